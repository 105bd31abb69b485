//! The links against closed forms written independently, and against the principle of virtual work.

use num_dual::Dual64;
use pid_withheld::linkage::{Linkage, Surroundings};
use pid_withheld::rigid::{Body, Hinge, add_point};

const EYE: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn hinge(revolute: bool, axis: [f64; 3], origin: [f64; 3]) -> Hinge {
    Hinge {
        parent: None,
        revolute,
        axis,
        origin,
        rotation: EYE,
    }
}

/// Hinges one on the other.
fn chain(mut hinges: Vec<Hinge>) -> Vec<Hinge> {
    for (k, hinge) in hinges.iter_mut().enumerate() {
        hinge.parent = k.checked_sub(1);
    }
    hinges
}

/// A point mass with inertia about its own y axis.
fn body(mass: f64, at: [f64; 3], about_y: f64) -> Body<f64> {
    let [x, y, z] = at;
    Body {
        mass,
        moment: at.map(|c| c * mass),
        inertia: [
            mass * (y * y + z * z),
            mass * (x * x + z * z) + about_y,
            mass * (x * x + y * y),
            -mass * x * y,
            -mass * x * z,
            -mass * y * z,
        ],
    }
}

fn evaluate(
    hinges: &[Hinge],
    bodies: &[Body<f64>],
    force: Option<[f64; 3]>,
    q: &[f64],
    v: &[f64],
) -> (Vec<f64>, Vec<f64>) {
    let n = hinges.len();
    let around = Surroundings {
        gravity: [0.0, 0.0, -9.81],
        tip_force: force,
    };
    let mut linkage = Linkage::new(hinges, bodies, [0.05, 0.02, -0.3]);
    let (mut m, mut b) = (vec![0.0; n * n], vec![0.0; n]);
    linkage.mass_and_bias(&around, (q, v), &mut m, &mut b);
    (m, b)
}

