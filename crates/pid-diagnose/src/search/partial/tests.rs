//! The search of effects that explain a part, on the pendulum of the tests.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::exchange::exchange;
use super::readings;
use super::shown::{Shown, shown, take_shown};
use crate::bench::{Draw, SIZE, among_a_dozen, named, pendulum};
use crate::case::Case;
use crate::diagnosis::{Diagnosis, Round, Verdict};
use crate::fit::{Effort, Point, basis, fit};
use crate::search::measure::measured;
use crate::search::refit::Refit;
use crate::search::stand::Stand;
use crate::search::{Listener, Settings, Watch, diagnose};

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
    let d = diagnose(&case, &among_a_dozen());
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

#[test]
fn a_lag_that_the_reading_shows_is_asked_for_by_itself() {
    let mut case = pendulum(&named(&["spring"]), &[0.9, 0.2], 8.0, &|_| {});
    for record in &mut case.records {
        let fade = (-record.h / 0.03).exp();
        let mut shown = record.v[0][0];
        for v in &mut record.v[0] {
            shown = fade * shown + (1.0 - fade) * *v;
            *v = shown;
        }
    }
    coloured(&mut case, 5e-4);
    let d = diagnose(&case, &among_a_dozen());
    let asked = |round: &Round| -> Vec<String> {
        round.candidates.iter().map(|c| c.label.clone()).collect()
    };
    let alone = |round: &&Round| asked(round) == ["velocity_filter_lag:1"];
    let own = d.rounds.iter().find(alone).expect("a round of its own");
    assert_eq!(own.candidates[0].refused, None);
    let mut found = labels(&d);
    found.sort_unstable();
    assert_eq!(found, ["spring", "velocity_filter_lag"], "{d:?}");
}

/// An input that acts late is asked for before all else, by its kinds alone, and once.
#[test]
fn an_input_that_acts_late_is_asked_for_by_itself() {
    let settings = Settings::default();
    // On one joint a delay of what it shows is the same map as one of its input.
    let kinds = [
        ("input_delay", &["input_delay:1", "sensor_delay:1"][..]),
        ("actuator_lag", &["actuator_lag:1"][..]),
    ];
    let all = ["actuator_lag:1", "input_delay:1", "sensor_delay:1"];
    for (id, right) in kinds {
        let case = pendulum(&named(&[id, "spring"]), &[0.02, 0.9, 0.2], 8.0, &|_| {});
        let beside = named(&["spring"]);
        let directions = basis(&case);
        let at = Point {
            theta: vec![0.0; SIZE],
            e: vec![0.9, 0.2],
        };
        let found = fit(&case, &directions, &beside, at, Effort::full(14));
        let mut now = Stand {
            gap: measured(&case, &found),
            case,
            directions,
            fit: found,
        };
        let shown = shown(&now.case, &now.fit.point.theta, &settings);
        let (mut taken, sensors) = (Vec::new(), readings(&now.case));
        let rounds = take_shown(&mut now, &mut taken, &shown, &settings, &sensors);
        assert_eq!(rounds.len(), 1, "{id}");
        let asked = &rounds[0].candidates;
        assert!(asked.iter().all(|c| all.contains(&&*c.label)), "{asked:?}");
        assert!(right.contains(&&*taken[0].0.term.label()), "{asked:?}");
        let delay = now.fit.point.e.last().expect("a time");
        assert!((delay - 0.02).abs() < 1e-3, "{id}: {delay}");
        let again = take_shown(&mut now, &mut taken, &shown, &settings, &sensors);
        assert!(again.is_empty() && taken.len() == 1);
    }
}

/// A delay that a lag stood for: beside the spring the delay takes its place, unless the lag is kept.
#[test]
fn a_lag_taken_early_gives_way_to_the_delay_it_stood_for() {
    let truth = named(&["input_delay", "spring"]);
    let case = pendulum(&truth, &[0.02, 0.9, 0.2], 8.0, &|_| {});
    let early = named(&["actuator_lag", "spring"]);
    let directions = basis(&case);
    let at = Point {
        theta: vec![0.0; SIZE],
        e: vec![0.02, 0.9, 0.2],
    };
    let found = fit(&case, &directions, &early, at, Effort::full(14));
    let taken = early.terms.iter().map(|term| {
        let refit = Refit {
            term: term.clone(),
            fit: found.clone(),
            score: 0.0,
        };
        (refit, 1.0)
    });
    let taken: Vec<(Refit, f64)> = taken.collect();
    let after = |shown: &[Shown]| {
        let mut now = Stand {
            case: case.clone(),
            directions: directions.clone(),
            gap: measured(&case, &found),
            fit: found.clone(),
        };
        let mut taken = taken.clone();
        let sensors = readings(&case);
        let rounds = exchange(&mut now, &mut taken, &Settings::default(), &sensors, shown);
        let labels: Vec<String> = taken.iter().map(|(r, _)| r.term.label()).collect();
        (rounds, labels)
    };
    let (rounds, labels) = after(&[]);
    assert_eq!(labels, ["spring:1", "input_delay:1"]);
    assert!(rounds.len() == 1 && rounds[0].exchange, "{rounds:?}");
    assert_eq!(rounds[0].dropped, ["actuator_lag:1"]);
    let (rounds, labels) = after(&[Shown::only(early.terms[0].clone())]);
    assert_eq!(labels, ["actuator_lag:1", "spring:1"]);
    assert!(rounds.is_empty());
}

/// Asks to stop while the first effect is looked for.
#[derive(Default)]
struct Stopper(AtomicBool);

impl Listener for Stopper {
    fn step(&self, what: &str) {
        if what.ends_with("the first effect") {
            self.0.store(true, Ordering::Relaxed);
        }
    }
    fn stop(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[test]
fn a_search_that_is_stopped_has_the_budget_so_far() {
    let e = [0.05, 0.9, 0.2];
    let mut case = pendulum(&named(&["quadratic_drag", "spring"]), &e, 8.0, &|_| {});
    coloured(&mut case, 5e-4);
    let settings = Settings {
        watch: Watch::new(Arc::new(Stopper::default())),
        ..among_a_dozen()
    };
    let d = diagnose(&case, &settings);
    // The first round was under way; no other one began.
    assert_eq!((d.rounds.len(), d.effects.len()), (1, 1));
    let taken = d.rounds[0].candidates.iter().find(|c| c.refused.is_none());
    let taken = taken.expect("an effect is taken");
    assert!(taken.label.starts_with(&*d.effects[0].effect), "{taken:?}");
    let all = diagnose(&case, &among_a_dozen());
    assert!(all.rounds.len() > 1 && labels(&all).contains(&"spring"));
}

/// Stops at once.
struct Impatient;

impl Listener for Impatient {
    fn step(&self, _: &str) {}
    fn stop(&self) -> bool {
        true
    }
}

#[test]
fn a_search_that_is_stopped_at_once_does_not_say_none() {
    let case = pendulum(&named(&[]), &[], 6.0, &|_| {});
    assert_eq!(
        diagnose(&case, &Settings::default()).verdict,
        Verdict::Nothing
    );
    let settings = Settings {
        watch: Watch::new(Arc::new(Impatient)),
        ..Settings::default()
    };
    let d = diagnose(&case, &settings);
    assert_eq!(d.verdict, Verdict::Unknown);
    assert!(d.regime.contains("stopped"), "{}", d.regime);
}
