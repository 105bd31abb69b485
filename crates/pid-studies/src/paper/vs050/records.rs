//! Records of the six-joint arm: axes 1 and 2 follow references under position control, axes 3 to 6
//! are held by it.
//!
//! A controller acts at every sample, as in a robot's cabinet; between samples its currents are
//! held and the arm is simulated with controlled error. The records hold what a cabinet would
//! record: positions, velocities and currents of axes 1 and 2, with noise.

use std::f64::consts::{FRAC_PI_2, TAU};

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_fit::integrate::{Drive, Settings, SimulateError, Simulator};
use pid_models::Vs050;
use pid_runtime::dynamics::Dynamics;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::super::gaussian;

/// Period of controller and record, s, and samples of a record.
const STEP: f64 = 0.01;
pub(super) const SAMPLES: usize = 601;
/// Standard deviations of the noise: rad, rad/s, and a share of the current with its smallest value in A.
const NOISE_Q: f64 = 1e-4;
const NOISE_V: f64 = 2e-3;
const NOISE_U: f64 = 5e-3;
/// Axes of the arm, and those that move.
const AXES: usize = 6;
const MOVED: usize = 2;
/// Inertia that each axis is controlled for, kg·m², and natural frequency of the loops, rad/s;
/// critically damped.
const INERTIA: [f64; AXES] = [0.7, 1.8, 0.4, 0.1, 0.1, 0.03];
const BANDWIDTH: f64 = 40.0;

/// Reference of the two axes at a time: positions and velocities.
type Reference = fn(f64) -> [[f64; MOVED]; 2];

/// Amplitude in rad, frequency in Hz, phase.
type Part = (f64, f64, f64);

fn sines(t: f64, centre: [f64; MOVED], parts: [&[Part]; MOVED]) -> [[f64; MOVED]; 2] {
    let mut out = [centre, [0.0; MOVED]];
    for (j, parts) in parts.into_iter().enumerate() {
        for &(amplitude, f, phase) in parts {
            let angle = TAU * f * t + phase;
            out[0][j] += amplitude * angle.sin();
            out[1][j] += amplitude * TAU * f * angle.cos();
        }
    }
    out
}

/// The arm sways about the horizontal.
fn sway(t: f64) -> [[f64; MOVED]; 2] {
    sines(
        t,
        [0.0, FRAC_PI_2],
        [
            &[(0.5, 0.25, 0.0), (0.25, 0.7, 1.0), (0.1, 1.5, 2.2)],
            &[(0.2, 0.2, 0.6), (0.12, 0.6, 2.0), (0.05, 1.4, 0.4)],
        ],
    )
}

/// A motion like [`sway`] with other amplitudes, frequencies and phases.
fn sway_again(t: f64) -> [[f64; MOVED]; 2] {
    sines(
        t,
        [0.2, FRAC_PI_2],
        [
            &[(0.4, 0.3, 1.4), (0.3, 0.6, 0.2), (0.08, 1.7, 4.0)],
            &[(0.18, 0.25, 3.0), (0.1, 0.75, 0.9), (0.06, 1.2, 5.0)],
        ],
    )
}

/// From point to point with rests between: a quintic of `rise` s, then rest until `period` s have passed.
fn travel(t: f64, points: &[[f64; MOVED]], rise: f64, period: f64) -> [[f64; MOVED]; 2] {
    let leg = ((t / period) as usize).min(points.len() - 2);
    let s = ((t - leg as f64 * period) / rise).clamp(0.0, 1.0);
    let share = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
    let speed = 30.0 * s * s * (1.0 - s) * (1.0 - s) / rise;
    let mut out = [[0.0; MOVED]; 2];
    for j in 0..MOVED {
        let (a, b) = (points[leg][j], points[leg + 1][j]);
        out[0][j] = a + (b - a) * share;
        out[1][j] = (b - a) * speed;
    }
    out
}

/// Fast turns through the upright position, with rests.
fn travels(t: f64) -> [[f64; MOVED]; 2] {
    const POINTS: [[f64; MOVED]; 5] = [
        [0.0, 1.4],
        [-1.6, -0.6],
        [1.4, 0.4],
        [0.5, -1.3],
        [-0.8, 1.2],
    ];
    travel(t, &POINTS, 1.1, 1.5)
}

/// Other turns of the same kind as [`travels`].
fn travels_again(t: f64) -> [[f64; MOVED]; 2] {
    const POINTS: [[f64; MOVED]; 5] = [
        [0.3, -1.2],
        [1.5, 0.9],
        [-0.9, -0.3],
        [-1.7, 1.5],
        [0.6, 0.1],
    ];
    travel(t, &POINTS, 1.0, 1.5)
}

/// Name, description and reference of each record.
const RECORDS: [(&str, &str, Reference); 4] = [
    ("sway", "sums of sines about the horizontal", sway),
    ("sway_again", "the same kind of motion", sway_again),
    (
        "travels",
        "point to point through the upright position, with rests",
        travels,
    ),
    ("travels_again", "the same kind as `travels`", travels_again),
];

