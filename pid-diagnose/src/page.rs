//! A report as one self-contained page.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::diagnosis::{Diagnosis, Named, Nameless, Remainder, Verdict};
use crate::effects;
use crate::free::Form;
use crate::locate::{Axis, MissingForce, classes};
use crate::next::Experiment;
use crate::plot;
use crate::report::Report;
use crate::timing::Alignment;

const STYLE: &str = ":root{color-scheme:light dark;--page:#f6f7f9;--card:#fff;--text:#14181f;--quiet:#5a6473;--line:#e3e7ed;--axis:#b4bcc8;\
--bar:#4a7ab5;--force:#8e3fc9;--band:#2b3440;--forward:#1d6fd6;--backward:#d9480f}\
@media(prefers-color-scheme:dark){:root{--page:#11151b;--card:#191f28;--text:#e8ecf2;--quiet:#9aa6b6;--line:#2a323e;--axis:#4b5666;\
--bar:#7aa9f7;--force:#c08bf0;--band:#d5dce6;--forward:#5fa4ff;--backward:#ff8a5c}}\
*{box-sizing:border-box}body{margin:0;background:var(--page);color:var(--text);font:15px/1.5 system-ui,sans-serif}\
main{max-width:68rem;margin:0 auto;padding:1.6rem 1.4rem 4rem}section{background:var(--card);border:1px solid var(--line);\
border-radius:12px;padding:1rem 1.3rem 1.2rem;margin-top:1.1rem}h1{font-size:1.5rem;margin:0}h2{font-size:1.1rem;margin:0 0 .4rem}\
h3{font-size:.95rem;margin:1rem 0 .2rem}p{margin:.35rem 0;max-width:95ch}.verdict{font-size:1.35rem;font-weight:600;margin:.5rem 0 0}\
.quiet,figcaption{color:var(--quiet);font-size:.87rem}table{border-collapse:collapse;margin:.5rem 0;font-size:.92rem}\
td,th{padding:.25rem 1.1rem .25rem 0;text-align:left;border-bottom:1px solid var(--line)}th{color:var(--quiet);font-size:.83rem}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}.equation{font-family:ui-monospace,monospace;font-size:.92em}\
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(24rem,100%),1fr));gap:.4rem 1.2rem}figure{margin:0}.single{max-width:38rem}\
svg{width:100%;height:auto;display:block}svg.bars{max-width:46rem}svg text{fill:var(--quiet);font:11px system-ui,sans-serif}\
svg.bars text{font-size:13px;fill:var(--text)}svg.bars rect{fill:var(--bar)}.grid{stroke:var(--line)}.zero{stroke:var(--axis)}\
.band{fill:var(--band);opacity:.16}.stated{stroke:var(--quiet);stroke-dasharray:4 3}.force{fill:none;stroke:var(--force);stroke-width:1.2}circle.forward{fill:var(--forward)}\
circle.backward{fill:var(--backward)}.dot{opacity:.28}.mean{fill:none;stroke-width:1.8}.mean.forward,.spread.forward{stroke:var(--forward)}\
.mean.backward,.spread.backward{stroke:var(--backward)}.legend i{display:inline-block;width:9px;height:9px;border-radius:50%;margin:0 .4rem 0 .9rem}";

