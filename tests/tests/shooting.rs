//! Single and multiple shooting against differences, full discretization, an accurate simulation
//! and a second linear solver.

use std::sync::Arc;

use pid_data::InputHold;
use pid_fit::integrate::{Drive, Settings, simulate};
use pid_fit::transcribe::{
    Adaptive, Curvature, ExplicitForm, FullDiscretization, Output, Scheme, Shooting, ShootingKkt,
    Track,
};
use pid_models::{DoublePendulum, TwoLink};
use pid_nlp::Nlp;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::kkt::{Kkt, KktValues};
use pid_runtime::dynamics::{Dynamics, Hessian};
use pid_runtime::generic::functions::{Exact, GenericFunction};
use pid_runtime::num_dual::DualNum;
use pid_tests::derivatives::{
    assert_derivative, dense_hessian, dense_jacobian, lagrangian_gradient, numbers, setup, unusual,
    window,
};
use pid_tests::two_link;

fn schemes() -> Vec<Scheme> {
    let names = [
        "explicit-euler",
        "heun",
        "rk4",
        "trapezoidal",
        "implicit-midpoint",
        "gauss-legendre-2",
        "radau-3",
    ];
    names.iter().map(|n| n.parse().expect("a scheme")).collect()
}

/// Friction gentle enough for coarse explicit steps.
fn gentle() -> Vec<f64> {
    let mut p = two_link::truth();
    for (value, info) in p.iter_mut().zip(TwoLink.params()) {
        if info.name.starts_with("sharp") {
            *value = 3.0;
        }
    }
    p
}

fn moved(problem: &Shooting<'_>, p: &[f64]) -> Vec<f64> {
    let mut x = problem.starting_point(p);
    let moves = numbers(5, x.len());
    x.iter_mut().zip(moves).for_each(|(x, m)| *x += 0.02 * m);
    x
}

/// Gradient, Jacobian and Hessian of the Lagrangian at a point.
fn check(name: &str, problem: &mut Shooting<'_>, p: &[f64]) {
    let x = moved(problem, p);
    let (n, m) = (problem.n(), problem.m());
    let mut gradient = vec![f64::NAN; n];
    problem.gradient(&x, &mut gradient);
    assert_derivative(&format!("{name}: gradient"), &gradient, &x, &mut |x| {
        vec![problem.objective(x)]
    });
    let jacobian = dense_jacobian(problem, &x);
    assert_derivative(&format!("{name}: Jacobian"), &jacobian, &x, &mut |x| {
        let mut c = vec![f64::NAN; m];
        problem.constraints(x, &mut c);
        c
    });
    let lambda = numbers(7, m);
    let hessian = dense_hessian(problem, &x, 0.7, &lambda);
    assert_derivative(&format!("{name}: Hessian"), &hessian, &x, &mut |x| {
        lagrangian_gradient(problem, x, 0.7, &lambda)
    });
}

#[test]
fn derivatives_agree_with_differences() {
    for scheme in schemes() {
        for (held, linear, windows, nodes, substeps) in [
            (false, false, vec![6], 1, 1),
            (true, true, vec![5], 2, 2),
            (false, true, vec![7, 4], 3, 1),
            (false, false, vec![4], 5, 1),
        ] {
            let tracks: Vec<Track> = windows
                .iter()
                .enumerate()
                .map(|(k, &steps)| window(&TwoLink, steps, 10 * k as u64))
                .collect();
            let mut setup = setup(&TwoLink, scheme, held, linear);
            setup.substeps = substeps;
            if linear && !held {
                (setup.loss, setup.priors) = unusual();
            }
            let mut problem = Shooting::new(&TwoLink, &tracks, setup, nodes, None);
            let name = format!("{scheme}, held {held}, linear {linear}, {nodes} nodes");
            check(&name, &mut problem, &gentle());
        }
    }
}

/// Height of the tip of the second link, and the shoulder's velocity scaled by a parameter.
struct Tip;

