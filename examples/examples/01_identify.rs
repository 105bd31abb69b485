//! Identifies a positioning drive from a simulated record: what was true, what was found, how surely.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use simtrue::synthetic::{Recipe, records};
use simtrue::{dynamics::Dynamics, identify};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (robot, truth) = (pid_models::Emps, [90.0, 210.0, 25.0, -4.0, 1000.0]);
    let recipe = Recipe::new(6.0, &[80.0]);
    let found = identify(&robot, &records(&robot, &truth, &recipe, 1)?)?;
    let values = &found.best().parameters;
    for (i, info) in robot.params().iter().enumerate() {
        let deviation = found.deviations[i].map_or("fixed".into(), |d| format!("± {d:.4}"));
        let (name, unit, found) = (&info.name, &info.unit, values[i]);
        println!("{name:8} {:7} {found:7.4} {deviation} {unit}", truth[i]);
    }
    Ok(())
}
