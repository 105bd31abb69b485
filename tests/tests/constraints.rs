//! Constraints of the user: exact derivatives, and optima that respect them.

use std::ops::ControlFlow;
use std::sync::Arc;

use pid_data::InputHold;
use pid_fit::integrate::{self, Drive, simulate};
use pid_fit::transcribe::{
    Constrained, ConstrainedKkt, Constraint, ConstraintError, FullDiscretization, Place, Scheme,
    Sense, Setup, Shooting, States, Structured, Track,
};
use pid_models::{DoublePendulum, TwoLink};
use pid_nlp::solver::kkt::Kkt;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{self, ip};
use pid_nlp::{Nlp, check_point};
use pid_runtime::dynamics::Dynamics;
use pid_runtime::generic::functions::{Exact, GenericFunction};
use pid_runtime::num_dual::DualNum;
use pid_tests::derivatives::{
    assert_derivative, dense_hessian, dense_jacobian, lagrangian_gradient, numbers, setup, window,
};
use pid_tests::two_link;

/// A product of parameters.
struct Product;

impl GenericFunction for Product {
    fn outputs(&self) -> usize {
        1
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, _: &[D], p: &[D], out: &mut [D]) {
        out[0] = p[0] * p[1] - 5.0;
    }
}

/// A speed limit that depends on the position and a parameter, and a second value.
struct Limit;

impl GenericFunction for Limit {
    fn outputs(&self) -> usize {
        2
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D], out: &mut [D]) {
        out[0] = x[2] * x[2] + x[0].sin() * p[2] - 3.0;
        out[1] = x[3] * x[1] - 9.0;
    }
}

fn constraints(np: usize) -> Vec<Constraint> {
    let named = |name: &str, place, sense, function| Constraint {
        name: name.to_owned(),
        place,
        sense,
        function,
    };
    vec![
        named(
            "product",
            Place::Parameters,
            Sense::Equal,
            Arc::new(Exact::new(Product, 4, np)) as _,
        ),
        named(
            "speed",
            Place::EveryNode,
            Sense::AtMost,
            Arc::new(Exact::new(Limit, 4, np)) as _,
        ),
        named(
            "end",
            Place::Node(2),
            Sense::Equal,
            Arc::new(Exact::new(Limit, 4, np)) as _,
        ),
    ]
}

fn check<P: States>(name: &str, mut problem: Constrained<P>, start: &[f64]) {
    let mut x = problem.extend(start);
    x.iter_mut()
        .zip(numbers(3, start.len() + 1000))
        .for_each(|(x, m)| *x += 0.02 * m);
    let m = problem.m();
    let jacobian = dense_jacobian(&mut problem, &x);
    assert_derivative(&format!("{name}: Jacobian"), &jacobian, &x, &mut |x| {
        let mut c = vec![f64::NAN; m];
        problem.constraints(x, &mut c);
        c
    });
    let lambda = numbers(7, m);
    let hessian = dense_hessian(&mut problem, &x, 0.7, &lambda);
    assert_derivative(&format!("{name}: Hessian"), &hessian, &x, &mut |x| {
        lagrangian_gradient(&mut problem, x, 0.7, &lambda)
    });
}

#[test]
fn derivatives_agree_with_differences() {
    let tracks = [window(&TwoLink, 4, 1), window(&TwoLink, 2, 9)];
    let truth = two_link::truth();
    let options = || setup(&TwoLink, Scheme::Trapezoidal, false, false);
    let full = FullDiscretization::new(&TwoLink, &tracks, options());
    let start = full.starting_point(&truth);
    let nodes = full.state_positions().len();
    let constrained = Constrained::new(full, constraints(19)).unwrap();
    assert_eq!(nodes, 8);
    assert_eq!(constrained.m(), constrained.inner().m() + 1 + 2 * nodes + 2);
    assert_eq!(constrained.n(), constrained.inner().n() + 2 * nodes);
    check("full discretization", constrained, &start);
    let shooting = Shooting::new(&TwoLink, &tracks, options(), 2, None);
    let start = shooting.starting_point(&truth);
    check(
        "shooting",
        Constrained::new(shooting, constraints(19)).unwrap(),
        &start,
    );
}

#[test]
fn a_node_that_is_not_there_is_named() {
    let tracks = [window(&TwoLink, 1, 1)];
    let full = FullDiscretization::new(
        &TwoLink,
        &tracks,
        setup(&TwoLink, Scheme::Trapezoidal, false, false),
    );
    let error = Constrained::new(full, constraints(19))
        .err()
        .expect("an error");
    let expected = ConstraintError::NoSuchNode {
        name: "end".to_owned(),
        node: 2,
        nodes: 2,
    };
    assert_eq!(error, expected);
    assert!(
        error
            .to_string()
            .contains("constraint `end` asks for node 2"),
        "{error}"
    );
}