#[test]
fn a_planar_double_pendulum_has_its_textbook_equations() {
    let (l1, r1, r2, m1, m2, i1, i2, g) = (0.4, 0.17, 0.14, 6.0, 4.0, 0.088, 0.043, 9.81);
    let hinges = chain(vec![
        hinge(true, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
        hinge(true, [0.0, 1.0, 0.0], [0.0, 0.0, -l1]),
    ]);
    let bodies = [body(m1, [0.0, 0.0, -r1], i1), body(m2, [0.0, 0.0, -r2], i2)];
    for (q, v) in [
        ([0.3, -0.8], [1.2, -0.7]),
        ([-1.4, 2.1], [0.0, 3.0]),
        ([0.0, 0.0], [0.0, 0.0]),
    ] {
        let (m, b) = evaluate(&hinges, &bodies, None, &q, &v);
        // J. J. Craig, Introduction to Robotics, 2005, section 6.7, with distances to centres of mass.
        let (c, s) = (q[1].cos(), q[1].sin());
        let h = m2 * l1 * r2;
        let m22 = i2 + m2 * r2 * r2;
        let m12 = m22 + h * c;
        let m11 = i1 + m1 * r1 * r1 + m2 * l1 * l1 + m22 + 2.0 * h * c;
        let g2 = m2 * g * r2 * (q[0] + q[1]).sin();
        let expected_b = [
            -h * s * (2.0 * v[0] * v[1] + v[1] * v[1]) + (m1 * r1 + m2 * l1) * g * q[0].sin() + g2,
            h * s * v[0] * v[0] + g2,
        ];
        for (x, y) in m.iter().zip([m11, m12, m12, m22]) {
            assert!((x - y).abs() < 1e-13, "{m:?}");
        }
        for (x, y) in b.iter().zip(expected_b) {
            assert!((x - y).abs() < 1e-12, "{b:?} {expected_b:?}");
        }
    }
}

#[test]
fn a_slide_on_a_turning_arm_feels_centrifugal_and_coriolis_forces() {
    // Arm about z, mass on a slide along its x axis: M = diag(m x², m), b = (2 m x ẋ ω, −m x ω²).
    let hinges = chain(vec![
        hinge(true, [0.0, 0.0, 1.0], [0.0; 3]),
        hinge(false, [1.0, 0.0, 0.0], [0.0; 3]),
    ]);
    let bodies = [body(0.0, [0.0; 3], 0.0), body(2.0, [0.0; 3], 0.0)];
    let (x, w, dx) = (0.7, 1.3, -0.4);
    let (m, b) = evaluate(&hinges, &bodies, None, &[0.9, x], &[w, dx]);
    for (a, e) in m.iter().zip([2.0 * x * x, 0.0, 0.0, 2.0]) {
        assert!((a - e).abs() < 1e-13, "{m:?}");
    }
    assert!(
        (b[0] - 2.0 * 2.0 * x * dx * w).abs() < 1e-13 && (b[1] + 2.0 * x * w * w).abs() < 1e-13,
        "{b:?}"
    );
}

#[test]
fn the_mass_matrix_is_the_kinetic_energy_and_the_bias_keeps_it() {
    // Along the free motion q̈ = −M⁻¹ b the energy rate vᵀ(M q̈ + b) vanishes; with gravity off, vᵀ
    // b = −½ vᵀ Ṁ v... checked as d(½ vᵀ M v)/dt = 0 through duals in time.
    let tilted = [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]];
    let mut hinges = chain(vec![
        hinge(true, [0.0, 0.0, 1.0], [0.0, 0.1, 0.2]),
        hinge(true, [0.0, 1.0, 0.0], [0.03, 0.0, 0.2]),
        hinge(false, [1.0, 0.0, 0.0], [0.0, 0.0, 0.3]),
        hinge(true, [0.6, 0.0, 0.8], [0.1, 0.0, 0.06]),
    ]);
    hinges[1].rotation = tilted;
    hinges[3].rotation = tilted;
    let bodies: Vec<Body<f64>> = (0..4)
        .map(|i| {
            body(
                1.0 + 0.3 * f64::from(i),
                [0.05, -0.02 * f64::from(i), 0.1],
                0.03,
            )
        })
        .collect();
    let (q, v) = ([0.3, -0.5, 0.2, 0.9], [0.7, -1.1, 0.4, 1.6]);
    let n = 4;
    let run = |q: &[Dual64], v: &[Dual64]| {
        let lift = |x: f64| Dual64::from(x);
        let bodies: Vec<Body<Dual64>> = bodies
            .iter()
            .map(|b| Body {
                mass: lift(b.mass),
                moment: b.moment.map(lift),
                inertia: b.inertia.map(lift),
            })
            .collect();
        let around = Surroundings {
            gravity: [lift(0.0); 3],
            tip_force: None,
        };
        let (mut m, mut b) = (vec![lift(0.0); n * n], vec![lift(0.0); n]);
        Linkage::new(&hinges, &bodies, [0.0; 3]).mass_and_bias(&around, (q, v), &mut m, &mut b);
        (m, b)
    };
    let still: Vec<Dual64> = q.iter().map(|&x| Dual64::from(x)).collect();
    let rates: Vec<Dual64> = v.iter().map(|&x| Dual64::from(x)).collect();
    let (m, b) = run(&still, &rates);
    let matrix = nalgebra::DMatrix::from_fn(n, n, |i, j| m[i * n + j].re);
    assert!((&matrix - matrix.transpose()).amax() < 1e-14);
    let bias = nalgebra::DVector::from_fn(n, |i, _| b[i].re);
    let a = -matrix.cholesky().expect("positive definite").solve(&bias);
    let moving: Vec<Dual64> = q.iter().zip(v).map(|(&x, v)| Dual64::new(x, v)).collect();
    let changing: Vec<Dual64> = v
        .iter()
        .zip(a.iter())
        .map(|(&x, a)| Dual64::new(x, *a))
        .collect();
    let (m, _) = run(&moving, &changing);
    let mut energy = Dual64::from(0.0);
    for i in 0..n {
        for j in 0..n {
            energy += changing[i] * m[i * n + j] * changing[j] * 0.5;
        }
    }
    assert!(energy.eps.abs() < 1e-13 * energy.re, "{energy:?}");
}

