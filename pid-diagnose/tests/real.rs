//! Records of real machines, where they lie beside the workspace.

use std::path::Path;

use pid_diagnose::diagnose::{Diagnosis, Settings};
use pid_diagnose::report::Report;

fn run(name: &str) -> Option<Diagnosis> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = root.join("../../shared/data").join(name);
    if !folder.is_dir() {
        eprintln!("{name}: no records beside the workspace, skipped");
        return None;
    }
    let nominal = root.join("robots").join(format!("{name}.toml"));
    let report = Report::of_files(&folder, &nominal, &Settings::default(), false)
        .expect("records and a description that fit each other");
    Some(report.found.diagnosis)
}

/// The field knows of friction that grows with the load, and of a velocity register that lags by 20 ms.
#[test]
fn a_hobby_servo_has_load_dependent_friction_and_a_lagging_velocity() {
    let Some(d) = run("bam_xl330") else { return };
    let labels: Vec<&str> = d.effects.iter().map(|e| e.effect.as_str()).collect();
    assert_eq!(d.effect, "load_dependent_friction", "{labels:?}");
    let lag = d
        .effects
        .iter()
        .find(|e| e.effect == "velocity_filter_lag")
        .expect("the register lags");
    let seconds = lag.parameters[0].value;
    assert!((0.015..0.03).contains(&seconds), "{seconds}");
    assert!(d.gap_after < 0.5 * d.gap_before, "{}", d.gap_after);
    // Nothing explains a hobby servo down to its encoder: that is said too.
    let left = d.remainder.expect("something is left");
    assert!((0.5..0.999).contains(&left.explained), "{}", left.explained);
    assert_eq!(left.missing_force.len(), 1);
    assert!(left.missing_force[0].rms < d.missing_force[0].rms);
}
