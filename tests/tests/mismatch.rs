//! Records with noise and with friction that the model lacks.

use std::ops::ControlFlow;

use pid_models::Arm6;
use pid_runtime::dynamics::Dynamics;
use pid_runtime::ident::{Settings, Weighting, identify};
use pid_runtime::solver;
use pid_runtime::transcribe::Scheme;
use pid_tests::mismatched::{follow, record};
use pid_tests::two_link;

/// The preparing fit of the steps' residuals finds inertias of the wrist that are negative. Motions then grow by 30 a step; the linear
/// system over segments of ten steps had no digit left, and the solver ended at its first exact step.
#[test]
fn an_arm_with_all_parameters_free_converges_under_noise() {
    let dataset = record(&Arm6, &follow, 400, 0.01).expect("simulates");
    let start: Vec<f64> = Arm6
        .params()
        .iter()
        .map(|p| (0.8 * p.nominal).clamp(p.lower, p.upper))
        .collect();
    let settings = Settings {
        weighting: Weighting::Spread,
        solver: solver::Settings {
            max_iterations: 300,
            ..Settings::default().solver
        },
        ..two_link::settings(Scheme::Trapezoidal)
    };
    let found = identify(&Arm6, &dataset, &settings, Some(&start), &mut |_| {
        ControlFlow::Continue(())
    })
    .expect("identifies");
    let run = found.best();
    assert!(
        run.status.converged() && run.check.primal_inf < 1e-6,
        "{} after {} iterations, violation {:e}",
        run.status.reason(),
        run.iterations,
        run.check.primal_inf
    );
}
