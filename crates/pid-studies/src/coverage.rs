//! `pid-studies coverage`: whether the 95 % intervals hold the truth, by simulation.

use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;

use crate::intervals::{Coverage, Study, coverage};
use clap::Args;
use pid_fit::ident::{Likelihood, Settings};
use pid_fit::synthetic::Recipe;
use pid_fit::transcribe::{Loss, Scheme};
use pid_interpret::Model;
use pid_interpret::nominal::{Nominal, Ranges};
use pid_runtime::dynamics::Hessian;
use serde_json::json;

use crate::{Failure, make_folder, write};
use pid_cli::output;
use pid_cli::progress::{Interrupt, Progress};

/// Arguments of `pid-studies coverage`.
#[derive(Debug, Clone, Args)]
pub struct CoverageArgs {
    /// Model, as `simtrue models` lists them.
    #[arg(required_unless_present = "nominal")]
    pub(crate) model: Option<String>,
    /// Robot from a nominal description (docs/nominal-format.md) instead; parameters range as physics allows.
    #[arg(long, value_name = "FILE", conflicts_with = "model")]
    pub(crate) nominal: Option<PathBuf>,
    /// RMS value of each input, in its unit, separated by commas.
    #[arg(long, value_name = "A1,A2,…", value_delimiter = ',', required = true)]
    pub(crate) amplitude: Vec<f64>,
    /// Positions at the start, rad or m; zero if absent.
    #[arg(
        long,
        value_name = "Q1,Q2,…",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    pub(crate) position: Vec<f64>,
    /// Standard deviation of the noise of positions and of velocities.
    #[arg(
        long,
        value_name = "Q,V",
        value_delimiter = ',',
        default_value = "1e-3,1e-2",
        num_args = 1
    )]
    pub(crate) noise: Vec<f64>,
    /// Number of data sets.
    #[arg(long, default_value_t = 200, value_name = "N")]
    pub(crate) sets: usize,
    /// Records per data set.
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub(crate) records: usize,
    /// Length of a record, s.
    #[arg(long, default_value_t = 5.0, value_name = "S")]
    pub(crate) seconds: f64,
    /// Sampling interval, s.
    #[arg(long, default_value_t = 0.02, value_name = "S")]
    pub(crate) step: f64,
    /// Highest frequency of the inputs, Hz.
    #[arg(long, default_value_t = 2.0, value_name = "HZ")]
    pub(crate) highest: f64,
    /// Share of outliers among the readings, thirty times as large as the noise.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    pub(crate) outliers: f64,
    /// Loss of the fits: square, huber=THRESHOLD, student-t=FREEDOM.
    #[arg(long, default_value = "square", value_parser = pid_cli::loss)]
    pub(crate) loss: Loss,
    /// Parameter that is held at the truth; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) hold: Vec<String>,
    /// Parameter whose intervals by profile likelihood are counted too, at one more fit per set;
    /// may be repeated.
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Vec<String>,
    /// One-step scheme.
    #[arg(long, default_value = "gauss-legendre-2", value_name = "SCHEME")]
    pub(crate) scheme: Scheme,
    /// Intervals of the sandwich form.
    #[arg(long)]
    pub(crate) sandwich: bool,
    /// Seed of inputs and noise.
    #[arg(long, default_value_t = 0, value_name = "S")]
    pub(crate) seed: u64,
    /// Folder for coverage.json; made if needed.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-coverage")]
    pub(crate) out: PathBuf,
}

/// How the records of a robot of `nq` joints are made.
fn recipe(args: &CoverageArgs, nq: usize) -> Result<Recipe, Failure> {
    let per_joint = |option: &str, list: &[f64]| match list.len() == nq {
        true => Ok(list.to_vec()),
        false => Err(Failure::from(format!(
            "{option} has {} values; {nq} are needed",
            list.len()
        ))),
    };
    let [q, v] = args.noise.as_slice() else {
        return Err(format!("--noise has {} values; 2 are needed", args.noise.len()).into());
    };
    Ok(Recipe {
        records: args.records,
        seconds: args.seconds,
        step: args.step,
        amplitude: per_joint("--amplitude", &args.amplitude)?,
        highest: args.highest,
        start: match args.position.is_empty() {
            true => vec![0.0; nq],
            false => per_joint("--position", &args.position)?,
        },
        noise: [vec![*q; nq], vec![*v; nq]].concat(),
        outliers: (args.outliers, 30.0),
    })
}

