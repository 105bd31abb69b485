//! Where unknown gains of position loops start: the law fitted to recorded inputs, or to the forces that the
//! motions take.

use pid_interpret::links;
use pid_interpret::nominal::{Gain, Servo, ServoGain, ServoLaw};

use super::followed::{EASED, Fitted, Followed, SLOWED, SLOWEST, followed};
use super::{Recorded, at, fastest, hardest, needed, staged};
use crate::case::{Case, CaseError, Record};
use crate::constants::Constants;

/// Range of a kp that is unknown, as a share of where it starts.
const UNKNOWN: f64 = 0.9;
/// Damping ratio of the loop at which an unknown kd starts at least.
const DAMPED: f64 = 0.5;
/// Rate at which an unknown integral starts at least, 1/s, in kp.
const SLOW: f64 = 0.2;
/// Share of the variance of a recorded input that the law must explain to be compared with it.
const FOLLOWED: f64 = 0.95;
/// Share of the variance of the forces of a motion that a law with a further stage must explain at least to stand in
/// for one that pushes away from the targets: a target with the wrong sign is none.
const ROUGHLY: f64 = 0.5;
/// Deviation of a stated gain from that of the recorded input that is worth a warning, beyond the tolerance.
const OFF: f64 = 0.05;

/// Where unknown gains start, and what is odd about those that are stated. `recorded` are inputs beside
/// targets, at equal times.
pub(crate) fn begin(case: &mut Case, recorded: &Recorded) -> Result<Vec<String>, CaseError> {
    let mut warnings = Vec::new();
    let forces = needed(case);
    let fed: Vec<Vec<Fed>> = case.records.iter().map(|r| fed(case, r)).collect();
    for j in 0..case.n() {
        let Some(servo) = case.nominal.description.servo(j).cloned() else {
            continue;
        };
        let with = |i: usize, u: Vec<f64>| Fitted {
            record: &case.records[i],
            joint: j,
            u,
            gravity: fed[i][j].gravity.clone(),
            inertia: fed[i][j].inertia.clone(),
            sign: case.nominal.gain(j).signum(),
        };
        let own: Vec<Fitted<'_>> = (recorded.iter().enumerate())
            .filter_map(|(i, own)| Some(with(i, own[j].clone()?)))
            .filter(|own| own.u.len() == own.record.len())
            .collect();
        let on = |i: &usize| !case.records[*i].gain_factors.is_off(j);
        let measured = match own.is_empty() {
            true => None,
            false => followed(case, (j, &servo), &own),
        };
        let measured = measured.filter(|f| f.explained > FOLLOWED && f.stiffness.abs() > 0.0);
        let gain = case.nominal.gain(j);
        let inputs: Vec<Fitted<'_>> = match measured.is_some() {
            true => own,
            false => (0..forces.len())
                .filter(on)
                .map(|i| with(i, forces[i][j].iter().map(|f| f / gain).collect()))
                .collect(),
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
        let found = measured.or_else(|| followed(case, (j, &servo), &inputs));
        let laws = match &found {
            Some(found) => staged::laws(case, (j, &servo), &inputs, found),
            None => Vec::new(),
        };
        // Where the law alone pushes away from the targets, one with a further stage may not.
        let pushes = |f: &&Followed| f.stiffness * gain.signum() > 0.0;
        let own = found.as_ref().filter(pushes);
        let wider = found.as_ref().and_then(|own| staged::decided(&laws, own));
        let follows = |f: &&Followed| pushes(f) && f.explained > ROUGHLY;
        let own = own.or_else(|| staged::best(laws.iter().map(|(_, f)| f).filter(follows)));
        let starts = start.of((own, wider.filter(pushes)))?;
        let further = staged::starts(case, j, &servo, &laws);
        for (gain, value) in starts {
            case.nominal.begin_servo(j, gain, value);
        }
        case.staged.extend(further);
    }
    Ok(warnings)
}

/// How far from where it starts an unknown gain may lie: down to nothing, but for those without which there is
/// no loop and for times.
pub(super) fn reach(gain: Gain, size: f64) -> f64 {
    match gain {
        Gain::Gravity | Gain::InertiaAhead | Gain::VelocityAhead => size.max(1.0),
        Gain::Kd | Gain::Ki | Gain::BackEmf => size,
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
    fn of(
        &self,
        (found, wider): (Option<&Followed>, Option<&Followed>),
    ) -> Result<Vec<(Gain, ServoGain)>, CaseError> {
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
        let factor = |g: Gain| case.usual_factor(g, j);
        let stiff = match cascade {
            true => kp * factor(Gain::Kp) * factor(Gain::Kv),
            false => kp * factor(Gain::Kp),
        };
        let critical =
            2.0 * (stiff.max(0.0) * gain.abs() * case.scale[j].inertia).sqrt() / gain.abs();
        let one = |g: Gain, found: Option<&Followed>| {
            let value = found.map_or(f64::NAN, |f| f.gains[g as usize]);
            let sign = if g.follows_motor(servo.law) {
                sign
            } else {
                1.0
            };
            let least = match g {
                Gain::Kp if cascade => SLOW / factor(g),
                Gain::Kp | Gain::Gravity | Gain::InertiaAhead | Gain::VelocityAhead => 0.0,
                Gain::TargetSpeed => SLOWED * fastest(case, j),
                Gain::TargetAcceleration => EASED * hardest(case, j),
                Gain::Kd | Gain::Kv | Gain::BackEmf => DAMPED * critical / factor(g),
                Gain::Ki if cascade => SLOW * DAMPED * critical / factor(g),
                Gain::Ki => SLOW * stiff / factor(g),
                _ => self.shortest(),
            };
            let value = (value * sign).max(least);
            (value, reach(g, value), sign)
        };
        let of = |g: Gain| {
            let (mut value, mut half_width, sign) = one(g, found);
            if let (Some(wider), true) = (wider, servo.law.gains().contains(&g)) {
                // From the least to the largest of both.
                let (other, reach, _) = one(g, Some(wider));
                let low = (value - half_width).min(other - reach);
                let high = (value + half_width).max(other + reach);
                (value, half_width) = (0.5 * (low + high), 0.5 * (high - low));
            }
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

/// Inputs of a drive along a record, sample by sample: with which its model makes up for gravity, and per acceleration
/// of the joint alone.
#[derive(Debug, Clone)]
struct Fed {
    gravity: Vec<f64>,
    inertia: Vec<f64>,
}

/// The same of all joints; zero where no drive has a loop.
fn fed(case: &Case, r: &Record) -> Vec<Fed> {
    let n = case.n();
    let description = &case.nominal.description;
    let none = || Fed {
        gravity: vec![0.0; r.len()],
        inertia: vec![0.0; r.len()],
    };
    let mut out = vec![none(); n];
    if !description.has_servos() {
        return out;
    }
    let (mut work, known) = Constants::<f64>::known_to_drives(&case.nominal);
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
            let own = work.mass()[j * (j + 3) / 2] + known.rotors[j];
            out[j].gravity[k] = bias[j] / known.gains[j];
            out[j].inertia[k] = own / known.gains[j];
        }
    }
    out
}
