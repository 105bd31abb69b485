//! The fit of a flexible law whose heights are drawn to zero as far as the records ask for it.
//!
//! Gauss-Newton steps with a prior N(0, s²) on the heights c, the nominal parameters and the effects at
//! hand (z) along derivatives of the model without the law. s maximises the evidence of the linear model
//! (D. J. C. MacKay, Neural Computation 4(3), 1992),
//!
//! ```text
//! ln p(r | s) = −½ Σ ln(1 + s² λ) + ½ Σ s² g² / (1 + s² λ) + const
//! ```
//!
//! with the eigenvalues λ of the information G that z leaves on c, and g the pull of the records along
//! their eigenvectors. Many heights over few independent samples would otherwise follow chance.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use pid_data::Role;

use crate::case::Case;
use crate::fit::{Basis, Direction, Fit, PRIOR, Point, cross, gram, linearise, ranges, value};
use crate::hypothesis::Hypothesis;

/// Steps at most.
const STEPS: usize = 4;
/// Halvings of a step that does not pay.
const HALVINGS: usize = 3;
/// Decrease of the objective at which a fit has come to rest, relative.
const REST: f64 = 1e-3;
/// Least decrease that the first step of a law must promise, as a share of what is left at one joint.
const LEAST: f64 = 0.03;
/// Deviations of heights that are tried, in their own units: in steps of a factor of two from a thousandth.
const DEVIATIONS: i32 = 12;
const SMALLEST: f64 = 1e-3;

/// A model under given levels, its derivatives, and how it answers to errors.
pub(super) struct Answering {
    pub(super) case: Case,
    pub(super) fit: Fit,
    basis: Basis,
    /// Derivatives along the basis and in the parameters of the effects.
    slopes: DMatrix<f64>,
    /// Their curvature with the prior of the nominal parameters.
    curvature: Cholesky<f64, Dyn>,
}

impl Answering {
    /// `None` where the curvature is not positive.
    pub(super) fn new(case: Case, fit: Fit, basis: Basis) -> Option<Self> {
        let slopes = fit.linearised(&case, &basis).j;
        let mut h = gram(&slopes);
        for i in 0..h.nrows() {
            let prior = if i < basis.columns.ncols() {
                1.0 / (PRIOR * PRIOR)
            } else {
                0.0
            };
            h[(i, i)] += prior + 1e-12 * h[(i, i)] + 1e-300;
        }
        Some(Answering {
            curvature: h.cholesky()?,
            case,
            fit,
            basis,
            slopes,
        })
    }

    /// Errors of the predictor on the test records, over the level of each channel.
    pub(super) fn errors(&self, hypothesis: &Hypothesis, at: &Point) -> Vec<f64> {
        let gains = &self.fit.gains;
        linearise(&self.case, hypothesis, at, gains, Role::Test, &[])
            .r
            .data
            .into()
    }

    /// Pull of the prior at a point.
    fn pull(&self, at: &Point) -> DVector<f64> {
        let theta = DVector::from_column_slice(&at.theta) / (PRIOR * PRIOR);
        let own = self.basis.columns.tr_mul(&theta);
        own.resize_vertically(self.slopes.ncols(), 0.0)
    }
}

/// Heights of a law beside a model, and where they enter.
pub(super) struct Heights {
    /// The model with the law, if it is an effect.
    pub(super) hypothesis: Hypothesis,
    /// What moves with each height.
    pub(super) enter: Enter,
    /// Start.
    pub(super) c: DVector<f64>,
}

/// What heights are.
pub(super) enum Enter {
    /// Parameters of the last effect, with the size of one unit.
    Effect(f64),
    /// Deviations of nominal parameters beyond their priors.
    Theta(Vec<usize>),
}

impl Heights {
    /// The point of the model with these heights: its own `at`.
    fn point(&self, at: &Point, c: &DVector<f64>) -> Point {
        let mut point = at.clone();
        match &self.enter {
            Enter::Effect(unit) => point.e.extend(c.iter().map(|x| x * unit)),
            Enter::Theta(places) => {
                for (&i, x) in places.iter().zip(c.iter()) {
                    point.theta[i] += x;
                }
            }
        }
        point
    }

    /// Errors on the train records, and their derivatives in the heights.
    fn slopes(&self, model: &Answering, at: &Point) -> (DVector<f64>, DMatrix<f64>) {
        let size = at.theta.len();
        let (unit, vectors) = match &self.enter {
            Enter::Effect(unit) => (*unit, Vec::new()),
            Enter::Theta(places) => {
                let vector = |i: &usize| (0..size).map(|k| f64::from(u8::from(k == *i))).collect();
                (1.0, places.iter().map(vector).collect::<Vec<Vec<f64>>>())
            }
        };
        let first = at.e.len() - self.c.len() * usize::from(vectors.is_empty());
        let directions: Vec<Direction<'_>> = match vectors.is_empty() {
            true => (first..at.e.len()).map(Direction::Effect).collect(),
            false => vectors.iter().map(|v| Direction::Theta(v)).collect(),
        };
        let lin = linearise(
            &model.case,
            &self.hypothesis,
            at,
            &model.fit.gains,
            Role::Train,
            &directions,
        );
        (lin.r, lin.j * unit)
    }

    /// Heights within the ranges of their effect.
    fn limited(&self, model: &Answering, mut c: DVector<f64>) -> DVector<f64> {
        if let Enter::Effect(unit) = self.enter {
            let ranges = ranges(&model.case, &self.hypothesis);
            let own = &ranges[ranges.len() - c.len()..];
            for (x, (low, high)) in c.iter_mut().zip(own) {
                *x = x.clamp(low / unit, high / unit);
            }
        }
        c
    }
}

