//! Optimal excitation: derivatives of its program, and the information of its motions.

use std::ops::ControlFlow;

use nalgebra::DMatrix;
use pid_fit::excite::{Criterion, ExciteError, Limits, Settings, Workspace, excite, program};
use pid_interpret::Kinematics;
use pid_interpret::kinematics::Point;
use pid_models::{Arm6, TwoLink};
use pid_nlp::Nlp;
use pid_runtime::dynamics::{At, Hessian};
use pid_runtime::kinematics::ForwardKinematics;

fn nominal(model: &dyn Hessian) -> Vec<f64> {
    model.params().iter().map(|p| p.nominal).collect()
}

fn limits(nq: usize, v: f64, a: f64, force: f64) -> Limits<'static> {
    Limits {
        q: vec![Some((-1.5, 1.5)); nq],
        v: vec![v; nq],
        a: vec![a; nq],
        force: vec![force; nq],
        workspace: None,
    }
}

/// Where points of a declared model are.
fn points(model: &dyn Hessian, points: &[(&str, [f64; 3])]) -> Kinematics {
    let point = |(link, at): &(&str, [f64; 3])| Point {
        link: (*link).to_owned(),
        at: *at,
    };
    let points: Vec<Point> = points.iter().map(point).collect();
    Kinematics::of_declared(model, &points).expect("declared")
}

const ANYWHERE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

fn go(_: usize, _: &pid_nlp::solver::Iteration) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Gradient, Jacobian and Hessian against differences of the fourth order.
fn derivatives_agree(model: &dyn Hessian, criterion: Criterion, places: &Kinematics) {
    let nq = model.dims().nq;
    let settings = Settings {
        criterion,
        harmonics: 3,
        samples: 24,
        ..Settings::default()
    };
    let p = nominal(model);
    let limits = Limits {
        workspace: Some(Workspace {
            points: places,
            boxes: vec![
                [(-0.5, 0.8), ANYWHERE, (0.1, f64::INFINITY)],
                [(f64::NEG_INFINITY, 0.7), (-0.4, 0.4), ANYWHERE],
            ],
        }),
        ..limits(nq, 2.0, 6.0, 400.0)
    };
    let mut program = program(model, &p, &limits, &settings).expect("sound");
    let (n, m) = (program.n(), program.m());
    let x: Vec<f64> = (0..n).map(|k| (1.3 * k as f64 + 0.4).sin()).collect();
    let lambda: Vec<f64> = (0..m).map(|k| (0.7 * k as f64).cos()).collect();
    let mut values = vec![0.0; program.hessian_pattern().nnz()];
    program.hessian(&x, 0.8, &lambda, &mut values);
    let mut hessian = DMatrix::<f64>::zeros(n, n);
    for ((r, c), v) in program
        .hessian_pattern()
        .rows
        .clone()
        .iter()
        .zip(&program.hessian_pattern().cols.clone())
        .zip(&values)
    {
        hessian[(*r as usize, *c as usize)] = *v;
        hessian[(*c as usize, *r as usize)] = *v;
    }
    let lagrangian = |program: &mut dyn Nlp, x: &[f64]| {
        let mut g = vec![0.0; n];
        program.gradient(x, &mut g);
        g.iter_mut().for_each(|g| *g *= 0.8);
        let mut j = vec![0.0; program.jacobian_pattern().nnz()];
        program.jacobian(x, &mut j);
        program
            .jacobian_pattern()
            .transpose_multiply_add(&j, &lambda, &mut g);
        g
    };
    let value = |program: &mut dyn Nlp, x: &[f64]| {
        let mut c = vec![0.0; m];
        program.constraints(x, &mut c);
        0.8 * program.objective(x) + c.iter().zip(&lambda).map(|(c, l)| c * l).sum::<f64>()
    };
    let here = lagrangian(&mut program, &x);
    let size = here.iter().fold(0.0_f64, |a, g| a.max(g.abs()));
    let h = 1e-5;
    for k in 0..n {
        let shifted = |s: f64| {
            let mut x = x.clone();
            x[k] += s;
            x
        };
        let mut central = |h: f64| {
            (value(&mut program, &shifted(h)) - value(&mut program, &shifted(-h))) / (2.0 * h)
        };
        let difference = (4.0 * central(h) - central(2.0 * h)) / 3.0;
        assert!(
            (difference - here[k]).abs() < 1e-7 * size.max(1.0),
            "{criterion:?}, gradient {k}: {} {difference}",
            here[k]
        );
        let mut at = |s: f64| lagrangian(&mut program, &shifted(s));
        let points = [at(h), at(-h), at(2.0 * h), at(-2.0 * h)];
        let scale = hessian.amax();
        for r in 0..n {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| points[i][r]);
            let difference = (8.0 * (a - b) - (c - d)) / (12.0 * h);
            assert!(
                (difference - hessian[(r, k)]).abs() < 2e-7 * scale,
                "{criterion:?}, Hessian ({r}, {k}): {} {difference}",
                hessian[(r, k)]
            );
        }
    }
}

