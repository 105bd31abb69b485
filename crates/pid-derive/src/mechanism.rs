//! A tree of driven bodies in numbers: what readers of robot files make, whatever their format.
//! [`Mechanism::robot`] makes a robot without parameters of it.
//!
//! Links that are joined rigidly are one body here. The frame of a body is that of the link that its
//! joint carries. All values are in SI units.

use crate::model::{About, Affine, Expr, Inertial, Input, Joint, JointKind, Link, Robot, Tensor};

/// A tree of bodies, parents first.
#[derive(Debug, Clone, PartialEq)]
pub struct Mechanism {
    /// Name of the robot, as the name of a type.
    pub name: String,
    /// Gravity in the frame of the base, m/s².
    pub gravity: [f64; 3],
    /// Moving bodies, depth first from the base, in the order of the file.
    pub bodies: Vec<Body>,
}

/// A moving body and the joint that carries it.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Name of the joint as an identifier; no other body has it.
    pub joint: String,
    /// Name of the link that the joint carries, as written.
    pub link: String,
    /// Whether the joint slides; it turns otherwise.
    pub prismatic: bool,
    /// Axis in the frame of the body, of unit length.
    pub axis: [f64; 3],
    /// Index of the body that carries the joint, `None` for the base.
    pub parent: Option<usize>,
    /// Place of the joint in the frame of the parent at position zero, m.
    pub origin: [f64; 3],
    /// Roll, pitch and yaw of that place, rad.
    pub rpy: [f64; 3],
    /// Another joint that this one follows.
    pub follows: Option<Follows>,
    /// Range of the position, rad or m.
    pub limits: Option<(f64, f64)>,
    /// Mass, kg; zero if the file states none.
    pub mass: f64,
    /// Centre of mass in the frame of the body, m.
    pub com: [f64; 3],
    /// Inertia about the centre of mass in the axes of the body, xx, yy, zz, xy, xz, yz, kg·m².
    pub inertia: [f64; 6],
    /// Where mass and inertia come from.
    pub source: InertiaSource,
    /// Rotor inertia or mass at the joint, kg·m² or kg; `None` if it is not stated.
    pub rotor: Option<f64>,
    /// Coulomb friction, N·m or N; `None` if it is not stated.
    pub coulomb: Option<f64>,
    /// Viscous friction, N·m·s/rad or N·s/m; `None` if it is not stated.
    pub viscous: Option<f64>,
    /// Largest torque or force of the drive, N·m or N.
    pub effort: Option<f64>,
    /// Largest velocity, rad/s or m/s.
    pub speed: Option<f64>,
}

/// `ratio · position + offset` of another joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Follows {
    /// Index of the body that this joint carries; it follows no other.
    pub body: usize,
    /// Ratio.
    pub ratio: f64,
    /// Offset, rad or m.
    pub offset: f64,
}

/// Where mass and inertia of a body come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum InertiaSource {
    /// The file states them.
    Stated,
    /// The file states an inertia that no body has; this is the nearest one that a body has.
    Corrected,
    /// From the geometry of the link, or in place of a mass that the file does not state.
    Guessed,
}

/// A frame in another one: `x ↦ R x + o`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// R, row by row.
    pub rotation: [[f64; 3]; 3],
    /// o, m.
    pub origin: [f64; 3],
}

/// Positions of joint k in three configurations: `start + step·k`, so that no two axes stay parallel.
const CONFIGURATIONS: [(f64, f64); 3] = [(0.3, 0.7), (-0.9, 1.1), (1.7, -0.6)];
/// A joint that feels less than this share of what it carries turns it about its own axis.
const NOTHING: f64 = 1e-12;

