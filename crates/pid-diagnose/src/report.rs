//! A diagnosis with everything a report shows: where the gap lives, and the next experiment.

use std::path::{Path, PathBuf};

use pid_data::Dataset;
use pid_runtime::dynamics::Dynamics;

use crate::case::{Case, CaseError};
use crate::ceilings::{About, ceilings, raise};
use crate::channel::{self, inputs, readings};
use crate::diagnosis::Ceiling;
use crate::diagnosis::{Diagnosis, Next, Share, Signals, Verdict};
use crate::extended::extended;
use crate::fit::Fit;
use crate::locate::{MissingForce, locate, residual_force};
use crate::next::{Experiment, separate};
use crate::nominal::Nominal;
use crate::numerics;
use crate::outlier;
use crate::search::{Evidence, Settings, Surroundings, Watch, search, share};

/// A file of a report cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written: {source}", .path.display())]
pub struct WriteError {
    /// The file or folder.
    pub path: PathBuf,
    /// What the system says.
    pub source: std::io::Error,
}

/// Everything a report shows.
#[derive(Debug)]
pub struct Report {
    /// What the search found, with its fits.
    pub evidence: Evidence,
    /// What is said.
    pub diagnosis: Diagnosis,
    /// Where the gap lives; `None` with the reason if that cannot be said.
    pub place: Result<MissingForce, String>,
    /// The motion that separates the first two rivals; `None` where none is left or none can be run.
    pub next: Option<Experiment>,
    /// The nominal description with the effects named and the values found.
    pub extended: pid_interpret::nominal::Nominal,
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
        let started = std::time::Instant::now();
        let dataset = &*nominal.records(dataset);
        let case = Case::new(nominal, dataset)?;
        let mut evidence = search(&case, settings);
        evidence.started = started;
        // Equations of motion without the known effects, or position loops, would miss their forces.
        let plain = case.known.is_empty() && !case.nominal.description.has_servos();
        let place = match plain {
            true => locate(&evidence.case, &evidence.base, dataset).map_err(|e| e.to_string()),
            false => Ok(residual_force(&evidence.case, &evidence.base)),
        };
        let stopped = settings.watch.stopped();
        settings
            .watch
            .step("where the gap lives, and the next experiment");
        let rivals = rivals(&evidence, next).filter(|_| !stopped);
        let next = rivals.and_then(|(a, b)| separate(&evidence.case, a, b));
        let left = evidence
            .remainder
            .as_ref()
            .map(|_| shares(&residual_force(&evidence.case, &evidence.fit)));
        let ceilings = match stopped {
            true => [Vec::new(), Vec::new()],
            false => ceilings_of(&case, &evidence, &settings.watch),
        };
        let diagnosis = evidence.diagnosis(Surroundings {
            ceilings,
            missing_force: place.as_ref().map_or_else(|_| Vec::new(), shares),
            left_force: left.unwrap_or_default(),
            signals: signals(&case, &evidence.base),
            warnings: {
                let read = dataset.warnings.iter().map(ToString::to_string);
                let numerical = numerics::warnings(&evidence.case, &evidence.fit);
                let odd = read.chain(outlier::warnings(&case.outliers));
                let filter = channel::shared_lag_warning(&case);
                let cut = stopped.then(|| STOPPED.to_owned());
                let loops = case.loop_warnings.iter().cloned();
                odd.chain(loops)
                    .chain(filter)
                    .chain(numerical)
                    .chain(cut)
                    .collect()
            },
            next: next.as_ref().map(|e| Next {
                rivals: e.rivals.clone(),
                log_odds: e.least(),
            }),
        });
        Ok(Report {
            extended: extended(&case, &evidence),
            evidence,
            diagnosis,
            place,
            next,
        })
    }

    /// The verdict.
    pub fn diagnosis(&self) -> &Diagnosis {
        &self.diagnosis
    }
}

/// What is said of a search that was asked to stop.
const STOPPED: &str = "the search was stopped before its end: causes may be missing, and the verdict is that of what was found so far";

/// What any cause of a class can remove at most: of the gap before, and of what the named effects leave,
/// if they leave something; `case` has the levels of the sensors.
fn ceilings_of(case: &Case, found: &Evidence, watch: &Watch) -> [Vec<Ceiling>; 2] {
    watch.step("what any cause can remove at most");
    let mut records = found.case.clone();
    records.noise = case.noise.clone();
    let about = |fit, gap| {
        let floor = found.floor;
        ceilings(&About {
            case: &records,
            fit,
            gap,
            floor,
            watch,
        })
    };
    let left = found.remainder.is_some() && !found.effects.is_empty();
    let mut before = about(&found.base, &found.before);
    for (effect, joint, gap) in tried_alone(found) {
        let share = share(found.before.total, gap, found.floor);
        raise(&mut before, (effect, joint), share);
    }
    before.sort_by(|a, b| b.share.total_cmp(&a.share));
    [
        before,
        if left {
            about(&found.fit, &found.after)
        } else {
            Vec::new()
        },
    ]
}

/// Effects that were fitted with no other beside them: identifier, joint, and gap on the test records.
fn tried_alone(found: &Evidence) -> Vec<(&str, usize, f64)> {
    let rounds = found.rounds.iter().filter(|r| r.beside.is_empty());
    let tried = rounds.flat_map(|r| &r.candidates).filter_map(|c| {
        let (effect, joint) = c.label.split_once(':')?;
        Some((effect, joint.parse().ok()?, c.gap))
    });
    let only = match &found.effects[..] {
        [only] => only.joint.map(|j| (&*only.effect, j, found.after.total)),
        _ => None,
    };
    tried.chain(only).collect()
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

fn shares(place: &MissingForce) -> Vec<Share> {
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

/// The first two rivals: the likeliest candidate and the likeliest one beside it; the nominal
/// structure where nothing is named.
fn rivals(found: &Evidence, forced: bool) -> Option<(&Fit, &Fit)> {
    let first = found.rivals.first()?;
    let rival = found.criteria.rival;
    let probability = |i: usize| {
        let term = found.rivals[i].hypothesis.terms.last()?;
        let info = term.effect.info();
        found
            .ranking
            .iter()
            .find(|r| r.effect == info.id && r.joint == term.shown_joint())
            .map(|r| r.probability)
    };
    if found.verdict() == Verdict::Nothing {
        return (forced || probability(0)? > rival).then_some((&found.base, first));
    }
    // A second effect on top of the first is no rival of it.
    let own = first.hypothesis.terms.len();
    let other = (1..found.rivals.len()).find(|&i| found.rivals[i].hypothesis.terms.len() == own)?;
    (forced || probability(other)? > rival).then_some((first, &found.rivals[other]))
}
