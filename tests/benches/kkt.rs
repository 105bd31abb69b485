//! One factorization and solve of the two-link problem's linear system: structured and sparse.
//!
//! `cargo bench -p pid-tests --bench kkt`

use divan::Bencher;
use pid_fit::transcribe::{Curvature, FullDiscretization, Loss, Scheme, Setup};
use pid_models::TwoLink;
use pid_nlp::Nlp;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::kkt::structured::StructuredKkt;
use pid_nlp::solver::kkt::{Kkt, KktValues};
use pid_runtime::dynamics::Dynamics;
use pid_tests::{recorded, two_link};

fn main() {
    divan::main();
}

/// The problem at the true motion, midpoint rule.
fn problem(samples: usize) -> FullDiscretization<'static> {
    let p = two_link::truth();
    let dataset = two_link::simulated(&p, samples).expect("simulates");
    let track = recorded(&dataset.experiments[0]).expect("recorded velocities");
    let infos = TwoLink.params();
    let setup = Setup {
        scheme: Scheme::ImplicitMidpoint,
        curvature: Curvature::GaussNewton,
        lower: infos.iter().map(|i| i.lower).collect(),
        upper: infos.iter().map(|i| i.upper).collect(),
        scale: vec![1.0; infos.len()],
        inertia: vec![2.0; 2],
        hold_initial: false,
        linear_inputs: false,
        substeps: 1,
        output: None,
        loss: Loss::Square,
        priors: Vec::new(),
        bodies: Vec::new(),
        bodies_weight: 0.0,
    };
    FullDiscretization::new(&TwoLink, &[track], setup)
}

fn factorise_and_solve(
    bencher: Bencher<'_, '_>,
    samples: usize,
    system: fn(&FullDiscretization<'_>) -> Box<dyn Kkt>,
) {
    let mut problem = problem(samples);
    let x = problem.starting_point(&two_link::truth());
    let (n, m) = (problem.n(), problem.m());
    let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
    let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
    problem.jacobian(&x, &mut jacobian);
    problem.hessian(&x, samples as f64, &vec![0.0; m], &mut hessian);
    let sigma = vec![1e-2; n];
    let mut kkt = system(&problem);
    let (rx, rc) = (vec![1.0; n], vec![0.1; m]);
    let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
    bencher.bench_local(|| {
        let values = KktValues {
            hessian: &hessian,
            jacobian: &jacobian,
            sigma: &sigma,
        };
        kkt.factorise(values).expect("factorises");
        kkt.solve(&rx, &rc, &mut dx, &mut dl)
    });
}

#[divan::bench(args = [301, 3001], sample_count = 20, sample_size = 1)]
fn structured(bencher: Bencher<'_, '_>, samples: usize) {
    factorise_and_solve(bencher, samples, |p| {
        let fixed = p.fixed_parameters();
        Box::new(StructuredKkt::new(p.layout().clone(), &fixed, 10))
    });
}

#[divan::bench(args = [301, 3001], sample_count = 20, sample_size = 1)]
fn sparse(bencher: Bencher<'_, '_>, samples: usize) {
    factorise_and_solve(bencher, samples, |p| Box::new(SparseKkt::new(p)));
}
