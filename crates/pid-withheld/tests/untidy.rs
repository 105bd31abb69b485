//! Untidy cases: drawn again they are the same, shares sum to one, records are as untidy as drawn.

use std::path::PathBuf;

use pid_withheld::{Files, Mess, Study, UntidyPlan, UntidyTruth, lay_out};

fn plan(seed: u64) -> UntidyPlan {
    UntidyPlan {
        seed,
        cases: 12,
        joints: 1,
    }
}

/// The first case with a cause.
fn drawn() -> (usize, Files, UntidyTruth) {
    (0..12)
        .map(|i| (i, plan(7).make(i).expect("a case")))
        .find(|(_, (_, case))| !case.truth.causes.is_empty())
        .map(|(i, (files, case))| (i, files, case))
        .expect("a case with a cause")
}

#[test]
fn a_case_drawn_again_is_the_same_and_its_shares_sum_to_one() {
    let (i, files, case) = drawn();
    let sum: f64 = case.gaps.parts.iter().map(|p| p.share).sum();
    assert!((sum - 1.0).abs() < 1e-12, "{:?}", case.gaps);
    assert_eq!(case.gaps.parts.len(), case.truth.causes.len());
    assert!(case.gaps.none > case.gaps.all, "{:?}", case.gaps);
    let (again, same) = plan(7).make(i).expect("a case");
    assert_eq!(files, again);
    assert_eq!(case, same);
    let out: PathBuf =
        std::env::temp_dir().join(format!("pid-withheld-untidy-{}", std::process::id()));
    let here = lay_out(&plan(7), i, &out).expect("a folder");
    for (name, text) in &files {
        let written = std::fs::read_to_string(here.join(name)).expect("a file");
        assert_eq!(&written, text);
    }
    let _ = std::fs::remove_dir_all(out);
}

#[test]
fn stamps_losses_and_wrong_readings_are_as_drawn() {
    let (_, files, case) = drawn();
    let Mess {
        jitter,
        stamp,
        lost,
        cells,
        ..
    } = case.recording.mess;
    let h = 1.0 / case.recording.rate;
    let expected = (case.recording.length * case.recording.rate) as usize + 1;
    let records = files.iter().filter(|(name, _)| name.ends_with(".csv"));
    let (mut gone, mut all, mut late) = (0, 0, 0.0_f64);
    for (_, text) in records {
        let rows: Vec<Vec<&str>> = (text.lines().skip(1))
            .map(|line| line.split(',').collect())
            .collect();
        let per_row = rows[0].len() - 1;
        if cells {
            assert_eq!(rows.len(), expected);
            all += (expected - 2) * per_row;
            gone += (rows.iter().flatten()).filter(|x| x.is_empty()).count();
        } else {
            all += expected - 2;
            gone += expected - rows.len();
        }
        for row in &rows {
            let at: f64 = row[0].parse::<f64>().expect("a time") / h;
            let off = at - at.round();
            assert!(-6.0 * stamp < off && off < jitter + 6.0 * stamp, "{off}");
            late = late.max(off);
        }
    }
    let records = case.recording.records as f64;
    assert!((gone as f64 - lost * all as f64).abs() <= records, "{gone}");
    assert!(late > 0.5 * jitter, "{late} {jitter}");
}
