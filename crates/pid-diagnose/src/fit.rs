//! Prediction-error fit within the tolerances, by Gauss-Newton steps on bounded quadratic models.
//!
//! ```text
//! minimise  ½ Σ ε_i(θ, e)²  +  ½ Σ (θ_k / 0.55)²     with |θ_k| ≤ 1,  lower ≤ e ≤ upper
//! ```
//!
//! ε are whitened innovations on the train records, θ deviations in units of their tolerances
//! (0.55: the standard deviation of a value anywhere within 95 % of its tolerance). The Jacobian is
//! exact, a few directions per pass.

use std::cell::Cell;
use std::ops::ControlFlow;
use std::sync::Mutex;

use nalgebra::{DMatrix, DVector};
use pid_data::Role;
use rayon::prelude::*;

use crate::case::{Case, Record, Velocity};
use crate::effect::{FEW, LANES, Pick};
use crate::initial;
use crate::observer::Gain;
pub use crate::point::Point;
use crate::predict::{Runner, gains, rows};
use crate::scalar::{Lanes, Scalar};
use crate::simulate::{Hypothesis, Run};

/// Standard deviation of a deviation, in tolerances.
pub const PRIOR: f64 = 0.55;
/// A parallel run checks every so many samples whether the shared sum already exceeds the bound.
const ASIDE: usize = 64;
/// An innovation larger than this many deviations counts as this: a diverging candidate must not
/// give infinities.
const LARGEST: f64 = 1e4;

/// Value of the objective, in its parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    /// Sum of squared innovations per joint and channel.
    pub chi: Vec<[f64; 2]>,
    /// Number of innovations per joint and channel.
    pub count: Vec<[f64; 2]>,
    /// Sum of (θ/σ)².
    pub prior: f64,
    /// Sum of ln det S over the innovations' predicted covariances S, per joint: gains of their own
    /// make hypotheses comparable only together with it.
    pub log_det: Vec<f64>,
}

impl Value {
    /// Sum of squared innovations.
    pub fn total(&self) -> f64 {
        self.chi.iter().map(|c| c[0] + c[1]).sum()
    }
    /// Number of innovations.
    pub fn number(&self) -> f64 {
        self.count.iter().map(|c| c[0] + c[1]).sum()
    }
    /// Sum of ln det S over all joints.
    pub fn spread(&self) -> f64 {
        self.log_det.iter().sum()
    }
    /// Sum of squares and prior.
    pub fn objective(&self) -> f64 {
        self.total() + self.prior
    }
    /// Minus twice the log-likelihood, up to a constant of the records: sum of squares and ln det S.
    pub fn surprise(&self) -> f64 {
        self.total() + self.spread()
    }
    /// Minus twice the logarithm of the posterior density, up to a constant of the records.
    pub fn evidence(&self) -> f64 {
        self.objective() + self.spread()
    }
}

/// Innovations and, on request, derivatives in directions.
#[derive(Debug, Clone)]
pub struct Linear {
    /// Innovations.
    pub r: DVector<f64>,
    /// Derivatives, one column per direction.
    pub j: DMatrix<f64>,
}

/// Directions of θ that the records determine, as columns.
#[derive(Debug, Clone)]
pub struct Basis {
    /// Deviations × r, orthonormal.
    pub columns: DMatrix<f64>,
}

impl Basis {
    /// The directions, one by one.
    pub fn directions(&self) -> Vec<Vec<f64>> {
        self.columns
            .column_iter()
            .map(|c| c.iter().copied().collect())
            .collect()
    }
}

/// A direction in which to differentiate.
#[derive(Debug, Clone, Copy)]
pub enum Direction<'a> {
    /// Of the deviations.
    Theta(&'a [f64]),
    /// A parameter of the effects.
    Effect(usize),
}

/// Gains for every record.
pub fn all_gains(case: &Case, hypothesis: &Hypothesis, at: &Point) -> Vec<Vec<Gain>> {
    case.records
        .par_iter()
        .map(|r| {
            let mut g = gains(case, hypothesis, &at.theta, &at.e, r.h);
            if case.run(hypothesis).initial_states {
                initial::estimate(case, r, hypothesis, at, &mut g);
            }
            g
        })
        .collect()
}

fn tame(x: f64) -> f64 {
    if x.is_finite() {
        x.clamp(-LARGEST, LARGEST)
    } else {
        LARGEST
    }
}

/// Sums of squares on the records of a role; gains are designed at the point itself.
pub fn value(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    role: Role,
) -> Value {
    run(case, hypothesis, at, gains, role, f64::INFINITY)
}

