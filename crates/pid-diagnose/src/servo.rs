//! Joints whose input is the target of a position loop inside the drive: their targets in place of the
//! inputs, where unknown gains start, and what of a loop cannot be.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use pid_data::{Dataset, InputQuantity};
use pid_interpret::links;
use pid_interpret::nominal::{self as description, Gain, Role as Part, ServoGain, ServoLaw};

use crate::case::{Case, CaseError, Record};
use crate::constants::{Constant, Constants};
use crate::drives::Gains;
use crate::nominal::Nominal;
use crate::regular;

/// Range of a kp that is unknown, as a share of where it starts.
const UNKNOWN: f64 = 0.9;
/// Damping ratio of the loop at which an unknown kd starts at least.
const DAMPED: f64 = 0.5;
/// Rate at which an unknown integral starts at least, 1/s, in kp.
const SLOW: f64 = 0.2;
/// Share of the limit beyond which a sample tells nothing of the gains.
const FREE: f64 = 0.95;
/// Share of the largest speed over which dry friction changes its sign.
const REST: f64 = 0.02;
/// Samples that a period of a loop needs: its gains and its damping show as motion between samples.
/// Four are twice what the sampling theorem asks for.
const SAMPLES: f64 = 4.0;
/// Share of the variance of a recorded input that the law must explain to be compared with it.
const FOLLOWED: f64 = 0.95;
/// Deviation of a stated gain from that of the recorded input that is worth a warning, beyond the tolerance.
const OFF: f64 = 0.05;

/// Inputs that were recorded beside targets, record by record and joint by joint; `None` of a joint
/// without a loop or without inputs.
pub(crate) type Recorded = Vec<Vec<Option<Vec<f64>>>>;

/// The records with targets as inputs where a drive has a loop, and what was recorded as inputs there.
pub(crate) fn targets(
    nominal: &Nominal,
    dataset: &Dataset,
) -> Result<Option<(Dataset, Recorded)>, CaseError> {
    let n = nominal.n();
    for (j, channel) in dataset.joints.iter().enumerate() {
        if channel.input == InputQuantity::Position && nominal.description.servo(j).is_none() {
            return Err(CaseError::NoDrive {
                joint: channel.name.clone(),
            });
        }
    }
    if !nominal.description.has_servos() {
        return Ok(None);
    }
    let mut out = dataset.clone();
    let mut recorded = Vec::new();
    for e in &mut out.experiments {
        let mut own = vec![None; n];
        for (j, own) in own.iter_mut().enumerate() {
            if nominal.description.servo(j).is_none() {
                continue;
            }
            let as_input = dataset.joints[j].input == InputQuantity::Position;
            if !as_input {
                let Some(qref) = &e.qref else {
                    return Err(CaseError::NoTarget {
                        record: e.name.clone(),
                        joint: nominal.joints[j].name.clone(),
                        column: j + 1,
                    });
                };
                let measured: Vec<f64> = e.u.iter().skip(j).step_by(n).copied().collect();
                for (u, r) in
                    e.u.iter_mut()
                        .skip(j)
                        .step_by(n)
                        .zip(qref.iter().skip(j).step_by(n))
                {
                    *u = *r;
                }
                let measured = match regular::needed(&e.t) {
                    Some(at) => regular::readings(&e.t, &measured, &at),
                    None => measured,
                };
                *own = measured.iter().any(|u| *u != 0.0).then_some(measured);
            }
        }
        recorded.push(own);
    }
    Ok(Some((out, recorded)))
}

/// Whether the records hold targets of a position loop and no input of its motor.
pub fn only_targets(nominal: &description::Nominal, dataset: &Dataset) -> bool {
    let silent = |j: usize| {
        let mut all = dataset.experiments.iter();
        all.all(|e| {
            let own = e.u.iter().skip(j).step_by(e.nu().max(1));
            own.copied().all(|u| u == 0.0)
        })
    };
    let mut looped = (0..dataset.nq()).filter(|&j| nominal.servo(j).is_some());
    looped.any(|j| dataset.joints[j].input == InputQuantity::Position || silent(j))
}

