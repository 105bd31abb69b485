//! A short form of `pid-studies faults`: every kind of fault in some drawn robots; what is mended; clean ones.

use std::path::PathBuf;
use std::sync::LazyLock;

use pid_data::Dataset;
use pid_preflight::{Channel, Finding, FindingKind, Settings, Severity, check, fix};
use pid_withheld::{Drawing, Plan, lay_out};

use crate::findings::PENDULUM;
use crate::plant::{Draws, KINDS, Planted, described, names, plant};

/// Drawn cases of up to two joints.
const CASES: usize = 3;

/// Laid out once: tests run side by side, and one must not read a file that another is writing.
static DRAWN: LazyLock<Vec<(Dataset, String)>> =
    LazyLock::new(|| (0..CASES).map(|i| drawn(2024, 2, i)).collect());

/// Records and nominal description of a case of a seed, with up to so many joints.
fn drawn(seed: u64, joints: usize, i: usize) -> (Dataset, String) {
    let plan = Plan {
        seed,
        cases: i + 1,
        fewest: 1,
        joints,
        causes: Drawing::All,
    };
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("preflight-{seed}"));
    let here = lay_out(&plan, i, &folder).unwrap();
    let text = std::fs::read_to_string(here.join("nominal.toml")).unwrap();
    (Dataset::read(&here).unwrap(), text)
}

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

/// A drive that gives less than it is asked for is an effect of the robot: its input is five times what the
/// joint needs, and no factor explains it as well as a limit does. A factor that is one is still said.
#[test]
fn a_limited_drive_is_no_wrong_scale() {
    let (mut data, text) = drawn(36001, 6, 111);
    let scale = |data: &Dataset| {
        let found = check(data, &described(&text), &Settings::default());
        let off = |f: &&Finding| {
            matches!(
                f.kind,
                FindingKind::InputScale { .. } | FindingKind::Unit { .. }
            )
        };
        found.iter().find(off).map(|f| f.joints.clone())
    };
    assert_eq!(scale(&data), None);
    let (n, last) = (data.nq(), data.nq() - 1);
    for e in &mut data.experiments {
        let column = e.u.iter_mut().skip(last).step_by(n);
        column.for_each(|u| *u *= 5.0);
    }
    assert!(scale(&data).is_some_and(|joints| joints.contains(&n)));
}

/// An elastic gear at one joint hides its torque; a flipped encoder at another is found beside it.
#[test]
fn a_fault_beside_an_unexplained_joint_is_found() {
    let (mut data, text) = drawn(3001, 6, 80);
    let flipped = data.nq() - 1;
    let n = data.nq();
    for e in &mut data.experiments {
        for x in [Some(&mut e.q), e.v.as_mut()].into_iter().flatten() {
            x.iter_mut().skip(flipped).step_by(n).for_each(|x| *x = -*x);
        }
    }
    let found = check(&data, &described(&text), &Settings::default());
    let names = |f: &Finding| {
        let motion = matches!(
            f.kind,
            FindingKind::SignFlipped {
                channel: Channel::Motion,
                ..
            }
        );
        motion && f.joints == [n]
    };
    assert!(found.iter().any(names), "{found:#?}");
    assert_eq!(wrong(&found).len(), 1, "{found:#?}");
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
