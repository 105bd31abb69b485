//! Cost of user constraints: an identification with a speed limit at every node and a bound on a
//! product of parameters, by the structured linear system and by that of the whole matrix.
//!
//! ```text
//! pid-studies constrained [N,N,…]
//! ```
//!
//! The two-link robot under sums of sines with noise and Stribeck friction (as `scaling`),
//! trapezoidal rule, starts at the true values. The limit is a tenth below the largest speed of the
//! record. Seconds are of the processor.

use std::ops::ControlFlow;
use std::sync::Arc;

use cpu_time::ProcessTime;
use pid_fit::transcribe::{
    Constrained, ConstrainedKkt, Constraint, FullDiscretization, Place, Scheme, Sense,
};
use pid_models::TwoLink;
use pid_nlp::check_point;
use pid_nlp::solver::kkt::Kkt;
use pid_nlp::solver::kkt::sparse::SparseKkt;
use pid_nlp::solver::{self, ip};
use pid_runtime::dynamics::Dynamics;
use pid_runtime::generic::functions::{Exact, GenericFunction};
use pid_runtime::num_dual::DualNum;
use pid_tests::derivatives::setup;
use pid_tests::mismatched::{record, sines};
use pid_tests::recorded;

use crate::Failure;

/// Square of the shoulder's speed below a limit.
struct Speed(f64);

impl GenericFunction for Speed {
    fn outputs(&self) -> usize {
        1
    }
    fn variables(&self) -> Option<Vec<usize>> {
        Some(vec![2])
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], _: &[D], out: &mut [D]) {
        out[0] = x[2] * x[2] - self.0;
    }
}

/// Mass times offset of the forearm's centre of mass below a limit.
struct Moment(f64);

impl GenericFunction for Moment {
    fn outputs(&self) -> usize {
        1
    }
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, _: &[D], p: &[D], out: &mut [D]) {
        out[0] = p[1] * p[6] - self.0;
    }
}

/// Runs the command with its words.
///
/// # Errors
/// What stops it.
pub fn run(words: &[String]) -> Result<(), Failure> {
    let sizes = words.first().cloned().unwrap_or("300,1000,3000".to_owned());
    println!("samples  system      iterations            J   violation   seconds  ms/iteration");
    for samples in sizes.split(',') {
        let samples: usize = samples.parse()?;
        let dataset = record(&TwoLink, &sines, samples, 0.02)?;
        let track = recorded(&dataset.experiments[0]).ok_or("the record has velocities")?;
        let p: Vec<f64> = TwoLink.params().iter().map(|i| i.nominal).collect();
        let speeds = track.measured.iter().skip(2).step_by(4);
        let fastest = speeds.fold(0.0_f64, |a, v| a.max(v * v));
        let mut options = setup(&TwoLink, Scheme::Trapezoidal, false, false);
        for (j, info) in TwoLink.params().iter().enumerate() {
            (options.lower[j], options.upper[j]) = (info.lower, info.upper);
            options.scale[j] = info.nominal.abs().max(0.1);
        }
        for structured in [true, false] {
            let full =
                FullDiscretization::new(&TwoLink, std::slice::from_ref(&track), options.clone());
            let start = full.starting_point(&p);
            let held = full.fixed_parameters();
            let constraint = |name: &str, place, function| Constraint {
                name: name.to_owned(),
                place,
                sense: Sense::AtMost,
                function,
            };
            let constraints = vec![
                constraint(
                    "speed",
                    Place::EveryNode,
                    Arc::new(Exact::new(Speed(0.81 * fastest), 4, p.len())) as _,
                ),
                constraint(
                    "moment",
                    Place::Parameters,
                    Arc::new(Exact::new(Moment(0.9 * p[1] * p[6]), 4, p.len())) as _,
                ),
            ];
            let mut problem = Constrained::new(full, constraints)?;
            let x0 = problem.extend(&start);
            let mut kkt: Box<dyn Kkt> = match structured {
                true => Box::new(ConstrainedKkt::new(&problem, &held)),
                false => Box::new(SparseKkt::new(&problem)),
            };
            let settings = solver::Settings {
                objective_scale: samples as f64,
                mu_start: 1e-2,
                max_iterations: 500,
                ..solver::Settings::default()
            };
            let clock = ProcessTime::now();
            let solution = ip::solve(&mut problem, kkt.as_mut(), &x0, &settings, &mut |_, _| {
                ControlFlow::Continue(())
            });
            let seconds = clock.elapsed().as_secs_f64();
            let check = check_point(&mut problem, &solution.x, &solution.lambda);
            let iterations = solution.log.len().saturating_sub(1);
            println!(
                "{samples:7}  {:10} {iterations:11} {:12.6e} {:11.1e} {seconds:9.3} {:13.2}  {}",
                if structured { "structured" } else { "whole" },
                solution.objective,
                check.primal_inf,
                1e3 * seconds / iterations.max(1) as f64,
                solution.status.reason()
            );
        }
    }
    Ok(())
}