/// The identity matrix.
const UNIT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl Place {
    /// The frame itself.
    pub const IDENTITY: Self = Self {
        rotation: UNIT,
        origin: [0.0; 3],
    };

    /// By origin and `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    pub fn new(origin: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Self {
        let ((sx, cx), (sy, cy), (sz, cz)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
        let rotation = [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ];
        Self { rotation, origin }
    }

    /// By rotation about an axis of unit length (Rodrigues), or translation along it.
    pub fn moved(prismatic: bool, axis: [f64; 3], position: f64) -> Self {
        if prismatic {
            return Self {
                origin: axis.map(|x| x * position),
                ..Self::IDENTITY
            };
        }
        let [x, y, z] = axis;
        let ((s, c), t) = (position.sin_cos(), 1.0 - position.cos());
        let rotation = [
            [c + x * x * t, x * y * t - z * s, x * z * t + y * s],
            [x * y * t + z * s, c + y * y * t, y * z * t - x * s],
            [x * z * t - y * s, y * z * t + x * s, c + z * z * t],
        ];
        Self {
            rotation,
            origin: [0.0; 3],
        }
    }

    /// The frame `inner`, given in this one, in the frame that this one is given in.
    pub fn then(&self, inner: &Self) -> Self {
        let (a, b) = (&self.rotation, &inner.rotation);
        let entry = |i: usize, j: usize| (0..3).map(|k| a[i][k] * b[k][j]).sum();
        Self {
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))),
            origin: self.point(inner.origin),
        }
    }

    /// A point of the inner frame in the outer one.
    pub fn point(&self, x: [f64; 3]) -> [f64; 3] {
        let turned = self.vector(x);
        std::array::from_fn(|i| turned[i] + self.origin[i])
    }

    /// A direction of the inner frame in the outer one.
    pub fn vector(&self, x: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| (0..3).map(|k| self.rotation[i][k] * x[k]).sum())
    }

    /// `R I Rᵀ` of a tensor xx, yy, zz, xy, xz, yz. The identity leaves it exactly as it is.
    pub fn tensor(&self, inertia: [f64; 6]) -> [f64; 6] {
        let r = &self.rotation;
        if *r == UNIT {
            return inertia;
        }
        let [xx, yy, zz, xy, xz, yz] = inertia;
        let t = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let entry = |i: usize, j: usize| -> f64 {
            let row = |k: usize| (0..3).map(|l| r[i][k] * t[k][l] * r[j][l]).sum::<f64>();
            (0..3).map(row).sum()
        };
        [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(i, j)| entry(i, j))
    }

    /// The outer frame in the inner one.
    pub fn inverse(&self) -> Self {
        let r = &self.rotation;
        let back = Self {
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| r[j][i])),
            origin: [0.0; 3],
        };
        Self {
            origin: back.vector(self.origin).map(|x| -x),
            ..back
        }
    }

    /// Roll, pitch and yaw. Exact to rounding at a pitch of ±90° too, where only the sum or the
    /// difference of roll and yaw is determined.
    pub fn rpy(&self) -> [f64; 3] {
        let r = &self.rotation;
        let yaw = r[1][0].atan2(r[0][0]);
        let (s, c) = yaw.sin_cos();
        // Rz(−yaw) R = Ry(pitch) Rx(roll), whatever yaw is in the degenerate case.
        let pitch = (-r[2][0]).atan2(c * r[0][0] + s * r[1][0]);
        let roll = (s * r[0][2] - c * r[1][2]).atan2(c * r[1][1] - s * r[0][1]);
        [roll, pitch, yaw]
    }
}

/// Mass, centre of mass, and inertia about it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distribution {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub com: [f64; 3],
    /// Inertia about it, xx, yy, zz, xy, xz, yz, kg·m².
    pub inertia: [f64; 6],
}

impl Distribution {
    /// The same in the frame that `place` is given in.
    pub fn placed(&self, place: &Place) -> Self {
        Self {
            mass: self.mass,
            com: place.point(self.com),
            inertia: place.tensor(self.inertia),
        }
    }

