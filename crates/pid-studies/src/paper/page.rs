//! The content of the study's page, and the study as text. Layout and plots are those of `pid_page`.

use std::fmt::Write;

use maud::{Markup, html};
use pid_data::Role;
use pid_fit::transcribe::Scheme;
use pid_models::{TwoLink, two_link};
use pid_page::{Footer, Page, table};
use pid_runtime::dynamics::Dynamics;

use super::plot::{Axes, Series, chart, curve, joint_chart};
use super::robot;
use super::study::{HESSIANS, MEMORY, Outcome, Second};
use super::{Findings, Size, vs050};

/// Runs of one kind.
#[derive(Default)]
pub(super) struct Group<'a> {
    runs: Vec<&'a Outcome>,
}

impl<'a> Group<'a> {
    fn of(findings: &'a Findings, wanted: impl Fn(&Outcome) -> bool) -> Self {
        Self {
            runs: findings.outcomes.iter().filter(|o| wanted(o)).collect(),
        }
    }

    fn shooting(findings: &'a Findings, nodes: usize, hessian: Second, lift: bool) -> Self {
        Self::of(findings, |o| {
            o.job.nodes == Some(nodes) && o.job.hessian == hessian && o.job.lift == lift
        })
    }

    fn full(findings: &'a Findings, scheme: Scheme, substeps: usize, hessian: Second) -> Self {
        Self::of(findings, |o| {
            let job = &o.job;
            job.nodes.is_none()
                && (job.scheme, job.substeps, job.hessian) == (scheme, substeps, hessian)
        })
    }

    fn objectives(&self) -> Vec<f64> {
        let mut j: Vec<f64> = self
            .runs
            .iter()
            .map(|o| o.objective.unwrap_or(f64::INFINITY))
            .collect();
        j.sort_by(f64::total_cmp);
        j
    }

    fn best(&self) -> Option<&'a Outcome> {
        let with = self.runs.iter().filter(|o| o.objective.is_some());
        let key = |o: &&&Outcome| o.objective.unwrap_or(f64::INFINITY);
        with.min_by(|a, b| key(a).total_cmp(&key(b))).copied()
    }

    fn within(&self, best: f64, share: f64) -> usize {
        let near = |j: &&f64| **j <= (1.0 + share) * best;
        self.objectives().iter().filter(near).count()
    }

    fn median(&self, of: impl Fn(&Outcome) -> f64) -> f64 {
        let mut v: Vec<f64> = self.runs.iter().map(|o| of(o)).collect();
        v.sort_by(f64::total_cmp);
        if v.is_empty() {
            return f64::NAN;
        }
        0.5 * (v[(v.len() - 1) / 2] + v[v.len() / 2])
    }

    fn count(&self, of: impl Fn(&Outcome) -> bool) -> usize {
        self.runs.iter().filter(|o| of(o)).count()
    }

    /// min, median, max of J; within 1 %, within 15 %, ended before a limit, converged; iterations, seconds.
    fn row(&self, best: f64) -> Vec<String> {
        let j = self.objectives();
        let n = self.runs.len();
        let at = |k: usize| j.get(k).copied().unwrap_or(f64::NAN);
        let median = 0.5 * (at(n.saturating_sub(1) / 2) + at(n / 2));
        vec![
            number(at(0)),
            number(median),
            number(at(n.saturating_sub(1))),
            format!("{} of {n}", self.within(best, 0.01)),
            format!("{} of {n}", self.within(best, 0.15)),
            format!("{} of {n}", self.count(|o| !o.limited)),
            format!("{} of {n}", self.count(|o| o.converged)),
            format!("{:.0}", self.median(|o| o.iterations as f64)),
            format!("{:.2}", self.median(|o| o.seconds)),
        ]
    }
}

const ROW: [&str; 9] = [
    "min J",
    "median J",
    "max J",
    "within 1 %",
    "within 15 %",
    "ended",
    "converged",
    "iterations",
    "seconds",
];

/// Four significant digits; ∞ for runs without a feasible point.
fn number(v: f64) -> String {
    if v.is_infinite() {
        "∞".to_owned()
    } else if v.is_nan() {
        "–".to_owned()
    } else if v == 0.0 || (1e-3..1e5).contains(&v.abs()) {
        format!("{v:.4}")
    } else {
        format!("{v:.3e}")
    }
}

