//! The discretised problem against central differences, an accurate integration and a second linear solver.

use pid_data::InputHold;
use pid_fit::integrate::{Drive, ForwardDynamics, Settings, simulate};
use pid_fit::transcribe::{ExplicitForm, FullDiscretization, ResidualFit, Scheme, Setup, Track};
use pid_models::{DoublePendulum, Emps, TwoLink};
use pid_nlp::Nlp;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::kkt::structured::StructuredKkt;
use pid_nlp::solver::kkt::{Kkt, KktValues};
use pid_runtime::dynamics::{At, Dynamics, Hessian, Jacobian};
use pid_tests::derivatives::{
    assert_derivative, dense_hessian, dense_jacobian, lagrangian_gradient, numbers, setup, unusual,
    window,
};
use pid_tests::two_link;

/// Every scheme, collocation with two numbers of stages each.
fn schemes() -> Vec<Scheme> {
    let names = [
        "explicit-euler",
        "heun",
        "rk4",
        "dormand-prince",
        "trapezoidal",
        "implicit-midpoint",
        "hermite-simpson",
        "gauss-legendre-2",
        "gauss-legendre-3",
        "radau-1",
        "radau-2",
        "radau-3",
    ];
    names.iter().map(|n| n.parse().expect("a scheme")).collect()
}

/// Every setting of the discretization: its description and the problem's ingredients.
fn for_each_setting(check: impl Fn(&str, &[Track], Setup)) {
    for scheme in schemes() {
        for (held, linear, windows) in [
            (false, false, vec![4]),
            (false, true, vec![3, 1, 2]),
            (true, false, vec![2, 3]),
            (true, true, vec![3]),
        ] {
            let tracks: Vec<Track> = windows
                .iter()
                .enumerate()
                .map(|(k, &steps)| window(&TwoLink, steps, 10 * k as u64))
                .collect();
            let name = format!("{scheme}, held {held}, linear {linear}, {windows:?}");
            let mut setup = setup(&TwoLink, scheme, held, linear);
            // A finer grid for the steps than for the samples, in one of the settings.
            setup.substeps = if held && linear { 3 } else { 1 };
            // Long tails and priors in another.
            if linear && !held {
                (setup.loss, setup.priors) = unusual();
            }
            check(&name, &tracks, setup);
        }
    }
}

/// A point of the problem that is not its start: states and stages moved, parameters near the true ones.
fn point(problem: &FullDiscretization<'_>, seed: u64) -> Vec<f64> {
    let mut x = problem.starting_point(&two_link::truth());
    let moves = numbers(seed, x.len());
    x.iter_mut().zip(moves).for_each(|(x, m)| *x += 0.05 * m);
    x
}

#[test]
fn gradient_and_jacobian_agree_with_differences() {
    for_each_setting(|name, tracks, setup| {
        let mut problem = FullDiscretization::new(&TwoLink, tracks, setup);
        let x = point(&problem, 5);
        let (n, m) = (problem.n(), problem.m());
        let mut gradient = vec![f64::NAN; n];
        problem.gradient(&x, &mut gradient);
        assert_derivative(&format!("{name}: gradient"), &gradient, &x, &mut |x| {
            vec![problem.objective(x)]
        });
        let jacobian = dense_jacobian(&mut problem, &x);
        assert_derivative(&format!("{name}: Jacobian"), &jacobian, &x, &mut |x| {
            let mut c = vec![f64::NAN; m];
            problem.constraints(x, &mut c);
            c
        });
    });
}

#[test]
fn hessian_of_the_lagrangian_agrees_with_differences() {
    for_each_setting(|name, tracks, setup| {
        let mut problem = FullDiscretization::new(&TwoLink, tracks, setup);
        let x = point(&problem, 6);
        let lambda = numbers(7, problem.m());
        let hessian = dense_hessian(&mut problem, &x, 0.7, &lambda);
        assert_derivative(&format!("{name}: Hessian"), &hessian, &x, &mut |x| {
            lagrangian_gradient(&mut problem, x, 0.7, &lambda)
        });
    });
}

