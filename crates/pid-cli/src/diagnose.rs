//! `simtrue diagnose`: which effect the model in a data folder lacks.

use std::ffi::{OsStr, OsString};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex};

use pid_diagnose::declared::declared;
use pid_diagnose::diagnosis::{Diagnosis, Outcome, Share};
use pid_diagnose::report::Report;
use pid_diagnose::search::{Listener, Settings, Watch};
use pid_diagnose::with_effects::{Placed, source};
use pid_diagnose::words;
use pid_diagnose::write::remove_stale;
use pid_page::number::{self, short};
use pid_runtime::dynamics::Hessian;
use rayon::prelude::*;

use crate::args::diagnose::DiagnoseArgs;
use crate::course::Search;
use crate::error::{CliError, make_folder, write};
use crate::open::{folders, open, robot_and_logs};
use crate::progress::{Interrupt, Progress};
use crate::{check, models, output};

/// Diagnoses a robot file with its logs, or all folders, several at a time. Names those that cannot be
/// read and goes on.
pub(crate) fn run(args: &DiagnoseArgs) -> Result<u8, CliError> {
    let watch = Arc::new(Shown::new());
    let code = diagnosed(args, &watch)?;
    Ok(match watch.stop() {
        true => INTERRUPTED,
        false => code,
    })
}

/// Exit code after Ctrl-C; what was found so far is written.
const INTERRUPTED: u8 = 130;

/// Steps of the searches on standard error, and Ctrl-C.
struct Shown {
    progress: Mutex<Progress>,
    interrupt: Interrupt,
    /// How far a single search is.
    search: Search,
    /// Folders and how many of them are done, where there are several.
    folders: Mutex<Option<(usize, usize)>>,
}

impl Shown {
    fn new() -> Self {
        Shown {
            progress: Mutex::new(Progress::start("reading the data")),
            interrupt: Interrupt::listen(),
            search: Search::default(),
            folders: Mutex::new(None),
        }
    }

    /// Several folders are diagnosed.
    fn several(&self, number: usize) {
        if let Ok(mut folders) = self.folders.lock() {
            *folders = Some((0, number));
        }
    }

    /// A folder is done.
    fn finished(&self) {
        let (Ok(mut folders), Ok(progress)) = (self.folders.lock(), self.progress.lock()) else {
            return;
        };
        if let Some((done, number)) = folders.as_mut() {
            *done += 1;
            progress.done(*done as f64 / *number as f64);
        }
    }

    /// Prints a result beside the progress.
    fn print(&self, text: &str) {
        match self.progress.lock() {
            Ok(progress) => progress.result(text),
            Err(_) => output::print(text),
        }
    }
}

impl Listener for Shown {
    fn step(&self, what: &str) {
        let several = self.folders.lock().is_ok_and(|folders| folders.is_some());
        if let Ok(progress) = self.progress.lock() {
            progress.step(what);
            if !several {
                progress.done(self.search.begins(what));
            }
        }
    }

    fn stop(&self) -> bool {
        self.interrupt.requested()
    }
}

/// What every diagnosis of a command shares.
struct Run<'a> {
    args: &'a DiagnoseArgs,
    settings: Settings,
    watch: &'a Shown,
    several: bool,
}

fn diagnosed(args: &DiagnoseArgs, watch: &Arc<Shown>) -> Result<u8, CliError> {
    let mut run = Run {
        args,
        settings: settings(args, watch.clone()),
        watch,
        several: false,
    };
    if let Some((robot, logs)) = robot_and_logs(&args.paths) {
        return of_logs(robot, logs, &run);
    }
    let paths = folders(&args.paths, &args.open)?;
    let several = paths.len() > 1;
    run.several = several;
    if several {
        watch.several(paths.len());
    }
    let model = match &args.model {
        Some(name) => Some(models::by_name(name)?.model),
        None => None,
    };
    let outcomes: Vec<Result<Option<Diagnosis>, CliError>> = paths
        .par_iter()
        .zip(places(paths))
        .map(|(folder, place)| {
            if watch.stop() {
                return Ok(None);
            }
            let out = if several {
                args.out.join(place)
            } else {
                args.out.clone()
            };
            let file = out.join("diagnosis.json");
            if several && !args.again && file.exists() {
                if !args.quiet && !args.json {
                    watch.print(&format!("{}: already diagnosed\n", folder.display()));
                }
                return earlier(&file).map(Some);
            }
            let outcome = one(folder, model, &out, &run);
            watch.finished();
            match outcome {
                Ok(d) => Ok(d),
                Err(CliError::Case { source }) => {
                    output::message(&format!("error: {}: {source}", folder.display()));
                    Ok(None)
                }
                Err(other) => Err(other),
            }
        })
        .collect();
    let outcomes: Vec<Option<Diagnosis>> = outcomes.into_iter().collect::<Result<_, _>>()?;
    let failed = outcomes.iter().any(Option::is_none);
    let all: Vec<Diagnosis> = outcomes.into_iter().flatten().collect();
    if args.json {
        let text = match all.as_slice() {
            [one] if !several => one.to_json(),
            _ => serde_json::to_string_pretty(&all).map_err(CliError::Json)?,
        };
        watch.print(&format!("{text}\n"));
    }
    match failed {
        true => Ok(FAILED),
        false => Ok(code(&all, args)),
    }
}

