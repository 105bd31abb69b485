//! From the fits to what is said.

use super::magnitude::name;
use super::refit::Refit;
use super::remainder::share;
use super::residue::{Residue, residue};
use super::search::NEAR;
use super::unnamed::{Imitated, Nameless};
use super::{
    Diagnosis, Magnitude, Named, Ranked, Remainder, SCHEMA_VERSION, Settings, measured, noise_alone,
};
use crate::case::Case;
use crate::channel;
use crate::effect::Term;
use crate::fit::Fit;
use crate::gap::Gap;

/// Gap over floor, mean squared innovation and gap over the largest floor drawn up to which the nominal structure stands.
const NOTHING: (f64, f64, f64) = (1.4, 1.25, 1.2);

/// Line and burst (see [`Residue`](super::Residue)) up to which innovations count as noise, and up to which an effect is allowed to leave them:
/// contacts and sticking leave some.
const NOISE: (f64, f64) = (12.0, 6.0);
const STRUCTURE: (f64, f64) = (14.0, 100.0);

/// Share of the squared innovations beyond the noise that an effect may leave for their lines and bursts not to count: of a strong
/// contact every hundredth shows.
const NEARLY_ALL: f64 = 0.01;
/// Mean squared innovation over 1 that cannot be told from noise: its level is estimated, or stated to a few figures.
const SCATTER: f64 = 0.01;

/// Memory of innovations, and the correlation behind it, beyond which neighbours are not independent: the level of the noise was taken
/// from records that hold something else too. The first is a figure of chance, a tenth of a chi-squared number of ten degrees of
/// freedom (G. E. P. Box, D. A. Pierce 1970); the second one of size, since in long records every correlation is beyond chance.
const MEMORY: (f64, f64) = (8.0, 0.04);

/// Gap over the largest floor drawn that is allowed in any case: it may differ much from draw to draw.
const SPREAD: f64 = 1.4;

/// Mean squared innovation below which a model has followed the records, if lines and bursts are those of noise, and the factor
/// on the gap that is then allowed.
const CALM: (f64, f64) = (1.1, 2.0);

/// Share of right verdicts: effects named with stated and with estimated noise; `none`; `unknown`. Rounded from drawn cases. The odds
/// among the candidates know nothing of causes outside the list, nor of what is too faint to be seen.
const NAMED: (f64, f64) = (0.985, 0.95);
const NOTHING_ELSE: f64 = 0.95;
const OUTSIDE: f64 = 0.9;

/// Whether what is left has neither lines nor bursts.
pub(super) fn white(left: &Residue) -> bool {
    left.line < NOISE.0 && left.burst < NOISE.1
}

/// Whether innovations remember their neighbours.
fn remember(left: &Residue) -> bool {
    left.memory > MEMORY.0 && left.correlation > MEMORY.1
}

/// What a model leaves, for [`Leaves::unexplained`].
#[derive(Debug, Clone, Copy)]
struct Leaves {
    /// Gap on the test records.
    gap: f64,
    /// What noise alone leaves of it, typically and at most.
    floor: (f64, f64),
    /// Mean squared innovation, of the nominal structure and of the model.
    misfit: (f64, f64),
    /// Its lines and bursts.
    residue: Residue,
    /// Whether the noise is stated.
    stated: bool,
    /// Whether the model has a contact or a resonance: their substeps leave memory.
    stiff: bool,
}