#[test]
fn missing_samples_do_not_count() {
    let track = window(&TwoLink, 3, 1);
    let samples = track.t.len() as f64;
    let mut expected = 0.0;
    for (k, (x, d)) in track.guess.iter().zip(&track.measured).enumerate() {
        if !d.is_nan() {
            expected += track.weights[k % 4] * (x - d) * (x - d) / samples;
        }
    }
    let setup = setup(&TwoLink, Scheme::ImplicitMidpoint, false, false);
    let mut problem = FullDiscretization::new(&TwoLink, &[track], setup);
    let x = problem.starting_point(&two_link::truth());
    assert!((problem.objective(&x) - expected).abs() < 1e-14);
}

/// Sharpness of the friction that low-order steps of this length resolve.
fn smooth_truth() -> Vec<f64> {
    let mut p = two_link::truth();
    for (value, info) in p.iter_mut().zip(TwoLink.params()) {
        if info.name.starts_with("sharp") {
            *value = 2.0;
        }
    }
    p
}

/// Two sampling intervals of 0.2 s, inputs that jump or ramp; an accurate simulation of them.
fn accurate_motion(linear: bool) -> (Track, Vec<f64>) {
    let t = vec![0.0, 0.2, 0.4];
    let u = vec![12.0, 60.0, 3.0, -20.0, 9.0, 40.0];
    let (q0, v0) = ([0.3, 2.2], [0.8, -0.6]);
    let drive = Drive {
        t: &t,
        u: &u,
        hold: if linear {
            InputHold::Linear
        } else {
            InputHold::ZeroOrder
        },
    };
    let accurate = Settings {
        rtol: 1e-13,
        atol: 1e-14,
        ..Settings::default()
    };
    let motion = simulate(&TwoLink, &smooth_truth(), &q0, &v0, &drive, accurate).unwrap();
    let states: Vec<f64> = (0..3)
        .flat_map(|k| [&motion.q[2 * k..2 * k + 2], &motion.v[2 * k..2 * k + 2]].concat())
        .collect();
    let end = states[8..].to_vec();
    let track = Track {
        t,
        measured: states.clone(),
        guess: states,
        u,
        weights: vec![1.0; 4],
    };
    (track, end)
}

/// Newton's method on the square system of all steps, the initial state and the parameters held.
fn motion_of_the_scheme(problem: &mut FullDiscretization<'_>, p: &[f64]) -> Vec<f64> {
    let mut x = problem.starting_point(p);
    let (n, m, first) = (problem.n(), problem.m(), 4);
    let mut kkt = SparseKkt::new(problem);
    let mut c = vec![0.0; m];
    let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
    let hessian = vec![0.0; problem.hessian_pattern().nnz()];
    let (zero, one) = (vec![0.0; n], vec![1.0; n]);
    let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
    for _ in 0..8 {
        problem.constraints(&x, &mut c);
        c.iter_mut().for_each(|c| *c = -*c);
        problem.jacobian(&x, &mut jacobian);
        let values = KktValues {
            hessian: &hessian,
            jacobian: &jacobian,
            sigma: &one,
        };
        kkt.factorise(values).expect("regular");
        kkt.solve(&zero, &c, &mut dx, &mut dl);
        x.iter_mut().zip(&dx).for_each(|(x, d)| *x += d);
    }
    problem.constraints(&x, &mut c);
    assert!(c.iter().all(|c| c.abs() < 1e-12), "the steps hold");
    x[first + m - 4..first + m].to_vec()
}

