//! The two-link problem of K. Schäfer, M. Runge, K. Flaßkamp, C. Büskens, Section V-A: settings,
//! starts, simulated records.

use std::fs;
use std::path::Path;

use pid_data::{
    Dataset, Experiment, Horizon, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_fit::ident::{InitialState, Method, Settings, Weighting};
use pid_fit::integrate::{self, Drive, SimulateError};
use pid_fit::transcribe::Scheme;
use pid_models::TwoLink;
use pid_runtime::dynamics::{Dynamics, ParamInfo};

/// The paper's setting: one window with a free initial state, unit weights; the preparing fits of
/// the defaults.
pub fn settings(scheme: Scheme) -> Settings {
    Settings {
        method: Method::FullDiscretization,
        scheme,
        horizon: Horizon::Record,
        initial_state: InitialState::Free,
        weighting: Weighting::Unit,
        ..Settings::default()
    }
}

/// Nominal values, those of Table II.
pub fn truth() -> Vec<f64> {
    TwoLink.params().iter().map(|p| p.nominal).collect()
}

/// Name of a parameter of [`TwoLink`] in the table of starts: κ₁ is `k1`, the factor of the tanh.
fn column(parameter: &str) -> String {
    let joint = if parameter.ends_with("_elbow") { 2 } else { 1 };
    let letter = match parameter.split('_').next() {
        Some("dry") => "k1",
        Some("viscous") => "k2",
        Some("gain") => "k3",
        Some("sharp") => "a",
        _ => return parameter.to_owned(),
    };
    format!("{letter}_{joint}")
}

/// Starts from a table with one row per start and a column per parameter, in the order of [`TwoLink`].
///
/// # Errors
/// The place in the table that cannot be read, and what belongs there.
pub fn starts(table: &Path) -> Result<Vec<Vec<f64>>, String> {
    let text = fs::read_to_string(table).map_err(|e| e.to_string());
    text.and_then(|text| rows(&text)).map_err(|e| {
        let belongs = "a CSV with a row per start and a column per parameter of the two-link robot";
        format!("{}: {e}\n  help: {belongs}", table.display())
    })
}

/// The rows of a table of starts.
fn rows(text: &str) -> Result<Vec<Vec<f64>>, String> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let place = |p: &ParamInfo| {
        let name = column(&p.name);
        let found = header.iter().position(|h| h.eq_ignore_ascii_case(&name));
        found.ok_or_else(|| format!("line 1: no column `{name}`"))
    };
    let places: Vec<usize> = (TwoLink.params().iter().map(place)).collect::<Result<_, _>>()?;
    let row = |(row, line): (usize, &str)| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |&k: &usize| {
            let cell = cells.get(k).copied().unwrap_or_default();
            let number = cell.parse().ok().filter(|x: &f64| x.is_finite());
            let place = || format!("line {}, column `{}`", row + 2, header[k]);
            number.ok_or_else(|| format!("{}: `{cell}` is no number", place()))
        };
        places.iter().map(number).collect()
    };
    let rows: Vec<Vec<f64>> = lines.enumerate().map(row).collect::<Result<_, String>>()?;
    if rows.is_empty() {
        return Err("no row below the names of the columns".to_owned());
    }
    Ok(rows)
}

/// Amplitude, frequency in Hz and phase of a current's parts.
type Multisine = [(f64, f64, f64)];

fn multisine(parts: &Multisine, t: f64) -> f64 {
    let part =
        |&(a, f, phase): &(f64, f64, f64)| a * (2.0 * std::f64::consts::PI * f * t + phase).sin();
    parts.iter().map(part).sum()
}

/// Currents of the shoulder.
const SHOULDER: &Multisine = &[
    (12.0, 0.25, 0.0),
    (12.0, 0.60, 1.0),
    (10.0, 1.10, 2.0),
    (8.0, 1.90, 0.5),
    (6.0, 3.10, 4.0),
];
/// Currents of the elbow.
const ELBOW: &Multisine = &[
    (70.0, 0.20, 0.3),
    (60.0, 0.45, 2.1),
    (50.0, 0.80, 4.0),
    (40.0, 1.40, 1.2),
    (30.0, 2.30, 5.0),
];

/// The training motion with `samples` samples over 6 s, simulated accurately with parameters `p`.
///
/// # Errors
/// If the motion cannot be simulated.
pub fn simulated(p: &[f64], samples: usize) -> Result<Dataset, SimulateError> {
    let h = 6.0 / (samples - 1) as f64;
    let t: Vec<f64> = (0..samples).map(|k| k as f64 * h).collect();
    let u: Vec<f64> = t
        .iter()
        .flat_map(|&t| [multisine(SHOULDER, t), multisine(ELBOW, t)])
        .collect();
    let hold = InputHold::ZeroOrder;
    let drive = Drive { t: &t, u: &u, hold };
    let settings = integrate::Settings::default();
    let motion = integrate::simulate(&TwoLink, p, &[0.3, 2.2], &[0.0; 2], &drive, settings)?;
    let joint = |name: &str| JointChannels {
        name: name.to_owned(),
        prismatic: false,
        input: InputQuantity::Current,
        input_unit: "A".to_owned(),
        velocity: VelocityKind::Measured,
    };
    Ok(Dataset {
        name: "two_link".to_owned(),
        title: "Two-link robot, simulated".to_owned(),
        source: "simulated for a test".to_owned(),
        license: "CC0-1.0".to_owned(),
        kind: Kind::Simulated,
        input_hold: hold,
        joints: vec![joint("shoulder"), joint("elbow")],
        experiments: vec![Experiment {
            name: "train".to_owned(),
            role: Role::Train,
            note: String::new(),
            nq: 2,
            t,
            q: motion.q,
            v: Some(motion.v),
            u,
            tau: None,
            qref: None,
            missing: 0,
            gain_factors: Default::default(),
        }],
        warnings: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_of_starts_is_read_by_the_names_of_its_columns() {
        let names: Vec<String> = (TwoLink.params().iter().rev())
            .map(|p| column(&p.name).to_uppercase())
            .collect();
        let cells: Vec<String> = (0..names.len()).map(|k| format!("{k}.5")).collect();
        let table = format!("{}\n{}\n", names.join(","), cells.join(","));
        let last = (names.len() - 1) as f64 + 0.5;
        let found = rows(&table).expect("a table");
        assert_eq!((found.len(), found[0].len()), (1, names.len()));
        assert_eq!((found[0][0], found[0][names.len() - 1]), (last, 0.5));
        let mistake = |table: &str| rows(table).expect_err("a mistake");
        let place = format!("line 2, column `{}`: `x` is no number", names[1]);
        assert_eq!(mistake(&table.replace(",1.5,", ",x,")), place);
        let first = column(&TwoLink.params()[0].name);
        let less = table.replace(&names[names.len() - 1], "other");
        assert_eq!(mistake(&less), format!("line 1: no column `{first}`"));
        assert!(mistake(&names.join(",")).contains("no row"));
    }
}
