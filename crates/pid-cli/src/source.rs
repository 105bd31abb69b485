//! Model and data from the arguments, results into their folder.

use std::path::Path;

use pid_data::Dataset;
use pid_diagnose::described::in_loops;
use pid_diagnose::servo;
use pid_diagnose::with_effects::Assembled;
use pid_fit::gap::force::States;
use pid_fit::wrap::controllers::{ControlError, Controllers};
use pid_fit::wrap::lag::Lagging;
use pid_fit::wrap::private::PerRecord;
use pid_interpret::Model;
use pid_interpret::nominal::{Gain, Nominal, Servo};
use pid_report::Report;
use pid_runtime::control::ClosedLoop;
use pid_runtime::dynamics::{Dims, Dynamics, Hessian};
use pid_runtime::extend::Extended;
use pid_runtime::term::Request;
use pid_urdf::{Description, Inertias, Options};

use clap::CommandFactory;

use crate::args::Cli;
use crate::args::source::{InertiasArg, Source};
use crate::described::{described, write_identified};
use crate::error::{CliError, make_folder, write};
use crate::open::{Opened, robot_and_logs};
use crate::with::{self, With};
use crate::{demo, models, output};

/// A model and its name.
pub(crate) struct Subject {
    pub(crate) name: String,
    summary: String,
    source: String,
    origin: Origin,
}

