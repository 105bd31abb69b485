//! Measured records: published parameters and the errors to beat. The figures stand in the data
//! sets' own descriptions.

use std::ops::ControlFlow;

use pid_data::{Dataset, Horizon, Role};
use pid_fit::gap::metrics::{FreeRunSettings, FreeRunTable, StartVelocity, free_run_table};
use pid_fit::ident::{self, Identification, InitialState, Method, Settings, Weighting};
use pid_fit::synthetic::{Recipe, records};
use pid_models::Emps;
use pid_runtime::dynamics::{Dynamics, Hessian};
use pid_tests::shared;

fn identify(model: &dyn Hessian, dataset: &Dataset, settings: &Settings) -> Identification {
    ident::identify(model, dataset, settings, None, &mut |_| {
        ControlFlow::Continue(())
    })
    .expect("identifies")
}

fn one_second(model: &dyn Hessian, p: &[f64], dataset: &Dataset) -> FreeRunTable {
    let settings = FreeRunSettings {
        start: StartVelocity::Estimated,
        ..FreeRunSettings::new(Horizon::Seconds(1.0))
    };
    free_run_table(model, p, dataset, &settings).expect("simulates")
}

/// The same axis simulated with the published parameters, for a clone without the records: both
/// methods return them.
#[test]
fn a_simulated_axis_gives_its_parameters_back() {
    // Mass, viscous and dry friction, offset; then how sharp dry friction turns, which motions of
    // this size do not tell.
    let truth: Vec<f64> = Emps.params().iter().map(|p| p.nominal).collect();
    assert_eq!(truth[..4], [95.1089, 203.5034, 20.3935, -3.1648]);
    let recipe = Recipe {
        records: 2,
        seconds: 6.0,
        step: 1e-3,
        amplitude: vec![80.0],
        highest: 5.0,
        start: vec![0.0],
        // Positions of a fine encoder, and no velocities.
        noise: vec![1e-7, f64::INFINITY],
        outliers: (0.0, 1.0),
    };
    let dataset = records(&Emps, &truth, &recipe, 3).expect("simulates");
    let equation = Settings {
        method: Method::EquationError,
        cutoff: Some(100.0),
        decimate: Some(10),
        ..Settings::default()
    };
    let output = Settings {
        horizon: Horizon::Seconds(1.0),
        initial_state: InitialState::Measured,
        weighting: Weighting::Position,
        ..Settings::default()
    };
    for (settings, share) in [(equation, 0.02), (output, 0.01)] {
        let found = identify(&Emps, &dataset, &settings);
        for (value, truth) in found.best().parameters.iter().zip(&truth[..4]) {
            let method = settings.method;
            assert!(
                (value / truth - 1.0).abs() < share,
                "{method:?}: {value} for {truth}"
            );
        }
    }
}

#[test]
fn emps_equation_error_gives_the_published_parameters() {
    let Some(folder) = shared("data/emps") else {
        return;
    };
    let dataset = Dataset::read(&folder).expect("readable");
    let settings = Settings {
        method: Method::EquationError,
        cutoff: Some(100.0),
        decimate: Some(10),
        ..Settings::default()
    };
    let found = identify(&Emps, &dataset, &settings);
    // Janot, Gautier, Brunot 2019: mass, viscous and dry friction, offset.
    let published = [95.1089, 203.5034, 20.3935, -3.1648];
    for (value, published) in found.best().parameters.iter().zip(published) {
        assert!(
            (value / published - 1.0).abs() < 0.02,
            "{value} for {published}"
        );
    }
    for error in &found.force_error {
        let relative = error.relative.expect("the drive acts");
        let limit = if error.role == Role::Train {
            0.041
        } else {
            0.060
        };
        assert!(relative <= limit, "{error:?}");
    }
}

#[test]
fn emps_output_error_beats_the_published_parameters_on_unseen_motion() {
    let Some(folder) = shared("data/emps") else {
        return;
    };
    let dataset = Dataset::read(&folder).expect("readable");
    let settings = Settings {
        horizon: Horizon::Seconds(1.0),
        initial_state: InitialState::Measured,
        weighting: Weighting::Position,
        ..Settings::default()
    };
    let found = identify(&Emps, &dataset, &settings);
    assert!(found.best().status.converged());
    let table = one_second(&Emps, &found.best().parameters, &dataset);
    for (score, limit) in table.roles.iter().zip([1.45e-3, 2.00e-3]) {
        let rms = score.joints[0].q.expect("compared").rms;
        assert!(rms < limit, "{:?}: {rms}", score.role);
    }
}
