//! What a diagnosis says: the verdict, the effects it names, and the figures it rests on.
//!
//! Nothing here is computed. [`Diagnosis`] is the form of `diagnosis.json`; the search fills it
//! once, from its evidence.

use serde::{Deserialize, Serialize};

pub use crate::beyond::Beyond;
use crate::channel::Reading;
use crate::effect::Class;
use crate::free::Form;
use crate::loop_gain::LoopGain;
use crate::timing::Alignment;

/// Version of the JSON form.
pub const SCHEMA_VERSION: u32 = 1;

/// The cause that is stated. In JSON the fields `effect` (one word) and `joint`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "Words", from = "Words")]
pub enum Verdict {
    /// The nominal structure within its tolerances leaves no more than noise. Word: `none`.
    Nothing,
    /// Effects of the library explain the records, or most of what the gap has beyond its floor
    /// (then [`Diagnosis::remainder`] says what is left). The first effect stands here, all of them
    /// in [`Diagnosis::effects`].
    Effect {
        /// Its identifier, which is its word.
        id: String,
        /// Its joint from 1; `None` for an effect of the whole robot.
        joint: Option<usize>,
    },
    /// Only friction is missing, outside its stated tolerance. Word: `friction`.
    OutsideTolerance {
        /// The first joint concerned, from 1.
        joint: usize,
    },
    /// Only the stated gains of a position loop are wrong, beyond their tolerance. Word: `servo_gain`.
    ServoGain {
        /// The first joint concerned, from 1.
        joint: usize,
    },
    /// Several effects together explain most of what the gap has beyond its floor, and none of them
    /// leads by itself; all stand in [`Diagnosis::effects`], the largest first. Word: `several`.
    Several,
    /// Something is missing that no effect of the library explains. Word: `unknown`.
    Unknown,
}

/// The verdict where the value is all that is wrong.
impl From<&Beyond> for Verdict {
    fn from(beyond: &Beyond) -> Self {
        let joint = beyond.joint;
        match beyond.is_gain() {
            true => Verdict::ServoGain { joint },
            false => Verdict::OutsideTolerance { joint },
        }
    }
}

impl Verdict {
    /// Word of [`Verdict::Nothing`].
    pub const NOTHING: &'static str = "none";
    /// Word of [`Verdict::OutsideTolerance`].
    pub const FRICTION: &'static str = "friction";
    /// Word of [`Verdict::ServoGain`].
    pub const SERVO_GAIN: &'static str = "servo_gain";
    /// Word of [`Verdict::Several`].
    pub const SEVERAL: &'static str = "several";
    /// Word of [`Verdict::Unknown`].
    pub const UNKNOWN: &'static str = "unknown";

    /// The verdict in one word, as in the field `effect` of `diagnosis.json`.
    pub fn word(&self) -> &str {
        match self {
            Verdict::Nothing => Self::NOTHING,
            Verdict::Effect { id, .. } => id,
            Verdict::OutsideTolerance { .. } => Self::FRICTION,
            Verdict::ServoGain { .. } => Self::SERVO_GAIN,
            Verdict::Several => Self::SEVERAL,
            Verdict::Unknown => Self::UNKNOWN,
        }
    }

    /// The joint that is blamed, from 1.
    pub fn joint(&self) -> Option<usize> {
        match self {
            Verdict::Effect { joint, .. } => *joint,
            Verdict::OutsideTolerance { joint } | Verdict::ServoGain { joint } => Some(*joint),
            Verdict::Nothing | Verdict::Several | Verdict::Unknown => None,
        }
    }

    /// Whether values that are stated, and no effect, are what is wrong.
    pub fn is_outside_tolerance(&self) -> bool {
        matches!(
            self,
            Verdict::OutsideTolerance { .. } | Verdict::ServoGain { .. }
        )
    }
}

/// How much of the gap has a name. In JSON the field `verdict`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// Nothing is missing.
    #[serde(rename = "none")]
    Nothing,
    /// One effect, or friction or gains of loops outside their tolerance.
    #[serde(rename = "one cause")]
    OneCause,
    /// Several effects together.
    #[serde(rename = "several")]
    Several,
    /// Effects have a share of the gap, and too much of it has no name.
    #[serde(rename = "partly unknown")]
    PartlyUnknown,
    /// Nothing that is missing has a name.
    #[serde(rename = "unknown")]
    Unknown,
}

