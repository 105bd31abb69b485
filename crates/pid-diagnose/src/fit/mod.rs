//! Prediction-error fit within the tolerances, by Gauss-Newton steps on bounded quadratic models.
//!
//! ```text
//! minimise  ½ Σ ε_i(θ, e)²  +  ½ Σ (θ_k / 0.55)²     with |θ_k| ≤ 1,  lower ≤ e ≤ upper
//! ```
//!
//! ε are whitened innovations on the train records, θ deviations in units of their tolerances
//! (0.55: the standard deviation of a value anywhere within 95 % of its tolerance). The Jacobian is
//! exact, a few directions per pass.

mod free_run;
mod linear;
mod products;
mod quadratic;
mod step;
#[cfg(test)]
mod tests;
mod value;

use nalgebra::{DMatrix, DVector};
use pid_data::Role;

use crate::case::{Case, Record};
use crate::hypothesis::Hypothesis;
use crate::initial::starts_open;
use crate::observer::Gain;
pub use crate::point::Point;
use crate::predict::Runner;
pub(crate) use free_run::{fit_free_runs, fit_nominal_to_free_runs, free_runs};
pub(crate) use linear::basis_as_run;
pub use linear::{Basis, Direction, Linear, basis, basis_beside, linearise};
pub use products::Slopes;
pub(crate) use products::{cross, gram};
pub use quadratic::Quadratic;
use step::Damping;
pub use value::{PRIOR, Value, all_gains, log_dets, value, value_below};
use value::{gains_from, value_of};

/// Ranges of the parameters of a hypothesis, SI.
pub fn ranges(case: &Case, hypothesis: &Hypothesis) -> Vec<(f64, f64)> {
    hypothesis
        .terms
        .iter()
        .flat_map(|t| {
            t.effect
                .info()
                .parameters
                .iter()
                .map(|p| {
                    let unit = case.unit(p.unit, t.joint);
                    (p.lower * unit, p.upper * unit)
                })
                .collect::<Vec<_>>()
        })
        .collect()
}

/// A converged fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The hypothesis.
    pub hypothesis: Hypothesis,
    /// Where it ended.
    pub point: Point,
    /// Gains at its end.
    pub gains: Vec<Vec<Gain>>,
    /// Objective on the train records.
    pub train: Value,
    /// Quadratic model at the end, unless [`Effort::curvature`] says otherwise.
    pub quadratic: Quadratic,
    /// Steps taken.
    pub steps: usize,
    /// Trial points of the steps that are no minimiser of their quadratic model; see [`Quadratic::minimise`].
    pub unsettled: usize,
    /// Whether the point is that of free runs, and not of predictions.
    pub to_free_runs: bool,
}

/// How much a fit may cost.
#[derive(Debug, Clone, Copy)]
pub struct Effort<'a> {
    /// Steps at most.
    pub steps: usize,
    /// Derivatives along the basis from a neighbouring fit, rows as on the train records: the first
    /// steps use them and differentiate in the effects' parameters only (a chord method; P.
    /// Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 2.1). They are renewed when
    /// the model they give no longer predicts the decrease.
    pub slopes: Option<&'a Slopes>,
    /// Whether the end must be an optimum with derivatives of its own, and not only of the neighbour.
    pub exact: bool,
    /// Whether [`Fit::quadratic`] is asked for where the steps end before the optimum; it is empty otherwise.
    pub curvature: bool,
}

impl Effort<'_> {
    /// Derivatives of its own in every step.
    pub fn full(steps: usize) -> Self {
        Effort {
            steps,
            slopes: None,
            exact: true,
            curvature: true,
        }
    }
    /// The same for a point on the way, of which nothing but the point and its value is asked.
    pub fn on_the_way(steps: usize) -> Self {
        Effort {
            curvature: false,
            ..Effort::full(steps)
        }
    }
}

impl Fit {
    /// Innovations on the train records with derivatives at the point of the fit, along a basis and
    /// then in the effects' parameters.
    pub fn linearised(&self, case: &Case, basis: &Basis) -> Linear {
        let columns = basis.directions();
        differentiated(case, &self.hypothesis, &self.point, &self.gains, &columns)
    }

    /// Whether its quadratic model has no more than a fit's end leaves to gain within the ranges.
    fn rests(&self, case: &Case) -> bool {
        if self.quadratic.g.len() != self.point.theta.len() + self.point.e.len() {
            return false;
        }
        let room = step::room(&self.point, &ranges(case, &self.hypothesis));
        let (x, _) = self.quadratic.minimise(&room.0, &room.1);
        -2.0 * self.quadratic.at(&x) < REST.0 + REST.1 * self.train.objective()
    }

    /// The fit from its point on, where it has not come to its optimum and that leaves less.
    pub(crate) fn rested(&self, case: &Case, basis: &Basis, steps: usize) -> Option<Fit> {
        if self.rests(case) {
            return None;
        }
        let effort = Effort::full(steps);
        let further = fit(case, basis, &self.hypothesis, self.point.clone(), effort);
        (further.train.objective() < self.train.objective()).then_some(further)
    }

