//! Forward selection of effects with a backward and an exchange check (M. A. Efroymson 1960), within the tolerances of a case.

use std::collections::BTreeSet;
use std::time::Instant;

use pid_runtime::data::Role;

use super::backward::{superfluous, without_each};
use super::exchange::exchange;
use super::magnitude::{size_in_deviations, sizes};
use super::refit::{Refit, refit, score};
use super::residue::residue;
use super::unnamed::{Imitated, concerned, free_laws, imitated};
use super::verdict::{self, Parts, lagging_velocity};
use super::{Found, Settings, measured, noise_alone, test_value};
use crate::case::Case;
use crate::effect::{Kind, Term};
use crate::fit::{Basis, Effort, Fit, Point, basis, basis_beside, fit, value};
use crate::gap::Gap;
use crate::noise;
use crate::screen::{candidates, screen};
use crate::simulate::Hypothesis;
use crate::windows;

/// Relative decrease of the objective with which an effect is kept for a further round although the gap does not shrink yet.
const PROVISIONAL: f64 = 0.1;
/// Score, in margins, with which it is kept where the noise levels are not stated.
const STRONG: f64 = 20.0;
/// Gain on motions never fitted, in margins, with which an effect is taken if only the gap does not grow.
pub(super) const BEYOND_DOUBT: f64 = 10.0;
/// Gap over floor below which nothing is left to look for.
pub(super) const NEAR: f64 = 1.4;
/// Share by which a second effect must shrink the gap to be told by free runs alone: a slow one may leave the innovations white.
const DRIFT: f64 = 0.3;
/// Mean squared innovation below which no further effect is looked for.
const EXPLAINED: f64 = 1.1;

/// Searches a case for the effects that explain it, and gives the verdict.
pub(super) fn search(case: &Case, settings: &Settings) -> Found {
    let clock = Instant::now();
    let mut forward = Forward::start(case, settings);
    for round in 0..settings.most {
        if !forward.round(round) {
            break;
        }
    }
    forward.check();
    forward.finish();
    forward.found(clock)
}

/// What forward selection has found so far.
struct Forward<'a> {
    settings: &'a Settings,
    /// With the noise levels as they are now.
    case: Case,
    basis: Basis,
    /// The nominal structure and its gap.
    base: Fit,
    before: Gap,
    /// With the effects accepted.
    current: Fit,
    gap: Gap,
    accepted: Vec<Term>,
    /// With the first of them alone.
    alone: Option<Fit>,
    /// Candidates of the first round, best first; a second effect stands after the first.
    ranking: Vec<Refit>,
    refits: usize,
    /// Candidates of the first round.
    candidates: usize,
    /// Labels of the candidates that the first round is left to.
    shortlist: Option<BTreeSet<String>>,
    /// Whether free runs leave more than noise.
    drifts: bool,
}

