//! Time of one evaluation, interpreted and compiled, at the same point in the same run.
//!
//! `cargo run --release -p pid-interpret --example interpreted_speed` prints nanoseconds per node
//! of r, J and H: compiled, interpreted, and interpreted four nodes at once. It takes the least of
//! several rounds, so that other work on the machine does not count.
#![allow(clippy::print_stdout, reason = "its result is what it prints")]

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;
use std::time::Instant;

use pid_interpret::Model;
use pid_runtime::dynamics::{At, Hessian};
use pid_runtime::lanes::{LANES, Lane, LanesAt};

/// Rounds, of which the fastest counts.
const ROUNDS: usize = 15;

/// Least time per call, ns.
fn time(calls: usize, mut f: impl FnMut()) -> f64 {
    let round = |_| {
        let started = Instant::now();
        for _ in 0..calls {
            f();
        }
        1e9 * started.elapsed().as_secs_f64() / calls as f64
    };
    (0..ROUNDS).map(round).fold(f64::INFINITY, f64::min)
}

/// r, J and H of one node.
fn single(model: &dyn Hessian, at: &At<'_>, lambda: &[f64]) -> [f64; 3] {
    let mut r = vec![0.0; model.dims().nq];
    let mut j = vec![0.0; model.jacobian_pattern().nnz()];
    let mut h = vec![0.0; model.hessian_pattern().nnz()];
    [
        time(4000, || model.residual(black_box(at), black_box(&mut r))),
        time(1000, || {
            model.residual_jacobian(black_box(at), black_box(&mut r), black_box(&mut j))
        }),
        time(400, || {
            model.residual_hessian(black_box(at), lambda, black_box(&mut h))
        }),
    ]
}

/// The same per node, four nodes at once.
fn lanes(model: &dyn Hessian, at: &LanesAt<'_>, lambda: &[Lane]) -> [f64; 3] {
    let zeros = |len: usize| vec![[0.0; LANES]; len];
    let mut r = zeros(model.dims().nq);
    let mut j = zeros(model.jacobian_pattern().nnz());
    let mut h = zeros(model.hessian_pattern().nnz());
    [
        time(4000, || {
            model.residual_lanes(black_box(at), black_box(&mut r))
        }),
        time(1000, || {
            model.residual_jacobian_lanes(black_box(at), black_box(&mut r), black_box(&mut j))
        }),
        time(400, || {
            model.residual_hessian_lanes(black_box(at), lambda, black_box(&mut h))
        }),
    ]
    .map(|time| time / LANES as f64)
}

fn compare(file: &str, compiled: &dyn Hessian) {
    let started = Instant::now();
    let model = Model::new(&common::declared(file)).expect("the robot can be derived");
    let made = started.elapsed().as_secs_f64();
    let nnz = model.hessian_pattern().nnz();
    let all = started.elapsed().as_secs_f64();
    let d = compiled.dims();
    let p: Vec<f64> = compiled.params().iter().map(|p| p.nominal).collect();
    let z: Vec<f64> = (0..3 * d.nq + d.nu)
        .map(|k| 0.3 + 0.17 * k as f64)
        .collect();
    let lambda: Vec<f64> = (0..d.nq).map(|k| 0.4 - 0.3 * k as f64).collect();
    let at = At {
        q: &z[..d.v()],
        v: &z[d.v()..d.a()],
        a: &z[d.a()..d.u()],
        u: &z[d.u()..],
        p: &p,
    };
    let spread = |x: &[f64]| -> Vec<Lane> { x.iter().map(|&x| [x; LANES]).collect() };
    let (z4, lambda4) = (spread(&z), spread(&lambda));
    let at4 = LanesAt {
        q: &z4[..d.v()],
        v: &z4[d.v()..d.a()],
        a: &z4[d.a()..d.u()],
        u: &z4[d.u()..],
        p: &p,
    };

    println!(
        "{file}: made in {made:.3} s, with second derivatives in {all:.3} s; {nnz} entries of H; ns per node:"
    );
    println!("  {model:?}");
    let rows = [
        ("compiled", single(compiled, &at, &lambda)),
        ("compiled, four nodes", lanes(compiled, &at4, &lambda4)),
        ("interpreted", single(&model, &at, &lambda)),
        ("interpreted, four nodes", lanes(&model, &at4, &lambda4)),
    ];
    for (name, [r, j, h]) in rows {
        println!("  {name:24} r {r:9.0}  J {j:9.0}  H {h:9.0}");
    }
}

fn main() {
    compare("two_link.rs", &pid_models::TwoLink);
    compare("arm6.rs", &pid_models::Arm6);
}
