//! Mass matrix and bias of a URDF or MJCF at random states, as lines of JSON, to compare with other
//! libraries.
//!
//! `cargo run --release -p pid-interpret --example dynamics_of_file FILE [STATES] [WRITTEN]`
//!
//! WRITTEN is a URDF with the inertias that were read: what no body has is mended there.

use std::error::Error;

use pid_derive::mechanism::Mechanism;
use pid_interpret::Model;
use pid_runtime::dynamics::{At, Dynamics};
use pid_symbolic::random::Random;
use pid_urdf::{Description, Guess, Missing, Options, Reading};

#[allow(clippy::print_stdout, reason = "the output of the example")]
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let file = arguments.first().ok_or("give a URDF or MJCF")?;
    let states: usize = arguments.get(1).map_or(Ok(5), |n| n.parse())?;
    let (mechanism, names, warnings) = match file.to_ascii_lowercase().ends_with(".urdf") {
        true => urdf(file, arguments.get(2))?,
        false => mjcf(file)?,
    };
    let of = |body: usize| &names[body];
    let follows: Vec<_> = (mechanism.bodies.iter().enumerate())
        .filter_map(|(k, body)| {
            let f = body.follows?;
            Some((of(k), of(f.body), f.ratio, f.offset))
        })
        .collect();
    let moving: Vec<_> = (0..names.len())
        .filter(|&k| mechanism.bodies[k].follows.is_none())
        .map(of)
        .collect();
    println!(
        "{}",
        serde_json::json!({ "joints": moving, "follows": follows, "warnings": warnings })
    );
    let model = Model::new(&mechanism.robot())?;
    let (n, mut random) = (model.dims().nq, Random::new(5));
    for _ in 0..states {
        let mut draw = || -> Vec<f64> { (0..n).map(|_| random.uniform(-1.5, 1.5)).collect() };
        let (q, v, zero) = (draw(), draw(), vec![0.0; n]);
        let at = At {
            q: &q,
            v: &v,
            a: &zero,
            u: &zero,
            p: &[],
        };
        let (mut m, mut b) = (vec![0.0; n * (n + 1) / 2], vec![0.0; n]);
        model.mass_matrix(&at, &mut m);
        model.bias(&at, &mut b);
        println!("{}", serde_json::json!({ "q": q, "v": v, "m": m, "b": b }));
    }
    Ok(())
}

/// The mechanism, names of its joints, and warnings.
type Read = (Mechanism, Vec<String>, Vec<String>);

fn urdf(file: &str, written: Option<&String>) -> Result<Read, Box<dyn Error>> {
    let mut reading = Reading::default();
    reading.missing = Missing::Guess(Guess::default());
    let description = Description::read_with(file, &reading)?;
    if let Some(written) = written {
        let options = Options::default();
        let free = pid_urdf::robot(&description, &options)?;
        let value = |name: &str| {
            let param = free.params.iter().find(|p| p.name == name);
            param.map(|p| p.nominal)
        };
        std::fs::write(written, pid_urdf::write(&description, &options, value).text)?;
    }
    let names = (description.order.iter())
        .map(|&k| &description.joints[k])
        .filter(|joint| joint.moves())
        .map(|joint| joint.name.clone());
    let mechanism = description.mechanism([0.0, 0.0, -9.81]);
    Ok((mechanism, names.collect(), description.warnings.clone()))
}

fn mjcf(file: &str) -> Result<Read, Box<dyn Error>> {
    let model = pid_mjcf::Mjcf::read(file)?;
    let names = model.mechanism.bodies.iter().map(|body| body.joint.clone());
    let names = names.collect();
    Ok((model.mechanism, names, model.warnings))
}
