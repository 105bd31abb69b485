//! The report on an identification: its parameters judged, its settings and intervals in words.

use pid_data::{Dataset, Horizon, Role};
use pid_fit::gap::force::States;
use pid_fit::ident::bootstrap::Bootstrap;
use pid_fit::ident::{
    CandidateScore, ForceError, Identification, InitialState, Method, Profile, Run, Settings,
    Weighting,
};
use pid_fit::identify::{Consistency, HorizonChoice, Identified};
use pid_fit::transcribe::Curvature;
use pid_nlp::solver::{Algorithm, Status};
use pid_page::number;
use pid_runtime::dynamics::ParamInfo;

use crate::judge::{Fit, JudgeError, Subject, judge};
use crate::{CheckRow, Correlation, Report, Setting, StartRow, Verdict};

/// The independent check accepts this constraint violation and stationarity.
const FEASIBLE: f64 = 1e-6;
const STATIONARY: f64 = 1e-4;

/// Judges an identification on all records; `step` is told what it is at.
///
/// `dataset`: the records it was made from, those of the subject's model.
///
/// # Errors
/// As [`judge`].
pub fn report(
    subject: &Subject<'_>,
    dataset: &Dataset,
    found: &Identified,
    step: &dyn Fn(String),
) -> Result<Report, JudgeError> {
    let Identified {
        identification,
        settings,
        ..
    } = found;
    let params = subject.model.params();
    let best = identification.best();
    let fit = Fit {
        title: format!("{} identified on {}", subject.name, dataset.name),
        start: best.start.clone(),
        values: best.parameters.clone(),
        deviations: identification.deviations.clone(),
        lower: identification.lower.clone(),
        upper: identification.upper.clone(),
        fixed: identification.fixed.clone(),
        verdict: verdict(best),
        status: best.status.reason().to_owned(),
        objective: best.objective.is_finite().then_some(best.objective),
        seconds: found.seconds,
        checks: checks(best),
        iterations: best.iterations,
        log: best.log.clone(),
        starts: identification.runs.iter().map(start_row).collect(),
        cutoff: settings.cutoff,
        settings: in_words(settings, identification),
        notes: (found.horizon.iter().map(horizon_note))
            .chain(notes(identification, params))
            .collect(),
    };
    let mut report = judge(subject, fit, step)?;
    report.correlations = correlations(identification, params);
    let more = &mut report.findings;
    more.extend(force_findings(&identification.force_error));
    more.extend(optima(identification));
    more.extend(noise_finding(
        identification,
        settings,
        dataset,
        subject.states,
    ));
    more.extend(found.consistency.iter().map(consistency_finding));
    let drawn = found.bootstrap.iter();
    more.extend(drawn.flat_map(|drawn| bootstrap_findings(params, drawn)));
    let profiles = found.profiles.iter();
    more.extend(profiles.map(|(j, profile)| profile_finding(&params[*j], profile)));
    if settings.method == Method::FullDiscretization
        && let Some(sentence) = hidden_error(settings, best, &report)
    {
        report.findings.insert(0, sentence);
    }
    Ok(report)
}

/// Correlations of all pairs of parameters that have deviations.
fn correlations(found: &Identification, params: &[ParamInfo]) -> Vec<Correlation> {
    let Some(covariance) = &found.covariance else {
        return Vec::new();
    };
    let known = |i: &usize| found.deviations[covariance.free[*i]].is_some();
    let known: Vec<usize> = (0..covariance.free.len()).filter(known).collect();
    let name = |i: usize| params[covariance.free[i]].name.to_string();
    let mut out = Vec::new();
    for (at, &k) in known.iter().enumerate() {
        for &i in &known[..at] {
            let value = covariance.correlation(i, k);
            if value.is_finite() {
                out.push(Correlation(name(i), name(k), value.clamp(-1.0, 1.0)));
            }
        }
    }
    out
}

