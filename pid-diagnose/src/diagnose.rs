//! From a case to a verdict.
//!
//! The nominal structure is fitted within its tolerances; all effects at all joints are screened on top; the best are refitted in
//! full and ranked by their objective with a penalty per parameter; a second effect is looked for on top of the first. An effect is
//! named only if it gains more than chance and multiplicity allow, on the train records and on records never fitted.

use std::sync::Arc;

use nalgebra::DMatrix;
use pid_runtime::data::Role;
use serde::{Deserialize, Serialize};

use crate::case::Case;
use crate::channel;
use crate::effect::{Effect, Term};
use crate::fit::{Basis, Fit, Point, basis, fit, value};
use crate::gap::{Gap, floor, gap};
use crate::plant::PER_JOINT;
use crate::screen::{candidates, screen};
use crate::simulate::Hypothesis;

/// Version of the JSON form.
pub const SCHEMA_VERSION: u32 = 1;

/// Mean squared innovation below which no further effect is looked for.
const EXPLAINED: f64 = 1.1;

/// What may be set.
#[derive(Clone)]
pub struct Settings {
    /// The effects considered; [`effects::all`](crate::effects::all) and the user's own.
    pub library: Vec<Arc<dyn Effect>>,
    /// How many candidates are refitted in full.
    pub refits: usize,
    /// Steps of a refit at most.
    pub steps: usize,
    /// Most effects named together.
    pub effects: usize,
    /// Gain of twice the log-likelihood beyond the penalty that an effect must reach.
    pub margin: f64,
    /// Share by which the gap on the test records must shrink.
    pub least_shrink: f64,
    /// A gap this many times the floor, or mean squared innovations beyond this figure, is not explained.
    pub unexplained: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            library: crate::effects::all(),
            refits: 7,
            steps: 14,
            effects: 2,
            margin: 12.0,
            least_shrink: 0.06,
            unexplained: 2.6,
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
        settings.steps,
    );
    let before = measured(case, &base);
    let mut current = base.clone();
    let mut current_gap = before.clone();
    let mut ranking: Vec<Refit> = Vec::new();
    let mut refits = 0;
    let mut accepted: Vec<Term> = Vec::new();
    for round in 0..settings.effects {
        let list = candidates(case, &settings.library, &current.hypothesis);
        let best = screen(case, &basis, &current, &list);
        let tried = refit(case, &basis, settings, &current, &best, list.len());
        refits += tried.len();
        let Some(first) = tried.first() else { break };
        let after = measured(case, &first.fit);
        let held_out = test_value(case, &current) - test_value(case, &first.fit);
        let significant = first.score > settings.margin;
        let relative =
            (current.train.objective() - first.fit.train.objective()) / current.train.objective();
        let needed = if round == 0 {
            settings.least_shrink
        } else {
            2.0 * settings.least_shrink
        };
        let shrinks = after.total < (1.0 - needed) * current_gap.total;
        let enough = relative > if round == 0 { 0.002 } else { 0.03 };
        let take = significant && held_out > 0.0 && shrinks && enough;
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
    value(case, &fit.hypothesis, &fit.point, &fit.gains, Role::Test).total()
}

/// Refits the most promising candidates in parallel; best score first.
fn refit(
    case: &Case,
    basis: &Basis,
    settings: &Settings,
    current: &Fit,
    best: &[crate::screen::Candidate],
    tried: usize,
) -> Vec<Refit> {
    let mut out: Vec<Refit> = best
        .iter()
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
            let done = fit(case, basis, &hypothesis, start, settings.steps);
            Refit {
                term: c.term.clone(),
                fit: done,
                score: 0.0,
            }
        })
        .collect();
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
        r.score = (current.train.objective() - r.fit.train.objective() + held_out) / scale
            - k * number.ln()
            - 2.0 * (tried as f64).ln();
    }
    out.sort_by(|a, b| b.score.total_cmp(&a.score));
    out
}

/// A derived velocity that does not follow from its positions as stated.
fn lagging_velocity(case: &Case, settings: &Settings) -> Option<(Term, f64, f64)> {
    let effect = settings
        .library
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
    let unexplained = after.total > settings.unexplained * floor
        || misfit > settings.unexplained * settings.unexplained;
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
            0.8,
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
            (nothing / sum).max(0.5),
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

/// The effects of a fit with their magnitudes and standard deviations (from the curvature, widened where the misfit is larger than
/// the noise; 2 for what neighbouring innovations share).
fn name(case: &Case, fit: &Fit) -> Vec<Named> {
    let misfit = (fit.train.total() / fit.train.number()).max(1.0);
    let covariance = fit
        .quadratic
        .h
        .clone()
        .cholesky()
        .map(|c| c.inverse() * (misfit * 2.0));
    let size = fit.point.theta.len();
    let mut at = 0;
    fit.hypothesis
        .terms
        .iter()
        .map(|term| {
            let info = term.effect.info();
            let k = info.parameters.len();
            let e = &fit.point.e[at..at + k];
            let gain = case.nominal.joints[term.joint].motor_gain;
            let rated = case.scale[term.joint].torque / gain.abs();
            let shown = term.effect.shown(e, gain, rated);
            let own: Option<DMatrix<f64>> = covariance
                .as_ref()
                .map(|c| c.view((size + at, size + at), (k, k)).into_owned());
            at += k;
            let slopes: Vec<Vec<f64>> = (0..k)
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
            let parameters = shown
                .iter()
                .enumerate()
                .map(|(s, (name, x))| {
                    let variance = own.as_ref().map(|c| {
                        (0..k)
                            .flat_map(|a| (0..k).map(move |b| (a, b)))
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