    /// Both together, in one frame. A part without mass adds its inertia as it is.
    pub fn with(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let mean = |k: usize| (self.mass * self.com[k] + other.mass * other.com[k]) / mass;
        let com = match (self.mass, other.mass) {
            (_, 0.0) => self.com,
            (0.0, _) => other.com,
            _ if mass == 0.0 => self.com,
            _ => [0, 1, 2].map(mean),
        };
        let (a, b) = (self.about(com), other.about(com));
        Self {
            mass,
            com,
            inertia: std::array::from_fn(|k| a[k] + b[k]),
        }
    }

    /// Inertia about a point.
    pub fn about(&self, point: [f64; 3]) -> [f64; 6] {
        let d: [f64; 3] = std::array::from_fn(|k| self.com[k] - point[k]);
        let m = self.mass;
        let [xx, yy, zz, xy, xz, yz] = self.inertia;
        [
            xx + m * (d[1] * d[1] + d[2] * d[2]),
            yy + m * (d[0] * d[0] + d[2] * d[2]),
            zz + m * (d[0] * d[0] + d[1] * d[1]),
            xy - m * d[0] * d[1],
            xz - m * d[0] * d[2],
            yz - m * d[1] * d[2],
        ]
    }

    /// What a joint at `point` with this axis feels: inertia about the axis, kg·m², or mass, kg.
    pub fn felt(&self, prismatic: bool, point: [f64; 3], axis: [f64; 3]) -> f64 {
        match prismatic {
            true => self.mass,
            false => about_axis(self.about(point), axis),
        }
    }
}

/// `nᵀ I n` of a tensor xx, yy, zz, xy, xz, yz.
pub fn about_axis([xx, yy, zz, xy, xz, yz]: [f64; 6], [x, y, z]: [f64; 3]) -> f64 {
    xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
}

impl Body {
    /// Its mass distribution.
    pub fn distribution(&self) -> Distribution {
        Distribution {
            mass: self.mass,
            com: self.com,
            inertia: self.inertia,
        }
    }

    /// Place of its frame in that of its parent at a position of its joint.
    pub fn place(&self, position: f64) -> Place {
        let moved = Place::moved(self.prismatic, self.axis, position);
        Place::new(self.origin, self.rpy).then(&moved)
    }
}

impl Mechanism {
    /// For each body itself and all that it carries, in its own frame, at positions of the joints.
    ///
    /// # Panics
    /// If there are not as many positions as bodies.
    pub fn carried(&self, positions: &[f64]) -> Vec<Distribution> {
        assert_eq!(positions.len(), self.bodies.len(), "one position per body");
        let mut out: Vec<Distribution> = self.bodies.iter().map(Body::distribution).collect();
        for k in (0..self.bodies.len()).rev() {
            if let Some(parent) = self.bodies[k].parent {
                let child = out[k].placed(&self.bodies[k].place(positions[k]));
                out[parent] = out[parent].with(&child);
            }
        }
        out
    }

    /// Inertia about its axis, or mass, that each joint moves at these positions, the other joints
    /// held; without rotors, kg·m² or kg.
    ///
    /// # Panics
    /// As [`carried`](Self::carried).
    pub fn felt(&self, positions: &[f64]) -> Vec<f64> {
        let carried = self.carried(positions);
        let each = self.bodies.iter().zip(&carried);
        each.map(|(body, all)| all.felt(body.prismatic, [0.0; 3], body.axis))
            .collect()
    }

