//! Objective reached from every start of a table against the number of shooting nodes.
//!
//! ```text
//! pid-studies shooting [--scheme NAME] [--nodes 1,2,5] [--starts 10] [--hessian exact|gauss-newton]
//!                [--prepare nothing|motion|everything] [--no-lift] [FOLDER]
//! ```
//! FOLDER holds data/seed_two_link and bench/.

use std::ops::ControlFlow;
use std::path::PathBuf;

use pid_data::Dataset;
use pid_fit::ident::{Method, Prepare, Run, Settings, identify};
use pid_fit::transcribe::{Curvature, Scheme};
use pid_models::TwoLink;
use pid_tests::two_link;

use crate::Failure;

/// The best objective known of the problem with explicit Euler, N = 301.
const BEST: f64 = 0.044253;

/// What the words ask for.
struct Options {
    scheme: Scheme,
    /// Numbers of shooting nodes.
    nodes: Vec<usize>,
    /// Number of starts.
    count: usize,
    curvature: Curvature,
    prepare: Prepare,
    lift: Option<bool>,
    folder: PathBuf,
}

impl Options {
    fn parse(words: &[String]) -> Result<Self, Failure> {
        let mut options = Self {
            scheme: Scheme::ExplicitEuler,
            nodes: vec![1, 2, 3, 5, 10, 20, 50, 100, 200, 300, 301],
            count: 10,
            curvature: Curvature::Exact,
            prepare: Prepare::Everything,
            lift: None,
            folder: pid_records::beside(""),
        };
        let mut args = words.iter().cloned();
        while let Some(arg) = args.next() {
            let mut value = || args.next().ok_or(format!("{arg} takes a value"));
            match arg.as_str() {
                "--scheme" => options.scheme = value()?.parse()?,
                "--nodes" => {
                    options.nodes = value()?
                        .split(',')
                        .map(str::parse)
                        .collect::<Result<_, _>>()?;
                }
                "--starts" => options.count = value()?.parse()?,
                "--hessian" => {
                    options.curvature = match value()?.as_str() {
                        "exact" => Curvature::Exact,
                        "gauss-newton" => Curvature::GaussNewton,
                        other => return Err(format!("unknown Hessian {other}").into()),
                    }
                }
                "--prepare" => {
                    options.prepare = match value()?.as_str() {
                        "nothing" => Prepare::Nothing,
                        "motion" => Prepare::Motion,
                        "everything" => Prepare::Everything,
                        other => return Err(format!("unknown preparation {other}").into()),
                    }
                }
                "--no-lift" => options.lift = Some(false),
                other if other.starts_with('-') => {
                    return Err(format!("unknown option {other}; see the head of this file").into());
                }
                other => options.folder = PathBuf::from(other),
            }
        }
        Ok(options)
    }
}

/// Runs the command with its words.
///
/// # Errors
/// What stops it.
pub fn run(words: &[String]) -> Result<(), Failure> {
    let Options {
        scheme,
        nodes,
        count,
        curvature,
        prepare,
        lift,
        folder,
    } = Options::parse(words)?;
    let mut starts = two_link::starts(&folder.join("bench/initial_parameters.csv"))?;
    starts.truncate(count);
    let dataset = Dataset::read(&folder.join("data/seed_two_link"))?;
    println!(
        "{}, {curvature:?}, prepare {prepare:?}, lift {lift:?}, {} starts",
        scheme.label(),
        starts.len()
    );
    println!(
        "nodes      n     m         min J      median J         max J  near  15%  solved  iterations  seconds"
    );
    for nodes in nodes {
        let settings = Settings {
            method: Method::Shooting,
            nodes,
            curvature,
            prepare,
            lift,
            ..two_link::settings(scheme)
        };
        let mut runs: Vec<Run> = Vec::new();
        let mut size = (0, 0);
        for start in &starts {
            let found = identify(&TwoLink, &dataset, &settings, Some(start), &mut |_| {
                ControlFlow::Continue(())
            })?;
            size = found.size;
            runs.push(found.best().clone());
        }
        print(nodes, size, &runs);
    }
    Ok(())
}

/// A line for a number of nodes, then one for each start.
fn print(nodes: usize, size: (usize, usize), runs: &[Run]) {
    let usable = |r: &Run| r.objective.is_finite() && r.check.primal_inf < 1e-6;
    let j: Vec<f64> = runs
        .iter()
        .map(|r| {
            if usable(r) {
                r.objective
            } else {
                f64::INFINITY
            }
        })
        .collect();
    let within = |share: f64| j.iter().filter(|j| **j <= (1.0 + share) * BEST).count();
    let median = |mut v: Vec<f64>| {
        v.sort_by(f64::total_cmp);
        0.5 * (v[(v.len() - 1) / 2] + v[v.len() / 2])
    };
    println!(
        "{nodes:5} {:6} {:5} {:13.5e} {:13.5e} {:13.5e} {:5} {:4} {:7} {:11} {:8.3}",
        size.0,
        size.1,
        j.iter().copied().fold(f64::INFINITY, f64::min),
        median(j.clone()),
        j.iter().copied().fold(0.0, f64::max),
        within(0.01),
        within(0.15),
        runs.iter().filter(|r| r.status.converged()).count(),
        median(runs.iter().map(|r| r.iterations as f64).collect()),
        median(runs.iter().map(|r| r.seconds).collect()),
    );
    for (k, r) in runs.iter().enumerate() {
        println!(
            "      start {k}: {:.6e} after {} iterations, {}",
            r.objective,
            r.iterations,
            r.status.reason()
        );
    }
}
