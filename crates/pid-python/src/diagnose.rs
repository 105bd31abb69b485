//! Check and diagnosis.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use simtrue::cli::open::{Opened, wrong};
use simtrue::diagnosis::nominal::Nominal;
use simtrue::diagnosis::report;
use simtrue::diagnosis::search::{Settings, Watch};

use crate::error::raised;
use crate::records::{Records, positive};
use crate::robot::Robot;
use crate::work::{Stops, run};

/// Checks records against a robot; the findings as JSON.
#[pyfunction]
pub(crate) fn check(py: Python<'_>, robot: &Robot, records: &Records) -> PyResult<String> {
    let opened = opened(robot, records);
    let work = move |_: &_| {
        let settings = simtrue::preflight::Settings::default();
        let found = simtrue::preflight::check(&opened.records.dataset, &opened.nominal, &settings);
        serde_json::to_string(&found)
    };
    Ok(run(py, Stops::Never, None, work)?.0)
}

fn opened(robot: &Robot, records: &Records) -> Opened {
    let robot = robot.read.as_ref().clone();
    robot.with(records.found.as_ref().clone())
}

/// A diagnosis with everything its page shows.
#[pyclass(frozen, module = "simtrue._simtrue")]
pub(crate) struct Report {
    report: Arc<report::Report>,
}

/// Diagnoses; the report, and whether Ctrl-C cut it short.
#[pyfunction]
#[pyo3(signature = (robot, records, *, anyway=false, next=false, joint_seconds=None, refit_all=false, step=None))]
#[allow(clippy::too_many_arguments)] // keyword arguments of Python
pub(crate) fn diagnose(
    py: Python<'_>,
    robot: &Robot,
    records: &Records,
    anyway: bool,
    next: bool,
    joint_seconds: Option<f64>,
    refit_all: bool,
    step: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Report, bool)> {
    let opened = opened(robot, records);
    let joint_seconds = positive("joint_seconds", joint_seconds)?;
    let (report, cut) = run(py, Stops::WithWhatItHas, step, move |watch| {
        let wrong = if anyway { Vec::new() } else { wrong(&opened) };
        if !wrong.is_empty() {
            let lines: Vec<String> = wrong.iter().map(ToString::to_string).collect();
            return Err(format!(
                "{} findings contradict the robot\n{}\n  help: mend the records or the robot; anyway=True goes on with the records as they are",
                wrong.len(),
                lines.join("\n")
            ));
        }
        let defaults = Settings::default();
        let settings = Settings {
            refit_all,
            joint_seconds: joint_seconds.unwrap_or(defaults.joint_seconds),
            watch: Watch::new(watch.clone()),
            ..defaults
        };
        let nominal = Nominal::new(opened.nominal);
        report::Report::new(nominal, &opened.records.dataset, &settings, next)
            .map_err(|e| e.to_string())
    })?;
    let report = Report {
        report: Arc::new(report),
    };
    Ok((report, cut))
}

#[pymethods]
impl Report {
    /// The text of `diagnosis.json`.
    fn to_json(&self) -> String {
        self.report.diagnosis.to_json()
    }

    /// The page `report.html`.
    fn to_html(&self, py: Python<'_>) -> String {
        py.detach(|| self.report.to_html())
    }

    /// What the command prints.
    fn summary(&self) -> String {
        simtrue::cli::summary(&self.report.diagnosis)
    }

    /// `extended.toml`: the robot with the effects found; `None` if no file can state it.
    fn extended(&self) -> Option<String> {
        self.report.extended.to_toml()
    }

    /// Writes the files of the report.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        py.detach(|| self.report.write(&folder)).map_err(raised)
    }
}
