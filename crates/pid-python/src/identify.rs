//! Identification.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use simtrue::data::{Dataset, Horizon};
use simtrue::diagnosis::described::in_loops;
use simtrue::diagnosis::search::Listener;
use simtrue::diagnosis::servo;
use simtrue::diagnosis::with_effects::Assembled;
use simtrue::diagnosis::write::write_whole;
use simtrue::dynamics::Hessian;
use simtrue::fit::gap::force::States;
use simtrue::fit::ident::Settings;
use simtrue::fit::identify::{News, Request, by_rule, identify as identified};
use simtrue::interpret::nominal::Nominal;
use simtrue::report::Subject;

use crate::error::raised;
use crate::records::Records;
use crate::robot::Robot;
use crate::work::{Stops, Watch, run};

/// The report on an identification.
#[pyclass(frozen, module = "simtrue._simtrue")]
pub(crate) struct Fit {
    report: Arc<simtrue::report::Report>,
}

/// What an identification is asked for beside its records.
struct Asked {
    hold: Vec<String>,
    horizon: Option<Horizon>,
    starts: usize,
    seed: u64,
}

/// Identifies; the report, and whether Ctrl-C cut it short.
#[pyfunction]
#[pyo3(signature = (robot, records, *, hold=None, horizon=None, starts=1, seed=0, step=None))]
#[allow(clippy::too_many_arguments)] // keyword arguments of Python
pub(crate) fn identify(
    py: Python<'_>,
    robot: &Robot,
    records: &Records,
    hold: Option<Vec<String>>,
    horizon: Option<&str>,
    starts: usize,
    seed: u64,
    step: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Fit, bool)> {
    let asked = Asked {
        hold: hold.unwrap_or_default(),
        horizon: horizon
            .map(|text| text.parse().map_err(|e| raised(format!("horizon: {e}"))))
            .transpose()?,
        starts: starts.max(1),
        seed,
    };
    let opened = robot
        .read
        .as_ref()
        .clone()
        .with(records.found.as_ref().clone());
    let declared = robot.declared;
    let (report, cut) = run(py, Stops::WithWhatItHas, step, move |watch| {
        let dataset = opened.records.dataset;
        match declared {
            Some(model) => fitted(model, None, &dataset, &asked, watch),
            None => described(&opened.nominal, dataset, &asked, watch),
        }
    })?;
    let report = Arc::new(report);
    Ok((Fit { report }, cut))
}

/// A description with its effects: tolerances are bounds and priors, stated noise is that of the channels.
fn described(
    nominal: &Nominal,
    dataset: Dataset,
    asked: &Asked,
    watch: &Arc<Watch>,
) -> Result<simtrue::report::Report, String> {
    let (nominal, mut dataset) = match servo::only_targets(nominal, &dataset) {
        true => servo::commanded(nominal, &dataset).map_err(|e| e.to_string())?,
        // Effects that are stages of loops go with these, beside inputs of the motors.
        false => (in_loops(nominal).map_err(|e| e.to_string())?, dataset),
    };
    let with = Assembled::new(&nominal, &mut dataset).map_err(|e| e.to_string())?;
    fitted(
        with.model.as_ref(),
        Some((&nominal, &with)),
        &dataset,
        asked,
        watch,
    )
}

fn fitted(
    model: &dyn Hessian,
    nominal: Option<(&Nominal, &Assembled)>,
    dataset: &Dataset,
    asked: &Asked,
    watch: &Arc<Watch>,
) -> Result<simtrue::report::Report, String> {
    dataset.check_model(model).map_err(|e| e.to_string())?;
    let position = |name: &String| {
        let mut params = model.params().iter();
        params.position(|p| p.name == *name).ok_or_else(|| {
            let names: Vec<&str> = model.params().iter().map(|p| p.name.as_ref()).collect();
            format!(
                "hold: the robot has no parameter `{name}`\n  help: its parameters are {}",
                names.join(", ")
            )
        })
    };
    let request = Request {
        settings: Settings {
            horizon: asked.horizon.unwrap_or_else(|| by_rule(dataset)),
            // As the command: links of a description stay bodies.
            consistent: nominal.is_some(),
            hold: asked.hold.iter().map(position).collect::<Result<_, _>>()?,
            likelihood: nominal.map(|(nominal, with)| simtrue::cli::from_nominal(nominal, with)),
            starts: asked.starts,
            seed: asked.seed,
            ..Settings::default()
        },
        ..Request::default()
    };
    let tell = |news: &News<'_>| {
        if let News::Fit(i) = news {
            watch.step(&format!(
                "{} (start {} of {}): iteration {}, J = {:.6e}",
                i.phase,
                i.start + 1,
                i.starts,
                i.iteration.iteration,
                i.iteration.objective
            ));
        }
        match watch.stop() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    let found = identified(model, dataset, &request, &tell).map_err(|e| e.to_string())?;
    let best = found.identification.best();
    let subject = Subject {
        name: model.name(),
        summary: "",
        source: "",
        model,
        judged: (model, dataset, &best.parameters),
        states: nominal.map_or(States::NONE, |(_, with)| &with.states),
    };
    simtrue::report::report(&subject, dataset, &found, &|what| watch.step(&what))
        .map_err(|e| e.to_string())
}

#[pymethods]
impl Fit {
    /// The text of `fit.json`.
    fn to_json(&self) -> PyResult<String> {
        self.report.to_json().map_err(raised)
    }

    /// The page `report.html`.
    fn to_html(&self, py: Python<'_>) -> String {
        py.detach(|| self.report.to_html())
    }

    /// What the command prints.
    fn summary(&self) -> String {
        self.report.to_text()
    }

    /// Writes `fit.json` and `report.html`.
    fn save(&self, folder: PathBuf) -> PyResult<()> {
        let files = [
            ("fit.json", self.to_json()?),
            ("report.html", self.report.to_html()),
        ];
        let failed = |error| {
            raised(format!(
                "{}: cannot be written: {error}\n  help: choose another folder",
                folder.display()
            ))
        };
        std::fs::create_dir_all(&folder).map_err(failed)?;
        for (name, text) in files {
            write_whole(&folder.join(name), &text).map_err(failed)?;
        }
        Ok(())
    }
}