impl GenericFunction for Tip {
    fn outputs(&self) -> usize {
        2
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D], out: &mut [D]) {
        out[0] = x[0].sin() * x[1].cos() * p[0];
        out[1] = x[2] * x[2] * p[1];
    }
}

/// Two windows that measure [`Tip`], every sample with its own weight, some missing.
fn output_tracks() -> Vec<Track> {
    [(5, 1), (3, 20)]
        .map(|(steps, seed)| {
            let mut track = window(&TwoLink, steps, seed);
            let count = 2 * (steps + 1);
            track.measured = numbers(seed + 50, count);
            track.measured[3] = f64::NAN;
            track.weights = numbers(seed + 60, count).iter().map(|w| 1.5 + w).collect();
            track
        })
        .to_vec()
}

#[test]
fn outputs_of_the_user_are_differentiated_exactly() {
    let output = Some(Output(Arc::new(Exact::new(Tip, 4, 19))));
    for (scheme, nodes) in [(Scheme::RungeKutta4, 1), (Scheme::Trapezoidal, 3)] {
        let mut setup = setup(&TwoLink, scheme, false, true);
        setup.output = output.clone();
        let mut problem = Shooting::new(&TwoLink, &output_tracks(), setup, nodes, None);
        check(&format!("{scheme}, {nodes} nodes"), &mut problem, &gentle());
    }
    for substeps in [1, 2] {
        let mut setup = setup(&TwoLink, Scheme::Trapezoidal, false, true);
        (setup.output, setup.substeps) = (output.clone(), substeps);
        let mut problem = FullDiscretization::new(&TwoLink, &output_tracks(), setup);
        let x = problem.starting_point(&gentle());
        let mut gradient = vec![f64::NAN; x.len()];
        problem.gradient(&x, &mut gradient);
        assert_derivative("gradient", &gradient, &x, &mut |x| {
            vec![problem.objective(x)]
        });
        let lambda = numbers(7, problem.m());
        let hessian = dense_hessian(&mut problem, &x, 0.7, &lambda);
        assert_derivative("Hessian", &hessian, &x, &mut |x| {
            lagrangian_gradient(&mut problem, x, 0.7, &lambda)
        });
    }
}

#[test]
fn without_output_curvature_the_hessian_is_that_of_gauss_newton() {
    let track = window(&TwoLink, 6, 1);
    let mut setup = setup(&TwoLink, Scheme::Heun, false, false);
    setup.curvature = Curvature::GaussNewton;
    let mut problem = Shooting::new(&TwoLink, &[track], setup, 1, None);
    let x = moved(&problem, &gentle());
    let hessian = dense_hessian(&mut problem, &x, 1.0, &[]);
    // 2 RᵀR with the residuals' Jacobian by differences.
    let n = x.len();
    let slope = |problem: &mut Shooting<'_>, j: usize| -> Vec<f64> {
        let mut residuals = |d: f64| {
            let mut y = x.clone();
            y[j] += d;
            let all = problem.residuals(&y).0;
            all.into_iter()
                .filter(|r| !r.is_nan())
                .collect::<Vec<f64>>()
        };
        let (a, b) = (residuals(1e-5), residuals(-1e-5));
        a.iter().zip(b).map(|(a, b)| (a - b) / 2e-5).collect()
    };
    let columns: Vec<Vec<f64>> = (0..n).map(|j| slope(&mut problem, j)).collect();
    let scale = hessian.iter().fold(0.0_f64, |m, h| m.max(h.abs()));
    for i in 0..n {
        for j in 0..n {
            let product: f64 = columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum();
            assert!(
                (hessian[i * n + j] - 2.0 * product).abs() < 1e-6 * scale,
                "{i} {j}"
            );
        }
    }
}