#[test]
fn schemes_converge_with_their_order_over_jumping_and_ramped_inputs() {
    for linear in [false, true] {
        let (track, end) = accurate_motion(linear);
        let p = smooth_truth();
        for scheme in schemes() {
            // Step numbers at which the error lies between that of coarse steps and rounding.
            let counts: [usize; 3] = match scheme.order() {
                1 => [64, 128, 256],
                2 => [16, 32, 64],
                3 => [12, 24, 48],
                4 => [32, 64, 128],
                5 if scheme.explicit() => [32, 64, 128],
                5 => [16, 32, 64],
                _ => [12, 24, 48],
            };
            let errors = counts.map(|substeps| {
                let mut setup = setup(&TwoLink, scheme, true, linear);
                // The parameters are held as well: the steps alone determine the motion.
                (setup.lower, setup.upper) = (vec![0.0; 19], vec![0.0; 19]);
                setup.substeps = substeps;
                let mut problem =
                    FullDiscretization::new(&TwoLink, std::slice::from_ref(&track), setup);
                let found = motion_of_the_scheme(&mut problem, &p);
                let difference = found.iter().zip(&end).map(|(a, b)| (a - b).abs());
                difference.fold(0.0_f64, f64::max)
            });
            let order = (errors[1] / errors[2]).log2();
            eprintln!("{scheme}, linear inputs {linear}: errors {errors:?}, order {order:.3}");
            let expected = f64::from(scheme.order());
            assert!(
                (order - expected).abs() < 0.15,
                "{scheme}: {order} for {expected}"
            );
        }
    }
}

/// State, inputs and parameters of a model, none of them special; z = (q, v, a, u, p).
fn anywhere(model: &dyn Dynamics, seed: u64) -> Vec<f64> {
    let d = model.dims();
    let mut raw = numbers(seed, d.nz());
    raw[d.u()..d.p()].iter_mut().for_each(|u| *u *= 10.0);
    for (z, info) in raw[d.p()..].iter_mut().zip(model.params()) {
        let moved = if info.nominal == 0.0 {
            0.1 * *z
        } else {
            info.nominal * (1.0 + 0.1 * *z)
        };
        // Slopes that differences of order 4 resolve.
        *z = if info.name.starts_with("sharp") {
            5.0 + *z
        } else {
            moved
        };
    }
    raw
}

fn at<'a>(model: &dyn Dynamics, z: &'a [f64]) -> At<'a> {
    let d = model.dims();
    At {
        q: &z[..d.v()],
        v: &z[d.v()..d.a()],
        a: &z[d.a()..d.u()],
        u: &z[d.u()..d.p()],
        p: &z[d.p()..],
    }
}

/// ∇(λᵀ r̃) from the Jacobian.
fn weighted_rows(form: &ExplicitForm<'_>, z: &[f64], lambda: &[f64]) -> Vec<f64> {
    let mut r = vec![0.0; lambda.len()];
    let mut values = vec![0.0; form.jacobian_pattern().nnz()];
    form.residual_jacobian(&at(form, z), &mut r, &mut values);
    let mut out = vec![0.0; z.len()];
    let pattern = form.jacobian_pattern();
    for ((&row, &col), v) in pattern.rows.iter().zip(pattern.cols).zip(values) {
        out[col as usize] += lambda[row as usize] * v;
    }
    out
}

#[test]
fn the_explicit_form_vanishes_at_the_forward_dynamics() {
    for model in [&TwoLink as &dyn Hessian, &Emps, &DoublePendulum] {
        let form = ExplicitForm::new(model);
        for seed in 0..20 {
            let mut z = anywhere(model, seed);
            let d = model.dims();
            let mut a = vec![0.0; d.nq];
            let x = at(model, &z);
            ForwardDynamics::new(model)
                .acceleration(x.q, x.v, x.u, x.p, &mut a)
                .unwrap();
            z[d.a()..d.u()].copy_from_slice(&a);
            let mut r = vec![f64::NAN; d.nq];
            form.residual(&at(model, &z), &mut r);
            let scale = a.iter().fold(1.0_f64, |m, a| m.max(a.abs()));
            assert!(
                r.iter().all(|r| r.abs() < 1e-12 * scale),
                "{}: {r:?}",
                model.name()
            );
        }
    }
}

