//! The content of the page; layout and plots are those of `pid_page`.

use maud::{Markup, html};
use pid_page::number::{short, unit, value as number, with_deviation};
use pid_page::{Footer, Ink, Legend, Page, figure, legend};

use super::plot::{self, Axes};
use super::{Bound, MissingForce, Motion, MotionJoint, ParameterRow, Report, Verdict};
use pid_fit::gap::metrics::{ChannelError, FreeRunScore};
use pid_nlp::solver::Iteration;

const SECTIONS: [(&str, &str); 7] = [
    ("findings", "Findings"),
    ("parameters", "Parameters"),
    ("error", "Free-run error"),
    ("force", "Missing force"),
    ("motion", "Motion"),
    ("run", "Run"),
    ("data", "Data"),
];

pub(super) fn page(report: &Report) -> String {
    let settings: Vec<String> = report
        .settings
        .iter()
        .map(|s| format!("{} {}", s.name, s.value))
        .collect();
    let records = report.data.experiments.len();
    let page = Page {
        title: &report.title,
        lead: html! { p { (report.model.source) } },
        sections: &SECTIONS,
        body: html! {
            (tiles(report))
            (findings(report))
            (parameters(report))
            (free_run(report))
            (missing_force(report))
            (motions(report))
            (run(report))
            (data(report))
        },
        footer: Footer {
            program: &format!(
                "{} · report schema {}",
                report.program, report.schema_version
            ),
            data: &format!("{}, {records} record{}", report.data.name, plural(records)),
            settings: &settings.join(", "),
            more: "the same figures are in the JSON file beside this page",
        },
    };
    page.html()
}

fn verdict(v: Verdict) -> (&'static str, &'static str) {
    match v {
        Verdict::Good => ("good", "converged"),
        Verdict::Fair => ("fair", "usable with reservations"),
        Verdict::Bad => ("bad", "not usable"),
    }
}

fn tiles(report: &Report) -> Markup {
    let (class, word) = verdict(report.outcome.verdict);
    let samples: usize = report.data.experiments.iter().map(|e| e.samples).sum();
    let largest = report
        .missing_force
        .iter()
        .max_by(|a, b| a.share.total_cmp(&b.share));
    html! {
        div.tiles {
            div.tile {
                div.name { "Outcome" }
                div.value { span.badge.(class) { (word) } }
                div.more { (report.outcome.status) }
            }
            div.tile {
                div.name { "Objective" }
                div.value { (report.outcome.objective.map_or_else(|| "–".into(), number)) }
                div.more { (report.outcome.iterations_in_words()) ", " (number(round3(report.outcome.seconds))) " s" }
            }
            div.tile {
                div.name { "Model" }
                div.value { (report.model.name) }
                div.more { (report.data.joints.len()) " joint" (plural(report.data.joints.len())) ", " (report.model.np) " parameters" }
            }
            div.tile {
                div.name { "Data" }
                div.value { (report.data.name) }
                div.more { (report.data.experiments.len()) " experiment" (plural(report.data.experiments.len())) ", " (samples) " samples" }
            }
            @if let Some(f) = largest {
                div.tile {
                    div.name { "Largest missing force" }
                    div.value { (percent(f.share)) }
                    div.more { "of the force on " (f.joint) }
                }
            }
        }
    }
}

fn round3(v: f64) -> f64 {
    if v > 1.0 {
        (v * 100.0).round() / 100.0
    } else {
        (v * 1e4).round() / 1e4
    }
}

fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}

fn percent(share: f64) -> String {
    if share >= 0.1 {
        format!("{:.0} %", 100.0 * share)
    } else {
        format!("{:.1} %", 100.0 * share)
    }
}

fn findings(report: &Report) -> Markup {
    html! {
        section id="findings" {
            h2 { "Findings" }
            @if report.findings.is_empty() {
                p.about { "Nothing stands out." }
            } @else {
                ol { @for f in &report.findings { li { (f) } } }
            }
            @if !report.notes.is_empty() {
                h3 { "Notes" }
                ul { @for n in &report.notes { li { (n) } } }
            }
        }
    }
}

