//! Screening: how much each effect at each joint would gain, without refitting everything.
//!
//! Effects with an absent point (see [`Info::amplitudes`](crate::effect::Info::amplitudes)) take
//! the exact score test there: derivatives of the innovations in their amplitudes at zero, many
//! effects side by side in one pass, and the minimum of the quadratic model with the nominal
//! parameters free within their tolerances,
//!
//! ```text
//! gain = ½ ε₀ᵀε₀ − min over (θ, e) ½ |ε₀ + J_θ Δθ + J_e e|² + prior
//! ```
//!
//! (C. R. Rao 1948; as in D. A. Sprott, Statistical Inference in Science, 2000, for the bounded
//! form). The others are linearised at each of their starts.

use nalgebra::{DMatrix, DVector};
use pid_data::Role;
use pid_interpret::nominal::Role as Kind;
use rayon::prelude::*;

use crate::case::Case;
use crate::criteria::Budget;
use crate::effect::{Effect, LANES, Term};
use crate::excerpt::excerpt;
use crate::fit::{
    Basis, Direction, Effort, Fit, Linear, PRIOR, Point, Slopes, all_gains, approach, cross, fit,
    gram, linearise, log_dets, ranges, value, value_below,
};
use crate::hypothesis::Hypothesis;
use crate::servo;

use std::sync::{Arc, Mutex};

/// Directions of a joint at least, beside its rotor, along which starts are compared: inertia, weight and friction.
const FEWEST: usize = 3;

/// A candidate with the start that promises most.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// The effect and its joint.
    pub term: Term,
    /// Parameters to start a refit from, SI.
    pub start: Vec<f64>,
    /// Deviations to start from.
    pub theta: Vec<f64>,
    /// Predicted objective (sum of squares and prior).
    pub objective: f64,
}

/// Linearised fit that the candidates are compared with.
struct Reference<'a> {
    case: &'a Case,
    /// The part of it on which starts are compared.
    glanced: &'a Case,
    fit: &'a Fit,
    basis: &'a Basis,
    budget: &'a Budget,
    lin: Linear,
    /// Curvature and gradient along the basis, data only.
    h: DMatrix<f64>,
    /// Gradient of its innovations along these.
    pull: DVector<f64>,
}

/// Every effect of a library at every joint it can have beside the terms already there, with its
/// start values in SI.
pub fn candidates(
    case: &Case,
    library: &[Arc<dyn Effect>],
    present: &Hypothesis,
) -> Vec<(Term, Vec<Vec<f64>>)> {
    let mut out = Vec::new();
    for effect in library {
        let info = effect.info();
        if effect.needs_bodies() && !case.nominal.has_bodies() {
            continue;
        }
        if effect.needs_inputs() && case.n() < 2 {
            continue;
        }
        let joints = if info.has_joint { case.n() } else { 1 };
        for joint in 0..joints {
            // Where a drive has a position loop that can have this stage and does not state it.
            let servo = case.nominal.description.servo(joint);
            if effect
                .stage()
                .is_some_and(|stage| servo.is_none_or(|servo| !servo.lacks(stage)))
            {
                continue;
            }
            if effect.needs_partner() && effect.partner(joint).is_none() {
                continue;
            }
            let known = &case.known.hypothesis.terms;
            if (present.terms.iter().chain(known))
                .any(|t| t.effect.info().id == info.id && (t.joint == joint || !info.has_joint))
            {
                continue;
            }
            let effect = effect.clone();
            let term = Term { effect, joint };
            let starts = case.starts(&term);
            out.push((term, starts));
        }
    }
    out
}

/// Scores all candidates on top of a fit, best first; with the fit's derivatives along the basis,
/// for refits to borrow.
pub fn screen(
    case: &Case,
    basis: &Basis,
    fit: &Fit,
    candidates: &[(Term, Vec<Vec<f64>>)],
    budget: &Budget,
) -> (Vec<Candidate>, Slopes) {
    let lin = fit.linearised(case, basis);
    let h = gram(&lin.j);
    let pull = lin.j.tr_mul(&lin.r);
    let glanced = excerpt(case, budget.glanced);
    let reference = Reference {
        case,
        glanced: &glanced,
        fit,
        basis,
        budget,
        lin,
        h,
        pull,
    };
    let mut out = reference.score_tests(candidates);
    out.extend(reference.finite(candidates));
    // The best start of each.
    out.sort_by(|a, b| a.objective.total_cmp(&b.objective));
    let mut seen = std::collections::BTreeSet::new();
    out.retain(|c| seen.insert(c.term.label()));
    let rank = basis.columns.ncols();
    let slopes = Slopes::first(reference.lin.j, &reference.h, rank);
    (out, slopes)
}

