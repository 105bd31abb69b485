//! The derived equations against closed forms, against each other, and their derivatives against num-dual.

mod robots;

use num_dual::{Dual64, HyperDual64};
use pid_derive::kinematics::Tree;
use pid_derive::model::Robot;
use pid_derive::{self, Blanks, Derivatives, Equations, Symbols, equations::Derivations, sample};
use pid_symbolic::random::Random;
use pid_symbolic::{Graph, Id, Tape};

struct Derived {
    g: Graph,
    equations: Equations,
    derivatives: Derivatives,
}

fn derived(robot: &Robot) -> Derived {
    let mut g = Graph::new();
    let equations = pid_derive::equations(&mut g, robot).expect("both derivations agree");
    let derivatives = pid_derive::derivatives(&mut g, &equations, robot.emit);
    Derived {
        g,
        equations,
        derivatives,
    }
}

fn values(g: &Graph, outputs: &[Id], at: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; outputs.len()];
    Tape::new(g, outputs).eval(at, &mut out);
    out
}

fn largest(values: &[f64]) -> f64 {
    values
        .iter()
        .fold(0.0_f64, |largest, value| largest.max(value.abs()))
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = largest(expected);
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(
            (found - expected).abs() <= tolerance * scale,
            "{what}, entry {k}: {found:e} for {expected:e}, scale {scale:e}"
        );
    }
}

/// Written out by hand, see the module documentation of `robots::two_link`.
fn two_link_residual(z: &[f64]) -> [f64; 2] {
    let [_, q2, v1, v2, a1, a2, u1, u2] = z[..8].try_into().unwrap();
    let [
        m1,
        m2,
        sx1,
        sy1,
        sx2,
        sy2,
        sz2,
        iz1,
        ix2,
        iy2,
        iz2,
        dry1,
        dry2,
        vis1,
        vis2,
        gain1,
        gain2,
        sharp1,
        sharp2,
    ]: [f64; 19] = z[8..27].try_into().unwrap();
    let (s, c) = q2.sin_cos();
    let (r, h) = (c * sx2 + s * sz2, c * sz2 - s * sx2);
    let m11 =
        iz1 + m1 * (sx1 * sx1 + sy1 * sy1) + ix2 * s * s + iz2 * c * c + m2 * (r * r + sy2 * sy2);
    let m12 = -m2 * sy2 * h;
    let m22 = iy2 + m2 * (sx2 * sx2 + sz2 * sz2);
    let d = 2.0 * s * c * (ix2 - iz2) + 2.0 * m2 * r * h;
    let f1 = gain1 * u1 - dry1 * (sharp1 * v1).tanh() - vis1 * v1;
    let f2 = gain2 * u2 - dry2 * (sharp2 * v2).tanh() - vis2 * v2;
    [
        m11 * a1 + m12 * a2 + d * v1 * v2 + m2 * sy2 * r * v2 * v2 - f1,
        m12 * a1 + m22 * a2 - 0.5 * d * v1 * v1 - m2 * 9.81 * r - f2,
    ]
}

#[test]
fn two_link_equals_its_closed_form() {
    let robot = robots::two_link();
    let Derived { g, equations, .. } = derived(&robot);
    let mut random = Random::new(3);
    for _ in 0..20 {
        let at = sample::point(&robot, &mut random);
        assert_close(
            &values(&g, &equations.residual, &at),
            &two_link_residual(&at),
            1e-13,
            "r",
        );
    }
}

#[test]
fn carriage_on_a_slanted_rail() {
    let robot = robots::carriage();
    let Derived { g, equations, .. } = derived(&robot);
    let at = [0.7, 0.4, 1.5, 30.0, 95.0, 200.0];
    let expected = 95.0 * (1.5 + 9.81 * 0.3_f64.sin()) + 200.0 * 0.4 - 30.0;
    assert_close(
        &values(&g, &equations.residual, &at),
        &[expected],
        1e-14,
        "r",
    );
    let energies = values(
        &g,
        &[equations.energies.kinetic, equations.energies.potential],
        &at,
    );
    // The centre of mass is 0.1 along, 0.3 across the rail.
    let height = (0.7 + 0.1) * 0.3_f64.sin() + 0.3 * 0.3_f64.cos();
    assert_close(
        &energies,
        &[0.5 * 95.0 * 0.16, 95.0 * 9.81 * height],
        1e-14,
        "T, U",
    );
}