fn parameters(report: &Report) -> Markup {
    let referenced = report.parameters.iter().any(|p| p.reference.is_some());
    html! {
        section id="parameters" {
            h2 { "Parameters" }
            p.about {
                "Identified values with one standard deviation. “Not determined” means that the data fix this parameter only "
                "together with others. "
                span.roomy {
                    "The rail shows the value between its bounds"
                    @if referenced { ", the tick the reference value" }
                    "."
                }
            }
            div.scroll { table {
                thead { tr {
                    th { "Name" } th.num { "Value" } th.num { "± std. dev." } th { "Unit" }
                    @if referenced { th.num { "Reference" } }
                    th.num.roomy { "Start" } th.num { "Lower" } th.roomy { "Range" } th.num { "Upper" } th { "Meaning" }
                } }
                tbody { @for p in &report.parameters { (parameter(p, referenced)) } }
            } }
        }
    }
}

fn parameter(p: &ParameterRow, referenced: bool) -> Markup {
    let (value, deviation) = match p.deviation {
        Some(d) => with_deviation(p.value, d),
        None => (number(p.value), String::new()),
    };
    html! {
        tr {
            td.name { (p.name) }
            td.num { (value) }
            td.num {
                @match p.deviation {
                    Some(_) => (deviation),
                    None if p.fixed => span.badge.plain { "held" },
                    None => span.badge.fair { "not determined" },
                }
            }
            td.unit { (unit(&p.unit)) }
            @if referenced { td.num.quiet { (p.reference.map(number).unwrap_or_default()) } }
            td.num.quiet.roomy { (number(if rounded_zero(p) { 0.0 } else { p.start })) }
            td.num.quiet { (p.lower.map_or_else(|| "−∞".into(), number)) }
            td.roomy { (rail(p)) }
            td.num.quiet { (p.upper.map_or_else(|| "∞".into(), number)) }
            td.quiet {
                @match p.at_bound {
                    Some(Bound::Lower) => { span.badge.bad { "at lower bound" } " " },
                    Some(Bound::Upper) => { span.badge.bad { "at upper bound" } " " },
                    None => {},
                }
                (p.doc)
            }
        }
    }
}

/// A start of less than a billionth of its range is the rounding of zero.
fn rounded_zero(p: &ParameterRow) -> bool {
    let ends = p.lower.zip(p.upper);
    ends.is_some_and(|(low, high)| p.start.abs() < 1e-9 * (high - low))
}

/// Value and reference between the bounds, on a logarithmic rail where the range spans more than a decade.
fn rail(p: &ParameterRow) -> Markup {
    let (Some(low), Some(high)) = (p.lower, p.upper) else {
        return html! {};
    };
    if low >= high {
        return html! {};
    }
    let place = |v: f64| {
        let share = if low > 0.0 && high > 10.0 * low {
            (v / low).ln() / (high / low).ln()
        } else {
            (v - low) / (high - low)
        };
        format!("left:{:.1}%", 100.0 * share.clamp(0.0, 1.0))
    };
    let class = if p.at_bound.is_some() {
        "dot edge"
    } else {
        "dot"
    };
    html! {
        span.range {
            span.rail {}
            @if let Some(r) = p.reference { span.tick style=(place(r)) {} }
            span class=(class) style=(place(p.value)) {}
        }
    }
}

fn free_run(report: &Report) -> Markup {
    html! {
        section id="error" {
            h2 { "Free-run error" }
            p.about {
                "The model is simulated from the recorded state with the recorded inputs alone and restarted after each horizon. "
                "RMS and largest error per joint, on the records that were fitted (train) and on those that never were (test)."
            }
            @if report.free_run.is_empty() { p { "No free run was made." } }
            @else { div.scroll { table {
                thead { tr {
                    th { "Records" } th { "Role" } th { "Horizon" } th { "Joint" }
                    th.num { "Position RMS" } th.num { "MAE" } th.num { "max" } th { "" }
                    th.num { "Velocity RMS" } th.num { "max" } th { "" } th.num { "Windows" } th.num { "J" }
                } }
                tbody { @for s in &report.free_run { (score(report, s)) } }
            } } }
        }
    }
}

