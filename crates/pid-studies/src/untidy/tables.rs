//! The score of many untidy cases: a table over tiers, and a line per case.

use std::fmt::Write as _;

use serde::Serialize;

use super::score::{Effect, Row};
use crate::withheld::Share;
use crate::withheld::score::middle;

/// Least share of an effect that is to be named.
pub(crate) const LEAST: f64 = 0.1;
/// Tiers in the order of the table.
const TIERS: [&str; 4] = [
    "one effect",
    "several",
    "one outside beside",
    "nothing missing",
];

/// Figures of the cases of one tier; a figure without a case is `None`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tier {
    /// Its name.
    pub name: String,
    /// Number of cases.
    pub cases: usize,
    /// Listed effects with a tenth of the gap or more that are named.
    pub recall: Share,
    /// Named effects that are true.
    pub precision: Share,
    /// Share of the named effects in that of all listed ones, mean over the cases.
    pub share_named: Option<f64>,
    /// Error of the share of a rightly named effect, median.
    pub share_error: Option<f64>,
    /// Gap before and after, and floor, medians.
    pub gap: [Option<f64>; 3],
    /// Gap after over the study's own floor, median.
    pub over_own_floor: Option<f64>,
    /// Cases called `none`.
    pub none: Share,
    /// Intervals of 95 % that hold the true value.
    pub coverage: Share,
    /// Intervals of 95 % of shares that hold the true share.
    pub share_coverage: Share,
    /// Time of a diagnosis, s: median and largest.
    pub seconds: Option<(f64, f64)>,
}

/// Scores all rows tier by tier; tiers without a case are left out.
pub fn tiers(rows: &[Row]) -> Vec<Tier> {
    let of = |name: &'static str| {
        let own: Vec<&Row> = rows.iter().filter(|r| r.tier == name).collect();
        (!own.is_empty()).then(|| tier(name, &own))
    };
    TIERS.into_iter().filter_map(of).collect()
}

fn tier(name: &str, rows: &[&Row]) -> Tier {
    let (mut recall, mut precision) = (Share::default(), Share::default());
    let (mut none, mut coverage) = (Share::default(), Share::default());
    let mut share_coverage = Share::default();
    let (mut errors, mut shares) = (Vec::new(), Vec::new());
    for row in rows {
        let listed: Vec<&Effect> = row.hidden.iter().filter(|e| e.listed()).collect();
        let all: f64 = listed.iter().filter_map(|e| e.share).sum();
        let found = listed.iter().filter(|e| e.partner.is_some());
        if all > 0.0 {
            let named: f64 = found.filter_map(|e| e.share).fold(0.0, |a, b| a + b);
            shares.push(named / all);
        }
        for e in listed.iter().filter(|e| e.share >= Some(LEAST)) {
            recall.add(e.partner.is_some());
        }
        for e in &row.named {
            precision.add(e.partner.is_some());
            let true_share = e.partner.and_then(|i| row.hidden[i].share);
            if let (Some(said), Some(is)) = (e.share, true_share) {
                errors.push((said - is).abs());
            }
        }
        none.add(row.verdict == "none");
        coverage.hits += row.coverage.hits;
        coverage.of += row.coverage.of;
        share_coverage.hits += row.share_coverage.hits;
        share_coverage.of += row.share_coverage.of;
    }
    let median = |of: &dyn Fn(&Row) -> f64| {
        middle(rows.iter().map(|row| of(row)).collect()).map(|(median, _)| median)
    };
    Tier {
        name: name.to_owned(),
        cases: rows.len(),
        recall,
        precision,
        share_named: (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64),
        share_error: middle(errors).map(|(median, _)| median),
        gap: [0, 1, 2].map(|i| median(&|row| row.gap[i])),
        over_own_floor: median(&|row| row.gap[1] / row.own[1]),
        none,
        coverage,
        share_coverage,
        seconds: middle(rows.iter().map(|row| row.seconds).collect()),
    }
}

fn figure(x: Option<f64>, digits: usize) -> String {
    x.map_or(String::new(), |x| format!("{x:.digits$}"))
}

fn of(x: &Share) -> String {
    match x.of {
        0 => String::new(),
        of => format!("{} of {of}", x.hits),
    }
}

