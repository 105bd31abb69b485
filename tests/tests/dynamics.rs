//! The generated dynamics of every model against independent oracles: equations written by hand,
//! energy, forward-mode dual numbers, central differences.

mod by_hand;

use by_hand::{
    cart_pole_by_hand, double_pendulum_by_hand, emps_by_hand, servo_pendulum_by_hand,
    two_link_by_hand,
};
use pid_models::{
    Arm6, CartPole, DoublePendulum, Emps, Panda, Scara, ServoPendulum, TwoLink, Tx40, Ur10e, Vs050,
    Vs050TwoAxis,
};
use pid_runtime::dynamics::{At, Dims, Dynamics, Hessian, Pattern};
use pid_runtime::generic::{self, GenericDynamics};
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};

/// A point in `z = (q, v, a, u, p)`, with multipliers.
#[derive(Debug, Clone)]
struct Point {
    dims: Dims,
    z: Vec<f64>,
    lambda: Vec<f64>,
}

impl Point {
    /// A point from numbers in −1..1: angles over the whole circle, parameters within a factor 2 of
    /// nominal (and within their ranges), inertias about the joint axis at least those of the
    /// centre of mass. The ten parameters of a link in linear form stay those of a body.
    fn new(model: &dyn Dynamics, raw: &[f64]) -> Point {
        let dims = model.dims();
        let mut raw = raw.iter().copied().cycle();
        let mut z = Vec::new();
        for scale in [3.2, 4.0, 20.0] {
            z.extend((0..dims.nq).map(|_| scale * raw.next().unwrap()));
        }
        z.extend((0..dims.nu).map(|_| 30.0 * raw.next().unwrap()));
        for p in model.params() {
            let x = raw.next().unwrap();
            let value = match p.nominal == 0.0 {
                true => 0.5 * (p.lower + p.upper) + 0.5 * (p.upper - p.lower) * x,
                false => p.nominal * 2.0_f64.powf(x),
            };
            z.push(value.clamp(p.lower, p.upper));
        }
        if model.name() == "DoublePendulum" {
            let p = &mut z[dims.p()..];
            p[2] = p[2].max(1.05 * p[0] * p[1] * p[1]);
            p[5] = p[5].max(1.05 * p[3] * p[4] * p[4]);
        }
        for (k, info) in model.params().iter().enumerate() {
            if info.name.ends_with("_mx") {
                let nominal: Vec<f64> = model.params()[k - 1..k + 9]
                    .iter()
                    .map(|p| p.nominal)
                    .collect();
                let numbers = [(); 5].map(|()| raw.next().unwrap());
                z[dims.p() + k - 1..][..10].copy_from_slice(&body(&nominal, numbers));
            }
        }
        let lambda = (0..dims.nq).map(|_| raw.next().unwrap()).collect();
        Point { dims, z, lambda }
    }

    fn at(&self) -> At<'_> {
        let d = self.dims;
        At {
            q: &self.z[..d.v()],
            v: &self.z[d.v()..d.a()],
            a: &self.z[d.a()..d.u()],
            u: &self.z[d.u()..d.p()],
            p: &self.z[d.p()..],
        }
    }
}

/// Mass, first moment and inertia of a scaled body with a point mass added, all ten different from nominal.
fn body(nominal: &[f64], [scale, mass, x, y, z]: [f64; 5]) -> Vec<f64> {
    let m = 0.5 * nominal[0] * (1.0 + mass);
    let [x, y, z] = [0.2 * x, 0.2 * y, 0.2 * z];
    let point = [
        m,
        m * x,
        m * y,
        m * z,
        m * (y * y + z * z),
        m * (x * x + z * z),
        m * (x * x + y * y),
        -m * x * y,
        -m * x * z,
        -m * y * z,
    ];
    let scaled = nominal.iter().map(|n| n * 2.0_f64.powf(scale));
    scaled.zip(point).map(|(n, p)| n + p).collect()
}

