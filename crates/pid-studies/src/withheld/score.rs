//! Figures of a study.

use std::collections::BTreeMap;

use pid_diagnose::circumstances::Circumstances;
use pid_diagnose::diagnosis::{Diagnosis, Magnitude, Ranked, Verdict};
use pid_diagnose::effects;
use pid_withheld::{Cause, Kind, Truth};
use serde::{Deserialize, Serialize};

/// One case with its cause and its diagnosis.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Outcome<T = Truth> {
    /// The case.
    pub id: String,
    /// What was hidden.
    pub truth: T,
    /// What was said.
    pub diagnosis: Diagnosis,
}

/// A share with the numbers it is of.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Share {
    /// How many.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
}

impl Share {
    pub(crate) fn add(&mut self, hit: bool) {
        self.of += 1;
        self.hits += usize::from(hit);
    }
    /// Hits over number; `None` where there is nothing.
    pub fn value(&self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }
    /// Interval of 95 % (E. B. Wilson, JASA 22, 1927); the whole range where there is nothing.
    pub fn interval(&self) -> Interval {
        if self.of == 0 {
            return Interval {
                low: 0.0,
                high: 1.0,
            };
        }
        let (n, p, z) = (self.of as f64, self.hits as f64 / self.of as f64, 1.96);
        let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        Interval {
            low: (middle - half).max(0.0),
            high: (middle + half).min(1.0),
        }
    }
}

/// An interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// One bar of the reliability diagram.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bin {
    /// Mean stated confidence.
    pub stated: f64,
    /// Verdicts that were right.
    pub right: Share,
}

/// Everything a study says.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Summary {
    /// Effect named first is (one of) the true, by tier; exact equivalents accepted.
    pub effect: BTreeMap<String, Share>,
    /// A true effect is among the first three.
    pub top3: Share,
    /// Joint right where the effect is.
    pub joint: Share,
    /// Both causes among the named, of the cases with two.
    pub both: Share,
    /// Something was named where nothing is.
    pub false_alarms: Share,
    /// `unknown` where the cause is outside the list.
    pub abstained: Share,
    /// A law of its own where the cause is outside the list, and the same that leaves at most
    /// 1.3 floors.
    pub laws: (Share, Share),
    /// A law of its own where nothing is hidden.
    pub false_laws: Share,
    /// `unknown` where the cause is in the list.
    pub gave_up: Share,
    /// `none` where something is.
    pub missed: Share,
    /// Right verdicts of all kinds with stated and without stated noise.
    pub noise: (Share, Share),
    /// Right verdicts by the kind of velocity.
    pub velocity: BTreeMap<String, Share>,
    /// Gap after over floor, right single diagnoses: median and largest.
    pub gap_over_floor: Option<(f64, f64)>,
    /// Relative error of the magnitude, right diagnoses: median and largest.
    pub magnitude_error: Option<(f64, f64)>,
    /// Intervals of 95 % that hold the magnitude.
    pub coverage: Share,
    /// Reliability diagram.
    pub reliability: Vec<Bin>,
    /// Expected calibration error: mean distance of stated confidence and share of right verdicts.
    pub calibration_error: f64,
    /// Said, by what was hidden.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
    /// Time of a diagnosis, s: median and longest.
    pub seconds: Option<(f64, f64)>,
}

/// Floors that a law of its own may leave.
pub(crate) const LEFT_BY_LAW: f64 = 1.3;
/// Bars of the reliability diagram.
const BINS: usize = 8;

/// Whether an effect at a joint (from 1) is a cause of the case, or the same map on its robot.
fn caused(truth: &Truth, effect: &str, joint: Option<usize>) -> bool {
    truth
        .causes
        .iter()
        .any(|c| c.kind.id() == effect || same_map(truth, c, effect, joint))
}

/// Causes and effects whose records are the same, by [`Info::equal_to`](crate::effect::Info::equal_to).
pub(crate) fn same_map(truth: &Truth, cause: &Cause, effect: &str, joint: Option<usize>) -> bool {
    let (Some(own), Some(other)) = (effects::by_id(cause.kind.id()), effects::by_id(effect)) else {
        return false;
    };
    // A cause of the whole robot is at the joint that is said.
    let stated = joint.and_then(|j| j.checked_sub(1));
    let at_joint = if own.info().has_joint {
        cause.joint
    } else {
        stated.unwrap_or(0)
    };
    // Every robot of the study has viscous friction, and gravity counts as one that acts: its
    // direction is no part of the truth.
    let at = Circumstances {
        joints: truth.joints,
        joint: at_joint,
        gravity: true,
        vertical_plane: truth.one_axis,
        viscous: true,
    };
    let there = !other.info().has_joint || stated == Some(at_joint);
    there && own.info().equal_to(&at).any(|id| id == effect)
}

/// Whether the verdict is right: an effect of the case, `none` or `unknown` as it was hidden.
pub(crate) fn right(o: &Outcome) -> bool {
    if o.truth.causes.is_empty() {
        return o.diagnosis.verdict == Verdict::Nothing;
    }
    caused(
        &o.truth,
        o.diagnosis.verdict.word(),
        o.diagnosis.verdict.joint(),
    )
}

