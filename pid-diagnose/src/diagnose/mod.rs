//! From a case to a verdict.
//!
//! The nominal structure is fitted within its tolerances; all effects at all joints are screened on top; the best are refitted in
//! full and ranked by their objective with a penalty per parameter; a second effect is looked for on top of the first. An effect is
//! named only if it gains more than chance and multiplicity allow, on the train records and on records never fitted.

mod backward;
mod beyond;
mod exchange;
mod magnitude;
mod refit;
mod remainder;
mod residue;
mod verdict;

use std::collections::BTreeSet;
use std::sync::Arc;

use pid_runtime::data::Role;
use serde::{Deserialize, Serialize};

use crate::case::Case;
use crate::effect::{Effect, Kind, Term};
use crate::fit::{Basis, Effort, Fit, Point, basis, basis_beside, fit, value};
use crate::gap::{Floor, Gap, floor, gap};
use crate::noise;
use crate::plant::PER_JOINT;
use crate::report::{Next, Share};
use crate::screen::{candidates, screen};
use crate::simulate::Hypothesis;
use crate::thin::{lengthen, thin};
use crate::windows;
use backward::backward;
use exchange::exchange;
use magnitude::{size_in_deviations, sizes};
use refit::{Refit, refit};
pub use residue::Residue;
use residue::residue;
use verdict::{Parts, lagging_velocity};

/// Version of the JSON form.
pub const SCHEMA_VERSION: u32 = 1;

/// Relative decrease of the objective with which an effect is kept for a further round although the gap does not shrink yet.
const PROVISIONAL: f64 = 0.1;
/// Score, in margins, with which it is kept where the noise levels are not stated.
const STRONG: f64 = 20.0;
/// Gain on motions never fitted, in margins, with which it is taken if only the gap does not grow.
const BEYOND_DOUBT: f64 = 10.0;
/// Gap over floor below which nothing is left to look for.
const NEAR: f64 = 1.4;
/// Share by which a second effect must shrink the gap to be told by free runs alone: a slow one may leave the innovations white.
const DRIFT: f64 = 0.3;
/// Mean squared innovation below which no further effect is looked for.
const EXPLAINED: f64 = 1.1;

/// What may be set.
#[derive(Clone)]
pub struct Settings {
    /// The effects considered; [`effects::all`](crate::effects::all) and the user's own.
    pub effects: Vec<Arc<dyn Effect>>,
    /// How many candidates are refitted in full.
    pub refits: usize,
    /// Whether every candidate is refitted to its end, whatever screening says of it: what screening is measured against.
    pub refit_all: bool,
    /// Steps of a refit at most.
    pub steps: usize,
    /// Most effects named together.
    pub most: usize,
    /// Gain of twice the log-likelihood beyond the penalty that an effect must reach.
    pub margin: f64,
    /// Share by which the gap on the test records must shrink.
    pub least_shrink: f64,
    /// Size that an effect must reach, in its own standard deviations (A. Wald 1943): an observer with more freedom may predict
    /// a little better without any effect of a size.
    pub least_size: f64,
    /// A gap this many times the floor is not explained.
    pub unexplained: f64,
    /// Mean squared innovations beyond this figure are not explained.
    pub largest_misfit: f64,
    /// Length of the train records that is fitted, s times the number of joints, and twice that of the test records that it is
    /// judged by; the parts that decide are taken from longer ones (see [`thin`](crate::thin)).
    pub joint_seconds: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            effects: crate::effects::all(),
            refits: 7,
            refit_all: false,
            steps: 14,
            most: 2,
            margin: 12.0,
            least_shrink: 0.06,
            least_size: 3.0,
            unexplained: 1.9,
            largest_misfit: 1.6,
            joint_seconds: 150.0,
        }
    }
}

/// A parameter of a named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Magnitude {
    /// Name.
    pub name: String,
    /// Value, SI units.
    pub value: f64,
    /// Standard deviation; `None` if the records do not determine it.
    pub std: Option<f64>,
}

/// A named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Identifier.
    pub effect: String,
    /// Joint from 1.
    pub joint: Option<usize>,
    /// Magnitudes.
    pub parameters: Vec<Magnitude>,
    /// Where it shows.
    pub regime: String,
}

/// A line of the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ranked {
    /// Identifier.
    pub effect: String,
    /// Joint from 1.
    pub joint: Option<usize>,
    /// Twice the gain in log-likelihood over the nominal structure, less the penalty.
    pub score: f64,
    /// Posterior probability among the refitted candidates.
    pub probability: f64,
}

