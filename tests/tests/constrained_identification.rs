//! Identification under constraints of the user: optima and deviations are those of the problem
//! with the constraint worked in.

use std::ops::ControlFlow;
use std::sync::Arc;

use pid_data::Dataset;
use pid_fit::ident::{Identification, Method, Settings, identify};
use pid_fit::transcribe::{Constraint, Place, Sense};
use pid_models::TwoLink;
use pid_runtime::dynamics::Dynamics;
use pid_runtime::generic::functions::{Exact, GenericFunction};
use pid_runtime::num_dual::DualNum;
use pid_tests::mismatched::{record, sines};

/// Σ c_k z_k + d over (x, p).
struct Linear(Vec<(usize, f64)>, f64);

impl GenericFunction for Linear {
    fn outputs(&self) -> usize {
        1
    }
    fn variables(&self) -> Option<Vec<usize>> {
        Some(self.0.iter().map(|(k, _)| *k).collect())
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D], out: &mut [D]) {
        let z: Vec<D> = x.iter().chain(p).copied().collect();
        out[0] = D::from(self.1);
        self.0.iter().for_each(|(k, c)| out[0] += z[*k] * *c);
    }
}

const NX: usize = 4;

fn constraint(place: Place, sense: Sense, terms: &[(usize, f64)], constant: f64) -> Constraint {
    let function = Linear(terms.to_vec(), constant);
    Constraint {
        name: "rule".to_owned(),
        place,
        sense,
        function: Arc::new(Exact::new(function, NX, TwoLink.dims().np)),
    }
}

fn position(name: &str) -> usize {
    let found = TwoLink.params().iter().position(|p| p.name == name);
    found.expect("a parameter")
}

/// The viscous frictions and a dry one are free, others at their true values.
fn free() -> [usize; 3] {
    ["viscous_shoulder", "viscous_elbow", "dry_shoulder"].map(position)
}

fn settings(method: Method, nodes: usize) -> Settings {
    let all = 0..TwoLink.dims().np;
    Settings {
        method,
        nodes,
        hold: all.filter(|k| !free().contains(k)).collect(),
        ..Settings::default()
    }
}

fn nominal() -> Vec<f64> {
    TwoLink.params().iter().map(|p| p.nominal).collect()
}

fn fit(dataset: &Dataset, settings: &Settings, start: &[f64]) -> Identification {
    let found = identify(&TwoLink, dataset, settings, Some(start), &mut |_| {
        ControlFlow::Continue(())
    });
    let found = found.expect("identifies");
    assert!(found.best().status.converged(), "{:?}", found.best().status);
    let check = &found.best().check;
    assert!(
        check.primal_inf < 1e-6 && check.dual_inf < 1e-4,
        "{check:?}"
    );
    found
}

/// Objective, free parameters and deviations of those listed agree.
fn same(a: &Identification, b: &Identification, listed: &[usize], what: &str) {
    let close = |a: f64, b: f64, to: f64, of: &str| {
        assert!((a - b).abs() <= to * b.abs(), "{what}, {of}: {a} {b}");
    };
    close(a.best().objective, b.best().objective, 1e-6, "J");
    for &k in &free() {
        close(a.best().parameters[k], b.best().parameters[k], 1e-5, "p");
    }
    for &k in listed {
        let of = |i: &Identification| i.deviations[k].expect("determined");
        close(of(a), of(b), 1e-2, "deviation");
    }
}

