//! EMPS, the electro-mechanical positioning system: a carriage on a ball screw, one prismatic joint
//! without gravity.
//!
//! Source: A. Janot, M. Gautier, M. Brunot, *Data Set and Reference Models of EMPS*, Workshop on
//! Nonlinear System Identification Benchmarks, Eindhoven 2019. The reference model is
//!
//! ```text
//! M q'' = u − Fv q' − Fc sign(q') − offset          [N]
//! ```
//!
//! with the published values M = 95.1089 kg, Fv = 203.5034 N·s/m, Fc = 20.3935 N, offset = −3.1648
//! N (nominal values here). `u` is the force of the drive: control voltage times the published
//! total gain 35.1507 N/V. The sign is smoothed to `tanh(sharp q')`; at the nominal 1000 s/m it is
//! 96 % complete at 2 mm/s, against 0.1 m/s of the records' motions.

use pid_runtime::robot;

robot! {
    /// Electro-mechanical positioning system: a carriage driven along x.
    pub robot Emps {
        gravity: [0, 0, 0] m/s^2;

        params {
            /// Moving mass M, the inertia of motor and screw included.
            mass: kg = 95.1089 in 10.0..=300.0;
        }

        link carriage { mass: mass; }

        joint x: prismatic along x { base -> carriage; }

        per joint {
            /// Force of the drive.
            input force: N;
            /// Viscous friction Fv.
            viscous: N*s/m = 203.5034 in 0.0..=1000.0;
            /// Coulomb friction Fc.
            dry: N = 20.3935 in 0.0..=100.0;
            /// Constant force against the motion in positive direction: amplifier offset and asymmetry of friction.
            offset: N = -3.1648 in -30.0..=30.0;
            /// Sharpness of the transition of Coulomb friction at rest.
            sharp: s/m = 1000.0 in 50.0..=20000.0;

            force = force - viscous*v - dry*tanh(sharp*v) - offset;
        }
    }
}
