//! `simtrue identify`: parameters from records, and the report on them.

use std::ops::ControlFlow;
use std::time::Instant;

use pid_data::{Dataset, Horizon, Role};
use pid_fit::ident::bootstrap::{Bootstrap, bootstrap};
use pid_fit::ident::{
    self, ForceError, Identification, InitialState, Method, Prepare, Run, Sampling, Settings,
    Weighting,
};
use pid_fit::transcribe::{Adaptive, Curvature};
use pid_nlp::solver::{self, Algorithm, Iteration, Status};
use pid_report::{CheckRow, Setting, StartRow, Verdict};
use pid_runtime::dynamics::ParamInfo;

use crate::args::{
    ConsistentArg, HessianArg, HorizonArg, IdentifyArgs, InitialArg, MethodArg, SamplingArg,
    SolverArg, WeightsArg,
};
use crate::assemble::{Fit, assemble};
use crate::cause::Cause;
use crate::error::CliError;
use crate::progress::{Interrupt, Progress};
use crate::{assume, consistent, horizon, output, parameters, source};

/// The independent check accepts this constraint violation and stationarity.
const FEASIBLE: f64 = 1e-6;
const STATIONARY: f64 = 1e-4;

/// Runs the command; the exit code.
pub(crate) fn run(args: &IdentifyArgs) -> Result<u8, CliError> {
    let interrupt = Interrupt::listen();
    let progress = Progress::start("reading the data");
    let (entry, dataset) = source::load(&args.source)?;
    let model = entry.model();
    let mut settings = settings(args, &dataset);
    if settings.method == Method::EquationError && !args.source.velocity_lag.is_empty() {
        return Err(CliError::LagOfRegression);
    }
    let stated = assume::apply(args, &entry, &dataset, &mut settings)?;
    let mut start = match &args.start {
        Some(file) => Some(parameters::read(file, model.params())?),
        None => None,
    };
    if !stated.is_empty() {
        let nominal = || model.params().iter().map(|i| i.nominal).collect();
        let start = start.get_or_insert_with(nominal);
        stated.iter().for_each(|&(j, value)| start[j] = value);
    }
    let profiled = profiled(model.params(), &args.profile)?;
    if args.consistent == Some(ConsistentArg::After) && (args.bootstrap > 0 || !profiled.is_empty())
    {
        return Err(CliError::ConsistentAfter);
    }
    if args.consistent == Some(ConsistentArg::After) && !settings.constraints.is_empty() {
        return Err(CliError::ConstrainedAfter);
    }
    let started = Instant::now();
    let mut choice = None;
    if args.horizon == Some(HorizonArg::Auto) && settings.method != Method::EquationError {
        let start = start.as_deref();
        let (chosen, note) =
            horizon::chosen(model, &dataset, &settings, start, &progress, &interrupt)?;
        settings.horizon = chosen;
        choice = Some(note);
    }
    if args.verbose {
        output::message(Iteration::HEADING);
    }
    let identification = ident::identify(
        model,
        &dataset,
        &settings,
        start.as_deref(),
        &mut |news: &ident::Progress<'_>| {
            let i = news.iteration;
            progress.step(format!(
                "{} (start {} of {}): iteration {}, J = {:.6e}, violation {:.1e}",
                news.phase,
                news.start + 1,
                news.starts,
                i.iteration,
                i.objective,
                i.primal_inf
            ));
            if args.verbose {
                progress.line(&i.line());
            }
            if interrupt.requested() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        },
    )?;
    let mut intervals = Vec::new();
    let identification = match args.consistent {
        None | Some(ConsistentArg::Throughout) => identification,
        Some(ConsistentArg::After) => {
            let mut news = |news: &ident::Progress<'_>| {
                let i = news.iteration;
                progress.step(format!(
                    "consistent values, {}: iteration {}, J = {:.6e}",
                    news.phase, i.iteration, i.objective
                ));
                if args.verbose {
                    progress.line(&i.line());
                }
                match interrupt.requested() {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            };
            let (found, sentence) =
                consistent::refit(model, &dataset, &settings, &identification, &mut news)?;
            intervals.push(sentence);
            found
        }
    };
    if args.bootstrap > 0 {
        let news = || match interrupt.requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        progress.step(format!("bootstrap, {} draws", args.bootstrap));
        let drawn = bootstrap(
            model,
            &dataset,
            &settings,
            &identification,
            (args.bootstrap, args.seed),
            &news,
        )?;
        intervals.extend(bootstrap_findings(model.params(), &drawn));
    }
    if !profiled.is_empty() {
        let mut go_on = |_: &ident::Progress<'_>| match interrupt.requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        progress.step("profile likelihood".to_owned());
        let profiler =
            ident::Profiler::new(model, &dataset, &settings, &identification, &mut go_on)?;
        for j in profiled {
            progress.step(format!("profile likelihood of {}", model.params()[j].name));
            let found = profiler.interval(j, &mut go_on)?;
            intervals.push(profile_finding(&model.params()[j], &found));
        }
    }
    let seconds = started.elapsed().as_secs_f64();
    let best = identification.best();
    let verdict = verdict(best);
    let mut report = assemble(
        &entry,
        &dataset,
        Fit {
            title: format!("{} identified on {}", entry.name, dataset.name),
            start: best.start.clone(),
            values: best.parameters.clone(),
            deviations: identification.deviations.clone(),
            lower: identification.lower.clone(),
            upper: identification.upper.clone(),
            fixed: identification.fixed.clone(),
            verdict,
            status: best.status.reason().to_owned(),
            objective: best.objective.is_finite().then_some(best.objective),
            seconds,
            checks: checks(best),
            iterations: best.iterations,
            log: best.log.clone(),
            starts: identification.runs.iter().map(start_row).collect(),
            cutoff: args.cutoff,
            settings: in_words(&settings, &identification),
            notes: choice
                .into_iter()
                .chain(notes(&identification, model.params()))
                .collect(),
        },
        &progress,
    )?;
    let mut extra = force_findings(&identification.force_error);
    extra.extend(optima(&identification));
    extra.extend(noise_finding(&identification, &settings, &dataset));
    extra.extend(intervals);
    report.findings.extend(extra);
    if settings.method == Method::FullDiscretization
        && let Some(sentence) = hidden_error(&settings, best, &report)
    {
        report.findings.insert(0, sentence);
    }
    let wanted = (args.diagnose || args.source.embedded()) && !interrupt.requested();
    let cause = wanted.then(|| {
        progress.step("looking for the effect that the model lacks".to_owned());
        Cause::find(&entry, &dataset)
    });
    if let Some(Ok(cause)) = &cause {
        report.findings.insert(0, cause.sentence.clone());
    }
    drop(progress);
    // The fit is written whatever becomes of the diagnosis.
    source::deliver(&report, &args.source.out)?;
    entry.write_urdf(&best.parameters, &args.source.out)?;
    if let Some(cause) = cause {
        cause?.deliver(&args.source.out)?;
    }
    Ok(match (verdict, best.status) {
        (_, Status::Interrupted) => 130,
        (Verdict::Bad, _) => 3,
        _ => 0,
    })
}

