//! Stäubli TX40, with its coupled wrist.
//!
//! Source: M. Gautier, S. Briot, *Global Identification of Joint Drive Gains and Dynamic Parameters
//! of Robots*, ASME Journal of Dynamic Systems, Measurement, and Control 2014: modified
//! Denavit-Hartenberg parameters, and the coupling of the wrist, in which motor 6 turns with
//! `q5 + q6`. Friction and rotor inertia are those identified with the tool FIGAROH
//! (`figaroh-plus`, example of the TX40).
//!
//! | joint | α, rad | a, m | d, m |
//! |---|---|---|---|
//! | 1 | 0 | 0 | 0 |
//! | 2 | −π/2 | 0 | 0 |
//! | 3 | 0 | 0.225 | 0.035 |
//! | 4 | π/2 | 0 | 0.225 |
//! | 5 | −π/2 | 0 | 0 |
//! | 6 | π/2 | 0 | 0 |
//!
//! Masses of the links are not published. The nominal bodies here are assumed such that the
//! combinations which were identified come out about right (m2 x2 + 0.225 (m3 + … + m6) = 2.17 kg
//! m, m3 y3 − 0.225 (m4 + m5 + m6) = −0.59 kg m); their parameters are in the linear form and for
//! an identification to find. Inputs are the torques at the joints.

use pid_runtime::robot;

robot! {
    /// Stäubli TX40: six revolute joints, motor 6 turned by joints 5 and 6 together.
    pub robot Tx40 {
        gravity: [0, 0, -9.81] m/s^2;

        /// Shoulder.
        link l1 {
            inertial: free; mass: 5 kg; com: [0, 0, -0.06] m; inertia at com: diag(0.04, 0.04, 0.03) kg*m^2;
        }
        /// Upper arm.
        link l2 {
            inertial: free; mass: 4 kg; com: [0.1, 0, 0] m; inertia at com: diag(0.02, 0.05, 0.05) kg*m^2;
        }
        /// Elbow.
        link l3 {
            inertial: free; mass: 5.4 kg; com: [0, -0.006, 0] m; inertia at com: diag(0.03, 0.03, 0.03) kg*m^2;
        }
        /// Forearm.
        link l4 {
            inertial: free; mass: 2 kg; com: [0, 0, -0.05] m; inertia at com: diag(0.01, 0.01, 0.004) kg*m^2;
        }
        /// Wrist.
        link l5 {
            inertial: free; mass: 0.4 kg; com: [0, -0.02, 0] m; inertia at com: diag(4e-4, 4e-4, 4e-4) kg*m^2;
        }
        /// Flange.
        link l6 {
            inertial: free; mass: 0.1 kg; com: [0, 0, 0.05] m; inertia at com: diag(5e-5, 5e-5, 5e-5) kg*m^2;
        }

        joint j1: revolute about z { base -> l1; }
        joint j2: revolute about z { l1 -> l2 rpy [-pi/2, 0, 0] rad; }
        joint j3: revolute about z { l2 -> l3 at [0.225, 0, 0.035] m; }
        joint j4: revolute about z { l3 -> l4 at [0, -0.225, 0] m rpy [pi/2, 0, 0] rad; }
        joint j5: revolute about z { l4 -> l5 rpy [-pi/2, 0, 0] rad; }
        joint j6: revolute about z { l5 -> l6 rpy [pi/2, 0, 0] rad; }

        per joint {
            /// Torque at the joint.
            input torque: N*m;
            /// Dry friction.
            dry: N*m = [7.232, 8.254, 6.29, 2.5155, 3.019, 0.5] in 0.0..=40.0;
            /// Viscous friction.
            viscous: N*m*s/rad = [8.028, 5.518, 1.996, 1.1085, 1.857, 0.6705] in 0.0..=40.0;
            /// Inertia of the rotor behind the gear.
            rotor: kg*m^2 = [0.3, 0.3, 0.079, 0.0317, 0.0471, 0.01] in 0.0..=2.0;

            armature = rotor;
            force = torque - viscous*v - dry*tanh(v/(0.05 rad/s));
        }

        /// Motor 6, which joint 5 turns as well.
        motor wrist: j5 + j6 {
            /// Dry friction.
            dry: N*m = 2.108 in 0.0..=40.0;
            /// Viscous friction.
            viscous: N*m*s/rad = 0.6086 in 0.0..=40.0;
            /// Inertia of the rotor behind the gear.
            rotor: kg*m^2 = 0.01 in 0.0..=2.0;

            armature = rotor;
            force = -viscous*v - dry*tanh(v/(0.05 rad/s));
        }

        emit { dynamics, first_derivatives, second_derivatives }
    }
}
