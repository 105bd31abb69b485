//! Declares a robot, evaluates its dynamics and their exact derivatives.
#![allow(clippy::print_stdout, reason = "an example prints what it found")]

use simtrue::dynamics::{At, Dynamics, Jacobian};
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
        emit { first_derivatives }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let p = CarriageParams::nominal();
    let u = CarriageInputs { force_x: 100.0 };
    let (q, v) = ([0.0], [0.1]);
    println!("mass matrix {:?} kg", Carriage::mass_matrix(&q, &p));
    let a = Carriage::forward_dynamics(&q, &v, &u, &p)?;
    println!("acceleration at 0.1 m/s under 100 N: {:.5} m/s^2", a[0]);

    // The residual r = M a + b − f and ∂r/∂(q, v, a, u, p), entry by entry.
    let params: Vec<f64> = Carriage.params().iter().map(|p| p.nominal).collect();
    let at = At {
        q: &q,
        v: &v,
        a: &a,
        u: &[100.0],
        p: &params,
    };
    let pattern = Carriage.jacobian_pattern();
    let (mut r, mut values) = ([0.0], vec![0.0; pattern.nnz()]);
    Carriage.residual_jacobian(&at, &mut r, &mut values);
    println!("residual {:.1e} N", r[0]);
    for (place, value) in pattern.cols.iter().zip(&values) {
        println!("derivative by variable {place}: {value}");
    }
    Ok(())
}