/// Records with targets as inputs where the drives of a description have position loops, and the
/// description with a value for every gain: an unknown one where the motions say it is.
///
/// # Errors
/// As [`Case::new`].
pub fn commanded(
    nominal: &description::Nominal,
    dataset: &Dataset,
) -> Result<(description::Nominal, Dataset), CaseError> {
    let case = Case::new(Nominal::new(nominal.clone()), dataset)?;
    let servos = case.nominal.servos(&vec![0.0; case.nominal.size()]);
    let mut records = match targets(&case.nominal, dataset)? {
        Some((records, _)) => records,
        None => dataset.clone(),
    };
    for (j, channel) in records.joints.iter_mut().enumerate() {
        if nominal.servo(j).is_some() {
            channel.input = InputQuantity::Position;
            channel.input_unit = channel.unit().to_owned();
        }
    }
    Ok((nominal.clone().with_servos(servos), records))
}

/// Forces that the motions take under the nominal structure, friction included: `[record][joint][sample]`.
pub(crate) fn needed(case: &Case) -> Vec<Vec<Vec<f64>>> {
    let largest = |j: usize| {
        let speeds = case.records.iter().flat_map(|r| &r.smooth_v[j]);
        speeds.fold(1e-9, |m: f64, v| m.max(v.abs()))
    };
    let speed: Vec<f64> = (0..case.n()).map(largest).collect();
    let own = case.records.iter();
    own.map(|r| needed_along(case, r, &speed)).collect()
}

/// The same along one record, `[joint][sample]`, with the largest speeds.
fn needed_along(case: &Case, r: &Record, speed: &[f64]) -> Vec<Vec<f64>> {
    let n = case.n();
    let constants = Constants::<f64>::new(&case.nominal, &vec![0.0; case.nominal.size()]);
    let (mut work, mut bias) = (constants.prepared(), vec![0.0; n]);
    let a = r.accelerations();
    let mut out = vec![Vec::with_capacity(r.len()); n];
    let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..r.len() {
        for j in 0..n {
            (q[j], v[j]) = (r.smooth_q[j][k], r.smooth_v[j][k]);
        }
        let at = links::At {
            q: &q,
            v: &v,
            force: None,
        };
        let programs = &case.nominal.links;
        programs.evaluate(&mut work, &at, f64::sin_cos, &mut bias);
        for (j, out) in out.iter_mut().enumerate() {
            let mut force = bias[j] + constants.get(Constant::Rotor(j)) * a[j][k];
            for (i, a) in a.iter().enumerate() {
                let (row, column) = (i.max(j), i.min(j));
                force += work.mass()[row * (row + 1) / 2 + column] * a[k];
            }
            let rest = (v[j] / (REST * speed[j])).tanh();
            force += constants.get(Constant::Viscous(j)) * v[j]
                + constants.get(Constant::Coulomb(j)) * rest;
            out.push(force);
        }
    }
    out
}

/// A law fitted to inputs by least squares.
struct Followed {
    gains: [f64; 3],
    /// Share of the variance that it explains.
    explained: f64,
}

