//! `simtrue regress`: base parameters by inverse dynamics, and what they are worth.

use std::fmt::Write;

use pid_fit::inertia::pseudo_inertia::SUFFIXES;
use pid_fit::regress::judge::Errors;
use pid_fit::regress::record::Filtering;
use pid_fit::regress::solution::JointWeights;
use pid_fit::regress::{Options, Regression, Row, regress};
use pid_runtime::dynamics::Hessian;
use pid_runtime::extend::Extended;
use serde_json::{Value, json};

use crate::args::regress::{CutoffArg, JointWeightsArg, RegressArgs, RegressMethodArg};
use crate::error::{CliError, make_folder, write};
use crate::progress::Progress;
use crate::with::{self, With};
use crate::{assume, output, parameters, source};

/// Records disagree on a combination whose spread over them exceeds this.
const DISAGREES: f64 = 3.0;

/// Runs the command; the exit code.
pub(crate) fn run(args: &RegressArgs) -> Result<u8, CliError> {
    let progress = Progress::start("reading the data");
    // Here private parameters are unknowns of the regression, not of the model.
    let mut wanted = args.source.clone();
    let private = std::mem::take(&mut wanted.private);
    // Friction with a memory takes states that are computed from the records.
    let terms = std::mem::take(&mut wanted.terms);
    let (remembering, terms): (Vec<With>, Vec<With>) =
        (terms.into_iter()).partition(|t| t.law.as_ref().is_some_and(|l| l.law.has_memory()));
    let remembering = with::laws(&remembering)?;
    wanted.terms = terms;
    if !wanted.velocity_lag.is_empty() {
        return Err(CliError::LagOfRegression);
    }
    let (subject, dataset) = source::load_open(&wanted)?;
    let instruments = match (args.method, &args.source.controller) {
        (RegressMethodArg::LeastSquares, _) => None,
        (_, Some(file)) => Some(source::controllers(file, dataset.nq())?),
        (_, None) => return Err(CliError::NoController),
    };
    let dataset = dataset.keeping(&args.train)?;
    let extended = Extended::new(subject.model(), &remembering)?;
    let model: &dyn Hessian = match remembering.is_empty() {
        true => subject.model(),
        false => &extended,
    };
    let mut start: Vec<f64> = match &args.start {
        Some(file) => parameters::read(file, model.params())?,
        None => model.params().iter().map(|i| i.nominal).collect(),
    };
    let mut options = Options {
        private,
        memories: extended.memories().to_vec(),
        instruments,
        ..options(args, model)?
    };
    if let Some(file) = &args.assume {
        options.assume(assume::read(file, model, &dataset)?, model, &mut start);
    }
    if let Some(loss) = args.loss {
        options.loss = loss;
    }
    progress.step("regression".to_owned());
    let found = regress(model, &dataset, &start, &options)?;
    drop(progress);
    let title = format!("{} regressed on {}", subject.name, dataset.name);
    make_folder(&args.source.out)?;
    let file = args.source.out.join("regression.json");
    let text =
        serde_json::to_string_pretty(&as_json(model, &title, &found)).map_err(CliError::Json)?;
    write(&file, &text)?;
    output::print(&in_words(&title, &found));
    output::print(&format!("\nwritten: {}\n", file.display()));
    Ok(0)
}

/// What the arguments alone ask for.
fn options(args: &RegressArgs, model: &dyn Hessian) -> Result<Options, CliError> {
    let judge = args.judge.iter().map(|file| {
        let values = parameters::read(file, model.params())?;
        Ok((file.display().to_string(), values))
    });
    Ok(Options {
        judge: judge.collect::<Result<_, CliError>>()?,
        payload: args.payload.clone(),
        gains: args.gain_deviation.clone(),
        weights: match args.weights {
            JointWeightsArg::Variance => JointWeights::Variance,
            JointWeightsArg::Common => JointWeights::Common,
        },
        filtering: Filtering {
            cutoff: match args.cutoff {
                Some(CutoffArg::Stated(cutoff)) => Some(cutoff),
                Some(CutoffArg::Auto) | None => None,
            },
            decimate: args.decimate,
        },
        choose_filter: args.cutoff == Some(CutoffArg::Auto),
        hold: args.hold.clone(),
        rest: args.rest,
        shapes: !args.hold_shapes,
        consistent: !args.no_consistent,
        poses: args.poses,
        bootstrap: args.bootstrap,
        seed: args.seed,
        ..Options::default()
    })
}

/// The result for the terminal.
fn in_words(title: &str, found: &Regression) -> String {
    let mut lines = vec![format!(
        "{title}: {} linear parameters, {} combinations determined; {} samples in {} blocks, {:.1} s",
        found.linear,
        found.rows.len(),
        found.samples.0,
        found.samples.1,
        found.seconds
    )];
    lines.extend(filters(found));
    if !found.held.is_empty() {
        lines.push("\nHeld (not linear)".to_owned());
        let held = found.held.iter();
        lines.extend(held.map(|(name, value)| format!("  {name} = {value:.4}")));
    }
    lines.extend(combinations(found));
    lines.extend(payload(found));
    lines.extend(instruments(found));
    lines.extend(residuals(found));
    lines.extend(ranges(found));
    lines.join("\n") + "\n"
}

