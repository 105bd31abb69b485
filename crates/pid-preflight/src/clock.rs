//! Faults of the time column: unit, gaps, jitter, rate.

use pid_data::{DataWarning, Dataset, Experiment};

use crate::criteria::Criteria;
use crate::finding::{Channel, Finding, FindingKind, Severity, number};

/// Seconds per unit of time columns that are not in seconds.
pub(crate) const UNITS: [(f64, &str); 3] = [
    (1e-3, "milliseconds"),
    (1e-6, "microseconds"),
    (1e-9, "nanoseconds"),
];

/// Time in another unit, as the stated sample time has it.
pub(crate) fn stated_unit(data: &Dataset, criteria: &Criteria) -> Option<Finding> {
    let (found, stated) = data.warnings.iter().find_map(|w| match w {
        DataWarning::SampleTime { found, stated, .. } => Some((*found, *stated)),
        _ => None,
    })?;
    if !(found > 0.0 && stated > 0.0) {
        return None;
    }
    let ratio = stated / found;
    let (factor, unit) = near(ratio, criteria.factor_width)?;
    Some(
        unit_finding(factor, unit)
            .with("median step of t", found, "of t")
            .with("stated sample time", stated, "s"),
    )
}

/// The unit of time whose factor is near a ratio.
pub(crate) fn near(ratio: f64, width: f64) -> Option<(f64, &'static str)> {
    UNITS
        .into_iter()
        .find(|(f, _)| (ratio / f).ln().abs() < width.ln())
}

/// Says that t is in a unit.
pub(crate) fn unit_finding(factor: f64, unit: &str) -> Finding {
    Finding::new(
        FindingKind::TimeUnit { factor },
        Severity::Wrong,
        format!("t is in {unit}, not in seconds"),
        format!("multiply t by {factor:e}; `--fix` does it"),
    )
    .of(&[], Channel::Time)
}

/// Gaps, jitter and rate, once the time is in seconds.
pub(crate) fn check(data: &Dataset, filters: &[Option<f64>], criteria: &Criteria) -> Vec<Finding> {
    let mut out = Vec::new();
    for warning in &data.warnings {
        if let DataWarning::SampleTime {
            file,
            found,
            stated,
        } = warning
        {
            out.push(
                Finding::new(
                    FindingKind::SampleTimeStated {
                        found: *found,
                        stated: *stated,
                    },
                    Severity::Doubtful,
                    format!(
                        "{file}: the median time step is {} s, {} s is stated",
                        number(*found),
                        number(*stated)
                    ),
                    "correct sample_time_s, or the time stamps",
                )
                .of(&[], Channel::Time)
                .with("found over stated", found / stated, "1"),
            );
        }
    }
    out.extend(gaps(data, criteria));
    out.extend(jitter(data, criteria));
    out.extend(rate(data, filters, criteria));
    out
}

/// Rows that are missing, all records together, with the longest hole.
fn gaps(data: &Dataset, criteria: &Criteria) -> Option<Finding> {
    let (mut lost, mut rows, mut with) = (0.0, 0.0, Vec::new());
    let mut longest: Option<(f64, f64, &Experiment, usize)> = None;
    for e in &data.experiments {
        let step = e.sample_time();
        let hole = |w: &[f64]| w[1] - w[0] > criteria.gap_steps * step;
        let holes: Vec<usize> = (0..e.len().saturating_sub(1))
            .filter(|&i| hole(&e.t[i..i + 2]))
            .collect();
        if step <= 0.0 || holes.is_empty() {
            continue;
        }
        // The median of uneven steps is one of them; rows are counted by the mean.
        let near = e.t.windows(2).map(|w| w[1] - w[0]);
        let near: Vec<f64> = near.filter(|s| *s <= criteria.gap_steps * step).collect();
        let mean = near.iter().sum::<f64>() / near.len() as f64;
        for i in holes {
            let length = e.t[i + 1] - e.t[i];
            lost += (length / mean - 1.0).round().max(1.0);
            if longest.is_none_or(|(most, ..)| length > most) {
                longest = Some((length, step, e, i));
            }
        }
        rows += e.len() as f64;
        with.push(e);
    }
    let (length, step, e, place) = longest?;
    let share = lost / (lost + rows);
    let (severity, mend) = if length > criteria.gap_seconds.max(20.0 * step) {
        (
            Severity::Doubtful,
            "cut the record at the hole, or record anew: no simulation can run across it",
        )
    } else {
        (
            Severity::Note,
            "nothing: steps of time are taken as they are",
        )
    };
    let sentence = format!(
        "{} of the rows of {} are missing ({} rows); the longest hole is {} s",
        percent(share),
        crate::channels::records_text(&with),
        number(lost),
        number(length)
    );
    Some(
        Finding::new(
            FindingKind::LostRows {
                count: lost.min(1e15) as usize,
            },
            severity,
            sentence,
            mend,
        )
        .of(&[], Channel::Time)
        .within(&e.name)
        .at((place, place + 1), &e.t)
        .with("share of the rows", share, "1")
        .with("longest hole", length, "s")
        .with("median step", step, "s"),
    )
}

