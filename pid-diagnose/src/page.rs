//! A diagnosis as one self-contained page.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::diagnose::{Diagnosis, Named};
use crate::effects;

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:56rem;margin:2rem auto;padding:0 1rem;color:#222}\
table{border-collapse:collapse;margin:.6rem 0}td,th{padding:.25rem .8rem .25rem 0;text-align:left;border-bottom:1px solid #ddd}\
td.n{text-align:right;font-variant-numeric:tabular-nums}.verdict{font-size:1.4rem}.equation{font-family:ui-monospace,monospace}";

impl Diagnosis {
    /// The page.
    pub fn to_html(&self) -> String {
        html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width,initial-scale=1";
                    title { "Diagnosis of " (self.case) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    h1 { "Diagnosis of " (self.case) }
                    p class="verdict" { (verdict(self)) }
                    p { "Confidence " (format!("{:.2}", self.confidence)) ". Where it shows: " (self.regime) "." }
                    @if !self.confusion_set.is_empty() {
                        p { "These records do not tell it apart from: " (self.confusion_set.join(", ")) "." }
                    }
                    @for e in &self.effects { (effect(e)) }
                    h2 { "Gap" }
                    p { "Free-run error on records that were not fitted, relative to the motion." }
                    (bars(self))
                    (joints(self))
                    h2 { "Candidates" }
                    (ranking(self))
                    p {
                        "Mean squared innovation " (format!("{:.3}", self.misfit.0)) " without and "
                        (format!("{:.3}", self.misfit.1)) " with the named effects; 1 where the noise is as stated. "
                        (self.refits) " candidates refitted in full, " (format!("{:.1}", self.seconds)) " s."
                    }
                }
            }
        }
        .into_string()
    }
}

fn place(effect: &str, joint: Option<usize>) -> String {
    joint.map_or_else(|| effect.to_owned(), |j| format!("{effect} at joint {j}"))
}

fn verdict(d: &Diagnosis) -> String {
    match d.effect.as_str() {
        "none" => "No effect is missing beyond parameters within their tolerances.".to_owned(),
        "unknown" => "Something is missing, but no effect of the library explains it.".to_owned(),
        _ => d
            .effects
            .iter()
            .map(|e| place(&e.effect, e.joint))
            .collect::<Vec<_>>()
            .join(" and "),
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
            @if let Some(field) = info.simulator_field {
                p { "In a simulator: " (field) "." }
            }
        }
    }
}

/// Three bars on one scale.
fn bars(d: &Diagnosis) -> Markup {
    let rows = [
        ("before", d.gap_before),
        ("after", d.gap_after),
        ("floor", d.gap_floor),
    ];
    let largest = rows.iter().map(|r| r.1).fold(1e-12, f64::max);
    html! {
        svg viewBox="0 0 640 84" width="640" height="84" role="img" aria-label="gap before, after and floor" {
            @for (i, (name, x)) in rows.iter().enumerate() {
                text x="0" y=(i * 28 + 18) font-size="14" { (name) }
                rect x="70" y=(i * 28 + 4) height="18" width=(format!("{:.1}", 440.0 * x / largest)) fill="#4a7ab5" {}
                text x=(format!("{:.1}", 78.0 + 440.0 * x / largest)) y=(i * 28 + 18) font-size="14" { (format!("{x:.4}")) }
            }
        }
    }
}

fn joints(d: &Diagnosis) -> Markup {
    html! {
        table {
            tr { th { "joint" } th { "position, after" } th { "velocity, after" } }
            @for (j, (q, v)) in d.gap_joints.iter().enumerate() {
                tr {
                    td { (j + 1) }
                    td class="n" { (format!("{q:.4}")) }
                    td class="n" { (v.map_or_else(|| "not recorded".to_owned(), |v| format!("{v:.4}"))) }
                }
            }
        }
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
