//! What a regression found.

use crate::inertia::consistent::Consistent;
use crate::regress::filter_choice::Choice;
use crate::regress::instruments::Rounds;
use crate::regress::judge::Errors;
use crate::regress::range::{self, Excess};
use crate::regress::solution::Solution;

/// One base parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// In words.
    pub formula: String,
    /// Whether it is one parameter by itself.
    pub single: bool,
    /// Unit of the parameter that stands for it.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// Standard deviation by the jackknife.
    pub deviation: f64,
    /// Standard deviation under white residuals of the fitted size.
    pub white: f64,
    /// Bootstrap interval of 95 %.
    pub interval: Option<(f64, f64)>,
    /// Spread over the records, each fitted by itself: `√(Σ ((β_r − β̄)/σ_r)²/(R − 1))`, β̄ the
    /// weighted mean; about 1 where they agree within their own deviations. `None` with fewer than
    /// two records that determine it.
    pub agreement: Option<f64>,
}

impl Row {
    /// Whether the data determine the value: its deviation is less than half of it.
    pub fn pinned(&self) -> bool {
        self.deviation < 0.5 * self.value.abs()
    }
}

/// A finished regression.
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    /// Base parameters.
    pub rows: Vec<Row>,
    /// Linear parameters.
    pub linear: usize,
    /// All parameters of the model: those with the estimated β nearest to the start.
    pub parameters: Vec<f64>,
    /// Parameters that do not enter any combination.
    pub absent: Vec<String>,
    /// Parameters held though free in the model, with their values: gains, and shapes where found.
    pub held: Vec<(String, f64)>,
    /// Residuals of training records and of each test record.
    pub errors: Vec<Errors>,
    /// The same of values given to be judged.
    pub given: Vec<(String, Vec<Errors>)>,
    /// Residuals of left-out training records: mean overall share.
    pub folds: Option<f64>,
    /// Where test records leave the range of the training records.
    pub excess: Vec<Excess>,
    /// Range of the training records.
    pub ranges: Vec<range::Range>,
    /// How the filter was chosen, if it was.
    pub filter_choice: Option<Choice>,
    /// Physically consistent values and their residuals.
    pub consistent: Option<(Consistent, Vec<f64>, Vec<Errors>)>,
    /// Share of random poses with an indefinite mass matrix: unconstrained, consistent.
    pub indefinite: (f64, Option<f64>),
    /// Kept samples and blocks.
    pub samples: (usize, usize),
    /// What the filters did, per record.
    pub remarks: Vec<String>,
    /// Seconds.
    pub seconds: f64,
    /// The payload, if one was asked for: its ten parameters and the mass's standard deviation.
    pub payload: Option<PayloadFound>,
    /// Outcome of the rounds of instrumental variables, and how far they moved each combination
    /// from least squares.
    pub instruments: Option<(Rounds, Vec<f64>)>,
    /// The solution.
    pub solution: Solution,
}

/// A payload as it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct PayloadFound {
    /// Link it is fixed to.
    pub link: String,
    /// Mass, first moment and inertia about the origin of the link's frame (the order of
    /// [`crate::inertia::pseudo_inertia::SUFFIXES`]), with standard deviations where they are
    /// determined one by one.
    pub values: Vec<(f64, Option<f64>)>,
    /// The same of the physically consistent fit.
    pub consistent: Option<Vec<f64>>,
}
