//! `simtrue simulate`: a model with given parameters against the records.

use std::fmt::Write as _;
use std::time::Instant;

use pid_diagnose::extended::free_run_gap;
use pid_diagnose::nominal::Nominal;
use pid_diagnose::whole::whole_runs;
use pid_page::number::short;
use pid_report::{Fit, Setting, Verdict, judge};

use crate::args::SimulateArgs;
use crate::described::described;
use crate::error::CliError;
use crate::open::Opened;
use crate::progress::Progress;
use crate::{output, parameters, source};

/// Runs the command; the exit code.
pub(crate) fn run(args: &SimulateArgs) -> Result<u8, CliError> {
    let started = Instant::now();
    let progress = Progress::start("reading the data");
    let described = described(&args.source)?;
    let extended = match &described {
        Some(opened) => gap_with_effects(opened)?,
        None => None,
    };
    let loaded = match described {
        Some(opened) => source::load_described(opened, &args.source),
        None => source::load(&args.source),
    };
    let (entry, dataset) = match loaded {
        // The diagnosis's simulator takes effects that equations of motion do not.
        Err(CliError::Effect(obstacle)) if extended.is_some() => {
            drop(progress);
            output::print(&extended.unwrap_or_default());
            output::print(&format!("no report on equations of motion: {obstacle}\n"));
            return Ok(0);
        }
        loaded => loaded?,
    };
    let params = entry.model().params();
    let (values, origin) = match &args.parameters {
        Some(file) => (parameters::read(file, params)?, file.display().to_string()),
        None => (
            params.iter().map(|p| p.nominal).collect(),
            "nominal values".to_owned(),
        ),
    };
    let fit = Fit {
        title: format!(
            "{} with given parameters, against {}",
            entry.name, dataset.name
        ),
        start: values.clone(),
        deviations: vec![None; values.len()],
        lower: params.iter().map(|p| p.lower).collect(),
        upper: params.iter().map(|p| p.upper).collect(),
        fixed: vec![true; values.len()],
        values,
        verdict: Verdict::Fair,
        status: "parameters were given, nothing was identified".into(),
        objective: None,
        seconds: 0.0,
        checks: Vec::new(),
        iterations: 0,
        log: Vec::new(),
        starts: Vec::new(),
        cutoff: None,
        settings: vec![Setting::new("parameters", origin)],
        notes: Vec::new(),
    };
    let given = fit.values.clone();
    let subject = entry.subject(&dataset, &given);
    let mut report = judge(&subject, fit, &|what| progress.step(what))?;
    report.outcome.seconds = started.elapsed().as_secs_f64();
    drop(progress);
    source::deliver(&report, &args.source.out, false)?;
    output::print(&extended.unwrap_or_default());
    Ok(0)
}

/// The free-run gap by the simulator of `simtrue diagnose`, in words, of a nominal description with effects
/// or position loops.
fn gap_with_effects(opened: &Opened) -> Result<Option<String>, CliError> {
    let nominal = opened.nominal.clone();
    if nominal.effects().is_empty() && nominal.simulated().is_none() && !nominal.has_servos() {
        return Ok(None);
    }
    let names: Vec<String> = nominal
        .effects()
        .iter()
        .map(|e| e.id.value.clone())
        .collect();
    let gap = free_run_gap(Nominal::new(nominal), &opened.records.dataset)?;
    let with = match names.is_empty() {
        true => "no effect".to_owned(),
        false => names.join(", "),
    };
    let joints = gap.joints.iter().enumerate().map(|(j, (q, v))| {
        let velocity = v.map_or(String::new(), |v| format!(", velocity {}", short(v)));
        format!("  joint {}: position {}{velocity}\n", j + 1, short(*q))
    });
    Ok(Some(format!(
        "free-run gap by the simulator of the diagnosis, with {with}: {}\n{}{}",
        short(gap.total),
        joints.collect::<String>(),
        strayed(opened)?
    )))
}

/// Errors of its free runs over whole records, in words.
fn strayed(opened: &Opened) -> Result<String, CliError> {
    let nominal = Nominal::new(opened.nominal.clone());
    let joints = &opened.records.dataset.joints;
    let mut out = "whole records, positions: root mean square and mean of the error\n".to_owned();
    for run in whole_runs(nominal, &opened.records.dataset)? {
        let own = run.joints.iter().zip(joints).map(|(own, joint)| {
            let (rms, mae, unit) = (short(own.rms), short(own.mae), joint.unit());
            format!("{} {rms}, {mae} {unit}", joint.name)
        });
        let own: Vec<String> = own.collect();
        let role = run.role.to_string();
        let _ = writeln!(out, "  {role:<5} {:<16}  {}", run.record, own.join("; "));
    }
    Ok(out)
}