#[test]
fn derivatives_agree_with_differences() {
    let two = points(
        &TwoLink,
        &[("upper", [0.2, 0.0, 0.1]), ("fore", [0.0, 0.0, 0.5])],
    );
    for criterion in [Criterion::Determinant, Criterion::SmallestEigenvalue] {
        derivatives_agree(&TwoLink, criterion, &two);
    }
    let six = points(&Arm6, &[("l3", [0.0, 0.0, 0.5]), ("l6", [0.0; 3])]);
    derivatives_agree(&Arm6, Criterion::Determinant, &six);
}

/// The tip of the second link is at `l (sin q₂ cos q₁, sin q₂ sin q₁, cos q₂)`.
#[test]
fn points_stay_in_their_boxes() {
    let model: &dyn Hessian = &TwoLink;
    let p = nominal(model);
    let tip = points(model, &[("fore", [0.0, 0.0, 0.5])]);
    let free = limits(2, 2.0, 8.0, 60.0);
    let boxed = |boxes: [(f64, f64); 3]| Limits {
        workspace: Some(Workspace {
            points: &tip,
            boxes: vec![boxes],
        }),
        ..free.clone()
    };
    let settings = Settings {
        starts: 2,
        ..Settings::default()
    };
    let limited = boxed([(-0.1, f64::INFINITY), (-0.15, 0.2), ANYWHERE]);
    let reach = |limits: &Limits<'_>| {
        let found = excite(model, &p, limits, &settings, &mut go).expect("sound");
        assert!(found.largest_use <= 1.0, "{}", found.largest_use);
        let (mut q, mut v, mut a) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let mut ends = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for i in 0..1000 {
            found.motion.at(0.01 * f64::from(i), &mut q, &mut v, &mut a);
            let radius = 0.5 * q[1].sin();
            let (x, y) = (radius * q[0].cos(), radius * q[0].sin());
            ends = [ends[0].min(x), ends[1].min(y), ends[2].max(y)];
        }
        (ends, found.information.value)
    };
    let (anywhere, more) = reach(&free);
    let (within, less) = reach(&limited);
    assert!(
        anywhere[0] < -0.1 && anywhere[1] < -0.15 && anywhere[2] > 0.2,
        "{anywhere:?}"
    );
    assert!(
        within[0] >= -0.1 && within[1] >= -0.15 && within[2] <= 0.2,
        "{within:?}"
    );
    // A forbidden region costs information, and the motion touches its wall.
    assert!(less > more, "{less} {more}");
    assert!(within[1] < -0.14, "{within:?}");
    assert_eq!(tip.points(), ["fore"]);

    let far = excite(
        model,
        &p,
        &boxed([(0.6, 0.9), ANYWHERE, ANYWHERE]),
        &settings,
        &mut go,
    );
    let far = far.expect_err("out of reach").to_string();
    assert!(
        far.contains("in the best one `fore` is at x = 0.")
            && far.contains("its range is 0.6 to 0.9"),
        "{far}"
    );
    let empty = excite(
        model,
        &p,
        &boxed([(0.2, 0.1), ANYWHERE, ANYWHERE]),
        &settings,
        &mut go,
    );
    assert_eq!(
        empty.expect_err("empty").to_string(),
        "point `fore`: the range of x is from 0.2 to 0.1\n  help: give the lower end first"
    );
}