#[test]
fn lagrange_and_newton_euler_agree() {
    for robot in [
        robots::two_link(),
        robots::carriage(),
        robots::tree(),
        robots::arm(3),
        robots::arm(7),
    ] {
        let mut g = Graph::new();
        let symbols = Symbols::new(&mut g, &robot, Blanks::Zero);
        let tree = Tree::new(&mut g, &robot, &symbols);
        let both = Derivations::new(&mut g, &robot, &tree, &symbols);
        let mut random = Random::new(11);
        for _ in 0..10 {
            let at = sample::point(&robot, &mut random);
            let (lagrange, newton_euler) = (
                values(&g, &both.lagrange, &at),
                values(&g, both.newton_euler.as_ref().expect("bodies"), &at),
            );
            assert_close(&lagrange, &newton_euler, 1e-12, &robot.name);
        }
    }
}

/// dE/dt = vᵀ (M a + b) along any motion: T and U against r, by central differences over a short time.
#[test]
fn power_balance() {
    for robot in [robots::two_link(), robots::tree(), robots::arm(3)] {
        let Derived { g, equations, .. } = derived(&robot);
        let nq = robot.nq();
        let mut random = Random::new(5);
        let at = sample::point(&robot, &mut random);
        let energy = |time: f64| {
            let mut moved = at.clone();
            for k in 0..nq {
                let (v, a) = (at[nq + k], at[2 * nq + k]);
                moved[k] += v * time + 0.5 * a * time * time;
                moved[nq + k] += a * time;
            }
            values(
                &g,
                &[equations.energies.kinetic, equations.energies.potential],
                &moved,
            )
            .iter()
            .sum::<f64>()
        };
        let h = 1e-5;
        let rate = (energy(h) - energy(-h)) / (2.0 * h);
        let (r, f) = (
            values(&g, &equations.residual, &at),
            values(&g, &equations.applied_force, &at),
        );
        let power: f64 = (0..nq).map(|k| at[nq + k] * (r[k] + f[k])).sum();
        assert!(
            (rate - power).abs() < 1e-7 * power.abs().max(1.0),
            "{}: {rate} for {power}",
            robot.name
        );
    }
}

#[test]
fn mass_matrix_bias_and_force_add_up_to_the_residual() {
    for robot in [
        robots::two_link(),
        robots::tree(),
        robots::arm(3),
        robots::arm(6),
    ] {
        let Derived { g, equations, .. } = derived(&robot);
        let nq = robot.nq();
        let mut random = Random::new(6);
        let at = sample::point(&robot, &mut random);
        let m = values(&g, &equations.mass_matrix, &at);
        let (b, f) = (
            values(&g, &equations.bias, &at),
            values(&g, &equations.applied_force, &at),
        );
        let sum: Vec<f64> = (0..nq)
            .map(|i| {
                let inertia: f64 = (0..nq)
                    .map(|j| m[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)] * at[2 * nq + j])
                    .sum();
                inertia + b[i] - f[i]
            })
            .collect();
        assert_close(
            &values(&g, &equations.residual, &at),
            &sum,
            1e-12,
            &robot.name,
        );
        // 2 T = vᵀ M v.
        let twice: f64 = (0..nq)
            .flat_map(|i| (0..nq).map(move |j| (i, j)))
            .map(|(i, j)| m[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)] * at[nq + i] * at[nq + j])
            .sum();
        assert_close(
            &values(&g, &[equations.energies.kinetic], &at),
            &[0.5 * twice],
            1e-12,
            &robot.name,
        );
    }
}

#[test]
fn jacobian_and_hessian_agree_with_num_dual_everywhere() {
    for robot in [
        robots::two_link(),
        robots::carriage(),
        robots::tree(),
        robots::arm(3),
    ] {
        let Derived {
            g,
            equations,
            derivatives,
        } = derived(&robot);
        let (nq, nz) = (robot.nq(), equations.symbols.z().len());
        let tape = Tape::new(&g, &equations.residual);
        let mut random = Random::new(8);
        for _ in 0..2 {
            let at = sample::point(&robot, &mut random);
            let lambda = &at[nz..nz + nq];

            let mut dense = vec![0.0; nq * nz];
            let entries: Vec<Id> = derivatives
                .jacobian
                .iter()
                .map(|entry| entry.value)
                .collect();
            for (entry, value) in derivatives.jacobian.iter().zip(values(&g, &entries, &at)) {
                dense[entry.row * nz + entry.col] = value;
            }
            let mut expected = vec![0.0; nq * nz];
            let mut r = vec![Dual64::from(0.0); nq];
            for col in 0..nz {
                let mut z: Vec<Dual64> = at.iter().map(|&x| Dual64::from(x)).collect();
                z[col].eps = 1.0;
                tape.eval(&z, &mut r);
                for row in 0..nq {
                    expected[row * nz + col] = r[row].eps;
                }
            }
            assert_close(&dense, &expected, 1e-12, &format!("J of {}", robot.name));

            let mut dense = vec![0.0; nz * nz];
            let entries: Vec<Id> = derivatives
                .hessian
                .iter()
                .map(|entry| entry.value)
                .collect();
            for (entry, value) in derivatives.hessian.iter().zip(values(&g, &entries, &at)) {
                assert!(entry.row >= entry.col);
                dense[entry.row * nz + entry.col] = value;
            }
            let mut expected = vec![0.0; nz * nz];
            let mut r = vec![HyperDual64::from(0.0); nq];
            for row in 0..nz {
                for col in 0..=row {
                    let mut z: Vec<HyperDual64> =
                        at.iter().map(|&x| HyperDual64::from(x)).collect();
                    z[row].eps1 = 1.0;
                    z[col].eps2 = 1.0;
                    tape.eval(&z, &mut r);
                    expected[row * nz + col] = lambda
                        .iter()
                        .zip(&r)
                        .map(|(lambda, r)| lambda * r.eps1eps2)
                        .sum();
                }
            }
            assert_close(&dense, &expected, 1e-12, &format!("H of {}", robot.name));
        }
    }
}

