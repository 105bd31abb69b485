//! One entry for every method and every kind of second derivatives.

use std::ops::ControlFlow;

use super::ip::{self, Callback};
use super::kkt::Kkt;
use super::kkt::sparse::SparseKkt;
use super::outcome::Solution;
use super::settings::Settings;
use super::{quasi_newton, sqp};
use crate::nlp::Nlp;
use serde::{Deserialize, Serialize};

/// The method behind [`solve`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Algorithm {
    /// Interior point, [`ip::solve`].
    #[default]
    InteriorPoint,
    /// Sequential quadratic programming, [`sqp::solve`].
    Sqp,
}

/// Minimises a problem by a method, with the problem's own Hessian or with damped BFGS from the
/// last steps (`Some(number)`).
///
/// `kkt` must have been built for the same problem.
pub fn solve(
    problem: &mut dyn Nlp,
    kkt: &mut dyn Kkt,
    x0: &[f64],
    (algorithm, memory): (Algorithm, Option<usize>),
    settings: &Settings,
    callback: &mut Callback<'_>,
) -> Solution {
    match (algorithm, memory) {
        (Algorithm::InteriorPoint, None) => ip::solve(problem, kkt, x0, settings, callback),
        (Algorithm::InteriorPoint, Some(memory)) => {
            quasi_newton::solve(problem, kkt, x0, memory, settings, callback)
        }
        (Algorithm::Sqp, memory) => sqp::solve(problem, kkt, x0, memory, settings, callback),
    }
}

/// Minimises a problem by the interior-point method on the sparse linear system, with the problem's own Hessian.
pub fn minimise(problem: &mut dyn Nlp, x0: &[f64], settings: &Settings) -> Solution {
    let mut kkt = SparseKkt::new(problem);
    ip::solve(problem, &mut kkt, x0, settings, &mut |_, _| {
        ControlFlow::Continue(())
    })
}