impl Ranked {
    /// `effect` or `effect:joint`.
    pub fn label(&self) -> String {
        self.joint
            .map_or(self.effect.clone(), |j| format!("{}:{j}", self.effect))
    }
}

/// What is left beside the named effects where no verdict explains the records down to their noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Remainder {
    /// Share of the squared gap beyond the floor that the named effects explain on the test records.
    pub explained: f64,
    /// Where the force lives that is still missing beside them; empty if it was not looked for.
    pub missing_force: Vec<Share>,
}

/// A nominal value outside its stated tolerance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Beyond {
    /// Name, one of [`plant::NAMES`](crate::plant::NAMES).
    pub parameter: String,
    /// Joint from 1.
    pub joint: usize,
    /// Unit of the values.
    pub unit: String,
    /// As stated.
    pub stated: f64,
    /// Its tolerance.
    pub tolerance: f64,
    /// As found.
    pub value: f64,
    /// Standard deviation; `None` if the records do not determine it.
    pub std: Option<f64>,
}

impl Beyond {
    /// In words: which value, as found and as stated.
    pub fn words(&self) -> String {
        let std = self.std.map_or(String::new(), |s| format!(" ± {s:.1e}"));
        format!(
            "{} friction of joint {} {:.4}{std} {} (stated {:.4} ± {:.4})",
            self.parameter, self.joint, self.value, self.unit, self.stated, self.tolerance
        )
    }
}

/// The verdict and what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Data set.
    pub case: String,
    /// The first effect, `none` or `unknown`.
    pub effect: String,
    /// Its joint from 1.
    pub joint: Option<usize>,
    /// All named effects.
    pub effects: Vec<Named>,
    /// Gap of the nominal structure within its tolerances, test records.
    pub gap_before: f64,
    /// Gap with the named effects.
    pub gap_after: f64,
    /// Interval of 95 % of the gap before and after, from the windows of the test records.
    pub gap_intervals: ((f64, f64), (f64, f64)),
    /// What noise alone leaves.
    pub gap_floor: f64,
    /// Gap per joint after: position, velocity.
    pub gap_joints: Vec<(f64, Option<f64>)>,
    /// The same before.
    #[serde(default)]
    pub gap_joints_before: Vec<(f64, Option<f64>)>,
    /// Where the missing force of the nominal structure lives, joint by joint; empty if it was not looked for.
    #[serde(default)]
    pub missing_force: Vec<Share>,
    /// The motion that would separate the rivals that are left, if there are any and it was looked for.
    #[serde(default)]
    pub next_experiment: Option<Next>,
    /// What is left beside the named effects; absent where the records are explained down to their noise.
    #[serde(default)]
    pub remainder: Option<Remainder>,
    /// Friction outside its tolerance, without which no effect would explain the records.
    #[serde(default)]
    pub beyond_tolerance: Vec<Beyond>,
    /// Candidates, best first.
    pub ranking: Vec<Ranked>,
    /// Stated probability that the verdict is right.
    pub confidence: f64,
    /// Effects that the records cannot tell from the named one.
    pub confusion_set: Vec<String>,
    /// Where the effect shows.
    pub regime: String,
    /// Mean squared innovation of the nominal structure and of the verdict; 1 where the noise is as stated.
    pub misfit: (f64, f64),
    /// What the verdict's model leaves.
    #[serde(default)]
    pub residue: Residue,
    /// Processor-independent effort: refits made.
    pub refits: usize,
    /// Time, s.
    pub seconds: f64,
}