#[test]
fn derivatives_of_the_explicit_form_agree_with_differences() {
    for model in [&TwoLink as &dyn Hessian, &Emps, &DoublePendulum] {
        let form = ExplicitForm::new(model);
        let nz = model.dims().nz();
        for seed in 0..5 {
            let z = anywhere(model, seed);
            let lambda = numbers(seed + 100, model.dims().nq);
            let name = format!("{} {seed}", model.name());
            let gradient = weighted_rows(&form, &z, &lambda);
            assert_derivative(&format!("{name}: Jacobian"), &gradient, &z, &mut |z| {
                let mut r = vec![f64::NAN; lambda.len()];
                form.residual(&at(model, z), &mut r);
                vec![r.iter().zip(&lambda).map(|(r, l)| r * l).sum()]
            });
            let mut values = vec![f64::NAN; form.hessian_pattern().nnz()];
            form.residual_hessian(&at(model, &z), &lambda, &mut values);
            let mut dense = vec![0.0; nz * nz];
            let pattern = form.hessian_pattern();
            for ((&r, &c), v) in pattern.rows.iter().zip(pattern.cols).zip(values) {
                let (r, c) = (r as usize, c as usize);
                dense[r * nz + c] += v;
                if r != c {
                    dense[c * nz + r] += v;
                }
            }
            assert_derivative(&format!("{name}: Hessian"), &dense, &z, &mut |z| {
                weighted_rows(&form, z, &lambda)
            });
        }
    }
}

#[test]
fn derivatives_of_the_residual_fit_agree_with_differences() {
    for_each_setting(|name, tracks, setup| {
        let mut problem = FullDiscretization::new(&TwoLink, tracks, setup);
        let x = point(&problem, 8);
        let p = x[problem.layout().p()..].to_vec();
        let mut fit = ResidualFit::new(&mut problem, &x);
        let mut gradient = vec![f64::NAN; p.len()];
        fit.gradient(&p, &mut gradient);
        assert_derivative(&format!("{name}: gradient"), &gradient, &p, &mut |p| {
            vec![fit.objective(p)]
        });
        let hessian = dense_hessian(&mut fit, &p, 1.0, &[]);
        assert_derivative(&format!("{name}: Hessian"), &hessian, &p, &mut |p| {
            lagrangian_gradient(&mut fit, p, 1.0, &[])
        });
    });
}

/// Two implementations of one linear system, on the two-link problem with the exact Hessian.
#[test]
fn structured_and_sparse_systems_have_one_solution() {
    for scheme in schemes() {
        for held in [false, true] {
            let tracks = [window(&TwoLink, 25, 3), window(&TwoLink, 14, 30)];
            let mut problem =
                FullDiscretization::new(&TwoLink, &tracks, setup(&TwoLink, scheme, held, false));
            let mut x = point(&problem, 9);
            if scheme.explicit() && scheme.order() > 1 {
                // Explicit steps amplify stiff friction by a polynomial of the degree of their
                // stages: such a chain of steps is ill-conditioned by itself.
                let gentle = problem.starting_point(&smooth_truth());
                let first = problem.layout().p();
                x[first..].copy_from_slice(&gentle[first..]);
            }
            let (n, m) = (problem.n(), problem.m());
            let lambda: Vec<f64> = numbers(10, m).iter().map(|l| 1e-4 * l).collect();
            let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
            let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
            problem.jacobian(&x, &mut jacobian);
            problem.hessian(&x, 1.0, &lambda, &mut hessian);
            // So much of the barrier that the matrix is convex without any regularisation.
            let sigma = vec![1.0; n];
            let values = KktValues {
                hessian: &hessian,
                jacobian: &jacobian,
                sigma: &sigma,
            };
            let mut structured = StructuredKkt::new(
                problem.layout().clone(),
                &problem.fixed_parameters(),
                problem.segment_steps(),
            );
            let mut sparse = SparseKkt::new(&problem);
            let mut solutions = Vec::new();
            let (rx, rc) = (numbers(11, n), numbers(12, m));
            for kkt in [&mut structured as &mut dyn Kkt, &mut sparse] {
                let info = kkt.factorise(values).unwrap();
                assert_eq!(
                    (info.delta_x, info.shift),
                    (0.0, 0.0),
                    "{scheme}, held {held}"
                );
                let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
                let left = kkt.solve(&rx, &rc, &mut dx, &mut dl);
                // Relative to the right-hand side; large multipliers leave their own rounding errors.
                let size = dl.iter().fold(0.0_f64, |m, l| m.max(l.abs()));
                assert!(
                    left < (1e-14 * size).max(1e-9),
                    "{scheme}, held {held}, system {}: {left:e} is left",
                    solutions.len()
                );
                solutions.push((dx, dl));
            }
            let close = |what: &str, a: &[f64], b: &[f64]| {
                let scale = b.iter().fold(0.0_f64, |m, b| m.max(b.abs()));
                let error = a
                    .iter()
                    .zip(b)
                    .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                assert!(
                    error <= 1e-7 * scale,
                    "{scheme}, held {held}, {what}: {error:e} of {scale:e}"
                );
            };
            close("x", &solutions[0].0, &solutions[1].0);
            close("multipliers", &solutions[0].1, &solutions[1].1);
        }
    }
}