impl Leaves {
    /// Whether something is left that neither noise nor the model explains; `named`: the model has effects.
    fn unexplained(&self, named: bool, settings: &Settings) -> bool {
        let Leaves {
            gap,
            floor: (typical, largest),
            misfit: (nominal, misfit),
            residue: left,
            stated,
            stiff,
        } = *self;
        let noise_like = misfit < CALM.0 && white(&left);
        if !named {
            // Nothing that is named has to be excused: the nominal structure must leave no more than noise.
            let factors = if noise_like && stated {
                (settings.unexplained, SPREAD)
            } else {
                (NOTHING.0, NOTHING.2)
            };
            return gap > (factors.0 * typical).max(factors.1 * largest)
                || misfit > NOTHING.1
                || !white(&left)
                || remember(&left);
        }
        // Free runs from uncertain starts drift; innovations that are noise speak for the model.
        let factor = if noise_like { CALM.1 } else { 1.0 };
        let allowed = (settings.unexplained * factor * typical).max(SPREAD * largest);
        let nearly_all = (misfit - 1.0).max(SCATTER) < NEARLY_ALL * (nominal - 1.0);
        gap > allowed
            || misfit > settings.largest_misfit
            || (!nearly_all
                && (left.line > STRUCTURE.0
                    || left.burst > STRUCTURE.1
                    || (!stiff && remember(&left))))
    }
}

/// What a verdict is made from.
pub(super) struct Parts<'a> {
    pub(super) case: &'a Case,
    pub(super) settings: &'a Settings,
    pub(super) base: &'a Fit,
    pub(super) before: &'a Gap,
    pub(super) ranking: &'a [Refit],
    pub(super) accepted: &'a [Term],
    pub(super) lagging: Option<(Term, Magnitude, f64)>,
    /// A law without a name that describes the records better than the effects accepted.
    pub(super) imitated: Option<Imitated>,
    pub(super) refits: usize,
    pub(super) clock: std::time::Instant,
}

impl Parts<'_> {
    /// The verdict on the fit that forward selection ended with, and that fit with what the velocity channel adds.
    pub(super) fn verdict(self, mut fit: Fit) -> (Diagnosis, Fit) {
        let Parts {
            case,
            settings,
            base,
            before,
            ranking,
            accepted,
            lagging,
            imitated,
            refits,
            clock,
        } = self;
        let misfit = fit.train.total() / fit.train.number();
        let left = residue(case, &fit);
        let mut named = name(case, &fit);
        if let Some((term, lag, _)) = &lagging {
            fit.hypothesis.terms.push(term.clone());
            fit.point.e.push(lag.value);
            named.insert(
                0,
                Named {
                    effect: term.effect.info().id.to_owned(),
                    joint: term.shown_joint(),
                    parameters: vec![lag.clone()],
                    regime: term.effect.info().regime.to_owned(),
                },
            );
        }
        let after = measured(case, &fit);
        let noise = noise_alone(case, &fit);
        let floor = noise.typical;
        let stated = case.noise.iter().all(|n| n.stated);
        let leaves = Leaves {
            gap: after.total,
            floor: (noise.typical, noise.largest),
            misfit: (base.train.total() / base.train.number(), misfit),
            residue: left,
            stated,
            stiff: accepted.iter().any(Term::splits_joint),
        };
        let unexplained = imitated.is_some() || leaves.unexplained(!named.is_empty(), settings);
        let remainder = imitated
            .filter(|law| law.gap < NEAR * floor)
            .map(|law| Remainder {
                explained: share(before.total, after.total, floor),
                own_error: false,
                missing_force: Vec::new(),
                nameless: Nameless::new(case, &law.refit, share(before.total, law.gap, floor)),
            });
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
            let law = remainder.as_ref().and_then(|r| r.nameless.as_ref());
            (
                "unknown".to_owned(),
                None,
                OUTSIDE,
                law.map_or_else(
                    || "what is left is larger than the noise".to_owned(),
                    Nameless::words,
                ),
            )
        } else if let Some(first) = named.first() {
            let own = lines
                .iter()
                .find(|l| l.effect == first.effect && l.joint == first.joint)
                .map_or(0.5, |l| l.probability);
            let known = if stated { NAMED.0 } else { NAMED.1 };
            (
                first.effect.clone(),
                first.joint,
                own * known,
                first.regime.clone(),
            )
        } else {
            (
                "none".to_owned(),
                None,
                NOTHING_ELSE,
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
        let diagnosis = Diagnosis {
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
            gap_joints_before: before.joints.clone(),
            gap_shares: before.shares(),
            missing_force: Vec::new(),
            signals: Vec::new(),
            warnings: Vec::new(),
            remainder,
            beyond_tolerance: Vec::new(),
            next_experiment: None,
            ranking: lines,
            confidence,
            confusion_set: confusion,
            regime,
            misfit: (base.train.total() / base.train.number(), misfit),
            residue: left,
            refits,
            seconds: clock.elapsed().as_secs_f64(),
        };
        (diagnosis, fit)
    }
}

