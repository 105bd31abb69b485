//! Ceilings: how much of the gap any cause of a class can remove at most.
//!
//! For each joint and class of cause a flexible law ([`laws`]) is fitted with the nominal parameters and
//! all effects at hand free, to slow predictions (see [`levels`](crate::levels)): first over a part of
//! the horizon, where its shape is found, then over all of it. Its heights are drawn to zero as far as
//! the records ask for it (see [`shrunk`]). It is judged by free runs on records that were never fitted,
//!
//! ```text
//! share = (G₀² − G₁²) / (G₀² − F²)
//! ```
//!
//! with the gap G₀ of the model at hand, G₁ with the law, and the floor F. Where an effect of the
//! library that belongs to the class removes more, that is its ceiling. Intervals come from drawing the
//! windows of the free runs anew, the same ones for both gaps (B. Efron, R. J. Tibshirani, An
//! Introduction to the Bootstrap, 1993, chapter 8).

mod laws;
mod shrunk;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::DVector;
use pid_data::Role;
use pid_interpret::nominal::Role as Part;
use rayon::prelude::*;

use crate::case::{Case, Velocity};
use crate::diagnosis::Ceiling;
use crate::effect::{Class, Effect, Term};
use crate::effects;
use crate::fit::{Basis, Effort, Fit, Point, fit};
use crate::gap::{FEW_WINDOWS, Gap, draws, gap, within};
use crate::levels::{SHORT, WHOLE, follow_slowly, settle};
use crate::search::{Watch, directions};
use laws::ClassLaw;
use shrunk::{Answering, Enter, Heights, fitted};

/// Steps of the model before laws are tried.
const STEPS: usize = 6;
/// Two classes whose corrections of the test records are this much alike (cosine) are confounded: either
/// takes the place of the other up to a fifth of its squares.
const ALIKE: f64 = 0.9;
/// Ceilings below this are not compared.
const SMALL: f64 = 0.05;
/// Unit of delays and lags, s.
const LATE: f64 = 0.01;

/// What ceilings are taken about.
pub(crate) struct About<'a> {
    /// The records, with the levels of the sensors.
    pub(crate) case: &'a Case,
    /// The model.
    pub(crate) fit: &'a Fit,
    /// Its gap, and the gap that noise alone leaves.
    pub(crate) gap: &'a Gap,
    pub(crate) floor: f64,
    /// What may ask it to stop.
    pub(crate) watch: &'a Watch,
}

/// Ceilings of all classes at all joints, the largest first; none where the gap is that of noise.
pub(crate) fn ceilings(about: &About<'_>) -> Vec<Ceiling> {
    if about.gap.total <= about.floor {
        return Vec::new();
    }
    let (Some(short), Some(whole)) = (tuned(about, SHORT), tuned(about, WHOLE)) else {
        return Vec::new();
    };
    let plain = short.errors(&short.fit.hypothesis, &short.fit.point);
    let models = [short, whole];
    let mut jobs = Vec::new();
    for (j, class) in (0..about.case.n()).flat_map(|j| Class::ALL.map(|class| (j, class))) {
        let heights = heights(about.case, &models[0].fit, class, j);
        jobs.extend(heights.map(|h| (j, class, h)));
    }
    let mut found: Vec<(Ceiling, Vec<f64>)> = jobs
        .into_par_iter()
        .filter(|_| !about.watch.stopped())
        .map(|(j, class, heights)| {
            let left = left(&models, heights);
            let (share, interval) = (left.as_ref()).map_or((0.0, None), |l| removed(about, &l.gap));
            let ceiling = Ceiling {
                joint: j + 1,
                class,
                share,
                interval,
                confounded: Vec::new(),
            };
            let moved = left.map_or_else(Vec::new, |l| l.errors);
            let correction = moved.iter().zip(&plain).map(|(a, b)| a - b);
            (ceiling, correction.collect())
        })
        .collect();
    found.sort_by(|a, b| b.0.share.total_cmp(&a.0.share));
    with_confounded(found)
}

/// The model, tuned under the levels of its own errors over a part of the horizon.
fn tuned(about: &About<'_>, part: f64) -> Option<Answering> {
    let mut case = about.case.clone();
    let sensors: Vec<(f64, f64)> = case.noise.iter().map(|n| (n.q, n.v)).collect();
    follow_slowly(&mut case, part);
    let better = |case: &Case, at: &Fit, basis: &Basis| {
        let effort = Effort::full(STEPS);
        fit(case, basis, &at.hypothesis, at.point.clone(), effort)
    };
    let first = better(&case, about.fit, &directions(&case, about.fit));
    settle(&mut case, &first, &sensors);
    let basis = directions(&case, &first);
    let fit = better(&case, &first, &basis);
    Answering::new(case, fit, basis)
}

fn of_inertia(role: Part) -> bool {
    let link = matches!(role, Part::Mass | Part::CenterOfMass(_) | Part::Inertia(_));
    link || role == Part::RotorInertia
}

/// What the law of a class leaves.
struct Left {
    /// The smallest gap.
    gap: Gap,
    /// Errors of the test records over a part of the horizon.
    errors: Vec<f64>,
}

