//! Where unknown gains of position loops start: the law fitted to recorded inputs, or to the forces that the
//! motions take.

use nalgebra::{DMatrix, DVector};
use pid_interpret::links;
use pid_interpret::nominal::{Gain, Servo, ServoGain, ServoLaw};

use super::{Recorded, at, needed};
use crate::case::{Case, CaseError, Record};
use crate::constants::Constants;
use crate::drives::target::{Shaped, followed as shaped};
use crate::drives::{Gains, filter};

/// Range of a kp that is unknown, as a share of where it starts.
const UNKNOWN: f64 = 0.9;
/// Damping ratio of the loop at which an unknown kd starts at least.
const DAMPED: f64 = 0.5;
/// Rate at which an unknown integral starts at least, 1/s, in kp.
const SLOW: f64 = 0.2;
/// Share of the limit beyond which a sample tells nothing of the gains.
const FREE: f64 = 0.95;
/// Share of the variance of a recorded input that the law must explain to be compared with it.
const FOLLOWED: f64 = 0.95;
/// Deviation of a stated gain from that of the recorded input that is worth a warning, beyond the tolerance.
const OFF: f64 = 0.05;
/// Unknown times are looked for from a sample to this, s: filters of drives are faster.
const SLOWEST: f64 = 0.5;
/// Least and largest kp of a cascade that is looked for, 1/s: position loops of drives have 3 to 100.
const CASCADES: (f64, f64) = (1.0, 300.0);
/// Ratio of a number that is looked at to the one before.
const FINER: f64 = 1.5;

/// A law fitted to inputs by least squares.
struct Followed {
    /// In the order of [`Gain::ALL`].
    gains: [f64; Gain::ALL.len()],
    /// Output per error.
    stiffness: f64,
    /// Share of the variance that it explains.
    explained: f64,
}

/// One record with inputs of a joint, and the input with which its drive makes up for gravity.
struct Fitted<'a> {
    record: &'a Record,
    joint: usize,
    u: Vec<f64>,
    gravity: Vec<f64>,
}

/// Where unknown gains start, and what is odd about those that are stated. `recorded` are inputs beside
/// targets, at equal times.
pub(crate) fn begin(case: &mut Case, recorded: &Recorded) -> Result<Vec<String>, CaseError> {
    let mut warnings = Vec::new();
    let forces = needed(case);
    let gravity: Vec<Vec<Vec<f64>>> = case.records.iter().map(|r| gravity(case, r)).collect();
    for j in 0..case.n() {
        let Some(servo) = case.nominal.description.servo(j).cloned() else {
            continue;
        };
        let with = |i: usize, u: Vec<f64>| Fitted {
            record: &case.records[i],
            joint: j,
            u,
            gravity: gravity[i][j].clone(),
        };
        let own: Vec<Fitted<'_>> = (recorded.iter().enumerate())
            .filter_map(|(i, own)| Some(with(i, own[j].clone()?)))
            .filter(|own| own.u.len() == own.record.len())
            .collect();
        let measured = match own.is_empty() {
            true => None,
            false => followed(case, j, &own),
        };
        let measured = measured.filter(|f| f.explained > FOLLOWED && f.stiffness.abs() > 0.0);
        let gain = case.nominal.gain(j);
        let from_motion = || {
            let inputs = forces
                .iter()
                .enumerate()
                .map(|(i, own)| with(i, own[j].iter().map(|f| f / gain).collect()));
            followed(case, j, &inputs.collect::<Vec<_>>())
        };
        let unknown = servo.gains().any(|g| servo.gain(g).value.is_none());
        let found = match measured.is_none() && unknown {
            true => from_motion(),
            false => None,
        };
        let start = Start {
            case,
            j,
            servo: &servo,
        };
        warnings.extend(
            measured
                .as_ref()
                .and_then(|found| start.contradicted(found)),
        );
        if !unknown {
            continue;
        }
        for (gain, value) in start.of(measured.as_ref().or(found.as_ref()))? {
            case.nominal.begin_servo(j, gain, value);
        }
    }
    Ok(warnings)
}

/// How far from where it starts an unknown gain may lie: down to nothing, but for those without which there is
/// no loop and for times.
pub(super) fn reach(gain: Gain, size: f64) -> f64 {
    match gain {
        Gain::Gravity => size.max(1.0),
        Gain::Kd | Gain::Ki => size,
        _ => UNKNOWN * size,
    }
}

