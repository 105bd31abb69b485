//! The report for a terminal.

use std::fmt::Write;

use pid_page::number::{short, unit, value as number, with_deviation};

use super::{Bound, Report, Verdict};

/// Width of the text.
const WIDTH: usize = 100;

pub(super) fn summary(report: &Report) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write_summary(report, &mut out);
    out
}

fn write_summary(r: &Report, out: &mut String) -> std::fmt::Result {
    outcome(r, out)?;
    parameters(r, out)?;
    starts(r, out)?;
    free_runs(r, out)?;
    missing_force(r, out)?;
    for (name, lines) in [("Findings", &r.findings), ("Notes", &r.notes)] {
        if !lines.is_empty() {
            heading(out, name)?;
            for line in lines {
                wrap(out, line)?;
            }
        }
    }
    Ok(())
}

/// Model, data, verdict, and the checks that failed.
fn outcome(r: &Report, out: &mut String) -> std::fmt::Result {
    let samples: usize = r.data.experiments.iter().map(|e| e.samples).sum();
    writeln!(out, "{}", r.title)?;
    writeln!(
        out,
        "  model {} ({}, {} parameters), data {} ({}, {} samples)",
        r.model.name,
        count(r.data.joints.len(), "joint"),
        r.model.np,
        r.data.name,
        count(r.data.experiments.len(), "experiment"),
        samples
    )?;
    let mark = match r.outcome.verdict {
        Verdict::Good => "ok",
        Verdict::Fair => "with reservations",
        Verdict::Bad => "not usable",
    };
    writeln!(
        out,
        "  {}: {}{}, {:.3} s",
        mark,
        r.outcome.status,
        r.outcome.objective.map_or_else(String::new, |j| format!(
            "; J = {}, {}",
            number(j),
            r.outcome.iterations_in_words()
        )),
        r.outcome.seconds
    )?;
    for check in r.outcome.checks.iter().filter(|c| !c.passed()) {
        writeln!(
            out,
            "  check violated: {} = {} (tolerance {})",
            check.name,
            number(check.value),
            number(check.tolerance)
        )?;
    }
    Ok(())
}

/// A line for each parameter.
fn parameters(r: &Report, out: &mut String) -> std::fmt::Result {
    heading(out, "Parameters")?;
    let width = r
        .parameters
        .iter()
        .map(|p| p.name.chars().count())
        .max()
        .unwrap_or(4)
        .max(4);
    writeln!(
        out,
        "  {:width$}  {:>12}  {:>14}  {:>12}  {:<10} ",
        "name", "value", "std. dev.", "reference", "unit"
    )?;
    for p in &r.parameters {
        let (value, deviation) = match p.deviation {
            Some(d) => with_deviation(p.value, d),
            None if p.fixed => (number(p.value), "held".into()),
            None => (number(p.value), "not determined".into()),
        };
        let bound = match p.at_bound {
            Some(Bound::Lower) => "at lower bound",
            Some(Bound::Upper) => "at upper bound",
            None => "",
        };
        let line = format!(
            "  {:width$}  {:>12}  {:>14}  {:>12}  {:<10} {}",
            p.name,
            value,
            deviation,
            p.reference.map(number).unwrap_or_default(),
            unit(&p.unit),
            bound
        );
        writeln!(out, "{}", line.trim_end())?;
    }
    Ok(())
}

/// A line for each start, if there are several.
fn starts(r: &Report, out: &mut String) -> std::fmt::Result {
    if r.starts.len() <= 1 {
        return Ok(());
    }
    heading(out, "Starts")?;
    writeln!(
        out,
        "  {:>5}  {:>12}  {:>10}  {:>8}  status",
        "start", "J", "iterations", "time, s"
    )?;
    for s in &r.starts {
        writeln!(
            out,
            "  {:>5}  {:>12}  {:>10}  {:>8.3}  {}",
            s.index,
            s.objective.map_or_else(|| "–".into(), number),
            s.iterations,
            s.seconds,
            s.status
        )?;
    }
    Ok(())
}

/// A line for each horizon and group of records.
fn free_runs(r: &Report, out: &mut String) -> std::fmt::Result {
    if r.free_run.is_empty() {
        return Ok(());
    }
    heading(
        out,
        "Free-run error (RMS, simulated from the recorded state with the recorded inputs)",
    )?;
    for s in &r.free_run {
        let names = match s.experiments.as_slice() {
            [one] => one.clone(),
            several => format!("{} records", several.len()),
        };
        write!(
            out,
            "  {:<5} {:<16} {:<10}",
            s.role.to_string(),
            names,
            s.horizon.to_string()
        )?;
        for (joint, channel) in s.joints.iter().zip(&r.data.joints) {
            // The position behind a velocity that lags is read nowhere.
            if let Some(q) = joint.q {
                write!(out, "  {} {} {}", joint.joint, short(q.rms), channel.unit())?;
            }
        }
        if s.diverged + s.skipped > 0 {
            write!(out, "  ({} diverged, {} skipped)", s.diverged, s.skipped)?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// A line for each joint, with a bar for the share.
fn missing_force(r: &Report, out: &mut String) -> std::fmt::Result {
    if r.missing_force.is_empty() {
        return Ok(());
    }
    heading(out, "Missing generalised force")?;
    for f in &r.missing_force {
        let bar = "#".repeat((20.0 * f.share.clamp(0.0, 1.0)).round() as usize);
        writeln!(
            out,
            "  {:<12} RMS {:>9} {:<4} {:>5.1} % of the whole force  {bar}",
            f.joint,
            short(f.rms),
            unit(&f.unit),
            100.0 * f.share
        )?;
    }
    Ok(())
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

fn heading(out: &mut String, text: &str) -> std::fmt::Result {
    writeln!(out, "\n{text}")
}

/// A list item broken at words.
fn wrap(out: &mut String, text: &str) -> std::fmt::Result {
    let mut line = String::from("  - ");
    let mut used = 4;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if used + length > WIDTH && used > 4 {
            writeln!(out, "{}", line.trim_end())?;
            line = "    ".into();
            used = 4;
        }
        line.push_str(word);
        line.push(' ');
        used += length + 1;
    }
    writeln!(out, "{}", line.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_findings_are_broken_at_words() {
        let mut out = String::new();
        wrap(&mut out, &"friction depends on direction ".repeat(9)).unwrap();
        let lines: Vec<&str> = out.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[0].starts_with("  - friction") && lines[1].starts_with("    "));
        assert!(lines.iter().all(|l| l.chars().count() <= WIDTH));
        let words: Vec<&str> = out.split_whitespace().skip(1).collect();
        assert_eq!(words.len(), 36, "no word is lost");
    }
}
