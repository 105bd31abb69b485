//! Faults of single channels: zero, dead, frozen, doubled, at a bound, with outliers, with holes.

use pid_data::signal::{central_differences, column};
use pid_data::{Dataset, Experiment, InputQuantity};

use crate::columns::{named, outlier_rows, quantile, spread};
use crate::criteria::Criteria;
use crate::finding::{Channel, Finding, FindingKind, Severity, number};

/// All findings about single channels.
pub(crate) fn check(data: &Dataset, criteria: &Criteria) -> Vec<Finding> {
    let mut out: Vec<Finding> = zero_inputs(data).into_iter().collect();
    out.extend(doubled(data));
    let mut clean = data.clone();
    for j in 0..data.nq() {
        if let Some(finding) = outlying(data, j) {
            // A single wrong reading ends no stretch that stands still.
            crate::fix::apply(&mut clean, &finding);
            out.push(finding);
        }
    }
    for e in &clean.experiments {
        for j in 0..data.nq() {
            out.extend(dead(e, j));
            out.extend(frozen_position(e, j, criteria));
            out.extend(frozen_velocity(e, j, criteria));
            // A target that is held, or at its largest, is no fault.
            if data.joints[j].input != InputQuantity::Position {
                out.extend(frozen_input(e, j, criteria));
                out.extend(saturated(e, j, criteria));
            }
        }
    }
    out.extend(holes(data));
    out
}

/// Empty cells, all records together.
fn holes(data: &Dataset) -> Option<Finding> {
    let with: Vec<&Experiment> = data.experiments.iter().filter(|e| e.missing > 0).collect();
    let count: usize = with.iter().map(|e| e.missing).sum();
    let cells: usize = data
        .experiments
        .iter()
        .map(|e| e.len() * (e.nq + e.nu()))
        .sum();
    if count == 0 {
        return None;
    }
    Some(
        Finding::new(
            FindingKind::MissingSamples { count },
            Severity::Note,
            format!("{count} cells of {} are empty", records_text(&with)),
            "nothing: missing samples are left out",
        )
        .with(
            "share of the cells",
            count as f64 / cells.max(1) as f64,
            "1",
        ),
    )
}

/// `record \`a\`` or `3 records`.
pub(crate) fn records_text(with: &[&Experiment]) -> String {
    match with {
        [one] => format!("record `{}`", one.name),
        _ => format!("{} records", with.len()),
    }
}

/// Joints whose inputs are zero in all records.
fn zero_inputs(data: &Dataset) -> Option<Finding> {
    let nq = data.nq();
    let zero = |j: usize| {
        data.experiments.iter().all(|e| {
            let mut u =
                e.u.iter()
                    .skip(j)
                    .step_by(e.nu().max(1))
                    .filter(|u| u.is_finite());
            u.all(|u| *u == 0.0)
        })
    };
    let joints: Vec<usize> = (0..nq).filter(|&j| zero(j)).map(|j| j + 1).collect();
    if joints.is_empty() {
        return None;
    }
    let rows: usize = data.experiments.iter().map(Experiment::len).sum();
    let (severity, sentence, mend) = if joints.len() == nq {
        (
            Severity::Wrong,
            "no torque in this log: all inputs are zero throughout".to_owned(),
            "record the torque, current or command of the drives; without it only positions and velocities can be compared with each other",
        )
    } else {
        let names = joints.iter().map(|j| format!("u{j}"));
        (
            Severity::Doubtful,
            format!("{} is zero throughout", crate::finding::list(names)),
            "right for a joint without drive; otherwise record its input",
        )
    };
    Some(
        Finding::new(FindingKind::ZeroInput, severity, sentence, mend)
            .of(&joints, Channel::Input)
            .with("rows", rows as f64, "1"),
    )
}

