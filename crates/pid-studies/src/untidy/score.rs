//! What a diagnosis names of an untidy case.

use pid_diagnose::diagnosis::{Magnitude, Named};
use pid_withheld::{Cause, Kind, UntidyTruth};
use serde::{Deserialize, Serialize};

use crate::withheld::score::same_map;
use crate::withheld::{Outcome, Share};

/// A true or a named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Identifier; `unknown` for a cause outside the list.
    pub effect: String,
    /// Joint from 1; `None` for an effect of the whole robot.
    pub joint: Option<usize>,
    /// Share of the squared gap beyond the floor: the true one, or that of the diagnosis.
    pub share: Option<f64>,
    /// The place of its partner among the named or the true ones; `None`: missed, or wrong.
    pub partner: Option<usize>,
}

impl Effect {
    /// `effect` or `effect:joint`, with its share.
    pub fn words(&self) -> String {
        let joint = self.joint.map_or(String::new(), |j| format!(":{j}"));
        let share = self.share.map_or(String::new(), |s| format!("({s:.2})"));
        format!("{}{joint}{share}", self.effect)
    }

    /// Whether a diagnosis can name it.
    pub fn listed(&self) -> bool {
        self.effect != "unknown"
    }
}

/// One case with its score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The case.
    pub id: String,
    /// See [`UntidyTruth::tier`].
    pub tier: String,
    /// Joints of the robot.
    pub joints: usize,
    /// Readings per second.
    pub rate: f64,
    /// What is hidden.
    pub hidden: Vec<Effect>,
    /// What is named.
    pub named: Vec<Effect>,
    /// How much of the gap has a name, in words.
    pub verdict: String,
    /// Gap of the diagnosis before and after, and its floor.
    pub gap: [f64; 3],
    /// The study's own gap without the causes, and its floor.
    pub own: [f64; 2],
    /// Intervals of 95 % that hold the true value, of the rightly named effects.
    pub coverage: Share,
    /// The same for shares.
    #[serde(default)]
    pub share_coverage: Share,
    /// Time of the diagnosis, s.
    pub seconds: f64,
}

/// Scores one case.
pub fn row(outcome: &Outcome<UntidyTruth>) -> Row {
    let Outcome {
        id,
        truth: case,
        diagnosis,
    } = outcome;
    let (truth, causes) = (&case.truth, &case.truth.causes);
    let mut hidden: Vec<Effect> = (causes.iter().zip(&case.gaps.parts))
        .map(|(c, part)| Effect {
            effect: c.kind.id().to_owned(),
            joint: c.kind.has_joint().then_some(c.joint + 1),
            share: Some(part.share),
            partner: None,
        })
        .collect();
    let (mut coverage, mut share_coverage) = (Share::default(), Share::default());
    let named: Vec<Effect> = (diagnosis.effects.iter().enumerate())
        .map(|(k, e)| {
            // An effect by its own name rather than by that of an equal.
            let free = |i: &usize| hidden[*i].partner.is_none();
            let own = |i: &usize| is(&causes[*i], e);
            let equal = |i: &usize| same_map(truth, &causes[*i], &e.effect, e.joint);
            let all = || (0..causes.len()).filter(free);
            let partner = all().find(own).or_else(|| all().find(equal));
            if let Some(i) = partner {
                hidden[i].partner = Some(k);
                cover(&causes[i], e, &mut coverage);
                if let (Some((low, high)), Some(is)) = (e.share_interval, hidden[i].share) {
                    share_coverage.add(low <= is && is <= high);
                }
            }
            Effect {
                effect: e.effect.clone(),
                joint: e.joint,
                share: e.share,
                partner,
            }
        })
        .collect();
    Row {
        id: id.clone(),
        tier: case.tier().to_owned(),
        joints: truth.joints,
        rate: case.recording.rate,
        hidden,
        named,
        verdict: diagnosis.outcome().word().to_owned(),
        gap: [
            diagnosis.gap_before,
            diagnosis.gap_after,
            diagnosis.gap_floor,
        ],
        own: [case.gaps.none, case.gaps.all],
        coverage,
        share_coverage,
        seconds: diagnosis.seconds,
    }
}

/// Whether an effect is this very cause. A cable between the first two joints has two ends.
fn is(cause: &Cause, named: &Named) -> bool {
    let other_end = matches!(cause.kind, Kind::JointCoupling { .. })
        && cause.joint == 0
        && named.joint == Some(2);
    let here = !cause.kind.has_joint() || named.joint == Some(cause.joint + 1) || other_end;
    cause.kind.id() == named.effect && here
}

/// Counts the parameters of a cause that a diagnosis gives with a deviation.
fn cover(cause: &Cause, named: &Named, coverage: &mut Share) {
    if !is(cause, named) {
        return;
    }
    for (name, value) in cause.kind.parameters() {
        let mut found = named.parameters.iter().filter(|p| p.name == name);
        if let Some(Magnitude {
            value: estimate,
            std: Some(std),
            ..
        }) = found.next()
        {
            coverage.add((estimate - value).abs() <= 1.96 * std);
        }
    }
}
