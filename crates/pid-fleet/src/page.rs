//! A summary as a page.

use maud::{Markup, html};
use pid_page::number::{plus_minus, short, unit, value};
use pid_page::{Axis, Footer, Ink, Page, Plot, Range, figure, table};

use crate::collect::{Summary, Unit};
use crate::text::suspects;

/// Units of which a plot is drawn.
const DRAWN: usize = 12;
/// Distances that a plot shows at most.
const FARTHEST: f64 = 30.0;

impl Summary {
    /// The page `report.html`; `settings` says what decided the result.
    pub fn to_html(&self, settings: &str) -> String {
        let named: Vec<&Unit> = self.standing_out().collect();
        let mut sections = vec![("units", "Units that stand out"), ("spread", "Spread")];
        if !self.gaps.is_empty() {
            sections.push(("gaps", "Logs that do not count"));
        }
        let page = Page {
            title: &format!("Fleet of {}", self.robot),
            lead: html! { p {
                (self.counted()) " of " (self.logs) " logs of " (self.units.len()) " units count; "
                (named.len()) " units stand out, with at most " (format!("{:.0} %", 100.0 * self.rate)) " false ones among them expected."
            } },
            sections: &sections,
            body: html! {
                section id="units" {
                    h2 { "Units that stand out" }
                    div.full { (figure(&self.distances(), "All units", "the farthest quantity of each, in deviations of a healthy unit")) }
                    (table(&["unit", "differs from the first log on", "changes", "logs"], &self.named(&named)))
                    div.plots { @for u in named.iter().take(DRAWN) { (self.course(u)) } }
                }
                section id="spread" {
                    h2 { "Spread between units" }
                    (table(
                        &["quantity", "unit", "mean", "spread", "from log to log", "nominal", "common drift", "beyond 3", "what it is"],
                        &self.spread(),
                    ))
                    p { "Spread is the standard deviation between units beyond what their logs tell wrongly; of normal units 0.27 % lie beyond three deviations." }
                }
                @if !self.gaps.is_empty() {
                    section id="gaps" {
                        h2 { "Logs that do not count" }
                        (table(&["job", "unit", "log", "what", "why"], &self.lost()))
                    }
                }
            },
            footer: Footer {
                program: &self.program,
                data: &format!(
                    "{}, {} logs of {} units",
                    self.robot,
                    self.logs,
                    self.units.len()
                ),
                settings,
                more: "fleet.json beside this page holds every unit; prior.toml describes the next one",
            },
        };
        page.html()
    }

    fn named(&self, named: &[&Unit]) -> Vec<Vec<String>> {
        let row = |u: &&Unit| {
            let change = u.change.as_ref();
            vec![
                u.name.clone(),
                suspects(&u.suspects),
                change.map_or_else(String::new, |c| self.change_in_words(c)),
                u.logs.to_string(),
            ]
        };
        named.iter().map(row).collect()
    }

    fn spread(&self) -> Vec<Vec<String>> {
        let row = |q: &crate::collect::Over| {
            let drift = q.trend.filter(|_| q.drifts).map_or_else(
                || "none".to_owned(),
                |(slope, own)| {
                    let (slope, own) = (self.yearly(slope), self.yearly(own));
                    format!("{} {}", plus_minus(slope, own), self.per())
                },
            );
            vec![
                q.name.clone(),
                unit(&q.unit),
                value(q.mean),
                short(q.spread),
                short(q.within.hypot(q.of_a_log)),
                value(q.nominal),
                drift,
                format!("{:.2} %", 100.0 * q.far),
                q.formula.clone(),
            ]
        };
        self.quantities.iter().map(row).collect()
    }

    fn lost(&self) -> Vec<Vec<String>> {
        let row = |g: &crate::collect::Gap| {
            vec![
                g.job.to_string(),
                g.unit.clone(),
                g.log.clone(),
                g.what.word().to_owned(),
                g.why.clone(),
            ]
        };
        self.gaps.iter().map(row).collect()
    }

    /// The farthest quantity of every unit.
    fn distances(&self) -> Markup {
        let far = |u: &Unit| {
            let most =
                u.z.iter()
                    .copied()
                    .max_by(|a, b| a.abs().total_cmp(&b.abs()));
            most.unwrap_or(0.0).clamp(-FARTHEST, FARTHEST)
        };
        let points: Vec<(f64, f64, bool)> = (self.units.iter().enumerate())
            .map(|(i, u)| (i as f64, far(u), u.deviates || u.change.is_some()))
            .collect();
        let height = Range::of(points.iter().map(|p| p.1)).span(0.05);
        let mut plot = Plot::new(
            "Farthest quantity of every unit in deviations",
            Axis::new("unit", "number", (0.0, points.len() as f64)),
            Axis::new("distance from the fleet", "deviations", height),
        )
        .wide();
        let of = |named: bool| {
            points
                .iter()
                .filter(move |p| p.2 == named)
                .map(|p| (p.0, p.1))
        };
        plot.cloud(Ink::Measured, of(false));
        plot.marks(Ink::Force, of(true));
        plot.draw()
    }

    /// A unit over time beside the fleet.
    fn course(&self, u: &Unit) -> Markup {
        let Some(over) = u.shown.and_then(|k| self.quantities.get(k)) else {
            return html! {};
        };
        let edges = [over.mean - 2.0 * over.spread, over.mean + 2.0 * over.spread];
        let mut height = Range::of(u.course.iter().flat_map(|(_, y, s)| [y - s, y + s]));
        height.cover(edges);
        let time = Range::of(u.course.iter().map(|c| c.0)).span(0.03);
        let mut plot = Plot::new(
            &format!("{} of {} over time", over.name, u.name),
            Axis::new(
                "time",
                if self.dates {
                    "days since 1970"
                } else {
                    "as given"
                },
                time,
            ),
            Axis::new(&over.name, &unit(&over.unit), height.span(0.05)),
        );
        plot.band(&[(time.0, edges[0], edges[1]), (time.1, edges[0], edges[1])]);
        plot.straight(Ink::Stated, (time.0, over.mean), (time.1, over.mean));
        for (t, y, s) in &u.course {
            plot.interval(Ink::Measured, *t, (y - s, y + s));
        }
        plot.marks(Ink::Measured, u.course.iter().map(|c| (c.0, c.1)));
        if let Some(changed) = &u.change {
            plot.upright(Ink::Force, changed.change.onset);
        }
        figure(
            &plot.draw(),
            &u.name,
            "dots: logs; band: two spreads about the mean of the fleet; upright: onset",
        )
    }
}
