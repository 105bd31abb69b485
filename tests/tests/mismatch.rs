//! Records with noise and with friction that the model lacks.

use std::ops::ControlFlow;

use pid_data::Dataset;
use pid_fit::ident::{Identification, Progress, Settings, Weighting, identify};
use pid_fit::transcribe::{Body, FullDiscretization, Scheme, Setup};
use pid_models::{Arm6, TwoLink};
use pid_nlp::Nlp;
use pid_nlp::solver;
use pid_runtime::dynamics::{At, Dynamics, Jacobian};
use pid_tests::derivatives::{
    assert_derivative, dense_hessian, lagrangian_gradient, setup, window,
};
use pid_tests::mismatched::{Geared, ROTOR, follow, follow_geared, record, sines, start};
use pid_tests::two_link;

fn settings(consistent: bool) -> Settings {
    Settings {
        weighting: Weighting::Spread,
        consistent,
        solver: solver::Settings {
            max_iterations: 300,
            ..Settings::default().solver
        },
        ..two_link::settings(Scheme::Trapezoidal)
    }
}

/// Fits 84 parameters of the arm to 400 noisy samples; it must converge.
fn fitted(consistent: bool) -> (Dataset, Identification) {
    let dataset = record(&Arm6, &follow, 400, 0.01).expect("simulates");
    let settings = settings(consistent);
    let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
    let found = identify(&Arm6, &dataset, &settings, Some(&start(&Arm6)), go_on);
    let found = found.expect("identifies");
    let run = found.best();
    assert!(
        run.status.converged() && run.check.primal_inf < 1e-6,
        "{} after {} iterations, violation {:e}",
        run.status.reason(),
        run.iterations,
        run.check.primal_inf
    );
    (dataset, found)
}

/// On a record long enough that threads share its steps, the result is the same to the last bit,
/// whatever their number.
#[test]
fn the_number_of_threads_changes_nothing() {
    let dataset = record(&TwoLink, &sines, 2_000, 0.02).expect("simulates");
    let mut settings = settings(false);
    settings.solver.max_iterations = 40;
    let fit = || {
        let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
        let found = identify(&TwoLink, &dataset, &settings, Some(&start(&TwoLink)), go_on);
        found.expect("identifies").best().parameters.clone()
    };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(fit)
    };
    assert_eq!(with(1), with(3));
}

/// r = M a + b − f with the rotors in M alone, and ∂r/∂a = M.
#[test]
fn rotors_add_their_inertia_to_the_mass_matrix() {
    let geared = Geared::new(&Arm6);
    let wave = |scale: f64, of: f64| -> Vec<f64> {
        (0..6).map(|j| scale * (of + f64::from(j)).sin()).collect()
    };
    let (q, v, a, u) = (
        wave(1.0, 0.3),
        wave(2.0, 1.1),
        wave(9.0, 2.0),
        wave(5.0, 0.7),
    );
    let p: Vec<f64> = Arm6.params().iter().map(|p| p.nominal).collect();
    let at = At {
        q: &q,
        v: &v,
        a: &a,
        u: &u,
        p: &p,
    };
    let (mut m, mut bare) = ([0.0; 21], [0.0; 21]);
    geared.mass_matrix(&at, &mut m);
    Arm6.mass_matrix(&at, &mut bare);
    let (mut b, mut f, mut r) = ([0.0; 6], [0.0; 6], [0.0; 6]);
    geared.bias(&at, &mut b);
    geared.applied_force(&at, &mut f);
    let pattern = geared.jacobian_pattern();
    let mut values = vec![0.0; pattern.nnz()];
    geared.residual_jacobian(&at, &mut r, &mut values);
    for i in 0..6 {
        let mut sum = b[i] - f[i];
        for j in 0..6 {
            let place = i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
            let rotor = if i == j { ROTOR } else { 0.0 };
            assert!((m[place] - bare[place] - rotor).abs() < 1e-14);
            sum += m[place] * a[j];
            let entries = pattern.rows.iter().zip(pattern.cols).zip(&values);
            let slope: f64 = entries
                .filter(|((row, col), _)| (**row, **col) == (i as u32, (12 + j) as u32))
                .map(|(_, value)| *value)
                .sum();
            assert!((slope - m[place]).abs() < 1e-12, "{i} {j}");
        }
        assert!((r[i] - sum).abs() < 1e-10, "{i}: {} {sum}", r[i]);
    }
}

