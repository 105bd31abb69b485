//! The law of a position loop fitted to inputs of its motor by least squares, with the limit of its output.

use nalgebra::{DVector, SMatrix, SVector};
use pid_interpret::nominal::{Gain, Servo, ServoLaw};

use super::fastest;
use crate::case::{Case, Record};
use crate::drives::target::{Point, Shaped, followed as shaped};
use crate::drives::{Gains, filter};

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
/// Shares of the target's velocity that are looked at: none, half, all. A fit goes on from the best.
const AHEAD: [f64; 3] = [0.0, 0.5, 1.0];
/// Ratio of a number that is looked at to the one before.
const FINER: f64 = 1.5;
/// Most numbers in which a law is linear, an offset included.
const WIDEST: usize = 5;

/// A law fitted to inputs by least squares.
pub(super) struct Followed {
    /// In the order of [`Gain::ALL`].
    pub(super) gains: [f64; Gain::ALL.len()],
    /// Output per error.
    pub(super) stiffness: f64,
    /// Share of the variance that it explains.
    pub(super) explained: f64,
}

/// One record with inputs of a joint, and the input with which its drive makes up for gravity.
pub(super) struct Fitted<'a> {
    pub(super) record: &'a Record,
    pub(super) joint: usize,
    pub(super) u: Vec<f64>,
    pub(super) gravity: Vec<f64>,
}

/// Numbers of a loop in which its law is not linear.
#[derive(Debug, Clone, Copy)]
struct Curved {
    /// Of a cascade: its velocity is limited.
    kp: f64,
    /// Infinite where nothing limits it.
    target_speed: f64,
    ahead: f64,
    target_time: f64,
    velocity_time: f64,
    feedback_delay: f64,
}