/// The page.
pub(crate) fn page(report: &Report) -> String {
    let d = report.diagnosis();
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width,initial-scale=1";
                title { "Diagnosis of " (d.case) }
                style { (PreEscaped(STYLE)) }
            }
            body { main {
                h1 { "Diagnosis of " (d.case) }
                p class="verdict" { (verdict(d)) }
                p { "Confidence " (format!("{:.2}", d.confidence)) ". Where it shows: " (d.regime) "." }
                @if !d.confusion_set.is_empty() {
                    p { "These records do not tell it apart from: " (d.confusion_set.join(", ")) "." }
                }
                @for warning in &d.warnings { p class="quiet" { (warning) } }
                @if let Some(law) = law(d) { section { (nameless(report, law)) } }
                @for e in &d.effects { section { (effect(e)) } }
                @if !d.beyond_tolerance.is_empty() {
                    section {
                        h2 { "Outside its tolerance" }
                        p { "No effect explains the records while these values stay within what the description states:" }
                        ul { @for b in &d.beyond_tolerance { li { (b.words()) } } }
                    }
                }
                @if let Some(left) = &d.remainder { section { (remainder(d, left)) } }
                section {
                    h2 { "How far" }
                    p class="quiet" { "Free-run error on records that were not fitted, relative to the motion; the floor is what noise alone leaves. Intervals of 95 % from the windows of the records." }
                    (gaps(d))
                    (joints(d))
                }
                section { (located(report)) }
                @if !d.signals.is_empty() { section { (signals(report)) } }
                section {
                    h2 { "Which" }
                    (ranking(d))
                    p class="quiet" {
                        "Mean squared innovation " (format!("{:.3}", d.misfit.0)) " without and "
                        (format!("{:.3}", d.misfit.1)) " with the named effects; 1 where the noise is as stated. "
                        (d.refits) " candidates refitted in full, " (format!("{:.1}", d.seconds)) " s."
                    }
                }
                section { (next(report.next.as_ref())) }
            } }
        }
    }
    .into_string()
}

/// Where the gap lives.
fn located(report: &Report) -> Markup {
    let place = match &report.place {
        Ok(place) => place,
        Err(reason) => {
            return html! { h2 { "Where" } p { "The missing force could not be found: " (reason) } };
        }
    };
    let worst = place.worst();
    html! {
        h2 { "Where" }
        p class="quiet" {
            "Force that would have to act beside the nominal structure for it to follow the test records, by smoothing with "
            "noise levels from the records. Bars: share of each joint, in units of its typical torque."
        }
        (plot::bars(&share_rows(report, place), "share of the missing force per joint"))
        table {
            tr { th { "joint" } th class="n" { "rms" } @for a in Axis::ALL { th class="n" { (a.words()) } } }
            @for (j, p) in place.joints.iter().enumerate() {
                tr {
                    td { (report.evidence.case.nominal.joints[j].name) }
                    td class="n" { (format!("{:.4} {}", p.rms, unit(report, j))) }
                    @for x in p.explained { td class="n" { (format!("{x:.2}")) } }
                }
            }
        }
        p class="quiet" { "Figures under a quantity: how far the missing force is a function of it and of the direction of motion (1: entirely)." }
        @for (j, p) in place.joints.iter().enumerate() {
            @let name = &report.evidence.case.nominal.joints[j].name;
            h3 { "Joint " (name) }
            div class="plots" {
                @for c in &p.curves {
                    figure {
                        (plot::over_time(c, unit(report, j)))
                        figcaption { (c.record) ", with a band of two standard deviations about zero" }
                    }
                }
            }
            @if j == worst {
                p class="quiet legend" { "Against one quantity each, with means and spreads of classes:" i style="background:var(--forward)" {} "forward" i style="background:var(--backward)" {} "backward" }
                div class="plots" {
                    @for axis in [Axis::Velocity, Axis::Position, Axis::Load, Axis::SinceReversal] {
                        figure { (plot::against(&p.samples, &classes(&p.samples, axis), axis as usize, (&axis_name(report, j, axis), &format!("missing force, {}", unit(report, j))))) }
                    }
                }
            }
        }
    }
}

