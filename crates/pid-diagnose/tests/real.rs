//! Records of real machines, where they lie beside the workspace.

use std::path::Path;

use pid_diagnose::diagnosis::Diagnosis;
use pid_diagnose::report::Report;
use pid_diagnose::search::Settings;

fn run(name: &str) -> Option<Diagnosis> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = pid_records::shared(&format!("data/{name}"))?;
    let nominal = root.join("robots").join(format!("{name}.toml"));
    let report = Report::of_files(&folder, &nominal, &Settings::default(), false)
        .expect("records and a description that fit each other");
    Some(report.diagnosis)
}

/// The field knows of friction that differs between directions.
#[test]
fn a_positioning_drive_has_direction_dependent_friction() {
    let Some(d) = run("emps") else { return };
    assert_eq!(
        (d.verdict.word(), d.verdict.joint()),
        ("coulomb_asymmetry", Some(1))
    );
    assert!(d.gap_after < 0.5 * d.gap_before, "{}", d.gap_after);
    // Nothing explains a machine down to its encoder: that is said too.
    let left = d.remainder.expect("something is left");
    assert!((0.7..0.999).contains(&left.explained), "{}", left.explained);
    assert_eq!(left.missing_force.len(), 1);
}
