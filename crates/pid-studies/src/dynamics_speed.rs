//! Time of one evaluation of the six-axis arm with 84 parameters, 60 of them inertial: r, r and
//! ∂r/∂z, ∂²(λᵀr)/∂z², one node and four at once; forward dynamics with all first derivatives
//! (states, inputs, parameters).
//!
//! ```text
//! cargo run --release -p pid-studies -- dynamics-speed
//! RUSTFLAGS="-C target-cpu=native" cargo run --release -p pid-studies -- dynamics-speed
//! perf stat -e instructions:u target/release/pid-studies dynamics-speed jacobian 1000000   # evaluations of one
//! ```
//! Printed: nanoseconds per node, the least of many batches.

use std::hint::black_box;
use std::time::Instant;

use pid_fit::transcribe::ExplicitForm;
use pid_models::Arm6;
use pid_runtime::dynamics::{At, Dynamics, Hessian, Jacobian};
use pid_runtime::lanes::{LANES, Lane, LanesAt};

/// The point at which the peers are timed.
const Q: [f64; 6] = [0.3, -1.1, 0.9, -0.4, 0.7, -0.2];
const V: [f64; 6] = [0.5, -0.3, 0.8, -0.6, 0.4, 1.2];
const A: [f64; 6] = [1.0, -2.0, 0.5, 3.0, -1.5, 2.5];
const U: [f64; 6] = [1.0, 5.0, 2.0, 0.3, -0.1, 0.02];
const LAMBDA: [f64; 6] = [0.4, -0.7, 1.1, 0.2, -0.5, 0.9];

/// A function by name, with the number of nodes that one call evaluates.
struct Case {
    name: &'static str,
    nodes: usize,
    call: Box<dyn FnMut()>,
}

fn lanes(x: [f64; 6]) -> [Lane; 6] {
    x.map(|x| std::array::from_fn(|k| x * (1.0 + 0.01 * k as f64)))
}

fn nominal() -> Vec<f64> {
    Arm6.params().iter().map(|p| p.nominal).collect()
}

/// Functions of one node.
fn of_one() -> Vec<Case> {
    let p = nominal();
    let (nj, nh) = (Arm6::JACOBIAN_NNZ, Arm6::HESSIAN_NNZ);
    let mut cases = Vec::new();
    let mut one = |name, mut f: Box<dyn FnMut(&At<'_>)>| {
        let p = p.clone();
        let call = Box::new(move || {
            f(black_box(&At {
                q: &Q,
                v: &V,
                a: &A,
                u: &U,
                p: &p,
            }));
        });
        cases.push(Case {
            name,
            nodes: 1,
            call,
        });
    };
    let mut r = [0.0; 6];
    one(
        "residual",
        Box::new(move |at| {
            Arm6.residual(at, &mut r);
            black_box(&r);
        }),
    );
    let (mut r, mut j) = ([0.0; 6], vec![0.0; nj]);
    one(
        "jacobian",
        Box::new(move |at| {
            Arm6.residual_jacobian(at, &mut r, &mut j);
            black_box(&j);
        }),
    );
    let mut h = vec![0.0; nh];
    one(
        "hessian",
        Box::new(move |at| {
            Arm6.residual_hessian(at, black_box(&LAMBDA), &mut h);
            black_box(&h);
        }),
    );
    let explicit = ExplicitForm::new(&Arm6);
    let (mut r, mut j) = ([0.0; 6], vec![0.0; explicit.jacobian_pattern().nnz()]);
    one(
        "forward_derivatives",
        Box::new(move |at| {
            explicit.residual_jacobian(at, &mut r, &mut j);
            black_box(&j);
        }),
    );
    cases
}

/// Functions of four nodes at once.
fn of_four() -> Vec<Case> {
    let p = nominal();
    let (nj, nh) = (Arm6::JACOBIAN_NNZ, Arm6::HESSIAN_NNZ);
    let mut cases = Vec::new();
    let mut four = |name, mut f: Box<dyn FnMut(&LanesAt<'_>)>| {
        let p = p.clone();
        let [q, v, a, u] = [Q, V, A, U].map(lanes);
        let call = Box::new(move || {
            f(black_box(&LanesAt {
                q: &q,
                v: &v,
                a: &a,
                u: &u,
                p: &p,
            }));
        });
        cases.push(Case {
            name,
            nodes: LANES,
            call,
        });
    };
    let mut r = [[0.0; LANES]; 6];
    four(
        "residual_lanes",
        Box::new(move |at| {
            Arm6.residual_lanes(at, &mut r);
            black_box(&r);
        }),
    );
    let (mut r, mut j) = ([[0.0; LANES]; 6], vec![[0.0; LANES]; nj]);
    four(
        "jacobian_lanes",
        Box::new(move |at| {
            Arm6.residual_jacobian_lanes(at, &mut r, &mut j);
            black_box(&j);
        }),
    );
    let (mut h, lambda) = (vec![[0.0; LANES]; nh], lanes(LAMBDA));
    four(
        "hessian_lanes",
        Box::new(move |at| {
            Arm6.residual_hessian_lanes(at, black_box(&lambda), &mut h);
            black_box(&h);
        }),
    );
    let explicit = ExplicitForm::new(&Arm6);
    let nnz = explicit.jacobian_pattern().nnz();
    let (mut r, mut j) = ([[0.0; LANES]; 6], vec![[0.0; LANES]; nnz]);
    four(
        "forward_derivatives_lanes",
        Box::new(move |at| {
            explicit.residual_jacobian_lanes(at, &mut r, &mut j);
            black_box(&j);
        }),
    );
    cases
}

/// Runs the command with its words.
pub fn run(words: &[String]) {
    let mut arguments = words.iter().cloned();
    let (only, calls) = (arguments.next(), arguments.next());
    for mut case in of_one().into_iter().chain(of_four()) {
        if only.as_deref().is_some_and(|only| only != case.name) {
            continue;
        }
        if let Some(calls) = calls.as_ref().and_then(|n| n.parse::<usize>().ok()) {
            (0..calls).for_each(|_| (case.call)());
            continue;
        }
        // Batches of some 30 µs fit between the interruptions of a busy machine.
        let batch = 20;
        let mut best = f64::INFINITY;
        for _ in 0..4000 {
            let start = Instant::now();
            (0..batch).for_each(|_| (case.call)());
            best = best.min(start.elapsed().as_nanos() as f64);
        }
        let ns = best / (batch * case.nodes) as f64;
        println!("{:26} {ns:8.1} ns per node", case.name);
    }
}
