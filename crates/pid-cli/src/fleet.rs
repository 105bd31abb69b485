//! `simtrue fleet`: many logs of many units, on any engine that runs commands.

use std::path::{Path, PathBuf};
use std::time::Instant;

use pid_data::Dataset;
use pid_diagnose::with_effects::Assembled;
use pid_fleet::{Estimator, Fleet, FleetError, Job, Plan, Slice};
use pid_interpret::nominal::Nominal;
use rayon::ThreadPoolBuilder;

use crate::args::fleet::{CollectArgs, FleetArgs, FleetCommand, PlanArgs, RunArgs, of_reading};
use crate::args::open::OpenArgs;
use crate::error::{CliError, write};
use crate::open::{Robot, read_robot};
use crate::output;
use crate::progress::{Interrupt, Progress};

/// Logs that a plan is made from.
const LOOKED_AT: usize = 12;
/// Logs of a slice, unless stated otherwise: starting the command is then below a hundredth of it.
const PER_SLICE: usize = 1000;
/// Exit code of a summary that lacks logs.
const INCOMPLETE: u8 = 3;
/// Exit code of `--exit-code` where a unit stands out.
const STANDS_OUT: u8 = 10;
/// Exit code after Ctrl-C.
const INTERRUPTED: u8 = 130;

/// Runs the command; the exit code.
pub(crate) fn run(args: &FleetArgs) -> Result<u8, CliError> {
    match &args.command {
        FleetCommand::Plan(args) => plan(args),
        FleetCommand::Run(args) => measure(args),
        FleetCommand::Collect(args) => collect(args),
    }
}

fn plan(args: &PlanArgs) -> Result<u8, CliError> {
    let progress = Progress::start("listing the logs");
    let (jobs, dates) = pid_fleet::logs::find(&args.logs)?;
    let robot = read_robot(&args.robot, &args.of_robot())?;
    let text = robot.nominal.to_toml().ok_or(CliError::FleetRobot)?;
    let reading = args.reading();
    let open = of_reading(&reading).map_err(CliError::FleetReading)?;
    progress.step("looking at some logs");
    let logs = some_logs(&jobs, &robot, &open)?;
    let model = model(&robot.nominal, &logs[0])?;
    for log in &logs {
        log.check_model(model.model.as_ref())?;
    }
    let plan = Plan {
        dates,
        ..pid_fleet::design::design(
            &robot.nominal,
            model.model.as_ref(),
            &logs,
            args.cutoff,
            reading,
        )?
    };
    crate::error::make_folder(&args.out)?;
    let folder = std::fs::canonicalize(&args.out).map_err(|error| CliError::Write {
        path: args.out.clone(),
        error,
    })?;
    let fleet = Fleet { folder, plan, jobs };
    fleet.write(&text)?;
    let slices = args.slices.unwrap_or(fleet.jobs.len().div_ceil(PER_SLICE));
    write(
        &fleet.folder.join("slurm.sh"),
        &slurm(&fleet.folder, slices),
    )?;
    drop(progress);
    output::print(&planned(&fleet, slices));
    Ok(0)
}

/// Some logs, spread evenly over the list; those that cannot be opened are told and left out.
fn some_logs(jobs: &[Job], robot: &Robot, open: &OpenArgs) -> Result<Vec<Dataset>, CliError> {
    let count = jobs.len().min(LOOKED_AT);
    let mut logs = Vec::new();
    for k in 0..count {
        let log = &jobs[k * jobs.len() / count].log;
        match dataset(log, robot, open) {
            Ok(dataset) => logs.push(dataset),
            Err(why) => output::message(&format!("warning: {}: {why}", log.display())),
        }
    }
    match logs.is_empty() {
        true => Err(CliError::FleetNoLog { number: count }),
        false => Ok(logs),
    }
}

/// A log as a data set of the robot, the whole of it to be measured.
fn dataset(log: &Path, robot: &Robot, open: &OpenArgs) -> Result<Dataset, String> {
    let found = match log.join("dataset.toml").is_file() {
        true => robot.folder(log, open).map_err(|e| e.to_string())?,
        false => {
            let read = pid_logs::open(log).map_err(|e| e.to_string())?;
            robot.records(&read, open).map_err(|e| e.to_string())?
        }
    };
    Ok(found.dataset)
}

/// The model of the description with its effects.
fn model(nominal: &Nominal, log: &Dataset) -> Result<Assembled, CliError> {
    if nominal.effects().is_empty() {
        return Ok(Assembled::without_effects(nominal)?);
    }
    let with = Assembled::new(nominal, &mut log.clone())?;
    match with.read.is_some() {
        true => Err(FleetError::States.into()),
        false => Ok(with),
    }
}

/// A word of a shell's command line.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', "'\\''"))
}

/// The script of an array of Slurm.
fn slurm(folder: &Path, slices: usize) -> String {
    format!(
        "#!/bin/sh\n#SBATCH --job-name=simtrue-fleet\n#SBATCH --array=1-{slices}\n#SBATCH --ntasks=1\n#SBATCH --cpus-per-task=1\n#SBATCH --requeue\nexec simtrue fleet run {} --slice \"$SLURM_ARRAY_TASK_ID/{slices}\"\n",
        quoted(folder)
    )
}