impl Outcome {
    /// Of a verdict and the number of effects it names.
    pub fn of(verdict: &Verdict, effects: usize) -> Self {
        match verdict {
            Verdict::Nothing => Outcome::Nothing,
            Verdict::Unknown if effects == 0 => Outcome::Unknown,
            Verdict::Unknown => Outcome::PartlyUnknown,
            Verdict::Several => Outcome::Several,
            Verdict::Effect { .. } if effects > 1 => Outcome::Several,
            Verdict::Effect { .. }
            | Verdict::OutsideTolerance { .. }
            | Verdict::ServoGain { .. } => Outcome::OneCause,
        }
    }

    /// As in the field `verdict` of `diagnosis.json`.
    pub fn word(self) -> &'static str {
        match self {
            Outcome::Nothing => "none",
            Outcome::OneCause => "one cause",
            Outcome::Several => "several",
            Outcome::PartlyUnknown => "partly unknown",
            Outcome::Unknown => "unknown",
        }
    }
}

/// [`Verdict`] as two fields.
#[derive(Serialize, Deserialize)]
struct Words {
    effect: String,
    joint: Option<usize>,
}

impl From<Verdict> for Words {
    fn from(verdict: Verdict) -> Self {
        Words {
            effect: verdict.word().to_owned(),
            joint: verdict.joint(),
        }
    }
}

impl From<Words> for Verdict {
    fn from(Words { effect, joint }: Words) -> Self {
        match (effect.as_str(), joint) {
            (Self::NOTHING, _) => Verdict::Nothing,
            (Self::SEVERAL, _) => Verdict::Several,
            (Self::UNKNOWN, _) => Verdict::Unknown,
            (Self::FRICTION, Some(joint)) => Verdict::OutsideTolerance { joint },
            (Self::SERVO_GAIN, Some(joint)) => Verdict::ServoGain { joint },
            _ => Verdict::Effect { id: effect, joint },
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
    /// Its unit; `1` for a plain number.
    #[serde(default)]
    pub unit: String,
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
    /// Its share of the squared gap beyond the floor on the test records: the mean of what is lost
    /// without it and of what it explains alone, in proportion to what all named effects explain
    /// together. `None` where no free run tells.
    #[serde(default)]
    pub share: Option<f64>,
    /// Interval of 95 % of the share, by drawing the windows of the free runs anew; `None` where there are
    /// fewer than four.
    #[serde(default)]
    pub share_interval: Option<(f64, f64)>,
}

/// How much of the gap any cause of a class at a joint can remove at most.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ceiling {
    /// Joint from 1.
    pub joint: usize,
    /// What the cause is a function of.
    pub class: Class,
    /// Share of the squared gap beyond the floor that a flexible law of the class removes on records
    /// that were not fitted, 0 to 1.
    pub share: f64,
    /// Its interval of 95 %; `None` where there are fewer than four windows, or where the records ask for
    /// no law of the class.
    pub interval: Option<(f64, f64)>,
    /// Other classes whose laws correct these records alike.
    pub confounded: Vec<String>,
}

impl Ceiling {
    /// Joint and class in words.
    pub fn label(&self) -> String {
        format!("{} at joint {}", self.class.words(), self.joint)
    }
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

/// A round of the search: what was tried beside the effects taken before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Labels of the effects that were there already.
    pub beside: Vec<String>,
    /// Refitted candidates, best first.
    pub candidates: Vec<Tried>,
    /// Labels of effects dropped after it: the one taken made them superfluous, or their share is
    /// too small.
    #[serde(default)]
    pub dropped: Vec<String>,
    /// Whether it asked what an effect taken early is confused with: `beside` are the others, `dropped`
    /// is the one that lost its place.
    #[serde(default)]
    pub exchange: bool,
}

/// A candidate of a round.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tried {
    /// Label: `effect` or `effect:joint`.
    pub label: String,
    /// Twice the gain in log-likelihood, less the penalty.
    pub score: f64,
    /// Gain on records never fitted.
    pub held_out: f64,
    /// Gap on the test records with it.
    pub gap: f64,
    /// The rule that refused it; `None` for the one taken.
    pub refused: Option<String>,
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
    /// What any cause of a class can remove of it at most, largest first; empty if it was not looked for.
    #[serde(default)]
    pub ceilings: Vec<Ceiling>,
    /// A law without a name, if one describes most of the gap, and better than the named effects.
    #[serde(default)]
    pub nameless: Option<Nameless>,
    /// A law of its own for what the named effects leave, if terms without a name describe it.
    #[serde(default)]
    pub law: Option<OwnLaw>,
}

