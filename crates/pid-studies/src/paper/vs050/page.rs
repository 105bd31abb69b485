//! The part of the page about the VS-050.

use std::fmt::Write;

use maud::{Markup, html as markup};
use pid_page::table;

use super::super::page::optional;
use super::super::plot::{curve, joint_chart};
use super::super::study::{FEASIBLE, HESSIANS, Second};
use super::{Arm, Fit, HORIZON, KINDS, MEMORY, records};

/// Name of a kind of fit.
fn label(hessian: Second, both_kinds: bool) -> (String, String) {
    let hessian = HESSIANS.iter().find(|(h, _)| *h == hessian);
    let data = if both_kinds {
        "one record of each kind"
    } else {
        "one record"
    };
    (
        hessian.map_or("", |(_, name)| name).to_owned(),
        data.to_owned(),
    )
}

fn milliradians(v: Option<f64>) -> String {
    v.map_or_else(|| "diverges".to_owned(), |v| format!("{:.2}", 1e3 * v))
}

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    if v.is_empty() {
        return f64::NAN;
    }
    0.5 * (v[(v.len() - 1) / 2] + v[v.len() / 2])
}

const HEAD: [&str; 9] = [
    "Hessian",
    "fitted to",
    "lowest J",
    "within 1 % of it",
    "ended",
    "converged",
    "iterations",
    "seconds",
    "not determined",
];

/// One row for each kind of fit.
fn fits(arm: &Arm) -> Vec<Vec<String>> {
    KINDS
        .iter()
        .map(|&(hessian, both)| {
            let group = arm.group(hessian, both);
            let n = group.len();
            let count = |f: &dyn Fn(&Fit) -> bool| group.iter().filter(|g| f(g)).count();
            // Both Hessians solve the same program, so its lowest J may come from either.
            let same = KINDS.iter().filter(|(_, b)| *b == both);
            let lowest = same
                .filter_map(|&(h, b)| Some(arm.best(h, b)?.objective))
                .fold(f64::INFINITY, f64::min);
            let near = |f: &Fit| f.violation <= FEASIBLE && f.objective <= 1.01 * lowest;
            let (hessian_name, data) = label(hessian, both);
            let best = arm.best(hessian, both);
            vec![
                hessian_name,
                data,
                optional(best.map(|b| b.objective)),
                format!("{} of {n}", count(&near)),
                format!("{} of {n}", count(&|f| !f.limited)),
                format!("{} of {n}", count(&|f| f.converged)),
                format!(
                    "{:.0}",
                    median(group.iter().map(|f| f.iterations as f64).collect())
                ),
                format!("{:.2}", median(group.iter().map(|f| f.seconds).collect())),
                best.map_or_else(
                    || "–".to_owned(),
                    |b| format!("{} of {}", b.undetermined, arm.parameters),
                ),
            ]
        })
        .collect()
}

/// RMS of the joint angles of the best fit of each kind, per record.
fn scores(arm: &Arm) -> Vec<Vec<String>> {
    KINDS
        .iter()
        .flat_map(|&(hessian, both)| {
            let best = arm.best(hessian, both);
            let (hessian, data) = label(hessian, both);
            [("whole record", true), ("restarted", false)].map(|(how, whole)| {
                let mut row = vec![hessian.clone(), data.clone(), how.to_owned()];
                let values = best.map(|b| if whole { &b.whole } else { &b.restarted });
                row.extend((0..arm.records.len()).map(|k| match values {
                    None => "–".to_owned(),
                    Some(values) => milliradians(values.get(k).copied().flatten()),
                }));
                row
            })
        })
        .collect()
}