pub(super) fn optional(v: Option<f64>) -> String {
    v.map_or_else(|| "–".to_owned(), number)
}

/// The lowest J of the paper's problem (explicit Euler, one step per sample) found by any run.
fn best_euler(f: &Findings) -> f64 {
    let euler = Group::of(f, |o| {
        (o.job.scheme, o.job.substeps) == (Scheme::ExplicitEuler, 1)
    });
    euler.objectives().first().copied().unwrap_or(f64::INFINITY)
}

/// How many starts come close to the best J, by the number of nodes, in words.
fn good_starts(f: &Findings, best: f64, full: &Group<'_>) -> String {
    let share = |g: &Group<'_>| format!("{} of {}", g.within(best, 0.01), g.runs.len());
    let few: Vec<String> = f
        .plan
        .nodes
        .iter()
        .map(|&m| {
            format!(
                "{m}: {}",
                share(&Group::shooting(f, m, Second::Exact, false))
            )
        })
        .collect();
    format!(
        "starts within 1 % of the best J by number of nodes, exact Hessian: {}; full discretization: {}",
        few.join(", "),
        share(full)
    )
}

/// How numbers of non-zeros and relative densities change with the number of nodes, in words.
fn growth(sizes: &[Size]) -> (String, String) {
    let shooting: Vec<&Size> = sizes.iter().filter(|s| s.nodes.is_some()).collect();
    let total = |s: &Size| s.nnz.iter().sum::<usize>();
    let grows = shooting.windows(2).all(|w| total(w[0]) < total(w[1]));
    let density = |s: &Size| s.densities().map(|d| d.unwrap_or(f64::INFINITY));
    let falls = shooting.windows(2).all(|w| {
        let (a, b) = (density(w[0]), density(w[1]));
        b[1] < a[1] && b[2] < a[2]
    });
    let non_zeros = format!(
        "{} over the numbers of nodes counted; {}",
        if grows {
            "increasing"
        } else {
            "not increasing everywhere"
        },
        shooting
            .iter()
            .map(|s| format!("M = {}: {}", s.nodes.unwrap_or(0), total(s)))
            .collect::<Vec<_>>()
            .join(", ")
    );
    let densities = if falls {
        "the same".to_owned()
    } else {
        "not falling everywhere; see the table".to_owned()
    };
    (non_zeros, densities)
}

/// Rows of "paper says / we find".
fn comparison(f: &Findings) -> Vec<Vec<String>> {
    let best = best_euler(f);
    let full = Group::full(f, Scheme::ExplicitEuler, 1, Second::Exact);
    let five = Group::shooting(f, 5, Second::Exact, false);
    let size = |nodes| f.sizes.iter().find(|s| s.nodes == nodes);
    let mut rows = Vec::new();
    let mut row = |what: &str, paper: &str, found: String| {
        rows.push(vec![what.to_owned(), paper.to_owned(), found]);
    };
    if let (Some(single), Some(all)) = (size(Some(1)), size(None)) {
        row(
            "Table I, n",
            "nx + np, nx M + np, nx N + np",
            format!(
                "the same: {} for single shooting, {} for full discretization",
                single.n, all.n
            ),
        );
        row(
            "Table I, m",
            "0, nx M, nx N",
            format!(
                "0, nx (M − 1), nx (N − 1), which is what equations (4) and (5) give with a free initial state: {} and {}",
                single.m, all.m
            ),
        );
    }
    row(
        "Figure 2, J",
        "5.016 for five nodes, 6.5e-2 for full discretization",
        format!(
            "median over {} starts: {} for five nodes, {} for full discretization; best of any run {}",
            f.plan.starts,
            number(five.median(|o| o.objective.unwrap_or(f64::INFINITY))),
            number(full.median(|o| o.objective.unwrap_or(f64::INFINITY))),
            number(best)
        ),
    );
    row(
        "Figure 3",
        "more nodes make good optima more likely; single shooting and few nodes end in bad ones",
        good_starts(f, best, &full),
    );
    let (non_zeros, densities) = growth(&f.sizes);
    row(
        "Number of non-zeros against M",
        "strictly increasing",
        non_zeros,
    );
    row(
        "Figure 4, relative densities",
        "fall with M, most at few nodes",
        densities,
    );
    if let Some(o) = full.best() {
        row(
            "Redundancy",
            "different sets of parameters lead to very similar motions",
            format!(
                "{} of {} directions in parameter space are not determined by the record at the best point",
                o.undetermined,
                TwoLink.dims().np
            ),
        );
    }
    let (paper, found) = vs050::row(&f.arm);
    row("Figures 6 and 7, DENSO VS-050", &paper, found);
    rows
}