/// Exit code where a folder could not be diagnosed.
const FAILED: u8 = 1;

/// Exit code of diagnoses: 0, or with `--exit-code` that of the worst of them.
fn code(all: &[Diagnosis], args: &DiagnoseArgs) -> u8 {
    let of = |d: &Diagnosis| match d.outcome() {
        Outcome::Nothing => 0,
        Outcome::OneCause | Outcome::Several => 10,
        Outcome::PartlyUnknown => 11,
        Outcome::Unknown => 12,
    };
    let worst = all.iter().map(of).max().unwrap_or(0);
    if args.exit_code { worst } else { 0 }
}

/// A diagnosis that an earlier run wrote.
fn earlier(file: &Path) -> Result<Diagnosis, CliError> {
    let text = std::fs::read_to_string(file).map_err(|error| CliError::Read {
        path: file.to_owned(),
        error,
    })?;
    serde_json::from_str(&text).map_err(|error| CliError::Earlier {
        path: file.to_owned(),
        error,
    })
}

impl Run<'_> {
    /// Prints a summary and where the report is, unless that is not wanted.
    fn said(&self, d: &Diagnosis, out: &Path) {
        if self.args.json || self.args.quiet {
            return;
        }
        let report = out.join("report.html");
        let text = format!("{}  report: {}\n", summary(d), report.display());
        self.watch.print(&text);
    }
}

/// Names of the folders of results: the last part of each path, or all of it where two end alike.
fn places(paths: &[PathBuf]) -> Vec<OsString> {
    let last = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_owned();
    let whole = |path: &Path| {
        let parts = path.components().filter_map(|part| match part {
            Component::Normal(name) => Some(name.to_owned()),
            _ => None,
        });
        parts.collect::<Vec<OsString>>().join(OsStr::new("_"))
    };
    let names: Vec<OsString> = paths.iter().map(|path| last(path)).collect();
    paths
        .iter()
        .zip(&names)
        .map(
            |(path, name)| match names.iter().filter(|n| *n == name).count() {
                1 => name.clone(),
                _ => whole(path),
            },
        )
        .collect()
}

fn settings(args: &DiagnoseArgs, watch: Arc<Shown>) -> Settings {
    Settings {
        refit_all: args.refit_all,
        joint_seconds: args.joint_seconds,
        watch: Watch::new(watch),
        ..Settings::default()
    }
}

/// Diagnoses a robot file with its logs. What the run rests on stands in the folder `data` beside the
/// report and repeats it.
fn of_logs(robot: &Path, logs: &[PathBuf], run: &Run<'_>) -> Result<u8, CliError> {
    let args = run.args;
    let of_folders = [
        ("--nominal", args.nominal.is_some()),
        ("--model", args.model.is_some()),
    ];
    if let Some((option, _)) = of_folders.into_iter().find(|(_, stated)| *stated) {
        return Err(CliError::OptionOfFolders { option });
    }
    let opened = open(robot, logs, &args.open)?;
    check::refuse_wrong(&opened, args.anyway)?;
    make_folder(&args.out)?;
    opened.write(&args.out.join("data"))?;
    let nominal = pid_diagnose::nominal::Nominal::new(opened.nominal);
    let report = Report::new(nominal, &opened.records.dataset, &run.settings, args.next)?;
    report.write(&args.out)?;
    run.said(&report.diagnosis, &args.out);
    if args.json {
        run.watch
            .print(&format!("{}\n", report.diagnosis.to_json()));
    }
    Ok(code(std::slice::from_ref(&report.diagnosis), args))
}

/// Diagnoses a folder; `None` if it was interrupted among several, which a further run does again.
fn one(
    folder: &Path,
    model: Option<&dyn Hessian>,
    out: &Path,
    run: &Run<'_>,
) -> Result<Option<Diagnosis>, CliError> {
    let (args, settings) = (run.args, &run.settings);
    let report = match (model, &args.nominal) {
        (Some(model), _) => Report::of_model(model, folder, settings, args.next)?,
        (None, Some(file)) => Report::of_files(folder, file, settings, args.next)?,
        (None, None) => Report::of_folder(folder, settings, args.next)?,
    };
    if run.several && run.watch.stop() {
        return Ok(None);
    }
    report.write(out)?;
    if let Some(model) = model {
        write_items(model, &report, out)?;
        write_declared(model, &report, out)?;
    }
    run.said(&report.diagnosis, out);
    Ok(Some(report.diagnosis))
}