/// The loop of a joint whose unknown gains are to start.
struct Start<'a> {
    case: &'a Case,
    j: usize,
    servo: &'a Servo,
}

impl Start<'_> {
    /// A stated kp that the recorded input contradicts.
    fn contradicted(&self, found: &Followed) -> Option<String> {
        let stated = self.servo.gain(Gain::Kp);
        let value = stated.value?;
        let found = found.gains[Gain::Kp as usize];
        if (found - value).abs() <= stated.half_width + OFF * value.abs() {
            return None;
        }
        let name = &self.case.nominal.joints[self.j].name;
        Some(format!(
            "joint `{name}`: the recorded input follows the target with kp = {found:.4}, stated is {value} ± {}; the diagnosis takes the target and what is stated",
            stated.half_width
        ))
    }

    /// Where the unknown gains start, and how far from there they may lie.
    fn of(&self, found: Option<&Followed>) -> Result<Vec<(Gain, ServoGain)>, CaseError> {
        let (case, j, servo) = (self.case, self.j, self.servo);
        let gain = case.nominal.gain(j);
        let sign = gain.signum();
        let stated = |g: Gain| servo.gain(g).value;
        let stiffness = found.map_or(f64::NAN, |f| f.stiffness * sign);
        if stated(Gain::Kp).is_none() && (stiffness.is_nan() || stiffness <= 0.0) {
            return Err(CaseError::NoLoop {
                joint: case.nominal.joints[j].name.clone(),
                place: at(&servo.place),
            });
        }
        let cascade = servo.law == ServoLaw::Cascade;
        let kp = match (stated(Gain::Kp), stated(Gain::Kv), cascade) {
            (Some(kp), _, false) => kp.abs(),
            (Some(kp), Some(kv), true) => (kp * kv).abs(),
            _ => stiffness,
        };
        let critical = 2.0 * (kp.max(0.0) * gain.abs() * case.scale[j].inertia).sqrt() / gain.abs();
        let of = |g: Gain| {
            let value = found.map_or(f64::NAN, |f| f.gains[g as usize]);
            let sign = if g.follows_motor(servo.law) {
                sign
            } else {
                1.0
            };
            let least = match g {
                Gain::Kp if cascade => SLOW,
                Gain::Kp | Gain::Gravity => 0.0,
                Gain::Kd | Gain::Kv => DAMPED * critical,
                Gain::Ki => SLOW * if cascade { DAMPED * critical } else { kp },
                _ => self.shortest(),
            };
            let value = (value * sign).max(least);
            let half_width = reach(g, value);
            let value = Some(value * sign);
            (g, ServoGain { value, half_width })
        };
        let unknown = servo.gains().filter(|&g| stated(g).is_none());
        Ok(unknown.map(of).collect())
    }

    /// The shortest time that is looked at: the records have samples no closer.
    fn shortest(&self) -> f64 {
        let steps = self.case.records.iter().map(|r| r.h);
        steps.fold(SLOWEST, f64::min)
    }
}

/// Inputs with which the drives make up for gravity along a record, `[joint][sample]`; none where no drive
/// does.
fn gravity(case: &Case, r: &Record) -> Vec<Vec<f64>> {
    let n = case.n();
    let description = &case.nominal.description;
    let fed = |j| description.servo(j).is_some_and(|s| s.has(Gain::Gravity));
    let mut out = vec![vec![0.0; r.len()]; n];
    if !(0..n).any(fed) {
        return out;
    }
    let (mut work, gains) = Constants::<f64>::known_to_drives(&case.nominal);
    let (mut q, v, mut bias) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    for k in 0..r.len() {
        (q.iter_mut().zip(&r.smooth_q)).for_each(|(q, smooth)| *q = smooth[k]);
        let at = links::At {
            q: &q,
            v: &v,
            force: None,
        };
        let programs = &case.nominal.links;
        programs.evaluate(&mut work, &at, f64::sin_cos, &mut bias);
        for j in 0..n {
            out[j][k] = bias[j] / gains[j];
        }
    }
    out
}

/// Numbers of a loop in which its law is not linear.
#[derive(Debug, Clone, Copy)]
struct Curved {
    /// Of a cascade: its velocity is limited.
    kp: f64,
    target_time: f64,
    velocity_time: f64,
}