#[test]
fn a_force_on_the_tool_does_virtual_work() {
    let hinges = chain(vec![
        hinge(true, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
        hinge(true, [1.0, 0.0, 0.0], [0.1, 0.0, -0.4]),
    ]);
    let bodies = [
        body(1.0, [0.0, 0.0, -0.1], 0.01),
        body(1.0, [0.0, 0.0, -0.1], 0.01),
    ];
    let (q, v, f) = ([0.4, -0.9], [0.0, 0.0], [3.0, -2.0, 1.0]);
    let (_, with) = evaluate(&hinges, &bodies, Some(f), &q, &v);
    let (_, without) = evaluate(&hinges, &bodies, None, &q, &v);
    let tool = |q: [f64; 2]| {
        let t = nalgebra::Vector3::new(0.05, 0.02, -0.3);
        let r1 = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), q[0]);
        let r2 = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::x_axis(), q[1]);
        nalgebra::Vector3::new(0.0, 0.0, 1.0)
            + r1 * (nalgebra::Vector3::new(0.1, 0.0, -0.4) + r2 * t)
    };
    for j in 0..2 {
        let (mut up, mut down) = (q, q);
        up[j] += 1e-6;
        down[j] -= 1e-6;
        let work = nalgebra::Vector3::from(f).dot(&((tool(up) - tool(down)) / 2e-6));
        assert!((without[j] - with[j] - work).abs() < 1e-8, "joint {j}");
    }
}

/// Points of every link in base axes.
fn places(hinges: &[Hinge], points: &[[f64; 3]], q: &[f64]) -> Vec<nalgebra::Vector3<f64>> {
    use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
    let mut frames: Vec<(Matrix3<f64>, Vector3<f64>)> = Vec::new();
    let mut out = Vec::new();
    for (h, q) in hinges.iter().zip(q) {
        let (mut turn, mut at) = h
            .parent
            .map_or((Matrix3::identity(), Vector3::zeros()), |p| frames[p]);
        at += turn * Vector3::from(h.origin);
        turn *= Matrix3::from_fn(|i, j| h.rotation[i][j]);
        let axis = Vector3::from(h.axis);
        if h.revolute {
            turn *= Rotation3::from_axis_angle(&Unit::new_normalize(axis), *q).into_inner();
        } else {
            at += turn * axis * *q;
        }
        out.extend(points.iter().map(|p| at + turn * Vector3::from(*p)));
        frames.push((turn, at));
    }
    out
}

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const DOWN: [f64; 3] = [0.0, 0.0, -1.0];
const SLANTED: [f64; 3] = [0.0, -0.6, 0.8];

/// Robots: parent, revolute or not, axis and rotation of each hinge (0: none, 1: about z, 2: about y).
type Kind = (Option<usize>, bool, [f64; 3], usize);
const ROBOTS: [&[Kind]; 12] = [
    &[(None, true, Y, 0)],
    &[(None, false, X, 1)],
    &[
        (None, true, Y, 0),
        (Some(0), true, Y, 2),
        (Some(1), true, [0.0, -1.0, 0.0], 0),
    ],
    &[
        (None, false, X, 0),
        (Some(0), true, Y, 0),
        (Some(1), true, Y, 0),
    ],
    &[
        (None, true, Z, 0),
        (Some(0), false, Z, 0),
        (Some(1), true, Z, 0),
        (Some(2), false, DOWN, 0),
    ],
    &[(None, true, Z, 0), (Some(0), false, DOWN, 2)],
    &[
        (None, true, Z, 0),
        (Some(0), false, X, 0),
        (Some(1), false, Y, 1),
    ],
    &[
        (None, false, Y, 0),
        (Some(0), false, Z, 1),
        (Some(1), true, X, 0),
        (Some(2), true, DOWN, 0),
        (Some(3), true, Z, 0),
    ],
    &[
        (None, true, Z, 0),
        (Some(0), true, Y, 0),
        (Some(1), true, Y, 0),
        (Some(2), true, X, 1),
        (Some(3), true, SLANTED, 2),
        (Some(4), true, SLANTED, 0),
    ],
    // Two arms on one link.
    &[
        (None, true, Y, 0),
        (Some(0), true, Y, 0),
        (Some(0), true, Y, 2),
    ],
    // Two robots on one base.
    &[
        (None, true, Y, 0),
        (Some(0), true, X, 0),
        (None, false, Z, 1),
        (Some(2), true, Y, 0),
    ],
    // A trunk with two arms, one of which branches again.
    &[
        (None, true, Z, 0),
        (Some(0), true, X, 0),
        (Some(1), false, SLANTED, 2),
        (Some(0), true, Y, 1),
        (Some(3), true, Y, 0),
        (Some(3), true, Z, 0),
    ],
];

