//! Physical magnitudes of fitted effects with their standard deviations.

use nalgebra::{DMatrix, DVector};

use super::measure::misfit;
use super::spread::Spread;
use crate::case::Case;
use crate::criteria::Criteria;
use crate::described::unit_at;
use crate::diagnosis::{Magnitude, Named};
use crate::effect::{Quantity, Term};
use crate::fit::Fit;
use pid_interpret::nominal::Role as Part;

/// Curvature of a fit with 1 where a parameter has no influence, and which these are.
pub(super) fn curvature(fit: &Fit) -> (DMatrix<f64>, Vec<bool>) {
    let mut h = fit.quadratic.h.clone();
    let dead: Vec<bool> = (0..h.nrows()).map(|i| h[(i, i)] <= 0.0).collect();
    for (i, dead) in dead.iter().enumerate() {
        if *dead {
            h[(i, i)] = 1.0;
        }
    }
    (h, dead)
}

/// Size of the last effect of a fit over its standard deviation, the largest of its amplitudes; 0
/// if it is not determined.
///
/// An effect with an absent point is judged at the nominal parameters found: where a tolerance
/// alone separates the two, its likelihood speaks for it and not its size. One without such a point
/// brings freedom of its own and must be determined beside them.
pub(super) fn size_in_deviations(criteria: &Criteria, fit: &Fit) -> f64 {
    let Some(term) = fit.hypothesis.terms.last() else {
        return 0.0;
    };
    let info = term.effect.info();
    let scale = misfit(fit).max(1.0);
    let (mut h, mut dead) = curvature(fit);
    let mut size = fit.point.theta.len();
    let absent: [usize; 1] = [0];
    let own: &[usize] = if info.amplitudes.is_empty() {
        &absent
    } else {
        h = h.remove_rows(0, size).remove_columns(0, size);
        dead.drain(..size);
        size = 0;
        info.amplitudes
    };
    let first = fit.point.e.len() - info.parameters.len();
    let Some(factor) = h.cholesky() else {
        return 0.0;
    };
    let covariance = factor.inverse() * (scale * criteria.shared);
    own.iter()
        .filter(|&&a| !dead[size + first + a])
        .map(|&a| {
            let i = size + first + a;
            fit.point.e[first + a].abs() / covariance[(i, i)].sqrt()
        })
        .fold(0.0, f64::max)
}

/// Standard deviations of the deviations θ, in tolerances.
pub(super) fn deviations(case: &Case, criteria: &Criteria, fit: &Fit) -> Option<Vec<f64>> {
    let spread = Spread::new(case, criteria, fit)?;
    let own = 0..fit.point.theta.len();
    Some(own.map(|i| spread.deviation(i)).collect())
}

/// How many of its own standard deviations the amplitudes of each effect of a fit reach,
/// `√(eᵀ C⁻¹ e / m)` over its m amplitudes (A. Wald 1943), C the larger of those from the curvature
/// and from blocks of time; an effect without an absent point is judged by its first parameter.
/// Phases, rests and edges tell where an effect is, not that there is one. No more than each
/// parameter at whose zero the law is another one reaches by itself.
pub(super) fn sizes(case: &Case, criteria: &Criteria, fit: &Fit) -> Vec<f64> {
    let Some(spread) = Spread::of_predictions(case, criteria, fit) else {
        return vec![0.0; fit.hypothesis.terms.len()];
    };
    let size = fit.point.theta.len();
    let (starts, _) = fit.hypothesis.offsets();
    let (_, dead) = curvature(fit);
    fit.hypothesis
        .terms
        .iter()
        .zip(starts)
        .map(|(term, at)| {
            let own = match term.effect.info().amplitudes {
                [] => &[0][..],
                amplitudes => amplitudes,
            };
            // Nothing is known of an amplitude without influence, like that of a force across the
            // plane of a planar arm.
            let own: Vec<usize> = own
                .iter()
                .copied()
                .filter(|a| !dead[size + at + a])
                .collect();
            let reached = |own: &[usize]| {
                let m = own.len();
                let e = DVector::from_fn(m, |i, _| fit.point.e[at + own[i]]);
                [&spread.curved, &spread.blocks]
                    .iter()
                    .map(|c| {
                        let place = |i: usize| size + at + own[i];
                        let part = DMatrix::from_fn(m, m, |i, k| c[(place(i), place(k))]);
                        part.cholesky()
                            .map_or(0.0, |f| (e.dot(&f.solve(&e)) / m.max(1) as f64).sqrt())
                    })
                    .fold(f64::INFINITY, f64::min)
            };
            let essential = term.effect.essential().iter();
            essential.fold(reached(&own), |size, &one| size.min(reached(&[one])))
        })
        .collect()
}

