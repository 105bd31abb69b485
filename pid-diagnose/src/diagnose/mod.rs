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
mod search;
mod unnamed;
mod verdict;

use std::sync::Arc;

use pid_runtime::data::Role;
use serde::{Deserialize, Serialize};

use crate::case::Case;
use crate::effect::Effect;
use crate::fit::{Fit, value};
use crate::gap::{Floor, Gap, floor, gap};
use crate::report::{Next, Share, Signals};
use crate::thin::{lengthen, thin};
pub use residue::Residue;
use search::search;
pub use unnamed::Nameless;

/// Version of the JSON form.
pub const SCHEMA_VERSION: u32 = 1;

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
    /// Whether intervals and scores count the model's own error, correlated as it is, in place of noise.
    #[serde(default = "counted")]
    pub own_error: bool,
    /// Where the force lives that is still missing beside them; empty if it was not looked for.
    pub missing_force: Vec<Share>,
    /// A law without a name, if one describes most of the gap, and better than the named effects.
    #[serde(default)]
    pub nameless: Option<Nameless>,
}

fn counted() -> bool {
    true
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
    /// Share of each joint and channel in the squared gap before: position, velocity; they add up to 1.
    #[serde(default)]
    pub gap_shares: Vec<(f64, Option<f64>)>,
    /// Where the missing force of the nominal structure lives, joint by joint; empty if it was not looked for.
    #[serde(default)]
    pub missing_force: Vec<Share>,
    /// When inputs act and readings show, joint by joint; empty if it was not looked for.
    #[serde(default)]
    pub signals: Vec<Signals>,
    /// What reading the records found odd, and iterations of the verdict's fit that ended at their limit.
    #[serde(default)]
    pub warnings: Vec<String>,
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
        if d.remainder.as_ref().is_none_or(|r| !r.own_error) {
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
    // What no train record shows and the library explains only in part is no verdict.
    if again.diagnosis.effects.is_empty() || again.diagnosis.remainder.is_some() {
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
    if found.diagnosis.effect != "unknown" || found.diagnosis.remainder.is_some() {
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
