//! A diagnosis with everything a report shows: where the gap lives, and the next experiment.

use std::path::{Path, PathBuf};

use pid_runtime::data::Dataset;
use pid_runtime::dynamics::Dynamics;
use serde::{Deserialize, Serialize};

use crate::case::{Case, CaseError};
use crate::channel::{Reading, inputs, readings};
use crate::diagnose::{Diagnosis, Found, Settings, investigate};
use crate::fit::Fit;
use crate::locate::{Place, locate, rest};
use crate::next::{Experiment, separate};
use crate::nominal::Nominal;
use crate::timing::Alignment;

/// A file of a report cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written: {source}", .path.display())]
pub struct WriteError {
    /// The file or folder.
    pub path: PathBuf,
    /// What the system says.
    pub source: std::io::Error,
}

/// Where the missing force of one joint lives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Joint from 1.
    pub joint: usize,
    /// Share in the squared missing force of all joints, each in units of its typical torque.
    pub share: f64,
    /// Root mean square of the missing force, N·m or N.
    pub rms: f64,
    /// The quantity it goes with most.
    pub regime: String,
    /// How far it is a function of that quantity and the direction, 0 to 1.
    pub explained: f64,
}

/// When the input of one joint acts, and when its velocity shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Signals {
    /// Joint from 1.
    pub joint: usize,
    /// The input against the force that moves the joint, all records; `None` where they tell nothing of it.
    pub input: Option<Alignment>,
    /// The velocity reading against the derivative of the positions, all records; `None` where no velocity is recorded.
    pub velocity: Option<Reading>,
}

/// How well a further motion would separate the first two rivals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Next {
    /// The rivals.
    pub rivals: (String, String),
    /// Expected logarithm of the likelihood ratio in favour of the right one, the lesser of both cases.
    pub log_odds: f64,
}

/// Probability beyond which a candidate counts as a rival that is left.
const LEFT: f64 = 0.01;

/// Everything a report shows.
#[derive(Debug)]
pub struct Report {
    /// The verdict and its fits.
    pub found: Found,
    /// Where the gap lives; `None` with the reason if that cannot be said.
    pub place: Result<Place, String>,
    /// The motion that separates the first two rivals; `None` where none is left or none can be run.
    pub next: Option<Experiment>,
}

impl Report {
    /// Reads a folder and diagnoses it. `next` asks for the next experiment even where no rival is left.
    ///
    /// # Errors
    /// As [`Case::read`].
    pub fn of_folder(folder: &Path, settings: &Settings, next: bool) -> Result<Self, CaseError> {
        let dataset = Dataset::read(folder)?;
        Self::new(Nominal::read(folder)?, &dataset, settings, next)
    }

    /// The same with the description in a file of its own.
    ///
    /// # Errors
    /// As [`Case::read`].
    pub fn of_files(
        folder: &Path,
        nominal: &Path,
        settings: &Settings,
        next: bool,
    ) -> Result<Self, CaseError> {
        let dataset = Dataset::read(folder)?;
        Self::new(Nominal::read_file(nominal)?, &dataset, settings, next)
    }

    /// Diagnoses the records of a folder with a declared robot in place of `nominal.toml`.
    ///
    /// # Errors
    /// As [`Nominal::of_declared`] and [`Case::new`].
    pub fn of_model(
        model: &dyn Dynamics,
        folder: &Path,
        settings: &Settings,
        next: bool,
    ) -> Result<Self, CaseError> {
        let dataset = Dataset::read(folder)?;
        Self::new(
            Nominal::of_declared(model, Some(folder))?,
            &dataset,
            settings,
            next,
        )
    }

    /// Diagnoses records with a declared robot; nothing is known of the measurement.
    ///
    /// # Errors
    /// As [`Nominal::of_declared`] and [`Case::new`].
    pub fn of_dataset(
        model: &dyn Dynamics,
        dataset: &Dataset,
        settings: &Settings,
        next: bool,
    ) -> Result<Self, CaseError> {
        Self::new(Nominal::of_declared(model, None)?, dataset, settings, next)
    }