fn table_two(f: &Findings) -> (Vec<String>, Vec<Vec<String>>) {
    let truth = two_link::identifiable(&robot::truth());
    let mut head = vec![
        "combination, over κ3 of joint 2".to_owned(),
        "true".to_owned(),
    ];
    let mut columns = Vec::new();
    let mut shown = vec![(Scheme::ExplicitEuler, 1)];
    shown.extend(f.plan.schemes.iter().copied());
    for (scheme, substeps) in shown {
        if let Some(best) = Group::full(f, scheme, substeps, Second::Exact).best() {
            head.push(name(scheme, substeps));
            columns.push(two_link::identifiable(&best.parameters));
        }
    }
    let rows = truth
        .iter()
        .enumerate()
        .map(|(k, (name, value))| {
            let mut row = vec![(*name).to_owned(), number(*value)];
            row.extend(columns.iter().map(|c| number(c[k].1)));
            row
        })
        .collect();
    (head, rows)
}

fn name(scheme: Scheme, substeps: usize) -> String {
    if substeps == 1 {
        scheme.label()
    } else {
        format!("{}, {substeps} steps a sample", scheme.label())
    }
}

/// Scheme, step, J of the fit, J of accurate simulations on every record.
fn schemes(f: &Findings) -> Vec<Vec<String>> {
    let mut shown = vec![(Scheme::ExplicitEuler, 1)];
    shown.extend(f.plan.schemes.iter().copied());
    shown
        .into_iter()
        .map(|(scheme, substeps)| {
            let group = Group::full(f, scheme, substeps, Second::Exact);
            let mut row = vec![name(scheme, substeps), scheme.order().to_string()];
            match group.best() {
                None => row.extend(std::iter::repeat_n("–".to_owned(), 6)),
                Some(best) => {
                    let j = best.objective.unwrap_or(f64::INFINITY);
                    row.push(number(j));
                    row.push(format!("{} of {}", group.within(j, 0.01), group.runs.len()));
                    row.push(format!("{:.0}", group.median(|o| o.iterations as f64)));
                    let accurate = |k: usize| best.accurate.get(k).copied().flatten();
                    row.extend((0..3).map(|k| optional(accurate(k))));
                }
            }
            row
        })
        .collect()
}

/// Objective, share of starts, and errors of accurate simulations on unseen records, of every
/// optimum of one scheme.
fn optima(f: &Findings, scheme: Scheme) -> Vec<Vec<String>> {
    let group = Group::full(f, scheme, 1, Second::Exact);
    let mut found: Vec<(f64, Vec<&Outcome>)> = Vec::new();
    let mut runs: Vec<&Outcome> = group
        .runs
        .iter()
        .filter(|o| o.objective.is_some())
        .copied()
        .collect();
    let j = |o: &Outcome| o.objective.unwrap_or(f64::INFINITY);
    runs.sort_by(|a, b| j(a).total_cmp(&j(b)));
    for run in runs {
        match found.last_mut() {
            Some((value, list)) if j(run) <= *value * (1.0 + 1e-3) => list.push(run),
            _ => found.push((j(run), vec![run])),
        }
    }
    found
        .into_iter()
        .map(|(value, list)| {
            let accurate = |k: usize| list[0].accurate.get(k).copied().flatten();
            let share = 100.0 * list.len() as f64 / group.runs.len() as f64;
            let mut row = vec![number(value), format!("{share:.0} %")];
            row.extend((0..3).map(|k| optional(accurate(k))));
            row
        })
        .collect()
}

