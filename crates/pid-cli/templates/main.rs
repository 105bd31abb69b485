//! A robot of your own, with the whole command line.
//!
//! ```sh
//! cargo run --release -- models
//! cargo run --release -- excite new_robot --out motion
//! cargo run --release -- identify new_robot FOLDER
//! cargo run --release -- diagnose FOLDER --model new_robot
//! ```
//!
//! `FOLDER` holds your records: a `dataset.toml` and CSV files.

use simtrue::cli::Entry;
use simtrue::robot;

robot! {
    /// A link on a motor. Put your own links and joints in its place.
    pub robot NewRobot {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            /// Mass of the link.
            mass: kg = 6.0 in 5.0..=7.0;
            /// Distance of its centre of mass from the axis.
            distance: m = 0.17 in 0.15..=0.19;
            /// Inertia about its centre of mass.
            inertia: kg*m^2 = 0.09 in 0.05..=0.15;
        }
        link upper { mass: mass; com: [0, 0, -distance]; inertia at com: diag(_, inertia, _); }
        joint shoulder: revolute about y { base -> upper; }
        per joint {
            /// Torque of the drive.
            input torque: N*m;
            /// Viscous friction.
            viscous: N*m*s/rad = 0.5 in 0.0..=2.0;
            /// Dry friction.
            dry: N*m = 0.3 in 0.0..=2.0;
            force = torque - viscous*v - dry*tanh(100 s/rad * v);
        }
        emit { second_derivatives }
        // Mass, distance and inertia enter through two combinations. Drop the line with links of your own.
        expect rank 4;
    }
}

static ROBOTS: [Entry; 1] = [Entry::new(
    "new_robot",
    "a link on a motor",
    "values to be replaced by your own",
    &NewRobot,
)];

fn main() -> std::process::ExitCode {
    simtrue::cli::main(&ROBOTS)
}
