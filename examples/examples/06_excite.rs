//! Finds a motion, within the limits of a robot, from which a record tells most about its parameters.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use std::ops::ControlFlow;

use pid_models::Scara;
use simtrue::dynamics::Dynamics;
use simtrue::fit::excite::{Limits, Settings, excite};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let joints = Scara.dims().nq;
    let limits = Limits {
        q: vec![Some((-1.5, 1.5)); joints],
        v: vec![2.0; joints],
        a: vec![8.0; joints],
        force: vec![f64::INFINITY; joints],
        workspace: None,
    };
    let p: Vec<f64> = Scara.params().iter().map(|p| p.nominal).collect();
    let found = excite(&Scara, &p, &limits, &Settings::default(), &mut |_, _| {
        ControlFlow::Continue(())
    })?;
    println!("condition number {:.1}", found.information.condition);
    for (&place, deviation) in found.params.iter().zip(&found.information.deviations) {
        let info = &Scara.params()[place];
        println!("{:20} ± {deviation:.2e} {}", info.name, info.unit);
    }
    Ok(())
}