#[test]
fn rules_on_parameters_act_as_held_ones_and_bounds_do() {
    let dataset = record(&TwoLink, &sines, 250, 0.02).expect("simulates");
    let [a, b, c] = free();
    for (method, nodes) in [(Method::FullDiscretization, 1), (Method::Shooting, 5)] {
        let settings = settings(method, nodes);
        let open = fit(&dataset, &settings, &nominal());
        let value = 1.05 * open.best().parameters[a];
        let mut start = nominal();
        start[a] = value;
        let hold = [settings.hold.clone(), vec![a]].concat();
        let held = fit(
            &dataset,
            &Settings {
                hold,
                ..settings.clone()
            },
            &start,
        );
        assert!(held.best().objective > (1.0 + 1e-6) * open.best().objective);
        let with = |sense, sign: f64| {
            let rule = constraint(Place::Parameters, sense, &[(NX + a, sign)], -sign * value);
            let settings = Settings {
                constraints: vec![rule],
                ..settings.clone()
            };
            fit(&dataset, &settings, &nominal())
        };
        let what = format!("{method:?}");
        for (sense, sign, note) in [
            (Sense::Equal, 1.0, "an equality"),
            (Sense::AtMost, -1.0, "`rule`: active"),
        ] {
            let found = with(sense, sign);
            same(&found, &held, &[b, c], &what);
            let pinned = found.deviations[a].expect("pinned");
            assert!(
                pinned < 1e-2 * open.deviations[a].expect("determined"),
                "{pinned}"
            );
            assert!(
                found.notes.iter().any(|n| n.contains(note)),
                "{:?}",
                found.notes
            );
        }
        let found = with(Sense::AtMost, 1.0);
        same(&found, &open, &[a, b, c], &what);
        let room = found.notes.iter().find(|n| n.contains("not active, room"));
        assert!(room.is_some(), "{:?}", found.notes);
        // A rule between two parameters: the fit on the line is above that without, and on it.
        let ratio = open.best().parameters[a] / open.best().parameters[b] * 1.1;
        let rule = constraint(
            Place::Parameters,
            Sense::Equal,
            &[(NX + a, 1.0), (NX + b, -ratio)],
            0.0,
        );
        let settings = Settings {
            constraints: vec![rule],
            ..settings
        };
        let found = fit(&dataset, &settings, &nominal());
        let p = &found.best().parameters;
        assert!(
            (p[a] / p[b] / ratio - 1.0).abs() < 1e-7,
            "{} {}",
            p[a],
            p[b]
        );
        let of = |k: usize| found.deviations[k].expect("determined") / p[k];
        assert!((of(a) / of(b) - 1.0).abs() < 1e-2, "one deviation for both");
    }
}

#[test]
fn a_rule_on_states_holds_at_every_sample() {
    let dataset = record(&TwoLink, &sines, 250, 0.02).expect("simulates");
    let settings = settings(Method::FullDiscretization, 1);
    let open = fit(&dataset, &settings, &nominal());
    let speed = |found: &Identification| {
        let speeds = found.motion.iter().skip(2).step_by(NX);
        speeds.copied().fold(f64::NEG_INFINITY, f64::max)
    };
    let limit = speed(&open) - 1e-3;
    let rule = constraint(Place::EveryNode, Sense::AtMost, &[(2, 1.0)], -limit);
    let with = Settings {
        constraints: vec![rule],
        ..settings
    };
    let found = fit(&dataset, &with, &nominal());
    assert!(speed(&found) <= limit + 1e-7 && speed(&found) > limit - 1e-4);
    assert!(found.best().objective > open.best().objective);
    let note = "of 250 places";
    assert!(
        found.notes.iter().any(|n| n.contains(note)),
        "{:?}",
        found.notes
    );
}

#[test]
fn rules_that_do_not_fit_are_refused() {
    let dataset = record(&TwoLink, &sines, 50, 0.02).expect("simulates");
    let try_with = |method, constraint: Constraint| {
        let settings = Settings {
            constraints: vec![constraint],
            ..settings(method, 1)
        };
        identify(&TwoLink, &dataset, &settings, None, &mut |_| {
            ControlFlow::Continue(())
        })
        .expect_err("an error")
        .to_string()
    };
    let full = Method::FullDiscretization;
    let far = constraint(Place::Node(50), Sense::Equal, &[(0, 1.0)], 0.0);
    let message = try_with(full, far.clone());
    assert!(
        message.contains("`rule` asks for node 50, the program has 50"),
        "{message}"
    );
    let message = try_with(Method::EquationError, far);
    assert!(
        message.contains("`rule`") && message.contains("full discretization"),
        "{message}"
    );
    let short = Constraint {
        function: Arc::new(Exact::new(Linear(vec![(0, 1.0)], 0.0), NX, 3)),
        ..constraint(Place::Parameters, Sense::Equal, &[], 0.0)
    };
    let message = try_with(full, short.clone());
    assert!(
        message.contains("takes 4 and 3 states and parameters, the program has 4 and 19"),
        "{message}"
    );
    let message = try_with(Method::Shooting, short);
    assert!(message.contains("4 and 3"), "{message}");
}
