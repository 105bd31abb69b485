//! The law of a position loop fitted to inputs of its motor by least squares, with the limit of its output.

use nalgebra::{DVector, SMatrix, SVector};
use pid_interpret::nominal::{Gain, Servo, ServoLaw};

use super::{fastest, hardest};
use crate::case::{Case, Record};
use crate::drives::target::{Motion, Shaped, followed as shaped};
use crate::drives::{Gains, filter, slowed};

/// Share of the limit beyond which a sample tells nothing of the gains.
const FREE: f64 = 0.95;
/// Shares of the samples within whose errors a proportional gain is looked for that reaches the limit there.
const REACHED: [f64; 5] = [0.1, 0.25, 0.5, 0.75, 0.9];
/// Turns of a fit and of the question which samples the limit holds, from each start; one that does not rest by then
/// competes as it stands.
const TURNS: usize = 6;
/// Unknown times are looked for from a sample to this, s: filters of drives are faster.
pub(super) const SLOWEST: f64 = 0.5;
/// Least and largest kp of a cascade that is looked for, 1/s: position loops of drives have 3 to 100.
const CASCADES: (f64, f64) = (1.0, 300.0);
/// Largest delay of a loop's readings that is looked for, s: that of the effect `feedback_delay`.
const LATEST: f64 = 0.1;
/// An unknown largest speed is looked for down to this share of the fastest motion: a joint that follows its target
/// does not overshoot to twice its speed.
pub(super) const SLOWED: f64 = 0.5;
/// An unknown acceleration of a profile is looked for from this share of the hardest one of the motion to as many times
/// it: what a profile asks for a joint follows softened, or overshoots.
pub(super) const EASED: f64 = 0.25;
/// Shares of the target's velocity that are looked at: none, half, all. A fit goes on from the best.
const AHEAD: [f64; 3] = [0.0, 0.5, 1.0];
/// Ratio of a number that is looked at to the one before.
const FINER: f64 = 1.5;
/// Most numbers in which a law is linear, an offset included.
const WIDEST: usize = 6;

/// A law fitted to inputs by least squares.
pub(super) struct Followed {
    /// In the order of [`Gain::ALL`].
    pub(super) gains: [f64; Gain::ALL.len()],
    /// Output per error.
    pub(super) stiffness: f64,
    /// Share of the variance that it explains.
    pub(super) explained: f64,
}

/// One record with inputs of a joint, the input with which its drive makes up for gravity, and that with which it
/// accelerates by one unit.
pub(super) struct Fitted<'a> {
    pub(super) record: &'a Record,
    pub(super) joint: usize,
    pub(super) u: Vec<f64>,
    pub(super) gravity: Vec<f64>,
    pub(super) inertia: Vec<f64>,
    /// Sign of the motor gain.
    pub(super) sign: f64,
}

/// Numbers of a loop in the order of [`Gain::ALL`].
type Numbers = [f64; Gain::ALL.len()];

/// Numbers in which a law is not linear. Those of a group are looked at together, with the others where they are best.
const CURVED: [&[Gain]; 3] = [
    &[Gain::Kp, Gain::TargetTime, Gain::VelocityTime],
    &[Gain::TargetSpeed, Gain::VelocityAhead, Gain::FeedbackDelay],
    &[Gain::TargetAcceleration, Gain::TargetAverage],
];

/// Values of a number of a loop that are looked at, that which changes least first.
fn row(case: &Case, (j, servo): (usize, &Servo), gain: Gain, step: f64) -> Vec<f64> {
    let stated = servo.gain(gain).value;
    if !servo.has(gain) || stated.is_some() {
        return vec![stated.unwrap_or(0.0)];
    }
    let between = |least: f64, most: f64| -> Vec<f64> {
        let all = std::iter::successors(Some(least), |x| Some(x * FINER));
        all.take_while(|x| *x <= most).collect()
    };
    let mut out = match gain {
        Gain::Kp if servo.law == ServoLaw::Cascade => {
            let factor = case.usual_factor(gain, j);
            between(CASCADES.0 / factor, CASCADES.1 / factor)
        }
        Gain::TargetSpeed => {
            let fastest = fastest(case, j);
            between(SLOWED * fastest, fastest)
        }
        Gain::TargetAcceleration => {
            let hardest = hardest(case, j);
            between(EASED * hardest, hardest / EASED)
        }
        Gain::VelocityAhead => AHEAD.to_vec(),
        Gain::FeedbackDelay => between(step, LATEST),
        gain if gain.is_time() => between(step, SLOWEST),
        _ => vec![0.0],
    };
    if matches!(gain, Gain::TargetSpeed | Gain::TargetAcceleration) {
        out.reverse();
    }
    out
}

