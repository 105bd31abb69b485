//! The idealised robot of the paper: its records, starts, and the combinations that its motions can
//! determine.

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_fit::ident::starts::{Sampling, draw};
use pid_fit::integrate::{self, Drive, SimulateError};
use pid_models::TwoLink;
use pid_runtime::dynamics::Dynamics;

/// Samples of a record, and its length, s. The paper's figures end at M = 301; the step is 0.02 s.
pub(super) const SAMPLES: usize = 301;
const LENGTH: f64 = 6.0;

/// Parts of a current: amplitude in A, frequency in Hz, phase.
type Parts = [(f64, f64, f64)];

const TRAIN: [&Parts; 2] = [
    &[
        (12.0, 0.25, 0.0),
        (12.0, 0.60, 1.0),
        (10.0, 1.10, 2.0),
        (8.0, 1.90, 0.5),
        (6.0, 3.10, 4.0),
    ],
    &[
        (70.0, 0.20, 0.3),
        (60.0, 0.45, 2.1),
        (50.0, 0.80, 4.0),
        (40.0, 1.40, 1.2),
        (30.0, 2.30, 5.0),
    ],
];
/// The same robot moved faster.
const FAST: [&Parts; 2] = [
    &[(15.0, 0.9, 0.4), (9.0, 2.2, 1.5), (6.0, 3.9, 3.0)],
    &[(60.0, 0.7, 1.0), (55.0, 1.7, 2.6), (35.0, 3.1, 0.3)],
];

fn sum(parts: &Parts, t: f64) -> f64 {
    let part = |&(a, f, phase): &(f64, f64, f64)| a * (std::f64::consts::TAU * f * t + phase).sin();
    parts.iter().map(part).sum()
}

/// Levels that change every 0.75 s: qualitatively different from sums of sines.
fn steps(t: f64) -> [f64; 2] {
    const LEVELS: [[f64; 2]; 8] = [
        [20.0, 60.0],
        [-15.0, -90.0],
        [0.0, 30.0],
        [25.0, -40.0],
        [-20.0, 100.0],
        [10.0, 0.0],
        [-5.0, -70.0],
        [15.0, 80.0],
    ];
    LEVELS[((t + 1e-9) / 0.75) as usize % LEVELS.len()]
}

/// Values of Table II.
pub(super) fn truth() -> Vec<f64> {
    TwoLink.params().iter().map(|p| p.nominal).collect()
}

/// Training record and two unseen ones, simulated accurately with the values of Table II, without
/// noise as in the paper.
///
/// # Errors
/// That of the simulation.
pub(super) fn records() -> Result<Dataset, SimulateError> {
    let t: Vec<f64> = (0..SAMPLES)
        .map(|k| k as f64 * LENGTH / (SAMPLES - 1) as f64)
        .collect();
    let sines = |parts: [&'static Parts; 2]| move |t: f64| [sum(parts[0], t), sum(parts[1], t)];
    type Input = Box<dyn Fn(f64) -> [f64; 2]>;
    let plan: [(&str, Role, [f64; 2], Input); 3] = [
        ("train", Role::Train, [0.3, 2.2], Box::new(sines(TRAIN))),
        ("test_fast", Role::Test, [-0.2, 3.5], Box::new(sines(FAST))),
        ("test_steps", Role::Test, [0.0, 3.0], Box::new(steps)),
    ];
    let accurate = integrate::Settings {
        rtol: 1e-10,
        atol: 1e-12,
        ..integrate::Settings::default()
    };
    let mut experiments = Vec::new();
    for (name, role, q0, input) in plan {
        let u: Vec<f64> = t.iter().flat_map(|&t| input(t)).collect();
        let drive = Drive {
            t: &t,
            u: &u,
            hold: InputHold::ZeroOrder,
        };
        let motion = integrate::simulate(&TwoLink, &truth(), &q0, &[0.0; 2], &drive, accurate)?;
        experiments.push(Experiment {
            name: name.to_owned(),
            role,
            note: String::new(),
            nq: 2,
            t: t.clone(),
            q: motion.q,
            v: Some(motion.v),
            u,
            tau: None,
            qref: None,
            missing: 0,
            gain_factors: Default::default(),
        });
    }
    let joint = |name: &str| JointChannels {
        name: name.to_owned(),
        prismatic: false,
        input: InputQuantity::Current,
        input_unit: "A".to_owned(),
        velocity: VelocityKind::Measured,
    };
    Ok(Dataset {
        name: "two_link".to_owned(),
        title: "Idealised two-link robot".to_owned(),
        source: "simulated with controlled error".to_owned(),
        license: "CC0-1.0".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: vec![joint("shoulder"), joint("elbow")],
        experiments,
        warnings: Vec::new(),
    })
}

/// Starts "in their respective order of magnitude": factors 10^U(−0.5, 0.5) on the true values.
pub(super) fn starts(count: usize, seed: u64) -> Vec<Vec<f64>> {
    let infos = TwoLink.params();
    let lower: Vec<f64> = infos.iter().map(|p| p.lower).collect();
    let upper: Vec<f64> = infos.iter().map(|p| p.upper).collect();
    let mut all = draw(Sampling::Around, &truth(), &lower, &upper, count + 1, seed);
    // The first one is the truth itself.
    all.remove(0);
    all
}