/// Fits the law of a joint to inputs along the records, an offset free; unknown numbers in which it is not
/// linear are those of a row of them that explain most.
pub(super) fn followed(case: &Case, j: usize, inputs: &[Fitted<'_>]) -> Option<Followed> {
    let servo = case.nominal.description.servo(j)?;
    let steps = inputs.iter().map(|own| own.record.h);
    let step = steps.fold(SLOWEST, f64::min);
    let row = |gain: Gain, (least, most): (f64, f64)| -> Vec<f64> {
        let stated = servo.gain(gain).value;
        match (servo.has(gain), stated) {
            (true, None) => std::iter::successors(Some(least), |x| Some(x * FINER))
                .take_while(|x| *x <= most)
                .collect(),
            _ => vec![stated.unwrap_or(0.0)],
        }
    };
    let kp = match servo.law {
        ServoLaw::Cascade => row(Gain::Kp, CASCADES),
        _ => vec![0.0],
    };
    let times = [Gain::TargetTime, Gain::VelocityTime].map(|gain| row(gain, (step, SLOWEST)));
    let late = row(Gain::FeedbackDelay, (step, LATEST));
    let fastest = fastest(case, j);
    let slower = match servo.has(Gain::TargetSpeed) {
        true => row(Gain::TargetSpeed, (SLOWED * fastest, fastest)),
        false => vec![f64::INFINITY],
    };
    let ahead = match (
        servo.has(Gain::VelocityAhead),
        servo.gain(Gain::VelocityAhead).value,
    ) {
        (true, None) => AHEAD.to_vec(),
        (_, stated) => vec![stated.unwrap_or(0.0)],
    };
    let mut best: Option<(Followed, Curved)> = None;
    let tried = |best: &mut Option<(Followed, Curved)>, at: Curved| {
        let least = best.as_ref().map_or(f64::NEG_INFINITY, |b| b.0.explained);
        let fit = fitted(servo, at, inputs).filter(|fit| fit.explained > least);
        *best = fit.map(|fit| (fit, at)).or(best.take());
    };
    let fast = *slower.last()?;
    for &kp in &kp {
        for &target_time in &times[0] {
            for &velocity_time in &times[1] {
                let at = Curved {
                    kp,
                    target_speed: fast,
                    ahead: ahead[0],
                    target_time,
                    velocity_time,
                    feedback_delay: late[0],
                };
                tried(&mut best, at);
            }
        }
    }
    // The others where those are best.
    let from = best.as_ref()?.1;
    for &target_speed in &slower {
        for &ahead in &ahead {
            for &feedback_delay in &late {
                let at = Curved {
                    target_speed,
                    ahead,
                    feedback_delay,
                    ..from
                };
                tried(&mut best, at);
            }
        }
    }
    best.map(|(fit, _)| fit)
}

/// What a law multiplies its gains with, sample by sample: errors, velocities and integrals of errors; of a
/// cascade the velocity that lacks and its integral.
fn seen(servo: &Servo, k: &Gains<f64>, (r, j): (&Record, usize)) -> Vec<[f64; 3]> {
    let (q, v, h) = (&r.smooth_q[j], &r.smooth_v[j], r.h);
    let mut memory = Shaped::at_rest(r.u[j][0]);
    let (mut velocity, mut integral) = (v[0], 0.0);
    let most = servo.velocity_limit.unwrap_or(f64::INFINITY);
    let of = |i: usize| {
        let own = (r.u[j][i], (r.u[j][i] - r.u[j][i.saturating_sub(1)]) / h);
        let [_, Point { r: target, rate }] =
            shaped(servo, k, &mut memory, own, (h * i as f64, h), 0.0);
        // Readings of a while ago, along a straight line between samples.
        let x = (i as f64 - k.feedback_delay.unwrap_or(0.0) / h).max(0.0);
        let before = x as usize;
        let read = |of: &[f64]| {
            let next = of[(before + 1).min(of.len() - 1)];
            of[before] + (next - of[before]) * x.fract()
        };
        let (q, v) = (read(q), read(v));
        let error = target - q;
        let band = servo.dead_band.unwrap_or(0.0);
        let error = error - error.clamp(-band, band);
        velocity = match k.velocity_time {
            Some(time) => filter::after(velocity, v, time, h),
            None => v,
        };
        let lacks = match servo.law {
            ServoLaw::Cascade => (k.kp * error + rate).clamp(-most, most) - velocity,
            _ => error,
        };
        integral += lacks * h;
        match servo.law {
            ServoLaw::Cascade => [lacks, integral, 0.0],
            _ => [error, rate - velocity, integral],
        }
    };
    (0..r.len()).map(of).collect()
}

/// The same fit with the numbers in which the law is not linear.
fn fitted(servo: &Servo, curved: Curved, inputs: &[Fitted<'_>]) -> Option<Followed> {
    let k = Gains::of(|gain| {
        let value = match gain {
            Gain::Kp => curved.kp,
            Gain::VelocityAhead => curved.ahead,
            Gain::TargetSpeed => curved.target_speed,
            Gain::TargetTime => curved.target_time,
            Gain::VelocityTime => curved.velocity_time,
            Gain::FeedbackDelay => curved.feedback_delay,
            _ => 0.0,
        };
        servo.has(gain).then_some(value)
    });
    let cascade = servo.law == ServoLaw::Cascade;
    let share = servo.gain(Gain::Gravity).value;
    let free = servo.has(Gain::Gravity) && share.is_none();
    let known = share.unwrap_or(0.0);
    let columns = match servo.law {
        ServoLaw::P => 1,
        ServoLaw::Pd | ServoLaw::Cascade => 2,
        _ => 3,
    };
    let mut samples = Samples {
        width: 1 + columns + usize::from(free),
        limit: servo.limit.unwrap_or(f64::INFINITY),
        all: Vec::new(),
    };
    for own in inputs {
        let seen = seen(servo, &k, (own.record, own.joint)).into_iter();
        for (([a, b, c], &u), &gravity) in seen.zip(&own.u).zip(&own.gravity) {
            let mut row = [1.0, a, b, c, 0.0];
            if free {
                row[1 + columns] = gravity;
            }
            let known = known * gravity;
            if u.is_finite() {
                samples.all.push(Sample { row, known, u });
            }
        }
    }
    let x = samples.law()?;
    let at = |i: usize| if i <= columns { x[i] } else { 0.0 };
    let gains = Gain::ALL.map(|gain| match gain {
        Gain::Kp if cascade => curved.kp,
        Gain::Kv => at(1),
        Gain::Kp => at(1),
        Gain::Ki if cascade => at(2),
        Gain::Kd => at(2),
        Gain::Ki => at(3),
        Gain::Gravity if free => x[1 + columns],
        Gain::Gravity => known,
        Gain::VelocityAhead => curved.ahead,
        Gain::TargetSpeed if servo.has(gain) => curved.target_speed,
        Gain::TargetTime => curved.target_time,
        Gain::VelocityTime => curved.velocity_time,
        Gain::FeedbackDelay => curved.feedback_delay,
        _ => 0.0,
    });
    let found = Followed {
        gains,
        stiffness: at(1) * if cascade { curved.kp } else { 1.0 },
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
}

/// Samples of a law that is linear in its numbers up to a limit of its output.
struct Samples {
    /// Numbers of the law.
    width: usize,
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
        let free = |s: &Sample| s.u.abs() <= FREE * self.limit;
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
            self.least_squares(|s| self.output(s, x).abs() < self.limit)
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
        let left = |s: &Sample| s.u - self.output(s, x).clamp(-self.limit, self.limit);
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
                row: [1.0, error, -velocity, 0.0, 0.0],
                known: 0.0,
                u: (kp * error - kd * velocity).clamp(-limit, limit) + noise,
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