/// The effects of a fit with their magnitudes and standard deviations.
pub(super) fn name(case: &Case, criteria: &Criteria, fit: &Fit) -> Vec<Named> {
    // A parameter without any influence is not determined; the others are.
    let (_, dead) = curvature(fit);
    let spread = Spread::new(case, criteria, fit);
    let (starts, _) = fit.hypothesis.offsets();
    let terms = fit.hypothesis.terms.iter().zip(starts);
    terms
        .map(|(term, at)| Named {
            effect: term.effect.info().id.to_owned(),
            joint: term.shown_joint(),
            parameters: magnitudes(case, fit, (term, at), (&dead, spread.as_ref())),
            regime: term.effect.info().regime.to_owned(),
            share: None,
            share_interval: None,
        })
        .collect()
}

/// What is shown of an effect whose parameters begin at `at`.
fn magnitudes(
    case: &Case,
    fit: &Fit,
    (term, at): (&Term, usize),
    (dead, spread): (&[bool], Option<&Spread>),
) -> Vec<Magnitude> {
    let size = fit.point.theta.len();
    let k = term.effect.info().parameters.len();
    let own_dead = &dead[size + at..size + at + k];
    let Shown {
        quantities,
        slopes,
        gain_place,
    } = Shown::new(case, fit, (term, at));
    let places: Vec<usize> = (size + at..size + at + k).chain([gain_place]).collect();
    let shown = quantities.into_iter().enumerate().map(|(s, quantity)| {
        let lost = (0..k).any(|a| own_dead[a] && slopes[a][s] != 0.0);
        let along = |c: &DMatrix<f64>| {
            (0..=k)
                .flat_map(|a| (0..=k).map(move |b| (a, b)))
                .map(|(a, b)| slopes[a][s] * c[(places[a], places[b])] * slopes[b][s])
                .sum::<f64>()
        };
        let variance = spread.filter(|_| !lost).map(|known| known.variance(along));
        Magnitude {
            name: quantity.name.to_owned(),
            value: quantity.value,
            unit: unit_at(&case.nominal.description, term.joint, quantity.si),
            std: variance
                .filter(|v| *v >= 0.0 && v.is_finite())
                .map(f64::sqrt),
        }
    });
    // With zero stiffness the rest position is 0/0: a magnitude that is not finite is dropped.
    shown.filter(|m| m.value.is_finite()).collect()
}

/// Quantities that are shown of an effect.
struct Shown {
    quantities: Vec<Quantity>,
    /// Their slopes in the effect's parameters, then in the deviation of the motor gain.
    slopes: Vec<Vec<f64>>,
    /// Place of that deviation.
    gain_place: usize,
}

