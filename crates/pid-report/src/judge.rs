//! From identified (or given) parameters to the report: free runs, missing forces, tables,
//! sentences.

use pid_data::{Dataset, Experiment, Horizon, Kind, Role};
use pid_fit::gap::force::{MissingForceError, MissingForceEstimate, States, missing_force};
use pid_fit::gap::metrics::{
    ChannelError, FreeRunError, FreeRunScore, FreeRunSettings, JointError, StartVelocity, free_run,
    free_run_table,
};
use pid_nlp::solver::Iteration;
use pid_page::number::short;
use pid_runtime::dynamics::Hessian;

use crate::findings::findings;
use crate::{
    Bound, CheckRow, DataSection, ForceRecord, ModelSection, OutcomeSection, ParameterRow, Report,
    SCHEMA_VERSION, Setting, StartRow, TraceBudget, Verdict, missing_force as condense, motion,
};

/// A model by its name, and by what its motions and forces are judged.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// Name.
    pub name: &'a str,
    /// What it is, in a few words.
    pub summary: &'a str,
    /// Where its values come from.
    pub source: &'a str,
    /// The model whose parameters are shown.
    pub model: &'a dyn Hessian,
    /// The model that is simulated, its records and its parameters: those without what is wrong
    /// with the readings.
    pub judged: (&'a dyn Hessian, &'a Dataset, &'a [f64]),
    /// Coordinates of it that are no joints. Where no sensor reads, there is nothing to compare a motion with.
    pub states: &'a States,
}

impl Subject<'_> {
    /// Keeps what belongs to coordinates that sensors read, by their names.
    pub(crate) fn keep_read<T>(&self, all: &mut Vec<T>, name: impl Fn(&T) -> &str) {
        self.keep(all, &self.states.unread, name);
    }

    /// Keeps what belongs to joints, by their names.
    pub(crate) fn keep_joints<T>(&self, all: &mut Vec<T>, name: impl Fn(&T) -> &str) {
        self.keep(all, &self.states.unread, &name);
        self.keep(all, &self.states.readings, &name);
    }

    fn keep<T>(&self, all: &mut Vec<T>, without: &[usize], name: impl Fn(&T) -> &str) {
        let joints = &self.judged.1.joints;
        let without: Vec<&str> = without.iter().map(|&j| &*joints[j].name).collect();
        all.retain(|own| !without.contains(&name(own)));
    }
}