/// All records, the first one for training.
///
/// # Errors
/// That of the simulation.
pub(super) fn dataset(seed: u64) -> Result<Dataset, SimulateError> {
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x5650_3530);
    let mut experiments = Vec::new();
    for (k, (name, note, reference)) in RECORDS.into_iter().enumerate() {
        let role = if k == 0 { Role::Train } else { Role::Test };
        experiments.push(record(name, note, role, reference, &mut random)?);
    }
    let joint = |name: &str| JointChannels {
        name: name.to_owned(),
        prismatic: false,
        input: InputQuantity::Current,
        input_unit: "A".to_owned(),
        velocity: VelocityKind::Measured,
    };
    Ok(Dataset {
        name: "vs050".to_owned(),
        title: "DENSO VS-050, axes 1 and 2".to_owned(),
        source: "six axes simulated under position control, with noise".to_owned(),
        license: "CC0-1.0".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: vec![joint("j1"), joint("j2")],
        experiments,
        warnings: Vec::new(),
    })
}

fn record(
    name: &str,
    note: &str,
    role: Role,
    reference: Reference,
    random: &mut ChaCha8Rng,
) -> Result<Experiment, SimulateError> {
    let p: Vec<f64> = Vs050.params().iter().map(|p| p.nominal).collect();
    let gain: Vec<f64> = (1..=AXES)
        .map(|j| value(&p, &format!("gain_j{j}")))
        .collect();
    let mut simulator = Simulator::with_derivatives(&Vs050, Settings::default());
    let t: Vec<f64> = (0..SAMPLES).map(|k| k as f64 * STEP).collect();
    let (mut q, mut v) = ([0.0; AXES], [0.0; AXES]);
    let [q0, v0] = reference(0.0);
    q[..MOVED].copy_from_slice(&q0);
    v[..MOVED].copy_from_slice(&v0);
    let mut out = Experiment {
        name: name.to_owned(),
        role,
        note: note.to_owned(),
        nq: MOVED,
        t: t.clone(),
        q: Vec::new(),
        v: Some(Vec::new()),
        u: Vec::new(),
        tau: None,
        qref: None,
        missing: 0,
        gain_factors: Default::default(),
    };
    let mut recorded_v = Vec::with_capacity(MOVED * SAMPLES);
    let mut u = [0.0; 2 * AXES];
    for (k, &now) in t.iter().enumerate() {
        let [q_ref, v_ref] = reference(now);
        for j in 0..AXES {
            let seen_q = q[j] + NOISE_Q * gaussian(random);
            let seen_v = v[j] + NOISE_V * gaussian(random);
            let (to_q, to_v) = if j < MOVED {
                (q_ref[j], v_ref[j])
            } else {
                (0.0, 0.0)
            };
            let wanted =
                BANDWIDTH * BANDWIDTH * (to_q - seen_q) + 2.0 * BANDWIDTH * (to_v - seen_v);
            u[j] = INERTIA[j] * wanted / gain[j];
            if j < MOVED {
                out.q.push(seen_q);
                recorded_v.push(seen_v);
                out.u
                    .push(u[j] + NOISE_U * u[j].abs().max(1.0) * gaussian(random));
            }
        }
        u.copy_within(..AXES, AXES);
        if k + 1 < SAMPLES {
            let (mut qs, mut vs) = ([0.0; 2 * AXES], [0.0; 2 * AXES]);
            let drive = Drive {
                t: &t[k..k + 2],
                u: &u,
                hold: InputHold::ZeroOrder,
            };
            simulator.run(&p, &q, &v, &drive, &mut qs, &mut vs)?;
            q.copy_from_slice(&qs[AXES..]);
            v.copy_from_slice(&vs[AXES..]);
        }
    }
    out.v = Some(recorded_v);
    Ok(out)
}

/// The parameter of the six-joint arm with this name; NaN without one.
fn value(p: &[f64], name: &str) -> f64 {
    let at = Vs050.params().iter().position(|i| i.name == name);
    at.map_or(f64::NAN, |k| p[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The loops follow the references: the records are close to them, noisy, and have finite
    /// currents.
    #[test]
    fn the_arm_follows_its_references() {
        let data = dataset(0).unwrap();
        assert_eq!(data.experiments.len(), RECORDS.len());
        for (e, (name, _, reference)) in data.experiments.iter().zip(RECORDS) {
            let mut worst = 0.0_f64;
            for (k, &t) in e.t.iter().enumerate() {
                let [q, _] = reference(t);
                for j in 0..MOVED {
                    worst = worst.max((e.q[k * MOVED + j] - q[j]).abs());
                }
            }
            assert!(worst > 1e-4 && worst < 0.2, "{name}: {worst} rad");
            assert!(e.u.iter().all(|u| u.abs() < 20.0), "{name}");
        }
    }

    /// The velocity that a reference states is the derivative of its position.
    #[test]
    fn references_are_consistent() {
        for (name, _, reference) in RECORDS {
            for k in 1..600 {
                let (t, h) = (0.00983 * f64::from(k), 1e-5);
                let (after, before) = (reference(t + h)[0], reference(t - h)[0]);
                let v = reference(t)[1];
                for j in 0..MOVED {
                    let slope = (after[j] - before[j]) / (2.0 * h);
                    assert!(
                        (slope - v[j]).abs() < 1e-4,
                        "{name} at {t} s: {slope}, {}",
                        v[j]
                    );
                }
            }
        }
    }
}
