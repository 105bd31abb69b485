//! The parameters of the nominal structure, as deviations in units of their tolerances.
//!
//! Per joint k, in this order: mass, centre of mass (3), inertia about it (6), rotor inertia, motor gain, Coulomb friction,
//! viscous friction. A deviation of 1 is one tolerance: `m = m₀ + Δm θ`, and so on.

use crate::linkage::Linkage;
use crate::nominal::Nominal;
use crate::rigid::{Body, Hinge, V3};
use crate::scalar::Scalar;

/// Deviations per joint.
pub const PER_JOINT: usize = 14;
/// Place of the motor gain among the deviations of a joint.
pub const GAIN: usize = 11;
/// Place of Coulomb friction.
pub const COULOMB: usize = 12;
/// Place of viscous friction.
pub const VISCOUS: usize = 13;
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
            let x = |i: usize| d[i] * j.half_widths[i] + j.values[i];
            plant.bodies.push(about_origin(
                x(0),
                [x(1), x(2), x(3)],
                [x(4), x(5), x(6), x(7), x(8), x(9)],
            ));
            plant.rotor.push(x(10));
            plant.gain.push(x(GAIN));
            plant.coulomb.push(x(COULOMB));
            plant.viscous.push(x(VISCOUS));
        }
        plant
    }

    /// Its links, ready to be evaluated.
    pub fn linkage(&self) -> Linkage<D> {
        Linkage::new(&self.hinges, &self.bodies, self.tool)
    }
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