/// Whether the result of a start can be used.
pub fn verdict(run: &Run) -> Verdict {
    let sound = run.check.finite
        && run.check.primal_inf <= FEASIBLE
        && run.check.bound_violation <= FEASIBLE;
    match (sound, run.status) {
        (true, Status::Solved | Status::Acceptable) => Verdict::Good,
        (true, _) => Verdict::Fair,
        (false, _) => Verdict::Bad,
    }
}

fn checks(run: &Run) -> Vec<CheckRow> {
    let row = |name: &str, value: f64, tolerance: f64| CheckRow {
        name: name.to_owned(),
        value,
        tolerance,
    };
    vec![
        row(
            "largest violation of a step",
            run.check.primal_inf,
            FEASIBLE,
        ),
        row(
            "largest violation of a bound",
            run.check.bound_violation,
            FEASIBLE,
        ),
        row(
            "stationarity (natural residual)",
            run.check.dual_inf,
            STATIONARY,
        ),
    ]
}

fn start_row(run: &Run) -> StartRow {
    StartRow {
        index: run.index,
        objective: run.objective.is_finite().then_some(run.objective),
        iterations: run.iterations,
        seconds: run.seconds,
        status: run.status.reason().to_owned(),
    }
}

fn in_words(settings: &Settings, found: &Identification) -> Vec<Setting> {
    let mut rows = Vec::new();
    match settings.method {
        Method::EquationError => {
            rows.push(Setting::new(
                "method",
                "equation error (weighted least squares)",
            ));
            rows.push(Setting::new("samples", found.windows.1));
        }
        _ => rows.extend(program_in_words(settings, found)),
    }
    if settings.starts > 1 {
        rows.push(Setting::new(
            "starts",
            format!("{} (seed {})", settings.starts, settings.seed),
        ));
    }
    rows
}

/// How the program was made and solved, for the methods that solve one.
fn program_in_words(settings: &Settings, found: &Identification) -> Vec<Setting> {
    let mut rows = Vec::new();
    match settings.method {
        Method::Shooting => {
            let nodes = match settings.nodes {
                1 => "single shooting".to_owned(),
                n => format!("multiple shooting, {n} nodes a window"),
            };
            rows.push(Setting::new("method", nodes));
        }
        _ => rows.push(Setting::new("method", "full discretization")),
    }
    match settings
        .adaptive
        .filter(|_| settings.method == Method::Shooting)
    {
        Some(a) => rows.push(Setting::new(
            "integration",
            format!(
                "Dormand-Prince, controlled steps, relative tolerance {:e}",
                a.rtol
            ),
        )),
        None => rows.push(Setting::new("scheme", settings.scheme.label())),
    }
    if settings.substeps > 1 {
        rows.push(Setting::new("steps per sample", settings.substeps));
    }
    rows.push(Setting::new(
        "Hessian",
        match (settings.quasi_newton, settings.curvature) {
            (Some(usize::MAX), _) => "damped BFGS".to_owned(),
            (Some(steps), _) => format!("damped BFGS from the last {steps} steps"),
            (None, Curvature::Exact) => "exact".to_owned(),
            (None, _) => "Gauss-Newton".to_owned(),
        },
    ));
    rows.push(Setting::new(
        "solver",
        match settings.algorithm {
            Algorithm::Sqp => "sequential quadratic programming",
            _ => "interior point",
        },
    ));
    rows.push(Setting::new("horizon", settings.horizon));
    rows.push(Setting::new(
        "initial states",
        match settings.initial_state {
            InitialState::Free => "unknowns of the fit",
            InitialState::Measured => "held at the data",
        },
    ));
    rows.push(Setting::new(
        "weights",
        match settings.weighting {
            _ if settings.likelihood.is_some() => "one over the variance of the noise",
            Weighting::Unit => "1 for every channel",
            Weighting::Spread => "one over the variance of each channel",
            Weighting::Record => "positions, by one over their variance in their own record",
            Weighting::Position => "positions only",
        },
    ));
    let (n, m) = found.size;
    let (windows, samples) = found.windows;
    rows.push(Setting::new(
        "program",
        format!("{n} variables, {m} constraints; {windows} windows, {samples} samples"),
    ));
    rows
}

