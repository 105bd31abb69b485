//! What a record can determine: information on the parameters against their tolerances.

use nalgebra::{DMatrix, SymmetricEigen};
use pid_interpret::nominal::{Nominal, Role};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::columns::{quantile, spread};
use crate::criteria::Criteria;
use crate::finding::{Channel, Finding, FindingKind, Missing, Severity, joints_text, list, number};
use crate::motion::Motion;
use crate::torque::{Bench, Fit};

/// States at which information is collected.
const STATES: usize = 600;
/// Independent torque samples per second behind a filter of 10 Hz.
const PER_SECOND: f64 = 20.0;
/// Torque error, over the torque, below which no model is right.
const LEAST: f64 = 0.02;
/// Names in a sentence; all are in the values.
const NAMED: usize = 8;

/// Parameters that are not determined, and motion that is missing.
pub(crate) fn check(
    bench: &Bench,
    nominal: &Nominal,
    motion: &Motion,
    base: &[Fit],
    seconds: f64,
    criteria: &Criteria,
) -> Vec<Finding> {
    let mut out = missing(bench, nominal, motion);
    let free: Vec<usize> = (0..nominal.tolerances().len())
        .filter(|&k| {
            let t = &nominal.tolerances()[k];
            t.half_width > 0.0 && !matches!(t.role, Role::Gain | Role::Sharpness)
        })
        .collect();
    if free.is_empty() || motion.len() < 50 {
        return out;
    }
    let widths: Vec<f64> = free
        .iter()
        .map(|&k| nominal.tolerances()[k].half_width)
        .collect();
    let noise: Vec<f64> = base
        .iter()
        .map(|f| f.size * f.left.sqrt().clamp(LEAST, 1.0))
        .collect();
    let recorded = states(motion);
    let rich = rich(motion, nominal, recorded.len());
    let scale = PER_SECOND * seconds / recorded.len() as f64;
    let of = |states: &[State]| information(bench, states, &free, &widths, &noise, scale);
    let (here, there) = (of(&recorded), of(&rich));
    let (Some(left), Some(possible)) = (shrunk(&here), shrunk(&there)) else {
        return out;
    };
    let names: Vec<String> = (0..free.len())
        .filter(|&k| left[k] > criteria.undetermined && possible[k] < 0.5 * criteria.undetermined)
        .map(|k| nominal.tolerances()[free[k]].name.clone())
        .collect();
    let (rank, most) = (rank(here), rank(there));
    if names.is_empty() {
        return out;
    }
    let some = list(names.iter().take(NAMED).cloned());
    let more = names.len().saturating_sub(NAMED);
    let rest = if more > 0 {
        format!(" ({more} more)")
    } else {
        String::new()
    };
    let sentence = format!(
        "this record tells {rank} of the {most} combinations of inertial and friction parameters that a rich motion tells; not told: {some}{rest}"
    );
    let mend = "nothing, if their tolerances are good enough; otherwise record a motion that excites them (`simtrue excite`)";
    out.push(
        Finding::new(
            FindingKind::NotDetermined {
                names,
                rank,
                possible: most,
            },
            Severity::Note,
            sentence,
            mend,
        )
        .with("combinations told", rank as f64, "1")
        .with("of", most as f64, "1"),
    );
    out
}

type State = (Vec<f64>, Vec<f64>, Vec<f64>);

fn states(motion: &Motion) -> Vec<State> {
    let n = motion.n;
    let step = motion.len().div_ceil(STATES).max(1);
    let row = |x: &[f64], i: usize| x[i * n..(i + 1) * n].to_vec();
    (0..motion.len())
        .step_by(step)
        .map(|i| (row(&motion.q, i), row(&motion.v, i), row(&motion.a, i)))
        .collect()
}

/// States of a rich motion: positions over a wide range about those of the record, speeds and
/// accelerations of usual size, drawn with a fixed seed.
fn rich(motion: &Motion, nominal: &Nominal, count: usize) -> Vec<State> {
    let n = motion.n;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut draw = || random.random_range(-1.0..1.0);
    let scales: Vec<(f64, f64, f64, f64)> = (0..n)
        .map(|j| {
            let q: Vec<f64> = motion.column(&motion.q, j).collect();
            let top =
                |x: &[f64]| quantile(&motion.column(x, j).map(f64::abs).collect::<Vec<_>>(), 0.99);
            let stated = nominal
                .measurement()
                .channels
                .get(j)
                .and_then(|c| c.speed_scale);
            let v = top(&motion.v).max(stated.unwrap_or(0.0)).max(0.1);
            (
                quantile(&q, 0.5),
                (0.5 * spread(&q)).max(0.8),
                v,
                top(&motion.a).max(4.0 * v),
            )
        })
        .collect();
    (0..count)
        .map(|_| {
            let mut state = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
            for (j, (q, range, v, a)) in scales.iter().enumerate() {
                state.0[j] = q + range * draw();
                state.1[j] = v * draw();
                state.2[j] = a * draw();
            }
            state
        })
        .collect()
}

