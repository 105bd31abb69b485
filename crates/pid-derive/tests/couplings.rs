//! Joints that follow others or are held, drives that move several joints, extra potentials, bare
//! Lagrangians: against the free robot projected onto the motions that remain, and against
//! equations written by hand.

mod robots;

use pid_derive::model::{Affine, Emit, Expr, Func, JointKind, Motor, Robot};
use pid_derive::sample;
use pid_symbolic::random::Random;
use pid_symbolic::{Graph, Id, Tape};
use robots::{add, call, mul, num, sub};

/// r at the point `z = (q, v, a, u, p)`.
fn residual(robot: &Robot, z: &[f64]) -> Vec<f64> {
    evaluated(robot, z, |equations| equations.residual.clone())
}

fn evaluated(
    robot: &Robot,
    z: &[f64],
    what: impl Fn(&pid_derive::Equations) -> Vec<Id>,
) -> Vec<f64> {
    let mut g = Graph::new();
    let equations = pid_derive::equations(&mut g, robot).expect("both derivations agree");
    let outputs = what(&equations);
    let mut out = vec![0.0; outputs.len()];
    let mut at = z.to_vec();
    at.resize(z.len() + robot.nq(), 0.0);
    Tape::new(&g, &outputs).eval(&at, &mut out);
    out
}

fn assert_close(found: &[f64], expected: &[f64], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(1e-300_f64, |m, x| m.max(x.abs()));
    for (k, (x, y)) in found.iter().zip(expected).enumerate() {
        assert!(
            (x - y).abs() <= 1e-12 * scale,
            "{what}, row {k}: {x:e} for {y:e}"
        );
    }
}

/// Renumbers the coordinates of an expression; those without a new number become `held`.
fn renumbered(e: &Expr, map: &impl Fn(usize) -> (Expr, Expr)) -> Expr {
    let go = |x: &Expr| Box::new(renumbered(x, map));
    match e {
        Expr::Position(k) => map(*k).0,
        Expr::Velocity(k) => map(*k).1,
        Expr::Neg(x) => Expr::Neg(go(x)),
        Expr::Add(x, y) => Expr::Add(go(x), go(y)),
        Expr::Sub(x, y) => Expr::Sub(go(x), go(y)),
        Expr::Mul(x, y) => Expr::Mul(go(x), go(y)),
        Expr::Div(x, y) => Expr::Div(go(x), go(y)),
        Expr::Powi(x, n) => Expr::Powi(go(x), *n),
        Expr::Call(f, x) => Expr::Call(*f, go(x)),
        leaf => leaf.clone(),
    }
}

/// The four-joint arm in which the third joint is −(q2 + q1/2) + 0.3 and the last one is held at
/// `held`: coordinates 0, 1.
fn reduced(held: f64) -> (Robot, Robot) {
    let free = robots::arm(4);
    let mut robot = free.clone();
    let third = Affine {
        terms: vec![(0, num(-0.5)), (1, num(-1.0))],
        offset: num(0.3),
    };
    let map = |k: usize| match k {
        0 | 1 => (Expr::Position(k), Expr::Velocity(k)),
        2 => {
            let on = |x: fn(usize) -> Expr| sub(mul(num(-0.5), x(0)), x(1));
            (add(on(Expr::Position), num(0.3)), on(Expr::Velocity))
        }
        _ => (num(held), num(0.0)),
    };
    for (k, joint) in robot.joints.iter_mut().take(4).enumerate() {
        joint.coord = (k < 2).then_some(k);
        joint.force = joint.force.as_ref().map(|f| renumbered(f, &map));
    }
    robot.joints[2].follows = Some(third);
    robot.joints[3].follows = Some(Affine {
        terms: Vec::new(),
        offset: num(held),
    });
    (free, robot)
}

#[test]
fn followers_and_held_joints_are_the_free_robot_on_the_remaining_motions() {
    let held = 0.7;
    let (free, robot) = reduced(held);
    // Rows of C: q_free = C q + c.
    let c = [[1.0, 0.0], [0.0, 1.0], [-0.5, -1.0], [0.0, 0.0]];
    let mut random = Random::new(11);
    for _ in 0..10 {
        let z = sample::point(&robot, &mut random);
        let (motion, rest) = z[..z.len() - 2].split_at(6);
        let widen = |x: &[f64], offset: [f64; 4]| -> Vec<f64> {
            (0..4)
                .map(|j| c[j][0] * x[0] + c[j][1] * x[1] + offset[j])
                .collect()
        };
        let mut wide = widen(&motion[..2], [0.0, 0.0, 0.3, held]);
        wide.extend(widen(&motion[2..4], [0.0; 4]));
        wide.extend(widen(&motion[4..], [0.0; 4]));
        wide.extend(rest);
        let r = residual(&free, &wide);
        let projected: Vec<f64> = (0..2)
            .map(|k| (0..4).map(|j| c[j][k] * r[j]).sum())
            .collect();
        assert_close(
            &residual(&robot, &z[..z.len() - 2]),
            &projected,
            "projected",
        );
    }
}