/// Fits the law of a joint to inputs along the records, an offset free; unknown numbers in which it is not
/// linear are those of a row of them that explain most.
pub(super) fn followed(
    case: &Case,
    (j, servo): (usize, &Servo),
    inputs: &[Fitted<'_>],
) -> Option<Followed> {
    let steps = inputs.iter().map(|own| own.record.h);
    let step = steps.fold(SLOWEST, f64::min);
    let rows = Gain::ALL.map(|gain| row(case, (j, servo), gain, step));
    let mut from = rows
        .each_ref()
        .map(|row| row.first().copied().unwrap_or(0.0));
    let mut best: Option<(Followed, Numbers)> = None;
    for group in CURVED {
        let sizes = group.iter().map(|&gain| rows[gain as usize].len());
        for n in 0..sizes.product() {
            let (mut at, mut left) = (from, n);
            for &gain in group {
                let row = &rows[gain as usize];
                at[gain as usize] = row[left % row.len()];
                left /= row.len();
            }
            let least = best.as_ref().map_or(f64::NEG_INFINITY, |b| b.0.explained);
            let fit = fitted(servo, &at, inputs).filter(|fit| fit.explained > least);
            best = fit.map(|fit| (fit, at)).or(best);
        }
        from = best.as_ref()?.1;
    }
    best.map(|(fit, _)| fit)
}

/// What a law multiplies its gains with, sample by sample, times the factors of the record: errors, velocities and
/// integrals of errors, of a cascade the velocity that lacks and its integral; and the acceleration of the target.
fn seen(servo: &Servo, k: &Gains<f64>, (r, j): (&Record, usize)) -> Vec<([f64; 3], f64)> {
    let factor = |gain: Gain| r.gain_factors.at(gain as usize, j);
    let mut k = *k;
    k.times(factor);
    let k = &k;
    let (q, v, h) = (&r.smooth_q[j], &r.smooth_v[j], r.h);
    let mut memory = Shaped::at_rest(r.u[j][0]);
    let (mut velocity, mut integral) = (v[0], 0.0);
    let most = servo.velocity_limit.unwrap_or(f64::INFINITY);
    let of = |i: usize| {
        let before = |n: usize| r.u[j][i.saturating_sub(n)];
        let target = Motion {
            r: before(0),
            rate: (before(0) - before(1)) / h,
            acceleration: (before(0) - 2.0 * before(1) + before(2)) / (h * h),
        };
        let [_, target] = shaped(servo, k, &mut memory, &target, (h * i as f64, h), 0.0);
        // Readings of a while ago, along a straight line between samples.
        let x = (i as f64 - k.feedback_delay.unwrap_or(0.0) / h).max(0.0);
        let before = x as usize;
        let read = |of: &[f64]| {
            let next = of[(before + 1).min(of.len() - 1)];
            of[before] + (next - of[before]) * x.fract()
        };
        let (q, v) = (read(q), read(v));
        let error = target.r - q;
        let band = servo.dead_band.unwrap_or(0.0);
        let error = error - error.clamp(-band, band);
        velocity = match k.velocity_time {
            Some(time) => filter::after(velocity, v, time, h),
            None => v,
        };
        let rate = k.ahead.unwrap_or(0.0) * target.rate;
        let lacks = match servo.law {
            ServoLaw::Cascade => (k.kp * error + rate).clamp(-most, most) - velocity,
            _ => error,
        };
        integral += lacks * h;
        let row = match servo.law {
            ServoLaw::Cascade => [factor(Gain::Kv) * lacks, factor(Gain::Ki) * integral, 0.0],
            _ => [
                factor(Gain::Kp) * error,
                factor(Gain::Kd) * (rate - velocity),
                factor(Gain::Ki) * integral,
            ],
        };
        (row, target.acceleration)
    };
    (0..r.len()).map(of).collect()
}

/// A share of what a drive's model makes up for, as a number of a law that is linear in it.
#[derive(Debug, Clone, Copy)]
struct Fed {
    /// What is stated of it, zero where it is not known.
    known: f64,
    /// Its place in a row where it is not known.
    free: Option<usize>,
}

impl Fed {
    /// Of a loop; rows are `width` wide and grow where it is not known.
    fn of(servo: &Servo, gain: Gain, width: &mut usize) -> Self {
        let stated = servo.gain(gain).value;
        let free = (servo.has(gain) && stated.is_none()).then_some(*width);
        *width += usize::from(free.is_some());
        Fed {
            known: stated.unwrap_or(0.0),
            free,
        }
    }

    /// What it adds that is known; what is not goes into a row.
    fn add(&self, row: &mut [f64; WIDEST], input: f64) -> f64 {
        if let Some(place) = self.free {
            row[place] = input;
        }
        self.known * input
    }
}

/// The same fit with the numbers in which the law is not linear.
fn fitted(servo: &Servo, curved: &Numbers, inputs: &[Fitted<'_>]) -> Option<Followed> {
    let k = Gains::of(|gain| servo.has(gain).then_some(curved[gain as usize]));
    let cascade = servo.law == ServoLaw::Cascade;
    let columns = match servo.law {
        ServoLaw::P => 1,
        ServoLaw::Pd | ServoLaw::Cascade => 2,
        _ => 3,
    };
    let mut width = 1 + columns;
    let gravity = Fed::of(servo, Gain::Gravity, &mut width);
    let inertia = Fed::of(servo, Gain::InertiaAhead, &mut width);
    let mut samples = Samples {
        width,
        limit: {
            let stall = servo.falling.map(|own| own.stall);
            let both = [servo.limit, stall].into_iter().flatten();
            both.fold(f64::INFINITY, f64::min)
        },
        all: Vec::new(),
    };
    for own in inputs {
        let seen = seen(servo, &k, (own.record, own.joint));
        for (i, ([a, b, c], acceleration)) in seen.into_iter().enumerate() {
            let mut row = [1.0, a, b, c, 0.0, 0.0];
            let known = gravity.add(&mut row, own.gravity[i])
                + inertia.add(&mut row, own.inertia[i] * acceleration);
            let u = own.u[i];
            if u.is_finite() {
                let speed = own.sign * own.record.smooth_v[own.joint][i];
                let ends = ends(servo, speed);
                samples.all.push(Sample {
                    row,
                    known,
                    u,
                    ends,
                });
            }
        }
    }
    let x = samples.law()?;
    let at = |i: usize| if i <= columns { x[i] } else { 0.0 };
    let share = |own: &Fed| own.free.map_or(own.known, |place| x[place]);
    let gains = Gain::ALL.map(|gain| match gain {
        Gain::Kp if cascade => curved[gain as usize],
        Gain::Kv => at(1),
        Gain::Kp => at(1),
        Gain::Ki if cascade => at(2),
        Gain::Kd => at(2),
        Gain::Ki => at(3),
        Gain::Gravity => share(&gravity),
        Gain::InertiaAhead => share(&inertia),
        gain => curved[gain as usize],
    });
    let found = Followed {
        gains,
        stiffness: at(1)
            * if cascade {
                gains[Gain::Kp as usize]
            } else {
                1.0
            },
        explained: 1.0 - samples.left(&x) / samples.variance().max(1e-300),
    };
    Some(found).filter(|f| f.gains.iter().all(|x| x.is_finite()))
}

/// What a law makes an input of.
struct Sample {
    /// What its numbers are multiplied with, the offset first and the error second.
    row: [f64; WIDEST],
    /// What it adds by itself.
    known: f64,
    u: f64,
    /// Least and largest output at the speed there.
    ends: [f64; 2],
}

impl Sample {
    /// Whether an input lies within a share of the ends.
    fn within(&self, share: f64, u: f64) -> bool {
        u > share * self.ends[0] && u < share * self.ends[1]
    }
}

/// Least and largest output of a loop at a speed of its motor in the direction that a positive output drives.
fn ends(servo: &Servo, speed: f64) -> [f64; 2] {
    let limit = servo.limit.unwrap_or(f64::INFINITY);
    let end = |u: f64| slowed(servo, u, speed).map_or(u, |out| out.u);
    [end(-limit), end(limit)]
}

/// Samples of a law that is linear in its numbers up to a limit of its output.
struct Samples {
    /// Numbers of the law.
    width: usize,
    /// Largest output at rest.
    limit: f64,
    all: Vec<Sample>,
}

impl Samples {
    /// The numbers that leave the smallest sum of squares.
    ///
    /// Without samples at the limit by linear least squares. With them the samples that the inputs place below it
    /// give a start: inputs with noise, of which the largest are left out, make it too low. Further ones are
    /// proportional gains that reach the limit within some of the errors. From each, samples that the law itself
    /// places below its limit are fitted, by turns (a Gauss-Newton method: those at the limit have no slope).
    fn law(&self) -> Option<DVector<f64>> {
        let free = |s: &Sample| s.within(FREE, s.u);
        let linear = self.least_squares(free);
        if self.all.iter().all(free) {
            return linear;
        }
        let starts = linear.into_iter().chain(self.reaching());
        let ends = starts.flat_map(|start| self.turned(start));
        ends.min_by(|a, b| self.left(a).total_cmp(&self.left(b)))
    }

    /// Proportional gains of both signs that reach the limit within a share of the errors.
    fn reaching(&self) -> Vec<DVector<f64>> {
        let mut errors: Vec<f64> = self.all.iter().map(|s| s.row[1].abs()).collect();
        errors.sort_by(f64::total_cmp);
        let last = errors.len().saturating_sub(1);
        let at = REACHED.map(|share| errors[(share * last as f64) as usize]);
        let gains = at
            .into_iter()
            .filter(|error| *error > 0.0)
            .flat_map(|error| {
                let gain = self.limit / error;
                [gain, -gain]
            });
        let pure = |gain: f64| {
            let mut x = DVector::zeros(self.width);
            x[1] = gain;
            x
        };
        gains.map(pure).collect()
    }

    /// The start, and what each turn leads to.
    fn turned(&self, start: DVector<f64>) -> Vec<DVector<f64>> {
        // The same samples give the same numbers: it rests.
        let next = |x: &DVector<f64>| {
            self.least_squares(|s| s.within(1.0, self.output(s, x)))
                .filter(|next| next != x)
        };
        std::iter::successors(Some(start), next)
            .take(1 + TURNS)
            .collect()
    }

    /// Output of the law with these numbers, before its limit.
    fn output(&self, sample: &Sample, x: &DVector<f64>) -> f64 {
        let terms = sample.row.iter().zip(x.iter());
        sample.known + terms.map(|(a, x)| a * x).sum::<f64>()
    }

    /// Sum of squares that these numbers leave.
    fn left(&self, x: &DVector<f64>) -> f64 {
        let left = |s: &Sample| s.u - self.output(s, x).clamp(s.ends[0], s.ends[1]);
        self.all.iter().map(|s| left(s).powi(2)).sum()
    }

    /// Sum of squares about their mean of what is to be explained.
    fn variance(&self) -> f64 {
        let sum: f64 = self.all.iter().map(|s| s.u - s.known).sum();
        let mean = sum / (self.all.len() as f64).max(1.0);
        let about = |s: &Sample| (s.u - s.known - mean).powi(2);
        self.all.iter().map(about).sum()
    }

    /// The numbers without a limit on some of the samples.
    fn least_squares(&self, keep: impl Fn(&Sample) -> bool) -> Option<DVector<f64>> {
        // On the stack: this runs over all samples many times.
        let mut gram = SMatrix::<f64, WIDEST, WIDEST>::zeros();
        let mut right = SVector::<f64, WIDEST>::zeros();
        for s in self.all.iter().filter(|s| keep(s)) {
            let row = SVector::from(s.row);
            gram.ger(1.0, &row, &row, 1.0);
            right.axpy(s.u - s.known, &row, 1.0);
        }
        let width = self.width;
        let gram = gram.view((0, 0), (width, width)).clone_owned();
        gram.lu().solve(&right.rows(0, width))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A damped loop with a limit: errors and velocities swing, inputs are those of the law with a little noise.
    fn swinging(kp: f64, kd: f64, limit: f64, swing: f64) -> Samples {
        let all = (0..4000).map(|i| {
            let t = 0.002 * f64::from(i);
            let error = swing * (2.1 * t).sin() + 0.4 * swing * (7.3 * t).sin();
            let velocity = swing * (1.7 * t).cos();
            // Neither correlated with the errors nor small beside the limit.
            let noise = 0.3 * limit * (911.0 * t).sin();
            Sample {
                row: [1.0, error, -velocity, 0.0, 0.0, 0.0],
                known: 0.0,
                u: (kp * error - kd * velocity).clamp(-limit, limit) + noise,
                ends: [-limit, limit],
            }
        });
        Samples {
            width: 3,
            limit,
            all: all.collect(),
        }
    }

    #[test]
    fn gains_are_told_where_the_output_is_mostly_at_its_limit() {
        // The limit is reached by an error of 0.17; errors of up to 0.07, 1.4 and 8.4.
        for swing in [0.05, 1.0, 6.0] {
            let samples = swinging(0.8, 0.1, 0.14, swing);
            let x = samples.law().expect("a law");
            assert!((x[1] / 0.8 - 1.0).abs() < 0.1, "{swing}: {x}");
            let held = samples.all.iter().filter(|s| s.u.abs() > 0.14).count();
            assert_eq!(held > 1000, swing > 0.5, "{swing}: {held}");
        }
    }

    #[test]
    fn a_motor_that_turns_the_other_way_has_a_negative_gain() {
        let x = swinging(-0.8, -0.1, 0.14, 1.0).law().expect("a law");
        assert!((x[1] / -0.8 - 1.0).abs() < 0.1, "{x}");
    }

    #[test]
    fn no_samples_give_no_law() {
        let empty = Samples {
            width: 3,
            limit: 0.14,
            all: Vec::new(),
        };
        assert!(empty.law().is_none());
    }
}