    /// The mechanism with some joints held: one entry per body, the position of its joint where that is
    /// held. What a held joint carries becomes part of the body that carries it; joints that follow a
    /// held one are held too.
    ///
    /// # Panics
    /// If there are not as many entries as bodies.
    pub fn holding(&self, held: &[Option<f64>]) -> Self {
        assert_eq!(held.len(), self.bodies.len(), "one entry per body");
        let position = |k: usize| {
            let follows = self.bodies[k].follows;
            let led = follows.and_then(|f| Some(f.ratio * held[f.body]? + f.offset));
            held[k].or(led)
        };
        let mut bodies: Vec<Body> = Vec::new();
        // For each body: the one that it is part of now, its place there, and its own new index.
        let mut now: Vec<(Option<usize>, Place)> = Vec::new();
        let mut index = vec![None; self.bodies.len()];
        for (k, body) in self.bodies.iter().enumerate() {
            let (carrier, place) = body.parent.map_or((None, Place::IDENTITY), |p| now[p]);
            if let Some(position) = position(k) {
                let place = place.then(&body.place(position));
                if let Some(carrier) = carrier {
                    let all: &mut Body = &mut bodies[carrier];
                    let merged = all.distribution().with(&body.distribution().placed(&place));
                    (all.mass, all.com, all.inertia) = (merged.mass, merged.com, merged.inertia);
                    all.source = all.source.max(body.source);
                }
                now.push((carrier, place));
                continue;
            }
            let mut body = body.clone();
            body.parent = carrier;
            if place != Place::IDENTITY {
                let placed = place.then(&Place::new(body.origin, body.rpy));
                (body.origin, body.rpy) = (placed.origin, placed.rpy());
            }
            index[k] = Some(bodies.len());
            now.push((Some(bodies.len()), Place::IDENTITY));
            bodies.push(body);
        }
        for body in &mut bodies {
            body.follows = body.follows.and_then(|follows| {
                Some(Follows {
                    body: index[follows.body]?,
                    ..follows
                })
            });
        }
        Self {
            bodies,
            name: self.name.clone(),
            gravity: self.gravity,
        }
    }

    /// The robot without parameters: all is numbers, friction is left out, and each joint that moves on
    /// its own has its torque or force as input.
    pub fn robot(&self) -> Robot {
        let mut robot = Robot::new(self.name.clone(), self.gravity.map(Expr::Num));
        robot.order = (0..self.bodies.len()).collect();
        // A joint may follow one that comes later.
        let mut coordinates = vec![None; self.bodies.len()];
        let free = (0..self.bodies.len()).filter(|&k| self.bodies[k].follows.is_none());
        for (coordinate, k) in free.enumerate() {
            coordinates[k] = Some(coordinate);
        }
        for (index, body) in self.bodies.iter().enumerate() {
            let input = robot.inputs.len();
            if body.follows.is_none() {
                robot.inputs.push(Input {
                    name: format!("u_{}", body.joint),
                    docs: Vec::new(),
                    unit: if body.prismatic { "N" } else { "N*m" }.to_owned(),
                    coord: Some(input),
                });
            }
            robot.links.push(Link {
                name: format!("link_{}", body.joint),
                docs: Vec::new(),
                inertial: match body.mass == 0.0 && body.inertia == [0.0; 6] {
                    true => Inertial::None,
                    false => Inertial::Body {
                        mass: Expr::Num(body.mass),
                        com: body.com.map(Expr::Num),
                        inertia: Tensor::from(body.inertia.map(Expr::Num)),
                        about: About::Com,
                    },
                },
            });
            let kind = match body.prismatic {
                true => JointKind::Prismatic(body.axis),
                false => JointKind::Revolute(body.axis),
            };
            robot.joints.push(Joint {
                name: body.joint.clone(),
                docs: Vec::new(),
                kind,
                coord: coordinates[index],
                follows: body.follows.map(|follows| Affine {
                    terms: coordinates[follows.body]
                        .map(|coordinate| (coordinate, Expr::Num(follows.ratio)))
                        .into_iter()
                        .collect(),
                    offset: Expr::Num(follows.offset),
                }),
                parent: body.parent,
                child: index,
                origin: body.origin.map(Expr::Num),
                rpy: body.rpy.map(Expr::Num),
                limits: body.limits,
                armature: body.rotor.map(Expr::Num),
                force: coordinates[index].map(|_| Expr::Input(input)),
            });
        }
        robot
    }

