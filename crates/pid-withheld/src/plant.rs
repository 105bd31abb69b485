//! The study's own reading of a description, as deviations in units of their tolerances.
//!
//! Per joint k, in this order: mass, centre of mass (3), inertia about it (6), rotor inertia, motor
//! gain, Coulomb friction, viscous friction. A deviation of 1 is one tolerance: `m = m₀ + Δm θ`,
//! and so on.

use nalgebra::DMatrix;
use pid_derive::model::{Expr, JointKind};
use pid_interpret::nominal::{Nominal, Role};

use crate::linkage::{Linkage, Surroundings};
use crate::rigid::{Body, Hinge, M3, Number, V3};

/// Deviations per joint.
pub const PER_JOINT: usize = 14;
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

impl<D: Number> Plant<D> {
    /// The plant at the deviations `theta` (n × [`PER_JOINT`]) of a chain or tree of driven links;
    /// `tool` in the last link's frame.
    pub fn new(description: &Nominal, theta: &[D]) -> Self {
        let robot = description.robot();
        let mut plant = Plant {
            hinges: Vec::new(),
            bodies: Vec::new(),
            rotor: Vec::new(),
            gain: Vec::new(),
            coulomb: Vec::new(),
            viscous: Vec::new(),
            gravity: [0, 1, 2].map(|i| D::from(number(&robot.gravity[i]))),
            tool: description.measurement().tool.unwrap_or([0.0; 3]),
        };
        for (k, (joint, d)) in robot
            .joints
            .iter()
            .zip(theta.chunks_exact(PER_JOINT))
            .enumerate()
        {
            let (revolute, axis) = match joint.kind {
                JointKind::Prismatic(axis) => (false, axis),
                JointKind::Revolute(axis) => (true, axis),
                // A description of a tree has no other kinds.
                _ => (true, [f64::NAN; 3]),
            };
            plant.hinges.push(Hinge {
                parent: joint.parent,
                revolute,
                axis,
                origin: [0, 1, 2].map(|i| number(&joint.origin[i])),
                rotation: rpy([0, 1, 2].map(|i| number(&joint.rpy[i]))),
            });
            let (mut values, mut half_widths) = ([0.0; PER_JOINT], [0.0; PER_JOINT]);
            for t in description
                .tolerances()
                .iter()
                .filter(|t| t.joint == Some(k))
            {
                if let Some(i) = place(t.role) {
                    (values[i], half_widths[i]) = (t.nominal, t.half_width);
                }
            }
            let x = |i: usize| d[i] * half_widths[i] + values[i];
            plant.bodies.push(about_origin(
                x(0),
                [x(1), x(2), x(3)],
                [x(4), x(5), x(6), x(7), x(8), x(9)],
            ));
            plant.rotor.push(x(10));
            plant.gain.push(x(11));
            plant.coulomb.push(x(12));
            plant.viscous.push(x(13));
        }
        plant
    }

    /// Its links, ready to be evaluated.
    pub fn linkage(&self) -> Linkage<D> {
        Linkage::new(&self.hinges, &self.bodies, self.tool)
    }
}

impl Plant<f64> {
    /// `M(q)` without rotors and `b(q, v)`, the torques at zero acceleration, without a force on the
    /// tool.
    pub(crate) fn mass_and_bias(&self, q: &[f64], v: &[f64]) -> (DMatrix<f64>, Vec<f64>) {
        let n = q.len();
        let around = Surroundings {
            gravity: self.gravity,
            tip_force: None,
        };
        let (mut mass, mut bias) = (vec![0.0; n * n], vec![0.0; n]);
        self.linkage()
            .mass_and_bias(&around, (q, v), &mut mass, &mut bias);
        (DMatrix::from_row_slice(n, n, &mass), bias)
    }
}

/// Inertial parameters about the link's origin from those about the centre of mass (parallel axes).
pub fn about_origin<D: Number>(mass: D, com: V3<D>, central: [D; 6]) -> Body<D> {
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

/// Place of a role among the values of a joint; `None` for what is no value of the robot.
fn place(role: Role) -> Option<usize> {
    match role {
        Role::Mass => Some(0),
        Role::CenterOfMass(k) => Some(1 + k),
        Role::Inertia(k) => Some(4 + k),
        Role::RotorInertia => Some(10),
        Role::Gain => Some(11),
        Role::Coulomb => Some(12),
        Role::Viscous => Some(13),
        _ => None,
    }
}

/// A description of a tree states numbers where the language of robots allows expressions.
fn number(x: &Expr) -> f64 {
    match x {
        Expr::Num(x) => *x,
        _ => f64::NAN,
    }
}

/// Rotation `Rz(yaw) Ry(pitch) Rx(roll)`.
fn rpy([r, p, y]: [f64; 3]) -> M3<f64> {
    let ((sr, cr), (sp, cp), (sy, cy)) = (r.sin_cos(), p.sin_cos(), y.sin_cos());
    [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
}