fn score(report: &Report, s: &FreeRunScore) -> Markup {
    let names = match s.experiments.as_slice() {
        [one] => one.clone(),
        several => format!("{} records", several.len()),
    };
    let cell = |e: Option<ChannelError>, f: fn(&ChannelError) -> f64| {
        e.map_or_else(|| "–".to_owned(), |e| short(f(&e)))
    };
    html! {
        @for (k, joint) in s.joints.iter().enumerate() {
            @let channels = report.data.joints.get(k);
            tr {
                @if k == 0 {
                    td.name rowspan=(s.joints.len()) { (names) }
                    td rowspan=(s.joints.len()) { (s.role) }
                    td rowspan=(s.joints.len()) { (s.horizon) }
                }
                td { (joint.joint) }
                td.num { b { (cell(joint.q, |e| e.rms)) } }
                td.num { (cell(joint.q, |e| e.mae)) }
                td.num { (cell(joint.q, |e| e.max)) }
                td.unit { (channels.map_or("", |c| c.unit())) }
                td.num { (cell(joint.v, |e| e.rms)) }
                td.num { (cell(joint.v, |e| e.max)) }
                td.unit { @if joint.v.is_some() { (channels.map_or("", |c| c.velocity_unit())) } }
                @if k == 0 {
                    td.num rowspan=(s.joints.len()) {
                        (s.windows)
                        @if s.diverged > 0 { " " span.badge.bad { (s.diverged) " diverged" } }
                        @if s.skipped > 0 { " " span.badge.fair { (s.skipped) " skipped" } }
                    }
                    td.num rowspan=(s.joints.len()) { (s.objective.map_or_else(|| "–".into(), number)) }
                }
            }
        }
    }
}

fn missing_force(report: &Report) -> Markup {
    html! {
        section id="force" {
            h2 { "Missing generalised force" }
            p.about {
                "w(t) is what would have to act on each joint, beside everything the model knows, for the model to follow the record. "
                "Where it leaves the grey band, two standard deviations wide, the record contradicts the model. Its dependence on velocity, direction and position tells what is missing."
            }
            @if report.missing_force.is_empty() { p { "It was not computed." } }
            @else {
                div.scroll { table {
                    thead { tr { th { "Joint" } th.num { "RMS of w" } th.num { "RMS of the whole force" } th { "Unit" } th { "Share" } th.num { "Standard deviation of w" } } }
                    tbody { @for f in &report.missing_force { tr {
                        td.name { (f.joint) }
                        td.num { (short(f.rms)) }
                        td.num { (short(f.total_rms)) }
                        td.unit { (unit(&f.unit)) }
                        td { span.bar { b style=(format!("width:{:.1}%", 100.0 * f.share.clamp(0.0, 1.0))) {} } " " (percent(f.share)) }
                        td.num { (f.band_rms.map_or_else(|| "–".into(), |b| short(0.5 * b))) }
                    } } }
                } }
                @for f in &report.missing_force { (force(f)) }
            }
        }
    }
}

fn force(f: &MissingForce) -> Markup {
    let unit = unit(&f.unit);
    let against = |quantity: &str, of: &str, axis, bins| {
        let axes = Axes {
            title: &format!("Missing force on {} against {quantity}", f.joint),
            x: (quantity, of),
            y: ("w", &unit),
        };
        let svg = plot::scatter(&axes, &f.samples, axis, bins);
        figure(&svg, &f.joint, &format!("missing force against {quantity}"))
    };
    html! {
        h3 { (f.joint) }
        (legend(&[
            Legend::Dot(Ink::Forward, "moving forward (v > 0)"),
            Legend::Dot(Ink::Backward, "moving backward (v < 0)"),
            Legend::Note("line: class means, bars: one standard deviation"),
        ]))
        div.plots {
            (against("velocity", &f.velocity_unit, 1, &f.by_velocity))
            (against("position", &f.position_unit, 0, &f.by_position))
        }
        @let first = f.over_time.iter().take(2);
        @let rest: Vec<_> = f.over_time.iter().skip(2).collect();
        div.plots { @for e in first { (force_time(f, e, &unit)) } }
        @if !rest.is_empty() {
            details {
                summary { "Over time, " (rest.len()) " more record" (plural(rest.len())) }
                div.plots { @for e in rest { (force_time(f, e, &unit)) } }
            }
        }
    }
}

fn force_time(f: &MissingForce, e: &super::ForceTrace, unit: &str) -> Markup {
    let axes = Axes {
        title: &format!("Missing force on {} over time, {}", f.joint, e.experiment),
        x: ("time", "s"),
        y: ("w", unit),
    };
    let svg = plot::force_over_time(&axes, &e.w, e.band.as_ref());
    let what = format!("over time, {} ({})", e.experiment, e.role);
    figure(&svg, &f.joint, &what)
}

fn motions(report: &Report) -> Markup {
    html! {
        section id="motion" {
            h2 { "Measured and simulated motion" }
            (legend(&[
                Legend::Line(Ink::Measured, "measured"),
                Legend::Line(Ink::Simulated, "simulated"),
            ]))
            @if report.motions.is_empty() { p { "No motion was simulated." } }
            @for (k, m) in report.motions.iter().enumerate() {
                @if k < 4 { (motion(m)) } @else {
                    details { summary { (m.experiment) " (" (m.role) ")" } (motion(m)) }
                }
            }
        }
    }
}