#[test]
fn shooting_from_every_sample_is_full_discretization() {
    let tracks = [window(&TwoLink, 6, 1), window(&TwoLink, 3, 8)];
    let form = ExplicitForm::new(&TwoLink);
    let mut setup = setup(&TwoLink, Scheme::ExplicitEuler, false, false);
    setup.inertia = vec![1.0; 2];
    let mut full = FullDiscretization::new(&form, &tracks, setup.clone());
    let mut shooting = Shooting::new(&TwoLink, &tracks, setup, usize::MAX, None);
    assert_eq!((full.n(), full.m()), (shooting.n(), shooting.m()));
    let x = moved(&shooting, &gentle());
    assert!((full.objective(&x) - shooting.objective(&x)).abs() < 1e-14);
    let (mut a, mut b) = (vec![0.0; full.m()], vec![0.0; full.m()]);
    full.constraints(&x, &mut a);
    shooting.constraints(&x, &mut b);
    for (a, b) in a.iter().zip(&b) {
        // The rows have opposite signs: x_{k+1} − Φ there, Φ − x_{k+1} here.
        assert!((a + b).abs() < 1e-12, "{a} {b}");
    }
}

#[test]
fn structured_and_sparse_systems_have_one_solution() {
    for held in [false, true] {
        for nodes in [1, 4, 30] {
            let tracks = [window(&TwoLink, 25, 3), window(&TwoLink, 14, 30)];
            let setup = setup(&TwoLink, Scheme::ImplicitMidpoint, held, false);
            let mut problem = Shooting::new(&TwoLink, &tracks, setup, nodes, None);
            let x = problem.starting_point(&gentle());
            let (n, m) = (problem.n(), problem.m());
            let lambda: Vec<f64> = numbers(10, m).iter().map(|l| 1e-4 * l).collect();
            let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
            let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
            problem.jacobian(&x, &mut jacobian);
            problem.set_curvature(Curvature::GaussNewton);
            problem.hessian(&x, 1.0, &lambda, &mut hessian);
            let sigma = vec![1.0; n];
            let values = KktValues {
                hessian: &hessian,
                jacobian: &jacobian,
                sigma: &sigma,
            };
            let mut structured = ShootingKkt::from(&problem);
            let mut sparse = SparseKkt::new(&problem);
            let (rx, rc) = (numbers(11, n), numbers(12, m));
            let mut solutions = Vec::new();
            for kkt in [&mut structured as &mut dyn Kkt, &mut sparse] {
                let info = kkt.factorise(values).unwrap();
                assert_eq!(
                    (info.delta_x, info.shift),
                    (0.0, 0.0),
                    "{nodes} nodes, held {held}"
                );
                let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
                let left = kkt.solve(&rx, &rc, &mut dx, &mut dl);
                assert!(left < 1e-9, "{nodes} nodes, held {held}: {left:e}");
                solutions.push((dx, dl));
            }
            let close = |a: &[f64], b: &[f64]| {
                let scale = b.iter().fold(1e-30_f64, |m, b| m.max(b.abs()));
                let error = a
                    .iter()
                    .zip(b)
                    .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                assert!(
                    error <= 1e-7 * scale,
                    "{nodes} nodes, held {held}: {error:e} of {scale:e}"
                );
            };
            close(&solutions[0].0, &solutions[1].0);
            close(&solutions[0].1, &solutions[1].1);
            // The limit holds for the part in the parameters, of the last solution or of the one
            // that is named.
            let (mut dx, mut dl) = solutions.swap_remove(0);
            let norm = |dx: &[f64]| {
                let p = &dx[dx.len() - problem.setup().scale.len()..];
                p.iter().map(|d| d * d).sum::<f64>().sqrt()
            };
            let free = norm(&dx);
            let before = structured.limit(0.1 * free).expect("a solution");
            assert!((before - free).abs() <= 1e-9 * free, "{before} {free}");
            structured.solve(&rx, &rc, &mut dx, &mut dl);
            let limited = norm(&dx);
            assert!(
                limited <= 0.1001 * free && limited > 0.05 * free,
                "{limited} {free}"
            );
            structured.remember(&dx);
            let before = structured.limit(f64::INFINITY).expect("a solution");
            assert!(
                (before - limited).abs() <= 1e-9 * free,
                "{before} {limited}"
            );
        }
    }
}

