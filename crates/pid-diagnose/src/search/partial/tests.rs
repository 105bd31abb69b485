//! The search of effects that explain a part, on the pendulum of the tests.

use crate::bench::{Draw, named, pendulum};
use crate::case::Case;
use crate::diagnosis::{Diagnosis, Verdict};
use crate::search::{Settings, diagnose};

/// First-order noise (correlation 0.97 from sample to sample, deviation `level`) on all positions.
fn coloured(case: &mut Case, level: f64) {
    let mut draw = Draw::new(5);
    for record in &mut case.records {
        let mut x = 0.0;
        for q in &mut record.q[0] {
            x = 0.97 * x + f64::sqrt(1.0 - 0.97 * 0.97) * draw.next();
            *q += level * x;
        }
    }
}

fn labels(d: &Diagnosis) -> Vec<&str> {
    d.effects.iter().map(|e| &*e.effect).collect()
}

#[test]
fn three_effects_beside_coloured_noise_are_all_named_with_their_shares() {
    // Sine, cosine and periods per rad; drag; stiffness and rest.
    let e = [0.15, 0.05, 15.0, 0.05, 0.9, 0.2];
    let three = named(&["cogging", "quadratic_drag", "spring"]);
    let mut case = pendulum(&three, &e, 8.0, &|_| {});
    coloured(&mut case, 5e-4);
    let d = diagnose(&case, &Settings::default());
    let mut found = labels(&d);
    found.sort_unstable();
    assert_eq!(found, ["cogging", "quadratic_drag", "spring"], "{d:?}");
    assert_eq!(d.verdict, Verdict::Several);
    // The spring moves the pendulum by far more than the others.
    assert_eq!(d.effects[0].effect, "spring");
    let shares: Vec<f64> = d.effects.iter().filter_map(|e| e.share).collect();
    assert_eq!(shares.len(), 3);
    assert!(shares.is_sorted_by(|a, b| a >= b), "{shares:?}");
    let explained = d.remainder.as_ref().expect("noise is left").explained;
    assert!((shares.iter().sum::<f64>() - explained).abs() < 1e-12);
    let spring = &d.effects[0].parameters[0];
    assert!((spring.value - 0.9).abs() < 0.09, "{spring:?}");
    // Every round says what became of each candidate.
    assert!(d.rounds.len() >= 3);
    for round in &d.rounds[..3] {
        let taken = round.candidates.iter().filter(|c| c.refused.is_none());
        assert_eq!(taken.count(), 1, "{round:?}");
    }
}

#[test]
fn coloured_noise_that_moves_nothing_is_no_cause() {
    let mut case = pendulum(&named(&[]), &[], 8.0, &|_| {});
    coloured(&mut case, 5e-4);
    let d = diagnose(&case, &Settings::default());
    assert_eq!(d.verdict, Verdict::Nothing, "{d:?}");
    assert!(d.effects.is_empty() && d.remainder.is_none());
    assert!(d.regime.contains("no white noise"), "{}", d.regime);
    assert!(!d.rounds.is_empty());
}
