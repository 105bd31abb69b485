//! The content of the page of a study; layout and plots are those of `pid_page`.

use maud::{Markup, html};
use pid_page::{Axis, Footer, Ink, Page, Plot, figure, table};

use super::score::{Outcome, Share, Summary, right, tier};

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
            ("a law of its own for a cause outside", &self.laws.0),
            ("the same, at most 1.3 floors left", &self.laws.1),
            ("a law of its own for nothing", &self.false_laws),
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

/// The report as a page.
pub fn to_html(s: &Summary, outcomes: &[Outcome]) -> String {
    let figures: Vec<Vec<String>> = s.lines().into_iter().map(|(a, b)| vec![a, b]).collect();
    let said: Vec<Vec<String>> = s
        .confusion
        .iter()
        .flat_map(|(hidden, row)| {
            row.iter()
                .map(move |(said, n)| vec![hidden.to_string(), said.to_string(), n.to_string()])
        })
        .collect();
    let page = Page {
        title: "Withheld-effect study",
        lead: html! { p { (outcomes.len()) " cases; the cause of each was opened after its diagnosis." } },
        sections: &[],
        body: html! {
            section { h2 { "Figures" } (table(&["figure", "value"], &figures)) }
            section {
                h2 { "Stated confidence and share of right verdicts" }
                div.single {
                    (figure(&diagram(s), "", "marks: share of right verdicts, bars: 95 % interval, dashes: as stated"))
                }
            }
            section { h2 { "What was said of what" } (table(&["hidden", "said", "cases"], &said)) }
            section {
                h2 { "Cases" }
                div.scroll { table {
                    thead { tr {
                        th { "case" } th { "hidden" } th { "tier" } th { "said" } th.num { "confidence" }
                        th.num { "gap before" } th.num { "after" } th.num { "floor" }
                    } }
                    tbody { @for o in outcomes { (row(o)) } }
                } }
            }
        },
        footer: Footer {
            program: concat!("pid-studies ", env!("CARGO_PKG_VERSION")),
            data: &format!("{} simulated cases", outcomes.len()),
            settings: "",
            more: "summary.json beside this page holds the same figures",
        },
    };
    page.html()
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
        tr class=[(!right(o)).then_some("wrong")] {
            td { (o.id) }
            td { (if hidden.is_empty() { "none" } else { hidden.as_str() }) }
            td { (tier(o)) }
            td { (said) }
            td.num { (format!("{:.2}", d.confidence)) }
            @for gap in [d.gap_before, d.gap_after, d.gap_floor] { td.num { (format!("{gap:.4}")) } }
        }
    }
}

/// Share of right verdicts against the confidence that was stated.
fn diagram(s: &Summary) -> Markup {
    let mut plot = Plot::new(
        "Share of right verdicts against stated confidence",
        Axis::new("stated confidence", "1", (0.0, 1.0)),
        Axis::new("share of right verdicts", "1", (-0.02, 1.02)),
    );
    plot.straight(Ink::Stated, (0.0, 0.0), (1.0, 1.0));
    for b in &s.reliability {
        let interval = b.right.interval();
        plot.interval(Ink::Series(0), b.stated, (interval.low, interval.high));
    }
    let shares = s.reliability.iter();
    plot.marks(
        Ink::Series(0),
        shares.filter_map(|b| Some((b.stated, b.right.value()?))),
    );
    plot.draw()
}