/// Half a second of the two links with jumping inputs.
fn motion(model: &dyn Hessian, p: &[f64], q0: &[f64], v0: &[f64]) -> Track {
    let d = model.dims();
    let t: Vec<f64> = (0..26).map(|k| 0.02 * f64::from(k)).collect();
    let u: Vec<f64> = numbers(3, d.nu * 26).iter().map(|u| 20.0 * u).collect();
    let drive = Drive {
        t: &t,
        u: &u,
        hold: InputHold::ZeroOrder,
    };
    let accurate = Settings {
        rtol: 1e-12,
        atol: 1e-13,
        ..Settings::default()
    };
    let motion = simulate(model, p, q0, v0, &drive, accurate).unwrap();
    let states: Vec<f64> = motion
        .q
        .chunks_exact(d.nq)
        .zip(motion.v.chunks_exact(d.nq))
        .flat_map(|(q, v)| [q, v].concat())
        .collect();
    Track {
        t,
        measured: states.clone(),
        guess: states,
        u,
        weights: vec![1.0; 2 * d.nq],
    }
}

#[test]
fn controlled_steps_follow_an_accurate_simulation_and_are_differentiated() {
    let p = two_link::truth();
    let track = motion(&TwoLink, &p, &[0.3, 2.2], &[0.8, -0.6]);
    for (rtol, within) in [(1e-6, 1e-4), (1e-10, 1e-8)] {
        let adaptive = Adaptive {
            rtol,
            atol: 1e-2 * rtol,
        };
        let setup = setup(&TwoLink, Scheme::ExplicitEuler, false, false);
        let tracks = std::slice::from_ref(&track);
        let mut problem = Shooting::new(&TwoLink, tracks, setup, 2, Some(adaptive));
        let x = problem.starting_point(&p);
        let states = problem.states(&x).expect("integrates");
        let error = states
            .iter()
            .zip(&track.guess)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(error < within, "rtol {rtol:e}: {error:e}");
        if rtol < 1e-9 {
            // Differences see the changes of the step sequence, at the size of the tolerance over their step.
            check("controlled steps", &mut problem, &gentle());
        }
    }
}

#[test]
fn a_motion_that_explodes_has_values_that_are_not_finite() {
    let track = motion(
        &DoublePendulum,
        &nominal(&DoublePendulum),
        &[0.1, 0.2],
        &[0.0; 2],
    );
    let setup = setup(&DoublePendulum, Scheme::ExplicitEuler, false, false);
    let mut problem = Shooting::new(&DoublePendulum, &[track], setup, 1, None);
    let mut x = problem.starting_point(&nominal(&DoublePendulum));
    x[2] = 1e9;
    assert!(!problem.objective(&x).is_finite());
    assert!(problem.states(&x).is_none());
    let mut gradient = vec![0.0; problem.n()];
    problem.gradient(&x, &mut gradient);
    assert!(gradient.iter().any(|g| !g.is_finite()));
    // The next point is evaluated as if nothing had been.
    x[2] = 0.0;
    assert!(problem.objective(&x).is_finite());
}

fn nominal(model: &dyn Hessian) -> Vec<f64> {
    model.params().iter().map(|p| p.nominal).collect()
}

#[test]
fn nodes_stand_where_they_should_and_sizes_follow() {
    let track = motion(&TwoLink, &two_link::truth(), &[0.3, 2.2], &[0.8, -0.6]);
    for nodes in [1, 2, 5, 25, 26, 400] {
        let setup = setup(&TwoLink, Scheme::ExplicitEuler, false, false);
        let problem = Shooting::new(&TwoLink, std::slice::from_ref(&track), setup, nodes, None);
        let count = nodes.min(26);
        assert_eq!(problem.nodes(), [count]);
        assert_eq!(
            (problem.n(), problem.m()),
            (4 * count + 19, 4 * (count - 1))
        );
        let x = problem.starting_point(&two_link::truth());
        for j in 0..count {
            let sample = j * 26 / count;
            assert_eq!(x[4 * j..4 * j + 4], track.guess[4 * sample..4 * sample + 4]);
        }
    }
}
