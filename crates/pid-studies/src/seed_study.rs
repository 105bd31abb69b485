//! Objective, iterations and time of the two-link problem for every start of a table, and how the
//! time grows with the record.
//!
//! ```text
//! pid-studies seed [--scheme NAME] [--unprepared] [FOLDER]             FOLDER holds data/seed_two_link and bench/
//! pid-studies seed --scaling [FOLDER]                                  301 … 10001 samples over 6 s, trapezoidal rule
//! ```
//!
//! `--unprepared` hands the starts to the exact Hessian at once, without the preparing fits
//! (residuals of the steps, Gauss-Newton). Seconds are of the processor, all threads together.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use cpu_time::ProcessTime;
use pid_data::Dataset;
use pid_fit::ident::{Prepare, Run, Settings, identify};
use pid_fit::transcribe::Scheme;
use pid_models::TwoLink;
use pid_tests::two_link;

use crate::Failure;

/// Runs the command with its words.
///
/// # Errors
/// What stops it.
pub fn run(words: &[String]) -> Result<(), Failure> {
    let mut scheme = Scheme::ExplicitEuler;
    let mut scaling = false;
    let mut prepare = Prepare::Everything;
    let mut folder = pid_records::beside("");
    let mut args = words.iter().cloned();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--scaling" => scaling = true,
            "--unprepared" => prepare = Prepare::Nothing,
            "--scheme" => {
                scheme = args.next().ok_or("--scheme takes a name")?.parse()?;
            }
            other if other.starts_with('-') => {
                return Err(format!("unknown option {other}; see the head of this file").into());
            }
            other => folder = PathBuf::from(other),
        }
    }
    let starts = two_link::starts(&folder.join("bench/initial_parameters.csv"))?;
    if scaling {
        growth(&starts[0])
    } else {
        table(&folder, scheme, prepare, &starts)
    }
}

fn from_start(
    dataset: &Dataset,
    scheme: Scheme,
    prepare: Prepare,
    start: &[f64],
) -> Result<Run, pid_fit::ident::IdentError> {
    let settings = Settings {
        prepare,
        ..two_link::settings(scheme)
    };
    let found = identify(&TwoLink, dataset, &settings, Some(start), &mut |_| {
        ControlFlow::Continue(())
    })?;
    Ok(found.best().clone())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

fn table(
    folder: &Path,
    scheme: Scheme,
    prepare: Prepare,
    starts: &[Vec<f64>],
) -> Result<(), Failure> {
    let dataset = Dataset::read(&folder.join("data/seed_two_link"))?;
    println!("{}, N = 301", scheme.label());
    println!("start            J  iterations   seconds  violation  status");
    let mut runs = Vec::new();
    for (k, start) in starts.iter().enumerate() {
        let clock = ProcessTime::now();
        let mut r = from_start(&dataset, scheme, prepare, start)?;
        r.seconds = clock.elapsed().as_secs_f64();
        println!(
            "{k:5} {:12.6e} {:11} {:9.3} {:10.1e}  {}",
            r.objective,
            r.iterations,
            r.seconds,
            r.check.primal_inf,
            r.status.reason()
        );
        runs.push(r);
    }
    let best = runs
        .iter()
        .map(|r| r.objective)
        .fold(f64::INFINITY, f64::min);
    let near = runs.iter().filter(|r| r.objective <= 1.01 * best).count();
    let of = |f: fn(&Run) -> f64| median(runs.iter().map(f).collect());
    println!(
        "median: J {:.6e}, {} iterations, {:.3} s; {near} of {} within 1 % of the best {best:.6e}",
        of(|r| r.objective),
        of(|r| r.iterations as f64),
        of(|r| r.seconds),
        runs.len()
    );
    Ok(())
}

/// Largest memory of this process so far, MiB, where the system tells.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

fn growth(start: &[f64]) -> Result<(), Failure> {
    println!("trapezoidal rule, 6 s, start 0");
    println!("samples  iterations            J   seconds  ms/iteration  peak MiB");
    for samples in [301, 1001, 3001, 10_001] {
        let dataset = two_link::simulated(&two_link::truth(), samples)?;
        let settings = two_link::settings(Scheme::Trapezoidal);
        let clock = ProcessTime::now();
        let found = identify(&TwoLink, &dataset, &settings, Some(start), &mut |_| {
            ControlFlow::Continue(())
        })?;
        let r = found.best();
        let seconds = clock.elapsed().as_secs_f64();
        println!(
            "{samples:7} {:11} {:12.4e} {:9.3} {:13.2} {:>9}  {}",
            r.iterations,
            r.objective,
            seconds,
            1e3 * seconds / r.iterations.max(1) as f64,
            peak_memory().map_or_else(|| "-".to_owned(), |m| format!("{m:.0}")),
            r.status.reason()
        );
    }
    Ok(())
}
