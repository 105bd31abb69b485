//! Identifies a positioning drive from a simulated record: what was true, what was found, how surely.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use simtrue::synthetic::{Recipe, records};
use simtrue::{dynamics::Dynamics, identify};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (robot, truth) = (pid_models::Emps, [90.0, 210.0, 25.0, -4.0, 1000.0]);
    let recipe = Recipe {
        records: 2,
        seconds: 6.0,
        step: 0.002,
        amplitude: vec![80.0],
        highest: 1.5,
        start: vec![0.0],
        noise: vec![1e-5, 1e-4],
        outliers: (0.0, 1.0),
    };
    let found = identify(&robot, &records(&robot, &truth, &recipe, 1)?)?;
    let values = &found.runs[found.best].parameters;
    for (i, info) in robot.params().iter().enumerate() {
        let deviation = found.deviations[i].map_or("fixed".into(), |d| format!("± {d:.4}"));
        println!(
            "{:8} {:7} {:7.4} {deviation} {}",
            info.name, truth[i], values[i], info.unit
        );
    }
    Ok(())
}