/// A law without a name: a sum of terms that stand beside the named effects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OwnLaw {
    /// Its [terms](pid_effects::terms), which `extended.toml` states as effects.
    pub terms: Vec<Named>,
    /// Share of the squared gap beyond the floor that it removes on the test records.
    pub share: f64,
    /// Interval of 95 % of the share, as of [`Named::share_interval`].
    #[serde(default)]
    pub share_interval: Option<(f64, f64)>,
    /// Gap on the test records with the named effects alone; [`Diagnosis::gap_after`] is with the law.
    pub gap_without: f64,
    /// Motions that it was fitted to, joint by joint: it says nothing of others.
    pub earned: Vec<Earned>,
}

/// Motions of a joint that a law was fitted to, SI.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Earned {
    /// Joint from 1.
    pub joint: usize,
    /// Least and largest position.
    pub position: (f64, f64),
    /// Least and largest velocity.
    pub velocity: (f64, f64),
}

fn counted() -> bool {
    true
}

/// A cause without a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Nameless {
    /// What it is of, and over what.
    pub form: Form,
    /// Joint from 1.
    pub joint: usize,
    /// Positions or times, SI.
    pub at: Vec<f64>,
    /// Forces or relative changes of the gain there, straight between them, SI.
    pub values: Vec<f64>,
    /// Standard deviations; `None` where the records do not determine a value.
    pub stds: Vec<Option<f64>>,
    /// Share of the squared gap beyond the floor that it explains on the test records.
    pub explained: f64,
}

impl Nameless {
    /// Where it bends most, for certain: where the change of its slope is the largest number of its
    /// deviations.
    pub fn bend(&self) -> Option<f64> {
        let bent = |i: usize| {
            let [a, b, c] = [0, 1, 2].map(|k| self.stds[i + k]);
            let f = &self.values[i..i + 3];
            let std = (a?.powi(2) + 4.0 * b?.powi(2) + c?.powi(2)).sqrt();
            Some((i + 1, (f[2] - 2.0 * f[1] + f[0]).abs() / std.max(1e-300)))
        };
        (0..self.values.len().saturating_sub(2))
            .filter_map(bent)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(i, _)| self.at[i])
    }

    /// In words: what, of which joint, and where it bends or how far it goes.
    pub fn words(&self) -> String {
        let joint = self.joint;
        match self.form {
            Form::ForceOverPosition => {
                let bend = self
                    .bend()
                    .map_or_else(String::new, |q| format!(", bending most at {q:.3}"));
                format!("a force over the position of joint {joint}{bend}")
            }
            Form::GainOverTime => {
                let change = self.values.last().zip(self.values.first());
                let percent = change.map_or(0.0, |(last, first)| 100.0 * (last - first));
                format!(
                    "a gain of the drive of joint {joint} that changes by {percent:+.0} % within a record"
                )
            }
        }
    }
}

/// Where the missing force of one joint lives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Joint from 1.
    pub joint: usize,
    /// Share in the squared missing force of all joints, each in units of its typical torque.
    pub share: f64,
    /// Root mean square of the missing force, N·m or N.
    pub rms: f64,
    /// The quantity it goes with most.
    pub regime: String,
    /// How far it is a function of that quantity and the direction, 0 to 1.
    pub explained: f64,
}

/// When the input of one joint acts, and when its velocity shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Signals {
    /// Joint from 1.
    pub joint: usize,
    /// The input against the force that moves the joint, all records; `None` where they tell nothing of it.
    pub input: Option<Alignment>,
    /// The velocity reading against the derivative of the positions, all records; `None` where no
    /// velocity is recorded.
    pub velocity: Option<Reading>,
}

