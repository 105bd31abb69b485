//! Model and data from the arguments, results into their folder.

use std::path::Path;

use pid_data::{Dataset, InputHold, InputQuantity};
use pid_diagnose::with_effects::Assembled;
use pid_fit::wrap::controllers::{ControlError, Controllers};
use pid_fit::wrap::lag::Lagging;
use pid_fit::wrap::private::PerRecord;
use pid_interpret::Model;
use pid_interpret::nominal::Nominal;
use pid_report::Report;
use pid_runtime::control::ClosedLoop;
use pid_runtime::dynamics::{Dynamics, Hessian};
use pid_runtime::extend::Extended;
use pid_runtime::term::Request;
use pid_urdf::{Description, Inertias, Options};

use crate::args::{HoldArg, InertiasArg, Source};
use crate::error::{CliError, make_folder, write};
use crate::with::{self, With};
use crate::{demo, models, output};

/// A model and its name.
pub(crate) struct Subject {
    pub(crate) name: String,
    pub(crate) summary: String,
    pub(crate) source: String,
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
    pub(crate) fn judged<'a>(
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

    /// The nominal description it came from, if it came from one, and its model.
    pub(crate) fn nominal(&self) -> Option<(&Nominal, &Assembled)> {
        match &self.origin {
            Origin::Nominal(nominal) => Some((&nominal.1, &nominal.0)),
            _ => None,
        }
    }

    /// Of a description, without its effects.
    fn from_nominal(file: &Path) -> Result<Self, CliError> {
        let nominal = Nominal::read(file)?;
        let plain = Assembled::without_effects(&nominal)?;
        Ok(Self::described(nominal, plain))
    }

    /// The same with the effects of its description; records get the columns that these need.
    fn with_effects(self, dataset: &mut Dataset) -> Result<Self, CliError> {
        match self.origin {
            Origin::Nominal(nominal) if !nominal.1.effects().is_empty() => {
                let with = Assembled::new(&nominal.1, dataset)?;
                Ok(Self::described(nominal.1, with))
            }
            origin => Ok(Self { origin, ..self }),
        }
    }

    fn described(nominal: Nominal, with: Assembled) -> Self {
        let dims = with.model.dims();
        Self {
            name: with.model.name().to_owned(),
            summary: format!("{} coordinates, {} parameters", dims.nq, dims.np),
            source: nominal.file().display().to_string(),
            origin: Origin::Nominal(Box::new((with, nominal))),
        }
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
            output::print(&format!("warning: {warning}\n"));
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
            summary: format!(
                "{} coordinates, {} parameters",
                model.dims().nq,
                model.dims().np
            ),
            source: file.display().to_string(),
            origin: Origin::Urdf(Box::new(FromUrdf {
                model,
                description,
                options,
            })),
        })
    }

    /// Writes the URDF with these parameters beside the report, for a model that came from one.
    pub(crate) fn write_urdf(&self, values: &[f64], out: &Path) -> Result<(), CliError> {
        let Origin::Urdf(urdf) = &self.origin else {
            return Ok(());
        };
        let params = urdf.model.params();
        let value = |name: &str| Some(values[params.iter().position(|p| p.name == name)?]);
        let written = pid_urdf::write(&urdf.description, &urdf.options, value);
        make_folder(out)?;
        let file = out.join("identified.urdf");
        write(&file, &written.text)?;
        output::print(&format!("written: {}\n", file.display()));
        for lost in &written.lost {
            output::print(&format!("  not in it: {lost}\n"));
        }
        Ok(())
    }
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
    load_with(source, source.controller.as_deref(), false)
}

