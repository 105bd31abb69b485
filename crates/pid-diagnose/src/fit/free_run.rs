//! Fit to free runs: what the gap counts, on the train records.
//!
//! ```text
//! minimise  Σ_w w |e_w(θ, e)|²  +  Σ (θ_k / 0.55)²,    e_w = errors of the free run over window w
//! ```
//!
//! (simulation error in place of prediction error: M. Farina, L. Piroddi, Automatica 47(10), 2011).
//! Errors are relative to their level, each joint and channel with its own, and count as many as are
//! independent. Windows have the weights of Student's distribution: one in which a joint sticks at
//! another moment than its model says nothing of the rest. Free runs are rough in the parameters of
//! friction, so they serve from a point near the optimum. States at the starts of windows are those of
//! the predictor at the point; derivatives hold them.

use std::ops::Range;

use pid_data::Role;
use rayon::prelude::*;

use super::linear::{Basis, Direction, Linear, gathered, lifted};
use super::quadratic::Quadratic;
use super::step::Damping;
use super::value::PRIOR;
use super::{Effort, Fit, Point, directions, fit, ranges};
use crate::case::{Case, Velocity};
use crate::effect::{FEW, LANES, Pick};
use crate::gap::{Windows, deviations, free_run, gap, windows};
use crate::hypothesis::Hypothesis;
use crate::levels::shared;
use crate::predict::Runner;
use crate::scalar::Lanes;
use crate::simulate::State;

/// Turns of weights and steps.
const TURNS: usize = 3;
/// Steps of one turn.
const STEPS: usize = 5;
/// Trials of one step.
const TRIALS: usize = 6;
/// Largest error that counts, in the deviations of the motion.
const LARGEST: f64 = 10.0;
/// Decrease of the objective, relative, below which a turn has come to rest.
const REST: f64 = 1e-3;

/// Degrees of freedom of the distribution of errors: Student's with four has tails that are long enough
/// for most data (K. L. Lange, R. J. A. Little, J. M. G. Taylor, JASA 84, 1989).
const FREEDOM: f64 = 4.0;
/// Rounds of [`scale`]; it converges by a factor of about 0.2 each.
const ROUNDS: usize = 24;

/// Errors of a window, one after the other: sample by sample, joint by joint, position and velocity, in
/// deviations of the motion; NaN where nothing was read.
type Window<D> = Vec<D>;

/// The windows of the train records at a point.
struct Starts(Vec<Cut>);

/// A record in its windows.
struct Cut {
    record: usize,
    windows: Windows,
    /// Deviations of the readings of every joint.
    size: Vec<(f64, f64)>,
}

/// One window.
struct Place<'a> {
    record: usize,
    /// First sample.
    k: usize,
    length: usize,
    start: &'a State<f64>,
    /// Deviations of the readings of every joint.
    size: &'a [(f64, f64)],
}

impl Starts {
    fn new(case: &Case, hypothesis: &Hypothesis, at: &Point) -> Self {
        let train = case.records.par_iter().enumerate();
        let train = train.filter(|(_, r)| r.role == Role::Train);
        let own = train.map(|(record, r)| Cut {
            record,
            windows: windows(case, r, hypothesis, &at.theta, &at.e),
            size: deviations(r, case.n()),
        });
        Starts(own.collect())
    }

    fn each(&self) -> Vec<Place<'_>> {
        let each = self.0.iter().flat_map(|cut| {
            let (length, starts) = (cut.windows.length, &cut.windows.starts);
            starts.iter().enumerate().map(move |(i, start)| Place {
                record: cut.record,
                k: i * length,
                length,
                start,
                size: &cut.size,
            })
        });
        each.collect()
    }
}