    /// Bodies whose joints move on their own but move neither mass nor inertia nor a rotor, in any of
    /// three configurations: the mass matrix is singular at them.
    pub fn without_inertia(&self) -> Vec<usize> {
        let bodies = &self.bodies;
        let rotor = |body: &Body| body.rotor.is_some_and(|x| x > 0.0);
        let mut resists: Vec<bool> = bodies.iter().map(rotor).collect();
        for (start, step) in CONFIGURATIONS {
            let mut positions: Vec<f64> =
                (0..bodies.len()).map(|k| start + step * k as f64).collect();
            for (k, body) in bodies.iter().enumerate() {
                if let Some(follows) = body.follows {
                    positions[k] = follows.ratio * positions[follows.body] + follows.offset;
                }
            }
            let carried = self.carried(&positions);
            for (k, (body, all)) in bodies.iter().zip(&carried).enumerate() {
                let arm: f64 = all.com.iter().map(|x| x * x).sum();
                let trace: f64 = all.inertia[..3].iter().map(|x| x.abs()).sum();
                let size = match body.prismatic {
                    true => 0.0,
                    false => NOTHING * (all.mass * arm + trace),
                };
                if all.felt(body.prismatic, [0.0; 3], body.axis) > size {
                    // A joint that is followed feels what its followers carry.
                    resists[k] = true;
                    if let Some(follows) = body.follows.filter(|f| f.ratio != 0.0) {
                        resists[follows.body] = true;
                    }
                }
            }
        }
        (0..bodies.len())
            .filter(|&k| !resists[k] && bodies[k].follows.is_none())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Distribution, Place};

    fn close(x: f64, y: f64, tolerance: f64) {
        assert!((x - y).abs() <= tolerance, "{x} {y}");
    }

    #[test]
    fn roll_pitch_yaw_of_a_place_give_its_rotation() {
        let right = std::f64::consts::FRAC_PI_2;
        for rpy in [
            [0.3, -0.7, 2.0],
            [0.4, right, 1.1],
            [-2.4, -right, 0.9],
            [3.0, right - 1e-8, -3.0],
            [0.0; 3],
        ] {
            let place = Place::new([0.0; 3], rpy);
            let again = Place::new([0.0; 3], place.rpy());
            for (x, y) in place
                .rotation
                .iter()
                .flatten()
                .zip(again.rotation.iter().flatten())
            {
                close(*x, *y, 4e-16 * 4.0);
            }
        }
    }

    /// Two points of 1 kg and 3 kg, 2 m apart: reduced mass 0.75 kg, so 3 kg m² across.
    #[test]
    fn distributions_add_by_the_parallel_axis_theorem() {
        let point = |mass, x| Distribution {
            mass,
            com: [x, 0.0, 0.0],
            inertia: [0.0; 6],
        };
        let both = point(1.0, 0.0).with(&point(3.0, 2.0));
        assert_eq!(both.com, [1.5, 0.0, 0.0]);
        assert_eq!(both.inertia, [0.0, 3.0, 3.0, 0.0, 0.0, 0.0]);
        // About z through the origin: 3 kg at 2 m.
        close(both.felt(false, [0.0; 3], [0.0, 0.0, 1.0]), 12.0, 1e-15);
        // Turned by 90° about z, moved: across is now along x.
        let place = Place::new([1.0, 2.0, 3.0], [0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let turned = both.placed(&place);
        close(turned.com[1], 3.5, 1e-15);
        close(turned.inertia[0], 3.0, 1e-15);
        close(turned.inertia[1], 0.0, 1e-15);
    }

    #[test]
    fn a_place_and_its_inverse_cancel() {
        let place = Place::new([0.1, -2.0, 0.7], [0.3, -0.7, 2.0]);
        let back = place.inverse().then(&place);
        for (x, y) in back
            .rotation
            .iter()
            .flatten()
            .zip(Place::IDENTITY.rotation.iter().flatten())
        {
            close(*x, *y, 1e-15);
        }
        assert!(back.origin.iter().all(|x| x.abs() < 1e-15));
    }
}
