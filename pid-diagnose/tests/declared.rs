//! A declared robot against records of a robot that has a spring more: no `nominal.toml`, the same verdict as with one.

use std::fmt::Write;
use std::path::PathBuf;

use pid_diagnose::diagnose::Settings;
use pid_diagnose::report::Report;
use pid_runtime::data::InputHold;
use pid_runtime::dynamics::Dynamics;
use pid_runtime::integrate::{self, Drive, simulate};
use pid_runtime::robot;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

robot! {
    /// What the engineer declares.
    pub robot Pendulum {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            m: kg = 1.5 in 1.43..=1.57;
            c: m = -0.22 in -0.223..=-0.217;
        }
        link rod { mass: m; com: [0, 0, c]; inertia at com: diag(_, 0.021 kg*m^2, _); }
        joint hinge: revolute about y { base -> rod; }
        per joint {
            input current: A;
            gain: N*m/A = 1.8 in 1.78..=1.82;
            dry: N*m = 0.25 in 0.15..=0.35;
            viscous: N*m*s/rad = 0.08 in 0.04..=0.12;
            force = gain*current - viscous*v - dry*tanh(40 s/rad * v);
        }
        emit { second_derivatives }
        expect rank 4;
    }
}

robot! {
    /// The machine.
    pub robot Machine {
        gravity: [0, 0, -9.81] m/s^2;
        params { stiffness: N*m/rad = 1.0 in 0.0..=5.0; rest: rad = 0.3 fixed; }
        link rod { mass: 1.52 kg; com: [0, 0, -0.221] m; inertia at com: diag(_, 0.021 kg*m^2, _); }
        joint hinge: revolute about y { base -> rod; }
        per joint {
            input current: A;
            force = 1.79 N*m/A * current - 0.1 N*m*s/rad * v - 0.28 N*m * tanh(2000 s/rad * v) - stiffness*(q - rest);
        }
        emit { first_derivatives }
    }
}

const STEP: f64 = 0.004;
const SAMPLES: u32 = 1500;

/// A data folder of the machine without `nominal.toml`.
fn folder() -> PathBuf {
    let out = std::env::temp_dir().join(format!("pid-declared-{}", std::process::id()));
    std::fs::create_dir_all(&out).expect("a folder");
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut dataset = String::from(
        "name = \"pendulum\"\ntitle = \"A pendulum with a spring\"\nsource = \"simulated\"\nlicense = \"none\"\nkind = \"simulated\"\n\n\
         [[joint]]\nname = \"hinge\"\ntype = \"revolute\"\ninput = \"current\"\ninput_unit = \"A\"\nvelocity = \"absent\"\n",
    );
    for (record, role) in ["train", "train", "test"].iter().enumerate() {
        let waves: [(f64, f64, f64); 4] = std::array::from_fn(|k| {
            let f = 0.15 + 0.4 * k as f64 + 0.1 * random.random::<f64>();
            (
                f,
                2.2 / (1.0 + k as f64),
                std::f64::consts::TAU * random.random::<f64>(),
            )
        });
        let t: Vec<f64> = (0..SAMPLES).map(|k| STEP * f64::from(k)).collect();
        let u: Vec<f64> = (t.iter())
            .map(|t| {
                let wave =
                    |(f, a, p): &(f64, f64, f64)| a * (std::f64::consts::TAU * f * t + p).sin();
                waves.iter().map(wave).sum()
            })
            .collect();
        let p: Vec<f64> = Machine.params().iter().map(|p| p.nominal).collect();
        let drive = Drive {
            t: &t,
            u: &u,
            hold: InputHold::ZeroOrder,
        };
        let motion = simulate(
            &Machine,
            &p,
            &[0.1],
            &[0.0],
            &drive,
            integrate::Settings::default(),
        )
        .expect("a motion");
        let mut text = String::from("t,q1,u1\n");
        for ((t, u), q) in t.iter().zip(&u).zip(&motion.q) {
            // Uniform noise of standard deviation 1e-4.
            let noise = 1e-4 * 12f64.sqrt() * (random.random::<f64>() - 0.5);
            writeln!(text, "{t:.3},{:.9},{u:.9}", q + noise).expect("a text");
        }
        let file = format!("r{record}.csv");
        std::fs::write(out.join(&file), text).expect("a record");
        write!(
            dataset,
            "\n[[experiment]]\nfile = \"{file}\"\nrole = \"{role}\"\n"
        )
        .expect("a text");
    }
    std::fs::write(out.join("dataset.toml"), dataset).expect("a file");
    std::fs::write(
        out.join("measurement.toml"),
        "[[joint]]\nname = \"hinge\"\nq_noise_std = 1e-4\n",
    )
    .expect("a file");
    out
}

#[test]
fn the_spring_is_found_without_a_nominal_file() {
    let folder = folder();
    let report = Report::of_model(&Pendulum, &folder, &Settings::default(), false);
    std::fs::remove_dir_all(&folder).expect("the folder");
    let report = report.expect("a diagnosis");
    let d = report.diagnosis();
    assert_eq!((d.effect.as_str(), d.joint), ("spring", Some(1)), "{d:?}");
    assert!(d.gap_after < 0.2 * d.gap_before, "{d:?}");
    let stiffness = (d.effects[0].parameters.iter())
        .find(|p| p.name.contains("stiff"))
        .expect("a stiffness");
    let error = stiffness.value - 1.0;
    assert!(error.abs() < 0.1, "{stiffness:?}");
    // The tolerance of the gain is all that fixes the scale: 0.55 of 0.02 in 1.8.
    let std = stiffness.std.expect("an interval");
    assert!(error.abs() < 4.0 * std && std < 0.02, "{stiffness:?}");
}