impl<'a> Forward<'a> {
    /// Fits the nominal structure; noise levels that are not stated are settled on the most promising candidate.
    fn start(case: &Case, settings: &'a Settings) -> Self {
        let mut case = case.clone();
        let basis = basis(&case);
        let nothing = Hypothesis::default();
        let start = Point {
            theta: vec![0.0; case.nominal.size()],
            e: Vec::new(),
        };
        let mut base = fit(&case, &basis, &nothing, start, Effort::full(settings.steps));
        let mut shortlist = None;
        if noise::settle(&mut case, &base) {
            base = again(&case, &basis, &base);
            // What the nominal structure leaves is not all noise.
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
        Forward {
            settings,
            basis,
            current: base.clone(),
            gap: before.clone(),
            base,
            before,
            case,
            accepted: Vec::new(),
            alone: None,
            ranking: Vec::new(),
            refits: 0,
            candidates: 0,
            shortlist,
            drifts: false,
        }
    }

    /// Screens and refits all candidates on top of what is accepted; takes the best if it pays. Whether a further round may find
    /// more.
    fn round(&mut self, round: usize) -> bool {
        let settings = self.settings;
        let mut list = listed(&self.case, &self.basis, settings, &self.current);
        let number = list.len();
        self.candidates = self.candidates.max(number);
        if let Some(short) = self.shortlist.take() {
            list.retain(|(term, _)| short.contains(&term.label()));
        }
        let (best, slopes) = screen(&self.case, &self.basis, &self.current, &list);
        let mut tried = refit(
            &self.case,
            &self.basis,
            settings,
            &self.current,
            (&best, &slopes),
            number,
        );
        self.refits += tried.len();
        let Some(first) = tried.first() else {
            return false;
        };
        let after = measured(&self.case, &first.fit);
        let take = self.pays(first, &after, round);
        if take {
            self.accept(first, after);
        }
        if round == 0 {
            self.ranking = tried;
        } else if take {
            let second = tried.remove(0);
            self.ranking.insert(1.min(self.ranking.len()), second);
        }
        if !take {
            return false;
        }
        // Nothing is left to look for where the innovations are as large as the noise, and free runs too.
        let floor = noise_alone(&self.case, &self.current).typical;
        self.drifts = self.gap.total > NEAR * floor;
        self.drifts || self.current.train.total() >= EXPLAINED * self.current.train.number()
    }

    /// Whether the best candidate of a round gains more than chance and multiplicity allow, with the gap `after`.
    fn pays(&self, first: &Refit, after: &Gap, round: usize) -> bool {
        let (settings, current) = (self.settings, &self.current);
        let held_out = test_value(&self.case, current) - test_value(&self.case, &first.fit);
        let relative =
            (current.train.evidence() - first.fit.train.evidence()) / current.train.objective();
        let (least, shrink) = match round {
            0 => (0.002, settings.least_shrink),
            _ => (0.03, 2.0 * settings.least_shrink),
        };
        let shrinks = after.total < (1.0 - shrink) * self.gap.total;
        let enough =
            relative > least || (self.drifts && after.total < (1.0 - DRIFT) * self.gap.total);
        // One of two effects may hide behind the other in free runs: it is kept until the last round shows what both give.
        // Noise levels that were settled on one effect hide part of what the other does: there the score decides.
        let open = self.case.noise.iter().any(|n| !n.stated);
        let strong = relative > PROVISIONAL || (open && first.score > STRONG * settings.margin);
        let provisional = strong && round + 1 < settings.most;
        // Free runs scatter; predictions of motions never fitted are then beyond doubt.
        let beyond_doubt = relative > PROVISIONAL
            && held_out > BEYOND_DOUBT * settings.margin
            && after.total < self.gap.total;
        first.score > settings.margin
            && held_out > 0.0
            && enough
            && (shrinks || provisional || beyond_doubt)
            && size_in_deviations(&first.fit) > settings.least_size
    }

    /// Goes on with a candidate.
    fn accept(&mut self, first: &Refit, after: Gap) {
        self.accepted.push(first.term.clone());
        self.current = first.fit.clone();
        self.gap = after;
        if state(&first.term) {
            self.basis = directions(&self.case, &self.current);
            self.current = fit(
                &self.case,
                &self.basis,
                &self.current.hypothesis,
                self.current.point.clone(),
                Effort::full(self.settings.steps),
            );
            self.gap = measured(&self.case, &self.current);
        }
        if noise::settle(&mut self.case, &self.current) {
            self.current = again(&self.case, &self.basis, &self.current);
            self.gap = measured(&self.case, &self.current);
        }
        if self.accepted.len() == 1 {
            self.alone = Some(self.current.clone());
        }
    }

    /// Takes back or exchanges what later effects, sizes or free runs speak against.
    fn check(&mut self) {
        let settings = self.settings;
        let mut without = without_each(&self.case, &self.basis, settings, &self.current);
        if let Some(dropped) = superfluous(&self.case, settings, &self.current, &without) {
            self.go_on_with(without.swap_remove(dropped));
            let label = self.accepted.remove(dropped).label();
            if let Some(at) = self.ranking.iter().position(|r| r.term.label() == label) {
                self.ranking.remove(at);
            }
            self.scored_alone();
        } else if let Some(later) = without.first() {
            let beside = (&self.current, later);
            let exchanged = exchange(&self.case, &self.basis, settings, beside);
            self.refits += exchanged.tried.len();
            if let Some(fit) = exchanged.fit {
                self.go_on_with(fit);
                self.accepted[0] = self.current.hypothesis.terms[0].clone();
                // The candidates for the first place are those beside the later effects now, which stand behind the first.
                let later: Vec<Refit> = self.ranking.drain(1..self.accepted.len()).collect();
                self.ranking = exchanged.tried;
                self.ranking.splice(1..1, later);
                self.alone = None;
            }
        }
        if self.accepted.len() > 1
            && let Some(first) = self.alone.take()
            && without_size(&sizes(&self.case, &self.current), settings)
        {
            self.go_on_with(first);
            self.accepted.truncate(1);
            self.ranking.remove(1);
        }
        if self.gap.total > (1.0 - settings.least_shrink) * self.before.total {
            self.current = self.base.clone();
            self.accepted.clear();
        }
    }

    /// An effect that is left alone was scored on top of another one.
    fn scored_alone(&mut self) {
        let [only] = &self.accepted[..] else {
            return;
        };
        let (label, k) = (only.label(), only.effect.info().parameters.len());
        let scale = (self.current.train.objective() / self.current.train.number()).max(1.0);
        let own = score(
            (&self.case, &self.base),
            &self.current,
            (k, self.candidates),
            scale,
        );
        if let Some(r) = self.ranking.iter_mut().find(|r| r.term.label() == label) {
            r.score = own;
        }
    }

    fn go_on_with(&mut self, fit: Fit) {
        self.current = fit;
        self.gap = measured(&self.case, &self.current);
    }

    /// Contacts, resonances and bristles are stiff, and sticking within a step leaves an error of its own: the end of the fit has
    /// finer substeps, if the likelihood agrees.
    fn finish(&mut self) {
        let stiff = self.accepted.iter().any(state);
        let misfit = self.current.train.total() / self.current.train.number();
        let finer = stiff
            || (misfit < self.settings.largest_misfit
                && !verdict::white(&residue(&self.case, &self.current)));
        if finer {
            self.case.refined = FINER;
            self.case.unread = stiff;
            let finer = again(&self.case, &self.basis, &self.current);
            if finer.train.evidence() < self.current.train.evidence() {
                self.current = finer;
                if self.accepted.is_empty() {
                    self.base = self.current.clone();
                }
            } else {
                (self.case.refined, self.case.unread) = (1, false);
            }
        }
        let base = &mut self.base;
        base.train = value(
            &self.case,
            &Hypothesis::default(),
            &base.point,
            &base.gains,
            Role::Train,
        );
    }

    /// A law without a name, if one describes the records better than the effects found.
    fn imitated(&mut self) -> Option<Imitated> {
        if self.accepted.is_empty() {
            return None;
        }
        let joints = concerned(&self.accepted);
        let directions = basis(&self.case);
        let laws = free_laws(&self.case, &directions, self.settings, &self.base, joints);
        self.refits += laws.len();
        let mut better = laws
            .into_iter()
            .filter(|l| imitated(&self.case, &self.current, l));
        better.next().map(|refit| Imitated {
            gap: measured(&self.case, &refit.fit).total,
            refit,
        })
    }

    fn found(mut self, clock: Instant) -> Found {
        let imitated = self.imitated();
        let parts = Parts {
            case: &self.case,
            settings: self.settings,
            base: &self.base,
            before: &self.before,
            ranking: &self.ranking,
            accepted: &self.accepted,
            lagging: lagging_velocity(&self.case, self.settings),
            imitated,
            refits: self.refits,
            clock,
        };
        let (diagnosis, fit) = parts.verdict(self.current);
        Found {
            diagnosis,
            base: self.base,
            fit,
            rivals: self.ranking.into_iter().map(|r| r.fit).collect(),
            case: self.case,
        }
    }
}

fn state(term: &Term) -> bool {
    term.effect.info().kind == Kind::State
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
pub(super) fn listed(
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
pub(super) const TOUCH: usize = 4;

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
pub(super) fn directions(case: &Case, fit: &Fit) -> Basis {
    if fit.hypothesis.terms.iter().any(state) {
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
