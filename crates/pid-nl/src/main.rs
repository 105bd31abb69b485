//! `pid-nl STUB [-AMPL] [option=value …]`: solves `STUB.nl` and, with `-AMPL`, writes `STUB.sol`.

// The command prints.
#![allow(clippy::print_stdout)]

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use pid_nl::{Problem, answer};
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{Iteration, Settings, ip};

const USAGE: &str = "pid-nl STUB [-AMPL] [tol=1e-8] [acceptable_tol=1e-6] [max_iter=1000] [max_cpu_time=SECONDS] \
    [print_level=5]";

/// What the words of the command say.
struct Wish {
    file: PathBuf,
    answers: bool,
    prints: bool,
    settings: Settings,
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.first().map(String::as_str) {
        None | Some("-h" | "--help") => {
            println!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        // Pyomo asks for a version before anything else.
        Some("-v" | "--version") => {
            println!("pid-nl {}", env!("CARGO_PKG_VERSION"));
            return ExitCode::SUCCESS;
        }
        Some(_) => {}
    }
    match wish(&words).and_then(|wish| solve(&wish)) {
        Ok(converged) => ExitCode::from(u8::from(!converged)),
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::from(2)
        }
    }
}

fn wish(words: &[String]) -> Result<Wish, String> {
    let mut wish = Wish {
        file: PathBuf::new(),
        answers: false,
        prints: false,
        settings: Settings::default(),
    };
    for (i, word) in words.iter().enumerate() {
        if word == "-AMPL" {
            wish.answers = true;
        } else if let Some((key, value)) = word.split_once('=').filter(|_| i > 0) {
            option(&mut wish, key, value)?;
        } else if i == 0 {
            let path = Path::new(word);
            wish.file = if path.extension().is_some_and(|e| e == "nl") {
                path.to_owned()
            } else {
                PathBuf::from(format!("{word}.nl"))
            };
        } else {
            return Err(format!("`{word}` is no option\n  help: {USAGE}"));
        }
    }
    Ok(wish)
}

fn option(wish: &mut Wish, key: &str, value: &str) -> Result<(), String> {
    let bad = || format!("{key} is \"{value}\"\n  help: write a number above 0");
    let number: f64 = value.parse().map_err(|_| bad())?;
    if !(number.is_finite() && number >= 0.0) {
        return Err(bad());
    }
    match key {
        "tol" => wish.settings.tol = number,
        "acceptable_tol" => wish.settings.acceptable_tol = number,
        "max_iter" => wish.settings.max_iterations = number as usize,
        "max_cpu_time" => {
            wish.settings.max_time = Some(Duration::try_from_secs_f64(number).map_err(|_| bad())?);
        }
        "print_level" => wish.prints = number >= 5.0,
        _ => return Err(format!("`{key}` is no option\n  help: {USAGE}")),
    }
    Ok(())
}

/// Solves and prints; whether the conditions of optimality hold.
fn solve(wish: &Wish) -> Result<bool, String> {
    let mut problem = Problem::read(&wish.file).map_err(|error| error.to_string())?;
    let start = problem.start().to_vec();
    let mut kkt = SparseKkt::new(&problem);
    if wish.prints {
        println!("{}", Iteration::HEADING);
    }
    let found = ip::solve(
        &mut problem,
        &mut kkt,
        &start,
        &wish.settings,
        &mut |line, _| {
            if wish.prints {
                println!("{}", line.line());
            }
            ControlFlow::Continue(())
        },
    );
    let objective = if problem.maximises() {
        -found.objective
    } else {
        found.objective
    };
    println!(
        "{}: objective {objective:.10e}, {} iterations",
        found.status.reason(),
        found.log.len().saturating_sub(1)
    );
    if wish.answers {
        let file = wish.file.with_extension("sol");
        std::fs::write(&file, answer(&problem, &found))
            .map_err(|error| format!("{}: cannot be written: {error}", file.display()))?;
    }
    Ok(wish.answers || found.status.converged())
}
