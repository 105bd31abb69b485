//! Universal Robots UR10e.
//!
//! Source: Universal Robots, support article *DH Parameters for calculations of kinematics and
//! dynamics*: Denavit-Hartenberg parameters, masses, centres of mass and inertia tensors of the
//! links of the UR10e, the latter two in the Denavit-Hartenberg frames. The frame of a link here
//! sits on its own joint axis (z), so that the published values are turned by `rotx(α)` and moved
//! by `(a, 0, d)`: centres of mass `(a, 0, d) + rotx(α) c`, tensors `rotx(α) I rotx(α)ᵀ`.
//!
//! | joint | a, m | d, m | α |
//! |---|---|---|---|
//! | 1 | 0 | 0.1807 | π/2 |
//! | 2 | −0.6127 | 0 | 0 |
//! | 3 | −0.57155 | 0 | 0 |
//! | 4 | 0 | 0.17415 | π/2 |
//! | 5 | 0 | 0.11985 | −π/2 |
//! | 6 | 0 | 0.11655 | 0 |
//!
//! Inertial parameters are in the linear form, ten per link. Friction is not published; its nominal
//! values are of the size usual for such drives, the transition of dry friction at rest is fixed.
//! Input is the torque of the drive at the joint.

use pid_runtime::robot;

robot! {
    /// Universal Robots UR10e, inertial parameters in linear form.
    pub robot Ur10e {
        gravity: [0, 0, -9.81] m/s^2;

        /// Shoulder.
        link shoulder {
            inertial: free;
            mass: 7.369 kg; com: [0.021, -0.027, 0.1807] m;
            inertia at com: [xx: 0.03408, yy: 0.02156, zz: 0.03529, xy: 0.00425, xz: 0.00002, yz: -0.00008] kg*m^2;
        }
        /// Upper arm.
        link upper_arm {
            inertial: free;
            mass: 13.051 kg; com: [-0.6127 + 0.380, 0, 0.158] m;
            inertia at com: [xx: 0.02814, yy: 0.77068, zz: 0.76943, xy: 0.00005, xz: -0.01561, yz: 0.00002] kg*m^2;
        }
        /// Forearm.
        link forearm {
            inertial: free;
            mass: 3.989 kg; com: [-0.57155 + 0.240, 0, 0.068] m;
            inertia at com: [xx: 0.01014, yy: 0.30928, zz: 0.30646, xy: 0.00008, xz: 0.00916, yz: 0] kg*m^2;
        }
        /// First wrist.
        link wrist_1 {
            inertial: free;
            mass: 2.1 kg; com: [0, -0.018, 0.17415 + 0.007] m;
            inertia at com: [xx: 0.00296, yy: 0.00258, zz: 0.00222, xy: 0, xz: -0.00001, yz: 0.00024] kg*m^2;
        }
        /// Second wrist.
        link wrist_2 {
            inertial: free;
            mass: 1.98 kg; com: [0, 0.018, 0.11985 - 0.007] m;
            inertia at com: [xx: 0.00296, yy: 0.00258, zz: 0.00222, xy: 0, xz: 0.00001, yz: 0.00024] kg*m^2;
        }
        /// Third wrist and flange.
        link wrist_3 {
            inertial: free;
            mass: 0.615 kg; com: [0, 0, 0.11655 - 0.026] m;
            inertia at com: diag(0.00040, 0.00041, 0.00034) kg*m^2;
        }

        joint shoulder_pan:  revolute about z { base -> shoulder; limits: -2*pi..=2*pi rad; }
        joint shoulder_lift: revolute about z {
            shoulder -> upper_arm at [0, 0, 0.1807] m rpy [pi/2, 0, 0] rad;
            limits: -2*pi..=2*pi rad;
        }
        joint elbow:  revolute about z { upper_arm -> forearm at [-0.6127, 0, 0] m; limits: -pi..=pi rad; }
        joint wrist1: revolute about z { forearm -> wrist_1 at [-0.57155, 0, 0] m; limits: -2*pi..=2*pi rad; }
        joint wrist2: revolute about z {
            wrist_1 -> wrist_2 at [0, 0, 0.17415] m rpy [pi/2, 0, 0] rad;
            limits: -2*pi..=2*pi rad;
        }
        joint wrist3: revolute about z {
            wrist_2 -> wrist_3 at [0, 0, 0.11985] m rpy [-pi/2, 0, 0] rad;
            limits: -2*pi..=2*pi rad;
        }

        per joint {
            /// Torque of the drive at the joint.
            input torque: N*m;
            /// Dry friction.
            dry: N*m = [15, 15, 8, 3, 3, 3] in 0.0..=60.0;
            /// Viscous friction.
            viscous: N*m*s/rad = [18, 18, 10, 3, 3, 3] in 0.0..=60.0;

            force = torque - viscous*v - dry*tanh(v/(0.02 rad/s));
        }

        emit { dynamics, first_derivatives, second_derivatives }
    }
}