/// Sum of two parameters above its true value.
struct Above(usize, usize, f64);

impl GenericFunction for Above {
    fn outputs(&self) -> usize {
        1
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, _: &[D], p: &[D], out: &mut [D]) {
        out[0] = -p[self.0] - p[self.1] + self.2;
    }
}

/// A record of the double pendulum and a setup with two free inertias.
fn double_pendulum(scheme: Scheme) -> (Track, Setup, [usize; 2]) {
    let model = &DoublePendulum;
    let d = model.dims();
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let t: Vec<f64> = (0..61).map(|k| 0.01 * f64::from(k)).collect();
    let u = vec![0.0; d.nu * t.len()];
    let drive = Drive {
        t: &t,
        u: &u,
        hold: InputHold::ZeroOrder,
    };
    let motion = simulate(
        model,
        &p,
        &[1.2, 0.4],
        &[0.0; 2],
        &drive,
        integrate::Settings::default(),
    )
    .unwrap();
    let states: Vec<f64> = (0..t.len())
        .flat_map(|k| [&motion.q[2 * k..2 * k + 2], &motion.v[2 * k..2 * k + 2]].concat())
        .collect();
    let track = Track {
        t,
        measured: states.clone(),
        guess: states,
        u,
        weights: vec![1.0; 4],
    };
    let find = |n: &str| {
        model
            .params()
            .iter()
            .position(|p| p.name == n)
            .expect("a parameter")
    };
    let free = [find("i1"), find("i2")];
    let mut options = setup(model, scheme, false, false);
    for k in 0..d.np {
        let bounds = match free.contains(&k) {
            true => (1e-3, 10.0),
            false => (p[k], p[k]),
        };
        (options.lower[k], options.upper[k]) = bounds;
        options.scale[k] = 1.0;
    }
    (track, options, free)
}

/// A speed that a coordinate shall not exceed, softened by a parameter; depends on few of its arguments.
struct Fastest(usize, f64);

impl GenericFunction for Fastest {
    fn outputs(&self) -> usize {
        1
    }
    fn variables(&self) -> Option<Vec<usize>> {
        Some(vec![2, 4 + self.0])
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D], out: &mut [D]) {
        out[0] = x[2] * x[2] - p[self.0] * 0.1 - self.1;
    }
}

/// Where the first coordinate shall be.
struct At(f64);

impl GenericFunction for At {
    fn outputs(&self) -> usize {
        1
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], _: &[D], out: &mut [D]) {
        out[0] = x[0].sin() - self.0.sin();
    }
}

/// Solves by the structured system and by that of the whole matrix from the same start; the
/// solutions and their multipliers agree, constraints of every kind hold and push.
fn agree<P: Structured>(name: &str, program: impl Fn() -> (P, Vec<f64>), track: &Track) {
    let (_, _, [i, j]) = double_pendulum(Scheme::Trapezoidal);
    let np = DoublePendulum.dims().np;
    let p: Vec<f64> = DoublePendulum.params().iter().map(|p| p.nominal).collect();
    let speed = |k: usize| track.measured[4 * k + 2].powi(2);
    // At samples that are nodes of shooting too.
    let fastest = (0..51).step_by(10).map(speed).fold(0.0, f64::max);
    let constraint = |name: &str, place, sense, function| Constraint {
        name: name.to_owned(),
        place,
        sense,
        function,
    };
    let constraints = || {
        vec![
            constraint(
                "sum",
                Place::Parameters,
                Sense::AtMost,
                Arc::new(Exact::new(Above(i, j, p[i] + p[j] + 0.01), 4, np)) as _,
            ),
            constraint(
                "speed",
                Place::EveryNode,
                Sense::AtMost,
                Arc::new(Exact::new(Fastest(i, 0.95 * fastest - 0.1 * p[i]), 4, np)) as _,
            ),
            constraint(
                "first",
                Place::Node(0),
                Sense::Equal,
                Arc::new(Exact::new(At(track.measured[0] + 0.001), 4, np)) as _,
            ),
        ]
    };
    let held: Vec<bool> = (0..np).map(|k| k != i && k != j).collect();
    let settings = solver::Settings {
        objective_scale: 61.0,
        tol: 1e-12,
        ..solver::Settings::default()
    };
    let mut found = Vec::new();
    for structured in [true, false] {
        let (inner, start) = program();
        let mut problem = Constrained::new(inner, constraints()).unwrap();
        let x0 = problem.extend(&start);
        let mut kkt: Box<dyn Kkt> = match structured {
            true => Box::new(ConstrainedKkt::new(&problem, &held)),
            false => Box::new(SparseKkt::new(&problem)),
        };
        let solution = ip::solve(&mut problem, kkt.as_mut(), &x0, &settings, &mut |_, _| {
            ControlFlow::Continue(())
        });
        assert!(
            solution.status.converged(),
            "{name}, structured {structured}: {:?} after {} iterations",
            solution.status,
            solution.log.len()
        );
        let check = check_point(&mut problem, &solution.x, &solution.lambda);
        assert!(
            check.primal_inf < 1e-9 && check.dual_inf < 1e-6,
            "{name}, structured {structured}: {check:?}"
        );
        let own = problem.inner().m();
        let pushing = |l: &&f64| **l > 1e-6;
        let [sum, rest @ .., first] = &solution.lambda[own..] else {
            panic!("multipliers of the constraints");
        };
        assert!(*sum > 1e-4 && first.abs() > 1e-4, "{name}: {sum} {first}");
        let active = rest.iter().filter(pushing).count();
        assert!(active > 0 && active < rest.len(), "{name}: {active} active");
        found.push(solution);
    }
    let difference = |a: &[f64], b: &[f64]| {
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0_f64, f64::max)
    };
    let (a, b) = (&found[0], &found[1]);
    assert!(
        difference(&a.x, &b.x) < 1e-8,
        "{name}: {:.1e}",
        difference(&a.x, &b.x)
    );
    let size = b.lambda.iter().fold(0.0_f64, |s, l| s.max(l.abs()));
    assert!(
        difference(&a.lambda, &b.lambda) < 1e-6 * size,
        "{name}: multipliers {:.1e}",
        difference(&a.lambda, &b.lambda)
    );
}

