//! Franka Emika Panda, seven joints.
//!
//! Sources: kinematics by Franka Emika, *Franka Control Interface documentation*,
//! Denavit-Hartenberg parameters in Craig's convention; inertial parameters by C. Gaz, M. Cognetti,
//! A. Oliva, P. Robuffo Giordano, A. De Luca, *Dynamic Identification of the Franka Emika Panda
//! Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization*, IEEE Robotics and
//! Automation Letters 4(4), 2019, in the rounded form in which they are distributed with the
//! manufacturer's robot description (centre of mass of link 1 at z = −0.04762 m). Frames are those
//! of Craig's convention: z along the joint axis.
//!
//! | joint | a (previous), m | d, m | α (previous) |
//! |---|---|---|---|
//! | 1 | 0 | 0.333 | 0 |
//! | 2 | 0 | 0 | −π/2 |
//! | 3 | 0 | 0.316 | π/2 |
//! | 4 | 0.0825 | 0 | π/2 |
//! | 5 | −0.0825 | 0.384 | −π/2 |
//! | 6 | 0 | 0 | π/2 |
//! | 7 | 0.088 | 0 | π/2 |
//!
//! Inertial parameters are in the linear form, ten per link. Friction: nominal values of the size
//! usual for such drives, the transition of dry friction at rest fixed. Input is the torque of the
//! drive at the joint.

use pid_runtime::robot;

robot! {
    /// Franka Emika Panda, inertial parameters in linear form.
    pub robot Panda {
        gravity: [0, 0, -9.81] m/s^2;

        link l1 {
            inertial: free;
            mass: 4.970684 kg; com: [0.003875, 0.002081, -0.04762] m;
            inertia at com: [xx: 0.70337, yy: 0.70661, zz: 0.009117, xy: -0.000139, xz: 0.006772, yz: 0.019169] kg*m^2;
        }
        link l2 {
            inertial: free;
            mass: 0.646926 kg; com: [-0.003141, -0.02872, 0.003495] m;
            inertia at com: [xx: 0.007962, yy: 0.02811, zz: 0.025995, xy: -0.003925, xz: 0.010254, yz: 0.000704] kg*m^2;
        }
        link l3 {
            inertial: free;
            mass: 3.228604 kg; com: [0.027518, 0.039252, -0.066502] m;
            inertia at com: [xx: 0.037242, yy: 0.036155, zz: 0.01083, xy: -0.004761, xz: -0.011396, yz: -0.012805] kg*m^2;
        }
        link l4 {
            inertial: free;
            mass: 3.587895 kg; com: [-0.05317, 0.104419, 0.027454] m;
            inertia at com: [xx: 0.025853, yy: 0.019552, zz: 0.028323, xy: 0.007796, xz: -0.001332, yz: 0.008641] kg*m^2;
        }
        link l5 {
            inertial: free;
            mass: 1.225946 kg; com: [-0.011953, 0.041065, -0.038437] m;
            inertia at com: [xx: 0.035549, yy: 0.029474, zz: 0.008627, xy: -0.002117, xz: -0.004037, yz: 0.000229] kg*m^2;
        }
        link l6 {
            inertial: free;
            mass: 1.666555 kg; com: [0.060149, -0.014117, -0.010517] m;
            inertia at com: [xx: 0.001964, yy: 0.004354, zz: 0.005433, xy: 0.000109, xz: -0.001158, yz: 0.000341] kg*m^2;
        }
        link l7 {
            inertial: free;
            mass: 0.735522 kg; com: [0.010517, -0.004252, 0.061597] m;
            inertia at com: [xx: 0.012516, yy: 0.010027, zz: 0.004815, xy: -0.000428, xz: -0.001196, yz: -0.000741] kg*m^2;
        }

        joint j1: revolute about z { base -> l1 at [0, 0, 0.333] m; limits: -2.8973..=2.8973 rad; }
        joint j2: revolute about z { l1 -> l2 rpy [-pi/2, 0, 0] rad; limits: -1.7628..=1.7628 rad; }
        joint j3: revolute about z { l2 -> l3 at [0, -0.316, 0] m rpy [pi/2, 0, 0] rad; limits: -2.8973..=2.8973 rad; }
        joint j4: revolute about z { l3 -> l4 at [0.0825, 0, 0] m rpy [pi/2, 0, 0] rad; limits: -3.0718..=-0.0698 rad; }
        joint j5: revolute about z { l4 -> l5 at [-0.0825, 0.384, 0] m rpy [-pi/2, 0, 0] rad; limits: -2.8973..=2.8973 rad; }
        joint j6: revolute about z { l5 -> l6 rpy [pi/2, 0, 0] rad; limits: -0.0175..=3.7525 rad; }
        joint j7: revolute about z { l6 -> l7 at [0.088, 0, 0] m rpy [pi/2, 0, 0] rad; limits: -2.8973..=2.8973 rad; }

        per joint {
            /// Torque of the drive at the joint.
            input torque: N*m;
            /// Dry friction.
            dry: N*m = [0.5, 0.5, 0.5, 0.5, 0.5, 0.3, 0.4] in 0.0..=10.0;
            /// Viscous friction.
            viscous: N*m*s/rad = [0.6, 0.6, 0.6, 0.6, 0.6, 0.4, 0.4] in 0.0..=10.0;

            force = torque - viscous*v - dry*tanh(v/(0.02 rad/s));
        }

        emit { dynamics, first_derivatives, second_derivatives, regressor, base_parameters, lanes }
    }
}
