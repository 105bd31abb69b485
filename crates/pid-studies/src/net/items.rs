//! How each result is made. What the rest of the workspace must offer for the net stands in this file alone.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use pid_diagnose::report::Report;
use pid_diagnose::search::Settings as Diagnosing;
use pid_nlp::solver::{Barrier, Oracle, Settings};
use pid_withheld::{Drawing, Plan, lay_out};
use serde_json::{Value, json};

use super::{Failure, Part, Request, compare};
use crate::hock_schittkowski::{all, study};

/// Seeds of the study, cases of each, most joints of a robot.
const SEEDS: [u64; 2] = [1, 2];
const CASES: usize = 30;
const JOINTS: usize = 3;

/// A result.
pub(super) struct Item {
    /// Name within its part.
    pub(super) name: String,
    /// Whether it is there already.
    pub(super) done: Box<dyn Fn() -> bool + Send + Sync>,
    /// Makes its files.
    pub(super) make: Box<dyn Fn() -> Result<(), Failure> + Send + Sync>,
}

/// Items of a part, to be written into its folder.
pub(super) fn of(part: Part, request: &Request, place: &Path) -> Result<Vec<Item>, Failure> {
    match part {
        Part::Demo => Ok(vec![demo(place)]),
        Part::Expansions => expansions(place),
        Part::HockSchittkowski => Ok(collection(place)),
        Part::Draws => Ok(draws(place)),
        Part::Study => diagnoses(&request.folder.join("draws/cases"), place),
        Part::Practice => diagnoses(&request.practice, place),
    }
}

/// Writes a file such that it is complete when it is there.
fn write(path: &Path, text: &str) -> Result<(), Failure> {
    let draft = path.with_extension("draft");
    std::fs::write(&draft, text)?;
    Ok(std::fs::rename(draft, path)?)
}

/// An item of one file.
fn one(
    name: &str,
    path: PathBuf,
    text: impl Fn() -> Result<String, Failure> + Send + Sync + 'static,
) -> Item {
    let there = path.clone();
    Item {
        name: name.to_owned(),
        done: Box::new(move || there.exists()),
        make: Box::new(move || write(&path, &text()?)),
    }
}

/// Environment variable by which this program runs as the command.
const AS_COMMAND: &str = "PID_NET_AS_COMMAND";

/// Runs this process as the command line, if `demo` started it.
pub fn as_command() -> Option<ExitCode> {
    std::env::var_os(AS_COMMAND)?;
    Some(pid_cli::main(&[]))
}

/// The command without arguments but the folder of its results.
fn demo(place: &Path) -> Item {
    let (fit, place) = (place.join("fit.json"), place.to_owned());
    Item {
        name: "fit.json".to_owned(),
        done: Box::new(move || fit.exists()),
        make: Box::new(move || {
            let scratch = place.with_file_name("demo.draft");
            let status = Command::new(std::env::current_exe()?)
                .arg("--out")
                .arg(&scratch)
                .env(AS_COMMAND, "1")
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status()?;
            if !status.success() {
                return Err(format!("the command without arguments ends with {status}").into());
            }
            for name in ["diagnosis/diagnosis.json", "fit.json"] {
                let from = scratch.join(name);
                let file = from.file_name().unwrap_or_default();
                std::fs::copy(&from, place.join(file))?;
            }
            Ok(std::fs::remove_dir_all(scratch)?)
        }),
    }
}

/// A case for every case of the seeds.
fn draws(place: &Path) -> Vec<Item> {
    let plan = |seed| Plan {
        seed,
        cases: CASES,
        fewest: 1,
        joints: JOINTS,
        causes: Drawing::All,
    };
    let cases = SEEDS
        .into_iter()
        .flat_map(|seed| (0..CASES).map(move |i| (plan(seed), i)));
    cases
        .map(|(plan, i)| {
            let (id, place) = (plan.id(i), place.to_owned());
            let truth = place.join("truth").join(format!("{id}.json"));
            Item {
                name: format!("cases/{id}"),
                done: Box::new(move || truth.exists()),
                make: Box::new(move || Ok(lay_out(&plan, i, &place).map(|_| ())?)),
            }
        })
        .collect()
}