    /// The fitted model, to be run along a record.
    pub fn runner<'a>(&'a self, case: &'a Case, record: &'a Record) -> Runner<'a, 'a, f64> {
        Runner::new(
            case,
            record,
            &self.hypothesis,
            &self.point.theta,
            &self.point.e,
        )
    }
}

/// Decrease below which a fit has come to rest: absolute, and relative to the objective.
const REST: (f64, f64) = (0.05, 1e-4);
/// Share of the predicted decrease that borrowed derivatives must bring to be kept.
const TRUSTED: f64 = 0.5;

/// What the damping adds to the curvature of a deviation: about that of the prior.
const OF_THETA: f64 = 4.0;

/// Directions along the columns, then of so many parameters of the effects.
fn directions(columns: &[Vec<f64>], effects: usize) -> Vec<Direction<'_>> {
    let basis = columns.iter().map(|c| Direction::Theta(c));
    basis.chain((0..effects).map(Direction::Effect)).collect()
}

/// Innovations with their derivatives along the columns, then in the effects' parameters.
fn differentiated(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    columns: &[Vec<f64>],
) -> Linear {
    let directions = directions(columns, at.e.len());
    linearise(case, hypothesis, at, gains, Role::Train, &directions)
}

/// Fits a hypothesis from a start.
pub fn fit(
    case: &Case,
    basis: &Basis,
    hypothesis: &Hypothesis,
    start: Point,
    effort: Effort<'_>,
) -> Fit {
    let (mut path, quadratic, steps) = descended(case, basis, hypothesis, start, effort);
    path.complete_gains();
    let train = path.value_or(Path::run).clone();
    Fit {
        hypothesis: hypothesis.clone(),
        point: path.at,
        gains: path.gains,
        train,
        quadratic,
        steps,
        unsettled: path.unsettled,
        to_free_runs: false,
    }
}

/// Where a [`fit`] on the way ends, without what is left there.
pub(crate) fn approach(
    case: &Case,
    basis: &Basis,
    hypothesis: &Hypothesis,
    start: Point,
    steps: usize,
) -> Point {
    let effort = Effort::on_the_way(steps);
    descended(case, basis, hypothesis, start, effort).0.at
}

/// The steps of a fit, with the quadratic model of the last and their number.
fn descended<'a>(
    case: &'a Case,
    basis: &Basis,
    hypothesis: &'a Hypothesis,
    start: Point,
    effort: Effort<'_>,
) -> (Path<'a>, Quadratic, usize) {
    let mut path = Path::new(case, basis, hypothesis, start);
    let rank = path.columns.len();
    let mut steps = 0;
    let mut own: Option<Slopes> = None;
    let mut borrowed = effort.slopes.is_some();
    let mut quadratic = Quadratic {
        h: DMatrix::zeros(0, 0),
        g: DVector::zeros(0),
    };
    loop {
        if steps >= effort.steps && !effort.curvature {
            break;
        }
        let old = if borrowed {
            own.as_ref().or(effort.slopes)
        } else {
            None
        };
        let beside = old.and_then(|old| path.beside(old, basis));
        let left;
        (quadratic, left) = match beside {
            Some(found) => found,
            None => {
                let (quadratic, left, slopes) = path.renewed(basis);
                own = Some(slopes);
                (quadratic, left)
            }
        };
        let bound = path.value_or(|path| path.value_of(&left)).objective();
        if steps >= effort.steps {
            break;
        }
        let tried = path.step((&quadratic, bound), if borrowed { 3 } else { 7 });
        steps += 1;
        let rest = REST.0 + REST.1 * (bound - tried.decrease);
        let resting = tried.decrease < rest;
        if borrowed {
            let at_rest = tried.predicted < rest;
            let untrue = !tried.improved || tried.decrease < TRUSTED * tried.predicted;
            if untrue || (resting && !at_rest) {
                // The neighbour's derivatives no longer serve.
                borrowed = false;
                continue;
            }
            if resting {
                if !effort.exact && !path.begins_anew() {
                    break;
                }
                borrowed = false;
                continue;
            }
        } else {
            if !tried.improved || (resting && steps > 1) {
                if path.begins_anew() {
                    continue;
                }
                break;
            }
            // Derivatives of this fit serve its next steps.
            borrowed = rank > 0 && tried.decrease > 0.7 * tried.predicted;
        }
        if starts_open(case) || (!path.at.e.is_empty() && steps < 4) {
            path.renew_gains();
        }
    }
    (path, quadratic, steps)
}

/// A fit on its way.
struct Path<'a> {
    case: &'a Case,
    hypothesis: &'a Hypothesis,
    /// Directions of θ in which it differentiates.
    columns: Vec<Vec<f64>>,
    /// Ranges of the effects' parameters, SI.
    bounds: Vec<(f64, f64)>,
    at: Point,
    gains: Vec<Vec<Gain>>,
    /// What is left there; `None` where gains have changed since it was found.
    now: Option<Value>,
    damping: Damping,
    unsettled: usize,
}