/// What the filters did, and how they were chosen.
fn filters(found: &Regression) -> Vec<String> {
    let mut lines = vec!["\nFilters".to_owned()];
    lines.extend(found.remarks.iter().map(|r| format!("  {r}")));
    if let Some(choice) = &found.filter_choice {
        let list: Vec<String> = choice
            .candidates
            .iter()
            .map(|c| format!("{:.1} Hz {:.2} %", c.cutoff, 100.0 * c.left_out))
            .collect();
        lines.push(format!(
            "  cut-off chosen by left-out training records, all judged through {:.1} Hz: {}",
            choice.judged_at,
            list.join(", ")
        ));
    }
    lines
}

/// The base parameters, and whether the records agree on them.
fn combinations(found: &Regression) -> Vec<String> {
    let mut lines = vec!["\nCombinations: value, standard deviation (jackknife over blocks), relative; spread over the records in their own deviations".to_owned()];
    lines.extend(found.rows.iter().map(combination));
    if !found.absent.is_empty() {
        lines.push(format!("  without influence: {}", found.absent.join(", ")));
    }
    let judged: Vec<f64> = found.rows.iter().filter_map(|r| r.agreement).collect();
    if !judged.is_empty() {
        let disagree = judged.iter().filter(|a| **a > DISAGREES).count();
        lines.push(format!(
            "  the records, each fitted by itself, agree on {} of {} combinations ({disagree} spread more than {DISAGREES} of their own deviations, marked !)",
            judged.len() - disagree,
            judged.len()
        ));
    }
    lines
}

fn combination(row: &Row) -> String {
    let agreement = row.agreement.map_or(String::new(), |a| {
        format!("  {a:5.1}{}", if a > DISAGREES { " !" } else { "" })
    });
    let interval = row.interval.map_or(String::new(), |(a, b)| {
        format!("  bootstrap {a:.4} … {b:.4}")
    });
    if row.pinned() {
        format!(
            "  {:>12.5} ± {:<10.2e} {:>5.1} %{agreement}{interval}  {}  [{}]",
            row.value,
            row.deviation,
            100.0 * row.deviation / row.value.abs(),
            row.formula,
            row.unit
        )
    } else {
        format!(
            "   not pinned ± {:<10.2e}        {agreement}{interval}  {}  [{}]",
            row.deviation, row.formula, row.unit
        )
    }
}

fn payload(found: &Regression) -> Vec<String> {
    let Some(payload) = &found.payload else {
        return Vec::new();
    };
    let body = |v: &[f64]| {
        format!(
            "{:.3} kg, centre of mass ({:.3}, {:.3}, {:.3}) m",
            v[0],
            v[1] / v[0],
            v[2] / v[0],
            v[3] / v[0]
        )
    };
    let values: Vec<f64> = payload.values.iter().map(|v| v.0).collect();
    let deviation = payload.values[0]
        .1
        .map_or(String::new(), |d| format!(" (mass ± {d:.3} kg)"));
    let mut lines = vec![format!(
        "\nPayload at {}, in the frame of that link: {}{deviation}",
        payload.link,
        body(&values)
    )];
    if let Some(consistent) = &payload.consistent {
        lines.push(format!("  physically consistent: {}", body(consistent)));
    }
    lines
}

fn instruments(found: &Regression) -> Option<String> {
    let (rounds, moves) = found.instruments.as_ref()?;
    let most = moves
        .iter()
        .zip(&found.rows)
        .map(|(m, r)| m.abs() / r.deviation)
        .fold(0.0_f64, f64::max);
    Some(format!(
        "  instrumental variables: {} rounds, {}; the simulated loop misses the positions by {:.2} % of their spread; the farthest value moved {most:.1} deviations from least squares",
        rounds.rounds,
        if rounds.settled {
            "settled"
        } else {
            "not settled"
        },
        100.0 * rounds.distance
    ))
}

/// What is left of the drives' force: by the fit, by given values, by consistent ones.
fn residuals(found: &Regression) -> Vec<String> {
    let mut lines =
        vec!["\nResidual over the drive's force, % per joint; all joints together".to_owned()];
    lines.extend(found.errors.iter().map(error_line));
    if let Some(share) = found.folds {
        lines.push(format!(
            "  {:<24} {:6.2} all (mean over training records or parts left out in turn)",
            "left out",
            100.0 * share
        ));
    }
    for (name, errors) in &found.given {
        lines.push(format!("\nValues of {name}"));
        lines.extend(errors.iter().map(error_line));
    }
    if let Some((consistent, _, errors)) = &found.consistent {
        lines.push(format!(
            "\nPhysically consistent values ({} links in log-Cholesky coordinates, {} iterations, {}): residual sum of squares {:.4} of the unconstrained",
            consistent.links.len(),
            consistent.iterations,
            consistent.status.reason(),
            consistent.squares.1 / consistent.squares.0
        ));
        lines.extend(errors.iter().map(error_line));
    }
    let consistent = found.indefinite.1.map_or(String::new(), |c| {
        format!(", consistent values {:.2} %", 100.0 * c)
    });
    lines.push(format!(
        "\nRandom poses with an indefinite mass matrix: unconstrained values {:.2} %{consistent}",
        100.0 * found.indefinite.0
    ));
    lines
}