/// When inputs act and readings show.
fn signals(report: &Report) -> Markup {
    let name = |j: usize| &report.evidence.case.nominal.joints[j - 1].name;
    let all = &report.diagnosis().signals;
    html! {
        h2 { "Signal paths" }
        p class="quiet" {
            "When the input acts: shift of the input against the force that moves the joint, beside errors of inertia, gain, friction, offset "
            "and gravity. When the velocity shows: shift of its reading against the derivative of the positions, and its factor. "
            "A figure in bold differs from what is stated by four standard deviations and takes 30 % of the squares away."
        }
        table {
            tr { th { "joint" } th class="n" { "input acts late by" } th class="n" { "velocity shows late by" } th class="n" { "stated" } th class="n" { "velocity over derivative" } th class="n" { "left as stated" } }
            @for s in all {
                tr {
                    td { (name(s.joint)) }
                    td class="n" { (shift(s.input.as_ref(), "not determined")) }
                    @match &s.velocity {
                        Some(v) => {
                            td class="n" { (shift(Some(&v.timing), "")) }
                            td class="n" { (format!("{:.2} ms", 1e3 * v.timing.stated)) }
                            td class="n" { (format!("{:.4}", v.scale)) }
                            td class="n" { (format!("{:.2} %", 100.0 * v.timing.left)) }
                        }
                        None => td class="n" colspan="4" { "no velocity recorded" }
                    }
                }
            }
        }
        div class="plots" {
            @for s in all {
                @for (what, found) in [("input", s.input.as_ref()), ("velocity", s.velocity.as_ref().map(|v| &v.timing))] {
                    @if let Some(a) = found {
                        figure {
                            (plot::alignment(a, &format!("left of the {what}, %")))
                            figcaption { (name(s.joint)) ": what a shift of the " (what) " leaves; bar: best shift with two standard deviations, dashes: stated" }
                        }
                    }
                }
            }
        }
    }
}

/// A shift in words, bold where it is news.
fn shift(found: Option<&Alignment>, absent: &str) -> Markup {
    let Some(a) = found else {
        return html! { (absent) };
    };
    let text = match a.std {
        Some(std) => format!("{:.2} ± {:.2} ms", 1e3 * a.delay, 1e3 * std),
        None => "not determined".to_owned(),
    };
    html! { @if a.noticeable() { b { (text) } } @else { (text) } }
}

fn unit(report: &Report, j: usize) -> &'static str {
    if report.evidence.case.nominal.joints[j].revolute {
        "N m"
    } else {
        "N"
    }
}

fn axis_name(report: &Report, j: usize, axis: Axis) -> String {
    let revolute = report.evidence.case.nominal.joints[j].revolute;
    let unit = match (axis, revolute) {
        (Axis::Velocity, true) => "rad/s",
        (Axis::Velocity, false) => "m/s",
        (Axis::Position, true) => "rad",
        (Axis::Position, false) => "m",
        (Axis::Load, true) => "N m",
        (Axis::Load, false) => "N",
        _ => "s",
    };
    format!("{}, {unit}", axis.words())
}

fn share_rows(report: &Report, place: &MissingForce) -> Vec<(String, f64, String)> {
    place
        .shares()
        .iter()
        .enumerate()
        .map(|(j, s)| {
            let name = report.evidence.case.nominal.joints[j].name.clone();
            (name, *s, format!("{:.0} %", 100.0 * s))
        })
        .collect()
}

/// The next experiment.
fn next(next: Option<&Experiment>) -> Markup {
    html! {
        h2 { "Next" }
        @match next {
            None => p { "No rival is left that a further motion within the limits would have to separate." },
            Some(e) => {
                p {
                    "Rivals: " (e.rivals.0) " and " (e.rivals.1) ". The motion in next_experiment.csv, within the positions, speeds and torques of these records, would tell them apart with an expected logarithm of the likelihood ratio of "
                    b { (format!("{:.1}", e.least())) }
                    (format!(" (if {} is right: {:.1}; if {}: {:.1}), after both are refitted.", e.rivals.0, e.log_odds.0, e.rivals.1, e.log_odds.1))
                }
                @if e.least() < 3.0 {
                    p { "That is little: within these limits no motion that was tried separates them. A wider range, more speed or another sensor is needed." }
                }
            }
        }
    }
}