/// Errors of one window under constants that may carry derivatives.
fn errors_of<D: Pick>(
    case: &Case,
    hypothesis: &Hypothesis,
    (theta, e): (&[D], &[D]),
    place: &Place<'_>,
) -> Window<D> {
    let n = case.n();
    let (record, k) = (&case.records[place.record], place.k);
    let mut runner = Runner::<D>::new(case, record, hypothesis, theta, e);
    let start = place.start.lift();
    let length = place.length;
    let run = free_run(case, &mut runner, record, &start, k, length, &mut |_| {
        (0.0, 0.0)
    });
    let mut out = Vec::with_capacity(2 * run.len());
    for (i, (q, v)) in run.into_iter().enumerate() {
        let (j, at) = (i % n, k + 1 + i / n);
        out.push(error(q, record.q[j][at], place.size[j].0));
        out.push(match case.velocity[j] {
            Velocity::Absent => D::constant(f64::NAN),
            _ => error(v, record.v[j][at], place.size[j].1),
        });
    }
    out
}

/// An error where something was read, NaN elsewhere; a run that diverged is as far off as counts.
fn error<D: Pick>(x: D, reading: f64, size: f64) -> D {
    match (reading.is_finite(), x.value().is_nan()) {
        (false, _) => D::constant(f64::NAN),
        (true, true) => D::constant(LARGEST),
        (true, false) => (x - reading) / size,
    }
}

/// Errors of all windows.
fn errors(case: &Case, hypothesis: &Hypothesis, at: &Point, starts: &Starts) -> Vec<Window<f64>> {
    let each = starts.each();
    let own = each.par_iter();
    own.map(|w| errors_of::<f64>(case, hypothesis, (&at.theta, &at.e), w))
        .collect()
}

/// Square of the scale of Student's distribution under which mean squares, each of so many independent
/// samples, are most likely: few large ones do not decide it.
fn scale(squares: &[(f64, f64)]) -> f64 {
    let number: f64 = squares.iter().map(|(_, n)| n).sum();
    let mut scale = squares.iter().map(|(x, n)| n * x).sum::<f64>() / number.max(1e-300);
    for _ in 0..ROUNDS {
        let weighted = squares.iter().map(|(x, n)| {
            let weight = (FREEDOM + n) / (FREEDOM + n * x / scale.max(1e-300));
            weight * n * x
        });
        scale = weighted.sum::<f64>() / number.max(1e-300);
    }
    scale.max(1e-300)
}

/// What an error of each window, joint and channel is multiplied by.
struct Weights(Vec<Vec<f64>>);

impl Weights {
    fn new(case: &Case, errors: &[Window<f64>]) -> Self {
        let channels = 2 * case.n();
        let mut out = vec![vec![0.0; channels]; errors.len()];
        for c in 0..channels {
            let of = |w: &Window<f64>| -> Vec<f64> {
                let own = w.iter().skip(c).step_by(channels).copied();
                own.filter(|x| !x.is_nan()).map(cut).collect()
            };
            let all: Vec<Vec<f64>> = errors.iter().map(of).collect();
            let square = |x: &Vec<f64>| x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
            let read = all.iter().filter(|x| !x.is_empty());
            let squares = read.map(|x| (square(x).max(1e-12), x.len() as f64 / shared(x)));
            let level = scale(&squares.collect::<Vec<_>>());
            for (x, out) in all.iter().zip(&mut out).filter(|(x, _)| !x.is_empty()) {
                let shared = shared(x);
                let n = x.len() as f64 / shared;
                let over = (FREEDOM + n * square(x) / level) / (FREEDOM + n);
                out[c] = (level * shared * over).sqrt().recip();
            }
        }
        Weights(out)
    }

    fn of(&self, window: usize, i: usize) -> f64 {
        let own = &self.0[window];
        own[i % own.len()]
    }
}

fn cut(x: f64) -> f64 {
    x.clamp(-LARGEST, LARGEST)
}

/// The objective.
fn objective(weights: &Weights, errors: &[Window<f64>], at: &Point) -> f64 {
    let prior: f64 = at.theta.iter().map(|t| (t / PRIOR).powi(2)).sum();
    let square = |(w, x): (usize, &Window<f64>)| -> f64 {
        let own = x.iter().enumerate().filter(|(_, x)| !x.is_nan());
        own.map(|(i, x)| (weights.of(w, i) * cut(*x)).powi(2)).sum()
    };
    prior + errors.iter().enumerate().map(square).sum::<f64>()
}

