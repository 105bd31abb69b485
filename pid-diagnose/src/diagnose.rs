//! From a case to a verdict.
//!
//! The nominal structure is fitted within its tolerances; all effects at all joints are screened on top; the best are refitted in
//! full and ranked by their objective with a penalty per parameter; a second effect is looked for on top of the first. An effect is
//! named only if it gains more than chance and multiplicity allow, on the train records and on records never fitted.

use std::sync::Arc;

use nalgebra::DMatrix;
use pid_runtime::data::Role;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::case::Case;
use crate::channel;
use crate::effect::{Effect, Term};
use crate::fit::{Basis, Effort, Fit, Point, basis, fit, value};
use crate::gap::{Gap, floor, gap};
use crate::plant::{GAIN, PER_JOINT};
use crate::screen::{candidates, screen};
use crate::simulate::Hypothesis;
use crate::windows;

/// Version of the JSON form.
pub const SCHEMA_VERSION: u32 = 1;

/// Relative decrease of the objective with which an effect is kept for a further round although the gap does not shrink yet.
const PROVISIONAL: f64 = 0.1;
/// Factor on the limits of what counts as unexplained where the noise is an estimate.
const ESTIMATED: f64 = 1.6;

/// Mean squared innovation below which no further effect is looked for.
const EXPLAINED: f64 = 1.1;

