//! Values of one log with their deviations, by weighted least squares and a jackknife over blocks of time.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use pid_data::Dataset;
use pid_data::signal::SignalError;
use pid_runtime::dynamics::Hessian;
use serde::{Deserialize, Serialize};

use crate::frame::{Block, Extra, Frame, total};
use crate::plan::{Kind, Plan};

/// Passes of the joints' weights, each one over its residual variance.
const PASSES: usize = 4;
/// Fewest blocks of a jackknife.
const FEWEST: usize = 3;

/// What a log tells: one value and deviation per quantity of the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Values.
    pub values: Vec<f64>,
    /// Standard deviations by leaving out one block of time after another.
    pub deviations: Vec<f64>,
}

/// Why a log tells nothing.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// The filters do not take the record.
    #[error(transparent)]
    Signal(#[from] SignalError),
    /// The motion does not determine the quantities of the fleet.
    #[error(
        "the motion does not determine the quantities of the fleet\n  help: leave the log out, or log the motion of the others"
    )]
    Undetermined,
    /// The plan is of another robot.
    #[error("the plan names `{name}`, which the robot does not have\n  help: plan the fleet again")]
    OtherRobot {
        /// A parameter.
        name: String,
    },
}

/// The estimator of a plan for its robot.
pub struct Estimator<'m> {
    frame: Frame<'m>,
    joints: usize,
    /// Per quantity: its column, or the joint whose residual it is.
    places: Vec<Place>,
}

enum Place {
    Column(usize),
    Residual(usize),
}

impl<'m> Estimator<'m> {
    /// Of a plan; `model` is that of the plan's robot.
    ///
    /// # Errors
    /// [`MeasureError::OtherRobot`].
    pub fn new(model: &'m dyn Hessian, plan: &Plan) -> Result<Self, MeasureError> {
        let params = model.params();
        let position = |name: &str| {
            let found = params.iter().position(|p| p.name == *name);
            found.ok_or_else(|| MeasureError::OtherRobot {
                name: name.to_owned(),
            })
        };
        let mut p: Vec<f64> = params.iter().map(|p| p.nominal).collect();
        let mut hold = Vec::new();
        for held in &plan.held {
            let at = position(&held.name)?;
            p[at] = held.value;
            hold.push(at);
        }
        let joint = |name: &str| {
            let found = model.joints().iter().position(|j| j.name == *name);
            found.ok_or_else(|| MeasureError::OtherRobot {
                name: name.to_owned(),
            })
        };
        let mut extras = Vec::new();
        for quantity in &plan.quantities {
            match &quantity.kind {
                Kind::Offset { joint: name } => extras.push(Extra::Offset(joint(name)?)),
                Kind::Delay { joint: name } => extras.push(Extra::Delay(joint(name)?)),
                Kind::Parameter | Kind::Residual { .. } => {}
            }
        }
        let frame = Frame::new(model, &p, &hold, &extras, plan.cutoff);
        let mut places = Vec::new();
        let mut next = frame.linear().len();
        for quantity in &plan.quantities {
            places.push(match &quantity.kind {
                Kind::Parameter => {
                    let at = position(&quantity.name)?;
                    let column = frame.linear().binary_search(&at);
                    Place::Column(column.map_err(|_| MeasureError::OtherRobot {
                        name: quantity.name.clone(),
                    })?)
                }
                Kind::Residual { joint: name } => Place::Residual(joint(name)?),
                Kind::Offset { .. } | Kind::Delay { .. } => {
                    next += 1;
                    Place::Column(next - 1)
                }
            });
        }
        Ok(Self {
            frame,
            joints: model.dims().nq,
            places,
        })
    }

    /// Measures a log.
    ///
    /// # Errors
    /// A record that cannot be filtered, or that does not determine the quantities.
    pub fn measure(&self, log: &Dataset) -> Result<Measured, MeasureError> {
        let blocks = self.frame.blocks(log)?;
        let columns = self.frame.columns();
        let all = total(&blocks, self.joints, columns);
        let weights = weights(&all).ok_or(MeasureError::Undetermined)?;
        let solution = solve(&all, &weights).ok_or(MeasureError::Undetermined)?;
        let covariance = jackknife(&blocks, &all, &weights).ok_or(MeasureError::Undetermined)?;
        let (mut values, mut deviations) = (Vec::new(), Vec::new());
        for place in &self.places {
            let (value, deviation) = match *place {
                Place::Column(k) => (solution[k], covariance[(k, k)].max(0.0).sqrt()),
                Place::Residual(j) => residual(&blocks, j, &solution),
            };
            values.push(value);
            deviations.push(deviation);
        }
        let sound = |x: &f64| x.is_finite();
        match values.iter().all(sound) && deviations.iter().all(|d| sound(d) && *d > 0.0) {
            true => Ok(Measured { values, deviations }),
            false => Err(MeasureError::Undetermined),
        }
    }
}

