//! Initial-state estimation: states that no sensor reads, at the start of a record.
//!
//! A link behind a spring may still swing when a record starts, a bristle may be bent: neither
//! position nor velocity of the drive tells at once. What the first moment of the record tells of
//! them is taken from the innovations ε of the predictor,
//!
//! ```text
//! minimise over x    Σ_{t < T} ε(x)²  +  Σ_i (x_i / s_i)²
//! ```
//!
//! with x the deviations of these states from rest and s their sizes: the twist of the gear under a
//! tenth of the typical torque, its rate at the resonance, a bristle bent to its end. Gauss and
//! Newton's steps with exact derivatives, halved until they pay.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};

use crate::case::{Case, Record};
use crate::constants::Constant;
use crate::effect::{FEW, LANES, Pick};
use crate::hypothesis::Hypothesis;
use crate::observer::Gain;
use crate::predict::Runner;
use crate::scalar::Lanes;

/// Length of record that is looked at, s.
const LENGTH: f64 = 1.0;
/// Steps at most.
const STEPS: usize = 4;
/// Halvings of a step at most.
const HALVINGS: i32 = 3;
/// Decrease of the objective that is no longer worth a step: a tenth of what one innovation adds to it on average.
const REST: f64 = 0.1;
/// Twist, in that under the typical torque.
const TWIST: f64 = 0.1;
/// An innovation larger than this many deviations counts as this.
const LARGEST: f64 = 1e4;

/// Place of the integral of a position loop in [`Gain::hidden`].
const INTEGRAL: usize = 3;

/// One of these states: its joint and its place in [`Gain::hidden`], its size.
type Hidden = (usize, usize, f64);

/// The first moment of a record under a hypothesis at a point.
struct Moment<'a> {
    case: &'a Case,
    record: &'a Record,
    hypothesis: &'a Hypothesis,
    theta: &'a [f64],
    e: &'a [f64],
    /// Samples.
    end: usize,
    /// States that are looked for.
    unread: Vec<Hidden>,
}

/// Sets [`Gain::hidden`] to what the first moment of a record tells, from where they are: of the integrals of position
/// loops alone where not of the `whole`.
pub(crate) fn settle(
    (case, record): (&Case, &Record),
    hypothesis: &Hypothesis,
    (theta, e): (&[f64], &[f64]),
    gains: &mut [Gain],
    whole: bool,
) {
    let unread = unread(
        &Runner::<f64>::new(case, record, hypothesis, theta, e),
        whole,
    );
    if unread.is_empty() {
        return;
    }
    let moment = Moment {
        case,
        record,
        hypothesis,
        theta,
        e,
        end: ((LENGTH / record.h) as usize).clamp(1, record.len()),
        unread,
    };
    moment.minimise(gains);
}

