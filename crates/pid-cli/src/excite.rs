//! `simtrue excite`: the motion from which a record tells most.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::path::PathBuf;

use pid_fit::excite::{self, Criterion, Excitation, ExciteError, Settings, Without};
use pid_interpret::nominal::Nominal;
use pid_interpret::{Kinematics, Model};
use pid_runtime::dynamics::{At, Hessian};
use pid_runtime::kinematics::ForwardKinematics;
use serde::Serialize;

use crate::args::excite::{CriterionArg, ExciteArgs};
use crate::course::Course;
use crate::error::{CliError, make_folder, write};
use crate::limits::LimitFile;
use crate::open::{read_robot, robot_and_logs};
use crate::progress::{Interrupt, Progress};
use crate::{output, parameters};

/// A robot that is to move.
enum Mover {
    /// Declared with `robot!`.
    Declared(&'static dyn Hessian),
    /// Of a URDF, an MJCF or a description.
    Described(Box<(Model, Nominal)>),
}

impl Mover {
    /// Of a robot file, of a folder with a description, or by its name.
    fn of(args: &ExciteArgs) -> Result<Self, CliError> {
        let own = args.robot.join("nominal.toml");
        let path: &PathBuf = if own.is_file() { &own } else { &args.robot };
        if robot_and_logs(std::slice::from_ref(path)).is_some() {
            let nominal = read_robot(path, &args.read.open())?.nominal;
            let model = Model::new(nominal.robot())?;
            return Ok(Self::Described(Box::new((model, nominal))));
        }
        if path.exists() {
            return Err(CliError::NoRobot { path: path.clone() });
        }
        let name = path.to_str().unwrap_or_default();
        Ok(Self::Declared(crate::models::by_name(name)?.model))
    }

    fn model(&self) -> &dyn Hessian {
        match self {
            Self::Declared(model) => *model,
            Self::Described(own) => &own.0,
        }
    }

