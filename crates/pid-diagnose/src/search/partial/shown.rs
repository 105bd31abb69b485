//! Delays and lags that a signal shows by itself.
//!
//! A velocity that follows late from the positions of its own joint needs no model of the robot to be
//! seen, and an input that acts late needs hardly any; no place is chosen among many. So they come
//! before every round, without the margin for many candidates and without a share of free runs: each
//! must predict motions never fitted better, and free runs must not grow. Where a larger effect hides
//! one, it comes after that. A lag of a velocity stays beside every effect that is taken later; an input
//! that acts late can be one that shows late, or a slow drive.

use super::{Asked, round};
use crate::case::Case;
use crate::channel::{late_inputs, late_readings};
use crate::diagnosis::Round;
use crate::effect::{Effect, Term, Unit};
use crate::search::refit::Refit;
use crate::search::settings::Settings;
use crate::search::stand::Stand;
use crate::timing::Alignment;

/// What an effect of a signal does with its one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Late {
    /// A velocity reading lags.
    Velocity,
    /// The input acts, or the joint shows, a time later.
    Shift,
    /// The input acts by a lag.
    Lag,
}

/// What makes a signal late by one time, if an effect does that.
fn late(effect: &dyn Effect) -> Option<Late> {
    let [time] = effect.info().parameters else {
        return None;
    };
    if time.unit != Unit::Time {
        return None;
    }
    let (law, some) = (effect.plain(), [1.0]);
    Some(if law.velocity_lag(&some).is_some() {
        Late::Velocity
    } else if effect.memory() > 0 {
        Late::Lag
    } else {
        Late::Shift
    })
}

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
    let terms = |joint: usize, kind: Late, start: Option<f64>| {
        let all = settings.effects.iter();
        let own = all.filter(move |e| {
            let known = case.known.parameters(e.info().id, joint).is_some();
            late(&***e) == Some(kind) && !known
        });
        own.map(move |effect| {
            let effect = effect.clone();
            (Term { effect, joint }, Vec::from_iter(start))
        })
    };
    let readings = late_readings(case).into_iter().map(|j| Shown {
        terms: terms(j, Late::Velocity, None).collect(),
        stays: true,
    });
    let inputs = late_inputs(case, theta).into_iter().map(|(j, timing)| {
        let kinds = kinds(&timing, settings.criteria.replaces()).into_iter();
        Shown {
            terms: kinds
                .flat_map(|(kind, start)| terms(j, kind, Some(start)))
                .collect(),
            stays: false,
        }
    });
    let all = readings.chain(inputs);
    all.filter(|s| !s.terms.is_empty()).collect()
}

/// What makes an input late in the way found, with its time; a shift and a lag where neither is more
/// likely by `replaces`.
fn kinds(timing: &Alignment, replaces: f64) -> Vec<(Late, f64)> {
    let shift = (Late::Shift, timing.delay);
    match timing
        .lag
        .map(|lag| (lag.for_shift, (Late::Lag, lag.time_constant)))
    {
        Some((for_shift, lag)) if for_shift < -replaces => vec![lag],
        Some((for_shift, lag)) if for_shift < replaces => vec![shift, lag],
        _ => vec![shift],
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
