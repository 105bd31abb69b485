//! The content of the page of a diagnosis; layout and plots are those of `pid_page`.

mod laws;

use laws::{its_law, law, nameless, own_law};
use maud::{Markup, html};
use pid_page::number::{self, short};
use pid_page::{Bar, Footer, Ink, Legend, Page, bars, figure, legend};

use crate::diagnosis::{Ceiling, Diagnosis, Magnitude, Named, Outcome, Remainder};
use crate::effects;
use crate::locate::{Axis, MissingForce, classes};
use crate::next::Experiment;
use crate::plot;
use crate::report::Report;
use crate::timing::Alignment;
use crate::words;

/// The page.
pub(crate) fn page(report: &Report) -> String {
    let d = report.diagnosis();
    let case = &report.evidence.case;
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let page = Page {
        title: &format!("Diagnosis of {}", d.case),
        lead: html! {
            p.verdict { (words::headline(d)) }
            ul.budget { @for line in words::budget(d) { li { (line) } } }
            p { "Confidence " (number::probability(d.confidence)) ". Where it shows: " (d.regime) "." }
            @if !d.confusion_set.is_empty() {
                @let named = if d.effects.len() > 1 { "some of these" } else { "it" };
                @let others: Vec<String> = d.confusion_set.iter().map(|label| spelt(label)).collect();
                p { "These records do not tell " (named) " apart from: " (others.join(", ")) "." }
            }
            @if !d.warnings.is_empty() { p { (count(d.warnings.len(), "remark")) " on the records: see below." } }
        },
        sections: &[],
        body: content(report),
        footer: Footer {
            program: concat!("pid-diagnose ", env!("CARGO_PKG_VERSION")),
            data: &format!(
                "{}, {}, {}",
                d.case,
                count(case.records.len(), "record"),
                count(case.n(), "joint")
            ),
            settings: &format!("{} refitted in full", count(d.refits, "candidate")),
            more: "diagnosis.json beside this page holds the same figures",
        },
    };
    page.html()
}