/// Pairs of columns of one kind that hold the same values in all records.
fn doubled(data: &Dataset) -> Vec<Finding> {
    let nq = data.nq();
    let mut out = Vec::new();
    for (stem, channel) in [
        ("q", Channel::Position),
        ("dq", Channel::Velocity),
        ("u", Channel::Input),
    ] {
        for j in 0..nq {
            for i in 0..j {
                let (a, b) = (format!("{stem}{}", i + 1), format!("{stem}{}", j + 1));
                let mut rows = 0;
                let same = data.experiments.iter().all(|e| {
                    let (Some(x), Some(y)) = (named(e, &a), named(e, &b)) else {
                        return false;
                    };
                    rows += x.len();
                    // A channel that rests is no copy of another that rests.
                    spread(&x) > 0.0
                        && x.iter()
                            .zip(&y)
                            .all(|(x, y)| x == y || x.is_nan() || y.is_nan())
                });
                if same && rows > 0 {
                    out.push(
                        Finding::new(
                            FindingKind::DuplicateChannels,
                            Severity::Wrong,
                            format!("{a} and {b} hold the same values"),
                            "one of them was written into both columns; write the other one's values",
                        )
                        .of(&[i + 1, j + 1], channel)
                        .with("equal rows", rows as f64, "1"),
                    );
                }
            }
        }
    }
    out
}

fn outlying(data: &Dataset, j: usize) -> Option<Finding> {
    let name = format!("q{}", j + 1);
    let (mut count, mut rows, mut largest, mut with) = (0, 0, 0.0_f64, Vec::new());
    let mut first = None;
    for e in &data.experiments {
        let found = outlier_rows(e, &name);
        let Some(&row) = found.first() else { continue };
        let q = named(e, &name)?;
        let jump = |i: usize| (q[i] - q[if i > 0 { i - 1 } else { 1 }]).abs();
        largest = found
            .iter()
            .map(|&i| jump(i))
            .filter(|x| x.is_finite())
            .fold(largest, f64::max);
        first = first.or(Some(e.t[row]));
        count += found.len();
        rows += e.len();
        with.push(e);
    }
    let finding = Finding::new(
        FindingKind::Outliers { count },
        Severity::Note,
        format!(
            "{count} readings of {name} jump away from their neighbours and back, in {}",
            records_text(&with)
        ),
        "nothing: they are set aside; `--fix` empties their cells",
    )
    .of(&[j + 1], Channel::Position)
    .with(
        "share of the readings there",
        count as f64 / rows as f64,
        "1",
    )
    .with("largest jump", largest, data.joints[j].unit())
    .with("first at", first?, "s");
    Some(match with.as_slice() {
        [one] => finding.within(&one.name),
        _ => finding,
    })
}

/// A position that has one value throughout while the joint's velocity or input varies.
fn dead(e: &Experiment, j: usize) -> Option<Finding> {
    let q = column(&e.q, e.nq, j);
    if e.len() < 50 || spread(&q) > 0.0 {
        return None;
    }
    let v = e.v.as_ref().map_or(0.0, |v| spread(&column(v, e.nq, j)));
    let u = spread(&column(&e.u, e.nu().max(1), j));
    let (severity, mend) = match (v > 0.0, u > 0.0) {
        (true, _) => (
            Severity::Wrong,
            "the encoder or its column is dead; record it",
        ),
        (_, true) => (
            Severity::Doubtful,
            "a joint that is held or stuck, or a dead encoder; look",
        ),
        _ => return None,
    };
    let sentence = format!(
        "q{} has one value throughout record `{}` while the joint is driven",
        j + 1,
        e.name
    );
    Some(
        Finding::new(FindingKind::DeadChannel, severity, sentence, mend)
            .of(&[j + 1], Channel::Position)
            .within(&e.name)
            .with("range of the velocity", v, "rad/s or m/s")
            .with("range of the input", u, "of u"),
    )
}

/// Runs of equal values of at least so many rows: first row and the one after the last.
pub(crate) fn runs(x: &[f64], least: usize) -> Vec<(usize, usize)> {
    let mut out = Vec::new();
    let mut start = 0;
    for i in 1..=x.len() {
        if i == x.len() || x[i] != x[start] {
            if i - start >= least && x[start].is_finite() {
                out.push((start, i));
            }
            start = i;
        }
    }
    out
}

/// Rows that a stretch must have to count as frozen.
fn least_rows(e: &Experiment, criteria: &Criteria) -> usize {
    let rows = criteria.frozen_seconds / e.sample_time().max(1e-12);
    (rows.min(1e9) as usize).max(criteria.frozen_rows)
}