fn place(effect: &str, joint: Option<usize>) -> String {
    joint.map_or_else(|| effect.to_owned(), |j| format!("{effect} at joint {j}"))
}

fn verdict(d: &Diagnosis) -> String {
    match &d.verdict {
        Verdict::OutsideTolerance { .. } => format!(
            "No effect is missing, but friction lies outside its stated tolerance: {}.",
            all(d)
        ),
        Verdict::Nothing => {
            "No effect is missing beyond parameters within their tolerances.".to_owned()
        }
        Verdict::Unknown if law(d).is_some() => law(d).map_or_else(String::new, |l| {
            let all = match d.effects.len() {
                0 => String::new(),
                1 => format!(" {} only imitates it.", all(d)),
                _ => format!(" {} only imitate it.", all(d)),
            };
            let (words, share) = (l.words(), 100.0 * l.explained);
            format!("No effect of the library, but {words}: {share:.0} % of the squared gap.{all}")
        }),
        Verdict::Unknown if d.effects.is_empty() => {
            "Something is missing, but no effect of the library explains it.".to_owned()
        }
        Verdict::Unknown => format!(
            "Something is missing that no effect of the library explains; {} of it goes with {}.",
            d.remainder
                .as_ref()
                .map_or_else(String::new, |r| format!("{:.0} %", 100.0 * r.explained)),
            all(d)
        ),
        Verdict::Effect { .. } => match &d.remainder {
            Some(r) => format!(
                "{}: {:.0} % of the squared gap; the rest is unknown.",
                all(d),
                100.0 * r.explained
            ),
            None => all(d),
        },
    }
}

/// All named effects.
fn all(d: &Diagnosis) -> String {
    d.effects
        .iter()
        .map(|e| place(&e.effect, e.joint))
        .collect::<Vec<_>>()
        .join(" and ")
}

/// The law without a name that describes the records better than any effect.
fn law(d: &Diagnosis) -> Option<&Nameless> {
    d.remainder.as_ref()?.nameless.as_ref()
}

/// A cause without a name.
fn nameless(report: &Report, law: &Nameless) -> Markup {
    let j = law.joint - 1;
    let name = &report.evidence.case.nominal.joints[j].name;
    let (what, shape, names) = match law.form {
        Form::ForceOverPosition => (
            format!("a force that depends on the position of joint {name} alone"),
            "a stop shows as a kink, a hard point as a hill",
            (
                axis_name(report, j, Axis::Position),
                format!("force, {}", unit(report, j)),
            ),
        ),
        Form::GainOverTime => (
            format!("a gain of the drive of joint {name} that depends on the time alone"),
            "a supply that sags and magnets that warm up fade",
            (
                "time since the start of the record, s".to_owned(),
                "relative change of the gain".to_owned(),
            ),
        ),
    };
    html! {
        h2 { "A cause without a name" }
        p {
            "In place of all effects, " (what) " explains " (format!("{:.0} %", 100.0 * law.explained))
            " of the squared gap beyond the floor on motions that were never fitted, and describes the records better than the "
            "named effects, its number of parameters counted. Its shape is free: " (shape) "."
        }
        div class="single" { figure {
            (plot::free_law(law, (&names.0, &names.1)))
            figcaption { "straight between the marks, with a band of two standard deviations where the records determine it" }
        } }
    }
}

/// What is left beside the named effects.
fn remainder(d: &Diagnosis, r: &Remainder) -> Markup {
    html! {
        h2 { "What is left" }
        p {
            @if d.effects.is_empty() {
                "No effect of the library pays on motions that were never fitted."
            } @else {
                "The named effects explain " (format!("{:.0} %", 100.0 * r.explained))
                " of the squared gap beyond the floor on motions that were never fitted."
            }
            @if r.own_error {
                " Intervals and scores count the model's own error, "
                "correlated as it is, in place of sensor noise."
            }
        }
        table {
            tr { th { "joint" } th class="n" { "share" } th class="n" { "rms of the force still missing" } th { "goes with" } th class="n" { "how far" } }
            @for m in &r.missing_force {
                tr {
                    td { (m.joint) }
                    td class="n" { (format!("{:.0} %", 100.0 * m.share)) }
                    td class="n" { (format!("{:.4}", m.rms)) }
                    td { (m.regime) }
                    td class="n" { (format!("{:.2}", m.explained)) }
                }
            }
        }
    }
}