impl Diagnosis {
    /// As JSON, indented.
    pub fn to_json(&self) -> String {
        // Only numbers, texts and lists: writing to memory cannot fail.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

/// A diagnosis with the fits it rests on.
#[derive(Debug, Clone)]
pub struct Found {
    /// The case; noise levels that were not stated as they were found.
    pub case: Case,
    /// What is said.
    pub diagnosis: Diagnosis,
    /// The nominal structure within its tolerances.
    pub base: Fit,
    /// With the named effects.
    pub fit: Fit,
    /// Refitted candidates, best first: each beside those named before it.
    pub rivals: Vec<Fit>,
}

/// Diagnoses a case.
pub fn diagnose(case: &Case, settings: &Settings) -> Diagnosis {
    investigate(case, settings).diagnosis
}

/// Mean squared innovation of a joint on test records over that on train records above which something shows there alone.
const UNSEEN: f64 = 1.5;

/// Diagnoses a case and keeps the fits.
///
/// A cause that no train record brings out (a drive that reaches its limit on a test record only) cannot be found by a fit to
/// train records. Where the nominal structure follows these and not the test records, the test record it follows least is fitted
/// too, and the gap is that of the test records left; the verdict's regime says so.
pub fn investigate(case: &Case, settings: &Settings) -> Found {
    let mut found = decide(&thin(case, settings.joint_seconds), settings);
    let fits = [&mut found.base, &mut found.fit].into_iter();
    if lengthen(case, &mut found.case, fits.chain(&mut found.rivals)) {
        let (own, d) = (&found.case, &mut found.diagnosis);
        let (before, after) = (measured(own, &found.base), measured(own, &found.fit));
        (d.gap_before, d.gap_after) = (before.total, after.total);
        d.gap_intervals = (before.interval(), after.interval());
        (d.gap_joints_before, d.gap_joints) = (before.joints, after.joints);
        if d.remainder.is_none() {
            // Otherwise the levels are those of the model's errors.
            d.gap_floor = noise_alone(own, &found.fit).typical;
        }
    }
    found
}

/// The verdict on records of a length that can be searched.
fn decide(case: &Case, settings: &Settings) -> Found {
    let found = once(case, settings);
    let d = &found.diagnosis;
    let unexplained = d.effects.is_empty() || d.remainder.is_some();
    let followed = unexplained && d.misfit.1 < settings.largest_misfit;
    if !followed || d.residue.unseen < UNSEEN {
        return found;
    }
    let tests: Vec<usize> = (0..case.records.len())
        .filter(|&i| case.records[i].role == Role::Test)
        .collect();
    let misfit = |i: usize| {
        let mut alone = case.clone();
        for (k, r) in alone.records.iter_mut().enumerate() {
            r.role = if k == i { Role::Test } else { Role::Train };
        }
        let v = value(
            &alone,
            &found.base.hypothesis,
            &found.base.point,
            &found.base.gains,
            Role::Test,
        );
        v.total() / v.number().max(1.0)
    };
    let worst = tests
        .iter()
        .copied()
        .max_by(|&a, &b| misfit(a).total_cmp(&misfit(b)));
    let Some(worst) = worst.filter(|_| tests.len() > 1) else {
        return found;
    };
    let mut wider = case.clone();
    wider.records[worst].role = Role::Train;
    let mut again = once(&wider, settings);
    if again.diagnosis.effects.is_empty() || again.diagnosis.effect == "unknown" {
        return found;
    }
    let d = &mut again.diagnosis;
    d.regime = format!(
        "{}; no train record shows it: `{}` was fitted too",
        d.regime, case.records[worst].name
    );
    d.gap_before = found.diagnosis.gap_before;
    again
}

/// One investigation with the roles as they are: within the tolerances, with friction outside them, and for what the library
/// explains only in part.
fn once(case: &Case, settings: &Settings) -> Found {
    let clock = std::time::Instant::now();
    let found = search(case, settings);
    if found.diagnosis.effect != "unknown" {
        return found;
    }
    let wider = beyond::wider(case, settings, &found);
    let (mut found, stated) = match wider {
        Some(wider) => (wider, Some(found)),
        None => (found, None),
    };
    if found.diagnosis.effect == "unknown" {
        let floor = found.diagnosis.gap_floor;
        let partial = remainder::partial(&found.case, settings, &found.base, floor);
        partial.describe(&mut found.diagnosis);
        found.base = partial.base;
        found.fit = partial.fit;
        found.rivals = partial.ranking.into_iter().map(|r| r.fit).collect();
        found.case = partial.case;
    }
    if let Some(stated) = stated {
        beyond::describe(stated, &mut found);
    }
    found.diagnosis.seconds = clock.elapsed().as_secs_f64();
    found
}

/// Forward selection with a backward check, within the tolerances of a case.
fn search(case: &Case, settings: &Settings) -> Found {
    let clock = std::time::Instant::now();
    let mut case = case.clone();
    let mut basis = basis(&case);
    let nothing = Hypothesis::default();
    let start = Point {
        theta: vec![0.0; case.n() * PER_JOINT],
        e: Vec::new(),
    };
    let mut base = fit(&case, &basis, &nothing, start, Effort::full(settings.steps));
    let mut shortlist: Option<BTreeSet<String>> = None;
    if noise::settle(&mut case, &base) {
        base = again(&case, &basis, &base);
        // What the nominal structure leaves is not all noise: the level is that of the most promising candidate.
        let (better, short) = sketch(&case, &basis, settings, &base);
        if let Some(better) = better {
            noise::settle(&mut case, &better);
            base = again(&case, &basis, &base);
            if !settings.refit_all {
                shortlist = Some(short);
            }
        }
    }
    let before = measured(&case, &base);
    let mut current = base.clone();
    let mut current_gap = before.clone();
    let mut ranking: Vec<Refit> = Vec::new();
    let mut refits = 0;
    let mut accepted: Vec<Term> = Vec::new();
    let mut alone: Option<Fit> = None;
    let mut drifts = false;
    for round in 0..settings.most {
        let mut list = listed(&case, &basis, settings, &current);
        let number = list.len();
        if let Some(short) = shortlist.take() {
            list.retain(|(term, _)| short.contains(&term.label()));
        }
        let (best, slopes) = screen(&case, &basis, &current, &list);
        let tried = refit(&case, &basis, settings, &current, (&best, &slopes), number);
        refits += tried.len();
        let Some(first) = tried.first() else { break };
        let after = measured(&case, &first.fit);
        let held_out = test_value(&case, &current) - test_value(&case, &first.fit);
        let significant = first.score > settings.margin;
        let relative =
            (current.train.evidence() - first.fit.train.evidence()) / current.train.objective();
        let needed = if round == 0 {
            settings.least_shrink
        } else {
            2.0 * settings.least_shrink
        };
        let shrinks = after.total < (1.0 - needed) * current_gap.total;
        let enough = relative > if round == 0 { 0.002 } else { 0.03 }
            || (drifts && after.total < (1.0 - DRIFT) * current_gap.total);
        // One of two effects may hide behind the other in free runs: it is kept until the last round shows what both give.
        // Noise levels that were settled on one effect hide part of what the other does: there the score decides.
        let open = case.noise.iter().any(|n| !n.stated);
        let strong = relative > PROVISIONAL || (open && first.score > STRONG * settings.margin);
        let provisional = strong && round + 1 < settings.most;
        // Free runs scatter; predictions of motions never fitted are then beyond doubt.
        let beyond_doubt = relative > PROVISIONAL
            && held_out > BEYOND_DOUBT * settings.margin
            && after.total < current_gap.total;
        let take = significant
            && held_out > 0.0
            && enough
            && (shrinks || provisional || beyond_doubt)
            && size_in_deviations(&first.fit) > settings.least_size;
        if take {
            accepted.push(first.term.clone());
            current = first.fit.clone();
            current_gap = after;
            if first.term.effect.info().kind == Kind::State {
                basis = directions(&case, &current);
                current = fit(
                    &case,
                    &basis,
                    &current.hypothesis,
                    current.point.clone(),
                    Effort::full(settings.steps),
                );
                current_gap = measured(&case, &current);
            }
            if noise::settle(&mut case, &current) {
                current = again(&case, &basis, &current);
                current_gap = measured(&case, &current);
            }
            if accepted.len() == 1 {
                alone = Some(current.clone());
            }
        }
        if round == 0 {
            ranking = tried;
        } else if take {
            let mut tried = tried;
            let second = tried.remove(0);
            ranking.insert(1.min(ranking.len()), second);
        }
        // Nothing is left to look for where the innovations are as large as the noise, and free runs too.
        if !take {
            break;
        }
        drifts = current_gap.total > NEAR * noise_alone(&case, &current).typical;
        if !drifts && current.train.total() < EXPLAINED * current.train.number() {
            break;
        }
    }
    if accepted.len() > 1
        && let Some((kept, dropped)) = backward(&case, &basis, settings, &current)
    {
        current = kept;
        current_gap = measured(&case, &current);
        accepted.remove(dropped);
        ranking.remove(0);
    }
    if accepted.len() > 1
        && let Some(exchanged) = exchange(&case, &basis, settings, &current)
    {
        // The candidates for the first place are those beside the second effect now.
        let second = ranking.remove(1);
        current = exchanged.fit;
        current_gap = measured(&case, &current);
        accepted[0] = current.hypothesis.terms[0].clone();
        ranking = exchanged.tried;
        ranking.insert(1, second);
        refits += exchanged.refits;
        alone = None;
    }
    if let Some(first) = alone
        && accepted.len() > 1
        && without_size(&sizes(&case, &current), settings)
    {
        current = first;
        current_gap = measured(&case, &current);
        accepted.truncate(1);
        ranking.remove(1);
    }
    if current_gap.total > (1.0 - settings.least_shrink) * before.total {
        current = base.clone();
        accepted.clear();
    }
    // Contacts, resonances and bristles are stiff, and sticking within a step leaves an error of its own: the end of the fit has
    // finer substeps, if the likelihood agrees.
    let stiff = accepted.iter().any(|t| t.effect.info().kind == Kind::State);
    let misfit = current.train.total() / current.train.number();
    if stiff || (misfit < settings.largest_misfit && !verdict::white(&residue(&case, &current))) {
        case.refined = FINER;
        case.unread = stiff;
        let finer = again(&case, &basis, &current);
        if finer.train.evidence() < current.train.evidence() {
            current = finer;
            if accepted.is_empty() {
                base = current.clone();
            }
        } else {
            (case.refined, case.unread) = (1, false);
        }
    }
    base.train = value(&case, &nothing, &base.point, &base.gains, Role::Train);
    let lagging = lagging_velocity(&case, settings);
    let parts = Parts {
        case: &case,
        settings,
        base: &base,
        before: &before,
        ranking: &ranking,
        accepted: &accepted,
        lagging,
        refits,
        clock,
    };
    let (diagnosis, fit) = parts.verdict(current);
    Found {
        diagnosis,
        base,
        fit,
        rivals: ranking.into_iter().map(|r| r.fit).collect(),
        case,
    }
}

/// Size, in its own deviations, below which a second effect is chance even beside a first one that has a size.
const CHANCE: f64 = 2.0;

/// Whether the second of two effects is none, by the [`sizes`] of both beside each other: two that are both small imitate together
/// what the library lacks, and a second one may take up what the smooth form of a contact leaves.
fn without_size(sizes: &[f64], settings: &Settings) -> bool {
    let [first, second, ..] = *sizes else {
        return false;
    };
    second < CHANCE || first.max(second) < settings.least_size
}

/// All candidates on top of a fit, with their starts.
fn listed(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    current: &Fit,
) -> Vec<(Term, Vec<Vec<f64>>)> {
    let mut list = candidates(case, &settings.effects, &current.hypothesis);
    for (term, starts) in &mut list {
        starts.extend(windows::starts(case, basis, current, term));
    }
    list
}

/// Factor on the substeps at the end of a fit with states.
const FINER: usize = 3;

/// Steps that follow a change of the noise levels.
const TOUCH: usize = 4;

/// The same hypothesis under the noise levels as they are now.
fn again(case: &Case, basis: &Basis, at: &Fit) -> Fit {
    fit(
        case,
        basis,
        &at.hypothesis,
        at.point.clone(),
        Effort::full(TOUCH),
    )
}

/// Directions of the nominal parameters that the records determine: a gear that gives way shows more of them.
fn directions(case: &Case, fit: &Fit) -> Basis {
    let states = |t: &Term| t.effect.info().kind == Kind::State;
    if fit.hypothesis.terms.iter().any(states) {
        basis_beside(case, &fit.hypothesis, &fit.point)
    } else {
        basis(case)
    }
}

/// Candidates of a sketch.
const SKETCHED: usize = 4;

/// Candidates that a sketch leaves for the first round.
const SHORT: usize = 12;

/// The most likely of the best candidates after a few steps, `None` if none gains beyond its penalty; and those that are worth
/// screening again under the noise levels that follow from it.
fn sketch(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    base: &Fit,
) -> (Option<Fit>, BTreeSet<String>) {
    let list = listed(case, basis, settings, base);
    let (best, slopes) = screen(case, basis, base, &list);
    let short = best.iter().take(SHORT).map(|c| c.term.label()).collect();
    let few = Settings {
        refits: SKETCHED,
        ..settings.clone()
    };
    let tried = refit(case, basis, &few, base, (&best, &slopes), list.len());
    let first = tried.into_iter().next();
    let better = first.filter(|f| f.score > settings.margin).map(|f| f.fit);
    (better, short)
}

/// The gap that noise alone leaves on the test records.
fn noise_alone(case: &Case, fit: &Fit) -> Floor {
    floor(
        case,
        &fit.hypothesis,
        &fit.point.theta,
        &fit.point.e,
        Role::Test,
    )
}

fn measured(case: &Case, fit: &Fit) -> Gap {
    gap(
        case,
        &fit.hypothesis,
        &fit.point.theta,
        &fit.point.e,
        Role::Test,
    )
}

fn test_value(case: &Case, fit: &Fit) -> f64 {
    value(case, &fit.hypothesis, &fit.point, &fit.gains, Role::Test).surprise()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_effect_needs_a_size_of_its_own() {
        let none = |sizes: &[f64]| without_size(sizes, &Settings::default());
        // Beside a backlash, what its smooth form leaves.
        assert!(none(&[40.0, 1.6]));
        // Two that imitate a third together.
        assert!(none(&[2.4, 2.8]));
        assert!(!none(&[2.4, 9.0]) && !none(&[40.0, 2.4]));
        assert!(!none(&[1.0]) && !none(&[]));
    }
}