/// Runs the command; the exit code.
///
/// # Errors
/// What stops it.
pub fn run(args: &CoverageArgs) -> Result<u8, Failure> {
    let interpreted = match &args.nominal {
        Some(file) => Some(Model::new(
            &Nominal::read(file)?.robot_with(Ranges::Physical),
        )?),
        None => None,
    };
    let model: &dyn Hessian = match &interpreted {
        Some(model) => model,
        None => pid_models::by_name(args.model.as_deref().unwrap_or_default())?,
    };
    let recipe = recipe(args, model.dims().nq)?;
    let positions = |option: &'static str, names: &[String]| -> Result<Vec<usize>, Failure> {
        names
            .iter()
            .map(|name| {
                let position = model.params().iter().position(|p| p.name == *name);
                position
                    .ok_or_else(|| format!("{option}: the model has no parameter `{name}`").into())
            })
            .collect()
    };
    let study = Study {
        sets: args.sets,
        seed: args.seed,
        profiled: positions("--profile", &args.profile)?,
    };
    let settings = Settings {
        scheme: args.scheme,
        likelihood: Some(Likelihood {
            loss: args.loss,
            ..Likelihood::default()
        }),
        sandwich: args.sandwich,
        hold: positions("--hold", &args.hold)?,
        ..Settings::default()
    };
    let truth: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let interrupt = Interrupt::listen();
    let progress = Progress::start("the first set");
    let news = |done: usize| {
        progress.step(format!("{done} of {} sets", args.sets));
        progress.done(done as f64 / args.sets as f64);
        match interrupt.requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    let found = coverage(model, &truth, &recipe, &settings, &study, &news)?;
    drop(progress);
    make_folder(&args.out)?;
    let file = args.out.join("coverage.json");
    let text = serde_json::to_string_pretty(&as_json(model, &found))?;
    write(&file, &text)?;
    output::print(&in_words(model, &found));
    output::print(&format!("\nwritten: {}\n", file.display()));
    Ok(if found.interrupted { 130 } else { 0 })
}

fn in_words(model: &dyn Hessian, found: &Coverage) -> String {
    let name = |j: usize| model.params()[j].name.as_ref();
    let mut s = format!(
        "{}: {} data sets identified, {} not converged and left out\n",
        model.name(),
        found.sets.0,
        found.sets.1
    );
    let held: Vec<&str> = found.held.iter().map(|&j| name(j)).collect();
    if !held.is_empty() {
        let _ = writeln!(s, "held at the truth: {}", held.join(", "));
    }
    s.push_str("\n  parameter               95 % intervals that hold the truth   bias / scatter   stated / scatter\n");
    for row in &found.rows {
        let _ = writeln!(
            s,
            "  {:<24} {:6.1} % of {:<4}                        {:+8.2}         {:8.2}",
            name(row.parameter),
            100.0 * row.share,
            row.sets,
            row.bias,
            row.stated / row.scatter
        );
    }
    for row in &found.rows {
        if let Some((share, sets)) = row.profile {
            let _ = writeln!(
                s,
                "  {:<24} {:6.1} % of {sets:<4} by profile likelihood",
                name(row.parameter),
                100.0 * share
            );
        }
    }
    let _ = writeln!(
        s,
        "  all together             {:6.1} %",
        100.0 * found.overall()
    );
    if found.elsewhere {
        s.push_str("\nThe estimates lie together far from the truth: with these parameters held, other values of the rest make the same motions.\n  help: hold others, such as gains (--hold NAME)\n");
    }
    s
}

fn as_json(model: &dyn Hessian, found: &Coverage) -> serde_json::Value {
    let name = |j: usize| model.params()[j].name.to_string();
    json!({
        "schema_version": 1,
        "program": format!("simtrue {}", env!("CARGO_PKG_VERSION")),
        "model": model.name(),
        "sets": found.sets.0,
        "not_converged": found.sets.1,
        "held": found.held.iter().map(|&j| name(j)).collect::<Vec<_>>(),
        "overall": found.overall(), "elsewhere": found.elsewhere,
        "parameters": found.rows.iter().map(|r| json!({
            "name": name(r.parameter), "share": r.share, "sets": r.sets, "bias_over_scatter": r.bias, "scatter": r.scatter,
            "stated": r.stated, "profile": r.profile.map(|(share, sets)| json!({ "share": share, "sets": sets })),
        })).collect::<Vec<_>>(),
    })
}
