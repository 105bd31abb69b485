//! `pid-studies paper`: the study of K. Schäfer, M. Runge, K. Flaßkamp, C. Büskens, *Parameter
//! Identification for Dynamical Systems Using Optimal Control Techniques*, on the idealised
//! two-link robot.
//!
//! Everything is made here: the records by accurate simulation with the values of Table II, the
//! starts from a seed, sizes and non-zeros by counting in the programs that are solved.

mod page;
mod plot;
mod robot;
mod size;
mod study;
mod vs050;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use pid_data::Dataset;
use pid_fit::transcribe::Scheme;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::{Failure, make_folder, write};
use pid_cli::output;
use pid_cli::progress::{Interrupt, Progress};
use size::Size;
use study::{HESSIANS, Job, Outcome, Second};
use vs050::Arm;

/// Arguments of `pid-studies paper`.
#[derive(Debug, Clone, Args)]
pub struct PaperArgs {
    /// Folder for paper.html and paper.json; made if needed.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-paper")]
    pub(crate) out: PathBuf,
    /// Few starts, few numbers of nodes, few iterations: a minute.
    #[arg(long, conflicts_with = "long")]
    pub(crate) quick: bool,
    /// Twenty starts and every number of nodes that the figures show: hours on one core.
    #[arg(long)]
    pub(crate) long: bool,
    /// Seconds for each solve; the tables say how many ended before that.
    #[arg(long, default_value_t = 20.0, value_name = "SECONDS", value_parser = positive)]
    pub(crate) limit: f64,
    /// Seed of the starts.
    #[arg(long, default_value_t = 0, value_name = "S")]
    pub(crate) seed: u64,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err(format!("`{text}` is not a number above zero, such as 20")),
    }
}

/// A normal number by the method of Box and Muller.
fn gaussian(random: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// How much is done.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Plan {
    nodes: Vec<usize>,
    /// Numbers of nodes at which sizes are counted.
    counted: Vec<usize>,
    starts: usize,
    max_iterations: usize,
    /// Seconds for each solve.
    limit: f64,
    /// Starts of the fits of the VS-050.
    arm_starts: usize,
    schemes: Vec<(Scheme, usize)>,
}

impl Plan {
    fn of(args: &PaperArgs) -> Self {
        let scheme = |name: &str| name.parse().expect("invariant: a name of a scheme");
        let mut schemes: Vec<(Scheme, usize)> = vec![
            (Scheme::ExplicitEuler, 4),
            (Scheme::Trapezoidal, 1),
            (Scheme::ImplicitMidpoint, 1),
            (scheme("gauss-legendre-2"), 1),
        ];
        let counted = vec![1, 2, 3, 5, 10, 20, 50, 100, 150, 200, 250, 300];
        if args.quick {
            schemes.truncate(2);
            return Self {
                nodes: vec![1, 5, 50],
                counted: vec![1, 2, 5, 50, 300],
                starts: 2,
                max_iterations: 100,
                limit: args.limit,
                arm_starts: 1,
                schemes,
            };
        }
        schemes.extend([
            (Scheme::ExplicitEuler, 2),
            (Scheme::Heun, 2),
            (Scheme::RungeKutta4, 2),
            (Scheme::HermiteSimpson, 1),
            (scheme("radau-2"), 1),
            (scheme("radau-3"), 1),
        ]);
        if args.long {
            Self {
                nodes: vec![
                    1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 50, 75, 100, 150, 200, 250, 300,
                ],
                counted,
                starts: 20,
                max_iterations: 1000,
                limit: args.limit,
                arm_starts: 10,
                schemes,
            }
        } else {
            Self {
                nodes: vec![1, 2, 5, 20, 50, 100],
                counted,
                starts: 5,
                max_iterations: 500,
                limit: args.limit,
                arm_starts: 3,
                schemes,
            }
        }
    }

    fn jobs(&self) -> Vec<Job> {
        let mut jobs = Vec::new();
        let euler = |nodes, hessian, lift, start| Job {
            nodes,
            scheme: Scheme::ExplicitEuler,
            substeps: 1,
            hessian,
            lift,
            start,
        };
        for start in 0..self.starts {
            for (hessian, _) in HESSIANS {
                jobs.push(euler(None, hessian, false, start));
                for &nodes in &self.nodes {
                    jobs.push(euler(Some(nodes), hessian, false, start));
                }
            }
            for &nodes in &self.nodes {
                jobs.push(euler(Some(nodes), Second::Exact, true, start));
            }
            for &(scheme, substeps) in &self.schemes {
                jobs.push(Job {
                    scheme,
                    substeps,
                    ..euler(None, Second::Exact, false, start)
                });
            }
        }
        jobs
    }
}

/// Everything the page shows.
#[derive(Debug, Serialize)]
struct Findings {
    program: String,
    command: String,
    seed: u64,
    plan: Plan,
    sizes: Vec<Size>,
    outcomes: Vec<Outcome>,
    seconds: f64,
    interrupted: bool,
    /// The job of figures 6 and 7.
    arm: Arm,
    /// Start parameters, for the record.
    starts: Vec<Vec<f64>>,
    #[serde(skip)]
    dataset: Dataset,
}

/// Runs the command; the exit code.
///
/// # Errors
/// What stops it.
pub fn run(args: &PaperArgs) -> Result<u8, Failure> {
    let interrupt = Interrupt::listen();
    let progress = Progress::start("simulating the idealised robot");
    let started = Instant::now();
    let plan = Plan::of(args);
    let dataset = robot::records()?;
    let starts = robot::starts(plan.starts, args.seed);
    progress.step("counting sizes and non-zeros");
    let sizes = size::sizes(&dataset, &plan.counted, &starts[0]);
    let jobs = plan.jobs();
    let news = |done: usize| {
        progress.step(format!("{done} of {} identifications done", jobs.len()));
    };
    let stop = || interrupt.requested();
    let limits = (
        plan.max_iterations,
        Duration::try_from_secs_f64(plan.limit).unwrap_or(Duration::MAX),
    );
    let outcomes = study::run(&dataset, &starts, &jobs, limits, &news, &stop)?;
    progress.step("simulating the VS-050");
    let news = |done: usize| progress.step(format!("{done} fits of the VS-050 done"));
    let arm = vs050::run((plan.arm_starts, args.seed), limits, &news, &stop)?;
    let interrupted = interrupt.requested();
    let level = match (args.quick, args.long) {
        (true, _) => " --quick",
        (_, true) => " --long",
        _ => "",
    };
    let findings = Findings {
        program: format!("simtrue {}", env!("CARGO_PKG_VERSION")),
        command: format!(
            "pid-studies paper{level} --limit {} --seed {}",
            args.limit, args.seed
        ),
        seed: args.seed,
        plan,
        sizes,
        outcomes,
        seconds: started.elapsed().as_secs_f64(),
        interrupted,
        arm,
        starts,
        dataset,
    };
    drop(progress);
    make_folder(&args.out)?;
    let (html, json) = (args.out.join("paper.html"), args.out.join("paper.json"));
    write(&html, &page::html(&findings))?;
    let text = serde_json::to_string_pretty(&findings)?;
    write(&json, &text)?;
    output::print(&page::text(&findings));
    output::print(&format!(
        "\nwritten: {}, {}\n",
        html.display(),
        json.display()
    ));
    Ok(if interrupted { 130 } else { 0 })
}
