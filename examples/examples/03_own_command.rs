//! The whole command line for a robot of your own. Try
//!
//! ```sh
//! cargo run --release --example 03_own_command -- models
//! cargo run --release --example 03_own_command -- identify carriage FOLDER
//! cargo run --release --example 03_own_command -- diagnose FOLDER --model carriage
//! ```

use simtrue::cli::Entry;
use simtrue::robot;

robot! {
    /// A carriage on a rail.
    pub robot Carriage {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            /// Moving mass.
            mass: kg = 95.0 in 80.0..=110.0;
        }
        link body { mass: mass; com: [_, _, _]; inertia at com: diag(_, _, _); }
        joint x: prismatic about x { base -> body; }
        per joint {
            /// Force of the drive.
            input force: N;
            /// Viscous friction.
            viscous: N*s/m = 200.0 in 100.0..=300.0;
            /// Dry friction.
            dry: N = 20.0 in 10.0..=30.0;
            force = force - viscous*v - dry*tanh(1000 s/m * v);
        }
        emit { second_derivatives }
    }
}

static ROBOTS: [Entry; 1] = [Entry::new(
    "carriage",
    "a carriage on a rail",
    "an example",
    &Carriage,
)];

fn main() -> std::process::ExitCode {
    simtrue::cli::main(&ROBOTS)
}