fn figure_two(f: &Findings) -> Vec<Markup> {
    let Some(record) = f.dataset.with_role(Role::Train).next() else {
        return Vec::new();
    };
    let five = Group::shooting(f, 5, Second::Exact, false);
    let full = Group::full(f, Scheme::ExplicitEuler, 1, Second::Exact);
    (0..2)
        .map(|joint| {
            let motion = |label: &str, o: Option<&&Outcome>| {
                let states = o.map_or(&[][..], |o| &o.motion);
                curve(label, &record.t, states, (joint, 4), 1)
            };
            let series = [
                curve("data", &record.t, &record.q, (joint, 2), 1),
                motion("five nodes", five.runs.first()),
                motion("full discretization", full.runs.first()),
            ];
            joint_chart("record `train`", joint, &series)
        })
        .collect()
}

fn figure_three(f: &Findings) -> Markup {
    let kinds = HESSIANS
        .iter()
        .map(|&(hessian, name)| (hessian, false, name.to_owned()))
        .chain([(Second::Exact, true, "exact, lifted start".to_owned())]);
    let mut series: Vec<Series> = kinds
        .map(|(hessian, lift, label)| Series {
            label,
            line: false,
            points: f
                .outcomes
                .iter()
                .filter(|o| (o.job.hessian, o.job.lift) == (hessian, lift))
                .filter_map(|o| Some((o.job.nodes? as f64, o.objective?)))
                .collect(),
        })
        .collect();
    let full = Group::full(f, Scheme::ExplicitEuler, 1, Second::Exact);
    series.push(Series {
        label: "full discretization".to_owned(),
        line: false,
        points: full
            .runs
            .iter()
            .filter_map(|o| Some((robot::SAMPLES as f64, o.objective?)))
            .collect(),
    });
    let axes = Axes {
        title: "Objective against the number of nodes",
        x: ("nodes M", "count"),
        y: ("objective J", "1"),
        log: true,
    };
    chart(&axes, &series)
}

fn figure_four(f: &Findings) -> Markup {
    let of = |k: usize, label: &str| Series {
        label: label.to_owned(),
        line: true,
        points: f
            .sizes
            .iter()
            .filter_map(|s| Some((s.nodes.unwrap_or(robot::SAMPLES) as f64, s.densities()[k]?)))
            .collect(),
    };
    let axes = Axes {
        title: "Relative densities of the derivatives against the number of nodes",
        x: ("nodes M (the last point: full discretization)", "count"),
        y: ("relative density", "1"),
        log: true,
    };
    chart(&axes, &[of(0, "Dr"), of(1, "Dg"), of(2, "DH")])
}

fn sizes(f: &Findings) -> Vec<Vec<String>> {
    f.sizes
        .iter()
        .map(|s| {
            let who = match s.nodes {
                None => "full discretization".to_owned(),
                Some(1) => "single shooting".to_owned(),
                Some(m) => format!("M = {m}"),
            };
            let mut row = vec![who, s.n.to_string(), s.m.to_string()];
            row.extend(s.nnz.iter().map(ToString::to_string));
            row.extend(s.densities().map(optional));
            row
        })
        .collect()
}

/// One row per transcription and Hessian.
fn hessians(f: &Findings) -> Vec<Vec<String>> {
    let best = best_euler(f);
    let mut rows = Vec::new();
    let mut row = |who: String, hessian: &str, group: Group<'_>| {
        let mut cells = vec![who, hessian.to_owned()];
        cells.extend(group.row(best));
        rows.push(cells);
    };
    for &nodes in &f.plan.nodes {
        let who = format!("M = {nodes}");
        for (hessian, name) in HESSIANS {
            row(who.clone(), name, Group::shooting(f, nodes, hessian, false));
        }
        let lifted = Group::shooting(f, nodes, Second::Exact, true);
        row(who, "exact, lifted start", lifted);
    }
    for (hessian, name) in HESSIANS {
        let full = Group::full(f, Scheme::ExplicitEuler, 1, hessian);
        row("full discretization".to_owned(), name, full);
    }
    rows
}

