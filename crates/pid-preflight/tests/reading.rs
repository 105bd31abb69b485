//! Folders that the reader refuses for their time stamps.

use std::path::PathBuf;

use pid_data::{DataError, Dataset};
use pid_preflight::{FindingKind, Severity, open};

const MANIFEST: &str = r#"
name = "cart"
title = "A cart"
source = "made up"
license = "CC0-1.0"
kind = "simulated"

[[joint]]
name = "x"
type = "prismatic"
input = "force"
input_unit = "N"
velocity = "absent"

[[experiment]]
file = "train.csv"
role = "train"
"#;

fn folder(name: &str, csv: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("reading_{name}"));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("dataset.toml"), MANIFEST).unwrap();
    std::fs::write(folder.join("train.csv"), csv).unwrap();
    folder
}

#[test]
fn repeated_stamps_are_found_and_taken_out() {
    let here = folder(
        "repeated",
        "t,q1,u1\n0,0.0,1\n0.1,0.005,1\n0.1,0.005,1\n0.2,0.02,1\n0.2,0.03,1\n0.3,0.04,1\n",
    );
    assert!(matches!(
        Dataset::read(&here),
        Err(DataError::TimeNotIncreasing { .. })
    ));
    let opened = open(&here).unwrap();
    assert_eq!(opened.dataset.experiments[0].t, [0.0, 0.1, 0.2, 0.3]);
    assert_eq!(opened.dataset.experiments[0].q, [0.0, 0.005, 0.02, 0.04]);
    let finding = &opened.findings[0];
    assert_eq!(finding.kind, FindingKind::DuplicateStamps { count: 2 });
    assert_eq!(
        (finding.severity, finding.rows),
        (Severity::Wrong, Some((2, 4)))
    );
    assert_eq!(
        opened.mended,
        [(
            "train.csv".to_owned(),
            "t,q1,u1\n0,0.0,1\n0.1,0.005,1\n0.2,0.02,1\n0.3,0.04,1\n".to_owned()
        )]
    );
}

#[test]
fn time_that_goes_back_is_told_from_time_that_stands() {
    let here = folder(
        "back",
        "t,q1,u1\n0,0.0,1\n0.1,0.005,1\n0.2,0.02,1\n0.05,0.03,1\n0.3,0.04,1\n",
    );
    let opened = open(&here).unwrap();
    assert_eq!(opened.dataset.experiments[0].t, [0.0, 0.1, 0.2, 0.3]);
    assert!(
        opened.findings[0].sentence.contains("1 of them go back"),
        "{}",
        opened.findings[0]
    );
}

#[test]
fn right_folders_open_without_findings_and_other_faults_stay_errors() {
    let here = folder("right", "t,q1,u1\n0,0.0,1\n0.1,0.005,1\n");
    let opened = open(&here).unwrap();
    assert!(opened.findings.is_empty() && opened.mended.is_empty());
    let here = folder("broken", "t,q1,u1\n0,0.0,1\n0,0.0,1\n0.1,x,1\n");
    assert!(matches!(open(&here), Err(DataError::NotANumber { .. })));
}