/// Where the law and the model end together; `None` where the records ask for no law.
pub(super) fn fitted(model: &Answering, from: &Point, heights: &Heights) -> Option<Fitted> {
    let (mut at, mut c) = (from.clone(), heights.c.clone());
    let gains = &model.fit.gains;
    let squares = |at: &Point, c: &DVector<f64>| {
        let there = heights.point(at, c);
        value(&model.case, &heights.hypothesis, &there, gains, Role::Train).total()
    };
    let priors = |at: &Point, c: &DVector<f64>, s: f64| {
        let own: f64 = at.theta.iter().map(|t| (t / PRIOR).powi(2)).sum();
        own + c.norm_squared() / (s * s)
    };
    let mut moved = false;
    for _ in 0..STEPS {
        let Some(step) = step(model, heights, &at, &c) else {
            break;
        };
        let Step { s, dz, dc, .. } = &step;
        if c.norm() == 0.0 && step.promise < LEAST / model.case.n() as f64 {
            return None;
        }
        let now = step.squares + priors(&at, &c, *s);
        let better = (0..=HALVINGS).find_map(|i| {
            let part = 0.5_f64.powi(i as i32);
            let next_c = heights.limited(model, &c + part * dc);
            let next = shifted(model, &at, &(part * dz));
            let then = squares(&next, &next_c) + priors(&next, &next_c, *s);
            (then < now).then_some((next, next_c, then))
        });
        let Some((next, next_c, then)) = better else {
            break;
        };
        (at, c, moved) = (next, next_c, true);
        if then > (1.0 - REST) * now {
            break;
        }
    }
    let point = heights.point(&at, &c);
    moved.then_some(Fitted { c, point })
}

/// The end of a fit.
pub(super) struct Fitted {
    /// The heights.
    pub(super) c: DVector<f64>,
    /// The model with the law.
    pub(super) point: Point,
}

/// A step of model and heights.
struct Step {
    /// Deviation of the heights.
    s: f64,
    dz: DVector<f64>,
    dc: DVector<f64>,
    /// Sum of squared errors before it.
    squares: f64,
    /// Decrease that the heights bring in the linear model, as a share of the squared errors.
    promise: f64,
}

/// The step of the linear model; `None` where no deviation of the heights pays.
fn step(model: &Answering, heights: &Heights, at: &Point, c: &DVector<f64>) -> Option<Step> {
    let there = heights.point(at, c);
    let (r, slopes) = heights.slopes(model, &there);
    if r.len() != model.slopes.nrows() {
        return None;
    }
    let first = -model
        .curvature
        .solve(&(model.slopes.tr_mul(&r) + model.pull(at)));
    let left = &r + &model.slopes * &first;
    let answer = model.curvature.solve(&cross(&model.slopes, &slopes));
    let mut information = cross(&slopes, &(&slopes - &model.slopes * &answer));
    information = (&information + information.transpose()) * 0.5;
    let pull = &information * c - slopes.tr_mul(&left);
    let eigen = information.symmetric_eigen();
    let along = eigen.eigenvectors.tr_mul(&pull);
    let pairs = || {
        eigen
            .eigenvalues
            .iter()
            .map(|l| l.max(0.0))
            .zip(along.iter())
    };
    let evidence = |s: f64| -> f64 {
        let s2 = s * s;
        pairs()
            .map(|(l, g)| s2 * g * g / (1.0 + s2 * l) - (1.0 + s2 * l).ln())
            .sum()
    };
    let s = (0..DEVIATIONS)
        .map(|i| SMALLEST * 2.0_f64.powi(i))
        .max_by(|a, b| evidence(*a).total_cmp(&evidence(*b)))
        .filter(|s| evidence(*s) > 0.0)?;
    let solved = pairs().map(|(l, g)| g / (l + 1.0 / (s * s)));
    let next = &eigen.eigenvectors * DVector::from_iterator(c.len(), solved);
    let promise = pull.dot(&next) / left.norm_squared().max(1e-300);
    let dc = next - c;
    let dz = first - answer * &dc;
    let finite = dc.iter().chain(dz.iter()).all(|x| x.is_finite());
    finite.then_some(Step {
        s,
        dz,
        dc,
        squares: r.norm_squared(),
        promise,
    })
}

/// The model moved along its directions; parameters of effects stay within their ranges.
fn shifted(model: &Answering, at: &Point, z: &DVector<f64>) -> Point {
    let rank = model.basis.columns.ncols();
    let theta = &model.basis.columns * z.rows(0, rank);
    let ranges = ranges(&model.case, &model.fit.hypothesis);
    let own = z.rows_range(rank..);
    let e = at.e.iter().zip(own.iter()).zip(ranges);
    Point {
        theta: at
            .theta
            .iter()
            .zip(theta.iter())
            .map(|(a, b)| a + b)
            .collect(),
        e: e.map(|((a, b), (low, high))| (a + b).clamp(low, high))
            .collect(),
    }
}
