//! Position loops that cannot hold their joint, and records too slow for a loop.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use pid_interpret::nominal::{Role as Part, Servo};

use super::at;
use crate::case::{Case, CaseError, Record};
use crate::drives::{Gains, Seen, filter, growth, slopes, unlimited};

/// Samples that a period of a loop needs: its gains and its damping show as motion between samples.
/// Four are twice what the sampling theorem asks for.
const SAMPLES: f64 = 4.0;
/// Growth per radian of a swing that counts as rounding.
const ROUNDING: f64 = 1e-9;

/// Gains of a joint in a record at deviations of its tolerances, all the same.
fn gains((case, record): (&Case, &Record), j: usize, deviation: f64) -> Gains<f64> {
    let mut out = Gains::of(|gain| {
        let place = case.nominal.place(j, Part::Servo(gain));
        place.map(|i| {
            let own = &case.nominal.values[i];
            own.nominal - deviation * own.half_width * own.nominal.signum()
        })
    });
    out.times(|gain| record.gain_factors.at(gain as usize, j));
    out
}

/// Records of which no two have the same gains.
fn different(case: &Case) -> Vec<&Record> {
    let mut out: Vec<&Record> = Vec::new();
    for record in &case.records {
        if out
            .iter()
            .all(|own| own.gain_factors != record.gain_factors)
        {
            out.push(record);
        }
    }
    out
}

/// Refuses a loop that is unstable at its stated rate, or by its integral; warns where only the nominal
/// gains are, and where the records are too slow for a loop.
pub(crate) fn checked(case: &Case) -> Result<Vec<String>, CaseError> {
    let mut warnings = Vec::new();
    let different = different(case);
    for j in 0..case.n() {
        let Some(servo) = case.nominal.description.servo(j) else {
            continue;
        };
        let on = || different.iter().filter(|r| !r.gain_factors.is_off(j));
        for record in on() {
            warnings.extend(judged((case, record), (j, servo))?);
        }
        let frequency = |r: &&Record| {
            let [stiffness, _] = slopes(servo.law, &gains((case, r), j, 0.0));
            (case.nominal.gain(j) * stiffness / case.scale[j].inertia).sqrt()
                / std::f64::consts::TAU
        };
        let hertz = on().map(frequency).fold(0.0, f64::max);
        let rates = case.records.iter().map(|r| 1.0 / r.h);
        let rate = rates.fold(f64::INFINITY, f64::min);
        if rate < SAMPLES * hertz {
            let name = &case.nominal.joints[j].name;
            warnings.push(format!(
                "joint `{name}`: its position loop answers at {hertz:.0} Hz, and the records have {rate:.0} samples a second: its gains show between samples only; record at {:.0} Hz or more",
                SAMPLES * hertz
            ));
        }
    }
    Ok(warnings)
}

/// Refuses the loop of a joint that is unstable with its gains in a record; warns where only the nominal gains are.
fn judged(
    (case, record): (&Case, &Record),
    (j, servo): (usize, &Servo),
) -> Result<Option<String>, CaseError> {
    let stated = value(case, j, Part::Viscous, 0.0);
    let Some(why) = unstable(case, j, &gains((case, record), j, 0.0), stated) else {
        return Ok(None);
    };
    let name = &case.nominal.joints[j].name;
    let why = match record.gain_factors.are_one() {
        true => why,
        false => format!("{why} in record `{}`", record.name),
    };
    // The least gains of the tolerance are the most stable ones.
    let least = gains((case, record), j, 1.0);
    let braked = value(case, j, Part::Viscous, 1.0) + dry(case, j);
    if unstable(case, j, &least, braked).is_some() {
        return Err(CaseError::Unstable {
            joint: name.clone(),
            place: at(&servo.place),
            why,
        });
    }
    let holds = match unstable(case, j, &least, stated).is_none() {
        true => "only smaller ones within the tolerance hold the joint",
        false => "dry friction alone holds the joint",
    };
    Ok(Some(format!(
        "joint `{name}`: {why} with the stated gains, {holds}"
    )))
}

/// Viscous friction that brakes a swing at the largest speed V of the records as dry friction does, 4 f/(π V)
/// (describing function; J.-J. Slotine, W. Li, Applied Nonlinear Control, 1991, chapter 5): what grows beyond
/// that leaves the motion of the records.
fn dry(case: &Case, j: usize) -> f64 {
    let speeds = case.records.iter().flat_map(|r| &r.smooth_v[j]);
    let largest = speeds.fold(0.0, |m: f64, v| m.max(v.abs()));
    match largest > 0.0 {
        true => 4.0 * value(case, j, Part::Coulomb, 1.0) / (std::f64::consts::PI * largest),
        false => 0.0,
    }
}