/// Parameters that cannot be judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JudgeError {
    /// A free run.
    #[error(transparent)]
    FreeRun(#[from] FreeRunError),
    /// A missing force.
    #[error(transparent)]
    Force(#[from] MissingForceError),
}

/// Parameters and their origin.
pub struct Fit {
    /// Headline of the report.
    pub title: String,
    /// Where the parameters started.
    pub start: Vec<f64>,
    /// Their values.
    pub values: Vec<f64>,
    /// Standard deviations; `None` for parameters that are not determined one by one.
    pub deviations: Vec<Option<f64>>,
    /// Bounds of the identification, `-inf` and `inf` for none.
    pub lower: Vec<f64>,
    /// See `lower`.
    pub upper: Vec<f64>,
    /// Parameters that were held.
    pub fixed: Vec<bool>,
    /// Whether the result can be used.
    pub verdict: Verdict,
    /// The status in words.
    pub status: String,
    /// Objective, if something was minimised.
    pub objective: Option<f64>,
    /// Time, s.
    pub seconds: f64,
    /// Independent check of the point.
    pub checks: Vec<CheckRow>,
    /// Iterations of the best start, those that prepared it included.
    pub iterations: usize,
    /// Log of the best start.
    pub log: Vec<Iteration>,
    /// All starts.
    pub starts: Vec<StartRow>,
    /// Cut-off of the filter behind estimated states, Hz; `None` for the data's own.
    pub cutoff: Option<f64>,
    /// Settings as name and value.
    pub settings: Vec<Setting>,
    /// Remarks.
    pub notes: Vec<String>,
}

/// Horizons at which free runs are judged: short, one second, the whole record.
const HORIZONS: [Horizon; 3] = [
    Horizon::Seconds(0.1),
    Horizon::Seconds(1.0),
    Horizon::Record,
];
/// Horizon of the motion that is drawn.
const DRAWN: Horizon = Horizon::Seconds(1.0);

/// Free runs of a simulated record start at the recorded velocity. On a machine a single sample is
/// noisy, and they start at the filtered one.
fn free_run_settings(dataset: &Dataset, horizon: Horizon, cutoff: Option<f64>) -> FreeRunSettings {
    let start = match dataset.kind {
        Kind::Real => StartVelocity::Estimated,
        Kind::Simulated => StartVelocity::Recorded,
    };
    FreeRunSettings {
        start,
        cutoff,
        ..FreeRunSettings::new(horizon)
    }
}

/// Judges parameters on all records and puts everything into a report; `step` is told what it is at.
///
/// # Errors
/// [`JudgeError`]: a free run or a missing force that cannot be computed.
pub fn judge(subject: &Subject<'_>, fit: Fit, step: &dyn Fn(String)) -> Result<Report, JudgeError> {
    let (model, dataset, p) = subject.judged;
    let scores = free_runs(subject, &fit, step)?;
    let nq = dataset.nq();
    let budget = TraceBudget::shared_by(dataset.experiments.len() * nq * 5);
    let mut motions = Vec::new();
    let mut forces = Vec::new();
    let parameters = rows(subject.model, &fit);
    let mut notes = fit.notes;
    // Unseen motions first, since a model is made for them.
    let mut order: Vec<usize> = (0..dataset.experiments.len()).collect();
    order.sort_by_key(|i| dataset.experiments[*i].role != Role::Test);
    for experiment in order.iter().map(|i| &dataset.experiments[*i]) {
        step(format!("motion and missing force of {}", experiment.name));
        let run = free_run(
            model,
            p,
            dataset,
            experiment,
            &free_run_settings(dataset, DRAWN, fit.cutoff),
        )?;
        if let Some((window, error)) = run.diverged.first() {
            notes.push(format!(
                "{}: {} of its windows could not be simulated to their end; the first one, from {:.3} s: {error}",
                experiment.name,
                run.diverged.len(),
                experiment.t[window.start]
            ));
        }
        let how = format!("restarted every {DRAWN}");
        let mut motion = motion(dataset, experiment, &run, &how, budget);
        subject.keep_read(&mut motion.joints, |own| &own.joint);
        motions.push(motion);
        let force = missing_force(model, p, dataset, experiment, subject.states)?;
        forces.push((experiment, force));
    }
    let mut missing = condense(dataset, &records(&forces), budget);
    subject.keep_joints(&mut missing, |own| &own.joint);
    notes.push(force_note(subject, &forces));
    let mut data = DataSection::of(dataset);
    subject.keep_read(&mut data.joints, |own| &own.name);

    let dims = model.dims();
    let solving = fit.log.last().map_or(0, |i| i.iteration);
    Ok(Report {
        schema_version: SCHEMA_VERSION,
        program: format!("simtrue {}", env!("CARGO_PKG_VERSION")),
        title: fit.title,
        model: ModelSection {
            name: subject.name.to_owned(),
            source: format!("{}: {}. {}.", subject.name, subject.summary, subject.source),
            nq: dims.nq,
            nu: dims.nu,
            np: subject.model.dims().np,
        },
        data,
        settings: fit.settings,
        outcome: OutcomeSection {
            verdict: fit.verdict,
            status: fit.status,
            iterations: solving,
            preparing_iterations: fit.iterations.saturating_sub(solving),
            objective: fit.objective,
            seconds: fit.seconds,
            checks: fit.checks,
        },
        iterations: fit.log,
        findings: findings(&missing, &scores, &parameters),
        parameters,
        correlations: Vec::new(),
        starts: fit.starts,
        motions,
        free_run: scores,
        missing_force: missing,
        notes,
    })
}

/// Errors of free runs at several horizons.
fn free_runs(
    subject: &Subject<'_>,
    fit: &Fit,
    step: &dyn Fn(String),
) -> Result<Vec<FreeRunScore>, FreeRunError> {
    let (model, dataset, p) = subject.judged;
    let mut scores = Vec::new();
    for horizon in HORIZONS {
        step(format!("free run, horizon {horizon}"));
        let table = free_run_table(
            model,
            p,
            dataset,
            &free_run_settings(dataset, horizon, fit.cutoff),
        )?;
        scores.extend(table.roles);
        // Unseen motions also one by one, since they test different things.
        let unseen = table
            .experiments
            .into_iter()
            .filter(|s| s.role == Role::Test);
        let unseen: Vec<_> = unseen.collect();
        if unseen.len() > 1 {
            scores.extend(unseen);
        }
    }
    if !subject.states.unread.is_empty() {
        for score in &mut scores {
            subject.keep_read(&mut score.joints, |own| &own.joint);
            score.objective = objective(&score.joints);
        }
    }
    Ok(scores)
}

/// Mean square of positions and, where all joints have them, velocities.
fn objective(joints: &[JointError]) -> Option<f64> {
    let square = |c: &Option<ChannelError>| c.map(|e| e.rms * e.rms);
    let q: Option<f64> = joints.iter().map(|own| square(&own.q)).sum();
    let v: Option<f64> = joints.iter().map(|own| square(&own.v)).sum();
    q.map(|q| q + v.unwrap_or(0.0))
}

/// The parameters with their ranges and deviations.
fn rows(model: &dyn Hessian, fit: &Fit) -> Vec<ParameterRow> {
    model
        .params()
        .iter()
        .enumerate()
        .map(|(i, info)| {
            let (value, lower, upper) = (fit.values[i], fit.lower[i], fit.upper[i]);
            let room = 1e-6
                * if (upper - lower).is_finite() {
                    upper - lower
                } else {
                    value.abs()
                };
            let at_bound = if fit.fixed[i] {
                None
            } else if value - lower <= room {
                Some(Bound::Lower)
            } else if upper - value <= room {
                Some(Bound::Upper)
            } else {
                None
            };
            ParameterRow {
                name: info.name.to_string(),
                unit: info.unit.to_string(),
                doc: info.doc.to_string(),
                start: fit.start[i],
                value,
                deviation: fit.deviations[i].filter(|d| d.is_finite()),
                lower: lower.is_finite().then_some(lower),
                upper: upper.is_finite().then_some(upper),
                at_bound,
                fixed: fit.fixed[i],
                reference: Some(info.nominal),
            }
        })
        .collect()
}

/// Missing forces with the record that each belongs to.
type Forces<'a> = [(&'a Experiment, MissingForceEstimate)];

