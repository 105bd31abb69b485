//! Likelihood in output-error fits, on records of a servo that is known.

use std::ops::ControlFlow;

use pid_data::{Dataset, Horizon, VelocityKind};
use pid_fit::ident::{
    Identification, Likelihood, Method, Prepare, Profiler, Progress, Settings, identify,
};
use pid_fit::synthetic::{Recipe, records};
use pid_fit::transcribe::{Loss, Prior, Scheme};
use pid_models::ServoPendulum;
use pid_runtime::dynamics::Dynamics;

const NOISE: [f64; 2] = [2e-3, 5e-2];

fn recipe(records: usize) -> Recipe {
    Recipe {
        records,
        seconds: 3.0,
        step: 0.01,
        amplitude: vec![1.5],
        highest: 3.0,
        start: vec![0.2],
        noise: NOISE.to_vec(),
        outliers: (0.0, 1.0),
    }
}

fn position(name: &str) -> usize {
    let found = ServoPendulum.params().iter().position(|p| p.name == name);
    found.expect("a parameter")
}

/// Only these parameters are free.
fn settings(free: &[&str], likelihood: Likelihood) -> Settings {
    let free: Vec<usize> = free.iter().map(|n| position(n)).collect();
    Settings {
        scheme: Scheme::RungeKutta4,
        hold: (0..ServoPendulum.params().len())
            .filter(|j| !free.contains(j))
            .collect(),
        likelihood: Some(likelihood),
        ..Settings::default()
    }
}

fn fit(dataset: &Dataset, settings: &Settings) -> Identification {
    let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
    let found = identify(&ServoPendulum, dataset, settings, None, go_on).expect("identifies");
    assert!(found.best().status.converged(), "{:?}", found.best().status);
    found
}

fn truth() -> Vec<f64> {
    ServoPendulum.params().iter().map(|p| p.nominal).collect()
}

#[test]
fn estimated_noise_is_that_of_the_readings() {
    let dataset = records(&ServoPendulum, &truth(), &recipe(3), 1).expect("simulates");
    let free = ["dry_shaft", "viscous_shaft", "gain_shaft"];
    let found = fit(&dataset, &settings(&free, Likelihood::default()));
    // 903 values a channel: the relative deviation of an estimated level is 1/√(2·903) = 2.4 %.
    for (level, expected) in found.noise.iter().zip(NOISE) {
        let level = level.expect("fitted");
        assert!((level / expected - 1.0).abs() < 0.08, "{level} {expected}");
    }
    // A stated level stays as it is.
    let stated = Likelihood {
        noise: vec![Some(4e-3), None],
        ..Likelihood::default()
    };
    let other = fit(&dataset, &settings(&free, stated));
    assert!((other.noise[1].expect("fitted") / NOISE[1] - 1.0).abs() < 0.08);
}

/// Velocities computed from the positions have their errors: they add nothing to the positions.
#[test]
fn computed_velocities_are_no_further_readings() {
    let mut measured = records(&ServoPendulum, &truth(), &recipe(3), 1).expect("simulates");
    for e in &mut measured.experiments {
        e.v = Some(pid_data::signal::central_differences(&e.t, &e.q));
    }
    let (mut derived, mut absent) = (measured.clone(), measured.clone());
    derived.joints[0].velocity = VelocityKind::Derived;
    absent.joints[0].velocity = VelocityKind::Absent;
    absent.experiments.iter_mut().for_each(|e| e.v = None);
    let stated_data = derived.clone();
    let free = ["dry_shaft", "gain_shaft"];
    let settings = settings(&free, Likelihood::default());
    let [measured, derived, absent] = [&measured, &derived, &absent].map(|d| fit(d, &settings));
    assert!(derived.notes.iter().any(|n| n.contains("computed")));
    assert!(!measured.notes.iter().any(|n| n.contains("computed")));
    assert_eq!(derived.noise[1], None);
    for name in free {
        let own = |found: &Identification| {
            let j = position(name);
            let deviation = found.deviations[j].expect("determined");
            (found.best().parameters[j], deviation)
        };
        let (value, deviation) = own(&derived);
        let (expected, without) = own(&absent);
        assert!(
            (value - expected).abs() < 1e-3 * deviation,
            "{name}: {value} {expected} {deviation}"
        );
        assert!((deviation / without - 1.0).abs() < 1e-3, "{name}");
        assert_ne!(own(&measured).0, value, "{name}");
    }
    // A user who states a level for them has them fitted.
    let stated = Likelihood {
        noise: vec![None, Some(0.2)],
        ..Likelihood::default()
    };
    let found = fit(&stated_data, &self::settings(&free, stated));
    assert!(found.noise[1].is_some() && !found.notes.iter().any(|n| n.contains("computed")));
}

