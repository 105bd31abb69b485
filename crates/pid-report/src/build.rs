//! Condenses records for a report.

use super::{Direction, ForceBin, ForceTrace, MissingForce, Motion, MotionJoint, Trace};
use pid_data::{Dataset, Experiment, Role};
use pid_fit::gap::metrics::FreeRun;

/// Classes of velocity or position.
const BINS: usize = 24;
/// Classes with fewer samples are left out.
const FEWEST: usize = 8;
/// Samples kept for scatter plots.
const SCATTER: usize = 700;

/// How finely curves are kept: this many stretches per curve, two points each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TraceBudget(pub usize);

impl TraceBudget {
    /// Gives each of `curves` curves a share so that a page stays well below 3 MB: at least 60 and
    /// at most 500 stretches.
    pub fn shared_by(curves: usize) -> Self {
        TraceBudget((40_000 / curves.max(1)).clamp(60, 500))
    }
}

/// Reduces a curve to the smallest and the largest value of each of `budget` stretches, in their
/// order of time.
///
/// `t` increasing, `y` of the same length; NaN interrupts the curve. Curves that are short enough
/// are kept as they are.
pub fn trace(t: &[f64], y: impl Fn(usize) -> f64, budget: TraceBudget) -> Trace {
    let n = t.len();
    let mut out = Trace::default();
    let mut push = |i: usize| {
        let value = y(i);
        out.x.push(t[i]);
        out.y.push(value.is_finite().then_some(value));
    };
    if n <= 2 * budget.0 {
        (0..n).for_each(&mut push);
        return out;
    }
    for k in 0..budget.0 {
        let (from, to) = (k * n / budget.0, (k + 1) * n / budget.0);
        let known = || (from..to).filter(|i| y(*i).is_finite());
        let low = known().min_by(|a, b| y(*a).total_cmp(&y(*b)));
        let high = known().max_by(|a, b| y(*a).total_cmp(&y(*b)));
        match (low, high) {
            (Some(a), Some(b)) if a != b => {
                push(a.min(b));
                push(a.max(b));
            }
            (Some(a), _) => push(a),
            (None, _) => push(from),
        }
    }
    out
}

/// Measured against simulated motion of one experiment; `how` says how it was simulated.
pub fn motion(
    dataset: &Dataset,
    experiment: &Experiment,
    run: &FreeRun,
    how: &str,
    budget: TraceBudget,
) -> Motion {
    let nq = experiment.nq;
    let t = &experiment.t;
    // Restarts interrupt the simulated curve, so that no line joins two windows.
    let mut restart = vec![false; t.len()];
    for window in &run.windows {
        restart[window.start] = window.start > 0;
    }
    let simulated = |x: &[f64], j: usize| {
        trace(
            t,
            |i| if restart[i] { f64::NAN } else { x[i * nq + j] },
            budget,
        )
    };
    let joints = dataset
        .joints
        .iter()
        .enumerate()
        .map(|(j, joint)| MotionJoint {
            joint: joint.name.clone(),
            unit: joint.unit().to_owned(),
            velocity_unit: joint.velocity_unit().to_owned(),
            q_measured: trace(t, |i| experiment.q[i * nq + j], budget),
            q_simulated: simulated(&run.q, j),
            v_measured: experiment
                .v
                .as_ref()
                .filter(|v| v.iter().skip(j).step_by(nq).any(|x| x.is_finite()))
                .map(|v| trace(t, |i| v[i * nq + j], budget)),
            v_simulated: simulated(&run.v, j),
        })
        .collect();
    Motion {
        experiment: experiment.name.clone(),
        role: experiment.role,
        how: how.to_owned(),
        joints,
    }
}

/// The missing generalised force of one experiment; N × nq row by row.
#[derive(Debug, Clone, Copy)]
pub struct ForceRecord<'a> {
    /// The experiment.
    pub experiment: &'a str,
    /// Its role.
    pub role: Role,
    /// Times, s.
    pub t: &'a [f64],
    /// Positions.
    pub q: &'a [f64],
    /// Velocities.
    pub v: &'a [f64],
    /// Missing force w.
    pub w: &'a [f64],
    /// Two standard deviations of w.
    pub band: Option<&'a [f64]>,
    /// Total generalised force, of which w is a part: that of drives and friction, f_L + w.
    pub total: &'a [f64],
}