/// What was planned, and the lines that run it.
fn planned(fleet: &Fleet, slices: usize) -> String {
    let mut units: Vec<&str> = fleet.jobs.iter().map(|j| j.unit.as_str()).collect();
    units.sort_unstable();
    units.dedup();
    let folder = quoted(&fleet.folder);
    let names: Vec<&str> = fleet
        .plan
        .quantities
        .iter()
        .map(|q| q.name.as_str())
        .collect();
    // The shell of a task reads its number and makes way for the command, which then dies with its
    // worker. Quotes of the folder stand within those of the task.
    let task = format!("exec simtrue fleet run {folder} --slice $HQ_TASK_ID/{slices}")
        .replace('\'', "'\\''");
    format!(
        "{} logs of {} units; filter {} Hz; {} quantities: {}\n\n\
         one machine   simtrue fleet run {folder} --threads 0\n\
         GNU parallel  seq {slices} | parallel simtrue fleet run {folder} --slice {{}}/{slices}\n\
         HyperQueue    hq submit --array 1-{slices} -- sh -c '{task}'\n\
         Slurm         sbatch --array=1-{slices} {}\n\
         then          simtrue fleet collect {folder}\n",
        fleet.jobs.len(),
        units.len(),
        fleet.plan.cutoff,
        names.len(),
        names.join(", "),
        quoted(&fleet.folder.join("slurm.sh")),
    )
}

fn measure(args: &RunArgs) -> Result<u8, CliError> {
    let started = Instant::now();
    let fleet = Fleet::read(&args.folder)?;
    let jobs: Vec<usize> = match args.job {
        Some(job) if job < fleet.jobs.len() => vec![job],
        Some(job) => {
            let jobs = fleet.jobs.len();
            return Err(CliError::FleetJob { job, jobs });
        }
        None => args
            .slice
            .unwrap_or(Slice::ALL)
            .of(fleet.jobs.len())
            .collect(),
    };
    let robot = Robot::described(Nominal::read(fleet.folder.join("nominal.toml"))?);
    let open = of_reading(&fleet.plan.reading).map_err(CliError::FleetReading)?;
    let model = match robot.nominal.effects().is_empty() {
        true => Assembled::without_effects(&robot.nominal)?,
        false => model(&robot.nominal, &some_logs(&fleet.jobs, &robot, &open)?[0])?,
    };
    let model = model.model.as_ref();
    let estimator = Estimator::new(model, &fleet.plan).map_err(FleetError::from)?;
    let opened = |path: &Path| {
        let dataset = dataset(path, &robot, &open)?;
        dataset.check_model(model).map_err(|e| e.to_string())?;
        Ok(dataset)
    };
    let (interrupt, progress) = (Interrupt::listen(), Progress::start("measuring"));
    let watch = |done: usize| {
        progress.step(format!("{done} of {} logs", jobs.len()));
        progress.done(done as f64 / jobs.len() as f64);
        !interrupt.requested()
    };
    let pool = ThreadPoolBuilder::new().num_threads(args.threads).build();
    let all = || pid_fleet::run(&fleet, &estimator, &jobs, &opened, &watch);
    // Without threads of its own, the run takes those of the process.
    let done = pool.map_or_else(|_| all(), |pool| pool.install(all))?;
    drop(progress);
    for (job, why) in &done.failed {
        let log = fleet.jobs[*job].log.display().to_string();
        output::message(&format!("warning: job {job}, {log}: {why}"));
    }
    let seconds = started.elapsed().as_secs_f64();
    output::print(&format!(
        "{} logs: {} measured, {} were done, {} tell nothing; {seconds:.3} s, {:.3} s of them with logs\n",
        jobs.len(),
        done.measured,
        done.kept,
        done.failed.len(),
        done.busy.as_secs_f64()
    ));
    Ok(match interrupt.requested() {
        true => INTERRUPTED,
        false => 0,
    })
}

fn collect(args: &CollectArgs) -> Result<u8, CliError> {
    let progress = Progress::start("reading the results");
    let fleet = Fleet::read(&args.folder)?;
    let summary = pid_fleet::collect(&fleet, args.rate)?;
    let nominal = Nominal::read(fleet.folder.join("nominal.toml"))?;
    drop(progress);
    let at = |name: &str| fleet.folder.join(name);
    let settings = format!(
        "filter {} Hz; false ones among named units: {}",
        fleet.plan.cutoff, args.rate
    );
    write(&at("report.html"), &summary.to_html(&settings))?;
    let mut written: Vec<PathBuf> = vec![at("fleet.json"), at("report.html")];
    output::print(&summary.in_words());
    if let Some((text, kept)) = pid_fleet::prior(&nominal, &fleet.plan, &summary) {
        write(&at("prior.toml"), &text)?;
        written.push(at("prior.toml"));
        if !kept.is_empty() {
            output::print(&format!(
                "\nprior.toml keeps as stated: {}\n",
                kept.join(", ")
            ));
        }
    }
    let text = serde_json::to_string_pretty(&summary).map_err(CliError::Json)?;
    write(&at("fleet.json"), &text)?;
    output::print("\n");
    for path in written {
        output::print(&format!("written: {}\n", path.display()));
    }
    let named = summary.standing_out().next().is_some();
    Ok(match (summary.gaps.is_empty(), args.exit_code && named) {
        (false, _) => INCOMPLETE,
        (true, true) => STANDS_OUT,
        (true, false) => 0,
    })
}
