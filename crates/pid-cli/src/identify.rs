//! `simtrue identify`: parameters from records, and the report on them.

use std::ops::ControlFlow;

use pid_data::{Dataset, Horizon};
use pid_fit::ident::{self, InitialState, Method, Prepare, Sampling, Settings, Weighting};
use pid_fit::identify::{News, Request, by_rule, identify};
use pid_fit::transcribe::{Adaptive, Curvature};
use pid_nlp::solver::{self, Algorithm, Iteration, Status};
use pid_report::Verdict;
use pid_runtime::dynamics::ParamInfo;

use crate::args::identify::{
    ConsistentArg, HessianArg, HorizonArg, IdentifyArgs, InitialArg, MethodArg, SamplingArg,
    SolverArg, WeightsArg,
};
use crate::args::source::InertiasArg;
use crate::cause::Cause;
use crate::course::Course;
use crate::error::CliError;
use crate::progress::{Interrupt, Progress};
use crate::source::Subject;
use crate::{assume, output, parameters, source};

/// Runs the command; the exit code.
pub(crate) fn run(args: &IdentifyArgs) -> Result<u8, CliError> {
    let interrupt = Interrupt::listen();
    let progress = Progress::start("reading the data");
    let (entry, dataset) = source::load(&args.source)?;
    let model = entry.model();
    let request = request(args, &entry, &dataset)?;
    if args.verbose {
        output::message(Iteration::HEADING);
    }
    let course = Course::new(args.tol, args.bootstrap);
    let tell = |news: &News<'_>| {
        progress.done(course.identified(news));
        show(news, model.params(), args, &progress);
        match interrupt.requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    let found = identify(model, &dataset, &request, &tell)?;
    let best = found.identification.best();
    let subject = entry.subject(&dataset, &best.parameters);
    let step = |what: String| progress.step(what);
    let mut report = pid_report::report(&subject, &dataset, &found, &step)?;
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
    source::deliver(&report, &args.source.out, args.json)?;
    entry.write_back(&best.parameters, &args.source.out)?;
    if let Some(cause) = cause {
        cause?.deliver(&args.source.out, args.json)?;
    }
    Ok(match (report.outcome.verdict, best.status) {
        (_, Status::Interrupted) => 130,
        (Verdict::Bad, _) => 3,
        _ => 0,
    })
}

/// What the arguments ask for.
fn request(args: &IdentifyArgs, entry: &Subject, dataset: &Dataset) -> Result<Request, CliError> {
    let model = entry.model();
    let mut settings = settings(args, entry, dataset);
    if settings.method == Method::EquationError && !args.source.velocity_lag.is_empty() {
        return Err(CliError::LagOfRegression);
    }
    let stated = assume::apply(args, entry, dataset, &mut settings)?;
    let mut start = match &args.start {
        Some(file) => Some(parameters::read(file, model.params())?),
        None => None,
    };
    if !stated.is_empty() {
        let nominal = || model.params().iter().map(|i| i.nominal).collect();
        let start = start.get_or_insert_with(nominal);
        stated.iter().for_each(|&(j, value)| start[j] = value);
    }
    Ok(Request {
        settings,
        start,
        choose_horizon: args.horizon == Some(HorizonArg::Auto),
        consistent_after: consistent(args, entry) == Some(ConsistentArg::After),
        draws: args.bootstrap,
        profiled: profiled(model.params(), &args.profile)?,
    })
}

/// Shows how far the identification is.
fn show(news: &News<'_>, params: &[ParamInfo], args: &IdentifyArgs, progress: &Progress) {
    let line = |i: &ident::Progress<'_>| {
        if args.verbose {
            progress.line(&i.iteration.line());
        }
    };
    match news {
        News::Horizon(i) => progress.step(format!(
            "choosing the horizon by cross validation: {}, iteration {}",
            i.phase, i.iteration.iteration
        )),
        News::Fit(i) => {
            progress.step(format!(
                "{} (start {} of {}): iteration {}, J = {:.6e}, violation {:.1e}",
                i.phase,
                i.start + 1,
                i.starts,
                i.iteration.iteration,
                i.iteration.objective,
                i.iteration.primal_inf
            ));
            line(i);
        }
        News::Consistent(i) => {
            progress.step(format!(
                "consistent values, {}: iteration {}, J = {:.6e}",
                i.phase, i.iteration.iteration, i.iteration.objective
            ));
            line(i);
        }
        News::Bootstrap => progress.step(format!("bootstrap, {} draws", args.bootstrap)),
        News::Profile(None) => progress.step("profile likelihood".to_owned()),
        News::Profile(Some(j)) => {
            progress.step(format!("profile likelihood of {}", params[*j].name));
        }
        _ => {}
    }
}

/// When links are kept bodies: as asked, and throughout for the free links of a robot file.
fn consistent(args: &IdentifyArgs, entry: &Subject) -> Option<ConsistentArg> {
    let free_links = match args.source.urdf {
        Some(_) => args.source.inertias == InertiasArg::Free,
        None => entry.nominal().is_some(),
    };
    let by_default =
        free_links && !args.free_parameters && args.method == MethodArg::FullDiscretization;
    args.consistent
        .or(by_default.then_some(ConsistentArg::Throughout))
}

fn settings(args: &IdentifyArgs, entry: &Subject, dataset: &Dataset) -> Settings {
    let embedded = args.source.embedded();
    let method = match args.method {
        MethodArg::FullDiscretization => Method::FullDiscretization,
        MethodArg::Shooting => Method::Shooting,
        MethodArg::EquationError => Method::EquationError,
    };
    let horizon = match args.horizon {
        Some(HorizonArg::Stated(horizon)) => horizon,
        Some(HorizonArg::Auto) | None => by_rule(dataset),
    };
    Settings {
        consistent: consistent(args, entry) == Some(ConsistentArg::Throughout),
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