/// A second oracle that shares no code: central differences of r, and of J for the Hessian.
#[test]
fn derivatives_agree_with_central_differences() {
    let robot = robots::tree();
    let Derived {
        g,
        equations,
        derivatives,
    } = derived(&robot);
    let (nq, nz) = (robot.nq(), equations.symbols.z().len());
    let mut random = Random::new(9);
    let at = sample::point(&robot, &mut random);
    let residual = Tape::new(&g, &equations.residual);
    let entries: Vec<Id> = derivatives
        .jacobian
        .iter()
        .map(|entry| entry.value)
        .collect();
    let jacobian = Tape::new(&g, &entries);
    let mut dense = vec![0.0; nq * nz];
    let mut hessian = vec![0.0; nz * nz];
    let h = 1e-5;
    for col in 0..nz {
        let shifted = |sign: f64| {
            let mut z = at.clone();
            z[col] += sign * h;
            let (mut r, mut j) = (vec![0.0; nq], vec![0.0; entries.len()]);
            residual.eval(&z, &mut r);
            jacobian.eval(&z, &mut j);
            (r, j)
        };
        let ((r_up, j_up), (r_down, j_down)) = (shifted(1.0), shifted(-1.0));
        for row in 0..nq {
            dense[row * nz + col] = (r_up[row] - r_down[row]) / (2.0 * h);
        }
        for (k, entry) in derivatives.jacobian.iter().enumerate() {
            hessian[entry.col * nz + col] += at[nz + entry.row] * (j_up[k] - j_down[k]) / (2.0 * h);
        }
    }
    let mut found = vec![0.0; nq * nz];
    for (entry, value) in derivatives.jacobian.iter().zip(values(&g, &entries, &at)) {
        found[entry.row * nz + entry.col] = value;
    }
    assert_close(&found, &dense, 1e-8, "J");
    let entries: Vec<Id> = derivatives
        .hessian
        .iter()
        .map(|entry| entry.value)
        .collect();
    let mut found = vec![0.0; nz * nz];
    for (entry, value) in derivatives.hessian.iter().zip(values(&g, &entries, &at)) {
        found[entry.row * nz + entry.col] = value;
        found[entry.col * nz + entry.row] = value;
    }
    assert_close(&found, &hessian, 1e-8, "H");
}

#[test]
fn operation_counts() {
    let mut table = String::from(
        "n | r Lagrange | r Newton-Euler | M | J non-zeros | r and J | H non-zeros | H\n",
    );
    for n in 1..=7 {
        let robot = robots::arm(n);
        let Derived {
            g,
            equations,
            derivatives,
        } = derived(&robot);
        let cost = |outputs: &[Id]| pid_symbolic::Cost::of(&g, outputs).total();
        let jacobian: Vec<Id> = equations
            .residual
            .iter()
            .copied()
            .chain(derivatives.jacobian.iter().map(|entry| entry.value))
            .collect();
        let hessian: Vec<Id> = derivatives
            .hessian
            .iter()
            .map(|entry| entry.value)
            .collect();
        table += &format!(
            "{n} | {} | {} | {} | {} | {} | {} | {}\n",
            equations.lagrange.total(),
            equations.newton_euler.expect("bodies").total(),
            cost(&equations.mass_matrix),
            derivatives.jacobian.len(),
            cost(&jacobian),
            hessian.len(),
            cost(&hessian)
        );
    }
    insta::assert_snapshot!(table);
}