/// Condenses the missing force of all joints: size, share, curves over time, samples, means over
/// classes of velocity and position.
pub fn missing_force(
    dataset: &Dataset,
    records: &[ForceRecord<'_>],
    budget: TraceBudget,
) -> Vec<MissingForce> {
    let nq = dataset.nq();
    let mut out = Vec::with_capacity(nq);
    for (j, joint) in dataset.joints.iter().enumerate() {
        let rms = |f: &dyn Fn(&ForceRecord<'_>, usize) -> f64| {
            let (mut sum, mut count) = (0.0, 0_usize);
            for r in records {
                for k in (0..r.t.len()).map(|i| i * nq + j) {
                    let x = f(r, k);
                    if x.is_finite() {
                        sum += x * x;
                        count += 1;
                    }
                }
            }
            if count > 0 {
                (sum / count as f64).sqrt()
            } else {
                0.0
            }
        };
        let size = rms(&|r, k| r.w[k]);
        let total = rms(&|r, k| r.total[k]);
        let banded = records.iter().any(|r| r.band.is_some());
        let mut samples: Vec<[f64; 3]> = Vec::new();
        for r in records {
            samples.extend(
                (0..r.t.len())
                    .map(|i| [r.q[i * nq + j], r.v[i * nq + j], r.w[i * nq + j]])
                    .filter(|s| s.iter().all(|x| x.is_finite())),
            );
        }
        let by_velocity = bins(&samples, 1);
        let by_position = bins(&samples, 0);
        out.push(MissingForce {
            joint: joint.name.clone(),
            unit: joint.force_unit().to_owned(),
            position_unit: joint.unit().to_owned(),
            velocity_unit: joint.velocity_unit().to_owned(),
            rms: size,
            total_rms: total,
            share: if total > 0.0 { size / total } else { 0.0 },
            band_rms: banded.then(|| rms(&|r, k| r.band.map_or(f64::NAN, |b| b[k]))),
            over_time: records
                .iter()
                .map(|r| ForceTrace {
                    experiment: r.experiment.to_owned(),
                    role: r.role,
                    w: trace(r.t, |i| r.w[i * nq + j], budget),
                    band: r
                        .band
                        .map(|b| trace(r.t, |i| b[i * nq + j], TraceBudget(budget.0 / 4 + 1))),
                })
                .collect(),
            samples: thin(&samples),
            by_velocity,
            by_position,
        });
    }
    out
}

/// Selects samples evenly. Strides are not whole numbers, so that a periodic motion is not met at
/// the same phase each time.
fn thin(samples: &[[f64; 3]]) -> Vec<[f64; 3]> {
    if samples.len() <= SCATTER {
        return samples.to_vec();
    }
    (0..SCATTER)
        .map(|k| samples[k * samples.len() / SCATTER])
        .collect()
}

/// Classes of equal width between the 0.5 % and the 99.5 % quantile of coordinate `axis`, for each
/// direction of motion. Samples slower than 1 % of the fast ones (98 % quantile of |v|) have no
/// direction and are left out.
fn bins(samples: &[[f64; 3]], axis: usize) -> Vec<ForceBin> {
    if samples.is_empty() {
        return Vec::new();
    }
    let quantile = |f: &dyn Fn(&[f64; 3]) -> f64, share: f64| {
        let mut x: Vec<f64> = samples.iter().map(f).collect();
        x.sort_by(f64::total_cmp);
        x[((x.len() - 1) as f64 * share).round() as usize]
    };
    let still = 0.01 * quantile(&|s| s[1].abs(), 0.98);
    let (low, high) = (quantile(&|s| s[axis], 0.005), quantile(&|s| s[axis], 0.995));
    let width = (high - low) / BINS as f64;
    if width <= 0.0 {
        return Vec::new();
    }
    // Count, sum of the abscissa, sum and sum of squares of the force.
    let mut sums = [[[0.0_f64; 4]; BINS]; 2];
    for s in samples {
        let place = ((s[axis] - low) / width).floor();
        if s[1].abs() > still && (0.0..BINS as f64).contains(&place) {
            let sum = &mut sums[usize::from(s[1] < 0.0)][place as usize];
            for (total, x) in sum.iter_mut().zip([1.0, s[axis], s[2], s[2] * s[2]]) {
                *total += x;
            }
        }
    }
    let mut out = Vec::new();
    for (direction, sums) in [Direction::Forward, Direction::Backward]
        .into_iter()
        .zip(&sums)
    {
        for [n, x, w, ww] in sums {
            if *n >= FEWEST as f64 {
                let mean = w / n;
                let spread = (ww / n - mean * mean).max(0.0).sqrt();
                out.push(ForceBin {
                    direction,
                    at: x / n,
                    mean,
                    spread,
                    count: *n as usize,
                });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_and_gaps_survive_the_reduction() {
        let n = 10_000;
        let t: Vec<f64> = (0..n).map(|i| f64::from(i) * 1e-3).collect();
        let y = |i: usize| match i {
            1234 => 7.0,
            8765 => -9.0,
            4000..4200 => f64::NAN,
            _ => (i as f64 * 1e-3).sin(),
        };
        let r = trace(&t, y, TraceBudget(100));
        assert!(r.x.len() <= 200);
        assert!(r.x.windows(2).all(|w| w[0] < w[1]));
        let at = |time: f64| r.y[r.x.iter().position(|x| *x == time).unwrap()];
        assert_eq!((at(1.234), at(8.765)), (Some(7.0), Some(-9.0)));
        assert!(r.y.iter().any(Option::is_none), "the gap is visible");
        assert_eq!(trace(&t[..5], y, TraceBudget(100)).x, t[..5]);
    }

    #[test]
    fn direction_dependent_friction_shows_in_the_classes() {
        // w = 2 forward, −1 backward, on a motion that sweeps back and forth.
        let samples: Vec<[f64; 3]> = (0..5000)
            .map(|i| {
                let s = f64::from(i) * 0.01;
                let v = s.cos();
                [s.sin(), v, if v > 0.0 { 2.0 } else { -1.0 }]
            })
            .collect();
        for axis in [0, 1] {
            let bins = bins(&samples, axis);
            assert!(bins.len() > 20);
            for b in bins {
                let expected = if b.direction == Direction::Forward {
                    2.0
                } else {
                    -1.0
                };
                assert!(
                    (b.mean - expected).abs() < 1e-12 && b.spread < 1e-6,
                    "{b:?}"
                );
            }
        }
    }
}
