//! The constants of a robot that effects read and change, by what they are.

use crate::nominal::Nominal;
use crate::plant::Plant;
use crate::scalar::Scalar;

/// A constant of the robot. Bodies and coordinates count from 0, base to tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Constant {
    /// Component of the acceleration of gravity in base axes, m/s².
    Gravity(usize),
    /// Mass of a body, kg.
    Mass(usize),
    /// Component of the first moment m·c of a body in its frame, kg·m: body, axis.
    Moment(usize, usize),
    /// Entry xx, yy, zz, xy, xz, yz of the inertia of a body about the origin of its frame, kg·m²: body, entry.
    Inertia(usize, usize),
    /// Rotor inertia (kg·m²) or mass (kg) at a coordinate.
    Rotor(usize),
    /// Torque or force at a coordinate per unit of its input.
    Gain(usize),
    /// Coulomb friction of a coordinate, N·m or N.
    Coulomb(usize),
    /// Viscous friction of a coordinate, N·m·s/rad or N·s/m.
    Viscous(usize),
}

/// Values of all constants of one simulated robot.
#[derive(Debug, Clone)]
pub struct Constants<D> {
    pub(crate) plant: Plant<D>,
}

impl<D: Scalar> Constants<D> {
    /// At deviations `theta` of the nominal parameters, in tolerances.
    pub fn new(nominal: &Nominal, theta: &[D]) -> Self {
        Constants {
            plant: Plant::new(nominal, theta),
        }
    }

    /// A constant; zero if the robot has no such.
    pub fn get(&self, which: Constant) -> D {
        let p = &self.plant;
        let body = |b: usize| p.bodies.get(b);
        let found = match which {
            Constant::Gravity(i) => p.gravity.get(i).copied(),
            Constant::Mass(b) => body(b).map(|b| b.mass),
            Constant::Moment(b, i) => body(b).and_then(|b| b.moment.get(i).copied()),
            Constant::Inertia(b, i) => body(b).and_then(|b| b.inertia.get(i).copied()),
            Constant::Rotor(j) => p.rotor.get(j).copied(),
            Constant::Gain(j) => p.gain.get(j).copied(),
            Constant::Coulomb(j) => p.coulomb.get(j).copied(),
            Constant::Viscous(j) => p.viscous.get(j).copied(),
        };
        found.unwrap_or_else(D::nil)
    }

    /// Changes a constant; does nothing if the robot has no such.
    pub fn set(&mut self, which: Constant, value: D) {
        let p = &mut self.plant;
        let found = match which {
            Constant::Gravity(i) => p.gravity.get_mut(i),
            Constant::Mass(b) => p.bodies.get_mut(b).map(|b| &mut b.mass),
            Constant::Moment(b, i) => p.bodies.get_mut(b).and_then(|b| b.moment.get_mut(i)),
            Constant::Inertia(b, i) => p.bodies.get_mut(b).and_then(|b| b.inertia.get_mut(i)),
            Constant::Rotor(j) => p.rotor.get_mut(j),
            Constant::Gain(j) => p.gain.get_mut(j),
            Constant::Coulomb(j) => p.coulomb.get_mut(j),
            Constant::Viscous(j) => p.viscous.get_mut(j),
        };
        if let Some(found) = found {
            *found = value;
        }
    }

    /// Adds to a constant; does nothing if the robot has no such.
    pub fn add(&mut self, which: Constant, more: D) {
        let sum = self.get(which) + more;
        self.set(which, sum);
    }

    /// The body that carries the tool point, and the point in its frame, m; `None` for a robot without bodies.
    pub fn tool(&self) -> Option<(usize, [f64; 3])> {
        let last = self.plant.bodies.len().checked_sub(1)?;
        Some((last, self.plant.tool))
    }

    /// Adds a point mass, kg, to a body at a point of its frame, m.
    pub fn add_point_mass(&mut self, body: usize, mass: D, at: [f64; 3]) {
        let [x, y, z] = at;
        let shares = [
            y * y + z * z,
            x * x + z * z,
            x * x + y * y,
            -x * y,
            -x * z,
            -y * z,
        ];
        self.add(Constant::Mass(body), mass);
        for (i, at) in at.into_iter().enumerate() {
            self.add(Constant::Moment(body, i), mass * at);
        }
        for (i, share) in shares.into_iter().enumerate() {
            self.add(Constant::Inertia(body, i), mass * share);
        }
    }
}