impl Shown {
    fn new(case: &Case, fit: &Fit, (term, at): (&Term, usize)) -> Self {
        let parameters = term.effect.info().parameters;
        let e = &fit.point.e[at..at + parameters.len()];
        // What is shown in torque rests on the motor gain, which is fitted within its tolerance.
        let stated = case.nominal.gain(term.joint);
        let place = case.nominal.place(term.joint, Part::Gain);
        let gain_slope = place.map_or(0.0, |i| case.nominal.values[i].half_width);
        let gain_place = place.unwrap_or(0);
        let gain = stated + gain_slope * fit.point.theta[gain_place];
        let rated = case.scale[term.joint].torque / stated.abs();
        let quantities = term.effect.shown(e, gain, rated);
        let slope = |moved: &[f64], gain: f64, step: f64| -> Vec<f64> {
            let there = term.effect.shown(moved, gain, rated);
            // A step of a time may take it to where it is not shown.
            let moves = |b: &Quantity| {
                let a = there.iter().find(|a| a.name == b.name);
                a.map_or(0.0, |a| (a.value - b.value) / step)
            };
            quantities.iter().map(moves).collect()
        };
        let mut slopes: Vec<Vec<f64>> = (parameters.iter().enumerate())
            .map(|(i, p)| {
                let step = 1e-6 * (e[i].abs() + 1e-3 * case.unit(p.unit, term.joint));
                let mut moved = e.to_vec();
                moved[i] += step;
                slope(&moved, gain, step)
            })
            .collect();
        let step = 1e-6 * gain;
        let of_gain = slope(e, gain + step, step).into_iter();
        slopes.push(of_gain.map(|s| s * gain_slope).collect());
        Self {
            quantities,
            slopes,
            gain_place,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::constants::Constants;
    use crate::effect::{Class, Forces, Info, Kind, Law, Model, Site, Term, Unit, parameter};
    use crate::fit::{Effort, Point, basis, fit};
    use crate::hypothesis::Hypothesis;
    use crate::scalar::Scalar;

    /// Drag of a joint that a spring holds: without the spring it is drag.
    struct Held;

    static HELD: Info = Info {
        id: "held",
        title: "Drag and a spring",
        equation: "force −c v |v| − k q",
        source: "this test",
        kind: Kind::Force,
        class: Class::Velocity,
        has_joint: true,
        parameters: &[
            parameter("drag", "N*m*s^2", Unit::Drag, 0.0, 20.0),
            parameter("stiffness", "N*m/rad", Unit::Stiffness, -5.0, 5.0),
        ],
        starts: &[&[0.1, 0.0]],
        amplitudes: &[0],
        confusions: &[],
        regime: "all of it",
        equals: &[],
        mujoco: None,
        isaac: None,
        urdf: None,
    };

    impl Model for Held {
        fn info(&self) -> &'static Info {
            &HELD
        }
        fn essential(&self) -> &'static [usize] {
            &[1]
        }
    }

    impl<D: Scalar> Law<D> for Held {
        fn force(
            &self,
            e: &[D],
            at: &Site<'_, D>,
            _memory: &[D],
            f: &mut Forces<'_, D>,
            _constants: &Constants<D>,
        ) {
            f.rate[at.joint] += e[0] * at.speed();
            f.value[at.joint] += -(e[1] * at.q[at.joint]);
        }
    }

    #[test]
    fn an_effect_has_no_size_where_its_essential_parameter_is_zero() {
        let size = |stiffness: f64| {
            let held = Hypothesis::new(vec![Term {
                effect: Arc::new(Held),
                joint: 0,
            }]);
            let case = pendulum(&held, &[0.3, stiffness], 6.0, &|_| {});
            let at = Point {
                theta: vec![0.0; SIZE],
                e: vec![0.2, 0.1],
            };
            let found = fit(&case, &basis(&case), &held, at, Effort::full(14));
            assert!((found.point.e[0] - 0.3).abs() < 0.06, "{:?}", found.point.e);
            sizes(&case, &Criteria::default(), &found)[0]
        };
        let (drag, both) = (size(0.0), size(1.0));
        assert!(drag < 3.0 && both > 10.0, "{drag} {both}");
    }

    #[test]
    fn a_force_that_cannot_act_across_the_plane_has_a_size_within_it() {
        // On from 1 to 3 s; the pendulum turns about y.
        let windows = [1.0, 3.0, 1e5, 1e5, 1e5, 1e5];
        let force = |x: f64, z: f64| [&[x, 0.0, z][..], &windows].concat();
        let pushed = named(&["external_force"]);
        let case = pendulum(&pushed, &force(0.6, -0.3), 6.0, &|_| {});
        let at = Point {
            theta: vec![0.0; SIZE],
            e: force(0.5, 0.0),
        };
        let found = fit(&case, &basis(&case), &pushed, at, Effort::full(14));
        assert!((found.point.e[0] - 0.6).abs() < 0.06, "{:?}", found.point.e);
        let size = sizes(&case, &Criteria::default(), &found)[0];
        assert!(size > 3.0, "{size}");
    }
}