/// Logarithm of the RMS residual of a joint over the RMS force of its drive, and the deviation of that from the
/// scatter of the blocks.
fn residual(blocks: &[Block], joint: usize, x: &DVector<f64>) -> (f64, f64) {
    let own = blocks.iter().map(|b| &b[joint]).filter(|s| s.count > 0);
    let shares: Vec<(f64, f64)> = own.map(|s| (s.residual(x), s.drive)).collect();
    let (square, drive) = shares
        .iter()
        .fold((0.0, 0.0), |(r, d), s| (r + s.0, d + s.1));
    let n = shares.len() as f64;
    let left: f64 = shares
        .iter()
        .map(|(r, d)| (((square - r) / (drive - d)) / (square / drive)).ln())
        .map(|change| change * change)
        .sum();
    (
        0.5 * (square / drive).ln(),
        (0.25 * left * (n - 1.0) / n).sqrt(),
    )
}

fn weighted(block: &Block, weights: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
    let n = block.first().map_or(0, |s| s.b.len());
    let (mut a, mut b) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for (sums, weight) in block.iter().zip(weights) {
        a += *weight * &sums.a;
        b += *weight * &sums.b;
    }
    (a, b)
}

/// A factor of a matrix scaled to a unit diagonal.
struct Factor {
    factor: Cholesky<f64, Dyn>,
    scale: DVector<f64>,
}

impl Factor {
    fn new(a: &DMatrix<f64>) -> Option<Self> {
        let scale = a.diagonal().map(|d| match d > 0.0 {
            true => d.sqrt().recip(),
            false => 1.0,
        });
        let scaled = DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] * scale[i] * scale[j]);
        Some(Self {
            factor: scaled.cholesky()?,
            scale,
        })
    }

    fn solve(&self, b: &DVector<f64>) -> DVector<f64> {
        let right = b.component_mul(&self.scale);
        self.factor.solve(&right).component_mul(&self.scale)
    }
}

/// Values of the columns under given weights of the joints.
pub(crate) fn solve(all: &Block, weights: &[f64]) -> Option<DVector<f64>> {
    let (a, b) = weighted(all, weights);
    Some(Factor::new(&a)?.solve(&b))
}

/// Weights of the joints, settled in a few passes; `None` where the sums do not determine the columns.
pub(crate) fn weights(all: &Block) -> Option<Vec<f64>> {
    let reciprocal = |square: f64, count: usize| match square > 0.0 && square.is_finite() {
        true => count as f64 / square,
        false => 1.0,
    };
    let mut weights: Vec<f64> = all.iter().map(|s| reciprocal(s.c, s.count)).collect();
    for _ in 0..PASSES {
        let x = solve(all, &weights)?;
        weights = (all.iter())
            .map(|s| reciprocal(s.residual(&x), s.count))
            .collect();
    }
    Some(weights)
}

/// `(B − 1)/B Σ (x₍ₖ₎ − x̄)(x₍ₖ₎ − x̄)ᵀ` of the values without each block.
fn jackknife(blocks: &[Block], all: &Block, weights: &[f64]) -> Option<DMatrix<f64>> {
    if blocks.len() < FEWEST {
        return None;
    }
    let (a, b) = weighted(all, weights);
    let each: Option<Vec<DVector<f64>>> = blocks
        .iter()
        .map(|block| {
            let (own_a, own_b) = weighted(block, weights);
            Some(Factor::new(&(&a - own_a))?.solve(&(&b - own_b)))
        })
        .collect();
    let each = each?;
    let n = each.len() as f64;
    let mean = each.iter().fold(DVector::zeros(b.len()), |sum, x| sum + x) / n;
    let scatter = each
        .iter()
        .fold(DMatrix::zeros(b.len(), b.len()), |sum, x| {
            let d = x - &mean;
            sum + &d * d.transpose()
        });
    Some(scatter * ((n - 1.0) / n))
}
