//! The constants of a robot that effects read and change, by what they are.

use pid_interpret::links;
use pid_interpret::nominal::{self as servo, Role};
use pid_symbolic::program::Element;

use crate::nominal::{DriveKnowledge, Nominal};
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
    /// Entry xx, yy, zz, xy, xz, yz of the inertia of a body about the origin of its frame, kg·m²:
    /// body, entry.
    Inertia(usize, usize),
    /// Rotor inertia (kg·m²) or mass (kg) at a coordinate.
    Rotor(usize),
    /// Torque or force at a coordinate per unit of its input.
    Gain(usize),
    /// Coulomb friction of a coordinate, N·m or N.
    Coulomb(usize),
    /// Viscous friction of a coordinate, N·m·s/rad or N·s/m.
    Viscous(usize),
    /// A gain, share or time of the position loop of a coordinate, in its unit.
    Servo(servo::Gain, usize),
}

/// Values of all constants of one simulated robot.
#[derive(Debug, Clone)]
pub struct Constants<'n, D> {
    nominal: &'n Nominal,
    /// Parameters of the description's robot.
    p: Vec<D>,
    /// In the order of [`links::Links::place`].
    links: Vec<D>,
    gain: Vec<D>,
    coulomb: Vec<D>,
    viscous: Vec<D>,
    /// In the order of [`servo::Gain::ALL`]; empty where no drive has a position loop.
    servo: [Vec<D>; servo::Gain::ALL.len()],
}

impl<'n, D: Scalar + Element> Constants<'n, D> {
    /// At deviations `theta` of the nominal parameters, in tolerances.
    pub fn new(nominal: &'n Nominal, theta: &[D]) -> Self {
        let p = nominal.parameters(theta);
        let of = |role: Role| -> Vec<D> {
            (0..nominal.n())
                .map(|j| {
                    nominal
                        .place(j, role)
                        .map_or_else(D::nil, |i| nominal.value(i, theta))
                })
                .collect()
        };
        Constants {
            nominal,
            links: nominal.links.constants(&p),
            gain: of(Role::Gain),
            coulomb: of(Role::Coulomb),
            viscous: of(Role::Viscous),
            servo: servo::Gain::ALL.map(|gain| match nominal.description.has_servos() {
                true => of(Role::Servo(gain)),
                false => Vec::new(),
            }),
            p,
        }
    }

    /// The robot that the feed-forward of the drives knows: what is stated, or what is stated of the drives; and what
    /// its mass matrix and bias are evaluated with.
    pub fn known_to_drives(nominal: &Nominal) -> (links::Work<D>, DriveKnowledge<D>) {
        let known = nominal.known_to_drives::<D>();
        let links = nominal.links.constants(&known.p);
        (nominal.links.prepare(&known.p, &links), known)
    }

    /// Everything of mass matrix and bias that depends on constants alone.
    pub fn prepared(&self) -> links::Work<D> {
        self.nominal.links.prepare(&self.p, &self.links)
    }

    /// The same for a base that accelerates, m/s² in base axes: the links feel gravity less that (A.
    /// Einstein, Jahrbuch der Radioaktivität 4, 1907, section 17). Does nothing on a robot without bodies.
    pub fn shaken(&mut self, work: &mut links::Work<D>, acceleration: [D; 3]) {
        let still = [0, 1, 2].map(|i| self.get(Constant::Gravity(i)));
        for (i, a) in acceleration.into_iter().enumerate() {
            self.add(Constant::Gravity(i), -a);
        }
        self.nominal.links.renew(work, &self.p, &self.links);
        for (i, g) in still.into_iter().enumerate() {
            self.set(Constant::Gravity(i), g);
        }
    }
}

impl<'n, D: Scalar> Constants<'n, D> {
    /// None of them: for forces that are evaluated apart from a robot. Allocates nothing.
    pub fn none(nominal: &'n Nominal) -> Self {
        Constants {
            nominal,
            p: Vec::new(),
            links: Vec::new(),
            gain: Vec::new(),
            coulomb: Vec::new(),
            viscous: Vec::new(),
            servo: Default::default(),
        }
    }

    /// The robot they are constants of.
    pub fn nominal(&self) -> &'n Nominal {
        self.nominal
    }

    /// A constant; zero if the robot has no such.
    #[inline(always)]
    pub fn get(&self, which: Constant) -> D {
        let found = match which {
            Constant::Gain(j) => self.gain.get(j),
            Constant::Coulomb(j) => self.coulomb.get(j),
            Constant::Viscous(j) => self.viscous.get(j),
            Constant::Servo(gain, j) => self.servo[gain as usize].get(j),
            _ => self.place(which).and_then(|i| self.links.get(i)),
        };
        found.copied().unwrap_or_else(D::nil)
    }

    /// Damping of a coordinate by the voltage that its motor induces while its drive is on, N·m·s/rad or N·s/m; zero
    /// where a description has it in the viscous friction.
    #[inline(always)]
    pub fn induced(&self, j: usize) -> D {
        self.get(Constant::Gain(j)) * self.get(Constant::Servo(servo::Gain::BackEmf, j))
    }

    /// Changes a constant; does nothing if the robot has no such.
    pub fn set(&mut self, which: Constant, value: D) {
        let place = self.place(which);
        let found = match which {
            Constant::Gain(j) => self.gain.get_mut(j),
            Constant::Coulomb(j) => self.coulomb.get_mut(j),
            Constant::Viscous(j) => self.viscous.get_mut(j),
            Constant::Servo(gain, j) => self.servo[gain as usize].get_mut(j),
            _ => place.and_then(|i| self.links.get_mut(i)),
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

    fn place(&self, which: Constant) -> Option<usize> {
        let which = match which {
            Constant::Gravity(i) => links::Constant::Gravity(i),
            Constant::Mass(b) => links::Constant::Mass(b),
            Constant::Moment(b, i) => links::Constant::Moment(b, i),
            Constant::Inertia(b, i) => links::Constant::Inertia(b, i),
            Constant::Rotor(j) => links::Constant::Rotor(j),
            Constant::Gain(_)
            | Constant::Coulomb(_)
            | Constant::Viscous(_)
            | Constant::Servo(..) => return None,
        };
        self.nominal.links.place(which)
    }

    /// The body that carries the tool point, and the point in its frame, m; `None` for a robot
    /// without bodies.
    pub fn tool(&self) -> Option<(usize, [f64; 3])> {
        self.nominal.links.tool()
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
