//! Instrumental variables on a closed loop whose noise is fed back, against least squares on the
//! same records.

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_fit::integrate::{Drive, Settings, simulate};
use pid_fit::regress::record::Filtering;
use pid_fit::regress::{Options, Regression, regress};
use pid_fit::wrap::controllers::Controllers;
use pid_models::Emps;
use pid_runtime::dynamics::Dynamics;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const H: f64 = 1e-3;
const SAMPLES: usize = 4001;
const P: f64 = 60_000.0;
const D: f64 = 3_000.0;
/// Standard deviation of the position readings, m.
const NOISE: f64 = 1e-5;

fn reference(t: f64) -> f64 {
    0.08 * (2.3 * t).sin() + 0.03 * (5.9 * t + 0.4).sin() + 0.01 * (14.1 * t).sin()
}

/// A PD controller that reads the position with noise, sample by sample.
fn record(seed: u64) -> Dataset {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let p: Vec<f64> = Emps.params().iter().map(|i| i.nominal).collect();
    let (mut q, mut v) = (vec![reference(0.0)], vec![0.0]);
    let (mut read, mut u, mut t, mut qref) = (vec![], vec![], vec![], vec![]);
    let mut previous = q[0];
    for k in 0..SAMPLES {
        let now = k as f64 * H;
        let reading = q[0] + NOISE * random.sample::<f64, _>(StandardNormal);
        let force = P * (reference(now) - reading) - D * (reading - previous) / H;
        previous = reading;
        t.push(now);
        read.push(reading);
        u.push(force);
        qref.push(reference(now));
        let drive = Drive {
            t: &[0.0, H],
            u: &[force, force],
            hold: InputHold::ZeroOrder,
        };
        let next = simulate(&Emps, &p, &q, &v, &drive, Settings::default()).expect("simulates");
        (q, v) = (next.q[1..].to_vec(), next.v[1..].to_vec());
    }
    Dataset {
        name: "loop".into(),
        title: "a loop".into(),
        source: "simulated".into(),
        license: "CC0-1.0".into(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: vec![JointChannels {
            name: "x".into(),
            prismatic: true,
            input: InputQuantity::Force,
            input_unit: "N".into(),
            velocity: VelocityKind::Absent,
        }],
        experiments: vec![Experiment {
            name: "train".into(),
            role: Role::Train,
            note: String::new(),
            nq: 1,
            t,
            q: read,
            v: None,
            u,
            tau: None,
            qref: Some(qref),
            missing: 0,
            gain_factors: Default::default(),
        }],
        warnings: Vec::new(),
    }
}

fn run(dataset: &Dataset, instruments: Option<Controllers>) -> Regression {
    let start: Vec<f64> = Emps.params().iter().map(|i| i.nominal).collect();
    let options = Options {
        // Wide open: the derivatives of the readings are noise above a few tens of Hz.
        filtering: Filtering {
            cutoff: Some(100.0),
            decimate: Some(1),
        },
        instruments,
        consistent: false,
        poses: 1,
        ..Options::default()
    };
    regress(&Emps, dataset, &start, &options).expect("regresses")
}

#[test]
fn fed_back_noise_biases_least_squares_and_not_instruments() {
    let text = format!("[[record]]\nname = \"*\"\np = [{P:?}]\nd = [{D:?}]\n");
    let controllers = Controllers::parse("loop.toml", &text, 1).expect("readable");
    let inertia = |found: &Regression| -> (f64, f64) {
        let row = found.rows.iter().find(|r| r.formula == "mass");
        let row = row.unwrap_or_else(|| panic!("{:?}", found.rows));
        (row.value, row.deviation)
    };
    let truth = Emps.params()[0].nominal;
    let (mut by_squares, mut by_instruments, mut deviations) = (vec![], vec![], vec![]);
    for seed in 0..12 {
        let dataset = record(seed);
        by_squares.push(inertia(&run(&dataset, None)).0 / truth - 1.0);
        let found = run(&dataset, Some(controllers.clone()));
        let (rounds, _) = found.instruments.as_ref().expect("asked for");
        assert!(rounds.settled && rounds.distance < 0.01, "{rounds:?}");
        let (value, deviation) = inertia(&found);
        by_instruments.push(value / truth - 1.0);
        deviations.push(deviation / truth);
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (squares, instruments) = (mean(&by_squares), mean(&by_instruments));
    let scatter = (by_instruments
        .iter()
        .map(|x| (x - instruments).powi(2))
        .sum::<f64>()
        / 11.0)
        .sqrt();
    assert!(squares < -0.05, "least squares lose inertia: {squares}");
    // The mean of twelve is known to scatter/√12; the hold of the sampled loop adds a little.
    assert!(
        instruments.abs() < 3.0 * scatter / 12.0_f64.sqrt() + 2e-3,
        "{instruments} ± {scatter}"
    );
    assert!(instruments.abs() < 0.1 * squares.abs());
    // The jackknife foretells the scatter.
    let foretold = mean(&deviations);
    assert!(
        (0.4..2.5).contains(&(foretold / scatter)),
        "{foretold} {scatter}"
    );
}