#[test]
fn an_optimal_motion_tells_more_than_random_ones_within_the_same_limits() {
    let model: &dyn Hessian = &TwoLink;
    let limits = limits(2, 2.0, 8.0, 60.0);
    let p = nominal(model);
    for criterion in [Criterion::Determinant, Criterion::SmallestEigenvalue] {
        let settings = Settings {
            criterion,
            starts: 2,
            ..Settings::default()
        };
        let found = excite(model, &p, &limits, &settings, &mut go).expect("sound");
        assert!(found.status.converged(), "{:?}", found.status);
        assert!(found.largest_use <= 1.0, "{}", found.largest_use);
        for random in &found.random {
            assert!(
                found.information.value < random.value - 0.1,
                "{:?}\n{random:?}",
                found.information
            );
        }
        // The motion begins at rest, and its figures hold for a regressor assembled here from the
        // model's Jacobian.
        let (mut q, mut v, mut a) = (vec![0.0; 2], vec![0.0; 2], vec![0.0; 2]);
        found.motion.at(0.0, &mut q, &mut v, &mut a);
        assert!(v.iter().chain(&a).all(|x| x.abs() < 1e-6), "{v:?} {a:?}");
        let nb = found.params.len();
        let mut information = DMatrix::<f64>::zeros(nb, nb);
        let pattern = model.jacobian_pattern();
        let (mut r, mut values) = (vec![0.0; 2], vec![0.0; pattern.nnz()]);
        for i in 0..settings.samples {
            let t = settings.period * i as f64 / settings.samples as f64;
            found.motion.at(t, &mut q, &mut v, &mut a);
            let u = vec![0.0; model.dims().nu];
            let at = At {
                q: &q,
                v: &v,
                a: &a,
                u: &u,
                p: &p,
            };
            model.residual_jacobian(&at, &mut r, &mut values);
            let mut y = DMatrix::<f64>::zeros(2, nb);
            for ((row, col), value) in pattern.rows.iter().zip(pattern.cols).zip(&values) {
                let place = found
                    .params
                    .iter()
                    .position(|k| k + model.dims().p() == *col as usize);
                if let Some(k) = place {
                    y[(*row as usize, k)] = *value;
                }
            }
            information += y.transpose() * y;
        }
        let covariance = information.try_inverse().expect("regular");
        for (k, deviation) in found.information.deviations.iter().enumerate() {
            let expected = covariance[(k, k)].sqrt();
            assert!(
                (deviation - expected).abs() < 1e-6 * expected,
                "{deviation} {expected}"
            );
        }
    }
}

#[test]
fn wrong_limits_are_named() {
    let model: &dyn Hessian = &TwoLink;
    let p = nominal(model);
    let sound = limits(2, 2.0, 8.0, 60.0);
    let said = |limits: &Limits<'_>, settings: &Settings| -> String {
        excite(model, &p, limits, settings, &mut go)
            .expect_err("wrong")
            .to_string()
    };
    let mut bad = sound.clone();
    bad.v[1] = -1.0;
    assert_eq!(
        said(&bad, &Settings::default()),
        "joint `elbow`: limit of the velocity is -1\n  help: give a positive number"
    );
    bad = sound.clone();
    bad.q[0] = Some((1.0, -1.0));
    assert!(said(&bad, &Settings::default()).contains("joint `shoulder`: limit of the range"));
    bad = sound.clone();
    bad.a.pop();
    assert!(said(&bad, &Settings::default()).contains("limits of accelerations for 1 joints"));
    let few = Settings {
        samples: 10,
        ..Settings::default()
    };
    assert!(said(&sound, &few).contains("the number of samples is 10"));
    bad = sound.clone();
    bad.force = vec![1e-3; 2];
    let weak = excite(model, &p, &bad, &Settings::default(), &mut go).expect_err("weak");
    assert!(matches!(weak, ExciteError::TooWeak { .. }), "{weak}");
}