/// Runs a property at 100 random points, always the same ones.
fn for_points(model: &dyn Dynamics, check: impl Fn(&Point)) {
    let mut runner = TestRunner::new(ProptestConfig {
        cases: 100,
        rng_seed: RngSeed::Fixed(20_240_611),
        failure_persistence: None,
        ..ProptestConfig::default()
    });
    let numbers = model.dims().nz() + model.dims().nq;
    runner
        .run(&prop::collection::vec(-1.0..1.0, numbers), |raw| {
            check(&Point::new(model, &raw));
            Ok(())
        })
        .unwrap_or_else(|e| panic!("{}: {e}", model.name()));
}

/// `|x − y| ≤ tolerance · scale` for each entry.
fn assert_close(what: &str, x: &[f64], y: &[f64], scale: f64, tolerance: f64) {
    assert_eq!(x.len(), y.len(), "{what}");
    for (k, (x, y)) in x.iter().zip(y).enumerate() {
        let error = (x - y).abs();
        assert!(
            error <= tolerance * scale.max(y.abs()),
            "{what}[{k}]: {x:e} and {y:e} differ by {error:e}, scale {scale:e}"
        );
    }
}

fn assert_within(what: &str, x: f64, y: f64, tolerance: f64) {
    let error = (x - y).abs();
    assert!(
        error <= tolerance,
        "{what}: {x:e} and, by differences, {y:e} differ by {error:e}, allowed {tolerance:e}"
    );
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// One model after the other, also as a generic model.
macro_rules! for_each_model {
    ($check:ident) => {{
        $check(&TwoLink);
        $check(&Emps);
        $check(&DoublePendulum);
        $check(&Scara);
        $check(&Arm6);
        $check(&Ur10e);
        $check(&Panda);
        $check(&CartPole);
        $check(&ServoPendulum);
        $check(&Tx40);
        $check(&Vs050);
        $check(&Vs050TwoAxis);
    }};
}

fn mass_matrix(model: &dyn Dynamics, at: &At<'_>) -> Vec<Vec<f64>> {
    let nq = model.dims().nq;
    let mut packed = vec![0.0; model.dims().nm()];
    model.mass_matrix(at, &mut packed);
    let entry = |i: usize, j: usize| packed[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)];
    (0..nq)
        .map(|i| (0..nq).map(|j| entry(i, j)).collect())
        .collect()
}

fn vector(model: &dyn Dynamics, f: impl Fn(&mut [f64])) -> Vec<f64> {
    let mut out = vec![f64::NAN; model.dims().nq];
    f(&mut out);
    out
}