/// The range of the training records, and test records that leave it.
fn ranges(found: &Regression) -> Vec<String> {
    let mut lines = vec!["\nRange of the training records".to_owned()];
    for range in &found.ranges {
        let part = |k: usize| {
            format!(
                "{:.3} … {:.3} {}",
                range.bounds[k].0, range.bounds[k].1, range.units[k]
            )
        };
        lines.push(format!(
            "  {:<16} {}; {}; {}",
            range.joint,
            part(0),
            part(1),
            part(2)
        ));
    }
    lines.extend(found.excess.iter().map(|e| {
        format!(
            "  warning: {} leaves it at joint {}: {} {:.3} … {:.3} {} against {:.3} … {:.3}, {:.1} % of the samples outside",
            e.record,
            e.joint,
            e.quantity,
            e.reached.0,
            e.reached.1,
            e.unit,
            e.range.0,
            e.range.1,
            100.0 * e.share
        )
    }));
    lines
}

fn error_line(e: &Errors) -> String {
    let mut s = format!("  {:<24}", e.records);
    for relative in &e.relative {
        match relative {
            Some(r) => write!(s, " {:6.2}", 100.0 * r),
            None => write!(s, "      -"),
        }
        .expect("invariant: writing to a string succeeds");
    }
    if let Some(all) = e.overall {
        s.push_str(&format!("   all {:6.2}", 100.0 * all));
    }
    s
}

/// The result for programs.
fn as_json(model: &dyn Hessian, title: &str, found: &Regression) -> Value {
    let errors = |list: &[Errors]| -> Value {
        list.iter()
            .map(|e| json!({ "records": e.records, "rms": e.rms, "relative": e.relative, "overall": e.overall }))
            .collect()
    };
    let named = |p: &[f64]| -> Value {
        model
            .params()
            .iter()
            .zip(p)
            .map(|(i, value)| json!({ "name": i.name, "unit": i.unit, "value": value }))
            .collect()
    };
    let rows: Value = found
        .rows
        .iter()
        .map(|r| {
            json!({
                "combination": r.formula, "single": r.single, "unit": r.unit, "value": r.value, "deviation": r.deviation,
                "deviation_white": r.white, "bootstrap_95": r.interval, "spread_over_records": r.agreement, "pinned": r.pinned(),
            })
        })
        .collect();
    json!({
        "schema_version": 1,
        "program": format!("simtrue {}", env!("CARGO_PKG_VERSION")),
        "title": title,
        "seconds": found.seconds,
        "samples": found.samples.0,
        "blocks": found.samples.1,
        "filters": found.remarks,
        "held": found.held.iter().map(|(name, value)| json!({ "name": name, "value": value })).collect::<Value>(),
        "combinations": rows,
        "without_influence": found.absent,
        "filter_choice": found.filter_choice.as_ref().map(|c| json!({
            "judged_at": c.judged_at,
            "candidates": c.candidates.iter().map(|c| json!({ "cutoff": c.cutoff, "left_out": c.left_out })).collect::<Value>(),
        })),
        "instrumental_variables": found.instruments.as_ref().map(|(r, moves)| json!({
            "rounds": r.rounds, "settled": r.settled, "distance": r.distance, "moved_from_least_squares": moves,
        })),
        "payload": found.payload.as_ref().map(|p| json!({
            "link": p.link, "parameters": SUFFIXES,
            "values": p.values.iter().map(|v| v.0).collect::<Vec<_>>(),
            "deviations": p.values.iter().map(|v| v.1).collect::<Vec<_>>(),
            "consistent": p.consistent,
        })),
        "nearest_to_start": named(&found.parameters),
        "residuals": errors(&found.errors),
        "given": found.given.iter().map(|(name, e)| json!({ "file": name, "residuals": errors(e) })).collect::<Value>(),
        "left_out": found.folds,
        "consistent": found.consistent.as_ref().map(|(c, p, e)| json!({
            "links": c.links, "status": c.status.reason(), "parameters": named(p), "residuals": errors(e),
            "squares_over_unconstrained": c.squares.1 / c.squares.0,
        })),
        "indefinite_poses": { "unconstrained": found.indefinite.0, "consistent": found.indefinite.1 },
        "ranges": found.ranges.iter().map(|r| json!({ "joint": r.joint, "position": r.bounds[0], "velocity": r.bounds[1], "input": r.bounds[2] })).collect::<Value>(),
        "outside_of_range": found.excess.iter().map(|e| json!({
            "record": e.record, "joint": e.joint, "quantity": e.quantity, "reached": e.reached, "range": e.range, "share": e.share,
        })).collect::<Value>(),
    })
}
