//! `simtrue simulate`: a model with given parameters against the records.

use std::time::Instant;

use pid_report::{Setting, Verdict};

use crate::args::SimulateArgs;
use crate::assemble::{Fit, assemble};
use crate::error::CliError;
use crate::progress::Progress;
use crate::{parameters, source};

/// Runs the command; the exit code.
pub(crate) fn run(args: &SimulateArgs) -> Result<u8, CliError> {
    let started = Instant::now();
    let progress = Progress::start("reading the data");
    let (entry, dataset) = source::load(&args.source)?;
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
    let mut report = assemble(&entry, &dataset, fit, &progress)?;
    report.outcome.seconds = started.elapsed().as_secs_f64();
    drop(progress);
    source::deliver(&report, &args.source.out)?;
    Ok(0)
}