#[test]
fn residuals_equal_the_equations_written_by_hand() {
    type ByHand = fn(&At<'_>) -> Vec<f64>;
    let cases: [(&dyn Dynamics, ByHand); 5] = [
        (&TwoLink, two_link_by_hand),
        (&Emps, emps_by_hand),
        (&DoublePendulum, double_pendulum_by_hand),
        (&CartPole, cart_pole_by_hand),
        (&ServoPendulum, servo_pendulum_by_hand),
    ];
    for (model, expected) in cases {
        for_points(model, |point| {
            let at = point.at();
            let r = vector(model, |r| model.residual(&at, r));
            let expected = expected(&at);
            assert_close(model.name(), &r, &expected, largest(&expected), 1e-12);
        });
    }
}

/// Motor 6 of the TX40 turns by q5 + q6 and pushes joints 5 and 6 alike.
#[test]
fn the_coupled_motor_acts_on_both_joints_of_the_wrist() {
    let own: Vec<usize> = ["dry_wrist", "viscous_wrist", "rotor_wrist"]
        .map(|name| {
            let mut params = Tx40.params().iter();
            params.position(|p| p.name == name).expect("the motor's")
        })
        .to_vec();
    for_points(&Tx40, |point| {
        let at = point.at();
        let mut without = at.p.to_vec();
        own.iter().for_each(|&k| without[k] = 0.0);
        let r = vector(&Tx40, |r| Tx40.residual(&at, r));
        let rest = At { p: &without, ..at };
        let rest = vector(&Tx40, |r| Tx40.residual(&rest, r));
        let [dry, viscous, rotor] = [0, 1, 2].map(|k| at.p[own[k]]);
        let (v, a) = (at.v[4] + at.v[5], at.a[4] + at.a[5]);
        let push = rotor * a + viscous * v + dry * (v / 0.05).tanh();
        let expected: Vec<f64> = (0..6)
            .map(|i| rest[i] + if i >= 4 { push } else { 0.0 })
            .collect();
        assert_close("r", &r, &expected, largest(&expected), 1e-13);
    });
}

/// Holding joints is the same as leaving them where they are.
#[test]
fn the_variant_with_held_joints_moves_as_the_robot_with_joints_at_rest() {
    for_points(&Vs050TwoAxis, |point| {
        let at = point.at();
        let p: Vec<f64> = Vs050
            .params()
            .iter()
            .map(|full| {
                let mut own = Vs050TwoAxis.params().iter();
                own.position(|p| p.name == full.name)
                    .map_or(full.nominal, |k| at.p[k])
            })
            .collect();
        let padded = |x: &[f64]| [x, &[0.0; 4]].concat();
        let (q, v, a, u) = (padded(at.q), padded(at.v), padded(at.a), padded(at.u));
        let full = At {
            q: &q,
            v: &v,
            a: &a,
            u: &u,
            p: &p,
        };
        let full = vector(&Vs050, |r| Vs050.residual(&full, r));
        let r = vector(&Vs050TwoAxis, |r| Vs050TwoAxis.residual(&at, r));
        assert_close("r", &r, &full[..2], largest(&full), 1e-12);
    });
}

#[test]
fn nominal_values_are_the_published_ones() {
    let p = pid_models::two_link::TwoLinkParams::nominal();
    assert_eq!(TwoLink::NP, 19);
    assert_eq!(
        p.as_array(),
        [
            6.0, 23.0, 0.0, 0.0, 0.0, 0.0, 0.2875, 0.03, 0.6912, 0.6912, 0.115, 1.0, 2.0, 8.0, 3.0,
            0.7, 0.4, 50.0, 50.0
        ]
    );
    let (lower, upper) = (
        pid_models::two_link::TwoLinkParams::lower(),
        pid_models::two_link::TwoLinkParams::upper(),
    );
    for ((x, lo), hi) in p
        .as_array()
        .iter()
        .zip(lower.as_array())
        .zip(upper.as_array())
    {
        let (a, b) = match *x == 0.0 {
            true => (-0.3, 0.3),
            false => (0.1 * x, 10.0 * x),
        };
        assert!(
            (lo - a).abs() < 1e-12 && (hi - b).abs() < 1e-12,
            "{x}: {lo}..={hi}"
        );
    }
}

#[test]
fn the_residual_is_the_sum_of_its_parts() {
    fn check<M: Dynamics>(model: &M) {
        for_points(model, |point| {
            let at = point.at();
            let m = mass_matrix(model, &at);
            let b = vector(model, |b| model.bias(&at, b));
            let f = vector(model, |f| model.applied_force(&at, f));
            let r = vector(model, |r| model.residual(&at, r));
            let sum: Vec<f64> = (0..m.len())
                .map(|i| m[i].iter().zip(at.a).map(|(m, a)| m * a).sum::<f64>() + b[i] - f[i])
                .collect();
            let scale = largest(&b) + largest(&f) + largest(&sum);
            assert_close(model.name(), &r, &sum, scale, 1e-12);
        });
    }
    for_each_model!(check);
}

#[test]
fn the_mass_matrix_is_positive_definite_and_gives_the_kinetic_energy() {
    fn check<M: Dynamics>(model: &M) {
        for_points(model, |point| {
            let at = point.at();
            let m = mass_matrix(model, &at);
            // LDLᵀ: all pivots of a positive definite matrix are positive.
            let mut rest = m.clone();
            for k in 0..m.len() {
                let pivot = rest[k][k];
                assert!(pivot > 0.0, "{}: pivot {pivot} in {m:?}", model.name());
                for i in k + 1..m.len() {
                    let factor = rest[i][k] / pivot;
                    for j in k + 1..m.len() {
                        rest[i][j] -= factor * rest[k][j];
                    }
                }
            }
            let t: f64 = (0..m.len())
                .flat_map(|i| (0..m.len()).map(move |j| (i, j)))
                .map(|(i, j)| 0.5 * at.v[i] * m[i][j] * at.v[j])
                .sum();
            assert_close("T", &[model.kinetic_energy(&at)], &[t], t, 1e-12);
        });
    }
    for_each_model!(check);
}

/// Accelerations with r = 0.
fn accelerations<M: GenericDynamics + Dynamics>(model: &M, at: &At<'_>) -> Vec<f64> {
    let mut a = vec![0.0; model.dims().nq];
    model
        .vector_field_generic(at.q, at.v, at.u, at.p, &mut a)
        .unwrap();
    a
}

fn power<M: Dynamics>(model: &M, at: &At<'_>) -> f64 {
    let f = vector(model, |f| model.applied_force(at, f));
    f.iter().zip(at.v).map(|(f, v)| f * v).sum()
}

fn energy(model: &dyn Dynamics, at: &At<'_>) -> f64 {
    model.kinetic_energy(at) + model.potential_energy(at)
}

/// dE/dt = v · f_L at a point: E by central differences along the flow.
#[test]
fn the_rate_of_energy_is_the_power_of_the_applied_forces() {
    fn check<M: GenericDynamics + Dynamics>(model: &M) {
        for_points(model, |point| {
            let at = point.at();
            let a = accelerations(model, &at);
            let h = 1e-5 / (1.0 + largest(&a)).max(largest(at.v)).sqrt();
            let moved = |h: f64| {
                let q: Vec<f64> = (0..a.len())
                    .map(|i| at.q[i] + h * at.v[i] + 0.5 * h * h * a[i])
                    .collect();
                let v: Vec<f64> = (0..a.len()).map(|i| at.v[i] + h * a[i]).collect();
                energy(model, &At { q: &q, v: &v, ..at })
            };
            let rate = (moved(h) - moved(-h)) / (2.0 * h);
            // Rounding of E, and the power of the forces one by one.
            let scale = largest(&a) * largest(at.v) * mass_matrix(model, &at)[0][0]
                + energy(model, &at).abs() * 1e-10 / h;
            let expected = power(model, &at);
            assert_close(model.name(), &[rate], &[expected], scale, 1e-6);
        });
    }
    for_each_model!(check);
}

/// Over one simulated second the energy changes by the work of the applied forces.
#[test]
fn energy_balances_along_a_simulated_motion() {
    fn check<M: GenericDynamics + Dynamics>(model: &M) {
        let dims = model.dims();
        // Friction of geared drives on light wrists decays within microseconds: less of it, for the
        // fixed step to resolve.
        let geared = dims.nq > 2;
        let p = model.params().iter().map(|p| {
            let friction = p.name.starts_with("dry") || p.name.starts_with("viscous");
            p.nominal * if geared && friction { 1e-4 } else { 1.0 }
        });
        let p: Vec<f64> = p.collect();
        // A constant drive that moves each model without running away.
        let u = vec![if model.name() == "Emps" { 60.0 } else { 0.3 }; dims.nu];
        let mut x = vec![0.7; dims.nq];
        x.extend(vec![0.2; dims.nq]);
        x.push(0.0); // work done so far
        let zero = vec![0.0; dims.nq];
        let rate = |x: &[f64]| -> Vec<f64> {
            let at = At {
                q: &x[..dims.nq],
                v: &x[dims.nq..2 * dims.nq],
                a: &zero,
                u: &u,
                p: &p,
            };
            let mut out = at.v.to_vec();
            out.extend(accelerations(model, &at));
            out.push(power(model, &at));
            out
        };
        let total = |x: &[f64]| {
            let at = At {
                q: &x[..dims.nq],
                v: &x[dims.nq..2 * dims.nq],
                a: &zero,
                u: &u,
                p: &p,
            };
            energy(model, &at)
        };
        let start = total(&x);
        let (h, steps) = (1e-4, 10_000);
        let shifted = |x: &[f64], k: &[f64], h: f64| -> Vec<f64> {
            x.iter().zip(k).map(|(x, k)| x + h * k).collect()
        };
        let mut swing: f64 = 0.0;
        for _ in 0..steps {
            let k1 = rate(&x);
            let k2 = rate(&shifted(&x, &k1, 0.5 * h));
            let k3 = rate(&shifted(&x, &k2, 0.5 * h));
            let k4 = rate(&shifted(&x, &k3, h));
            for i in 0..x.len() {
                x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
            swing = swing.max((total(&x) - start).abs());
        }
        let (gained, work) = (total(&x) - start, x[2 * dims.nq]);
        assert!(swing > 1e-2, "{}: nothing happened", model.name());
        assert!(
            (gained - work).abs() < 1e-7 * swing,
            "{}: energy {gained}, work {work}",
            model.name()
        );
    }
    for_each_model!(check);
}

/// Values at the entries of a pattern, as a dense matrix.
fn dense(pattern: Pattern<'_>, values: &[f64], rows: usize, cols: usize) -> Vec<f64> {
    let mut out = vec![0.0; rows * cols];
    for ((&i, &j), x) in pattern.rows.iter().zip(pattern.cols).zip(values) {
        out[i as usize * cols + j as usize] = *x;
    }
    out
}

fn jacobian<M: Hessian>(model: &M, at: &At<'_>) -> Vec<f64> {
    let d = model.dims();
    let pattern = model.jacobian_pattern();
    let (mut r, mut values) = (vec![0.0; d.nq], vec![0.0; pattern.nnz()]);
    model.residual_jacobian(at, &mut r, &mut values);
    assert_eq!(r, vector(model, |r| model.residual(at, r)));
    dense(pattern, &values, d.nq, d.nz())
}

fn hessian<M: Hessian>(model: &M, at: &At<'_>, lambda: &[f64]) -> Vec<f64> {
    let nz = model.dims().nz();
    let pattern = model.hessian_pattern();
    let mut values = vec![0.0; pattern.nnz()];
    model.residual_hessian(at, lambda, &mut values);
    assert!(pattern.rows.iter().zip(pattern.cols).all(|(i, j)| i >= j));
    dense(pattern, &values, nz, nz)
}

/// Size of the terms `dry sharp² (1 − tanh²) tanh` before the cancellation in `1 − tanh²`: far from
/// rest their derivatives are small differences, good to a few ulp of this and no better, by either
/// way.
fn saturated(model: &dyn Dynamics, point: &Point) -> f64 {
    let of = |stem: &str| {
        let all = model.params().iter().zip(point.at().p);
        let own = all.filter(|(info, _)| info.name.starts_with(stem));
        own.fold(0.0, |m: f64, (_, x)| m.max(x.abs()))
    };
    let sharp = match model.name() {
        // Fixed in the declaration.
        "Scara" => 200.0,
        "Tx40" => 20.0,
        "Ur10e" | "Panda" | "Vs050" | "Vs050TwoAxis" => 50.0,
        // `tanh(v/slip)`, the second derivative by `slip` is larger by (v/slip)².
        "ServoPendulum" => slipping(model, point),
        _ => of("sharp"),
    };
    1e-3 * of("dry") * sharp.powi(2) * largest(&point.lambda)
}

fn slipping(model: &dyn Dynamics, point: &Point) -> f64 {
    let all = model.params().iter().zip(point.at().p);
    let slips = all.filter(|(info, _)| info.name.starts_with("slip"));
    let slip = slips.fold(f64::INFINITY, |m: f64, (_, x)| m.min(x.abs()));
    (1.0 + largest(point.at().v) / slip) / slip
}

#[test]
fn first_derivatives_equal_dual_numbers_and_are_zero_off_the_pattern() {
    fn check<M: Hessian + GenericDynamics>(model: &M) {
        for_points(model, |point| {
            let (at, nz) = (point.at(), point.dims.nz());
            let mut expected = vec![0.0; point.dims.nq * nz];
            generic::residual_jacobian(model, point.dims, &at, &mut expected);
            let found = jacobian(model, &at);
            for (row, expected) in expected.chunks(nz).enumerate() {
                let found = &found[row * nz..][..nz];
                let scale = 1e-2 * largest(expected);
                assert_close("J", found, expected, scale, 1e-12);
            }
        });
    }
    for_each_model!(check);
}

#[test]
fn second_derivatives_equal_dual_numbers_and_are_zero_off_the_pattern() {
    fn check<M: Hessian + GenericDynamics>(model: &M) {
        let nz = model.dims().nz() as u32;
        let (rows, cols): (Vec<u32>, Vec<u32>) =
            (0..nz).flat_map(|i| (0..=i).map(move |j| (i, j))).unzip();
        for_points(model, |point| {
            let at = point.at();
            let pattern = Pattern {
                rows: &rows,
                cols: &cols,
            };
            let mut values = vec![0.0; pattern.nnz()];
            let d = point.dims;
            generic::residual_hessian(model, d, &at, &point.lambda, pattern, &mut values);
            let expected = dense(pattern, &values, d.nz(), d.nz());
            let found = hessian(model, &at, &point.lambda);
            let scale = 1e-2 * largest(&expected) + saturated(model, point);
            assert_close("H", &found, &expected, scale, 1e-12);
        });
    }
    for_each_model!(check);
}

#[test]
fn derivatives_agree_with_central_differences() {
    fn check<M: Hessian>(model: &M) {
        for_points(model, |point| {
            let (d, nz) = (point.dims, point.dims.nz());
            let found_j = jacobian(model, &point.at());
            let found_h = hessian(model, &point.at(), &point.lambda);
            let at_j = |z: &[f64]| {
                let p = Point {
                    z: z.to_vec(),
                    ..point.clone()
                };
                let j = jacobian(model, &p.at());
                let r = vector(model, |r| model.residual(&p.at(), r));
                let gradient: Vec<f64> = (0..nz)
                    .map(|c| (0..d.nq).map(|i| point.lambda[i] * j[i * nz + c]).sum())
                    .collect();
                (r, gradient)
            };
            for c in 0..nz {
                // tanh(sharp v) changes over v of 1/sharp: steps well below.
                let h = 1e-6 * point.z[c].abs().max(0.01);
                let (mut up, mut down) = (point.z.clone(), point.z.clone());
                up[c] += h;
                down[c] -= h;
                let width = up[c] - down[c];
                let ((r_up, g_up), (r_down, g_down)) = (at_j(&up), at_j(&down));
                for i in 0..d.nq {
                    let x = (r_up[i] - r_down[i]) / width;
                    let rounding = 1e-15 * r_up[i].abs() / h + 1e-15 * 1e3 / h;
                    let tolerance = 1e-6 * x.abs() + rounding + 1e-9;
                    assert_within("J", found_j[i * nz + c], x, tolerance);
                }
                for row in c..nz {
                    let x = (g_up[row] - g_down[row]) / width;
                    let rounding = 1e-15 * (g_up[row].abs() + 1e3) / h;
                    let tolerance = 1e-5 * x.abs() + rounding + 1e-8;
                    assert_within("H", found_h[row * nz + c], x, tolerance);
                }
            }
        });
    }
    for_each_model!(check);
}