fn effect(e: &Named) -> Markup {
    let known = effects::by_id(&e.effect).map(|x| x.info());
    html! {
        h2 { (place(&e.effect, e.joint)) }
        @if let Some(info) = known {
            p { (info.title) ": " span class="equation" { (info.equation) } ". " (info.source) "." }
        }
        table {
            tr { th { "parameter" } th { "value" } th { "standard deviation" } }
            @for p in &e.parameters {
                tr {
                    td { (p.name) }
                    td class="n" { (format!("{:.5}", p.value)) }
                    td class="n" { (p.std.map_or_else(|| "not determined".to_owned(), |s| format!("{s:.2e}"))) }
                }
            }
        }
        @if let Some(info) = known {
            @if !info.confusions.is_empty() {
                p { "What tells it from its rivals:" }
                ul { @for (rival, why) in info.confusions { li { (rival) ": " (why) } } }
            }
            @for (simulator, field) in info.simulators() {
                p { "In " (simulator) ": " (field) "." }
            }
        }
    }
}

/// Gap before, after, floor on one scale.
fn gaps(d: &Diagnosis) -> Markup {
    let (before, after) = d.gap_intervals;
    let text = |x: f64, (a, b): (f64, f64)| {
        if a < b {
            format!("{x:.4}  ({a:.4} to {b:.4})")
        } else {
            // One window has no scatter.
            format!("{x:.4}")
        }
    };
    plot::bars(
        &[
            (
                "before".to_owned(),
                d.gap_before,
                text(d.gap_before, before),
            ),
            ("after".to_owned(), d.gap_after, text(d.gap_after, after)),
            (
                "floor".to_owned(),
                d.gap_floor,
                format!("{:.4}", d.gap_floor),
            ),
        ],
        "gap before, after and floor",
    )
}

fn joints(d: &Diagnosis) -> Markup {
    let figure =
        |v: Option<f64>| v.map_or_else(|| "not recorded".to_owned(), |v| format!("{v:.4}"));
    let rows: Vec<_> = d
        .gap_joints_before
        .iter()
        .zip(&d.gap_joints)
        .enumerate()
        .collect();
    let part = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{:.0} %", 100.0 * x));
    html! {
        table {
            tr { th { "joint" } th class="n" { "position before" } th class="n" { "share" } th class="n" { "after" } th class="n" { "velocity before" } th class="n" { "share" } th class="n" { "after" } }
            @for (j, (before, after)) in rows {
                @let share = d.gap_shares.get(j);
                tr {
                    td { (j + 1) }
                    td class="n" { (figure(Some(before.0))) }
                    td class="n" { (part(share.map(|s| s.0))) }
                    td class="n" { (figure(Some(after.0))) }
                    td class="n" { (figure(before.1)) }
                    td class="n" { (part(share.and_then(|s| s.1))) }
                    td class="n" { (figure(after.1)) }
                }
            }
        }
        p class="quiet" { "Share: part of the squared gap before that this joint and channel have." }
    }
}

fn ranking(d: &Diagnosis) -> Markup {
    html! {
        table {
            tr { th { "effect" } th { "joint" } th { "score" } th { "probability" } }
            @for r in &d.ranking {
                tr {
                    td { (r.effect) }
                    td { (r.joint.map_or_else(String::new, |j| j.to_string())) }
                    td class="n" { (format!("{:.0}", r.score)) }
                    td class="n" { (format!("{:.3}", r.probability)) }
                }
            }
        }
    }
}
