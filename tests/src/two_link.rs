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
use pid_runtime::dynamics::Dynamics;

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
/// # Panics
/// If the table cannot be read, lacks a column or holds something that is no number.
pub fn starts(table: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(table).unwrap_or_else(|e| panic!("{}: {e}", table.display()));
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let at: Vec<usize> = TwoLink
        .params()
        .iter()
        .map(|p| {
            let name = column(&p.name);
            let found = header.iter().position(|h| h.eq_ignore_ascii_case(&name));
            found.unwrap_or_else(|| panic!("{}: no column {name}", table.display()))
        })
        .collect();
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            at.iter()
                .map(|&k| cells[k].parse().expect("a number"))
                .collect()
        })
        .collect()
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