/// What became of a step.
struct Tried {
    improved: bool,
    /// Of the objective, as it is and as the model has it.
    decrease: f64,
    predicted: f64,
}

impl<'a> Path<'a> {
    fn new(case: &'a Case, basis: &Basis, hypothesis: &'a Hypothesis, mut at: Point) -> Self {
        let bounds = ranges(case, hypothesis);
        for (e, (low, high)) in at.e.iter_mut().zip(&bounds) {
            *e = e.clamp(*low, *high);
        }
        let from_rest = vec![Vec::new(); case.records.len()];
        let gains = gains_from(case, hypothesis, &at, &from_rest, |role| {
            role == Role::Train
        });
        Self {
            case,
            hypothesis,
            columns: basis.directions(),
            bounds,
            at,
            gains,
            now: None,
            damping: Damping::new(Some(OF_THETA)),
            unsettled: 0,
        }
    }

    /// What is left at the point, by a way to find it where that is not known.
    fn value_or(&mut self, find: impl FnOnce(&Self) -> Value) -> &Value {
        let now = self.now.take().unwrap_or_else(|| find(self));
        self.now.insert(now)
    }

    /// What is left, by a simulation.
    fn run(&self) -> Value {
        value(
            self.case,
            self.hypothesis,
            &self.at,
            &self.gains,
            Role::Train,
        )
    }

    /// What is left, of the innovations on the train records.
    fn value_of(&self, innovations: &DVector<f64>) -> Value {
        value_of(self.case, &self.at, &self.gains, innovations.as_slice())
    }

    /// The model with borrowed derivatives along the basis and new ones in the effects' parameters, and innovations;
    /// `None` where they do not have the same rows.
    fn beside(&self, old: &Slopes, basis: &Basis) -> Option<(Quadratic, DVector<f64>)> {
        let effects: Vec<Direction<'_>> = (0..self.at.e.len()).map(Direction::Effect).collect();
        let (hypothesis, gains) = (self.hypothesis, &self.gains);
        let own = linearise(
            self.case,
            hypothesis,
            &self.at,
            gains,
            Role::Train,
            &effects,
        );
        (own.r.len() == old.j.nrows())
            .then(|| (Quadratic::beside(basis, old, &own, &self.at), own.r))
    }

    /// The model with derivatives of its own, innovations, and derivatives along the basis.
    fn renewed(&self, basis: &Basis) -> (Quadratic, DVector<f64>, Slopes) {
        let (hypothesis, gains) = (self.hypothesis, &self.gains);
        let lin = differentiated(self.case, hypothesis, &self.at, gains, &self.columns);
        let products = gram(&lin.j);
        let quadratic = Quadratic::of(basis, &products, &lin.j.tr_mul(&lin.r), &self.at);
        let slopes = Slopes::first(lin.j, &products, self.columns.len());
        (quadratic, lin.r, slopes)
    }

    /// Gains of the records that are not fitted, which no step needs.
    fn complete_gains(&mut self) {
        let others = |role| role != Role::Train;
        let all = gains_from(self.case, self.hypothesis, &self.at, &self.gains, others);
        let records = self.case.records.iter().zip(&mut self.gains).zip(all);
        for ((_, own), all) in records.filter(|((record, _), _)| others(record.role)) {
            *own = all;
        }
    }

    fn renew_gains(&mut self) {
        self.gains = self.found_from(&self.gains);
        self.now = None;
    }

    /// Gains with the states that no sensor reads looked for from where they were `before`.
    fn found_from(&self, before: &[Vec<Gain>]) -> Vec<Vec<Gain>> {
        let train = |role| role == Role::Train;
        gains_from(self.case, self.hypothesis, &self.at, before, train)
    }

    /// Takes integrals that are looked for from rest, if they leave less: friction that sticks holds some where others
    /// are better.
    fn begins_anew(&mut self) -> bool {
        if !starts_open(self.case) {
            return false;
        }
        let from_rest = vec![Vec::new(); self.case.records.len()];
        let before = self.value_or(Self::run).objective();
        let gains = self.found_from(&from_rest);
        let now = value(self.case, self.hypothesis, &self.at, &gains, Role::Train);
        let gained = before - now.objective();
        let pays = gained > REST.0 + REST.1 * now.objective();
        if pays {
            (self.gains, self.now) = (gains, Some(now));
        }
        pays
    }

    /// One step to less than a bound, in at most `trials` trials.
    fn step(&mut self, (quadratic, bound): (&Quadratic, f64), trials: usize) -> Tried {
        let stepped = (self.damping).step((&self.at, &self.bounds), quadratic, trials, |next| {
            value_below(bound, self.case, self.hypothesis, next, &self.gains)
        });
        self.unsettled += stepped.unsettled;
        let mut tried = Tried {
            improved: false,
            decrease: 0.0,
            predicted: stepped.predicted,
        };
        if let Some((next, there)) = stepped.to {
            tried.decrease = bound - there.objective();
            tried.improved = true;
            (self.at, self.now) = (next, Some(there));
        }
        tried
    }
}
