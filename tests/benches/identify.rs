//! A whole identification of the two-link robot from a simulated record of 301 samples.
//!
//! `cargo bench -p pid-tests --bench identify`

use std::ops::ControlFlow;

use divan::Bencher;
use pid_fit::ident::identify;
use pid_fit::transcribe::Scheme;
use pid_models::TwoLink;
use pid_tests::two_link;

fn main() {
    divan::main();
}

fn whole(bencher: Bencher<'_, '_>, scheme: Scheme) {
    let truth = two_link::truth();
    let dataset = two_link::simulated(&truth, 301).expect("simulates");
    // Every second parameter that is not a centre of mass a quarter up, the others a fifth down.
    let start: Vec<f64> = truth
        .iter()
        .enumerate()
        .map(|(k, p)| if k % 2 == 0 { 1.25 * p } else { 0.8 * p })
        .collect();
    let settings = two_link::settings(scheme);
    bencher.bench_local(|| {
        let found = identify(&TwoLink, &dataset, &settings, Some(&start), &mut |_| {
            ControlFlow::Continue(())
        })
        .expect("identifies");
        assert!(found.best().status.converged());
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn explicit_euler(bencher: Bencher<'_, '_>) {
    whole(bencher, Scheme::ExplicitEuler);
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn trapezoidal(bencher: Bencher<'_, '_>) {
    whole(bencher, Scheme::Trapezoidal);
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn midpoint(bencher: Bencher<'_, '_>) {
    whole(bencher, Scheme::ImplicitMidpoint);
}