fn settings(args: &IdentifyArgs, dataset: &Dataset) -> Settings {
    let embedded = args.source.embedded();
    let method = match args.method {
        MethodArg::FullDiscretization => Method::FullDiscretization,
        MethodArg::Shooting => Method::Shooting,
        MethodArg::EquationError => Method::EquationError,
    };
    let horizon = match args.horizon {
        Some(HorizonArg::Stated(horizon)) => horizon,
        Some(HorizonArg::Auto) | None => horizon::by_rule(dataset),
    };
    Settings {
        consistent: args.consistent == Some(ConsistentArg::Throughout),
        method,
        scheme: args.scheme,
        substeps: args.substeps,
        nodes: args.nodes,
        lift: args.no_lift.then_some(false),
        adaptive: args.adaptive.map(|rtol| Adaptive {
            rtol,
            atol: 1e-2 * rtol,
        }),
        sampling: match args.sampling {
            SamplingArg::Around => Sampling::Around,
            SamplingArg::LatinHypercube => Sampling::LatinHypercube,
            SamplingArg::Sobol => Sampling::Sobol,
        },
        curvature: match args.hessian {
            HessianArg::Exact => Curvature::Exact,
            HessianArg::GaussNewton => Curvature::GaussNewton,
            // Only the standard deviations at the solution use it.
            HessianArg::Bfgs | HessianArg::LBfgs => Curvature::Exact,
        },
        quasi_newton: match args.hessian {
            HessianArg::Exact | HessianArg::GaussNewton => None,
            HessianArg::Bfgs => Some(usize::MAX),
            HessianArg::LBfgs => Some(10),
        },
        algorithm: match args.solver {
            SolverArg::InteriorPoint => Algorithm::InteriorPoint,
            SolverArg::Sqp => Algorithm::Sqp,
        },
        horizon: if method == Method::EquationError {
            Horizon::Samples(1)
        } else {
            horizon
        },
        initial_state: match args.initial {
            InitialArg::Free => InitialState::Free,
            InitialArg::Measured => InitialState::Measured,
        },
        weighting: match args.weights {
            WeightsArg::Unit => Weighting::Unit,
            WeightsArg::Spread => Weighting::Spread,
            WeightsArg::Record => Weighting::Record,
            WeightsArg::Position => Weighting::Position,
        },
        likelihood: None,
        hold: Vec::new(),
        constraints: Vec::new(),
        sandwich: false,
        starts: if embedded && args.starts.is_none() {
            3
        } else {
            args.starts.unwrap_or(1) as usize
        },
        seed: args.seed,
        prepare: match args.no_prepare {
            true => Prepare::Nothing,
            false => Prepare::Everything,
        },
        cutoff: args.cutoff,
        decimate: args.decimate,
        solver: solver::Settings {
            max_iterations: args.max_iter,
            tol: args.tol,
            ..Settings::default().solver
        },
    }
}

