//! The report of a study as one page.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::Outcome;
use super::score::{Share, Summary, right, tier};

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}\
table{border-collapse:collapse;margin:.6rem 0}td,th{padding:.2rem .8rem .2rem 0;text-align:left;border-bottom:1px solid #ddd}\
.wrong{color:#a22}";

fn share(x: &Share) -> String {
    match x.value() {
        None => "no case".to_owned(),
        Some(v) => {
            let i = x.interval();
            format!(
                "{}/{} ({:.0} %, 95 % interval {:.0} to {:.0} %)",
                x.hits,
                x.of,
                100.0 * v,
                100.0 * i.low,
                100.0 * i.high
            )
        }
    }
}

fn pair(x: Option<(f64, f64)>) -> String {
    x.map_or_else(
        || "no case".to_owned(),
        |(m, l)| format!("median {m:.3}, largest {l:.3}"),
    )
}

impl Summary {
    /// Names and figures, one per line of a table.
    pub fn lines(&self) -> Vec<(String, String)> {
        let mut out: Vec<(String, String)> = self
            .effect
            .iter()
            .map(|(tier, x)| (format!("effect right, {tier}"), share(x)))
            .collect();
        for (name, x) in [
            ("a true effect among the first three", &self.top3),
            ("joint right where the effect is", &self.joint),
            ("both causes named", &self.both),
            ("false alarms", &self.false_alarms),
            ("unknown recognised", &self.abstained),
            ("unknown said of a listed effect", &self.gave_up),
            ("none said of an effect", &self.missed),
            ("95 % intervals that hold the magnitude", &self.coverage),
            ("verdict right, noise stated", &self.noise.0),
            ("verdict right, noise not stated", &self.noise.1),
        ] {
            out.push((name.to_owned(), share(x)));
        }
        for (kind, x) in &self.velocity {
            out.push((format!("verdict right, velocity {kind}"), share(x)));
        }
        out.push(("gap after over floor".to_owned(), pair(self.gap_over_floor)));
        out.push((
            "error of the magnitude".to_owned(),
            pair(self.magnitude_error),
        ));
        out.push(("time of a diagnosis, s".to_owned(), pair(self.seconds)));
        out.push((
            "expected calibration error".to_owned(),
            format!("{:.3}", self.calibration_error),
        ));
        out
    }
}

pub(super) fn page(s: &Summary, outcomes: &[Outcome]) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { "Withheld-effect study" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { "Withheld-effect study" }
                p { (outcomes.len()) " cases; the cause of each was opened after its diagnosis." }
                table { @for (name, x) in s.lines() { tr { td { (name) } td { (x) } } } }
                h2 { "Stated confidence and share of right verdicts" }
                (diagram(s))
                h2 { "What was said of what" }
                table {
                    tr { th { "hidden" } th { "said" } th { "cases" } }
                    @for (hidden, row) in &s.confusion {
                        @for (said, count) in row {
                            tr { td { (hidden) } td { (said) } td { (count) } }
                        }
                    }
                }
                h2 { "Cases" }
                table {
                    tr { th { "case" } th { "hidden" } th { "tier" } th { "said" } th { "confidence" } th { "gap before, after, floor" } }
                    @for o in outcomes { (row(o)) }
                }
            }
        }
    }
    .into_string()
}

fn row(o: &Outcome) -> Markup {
    let hidden = o
        .truth
        .causes
        .iter()
        .map(|c| format!("{} at {}", c.kind.id(), c.joint + 1))
        .collect::<Vec<_>>()
        .join(" + ");
    let d = &o.diagnosis;
    let word = d.verdict.word();
    let said = d
        .verdict
        .joint()
        .map_or_else(|| word.to_owned(), |j| format!("{word} at {j}"));
    html! {
        tr class=(if right(o) { "" } else { "wrong" }) {
            td { (o.id) }
            td { (if hidden.is_empty() { "none" } else { hidden.as_str() }) }
            td { (tier(o)) }
            td { (said) }
            td { (format!("{:.2}", d.confidence)) }
            td { (format!("{:.4}, {:.4}, {:.4}", d.gap_before, d.gap_after, d.gap_floor)) }
        }
    }
}

/// Points of the reliability diagram with the diagonal.
fn diagram(s: &Summary) -> Markup {
    let at = |x: f64| 20.0 + 260.0 * x;
    html! {
        svg viewBox="0 0 300 300" width="300" height="300" role="img" aria-label="reliability diagram" {
            rect x="20" y="20" width="260" height="260" fill="none" stroke="#999" {}
            line x1="20" y1="280" x2="280" y2="20" stroke="#bbb" {}
            @for b in &s.reliability {
                @let i = b.right.interval();
                @let x = format!("{:.1}", at(b.stated));
                line x1=(x) x2=(x) y1=(format!("{:.1}", 300.0 - at(i.low))) y2=(format!("{:.1}", 300.0 - at(i.high))) stroke="#4a7ab5" {}
                circle cx=(x) cy=(format!("{:.1}", 300.0 - at(b.right.value().unwrap_or(0.0)))) r="4" fill="#4a7ab5" {}
            }
        }
    }
}