/// A law fitted over a part of the horizon and from its shape over all of it; `None` where the records
/// do not ask for it.
fn left([short, whole]: &[Answering; 2], mut heights: Heights) -> Option<Left> {
    let gap = |model: &Answering, point: &Point| {
        let (theta, e) = (&point.theta, &point.e);
        gap(&model.case, &heights.hypothesis, theta, e, Role::Test)
    };
    let first = fitted(short, &short.fit.point, &heights);
    let errors = first
        .as_ref()
        .map(|f| short.errors(&heights.hypothesis, &f.point));
    let mut gaps: Vec<Gap> = first.iter().map(|f| gap(short, &f.point)).collect();
    if let Some(first) = first {
        heights.c = first.c;
    }
    let last = fitted(whole, &whole.fit.point, &heights);
    gaps.extend(last.iter().map(|f| gap(whole, &f.point)));
    Some(Left {
        gap: gaps
            .into_iter()
            .min_by(|a, b| a.total.total_cmp(&b.total))?,
        errors: errors.unwrap_or_default(),
    })
}

/// The law of a class at a joint beside a model: hats, a delay or a lag of the library, or inertia
/// beyond its tolerance; `None` where the class has nothing there.
fn heights(case: &Case, at: &Fit, class: Class, j: usize) -> Option<Heights> {
    let (effect, unit): (Arc<dyn Effect>, f64) = match class {
        Class::Inertia => {
            let values = case.nominal.values.iter().enumerate();
            let places: Vec<usize> = values
                .filter(|(_, v)| v.joint == Some(j) && v.half_width > 0.0 && of_inertia(v.role))
                .map(|(i, _)| i)
                .collect();
            return (!places.is_empty()).then(|| Heights {
                hypothesis: at.hypothesis.clone(),
                c: DVector::zeros(places.len()),
                enter: Enter::Theta(places),
            });
        }
        Class::InputTiming => (effects::by_id("input_delay")?, LATE),
        Class::PositionTiming => (effects::by_id("sensor_delay")?, LATE),
        Class::VelocityTiming if case.velocity[j] == Velocity::Measured => {
            (effects::by_id("velocity_filter_lag")?, LATE)
        }
        _ => (Arc::new(ClassLaw::new(case, class, j)?), 1.0),
    };
    let terms = (at.hypothesis.terms.iter()).chain(&case.known.hypothesis.terms);
    let id = effect.info().id;
    if terms
        .filter(|t| t.joint == j)
        .any(|t| t.effect.info().id == id)
    {
        return None;
    }
    let count = effect.info().parameters.len();
    // A lag has no slope at zero.
    let start = if class == Class::VelocityTiming {
        1.0
    } else {
        0.0
    };
    let mut hypothesis = at.hypothesis.clone();
    hypothesis.terms.push(Term { effect, joint: j });
    Some(Heights {
        hypothesis,
        enter: Enter::Effect(unit),
        c: DVector::from_element(count, start),
    })
}

/// Raises the ceiling of the class of an effect at joint `j` to the share that the effect removes.
pub(crate) fn raise(ceilings: &mut [Ceiling], (effect, j): (&str, usize), share: f64) {
    let class = effects::by_id(effect).map(|e| e.info().class);
    let mut all = ceilings.iter_mut();
    let own = all.find(|c| c.joint == j && Some(c.class) == class);
    if let Some(own) = own.filter(|c| c.share < share) {
        own.share = share;
        own.interval = own.interval.map(|(low, high)| (low, high.max(share)));
    }
}

/// Share that a law removes, and its interval of 95 %, if there are windows enough.
fn removed(about: &About<'_>, with: &Gap) -> (f64, Option<(f64, f64)>) {
    let (before, floor) = (about.gap.total, about.floor);
    let whole = before * before / (before * before - floor * floor);
    let (old, new) = (&about.gap.windows, &with.windows);
    let left = |sums: (f64, f64)| sums.1 / sums.0.max(1e-300);
    let all = |x: &[f64]| x.iter().sum::<f64>();
    // Records count alike in the gap, whatever the number of their windows.
    let scale = (with.total / before).powi(2) / left((all(old), all(new))).max(1e-300);
    let share = |left: f64| (whole * (1.0 - scale * left)).clamp(0.0, 1.0);
    let n = old.len().min(new.len());
    let point = share(left((all(old), all(new))));
    if n < FEW_WINDOWS {
        return (point, None);
    }
    let drawn = draws(n, 0xce11).map(|draw| {
        let drawn = draw.into_iter();
        share(left(
            drawn.fold((0.0, 0.0), |s, i| (s.0 + old[i], s.1 + new[i])),
        ))
    });
    (point, Some(within(drawn)))
}

/// The ceilings with those that correct the test records alike.
fn with_confounded(found: Vec<(Ceiling, Vec<f64>)>) -> Vec<Ceiling> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let alike = |i: usize| -> Vec<String> {
        let (own, x) = &found[i];
        let others = found.iter().enumerate();
        others
            .filter(|(k, (other, _))| *k != i && own.share.min(other.share) > SMALL)
            .filter(|(_, (_, y))| dot(x, y) > ALIKE * (dot(x, x) * dot(y, y)).sqrt())
            .map(|(_, (other, _))| other.label())
            .collect()
    };
    let confounded: Vec<Vec<String>> = (0..found.len()).map(alike).collect();
    let all = found.into_iter().zip(confounded);
    all.map(|((ceiling, _), confounded)| Ceiling {
        confounded,
        ..ceiling
    })
    .collect()
}
