//! What a search found out, and the one function that turns it into a diagnosis.

use std::time::Instant;

use super::forward::Selection;
use super::loops::loop_gains;
use super::measure::share;
use super::nameless::described;
use super::odds::tempered;
use super::stand::Sought;
use crate::case::Case;
use crate::circumstances::equal_to;
use crate::criteria::Criteria;
use crate::diagnosis::{
    Beyond, Ceiling, Diagnosis, Magnitude, Named, Next, Outcome, Ranked, Remainder, Residue, Round,
    SCHEMA_VERSION, Share, Signals, Verdict,
};
use crate::effect::Term;
use crate::effects::by_id;
use crate::fit::Fit;
use crate::gap::Gap;

/// What a search found out.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The case; noise levels that were not stated as they were found.
    pub case: Case,
    /// The nominal structure within its tolerances.
    pub base: Fit,
    /// With the named effects, and with the law of its own if there is one.
    pub fit: Fit,
    /// Refitted candidates, best first: each beside those named before it.
    pub rivals: Vec<Fit>,
    /// Gap of the nominal structure, test records.
    pub before: Gap,
    /// Gap of [`Evidence::fit`].
    pub after: Gap,
    /// The gap that noise alone leaves.
    pub floor: f64,
    /// Share of each joint and channel in the squared gap before.
    pub shares: Vec<(f64, Option<f64>)>,
    /// The named effects of [`Evidence::fit`].
    pub effects: Vec<Named>,
    /// Candidates with their odds, best first.
    pub ranking: Vec<Ranked>,
    /// Rounds in which effects were taken in part.
    pub rounds: Vec<Round>,
    /// Mean squared innovation of the nominal structure and of the effects accepted.
    pub misfit: (f64, f64),
    /// Whether the innovations of the effects accepted are white.
    pub residue: Residue,
    /// Whether something is left that neither noise nor the effects accepted explain.
    pub unexplained: bool,
    /// What effects explain that were taken although something is left.
    pub(super) part: Option<Part>,
    /// Whether free runs leave no more than noise although innovations are no white noise, and no
    /// effect pays.
    pub coloured: bool,
    /// Where the search for these ended.
    pub(super) sought: Option<Box<Sought>>,
    /// The fit without the law of its own, if [`Evidence::fit`] holds one.
    pub(super) without_law: Option<Box<Fit>>,
    /// What is left beside the effects, if something is.
    pub remainder: Option<Remainder>,
    /// Friction outside its stated tolerance.
    pub beyond: Vec<Beyond>,
    /// The test record that was fitted because no train record shows the cause.
    pub promoted: Option<String>,
    /// Whether the search was stopped before its end.
    pub stopped: bool,
    /// Refits made.
    pub refits: usize,
    /// Numbers the verdict follows from.
    pub criteria: Criteria,
    /// When the search began.
    pub started: Instant,
}

/// How much effects explain that were taken although something is left.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    /// Share of the squared gap beyond the floor that the first effect explains by itself.
    pub(super) first: f64,
    /// Share that all of them explain.
    pub(super) all: f64,
    /// Gap over the floor with all of them.
    pub(super) left: f64,
    /// Whether a law without a name describes the records better.
    pub(super) nameless: bool,
}

impl Part {
    /// Whether the first effect is a verdict beside an unknown rest: it explains most by itself and
    /// its rivals nearly never, or free runs leave no more than noise and it is more likely than
    /// its rivals together (these explain the same then, and stand in the confusion set).
    fn is_a_verdict(&self, criteria: &Criteria, effects: usize, probability: f64) -> bool {
        let most = leads(criteria, self.first, probability) && self.all > criteria.majority_of_all;
        let nothing_left = self.left < criteria.near && probability > 0.5;
        effects <= criteria.together && !self.nameless && (most || nothing_left)
    }

    /// Whether several effects together are the verdict: they explain most, and little is left.
    fn are_a_verdict(&self, criteria: &Criteria, effects: usize) -> bool {
        effects > 1
            && !self.nameless
            && self.all > criteria.majority_of_all
            && self.left < criteria.unexplained
    }
}

/// Whether the first effect explains most by itself, and its rivals nearly never.
pub(super) fn leads(criteria: &Criteria, explained: f64, probability: f64) -> bool {
    explained > criteria.majority && probability > criteria.leading()
}

/// What is said of a case beside the verdict: where the missing force lives, how signals pass, what
/// may be recorded next.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// Missing force of the nominal structure, joint by joint.
    pub missing_force: Vec<Share>,
    /// Missing force beside the named effects; shown where something is left.
    pub left_force: Vec<Share>,
    /// What any cause of a class can remove at most: of the gap before, and of what is left.
    pub ceilings: [Vec<Ceiling>; 2],
    /// When inputs act and readings show.
    pub signals: Vec<Signals>,
    /// What reading the records found odd.
    pub warnings: Vec<String>,
    /// The motion that would separate the rivals that are left.
    pub next: Option<Next>,
}