fn motion(m: &Motion) -> Markup {
    html! {
        h3 { (m.experiment) " " span.badge.plain { (m.role) } " " span.badge.plain { (m.how) } }
        div.plots { @for j in &m.joints { (position(m, j)) (velocity(m, j)) } }
    }
}

fn position(m: &Motion, j: &MotionJoint) -> Markup {
    let axes = Axes {
        title: &format!(
            "Measured and simulated position of {}, {}",
            j.joint, m.experiment
        ),
        x: ("time", "s"),
        y: ("position", &j.unit),
    };
    let svg = plot::compare(&axes, Some(&j.q_measured), &j.q_simulated);
    figure(&svg, &j.joint, "position")
}

fn velocity(m: &Motion, j: &MotionJoint) -> Markup {
    let (who, what) = match j.v_measured {
        Some(_) => ("Measured and simulated", "velocity"),
        None => ("Simulated", "velocity, not recorded"),
    };
    let axes = Axes {
        title: &format!("{who} velocity of {}, {}", j.joint, m.experiment),
        x: ("time", "s"),
        y: ("velocity", &j.velocity_unit),
    };
    let svg = plot::compare(&axes, j.v_measured.as_ref(), &j.v_simulated);
    figure(&svg, &j.joint, what)
}

fn run(report: &Report) -> Markup {
    let best = report
        .starts
        .iter()
        .filter_map(|s| s.objective)
        .fold(f64::INFINITY, f64::min);
    html! {
        section id="run" {
            h2 { "Run" }
            p.about { "Feasibility and optimality of the returned point, computed anew from the problem and not taken from the solver." }
            div.scroll { table {
                thead { tr { th { "Check" } th.num { "Value" } th.num { "Tolerance" } th { "" } } }
                tbody { @for c in &report.outcome.checks { tr {
                    td { (c.name) } td.num { (number(c.value)) } td.num.quiet { (number(c.tolerance)) }
                    td { @if c.passed() { span.badge.good { "holds" } } @else { span.badge.bad { "violated" } } }
                } } }
            } }
            h3 { "Settings" }
            div.scroll { table { tbody { @for s in &report.settings { tr { td.quiet { (s.name) } td { (s.value) } } } } } }
            @if report.starts.len() > 1 {
                h3 { "Starts" }
                div.scroll { table {
                    thead { tr { th.num { "Start" } th.num { "Objective" } th.num { "Iterations" } th.num { "Time, s" } th { "Status" } } }
                    tbody { @for s in &report.starts { tr {
                        td.num { (s.index) }
                        td.num {
                            (s.objective.map_or_else(|| "–".into(), number))
                            @if s.objective == Some(best) { " " span.badge.good { "best" } }
                        }
                        td.num { (s.iterations) } td.num { (number(round3(s.seconds))) } td { (s.status) }
                    } } }
                } }
            }
            @if !report.iterations.is_empty() {
                details {
                    summary { "Iterations of the best start (" (report.iterations.len()) ")" }
                    pre { (Iteration::HEADING) "\n" @for i in &report.iterations { (i.line()) "\n" } }
                }
            }
        }
    }
}

fn data(report: &Report) -> Markup {
    let d = &report.data;
    html! {
        section id="data" {
            h2 { "Data: " (d.title) }
            p.about { (d.source) " · licence: " (d.license) }
            div.scroll { table {
                thead { tr { th { "Record" } th { "Role" } th.num { "Samples" } th.num { "Length, s" } th.num { "Step, ms" } th.num { "Missing cells" } th { "Note" } } }
                tbody { @for e in &d.experiments { tr {
                    td.name { (e.name) } td { (e.role) } td.num { (e.samples) } td.num { (number(round3(e.duration))) }
                    td.num { (number(round3(1e3 * e.sample_time))) } td.num { (e.missing) } td.quiet { (e.note) }
                } } }
            } }
            div.scroll { table {
                thead { tr { th { "Joint" } th { "Kind" } th { "Input" } th { "Velocity" } } }
                tbody { @for j in &d.joints { tr {
                    td.name { (j.name) }
                    td { @if j.prismatic { "prismatic" } @else { "revolute" } }
                    td { (j.input.word()) ", " (unit(&j.input_unit)) }
                    td { (format!("{:?}", j.velocity).to_lowercase()) }
                } } }
            } }
            @if !d.warnings.is_empty() { ul { @for w in &d.warnings { li { (w) } } } }
        }
    }
}

#[cfg(test)]
mod tests;