#[test]
fn the_structured_system_and_the_whole_matrix_find_the_same_optimum() {
    for scheme in [
        Scheme::Trapezoidal,
        Scheme::GaussLegendre(pid_fit::transcribe::Stages::new(2).unwrap()),
    ] {
        let (track, options, _) = double_pendulum(scheme);
        let p: Vec<f64> = DoublePendulum.params().iter().map(|p| p.nominal).collect();
        let tracks = std::slice::from_ref(&track);
        agree(
            &format!("{scheme:?}"),
            || {
                let full = FullDiscretization::new(&DoublePendulum, tracks, options.clone());
                let start = full.starting_point(&p);
                (full, start)
            },
            &track,
        );
        agree(
            &format!("{scheme:?}, shooting"),
            || {
                let shooting = Shooting::new(&DoublePendulum, tracks, options.clone(), 6, None);
                let start = shooting.starting_point(&p);
                (shooting, start)
            },
            &track,
        );
    }
}

#[test]
fn an_active_inequality_holds_with_a_multiplier_of_the_right_sign_and_shifts_the_optimum() {
    let model = &DoublePendulum;
    let d = model.dims();
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    // Two inertias are free; their sum is asked to be above the true one.
    let (track, options, [i, j]) = double_pendulum(Scheme::GaussLegendre(
        pid_fit::transcribe::Stages::new(2).unwrap(),
    ));
    let sum = p[i] + p[j] + 0.01;
    let full = FullDiscretization::new(model, std::slice::from_ref(&track), options);
    let start = full.starting_point(&p);
    let first_p = full.layout().p();
    let rows = full.m();
    let function = Arc::new(Exact::new(Above(i, j, sum), 4, d.np));
    let constraint = Constraint {
        name: "sum".to_owned(),
        place: Place::Parameters,
        sense: Sense::AtMost,
        function,
    };
    let mut problem = Constrained::new(full, vec![constraint]).unwrap();
    let x0 = problem.extend(&start);
    let mut kkt = SparseKkt::new(&problem);
    let settings = solver::Settings {
        objective_scale: 61.0,
        ..solver::Settings::default()
    };
    let solution = ip::solve(&mut problem, &mut kkt, &x0, &settings, &mut |_, _| {
        ControlFlow::Continue(())
    });
    assert!(solution.status.converged(), "{:?}", solution.status);
    let check = check_point(&mut problem, &solution.x, &solution.lambda);
    assert!(
        check.primal_inf < 1e-7 && check.dual_inf < 1e-5,
        "{check:?}"
    );
    let found = solution.x[first_p + i] + solution.x[first_p + j];
    assert!((found - sum).abs() < 1e-6, "active: {found} for {sum}");
    assert!(solution.lambda[rows] > 0.0, "the constraint pushes");
}