    /// The description it came from.
    fn nominal(&self) -> Option<&Nominal> {
        match self {
            Self::Declared(_) => None,
            Self::Described(own) => Some(&own.1),
        }
    }
}

/// Runs the command; the exit code.
pub(crate) fn run(args: &ExciteArgs) -> Result<u8, CliError> {
    let mover = Mover::of(args)?;
    let model = mover.model();
    let p = match &args.parameters {
        Some(file) => parameters::read(file, model.params())?,
        None => model.params().iter().map(|p| p.nominal).collect(),
    };
    if !(args.rate.is_finite() && args.rate > 0.0) {
        return Err(CliError::Excite(ExciteError::Setting {
            what: "the rate",
            value: args.rate,
            help: "give a positive number of samples per second",
        }));
    }
    let asked = LimitFile::read(args.limits.as_deref(), model)?;
    let kinematics = asked.kinematics((model, mover.nominal()))?;
    let limits = asked.limits(args, (model, mover.nominal()), kinematics.as_ref());
    let settings = Settings {
        period: args.period,
        harmonics: args.harmonics,
        samples: args.samples,
        criterion: match args.criterion {
            CriterionArg::Determinant => Criterion::Determinant,
            CriterionArg::SmallestEigenvalue => Criterion::SmallestEigenvalue,
        },
        starts: args.starts,
        seed: args.seed,
        ..Settings::default()
    };
    let interrupt = Interrupt::listen();
    let progress = Progress::start("looking for an exciting motion");
    let started = std::time::Instant::now();
    let course = Course::new(settings.solver.tol, 0);
    let found = excite::excite(model, &p, &limits, &settings, &mut |start, i| {
        progress.done(course.converged((start, settings.starts), i));
        progress.step(format!(
            "start {} of {}: iteration {}, criterion {:.4}",
            start + 1,
            settings.starts,
            i.iteration,
            i.objective
        ));
        match interrupt.requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    let seconds = started.elapsed().as_secs_f64();
    drop(progress);
    make_folder(&args.out)?;
    let (csv, json) = (
        args.out.join("excitation.csv"),
        args.out.join("excitation.json"),
    );
    write(
        &csv,
        &table(model, &p, &found, args.rate, kinematics.as_ref()),
    )?;
    let record = Record::new(model, &found, &settings, seconds);
    let text = serde_json::to_string_pretty(&record).map_err(CliError::Json)?;
    write(&json, &text)?;
    output::print(&summary(model, &found, seconds));
    if mover.nominal().is_some_and(Nominal::has_servos) {
        output::print("\nThe drives follow targets: send the columns `q_…` to them.\n");
    }
    output::print(&format!(
        "\nwritten: {}, {}\n",
        csv.display(),
        json.display()
    ));
    Ok(if interrupt.requested() { 130 } else { 0 })
}

/// One period: time, positions, velocities, accelerations, the force they need and where the
/// limited points are.
fn table(
    model: &dyn Hessian,
    p: &[f64],
    found: &Excitation,
    rate: f64,
    points: Option<&Kinematics>,
) -> String {
    let dims = model.dims();
    let nq = dims.nq;
    let mut text = String::from("t");
    for kind in ["q", "v", "a", "force"] {
        for joint in model.joints() {
            let _ = write!(text, ",{kind}_{}", joint.name);
        }
    }
    let names = points.map_or(&[][..], Kinematics::points);
    for name in names {
        let _ = write!(text, ",x_{name},y_{name},z_{name}");
    }
    let mut places = vec![0.0; 3 * names.len()];
    text.push('\n');
    let u = vec![0.0; dims.nu];
    let mut parts = vec![vec![0.0; nq]; 4];
    let last = (found.motion.period * rate).round() as usize;
    for i in 0..=last {
        let t = i as f64 / rate;
        let [q, v, a, force] = &mut parts[..] else {
            break;
        };
        found.motion.at(t, q, v, a);
        model.residual(&At { q, v, a, u: &u, p }, force);
        let _ = write!(text, "{t:.6}");
        if let Some(points) = points {
            points.positions(&parts[0], p, &mut places);
        }
        for value in parts.iter().flatten().chain(&places) {
            let _ = write!(text, ",{value:.9}");
        }
        text.push('\n');
    }
    text
}

/// excitation.json.
#[derive(Debug, Serialize)]
struct Record<'a> {
    model: &'a str,
    criterion: Criterion,
    period: f64,
    harmonics: usize,
    samples: usize,
    seed: u64,
    seconds: f64,
    status: pid_nlp::solver::Status,
    iterations: usize,
    largest_use_of_a_limit: f64,
    /// Per joint: q0, a_1, b_1, … as `excite::Fourier` defines them.
    coefficients: BTreeMap<&'a str, &'a [f64]>,
    optimal: &'a excite::Information,
    random: &'a [excite::Information],
    parameters: Vec<&'a str>,
    without: BTreeMap<&'a str, Without>,
}

impl<'a> Record<'a> {
    fn new(
        model: &'a dyn Hessian,
        found: &'a Excitation,
        settings: &Settings,
        seconds: f64,
    ) -> Self {
        let name = |k: usize| model.params()[k].name.as_ref();
        Self {
            model: model.name(),
            criterion: settings.criterion,
            period: settings.period,
            harmonics: settings.harmonics,
            samples: settings.samples,
            seed: settings.seed,
            seconds,
            status: found.status,
            iterations: found.iterations,
            largest_use_of_a_limit: found.largest_use,
            coefficients: model
                .joints()
                .iter()
                .map(|j| j.name.as_ref())
                .zip(found.motion.coefficients.chunks(found.motion.width()))
                .collect(),
            optimal: &found.information,
            random: &found.random,
            parameters: found.params.iter().map(|k| name(*k)).collect(),
            without: found.without.iter().map(|(k, w)| (name(*k), *w)).collect(),
        }
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

fn summary(model: &dyn Hessian, found: &Excitation, seconds: f64) -> String {
    let random =
        |f: &dyn Fn(&excite::Information) -> f64| median(found.random.iter().map(f).collect());
    let mut text = format!(
        "{}: {}; {} iterations in the best of {} starts, {seconds:.1} s; largest use of a limit {:.3}\n\n",
        model.name(),
        found.status.reason(),
        found.iterations,
        found.random.len(),
        found.largest_use
    );
    let _ = writeln!(
        text,
        "  {:<24} {:>12} {:>16}\n  {:<24} {:>12.4} {:>16.4}\n  {:<24} {:>12.1} {:>16.1}",
        "",
        "optimal",
        "random multisine",
        "criterion",
        found.information.value,
        random(&|i| i.value),
        "condition number",
        found.information.condition,
        random(&|i| i.condition),
    );
    text.push_str(
        "\nStandard deviation from white noise of 1 N·m (N) at every joint, one period\n",
    );
    for (k, param) in found.params.iter().enumerate() {
        let info = &model.params()[*param];
        let _ = writeln!(
            text,
            "  {:<24} {:>12.4e} {:>16.4e}  {}",
            info.name,
            found.information.deviations[k],
            random(&|i| i.deviations[k]),
            info.unit
        );
    }
    let mut reasons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (k, why) in &found.without {
        let why = match why {
            Without::Fixed => "held by the declaration",
            Without::NeedsInput => "known: its effect depends on the input",
            Without::NotPolynomial => "known: the force is no polynomial of it",
            _ => "enters only together with those above, or not at all",
        };
        reasons
            .entry(why)
            .or_default()
            .push(model.params()[*k].name.as_ref());
    }
    for (why, names) in reasons {
        let _ = writeln!(text, "\n  {why}: {}", names.join(", "));
    }
    text
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::Parser;

    use super::run;
    use crate::args::{Cli, Command};
    use crate::samples::ARM;

    fn excited(folder: &Path, robot: &str, options: &[&str]) -> Result<u8, String> {
        let path = |name: &str| folder.join(name).display().to_string();
        let (robot, out) = (path(robot), path("out"));
        let words = ["simtrue", "excite", &robot, "--out", &out, "--starts", "1"];
        let words = words.iter().chain(options);
        let cli = Cli::try_parse_from(words).map_err(|e| e.to_string())?;
        let Some(Command::Excite(args)) = cli.command else {
            return Err("another command".to_owned());
        };
        run(&args).map_err(|e| e.to_string())
    }

    /// Largest sizes of the columns of excitation.csv after the time.
    fn largest(folder: &Path) -> Vec<f64> {
        let text = std::fs::read_to_string(folder.join("out/excitation.csv")).expect("a table");
        assert!(text.starts_with("t,q_shoulder,v_shoulder,a_shoulder,force_shoulder\n"));
        let mut most = vec![0.0_f64; 4];
        for line in text.lines().skip(1) {
            let cells = line.split(',').skip(1).map(|x| x.parse::<f64>());
            for (most, cell) in most.iter_mut().zip(cells) {
                *most = most.max(cell.expect("a number").abs());
            }
        }
        most
    }

    /// The arm's file states 3 rad, 3 rad/s and 40 N m. Between the samples at which limits hold a motion may go a
    /// little beyond them.
    #[test]
    fn a_urdf_moves_within_the_limits_of_its_file() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("arm.urdf"), ARM).expect("written");
        assert_eq!(excited(folder.path(), "arm.urdf", &[]), Ok(0));
        let own = largest(folder.path());
        for (most, limit) in own.iter().zip([3.0, 3.0, 8.0, 40.0]) {
            assert!(*most < 1.01 * limit, "{own:?}");
        }
        assert!(own[1] > 2.0, "{own:?}");
        assert_eq!(
            excited(folder.path(), "arm.urdf", &["--velocity", "1"]),
            Ok(0)
        );
        let slow = largest(folder.path());
        assert!(slow[1] < 1.01, "{slow:?}");
    }

    #[test]
    fn what_is_no_robot_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let error = excited(folder.path(), "", &[]).unwrap_err();
        assert!(error.contains("no robot file"), "{error}");
        let error = excited(folder.path(), "lost.urdf", &[]).unwrap_err();
        assert!(error.contains("check the path"), "{error}");
    }
}