/// Evidence that a start may lose to be compared with the lowest one of its candidate, which loses `least`.
fn most_lost(budget: &Budget, least: f64) -> f64 {
    (budget.far * least).max(budget.near)
}

impl Reference<'_> {
    /// Effects that can be absent at zero amplitude, packed into passes of [`LANES`] derivatives.
    fn score_tests(&self, candidates: &[(Term, Vec<Vec<f64>>)]) -> Vec<Candidate> {
        let mut packs: Vec<Vec<(Term, Vec<f64>)>> = Vec::new();
        let mut used = LANES;
        for (term, starts) in candidates {
            let amplitudes = term.effect.info().amplitudes;
            if amplitudes.is_empty() {
                continue;
            }
            let mut seen: Vec<Vec<f64>> = Vec::new();
            for s in starts {
                let mut e = s.clone();
                for &a in amplitudes {
                    e[a] = 0.0;
                }
                // Starts that differ in the amplitudes alone are one point.
                if seen.contains(&e) {
                    continue;
                }
                seen.push(e.clone());
                if used + amplitudes.len() > LANES {
                    packs.push(Vec::new());
                    used = 0;
                }
                used += amplitudes.len();
                if let Some(last) = packs.last_mut() {
                    last.push((term.clone(), e));
                }
            }
        }
        packs
            .par_iter()
            .flat_map_iter(|pack| self.one_pack(pack))
            .collect()
    }

    fn one_pack(&self, pack: &[(Term, Vec<f64>)]) -> Vec<Candidate> {
        let mut hypothesis = self.fit.hypothesis.clone();
        let mut at = self.fit.point.clone();
        let mut lanes = Vec::new();
        for (term, e) in pack {
            let first = at.e.len();
            hypothesis.terms.push(term.clone());
            at.e.extend_from_slice(e);
            lanes.extend(term.effect.info().amplitudes.iter().map(|a| first + a));
        }
        let directions: Vec<Direction<'_>> = lanes.iter().map(|&i| Direction::Effect(i)).collect();
        let lin = linearise(
            self.case,
            &hypothesis,
            &at,
            &self.fit.gains,
            Role::Train,
            &directions,
        );
        if lin.r.len() != self.lin.r.len() {
            return Vec::new();
        }
        let mut out = Vec::new();
        let mut column = 0;
        for (term, e) in pack {
            let amplitudes = term.effect.info().amplitudes;
            let block = lin.j.columns(column, amplitudes.len()).into_owned();
            column += amplitudes.len();
            let alone = Hypothesis::new(vec![term.clone()]);
            let bounds = ranges(self.case, &alone);
            let limits: Vec<(f64, f64)> = amplitudes.iter().map(|&a| bounds[a]).collect();
            let (objective, theta, step) = self.minimise(
                &self.fit.point.theta,
                (&self.lin.r, &self.pull),
                &block,
                &limits,
            );
            let mut start = e.clone();
            for (&a, s) in amplitudes.iter().zip(&step) {
                start[a] = *s;
            }
            // A refit must leave the absent point to see the shape parameters.
            if step.iter().all(|s| *s == 0.0) {
                continue;
            }
            out.push(Candidate {
                term: term.clone(),
                start,
                theta,
                objective,
            });
        }
        out
    }

    /// The others: from the starts that are [`followed`](Self::followed) a few steps in the
    /// effect's own parameters, then the quadratic model.
    fn finite(&self, candidates: &[(Term, Vec<Vec<f64>>)]) -> Vec<Candidate> {
        let terms: Vec<&(Term, Vec<Vec<f64>>)> = candidates
            .iter()
            .filter(|(t, _)| t.effect.info().amplitudes.is_empty())
            .collect();
        let jobs: Vec<(usize, Point)> = (terms.iter().enumerate())
            .flat_map(|(i, (term, starts))| {
                let own = self.starts(term, starts).into_iter();
                own.map(move |at| (i, at))
            })
            .collect();
        // A start that neither gains nor is the lowest of its candidate, or loses far more than that one, is known
        // to after a part of the records.
        let present = self.present();
        let lowest: Vec<Mutex<f64>> = terms.iter().map(|_| Mutex::new(f64::INFINITY)).collect();
        let values: Vec<(usize, Point, f64)> = jobs
            .par_iter()
            .filter_map(|(i, at)| {
                let (i, at) = (*i, at.clone());
                let (hypothesis, _) = self.with(&terms[i].0, &[]);
                let gains = all_gains(self.glanced, &hypothesis, &at);
                let spread: f64 = log_dets(self.glanced, &gains, Role::Train).iter().sum();
                let bound = lowest[i].lock().map_or(f64::INFINITY, |lowest| {
                    self.bound(&terms[i].0, *lowest, present)
                });
                let value = value_below(bound - spread, self.glanced, &hypothesis, &at, &gains)?;
                let evidence = value.evidence();
                if let Ok(mut l) = lowest[i].lock() {
                    *l = l.min(evidence);
                }
                Some((i, at, evidence))
            })
            .collect();
        let followed = self.followed(&terms, &values, present);
        let frozen = self.basis.frozen();
        followed
            .par_iter()
            .filter_map(|(i, at)| self.approached(&terms[*i].0, at.clone(), &frozen))
            .collect()
    }

    /// A candidate some steps in its own parameters from a start, then as the quadratic model has it.
    fn approached(&self, term: &Term, start: Point, frozen: &Basis) -> Option<Candidate> {
        let (hypothesis, _) = self.with(term, &[]);
        let at = approach(
            self.glanced,
            frozen,
            &hypothesis,
            start,
            self.budget.approach,
        );
        // Gains of a part of the records are not those of all.
        let gains = all_gains(self.case, &hypothesis, &at);
        let spread: f64 = log_dets(self.case, &gains, Role::Train).iter().sum();
        let (first, at) = (self.fit.point.e.len(), &at);
        let own: Vec<Direction<'_>> = (first..at.e.len()).map(Direction::Effect).collect();
        let lin = linearise(self.case, &hypothesis, at, &gains, Role::Train, &own);
        if lin.r.len() != self.lin.r.len() {
            return None;
        }
        let pull = self.lin.j.tr_mul(&lin.r);
        let alone = Hypothesis::new(vec![term.clone()]);
        let own = &at.e[first..];
        let ranges = ranges(self.case, &alone);
        // As far as the model holds.
        let limits: Vec<(f64, f64)> = (ranges.iter().zip(own))
            .map(|((low, high), s)| {
                let down = (low - s).max(-0.7 * s.abs()).min(0.0);
                (down, (high - s).min(1.5 * s.abs()).max(0.0))
            })
            .collect();
        let (objective, theta, step) = self.minimise(&at.theta, (&lin.r, &pull), &lin.j, &limits);
        Some(Candidate {
            term: term.clone(),
            start: own.iter().zip(&step).map(|(s, d)| s + d).collect(),
            theta,
            // Gains of its own: the predicted covariances count.
            objective: objective + spread - self.fit.train.spread(),
        })
    }

    /// Of every term the lowest start; where several gain already, or starts are compared beside the
    /// parameters of their joint, the lowest after [`Budget::glance`] steps from each,
    /// [`Budget::followed`] at most.
    fn followed(
        &self,
        terms: &[&(Term, Vec<Vec<f64>>)],
        values: &[(usize, Point, f64)],
        present: f64,
    ) -> Vec<(usize, Point)> {
        let frozen = self.basis.frozen();
        (0..terms.len())
            .into_par_iter()
            .flat_map_iter(|i| -> Vec<(usize, Point)> {
                let mut own: Vec<&(usize, Point, f64)> =
                    values.iter().filter(|v| v.0 == i).collect();
                own.sort_by(|a, b| a.2.total_cmp(&b.2));
                if let Some(lowest) = own.first().map(|v| v.2) {
                    let bound = self.bound(&terms[i].0, lowest, present);
                    own.retain(|v| v.2 <= bound);
                }
                let (hypothesis, _) = self.with(&terms[i].0, &[]);
                let lowest = |mut near: Vec<Fit>| -> Vec<(usize, Point)> {
                    near.sort_by(|a, b| a.train.evidence().total_cmp(&b.train.evidence()));
                    let gain = |f: &Fit| present - f.train.evidence();
                    let least = near.first().map_or(0.0, |f| self.budget.hopeless * gain(f));
                    // Behind the lowest one those that gain about as much.
                    let mut rank = 0..;
                    near.retain(|f| rank.next() == Some(0) || gain(f) > least.max(0.0));
                    near.truncate(self.budget.followed);
                    near.into_iter().map(|f| (i, f.point)).collect()
                };
                if self.beside_joint(&terms[i].0) {
                    own.truncate(self.budget.beside_joint);
                    let near = |v: &&(usize, Point, f64)| {
                        self.near(terms[i].0.joint, &hypothesis, v.1.clone())
                    };
                    return lowest(own.par_iter().map(near).collect());
                }
                if own.len() < 2 {
                    return own.iter().map(|v| (i, v.1.clone())).collect();
                }
                let glance = |v: &&(usize, Point, f64)| {
                    let effort = Effort::on_the_way(self.budget.glance);
                    fit(self.glanced, &frozen, &hypothesis, v.1.clone(), effort)
                };
                lowest(own.par_iter().map(glance).collect())
            })
            .collect()
    }

    /// Evidence of the fit where starts are compared.
    fn present(&self) -> f64 {
        let (hypothesis, point) = (&self.fit.hypothesis, &self.fit.point);
        let gains = all_gains(self.glanced, hypothesis, point);
        value(self.glanced, hypothesis, point, &gains, Role::Train).evidence()
    }

    /// Evidence up to which a start of a term is compared with its lowest one: that of the fit or of the lowest, or
    /// not [`Budget::far`] behind it where the parameters of its joint are free.
    fn bound(&self, term: &Term, lowest: f64, present: f64) -> f64 {
        match self.beside_joint(term) {
            true => present + most_lost(self.budget, lowest - present),
            false => lowest.max(present),
        }
    }

    /// Whether the starts of a term are compared with the nominal parameters of its joint free: gains of a loop that
    /// were fitted without a stage make up for it.
    fn beside_joint(&self, term: &Term) -> bool {
        let asked = self.budget.starts_beside_joint || term.effect.stage().is_some();
        asked && term.effect.info().has_joint
    }

    /// A few steps from a start, along directions of the nominal parameters of a joint and the parameters of the
    /// effects: a gear that gives way tells a load apart that a stiff one adds to its rotor.
    fn near(&self, joint: usize, hypothesis: &Hypothesis, at: Point) -> Fit {
        let columns = self.beside(joint, LANES.saturating_sub(at.e.len()));
        let effort = Effort::on_the_way(self.budget.glance);
        fit(self.glanced, &Basis { columns }, hypothesis, at, effort)
    }

    /// Directions of the nominal parameters of a joint, about so many: its rotor, and what the records tell most of
    /// the others.
    fn beside(&self, joint: usize, many: usize) -> DMatrix<f64> {
        let (size, rank) = self.basis.columns.shape();
        let rotor = self.case.nominal.place(joint, Kind::RotorInertia);
        let others: Vec<usize> = (0..size)
            .filter(|&i| self.case.nominal.values[i].joint == Some(joint) && Some(i) != rotor)
            .collect();
        let own = self.basis.columns.select_rows(&others);
        let told = &own * self.h.view((0, 0), (rank, rank)) * own.transpose();
        let eigen = told.symmetric_eigen();
        let mut order: Vec<usize> = (0..others.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        order.truncate(many.max(FEWEST + 1) - 1);
        let mut columns = DMatrix::zeros(size, order.len() + usize::from(rotor.is_some()));
        for (c, &k) in order.iter().enumerate() {
            for (row, &i) in others.iter().enumerate() {
                columns[(i, c)] = eigen.eigenvectors[(row, k)];
            }
        }
        if let Some(rotor) = rotor {
            columns[(rotor, order.len())] = 1.0;
        }
        columns
    }

    /// The points at which a term is looked at first: its starts, and where the law of its loop with it explains the
    /// motion, with the gains that it has there.
    fn starts(&self, term: &Term, starts: &[Vec<f64>]) -> Vec<Point> {
        let mut out: Vec<Point> = starts.iter().map(|s| self.with(term, s).1).collect();
        for own in &self.case.staged {
            if let Some((e, theta)) = servo::start(self.case, own, term, &self.fit.point.theta) {
                let mut at = self.with(term, &e).1;
                at.theta = theta;
                out.push(at);
            }
        }
        out
    }

    /// The hypothesis at hand with a further term, and its point.
    fn with(&self, term: &Term, start: &[f64]) -> (Hypothesis, Point) {
        let mut hypothesis = self.fit.hypothesis.clone();
        hypothesis.terms.push(term.clone());
        let mut at = self.fit.point.clone();
        at.e.extend_from_slice(start);
        (hypothesis, at)
    }

    /// Minimum of the quadratic model about `theta` over θ, the parameters of the effects present and
    /// the columns `block`, from innovations `r` and their product `pull` with the derivatives of the reference:
    /// objective (twice the model), θ there, step of the block.
    fn minimise(
        &self,
        theta: &[f64],
        (r, pull): (&DVector<f64>, &DVector<f64>),
        block: &DMatrix<f64>,
        limits: &[(f64, f64)],
    ) -> (f64, Vec<f64>, Vec<f64>) {
        let (size, rank) = self.basis.columns.shape();
        let old = self.fit.point.e.len();
        let m = block.ncols();
        let total = rank + old + m;
        let mut hz = DMatrix::zeros(total, total);
        hz.view_mut((0, 0), (rank + old, rank + old))
            .copy_from(&self.h);
        let mixed = cross(&self.lin.j, block);
        hz.view_mut((0, rank + old), (rank + old, m))
            .copy_from(&mixed);
        hz.view_mut((rank + old, 0), (m, rank + old))
            .copy_from(&mixed.transpose());
        hz.view_mut((rank + old, rank + old), (m, m))
            .copy_from(&gram(block));
        let mut gz = DVector::zeros(total);
        gz.rows_mut(0, rank + old).copy_from(pull);
        gz.rows_mut(rank + old, m).copy_from(&block.tr_mul(r));
        let mut wide = DMatrix::zeros(size + old + m, total);
        wide.view_mut((0, 0), (size, rank))
            .copy_from(&self.basis.columns);
        for i in 0..old + m {
            wide[(size + i, rank + i)] = 1.0;
        }
        let mut h = &wide * hz * wide.transpose();
        let mut g = &wide * gz;
        let mut prior = 0.0;
        for i in 0..size {
            h[(i, i)] += 1.0 / (PRIOR * PRIOR);
            g[i] += theta[i] / (PRIOR * PRIOR);
            prior += (theta[i] / PRIOR).powi(2);
        }
        let bounds = ranges(self.case, &self.fit.hypothesis);
        let mut low = DVector::zeros(size + old + m);
        let mut high = DVector::zeros(size + old + m);
        for i in 0..size {
            (low[i], high[i]) = (-1.0 - theta[i], 1.0 - theta[i]);
        }
        for i in 0..old {
            let e = self.fit.point.e[i];
            (low[size + i], high[size + i]) = (bounds[i].0 - e, bounds[i].1 - e);
        }
        for i in 0..m {
            (low[size + old + i], high[size + old + i]) = limits[i];
        }
        let quadratic = crate::fit::Quadratic { h, g };
        // A candidate whose start is no minimiser is refitted all the same, and its refit counts.
        let (x, _) = quadratic.minimise(&low, &high);
        let objective = r.norm_squared() + prior + 2.0 * quadratic.at(&x);
        (
            objective,
            (0..size).map(|i| theta[i] + x[i]).collect(),
            (0..m).map(|i| x[size + old + i]).collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_far_behind_the_lowest_are_left_out() {
        let compared = |least: f64, own: f64| own <= most_lost(&Budget::default(), least);
        // Loss of the lowest start, and of another one.
        assert!(compared(100.0, 499.0) && !compared(100.0, 501.0));
        // Where one is about as good as none, or better, those that lose little stay.
        assert!(compared(1.0, 29.0) && !compared(1.0, 31.0));
        assert!(compared(-1000.0, 29.0) && !compared(-1000.0, 31.0));
    }
}
