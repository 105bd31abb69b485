//! Joints whose input is the target of a position loop inside the drive: their targets in place of the
//! inputs, where unknown gains start, and what of a loop cannot be.

mod begin;
mod centre;
mod followed;
mod stable;
mod staged;

use std::borrow::Cow;

use pid_data::{Dataset, InputQuantity};
use pid_interpret::links;
use pid_interpret::nominal as description;

use crate::case::{Case, CaseError, Record};
use crate::constants::{Constant, Constants};
use crate::described::in_loops;
use crate::nominal::{Nominal, NominalError};
use crate::regular;

pub(crate) use begin::begin;
pub(crate) use centre::{centred, recentred};
pub(crate) use stable::checked;
pub(crate) use staged::start;

/// Share of the largest speed over which dry friction changes its sign.
const REST: f64 = 0.02;
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
    factors_of_gains(nominal, dataset)?;
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
                let Some(qref) = e.targets().map(Cow::into_owned) else {
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
                let driven = !e.gain_factors.is_off(j) && measured.iter().any(|u| *u != 0.0);
                *own = driven.then_some(measured);
            }
        }
        recorded.push(own);
    }
    Ok(Some((out, recorded)))
}

/// Refuses factors of gains that no loop has.
fn factors_of_gains(nominal: &Nominal, dataset: &Dataset) -> Result<(), CaseError> {
    for e in &dataset.experiments {
        for (key, factors) in e.gain_factors.stated() {
            let has = |j: usize| {
                let servo = nominal.description.servo(j);
                servo.is_some_and(|servo| servo.gains().any(|gain| gain.key() == key))
            };
            let odd = |(j, factor): (usize, f64)| (factor != 1.0 && !has(j)).then_some((j, factor));
            if let Some((j, value)) = factors.iter().copied().enumerate().find_map(odd) {
                return Err(CaseError::NoGain {
                    record: e.name.clone(),
                    gain: key,
                    value,
                    joint: nominal.joints[j].name.clone(),
                });
            }
        }
    }
    Ok(())
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

/// Records with targets as inputs where the drives of a description have position loops, and the description with
/// effects that are stages of these as their numbers ([`in_loops`]) and a value for every gain: an unknown one where
/// the motions say it is.
///
/// # Errors
/// As [`Case::new`].
pub fn commanded(
    nominal: &description::Nominal,
    dataset: &Dataset,
) -> Result<(description::Nominal, Dataset), CaseError> {
    let nominal = &in_loops(nominal).map_err(NominalError::from)?;
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

/// Largest speed of a joint in the records, above zero.
fn fastest(case: &Case, j: usize) -> f64 {
    let speeds = case.records.iter().flat_map(|r| &r.smooth_v[j]);
    speeds.fold(1e-9, |most: f64, v| most.max(v.abs()))
}

/// Largest acceleration of a joint in the records, by its smoothed velocities, above zero.
fn hardest(case: &Case, j: usize) -> f64 {
    let along = |r: &Record| {
        let jumps = r.smooth_v[j].windows(2).map(|v| (v[1] - v[0]).abs());
        jumps.fold(1e-9, f64::max) / r.h
    };
    case.records.iter().map(along).fold(1e-9, f64::max)
}

/// Forces that the motions take under the nominal structure, friction included: `[record][joint][sample]`.
pub(crate) fn needed(case: &Case) -> Vec<Vec<Vec<f64>>> {
    let speed: Vec<f64> = (0..case.n()).map(|j| fastest(case, j)).collect();
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
            let induced = match r.gain_factors.is_off(j) {
                true => 0.0,
                false => constants.induced(j),
            };
            force += (constants.get(Constant::Viscous(j)) + induced) * v[j]
                + constants.get(Constant::Coulomb(j)) * rest;
            out.push(force);
        }
    }
    out
}

fn at<T: ToString>(place: &Option<T>) -> String {
    place
        .as_ref()
        .map_or_else(|| "drive".to_owned(), T::to_string)
}