fn percent(share: f64) -> String {
    format!("{} %", number((1e4 * share).round() / 100.0))
}

/// Time steps that vary: the record where they vary most.
fn jitter(data: &Dataset, criteria: &Criteria) -> Option<Finding> {
    let of = |e: &Experiment| {
        let step = e.sample_time();
        let steps = e.t.windows(2).map(|w| w[1] - w[0]);
        // Holes are counted by themselves.
        let near: Vec<f64> = steps.filter(|s| *s < criteria.gap_steps * step).collect();
        let mean = near.iter().sum::<f64>() / near.len() as f64;
        let square = near.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / near.len() as f64;
        if step > 0.0 && near.len() >= 20 {
            square.sqrt() / mean
        } else {
            0.0
        }
    };
    let all: Vec<(f64, &Experiment)> = data.experiments.iter().map(|e| (of(e), e)).collect();
    let with: Vec<&Experiment> = all
        .iter()
        .filter(|(s, _)| *s >= criteria.jitter)
        .map(|(_, e)| *e)
        .collect();
    let &(share, worst) = all.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    if with.is_empty() {
        return None;
    }
    Some(
        Finding::new(
            FindingKind::Jitter { share },
            Severity::Note,
            format!("the time steps of {} vary, by up to {} of the step", crate::channels::records_text(&with), percent(share)),
            "nothing: stamps are taken as they are; if they are those of arrival, take those of measurement",
        )
        .of(&[], Channel::Time)
        .within(&worst.name)
        .with("standard deviation over the mean step", share, "1")
        .with("median step", worst.sample_time(), "s"),
    )
}

/// Whether the rate is enough: for the filters stated, for the effects that a diagnosis looks for, and for
/// the motion itself.
fn rate(data: &Dataset, filters: &[Option<f64>], criteria: &Criteria) -> Option<Finding> {
    let steps = data.experiments.iter().map(Experiment::sample_time);
    let step = steps.fold(0.0, f64::max);
    if step <= 0.0 {
        return None;
    }
    let rate = 1.0 / step;
    let corner = filters.iter().flatten().fold(0.0_f64, |a, &b| a.max(b));
    let filter = 2.0 * corner;
    let moved = rate_of_motion(data, criteria);
    let needed = criteria.rate.max(filter).max(moved);
    if rate >= needed * 0.99 {
        return None;
    }
    let why = if filter >= needed * 0.99 {
        format!(
            "the stated velocity filter of {} Hz needs {} Hz",
            number(corner),
            number(filter)
        )
    } else if moved >= needed * 0.99 {
        format!(
            "the motion changes so fast that it needs {} Hz",
            number(moved)
        )
    } else {
        format!(
            "effects of the drives (delays, play, elasticity, reversals) need {} Hz",
            number(needed)
        )
    };
    let severity = if rate < filter.max(moved) {
        Severity::Doubtful
    } else {
        Severity::Note
    };
    Some(
        Finding::new(
            FindingKind::RateLow { rate, needed },
            severity,
            format!("the rate of {} Hz is too low: {why}", number(rate)),
            format!(
                "record at {} Hz or more; at this rate gravity, inertia and friction can still be told, delays below {} s and vibrations above {} Hz cannot",
                number(needed),
                number(0.5 * step),
                number(0.25 * rate)
            ),
        )
        .of(&[], Channel::Time)
        .with("rate", rate, "Hz")
        .with("needed", needed, "Hz"),
    )
}

/// Rate at which the positions would go a tenth of their spread per row at most.
fn rate_of_motion(data: &Dataset, criteria: &Criteria) -> f64 {
    let mut needed: f64 = 0.0;
    for e in &data.experiments {
        for j in 0..e.nq {
            let q = pid_data::signal::column(&e.q, e.nq, j);
            let steps: Vec<f64> = q.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
            let range = crate::columns::spread(&q);
            if range > 0.0 && e.sample_time() > 0.0 {
                let share = crate::columns::quantile(&steps, 0.9) / range;
                needed = needed.max(share / criteria.step_of_range / e.sample_time());
            }
        }
    }
    needed
}
