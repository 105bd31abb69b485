//! Declares a robot and evaluates its dynamics.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use simtrue::robot;

robot! {
    /// A carriage on a rail.
    pub robot Carriage {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            /// Moving mass.
            mass: kg = 95.0 in 10.0..=300.0;
        }
        link body { mass: mass; com: [_, _, _]; inertia at com: diag(_, _, _); }
        joint x: prismatic about x { base -> body; }
        per joint {
            /// Force of the drive.
            input force: N;
            /// Viscous friction.
            viscous: N*s/m = 200.0 in 0.0..=1000.0;
            /// Dry friction.
            dry: N = 20.0 in 0.0..=100.0;
            force = force - viscous*v - dry*tanh(1000 s/m * v);
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let p = CarriageParams::nominal();
    let u = CarriageInputs { force_x: 100.0 };
    let (q, v) = ([0.0], [0.1]);
    println!("mass matrix {:?} kg", Carriage::mass_matrix(&q, &p));
    let a = Carriage::forward_dynamics(&q, &v, &u, &p)?;
    println!("acceleration at 0.1 m/s under 100 N: {:.5} m/s^2", a[0]);
    for parameter in CarriageParam::ALL {
        println!("{} in {}", parameter.name(), parameter.unit());
    }
    Ok(())
}