/// The verdict with the probability that it is right and where the cause shows.
struct Stated {
    verdict: Verdict,
    confidence: f64,
    regime: String,
}

impl Evidence {
    /// What forward selection alone tells.
    pub(super) fn of_selection(
        selection: Selection,
        criteria: &Criteria,
        started: Instant,
    ) -> Self {
        let (before, after, floor) = (&selection.before, &selection.after, selection.floor.typical);
        let close = selection
            .imitated
            .as_ref()
            .filter(|law| law.gap < criteria.near * floor);
        let remainder = close.map(|law| Remainder {
            explained: share(before.total, after.total, floor),
            own_error: false,
            missing_force: Vec::new(),
            ceilings: Vec::new(),
            nameless: described(
                &selection.case,
                criteria,
                &law.refit,
                share(before.total, law.gap, floor),
            ),
            law: None,
        });
        Evidence {
            ranking: tempered(
                criteria,
                &selection.ranking,
                &selection.accepted,
                selection.lagging.as_ref(),
                selection.misfit.1,
            ),
            shares: before.shares(),
            case: selection.case,
            base: selection.base,
            fit: selection.fit,
            rivals: selection.ranking.into_iter().map(|r| r.fit).collect(),
            before: selection.before,
            after: selection.after,
            floor,
            effects: selection.effects,
            rounds: Vec::new(),
            coloured: false,
            misfit: selection.misfit,
            residue: selection.residue,
            unexplained: selection.unexplained,
            part: None,
            sought: None,
            without_law: None,
            remainder,
            beyond: Vec::new(),
            promoted: None,
            stopped: false,
            refits: selection.refits,
            criteria: criteria.clone(),
            started,
        }
    }

    /// The cause that the evidence speaks for.
    pub fn verdict(&self) -> Verdict {
        self.stated().verdict
    }

    /// The verdict, its confidence and its regime.
    fn stated(&self) -> Stated {
        let mut stated = self.stated_of_records();
        if let Some(record) = &self.promoted {
            stated.regime = format!(
                "{}; no train record shows it: `{record}` was fitted too",
                stated.regime
            );
        }
        stated
    }

    fn stated_of_records(&self) -> Stated {
        let criteria = &self.criteria;
        let named = |first: &Named, confidence: f64| Stated {
            verdict: Verdict::Effect {
                id: first.effect.clone(),
                joint: first.joint,
            },
            confidence,
            regime: first.regime.clone(),
        };
        let first = self.effects.first();
        if let (Some(part), Some(first)) = (&self.part, first) {
            let probability = self.ranking[0].probability;
            if part.is_a_verdict(criteria, self.effects.len(), probability) {
                return named(first, probability.min(criteria.right_unknown));
            }
            if part.are_a_verdict(criteria, self.effects.len()) {
                let regimes: Vec<&str> = self.effects.iter().map(|e| &*e.regime).collect();
                return Stated {
                    verdict: Verdict::Several,
                    confidence: criteria.right_unknown,
                    regime: regimes.join("; "),
                };
            }
        }
        if self.unexplained && !self.coloured {
            let law = self.remainder.as_ref().and_then(|r| r.nameless.as_ref());
            return Stated {
                verdict: Verdict::Unknown,
                confidence: criteria.right_unknown,
                regime: law.filter(|_| self.part.is_none()).map_or_else(
                    || "what is left is larger than the noise".to_owned(),
                    |law| law.words(),
                ),
            };
        }
        if let Some(first) = first {
            let own = self
                .ranking
                .iter()
                .find(|l| l.effect == first.effect && l.joint == first.joint)
                .map_or(0.5, |l| l.probability);
            let right = if self.case.noise.iter().all(|n| n.stated) {
                criteria.right_stated
            } else {
                criteria.right_estimated
            };
            return named(first, own * right);
        }
        // What was not looked for may be missing all the same.
        if self.stopped && self.beyond.is_empty() {
            return Stated {
                verdict: Verdict::Unknown,
                confidence: criteria.right_unknown,
                regime: "the search was stopped before its end".to_owned(),
            };
        }
        // Nothing is missing; where a tolerance had to be left for that, another gain or another level of
        // friction is the cause.
        let (verdict, regime) = match self.beyond.first() {
            Some(b) => (Verdict::from(b), FRICTION_REGIME),
            None if self.coloured => (
                Verdict::Nothing,
                "all records; what is left is no white noise, but free runs do not show it",
            ),
            None => (Verdict::Nothing, "all records"),
        };
        Stated {
            verdict,
            confidence: match self.coloured {
                true => criteria.right_unknown,
                false => criteria.right_estimated,
            },
            regime: regime.to_owned(),
        }
    }

    /// Candidates that explain the records about as well as what is named.
    fn confusion_set(&self) -> Vec<String> {
        let named = |l: &&Ranked| {
            self.effects
                .iter()
                .any(|n| n.effect == l.effect && n.joint == l.joint)
        };
        let mut set: Vec<String> = self
            .ranking
            .iter()
            .filter(|l| !named(l) && l.probability > self.criteria.chance)
            .map(Ranked::label)
            .collect();
        // What is the same map on this robot cannot be told apart, whatever the odds of the fits.
        if let Verdict::Effect { id, joint } = self.verdict() {
            for equal in self.equal_to(&id, joint) {
                if !set.contains(&equal) {
                    set.push(equal);
                }
            }
        }
        set
    }