#[test]
fn trees_of_point_masses_obey_newton_whatever_their_axes() {
    let (c, s) = (0.7_f64.cos(), 0.7_f64.sin());
    let turns = [
        EYE,
        [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]],
        [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
    ];
    let points = [
        [0.1, 0.0, 0.2],
        [-0.2, 0.1, 0.0],
        [0.0, -0.1, 0.1],
        [0.05, 0.2, -0.1],
    ];
    let masses = [0.7, 0.4, 1.1, 0.6];
    for (number, kinds) in ROBOTS.iter().enumerate() {
        let n = kinds.len();
        let hinges: Vec<Hinge> = kinds
            .iter()
            .enumerate()
            .map(|(k, &(parent, revolute, axis, turn))| Hinge {
                parent,
                revolute,
                axis,
                origin: [0.1 - 0.05 * k as f64, 0.02 * k as f64, 0.3],
                rotation: turns[turn],
            })
            .collect();
        let mut body = Body {
            mass: 0.0,
            moment: [0.0; 3],
            inertia: [0.0; 6],
        };
        for (p, m) in points.iter().zip(masses) {
            add_point(&mut body, m, *p);
        }
        let q: Vec<f64> = (0..n).map(|k| 0.4 - 0.3 * k as f64).collect();
        let v: Vec<f64> = (0..n).map(|k| 1.3 - 0.8 * k as f64).collect();
        let push = nalgebra::Vector3::new(3.0, -2.0, 1.0);
        let (m, b) = evaluate(&hinges, &vec![body; n], Some(push.into()), &q, &v);
        // The tool is a point without mass of the last link.
        let mut all = points.to_vec();
        all.push([0.05, 0.02, -0.3]);
        let moved = |along: &[f64], h: f64| {
            let q: Vec<f64> = q.iter().zip(along).map(|(q, d)| q + h * d).collect();
            places(&hinges, &all, &q)
        };
        let slopes: Vec<Vec<nalgebra::Vector3<f64>>> = (0..n)
            .map(|j| {
                let unit: Vec<f64> = (0..n).map(|k| f64::from(u8::from(k == j))).collect();
                let (up, down) = (moved(&unit, 1e-5), moved(&unit, -1e-5));
                up.iter().zip(&down).map(|(a, b)| (a - b) / 2e-5).collect()
            })
            .collect();
        let (up, here, down) = (moved(&v, 1e-4), moved(&v, 0.0), moved(&v, -1e-4));
        let gravity = nalgebra::Vector3::new(0.0, 0.0, -9.81);
        for i in 0..n {
            let mut expected = -slopes[i][here.len() - 1].dot(&push);
            let mut row = vec![0.0; n];
            for p in 0..here.len() {
                let Some(mass) = masses.get(p % all.len()) else {
                    continue;
                };
                let acceleration = (up[p] - here[p] * 2.0 + down[p]) / 1e-8;
                expected += mass * slopes[i][p].dot(&(acceleration - gravity));
                for (x, slope) in row.iter_mut().zip(&slopes) {
                    *x += mass * slopes[i][p].dot(&slope[p]);
                }
            }
            assert!(
                (b[i] - expected).abs() < 1e-5,
                "robot {number}, joint {i}: {} {expected}",
                b[i]
            );
            for (j, x) in row.iter().enumerate() {
                assert!(
                    (m[i * n + j] - x).abs() < 1e-8,
                    "robot {number}: M[{i}][{j}] {} {x}",
                    m[i * n + j]
                );
            }
        }
    }
}