/// A value of a joint, so many tolerances from the stated one.
fn value(case: &Case, j: usize, part: Part, deviation: f64) -> f64 {
    let place = case.nominal.place(j, part);
    place.map_or(0.0, |i| {
        let own = &case.nominal.values[i];
        own.nominal + own.half_width * deviation
    })
}

/// Why a loop is unstable, on the inertia of the joint with the others free and viscous friction.
fn unstable(case: &Case, j: usize, k: &Gains<f64>, viscous: f64) -> Option<String> {
    let servo = case.nominal.description.servo(j)?;
    let gain = case.nominal.gain(j);
    let joint = Linear {
        servo,
        k,
        gain,
        inertia: case.scale[j].inertia,
        viscous: viscous + gain * k.back_emf.unwrap_or(0.0),
    };
    if servo.law.integrates() && joint.swings_up() {
        return Some(format!("ki = {:.4} makes the loop swing up", k.ki));
    }
    let rate = servo.rate_hz?;
    (joint.radius(1.0 / rate) >= 1.0).then(|| format!("at {rate} Hz the loop swings up"))
}

/// A joint behind its loop where nothing is limited; states are position, velocity, the velocity that the
/// loop uses, and the integral.
struct Linear<'a> {
    servo: &'a Servo,
    k: &'a Gains<f64>,
    gain: f64,
    inertia: f64,
    viscous: f64,
}

impl Linear<'_> {
    fn seen(q: f64, v: f64) -> Seen<f64> {
        Seen {
            r: 0.0,
            q,
            v,
            ahead: 0.0,
            gravity: 0.0,
            inertia: 0.0,
        }
    }

    /// Output, and growth of the integral, per unit of the position and of the velocity that is used.
    fn rows(&self) -> [[f64; 2]; 2] {
        let mut free = self.servo.clone();
        (free.dead_band, free.velocity_limit) = (None, None);
        let u = |q, v| unlimited(&free, self.k, &Self::seen(q, v), 0.0).u;
        let z = |q, v| growth(&free, self.k, &Self::seen(q, v));
        [[u(1.0, 0.0), u(0.0, 1.0)], [z(1.0, 0.0), z(0.0, 1.0)]]
    }

    /// Whether the loop that answers at once grows.
    fn swings_up(&self) -> bool {
        let ([[uq, uw], [zq, zw]], push) = (self.rows(), self.gain / self.inertia);
        let drag = -self.viscous / self.inertia;
        let a = match self.k.velocity_time {
            Some(time) => {
                let fast = 1.0 / time;
                DMatrix::from_row_slice(
                    4,
                    4,
                    &[
                        [0.0, 1.0, 0.0, 0.0],
                        [push * uq, drag, push * uw, push],
                        [0.0, fast, -fast, 0.0],
                        [zq, 0.0, zw, 0.0],
                    ]
                    .concat(),
                )
            }
            None => DMatrix::from_row_slice(
                3,
                3,
                &[
                    [0.0, 1.0, 0.0],
                    [push * uq, drag + push * uw, push],
                    [zq, zw, 0.0],
                ]
                .concat(),
            ),
        };
        let mut all = a.complex_eigenvalues().iter().copied().collect::<Vec<_>>();
        all.retain(|z| z.norm() > 0.0);
        all.iter().any(|z| z.re > ROUNDING * z.norm())
    }

    /// Spectral radius of the loop that reads once in a period, s, and holds its output.
    fn radius(&self, period: f64) -> f64 {
        let [[uq, uw], [zq, zw]] = self.rows();
        let a = Matrix2::new(0.0, 1.0, 0.0, -self.viscous / self.inertia) * period;
        let step = a.exp();
        // ∫ exp(A t) dt b over a period, by its end and middle (Simpson).
        let b = Vector2::new(0.0, self.gain / self.inertia);
        let push = (b + (a * 0.5).exp() * b * 4.0 + step * b) * (period / 6.0);
        let time = self.k.velocity_time;
        let kept = time.map_or(0.0, |time| filter::kept(time, period));
        let integrates = zq != 0.0 || zw != 0.0;
        let size = if integrates { 4 } else { 3 };
        // Reading: the velocity that is used, then the integral, then the output.
        let mut used = DVector::zeros(size);
        (used[1], used[2]) = (1.0 - kept, kept);
        let mut u = &used * uw;
        u[0] += uq;
        let mut next = DMatrix::zeros(size, size);
        next.row_mut(2).copy_from(&used.transpose());
        if integrates {
            let mut z = &used * (zw * period);
            z[0] += zq * period;
            z[3] += 1.0;
            u += &z;
            next.row_mut(3).copy_from(&z.transpose());
        }
        for i in 0..2 {
            for c in 0..size {
                next[(i, c)] = push[i] * u[c] + if c < 2 { step[(i, c)] } else { 0.0 };
            }
        }
        let all = next.complex_eigenvalues();
        all.iter().fold(0.0, |most: f64, z| most.max(z.norm()))
    }
}
