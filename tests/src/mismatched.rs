//! Simulated records with noise and with a plant whose Stribeck friction the model lacks: of the two-link robot under sums of sines,
//! of the six-axis arm under inverse-dynamics control.

use std::f64::consts::TAU;

use pid_models::Arm6;
use pid_runtime::data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_runtime::dynamics::{At, Dynamics, Hessian, JointInfo};
use pid_runtime::integrate::{self, Drive, SimulateError, Simulator};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Inputs at a time from what is measured: (t, q, v, gains) → u.
pub type Control = dyn Fn(f64, &[f64], &[f64], &[f64]) -> Vec<f64>;

/// Currents of the two-link robot.
pub fn sines(t: f64, _: &[f64], _: &[f64], _: &[f64]) -> Vec<f64> {
    const PARTS: [[(f64, f64, f64); 4]; 2] = [
        [
            (12.0, 0.25, 0.0),
            (12.0, 0.61, 1.0),
            (10.0, 1.13, 2.0),
            (8.0, 1.97, 0.5),
        ],
        [
            (70.0, 0.21, 0.3),
            (60.0, 0.47, 2.1),
            (50.0, 0.83, 4.0),
            (40.0, 1.39, 1.2),
        ],
    ];
    let sum = |parts: &[(f64, f64, f64); 4]| {
        parts
            .iter()
            .map(|(a, f, phase)| a * (TAU * f * t + phase).sin())
            .sum()
    };
    PARTS.iter().map(sum).collect()
}

/// Parameters a fifth below the nominal ones, as far as their bounds allow.
pub fn start(model: &dyn Dynamics) -> Vec<f64> {
    let infos = model.params().iter();
    infos
        .map(|p| (0.8 * p.nominal).clamp(p.lower, p.upper))
        .collect()
}

/// Where axis `j` of the arm shall be, how fast, and its acceleration.
fn reference(t: f64, j: usize) -> [f64; 3] {
    let centre = [0.0, -0.8, 1.2, -0.6, 0.4, 0.0][j];
    let [mut q, mut v, mut a_to] = [centre, 0.0, 0.0];
    for (a, f, phase) in [(0.45, 0.11, 0.9), (0.25, 0.37, 2.3), (0.08, 0.97, 4.1)] {
        let (f, phase) = (f * (1.0 + 0.13 * j as f64), phase * (1 + j) as f64);
        let angle = TAU * f * t + phase;
        q += a * angle.sin();
        v += a * TAU * f * angle.cos();
        a_to -= a * (TAU * f).powi(2) * angle.sin();
    }
    [q, v, a_to]
}

/// The arm under control by its inverse dynamics, loops of 20 rad/s with critical damping.
pub fn follow(t: f64, q: &[f64], v: &[f64], gains: &[f64]) -> Vec<f64> {
    let one = |j: usize| {
        let [to_q, to_v, to_a] = reference(t, j);
        to_a + 400.0 * (to_q - q[j]) + 40.0 * (to_v - v[j])
    };
    let a: Vec<f64> = (0..6).map(one).collect();
    let p: Vec<f64> = Arm6.params().iter().map(|p| p.nominal).collect();
    let mut force = [0.0; 6];
    let at = At {
        q,
        v,
        a: &a,
        u: &[0.0; 6],
        p: &p,
    };
    // Without input the residual is the force that the drives must bring.
    Arm6.residual(&at, &mut force);
    force.iter().zip(gains).map(|(f, gain)| f / gain).collect()
}

/// Stribeck friction at a joint, which the model does not know of: a share of its dry friction that fades with speed.
fn stribeck(dry: f64, v: f64) -> f64 {
    0.3 * dry * (-(v / 0.3).powi(2)).exp() * (20.0 * v).tanh()
}

/// A record of so many samples, with noise of 1e-3 rad and 1e-2 rad/s.
///
/// # Errors
/// If the motion cannot be simulated.
pub fn record(
    model: &dyn Hessian,
    control: &Control,
    samples: usize,
    step: f64,
) -> Result<Dataset, SimulateError> {
    let nq = model.dims().nq;
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let named = |prefix: &str| -> Vec<f64> {
        let wanted = model
            .params()
            .iter()
            .zip(&p)
            .filter(|(i, _)| i.name.starts_with(prefix));
        wanted.map(|(_, p)| *p).collect()
    };
    let (gains, dry) = (named("gain_"), named("dry_"));
    let loose = integrate::Settings {
        rtol: 1e-6,
        atol: 1e-8,
        ..integrate::Settings::default()
    };
    let mut simulator = Simulator::with_derivatives(model, loose);
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut gaussian = || -> f64 {
        let (a, b): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
    };
    let (mut q, mut v) = (vec![0.0; nq], vec![0.0; nq]);
    if nq == 6 {
        (0..nq).for_each(|j| [q[j], v[j], _] = reference(0.0, j));
    } else {
        q.copy_from_slice(&[0.3, 2.2]);
    }
    let (mut qs, mut vs) = (vec![0.0; 2 * nq], vec![0.0; 2 * nq]);
    let t: Vec<f64> = (0..samples).map(|k| k as f64 * step).collect();
    let (mut all_q, mut all_v, mut all_u) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..samples {
        let u = control(t[k], &q, &v, &gains);
        all_q.extend(q.iter().map(|q| q + 1e-3 * gaussian()));
        all_v.extend(v.iter().map(|v| v + 1e-2 * gaussian()));
        all_u.extend_from_slice(&u);
        if k + 1 < samples {
            // What acts is the recorded input less the friction that the model lacks, as it is at the sample.
            let mut held = [u.as_slice(), u.as_slice()].concat();
            for (k, held) in held.iter_mut().enumerate() {
                let j = k % nq;
                *held -= stribeck(dry[j], v[j]) / gains[j];
            }
            let drive = Drive {
                t: &t[k..k + 2],
                u: &held,
                hold: InputHold::ZeroOrder,
            };
            simulator.run(&p, &q, &v, &drive, &mut qs, &mut vs)?;
            q.copy_from_slice(&qs[nq..]);
            v.copy_from_slice(&vs[nq..]);
        }
    }
    let joint = |j: &JointInfo| JointChannels {
        name: j.name.to_string(),
        prismatic: false,
        input: InputQuantity::Current,
        input_unit: "A".to_owned(),
        velocity: VelocityKind::Measured,
    };
    Ok(Dataset {
        name: model.name().to_owned(),
        title: "Record for the growth of time and memory".to_owned(),
        source: "simulated with noise and Stribeck friction".to_owned(),
        license: "CC0-1.0".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: model.joints().iter().map(joint).collect(),
        experiments: vec![Experiment {
            name: "train".to_owned(),
            role: Role::Train,
            note: String::new(),
            nq,
            t,
            q: all_q,
            v: Some(all_v),
            u: all_u,
            tau: None,
            qref: None,
            missing: 0,
        }],
        warnings: Vec::new(),
    })
}
