//! Ranges to randomise over: value, standard deviation and bounds of every parameter.

use std::collections::BTreeMap;

use pid_interpret::nominal::{Effect, Nominal};
use serde::Serialize;
use serde_json::Value;

use crate::File;
use crate::error::ExportError;
use crate::machine::{Machine, Named};

/// Half the width of a normal interval of 95 % in standard deviations.
const NORMAL_95: f64 = 1.959_963_984_540_054;

/// A file of results with its name for messages.
#[derive(Debug, Clone, Copy)]
pub struct Results<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its text.
    pub text: &'a str,
}

#[derive(Debug, Serialize)]
struct Ranges {
    note: &'static str,
    parameters: Vec<Range>,
    /// Pairs of parameters and the correlation of their estimates, as a fit states them.
    correlations: Vec<(String, String, f64)>,
}

#[derive(Debug, Serialize)]
struct Range {
    name: String,
    value: f64,
    /// Standard deviation of the estimate; `null` where no record says it.
    std: Option<f64>,
    lower: Option<f64>,
    upper: Option<f64>,
    /// Where the range comes from.
    from: &'static str,
}

const NOTE: &str = "SI units. `tolerance`: the description's range of the value, without a distribution. \
`interval`: 95 % interval of the diagnosis, std is its half width over 1.96. `fit`: standard deviation of the identification. \
`correlations`: of the estimates of a fit, by name; what is not listed is not correlated. \
Draw a normal value where std is given and keep it within lower and upper; draw evenly between them otherwise.";

/// The file `ranges.json`.
pub(crate) fn file(
    nominal: &Nominal,
    machine: &Machine,
    diagnosis: Option<Results<'_>>,
    fit: Option<Results<'_>>,
) -> Result<File, ExportError> {
    let fitted = fit.map(deviations).transpose()?.unwrap_or_default();
    let mut parameters = of_robot(nominal, &fitted);
    let derived = diagnosis.map(shown).transpose()?.unwrap_or_default();
    for (stated, effect) in nominal.effects().iter().zip(&machine.effects) {
        of_effect(machine, stated, effect, &derived, &mut parameters);
    }
    let ranges = Ranges {
        note: NOTE,
        parameters,
        correlations: fit.map(correlations).transpose()?.unwrap_or_default(),
    };
    let text = serde_json::to_string_pretty(&ranges).map_err(|error| ExportError::Text {
        name: "ranges.json",
        error: error.into(),
    })?;
    Ok(File::new("ranges.json", text + "\n"))
}

/// What is known of the robot's own parameters, then of fitted parameters that are not among them.
fn of_robot(nominal: &Nominal, fitted: &Fitted) -> Vec<Range> {
    let mut parameters = Vec::new();
    let robot = nominal.robot_with(pid_interpret::nominal::Ranges::Tolerance);
    for (param, tolerance) in robot.params.iter().zip(nominal.tolerances()) {
        let own = fitted.get(&param.name);
        if tolerance.half_width == 0.0 && own.is_none() {
            continue;
        }
        let end = |x: f64| Some(x).filter(|x| x.is_finite());
        parameters.push(Range {
            name: param.name.clone(),
            value: own.map_or(param.nominal, |(value, _)| *value),
            std: own.and_then(|(_, std)| *std),
            lower: end(param.lower),
            upper: end(param.upper),
            from: if own.is_some() { "fit" } else { "tolerance" },
        });
    }
    for (name, (value, std)) in fitted {
        // Parameters of effects have no place among those of the robot.
        if robot.params.iter().all(|p| p.name != *name) {
            parameters.push(Range {
                name: name.clone(),
                value: *value,
                std: *std,
                lower: None,
                upper: None,
                from: "fit",
            });
        }
    }
    parameters
}