#[test]
fn shooting_and_full_discretization_agree() {
    let dataset = records(&ServoPendulum, &truth(), &recipe(10), 3).expect("simulates");
    let likelihood = Likelihood {
        loss: Loss::StudentT { freedom: 5.0 },
        priors: vec![Prior {
            parameter: position("viscous_shaft"),
            mean: 0.003,
            deviation: 5e-4,
        }],
        ..Likelihood::default()
    };
    let full = Settings {
        sandwich: true,
        ..settings(&["dry_shaft", "viscous_shaft", "gain_shaft"], likelihood)
    };
    let shooting = Settings {
        method: Method::Shooting,
        nodes: 4,
        ..full.clone()
    };
    let (a, b) = (fit(&dataset, &full), fit(&dataset, &shooting));
    assert!(a.sandwich && b.sandwich);
    for (x, y) in a.best().parameters.iter().zip(&b.best().parameters) {
        assert!((x - y).abs() < 1e-6 * x.abs(), "{x} {y}");
    }
    for (x, y) in a.deviations.iter().zip(&b.deviations) {
        match (x, y) {
            (Some(x), Some(y)) => assert!((x - y).abs() < 1e-3 * x, "{x} {y}"),
            (None, None) => {}
            other => panic!("{other:?}"),
        }
    }
    for (x, y) in a.noise.iter().zip(&b.noise) {
        let (x, y) = (x.expect("fitted"), y.expect("fitted"));
        assert!((x - y).abs() < 1e-4 * x, "{x} {y}");
    }
}

#[test]
fn a_posterior_is_the_prior_of_further_records() {
    // Two halves in turn, the first as prior of the second, against both at once; noise stated, so
    // that the posteriors are comparable. One free parameter: its posterior is nearly normal.
    let both = records(&ServoPendulum, &truth(), &recipe(4), 7).expect("simulates");
    let half = |range: std::ops::Range<usize>| Dataset {
        experiments: both.experiments[range].to_vec(),
        ..both.clone()
    };
    let known = |priors: Vec<Prior>| Likelihood {
        noise: NOISE.iter().copied().map(Some).collect(),
        priors,
        ..Likelihood::default()
    };
    let name = "gain_shaft";
    let j = position(name);
    let first = fit(&half(0..2), &settings(&[name], known(Vec::new())));
    let prior = Prior {
        parameter: j,
        mean: first.best().parameters[j],
        deviation: first.deviations[j].expect("determined"),
    };
    let second = fit(&half(2..4), &settings(&[name], known(Vec::new())));
    let turns = fit(&half(2..4), &settings(&[name], known(vec![prior])));
    let once = fit(&both, &settings(&[name], known(Vec::new())));
    let s = once.deviations[j].expect("determined");
    let (a, b) = (turns.best().parameters[j], once.best().parameters[j]);
    assert!((a - b).abs() < 0.1 * s, "{a} {b} ± {s}");
    let narrowed = turns.deviations[j].expect("determined");
    assert!((narrowed / s - 1.0).abs() < 0.1, "{narrowed} {s}");
    assert!(second.deviations[j].expect("determined") > 1.2 * s);
}

