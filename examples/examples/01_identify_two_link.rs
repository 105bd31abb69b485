//! Simulates a declared robot, identifies it from the record and prints the result.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use simtrue::synthetic::{Recipe, records};
use simtrue::{dynamics::Dynamics, identify};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let robot = pid_models::TwoLink;
    let truth: Vec<f64> = robot.params().iter().map(|p| 1.1 * p.nominal).collect();
    let recipe = Recipe {
        records: 1,
        seconds: 4.0,
        step: 0.01,
        amplitude: vec![15.0, 80.0],
        highest: 1.0,
        start: vec![0.3, 2.2],
        noise: vec![1e-4, 1e-4, 1e-3, 1e-3],
        outliers: (0.0, 1.0),
    };
    let found = identify(&robot, &records(&robot, &truth, &recipe, 1)?)?;
    println!("{} directions are not determined", found.undetermined);
    for (info, d) in robot.params().iter().zip(&found.deviations) {
        println!("{:18} ± {d:?} {}", info.name, info.unit);
    }
    Ok(())
}
