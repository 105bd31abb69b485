//! The data of `pid` without arguments.
//!
//! The two-link robot with its nominal parameters (Table II of the source) is simulated with
//! controlled error and *one effect that its model lacks*: dry friction at the elbow grows towards
//! standstill (Stribeck friction),
//!
//! ```text
//! f = −8 N·m · exp(−(v / 0.8 rad/s)²) · tanh(50 v).
//! ```
//!
//! Positions and velocities carry white noise. The files are kept in `data/demo` and embedded; a
//! test makes them anew and compares.

use std::f64::consts::{PI, TAU};
use std::fmt::Write;

use pid_data::{Dataset, InputHold};
use pid_fit::integrate::{Drive, Settings, SimulateError, Simulator};
use pid_models::TwoLink;
use pid_runtime::dynamics::{At, Dims, Dynamics, InputInfo, JointInfo, ParamInfo};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Name of the model that belongs to the data.
pub const MODEL: &str = "two_link";

/// The embedded files.
pub(crate) const FILES: [(&str, &str); 4] = [
    ("dataset.toml", include_str!("../data/demo/dataset.toml")),
    (
        "train_sway.csv",
        include_str!("../data/demo/train_sway.csv"),
    ),
    (
        "train_swing.csv",
        include_str!("../data/demo/train_swing.csv"),
    ),
    (
        "test_steps.csv",
        include_str!("../data/demo/test_steps.csv"),
    ),
];

/// The embedded data set.
///
/// # Errors
/// Cannot fail on these data; passes on the error of the reader.
pub fn dataset() -> Result<Dataset, pid_data::DataError> {
    Dataset::from_embedded(&FILES)
}

/// Sampling step, s, and number of samples of each record.
const STEP: f64 = 0.01;
const SAMPLES: usize = 601;
/// Standard deviations of the noise, rad and rad/s.
const NOISE: [f64; 2] = [2e-4, 3e-3];
const SEED: u64 = 2019;

/// Makes the files anew: pairs of name and content.
///
/// # Errors
/// Cannot fail on these data; passes on the error of the simulation.
pub(crate) fn generate() -> Result<Vec<(String, String)>, SimulateError> {
    let mut files = vec![("dataset.toml".to_owned(), FILES[0].1.to_owned())];
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    for (name, q0, input) in RECORDS {
        files.push((format!("{name}.csv"), record(q0, input, &mut random)?));
    }
    Ok(files)
}

type Input = fn(f64) -> [f64; 2];
const RECORDS: [(&str, [f64; 2], Input); 3] = [
    ("train_sway", [0.2, 3.6], sway),
    ("train_swing", [-0.4, 2.4], swing),
    ("test_steps", [0.0, PI], steps),
];

/// Slow sines: many reversals of the elbow about its hanging position.
fn sway(t: f64) -> [f64; 2] {
    let sines = |a: &[(f64, f64, f64)]| a.iter().map(|(a, f, p)| a * (TAU * f * t + p).sin()).sum();
    [
        sines(&[(12.0, 0.4, 0.3), (6.0, 0.9, 1.7)]),
        sines(&[(90.0, 0.3, 0.0), (55.0, 0.75, 1.1), (25.0, 1.6, 2.4)]),
    ]
}

/// Faster sines: large swings.
fn swing(t: f64) -> [f64; 2] {
    let sines = |a: &[(f64, f64, f64)]| a.iter().map(|(a, f, p)| a * (TAU * f * t + p).sin()).sum();
    [
        sines(&[(14.0, 0.6, 0.0), (8.0, 1.4, 0.9)]),
        sines(&[(110.0, 0.5, 0.8), (70.0, 1.1, 0.2), (30.0, 2.1, 1.9)]),
    ]
}

/// A new level every 0.6 s.
fn steps(t: f64) -> [f64; 2] {
    const LEVELS: [[f64; 2]; 10] = [
        [8.0, 60.0],
        [-6.0, -40.0],
        [12.0, 90.0],
        [0.0, 20.0],
        [-12.0, -110.0],
        [4.0, -30.0],
        [10.0, 70.0],
        [-8.0, 100.0],
        [6.0, -80.0],
        [-10.0, 0.0],
    ];
    LEVELS[((t + 1e-9) / 0.6) as usize % LEVELS.len()]
}