#[test]
fn long_tailed_losses_stand_outliers() {
    let recipe = Recipe {
        outliers: (0.1, 30.0),
        ..recipe(3)
    };
    let dataset = records(&ServoPendulum, &truth(), &recipe, 11).expect("simulates");
    let names = ["dry_shaft", "viscous_shaft", "gain_shaft"];
    // Distance from the truth in units of the deviations that a fit without outliers has.
    let clean = records(&ServoPendulum, &truth(), &self::recipe(3), 11).expect("simulates");
    let clean = fit(&clean, &settings(&names, Likelihood::default()));
    let error = |loss: Loss| {
        let likelihood = Likelihood {
            loss,
            ..Likelihood::default()
        };
        let found = fit(&dataset, &settings(&names, likelihood));
        let square: f64 = names
            .iter()
            .map(|n| {
                let j = position(n);
                let unit = clean.deviations[j].expect("determined");
                ((found.best().parameters[j] - truth()[j]) / unit).powi(2)
            })
            .sum();
        (square.sqrt(), found.noise[0].expect("fitted"))
    };
    let (square, level) = error(Loss::Square);
    // The mean square of the mixture: σ² (0.9 + 0.1 · 900).
    assert!(
        (level / NOISE[0] / 90.9_f64.sqrt() - 1.0).abs() < 0.25,
        "{level}"
    );
    for loss in [
        Loss::Huber { threshold: 1.0 },
        Loss::StudentT { freedom: 2.0 },
    ] {
        let (robust, _) = error(loss);
        assert!(
            robust < 0.5 * square && robust < 5.0,
            "{loss:?}: {robust}, squares {square}"
        );
    }
}

#[test]
fn the_windows_gradients_sum_to_that_of_the_priors() {
    // At a solution in the interior of its bounds the data's gradient balances the priors'; here
    // there is none, so the clusters have mean zero and the sandwich on white noise is near the
    // Hessian's form.
    let dataset = records(&ServoPendulum, &truth(), &recipe(12), 5).expect("simulates");
    let names = ["dry_shaft", "viscous_shaft", "gain_shaft"];
    let by_hessian = Settings {
        horizon: Horizon::Seconds(1.0),
        ..settings(&names, Likelihood::default())
    };
    let sandwich = Settings {
        sandwich: true,
        ..by_hessian.clone()
    };
    let (a, b) = (fit(&dataset, &by_hessian), fit(&dataset, &sandwich));
    assert!(!a.sandwich && b.sandwich);
    for name in names {
        let j = position(name);
        let ratio = b.deviations[j].expect("determined") / a.deviations[j].expect("determined");
        // 36 windows: a deviation is known to 1/√72 = 12 %.
        assert!((0.6..1.6).contains(&ratio), "{name}: {ratio}");
    }
}

#[test]
fn a_profile_of_a_nearly_normal_posterior_is_its_normal_interval() {
    let dataset = records(&ServoPendulum, &truth(), &recipe(3), 17).expect("simulates");
    let with = |loss| {
        let likelihood = Likelihood {
            loss,
            ..Likelihood::default()
        };
        settings(&["dry_shaft", "viscous_shaft", "gain_shaft"], likelihood)
    };
    // Position and velocity, weighed without noise levels.
    let weighed = Settings {
        likelihood: None,
        ..with(Loss::Square)
    };
    for settings in [
        with(Loss::Square),
        with(Loss::StudentT { freedom: 4.0 }),
        weighed,
    ] {
        its_profile_is_the_normal_interval(&dataset, &settings);
    }
}

fn its_profile_is_the_normal_interval(dataset: &Dataset, settings: &Settings) {
    let found = fit(dataset, settings);
    let j = position("gain_shaft");
    let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
    let profiler = Profiler::new(&ServoPendulum, dataset, settings, &found, go_on).expect("fits");
    let interval = profiler.interval(j, go_on).expect("fits");
    let (value, deviation) = (
        found.best().parameters[j],
        found.deviations[j].expect("determined"),
    );
    for (end, side) in [(interval.lower, -1.96), (interval.upper, 1.96)] {
        let end = end.expect("inside of the bounds");
        let expected = value + side * deviation;
        assert!(
            (end - expected).abs() < 0.15 * deviation,
            "{end} {expected} ± {deviation}"
        );
    }
}

