//! Forward selection of effects with a backward and an exchange check (M. A. Efroymson 1960),
//! within the tolerances of a case.

use std::collections::BTreeSet;

use pid_data::Role;

use super::backward::{superfluous, without_each};
use super::candidates::{directions, has_state, listed, overdamped};
use super::exchange::exchange;
use super::lagging::Lagging;
use super::magnitude::{name, size_in_deviations, sizes};
use super::measure::{Reached, measured, misfit, noise_alone, noise_scale};
use super::nameless::{Imitated, concerned, free_laws, imitated};
use super::noise_like::{Leaves, lines_and_bursts};
use super::refit::{Refit, refit, score};
use super::settings::Settings;
use super::shorter::as_short;
use super::whiteness::residue;
use crate::case::Case;
use crate::criteria::{Budget, Criteria};
use crate::diagnosis::{Named, Residue};
use crate::effect::Term;
use crate::fit::{Basis, Effort, Fit, Point, basis, basis_as_run, fit, value};
use crate::gap::{Floor, Gap};
use crate::hypothesis::{Hypothesis, Run};
use crate::noise;
use crate::screen::screen;

/// What forward selection ended with.
#[derive(Debug)]
pub(super) struct Selection {
    /// The case; noise levels that were not stated as they were found.
    pub(super) case: Case,
    /// The nominal structure within its tolerances, and its gap.
    pub(super) base: Fit,
    pub(super) before: Gap,
    /// With the effects accepted and what the velocity channel adds, and its gap.
    pub(super) fit: Fit,
    pub(super) after: Gap,
    /// The gap that noise alone leaves.
    pub(super) floor: Floor,
    /// Candidates of the first round, best first; a second effect stands after the first.
    pub(super) ranking: Vec<Refit>,
    pub(super) accepted: Vec<Term>,
    pub(super) lagging: Option<Lagging>,
    /// A law without a name that describes the records better than the effects accepted.
    pub(super) imitated: Option<Imitated>,
    /// The effects of [`Selection::fit`] with their magnitudes.
    pub(super) effects: Vec<Named>,
    /// Mean squared innovation, of the nominal structure and of the effects accepted.
    pub(super) misfit: (f64, f64),
    pub(super) residue: Residue,
    /// Whether something is left that neither noise nor the effects explain.
    pub(super) unexplained: bool,
    pub(super) refits: usize,
}

