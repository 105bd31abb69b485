//! Intervals of the parameters of named effects.

use super::magnitude::curvature;
use super::spread::Spread;
use crate::case::Case;
use crate::criteria::Criteria;
use crate::described::range;
use crate::fit::Fit;

/// Deviations to either side of an interval of 95 %.
const SIDES: f64 = 1.96;

/// Intervals of 95 % of the effects' parameters of a fit, within their ranges; `None` for what the
/// records do not determine.
pub(crate) fn intervals(case: &Case, criteria: &Criteria, fit: &Fit) -> Vec<Option<(f64, f64)>> {
    let size = fit.point.theta.len();
    let (_, dead) = curvature(fit);
    let spread = Spread::new(case, criteria, fit);
    let parameters = fit.hypothesis.terms.iter();
    let parameters = parameters.flat_map(|t| t.effect.info().parameters);
    (fit.point.e.iter().zip(parameters).enumerate())
        .map(|(i, (&x, p))| {
            let k = size + i;
            // What was found beside the fit, by the velocity channel alone, has no place in its curvature.
            if *dead.get(k)? {
                return None;
            }
            let std = spread.as_ref()?.deviation(k);
            let (low, high) = range(p);
            let ends = (
                (x - SIDES * std).max(low).min(x),
                (x + SIDES * std).min(high).max(x),
            );
            std.is_finite().then_some(ends)
        })
        .collect()
}
