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
//! Newton's steps with differences, halved until they pay.

use nalgebra::{DMatrix, DVector};

use crate::case::{Case, Record};
use crate::constants::Constant;
use crate::hypothesis::Hypothesis;
use crate::observer::Gain;
use crate::point::Point;
use crate::predict::Runner;

/// Length of record that is looked at, s.
const LENGTH: f64 = 1.0;
/// Steps at most.
const STEPS: usize = 4;
/// Twist, in that under the typical torque.
const TWIST: f64 = 0.1;
/// Step of a difference, in sizes.
const DIFFERENCE: f64 = 0.02;

/// One of these states: its joint and its place in [`Gain::hidden`], its size.
type Hidden = (usize, usize, f64);

/// [`settle`] for a record under a hypothesis at a point, as the hypothesis is run.
pub(crate) fn estimate(
    case: &Case,
    record: &Record,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &mut [Gain],
) {
    let mut runner = Runner::<f64>::new(case, record, hypothesis, &at.theta, &at.e);
    settle_these(&mut runner, gains, case.run(hypothesis).initial_states);
}

/// Sets [`Gain::hidden`] to what the first moment of a record tells.
pub(crate) fn settle(runner: &mut Runner<'_, '_, f64>, gains: &mut [Gain]) {
    settle_these(runner, gains, true);
}

/// The same of the integrals of position loops alone where not of the `whole`.
fn settle_these(runner: &mut Runner<'_, '_, f64>, gains: &mut [Gain], whole: bool) {
    let unread = unread(runner, whole);
    if unread.is_empty() {
        return;
    }
    let end = ((LENGTH / runner.record.h) as usize).clamp(1, runner.record.len());
    let put = |x: &DVector<f64>, gains: &mut [Gain]| {
        for (&(joint, place, size), x) in unread.iter().zip(x.iter()) {
            gains[joint].hidden[place] = size * x;
        }
    };
    let mut own = gains.to_vec();
    let mut innovations = |x: &DVector<f64>| {
        let mut out = Vec::new();
        put(x, &mut own);
        runner.predict_over(
            0..end,
            &own,
            &mut |_, _, _, e| {
                out.push(if e.is_finite() {
                    e.clamp(-1e4, 1e4)
                } else {
                    1e4
                })
            },
            &mut |_, _| {},
        );
        DVector::from_vec(out)
    };
    let m = unread.len();
    let mut x = DVector::zeros(m);
    let mut r = innovations(&x);
    let mut cost = r.norm_squared();
    for _ in 0..STEPS {
        let mut j = DMatrix::zeros(r.len(), m);
        for i in 0..m {
            let mut moved = x.clone();
            moved[i] += DIFFERENCE;
            let column = (innovations(&moved) - &r) / DIFFERENCE;
            j.set_column(i, &column);
        }
        let h = j.tr_mul(&j) + DMatrix::identity(m, m);
        let g = j.tr_mul(&r) + &x;
        let Some(factor) = h.cholesky() else { break };
        let step = -factor.solve(&g);
        let mut pays = None;
        for halving in 0..4 {
            let trial = &x + &step * 0.5_f64.powi(halving);
            let left = innovations(&trial);
            let value = left.norm_squared() + trial.norm_squared();
            if value < cost {
                pays = Some((trial, left, value));
                break;
            }
        }
        let Some((trial, left, value)) = pays else {
            break;
        };
        let gained = cost - value;
        (x, r, cost) = (trial, left, value);
        if gained < 0.1 {
            break;
        }
    }
    put(&x, gains);
}

/// The states that are not read: integrals of position loops, which friction leaves open at rest, and
/// those of effects where they are asked for.
fn unread(runner: &Runner<'_, '_, f64>, whole: bool) -> Vec<Hidden> {
    let mut out = Vec::new();
    for j in runner.machine.integrating() {
        let of = |which| runner.machine.constants.get(which);
        let level = of(Constant::Coulomb(j)) + TWIST * runner.case.scale[j].torque;
        let unit = runner.machine.holds(j);
        out.push((j, 3, (level / (of(Constant::Gain(j)) * unit)).abs()));
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
        let mut g = gains(&case, &elastic, &theta, &e, record.h);
        let mut runner = Runner::<f64>::new(&case, record, &elastic, &theta, &e);
        assert_eq!(runner.start(0).v[0], 0.0, "at rest as far as readings tell");
        settle(&mut runner, &mut g);
        assert!((g[0].hidden[1] - 0.8).abs() < 0.08, "{:?}", g[0].hidden);
    }
}
