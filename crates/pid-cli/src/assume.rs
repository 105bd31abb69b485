//! Assumptions about noise and parameters, from a file, a nominal description and options.

use std::path::Path;

use pid_data::Dataset;
use pid_diagnose::with_effects::Assembled;
use pid_fit::ident::assumptions::Assumptions;
use pid_fit::ident::{Likelihood, Settings};
use pid_fit::transcribe::Loss;
use pid_interpret::nominal::Nominal;
use pid_runtime::dynamics::Hessian;

use crate::args::identify::IdentifyArgs;
use crate::constrain;
use crate::error::CliError;
use crate::source::Subject;

/// Puts likelihood, held parameters and the form of the covariance into the settings; starts of
/// parameters besides.
pub(crate) fn apply(
    args: &IdentifyArgs,
    subject: &Subject,
    dataset: &Dataset,
    settings: &mut Settings,
) -> Result<Vec<(usize, f64)>, CliError> {
    let model = subject.model();
    let mut values = Vec::new();
    let mut likelihood = subject.nominal().map(|(n, with)| from_nominal(n, with));
    if let Some(path) = &args.assume {
        let found = read(path, model, dataset)?;
        settings.hold.extend(found.hold);
        values = found.values;
        likelihood = Some(found.likelihood);
    }
    if args.likelihood {
        likelihood.get_or_insert_default();
    }
    if let Some(loss) = args.loss {
        likelihood.get_or_insert_default().loss = loss;
    }
    for name in &args.hold {
        let position = model.params().iter().position(|p| p.name == *name);
        settings
            .hold
            .push(position.ok_or_else(|| CliError::NoParameter {
                option: "--hold",
                name: name.clone(),
            })?);
    }
    let relations = args.constrain.iter();
    let relations = relations.map(|text| constrain::parse(text, model));
    settings.constraints = relations.collect::<Result<_, _>>()?;
    settings.likelihood = likelihood;
    settings.sandwich = args.sandwich;
    Ok(values)
}

/// Reads a file of assumptions.
pub(crate) fn read(
    path: &Path,
    model: &dyn Hessian,
    dataset: &Dataset,
) -> Result<Assumptions, CliError> {
    let text = std::fs::read_to_string(path).map_err(|error| CliError::Read {
        path: path.to_owned(),
        error,
    })?;
    let file = path.display().to_string();
    Ok(Assumptions::parse(&file, &text, model, dataset)?)
}

/// The likelihood of a description: priors from tolerances (uniform within ± tolerance: a deviation of
/// tolerance/√3), stated noise of sensors.
pub fn from_nominal(nominal: &Nominal, with: &Assembled) -> Likelihood {
    Likelihood {
        noise: with.noise.clone(),
        loss: Loss::Square,
        priors: with.priors(nominal),
    }
}
