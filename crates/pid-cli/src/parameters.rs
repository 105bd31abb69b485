//! Parameter values from a file: an earlier `fit.json`, or TOML lines `name = value`.

use std::collections::BTreeMap;
use std::path::Path;

use pid_report::{Report, ReportError};
use pid_runtime::dynamics::ParamInfo;
use pid_toml::{Mistake, Source, Spanned};

/// A file of parameters that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum ParameterFileError {
    /// The file cannot be read.
    #[error(
        "{file}: cannot be read: {error}\n  help: give a fit.json of `simtrue identify`, or a TOML file with lines name = value"
    )]
    Unreadable { file: String, error: std::io::Error },
    /// Not a report.
    #[error("{file}: {error}")]
    Report { file: String, error: ReportError },
    /// Not lines of name and value.
    #[error("{0}\n  the form: one line `name = value` per parameter, or a fit.json")]
    Toml(Mistake),
    /// A name that the model does not have.
    #[error("{file}: the model has no parameter `{name}`{}", hint(.nearest.as_deref()))]
    Unknown {
        file: String,
        name: String,
        nearest: Option<String>,
    },
    /// A value outside of its bounds.
    #[error(
        "{file}: `{name}` = {value} lies outside of its bounds {lower} … {upper} {unit}\n  help: choose a value within them, or widen the range in the model"
    )]
    OutOfBounds {
        file: String,
        name: String,
        value: f64,
        lower: f64,
        upper: f64,
        unit: String,
    },
}

fn hint(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |n| format!("\n  help: did you mean `{n}`?"))
}

/// Parameter values in the model's order: nominal ones, replaced by those of the file.
///
/// # Errors
/// [`ParameterFileError`], naming the file and the parameter.
pub(crate) fn read(path: &Path, params: &[ParamInfo]) -> Result<Vec<f64>, ParameterFileError> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|error| ParameterFileError::Unreadable {
        file: file.clone(),
        error,
    })?;
    parse(&file, &text, params)
}

/// The name that a mistyped one may stand for.
pub(crate) fn nearest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Option<String> {
    names
        .map(|n| (strsim::osa_distance(name, n), n))
        .filter(|(distance, n)| *distance <= n.len() / 2)
        .min()
        .map(|(_, n)| n.to_owned())
}

/// A named value with the places of both; a report has no lines that one would mend, so its file is
/// the place.
struct Named {
    name: String,
    key: String,
    place: String,
    value: f64,
}

fn named(file: &str, text: &str) -> Result<Vec<Named>, ParameterFileError> {
    if text.trim_start().starts_with('{') {
        let report = Report::from_json(text).map_err(|error| ParameterFileError::Report {
            file: file.to_owned(),
            error,
        })?;
        let parameters = report.parameters.into_iter();
        return Ok(parameters
            .map(|p| Named {
                name: p.name,
                key: file.to_owned(),
                place: file.to_owned(),
                value: p.value,
            })
            .collect());
    }
    let source = Source::new(file, text);
    let read: BTreeMap<Spanned<String>, Spanned<f64>> =
        source.parse().map_err(ParameterFileError::Toml)?;
    let one = |(name, value): (Spanned<String>, Spanned<f64>)| Named {
        key: source.place_of(&name).to_string(),
        place: source.place_of(&value).to_string(),
        name: name.into_inner(),
        value: value.into_inner(),
    };
    Ok(read.into_iter().map(one).collect())
}

fn parse(file: &str, text: &str, params: &[ParamInfo]) -> Result<Vec<f64>, ParameterFileError> {
    let mut values: Vec<f64> = params.iter().map(|p| p.nominal).collect();
    for Named {
        name,
        key,
        place,
        value,
    } in named(file, text)?
    {
        let Some(i) = params.iter().position(|p| p.name == name) else {
            let nearest = nearest(&name, params.iter().map(|p| &*p.name));
            return Err(ParameterFileError::Unknown {
                file: key,
                name,
                nearest,
            });
        };
        let info = &params[i];
        if !(info.lower..=info.upper).contains(&value) {
            return Err(ParameterFileError::OutOfBounds {
                file: place,
                name,
                value,
                lower: info.lower,
                upper: info.upper,
                unit: info.unit.to_string(),
            });
        }
        values[i] = value;
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use pid_models::TwoLink;
    use pid_runtime::dynamics::Dynamics;

    use super::*;

    #[test]
    fn named_values_replace_nominal_ones() {
        let p = parse("s.toml", "m2 = 20.0\niz1 = 0.05\n", TwoLink.params()).unwrap();
        assert_eq!((p[0], p[1], p[7]), (6.0, 20.0, 0.05));
    }

    #[test]
    fn mistakes_name_file_parameter_and_mend() {
        let text = |s: &str| {
            parse("s.toml", s, TwoLink.params())
                .unwrap_err()
                .to_string()
        };
        let unknown = text("dry_elbw = 1.0");
        assert!(
            unknown.starts_with("s.toml:1:1: ") && unknown.contains("did you mean `dry_elbow`"),
            "{unknown}"
        );
        let outside = text("m1 = 600.0");
        assert!(
            outside.starts_with("s.toml:1:6: `m1` = 600") && outside.contains("0.6 … 60 kg"),
            "{outside}"
        );
        assert!(text("m1 = nan").contains("`m1` = NaN"));
        assert!(text("m1 : 3").contains("name = value"));
        assert!(text("{\"a\": 1}").contains("not a report"));
        let missing = read(Path::new("no/such.toml"), TwoLink.params())
            .unwrap_err()
            .to_string();
        assert!(missing.contains("no/such.toml"));
    }
}