/// As [`load`], with the recorded inputs whatever controllers there are, and effects in their linear form.
pub(crate) fn load_open(source: &Source) -> Result<(Subject, Dataset), CliError> {
    load_with(source, None, true)
}

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
    // With --urdf or --nominal the one positional argument is the folder.
    let description = source.urdf.as_ref().or(source.nominal.as_ref());
    let (subject, folder) = match (description, &source.model, &source.folder) {
        (Some(file), folder, None) => (
            match source.nominal {
                Some(_) => Subject::from_nominal(file)?,
                None => Subject::from_urdf(file, source)?,
            },
            folder.as_ref().map(Path::new),
        ),
        (Some(_), Some(model), Some(_)) => {
            return Err(CliError::TwoModels {
                model: model.clone(),
            });
        }
        (_, Some(model), None) => {
            return Err(CliError::NoFolder {
                model: model.clone(),
            });
        }
        (_, model, folder) => {
            let name = model.as_deref().unwrap_or(demo::MODEL);
            (Subject::compiled(name, &terms)?, folder.as_deref())
        }
    };
    let dataset = match (folder, description) {
        (Some(folder), _) => Dataset::read(folder)?,
        (None, Some(file)) => {
            return Err(CliError::NoFolder {
                model: file.display().to_string(),
            });
        }
        (None, None) => demo::dataset()?,
    };
    let mut subject = subject;
    let mut dataset = as_stated(dataset, source)?;
    let also: Vec<Dataset> = source
        .also
        .iter()
        .map(|folder| as_stated(Dataset::read(folder)?, source))
        .collect::<Result<_, CliError>>()?;
    match controller {
        Some(file) => {
            let controllers = controllers(file, dataset.nq())?;
            let open = dataset.clone();
            dataset = merge(
                controllers.close(dataset)?,
                also.into_iter()
                    .map(|d| controllers.close(d))
                    .collect::<Result<_, _>>()?,
            )?;
            let model = models::by_name(&subject.name)?.model;
            let extended = Extended::new(model, &terms)?;
            let inner = with::extended(Box::new(extended), &effects, (model, &open))?;
            let closed = ClosedLoop::new(inner).map_err(ControlError::from)?;
            subject.origin = Origin::Closed(Box::new(closed));
        }
        None => {
            dataset = merge(dataset, also)?;
            subject = subject.with_effects(&mut dataset)?;
            if !effects.is_empty() {
                let inner = boxed(subject.origin).ok_or(CliError::PrivateOfFile)?;
                let declared = models::by_name(&subject.name)?.model;
                let records = (declared as &dyn Dynamics, &dataset);
                subject.origin = Origin::WithEffects(with::extended(inner, &effects, records)?);
            }
        }
    }
    if !source.private.is_empty() {
        let inner = boxed(subject.origin).ok_or(CliError::PrivateOfFile)?;
        let own = PerRecord::new(inner, &source.private, &mut dataset)?;
        subject.origin = Origin::PerRecord(Box::new(own));
    }
    if !source.velocity_lag.is_empty() {
        let inner = boxed(subject.origin).ok_or(CliError::LagOfFile)?;
        let records = dataset.clone();
        let names = match source.velocity_lag.iter().any(|n| n == "all") {
            true => Vec::new(),
            false => source.velocity_lag.clone(),
        };
        let model = Lagging::new(inner, &names, &mut dataset)?;
        subject.origin = Origin::Lagging(Box::new((model, records)));
    }
    dataset.check_model(subject.model())?;
    for warning in &dataset.warnings {
        output::print(&format!("warning: {warning}\n"));
    }
    Ok((subject, dataset))
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

/// The records of several folders as one data set.
fn merge(mut dataset: Dataset, also: Vec<Dataset>) -> Result<Dataset, CliError> {
    for other in also {
        let alike = other.joints.len() == dataset.joints.len()
            && other.input_hold == dataset.input_hold
            && dataset.joints.iter().zip(&other.joints).all(|(a, b)| {
                (a.prismatic, &a.input_unit, a.velocity) == (b.prismatic, &b.input_unit, b.velocity)
            });
        if !alike {
            return Err(CliError::OtherRobot {
                first: dataset.name,
                second: other.name,
            });
        }
        dataset.name = format!("{} and {}", dataset.name, other.name);
        dataset.experiments.extend(other.experiments);
        dataset.warnings.extend(other.warnings);
    }
    Ok(dataset)
}

/// The data with its inputs as the options say.
fn as_stated(mut dataset: Dataset, source: &Source) -> Result<Dataset, CliError> {
    if source.measured_torque {
        dataset = with_measured_torques(dataset)?;
    }
    match source.input_hold {
        Some(HoldArg::Linear) => dataset.input_hold = InputHold::Linear,
        Some(HoldArg::ZeroOrder) => dataset.input_hold = InputHold::ZeroOrder,
        None => {}
    }
    match source.input_gain.as_slice() {
        [] => Ok(dataset),
        gains => with_gains(dataset, gains),
    }
}

/// The data with the measured torques as inputs.
fn with_measured_torques(mut dataset: Dataset) -> Result<Dataset, CliError> {
    for experiment in &mut dataset.experiments {
        match experiment.tau.clone() {
            Some(tau) => experiment.u = tau,
            None => {
                return Err(CliError::NoTorque {
                    record: experiment.name.clone(),
                });
            }
        }
    }
    as_forces(&mut dataset);
    dataset.input_hold = InputHold::Linear;
    Ok(dataset)
}

/// Declares the inputs to be torques or forces at the joints.
fn as_forces(dataset: &mut Dataset) {
    for joint in &mut dataset.joints {
        joint.input = match joint.prismatic {
            true => InputQuantity::Force,
            false => InputQuantity::Torque,
        };
        joint.input_unit = joint.force_unit().to_owned();
    }
}

/// The data with every input column multiplied by its factor, as torques or forces at the joints.
fn with_gains(mut dataset: Dataset, gains: &[f64]) -> Result<Dataset, CliError> {
    let nq = dataset.nq();
    if gains.len() != nq {
        return Err(CliError::InputGains {
            found: gains.len(),
            joints: nq,
        });
    }
    as_forces(&mut dataset);
    for experiment in &mut dataset.experiments {
        for row in experiment.u.chunks_exact_mut(nq) {
            row.iter_mut().zip(gains).for_each(|(u, k)| *u *= k);
        }
    }
    Ok(dataset)
}

/// Writes fit.json and report.html and prints the summary.
pub(crate) fn deliver(report: &Report, out: &Path) -> Result<(), CliError> {
    make_folder(out)?;
    let (json, html) = (out.join("fit.json"), out.join("report.html"));
    write(&json, &report.to_json()?)?;
    write(&html, &report.to_html())?;
    output::print(&report.to_text());
    output::print(&format!(
        "\nwritten: {}, {}\n",
        html.display(),
        json.display()
    ));
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
