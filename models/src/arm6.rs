//! A six-axis arm with all inertial parameters open: the example-robot-data URDF of the Universal
//! Robots UR10, fixed links merged. The dynamics benchmarks of other tools use the same arm, so its
//! speed can be compared.
//!
//! Source: `ur_description/urdf/ur10_robot.urdf` of the example-robot-data package (J. Carpentier
//! et al., Gepetto team, LAAS-CNRS): joint origins, masses, and inertias of homogeneous cylinders.
//! Ten standard parameters per link, in which the torques are linear, and four of the drive per
//! joint: 84. Friction and gains are not part of the source; their nominal values are of the size
//! usual for such drives.

use pid_runtime::robot;

robot! {
    /// Six-axis arm of the size of a UR10, inertial parameters in linear form.
    pub robot Arm6 {
        gravity: [0, 0, -9.81] m/s^2;

        /// Shoulder.
        link l1 {
            inertial: free;
            mass: 7.778 kg; com: [0, 0, 0] m;
            inertia at com: diag(0.031474312577, 0.031474312577, 0.021875625) kg*m^2;
        }
        /// Upper arm.
        link l2 {
            inertial: free;
            mass: 12.93 kg; com: [0, 0, 0.306] m;
            inertia at com: diag(0.421753803798, 0.421753803798, 0.036365625) kg*m^2;
        }
        /// Forearm.
        link l3 {
            inertial: free;
            mass: 3.87 kg; com: [0, 0, 0.28615] m;
            inertia at com: diag(0.111069694097, 0.111069694097, 0.010884375) kg*m^2;
        }
        /// First wrist.
        link l4 {
            inertial: free;
            mass: 1.96 kg; com: [0, 0, 0] m;
            inertia at com: diag(0.005108247957, 0.005108247957, 0.0055125) kg*m^2;
        }
        /// Second wrist.
        link l5 {
            inertial: free;
            mass: 1.96 kg; com: [0, 0, 0] m;
            inertia at com: diag(0.005108247957, 0.005108247957, 0.0055125) kg*m^2;
        }
        /// Third wrist and flange.
        link l6 {
            inertial: free;
            mass: 0.202 kg; com: [0, 0, 0] m;
            inertia at com: diag(0.000526462289, 0.000526462289, 0.000568125) kg*m^2;
        }

        joint j1: revolute about z { base -> l1 at [0, 0, 0.1273] m; }
        joint j2: revolute about y { l1 -> l2 at [0, 0.220941, 0] m rpy [0, pi/2, 0] rad; }
        joint j3: revolute about y { l2 -> l3 at [0, -0.1719, 0.612] m; }
        joint j4: revolute about y { l3 -> l4 at [0, 0, 0.5723] m rpy [0, pi/2, 0] rad; }
        joint j5: revolute about z { l4 -> l5 at [0, 0.1149, 0] m; }
        joint j6: revolute about y { l5 -> l6 at [0, 0, 0.1157] m; }

        per joint {
            /// Motor current.
            input current: A;
            /// Dry friction.
            dry: N*m = [12, 12, 8, 4, 4, 4] in 0.0..=60.0;
            /// Viscous friction.
            viscous: N*m*s/rad = [15, 15, 10, 5, 5, 5] in 0.0..=60.0;
            /// Torque per ampere.
            gain: N*m/A = [13, 13, 11, 9, 9, 9] in 0.5..=50.0;
            /// Sharpness of the transition of dry friction at rest.
            sharp: s/rad = 50.0 in 5.0..=500.0;

            force = gain*current - viscous*v - dry*tanh(sharp*v);
        }

        emit { dynamics, first_derivatives, second_derivatives, regressor, base_parameters, lanes }
    }
}
