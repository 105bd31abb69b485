//! What the practice cases of others show, on drawn cases of the study: nothing, an effect with its
//! size, and what has no name.

use pid_diagnose::case::Case;
use pid_diagnose::diagnosis::{Diagnosis, Verdict};
use pid_diagnose::search::{Settings, diagnose};
use pid_withheld::Kind;

use crate::drawn::{Drawn, first};

fn run(case: &Drawn) -> Diagnosis {
    let case = Case::read(case.folder()).expect("a valid case");
    diagnose(&case, &Settings::default())
}

/// The named magnitude is the drawn one, within three of its standard deviations.
fn assert_magnitude(d: &Diagnosis, name: &str, drawn: f64) {
    let mut all = d.effects[0].parameters.iter();
    let found = all.find(|p| p.name == name).expect("of that name");
    let std = found.std.expect("determined");
    assert!(
        (found.value - drawn).abs() < 3.0 * std && std < 0.2 * drawn.abs(),
        "{name}: {} ± {std} for {drawn}",
        found.value
    );
}

#[test]
fn nothing_is_named_where_nothing_is_missing() {
    let d = run(&first("nothing", |kind| kind.is_none()));
    assert_eq!(d.verdict, Verdict::Nothing);
    assert!(d.gap_before < 1.5 * d.gap_floor, "{}", d.gap_before);
    assert!((d.misfit.0 - 1.0).abs() < 0.1, "{:?}", d.misfit);
}

#[test]
fn a_friction_curve_is_named_with_its_size() {
    let case = first("stribeck", |k| matches!(k, Some(Kind::Stribeck { .. })));
    let d = run(&case);
    assert_eq!((d.verdict.word(), d.verdict.joint()), ("stribeck", Some(1)));
    let Kind::Stribeck { ratio, speed } = case.truth.causes[0].kind else {
        panic!("asked for");
    };
    assert_magnitude(&d, "static_to_coulomb", ratio);
    assert_magnitude(&d, "stribeck_velocity", speed);
    assert!(d.gap_after < 1.5 * d.gap_floor, "{}", d.gap_after);
}

#[test]
fn an_elastic_joint_is_named_with_its_stiffness() {
    let case = first("elastic", |k| {
        matches!(k, Some(Kind::JointElasticity { .. }))
    });
    let d = run(&case);
    assert_eq!(
        (d.verdict.word(), d.verdict.joint()),
        ("joint_elasticity", Some(1))
    );
    let Kind::JointElasticity { stiffness, .. } = case.truth.causes[0].kind else {
        panic!("asked for");
    };
    assert_magnitude(&d, "stiffness", stiffness);
}

#[test]
fn what_is_not_in_the_library_is_unknown() {
    let case = first("outside", |k| k.is_some_and(|k| k.id() == "unknown"));
    assert_eq!(
        run(&case).verdict,
        Verdict::Unknown,
        "{:?}",
        case.truth.causes
    );
}