/// A derived velocity that does not follow from its positions as stated.
pub(super) fn lagging_velocity(case: &Case, settings: &Settings) -> Option<(Term, Magnitude, f64)> {
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
                Magnitude {
                    name: "time_constant_s".to_owned(),
                    value: c.lag,
                    std: c.lag_std,
                },
                c.mismatch / c.with_lag.max(1e-12),
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise and nothing else.
    const QUIET: Leaves = Leaves {
        gap: 0.010,
        floor: (0.010, 0.011),
        misfit: (1.0, 1.0),
        residue: Residue {
            burst: 2.0,
            line: 8.0,
            memory: 1.0,
            correlation: 0.01,
            unseen: 1.0,
        },
        stated: true,
        stiff: false,
    };

    fn with(change: impl Fn(&mut Leaves)) -> Leaves {
        let mut leaves = QUIET;
        change(&mut leaves);
        leaves
    }

    #[test]
    fn lines_and_bursts_of_a_contact_do_not_count_where_it_explains_nearly_all() {
        let settings = Settings::default();
        let contact = with(|l| (l.misfit, l.residue.line) = ((400.0, 1.5), 60.0));
        assert!(!contact.unexplained(true, &settings));
        // The same lines beside a cause of which a twentieth is left.
        let half = with(|l| (l.misfit, l.residue.line) = ((10.0, 1.45), 60.0));
        assert!(half.unexplained(true, &settings));
        // More than the noise in all is never explained.
        let much = with(|l| l.misfit = (400.0, 1.7));
        assert!(much.unexplained(true, &settings));
    }

    #[test]
    fn nothing_is_missing_only_where_nothing_but_noise_is_left() {
        let settings = Settings::default();
        assert!(!QUIET.unexplained(false, &settings));
        for loud in [
            with(|l| l.gap = 0.020),
            with(|l| l.misfit = (1.3, 1.3)),
            with(|l| l.residue.line = 13.0),
            with(|l| l.residue.burst = 7.0),
            with(|l| (l.residue.memory, l.residue.correlation) = (12.0, 0.07)),
        ] {
            assert!(loud.unexplained(false, &settings), "{loud:?}");
        }
        // A level that was taken from the records themselves excuses less.
        let drifting = with(|l| l.gap = 0.018);
        assert!(!drifting.unexplained(false, &settings));
        assert!(with(|l| (l.gap, l.stated) = (0.018, false)).unexplained(false, &settings));
    }

    #[test]
    fn innovations_that_remember_speak_against_what_is_no_contact() {
        let settings = Settings::default();
        let remember = |l: &mut Leaves| {
            (l.misfit, l.residue.memory, l.residue.correlation) = ((1.1, 1.0), 17.0, 0.08);
        };
        assert!(with(remember).unexplained(true, &settings));
        let contact = |l: &mut Leaves| {
            remember(l);
            l.stiff = true;
        };
        assert!(!with(contact).unexplained(true, &settings));
        // Beyond chance, but of no size.
        let long = |l: &mut Leaves| (l.residue.memory, l.residue.correlation) = (17.0, 0.01);
        assert!(!with(long).unexplained(true, &settings));
        assert!(!with(long).unexplained(false, &settings));
    }

    #[test]
    fn white_innovations_excuse_a_drift_of_free_runs_beside_an_effect() {
        let settings = Settings::default();
        let drifting = with(|l| (l.gap, l.misfit.0) = (0.030, 5.0));
        assert!(!drifting.unexplained(true, &settings));
        let coloured = with(|l| (l.gap, l.misfit.0, l.residue.line) = (0.030, 5.0, 13.0));
        assert!(coloured.unexplained(true, &settings));
    }
}
