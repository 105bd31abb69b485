//! Assumptions about noise and parameters, from a file, a nominal description and options.

use std::path::Path;

use pid_data::Dataset;
use pid_diagnose::with_effects::Assembled;
use pid_fit::ident::assumptions::Assumptions;
use pid_fit::ident::{Likelihood, Settings};
use pid_fit::transcribe::Loss;
use pid_interpret::nominal::Nominal;
use pid_runtime::dynamics::Hessian;

use crate::args::IdentifyArgs;
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

/// Priors from tolerances (uniform within ± tolerance: a deviation of tolerance/√3), stated noise of sensors.
fn from_nominal(nominal: &Nominal, with: &Assembled) -> Likelihood {
    Likelihood {
        noise: with.noise.clone(),
        loss: Loss::Square,
        priors: with.priors(nominal),
    }
}

/// Reads `square`, `huber`, `huber=1.5`, `student-t`, `student-t=4`.
///
/// # Errors
/// What is wrong with the text.
pub fn loss(text: &str) -> Result<Loss, String> {
    let (word, number) = match text.split_once('=') {
        Some((word, number)) => (word, Some(number)),
        None => (text, None),
    };
    let value = |default: f64| match number.map(str::parse::<f64>) {
        None => Ok(default),
        Some(Ok(x)) if x.is_finite() && x > 0.0 => Ok(x),
        Some(_) => Err(format!("`{text}`: the number after `=` must be above zero")),
    };
    match (word, number) {
        ("square", None) => Ok(Loss::Square),
        ("huber", _) => Ok(Loss::Huber {
            threshold: value(1.345)?,
        }),
        ("student-t", _) => Ok(Loss::StudentT {
            freedom: value(4.0)?,
        }),
        _ => Err(format!(
            "`{text}` is not a loss: square, huber=THRESHOLD or student-t=FREEDOM"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_read_and_refused() {
        assert_eq!(loss("square"), Ok(Loss::Square));
        assert_eq!(loss("huber=2"), Ok(Loss::Huber { threshold: 2.0 }));
        assert_eq!(loss("student-t"), Ok(Loss::StudentT { freedom: 4.0 }));
        for bad in ["", "square=1", "huber=0", "huber=x", "cauchy"] {
            assert!(loss(bad).is_err(), "{bad}");
        }
    }
}