#[test]
fn priors_are_knowledge_of_what_the_records_leave_open() {
    // Voltage acts by gain/resistance, back-EMF and friction by gain²/resistance + viscous: three
    // parameters, two combinations.
    let dataset = records(&ServoPendulum, &truth(), &recipe(3), 23).expect("simulates");
    let names = ["gain_shaft", "resistance_shaft", "viscous_shaft"];
    let alone = fit(&dataset, &settings(&names, Likelihood::default()));
    assert_eq!(alone.undetermined, 1, "{:?}", alone.open);
    let priors: Vec<Prior> = names
        .iter()
        .map(|name| {
            let j = position(name);
            let info = &ServoPendulum.params()[j];
            // Uniform over the range, as a normal distribution.
            Prior {
                parameter: j,
                mean: 0.5 * (info.lower + info.upper),
                deviation: (info.upper - info.lower) / 12.0_f64.sqrt(),
            }
        })
        .collect();
    let with = Likelihood {
        priors,
        ..Likelihood::default()
    };
    let settings = settings(&names, with);
    let known = fit(&dataset, &settings);
    assert_eq!(known.undetermined, 0, "{:?}", known.open);
    for name in names {
        let deviation = known.deviations[position(name)].expect("known by its prior");
        let info = &ServoPendulum.params()[position(name)];
        assert!(deviation < info.upper - info.lower, "{name}: {deviation}");
    }
    // The profile agrees that it is wide, and stays within the bounds.
    let j = position("gain_shaft");
    let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
    let profiler = Profiler::new(&ServoPendulum, &dataset, &settings, &known, go_on).expect("fits");
    let interval = profiler.interval(j, go_on).expect("fits");
    let value = known.best().parameters[j];
    let info = &ServoPendulum.params()[j];
    let (low, high) = (
        interval.lower.unwrap_or(info.lower),
        interval.upper.unwrap_or(info.upper),
    );
    assert!(info.lower <= low && low < value && value < high && high <= info.upper);
}

/// Short steps make every start look feasible: from noisy states the exact Hessian has multipliers
/// that mean nothing, even where the parameters are right. Every fit under new noise levels is such
/// a case. Approached by Gauss-Newton the fits settle, and sooner than with the exact Hessian
/// alone, which need not settle.
#[test]
fn fits_from_right_parameters_settle_and_sooner_after_gauss_newton() {
    let short = Recipe {
        records: 2,
        seconds: 2.0,
        step: 2e-3,
        amplitude: vec![0.8],
        highest: 3.0,
        start: vec![0.2],
        noise: vec![1e-3, 2e-2],
        outliers: (0.0, 1.0),
    };
    let truth: Vec<f64> = ServoPendulum.params().iter().map(|p| p.nominal).collect();
    // Over several records, since rounding decides how far a single fit wanders.
    let run = |prepare: Prepare| {
        let mut sum = 0;
        for seed in 5..10 {
            let dataset = records(&ServoPendulum, &truth, &short, seed).expect("simulates");
            let settings = Settings {
                likelihood: Some(Likelihood::default()),
                prepare,
                ..Settings::default()
            };
            let count = &mut |_: &Progress<'_>| {
                sum += 1;
                ControlFlow::Continue(())
            };
            let found = identify(&ServoPendulum, &dataset, &settings, None, count);
            let found = found.expect("identifies");
            let unsettled = found.notes.iter().any(|n| n.contains("not settled"));
            let settled = found.best().status.converged() && !unsettled;
            assert!(
                settled || prepare == Prepare::Nothing,
                "{prepare:?}, seed {seed}"
            );
        }
        sum
    };
    let (without, with) = (run(Prepare::Nothing), run(Prepare::Motion));
    assert!(5 * with < 4 * without, "{with} {without}");
    run(Prepare::Everything);
}