/// Searches a case for the effects that explain it.
pub(super) fn select(case: &Case, settings: &Settings) -> Selection {
    let mut forward = Forward::start(case, settings);
    for round in 0..settings.budget.most {
        if settings.watch.stopped() || !forward.round(round) {
            break;
        }
    }
    forward.rest();
    forward.check();
    forward.rest();
    forward.finish();
    forward.check_sizes();
    forward.selection()
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
    /// Fits the nominal structure; noise levels that are not stated are settled on the most
    /// promising candidate.
    fn start(case: &Case, settings: &'a Settings) -> Self {
        let mut case = case.clone();
        let basis = basis(&case);
        let nothing = Hypothesis::default();
        let start = Point {
            theta: vec![0.0; case.nominal.size()],
            e: Vec::new(),
        };
        settings.watch.step("nominal parameters");
        let mut base = fit(
            &case,
            &basis,
            &nothing,
            start,
            Effort::full(settings.budget.steps),
        );
        let mut shortlist = None;
        if noise::settle(&mut case, &base) {
            base = again(&case, &basis, settings, &base);
            // What the nominal structure leaves is not all noise.
            let (better, short) = sketch(&case, &basis, settings, &base);
            if let Some(better) = better {
                noise::settle(&mut case, &better);
                base = again(&case, &basis, settings, &base);
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

    /// Screens and refits all candidates on top of what is accepted; takes the best if it pays.
    /// Whether a further round may find more.
    fn round(&mut self, round: usize) -> bool {
        let settings = self.settings;
        let mut list = listed(&self.case, &self.basis, settings, &self.current);
        let number = list.len();
        let (count, words) = (round + 1, "candidates for effect");
        settings.watch.step(&format!("{number} {words} {count}"));
        self.candidates = self.candidates.max(number);
        if let Some(short) = self.shortlist.take() {
            list.retain(|(term, _)| short.contains(&term.label()));
        }
        let (best, slopes) = screen(
            &self.case,
            &self.basis,
            &self.current,
            &list,
            &settings.budget,
        );
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
        if let Some(short) = self.short(first) {
            self.go_on_with(short);
            if self.accepted.is_empty() {
                (self.base, self.before) = (self.current.clone(), self.gap.clone());
            }
            return self.round(round);
        }
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
        let criteria = &settings.criteria;
        self.drifts = self.gap.total > criteria.near * floor;
        self.drifts || self.current.train.total() >= criteria.calm * self.current.train.number()
    }

    /// What is accepted at the substeps of the best candidate, where that leaves too little for it to gain.
    fn short(&self, first: &Refit) -> Option<Fit> {
        let short = as_short(
            &self.case,
            &self.basis,
            self.settings,
            &self.current,
            &first.fit,
        )?;
        let score = score(
            &Reached::new(&self.case, &first.fit),
            &Reached::new(&self.case, &short),
            self.candidates,
            (noise_scale(&first.fit), short.train.number()),
        );
        (score < self.settings.criteria.margin()).then_some(short)
    }

    /// Whether the best candidate of a round gains more than chance and multiplicity allow, with
    /// the gap `after`.
    fn pays(&self, first: &Refit, after: &Gap, round: usize) -> bool {
        let (criteria, current) = (&self.settings.criteria, &self.current);
        let held_out =
            Reached::new(&self.case, &first.fit).held_out(&Reached::new(&self.case, current));
        let relative =
            (current.train.evidence() - first.fit.train.evidence()) / current.train.objective();
        let (least, shrink) = match round {
            0 => (criteria.least_decrease, criteria.least_shrink),
            _ => (criteria.least_second_decrease, 2.0 * criteria.least_shrink),
        };
        let shrinks = after.total < (1.0 - shrink) * self.gap.total;
        let enough = relative > least
            || (self.drifts && after.total < (1.0 - criteria.drift_shrink) * self.gap.total);
        // One of two effects may hide behind the other in free runs: it is kept until the last
        // round shows what both give. Noise levels that were settled on one effect hide part of
        // what the other does: there the score decides.
        let open = self.case.noise.iter().any(|n| !n.stated);
        let large = relative > criteria.large_decrease;
        let strong =
            large || (open && first.score > 2.0 * criteria.beyond_doubt * criteria.margin());
        let provisional = strong && round + 1 < self.settings.budget.most;
        // Free runs scatter; predictions of motions never fitted are then beyond doubt.
        let beyond_doubt = large
            && held_out > criteria.beyond_doubt * criteria.margin()
            && after.total < self.gap.total;
        first.score > criteria.margin()
            && held_out > 0.0
            && enough
            && (shrinks || provisional || beyond_doubt)
            && size_in_deviations(criteria, &first.fit) > criteria.size()
            && !overdamped(&self.case, &first.fit)
    }

    /// Goes on with a candidate.
    fn accept(&mut self, first: &Refit, after: Gap) {
        self.accepted.push(first.term.clone());
        self.current = first.fit.clone();
        self.gap = after;
        if has_state(&first.term) {
            self.basis = directions(&self.case, &self.current);
            self.current = fit(
                &self.case,
                &self.basis,
                &self.current.hypothesis,
                self.current.point.clone(),
                Effort::full(self.settings.budget.steps),
            );
            self.gap = measured(&self.case, &self.current);
        }
        if noise::settle(&mut self.case, &self.current) {
            self.current = again(&self.case, &self.basis, self.settings, &self.current);
            self.gap = measured(&self.case, &self.current);
        }
        if self.accepted.len() == 1 {
            self.alone = Some(self.current.clone());
        }
    }

    /// Goes on to the optimum of what is accepted: refits of candidates have few steps, and gains of loops trade with
    /// much else along narrow valleys. Of two effects one may have nothing left to do there.
    fn rest(&mut self) {
        if self.accepted.is_empty() {
            return;
        }
        let steps = self.settings.budget.steps;
        if let Some(rested) = self.current.rested(&self.case, &self.basis, steps) {
            self.go_on_with(rested);
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
                // The candidates for the first place are those beside the later effects now, which
                // stand behind the first.
                let later: Vec<Refit> = self.ranking.drain(1..self.accepted.len()).collect();
                self.ranking = exchanged.tried;
                self.ranking.splice(1..1, later);
                self.alone = None;
            }
        }
        if self.accepted.len() > 1
            && let Some(first) = self.alone.take()
            && without_size(
                &sizes(&self.case, &settings.criteria, &self.current),
                &settings.criteria,
            )
        {
            self.go_on_with(first);
            self.accepted.truncate(1);
            self.ranking.remove(1);
        }
        if self.gap.total > (1.0 - settings.criteria.least_shrink) * self.before.total {
            self.current = self.base.clone();
            self.accepted.clear();
        }
    }

    /// An effect that is left alone was scored on top of another one.
    fn scored_alone(&mut self) {
        let [only] = &self.accepted[..] else {
            return;
        };
        let label = only.label();
        let own = score(
            &Reached::new(&self.case, &self.current),
            &Reached::new(&self.case, &self.base),
            self.candidates,
            (noise_scale(&self.current), self.base.train.number()),
        );
        if let Some(r) = self.ranking.iter_mut().find(|r| r.term.label() == label) {
            r.score = own;
        }
    }

    /// Takes the last of two effects back whose size the finer substeps at the end took away.
    fn check_sizes(&mut self) {
        let criteria = &self.settings.criteria;
        if self.accepted.len() != 2
            || !without_size(&sizes(&self.case, criteria, &self.current), criteria)
        {
            return;
        }
        let (mut hypothesis, mut point) =
            (self.current.hypothesis.clone(), self.current.point.clone());
        let Some(last) = hypothesis.terms.pop() else {
            return;
        };
        let left = point.e.len() - last.effect.info().parameters.len();
        point.e.truncate(left);
        let effort = Effort::full(self.settings.budget.steps);
        let without = fit(&self.case, &self.basis, &hypothesis, point, effort);
        self.go_on_with(without);
        self.accepted.pop();
        let label = last.label();
        self.ranking.retain(|r| r.term.label() != label);
    }

    fn go_on_with(&mut self, fit: Fit) {
        self.current = fit;
        self.gap = measured(&self.case, &self.current);
    }

    /// Contacts, resonances and bristles are stiff, and sticking within a step leaves an error of
    /// its own: the end of the fit has finer substeps, if the likelihood agrees.
    fn finish(&mut self) {
        let criteria = &self.settings.criteria;
        let stiff = self.accepted.iter().any(has_state);
        let finer = stiff
            || (misfit(&self.current) < criteria.largest_misfit
                && lines_and_bursts(criteria, &residue(&self.case, &self.current)));
        if finer {
            let mut finer = self.current.clone();
            finer.hypothesis.run = Run {
                finer: self.settings.budget.finer,
                initial_states: stiff,
                ..self.current.hypothesis.run
            };
            let finer = again(&self.case, &self.basis, self.settings, &finer);
            if finer.train.evidence() < self.current.train.evidence() {
                self.current = finer;
                if self.accepted.is_empty() {
                    self.base = self.current.clone();
                }
                // What it is compared with is run alike.
                let run = self.current.hypothesis.run;
                self.base.hypothesis.run = run;
                for rival in &mut self.ranking {
                    rival.fit.hypothesis.run = run;
                }
            }
        }
        let base = &mut self.base;
        base.train = value(
            &self.case,
            &base.hypothesis,
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
        let directions = basis_as_run(&self.case, self.base.hypothesis.run);
        let laws = free_laws(&self.case, &directions, self.settings, &self.base, joints);
        self.refits += laws.len();
        let mut better = laws
            .into_iter()
            .filter(|l| imitated(&self.case, &self.settings.criteria, &self.current, l));
        better.next().map(|refit| Imitated {
            gap: measured(&self.case, &refit.fit).total,
            refit,
        })
    }

    /// What is left, and whether it is noise.
    fn selection(mut self) -> Selection {
        let imitated = self.imitated();
        let criteria = &self.settings.criteria;
        let lagging = Lagging::find(&self.case, self.settings);
        let misfit = (misfit(&self.base), misfit(&self.current));
        let residue = residue(&self.case, &self.current);
        let mut effects = name(&self.case, criteria, &self.current);
        let mut fit = self.current;
        if let Some(lag) = &lagging {
            fit.hypothesis.terms.push(lag.term.clone());
            fit.point.e.push(lag.constant.value);
            effects.insert(0, lag.named());
        }
        let after = measured(&self.case, &fit);
        let floor = noise_alone(&self.case, &fit);
        let leaves = Leaves {
            gap: after.total,
            floor,
            misfit,
            residue,
            stated: self.case.noise.iter().all(|n| n.stated),
            stiff: self.accepted.iter().any(Term::splits_joint),
        };
        Selection {
            unexplained: imitated.is_some() || leaves.unexplained(!effects.is_empty(), criteria),
            case: self.case,
            base: self.base,
            before: self.before,
            fit,
            after,
            floor,
            ranking: self.ranking,
            accepted: self.accepted,
            lagging,
            imitated,
            effects,
            misfit,
            residue,
            refits: self.refits,
        }
    }
}

/// Whether the second of two effects is none, by the [`sizes`] of both beside each other: two that
/// are both small imitate together what the library lacks, and a second one may take up what the
/// smooth form of a contact leaves.
fn without_size(sizes: &[f64], criteria: &Criteria) -> bool {
    let [first, second, ..] = *sizes else {
        return false;
    };
    second < criteria.second_size() || first.max(second) < criteria.size()
}

/// The same hypothesis under the noise levels as they are now.
fn again(case: &Case, basis: &Basis, settings: &Settings, at: &Fit) -> Fit {
    fit(
        case,
        basis,
        &at.hypothesis,
        at.point.clone(),
        Effort::full(settings.budget.touch),
    )
}

/// The most likely of the best candidates after a few steps, `None` if none gains beyond its
/// penalty; and those that are worth screening again under the noise levels that follow from it.
fn sketch(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    base: &Fit,
) -> (Option<Fit>, BTreeSet<String>) {
    let list = listed(case, basis, settings, base);
    let (best, slopes) = screen(case, basis, base, &list, &settings.budget);
    let short = best
        .iter()
        .take(settings.budget.shortlist)
        .map(|c| c.term.label())
        .collect();
    let few = Settings {
        budget: Budget {
            refits: settings.budget.sketched,
            ..settings.budget.clone()
        },
        ..settings.clone()
    };
    let tried = refit(case, basis, &few, base, (&best, &slopes), list.len());
    let first = tried.into_iter().next();
    let better = first
        .filter(|f| f.score > settings.criteria.margin())
        .map(|f| f.fit);
    (better, short)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_effect_needs_a_size_of_its_own() {
        let none = |sizes: &[f64]| without_size(sizes, &Criteria::default());
        // Beside a backlash, what its smooth form leaves.
        assert!(none(&[40.0, 1.6]));
        // Two that imitate a third together.
        assert!(none(&[2.4, 2.8]));
        assert!(!none(&[2.4, 9.0]) && !none(&[40.0, 2.4]));
        assert!(!none(&[1.0]) && !none(&[]));
    }
}
