//! The next experiment: limits are kept, the expected odds come true, and what cannot be separated is said to be so.

use pid_diagnose::case::Case;
use pid_diagnose::diagnose::{Settings, investigate};
use pid_diagnose::next::{limits, separate};

fn case(name: &str) -> Option<Case> {
    let folder = pid_records::shared(&format!("blind/{name}"))?;
    Some(Case::read(&folder).expect("readable"))
}

#[test]
fn the_motion_stays_within_what_was_seen_and_favours_the_truth() {
    let Some(case) = case("p08") else { return };
    let found = investigate(&case, &Settings::default());
    let (a, b) = (&found.fit, &found.base);
    let e = separate(&found.case, a, b).expect("a motion");
    let limit = limits(&found.case)[0];
    for (q, v) in e.q.iter().zip(&e.v) {
        assert!(q[0] >= limit.position.0 - 1e-9 && q[0] <= limit.position.1 + 1e-9);
        // Limits hold on a grid of 20 ms.
        assert!(v[0].abs() <= 1.02 * limit.speed);
    }
    let h = e.sample_time;
    for k in 1..e.q.len() - 1 {
        let rate = (e.q[k + 1][0] - e.q[k - 1][0]) / (2.0 * h);
        assert!((rate - e.v[k][0]).abs() < 1e-2 * limit.speed);
    }
    assert!(e.v[0][0].abs() < 1e-12, "starts at rest");
    // The effect was seen in four records like this one; one motion made for it tells at least as much as chance would.
    assert!(e.least() > 5.0, "{:?}", e.log_odds);
    assert_eq!(e.to_csv().lines().count(), e.q.len() + 1);
    assert_eq!(e.to_csv().lines().next(), Some("t,q1,dq1"));
}

#[test]
fn a_model_is_not_separated_from_itself() {
    let Some(case) = case("p03") else { return };
    let found = investigate(&case, &Settings::default());
    let e = separate(&found.case, &found.base, &found.base).expect("a motion");
    assert!(e.least() < 0.5, "{:?}", e.log_odds);
}