/// With the accelerations solved for, the trapezoidal rule needs no stages; constraints, Jacobian
/// and Hessian of an iteration share what they solve for, also when the point changes between them.
#[test]
fn the_solved_form_agrees_with_forward_dynamics_and_differences() {
    let form = ExplicitForm::new(&TwoLink);
    for_each_setting(|name, tracks, mut setup| {
        if !matches!(setup.scheme, Scheme::Trapezoidal | Scheme::Heun) {
            return;
        }
        setup.inertia = vec![1.0; 2];
        let linear = setup.linear_inputs;
        let substeps = setup.substeps;
        let mut problem = FullDiscretization::solved(&form, tracks, setup);
        let x = point(&problem, 8);
        let m = problem.m();
        let lambda = numbers(9, m);
        // At the same point and after another one.
        for shift in [0.0, 0.0, 0.01] {
            let x: Vec<f64> = x.iter().map(|x| x + shift).collect();
            let jacobian = dense_jacobian(&mut problem, &x);
            let hessian = dense_hessian(&mut problem, &x, 0.7, &lambda);
            assert_derivative(&format!("{name}: Jacobian"), &jacobian, &x, &mut |x| {
                let mut c = vec![f64::NAN; m];
                problem.constraints(x, &mut c);
                c
            });
            assert_derivative(&format!("{name}: Hessian"), &hessian, &x, &mut |x| {
                lagrangian_gradient(&mut problem, x, 0.7, &lambda)
            });
        }
        if problem.setup().scheme != Scheme::Trapezoidal || linear || substeps != 1 {
            return;
        }
        // The rows of the first step of the first window, from accelerations of another implementation.
        let (mut c, p) = (vec![f64::NAN; m], problem.parameters(&x));
        problem.constraints(&x, &mut c);
        let (layout, track) = (problem.layout(), &tracks[0]);
        let window = &layout.windows[0];
        let h = track.t[1] - track.t[0];
        let state = |k: usize| &x[layout.state(window, k)..][..4];
        let mut forward = ForwardDynamics::new(&TwoLink);
        let mut acceleration = |k: usize| {
            let mut a = [f64::NAN; 2];
            let (q, v) = state(k).split_at(2);
            forward
                .acceleration(q, v, &track.u[..2], &p, &mut a)
                .unwrap();
            a
        };
        let (a0, a1) = (acceleration(0), acceleration(1));
        for j in 0..2 {
            let mean = 0.5 * (a0[j] + a1[j]);
            let expected = state(1)[2 + j] - state(0)[2 + j] - h * mean;
            let found = c[window.row + 2 + j];
            assert!(
                (found - expected).abs() < 1e-11 * (1.0 + h * mean.abs()),
                "{name}: {found}, {expected}"
            );
        }
    });
}
