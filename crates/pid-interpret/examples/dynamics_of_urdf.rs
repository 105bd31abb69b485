//! Mass matrix and bias of a URDF at random states, as lines of JSON, to compare with other libraries.
//!
//! `cargo run --release -p pid-interpret --example dynamics_of_urdf FILE WRITTEN [STATES]`
//!
//! WRITTEN is the file with the inertias that were read: what no body has is mended there.

use std::error::Error;

use pid_interpret::Model;
use pid_runtime::dynamics::{At, Dynamics};
use pid_symbolic::random::Random;
use pid_urdf::{Description, Guess, Inertias, Missing, Options, Reading};

#[allow(clippy::print_stdout, reason = "the output of the example")]
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, written, ..] = &arguments[..] else {
        return Err("give a URDF and a file to write".into());
    };
    let states: usize = arguments.get(2).map_or(Ok(5), |n| n.parse())?;
    let mut reading = Reading::default();
    reading.missing = Missing::Guess(Guess::default());
    let description = Description::read_with(file, &reading)?;
    let options = Options::default();
    let free = pid_urdf::robot(&description, &options)?;
    let value = |name: &str| {
        free.params
            .iter()
            .find(|p| p.name == name)
            .map(|p| p.nominal)
    };
    std::fs::write(written, pid_urdf::write(&description, &options, value).text)?;

    let mut numbers = Options::default();
    numbers.inertias = Inertias::Numbers;
    numbers.friction = false;
    let model = Model::new(&pid_urdf::robot(&description, &numbers)?)?;
    let follows: Vec<_> = (description.joints.iter())
        .filter_map(|joint| {
            let mimic = joint.mimic?;
            let leader = &description.joints[mimic.joint].name;
            Some((&joint.name, leader, mimic.multiplier, mimic.offset))
        })
        .collect();
    let moving: Vec<_> = (description.order.iter())
        .map(|&k| &description.joints[k])
        .filter(|joint| joint.is_free())
        .map(|joint| &joint.name)
        .collect();
    let warnings = description.warnings.len();
    println!(
        "{}",
        serde_json::json!({ "joints": moving, "follows": follows, "warnings": warnings })
    );
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