fn records<'a>(forces: &'a Forces<'_>) -> Vec<ForceRecord<'a>> {
    let record = |(e, f): &'a (&Experiment, MissingForceEstimate)| ForceRecord {
        experiment: &e.name,
        role: e.role,
        t: &f.t,
        q: &f.q,
        v: &f.v,
        w: &f.w,
        band: Some(&f.band),
        total: &f.total,
    };
    forces.iter().map(record).collect()
}

/// How the missing forces were found, and the noise beside them.
fn force_note(subject: &Subject<'_>, forces: &Forces<'_>) -> String {
    let noise = forces
        .iter()
        .map(|(e, f)| noise_in_words(subject, &e.name, f));
    format!(
        "The missing force w is the smoothest one that makes the model follow the record: measurement noise and the drift of w are weighed by their likelihood, and its band is two standard deviations given the record. Noise found: {}.",
        noise.collect::<Vec<_>>().join("; ")
    )
}

/// `train: q 0.0012 rad` for every joint.
fn noise_in_words(subject: &Subject<'_>, experiment: &str, force: &MissingForceEstimate) -> String {
    let noise = force.noise.position.iter().zip(&force.noise.velocity);
    let mut all: Vec<_> = subject.judged.1.joints.iter().zip(noise).collect();
    subject.keep_joints(&mut all, |(joint, _)| &joint.name);
    let joints: Vec<String> = (all.into_iter())
        .map(|(joint, (q, v))| {
            let velocity = match v.is_finite() {
                true => format!(", {} {}", short(*v), joint.velocity_unit()),
                false => String::new(),
            };
            format!("{} {} {}{velocity}", joint.name, short(*q), joint.unit())
        })
        .collect();
    let open = if force.settled { "" } else { " (not settled)" };
    format!("{experiment}: {}{open}", joints.join(", "))
}