fn frozen_position(e: &Experiment, j: usize, criteria: &Criteria) -> Vec<Finding> {
    let q = column(&e.q, e.nq, j);
    let n = q.len();
    let range = spread(&q);
    if range == 0.0 || n < 50 {
        return Vec::new();
    }
    let steps: Vec<f64> = q.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    // Joints that rest most of the time are judged by when they move.
    let moving: Vec<f64> = steps.iter().copied().filter(|s| *s > 0.0).collect();
    let usual = quantile(&moving, 0.995);
    let v = e.v.as_ref().map(|v| column(v, e.nq, j));
    let fast = v.as_ref().map_or(0.0, |v| quantile(&speeds(v), 0.95));
    let mut out = Vec::new();
    for (a, b) in runs(&q, least_rows(e, criteria)) {
        // Where the velocity says that the joint went meanwhile.
        let way = v.as_ref().map_or(0.0, |v| {
            let mut at = 0.0;
            let path = (a + 1..b).map(|i| {
                let step = 0.5 * (v[i] + v[i - 1]) * (e.t[i] - e.t[i - 1]);
                at += if step.is_finite() { step } else { 0.0 };
                at
            });
            spread(&path.chain([0.0]).collect::<Vec<f64>>())
        });
        let rms = v.as_ref().map_or(0.0, |v| rms(&v[a..b]));
        let moved = way > criteria.frozen_way * range && rms > criteria.frozen_speed * fast;
        let after = if b < n { (q[b] - q[b - 1]).abs() } else { 0.0 };
        let jump = after > criteria.frozen_jump * usual && after > criteria.frozen_way * range;
        let abrupt = abrupt(&q, (a, b), criteria.frozen_speed * quantile(&moving, 0.95));
        // A velocity that is recorded and rests says that the joint rests.
        let silent = v.is_none()
            || v.as_ref()
                .is_some_and(|v| v[a..b].iter().all(|v| v.is_nan()));
        if !(moved || jump || (silent && abrupt)) {
            continue;
        }
        let mut finding = frozen(e, j, Channel::Position, (a, b), Severity::Wrong);
        if moved {
            finding = finding.with("way by the velocity meanwhile", way, "rad or m");
        }
        out.push(finding.with("jump at the end", after, "rad or m"));
    }
    out
}

/// Sizes of the velocities that are not zero.
fn speeds(v: &[f64]) -> Vec<f64> {
    v.iter().map(|v| v.abs()).filter(|v| *v > 0.0).collect()
}

/// Whether a run begins and ends in full motion: the means of the five steps before and after it are large.
fn abrupt(q: &[f64], (a, b): (usize, usize), least: f64) -> bool {
    let mean = |from: usize, to: usize| (q[to] - q[from]).abs() / (to - from) as f64;
    a >= 5 && b + 6 < q.len() && mean(a - 5, a) > least && mean(b, b + 5) > least
}

fn rms(x: &[f64]) -> f64 {
    let known: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    (known.iter().map(|x| x * x).sum::<f64>() / known.len().max(1) as f64).sqrt()
}

fn frozen_velocity(e: &Experiment, j: usize, criteria: &Criteria) -> Vec<Finding> {
    let Some(v) = e.v.as_ref().map(|v| column(v, e.nq, j)) else {
        return Vec::new();
    };
    let mut q = column(&e.q, e.nq, j);
    if spread(&v) == 0.0 || pid_data::signal::fill_missing(&e.t, &mut q) == q.len() {
        return Vec::new();
    }
    let slope = central_differences(&e.t, &q);
    let fast = quantile(&speeds(&v), 0.95);
    let mut out = Vec::new();
    for (a, b) in runs(&v, least_rows(e, criteria)) {
        // Means over fifths of the run keep the noise of the slope small.
        let part = ((b - a) / 5).max(1);
        let off = slope[a..b]
            .chunks_exact(part)
            .map(|c| (c.iter().sum::<f64>() / part as f64 - v[a]).abs())
            .fold(0.0, f64::max);
        let moved = spread(&q[a..b]) > criteria.frozen_way * spread(&q);
        let chance = repetitions(&v, (a, b));
        if moved
            && (off > criteria.frozen_velocity * fast
                || (v[a] != 0.0 && chance < criteria.frozen_chance))
        {
            let short = (b - a) as f64 <= criteria.frozen_share * v.len() as f64;
            let severity = match short {
                true => Severity::Doubtful,
                false => Severity::Wrong,
            };
            let finding = frozen(e, j, Channel::Velocity, (a, b), severity);
            out.push(finding.with(
                "slope of the position less the velocity",
                off,
                "rad/s or m/s",
            ));
        }
    }
    out
}