/// How the horizon was chosen.
fn horizon_note(choice: &HorizonChoice) -> String {
    let one = |(horizon, score): &(Horizon, CandidateScore)| {
        let folds = score.folds.iter();
        let folds: Vec<String> = folds.map(|(name, s)| format!("{name} {s:.4}")).collect();
        // `1 s: 0.0312 (both_a 0.03, …)`.
        format!("{horizon}: {:.4} ({})", score.score, folds.join(", "))
    };
    let words: Vec<String> = choice.scores.iter().map(one).collect();
    format!(
        "The horizon was chosen by cross validation over the training records (left-out records, free runs restarted every {}, RMS error over spread): {}.",
        choice.judged,
        words.join("; ")
    )
}

/// What positive densities cost and bring.
fn consistency_finding(c: &Consistency) -> String {
    let mut sentence = format!(
        "Physical consistency: {} in log-Cholesky coordinates; J = {}, {} without. Random poses with an indefinite mass matrix: {:.2} % of {}, {:.2} % without.",
        c.links.join(", "),
        number::value(c.objective.0),
        number::value(c.objective.1),
        100.0 * c.indefinite.0,
        c.poses,
        100.0 * c.indefinite.1
    );
    if c.lost_priors > 0 {
        sentence.push_str(&format!(
            " {} priors of these links' parameters have no form in coordinates and were left out.",
            c.lost_priors
        ));
    }
    sentence
}

fn bootstrap_findings(params: &[ParamInfo], drawn: &Bootstrap) -> Vec<String> {
    let (good, bad) = drawn.draws;
    let mut lines = vec![format!(
        "Block bootstrap over windows: {good} draws, {bad} did not converge and were left out."
    )];
    let found = params.iter().zip(&drawn.intervals).zip(&drawn.deviations);
    lines.extend(found.filter_map(|((info, interval), deviation)| {
        let ((low, high), deviation) = ((*interval)?, (*deviation)?);
        let (low, high) = number::interval(low, high)?;
        Some(format!(
            "Bootstrap of {}: 95 % interval {low} … {high} {}, standard deviation {}.",
            info.name,
            info.unit,
            number::short(deviation)
        ))
    }));
    lines
}

fn profile_finding(info: &ParamInfo, found: &Profile) -> String {
    let side = |end: Option<f64>, word: &str| {
        end.map_or_else(|| format!("its {word} bound"), number::value)
    };
    format!(
        "Profile likelihood of {}: 95 % interval {} … {} {} ({} fits).",
        info.name,
        side(found.lower, "lower"),
        side(found.upper, "upper"),
        info.unit,
        found.fits
    )
}

/// Noise levels of a fit by likelihood.
fn noise_finding(
    found: &Identification,
    settings: &Settings,
    data: &Dataset,
    states: &States,
) -> Option<String> {
    settings.likelihood.as_ref()?;
    let nq = data.nq();
    let levels: Vec<String> = found
        .noise
        .iter()
        .enumerate()
        .filter(|(c, _)| !states.unread.contains(&(c % nq)))
        // The position behind a velocity that lags is read nowhere.
        .filter(|(c, _)| !states.readings.contains(c))
        .filter_map(|(c, level)| {
            let letter = if c < nq { "q" } else { "dq" };
            Some(format!(
                "{} {letter} {}",
                data.joints[c % nq].name,
                number::short((*level)?)
            ))
        })
        .collect();
    Some(format!(
        "Standard deviation of the residuals, as the loss measures it: {}.",
        levels.join(", ")
    ))
}

