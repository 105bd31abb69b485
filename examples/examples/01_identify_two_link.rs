//! Simulates a declared robot, identifies it from the record and prints the result.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use std::ops::ControlFlow;

use pid_models::TwoLink;
use simtrue::data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use simtrue::dynamics::Dynamics;
use simtrue::fit::ident::{Settings, identify};
use simtrue::fit::integrate::{self, Drive, simulate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let truth: Vec<f64> = TwoLink.params().iter().map(|p| p.nominal).collect();
    let t: Vec<f64> = (0..401).map(|k| 0.01 * f64::from(k)).collect();
    let u: Vec<f64> = t
        .iter()
        .flat_map(|t| [25.0 * (3.0 * t).sin(), 150.0 * (2.0 * t).cos()])
        .collect();
    let hold = InputHold::ZeroOrder;
    let drive = Drive { t: &t, u: &u, hold };
    let settings = integrate::Settings::default();
    let motion = simulate(&TwoLink, &truth, &[0.3, 2.2], &[0.0; 2], &drive, settings)?;

    let joint = |name: &str| JointChannels {
        name: name.into(),
        prismatic: false,
        input: InputQuantity::Current,
        input_unit: "A".into(),
        velocity: VelocityKind::Measured,
    };
    let dataset = Dataset {
        name: "example".into(),
        title: "A simulated record".into(),
        source: "this example".into(),
        license: "CC0-1.0".into(),
        kind: Kind::Simulated,
        input_hold: hold,
        joints: vec![joint("shoulder"), joint("elbow")],
        experiments: vec![Experiment {
            name: "record".into(),
            role: Role::Train,
            note: String::new(),
            nq: 2,
            t,
            q: motion.q,
            v: Some(motion.v),
            u,
            tau: None,
            qref: None,
            missing: 0,
        }],
        warnings: Vec::new(),
    };
    let start: Vec<f64> = truth.iter().map(|p| 1.3 * p).collect();
    let found = identify(
        &TwoLink,
        &dataset,
        &Settings::default(),
        Some(&start),
        &mut |_| ControlFlow::Continue(()),
    )?;
    let best = found.best();
    println!("{}; J = {:.3e}", best.status.reason(), best.objective);
    println!("{} directions are not determined", found.undetermined);
    for ((info, value), deviation) in TwoLink
        .params()
        .iter()
        .zip(&best.parameters)
        .zip(&found.deviations)
    {
        match deviation {
            Some(d) => println!("{:18} {value:10.4} ± {d:.1e} {}", info.name, info.unit),
            None => println!("{:18} not determined by itself", info.name),
        }
    }
    Ok(())
}
