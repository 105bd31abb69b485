//! A short form of `pid-studies faults`: every kind of fault in some drawn robots; what is mended; clean ones.

use std::path::PathBuf;
use std::sync::LazyLock;

use pid_data::Dataset;
use pid_preflight::{Finding, FindingKind, Settings, Severity, check, fix};
use pid_withheld::{Plan, lay_out};

use crate::findings::PENDULUM;
use crate::plant::{Draws, KINDS, Planted, described, names, plant};

/// Drawn cases of up to two joints.
const CASES: usize = 3;

/// Laid out once: tests run side by side, and one must not read a file that another is writing.
static DRAWN: LazyLock<Vec<(Dataset, String)>> = LazyLock::new(|| {
    let plan = Plan {
        seed: 2024,
        cases: CASES,
        joints: 2,
        nulls: false,
    };
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("preflight");
    let case = |i| {
        let here = lay_out(&plan, i, &folder).unwrap();
        let text = std::fs::read_to_string(here.join("nominal.toml")).unwrap();
        (Dataset::read(&here).unwrap(), text)
    };
    (0..CASES).map(case).collect()
});

fn settings() -> Settings {
    Settings {
        determinable: false,
        // A third of the usual samples: the test is a short form.
        points: 1300,
        ..Settings::default()
    }
}

fn wrong(findings: &[Finding]) -> Vec<String> {
    let wrong = findings.iter().filter(|f| f.severity == Severity::Wrong);
    wrong.map(ToString::to_string).collect()
}

/// Faults that `fix` takes out of the records; gravity stands in the description, and inputs that were
/// never recorded do not come back.
fn mendable(planted: &Planted) -> bool {
    !["wrong gravity", "zero effort"].contains(&planted.kind)
}

fn all_kinds(i: usize) {
    let (data, text) = &DRAWN[i];
    let found = check(data, &described(text), &settings());
    assert!(
        wrong(&found).is_empty(),
        "case {i}, clean: {:#?}",
        wrong(&found)
    );
    let mut draws = Draws(7 + i as u64);
    let mut planted_kinds = 0;
    for kind in KINDS {
        let Some(planted) = plant(kind, data, text, &mut draws) else {
            continue;
        };
        planted_kinds += 1;
        let nominal = described(&planted.nominal);
        let found = check(&planted.data, &nominal, &settings());
        let named = found.iter().filter(|f| names(f, &planted)).count();
        assert!(
            named > 0,
            "case {i}, {kind} at {:?} {}: {found:#?}",
            planted.joints,
            planted.place
        );
        if mendable(&planted) {
            let (mended, done) = fix(&planted.data, &found);
            assert!(!done.is_empty(), "case {i}, {kind}");
            let left = check(&mended, &nominal, &settings());
            assert!(
                wrong(&left).is_empty(),
                "case {i}, {kind} mended by {done:?}: {:#?}",
                wrong(&left)
            );
        }
    }
    assert!(planted_kinds >= 9, "case {i} took {planted_kinds} kinds");
}

#[test]
fn every_kind_is_found_and_mended_in_drawn_robots() {
    (0..CASES).for_each(all_kinds);
}

#[test]
fn mended_columns_are_those_of_the_clean_record() {
    let two = DRAWN.iter().find(|(data, _)| data.nq() == 2);
    let (data, text) = two.unwrap();
    for kind in [
        "swapped inputs",
        "flipped input",
        "milli-units",
        "wrapped angle",
        "milliseconds",
    ] {
        let planted = plant(kind, data, text, &mut Draws(3)).unwrap();
        assert_ne!(&planted.data, data, "{kind} changes the records");
        let found = check(&planted.data, &described(text), &settings());
        let (mended, _) = fix(&planted.data, &found);
        for (a, b) in mended.experiments.iter().zip(&data.experiments) {
            // A wrapped angle may come back whole turns off, which is the same angle.
            let turn = |j: usize| {
                let off = (a.q[j] - b.q[j]) / std::f64::consts::TAU;
                assert!(
                    (off - off.round()).abs() < 1e-9,
                    "{kind}: joint {j} is {off} turns off"
                );
                off.round() * std::f64::consts::TAU
            };
            let turns = [turn(0), turn(1)];
            let near = |x: &[f64], y: &[f64], shift: [f64; 2]| {
                x.iter()
                    .zip(y)
                    .enumerate()
                    .all(|(k, (x, y))| (x - y - shift[k % 2]).abs() <= 1e-9 * (1.0 + y.abs()))
            };
            assert!(near(&a.q, &b.q, turns), "{kind}: positions of {}", a.name);
            assert!(near(&a.u, &b.u, [0.0; 2]), "{kind}: inputs of {}", a.name);
            assert!(near(&a.t, &b.t, [0.0; 2]), "{kind}: times of {}", a.name);
        }
    }
}

#[test]
fn whole_turns_are_no_fault() {
    let (mut data, text) = DRAWN[0].clone();
    let hinge = data.joints.iter().position(|j| !j.prismatic).unwrap();
    let n = data.nq();
    for e in &mut data.experiments {
        e.q.iter_mut()
            .skip(hinge)
            .step_by(n)
            .for_each(|q| *q += 3.0 * std::f64::consts::TAU);
    }
    let found = check(&data, &described(&text), &settings());
    assert!(wrong(&found).is_empty(), "{found:#?}");
}

#[test]
fn two_faults_in_one_record_are_both_found() {
    let two = DRAWN.iter().find(|(data, _)| data.nq() == 2);
    let (data, text) = two.unwrap();
    let mut draws = Draws(5);
    let once = plant("swapped inputs", data, text, &mut draws).unwrap();
    let twice = plant("milliseconds", &once.data, text, &mut draws).unwrap();
    let found = check(&twice.data, &described(text), &settings());
    assert!(
        found.iter().any(|f| names(f, &once)) && found.iter().any(|f| names(f, &twice)),
        "{found:#?}"
    );
    assert!(
        found
            .iter()
            .all(|f| f.severity < Severity::Wrong || names(f, &once) || names(f, &twice)),
        "{found:#?}"
    );
}

#[test]
fn a_data_set_of_another_robot_is_said_to_be_one() {
    let two = DRAWN.iter().find(|(data, _)| data.nq() == 2);
    let found = check(&two.unwrap().0, &described(PENDULUM), &settings());
    assert_eq!(found[0].kind, FindingKind::NotComparable);
    assert!(found[0].sentence.contains("has 2 joints"), "{}", found[0]);
}
