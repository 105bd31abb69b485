//! The next experiment: limits are kept, the expected odds come true, and what cannot be separated
//! is said to be so.

use std::path::Path;

use pid_diagnose::case::Case;
use pid_diagnose::next::{limits, separate};
use pid_diagnose::search::{Settings, search};
use pid_withheld::Kind;

use crate::drawn::first;

/// An effect that was seen in several records: one motion made for it tells at least as much as chance would.
fn the_motion_favours_the_truth(folder: &Path) {
    let case = Case::read(folder).expect("readable");
    let found = search(&case, &Settings::default());
    let (a, b) = (&found.fit, &found.base);
    let e = separate(&found.case, a, b).expect("a motion");
    let limit = limits(&found.case)[0];
    for (q, v) in e.q.iter().zip(&e.v) {
        assert!(q[0] >= limit.position.0 - 1e-9 && q[0] <= limit.position.1 + 1e-9);
        assert!(v[0].abs() <= limit.speed);
    }
    let h = e.sample_time;
    for k in 1..e.q.len() - 1 {
        let rate = (e.q[k + 1][0] - e.q[k - 1][0]) / (2.0 * h);
        assert!((rate - e.v[k][0]).abs() < 1e-2 * limit.speed);
    }
    assert!(e.v[0][0].abs() < 1e-12, "starts at rest");
    assert!(e.least() > 5.0, "{:?}", e.log_odds);
    assert_eq!(e.to_csv().lines().count(), e.q.len() + 1);
    assert_eq!(e.to_csv().lines().next(), Some("t,q1,dq1"));
}

fn a_model_is_not_separated_from_itself(folder: &Path) {
    let case = Case::read(folder).expect("readable");
    let found = search(&case, &Settings::default());
    let e = separate(&found.case, &found.base, &found.base).expect("a motion");
    assert!(e.least() < 0.5, "{:?}", e.log_odds);
}

#[test]
fn the_motion_stays_within_what_was_seen_and_favours_the_truth() {
    let case = first("drag-next", |k| {
        matches!(k, Some(Kind::QuadraticDrag { .. }))
    });
    the_motion_favours_the_truth(case.folder());
}

#[test]
fn the_motion_of_a_practice_case_favours_the_truth() {
    if let Some(folder) = pid_records::shared("blind/p08") {
        the_motion_favours_the_truth(&folder);
    }
}

#[test]
fn the_model_of_a_drawn_case_is_not_separated_from_itself() {
    let case = first("nothing-next", |kind| kind.is_none());
    a_model_is_not_separated_from_itself(case.folder());
}

#[test]
fn the_model_of_a_practice_case_is_not_separated_from_itself() {
    if let Some(folder) = pid_records::shared("blind/p03") {
        a_model_is_not_separated_from_itself(&folder);
    }
}
