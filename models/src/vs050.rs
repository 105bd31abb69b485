//! DENSO VS-050, and the same robot with its outer four axes held.
//!
//! Kinematics: modified Denavit-Hartenberg parameters of `SaltworkerMLU/robotkinematicscatalogue`,
//! class VS-050, which agree with the maker's file of the VS-060 (`DENSORobot/denso_robot_ros`) in
//! all dimensions that the two robots share. Upright at zero, axes 1, 4, 6 along z, axes 2, 3, 5
//! along y:
//!
//! | from | to | m |
//! |---|---|---|
//! | base | shoulder | 0.345 up |
//! | shoulder | elbow | 0.250 up |
//! | elbow | forearm | 0.255 up, 0.010 back |
//! | wrist | flange | 0.070 up |
//!
//! No masses are published. The nominal bodies are assumed, with parameters in the linear form: an
//! identification finds their base combinations. Drives are given by current; gains and friction
//! are of the size usual for such an arm.

use pid_runtime::robot;

robot! {
    /// DENSO VS-050, six axes.
    pub robot Vs050 {
        gravity: [0, 0, -9.81] m/s^2;

        link l1 { inertial: free; mass: 7 kg; com: [0, 0, -0.05] m;   inertia at com: diag(0.06, 0.06, 0.04) kg*m^2; }
        link l2 { inertial: free; mass: 6 kg; com: [0, 0, 0.125] m;   inertia at com: diag(0.05, 0.05, 0.02) kg*m^2; }
        link l3 { inertial: free; mass: 4 kg; com: [-0.01, 0, 0.05] m; inertia at com: diag(0.02, 0.02, 0.01) kg*m^2; }
        link l4 { inertial: free; mass: 2 kg; com: [0, 0, -0.08] m;   inertia at com: diag(0.01, 0.01, 0.004) kg*m^2; }
        link l5 { inertial: free; mass: 0.8 kg; com: [0, 0, 0.01] m;  inertia at com: diag(8e-4, 8e-4, 8e-4) kg*m^2; }
        link l6 { inertial: free; mass: 0.2 kg; com: [0, 0, 0.05] m;  inertia at com: diag(1e-4, 1e-4, 1e-4) kg*m^2; }

        joint j1: revolute about z { base -> l1 at [0, 0, 0.345] m;       limits: -170..=170 deg; }
        joint j2: revolute about y { l1 -> l2;                            limits: -120..=120 deg; }
        joint j3: revolute about y { l2 -> l3 at [0, 0, 0.250] m;         limits: -120..=151 deg; }
        joint j4: revolute about z { l3 -> l4 at [-0.010, 0, 0.255] m;    limits: -270..=270 deg; }
        joint j5: revolute about y { l4 -> l5;                            limits: -120..=120 deg; }
        joint j6: revolute about z { l5 -> l6 at [0, 0, 0.070] m;         limits: -360..=360 deg; }

        per joint {
            /// Torque per ampere behind the gear.
            gain: N*m/A = [30, 30, 20, 10, 8, 5] in 0.5..=100.0;
            /// Dry friction.
            dry: N*m = [8, 8, 5, 2, 2, 1] in 0.0..=60.0;
            /// Viscous friction.
            viscous: N*m*s/rad = [10, 10, 6, 2, 2, 1] in 0.0..=60.0;
            /// Inertia of rotor and gear.
            rotor: kg*m^2 = [0.5, 0.5, 0.2, 0.05, 0.05, 0.02] in 0.0..=5.0;

            /// Motor current.
            drive: current { gain: gain; }
            armature = rotor;
            force = -dry*tanh(v/(0.02 rad/s)) - viscous*v;
        }

        emit { dynamics, first_derivatives, second_derivatives }

        /// DENSO VS-050 with axes 3 to 6 held straight: they are an extension of link 2.
        variant Vs050TwoAxis {
            lock j3..=j6 = 0 rad;
        }
    }
}