/// [`value`] on the train records if its [`Value::objective`] is below a bound, else `None`: most
/// points above it are known to be after a part of the records.
pub fn value_below(
    bound: f64,
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
) -> Option<Value> {
    let there = run(case, hypothesis, at, gains, Role::Train, bound);
    (there.objective() < bound).then_some(there)
}

/// Sum of (θ/σ)².
fn prior(at: &Point) -> f64 {
    at.theta.iter().map(|t| (t / PRIOR).powi(2)).sum()
}

/// Sums of ln det S on the records of a role, per joint.
pub fn log_dets(case: &Case, gains: &[Vec<Gain>], role: Role) -> Vec<f64> {
    let mut out = vec![0.0; case.n()];
    for (record, g) in case.records.iter().zip(gains) {
        if record.role == role {
            let rows = rows(record) as f64;
            for (j, g) in g.iter().enumerate() {
                out[j] -= 2.0 * rows * g.whiten[0][0].ln();
                if case.velocity[j] == Velocity::Measured {
                    out[j] -= 2.0 * rows * g.whiten[1][1].ln();
                }
            }
        }
    }
    out
}

/// The sums; broken off as soon as they exceed a bound on the objective by more than they round.
fn run(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    role: Role,
    bound: f64,
) -> Value {
    let n = case.n();
    let prior = prior(at);
    let most = bound * (1.0 + 1e-9) - prior;
    // What the records at their end have summed up to.
    let summed = Mutex::new(0.0_f64);
    let summed_up = || summed.lock().map_or(0.0, |s| *s);
    type Channels = (Vec<[f64; 2]>, Vec<[f64; 2]>);
    let parts: Vec<Channels> = case
        .records
        .par_iter()
        .zip(gains)
        .filter(|(r, _)| r.role == role)
        .map(|(record, g)| {
            let mut chi = vec![[0.0; 2]; n];
            let mut count = vec![[0.0; 2]; n];
            let own = Cell::new(0.0);
            let mut others = summed_up();
            let mut runner = Runner::<f64>::new(case, record, hypothesis, &at.theta, &at.e);
            runner.predict_while(
                runner.counted(),
                g,
                &mut |_, j, c, x| {
                    let x = tame(x);
                    chi[j][c] += x * x;
                    count[j][c] += 1.0;
                    own.set(own.get() + x * x);
                },
                &mut |k, _| {
                    if k % ASIDE == 0 {
                        others = summed_up();
                    }
                    if others + own.get() > most {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                },
            );
            if let Ok(mut s) = summed.lock() {
                *s += own.get();
            }
            (chi, count)
        })
        .collect();
    let mut total = Value {
        chi: vec![[0.0; 2]; n],
        count: vec![[0.0; 2]; n],
        prior,
        log_det: log_dets(case, gains, role),
    };
    for (chi, count) in parts {
        for j in 0..n {
            for c in 0..2 {
                total.chi[j][c] += chi[j][c];
                total.count[j][c] += count[j][c];
            }
        }
    }
    total
}

/// Innovations and derivatives on the records of a role.
pub fn linearise(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    role: Role,
    directions: &[Direction<'_>],
) -> Linear {
    let records: Vec<usize> = (0..case.records.len())
        .filter(|&i| case.records[i].role == role)
        .collect();
    // Wide passes as long as they are more than half full.
    let mut passes: Vec<&[Direction<'_>]> = Vec::new();
    let mut left = directions;
    while left.len() > FEW {
        let (pass, rest) = left.split_at(left.len().min(LANES));
        passes.push(pass);
        left = rest;
    }
    if !left.is_empty() || passes.is_empty() {
        passes.push(left);
    }
    let jobs: Vec<(usize, usize)> = (0..passes.len())
        .flat_map(|p| records.iter().map(move |&r| (p, r)))
        .collect();
    let results: Vec<Vec<f64>> = jobs
        .par_iter()
        .map(|&(pass, r)| {
            let own = passes[pass];
            let over = if own.len() > FEW {
                one_pass::<LANES>
            } else {
                one_pass::<FEW>
            };
            over(case, &case.records[r], hypothesis, at, &gains[r], own)
        })
        .collect();
    let width = |pass: usize| 1 + passes[pass].len();
    let lengths: Vec<usize> = (0..records.len())
        .map(|slot| results[slot].len() / width(0))
        .collect();
    let mut out = Linear {
        r: DVector::zeros(lengths.iter().sum()),
        j: DMatrix::zeros(lengths.iter().sum(), directions.len()),
    };
    let mut column = 0;
    for (pass, of_records) in results.chunks(records.len().max(1)).enumerate() {
        let mut row = 0;
        for rows in of_records {
            for x in rows.chunks_exact(width(pass)) {
                out.r[row] = x[0];
                for (lane, slope) in x[1..].iter().enumerate() {
                    out.j[(row, column + lane)] = *slope;
                }
                row += 1;
            }
        }
        column += passes[pass].len();
    }
    out
}

/// Innovations of one record, each followed by its derivatives in the directions, at most `N`.
fn one_pass<const N: usize>(
    case: &Case,
    record: &Record,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Gain],
    directions: &[Direction<'_>],
) -> Vec<f64>
where
    Lanes<N>: Pick,
{
    let lift = |x: &[f64]| x.iter().map(|&x| Lanes::<N>::constant(x)).collect();
    let (mut theta, mut e): (Vec<Lanes<N>>, Vec<Lanes<N>>) = (lift(&at.theta), lift(&at.e));
    for (lane, d) in directions.iter().enumerate() {
        match d {
            Direction::Theta(x) => {
                for (t, x) in theta.iter_mut().zip(*x) {
                    t.eps[lane] = *x;
                }
            }
            Direction::Effect(i) => e[*i].eps[lane] = 1.0,
        }
    }
    let mut rows = Vec::with_capacity(record.len() * case.n() * 2 * (1 + directions.len()));
    Runner::<Lanes<N>>::new(case, record, hypothesis, &theta, &e).predict(
        gains,
        &mut |_, _, _, x| {
            let fine = x.re.abs() < LARGEST && x.eps.iter().all(|e| e.abs() < 1e12);
            if fine {
                rows.push(x.re);
                rows.extend_from_slice(&x.eps[..directions.len()]);
            } else {
                rows.push(tame(x.re));
                rows.resize(rows.len() + directions.len(), 0.0);
            }
        },
        &mut |_, _| {},
    );
    rows
}

/// Directions of θ that the train records determine beyond their tolerance, from the Jacobian at
/// the nominal values.
pub fn basis(case: &Case) -> Basis {
    basis_as_run(case, Run::default())
}

/// The same of the nominal structure run in a way.
pub(crate) fn basis_as_run(case: &Case, run: Run) -> Basis {
    let at = Point {
        theta: vec![0.0; case.nominal.size()],
        e: Vec::new(),
    };
    let terms = Vec::new();
    basis_beside(case, &Hypothesis { terms, run }, &at)
}

/// The same beside effects, at a point: a gear that gives way tells the inertia of its rotor from
/// that of the link behind it.
pub fn basis_beside(case: &Case, hypothesis: &Hypothesis, at: &Point) -> Basis {
    let size = case.nominal.size();
    let unit = DMatrix::<f64>::identity(size, size);
    let directions: Vec<Direction<'_>> = (0..size)
        .map(|i| Direction::Theta(&unit.as_slice()[i * size..(i + 1) * size]))
        .collect();
    let gains = all_gains(case, hypothesis, at);
    let lin = linearise(case, hypothesis, at, &gains, Role::Train, &directions);
    let eigen = (lin.j.transpose() * &lin.j).symmetric_eigen();
    let keep: Vec<usize> = (0..size).filter(|&i| eigen.eigenvalues[i] > 0.3).collect();
    let mut columns = DMatrix::zeros(size, keep.len());
    for (c, &i) in keep.iter().enumerate() {
        columns.set_column(c, &eigen.eigenvectors.column(i));
    }
    Basis { columns }
}

/// Rounds of [`Quadratic::minimise`]: each changes the set of bounds that hold, and a robot of six
/// joints has some hundred of them.
const ROUNDS: usize = 60;

/// Quadratic model of the objective around a point, in (θ, e): `½ xᵀ H x + gᵀ x`, prior included.
#[derive(Debug, Clone)]
pub struct Quadratic {
    /// Curvature.
    pub h: DMatrix<f64>,
    /// Gradient.
    pub g: DVector<f64>,
}

impl Quadratic {
    /// From derivatives along the basis (first columns) and the effects' parameters (last).
    pub fn new(basis: &Basis, lin: &Linear, at: &Point) -> Self {
        let (size, r) = basis.columns.shape();
        let ne = lin.j.ncols() - r;
        let hz = lin.j.transpose() * &lin.j;
        let gz = lin.j.transpose() * &lin.r;
        let mut wide = DMatrix::zeros(size + ne, r + ne);
        wide.view_mut((0, 0), (size, r)).copy_from(&basis.columns);
        for i in 0..ne {
            wide[(size + i, r + i)] = 1.0;
        }
        let mut h = &wide * hz * wide.transpose();
        let mut g = &wide * gz;
        for i in 0..size {
            h[(i, i)] += 1.0 / (PRIOR * PRIOR);
            // Without directions the deviations stay where they are.
            if r > 0 {
                g[i] += at.theta[i] / (PRIOR * PRIOR);
            }
        }
        Quadratic { h, g }
    }

    /// Minimiser within `low ≤ x ≤ high`, by an active set on Cholesky factorizations; and whether
    /// it is one: otherwise the curvature is not positive, or the active set has not settled within
    /// `ROUNDS`, and x is a point within the bounds.
    pub fn minimise(&self, low: &DVector<f64>, high: &DVector<f64>) -> (DVector<f64>, bool) {
        let m = self.g.len();
        let mut x = DVector::zeros(m);
        let mut held = vec![0i8; m];
        let mut settled = false;
        for _ in 0..ROUNDS {
            let free: Vec<usize> = (0..m).filter(|&i| held[i] == 0).collect();
            for i in 0..m {
                match held[i] {
                    1 => x[i] = high[i],
                    -1 => x[i] = low[i],
                    _ => {}
                }
            }
            let k = free.len();
            let mut a = DMatrix::zeros(k, k);
            let mut b = DVector::zeros(k);
            for (p, &i) in free.iter().enumerate() {
                b[p] = -self.g[i];
                for j in 0..m {
                    if held[j] != 0 {
                        b[p] -= self.h[(i, j)] * x[j];
                    }
                }
                for (q, &j) in free.iter().enumerate() {
                    a[(p, q)] = self.h[(i, j)];
                }
                a[(p, p)] += 1e-12 * self.h[(i, i)] + 1e-300;
            }
            let Some(factor) = a.cholesky() else { break };
            let y = factor.solve(&b);
            let mut changed = false;
            for (p, &i) in free.iter().enumerate() {
                x[i] = y[p];
                if y[p] > high[i] {
                    held[i] = 1;
                    changed = true;
                } else if y[p] < low[i] {
                    held[i] = -1;
                    changed = true;
                }
            }
            if !changed {
                // Release what pulls inwards.
                for i in 0..m {
                    if held[i] == 0 {
                        continue;
                    }
                    let slope = self.g[i] + (0..m).map(|j| self.h[(i, j)] * x[j]).sum::<f64>();
                    if (held[i] == 1 && slope > 1e-9) || (held[i] == -1 && slope < -1e-9) {
                        held[i] = 0;
                        changed = true;
                    }
                }
                if !changed {
                    settled = true;
                    break;
                }
            }
        }
        for i in 0..m {
            x[i] = x[i].clamp(low[i], high[i]);
        }
        (x, settled)
    }

    /// The model at x, relative to its value at 0.
    pub fn at(&self, x: &DVector<f64>) -> f64 {
        0.5 * (x.transpose() * &self.h * x)[(0, 0)] + self.g.dot(x)
    }
}

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
    pub slopes: Option<&'a DMatrix<f64>>,
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
        slopes(
            case,
            &self.hypothesis,
            &self.point,
            &self.gains,
            &columns,
            None,
        )
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

/// Derivatives of one step: those along the basis may be borrowed, those in the effects' parameters are new.
fn slopes(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    columns: &[Vec<f64>],
    borrowed: Option<&DMatrix<f64>>,
) -> Linear {
    let ne = at.e.len();
    let effects = (0..ne).map(Direction::Effect);
    if let Some(old) = borrowed {
        let directions: Vec<Direction<'_>> = effects.clone().collect();
        let own = linearise(case, hypothesis, at, gains, Role::Train, &directions);
        if own.r.len() == old.nrows() {
            let mut j = DMatrix::zeros(old.nrows(), columns.len() + ne);
            j.columns_mut(0, columns.len()).copy_from(old);
            j.columns_mut(columns.len(), ne).copy_from(&own.j);
            return Linear { r: own.r, j };
        }
    }
    let mut directions: Vec<Direction<'_>> = columns.iter().map(|c| Direction::Theta(c)).collect();
    directions.extend(effects);
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
    let bounds = ranges(case, hypothesis);
    let size = start.theta.len();
    let ne = start.e.len();
    let mut at = start;
    for (e, (low, high)) in at.e.iter_mut().zip(&bounds) {
        *e = e.clamp(*low, *high);
    }
    let columns = basis.directions();
    let rank = columns.len();
    let mut gains = all_gains(case, hypothesis, &at);
    let mut now = value(case, hypothesis, &at, &gains, Role::Train);
    let mut damping = 1e-3;
    let (mut steps, mut unsettled) = (0, 0);
    let mut own: Option<DMatrix<f64>> = None;
    let mut borrowed = effort.slopes.is_some();
    let mut quadratic = Quadratic {
        h: DMatrix::zeros(0, 0),
        g: DVector::zeros(0),
    };
    loop {
        if steps >= effort.steps && !effort.curvature {
            break;
        }
        let lin = slopes(
            case,
            hypothesis,
            &at,
            &gains,
            &columns,
            if borrowed {
                own.as_ref().or(effort.slopes)
            } else {
                None
            },
        );
        quadratic = Quadratic::new(basis, &lin, &at);
        if !borrowed {
            own = Some(lin.j.columns(0, rank).into_owned());
        }
        if steps >= effort.steps {
            break;
        }
        let mut low = DVector::zeros(size + ne);
        let mut high = DVector::zeros(size + ne);
        for i in 0..size {
            (low[i], high[i]) = (-1.0 - at.theta[i], 1.0 - at.theta[i]);
        }
        for i in 0..ne {
            (low[size + i], high[size + i]) = (bounds[i].0 - at.e[i], bounds[i].1 - at.e[i]);
        }
        let mut improved = false;
        let mut decrease = 0.0;
        let mut predicted = 0.0;
        for _ in 0..if borrowed { 3 } else { 7 } {
            let mut damped = quadratic.clone();
            for i in 0..size {
                damped.h[(i, i)] += damping * 4.0;
            }
            for i in 0..ne {
                let k = size + i;
                damped.h[(k, k)] += damping * quadratic.h[(k, k)] + 1e-300;
            }
            let (x, minimal) = damped.minimise(&low, &high);
            unsettled += usize::from(!minimal);
            predicted = -2.0 * quadratic.at(&x);
            let mut next = at.clone();
            for i in 0..size {
                next.theta[i] += x[i];
            }
            for i in 0..ne {
                next.e[i] += x[size + i];
            }
            if let Some(there) = value_below(now.objective(), case, hypothesis, &next, &gains) {
                decrease = now.objective() - there.objective();
                at = next;
                now = there;
                damping = (damping * 0.1).max(1e-6);
                improved = true;
                break;
            }
            damping = (damping * 10.0).max(1e-2);
        }
        steps += 1;
        let resting = decrease < REST.0 + REST.1 * now.objective();
        if borrowed {
            let at_rest = predicted < REST.0 + REST.1 * now.objective();
            if !improved || decrease < TRUSTED * predicted || (resting && !at_rest) {
                // The neighbour's derivatives no longer serve.
                borrowed = false;
                continue;
            }
            if resting {
                if !effort.exact {
                    break;
                }
                borrowed = false;
                continue;
            }
        } else {
            if !improved {
                break;
            }
            if resting && steps > 1 {
                break;
            }
            // Derivatives of this fit serve its next steps.
            borrowed = rank > 0 && decrease > 0.7 * predicted;
        }
        if ne > 0 && steps < 4 {
            gains = all_gains(case, hypothesis, &at);
            now = value(case, hypothesis, &at, &gains, Role::Train);
        }
    }
    Fit {
        hypothesis: hypothesis.clone(),
        point: at,
        gains,
        train: now,
        quadratic,
        steps,
        unsettled,
    }
}

impl Basis {
    /// No directions: a fit moves the effects' parameters only.
    pub fn frozen(&self) -> Self {
        Basis {
            columns: DMatrix::zeros(self.columns.nrows(), 0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum};

    #[test]
    fn a_gear_with_play_shows_the_rotor_apart_from_the_link() {
        let play = named(&["backlash"]);
        let e = [0.03, 6.7e-4, 2.6e-4];
        let case = pendulum(&play, &e, 6.0, &|_| {});
        let at = Point {
            theta: vec![0.0; SIZE],
            e: e.to_vec(),
        };
        let rigid = basis(&case).columns.ncols();
        let beside = basis_beside(&case, &play, &at).columns.ncols();
        assert!(beside > rigid, "{beside} directions, {rigid} without play");
    }

    #[test]
    fn a_fit_on_the_way_ends_where_the_same_steps_with_curvature_end() {
        let spring = named(&["spring"]);
        let case = pendulum(&spring, &[0.9, 0.2], 6.0, &|_| {});
        let basis = basis(&case);
        let start = || Point {
            theta: vec![0.0; SIZE],
            e: vec![0.1, 0.0],
        };
        let whole = fit(&case, &basis, &spring, start(), Effort::full(2));
        let part = fit(&case, &basis, &spring, start(), Effort::on_the_way(2));
        assert_eq!(whole.point, part.point);
        assert_eq!(whole.train, part.train);
        assert_eq!(whole.quadratic.h.nrows(), SIZE + 2);
        assert_eq!(part.steps, 2);
    }
}