/// The table as Markdown, then a line per case: what is hidden, what is named, the verdict.
pub fn to_text(rows: &[Row]) -> String {
    let mut text = String::from(
        "| cases | effects of a tenth or more that are named | right among the named | share of the gap named | \
         error of shares | gap before | gap after | floor | after over own floor | `none` | intervals that hold the \
         truth | those of shares | time, s |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for t in tiers(rows) {
        let seconds = t.seconds.map_or(String::new(), |(median, largest)| {
            format!("{median:.0}, at most {largest:.0}")
        });
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {}, {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {seconds} |",
            t.name,
            t.cases,
            of(&t.recall),
            of(&t.precision),
            figure(t.share_named, 2),
            figure(t.share_error, 2),
            figure(t.gap[0], 3),
            figure(t.gap[1], 3),
            figure(t.gap[2], 3),
            figure(t.over_own_floor, 1),
            of(&t.none),
            of(&t.coverage),
            of(&t.share_coverage),
        );
    }
    text.push('\n');
    for row in rows {
        let _ = writeln!(text, "{}", line(row));
    }
    text
}

/// One case: true, named, verdict.
fn line(row: &Row) -> String {
    let words = |effects: &[Effect], lack: &str| {
        let all: Vec<String> = (effects.iter())
            .map(|e| {
                let mark = if e.partner.is_none() && e.listed() {
                    lack
                } else {
                    ""
                };
                format!("{mark}{}", e.words())
            })
            .collect();
        if all.is_empty() {
            "-".to_owned()
        } else {
            all.join(" ")
        }
    };
    let [before, after, floor] = row.gap;
    format!(
        "{} {} joints {} Hz | true {} | named {} | {} | gap {before:.3} {after:.3} floor {floor:.3}, own {:.3} {:.3} | {:.0} s",
        row.id,
        row.joints,
        row.rate,
        words(&row.hidden, "missed "),
        words(&row.named, "wrong "),
        row.verdict,
        row.own[0],
        row.own[1],
        row.seconds,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn effect(effect: &str, share: f64, partner: Option<usize>) -> Effect {
        Effect {
            effect: effect.to_owned(),
            joint: Some(1),
            share: Some(share),
            partner,
        }
    }

    fn row(tier: &str, hidden: Vec<Effect>, named: Vec<Effect>, verdict: &str) -> Row {
        Row {
            id: "u1_0000".to_owned(),
            tier: tier.to_owned(),
            joints: 1,
            rate: 250.0,
            hidden,
            named,
            verdict: verdict.to_owned(),
            gap: [0.08, 0.03, 0.02],
            own: [0.07, 0.015],
            coverage: Share { hits: 1, of: 2 },
            share_coverage: Share { hits: 0, of: 1 },
            seconds: 3.0,
        }
    }

    #[test]
    fn tiers_count_what_is_named_missed_and_wrong() {
        let hidden = vec![
            effect("spring", 0.5, Some(1)),
            effect("stribeck", 0.3, None),
            effect("unknown", 0.2, None),
        ];
        let named = vec![effect("payload", 0.4, None), effect("spring", 0.6, Some(0))];
        let rows = [
            row("one outside beside", hidden, named, "partly unknown"),
            row("nothing missing", Vec::new(), Vec::new(), "none"),
        ];
        let all = tiers(&rows);
        let counts = |share: &Share| (share.hits, share.of);
        assert_eq!(all.len(), 2);
        assert_eq!(counts(&all[0].recall), (1, 2));
        assert_eq!(counts(&all[0].precision), (1, 2));
        assert_eq!(counts(&all[0].coverage), (1, 2));
        assert_eq!(counts(&all[0].share_coverage), (0, 1));
        let near = |x: Option<f64>, y: f64| (x.expect("a figure") - y).abs() < 1e-12;
        assert!(near(all[0].share_named, 0.625) && near(all[0].share_error, 0.1));
        assert!(near(all[0].over_own_floor, 2.0));
        assert_eq!(counts(&all[1].none), (1, 1));
        assert_eq!(all[1].share_named, None);
        let text = to_text(&rows);
        assert!(
            text.contains("missed stribeck:1(0.30) unknown:1(0.20) | named wrong payload:1"),
            "{text}"
        );
    }
}
