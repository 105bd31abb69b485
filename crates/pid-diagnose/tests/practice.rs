//! Practice cases of an independent simulator, where they lie beside the workspace.

use pid_diagnose::case::Case;
use pid_diagnose::diagnosis::{Diagnosis, Verdict};
use pid_diagnose::search::{Settings, diagnose};

fn run(name: &str) -> Option<Diagnosis> {
    let case = Case::read(&pid_records::shared(&format!("blind/{name}"))?).expect("a valid case");
    Some(diagnose(&case, &Settings::default()))
}

fn magnitude(d: &Diagnosis, name: &str) -> f64 {
    d.effects[0]
        .parameters
        .iter()
        .find(|p| p.name == name)
        .expect("a magnitude of that name")
        .value
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    let Some(d) = run("p03") else { return };
    assert_eq!(d.verdict, Verdict::Nothing);
    assert!(d.gap_before < 1.15 * 0.0052, "{}", d.gap_before);
    assert!(
        (d.misfit.0 - 1.0).abs() < 0.05,
        "innovations are as large as the stated noise: {:?}",
        d.misfit
    );
}

#[test]
fn a_friction_curve_is_named_with_its_size() {
    let Some(d) = run("p01") else { return };
    assert_eq!((d.verdict.word(), d.verdict.joint()), ("stribeck", Some(1)));
    assert!((magnitude(&d, "static_to_coulomb") / 2.98 - 1.0).abs() < 0.02);
    assert!((magnitude(&d, "stribeck_velocity") / 0.22131 - 1.0).abs() < 0.02);
    assert!(d.gap_after < 1.15 * 0.006862);
}

#[test]
fn an_elastic_joint_is_named_with_its_stiffness() {
    let Some(d) = run("p02") else { return };
    assert_eq!(
        (d.verdict.word(), d.verdict.joint()),
        ("joint_elasticity", Some(1))
    );
    assert!(
        (magnitude(&d, "stiffness") / 90.0 - 1.0).abs() < 0.02,
        "{}",
        magnitude(&d, "stiffness")
    );
}

#[test]
fn what_is_not_in_the_library_is_unknown() {
    let Some(d) = run("p06") else { return };
    assert_eq!(d.verdict, Verdict::Unknown);
}
