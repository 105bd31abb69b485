//! Robots that `robot!` accepts: their units, ranges and names.

/// The warning about `l` is silenced by the attribute.
#[deny(warnings)]
mod silenced {
    pid_runtime::robot! {
        #[allow(deprecated)]
        /// A rod without a nominal length.
        pub(crate) robot Rod {
            gravity: [0, 0, -9.81] m/s^2;
            params { l: m in 0.1..=0.5; }
            link rod { mass: 2 kg; com: [0, 0, -l]; }
            joint pivot: revolute about y { base -> rod; }
        }
    }
}

mod chain {
    pid_runtime::robot! {
        /// Millimetres, degrees, open ranges, expressions, a full tensor, a fixed flange, a chain
        /// declared by ranges.
        pub(crate) robot Chain {
            gravity: [0, 0, -g] m/s^2;
            params {
                g: m/s^2 = 9.81 fixed;
                l: mm = 300 in 100..;
                k: N*m/deg = 1.5 in ..=3.0;
            }
            link l1..=l2 {
                inertial: free;
                mass: 2 kg;
                com: [0, 0, 150] mm;
                inertia at com: diag(0.02, 0.02, 0.002) kg*m^2;
            }
            link tool {
                mass: 0.2 kg;
                com: [0, 0, l/2];
                inertia at origin: [xx: 0.01, yy: 0.01, zz: 0.001, xy: 0, xz: 0, yz: 1e-4] kg*m^2;
            }
            joint j1: revolute about [0, 0.6, 0.8] { base -> l1 rpy [0, 90, 0] deg; limits: -120..=120 deg; }
            joint j2: prismatic along x { l1 -> l2 at [0, 0, l]; }
            joint flange: fixed { l2 -> tool at [0, 0, 50 mm]; }
            per joint j1 {
                input torque: N*m;
                rotor: kg*m^2 = 0.01 in 0.0..=0.1;
                armature = rotor;
                force = torque - k*q;
            }
            per joint j2 { input push: N; force = push - 10 N*s/m * v; }
            force on j2 = -2.0 N/m * (q - l) + 0.1 N/rad * q.j1;
        }
    }
}

mod lists {
    pid_runtime::robot! {
        /// Values and ranges joint by joint.
        pub(crate) robot Pair {
            gravity: [0, 0, 0] m/s^2;
            link a { mass: 1 kg; com: [0.1, 0, 0] m; }
            link b { mass: 1 kg; com: [0.1, 0, 0] m; }
            joint first: revolute about z { base -> a; }
            joint second: revolute about z { a -> b at [0.2, 0, 0] m; }
            per joint {
                input u: N*m;
                damping: N*m*s/rad = [1.0, 2.0] in [0.5..=1.5, 0.0..=20.0];
                force = u - damping*v;
            }
        }
    }
}

use chain::{Chain, ChainInputs, ChainParam, ChainParams};
use pid_runtime::dynamics::Dynamics;

#[test]
fn values_are_converted_to_si() {
    let p = ChainParams::nominal();
    assert!((p.l - 0.3).abs() < 1e-15);
    assert!((p.k - 1.5 * 180.0 / std::f64::consts::PI).abs() < 1e-12);
    assert_eq!(ChainParam::K.unit(), "N*m/rad");
    assert_eq!(ChainParam::L.unit(), "m");
    let limits = Chain.joints()[0].limits.unwrap();
    assert!((limits.1 - 2.0 * std::f64::consts::PI / 3.0).abs() < 1e-15);
}

#[test]
fn open_ranges_are_infinite() {
    assert_eq!(ChainParams::lower().k, f64::NEG_INFINITY);
    assert_eq!(ChainParams::upper().l, f64::INFINITY);
    assert!(Chain.params()[ChainParam::G.index()].fixed);
}

#[test]
fn free_inertia_takes_its_nominal_values_from_the_link() {
    let p = ChainParams::nominal();
    assert_eq!(p.l1_m, 2.0);
    assert!((p.l1_mz - 0.3).abs() < 1e-15);
    // Steiner: 0.02 + 2 * 0.15².
    assert!((p.l2_ixx - 0.065).abs() < 1e-15);
    assert_eq!(p.l2_izz, 0.002);
}

#[test]
fn laws_of_a_joint_are_added_up() {
    let p = ChainParams::nominal();
    let inputs = ChainInputs {
        torque_j1: 1.0,
        push_j2: 5.0,
    };
    let f = Chain::applied_force(&[0.5, 0.4], &[0.0, 0.1], &inputs, &p);
    assert!((f[0] - (1.0 - p.k * 0.5)).abs() < 1e-12);
    assert!((f[1] - (5.0 - 1.0 - 2.0 * 0.1 + 0.05)).abs() < 1e-12);
}

#[test]
fn lists_give_each_joint_its_own_value_and_range() {
    use lists::PairParams;
    let (p, upper) = (PairParams::nominal(), PairParams::upper());
    assert_eq!((p.damping_first, p.damping_second), (1.0, 2.0));
    assert_eq!((upper.damping_first, upper.damping_second), (1.5, 20.0));
}

#[test]
fn the_middle_of_the_range_stands_for_a_missing_nominal_value() {
    assert!((silenced::RodParams::nominal().l - 0.3).abs() < 1e-15);
}
