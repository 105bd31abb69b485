//! From a case to a verdict.
//!
//! The nominal structure is fitted within its tolerances; all effects at all joints are screened on
//! top; the best are refitted in full and ranked by their objective with a penalty per parameter; a
//! second effect is looked for on top of the first. An effect is named only if it gains more than
//! chance and multiplicity allow, on the train records and on records never fitted.
//!
//! [`search`] is the whole procedure in five phases. It returns [`Evidence`];
//! [`Evidence::diagnosis`] makes the diagnosis of it.

mod backward;
mod candidates;
mod evidence;
mod exchange;
mod forward;
mod intervals;
mod lagging;
mod loops;
mod magnitude;
mod measure;
mod nameless;
mod noise_like;
mod odds;
mod partial;
mod refit;
mod settings;
mod shares;
mod shorter;
mod spread;
mod stand;
mod tolerance;
mod watch;
mod whiteness;

use std::time::Instant;

use pid_data::Role;

use crate::case::Case;
use crate::diagnosis::Diagnosis;
use crate::excerpt::{excerpt, restore_tests};
use crate::first;
use crate::fit::{Fit, value};
use crate::levels::{SHORT, WHOLE};
use crate::servo;
pub(crate) use candidates::directions;
pub use evidence::{Evidence, Surroundings};
pub(crate) use intervals::intervals;
pub(crate) use measure::share;
use measure::{measured, noise_alone};
pub use settings::Settings;
pub use watch::{Listener, Watch};

/// Searches at most that follow one that ran against the range of an unknown gain: each reaches 3.6 times as far.
const MOVES: usize = 2;

/// Diagnoses a case.
pub fn diagnose(case: &Case, settings: &Settings) -> Diagnosis {
    search(case, settings).diagnosis(Surroundings::default())
}

/// Searches a case for its cause.
pub fn search(case: &Case, settings: &Settings) -> Evidence {
    // Of long records the parts that decide.
    let short = excerpt(case, settings.joint_seconds);
    let begun = first::by_free_runs(case, &short);
    let read = case;
    let (case, short) = match &begun {
        Some(begun) => (begun, excerpt(begun, settings.joint_seconds)),
        None => (case, short),
    };
    let mut short = servo::centred(&short).unwrap_or(short);
    let mut evidence = explain(&short, settings);
    // With the effects a gain that is not stated may lie elsewhere than without.
    for _ in 0..MOVES {
        if settings.watch.stopped() {
            break;
        }
        let Some(moved) = servo::recentred(&short, &evidence.fit.point.theta) else {
            break;
        };
        short = moved;
        evidence = explain(&short, settings);
    }
    let mut evidence = with_a_test_record(&short, settings, evidence);
    evidence.stopped = settings.watch.stopped();
    let case = Case {
        nominal: short.nominal,
        ..case.clone()
    };
    let evidence = on_whole_records(&case, evidence);
    let evidence = match begun {
        Some(_) => from_its_own_starts(read, evidence),
        None => evidence,
    };
    shares::with_shares(evidence, settings)
}

/// A search for effects that explain the records.
enum Whole {
    /// They do.
    Explained(Evidence),
    /// They do not within the tolerances, nor with friction outside its own where that was tried.
    Unexplained {
        stated: Evidence,
        wider: Option<Box<Evidence>>,
    },
}

/// Effects within the tolerances; where none explains the records, gains of position loops outside their
/// tolerance, then friction.
fn whole(case: &Case, settings: &Settings) -> Whole {
    let started = Instant::now();
    let select = |case: &Case| {
        let selection = forward::select(case, settings);
        Evidence::of_selection(selection, &settings.criteria, started)
    };
    let stated = select(case);
    if !stated.unexplained || stated.remainder.is_some() || settings.watch.stopped() {
        return Whole::Explained(stated);
    }
    settings
        .watch
        .step("gains and friction outside their tolerance");
    let gains = tolerance::other_gains(case, settings, &stated).map(|wide| select(&wide));
    if let Some(mut wider) = gains.filter(|wider| !wider.unexplained) {
        wider.refits += stated.refits;
        return Whole::Explained(tolerance::beyond(stated, wider, settings));
    }
    let wider = tolerance::widened(case, settings, &stated).map(|wide| select(&wide));
    match wider {
        Some(mut wider) if !wider.unexplained => {
            wider.refits += stated.refits;
            Whole::Explained(tolerance::beyond(stated, wider, settings))
        }
        wider => Whole::Unexplained {
            stated,
            wider: wider.map(Box::new),
        },
    }
}

