//! The parameters of the nominal structure, as deviations in units of their tolerances.
//!
//! Per joint k, in this order: mass, centre of mass (3), inertia about it (6), rotor inertia, motor gain, Coulomb friction,
//! viscous friction. A deviation of 1 is one tolerance: `m = m₀ (1 + tol θ)`, `c = c₀ + tol θ`, and so on.

use crate::nominal::{Joint, Nominal};
use crate::rigid::{Body, Hinge, V3};
use crate::scalar::Scalar;

/// Deviations per joint.
pub const PER_JOINT: usize = 14;
/// Place of the motor gain among the deviations of a joint.
pub const GAIN: usize = 11;
/// Names of the deviations of one joint.
pub const NAMES: [&str; PER_JOINT] = [
    "mass",
    "com_x",
    "com_y",
    "com_z",
    "inertia_xx",
    "inertia_yy",
    "inertia_zz",
    "inertia_xy",
    "inertia_xz",
    "inertia_yz",
    "rotor_inertia",
    "motor_gain",
    "coulomb",
    "viscous",
];

/// The nominal structure with parameter values.
#[derive(Debug, Clone)]
pub struct Plant<D> {
    /// Geometry.
    pub hinges: Vec<Hinge>,
    /// Links.
    pub bodies: Vec<Body<D>>,
    /// Rotor inertia per joint.
    pub rotor: Vec<D>,
    /// Torque per unit of input.
    pub gain: Vec<D>,
    /// Coulomb friction.
    pub coulomb: Vec<D>,
    /// Viscous friction.
    pub viscous: Vec<D>,
    /// Gravity in base axes.
    pub gravity: V3<D>,
    /// Tool point in the last link's frame.
    pub tool: V3<f64>,
}

impl<D: Scalar> Plant<D> {
    /// The plant at the deviations `theta` (n × [`PER_JOINT`]).
    pub fn new(nominal: &Nominal, theta: &[D]) -> Self {
        let t = &nominal.tolerance;
        let mut plant = Plant {
            hinges: nominal.hinges(),
            bodies: Vec::with_capacity(nominal.n()),
            rotor: Vec::new(),
            gain: Vec::new(),
            coulomb: Vec::new(),
            viscous: Vec::new(),
            gravity: nominal.gravity.map(D::constant),
            tool: nominal.tool,
        };
        for (j, d) in nominal.joints.iter().zip(theta.chunks_exact(PER_JOINT)) {
            let relative = |x: f64, tolerance: f64, d: D| d * (x * tolerance) + x;
            let mass = relative(j.mass, t.mass_rel, d[0]);
            let com = [0, 1, 2].map(|i| d[1 + i] * t.com_abs_m + j.com[i]);
            let unit = t.inertia_rel * largest_principal(j);
            let central = [0, 1, 2, 3, 4, 5].map(|i| d[4 + i] * unit + j.inertia[i]);
            plant.bodies.push(about_origin(mass, com, central));
            plant
                .rotor
                .push(relative(j.rotor_inertia, t.rotor_inertia_rel, d[10]));
            plant
                .gain
                .push(relative(j.motor_gain, t.motor_gain_rel, d[11]));
            plant
                .coulomb
                .push(relative(j.coulomb, t.friction_rel, d[12]));
            plant
                .viscous
                .push(relative(j.viscous, t.friction_rel, d[13]));
        }
        plant
    }
}

/// Largest principal value of the stated inertia; the largest diagonal entry bounds it well enough as a unit.
fn largest_principal(j: &Joint) -> f64 {
    let [xx, yy, zz, xy, xz, yz] = j.inertia;
    let m = nalgebra::Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    m.symmetric_eigenvalues().max().max(1e-12)
}

/// Inertial parameters about the link's origin from those about the centre of mass (parallel axes).
pub fn about_origin<D: Scalar>(mass: D, com: V3<D>, central: [D; 6]) -> Body<D> {
    let [x, y, z] = com;
    let moment = com.map(|c| c * mass);
    Body {
        mass,
        moment,
        inertia: [
            central[0] + mass * (y * y + z * z),
            central[1] + mass * (x * x + z * z),
            central[2] + mass * (x * x + y * y),
            central[3] - mass * x * y,
            central[4] - mass * x * z,
            central[5] - mass * y * z,
        ],
    }
}