/// Measured and simulated angles of one record.
fn plots(arm: &Arm, record: usize) -> Vec<Markup> {
    let Some(e) = arm.dataset.experiments.get(record) else {
        return Vec::new();
    };
    // A chart shows every fourth sample.
    let thin = |label: String, q: &[f64], joint: usize| curve(label, &e.t, q, (joint, e.nq), 4);
    (0..e.nq)
        .map(|joint| {
            let mut series = vec![thin("measured".to_owned(), &e.q, joint)];
            for (hessian, both) in KINDS {
                let Some(q) = arm
                    .best(hessian, both)
                    .and_then(|b| b.simulated.get(record))
                    .filter(|q| !q.is_empty())
                else {
                    continue;
                };
                let (hessian, data) = label(hessian, both);
                series.push(thin(format!("simulated: {hessian}; {data}"), q, joint));
            }
            joint_chart(&e.name, joint, &series)
        })
        .collect()
}

/// The row of "paper says, we find": the paper's statement, and the figure found here.
pub(in super::super) fn row(arm: &Arm) -> (String, String) {
    let paper = "fit with the trapezoidal rule; a second record is predicted well, a qualitatively different one is not, perhaps for lack of information in the data";
    let of = |best: Option<&Fit>| {
        best.map_or_else(
            || "no feasible point".to_owned(),
            |b| {
                let each = |values: &[Option<f64>]| {
                    let of =
                        |(name, v): (&String, &Option<f64>)| format!("{name} {}", milliradians(*v));
                    arm.records
                        .iter()
                        .zip(values)
                        .map(of)
                        .collect::<Vec<_>>()
                        .join(", ")
                };
                format!(
                    "{}; restarted every {HORIZON} s: {}",
                    each(&b.whole),
                    each(&b.restarted)
                )
            },
        )
    };
    let found = format!(
        "RMS of the simulated joint angles, mrad. Fitted to `sway`, exact Hessian: {}. BFGS: {}. Fitted to `sway` and `travels_again`, exact: {}",
        of(arm.best(Second::Exact, false)),
        of(arm.best(Second::Bfgs, false)),
        of(arm.best(Second::Exact, true)),
    );
    (paper.to_owned(), found)
}

/// The section of the page.
pub(in super::super) fn html(arm: &Arm) -> Markup {
    let mut head = vec!["Hessian", "fitted to", "simulated"];
    head.extend(arm.records.iter().map(String::as_str));
    markup! {
        h2 { "Figures 6 and 7: the DENSO VS-050 with axes 3 to 6 fixed" }
        p {
            "The arm is simulated with all six axes, friction and noise; axes 1 and 2 follow references under position control, axes 3 to 6 "
            "are held by theirs. The model that is fitted holds them fixed: " (arm.parameters) " parameters, trapezoidal rule, angles and "
            "velocities with equal weights, N = " (records::SAMPLES) ", " (arm.starts) " starts. No measured data of this robot are "
            "public, and its masses are assumed."
        }
        (table(&HEAD, &fits(arm)))
        p { "Shares count starts within 1 % of the lowest J of any Hessian on the same records. BFGS is damped and keeps the last " (MEMORY) " steps." }
        h3 { "RMS of the simulated joint angles, mrad" }
        p {
            "Best fit of each kind, simulated with controlled error under the recorded currents alone: over the whole record, and restarted from "
            "the record every " (HORIZON) " s. `sway` is fitted by all, `travels_again` by those fitted to one record of each kind; the others are unseen."
        }
        (table(&head, &scores(arm)))
        @for (k, name) in arm.records.iter().enumerate() {
            h3 { (name) ": " (arm.dataset.experiments[k].note) }
            @for plot in plots(arm, k) { (plot) }
        }
    }
}

/// The tables as text.
pub(in super::super) fn text(arm: &Arm) -> String {
    let mut out = String::new();
    let mut head = vec!["Hessian", "fitted to", "simulated, mrad"];
    head.extend(arm.records.iter().map(String::as_str));
    for (head, rows) in [(&HEAD[..], fits(arm)), (&head[..], scores(arm))] {
        let _ = writeln!(out, "\nVS-050: {}", head.join("  "));
        for row in rows {
            let _ = writeln!(out, "  {}", row.join("  "));
        }
    }
    out
}
