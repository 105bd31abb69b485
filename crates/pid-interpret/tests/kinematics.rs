//! Positions of points, against geometry written by hand, against the dynamics of a mass at the
//! point, and against differences.

use pid_interpret::Kinematics;
use pid_interpret::kinematics::{KinematicsError, Point};
use pid_models::{Arm6, TwoLink};
use pid_runtime::dynamics::{At, Dynamics};
use pid_runtime::kinematics::ForwardKinematics;

fn nominal(model: &dyn Dynamics) -> Vec<f64> {
    model.params().iter().map(|p| p.nominal).collect()
}

fn point(link: &str, at: [f64; 3]) -> Point {
    Point {
        link: link.to_owned(),
        at,
    }
}

#[test]
fn a_pan_and_tilt_points_where_it_looks() {
    let points = [
        point("upper", [0.1, 0.0, 0.2]),
        point("fore", [0.0, 0.0, 0.5]),
        point("fore", [0.0, 0.3, 0.0]),
    ];
    let found = Kinematics::of_declared(&TwoLink, &points).expect("declared");
    assert_eq!(found.points(), ["upper", "fore", "fore_2"]);
    let p = nominal(&TwoLink);
    for q in [[0.0, 0.0], [0.7, -1.1], [-2.4, 2.9]] {
        let mut x = [0.0; 9];
        found.positions(&q, &p, &mut x);
        let ((s, c), (ss, cc)) = (q[0].sin_cos(), q[1].sin_cos());
        let expected = [
            0.1 * c,
            0.1 * s,
            0.2,
            0.5 * ss * c,
            0.5 * ss * s,
            0.5 * cc,
            -0.3 * s,
            0.3 * c,
            0.0,
        ];
        for (x, expected) in x.iter().zip(expected) {
            assert!((x - expected).abs() < 1e-15, "{x} {expected}");
        }
    }
}

/// A mass at the point adds `g m z` to the potential energy and `m Jᵀ J` to the mass matrix.
#[test]
fn a_mass_at_the_point_is_felt_there() {
    const MASS: f64 = 1.7;
    let q = [0.4, -0.9, 1.3, 0.2, -1.1, 2.0];
    let model: &dyn Dynamics = &Arm6;
    let p = nominal(model);
    for link in 1..=6 {
        let c = [0.11, -0.23, 0.31];
        let found =
            Kinematics::of_declared(model, &[point(&format!("l{link}"), c)]).expect("found");
        let mut heavier = p.clone();
        let mut add = |name: &str, value: f64| {
            let name = format!("l{link}_{name}");
            let at = model.params().iter().position(|p| p.name == name);
            heavier[at.unwrap_or_else(|| panic!("{name}"))] += MASS * value;
        };
        let [x, y, z] = c;
        add("m", 1.0);
        for (name, value) in [("mx", x), ("my", y), ("mz", z)] {
            add(name, value);
        }
        for (name, value) in [
            ("ixx", y * y + z * z),
            ("iyy", x * x + z * z),
            ("izz", x * x + y * y),
            ("ixy", -x * y),
            ("ixz", -x * z),
            ("iyz", -y * z),
        ] {
            add(name, value);
        }
        let (mut place, mut slope) = ([0.0; 3], [0.0; 18]);
        found.jacobian(&q, &p, &mut place, &mut slope);
        let still = [0.0; 6];
        let at = |p| At {
            q: &q,
            v: &still,
            a: &still,
            u: &still,
            p,
        };
        let energy = model.potential_energy(&at(&heavier)) - model.potential_energy(&at(&p));
        assert!((energy - 9.81 * MASS * place[2]).abs() < 1e-10, "{link}");
        let (mut before, mut after) = ([0.0; 21], [0.0; 21]);
        model.mass_matrix(&at(&p), &mut before);
        model.mass_matrix(&at(&heavier), &mut after);
        let mut entry = 0;
        for row in 0..6 {
            for col in 0..=row {
                let product: f64 = (0..3)
                    .map(|k| slope[6 * k + row] * slope[6 * k + col])
                    .sum();
                let added = after[entry] - before[entry];
                assert!((added - MASS * product).abs() < 1e-11, "{link} {row} {col}");
                entry += 1;
            }
        }
    }
}

#[test]
fn derivatives_agree_with_differences() {
    let points = [point("l4", [0.1, 0.2, -0.1]), point("l6", [0.0, 0.05, 0.2])];
    let found = Kinematics::of_declared(&Arm6, &points).expect("found");
    let p = nominal(&Arm6);
    let q = [0.4, -0.9, 1.3, 0.2, -1.1, 2.0];
    let lambda = [0.3, -1.2, 0.8, 1.1, 0.4, -0.6];
    let jacobian = |q: &[f64]| {
        let (mut x, mut slope) = ([0.0; 6], [0.0; 36]);
        found.jacobian(q, &p, &mut x, &mut slope);
        (x, slope)
    };
    let (x, slope) = jacobian(&q);
    let mut alone = [0.0; 6];
    found.positions(&q, &p, &mut alone);
    assert_eq!(alone, x);
    let mut values = vec![0.0; found.hessian_places().len()];
    found.hessian(&q, &p, &lambda, &mut values);
    let mut hessian = [[0.0; 6]; 6];
    for (&(row, col), value) in found.hessian_places().iter().zip(&values) {
        assert!(row >= col);
        hessian[row][col] = *value;
        hessian[col][row] = *value;
    }
    let h = 1e-5;
    for k in 0..6 {
        let moved = |s: f64| {
            let mut q = q;
            q[k] += s;
            jacobian(&q)
        };
        let (ahead, behind) = (moved(h), moved(-h));
        for i in 0..6 {
            let difference = (ahead.0[i] - behind.0[i]) / (2.0 * h);
            assert!((difference - slope[6 * i + k]).abs() < 1e-9, "{i} {k}");
        }
        for (j, entry) in hessian[k].iter().enumerate() {
            let pull = |slope: &[f64; 36]| -> f64 {
                lambda
                    .iter()
                    .enumerate()
                    .map(|(i, l)| l * slope[6 * i + j])
                    .sum()
            };
            let difference = (pull(&ahead.1) - pull(&behind.1)) / (2.0 * h);
            assert!(
                (difference - entry).abs() < 1e-8,
                "{j} {k}: {entry} {difference}"
            );
        }
    }
}

#[test]
fn what_has_no_position_is_named() {
    let wrong = |link: &str, at: [f64; 3]| {
        Kinematics::of_declared(&TwoLink, &[point(link, at)]).expect_err("wrong")
    };
    assert_eq!(
        wrong("hand", [0.0; 3]).to_string(),
        "`TwoLink` has no link `hand`; it has `upper`, `fore`"
    );
    assert!(matches!(
        wrong("fore", [f64::INFINITY, 0.0, 0.0]),
        KinematicsError::Place { .. }
    ));
}