    /// Diagnoses a data set of a nominal robot.
    ///
    /// # Errors
    /// As [`Case::new`].
    pub fn new(
        nominal: Nominal,
        dataset: &Dataset,
        settings: &Settings,
        next: bool,
    ) -> Result<Self, CaseError> {
        let clock = std::time::Instant::now();
        let case = Case::new(nominal, dataset)?;
        let mut found = investigate(&case, settings);
        let place = locate(&found.case, &found.base, dataset).map_err(|e| e.to_string());
        let next = rivals(&found, next).and_then(|(a, b)| separate(&found.case, a, b));
        if let Ok(place) = &place {
            found.diagnosis.missing_force = shares(place);
        }
        let read = dataset.warnings.iter().map(ToString::to_string);
        let numerical = crate::numerics::warnings(&found.case, &found.fit);
        found.diagnosis.warnings = read.chain(numerical).collect();
        found.diagnosis.signals = signals(&case, &found.base);
        if let Some(left) = &mut found.diagnosis.remainder {
            left.missing_force = shares(&rest(&found.case, &found.fit));
        }
        found.diagnosis.next_experiment = next.as_ref().map(|e| Next {
            rivals: e.rivals.clone(),
            log_odds: e.least(),
        });
        found.diagnosis.seconds = clock.elapsed().as_secs_f64();
        Ok(Report { found, place, next })
    }

    /// The verdict.
    pub fn diagnosis(&self) -> &Diagnosis {
        &self.found.diagnosis
    }

    /// Writes `report.html`, `next_experiment.csv` if there is one, and last `diagnosis.json`, so that a folder is complete when
    /// that is there.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), WriteError> {
        let at = |path: &Path| {
            let path = path.to_owned();
            move |source| WriteError { path, source }
        };
        std::fs::create_dir_all(out).map_err(at(out))?;
        let put = |name: &str, text: &str| {
            let path = out.join(name);
            std::fs::write(&path, text).map_err(at(&path))
        };
        put("report.html", &crate::page::page(self))?;
        if let Some(next) = &self.next {
            put("next_experiment.csv", &next.to_csv())?;
        }
        put("diagnosis.json", &self.diagnosis().to_json())
    }
}

fn signals(case: &Case, base: &Fit) -> Vec<Signals> {
    // Where the structure cannot be evaluated the missing force says why.
    let inputs = inputs(case, &base.point.theta).unwrap_or_else(|_| vec![None; case.n()]);
    let both = inputs.into_iter().zip(readings(case)).enumerate();
    both.map(|(j, (input, velocity))| Signals {
        joint: j + 1,
        input,
        velocity,
    })
    .collect()
}

fn shares(place: &Place) -> Vec<Share> {
    place
        .joints
        .iter()
        .zip(place.shares())
        .enumerate()
        .map(|(j, (p, share))| {
            let (axis, explained) = p.regime();
            Share {
                joint: j + 1,
                share,
                rms: p.rms,
                regime: axis.words().to_owned(),
                explained,
            }
        })
        .collect()
}

/// The first two rivals: the likeliest candidate and the likeliest one beside it; the nominal structure where nothing is named.
fn rivals(found: &Found, forced: bool) -> Option<(&Fit, &Fit)> {
    let first = found.rivals.first()?;
    let d = &found.diagnosis;
    let probability = |i: usize| {
        let term = found.rivals[i].hypothesis.terms.last()?;
        let info = term.effect.info();
        d.ranking
            .iter()
            .find(|r| r.effect == info.id && r.joint == term.shown_joint())
            .map(|r| r.probability)
    };
    if d.effect == "none" {
        return (forced || probability(0)? > LEFT).then_some((&found.base, first));
    }
    // A second effect on top of the first is no rival of it.
    let own = first.hypothesis.terms.len();
    let other = (1..found.rivals.len()).find(|&i| found.rivals[i].hypothesis.terms.len() == own)?;
    (forced || probability(other)? > LEFT).then_some((first, &found.rivals[other]))
}