/// Fits the law of a joint to inputs along the records, an offset free.
fn followed(case: &Case, j: usize, inputs: &[(&Record, Vec<f64>)]) -> Option<Followed> {
    let servo = case.nominal.description.servo(j)?;
    let width = servo.law.gains().len() + 1;
    // Where the limit holds, the gains do not show: which samples these are the inputs say.
    let most = servo.limit.map_or(f64::INFINITY, |limit| FREE * limit);
    let (mut gram, mut right) = (DMatrix::zeros(width, width), DVector::zeros(width));
    let (mut sum, mut square, mut count) = (0.0, 0.0, 0.0);
    for (r, u) in inputs {
        let mut integral = 0.0;
        for (k, &u) in u.iter().enumerate() {
            let error = r.u[j][k] - r.smooth_q[j][k];
            integral += error * r.h;
            if !u.is_finite() || u.abs() > most {
                continue;
            }
            let row = [1.0, error, -r.smooth_v[j][k], integral];
            let row = DVector::from_column_slice(&row[..width]);
            gram.ger(1.0, &row, &row, 1.0);
            right.axpy(u, &row, 1.0);
            (sum, square, count) = (sum + u, square + u * u, count + 1.0);
        }
    }
    let variance = square - sum * sum / f64::max(count, 1.0);
    let x = gram.lu().solve(&right)?;
    let left = square - x.dot(&right);
    let mut gains = [0.0; 3];
    gains[..width - 1].copy_from_slice(&x.as_slice()[1..]);
    let found = Followed {
        gains,
        explained: 1.0 - left / variance.max(1e-300),
    };
    Some(found).filter(|f| f.gains.iter().all(|x| x.is_finite()))
}

/// Where unknown gains start, and what is odd about those that are stated. `recorded` are inputs beside
/// targets, at equal times.
pub(crate) fn begin(case: &mut Case, recorded: &Recorded) -> Result<Vec<String>, CaseError> {
    let mut warnings = Vec::new();
    let forces = needed(case);
    for j in 0..case.n() {
        let Some(servo) = case.nominal.description.servo(j).cloned() else {
            continue;
        };
        let own: Vec<(&Record, Vec<f64>)> = (case.records.iter().zip(recorded))
            .filter_map(|(r, own)| Some((r, own[j].clone()?)))
            .filter(|(r, own)| own.len() == r.len())
            .collect();
        let measured = (!own.is_empty()).then(|| followed(case, j, &own)).flatten();
        let measured = measured.filter(|f| f.explained > FOLLOWED && f.gains[0].abs() > 0.0);
        let gain = case.nominal.gain(j);
        let from_motion = || {
            let of = |own: &Vec<Vec<f64>>| own[j].iter().map(|f| f / gain).collect();
            let inputs: Vec<(&Record, Vec<f64>)> =
                case.records.iter().zip(forces.iter().map(of)).collect();
            followed(case, j, &inputs)
        };
        let unknown = |g: &&Gain| servo.gain(**g).value.is_none();
        let start = match (&measured, servo.law.gains().iter().any(|g| unknown(&g))) {
            (Some(found), _) => Some(found.gains),
            (None, true) => Some(from_motion().map_or([f64::NAN; 3], |found| found.gains)),
            (None, false) => None,
        };
        let Some(start) = start else { continue };
        let kp = start[0] * gain.signum();
        if (kp.is_nan() || kp <= 0.0) && servo.gain(Gain::Kp).value.is_none() {
            return Err(CaseError::NoLoop {
                joint: case.nominal.joints[j].name.clone(),
                place: at(&servo.place),
            });
        }
        let kp = servo.gain(Gain::Kp).value.map_or(kp, f64::abs);
        let critical = 2.0 * (kp * gain.abs() * case.scale[j].inertia).sqrt() / gain.abs();
        let least = [0.0, DAMPED * critical, SLOW * kp];
        for &g in servo.law.gains() {
            let found = start[g as usize];
            let stated = servo.gain(g);
            if let Some(value) = stated.value {
                let off = (found - value).abs() > stated.half_width + OFF * value.abs();
                if measured.is_some() && off && g == Gain::Kp {
                    let name = &case.nominal.joints[j].name;
                    warnings.push(format!(
                        "joint `{name}`: the recorded input follows the target with {} = {found:.4}, stated is {value} ± {}; the diagnosis takes the target and what is stated",
                        g.key(), stated.half_width
                    ));
                }
                continue;
            }
            let value = (found * gain.signum()).max(least[g as usize]);
            let half_width = if g == Gain::Kp {
                UNKNOWN * value
            } else {
                value
            };
            let value = Some(value * gain.signum());
            case.nominal
                .begin_servo(j, g, ServoGain { value, half_width });
        }
    }
    Ok(warnings)
}

