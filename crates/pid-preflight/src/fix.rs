//! Mends what can be mended safely.

use pid_data::{DataWarning, Dataset, Experiment};

use crate::columns::{outlier_rows, split};
use crate::finding::{Channel, Finding, FindingKind, Severity, joints_text, number};
use crate::wrap;

/// The data set with the findings mended that can be mended safely, and what was done, one sentence each.
///
/// Mended are: columns in the wrong order or of the wrong sign, units, time units, wraps, clocks of the
/// inputs, frozen stretches and outliers (which become missing samples). Findings that say a thing
/// without a safe mend are left alone. Findings are applied in their order, so they must be those
/// of [`check`](crate::check) on this data set.
pub fn fix(data: &Dataset, findings: &[Finding]) -> (Dataset, Vec<String>) {
    let mut out = data.clone();
    let mut done = Vec::new();
    for finding in findings {
        done.extend(apply(&mut out, finding));
    }
    (out, done)
}

/// Gravity as the findings have it, m/s², for the description; `None` where the stated one is not wrong.
pub fn mended_gravity(findings: &[Finding]) -> Option<[f64; 3]> {
    findings.iter().find_map(|f| match f.kind {
        FindingKind::Gravity { found, .. } if f.severity == Severity::Wrong => Some(found),
        _ => None,
    })
}

/// Mends one finding; says what was done.
pub(crate) fn apply(data: &mut Dataset, finding: &Finding) -> Option<String> {
    let joints: Vec<usize> = finding
        .joints
        .iter()
        .filter_map(|j| j.checked_sub(1))
        .collect();
    let nq = data.nq();
    if joints.iter().any(|&j| j >= nq) {
        return None;
    }
    let who = joints_text(&finding.joints);
    let meant = |e: &Experiment| {
        finding
            .experiment
            .as_ref()
            .is_none_or(|name| *name == e.name)
    };
    let records = data.experiments.iter_mut().filter(|e| meant(e));
    match &finding.kind {
        FindingKind::Swapped { channel, order } => {
            let order: Vec<usize> = order.iter().filter_map(|j| j.checked_sub(1)).collect();
            if order.len() != nq || order.iter().any(|&j| j >= nq) {
                return None;
            }
            records.for_each(|e| permute(e, *channel, &order));
            Some(format!(
                "put the {} columns of {who} into their order",
                channel.word()
            ))
        }
        FindingKind::SignFlipped { channel, .. } => {
            records.for_each(|e| scale(e, *channel, &joints, -1.0));
            Some(format!(
                "changed the sign of the {} of {who}",
                channel.word()
            ))
        }
        FindingKind::Unit {
            channel,
            factor,
            unit,
        } => {
            records.for_each(|e| scale(e, *channel, &joints, *factor));
            let (word, factor) = (channel.word(), number(*factor));
            Some(format!(
                "brought the {word} of {who} from {unit} to SI units (times {factor})"
            ))
        }
        FindingKind::TimeUnit { factor } => {
            records.for_each(|e| e.t.iter_mut().for_each(|t| *t *= factor));
            restate_times(data, *factor);
            Some(format!(
                "brought the time to seconds (times {})",
                number(*factor)
            ))
        }
        FindingKind::Wrapped { turn, .. } => {
            let mut jumps = 0;
            records.for_each(|e| {
                for &j in &joints {
                    jumps += wrap::unwrap(e, j, *turn);
                }
            });
            Some(format!("unwrapped the position of {who} at {jumps} jumps"))
        }
        FindingKind::InputClock { late } => {
            records.for_each(|e| shift_inputs(e, *late));
            Some(format!("moved the inputs by {} s", number(-late)))
        }
        FindingKind::FrozenChannel => forget_frozen(records, finding),
        FindingKind::Outliers { .. } => forget_outliers(records, finding),
        _ => None,
    }
}

/// Takes a frozen stretch as missing.
fn forget_frozen<'e>(
    records: impl Iterator<Item = &'e mut Experiment>,
    finding: &Finding,
) -> Option<String> {
    let (first, last) = finding.rows?;
    let column = finding.columns.first()?;
    let mut cells = 0;
    records.for_each(|e| cells += forget(e, column, first..last + 1));
    Some(format!("took {cells} frozen cells of {column} as missing"))
}