/// An input that repeats a value for long while the joint moves, though it hardly ever repeats one elsewhere.
fn frozen_input(e: &Experiment, j: usize, criteria: &Criteria) -> Vec<Finding> {
    let u = column(&e.u, e.nu().max(1), j);
    let mut q = column(&e.q, e.nq, j);
    if spread(&u) == 0.0 || pid_data::signal::fill_missing(&e.t, &mut q) == q.len() {
        return Vec::new();
    }
    let known = || u.iter().copied().filter(|u| u.is_finite());
    let (low, high) = (
        known().fold(f64::INFINITY, f64::min),
        known().fold(f64::NEG_INFINITY, f64::max),
    );
    let found = runs(&u, least_rows(e, criteria))
        .into_iter()
        .filter(|&(a, b)| {
            let moved = spread(&q[a..b]) > criteria.frozen_way * spread(&q);
            // At its bound an input is saturated; at zero it is off.
            let free = u[a] != low && u[a] != high && u[a] != 0.0;
            moved && free && repetitions(&u, (a, b)) < criteria.frozen_chance
        });
    found
        .map(|(a, b)| {
            let finding = frozen(e, j, Channel::Input, (a, b), Severity::Doubtful);
            finding.with("way of the joint meanwhile", spread(&q[a..b]), "rad or m")
        })
        .collect()
}

/// Expected number of runs at least as long as the given one, if readings repeat as often as elsewhere in
/// the channel and independently: `N pⁿ` with the share p of repetitions, at least one in N.
fn repetitions(x: &[f64], (a, b): (usize, usize)) -> f64 {
    let equal = x.windows(2).filter(|w| w[0] == w[1]).count();
    let inside = b - a - 1;
    let others = x.len().saturating_sub(1 + inside).max(1) as f64;
    let share = ((equal - inside.min(equal)) as f64 / others).max(1.0 / others);
    others * share.powi(inside.min(10_000) as i32)
}

/// Says that a column stands still.
fn frozen(
    e: &Experiment,
    j: usize,
    channel: Channel,
    (a, b): (usize, usize),
    severity: Severity,
) -> Finding {
    let what = if channel == Channel::Velocity {
        "while the position moves"
    } else {
        "while the joint moves"
    };
    let sentence = format!(
        "{}{} stands still for {} rows ({} s) of record `{}` {what}",
        channel.columns(),
        j + 1,
        b - a,
        number(e.t[b - 1] - e.t[a]),
        e.name
    );
    Finding::new(
        FindingKind::FrozenChannel,
        severity,
        sentence,
        "take the stretch as missing; `--fix` empties its cells",
    )
    .of(&[j + 1], channel)
    .within(&e.name)
    .at((a, b - 1), &e.t)
}

/// An input that sits at its largest or smallest value for stretches.
fn saturated(e: &Experiment, j: usize, criteria: &Criteria) -> Option<Finding> {
    let u = column(&e.u, e.nu().max(1), j);
    let range = spread(&u);
    if range == 0.0 {
        return None;
    }
    let known = || u.iter().copied().filter(|u| u.is_finite());
    let (low, high) = (
        known().fold(f64::INFINITY, f64::min),
        known().fold(f64::NEG_INFINITY, f64::max),
    );
    let at = runs(&u, criteria.saturated_rows);
    let mut best: Option<(f64, usize, (usize, usize))> = None;
    for level in [low, high] {
        let there: Vec<_> = at.iter().filter(|(a, _)| u[*a] == level).collect();
        let rows: usize = there.iter().map(|(a, b)| b - a).sum();
        let (Some(first), Some(last)) = (there.first(), there.last()) else {
            continue;
        };
        if level != 0.0 && best.is_none_or(|(_, most, _)| rows > most) {
            best = Some((level, rows, (first.0, last.1 - 1)));
        }
    }
    let (level, rows, place) = best?;
    let share = rows as f64 / u.len() as f64;
    if share < criteria.saturated_share {
        return None;
    }
    let unit = "of u";
    Some(
        Finding::new(
            FindingKind::Saturated { level },
            Severity::Note,
            format!("u{} sits at its bound {} for {rows} rows of record `{}`", j + 1, number(level), e.name),
            "beyond the bound the input is not what the controller asked for; less demanding motion avoids it",
        )
        .of(&[j + 1], Channel::Input)
        .within(&e.name)
        .at(place, &e.t)
        .with("bound", level, unit)
        .with("share of the rows", share, "1"),
    )
}