impl Moment<'_> {
    /// Steps of Gauss and Newton from where the states are.
    fn minimise(&self, gains: &mut [Gain]) {
        // A state of no size stays at rest.
        let own = |&(joint, place, size): &Hidden| match size > 0.0 {
            true => gains[joint].hidden[place] / size,
            false => 0.0,
        };
        let mut x = DVector::from_iterator(self.unread.len(), self.unread.iter().map(own));
        for _ in 0..STEPS {
            let (r, j) = self.linearised(gains, &x);
            let cost = r.norm_squared() + x.norm_squared();
            let h = j.tr_mul(&j) + DMatrix::identity(x.len(), x.len());
            let g = j.tr_mul(&r) + &x;
            let Some(factor) = h.cholesky() else { break };
            let step = -factor.solve(&g);
            if -g.dot(&step) < REST {
                break;
            }
            let better = (0..=HALVINGS).find_map(|halving| {
                let trial = &x + &step * 0.5_f64.powi(halving);
                let left = self.innovations::<f64>(gains, &self.at(gains, &trial));
                let value = left.iter().map(|e| e * e).sum::<f64>() + trial.norm_squared();
                (value < cost).then_some((trial, cost - value))
            });
            let Some((trial, gained)) = better else { break };
            x = trial;
            if gained < REST {
                break;
            }
        }
        for (&(joint, place, size), x) in self.unread.iter().zip(x.iter()) {
            gains[joint].hidden[place] = size * x;
        }
    }

    /// All these states, joint by joint, with those that are looked for at `x` sizes.
    fn at<D: Pick>(&self, gains: &[Gain], x: &DVector<f64>) -> Vec<[D; 4]> {
        let all = gains.iter().map(|g| g.hidden.map(D::constant));
        let mut out: Vec<[D; 4]> = all.collect();
        for (&(joint, place, size), x) in self.unread.iter().zip(x.iter()) {
            out[joint][place] = D::constant(size * x);
        }
        out
    }

    /// Innovations of the moment.
    fn innovations<D: Pick>(&self, gains: &[Gain], hidden: &[[D; 4]]) -> Vec<D> {
        let lift = |x: &[f64]| x.iter().map(|&x| D::constant(x)).collect::<Vec<D>>();
        let (theta, e) = (lift(self.theta), lift(self.e));
        let mut runner = Runner::<D>::new(self.case, self.record, self.hypothesis, &theta, &e);
        let mut out = Vec::new();
        let mut sink = |_, _, _, e: D| {
            out.push(match e.value().is_finite() {
                true => e.limit(D::constant(-LARGEST), D::constant(LARGEST)),
                false => D::constant(LARGEST),
            });
        };
        let mut on = |_, _: &_| ControlFlow::Continue(());
        runner.predict_from(hidden, 0..self.end, gains, &mut sink, &mut on);
        out
    }

    /// Innovations and their derivatives in the states that are looked for, in sizes.
    fn linearised(&self, gains: &[Gain], x: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
        match x.len() > FEW {
            true => self.by_passes::<LANES>(gains, x),
            false => self.by_passes::<FEW>(gains, x),
        }
    }

    /// The same, `N` derivatives in a pass.
    fn by_passes<const N: usize>(
        &self,
        gains: &[Gain],
        x: &DVector<f64>,
    ) -> (DVector<f64>, DMatrix<f64>)
    where
        Lanes<N>: Pick,
    {
        let mut r = DVector::zeros(0);
        let mut j = DMatrix::zeros(0, x.len());
        for (pass, own) in self.unread.chunks(N).enumerate() {
            let mut hidden = self.at::<Lanes<N>>(gains, x);
            for (lane, &(joint, place, size)) in own.iter().enumerate() {
                hidden[joint][place].eps[lane] = size;
            }
            let innovations = self.innovations(gains, &hidden);
            r = DVector::from_iterator(innovations.len(), innovations.iter().map(|e| e.re));
            if pass == 0 {
                j = DMatrix::zeros(r.len(), x.len());
            }
            for (row, e) in innovations.iter().enumerate() {
                for lane in 0..own.len() {
                    let slope = e.eps[lane];
                    j[(row, pass * N + lane)] = if slope.is_finite() { slope } else { 0.0 };
                }
            }
        }
        (r, j)
    }
}

/// Whether records start with integrals of position loops, which are looked for along the way of a fit.
pub(crate) fn starts_open(case: &Case) -> bool {
    let mut laws = (0..case.n()).filter_map(|j| case.nominal.description.servo(j));
    laws.any(|servo| servo.law.integrates())
}

/// The states that are not read: integrals of position loops, and those of effects where they are asked for.
fn unread(runner: &Runner<'_, '_, f64>, whole: bool) -> Vec<Hidden> {
    let mut out = Vec::new();
    for j in runner.machine.integrating() {
        let of = |which| runner.machine.constants.get(which);
        let level = of(Constant::Coulomb(j)) + TWIST * runner.case.scale[j].torque;
        let unit = runner.machine.holds(j);
        let size = (level / (of(Constant::Gain(j)) * unit)).abs();
        out.push((j, INTEGRAL, size));
    }
    if !whole {
        return out;
    }
    for (j, gear) in runner.machine.gears.iter().enumerate() {
        let Some(gear) = gear else { continue };
        let scale = &runner.case.scale[j];
        let twist = TWIST * scale.torque / gear.stiffness.max(1e-300) + 0.5 * gear.gap;
        let resonance = (gear.stiffness / scale.inertia).sqrt();
        out.push((j, 0, twist));
        out.push((j, 1, twist * resonance));
    }
    for (_, joint, size) in runner.machine.unknown_cells() {
        out.push((joint, 2, size));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, pendulum};
    use crate::effect::Term;
    use crate::predict::gains;

    #[test]
    fn a_link_that_swings_at_the_start_is_seen_through_its_drive() {
        let elastic = Hypothesis::new(vec![Term {
            effect: crate::effects::all()
                .into_iter()
                .find(|e| e.info().id == "joint_elasticity")
                .expect("elasticity"),
            joint: 0,
        }]);
        // Compliance of 1/60 rad per N m, nearly undamped.
        let e = [1.0 / 60.0, 1e-4];
        let case = pendulum(&elastic, &e, 2.0, &|state| state.v[0] = 0.8);
        let theta = vec![0.0; SIZE];
        let record = &case.records[0];
        let mut g = gains((&case, record), &elastic, &theta, &e);
        let mut runner = Runner::<f64>::new(&case, record, &elastic, &theta, &e);
        assert_eq!(runner.start(0).v[0], 0.0, "at rest as far as readings tell");
        settle((&case, record), &elastic, (&theta, &e), &mut g, true);
        assert!((g[0].hidden[1] - 0.8).abs() < 0.08, "{:?}", g[0].hidden);
    }
}
