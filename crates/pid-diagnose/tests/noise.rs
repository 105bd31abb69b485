//! Noise levels that are not stated are found from the records.

use std::path::Path;

use pid_data::Dataset;
use pid_diagnose::case::Case;
use pid_diagnose::nominal::Nominal;
use pid_diagnose::search::{Settings, search};
use pid_withheld::Kind;

use crate::drawn::first;

/// The case with and without its stated noise figures.
fn both(folder: &Path) -> (Case, Case) {
    let dataset = Dataset::read(folder).expect("records");
    let text = std::fs::read_to_string(folder.join("nominal.toml")).expect("a description");
    let silent: Vec<&str> = text
        .lines()
        .filter(|l| {
            let key = l.split('=').next().unwrap_or("").trim();
            !["input_noise", "q_noise_std", "dq_noise_std", "q_resolution"].contains(&key)
        })
        .collect();
    let read = |text: &str| {
        let nominal = Nominal::parse(text, "nominal.toml".as_ref()).expect("a nominal robot");
        Case::new(nominal, &dataset).expect("a case")
    };
    (read(&text), read(&silent.join("\n")))
}

fn drive_noise_is_found(folder: &Path, effect: &str) {
    let (stated, silent) = both(folder);
    assert!(stated.noise[0].stated && !silent.noise[0].stated);
    let found = search(&silent, &Settings::default());
    assert_eq!(found.verdict().word(), effect);
    let ratio = found.case.noise[0].torque / stated.noise[0].torque;
    assert!((0.75..1.33).contains(&ratio), "{effect}: {ratio}");
}

/// With nothing missing, and with an effect that the nominal structure would take for much more noise.
#[test]
fn drive_noise_is_found_whether_an_effect_is_there_or_not() {
    let nothing = first("nothing-noise", |kind| kind.is_none());
    drive_noise_is_found(nothing.folder(), "none");
    let drag = first("drag-noise", |k| {
        matches!(k, Some(Kind::QuadraticDrag { .. }))
    });
    drive_noise_is_found(drag.folder(), "quadratic_drag");
}

#[test]
fn drive_noise_of_practice_cases_is_found() {
    for (name, effect) in [("p03", "none"), ("p08", "quadratic_drag")] {
        let Some(folder) = pid_records::shared(&format!("blind/{name}")) else {
            return;
        };
        drive_noise_is_found(&folder, effect);
    }
}