/// What may be set.
#[derive(Clone)]
pub struct Settings {
    /// The effects considered; [`effects::all`](crate::effects::all) and the user's own.
    pub effects: Vec<Arc<dyn Effect>>,
    /// How many candidates are refitted in full.
    pub refits: usize,
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
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            effects: crate::effects::all(),
            refits: 7,
            steps: 14,
            most: 2,
            margin: 12.0,
            least_shrink: 0.06,
            least_size: 3.0,
            unexplained: 1.9,
            largest_misfit: 1.6,
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

/// A refitted candidate.
struct Refit {
    term: Term,
    fit: Fit,
    score: f64,
}

/// Diagnoses a case.
pub fn diagnose(case: &Case, settings: &Settings) -> Diagnosis {
    let clock = std::time::Instant::now();
    let basis = basis(case);
    let size = case.n() * PER_JOINT;
    let base = fit(
        case,
        &basis,
        &Hypothesis::default(),
        Point {
            theta: vec![0.0; size],
            e: Vec::new(),
        },
        Effort::full(settings.steps),
    );
    let before = measured(case, &base);
    let mut current = base.clone();
    let mut current_gap = before.clone();
    let mut ranking: Vec<Refit> = Vec::new();
    let mut refits = 0;
    let mut accepted: Vec<Term> = Vec::new();
    for round in 0..settings.most {
        let mut list = candidates(case, &settings.effects, &current.hypothesis);
        for (term, starts) in &mut list {
            starts.extend(windows::start(case, &basis, &current, term));
        }
        let (best, slopes) = screen(case, &basis, &current, &list);
        let tried = refit(
            case,
            &basis,
            settings,
            &current,
            (&best, &slopes),
            list.len(),
        );
        refits += tried.len();
        let Some(first) = tried.first() else { break };
        let after = measured(case, &first.fit);
        let held_out = test_value(case, &current) - test_value(case, &first.fit);
        let significant = first.score > settings.margin;
        let relative =
            (current.train.evidence() - first.fit.train.evidence()) / current.train.objective();
        let needed = if round == 0 {
            settings.least_shrink
        } else {
            2.0 * settings.least_shrink
        };
        let shrinks = after.total < (1.0 - needed) * current_gap.total;
        let enough = relative > if round == 0 { 0.002 } else { 0.03 };
        // One of two effects may hide behind the other in free runs: it is kept until the last round shows what both give.
        let provisional = relative > PROVISIONAL && round + 1 < settings.most;
        let take = significant
            && held_out > 0.0
            && enough
            && (shrinks || provisional)
            && size_in_deviations(&first.fit) > settings.least_size;
        if take {
            accepted.push(first.term.clone());
            current = first.fit.clone();
            current_gap = after;
        }
        if round == 0 {
            ranking = tried;
        } else if take {
            let mut tried = tried;
            let second = tried.remove(0);
            ranking.insert(1.min(ranking.len()), second);
        }
        // Nothing is left to look for where the innovations are as large as the noise.
        if !take || current.train.total() < EXPLAINED * current.train.number() {
            break;
        }
    }
    if current_gap.total > (1.0 - settings.least_shrink) * before.total {
        current = base.clone();
        accepted.clear();
    }
    let lagging = lagging_velocity(case, settings);
    finish(
        case, settings, &base, &before, current, &ranking, &accepted, lagging, refits, clock,
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

/// Steps after which the refits are compared, how many go on, and whether they end at an optimum of their own.
const STAGES: [(usize, usize, bool); 3] = [(3, usize::MAX, false), (5, 4, false), (8, 2, true)];
/// Mean squared innovation of the leader above which it is followed to its end.
const LEFT: f64 = 1.1;
/// Share of the best gain below which a candidate is not followed further.
const HOPELESS: f64 = 0.35;

/// Refits the most promising candidates, those that fall behind for a few steps only; best score first.
fn refit(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    current: &Fit,
    (best, slopes): (&[crate::screen::Candidate], &DMatrix<f64>),
    tried: usize,
) -> Vec<Refit> {
    let mut out: Vec<Refit> = Vec::new();
    for (stage, &(steps, many, exact)) in STAGES.iter().enumerate() {
        let effort = Effort {
            steps: steps.min(settings.steps),
            slopes: Some(slopes),
            exact,
        };
        if stage == 0 {
            out = best
                .par_iter()
                .take(settings.refits)
                .map(|c| {
                    let mut hypothesis = current.hypothesis.clone();
                    hypothesis.terms.push(c.term.clone());
                    let mut e = current.point.e.clone();
                    e.extend_from_slice(&c.start);
                    let start = Point {
                        theta: c.theta.iter().map(|t| t.clamp(-1.0, 1.0)).collect(),
                        e,
                    };
                    Refit {
                        term: c.term.clone(),
                        fit: fit(case, basis, &hypothesis, start, effort),
                        score: 0.0,
                    }
                })
                .collect();
        } else {
            let leading = out.first().map_or(0.0, |r| gain(current, r));
            out.par_iter_mut().take(many).for_each(|r| {
                if gain(current, r) >= HOPELESS * leading {
                    r.fit = fit(case, basis, &r.fit.hypothesis, r.fit.point.clone(), effort);
                }
            });
        }
        out.sort_by(|a, b| a.fit.train.evidence().total_cmp(&b.fit.train.evidence()));
    }
    // Impacts and sticking make for slow ends; where much is left the leader gets derivatives of its own in every step.
    if let Some(leader) = out.first_mut()
        && leader.fit.train.total() > LEFT * leader.fit.train.number()
        && gain(current, leader) > 0.0
    {
        leader.fit = fit(
            case,
            basis,
            &leader.fit.hypothesis,
            leader.fit.point.clone(),
            Effort::full(settings.steps),
        );
    }
    let Some(least) = out
        .iter()
        .map(|r| r.fit.train.objective())
        .min_by(f64::total_cmp)
    else {
        return out;
    };
    let number = current.train.number();
    let scale = (least / number).max(1.0);
    let unseen = test_value(case, current);
    for r in &mut out {
        let k = r.term.effect.info().parameters.len() as f64;
        // What it gains where it was not fitted counts alike.
        let held_out = unseen - test_value(case, &r.fit);
        r.score = (current.train.evidence() - r.fit.train.evidence() + held_out) / scale
            - k * number.ln()
            - 2.0 * (tried as f64).ln();
    }
    out.sort_by(|a, b| b.score.total_cmp(&a.score));
    out
}

fn gain(current: &Fit, refit: &Refit) -> f64 {
    current.train.evidence() - refit.fit.train.evidence()
}

/// A derived velocity that does not follow from its positions as stated.
fn lagging_velocity(case: &Case, settings: &Settings) -> Option<(Term, f64, f64)> {
    let effect = settings
        .effects
        .iter()
        .find(|e| e.info().id == "velocity_filter_lag")?;
    channel::consistency(case)
        .into_iter()
        .enumerate()
        .filter_map(|(joint, c)| c.filter(|c| c.lagging).map(|c| (joint, c)))
        .max_by(|a, b| a.1.mismatch.total_cmp(&b.1.mismatch))
        .map(|(joint, c)| {
            (
                Term {
                    effect: effect.clone(),
                    joint,
                },
                c.lag,
                c.mismatch / c.with_lag.max(1e-12),
            )
        })
}

#[allow(clippy::too_many_arguments)] // the parts of one result, gathered in one place
fn finish(
    case: &Case,
    settings: &Settings,
    base: &Fit,
    before: &Gap,
    mut fit: Fit,
    ranking: &[Refit],
    accepted: &[Term],
    lagging: Option<(Term, f64, f64)>,
    refits: usize,
    clock: std::time::Instant,
) -> Diagnosis {
    let misfit = fit.train.total() / fit.train.number();
    let mut named = name(case, &fit);
    if let Some((term, lag, _)) = &lagging {
        fit.hypothesis.terms.push(term.clone());
        fit.point.e.push(*lag);
        named.insert(
            0,
            Named {
                effect: term.effect.info().id.to_owned(),
                joint: term.shown_joint(),
                parameters: vec![Magnitude {
                    name: "time_constant_s".to_owned(),
                    value: *lag,
                    std: None,
                }],
                regime: term.effect.info().regime.to_owned(),
            },
        );
    }
    let after = measured(case, &fit);
    let floor = floor(
        case,
        &fit.hypothesis,
        &fit.point.theta,
        &fit.point.e,
        Role::Test,
    );
    let factor = if case.noise.iter().all(|n| n.stated) {
        1.0
    } else {
        ESTIMATED
    };
    let unexplained = after.total > factor * settings.unexplained * floor
        || misfit > factor * factor * settings.largest_misfit;
    let scale = misfit.max(1.0);
    // Neighbouring innovations of a misfit are not independent: the odds are tempered.
    let temper = |score: f64| score / (2.0 * (2.0 + 2.0 * (scale - 1.0)));
    // A second effect was compared with others on top of the first, not with the first.
    let second = accepted.get(1).map(Term::label);
    let on_top = |r: &Refit| second.as_deref() == Some(r.term.label().as_str());
    let best = ranking
        .iter()
        .filter(|r| !on_top(r))
        .map(|r| r.score)
        .fold(0.0, f64::max);
    let weights: Vec<f64> = ranking
        .iter()
        .map(|r| {
            if on_top(r) {
                0.0
            } else {
                temper(r.score - best).exp()
            }
        })
        .collect();
    let nothing = temper(-best).exp();
    let sum: f64 = weights.iter().sum::<f64>() + nothing;
    let mut lines: Vec<Ranked> = ranking
        .iter()
        .zip(&weights)
        .map(|(r, w)| Ranked {
            effect: r.term.effect.info().id.to_owned(),
            joint: r.term.shown_joint(),
            score: r.score,
            probability: if on_top(r) { 1.0 } else { w / sum },
        })
        .collect();
    if let Some((term, _, ratio)) = &lagging {
        lines.insert(
            0,
            Ranked {
                effect: term.effect.info().id.to_owned(),
                joint: term.shown_joint(),
                score: ratio * ratio,
                probability: 1.0,
            },
        );
    }
    let (effect, joint, confidence, regime) = if unexplained {
        (
            "unknown".to_owned(),
            None,
            0.9,
            "what is left is larger than the noise".to_owned(),
        )
    } else if let Some(first) = named.first() {
        let own = lines
            .iter()
            .find(|l| l.effect == first.effect && l.joint == first.joint)
            .map_or(0.5, |l| l.probability);
        (first.effect.clone(), first.joint, own, first.regime.clone())
    } else {
        (
            "none".to_owned(),
            None,
            // Known from drawn cases rather than from the odds, which know nothing of the gap that did not shrink.
            if best > settings.margin { 0.9 } else { 0.97 },
            "all records".to_owned(),
        )
    };
    let mut confusion: Vec<String> = lines
        .iter()
        .filter(|l| {
            !named
                .iter()
                .any(|n| n.effect == l.effect && n.joint == l.joint)
                && l.probability > 0.05
        })
        .map(|l| {
            l.joint
                .map_or(l.effect.clone(), |j| format!("{}:{j}", l.effect))
        })
        .collect();
    if case.n() == 1 && (effect == "input_delay" || effect == "sensor_delay") {
        let twin = if effect == "input_delay" {
            "sensor_delay:1"
        } else {
            "input_delay:1"
        };
        if !confusion.iter().any(|c| c == twin) {
            confusion.push(twin.to_owned());
        }
    }
    Diagnosis {
        schema_version: SCHEMA_VERSION,
        case: case.name.clone(),
        effect,
        joint,
        effects: named,
        gap_before: before.total,
        gap_after: after.total,
        gap_intervals: (before.interval(), after.interval()),
        gap_floor: floor,
        gap_joints: after.joints,
        ranking: lines,
        confidence,
        confusion_set: confusion,
        regime,
        misfit: (base.train.total() / base.train.number(), misfit),
        refits,
        seconds: clock.elapsed().as_secs_f64(),
    }
}

/// Factor on variances from the curvature: neighbouring innovations share information.
const SHARED: f64 = 2.0;

/// Curvature of a fit with 1 where a parameter has no influence, and which these are.
fn curvature(fit: &Fit) -> (DMatrix<f64>, Vec<bool>) {
    let mut h = fit.quadratic.h.clone();
    let dead: Vec<bool> = (0..h.nrows()).map(|i| h[(i, i)] <= 0.0).collect();
    for (i, dead) in dead.iter().enumerate() {
        if *dead {
            h[(i, i)] = 1.0;
        }
    }
    (h, dead)
}

/// Size of the last effect of a fit over its standard deviation, the largest of its amplitudes; 0 if it is not determined.
fn size_in_deviations(fit: &Fit) -> f64 {
    let Some(term) = fit.hypothesis.terms.last() else {
        return 0.0;
    };
    let info = term.effect.info();
    let first = fit.point.e.len() - info.parameters.len();
    let size = fit.point.theta.len();
    let misfit = (fit.train.total() / fit.train.number()).max(1.0);
    let (h, dead) = curvature(fit);
    let Some(factor) = h.cholesky() else {
        return 0.0;
    };
    let covariance = factor.inverse() * (misfit * SHARED);
    let own: &[usize] = if info.amplitudes.is_empty() {
        &[0]
    } else {
        info.amplitudes
    };
    own.iter()
        .filter(|&&a| !dead[size + first + a])
        .map(|&a| {
            let i = size + first + a;
            fit.point.e[first + a].abs() / covariance[(i, i)].sqrt()
        })
        .fold(0.0, f64::max)
}

/// The effects of a fit with their magnitudes and standard deviations (from the curvature, widened where the misfit is larger than
/// the noise; 2 for what neighbouring innovations share).
fn name(case: &Case, fit: &Fit) -> Vec<Named> {
    let misfit = (fit.train.total() / fit.train.number()).max(1.0);
    let size = fit.point.theta.len();
    // A parameter without any influence is not determined; the others are.
    let (h, dead) = curvature(fit);
    let covariance = h.cholesky().map(|c| c.inverse() * (misfit * SHARED));
    let mut at = 0;
    fit.hypothesis
        .terms
        .iter()
        .map(|term| {
            let info = term.effect.info();
            let k = info.parameters.len();
            let e = &fit.point.e[at..at + k];
            let joint = &case.nominal.joints[term.joint];
            // What is shown in torque rests on the motor gain, which is fitted within its tolerance.
            let at_gain = term.joint * PER_JOINT + GAIN;
            let gain_slope = joint.motor_gain * case.nominal.tolerance.motor_gain_rel;
            let gain = joint.motor_gain + gain_slope * fit.point.theta[at_gain];
            let rated = case.scale[term.joint].torque / joint.motor_gain.abs();
            let shown = term.effect.shown(e, gain, rated);
            let own_dead: Vec<bool> = dead[size + at..size + at + k].to_vec();
            let places: Vec<usize> = (size + at..size + at + k)
                .chain(std::iter::once(at_gain))
                .collect();
            let own: Option<DMatrix<f64>> = covariance
                .as_ref()
                .map(|c| DMatrix::from_fn(k + 1, k + 1, |a, b| c[(places[a], places[b])]));
            at += k;
            let mut slopes: Vec<Vec<f64>> = (0..k)
                .map(|i| {
                    let step =
                        1e-6 * (e[i].abs() + 1e-3 * case.unit(info.parameters[i].unit, term.joint));
                    let mut moved = e.to_vec();
                    moved[i] += step;
                    term.effect
                        .shown(&moved, gain, rated)
                        .iter()
                        .zip(&shown)
                        .map(|(a, b)| (a.1 - b.1) / step)
                        .collect()
                })
                .collect();
            let step = 1e-6 * gain;
            slopes.push(
                term.effect
                    .shown(e, gain + step, rated)
                    .iter()
                    .zip(&shown)
                    .map(|(a, b)| (a.1 - b.1) / step * gain_slope)
                    .collect(),
            );
            let parameters = shown
                .iter()
                .enumerate()
                .map(|(s, (name, x))| {
                    let lost = (0..k).any(|a| own_dead[a] && slopes[a][s] != 0.0);
                    let variance = own.as_ref().filter(|_| !lost).map(|c| {
                        (0..=k)
                            .flat_map(|a| (0..=k).map(move |b| (a, b)))
                            .map(|(a, b)| slopes[a][s] * c[(a, b)] * slopes[b][s])
                            .sum::<f64>()
                    });
                    Magnitude {
                        name: (*name).to_owned(),
                        value: *x,
                        std: variance
                            .filter(|v| *v >= 0.0 && v.is_finite())
                            .map(f64::sqrt),
                    }
                })
                .collect();
            Named {
                effect: info.id.to_owned(),
                joint: term.shown_joint(),
                parameters,
                regime: info.regime.to_owned(),
            }
        })
        .collect()
}