fn verdict(run: &Run) -> Verdict {
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
        _ => {
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
                    Weighting::Record => {
                        "positions, by one over their variance in their own record"
                    }
                    Weighting::Position => "positions only",
                },
            ));
            let (n, m) = found.size;
            let (windows, samples) = found.windows;
            rows.push(Setting::new(
                "program",
                format!("{n} variables, {m} constraints; {windows} windows, {samples} samples"),
            ));
        }
    }
    if settings.starts > 1 {
        rows.push(Setting::new(
            "starts",
            format!("{} (seed {})", settings.starts, settings.seed),
        ));
    }
    rows
}

/// Positions of the parameters to profile.
fn profiled(params: &[ParamInfo], names: &[String]) -> Result<Vec<usize>, CliError> {
    names
        .iter()
        .map(|name| {
            let position = params.iter().position(|p| p.name == *name);
            position.ok_or_else(|| CliError::NoParameter {
                option: "--profile",
                name: name.clone(),
            })
        })
        .collect()
}

fn bootstrap_findings(params: &[ParamInfo], drawn: &Bootstrap) -> Vec<String> {
    let (good, bad) = drawn.draws;
    let mut lines = vec![format!(
        "Block bootstrap over windows: {good} draws, {bad} did not converge and were left out."
    )];
    let found = params.iter().zip(&drawn.intervals).zip(&drawn.deviations);
    lines.extend(found.filter_map(|((info, interval), deviation)| {
        let ((low, high), deviation) = ((*interval)?, (*deviation)?);
        Some(format!(
            "Bootstrap of {}: 95 % interval {low:.5} … {high:.5} {}, standard deviation {deviation:.2e}.",
            info.name, info.unit
        ))
    }));
    lines
}

fn profile_finding(info: &ParamInfo, found: &ident::Profile) -> String {
    let side = |end: Option<f64>, word: &str| {
        end.map_or_else(|| format!("its {word} bound"), |x| format!("{x:.5}"))
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
fn noise_finding(found: &Identification, settings: &Settings, data: &Dataset) -> Option<String> {
    settings.likelihood.as_ref()?;
    let nq = data.nq();
    let levels: Vec<String> = found
        .noise
        .iter()
        .enumerate()
        .filter_map(|(c, level)| {
            let letter = if c < nq { "q" } else { "dq" };
            Some(format!(
                "{} {letter} {:.3e}",
                data.joints[c % nq].name,
                (*level)?
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
        .map(|o| format!("J = {:.4e} ({:.0} %)", o.objective, 100.0 * o.share))
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
                "Force error of joint {} on the {} records: {:.4} RMS, {share}.",
                e.joint,
                match e.role {
                    Role::Train => "training",
                    Role::Test => "test",
                },
                e.rms
            )
        })
        .collect()
}

/// Warns if a scheme's own error has gone into the parameters: compares J of the fit with J of an
/// accurate simulation.
fn hidden_error(settings: &Settings, best: &Run, report: &pid_report::Report) -> Option<String> {
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
            "The {} hides its own error in the parameters: it fits the training record with J = {:.4e}, but an accurate simulation with these parameters misses it by J = {accurate:.4e}. Use a scheme of higher order or a smaller step before trusting the values.",
            settings.scheme.label(),
            best.objective
        )
    })
}