/// Weighted errors and their derivatives.
fn linearise(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    (starts, weights): (&Starts, &Weights),
    directions: &[Direction<'_>],
) -> Linear {
    let each = starts.each();
    gathered(each.len(), directions, |w, own| {
        let over = if own.len() > FEW {
            one_pass::<LANES>
        } else {
            one_pass::<FEW>
        };
        over(case, hypothesis, at, (&each[w], w, weights), own)
    })
}

/// Weighted errors of one window, each followed by its derivatives.
fn one_pass<const N: usize>(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    (place, w, weights): (&Place<'_>, usize, &Weights),
    directions: &[Direction<'_>],
) -> Vec<f64>
where
    Lanes<N>: Pick,
{
    let (theta, e) = lifted::<N>(at, directions.iter().copied());
    let errors = errors_of(case, hypothesis, (&theta, &e), place);
    let mut rows = Vec::with_capacity(errors.len() * (1 + directions.len()));
    for (i, x) in errors.iter().enumerate().filter(|(_, x)| !x.re.is_nan()) {
        let weight = weights.of(w, i);
        rows.push(weight * cut(x.re));
        let counts = x.re.abs() < LARGEST && x.eps.iter().all(|e| e.abs() < 1e9);
        let slopes = x.eps[..directions.len()].iter();
        rows.extend(slopes.map(|e| if counts { weight * e } else { 0.0 }));
    }
    rows
}

/// The fit from where it is, if free runs on the train records leave less there.
pub(crate) fn fit_free_runs(case: &Case, basis: &Basis, from: &Fit) -> Option<Fit> {
    within(case, basis, from, &ranges(case, &from.hypothesis))
}

/// The same of the nominal parameters, with the effects as they are.
pub(crate) fn fit_nominal_to_free_runs(case: &Case, basis: &Basis, from: &Fit) -> Option<Fit> {
    let held: Vec<_> = from.point.e.iter().map(|&e| (e, e)).collect();
    within(case, basis, from, &held)
}

/// [`fit_free_runs`] with the parameters of the effects within these bounds.
fn within(case: &Case, basis: &Basis, from: &Fit, bounds: &[(f64, f64)]) -> Option<Fit> {
    let hypothesis = &from.hypothesis;
    let columns = basis.directions();
    let directions = directions(&columns, from.point.e.len());
    if directions.is_empty() {
        return None;
    }
    let left = |at: &Point| gap(case, hypothesis, &at.theta, &at.e, Role::Train).total;
    let (before, mut at) = (left(&from.point), from.point.clone());
    let mut best: Option<(f64, Point)> = None;
    for _ in 0..TURNS {
        let start = at.clone();
        let mut starts = Starts::new(case, hypothesis, &at);
        let mut now = errors(case, hypothesis, &at, &starts);
        let weights = Weights::new(case, &now);
        let mut damping = Damping::new(None);
        for _ in 0..STEPS {
            let lin = linearise(case, hypothesis, &at, (&starts, &weights), &directions);
            let quadratic = Quadratic::new(basis, &lin, &at);
            let bound = objective(&weights, &now, &at);
            let stepped = damping.step((&at, bounds), &quadratic, TRIALS, |next| {
                let starts = Starts::new(case, hypothesis, next);
                let there = errors(case, hypothesis, next, &starts);
                (objective(&weights, &there, next) < bound).then_some((starts, there))
            });
            let Some((next, (their, there))) = stepped.to else {
                break;
            };
            let resting = bound - objective(&weights, &there, &next) < REST * bound;
            (at, starts, now) = (next, their, there);
            if resting {
                break;
            }
        }
        if at == start {
            break;
        }
        let own = left(&at);
        if own < best.as_ref().map_or(before, |b| b.0) {
            best = Some((own, at.clone()));
        }
    }
    let (_, point) = best?;
    Some(Fit {
        to_free_runs: true,
        ..fit(case, basis, hypothesis, point, Effort::full(0))
    })
}

/// Weighted errors of free runs at the point of a fit, their derivatives along a basis and then in the effects'
/// parameters, and the rows of each window.
pub(crate) fn free_runs(case: &Case, basis: &Basis, at: &Fit) -> (Linear, Vec<Range<usize>>) {
    let (hypothesis, point) = (&at.hypothesis, &at.point);
    let starts = Starts::new(case, hypothesis, point);
    let errors = errors(case, hypothesis, point, &starts);
    let weights = Weights::new(case, &errors);
    let columns = basis.directions();
    let directions = directions(&columns, point.e.len());
    let lin = linearise(case, hypothesis, point, (&starts, &weights), &directions);
    let mut from = 0;
    let windows = errors.iter().map(|w| {
        let start = from;
        from += w.iter().filter(|x| !x.is_nan()).count();
        start..from
    });
    let windows = windows.collect();
    (lin, windows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};
    use crate::fit::basis;

    fn at(e: &[f64]) -> Point {
        Point {
            theta: vec![0.0; SIZE],
            e: e.to_vec(),
        }
    }

    #[test]
    fn one_large_square_does_not_decide_the_scale() {
        assert!((scale(&[(4.0, 3.0); 20]) - 4.0).abs() < 1e-12);
        let mut squares = [(4.0, 3.0); 20];
        squares[7].0 = 1e6;
        let own = scale(&squares);
        assert!((3.9..6.0).contains(&own), "{own}");
    }

    #[test]
    fn a_run_that_diverged_is_far_off_and_a_missing_reading_is_not() {
        assert_eq!(error(f64::NAN, 0.3, 0.1), LARGEST);
        assert!(error(0.5, f64::NAN, 0.1).is_nan());
        assert!((error(0.5, 0.3, 0.1) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn derivatives_are_those_of_the_errors() {
        let hypothesis = named(&["spring"]);
        let case = pendulum(&hypothesis, &[0.9, 0.2], 6.0, &|_| {});
        let here = at(&[0.7, 0.1]);
        let starts = Starts::new(&case, &hypothesis, &here);
        let weights = Weights::new(&case, &errors(&case, &hypothesis, &here, &starts));
        let mut one = vec![0.0; SIZE];
        one[0] = 1.0;
        let directions = [Direction::Theta(&one), Direction::Effect(0)];
        let lin = linearise(&case, &hypothesis, &here, (&starts, &weights), &directions);
        let moved = |theta: f64, e: f64| {
            let mut there = here.clone();
            there.theta[0] += theta;
            there.e[0] += e;
            linearise(&case, &hypothesis, &there, (&starts, &weights), &[]).r
        };
        let h = 1e-5;
        for (column, (theta, e)) in [(h, 0.0), (0.0, h)].into_iter().enumerate() {
            let slope = (moved(theta, e) - moved(-theta, -e)) / (2.0 * h);
            let error = (&slope - lin.j.column(column)).amax();
            assert!(error < 1e-4 * slope.amax(), "{column}: {error}");
            assert!(slope.amax() > 0.0);
        }
    }

    #[test]
    fn a_fit_that_stopped_early_ends_at_the_truth_beside_a_window_that_nothing_explains() {
        let hypothesis = named(&["spring"]);
        let truth = [0.9, 0.2];
        let mut case = pendulum(&hypothesis, &truth, 8.0, &|_| {});
        // Someone holds the pendulum for a fifth of a second.
        let record = &mut case.records[0];
        let (from, to) = (
            record.len() / 2,
            record.len() / 2 + (0.2 / record.h) as usize,
        );
        for k in from..to {
            record.q[0][k] = record.q[0][from];
            record.v[0][k] = 0.0;
        }
        let own = basis(&case);
        let early = fit(&case, &own, &hypothesis, at(&[0.6, 0.0]), Effort::full(0));
        let end = fit_free_runs(&case, &own, &early).expect("a better fit");
        for (x, y) in end.point.e.iter().zip(&truth) {
            assert!((x - y).abs() < 0.02, "{:?}", end.point.e);
        }
        let left = |f: &Fit| gap(&case, &hypothesis, &f.point.theta, &f.point.e, Role::Train);
        assert!(left(&end).total < left(&early).total);

        // With the spring as it is, the nominal parameters make up for a part.
        let held = fit_nominal_to_free_runs(&case, &own, &early).expect("a better fit");
        assert_eq!(held.point.e, early.point.e);
        assert_ne!(held.point.theta, early.point.theta);
        let (least, most) = (left(&end).total, left(&early).total);
        assert!((least..most).contains(&left(&held).total));
    }
}