/// A diagnosis for every folder with records.
fn diagnoses(cases: &Path, place: &Path) -> Result<Vec<Item>, Failure> {
    let absent = |e| {
        let help = "record `draws` first, or give the practice set by --practice FOLDER";
        format!("{}: {e}; {help}", cases.display())
    };
    let mut items = Vec::new();
    for entry in std::fs::read_dir(cases).map_err(absent)? {
        let folder = entry?.path();
        if !folder.join("dataset.toml").exists() {
            continue;
        }
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let file = format!("{name}.json");
        items.push(one(&file, place.join(&file), move || {
            let report = Report::of_folder(&folder, &Diagnosing::default(), false)?;
            Ok(report.diagnosis().to_json())
        }));
    }
    items.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(items)
}

/// The collection by each solver.
fn collection(place: &Path) -> Vec<Item> {
    type Make = fn() -> Value;
    let solvers: [(&str, Make); 5] = [
        ("monotone", || by_barrier(Barrier::Monotone)),
        ("adaptive", || {
            by_barrier(Barrier::Adaptive(Oracle::Quality))
        }),
        ("sqp", || table(&Settings::default(), &mut study::sqp(None))),
        ("bfgs", || {
            let mut solver = study::quasi_newton(usize::MAX);
            table(&Settings::default(), &mut solver)
        }),
        ("sqp_bfgs", || {
            let mut solver = study::sqp(Some(usize::MAX));
            table(&Settings::default(), &mut solver)
        }),
    ];
    solvers
        .into_iter()
        .map(|(name, make)| {
            let file = format!("{name}.json");
            one(&file, place.join(&file), move || {
                Ok(serde_json::to_string_pretty(&make())?)
            })
        })
        .collect()
}

fn by_barrier(barrier: Barrier) -> Value {
    let settings = Settings {
        barrier,
        ..Settings::default()
    };
    table(&settings, &mut study::interior_point)
}

fn table(settings: &Settings, solver: &mut study::Solver<'_>) -> Value {
    let rows = all().into_iter().map(|mut case| {
        let o = study::run(&mut case, settings, solver);
        let s = &o.solution;
        json!({
            "number": o.number,
            "verdict": format!("{:?}", o.verdict),
            "status": format!("{:?}", s.status),
            "iterations": s.log.len(),
            "objective": s.objective,
            "error": s.error,
            "x": s.x,
            "lambda": s.lambda,
            "check": o.check,
        })
    });
    rows.collect()
}

/// Code, equations and operation counts of every robot that is declared in a source file of the
/// workspace and taken by `robot!`.
fn expansions(place: &Path) -> Result<Vec<Item>, Failure> {
    let root = workspace()?;
    let mut items = Vec::new();
    for name in compare::sources(&root)? {
        let path = root.join(&name);
        let source = std::fs::read_to_string(&path)?;
        // Files with strings and documentation about `robot!` hold no robot; those of the message
        // catalogue are refused.
        let Ok(robots) = pid_codegen::show::robots(&source) else {
            continue;
        };
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        for (k, robot) in robots.iter().enumerate() {
            let name = format!("{stem}_{}", robot.name());
            let (last, place) = (place.join(format!("{name}.counts")), place.to_owned());
            let (source, file) = (source.clone(), name.clone());
            items.push(Item {
                name,
                done: Box::new(move || last.exists()),
                make: Box::new(move || {
                    // Tokens stay in their thread.
                    let robot = &pid_codegen::show::robots(&source)?[k];
                    write(&place.join(format!("{file}.code")), &robot.code()?)?;
                    write(&place.join(format!("{file}.equations")), &robot.text()?)?;
                    write(&place.join(format!("{file}.counts")), &robot.counts()?)
                }),
            });
        }
    }
    Ok(items)
}

/// The folder with the lock file above this crate.
fn workspace() -> Result<PathBuf, Failure> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = here.ancestors().find(|a| a.join("Cargo.lock").exists());
    Ok(root.ok_or("no Cargo.lock above the tests")?.to_owned())
}
