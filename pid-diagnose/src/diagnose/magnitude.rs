//! Physical magnitudes of fitted effects with their standard deviations.

use nalgebra::DMatrix;

use super::{Magnitude, Named};
use crate::case::Case;
use crate::fit::Fit;
use crate::plant::{GAIN, PER_JOINT};

/// Factor on variances from the curvature: neighbouring innovations share information.
const SHARED: f64 = 2.0;

/// Curvature of a fit with 1 where a parameter has no influence, and which these are.
fn curvature(fit: &Fit) -> (DMatrix<f64>, Vec<bool>) {
    let mut h = fit.quadratic.h.clone();
    let dead: Vec<bool> = (0..h.nrows()).map(|i| h[(i, i)] <= 0.0).collect();
    for (i, dead) in dead.iter().enumerate() {
        if *dead {
            h[(i, i)] = 1.0;
        }
    }
    (h, dead)
}

/// Size of the last effect of a fit over its standard deviation, the largest of its amplitudes; 0 if it is not determined.
pub(super) fn size_in_deviations(fit: &Fit) -> f64 {
    let Some(term) = fit.hypothesis.terms.last() else {
        return 0.0;
    };
    let info = term.effect.info();
    let first = fit.point.e.len() - info.parameters.len();
    let size = fit.point.theta.len();
    let misfit = (fit.train.total() / fit.train.number()).max(1.0);
    let (h, dead) = curvature(fit);
    let Some(factor) = h.cholesky() else {
        return 0.0;
    };
    let covariance = factor.inverse() * (misfit * SHARED);
    let own: &[usize] = if info.amplitudes.is_empty() {
        &[0]
    } else {
        info.amplitudes
    };
    own.iter()
        .filter(|&&a| !dead[size + first + a])
        .map(|&a| {
            let i = size + first + a;
            fit.point.e[first + a].abs() / covariance[(i, i)].sqrt()
        })
        .fold(0.0, f64::max)
}

/// The effects of a fit with their magnitudes and standard deviations (from the curvature, widened where the misfit is larger than
/// the noise; 2 for what neighbouring innovations share).
pub(super) fn name(case: &Case, fit: &Fit) -> Vec<Named> {
    let misfit = (fit.train.total() / fit.train.number()).max(1.0);
    let size = fit.point.theta.len();
    // A parameter without any influence is not determined; the others are.
    let (h, dead) = curvature(fit);
    let covariance = h.cholesky().map(|c| c.inverse() * (misfit * SHARED));
    let mut at = 0;
    fit.hypothesis
        .terms
        .iter()
        .map(|term| {
            let info = term.effect.info();
            let k = info.parameters.len();
            let e = &fit.point.e[at..at + k];
            let joint = &case.nominal.joints[term.joint];
            // What is shown in torque rests on the motor gain, which is fitted within its tolerance.
            let at_gain = term.joint * PER_JOINT + GAIN;
            let gain_slope = joint.half_widths[GAIN];
            let gain = joint.gain() + gain_slope * fit.point.theta[at_gain];
            let rated = case.scale[term.joint].torque / joint.gain().abs();
            let shown = term.effect.shown(e, gain, rated);
            let own_dead: Vec<bool> = dead[size + at..size + at + k].to_vec();
            let places: Vec<usize> = (size + at..size + at + k)
                .chain(std::iter::once(at_gain))
                .collect();
            let own: Option<DMatrix<f64>> = covariance
                .as_ref()
                .map(|c| DMatrix::from_fn(k + 1, k + 1, |a, b| c[(places[a], places[b])]));
            at += k;
            let mut slopes: Vec<Vec<f64>> = (0..k)
                .map(|i| {
                    let step =
                        1e-6 * (e[i].abs() + 1e-3 * case.unit(info.parameters[i].unit, term.joint));
                    let mut moved = e.to_vec();
                    moved[i] += step;
                    term.effect
                        .shown(&moved, gain, rated)
                        .iter()
                        .zip(&shown)
                        .map(|(a, b)| (a.1 - b.1) / step)
                        .collect()
                })
                .collect();
            let step = 1e-6 * gain;
            slopes.push(
                term.effect
                    .shown(e, gain + step, rated)
                    .iter()
                    .zip(&shown)
                    .map(|(a, b)| (a.1 - b.1) / step * gain_slope)
                    .collect(),
            );
            let parameters = shown
                .iter()
                .enumerate()
                .map(|(s, (name, x))| {
                    let lost = (0..k).any(|a| own_dead[a] && slopes[a][s] != 0.0);
                    let variance = own.as_ref().filter(|_| !lost).map(|c| {
                        (0..=k)
                            .flat_map(|a| (0..=k).map(move |b| (a, b)))
                            .map(|(a, b)| slopes[a][s] * c[(a, b)] * slopes[b][s])
                            .sum::<f64>()
                    });
                    Magnitude {
                        name: (*name).to_owned(),
                        value: *x,
                        std: variance
                            .filter(|v| *v >= 0.0 && v.is_finite())
                            .map(f64::sqrt),
                    }
                })
                .collect();
            Named {
                effect: info.id.to_owned(),
                joint: term.shown_joint(),
                parameters,
                regime: info.regime.to_owned(),
            }
        })
        .collect()
}
