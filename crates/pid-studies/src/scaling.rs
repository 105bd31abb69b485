//! Growth of time and memory of an identification with the record: trapezoidal rule, noise, and a
//! plant with Stribeck friction that the model lacks; one window, or restart windows of a length.
//!
//! ```text
//! pid-studies scaling [--two-link N,N,…] [--arm N,N,…] [--rotors true] [--window SECONDS]
//!     [--limit SECONDS] [--consistent true]
//!         [--verbose true] [--records FOLDER]
//! ```
//!
//! The two-link robot moves under sums of sines at 50 Hz, the six-axis arm (84 parameters) under
//! inverse-dynamics control at 100 Hz; with `--rotors` its drives have inertia. The record grows
//! with N. Starts are the true values times 0.8. Seconds are of the processor, all threads
//! together. Memory is the largest of the process so far, so give the numbers of samples in
//! ascending order. `--records` writes the records as CSV (t, q, dq, u) for other programs, and
//! solves nothing.

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

use cpu_time::ProcessTime;
use pid_data::{Dataset, Horizon};
use pid_fit::ident::{Settings, Weighting, identify};
use pid_fit::transcribe::Scheme;
use pid_models::{Arm6, TwoLink};
use pid_nlp::solver;
use pid_runtime::dynamics::Hessian;
use pid_tests::mismatched::{Control, Geared, follow, follow_geared, record, sines, start};
use pid_tests::two_link;

use crate::Failure;

/// Runs the command with its words.
///
/// # Errors
/// What stops it.
pub fn run(words: &[String]) -> Result<(), Failure> {
    let mut sizes = [vec![1_000, 10_000, 100_000], vec![1_000, 10_000]];
    let (mut limit, mut consistent, mut verbose, mut rotors) = (600.0, false, false, false);
    let mut horizon = Horizon::Record;
    let mut folder: Option<PathBuf> = None;
    let mut args = words.iter().cloned();
    while let Some(arg) = args.next() {
        let value = args
            .next()
            .ok_or("every option takes a value; see the head of this file")?;
        let list = || -> Result<Vec<usize>, Failure> {
            let numbers = value.split(',').filter(|n| !n.is_empty());
            Ok(numbers.map(str::parse).collect::<Result<_, _>>()?)
        };
        match arg.as_str() {
            "--two-link" => sizes[0] = list()?,
            "--arm" => sizes[1] = list()?,
            "--consistent" => consistent = value.parse()?,
            "--rotors" => rotors = value.parse()?,
            "--verbose" => verbose = value.parse()?,
            "--records" => folder = Some(value.into()),
            "--window" => horizon = Horizon::Seconds(value.parse()?),
            "--limit" => limit = value.parse()?,
            other => {
                return Err(format!("unknown option {other}; see the head of this file").into());
            }
        }
    }
    let limit = Duration::try_from_secs_f64(limit)?;
    let two_link: (&dyn Hessian, &Control) = (&TwoLink, &sines);
    let geared = Geared::new(&Arm6);
    let arm: (&dyn Hessian, &Control) = match rotors {
        true => (&geared, &follow_geared),
        false => (&Arm6, &follow),
    };
    for ((model, control), (sizes, step)) in [two_link, arm]
        .into_iter()
        .zip(sizes.iter().zip([0.02, 0.01]))
    {
        if sizes.is_empty() {
            continue;
        }
        if let Some(folder) = &folder {
            for &samples in sizes {
                let file = format!("{}_{samples}.csv", model.name());
                write(&record(model, control, samples, step)?, &folder.join(file))?;
            }
            continue;
        }
        println!(
            "{}: {} parameters, step {step} s",
            model.name(),
            model.dims().np
        );
        println!(
            "samples  iterations            J   seconds  ms/iteration  µs/iteration/sample  peak MiB"
        );
        for &samples in sizes {
            let how = (horizon, limit, consistent, verbose);
            grow(model, control, samples, step, how)?;
        }
    }
    Ok(())
}

fn grow(
    model: &dyn Hessian,
    control: &Control,
    samples: usize,
    step: f64,
    (horizon, limit, consistent, verbose): (Horizon, Duration, bool, bool),
) -> Result<(), Failure> {
    let dataset = record(model, control, samples, step)?;
    let start = start(model);
    let settings = Settings {
        weighting: Weighting::Spread,
        consistent,
        horizon,
        solver: solver::Settings {
            max_time: Some(limit),
            ..Settings::default().solver
        },
        ..two_link::settings(Scheme::Trapezoidal)
    };
    let clock = ProcessTime::now();
    let found = identify(model, &dataset, &settings, Some(&start), &mut |news| {
        if verbose {
            println!("{} {}", &news.phase[..4], news.iteration.line());
        }
        ControlFlow::Continue(())
    })?;
    let run = found.best();
    let seconds = clock.elapsed().as_secs_f64();
    let each = seconds / run.iterations.max(1) as f64;
    println!(
        "{samples:7} {:11} {:12.4e} {seconds:9.3} {:13.2} {:20.2} {:>9}  {}",
        run.iterations,
        run.objective,
        1e3 * each,
        1e6 * each / samples as f64,
        peak_memory().map_or_else(|| "-".to_owned(), |m| format!("{m:.0}")),
        run.status.reason()
    );
    Ok(())
}

/// Writes the record of a data set as CSV.
fn write(dataset: &Dataset, file: &Path) -> Result<(), Failure> {
    let record = &dataset.experiments[0];
    let nq = record.nq;
    let mut text = String::from("t");
    for name in ["q", "dq", "u"] {
        (1..=nq).for_each(|j| text += &format!(",{name}{j}"));
    }
    for (k, t) in record.t.iter().enumerate() {
        let row = k * nq..(k + 1) * nq;
        let v = record.v.as_ref().ok_or("the record has velocities")?;
        let numbers = [&record.q[row.clone()], &v[row.clone()], &record.u[row]].concat();
        text += &format!("\n{t:?}");
        numbers.iter().for_each(|x| text += &format!(",{x:?}"));
    }
    Ok(fs::write(file, text + "\n")?)
}

/// Largest memory of this process so far, MiB, where the system tells.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}