/// Takes the outliers of a column as missing.
fn forget_outliers<'e>(
    records: impl Iterator<Item = &'e mut Experiment>,
    finding: &Finding,
) -> Option<String> {
    let column = finding.columns.first()?;
    let mut cells = 0;
    records.for_each(|e| {
        for i in outlier_rows(e, column) {
            cells += forget(e, column, i..i + 1);
        }
    });
    Some(format!("took {cells} outliers of {column} as missing"))
}

/// The channels of an experiment that a fault names, each with the number of its columns.
fn channels(e: &mut Experiment, channel: Channel) -> Vec<(&mut Vec<f64>, usize)> {
    let (nq, nu) = (e.nq, e.nu());
    let mut out = Vec::new();
    if matches!(channel, Channel::Position | Channel::Motion | Channel::All) {
        out.push((&mut e.q, nq));
    }
    if matches!(channel, Channel::Velocity | Channel::Motion | Channel::All) {
        out.extend(e.v.as_mut().map(|v| (v, nq)));
    }
    if matches!(channel, Channel::Input | Channel::All) {
        out.push((&mut e.u, nu));
    }
    if channel == Channel::All {
        let others = [e.tau.as_mut(), e.qref.as_mut()];
        out.extend(others.into_iter().flatten().map(|x| (x, nq)));
    }
    out
}

fn permute(e: &mut Experiment, channel: Channel, order: &[usize]) {
    for (x, width) in channels(e, channel) {
        for row in x.chunks_exact_mut(width.max(1)) {
            let old = row.to_vec();
            for (j, &from) in order.iter().enumerate().take(width) {
                row[j] = old[from];
            }
        }
    }
}

fn scale(e: &mut Experiment, channel: Channel, joints: &[usize], factor: f64) {
    for (x, width) in channels(e, channel) {
        for row in x.chunks_exact_mut(width.max(1)) {
            joints.iter().for_each(|&j| row[j] *= factor);
        }
    }
}

/// Inputs that are stamped `late` seconds after the motion go back by so much; the rows for which none is
/// left are missing.
fn shift_inputs(e: &mut Experiment, late: f64) {
    let nu = e.nu();
    let old = e.u.clone();
    let n = e.len();
    let slack = 0.25 * e.sample_time();
    let mut from = 0;
    for i in 0..n {
        let t = e.t[i] + late;
        // The input of the last row at or before the time: a hold of zero order.
        while from + 1 < n && e.t[from + 1] <= t + slack {
            from += 1;
        }
        let outside = t < e.t[0] - slack || t > e.t[n - 1] + slack;
        for j in 0..nu {
            e.u[i * nu + j] = if outside {
                f64::NAN
            } else {
                old[from * nu + j]
            };
        }
    }
    recount(e);
}

/// Makes cells of a column missing; returns how many there were.
pub(crate) fn forget(e: &mut Experiment, column: &str, rows: std::ops::Range<usize>) -> usize {
    let (n, nq, nu) = (e.len(), e.nq, e.nu());
    let Some((stem, j)) = split(column) else {
        return 0;
    };
    let (x, width) = match stem {
        "q" => (Some(&mut e.q), nq),
        "dq" => (e.v.as_mut(), nq),
        "u" => (Some(&mut e.u), nu),
        _ => (None, nq),
    };
    let Some(x) = x else { return 0 };
    let mut count = 0;
    for i in rows.start..rows.end.min(n) {
        if j < width && !x[i * width + j].is_nan() {
            x[i * width + j] = f64::NAN;
            count += 1;
        }
    }
    e.missing += count;
    count
}

/// Empty cells anew; a velocity that is absent for a joint is no empty cell.
fn recount(e: &mut Experiment) {
    let nq = e.nq;
    let count = |x: &[f64]| x.iter().filter(|x| x.is_nan()).count();
    let velocities = e.v.as_ref().map_or(0, |v| {
        let of = |j: usize| v.iter().skip(j).step_by(nq).filter(|x| x.is_nan()).count();
        (0..nq).map(of).filter(|&c| c < e.t.len()).sum()
    });
    e.missing = count(&e.q) + count(&e.u) + velocities;
    e.missing += e.tau.as_deref().map_or(0, count) + e.qref.as_deref().map_or(0, count);
}

/// Warnings of the reader about sample times, after the time has another unit.
fn restate_times(data: &mut Dataset, factor: f64) {
    data.warnings.retain_mut(|warning| match warning {
        DataWarning::SampleTime { found, stated, .. } => {
            *found *= factor;
            (*found - *stated).abs() > 0.01 * stated.abs()
        }
        _ => true,
    });
}
