//! Records of a known robot: simulated motions under random multisines, read with noise of known
//! size.
//!
//! ```text
//! u_j(t) = A_j Σ_k sin(2π f_k t + φ_jk)/√(2 K)·2,      f_k = k/T, k = 1 … K,   K = ⌊f_max T⌋
//! ```
//!
//! with random phases φ, held between samples. Readings are the simulated states plus normal noise;
//! a share of them may be outliers. Everything follows from the seed.

use crate::integrate::{self, Drive, SimulateError};
use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_runtime::dynamics::{Hessian, Jacobian};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Settings of the records.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// Number of records.
    pub records: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// Sampling interval, s.
    pub step: f64,
    /// RMS value of each input, in its unit.
    pub amplitude: Vec<f64>,
    /// Highest frequency of the inputs, Hz.
    pub highest: f64,
    /// Positions at the start, rad or m; velocities are zero.
    pub start: Vec<f64>,
    /// Standard deviation of the reading noise, positions of all joints, then velocities; a
    /// velocity of `inf` is not read.
    pub noise: Vec<f64>,
    /// Share of the readings that are outliers, and their noise as a multiple of the ordinary one.
    pub outliers: (f64, f64),
}

impl Recipe {
    /// Two records from rest at zero, a sample every 2 ms, inputs of up to 1.5 Hz with these RMS
    /// values; noise of 1e-5 rad or m, and of 1e-4 of these per second; no outliers.
    pub fn new(seconds: f64, amplitude: &[f64]) -> Self {
        let n = amplitude.len();
        Recipe {
            records: 2,
            seconds,
            step: 0.002,
            amplitude: amplitude.to_vec(),
            highest: 1.5,
            start: vec![0.0; n],
            noise: [vec![1e-5; n], vec![1e-4; n]].concat(),
            outliers: (0.0, 1.0),
        }
    }
}

/// The records of a model with parameters `p`; all of them are for training.
///
/// # Errors
/// [`SimulateError`] if a motion cannot be simulated, a length of the recipe is not that of the
/// model, or the model has not one input for each coordinate.
pub fn records(
    model: &dyn Hessian,
    p: &[f64],
    recipe: &Recipe,
    seed: u64,
) -> Result<Dataset, SimulateError> {
    let nq = model.dims().nq;
    // Records hold one input for each coordinate.
    let lengths = [
        ("the inputs of a model with records", nq, model.dims().nu),
        ("`amplitude` of the recipe", nq, recipe.amplitude.len()),
        ("`noise` of the recipe", 2 * nq, recipe.noise.len()),
    ];
    for (what, expected, found) in lengths {
        if expected != found {
            return Err(SimulateError::Shape {
                what,
                expected,
                found,
            });
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let experiments = (1..=recipe.records)
        .map(|number| experiment(model, p, recipe, (number, &mut random)))
        .collect::<Result<_, _>>()?;
    Ok(Dataset {
        name: format!("{}, simulated", model.name()),
        title: format!("{}, simulated with seed {seed}", model.name()),
        source: "simulated".to_owned(),
        license: "CC0-1.0".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: channels(model, &recipe.noise),
        experiments,
        warnings: Vec::new(),
    })
}

/// One record, with its number from 1.
fn experiment(
    model: &dyn Hessian,
    p: &[f64],
    recipe: &Recipe,
    (number, random): (usize, &mut ChaCha8Rng),
) -> Result<Experiment, SimulateError> {
    let nq = model.dims().nq;
    let samples = (recipe.seconds / recipe.step).round() as usize + 1;
    let t: Vec<f64> = (0..samples).map(|k| k as f64 * recipe.step).collect();
    let u = multisine(recipe, nq, &t, random);
    let drive = Drive {
        t: &t,
        u: &u,
        hold: InputHold::ZeroOrder,
    };
    let settings = integrate::Settings {
        rtol: 1e-8,
        atol: 1e-10,
        ..integrate::Settings::default()
    };
    let model: &dyn Jacobian = model;
    let rest = vec![0.0; nq];
    let motion = integrate::simulate(model, p, &recipe.start, &rest, &drive, settings)?;
    let (of_q, of_v) = recipe.noise.split_at(nq);
    let q = readings(&motion.q, of_q, recipe.outliers, random);
    let v = readings(&motion.v, of_v, recipe.outliers, random);
    let measured = of_v.iter().any(|n| n.is_finite());
    Ok(Experiment {
        name: format!("record_{number}"),
        role: Role::Train,
        note: String::new(),
        nq,
        t,
        q,
        v: measured.then_some(v),
        u,
        tau: None,
        qref: None,
        missing: 0,
        gain_factors: Default::default(),
    })
}

/// Inputs of random phases, row by row.
fn multisine(recipe: &Recipe, nq: usize, t: &[f64], random: &mut ChaCha8Rng) -> Vec<f64> {
    let lines = ((recipe.highest * recipe.seconds).floor() as usize).max(1);
    let phases: Vec<f64> = (0..nq * lines)
        .map(|_| random.random_range(0.0..std::f64::consts::TAU))
        .collect();
    let input = |t: f64, j: usize| {
        let sum: f64 = (0..lines)
            .map(|k| {
                let turn = std::f64::consts::TAU * (k + 1) as f64 / recipe.seconds;
                (turn * t + phases[j * lines + k]).sin()
            })
            .sum();
        recipe.amplitude[j] * sum * (2.0 / lines as f64).sqrt()
    };
    t.iter()
        .flat_map(|&t| (0..nq).map(move |j| (t, j)))
        .map(|(t, j)| input(t, j))
        .collect()
}

/// Values as a sensor reads them, row by row; NaN where its noise is without bound.
fn readings(
    values: &[f64],
    noise: &[f64],
    (share, multiple): (f64, f64),
    random: &mut ChaCha8Rng,
) -> Vec<f64> {
    let read = |(k, x): (usize, &f64)| {
        let outlier = random.random_range(0.0..1.0) < share;
        let size = if outlier { multiple } else { 1.0 };
        let noise = noise[k % noise.len()];
        let error = random.sample::<f64, _>(StandardNormal);
        if noise.is_finite() {
            x + size * noise * error
        } else {
            f64::NAN
        }
    };
    values.iter().enumerate().map(read).collect()
}

fn channels(model: &dyn Hessian, noise: &[f64]) -> Vec<JointChannels> {
    let nq = model.dims().nq;
    let inputs = model.inputs();
    (0..nq)
        .map(|j| {
            let unit = inputs
                .iter()
                .find(|i| i.joint == Some(j))
                .map_or("", |i| i.unit.as_ref());
            let info = &model.joints()[j];
            JointChannels {
                name: info.name.to_string(),
                prismatic: info.prismatic,
                input: match unit {
                    "A" => InputQuantity::Current,
                    "V" => InputQuantity::Voltage,
                    _ if info.prismatic => InputQuantity::Force,
                    _ => InputQuantity::Torque,
                },
                input_unit: unit.to_owned(),
                velocity: if noise[nq + j].is_finite() {
                    VelocityKind::Measured
                } else {
                    VelocityKind::Absent
                },
            }
        })
        .collect()
}