/// What is known of an effect: the parameters of its law, then what a diagnosis states beside them.
fn of_effect(
    machine: &Machine,
    stated: &Effect,
    effect: &Named,
    derived: &[Shown],
    out: &mut Vec<Range>,
) {
    let info = effect.term.effect.info();
    let place = match info.has_joint {
        true => format!("{}/{}", info.id, machine.joint(effect.term.joint)),
        false => info.id.to_owned(),
    };
    for (p, &value) in info.parameters.iter().zip(&effect.values) {
        let own = stated.parameters.iter().find(|own| own.name == p.name);
        let interval = own.and_then(|own| own.interval);
        out.push(Range {
            name: format!("{place}/{}", p.name),
            value,
            std: interval.map(|(low, high)| (high - low) / (2.0 * NORMAL_95)),
            lower: interval.map(|(low, _)| low),
            upper: interval.map(|(_, high)| high),
            from: if interval.is_some() {
                "interval"
            } else {
                "none"
            },
        });
    }
    let joint = info.has_joint.then_some(effect.term.joint + 1);
    for (_, _, name, value, std) in derived.iter().filter(|d| d.0 == info.id && d.1 == joint) {
        // What the diagnosis states beside the parameters of the law, such as a stiffness.
        if info.parameters.iter().all(|p| p.name != *name) {
            out.push(Range {
                name: format!("{place}/{name}"),
                value: *value,
                std: *std,
                lower: None,
                upper: None,
                from: "diagnosis",
            });
        }
    }
}

fn fault(results: Results<'_>, what: String, fit: bool) -> ExportError {
    ExportError::Results {
        name: results.name.to_owned(),
        what,
        kind: if fit { "fit.json" } else { "diagnosis.json" },
        command: if fit { "identify" } else { "diagnose" },
    }
}

fn json(results: Results<'_>, fit: bool) -> Result<Value, ExportError> {
    serde_json::from_str(results.text).map_err(|e| fault(results, format!("no JSON: {e}"), fit))
}

fn list<'v>(
    results: Results<'_>,
    value: &'v Value,
    key: &str,
    fit: bool,
) -> Result<&'v Vec<Value>, ExportError> {
    value
        .get(key)
        .and_then(Value::as_array)
        .ok_or_else(|| fault(results, format!("it has no list `{key}`"), fit))
}

/// Effect, joint from 1, name, value and standard deviation.
type Shown = (String, Option<usize>, String, f64, Option<f64>);

/// The magnitudes that a diagnosis states.
fn shown(results: Results<'_>) -> Result<Vec<Shown>, ExportError> {
    let root = json(results, false)?;
    let mut out = Vec::new();
    for effect in list(results, &root, "effects", false)? {
        let id = effect.get("effect").and_then(Value::as_str).unwrap_or("");
        let joint = effect.get("joint").and_then(Value::as_u64);
        for p in list(results, effect, "parameters", false)? {
            let (name, value) = (
                p.get("name").and_then(Value::as_str),
                p.get("value").and_then(Value::as_f64),
            );
            let (Some(name), Some(value)) = (name, value) else {
                return Err(fault(
                    results,
                    format!("a parameter of `{id}` has no name or no value"),
                    false,
                ));
            };
            let std = p.get("std").and_then(Value::as_f64);
            out.push((
                id.to_owned(),
                joint.map(|j| j as usize),
                name.to_owned(),
                value,
                std,
            ));
        }
    }
    Ok(out)
}

/// Correlations of a fit; empty for one of an earlier version, which states none.
fn correlations(results: Results<'_>) -> Result<Vec<(String, String, f64)>, ExportError> {
    let root = json(results, true)?;
    let stated = root.get("correlations").cloned();
    let stated = stated.unwrap_or(Value::Array(Vec::new()));
    serde_json::from_value(stated)
        .map_err(|e| fault(results, format!("its list `correlations`: {e}"), true))
}

/// Values and standard deviations of a fit, by name.
type Fitted = BTreeMap<String, (f64, Option<f64>)>;

fn deviations(results: Results<'_>) -> Result<Fitted, ExportError> {
    let root = json(results, true)?;
    let mut out = BTreeMap::new();
    for p in list(results, &root, "parameters", true)? {
        let name = p.get("name").and_then(Value::as_str);
        let value = p.get("value").and_then(Value::as_f64);
        let (Some(name), Some(value)) = (name, value) else {
            return Err(fault(
                results,
                "a parameter has no name or no value".to_owned(),
                true,
            ));
        };
        let std = p.get("deviation").and_then(Value::as_f64);
        out.insert(name.to_owned(), (value, std));
    }
    Ok(out)
}