/// Tier by the gap of the nominal structure over the floor.
pub(crate) fn tier(o: &Outcome) -> &'static str {
    if o.truth.causes.is_empty() {
        return "null";
    }
    match o.diagnosis.gap_before / o.diagnosis.gap_floor.max(1e-300) {
        x if x >= 4.0 => "clear",
        x if x >= 2.0 => "subtle",
        x if x >= 1.3 => "faint",
        _ => "hidden",
    }
}

/// Median and largest of the finite numbers.
pub(crate) fn middle(mut x: Vec<f64>) -> Option<(f64, f64)> {
    x.retain(|x| x.is_finite());
    x.sort_by(f64::total_cmp);
    Some((*x.get(x.len() / 2)?, *x.last()?))
}

/// Whether the verdict names the joint of a cause, or the other one of a cable between the first two.
fn at_joint(d: &Diagnosis, c: &Cause) -> bool {
    let other = matches!(c.kind, Kind::JointCoupling { .. }) && c.joint == 0;
    d.verdict.joint() == Some(c.joint + 1) || (other && d.verdict.joint() == Some(2))
}

/// The estimate of the magnitude of a cause that the verdict names, and its true value.
fn estimated<'d>(d: &'d Diagnosis, c: &Cause) -> Option<(&'d Magnitude, f64)> {
    let (key, mut value) = c.kind.magnitude()?;
    // One cable between the first two joints, seen from the other: K/2 (q₁ + ρ q₂)² = K
    // ρ²/2 (q₂ + q₁/ρ)².
    if let Kind::JointCoupling { ratio, .. } = c.kind
        && c.joint == 0
        && d.verdict.joint() == Some(2)
    {
        value *= ratio * ratio;
    }
    let effect = d.effects.iter().find(|e| e.effect == c.kind.id())?;
    let estimate = effect.parameters.iter().find(|p| p.name == key)?;
    Some((estimate, value))
}

/// Scores outcomes.
pub fn summary(outcomes: &[Outcome]) -> Summary {
    let mut s = Summary::default();
    let (mut gaps, mut errors) = (Vec::new(), Vec::new());
    for o in outcomes {
        let d = &o.diagnosis;
        let said = d.verdict.word();
        let hit = right(o);
        let hidden: Vec<&str> = o.truth.causes.iter().map(|c| c.kind.id()).collect();
        let name = if hidden.is_empty() {
            "none".to_owned()
        } else {
            hidden.join(" + ")
        };
        *s.confusion
            .entry(name)
            .or_default()
            .entry(said.to_owned())
            .or_default() += 1;
        if o.truth.noise_stated {
            s.noise.0.add(hit)
        } else {
            s.noise.1.add(hit)
        }
        s.velocity
            .entry(o.truth.velocity.clone())
            .or_default()
            .add(hit);
        let law = d.remainder.as_ref().is_some_and(|r| r.law.is_some());
        if hidden.is_empty() {
            s.false_alarms.add(!hit);
            s.false_laws.add(law);
            continue;
        }
        if hidden.contains(&"unknown") {
            s.abstained.add(hit);
            s.laws.0.add(law);
            s.laws
                .1
                .add(law && d.gap_after <= LEFT_BY_LAW * d.gap_floor);
            continue;
        }
        s.effect.entry(tier(o).to_owned()).or_default().add(hit);
        s.gave_up.add(d.verdict == Verdict::Unknown);
        s.missed.add(d.verdict == Verdict::Nothing);
        let listed = |r: &Ranked| caused(&o.truth, &r.effect, r.joint);
        s.top3.add(hit || d.ranking.iter().take(3).any(listed));
        if hidden.len() == 2 {
            s.both.add(o.truth.causes.iter().all(|c| {
                d.effects
                    .iter()
                    .any(|e| e.effect == c.kind.id() || same_map(&o.truth, c, &e.effect, e.joint))
            }));
        }
        if !hit {
            continue;
        }
        for c in o.truth.causes.iter().filter(|c| c.kind.id() == said) {
            if c.kind.has_joint() {
                s.joint.add(at_joint(d, c));
            }
            if hidden.len() == 1 {
                gaps.push(d.gap_after / d.gap_floor);
            }
            if let Some((p, value)) = estimated(d, c) {
                errors.push((p.value / value - 1.0).abs());
                if let Some(std) = p.std {
                    s.coverage.add((p.value - value).abs() <= 1.96 * std);
                }
            }
        }
    }
    s.gap_over_floor = middle(gaps);
    s.magnitude_error = middle(errors);
    s.seconds = middle(outcomes.iter().map(|o| o.diagnosis.seconds).collect());
    (s.reliability, s.calibration_error) = reliability(outcomes);
    s
}

/// Bars of about equal number and the mean distance of stated and reached.
fn reliability(outcomes: &[Outcome]) -> (Vec<Bin>, f64) {
    let mut all: Vec<(f64, bool)> = outcomes
        .iter()
        .map(|o| (o.diagnosis.confidence, right(o)))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let size = all.len().div_ceil(BINS).max(1);
    let bins: Vec<Bin> = all
        .chunks(size)
        .map(|part| {
            let mut bin = Bin {
                stated: 0.0,
                right: Share::default(),
            };
            for (stated, hit) in part {
                bin.stated += stated / part.len() as f64;
                bin.right.add(*hit);
            }
            bin
        })
        .collect();
    let error = bins
        .iter()
        .filter_map(|b| Some(b.right.of as f64 * (b.stated - b.right.value()?).abs()))
        .sum::<f64>()
        / all.len().max(1) as f64;
    (bins, error)
}