/// Origin of a model.
enum Origin {
    Compiled(&'static dyn Hessian),
    Extended(Box<Extended<'static>>),
    Closed(Box<ClosedLoop<'static>>),
    PerRecord(Box<PerRecord<'static>>),
    /// With the records as they were read.
    Lagging(Box<(Lagging<'static>, Dataset)>),
    Urdf(Box<FromUrdf>),
    Nominal(Box<(Assembled, Nominal)>),
    WithEffects(Box<dyn Hessian>),
}

/// A robot read from a URDF.
struct FromUrdf {
    model: Model,
    description: Description,
    options: Options,
}

impl Subject {
    pub(crate) fn model(&self) -> &dyn Hessian {
        match &self.origin {
            Origin::Compiled(model) => *model,
            Origin::Extended(model) => model.as_ref(),
            Origin::Closed(model) => model.as_ref(),
            Origin::PerRecord(model) => model.as_ref(),
            Origin::Lagging(lagging) => &lagging.0,
            Origin::Urdf(urdf) => &urdf.model,
            Origin::Nominal(nominal) => nominal.0.model.as_ref(),
            Origin::WithEffects(model) => model.as_ref(),
        }
    }

    /// The robot and records by which motions and forces are judged: those without lags of
    /// readings.
    fn judged<'a>(
        &'a self,
        dataset: &'a Dataset,
        values: &'a [f64],
    ) -> (&'a dyn Hessian, &'a Dataset, &'a [f64]) {
        match &self.origin {
            Origin::Lagging(lagging) => {
                let (model, records) = lagging.as_ref();
                (model.inner(), records, &values[..model.inner_params()])
            }
            _ => (self.model(), dataset, values),
        }
    }

    /// As a report shows it, with parameters.
    pub(crate) fn subject<'a>(
        &'a self,
        dataset: &'a Dataset,
        values: &'a [f64],
    ) -> pid_report::Subject<'a> {
        pid_report::Subject {
            name: &self.name,
            summary: &self.summary,
            source: &self.source,
            model: self.model(),
            judged: self.judged(dataset, values),
            states: self
                .nominal()
                .map_or(States::NONE, |(_, with)| &with.states),
        }
    }

    /// The nominal description it came from, if it came from one, and its model.
    pub(crate) fn nominal(&self) -> Option<(&Nominal, &Assembled)> {
        match &self.origin {
            Origin::Nominal(nominal) => Some((&nominal.1, &nominal.0)),
            _ => None,
        }
    }

    /// Of a description with its effects; records get the columns that these need.
    fn of_description(nominal: Nominal, dataset: &mut Dataset) -> Result<Self, CliError> {
        let with = Assembled::new(&nominal, dataset)?;
        Ok(Self {
            name: with.model.name().to_owned(),
            summary: size(with.model.dims()),
            source: nominal.file().display().to_string(),
            origin: Origin::Nominal(Box::new((with, nominal))),
        })
    }

    fn compiled(name: &str, terms: &[Request]) -> Result<Self, CliError> {
        let entry = models::by_name(name)?;
        Ok(Self {
            name: entry.name.to_owned(),
            summary: entry.summary.to_owned(),
            source: entry.source.to_owned(),
            origin: match terms {
                [] => Origin::Compiled(entry.model),
                terms => Origin::Extended(Box::new(Extended::new(entry.model, terms)?)),
            },
        })
    }

    fn from_urdf(file: &Path, source: &Source) -> Result<Self, CliError> {
        let description = Description::read(file)?;
        for warning in &description.warnings {
            output::message(&format!("warning: {warning}"));
        }
        let mut options = Options::default();
        options.armature = source.armature;
        options.inertias = match source.inertias {
            InertiasArg::Free => Inertias::Standard,
            InertiasArg::Fixed => Inertias::Numbers,
        };
        let model = Model::new(&pid_urdf::robot(&description, &options)?)?;
        Ok(Self {
            name: description.name.clone(),
            summary: size(model.dims()),
            source: file.display().to_string(),
            origin: Origin::Urdf(Box::new(FromUrdf {
                model,
                description,
                options,
            })),
        })
    }

    /// Writes the file that the robot came from with these parameters beside the report: a URDF by
    /// --urdf, or a description.
    pub(crate) fn write_back(&self, values: &[f64], out: &Path) -> Result<(), CliError> {
        match &self.origin {
            Origin::Urdf(urdf) => self.write_urdf(urdf, values, out),
            Origin::Nominal(own) => write_identified(&own.1, self.model().params(), values, out),
            _ => Ok(()),
        }
    }

    fn write_urdf(&self, urdf: &FromUrdf, values: &[f64], out: &Path) -> Result<(), CliError> {
        let params = urdf.model.params();
        let value = |name: &str| Some(values[params.iter().position(|p| p.name == name)?]);
        let written = pid_urdf::write(&urdf.description, &urdf.options, value);
        make_folder(out)?;
        let file = out.join("identified.urdf");
        write(&file, &written.text)?;
        output::message(&format!("written: {}", file.display()));
        for lost in &written.lost {
            output::message(&format!("  not in it: {lost}"));
        }
        Ok(())
    }
}

/// The size of a model in words.
fn size(dims: Dims) -> String {
    let plural = if dims.nq == 1 { "" } else { "s" };
    format!("{} coordinate{plural}, {} parameters", dims.nq, dims.np)
}

/// Reads a file of controllers.
pub(crate) fn controllers(file: &Path, joints: usize) -> Result<Controllers, CliError> {
    let text = std::fs::read_to_string(file).map_err(|error| CliError::Read {
        path: file.to_owned(),
        error,
    })?;
    Ok(Controllers::parse(
        &file.display().to_string(),
        &text,
        joints,
    )?)
}

/// The model and the data asked for, or the embedded ones; checked against each other. With
/// controllers the loop is closed.
pub(crate) fn load(source: &Source) -> Result<(Subject, Dataset), CliError> {
    match described(source)? {
        Some(opened) => load_described(opened, source),
        None => load_with(source, source.controller.as_deref(), false),
    }
}

/// As [`load`], with the recorded inputs whatever controllers there are, and effects in their linear form.
pub(crate) fn load_open(source: &Source) -> Result<(Subject, Dataset), CliError> {
    match described(source)? {
        Some(opened) => {
            with_inputs_of_motors(&opened)?;
            load_described(opened, source)
        }
        None => load_with(source, None, true),
    }
}

/// The model of a description with its effects, and its records.
pub(crate) fn load_described(
    opened: Opened,
    source: &Source,
) -> Result<(Subject, Dataset), CliError> {
    let logs = robot_and_logs(&source.paths).is_some();
    // What is off in a folder is so before folders are put together: its inputs do not count.
    let mut all = further(source)?;
    all.insert(0, opened.records.dataset);
    Dataset::set_gain_factors(&mut all, &source.open.gain_factor)?;
    let first = all.remove(0);
    let dataset = match logs {
        // Gains entered where the logs were read.
        true => with_inputs(first, source)?,
        false => as_stated(first, source)?,
    };
    let also = all.into_iter().map(|own| as_stated(own, source));
    let dataset = dataset.merged(also.collect::<Result<_, _>>()?)?;
    let (nominal, mut dataset) = behind_loops(opened.nominal, dataset)?;
    let mut subject = Subject::of_description(nominal, &mut dataset)?;
    if logs {
        // A description made of a robot file has no file of its own.
        subject.source = source.paths[0].display().to_string();
    }
    checked(subject, dataset)
}

/// Records and description as equations of motion take them: where only targets are recorded, the position
/// loops of the drives are part of the model, and gains that nobody knows start where the motions say.
fn behind_loops(nominal: Nominal, dataset: Dataset) -> Result<(Nominal, Dataset), CliError> {
    if servo::only_targets(&nominal, &dataset) {
        let (nominal, dataset) = servo::commanded(&nominal, &dataset)?;
        held_stages(&nominal)
            .iter()
            .for_each(|note| output::message(note));
        return Ok((nominal, dataset));
    }
    if nominal.has_servos() {
        output::message(
            "note: the recorded inputs of the motors act; the position loops of [drive] are left out (--targets: they act)",
        );
    }
    // Effects that are stages of these loops go with them.
    Ok((in_loops(&nominal)?, dataset))
}

/// What is said of stages of targets that are not exact: they act on the records and are no parameters.
fn held_stages(nominal: &Nominal) -> Vec<String> {
    let joints = nominal.robot().joints.iter().enumerate();
    let loops = joints.filter_map(|(j, joint)| Some((joint, nominal.servo(j)?)));
    let of = |(joint, servo): (&pid_derive::model::Joint, &Servo)| -> Vec<String> {
        let open = |gain: &Gain| gain.shapes_target() && servo.gain(*gain).half_width > 0.0;
        let value = |gain: Gain| servo.gain(gain).value.unwrap_or(0.0);
        (servo.gains().filter(open))
            .map(|gain| {
                format!(
                    "note: joint `{}`: `{}` is held at {:.4}; `simtrue diagnose` finds it",
                    joint.name,
                    gain.key(),
                    value(gain)
                )
            })
            .collect()
    };
    loops.flat_map(of).collect()
}

/// Refuses records without the inputs of motors.
fn with_inputs_of_motors(opened: &Opened) -> Result<(), CliError> {
    let (nominal, data) = (&opened.nominal, &opened.records.dataset);
    match servo::only_targets(nominal, data) {
        true => Err(CliError::OnlyTargets),
        false => Ok(()),
    }
}

/// The further records as they were read.
fn further(source: &Source) -> Result<Vec<Dataset>, CliError> {
    let folders = source.also.iter();
    folders.map(|own| Ok(Dataset::read(own)?)).collect()
}

/// The further records with their inputs as the options say.
fn also(source: &Source) -> Result<Vec<Dataset>, CliError> {
    let all = further(source)?.into_iter();
    all.map(|own| as_stated(own, source)).collect()
}

/// Model and records that fit each other; warnings are printed.
fn checked(subject: Subject, dataset: Dataset) -> Result<(Subject, Dataset), CliError> {
    dataset.check_model(subject.model())?;
    for warning in &dataset.warnings {
        output::message(&format!("warning: {warning}"));
    }
    Ok((subject, dataset))
}

/// What is said of gains by record of a model without loops.
const NO_LOOPS: &str = "note: gain_factors of the records act on loops of [drive] in a description, and a declared model has none: they are left out; --controller states gains by record";

fn load_with(
    source: &Source,
    controller: Option<&Path>,
    linear: bool,
) -> Result<(Subject, Dataset), CliError> {
    let (effects, others): (Vec<With>, Vec<With>) =
        (source.terms.iter().cloned()).partition(|t| !linear && t.effect.is_some());
    let terms = with::laws(&others)?;
    if let Some(term) = terms.iter().find(|t| t.law.has_memory()) {
        return Err(CliError::Memory {
            term: term.to_string(),
        });
    }
    let (subject, folder) = bare(source, &terms)?;
    let dataset = match folder {
        Some(folder) => Dataset::read(folder)?,
        None => demo::dataset()?,
    };
    let dataset = as_stated(dataset, source)?;
    if dataset
        .experiments
        .iter()
        .any(|e| !e.gain_factors.are_one())
    {
        output::message(NO_LOOPS);
    }
    let also = also(source)?;
    let (subject, mut dataset) = match controller {
        Some(file) => subject.closed(file, (dataset, also), &terms, &effects)?,
        None => {
            let dataset = dataset.merged(also)?;
            (subject.with_effects(&effects, &dataset)?, dataset)
        }
    };
    let subject = subject.wrapped(source, &mut dataset)?;
    checked(subject, dataset)
}

/// The model without what goes around it, and the folder of its records; `None`: the embedded ones.
fn bare<'a>(
    source: &'a Source,
    terms: &[Request],
) -> Result<(Subject, Option<&'a Path>), CliError> {
    if let Some(option) = source.open.stated_of_logs() {
        return Err(CliError::OptionOfLogs { option });
    }
    match (&source.urdf, source.paths.as_slice()) {
        (Some(file), [folder]) => Ok((
            Subject::from_urdf(file, source)?,
            Some(data_folder(folder)?),
        )),
        (None, []) => Ok((Subject::compiled(demo::MODEL, terms)?, None)),
        (None, [model, folder]) => {
            let name = named(model);
            known(name)?;
            Ok((Subject::compiled(name, terms)?, Some(data_folder(folder)?)))
        }
        (None, [folder]) if folder.is_dir() => Err(CliError::NoDescription {
            path: folder.clone(),
        }),
        (None, [model]) => {
            known(named(model))?;
            Err(CliError::NoFolder {
                model: named(model).to_owned(),
            })
        }
        (Some(file), []) => Err(CliError::NoFolder {
            model: file.display().to_string(),
        }),
        (Some(_), [model, _]) => Err(CliError::TwoModels {
            model: named(model).to_owned(),
        }),
        (_, paths) => {
            known(named(&paths[0]))?;
            Err(CliError::TooManyPaths {
                path: paths[0].clone(),
                number: paths.len(),
            })
        }
    }
}

/// A path as the name of a model; what is no text names none.
fn named(path: &Path) -> &str {
    path.to_str().unwrap_or_default()
}

/// A data folder; a log in its place is told the way that takes logs.
fn data_folder(path: &Path) -> Result<&Path, CliError> {
    match path.is_file() {
        true => Err(CliError::NoDataFolder {
            path: path.to_owned(),
        }),
        false => Ok(path),
    }
}

/// Whether there is a model of this name; a mistyped command gets the one that was meant.
fn known(name: &str) -> Result<(), CliError> {
    match (models::by_name(name), nearest_command(name)) {
        (Ok(_), _) => Ok(()),
        (Err(_), Some(nearest)) => Err(CliError::NoCommand {
            word: name.to_owned(),
            nearest,
        }),
        (Err(unknown), None) => Err(unknown.into()),
    }
}

/// Letters that a mistyped command differs by at most.
const MISTYPED: usize = 2;

/// The command that a word was probably meant to be.
fn nearest_command(word: &str) -> Option<String> {
    let cli = Cli::command();
    let names = cli.get_subcommands().filter(|c| !c.is_hide_set());
    names
        .map(|c| (strsim::osa_distance(word, c.get_name()), c.get_name()))
        .filter(|(distance, _)| *distance <= MISTYPED)
        .min()
        .map(|(_, name)| name.to_owned())
}

impl Subject {
    /// Closes the loop with the controllers of a file; the records, further ones among them, then
    /// have commands as inputs.
    fn closed(
        self,
        file: &Path,
        (dataset, also): (Dataset, Vec<Dataset>),
        terms: &[Request],
        effects: &[With],
    ) -> Result<(Self, Dataset), CliError> {
        let controllers = controllers(file, dataset.nq())?;
        let open = dataset.clone();
        let also: Vec<Dataset> = also
            .into_iter()
            .map(|d| controllers.close(d))
            .collect::<Result<_, _>>()?;
        let dataset = controllers.close(dataset)?.merged(also)?;
        let model = models::by_name(&self.name)?.model;
        let extended = Extended::new(model, terms)?;
        let inner = with::extended(Box::new(extended), effects, (model, &open))?;
        let closed = ClosedLoop::new(inner).map_err(ControlError::from)?;
        let origin = Origin::Closed(Box::new(closed));
        Ok((Self { origin, ..self }, dataset))
    }

    /// The same model with effects of the library.
    fn with_effects(self, effects: &[With], dataset: &Dataset) -> Result<Self, CliError> {
        if effects.is_empty() {
            return Ok(self);
        }
        let inner = boxed(self.origin).ok_or(CliError::PrivateOfFile)?;
        let declared = models::by_name(&self.name)?.model;
        let records = (declared as &dyn Dynamics, dataset);
        let origin = Origin::WithEffects(with::extended(inner, effects, records)?);
        Ok(Self { origin, ..self })
    }

    /// The same model with parameters of single records and with lags of readings, as the options say.
    fn wrapped(mut self, source: &Source, dataset: &mut Dataset) -> Result<Self, CliError> {
        if !source.private.is_empty() {
            let inner = boxed(self.origin).ok_or(CliError::PrivateOfFile)?;
            let own = PerRecord::new(inner, &source.private, dataset)?;
            self.origin = Origin::PerRecord(Box::new(own));
        }
        if !source.velocity_lag.is_empty() {
            let inner = boxed(self.origin).ok_or(CliError::LagOfFile)?;
            let records = dataset.clone();
            let names = match source.velocity_lag.iter().any(|n| n == "all") {
                true => Vec::new(),
                false => source.velocity_lag.clone(),
            };
            let model = Lagging::new(inner, &names, dataset)?;
            self.origin = Origin::Lagging(Box::new((model, records)));
        }
        Ok(self)
    }
}

/// A declared model and its wrappers as one more to wrap.
fn boxed(origin: Origin) -> Option<Box<dyn Hessian>> {
    Some(match origin {
        Origin::Compiled(model) => Box::new(Extended::new(model, &[]).ok()?),
        Origin::Extended(model) => model,
        Origin::Closed(model) => model,
        Origin::PerRecord(model) => model,
        Origin::WithEffects(model) => model,
        _ => return None,
    })
}

/// The data with its inputs as the options say.
fn as_stated(dataset: Dataset, source: &Source) -> Result<Dataset, CliError> {
    let dataset = with_inputs(dataset, source)?;
    match source.open.gain.as_slice() {
        [] => Ok(dataset),
        gains => Ok(dataset.with_input_gains(gains)?),
    }
}

/// The data with kind and origin of its inputs as the options say.
fn with_inputs(mut dataset: Dataset, source: &Source) -> Result<Dataset, CliError> {
    if source.measured_torque {
        dataset = dataset.with_measured_torques()?;
    }
    if let Some(hold) = source.open.input_hold {
        dataset.input_hold = hold.into();
    }
    match source.open.targets {
        true => Ok(dataset.with_targets()?),
        false => Ok(dataset),
    }
}

/// Writes fit.json and report.html and prints the summary, or the text of fit.json if that is asked for.
pub(crate) fn deliver(report: &Report, out: &Path, as_json: bool) -> Result<(), CliError> {
    make_folder(out)?;
    let (json, html) = (out.join("fit.json"), out.join("report.html"));
    let text = report.to_json()?;
    write(&json, &text)?;
    write(&html, &report.to_html())?;
    let written = format!("written: {}, {}", html.display(), json.display());
    match as_json {
        true => {
            output::print(&format!("{}\n", text.trim_end()));
            output::message(&written);
        }
        false => output::print(&format!("{}\n{written}\n", report.to_text())),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::load;
    use crate::args::{Cli, Command};
    use clap::Parser;

    #[test]
    fn a_model_needs_a_folder_and_stands_alone() {
        for (line, message) in [
            (
                "simtrue identify emps",
                "`emps` is given without a data folder",
            ),
            (
                "simtrue identify chekc",
                "there is no command `chekc`, did you mean `check`?",
            ),
            (
                "simtrue identify --urdf arm.urdf emps data",
                "model `emps` and a description by --urdf or --nominal are given",
            ),
            (
                "simtrue identify --urdf nowhere.urdf data",
                "nowhere.urdf: cannot be read",
            ),
        ] {
            let cli = Cli::try_parse_from(line.split(' ')).unwrap();
            let Some(Command::Identify(args)) = cli.command else {
                panic!("{cli:?}")
            };
            let error = load(&args.source).err().expect(line).to_string();
            assert!(error.contains(message), "{line}: {error}");
        }
    }
}