/// Writes what a declared robot lacks as items for its declaration, with the values that the
/// diagnosis found for the rest.
fn write_items(model: &dyn Hessian, report: &Report, out: &Path) -> Result<(), CliError> {
    let path = out.join("robot_items.rs");
    // What an earlier run left there belongs to another result.
    remove_stale(&path).map_err(|error| CliError::Write {
        path: path.clone(),
        error,
    })?;
    let placed = Placed::of(&report.extended)?;
    if placed.is_empty() {
        return Ok(());
    }
    let items = match source(model, &placed) {
        Ok(items) => items,
        Err(error) => {
            output::print(&format!("no items for `robot!`: {error}\n"));
            return Ok(());
        }
    };
    let mut text = format!(
        "// What `{}` lacks: items for its `robot! {{ … }}`.\n// Values of its parameters with them:\n",
        model.name()
    );
    for p in &report.extended.robot().params {
        text.push_str(&format!("//   {} = {:?} {}\n", p.name, p.nominal, p.unit));
    }
    write(&path, &format!("{text}{items}"))
}

/// Writes the extended model of a declared robot as a declaration of its own.
fn write_declared(model: &dyn Hessian, report: &Report, out: &Path) -> Result<(), CliError> {
    let path = out.join("extended.rs");
    remove_stale(&path).map_err(|error| CliError::Write {
        path: path.clone(),
        error,
    })?;
    match declared(model, &report.extended) {
        Ok(text) => write(&path, &text),
        Err(error) => {
            output::print(&format!("no declaration of the extended model: {error}\n"));
            Ok(())
        }
    }
}

/// Share of a missing force from which a joint has a line of its own.
const WORTH: f64 = 0.1;

/// A few lines for the terminal: verdict, budget of the gap, gap, what else was found.
pub fn summary(d: &Diagnosis) -> String {
    let mut text = format!(
        "{}: {}, confidence {}\n",
        d.case,
        d.outcome().word(),
        number::probability(d.confidence)
    );
    for line in words::budget(d) {
        text.push_str(&format!("  {line}\n"));
    }
    text.push_str(&format!(
        "  gap {} -> {}, floor {}; {:.1} s\n",
        short(d.gap_before),
        short(d.gap_after),
        short(d.gap_floor),
        d.seconds
    ));
    for b in &d.beyond_tolerance {
        text.push_str(&format!("  outside its tolerance: {}\n", b.words()));
    }
    for gain in &d.loop_gains {
        text.push_str(&format!("  {}\n", gain.words()));
    }
    for m in d.remainder.iter().flat_map(|left| &left.missing_force) {
        if m.share > WORTH {
            text.push_str(&force("left", m));
        }
    }
    if !d.confusion_set.is_empty() {
        text.push_str(&format!(
            "  not told apart from: {}\n",
            d.confusion_set.join(", ")
        ));
    }
    for m in d.missing_force.iter().filter(|m| m.share > WORTH) {
        text.push_str(&force("missing force", m));
    }
    for s in &d.signals {
        let velocity = s.velocity.as_ref().map(|v| &v.timing);
        let paths = [
            ("input acts", s.input.as_ref()),
            ("velocity shows", velocity),
        ];
        for (what, a) in paths {
            if let Some((a, std)) = a.filter(|a| a.noticeable()).and_then(|a| Some((a, a.std?))) {
                text.push_str(&format!(
                    "  signals: {what} {} ms late at joint {} (stated {} ms)\n",
                    number::plus_minus(1e3 * a.delay, 1e3 * std),
                    s.joint,
                    short(1e3 * a.stated)
                ));
            }
        }
    }
    for warning in &d.warnings {
        text.push_str(&format!("  warning: {warning}\n"));
    }
    if let Some(n) = &d.next_experiment {
        text.push_str(&format!(
            "  next: next_experiment.csv separates {} and {}, expected log-likelihood ratio {:.1}\n",
            n.rivals.0, n.rivals.1, n.log_odds
        ));
    }
    text
}

/// A line on where a force lives.
fn force(what: &str, m: &Share) -> String {
    let along = m.quantity().map_or("no quantity".to_owned(), |quantity| {
        format!("{quantity} ({:.2})", m.explained)
    });
    let share = 100.0 * m.share;
    format!(
        "  {what}: {share:.0} % at joint {}, rms {}; goes with {along}\n",
        m.joint,
        short(m.rms)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_of_folders_of_one_name_do_not_meet() {
        let paths = ["runs/a/data", "runs/b/data", "runs/c"].map(PathBuf::from);
        let places = places(&paths);
        assert_eq!(places, ["runs_a_data", "runs_b_data", "c"]);
    }
}