/// How well a further motion would separate the first two rivals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Next {
    /// The rivals.
    pub rivals: (String, String),
    /// Expected logarithm of the likelihood ratio in favour of the right one, the lesser of both cases.
    pub log_odds: f64,
}

/// Figures of what is left; the largest over joints and channels of their median over records, and
/// over records.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Residue {
    /// Largest mean square of a window over that of its record.
    pub burst: f64,
    /// Largest line of a spectrum over its mean, the median over the records.
    pub line: f64,
    /// Largest line over those on either side of it, the median over the records: coloured noise has
    /// large lines, but none stands out.
    #[serde(default)]
    pub hum: f64,
    /// What these figures are the largest of; not in the JSON form.
    #[serde(skip)]
    pub of: Extent,
    /// Sum of squared correlations of neighbours up to ten samples apart, times the number of
    /// samples and over ten, the median over the records: 1 for white noise.
    pub memory: f64,
    /// Root mean square of these correlations.
    #[serde(default)]
    pub correlation: f64,
    /// Mean squared innovation on the test records over that on the train records.
    pub unseen: f64,
}

/// Numbers that the figures of [`Residue`] are taken over, those of the record that has most.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Extent {
    /// Frequencies of a spectrum.
    pub frequencies: f64,
    /// Windows of a record.
    pub windows: f64,
    /// Samples of a window, the fewest.
    pub samples: f64,
}

/// The verdict and what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Data set.
    pub case: String,
    /// How much of the gap has a name, in the field `verdict`; absent in files of older versions.
    #[serde(rename = "verdict", default)]
    pub outcome: Option<Outcome>,
    /// The cause that is stated; fields `effect` and `joint` of the JSON form.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// All named effects.
    pub effects: Vec<Named>,
    /// Gap of the nominal structure within its tolerances, test records.
    pub gap_before: f64,
    /// Gap with the named effects, and with the [law of its own](Remainder::law) if there is one.
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
    /// Where the missing force of the nominal structure lives, joint by joint; empty if it was not
    /// looked for.
    #[serde(default)]
    pub missing_force: Vec<Share>,
    /// What any cause of a class can remove of the gap before at most, largest first; empty if it was not
    /// looked for, or if the gap is that of noise.
    #[serde(default)]
    pub ceilings: Vec<Ceiling>,
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
    /// Gains of the drives' position loops that the description does not state exactly.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loop_gains: Vec<LoopGain>,
    /// Candidates, best first.
    pub ranking: Vec<Ranked>,
    /// The rounds of the search that the named effects come from; empty where one round decided.
    #[serde(default)]
    pub rounds: Vec<Round>,
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
    /// How much of the gap has a name.
    pub fn outcome(&self) -> Outcome {
        Outcome::of(&self.verdict, self.effects.len())
    }

    /// As JSON, indented.
    pub fn to_json(&self) -> String {
        // Only numbers, texts and lists: writing to memory cannot fail.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::Verdict;

    #[test]
    fn a_verdict_is_two_fields_and_comes_back() {
        let effect = |joint| Verdict::Effect {
            id: "payload".to_owned(),
            joint,
        };
        for (verdict, json) in [
            (Verdict::Nothing, r#"{"effect":"none","joint":null}"#),
            (Verdict::Several, r#"{"effect":"several","joint":null}"#),
            (Verdict::Unknown, r#"{"effect":"unknown","joint":null}"#),
            (
                Verdict::OutsideTolerance { joint: 2 },
                r#"{"effect":"friction","joint":2}"#,
            ),
            (
                Verdict::ServoGain { joint: 2 },
                r#"{"effect":"servo_gain","joint":2}"#,
            ),
            (effect(None), r#"{"effect":"payload","joint":null}"#),
            (effect(Some(1)), r#"{"effect":"payload","joint":1}"#),
        ] {
            assert_eq!(serde_json::to_string(&verdict).expect("text"), json);
            let back: Verdict = serde_json::from_str(json).expect("a verdict");
            assert_eq!(back, verdict);
        }
    }
}
