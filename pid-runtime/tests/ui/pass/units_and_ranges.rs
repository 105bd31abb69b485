use pid_runtime::robot;

robot! {
    /// Millimetres, degrees, open ranges, expressions, a full tensor, a fixed flange, a chain declared by ranges.
    pub(crate) robot Chain {
        gravity: [0, 0, -g] m/s^2;
        params {
            g: m/s^2 = 9.81 fixed;
            l: mm = 300 in 100..;
            k: N*m/deg = 1.5 in ..=3.0;
        }
        link l1..=l2 { inertial: free; mass: 2 kg; com: [0, 0, 150] mm; inertia at com: diag(0.02, 0.02, 0.002) kg*m^2; }
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

fn main() {
    let p = ChainParams::nominal();
    assert!((p.l - 0.3).abs() < 1e-15);
    assert!((p.k - 1.5 * 180.0 / std::f64::consts::PI).abs() < 1e-12);
    assert_eq!(p.l1_mz, 0.3);
    // Steiner: 0.02 + 2 * 0.15^2.
    assert!((p.l2_ixx - 0.065).abs() < 1e-15);
    assert!(ChainParams::lower().k == f64::NEG_INFINITY && ChainParams::upper().l == f64::INFINITY);
    assert_eq!(ChainParam::K.unit(), "N*m/rad");
    assert_eq!((Chain::NQ, Chain::NU), (2, 2));
}