/// Information on the parameters in units of their tolerances.
fn information(
    bench: &Bench,
    states: &[State],
    free: &[usize],
    widths: &[f64],
    noise: &[f64],
    scale: f64,
) -> DMatrix<f64> {
    let n = noise.len();
    let np = bench.gravity.unwrap_or(bench.p.len());
    let mut rows = vec![0.0; n * np];
    let mut stacked = DMatrix::zeros(states.len() * n, free.len());
    for (i, (q, v, a)) in states.iter().enumerate() {
        bench.by_parameters(q, v, a, &mut rows);
        for j in (0..n).filter(|&j| noise[j] > 0.0) {
            for (c, (&k, width)) in free.iter().zip(widths).enumerate() {
                let x = rows[j * np + k] * width / noise[j];
                stacked[(i * n + j, c)] = if x.is_finite() { x } else { 0.0 };
            }
        }
    }
    scale * stacked.tr_mul(&stacked)
}

/// Standard deviation after the record, over the tolerance.
fn shrunk(information: &DMatrix<f64>) -> Option<Vec<f64>> {
    let n = information.nrows();
    let inverse = (information + DMatrix::identity(n, n))
        .cholesky()?
        .inverse();
    Some((0..n).map(|k| inverse[(k, k)].sqrt()).collect())
}

/// Combinations that the record tells better than the tolerances do.
fn rank(information: DMatrix<f64>) -> usize {
    SymmetricEigen::new(information)
        .eigenvalues
        .iter()
        .filter(|x| **x > 1.0)
        .count()
}

/// Joints that rest, and motions that are missing.
fn missing(bench: &Bench, nominal: &Nominal, motion: &Motion) -> Vec<Finding> {
    use pid_runtime::dynamics::Dynamics;
    let mut out = Vec::new();
    for j in 0..motion.n {
        let q: Vec<f64> = motion.column(&motion.q, j).collect();
        let v: Vec<f64> = motion.column(&motion.v, j).collect();
        let a: Vec<f64> = motion.column(&motion.a, j).collect();
        let range = spread(&q);
        if !motion.moves(j) {
            out.push(
                Finding::new(
                    FindingKind::JointRests,
                    Severity::Note,
                    format!("{} does not move", joints_text(&[j + 1])),
                    "record a motion of this joint, or nothing is told of its friction and rotor",
                )
                .of(&[j + 1], Channel::Motion)
                .with("range", range, bench.model.joints()[j].unit()),
            );
            continue;
        }
        let fast = quantile(&v.iter().map(|v| v.abs()).collect::<Vec<_>>(), 0.95);
        // A reversal is slow if 0.1 s away from it the joint still moves at less than a fifth of its speed.
        let slow = (1..v.len())
            .filter(|&i| {
                motion.at[i].0 == motion.at[i - 1].0
                    && v[i] * v[i - 1] < 0.0
                    && a[i].abs() * 0.1 < 0.2 * fast
            })
            .count();
        if slow < 2 {
            out.push(lacking(j, Missing::SlowReversal, "never reverses slowly", "dry friction, play and what happens before sliding cannot be told apart; add slow ramps to and fro").with("slow reversals", slow as f64, "1"));
        }
        let stated = nominal
            .measurement()
            .channels
            .get(j)
            .and_then(|c| c.speed_scale);
        if let Some(stated) = stated.filter(|s| fast < 0.3 * s) {
            out.push(
                lacking(
                    j,
                    Missing::Fast,
                    &format!(
                        "stays below {:.0} % of its usual speed",
                        (100.0 * fast / stated).max(1.0)
                    ),
                    "viscous friction and drag are not told; add fast motion",
                )
                .with(
                    "95 % of the speeds are below",
                    fast,
                    bench.model.joints()[j].velocity_unit(),
                ),
            );
        }
        if !bench.model.joints()[j].prismatic && range < 0.3 {
            out.push(
                lacking(j, Missing::Range, &format!("moves over {} rad only", number(range)), "gravity, springs and offsets look alike over so small a range; add a wide motion").with("range", range, "rad"),
            );
        }
    }
    out
}

fn lacking(j: usize, motion: Missing, what: &str, mend: &str) -> Finding {
    Finding::new(
        FindingKind::MotionMissing { motion },
        Severity::Note,
        format!("joint {} {what}", j + 1),
        mend,
    )
    .of(&[j + 1], Channel::Motion)
}