#[test]
fn a_coupled_drive_moves_both_of_its_joints_with_equal_power() {
    let plain = robots::arm(2);
    let mut coupled = plain.clone();
    let friction = |w: Expr| mul(num(-3.0), call(Func::Tanh, mul(num(20.0), w)));
    coupled.motors.push(Motor {
        name: "m".into(),
        docs: Vec::new(),
        moves: Affine {
            terms: vec![(0, num(0.4)), (1, num(-1.5))],
            offset: num(0.0),
        },
        armature: Some(num(0.25)),
        force: Some(friction(sub(
            mul(num(0.4), Expr::Velocity(0)),
            mul(num(1.5), Expr::Velocity(1)),
        ))),
    });
    let mut random = Random::new(5);
    for _ in 0..10 {
        let z = sample::point(&plain, &mut random);
        let z = &z[..z.len() - 2];
        let (w, dw) = (0.4 * z[2] - 1.5 * z[3], 0.4 * z[4] - 1.5 * z[5]);
        let felt = 0.25 * dw + 3.0 * (20.0 * w).tanh();
        let mut expected = residual(&plain, z);
        expected[0] += 0.4 * felt;
        expected[1] -= 1.5 * felt;
        assert_close(&residual(&coupled, z), &expected, "r");
        let m = evaluated(&coupled, z, |e| e.mass_matrix.clone());
        let m0 = evaluated(&plain, z, |e| e.mass_matrix.clone());
        let added = [0.25 * 0.16, -0.25 * 0.6, 0.25 * 2.25];
        let expected: Vec<f64> = m0.iter().zip(added).map(|(m, d)| m + d).collect();
        assert_close(&m, &expected, "M");
    }
}

#[test]
fn an_extra_potential_adds_its_slope_and_its_energy() {
    let plain = robots::arm(3);
    let mut sprung = plain.clone();
    // 20 (q1 − 0.3)² + 5 q1 q2.
    let twist = sub(Expr::Position(1), num(0.3));
    sprung.potential = Some(add(
        mul(num(20.0), Expr::Powi(Box::new(twist), 2)),
        mul(num(5.0), mul(Expr::Position(1), Expr::Position(2))),
    ));
    let mut random = Random::new(9);
    let z = sample::point(&plain, &mut random);
    let z = &z[..z.len() - 3];
    let mut expected = residual(&plain, z);
    expected[1] += 40.0 * (z[1] - 0.3) + 5.0 * z[2];
    expected[2] += 5.0 * z[1];
    assert_close(&residual(&sprung, z), &expected, "r");
    let energy = |robot: &Robot| evaluated(robot, z, |e| vec![e.energies.potential])[0];
    let added = 20.0 * (z[1] - 0.3).powi(2) + 5.0 * z[1] * z[2];
    assert_close(&[energy(&sprung) - energy(&plain)], &[added], "U");
}

/// A pole of mass 0.3 at length 0.6 on a cart of mass 1.2, with a term 0.8 x v_θ that does no work
/// but for its slope.
fn cart_pole() -> Robot {
    let mut b = robots::Builder::new("CartPole");
    for (name, kind) in [("x", JointKind::Length), ("th", JointKind::Angle)] {
        b.joint(name, kind, None, 0);
    }
    let mut robot = b.robot();
    robot.order.clear();
    robot.emit = Emit {
        first_derivatives: true,
        second_derivatives: true,
        ..Emit::default()
    };
    let (v, w, th) = (Expr::Velocity(0), Expr::Velocity(1), Expr::Position(1));
    let square = |x: &Expr| Expr::Powi(Box::new(x.clone()), 2);
    let terms = [
        mul(num(0.75), square(&v)),
        mul(num(0.5 * 0.3 * 0.36), square(&w)),
        mul(
            num(0.18),
            mul(mul(v.clone(), w.clone()), call(Func::Cos, th.clone())),
        ),
        mul(num(-0.18 * 9.81), call(Func::Cos, th)),
        mul(num(0.8), mul(Expr::Position(0), w)),
    ];
    robot.lagrangian = terms.into_iter().reduce(add);
    robot
}

#[test]
fn a_bare_lagrangian_gives_the_equations_of_the_cart_pole() {
    let robot = cart_pole();
    let mut random = Random::new(21);
    for _ in 0..10 {
        let z = sample::point(&robot, &mut random);
        let [_, th, v, w, dv, dw] = z[..6].try_into().unwrap();
        let (s, c) = f64::sin_cos(th);
        let expected = [
            1.5 * dv + 0.18 * c * dw - 0.18 * s * w * w - 0.8 * w,
            0.18 * c * dv + 0.3 * 0.36 * dw - 0.18 * 9.81 * s + 0.8 * v,
        ];
        assert_close(&residual(&robot, &z[..6]), &expected, "r");
        let m = evaluated(&robot, &z[..6], |e| e.mass_matrix.clone());
        assert_close(&m, &[1.5, 0.18 * c, 0.3 * 0.36], "M");
        let energies = evaluated(&robot, &z[..6], |e| {
            vec![e.energies.kinetic, e.energies.potential]
        });
        let kinetic = 0.75 * v * v + 0.054 * w * w + 0.18 * v * w * c;
        assert_close(&energies, &[kinetic, 0.18 * 9.81 * c], "T and U");
    }
    assert_eq!(pid_derive::facts(&robot).velocity_in_mass, None);
    assert_eq!(pid_derive::facts(&robot).singular_mass, None);
}

#[test]
fn a_lagrangian_that_is_not_quadratic_in_the_velocities_is_noticed() {
    let mut robot = cart_pole();
    let quartic = Expr::Powi(Box::new(Expr::Velocity(1)), 4);
    robot.lagrangian = robot.lagrangian.map(|l| add(l, quartic));
    assert_eq!(pid_derive::facts(&robot).velocity_in_mass, Some(1));
}