fn record(q0: [f64; 2], input: Input, random: &mut ChaCha8Rng) -> Result<String, SimulateError> {
    let t: Vec<f64> = (0..SAMPLES)
        .map(|i| rounded(i as f64 * STEP, 1e6))
        .collect();
    // The written inputs act: they are rounded before they are used.
    let u: Vec<f64> = t
        .iter()
        .flat_map(|t| input(*t))
        .map(|u| rounded(u, 1e4))
        .collect();
    let robot = WithStribeck(&TwoLink);
    let p: Vec<f64> = TwoLink.params().iter().map(|p| p.nominal).collect();
    let (mut q, mut v) = (vec![0.0; 2 * SAMPLES], vec![0.0; 2 * SAMPLES]);
    let accurate = Settings {
        rtol: 1e-10,
        atol: 1e-11,
        ..Settings::default()
    };
    let drive = Drive {
        t: &t,
        u: &u,
        hold: InputHold::ZeroOrder,
    };
    Simulator::new(&robot, accurate).run(&p, &q0, &[0.0, 0.0], &drive, &mut q, &mut v)?;

    let mut text = String::from("t,q1,q2,dq1,dq2,u1,u2\n");
    for (i, t) in t.iter().enumerate() {
        let row = 2 * i..2 * i + 2;
        let _ = write!(text, "{t}");
        for (values, noise) in [(&q, NOISE[0]), (&v, NOISE[1])] {
            for x in &values[row.clone()] {
                let _ = write!(text, ",{}", rounded(x + noise * gaussian(random), 1e6));
            }
        }
        for u in &u[row] {
            let _ = write!(text, ",{u}");
        }
        text.push('\n');
    }
    Ok(text)
}

fn rounded(x: f64, scale: f64) -> f64 {
    (x * scale).round() / scale
}

/// A normal number by the method of Box and Muller. The embedded files and the published study of
/// the VS-050 were drawn with it: all other draws are by `rand_distr`.
pub(crate) fn gaussian(random: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

/// A two-joint robot with Stribeck friction at its second joint.
struct WithStribeck<'a>(&'a dyn Dynamics);

impl WithStribeck<'_> {
    fn extra(v: f64) -> f64 {
        -8.0 * (-(v / 0.8).powi(2)).exp() * (50.0 * v).tanh()
    }
}

impl Dynamics for WithStribeck<'_> {
    fn name(&self) -> &str {
        self.0.name()
    }
    fn dims(&self) -> Dims {
        self.0.dims()
    }
    fn params(&self) -> &[ParamInfo] {
        self.0.params()
    }
    fn joints(&self) -> &[JointInfo] {
        self.0.joints()
    }
    fn inputs(&self) -> &[InputInfo] {
        self.0.inputs()
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        self.0.mass_matrix(at, m);
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        self.0.bias(at, b);
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        self.0.applied_force(at, f);
        f[1] += Self::extra(at.v[1]);
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        self.0.residual(at, r);
        r[1] -= Self::extra(at.v[1]);
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        self.0.kinetic_energy(at)
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.0.potential_energy(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_files_are_those_that_are_generated() {
        let made = generate().unwrap();
        assert_eq!(made.len(), FILES.len());
        for ((name, text), (kept_name, kept)) in made.iter().zip(FILES) {
            assert_eq!(name, kept_name);
            assert_eq!(text.lines().count(), kept.lines().count(), "{name}");
            for (line, (a, b)) in text.lines().zip(kept.lines()).enumerate() {
                let numbers = |s: &str| {
                    s.split(',')
                        .map(|c| c.parse::<f64>().ok())
                        .collect::<Vec<_>>()
                };
                // Libraries of functions differ in the last place, and so may the last digit
                // written.
                let same = a == b
                    || numbers(a)
                        .iter()
                        .zip(numbers(b))
                        .all(|(a, b)| match (a, b) {
                            (Some(a), Some(b)) => (a - b).abs() < 2.5e-6,
                            _ => false,
                        });
                assert!(
                    same,
                    "{name}, line {}: {a} for {b}; run `simtrue demo-data --out pid-cli/data/demo`",
                    line + 1
                );
            }
        }
    }

    #[test]
    fn the_data_belong_to_the_model_and_move_as_intended() {
        let data = dataset().unwrap();
        assert!(data.warnings.is_empty(), "{:?}", data.warnings);
        data.check_model(&TwoLink).unwrap();
        for e in &data.experiments {
            let v = e.v.as_ref().unwrap();
            let reversals = (1..e.len())
                .filter(|i| v[2 * i + 1] * v[2 * i - 1] < 0.0)
                .count();
            assert!(
                reversals >= 6,
                "{}: {reversals} reversals of the elbow",
                e.name
            );
            assert!(v.iter().all(|v| v.abs() < 20.0));
        }
    }
}
