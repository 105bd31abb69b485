//! Delays and lags that a signal shows by itself.
//!
//! A velocity that follows late from the positions of its own joint needs no model of the robot to be
//! seen, and an input that acts late needs hardly any; no place is chosen among many. So they come
//! before every round, without the margin for many candidates and without a share of free runs: each
//! must predict motions never fitted better, and free runs must not grow. Where a larger effect hides
//! one, it comes after that. A lag of a velocity stays beside every effect that is taken later; an input
//! that acts late can be one that shows late, or a slow drive.

use super::{Asked, Stand, round};
use crate::case::Case;
use crate::channel::{late_inputs, late_readings};
use crate::diagnosis::Round;
use crate::effect::Term;
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::timing::Alignment;

/// The effect by which a velocity reading lags.
const LAG_OF_VELOCITY: &str = "velocity_filter_lag";
/// Those by which an input acts late: by a shift, by a shift of what the joint shows, and by a lag.
const DELAY_OF_INPUT: &str = "input_delay";
const DELAY_OF_POSITION: &str = "sensor_delay";
const LAG_OF_INPUT: &str = "actuator_lag";

/// What one signal shows.
#[derive(Debug)]
pub(super) struct Shown {
    /// One of these terms, each with where its parameters start.
    terms: Vec<(Term, Vec<f64>)>,
    /// Whether it stays beside every effect that is taken later.
    stays: bool,
}

impl Shown {
    /// A signal that shows one term and no other.
    #[cfg(test)]
    pub(super) fn only(term: Term) -> Self {
        Shown {
            terms: vec![(term, Vec::new())],
            stays: true,
        }
    }

    /// Whether a term explains what the signal shows, by itself or in place of what it names.
    fn is_met_by(&self, other: &Term) -> bool {
        let alike = |term: &Term| term.label() == other.label() || term.is_confused_with(other);
        let own = self.terms.iter();
        own.filter(|(term, _)| term.joint == other.joint)
            .any(|(term, _)| alike(term))
    }

    fn names(&self, label: &str) -> bool {
        self.terms.iter().any(|(term, _)| term.label() == label)
    }
}

/// Whether a term of this label stays.
pub(super) fn stays(shown: &[Shown], label: &str) -> bool {
    shown.iter().any(|s| s.stays && s.names(label))
}

/// What the signals of a case show that its description lacks; the parameters lie `theta` half
/// tolerances from their nominal values.
pub(super) fn shown(case: &Case, theta: &[f64], settings: &Settings) -> Vec<Shown> {
    let term = |id: &str, joint: usize| {
        let mut all = settings.effects.iter();
        let effect = all.find(|e| e.info().id == id)?.clone();
        let unknown = case.known.parameters(id, joint).is_none();
        unknown.then_some(Term { effect, joint })
    };
    let readings = late_readings(case).into_iter();
    let readings = readings.filter_map(|j| Some(vec![(term(LAG_OF_VELOCITY, j)?, Vec::new())]));
    let readings = readings.map(|terms| Shown { terms, stays: true });
    let inputs = late_inputs(case, theta).into_iter().map(|(j, timing)| {
        let kinds = kinds(&timing, settings.criteria.replaces()).into_iter();
        let terms = kinds.filter_map(|(id, start)| Some((term(id, j)?, vec![start])));
        Shown {
            terms: terms.collect(),
            stays: false,
        }
    });
    let all = readings.chain(inputs);
    all.filter(|s| !s.terms.is_empty()).collect()
}

/// Effects that make an input late in the way found, with their starts; those of a shift and of a lag
/// where neither is more likely by `replaces`.
fn kinds(timing: &Alignment, replaces: f64) -> Vec<(&'static str, f64)> {
    let shift = [DELAY_OF_INPUT, DELAY_OF_POSITION].map(|id| (id, timing.delay));
    let lag = timing.lag.map(|lag| (LAG_OF_INPUT, lag.time_constant));
    match timing.lag {
        Some(other) if other.for_shift < -replaces => lag.into_iter().collect(),
        Some(other) if other.for_shift < replaces => shift.into_iter().chain(lag).collect(),
        _ => shift.to_vec(),
    }
}

/// Takes what the signals show and is not taken yet; the rounds that took one.
pub(super) fn take_shown(
    now: &mut Stand,
    taken: &mut Vec<(Refit, f64)>,
    shown: &[Shown],
    settings: &Settings,
    sensors: &[(f64, f64)],
) -> Vec<Round> {
    let mut rounds = Vec::new();
    for one in shown {
        if taken.iter().any(|(r, _)| one.is_met_by(&r.term)) {
            continue;
        }
        let starts = |term: &Term| {
            let own = one.terms.iter().filter(|(t, _)| t.label() == term.label());
            own.map(|(_, start)| start.clone())
                .filter(|start| !start.is_empty())
                .collect()
        };
        let asked = Asked {
            only: &|term| one.names(&term.label()),
            starts: &starts,
            shown: true,
        };
        let (mut tried, own, pays) = round(now, settings, sensors, &asked);
        if let Some((i, next)) = pays {
            *now = next;
            taken.push((tried.swap_remove(i), 1.0));
            rounds.push(own);
        }
    }
    rounds
}