    /// Labels of the effects that are the same map as a named one on this robot.
    fn equal_to(&self, id: &str, joint: Option<usize>) -> Vec<String> {
        let mut terms = self.fit.hypothesis.terms.iter();
        let named = |t: &&Term| t.effect.info().id == id && t.shown_joint() == joint;
        let Some(term) = terms.find(named) else {
            return Vec::new();
        };
        let robot = &self.case.nominal.description;
        let equal = equal_to(&*term.effect, robot, term.joint).into_iter();
        let equal = equal.filter_map(by_id).map(|effect| {
            let joint = term.joint;
            Term { effect, joint }.label()
        });
        equal.collect()
    }

    /// The diagnosis: the only place where one is made.
    pub fn diagnosis(&self, around: Surroundings) -> Diagnosis {
        let Stated {
            verdict,
            confidence,
            regime,
        } = self.stated();
        let effects = match verdict {
            _ if verdict.is_outside_tolerance() => outside(&self.beyond),
            _ => self.effects.clone(),
        };
        let [ceilings, of_the_rest] = around.ceilings;
        let remainder = self.remainder.clone().map(|left| Remainder {
            missing_force: around.left_force,
            ceilings: of_the_rest,
            ..left
        });
        Diagnosis {
            schema_version: SCHEMA_VERSION,
            case: self.case.name.clone(),
            outcome: Some(Outcome::of(&verdict, effects.len())),
            verdict,
            effects,
            gap_before: self.before.total,
            gap_after: self.after.total,
            gap_intervals: (self.before.interval(), self.after.interval()),
            gap_floor: self.floor,
            gap_joints: self.after.joints.clone(),
            gap_joints_before: self.before.joints.clone(),
            gap_shares: self.shares.clone(),
            missing_force: around.missing_force,
            ceilings,
            signals: around.signals,
            warnings: around.warnings,
            next_experiment: around.next,
            remainder,
            beyond_tolerance: self.beyond.clone(),
            loop_gains: loop_gains(&self.case, &self.criteria, &self.fit),
            ranking: self.ranking.clone(),
            rounds: self.rounds.clone(),
            confidence,
            confusion_set: self.confusion_set(),
            regime,
            misfit: self.misfit,
            residue: self.residue,
            refits: self.refits,
            seconds: self.started.elapsed().as_secs_f64(),
        }
    }
}

/// Where another level of friction, or another gain, shows.
const FRICTION_REGIME: &str = "all motion of the joint";

/// One entry per joint whose gains or whose friction lie outside their tolerance.
fn outside(beyond: &[Beyond]) -> Vec<Named> {
    let mut out: Vec<Named> = Vec::new();
    for b in beyond {
        let parameter = Magnitude {
            name: b.parameter.clone(),
            value: b.value,
            unit: b.unit.clone(),
            std: b.std,
        };
        let verdict = Verdict::from(b);
        let effect = verdict.word();
        let mut there = out.iter_mut();
        match there.find(|n| n.effect == effect && n.joint == Some(b.joint)) {
            Some(n) => n.parameters.push(parameter),
            None => out.push(Named {
                effect: effect.to_owned(),
                joint: Some(b.joint),
                parameters: vec![parameter],
                regime: FRICTION_REGIME.to_owned(),
                share: None,
                share_interval: None,
            }),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const PART: Part = Part {
        first: 0.75,
        all: 0.85,
        left: 3.0,
        nameless: false,
    };

    fn verdict(part: Part, effects: usize, probability: f64) -> bool {
        part.is_a_verdict(&Criteria::default(), effects, probability)
    }

    #[test]
    fn a_first_effect_leads_by_its_own_share_and_by_its_odds() {
        assert!(verdict(PART, 1, 0.97));
        // Of two rivals that explain the same, neither is the verdict, however much both explain.
        assert!(!verdict(
            Part {
                first: 0.99,
                all: 0.99,
                ..PART
            },
            1,
            0.5
        ));
        assert!(!verdict(Part { first: 0.6, ..PART }, 1, 1.0));
        // Three together imitate what the library lacks, and a free law speaks against all of them.
        assert!(!verdict(PART, 3, 0.97));
        assert!(!verdict(
            Part {
                nameless: true,
                ..PART
            },
            1,
            0.97
        ));
    }

    #[test]
    fn rivals_that_explain_the_same_do_not_deny_a_verdict_where_nothing_is_left() {
        let near = Part {
            first: 0.5,
            left: 1.3,
            ..PART
        };
        assert!(verdict(near, 1, 0.85));
        // Something is left.
        assert!(!verdict(Part { left: 1.7, ..near }, 1, 0.85));
        // The others together are as likely.
        assert!(!verdict(near, 1, 0.45));
    }
}
