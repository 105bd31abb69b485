//! Cases behind position loops.

use pid_data::Dataset;
use pid_data::signal::column;
use pid_withheld::{Drawing, Law, Plan, ServoPlan, Servos, Study};

/// Largest distance of a position from its target over the span of all targets, of a joint.
fn furthest(records: &Dataset, j: usize) -> f64 {
    let n = records.nq();
    let (mut off, mut low, mut high) = (0.0_f64, f64::INFINITY, f64::NEG_INFINITY);
    for e in &records.experiments {
        for (q, target) in column(&e.q, n, j).into_iter().zip(column(&e.u, n, j)) {
            off = off.max((q - target).abs());
            (low, high) = (low.min(target), high.max(target));
        }
    }
    off / (high - low)
}

#[test]
fn loops_without_damping_of_their_own_follow_their_targets() {
    let study = ServoPlan {
        plan: Plan {
            seed: 77,
            cases: 6,
            fewest: 1,
            joints: 2,
            causes: Drawing::Nothing,
        },
        law: Some(Law::P),
        servos: Servos::All,
    };
    for i in 0..study.cases() {
        let (files, _) = study.make(i).expect("a case");
        let texts: Vec<(&str, &str)> = files
            .iter()
            .map(|(name, text)| (&**name, &**text))
            .collect();
        let records = Dataset::from_embedded(&texts).expect("records");
        for j in 0..records.nq() {
            let own = furthest(&records, j);
            assert!(own < 1.0, "case {i}, joint {}: {own:.2}", j + 1);
        }
    }
}