/// The page.
pub(super) fn html(f: &Findings) -> String {
    let (head, rows) = table_two(f);
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let mut side = vec!["transcription", "Hessian"];
    side.extend(ROW);
    let records = ["train", "fast", "steps"].map(|r| format!("accurate J, {r}"));
    let records: Vec<&str> = records.iter().map(String::as_str).collect();
    let scheme_head = [
        &[
            "scheme",
            "order",
            "J of the fit",
            "starts within 1 % of it",
            "iterations",
        ],
        &records[..],
    ]
    .concat();
    let optima_head = [&["J of the fit", "share of starts"], &records[..]].concat();
    let plan = &f.plan;
    let page = Page {
        title: "The paper's study on the idealised two-link robot",
        lead: html! {
            p {
                "K. Schäfer, M. Runge, K. Flaßkamp, C. Büskens, "
                em { "Parameter Identification for Dynamical Systems Using Optimal Control Techniques" }
                ". Records simulated with the values of Table II, N = " (robot::SAMPLES) ", explicit Euler unless said otherwise; "
                (plan.starts) " starts, at most " (plan.max_iterations) " iterations and " (plan.limit) " s for each solve; what did not end before is counted as such and keeps its best point. Made by "
                code { (f.command) } " in " (format!("{:.0}", f.seconds)) " s."
            }
            @if f.interrupted { p { strong { "Interrupted: runs that were not finished are missing." } } }
        },
        sections: &[],
        body: html! {
            section { h2 { "Paper says, we find" } (table(&["", "paper", "here"], &comparison(f))) }
            section {
                h2 { "Table I and figure 4: sizes and densities" }
                (table(&["transcription", "n", "m", "nnz Dr", "nnz Dg", "nnz DH", "rd Dr", "rd Dg", "rd DH"], &sizes(f)))
                (figure_four(f))
            }
            section {
                h2 { "Table II: what the record determines" }
                p { "The 19 parameters are redundant; motions under known currents fix these combinations. Best run of full discretization for each scheme." }
                (table(&head, &rows))
            }
            section {
                h2 { "Figure 2: data and trajectories" }
                p { "First start, exact Hessian." }
                @for plot in figure_two(f) { (plot) }
            }
            section {
                h2 { "Figure 3: objective against the number of nodes" }
                p { "Every run that is feasible to 1e-6. A lifted start is the solution of the same problem with a node at every sample." }
                (figure_three(f))
            }
            section {
                h2 { "Hessians side by side" }
                p { "Shares count starts within 1 % and 15 % of the lowest J of any run, " (number(best_euler(f))) ". ∞: not feasible, or the motion could not be integrated. BFGS is damped and keeps the last " (MEMORY) " steps." }
                (table(&side, &hessians(f)))
            }
            section {
                h2 { "Open question: order and step of the scheme" }
                p { "A scheme's own error goes into the parameters: the last columns are J of an accurate simulation with them." }
                (table(&scheme_head, &schemes(f)))
            }
            section {
                h2 { "Open question: local optima, and which data separate them" }
                p { "Full discretization, exact Hessian; an optimum is a value of J within 0.1 %. Records on which the accurate J of two optima differs separate them." }
                @for scheme in [Scheme::ExplicitEuler, Scheme::Trapezoidal] {
                    h3 { (scheme.label()) }
                    (table(&optima_head, &optima(f, scheme)))
                }
            }
            section { (vs050::html(&f.arm)) }
        },
        footer: Footer {
            program: &f.program,
            data: "simulated: the two-link robot with the values of Table II, the VS-050 with assumed masses",
            settings: &f.command,
            more: "paper.json beside this page holds every run",
        },
    };
    page.html()
}

/// The comparison and the table of Hessians as text.
pub(super) fn text(f: &Findings) -> String {
    let mut out = String::new();
    for row in comparison(f) {
        let _ = writeln!(out, "{}\n  paper: {}\n  here:  {}", row[0], row[1], row[2]);
    }
    let _ = writeln!(
        out,
        "\n{:22} {:20} {}",
        "transcription",
        "Hessian",
        ROW.join("  ")
    );
    for row in hessians(f) {
        let _ = writeln!(out, "{:22} {:20} {}", row[0], row[1], row[2..].join("  "));
    }
    out.push_str(&vs050::text(&f.arm));
    out
}

#[cfg(test)]
mod tests;
