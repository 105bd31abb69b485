//! Friction that builds up over a displacement, found in records of a slide whose contact was
//! integrated over time.

use std::f64::consts::TAU;

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_fit::regress::record::Filtering;
use pid_fit::regress::{Options, Regression, regress};
use pid_models::Emps;
use pid_runtime::dynamics::Dynamics;
use pid_runtime::extend::Extended;
use pid_runtime::term::Request;

const STEP: f64 = 1e-3;
/// Mass, kg; viscous friction, N·s/m; level of the contact, N, and its width, m.
const TRUTH: (f64, f64, f64, f64) = (95.0, 200.0, 20.0, 1e-4);

/// A motion of half a millimetre with turns within the width of the contact, and its first two derivatives.
fn motion(t: f64, fast: f64) -> [f64; 3] {
    let waves = [(4e-4, 0.31), (1e-4, 0.83), (3e-5, 2.3)];
    waves.iter().fold([0.0; 3], |[q, v, a], (size, f)| {
        let w = TAU * f * fast;
        let (s, c) = (w * t).sin_cos();
        [q + size * s, v + size * w * c, a - size * w * w * s]
    })
}

fn record(name: &str, role: Role, fast: f64) -> Experiment {
    let (mass, viscous, level, width) = TRUTH;
    // The contact is integrated at a hundredth of the sampling interval, not by the operator under test.
    let fine = STEP / 100.0;
    let mut z = -0.3_f64;
    let (mut t, mut q, mut u) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..2_000_000_u32 {
        let time = f64::from(k) * fine;
        let [x, v, a] = motion(time, fast);
        if k % 100 == 0 {
            t.push(time);
            q.push(x);
            u.push(mass * a + viscous * v + level * z);
        }
        z = (z + fine * v / width).clamp(-1.0, 1.0);
    }
    Experiment {
        name: name.into(),
        role,
        note: String::new(),
        nq: 1,
        t,
        q,
        v: None,
        u,
        tau: None,
        qref: None,
        missing: 0,
        gain_factors: Default::default(),
    }
}

fn dataset() -> Dataset {
    Dataset {
        name: "slide".into(),
        title: String::new(),
        source: String::new(),
        license: String::new(),
        kind: Kind::Simulated,
        input_hold: InputHold::Linear,
        joints: vec![JointChannels {
            name: "x".into(),
            prismatic: true,
            input: InputQuantity::Force,
            input_unit: "N".into(),
            velocity: VelocityKind::Absent,
        }],
        experiments: vec![
            record("slow", Role::Train, 1.0),
            record("quick", Role::Train, 1.7),
            record("between", Role::Test, 1.3),
        ],
        warnings: Vec::new(),
    }
}

fn run(dataset: &Dataset, terms: &[&str]) -> Regression {
    let terms: Vec<Request> = terms.iter().map(|t| t.parse().expect("a term")).collect();
    let model = Extended::new(&Emps, &terms).expect("fits");
    let start: Vec<f64> = model.params().iter().map(|i| i.nominal).collect();
    let options = Options {
        filtering: Filtering {
            cutoff: Some(40.0),
            decimate: Some(5),
        },
        rest: Some(0.0),
        memories: model.memories().to_vec(),
        ..Options::default()
    };
    regress(&model, dataset, &start, &options).expect("solvable")
}

#[test]
fn the_level_is_found_at_its_width_and_motions_never_fitted_follow() {
    let dataset = dataset();
    let rigid = run(&dataset, &[]);
    let found = run(&dataset, &["presliding"]);
    let value = |name: &str| {
        let row = found.rows.iter().find(|r| r.formula == name);
        row.unwrap_or_else(|| panic!("{name}")).value
    };
    let level = TRUTH.2;
    assert!((value("presliding_100um_x") / level - 1.0).abs() < 0.01);
    assert!(value("presliding_10um_x").abs() < 0.02 * level);
    assert!((value("presliding_1um_x") + value("dry_x")).abs() < 0.02 * level);
    let test = |r: &Regression| r.errors.last().and_then(|e| e.overall).expect("a drive");
    assert!(
        test(&rigid) > 0.1 && test(&found) < 0.01,
        "{} {}",
        test(&rigid),
        test(&found)
    );
    // Friction with a memory is no force of the drive: the shares are of the same whole.
    let drive = |r: &Regression| {
        r.errors
            .last()
            .map(|e| e.rms[0] / e.relative[0].expect("acts"))
    };
    assert_eq!(
        drive(&rigid).map(|d| (d * 1e9).round()),
        drive(&found).map(|d| (d * 1e9).round())
    );
}
