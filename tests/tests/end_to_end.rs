//! Simulates a robot with known parameters, identifies it from the record, and compares the
//! combinations that the record determines.

use std::ops::ControlFlow;

use pid_data::Dataset;
use pid_fit::ident::{Identification, identify};
use pid_fit::transcribe::Scheme;
use pid_models::TwoLink;
use pid_models::two_link::identifiable;
use pid_runtime::dynamics::Dynamics;
use pid_tests::two_link;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Samples over 6 s: steps of 2 ms, at which the midpoint rule's own error lies below what is asserted.
const SAMPLES: usize = 3001;

/// Every parameter off by up to 30 % of itself, offsets of the centres of mass by up to 5 cm.
fn perturbed(p: &[f64]) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let infos = TwoLink.params().iter();
    p.iter()
        .zip(infos)
        .map(|(p, info)| {
            let x = random.random_range(-1.0..1.0);
            let moved = if *p == 0.0 {
                0.05 * x
            } else {
                p * 1.3_f64.powf(x)
            };
            moved.clamp(info.lower, info.upper)
        })
        .collect()
}

/// A standard normal number (Box and Muller, 1958).
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (random.random_range(f64::EPSILON..1.0), random.random());
    (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}

fn fit(dataset: &Dataset) -> Identification {
    let settings = two_link::settings(Scheme::ImplicitMidpoint);
    let start = perturbed(&two_link::truth());
    let silent = &mut |_: &pid_fit::ident::Progress<'_>| ControlFlow::Continue(());
    let found = identify(&TwoLink, dataset, &settings, Some(&start), silent).unwrap();
    let run = found.best();
    eprintln!(
        "J = {:e}, {} iterations, {:.2} s, {:?}, {} undetermined",
        run.objective, run.iterations, run.seconds, run.status, found.undetermined
    );
    assert!(run.status.converged(), "{:?}", run.status);
    assert!(
        run.check.finite && run.check.primal_inf < 1e-6,
        "{:?}",
        run.check
    );
    found
}

/// The combinations that the record determines, to a relative tolerance.
fn assert_identified(found: &[f64], tolerance: f64) {
    let expected = identifiable(&two_link::truth());
    let pairs: Vec<_> = identifiable(found).into_iter().zip(expected).collect();
    for ((name, value), (_, truth)) in &pairs {
        eprintln!(
            "{name}: {value:.5} for {truth:.5} ({:+.4} %)",
            100.0 * (value / truth - 1.0)
        );
    }
    for ((name, value), (_, truth)) in pairs {
        assert!(
            (value / truth - 1.0).abs() <= tolerance,
            "{name}: {value} for {truth}"
        );
    }
}

/// The start must be far enough off for the result to mean something.
#[test]
fn the_start_is_far_from_the_truth() {
    let start = perturbed(&two_link::truth());
    let (start, truth) = (identifiable(&start), identifiable(&two_link::truth()));
    let off = start
        .iter()
        .zip(&truth)
        .filter(|(s, t)| (s.1 / t.1 - 1.0).abs() > 0.1)
        .count();
    assert!(off >= 5, "{start:?} {truth:?}");
}

#[test]
fn a_noise_free_record_gives_the_parameters_back() {
    let dataset = two_link::simulated(&two_link::truth(), SAMPLES).unwrap();
    let found = fit(&dataset);
    assert_identified(&found.best().parameters, 1e-2);
    // 14 of 19 directions can be determined at all, 13 at the true values (sx2 = 0).
    assert!(
        (5..=6).contains(&found.undetermined),
        "{} undetermined",
        found.undetermined
    );
}

#[test]
fn a_noisy_record_gives_the_parameters_back_and_the_noise() {
    let mut dataset = two_link::simulated(&two_link::truth(), SAMPLES).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let (position, velocity): (f64, f64) = (1e-3, 1e-2);
    let experiment = &mut dataset.experiments[0];
    experiment
        .q
        .iter_mut()
        .for_each(|q| *q += position * normal(&mut random));
    let v = experiment.v.as_mut().unwrap();
    v.iter_mut()
        .for_each(|v| *v += velocity * normal(&mut random));
    let found = fit(&dataset);
    assert_identified(&found.best().parameters, 2e-2);
    // The noise is left: two positions and two velocities per sample.
    let noise = 2.0 * (position.powi(2) + velocity.powi(2));
    let ratio = found.best().objective / noise;
    assert!(
        (ratio - 1.0).abs() < 0.05,
        "J over the noise's variance: {ratio}"
    );
    assert!(
        (5..=6).contains(&found.undetermined),
        "{} undetermined",
        found.undetermined
    );
}
