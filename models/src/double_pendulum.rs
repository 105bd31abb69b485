//! The double pendulum of DFKI, design C.1: two links in the vertical plane, quasi-direct drives at
//! shoulder and elbow.
//!
//! Source: F. Wiebe et al., *Open Source Dual-Purpose Acrobot and Pendubot Platform*, IEEE Robotics
//! & Automation Magazine 2024, DOI 10.1109/MRA.2023.3341257. `q = 0`: both links hang down; `q2` is
//! relative to link 1; positive turns are counter-clockwise seen from positive x, as z is up and y
//! to the right. Link 1 is 0.2 m long, link 2 0.3 m, the gear ratio of both drives is 6, g = 9.81
//! m/s².
//!
//! As in the source the inertias are about the joint axes, the centres of mass lie on the links,
//! and a rotor adds `6² · Ir` to its joint. The couplings of the rotors with the motion of the
//! links (of order `6 Ir`, 0.4 g·m²) are left out. Nominal values are the published parameter set
//! "model_1.0"; the same rotors sit at both joints.

use pid_runtime::robot;

robot! {
    /// Double pendulum with drives at both joints.
    pub robot DoublePendulum {
        gravity: [0, 0, -9.81] m/s^2;

        params {
            /// Mass of link 1, the drive of the elbow included.
            m1: kg = 0.52346 in 0.05..=3.0;
            /// Distance of the centre of mass of link 1 from the shoulder.
            r1: m = 0.2 in 0.01..=0.5;
            /// Inertia of link 1 about the shoulder's axis.
            i1: kg*m^2 = 0.031887 in 1e-4..=0.3;
            /// Mass of link 2.
            m2: kg = 0.62557 in 0.05..=3.0;
            /// Distance of the centre of mass of link 2 from the elbow.
            r2: m = 0.25569 in 0.01..=0.8;
            /// Inertia of link 2 about the elbow's axis.
            i2: kg*m^2 = 0.050870 in 1e-4..=0.3;
            /// Inertia of a rotor about its own axis.
            rotor: kg*m^2 = 6.287e-5 in 0.0..=1e-3;
        }

        link upper { mass: m1; com: [0, 0, -r1]; inertia at origin: diag(i1, _, _); }
        link lower { mass: m2; com: [0, 0, -r2]; inertia at origin: diag(i2, _, _); }

        joint shoulder: revolute about x { base -> upper; }
        joint elbow: revolute about x { upper -> lower at [0, 0, -0.2] m; }

        per joint {
            /// Torque commanded to the drive, at the joint.
            input torque: N*m;
            /// Viscous friction.
            viscous: N*m*s/rad = 0.001 in 0.0..=0.5;
            /// Coulomb friction.
            dry: N*m = [0.16, 0.12] in 0.0..=1.0;
            /// Sharpness of the transition of Coulomb friction at rest; steps of 2 ms resolve up to
            /// 60 s/rad.
            sharp: s/rad = 30.0 in 5.0..=60.0;

            armature = 36*rotor;
            force = torque - viscous*v - dry*tanh(sharp*v);
        }

        expect rank 11;
    }
}