fn at<T: ToString>(place: &Option<T>) -> String {
    place
        .as_ref()
        .map_or_else(|| "drive".to_owned(), T::to_string)
}

/// Gains of a joint at deviations of its tolerances, all the same.
fn gains(case: &Case, j: usize, deviation: f64) -> Gains<f64> {
    let of = |gain| {
        let place = case.nominal.place(j, Part::Servo(gain));
        place.map_or(0.0, |i| {
            let own = &case.nominal.values[i];
            own.nominal - deviation * own.half_width * own.nominal.signum()
        })
    };
    Gains {
        kp: of(Gain::Kp),
        kd: of(Gain::Kd),
        ki: of(Gain::Ki),
    }
}

/// Refuses a loop that is unstable at its stated rate, or by its integral; warns where only the nominal
/// gains are, and where the records are too slow for a loop.
pub(crate) fn checked(case: &Case) -> Result<Vec<String>, CaseError> {
    let mut warnings = Vec::new();
    for j in 0..case.n() {
        let Some(servo) = case.nominal.description.servo(j) else {
            continue;
        };
        let name = &case.nominal.joints[j].name;
        let stated = unstable(case, j, &gains(case, j, 0.0));
        if let Some(why) = stated {
            // The least gains of the tolerance are the most stable ones.
            if unstable(case, j, &gains(case, j, 1.0)).is_some() {
                return Err(CaseError::Unstable {
                    joint: name.clone(),
                    place: at(&servo.place),
                    why,
                });
            }
            warnings.push(format!(
                "joint `{name}`: {why} with the stated gains, only smaller ones within the tolerance hold the joint"
            ));
        }
        let k = gains(case, j, 0.0);
        let hertz =
            (case.nominal.gain(j) * k.kp / case.scale[j].inertia).sqrt() / std::f64::consts::TAU;
        let rate = case
            .records
            .iter()
            .map(|r| 1.0 / r.h)
            .fold(f64::INFINITY, f64::min);
        if rate < SAMPLES * hertz {
            warnings.push(format!(
                "joint `{name}`: its position loop answers at {hertz:.0} Hz, and the records have {rate:.0} samples a second: its gains show between samples only; record at {:.0} Hz or more",
                SAMPLES * hertz
            ));
        }
    }
    Ok(warnings)
}

/// Why a loop is unstable, on the inertia of the joint with the others free.
fn unstable(case: &Case, j: usize, k: &Gains<f64>) -> Option<String> {
    let servo = case.nominal.description.servo(j)?;
    let (gain, inertia) = (case.nominal.gain(j), case.scale[j].inertia);
    let viscous = case.nominal.place(j, Part::Viscous);
    let viscous = viscous.map_or(0.0, |i| case.nominal.values[i].nominal);
    // Routh and Hurwitz for I s³ + (f + g kd) s² + g kp s + g ki.
    let integral =
        servo.law == ServoLaw::Pid && (viscous + gain * k.kd) * gain * k.kp < inertia * gain * k.ki;
    if integral {
        return Some(format!("ki = {:.4} makes the loop swing up", k.ki));
    }
    let rate = servo.rate_hz?;
    let a = Matrix2::new(0.0, 1.0, 0.0, -viscous / inertia) / rate;
    let step = a.exp();
    // ∫ exp(A t) dt b over a period, by its end and middle (Simpson).
    let b = Vector2::new(0.0, gain / inertia);
    let held = (b + (a * 0.5).exp() * b * 4.0 + step * b) / (6.0 * rate);
    let closed = step - held * Vector2::new(k.kp, k.kd).transpose();
    let (trace, det) = (closed.trace(), closed.determinant());
    // Jury's criterion for z² − trace z + det.
    let holds = det.abs() < 1.0 && trace.abs() < 1.0 + det;
    (!holds).then(|| format!("at {rate} Hz the loop swings up"))
}