/// Fits the law of a joint to inputs along the records, an offset free; unknown numbers in which it is not
/// linear are those of a row of them that explain most.
fn followed(case: &Case, j: usize, inputs: &[Fitted<'_>]) -> Option<Followed> {
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
    let mut best: Option<Followed> = None;
    for &kp in &kp {
        for &target_time in &times[0] {
            for &velocity_time in &times[1] {
                let at = Curved {
                    kp,
                    target_time,
                    velocity_time,
                };
                let fit = fitted(servo, at, inputs);
                let least = best.as_ref().map_or(f64::NEG_INFINITY, |b| b.explained);
                best = fit.filter(|f| f.explained > least).or(best);
            }
        }
    }
    best
}

/// What a law multiplies its gains with, sample by sample: errors, velocities and integrals of errors; of a
/// cascade the velocity that lacks and its integral.
fn seen(servo: &Servo, k: &Gains<f64>, (r, j): (&Record, usize)) -> Vec<[f64; 3]> {
    let (q, v, h) = (&r.smooth_q[j], &r.smooth_v[j], r.h);
    let mut memory = Shaped::at_rest(r.u[j][0]);
    let (mut velocity, mut integral) = (v[0], 0.0);
    let most = servo.velocity_limit.unwrap_or(f64::INFINITY);
    let of = |i: usize| {
        let [_, target] = shaped(servo, k, &mut memory, r.u[j][i], (h * i as f64, h), 0.0);
        let error = target - q[i];
        let band = servo.dead_band.unwrap_or(0.0);
        let error = error - error.clamp(-band, band);
        velocity = match servo.has(Gain::VelocityTime) {
            true => filter::after(velocity, v[i], k.velocity_time, h),
            false => v[i],
        };
        let lacks = match servo.law {
            ServoLaw::Cascade => (k.kp * error).clamp(-most, most) - velocity,
            _ => error,
        };
        integral += lacks * h;
        match servo.law {
            ServoLaw::Cascade => [lacks, integral, 0.0],
            _ => [error, -velocity, integral],
        }
    };
    (0..r.len()).map(of).collect()
}

/// The same fit with the numbers in which the law is not linear.
fn fitted(servo: &Servo, curved: Curved, inputs: &[Fitted<'_>]) -> Option<Followed> {
    let k = Gains::of(|gain| match gain {
        Gain::Kp => curved.kp,
        Gain::TargetTime => curved.target_time,
        Gain::VelocityTime => curved.velocity_time,
        _ => 0.0,
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
    let width = 1 + columns + usize::from(free);
    // Where the limit holds, the gains do not show: which samples these are the inputs say.
    let most = servo.limit.map_or(f64::INFINITY, |limit| FREE * limit);
    let (mut gram, mut right) = (DMatrix::zeros(width, width), DVector::zeros(width));
    let (mut sum, mut square, mut count) = (0.0, 0.0, 0.0);
    for own in inputs {
        let all = seen(servo, &k, (own.record, own.joint));
        for (i, [a, b, c]) in all.into_iter().enumerate() {
            let u = own.u[i];
            if !u.is_finite() || u.abs() > most {
                continue;
            }
            let u = u - known * own.gravity[i];
            let mut row =
                DVector::from_iterator(width, [1.0, a, b, c, 0.0].into_iter().take(width));
            if free {
                row[width - 1] = own.gravity[i];
            }
            gram.ger(1.0, &row, &row, 1.0);
            right.axpy(u, &row, 1.0);
            (sum, square, count) = (sum + u, square + u * u, count + 1.0);
        }
    }
    let variance = square - sum * sum / f64::max(count, 1.0);
    let x = gram.lu().solve(&right)?;
    let left = square - x.dot(&right);
    let at = |i: usize| if i <= columns { x[i] } else { 0.0 };
    let gains = Gain::ALL.map(|gain| match gain {
        Gain::Kp if cascade => curved.kp,
        Gain::Kv => at(1),
        Gain::Kp => at(1),
        Gain::Ki if cascade => at(2),
        Gain::Kd => at(2),
        Gain::Ki => at(3),
        Gain::Gravity if free => x[width - 1],
        Gain::Gravity => known,
        Gain::TargetTime => curved.target_time,
        Gain::VelocityTime => curved.velocity_time,
        _ => 0.0,
    });
    let found = Followed {
        gains,
        stiffness: at(1) * if cascade { curved.kp } else { 1.0 },
        explained: 1.0 - left / variance.max(1e-300),
    };
    Some(found).filter(|f| f.gains.iter().all(|x| x.is_finite()))
}