/// Parameters that change together without a change of the fit.
fn open_direction(
    direction: &[(usize, f64)],
    found: &Identification,
    params: &[ParamInfo],
) -> String {
    let parts: Vec<String> = direction
        .iter()
        .map(|&(j, share)| {
            let width = found.upper[j] - found.lower[j];
            match width.is_finite() {
                true => format!(
                    "{} {:+.3e} {}",
                    params[j].name,
                    share * width,
                    params[j].unit
                ),
                false => format!("{} {share:+.2} of its scale", params[j].name),
            }
        })
        .collect();
    parts.join(", ")
}

fn notes(found: &Identification, params: &[ParamInfo]) -> Vec<String> {
    let mut notes = found.notes.clone();
    if found.undetermined > 0 {
        notes.push(format!(
            "{} direction{} in parameter space {} not determined by these data; the parameters they touch have no standard deviation.",
            found.undetermined,
            if found.undetermined == 1 { "" } else { "s" },
            if found.undetermined == 1 { "is" } else { "are" },
        ));
    }
    notes.extend(
        found
            .open
            .iter()
            .map(|direction| match direction.as_slice() {
                [(alone, _)] => format!(
                    "Not determined: {} (the records hardly depend on it).",
                    params[*alone].name
                ),
                together => format!(
                    "Not determined: {} (change together, in proportion).",
                    open_direction(together, found, params)
                ),
            }),
    );
    if found.sandwich {
        notes.push("Standard deviations are of the sandwich form, from the scatter of the windows' gradients.".to_owned());
        return notes;
    }
    notes.push(format!(
        "Standard deviations come from the exact reduced Hessian at the solution and the residual variance, times {:.3} for residuals that are correlated in time; they do not cover what the model lacks.",
        found.correlation_factor.sqrt()
    ));
    notes
}

/// Number of optima that the starts reached, and the share of each.
fn optima(found: &Identification) -> Option<String> {
    if found.runs.len() < 2 || found.optima.is_empty() {
        return None;
    }
    let list: Vec<String> = found
        .optima
        .iter()
        .take(5)
        .map(|o| {
            format!(
                "J = {} ({:.0} %)",
                number::value(o.objective),
                100.0 * o.share
            )
        })
        .collect();
    let more = found.optima.len().saturating_sub(5);
    Some(format!(
        "{} starts reached {} optim{}, told apart by objective and motion, share of the starts in brackets: {}{}.",
        found.runs.len(),
        found.optima.len(),
        if found.optima.len() == 1 { "um" } else { "a" },
        list.join(", "),
        if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        }
    ))
}

fn force_findings(errors: &[ForceError]) -> Vec<String> {
    errors
        .iter()
        .map(|e| {
            let share = e.relative.map_or_else(
                || "the drive does not act".to_owned(),
                |r| format!("{:.2} % of the drive's force", 100.0 * r),
            );
            format!(
                "Force error of joint {} on the {} records: {} RMS, {share}.",
                e.joint,
                match e.role {
                    Role::Train => "training",
                    Role::Test => "test",
                },
                number::short(e.rms)
            )
        })
        .collect()
}

/// Warns if a scheme's own error has gone into the parameters: compares J of the fit with J of an
/// accurate simulation.
fn hidden_error(settings: &Settings, best: &Run, report: &Report) -> Option<String> {
    if settings.weighting != Weighting::Unit || !matches!(settings.horizon, Horizon::Record) {
        return None;
    }
    let accurate = report
        .free_run
        .iter()
        .find(|s| s.role == Role::Train && s.horizon == Horizon::Record)?
        .objective?;
    (accurate > 3.0 * best.objective).then(|| {
        format!(
            "The {} hides its own error in the parameters: it fits the training record with J = {}, but an accurate simulation with these parameters misses it by J = {}. Use a scheme of higher order or a smaller step before trusting the values.",
            settings.scheme.label(),
            number::value(best.objective),
            number::value(accurate)
        )
    })
}