/// What explains the records, or what effects explain in part, within the tolerances or outside them.
fn explain(case: &Case, settings: &Settings) -> Evidence {
    let (mut stated, wider) = match whole(case, settings) {
        Whole::Explained(evidence) => {
            let selected = evidence.case.clone();
            return partial::with_law(evidence, &selected, settings);
        }
        Whole::Unexplained { stated, wider } => (stated, wider),
    };
    let selected = stated.case.clone();
    let Some(mut wider) = wider else {
        let within = partial::add_part(stated, settings, SHORT, Some(WHOLE));
        return partial::with_law(within, &selected, settings);
    };
    wider.refits += stated.refits;
    stated.refits = wider.refits;
    let within = partial::add_part(stated.clone(), settings, SHORT, Some(WHOLE));
    // Nothing is left that other friction could explain.
    let left = within.part.map_or(f64::INFINITY, |part| part.left);
    if within.coloured || left < settings.criteria.near {
        return within;
    }
    // Other friction imitates laws of friction: it has to leave less than what the library explains
    // within the tolerances.
    wider.refits = within.refits;
    let freed = wider.case.clone();
    let wider = partial::add_part(*wider, settings, within.case.ahead, None);
    let shrunk = (1.0 - settings.criteria.least_shrink) * within.after.total;
    if wider.after.total < shrunk {
        let wider = partial::with_law(wider, &freed, settings);
        return tolerance::beyond(stated, wider, settings);
    }
    let within = Evidence {
        refits: wider.refits,
        ..within
    };
    partial::with_law(within, &selected, settings)
}

/// The evidence with a test record among those that are fitted, where that gives a verdict that
/// train records do not.
///
/// A cause that no train record brings out (a drive that reaches its limit on a test record only)
/// cannot be found by a fit to train records. Where the nominal structure follows these and not the
/// test records, the test record it follows least is fitted too, and the gap is that of the test
/// records left; the verdict's regime says so.
fn with_a_test_record(case: &Case, settings: &Settings, evidence: Evidence) -> Evidence {
    let criteria = &settings.criteria;
    let named = |e: &Evidence| !e.effects.is_empty() || e.verdict().is_outside_tolerance();
    let explained = |e: &Evidence| named(e) && e.remainder.is_none();
    let followed = !explained(&evidence) && evidence.misfit.1 < criteria.largest_misfit;
    if !followed || evidence.residue.unseen < criteria.unseen {
        return evidence;
    }
    let tests: Vec<usize> = (0..case.records.len())
        .filter(|&i| case.records[i].role == Role::Test)
        .collect();
    let worst = tests.iter().copied().max_by(|&a, &b| {
        let misfit = |i| misfit_of_record(case, &evidence.base, i);
        misfit(a).total_cmp(&misfit(b))
    });
    let Some(worst) = worst.filter(|_| tests.len() > 1 && !settings.watch.stopped()) else {
        return evidence;
    };
    let mut wider = case.clone();
    wider.records[worst].role = Role::Train;
    // What no train record shows and the library explains only in part is no verdict.
    let mut again = match whole(&wider, settings) {
        Whole::Explained(again) if explained(&again) => again,
        _ => return evidence,
    };
    again.promoted = Some(case.records[worst].name.clone());
    again.before.total = evidence.before.total;
    again
}

/// Mean squared innovation of a fit on one record.
fn misfit_of_record(case: &Case, fit: &Fit, record: usize) -> f64 {
    let mut alone = case.clone();
    for (k, r) in alone.records.iter_mut().enumerate() {
        r.role = if k == record { Role::Test } else { Role::Train };
    }
    let v = value(&alone, &fit.hypothesis, &fit.point, &fit.gains, Role::Test);
    v.total() / v.number().max(1.0)
}

/// Gaps of models that start records which begin in motion as each of them has it; a simulation of what is found
/// starts them so.
fn from_its_own_starts(read: &Case, mut e: Evidence) -> Evidence {
    let base = first::under(read, e.case.clone(), first::Model::of(&e.base));
    e.before = measured(&base, &e.base);
    e.case = first::under(read, e.case, first::Model::of(&e.fit));
    e.after = measured(&e.case, &e.fit);
    e
}

/// The gaps on the whole test records, where parts of them were looked at so far.
fn on_whole_records(case: &Case, mut evidence: Evidence) -> Evidence {
    let e = &mut evidence;
    let fits = [&mut e.base, &mut e.fit].into_iter();
    let fits = fits.chain(e.without_law.as_deref_mut());
    if restore_tests(case, &mut e.case, fits.chain(&mut e.rivals)) {
        e.before = measured(&e.case, &e.base);
        e.after = measured(&e.case, &e.fit);
        let law = e.remainder.as_mut().and_then(|r| r.law.as_mut());
        if let (Some(law), Some(without)) = (law, &e.without_law) {
            let without = measured(&e.case, without);
            let own = shares::beyond(&e.before, &without, &e.after, e.floor);
            (law.share, law.share_interval) = (own.share, own.interval);
            law.gap_without = without.total;
        }
        if e.part.is_none() {
            // Otherwise the levels are those of the model's errors.
            e.floor = noise_alone(&e.case, &e.fit).typical;
        }
    }
    evidence
}
