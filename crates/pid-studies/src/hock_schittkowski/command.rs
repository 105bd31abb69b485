//! Solves the Hock-Schittkowski collection and prints a line per problem.
//!
//! ```text
//! pid-studies hock-schittkowski [--barrier monotone|loqo|probing|quality] [--relaxation R]
//!     [--sqp] [--bfgs] [--log NUMBER]
//! ```

use crate::hock_schittkowski::all;
use crate::hock_schittkowski::study::{self, Verdict};
use pid_nlp::solver::{Barrier, Iteration, Oracle, Settings};

use crate::Failure;

/// What the words ask for.
#[derive(Default)]
struct Options {
    settings: Settings,
    /// The only problem, whose iterations are shown.
    shown: Option<u32>,
    sqp: bool,
    /// Steps that an approximated Hessian remembers.
    memory: Option<usize>,
}

impl Options {
    fn parse(words: &[String]) -> Result<Self, Failure> {
        let mut options = Self::default();
        let mut args = words.iter().cloned();
        while let Some(arg) = args.next() {
            match arg.as_str() {
                "--barrier" => {
                    options.settings.barrier = match args.next().as_deref() {
                        Some("monotone") => Barrier::Monotone,
                        Some("loqo") => Barrier::Adaptive(Oracle::Loqo),
                        Some("probing") => Barrier::Adaptive(Oracle::Probing),
                        Some("quality") => Barrier::Adaptive(Oracle::Quality),
                        _ => {
                            return Err("--barrier takes monotone, loqo, probing or quality".into());
                        }
                    }
                }
                "--relaxation" => {
                    options.settings.bound_relaxation =
                        args.next().ok_or("--relaxation takes a number")?.parse()?;
                }
                "--sqp" => options.sqp = true,
                "--bfgs" => options.memory = Some(usize::MAX),
                "--log" => {
                    options.shown = Some(args.next().ok_or("--log takes a number")?.parse::<u32>()?)
                }
                other => {
                    return Err(format!("unknown option {other}; see the head of this file").into());
                }
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
        settings,
        shown,
        sqp,
        memory,
    } = Options::parse(words)?;
    let mut solver: Box<study::Solver<'_>> = match (sqp, memory) {
        (true, memory) => Box::new(study::sqp(memory)),
        (false, Some(memory)) => Box::new(study::quasi_newton(memory)),
        (false, None) => Box::new(study::interior_point),
    };
    let mut cases = all();
    if let Some(number) = shown {
        cases.retain(|case| case.info.number == number);
    }
    let total = cases.len();
    println!(
        "  HS   n   m  iter    f    g    H  fac  R        objective        published  verdict"
    );
    let (mut published, mut lower, mut other, mut sums) = (0, 0, 0, [0usize; 4]);
    for case in &mut cases {
        let o = study::run(case, &settings, solver.as_mut());
        if shown.is_some() {
            println!("{}", Iteration::HEADING);
            o.solution.log.iter().for_each(|l| println!("{}", l.line()));
            println!("x = {:?}\n{:?}", o.solution.x, o.check);
        }
        let verdict = match o.verdict {
            Verdict::Published => {
                published += 1;
                ""
            }
            Verdict::Lower => {
                lower += 1;
                "minimum below the published value"
            }
            Verdict::OtherMinimum => {
                other += 1;
                "another local minimum"
            }
            Verdict::Failed => "FAILED",
        };
        let (s, c) = (&o.solution, &o.solution.counts);
        let iterations = s.log.len().saturating_sub(1);
        println!(
            "{:4} {:3} {:3} {iterations:5} {:4} {:4} {:4} {:4} {:2} {:16.8e} {:16.8e}  {verdict} {}",
            o.number,
            o.size.0,
            o.size.1,
            c.functions,
            c.gradients,
            c.hessians,
            c.factorizations,
            c.restorations,
            s.objective,
            o.reference,
            if s.status == pid_nlp::solver::Status::Solved {
                ""
            } else {
                s.status.reason()
            },
        );
        for (sum, n) in sums
            .iter_mut()
            .zip([iterations, c.functions, c.gradients, c.hessians])
        {
            *sum += n;
        }
    }
    println!(
        "{published} of {total} at the published optimum, {lower} just below it, {other} at another local minimum; {} iterations, {} function, {} gradient, {} Hessian evaluations",
        sums[0], sums[1], sums[2], sums[3]
    );
    Ok(())
}
