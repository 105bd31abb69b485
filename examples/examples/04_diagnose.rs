//! Diagnoses a simulated machine that has a spring which its model lacks.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use simtrue::data::Role;
use simtrue::diagnosis::{report::Report, search::Settings};
use simtrue::robot;
use simtrue::synthetic::{Recipe, records};

robot! {
    /// What the engineer declares, with tolerances as ranges.
    pub robot Pendulum {
        gravity: [0, 0, -9.81] m/s^2;
        params { m: kg = 1.5 in 1.43..=1.57; c: m = -0.22 in -0.223..=-0.217; }
        link rod { mass: m; com: [0, 0, c]; inertia at com: diag(_, 0.021 kg*m^2, _); }
        joint hinge: revolute about y { base -> rod; }
        per joint {
            input current: A;
            gain: N*m/A = 1.8 in 1.78..=1.82;
            dry: N*m = 0.25 in 0.15..=0.35;
            viscous: N*m*s/rad = 0.08 in 0.04..=0.12;
            force = gain*current - viscous*v - dry*tanh(40 s/rad * v);
        }
        // Weight is m c: its factors show up only together with the inertia.
        expect rank 4;
        emit { second_derivatives }
    }
}

robot! {
    /// The machine.
    pub robot Machine {
        gravity: [0, 0, -9.81] m/s^2;
        params { stiffness: N*m/rad = 1.0 in 0.0..=5.0; }
        link rod { mass: 1.52 kg; com: [0, 0, -0.221] m; inertia at com: diag(_, 0.021 kg*m^2, _); }
        joint hinge: revolute about y { base -> rod; }
        per joint {
            input current: A;
            force = 1.79 N*m/A * current - 0.1 N*m*s/rad * v
                - 0.28 N*m * tanh(2000 s/rad * v) - stiffness*(q - 0.3 rad);
        }
        emit { second_derivatives }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let recipe = Recipe {
        records: 4,
        seconds: 8.0,
        step: 0.002,
        amplitude: vec![0.8],
        highest: 2.0,
        start: vec![0.0],
        noise: vec![1e-4, 5e-3],
        outliers: (0.0, 1.0),
    };
    let mut data = records(&Machine, &[1.0], &recipe, 7)?;
    // A diagnosis is judged on motion that it never fitted.
    data.experiments[3].role = Role::Test;
    let report = Report::of_dataset(&Pendulum, &data, &Settings::default(), false)?;
    let found = report.diagnosis();
    println!(
        "verdict: {:?}, confidence {:.2}",
        found.verdict, found.confidence
    );
    println!(
        "gap {:.4} -> {:.4}, floor {:.4}",
        found.gap_before, found.gap_after, found.gap_floor
    );
    for effect in &found.effects {
        for p in &effect.parameters {
            let std = p.std.map_or(String::new(), |s| format!(" ± {s:.1e}"));
            println!("{}: {} = {:.4}{std}", effect.effect, p.name, p.value);
        }
    }
    Ok(())
}