/// Beyond a thousand samples the barrier grows with the record, once the constraints hold.
#[test]
fn a_longer_record_of_bodies_converges_once_its_constraints_hold() {
    let geared = Geared::new(&Arm6);
    let dataset = record(&geared, &follow_geared, 1200, 0.01).expect("simulates");
    let mut phases = Vec::new();
    let news = &mut |news: &Progress<'_>| {
        if phases.last() != Some(&news.phase) {
            phases.push(news.phase);
        }
        ControlFlow::Continue(())
    };
    let settings = settings(true);
    let found = identify(&geared, &dataset, &settings, Some(&start(&Arm6)), news);
    let found = found.expect("identifies");
    let run = found.best();
    assert!(run.status.converged(), "{}", run.status.reason());
    assert!(run.check.primal_inf < 1e-6, "{:e}", run.check.primal_inf);
    assert_eq!(
        phases[1..],
        [
            "approaching by Gauss-Newton",
            "closing the constraints",
            "solving"
        ]
    );
    let bodies = Body::all(Arm6.params());
    assert!(bodies.iter().all(|b| b.holds(&run.parameters)));
    // Noise of 1e-3 rad and 1e-2 rad/s, and what Stribeck friction leaves beside it.
    assert!(run.objective < 1e-2, "{:e}", run.objective);
}

/// The preparing fit of the steps' residuals finds negative inertias of the wrist. Motions then
/// grow by 30 a step, and the linear system over segments of ten steps would have no correct digit
/// left.
#[test]
fn an_arm_with_all_parameters_free_converges_under_noise() {
    fitted(false);
}

/// The barrier of the links as part of the program: its derivatives against differences.
#[test]
fn derivatives_with_bodies_agree_with_differences() {
    let p: Vec<f64> = Arm6.params().iter().map(|p| p.nominal).collect();
    let bodies = Body::all(Arm6.params());
    assert_eq!(bodies.len(), 6);
    let setup = Setup {
        bodies: bodies.into_iter().map(|b| b.around(&p)).collect(),
        bodies_weight: 0.3,
        // Small ones: the flange weighs 0.2 kg, differences must stay inside what bodies can be.
        scale: (0..p.len()).map(|k| 0.4 + 0.3 * (k % 3) as f64).collect(),
        ..setup(&Arm6, Scheme::Trapezoidal, false, false)
    };
    let tracks = [window(&Arm6, 1, 3)];
    let mut problem = FullDiscretization::new(&Arm6, &tracks, setup);
    let moved: Vec<f64> = (0..p.len())
        .map(|k| p[k] * (1.0 + 3e-3 * (1.7 * k as f64).sin()))
        .collect();
    let x = problem.starting_point(&moved);
    let mut gradient = vec![f64::NAN; x.len()];
    problem.gradient(&x, &mut gradient);
    assert_derivative("gradient", &gradient, &x, &mut |x| {
        vec![problem.objective(x)]
    });
    // Without multipliers, whose part is tested elsewhere and large beside this one.
    let lambda = vec![0.0; problem.m()];
    let hessian = dense_hessian(&mut problem, &x, 0.7, &lambda);
    assert_derivative("Hessian", &hessian, &x, &mut |x| {
        lagrangian_gradient(&mut problem, x, 0.7, &lambda)
    });
}

/// With links kept bodies of positive density the mass matrix is positive definite throughout the
/// fit: the optimum has inertias of a body.
#[test]
fn an_arm_kept_consistent_converges_to_bodies() {
    let (dataset, found) = fitted(true);
    let run = found.best();
    let bodies = Body::all(Arm6.params());
    assert!(bodies.iter().all(|b| b.holds(&run.parameters)));
    // J is that of the data alone: the mean of the weighted squares of the fitted motion.
    let e = &dataset.experiments[0];
    let v = e.v.as_ref().expect("measured");
    let channels: Vec<Vec<f64>> = (0..12)
        .map(|c| {
            let of = if c < 6 { &e.q } else { v };
            of.iter().skip(c % 6).step_by(6).copied().collect()
        })
        .collect();
    let mut j = 0.0;
    for (c, measured) in channels.iter().enumerate() {
        let n = measured.len() as f64;
        let mean = measured.iter().sum::<f64>() / n;
        let spread: f64 = measured.iter().map(|x| (x - mean) * (x - mean)).sum();
        let fitted = found.motion.iter().skip(c).step_by(12);
        let squares: f64 = measured
            .iter()
            .zip(fitted)
            .map(|(m, f)| (m - f) * (m - f))
            .sum();
        j += squares / spread;
    }
    assert!(
        (run.objective / j - 1.0).abs() < 1e-9,
        "{} {j}",
        run.objective
    );
}

#[test]
fn held_inertias_that_no_body_has_are_refused() {
    let dataset = record(&Arm6, &follow, 50, 0.01).expect("simulates");
    let mut start: Vec<f64> = Arm6.params().iter().map(|p| p.nominal).collect();
    let forearm = &Body::all(Arm6.params())[2];
    start[forearm.parameters()[4]] = 9.0;
    let settings = Settings {
        consistent: true,
        // All but the mass: nothing that is free makes up for it.
        hold: forearm.parameters()[1..].to_vec(),
        ..two_link::settings(Scheme::Trapezoidal)
    };
    let refused = identify(&Arm6, &dataset, &settings, Some(&start), &mut |_| {
        ControlFlow::Continue(())
    });
    let error = refused.expect_err("no body").to_string();
    assert!(error.contains("`l3`") && error.contains("help"), "{error}");
}