fn content(report: &Report) -> Markup {
    let d = report.diagnosis();
    html! {
        @if let Some(law) = law(d) { section { (nameless(report, law)) } }
        @if let Some(budget) = budget(d) { section { (budget) } }
        @for e in &d.effects { section { (effect(d, e)) } }
        @if let Some(law) = its_law(d) { section { (own_law(d, law)) } }
        @if !d.beyond_tolerance.is_empty() {
            section {
                h2 { "Outside its tolerance" }
                p { "No effect explains the records while these values stay within what the description states:" }
                ul { @for b in &d.beyond_tolerance { li { (b.words()) } } }
            }
        }
        @if !d.loop_gains.is_empty() {
            section {
                h2 { "Position loops of the drives" }
                p class="quiet" {
                    "Gains within what the description states, and how far the records tell them. A value counts as determined "
                    "where its interval of 95 % lies within 5 % of it. From targets and positions alone a loop, the masses it moves "
                    "and their friction share a common factor; what moves together is named."
                }
                ul { @for gain in &d.loop_gains { li { (gain.words()) } } }
            }
        }
        @if let Some(left) = &d.remainder { section { (remainder(d, left)) } }
        @if !d.warnings.is_empty() {
            section {
                h2 { "Remarks on the records" }
                p { "What reading them found odd. Missing readings take no part in the fit." }
                ul { @for warning in &d.warnings { li { (warning) } } }
            }
        }
        @if !d.rounds.is_empty() { section { (rounds(d)) } }
        section {
            h2 { "How far" }
            p class="quiet" { "Free-run error on records that were not fitted, relative to the motion; the floor is what noise alone leaves. Intervals of 95 % from the windows of the records." }
            (gaps(d))
            (joints(d))
        }
        @if !d.ceilings.is_empty() {
            section {
                h2 { "What any cause can remove at most" }
                p class="quiet" {
                    "A flexible law of each class was fitted at each joint, with no other effect and the nominal parameters free, and judged on "
                    "motions that were not fitted. Share of the squared gap beyond the floor, with its interval of 95 %. Causes of "
                    "different classes can explain the same: the shares do not add up."
                }
                (ceilings(&d.ceilings))
            }
        }
        section { (located(report)) }
        @if !d.signals.is_empty() { section { (signals(report)) } }
        section {
            h2 { "Which" }
            (ranking(d))
            p class="quiet" {
                "Mean squared innovation " (short(d.misfit.0))
                @if !d.effects.is_empty() { " without and " (short(d.misfit.1)) " with the named effects" }
                "; 1 where the noise is as stated. "
                (d.refits) " candidates refitted in full, " (format!("{:.1}", d.seconds)) " s."
            }
        }
        section { (next(report.next.as_ref())) }
    }
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
        (bars("Share of the missing force per joint", &share_rows(report, place)))
        div.scroll { table {
            thead { tr { th { "joint" } th class="num" { "rms" } @for a in Axis::ALL { th class="num" { (a.words()) } } } }
            @for (j, p) in place.joints.iter().enumerate() {
                tr {
                    td { (report.evidence.case.nominal.joints[j].name) }
                    td class="num" { (short(p.rms)) " " (unit(report, j)) }
                    @for x in p.explained { td class="num" { (format!("{x:.2}")) } }
                }
            }
        } }
        p class="quiet" { "Figures under a quantity: how far the missing force is a function of it and of the direction of motion (1: entirely)." }
        @for (j, p) in place.joints.iter().enumerate() {
            @let name = &report.evidence.case.nominal.joints[j].name;
            h3 { "Joint " (name) }
            div class="plots" {
                @for c in &p.curves {
                    (figure(&plot::over_time(c, name, unit(report, j)), &c.record, "with a band of two standard deviations about zero"))
                }
            }
            @if j == worst {
                p.quiet { "Against one quantity each, with means and spreads of classes:" }
                (legend(&[Legend::Dot(Ink::Forward, "forward"), Legend::Dot(Ink::Backward, "backward")]))
                div class="plots" {
                    @for axis in [Axis::Velocity, Axis::Position, Axis::Load, Axis::SinceReversal] {
                        @let names = (axis_name(report, j, axis), ("missing force", unit(report, j)));
                        @let svg = plot::against(&p.samples, &classes(&p.samples, axis), axis as usize, name, names);
                        (figure(&svg, name, &format!("missing force against {}", names.0.0)))
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
        div.scroll { table {
            thead { tr { th { "joint" } th class="num" { "input acts late by" } th class="num" { "velocity shows late by" } th class="num" { "stated" } th class="num" { "velocity over derivative" } th class="num" { "left as stated" } } }
            @for s in all {
                tr {
                    td { (name(s.joint)) }
                    td class="num" { (shift(s.input.as_ref(), "not determined")) }
                    @match &s.velocity {
                        Some(v) => {
                            td class="num" { (shift(Some(&v.timing), "")) }
                            td class="num" { (short(1e3 * v.timing.stated)) " ms" }
                            td class="num" { (format!("{:.4}", v.scale)) }
                            td class="num" { (format!("{:.2} %", 100.0 * v.timing.left)) }
                        }
                        None => td class="num" colspan="4" { "no velocity recorded" }
                    }
                }
            }
        } }
        div class="plots" {
            @for s in all {
                @for (what, found) in [("input", s.input.as_ref()), ("velocity", s.velocity.as_ref().map(|v| &v.timing))] {
                    @if let Some(a) = found {
                        @let words = format!("what a shift of the {what} leaves; band: best shift with two standard deviations, dashes: stated");
                        (figure(&plot::alignment(a, name(s.joint), what), name(s.joint), &words))
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
        Some(std) => format!("{} ms", number::plus_minus(1e3 * a.delay, 1e3 * std)),
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

/// Quantity and unit.
fn axis_name(report: &Report, j: usize, axis: Axis) -> (&'static str, &'static str) {
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
    (axis.words(), unit)
}

fn share_rows(report: &Report, place: &MissingForce) -> Vec<Bar> {
    place
        .shares()
        .iter()
        .enumerate()
        .map(|(j, s)| Bar {
            label: report.evidence.case.nominal.joints[j].name.clone(),
            value: *s,
            text: format!("{:.0} %", 100.0 * s),
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

/// A label such as `cogging:2` as [`place`] has it.
fn spelt(label: &str) -> String {
    let parts = label.split_once(':');
    parts.map_or_else(
        || label.to_owned(),
        |(effect, joint)| format!("{effect} at joint {joint}"),
    )
}

/// How the squared gap beyond the floor is shared out, where effects explain a part of it.
fn budget(d: &Diagnosis) -> Option<Markup> {
    let left = 1.0 - d.remainder.as_ref()?.explained;
    let bar = |label: String, share: f64, interval: Option<(f64, f64)>| {
        let interval = interval.map_or(String::new(), |(low, high)| {
            format!(" ({:.0} to {:.0})", 100.0 * low, 100.0 * high)
        });
        Bar {
            label,
            value: share,
            text: format!("{:.0} %{interval}", 100.0 * share),
        }
    };
    let mut shares: Vec<Bar> = d
        .effects
        .iter()
        .filter_map(|e| Some(bar(place(&e.effect, e.joint), e.share?, e.share_interval)))
        .collect();
    if shares.is_empty() {
        return None;
    }
    let law = its_law(d).map_or(0.0, |law| law.share);
    if law > 0.0 {
        let interval = its_law(d).and_then(|law| law.share_interval);
        shares.push(bar("a law without a name".to_owned(), law, interval));
    }
    shares.push(bar("left".to_owned(), (left - law).max(0.0), None));
    Some(html! {
        h2 { "The budget of the gap" }
        p {
            "Shares of the squared gap beyond the floor on motions that were never fitted: the mean of what is lost "
            "without an effect and of what it explains alone, in proportion to what all explain together. In brackets: "
            "the interval of 95 % over the windows of the free runs."
        }
        (bars("Share of each effect in the squared gap beyond the floor", &shares))
    })
}

/// What the search tried beside the effects taken before, and why it was refused.
fn rounds(d: &Diagnosis) -> Markup {
    html! {
        h2 { "What was tried" }
        @for round in &d.rounds {
            p {
                @if round.exchange { "Asked once more, in the place of " (round.dropped.join(", ")) " and beside " (round.beside.join(", ")) ":" }
                @else if round.beside.is_empty() { "Beside the nominal model:" }
                @else { "Beside " (round.beside.join(", ")) ":" }
            }
            div.scroll { table {
                thead { tr { th { "candidate" } th class="num" { "score" } th class="num" { "gain on records never fitted" } th class="num" { "gap" } th { "outcome" } } }
                @for c in &round.candidates {
                    tr {
                        td { (c.label) }
                        td class="num" { (format!("{:.1}", c.score)) }
                        td class="num" { (format!("{:.1}", c.held_out)) }
                        td class="num" { (short(c.gap)) }
                        td { (c.refused.as_deref().unwrap_or("taken")) }
                    }
                }
            } }
            @if !round.exchange && !round.dropped.is_empty() {
                p { "Dropped after it: " (round.dropped.join(", ")) "." }
            }
        }
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
        div.scroll { table {
            thead { tr { th { "joint" } th class="num" { "share" } th class="num" { "rms of the force still missing" } th { "goes with" } th class="num" { "how far" } } }
            @for m in &r.missing_force {
                tr {
                    td { (m.joint) }
                    td class="num" { (format!("{:.0} %", 100.0 * m.share)) }
                    td class="num" { (short(m.rms)) }
                    td { (m.quantity().unwrap_or("no quantity")) }
                    td class="num" { (format!("{:.2}", m.explained)) }
                }
            }
        } }
        @if !r.ceilings.is_empty() {
            p { "What any cause of a class can remove of what is left, at most:" }
            (ceilings(&r.ceilings))
        }
    }
}

/// The largest ceilings, and how many are below.
fn ceilings(all: &[Ceiling]) -> Markup {
    let shown = all
        .iter()
        .take_while(|c| c.share >= SMALL)
        .take(MOST)
        .count();
    html! {
        @if shown > 0 {
            div.scroll { table {
                thead { tr { th { "a function of" } th { "joint" } th.num { "at most" } th.num { "interval" } th { "corrects the same" } } }
                @for c in &all[..shown] {
                    tr {
                        td { (c.class.words()) }
                        td { (c.joint) }
                        td class="num" { (format!("{:.0} %", 100.0 * c.share)) }
                        td class="num" { (c.interval.map_or_else(|| "not determined".to_owned(), |(low, high)| format!("{:.0} to {:.0} %", 100.0 * low, 100.0 * high))) }
                        td { (c.confounded.join(", ")) }
                    }
                }
            } }
        }
        @let rest = if shown < MOST { format!("less than {:.0} %", 100.0 * SMALL) } else { "no more than the last".to_owned() };
        p class="quiet" { (all.len() - shown) " of " (all.len()) " classes at their joints can remove " (rest) "." }
    }
}

/// Ceilings below this are not shown one by one, nor more than this many.
const SMALL: f64 = 0.05;
const MOST: usize = 12;

fn effect(d: &Diagnosis, e: &Named) -> Markup {
    let known = effects::by_id(&e.effect).map(|x| x.info());
    html! {
        h2 { (place(&e.effect, e.joint)) }
        @if let Some(info) = known {
            p { (info.title) ": " span class="equation" { (info.equation) } ". " (info.source) "." }
            @if let Some(c) = d.ceilings.iter().find(|c| Some(c.joint) == e.joint && c.class == info.class && c.share > 0.0) {
                p {
                    "With nothing else beside it, a cause that is a function of " (c.class.words()) " at this joint removes at most "
                    (format!("{:.0} %", 100.0 * c.share)) " of the gap."
                }
            }
        }
        div.scroll { table {
            thead { tr { th { "parameter" } th.num { "value" } th.num { "standard deviation" } } }
            @for p in &e.parameters {
                tr {
                    @let (value, std) = written(p);
                    td { (words::name(p)) @if !matches!(p.unit.as_str(), "" | "1") { ", " (number::unit(&p.unit)) } }
                    td class="num" { (value) }
                    td class="num" { (std) }
                }
            }
        } }
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

/// A magnitude and its standard deviation.
fn written(p: &Magnitude) -> (String, String) {
    match p.std {
        Some(0.0) => (number::value(p.value), "given".to_owned()),
        Some(std) => number::with_deviation(p.value, std),
        None => (number::value(p.value), "not determined".to_owned()),
    }
}

/// Gap before, after, floor on one scale.
fn gaps(d: &Diagnosis) -> Markup {
    let (before, after) = d.gap_intervals;
    let bar = |label: &str, value: f64, text: String| Bar {
        label: label.to_owned(),
        value,
        text,
    };
    bars(
        "Gap before, after and floor, relative to the motion",
        &[
            bar("before", d.gap_before, with_interval(d.gap_before, before)),
            bar("after", d.gap_after, with_interval(d.gap_after, after)),
            bar("floor", d.gap_floor, short(d.gap_floor)),
        ],
    )
}

/// A value with its interval; without it where the interval has no width: one window has no scatter.
fn with_interval(x: f64, (low, high): (f64, f64)) -> String {
    match number::interval(low, high) {
        Some((low, high)) => format!("{} ({low} to {high})", short(x)),
        None => short(x),
    }
}

fn joints(d: &Diagnosis) -> Markup {
    let figure = |v: Option<f64>| v.map_or_else(|| "not recorded".to_owned(), short);
    let rows: Vec<_> = d
        .gap_joints_before
        .iter()
        .zip(&d.gap_joints)
        .enumerate()
        .collect();
    let part = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{:.0} %", 100.0 * x));
    html! {
        div.scroll { table {
            thead { tr { th { "joint" } th class="num" { "position before" } th class="num" { "share" } th class="num" { "after" } th class="num" { "velocity before" } th class="num" { "share" } th class="num" { "after" } } }
            @for (j, (before, after)) in rows {
                @let share = d.gap_shares.get(j);
                tr {
                    td { (j + 1) }
                    td class="num" { (figure(Some(before.0))) }
                    td class="num" { (part(share.map(|s| s.0))) }
                    td class="num" { (figure(Some(after.0))) }
                    td class="num" { (figure(before.1)) }
                    td class="num" { (part(share.and_then(|s| s.1))) }
                    td class="num" { (figure(after.1)) }
                }
            }
        } }
        p class="quiet" { "Share: part of the squared gap before that this joint and channel have." }
    }
}

/// The refitted candidates. Their probabilities weigh them against each other, which says nothing
/// where none of them is missing.
fn ranking(d: &Diagnosis) -> Markup {
    let weighed = d.outcome() != Outcome::Nothing;
    html! {
        @if !weighed { p { "None of these candidates pays; the first is the best of them." } }
        div.scroll { table {
            thead { tr { th { "effect" } th { "joint" } th.num { "score" } @if weighed { th.num { "probability" } } } }
            @for r in &d.ranking {
                tr {
                    td { (r.effect) }
                    td { (r.joint.map_or_else(String::new, |j| j.to_string())) }
                    td class="num" { (format!("{:.0}", r.score)) }
                    @if weighed { td class="num" { (number::probability(r.probability)) } }
                }
            }
        } }
    }
}
