//! One evaluation of the two-link model: generated, in explicit form and over dual numbers.
//!
//! `cargo bench -p pid-tests --bench evaluate`

use divan::{Bencher, black_box};
use pid_fit::transcribe::ExplicitForm;
use pid_models::TwoLink;
use pid_runtime::dynamics::{At, Dynamics, Hessian};
use pid_runtime::generic;
use pid_tests::two_link;

fn main() {
    divan::main();
}

const LAMBDA: [f64; 2] = [0.4, -0.7];

fn at(p: &[f64]) -> At<'_> {
    At {
        q: &[0.3, 2.2],
        v: &[0.8, -0.6],
        a: &[3.0, -5.0],
        u: &[12.0, 60.0],
        p,
    }
}

fn residual(bencher: Bencher<'_, '_>, model: &dyn Hessian) {
    let p = two_link::truth();
    let mut r = [0.0; 2];
    bencher.bench_local(|| {
        model.residual(black_box(&at(&p)), &mut r);
        r
    });
}

fn jacobian(bencher: Bencher<'_, '_>, model: &dyn Hessian) {
    let p = two_link::truth();
    let (mut r, mut values) = ([0.0; 2], vec![0.0; model.jacobian_pattern().nnz()]);
    bencher.bench_local(|| {
        model.residual_jacobian(black_box(&at(&p)), &mut r, &mut values);
        values[0]
    });
}

fn hessian(bencher: Bencher<'_, '_>, model: &dyn Hessian) {
    let p = two_link::truth();
    let mut values = vec![0.0; model.hessian_pattern().nnz()];
    bencher.bench_local(|| {
        model.residual_hessian(black_box(&at(&p)), black_box(&LAMBDA), &mut values);
        values[0]
    });
}

#[divan::bench]
fn r_generated(bencher: Bencher<'_, '_>) {
    residual(bencher, &TwoLink);
}

#[divan::bench]
fn jacobian_generated(bencher: Bencher<'_, '_>) {
    jacobian(bencher, &TwoLink);
}

#[divan::bench]
fn hessian_generated(bencher: Bencher<'_, '_>) {
    hessian(bencher, &TwoLink);
}

#[divan::bench]
fn r_explicit_form(bencher: Bencher<'_, '_>) {
    residual(bencher, &ExplicitForm::new(&TwoLink));
}

#[divan::bench]
fn jacobian_explicit_form(bencher: Bencher<'_, '_>) {
    jacobian(bencher, &ExplicitForm::new(&TwoLink));
}

#[divan::bench]
fn hessian_explicit_form(bencher: Bencher<'_, '_>) {
    hessian(bencher, &ExplicitForm::new(&TwoLink));
}

#[divan::bench]
fn jacobian_dual_numbers(bencher: Bencher<'_, '_>) {
    let p = two_link::truth();
    let d = TwoLink.dims();
    let mut dense = vec![0.0; d.nq * d.nz()];
    bencher.bench_local(|| {
        generic::residual_jacobian(&TwoLink, d, black_box(&at(&p)), &mut dense);
        dense[0]
    });
}

#[divan::bench]
fn hessian_dual_numbers(bencher: Bencher<'_, '_>) {
    let p = two_link::truth();
    let pattern = TwoLink.hessian_pattern();
    let mut values = vec![0.0; pattern.nnz()];
    bencher.bench_local(|| {
        let (at, lambda) = (black_box(at(&p)), black_box(&LAMBDA));
        generic::residual_hessian(&TwoLink, TwoLink.dims(), &at, lambda, pattern, &mut values);
        values[0]
    });
}
