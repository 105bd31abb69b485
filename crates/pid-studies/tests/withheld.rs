//! The withheld-effect study: the same plan gives the same cases, what is there is not made again,
//! scores count as they say.

use pid_diagnose::diagnosis::Verdict;
use pid_diagnose::report::Report;
use pid_diagnose::search::Settings;
use pid_studies::withheld::{Outcome, diagnose_all, summary, to_html};
use pid_withheld::{Cause, Drawing, Kind, Plan};

fn folder(name: &str) -> std::path::PathBuf {
    let path = std::env::temp_dir().join(format!("pid-study-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&path);
    path
}

/// The page of a diagnosis: the missing force over time and against four quantities; bars of gaps and shares.
fn diagnosis_page(case: &std::path::Path) {
    let report = Report::of_folder(case, &Settings::default(), false).expect("a report");
    let out = case.join("page");
    report.write(&out).expect("files");
    let html = std::fs::read_to_string(out.join("report.html")).expect("a page");
    let page = pid_page_check::page(&html).unwrap_or_else(|e| panic!("{e}"));
    assert!(page.plots >= 5 && page.bars == 2, "{page:?}");
    assert!(html.contains("missing force, N m</text>") || html.contains("missing force, N</text>"));
}

/// A robot that lacks nothing, seen by an independent simulation: nothing is named, and the
/// innovations are as large as the noise that was drawn.
#[test]
fn a_drawn_robot_without_a_cause_is_called_none() {
    let plan = Plan {
        seed: 3,
        cases: 2,
        fewest: 1,
        joints: 1,
        causes: Drawing::Nothing,
    };
    let out = folder("null");
    let first = diagnose_all(&plan, &Settings::default(), &out, &|_, _| {}).expect("a study");
    for o in &first {
        assert!(o.truth.causes.is_empty());
        assert_eq!(o.diagnosis.verdict, Verdict::Nothing, "{}", o.id);
        if o.truth.noise_stated {
            assert!(
                (o.diagnosis.misfit.0 - 1.0).abs() < 0.1,
                "{} {:?}",
                o.id,
                o.diagnosis.misfit
            );
        }
    }
    let truth = std::fs::read_to_string(out.join(format!("truth/{}.json", first[0].id)));
    let again = diagnose_all(&plan, &Settings::default(), &out, &|_, _| {}).expect("a study");
    // The time is part of a diagnosis: equal times mean that it was read, not made.
    assert_eq!(again[0].diagnosis, first[0].diagnosis);
    let fresh = folder("fresh");
    let one = Plan { cases: 1, ..plan };
    diagnose_all(&one, &Settings::default(), &fresh, &|_, _| {}).expect("a study");
    let same = std::fs::read_to_string(fresh.join(format!("truth/{}.json", first[0].id)));
    assert_eq!(truth.expect("a cause"), same.expect("a cause"));
    let s = summary(&first);
    assert_eq!((s.false_alarms.hits, s.false_alarms.of), (0, 2));
    // The page of the study: the reliability diagram; figures, confusions and cases.
    let page = pid_page_check::page(&to_html(&s, &first)).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((page.plots, page.bars, page.tables), (1, 0, 3));
    diagnosis_page(&out.join("cases").join(&first[0].id));
    let mut wrong: Vec<Outcome> = first.clone();
    wrong[0].diagnosis.verdict = Verdict::Effect {
        id: "payload".to_owned(),
        joint: None,
    };
    wrong[0].diagnosis.confidence = 1.0;
    wrong[1].diagnosis.confidence = 1.0;
    let s = summary(&wrong);
    assert_eq!((s.false_alarms.hits, s.false_alarms.of), (1, 2));
    assert!((s.calibration_error - 0.5).abs() < 1e-12);
    // A tilt belongs to no joint; about the one axis of a robot it is an offset of the first
    // encoder, and of no other.
    let verdict = |one_axis: bool, joint: usize| {
        let mut o = first[0].clone();
        o.truth.causes = vec![Cause {
            kind: Kind::BaseTilt { x: 0.0, y: 0.02 },
            joint: 1,
        }];
        o.truth.one_axis = one_axis;
        o.diagnosis.verdict = Verdict::Effect {
            id: "encoder_offset".to_owned(),
            joint: Some(joint),
        };
        let s = summary(&[o]);
        s.effect.values().map(|e| e.hits).sum::<usize>()
    };
    assert_eq!(
        [verdict(true, 1), verdict(true, 2), verdict(false, 1)],
        [1, 0, 0]
    );
    for path in [out, fresh] {
        let _ = std::fs::remove_dir_all(path);
    }
}

/// A file that is not of the study's making stops it with the place.
#[test]
fn a_foreign_file_is_named() {
    let plan = Plan {
        seed: 4,
        cases: 1,
        fewest: 1,
        joints: 1,
        causes: Drawing::Nothing,
    };
    let out = folder("foreign");
    std::fs::create_dir_all(out.join("truth")).expect("a folder");
    std::fs::write(out.join("truth/s4_0000.json"), "not this").expect("a file");
    let error = diagnose_all(&plan, &Settings::default(), &out, &|_, _| {}).expect_err("refused");
    assert!(error.to_string().contains("s4_0000.json"), "{error}");
    let _ = std::fs::remove_dir_all(out);
}
