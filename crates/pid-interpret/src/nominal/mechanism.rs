//! The nominal description of a mechanism in numbers, as robot files give it.
//!
//! A robot file states masses and inertias, and hardly ever how drives resist. Friction and rotor
//! inertia that it does not state start from a scale of the joint, and their tolerance covers zero to
//! several times that.

use std::path::PathBuf;

use pid_derive::mechanism::{Body, Mechanism};
use pid_derive::model::{Affine, Expr, Joint, JointKind, Link, Robot};

use super::assemble::{Assembly, DriveValues, JointValues, Value, inertial, param};
use super::error::NominalError;
use super::provenance::{Inertials, Provenance};
use super::{Channel, EncoderSide, Measurement, Nominal, Role, Velocity, general, measured};

/// Coulomb friction as a share of the largest torque: that of a geared drive in good order.
const COULOMB: f64 = 0.03;
/// Viscous friction at the largest velocity as a share of the largest torque. Harmonic drives have 0.13 to 0.22 (UR10e
/// of S. Mamedov, S. Mikhel, Frontiers in Robotics and AI 2020, with the limits of its data sheet), direct ones hardly
/// any: zero to five times this start value holds both.
const VISCOUS: f64 = 0.1;
/// Rotor inertia at the joint per largest torque, s²/rad. Geared drives have 0.004 to 0.011 (UR10e of S. Mamedov,
/// S. Mikhel, Frontiers in Robotics and AI 2020; XL-330 and STS3215 of BAM), direct ones less: zero to five times this
/// start value holds twice as much.
const ROTOR: f64 = 5e-3;
/// A start value is known within this multiple of itself, so the range is zero to five times it.
const UNKNOWN: f64 = 4.0;
/// A stated effort above this multiple of the largest weight torque of the robot is a placeholder.
const PLACEHOLDER: f64 = 10.0;
/// Velocity where the file states none, rad/s and m/s.
const SPEED: (f64, f64) = (2.0, 0.5);
/// Velocities outside are placeholders, rad/s or m/s.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=100.0;
/// Length of the windows of free simulation, s. A robot that carries weight and that no loop holds drifts away from
/// its record in a few seconds, whatever its model is.
const HORIZON: f64 = 1.0;
/// Standard gravity, m/s²: weights scale torques whatever way gravity points.
const GRAVITY: f64 = 9.81;

/// A nominal description of a robot file, and what was assumed for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Described {
    /// The description.
    pub nominal: Nominal,
    /// What the file does not state and what stands in its place, one sentence each.
    pub assumptions: Vec<String>,
}

impl Nominal {
    /// The description of a mechanism whose masses and inertias are of a class. Joints come in the
    /// order of the mechanism, depth first from the base. The input of each is its torque or force,
    /// with gain 1, exact. Bodies without mass become light ones.
    ///
    /// A mechanism with joints that follow others has its masses and inertias as
    /// [`Role::Declared`] parameters, and [`to_toml`](Self::to_toml) gives `None` for it.
    ///
    /// # Errors
    /// If no joint moves on its own.
    pub fn of_mechanism(
        mechanism: &Mechanism,
        class: Provenance,
    ) -> Result<Described, NominalError> {
        if mechanism.bodies.iter().all(|body| body.follows.is_some()) {
            return Err(NominalError::NothingMoves {
                robot: mechanism.name.clone(),
            });
        }
        let scales = Scales::new(mechanism);
        let mut assumptions = Vec::new();
        let joints: Vec<JointValues> = mechanism
            .bodies
            .iter()
            .enumerate()
            .map(|(k, body)| scales.joint(k, body, class, &mut assumptions))
            .collect();
        assumptions.push(format!(
            "free runs by which the gap is judged last {HORIZON:.0} s: a robot file states no `horizon_s`"
        ));
        let free = mechanism
            .bodies
            .iter()
            .filter(|body| body.follows.is_none());
        let measurement = Measurement {
            channels: free.map(channel).collect(),
            horizon: Some(HORIZON),
            encoder_side: EncoderSide::Joint,
            tool: None,
        };
        let nominal = match mechanism.bodies.iter().any(|body| body.follows.is_some()) {
            true => coupled(mechanism, joints, measurement),
            false => {
                let mut assembly = Assembly::new(mechanism.name.clone(), mechanism.gravity);
                joints.into_iter().for_each(|joint| assembly.joint(joint));
                assembly.finish(measurement)
            }
        };
        Ok(Described {
            nominal,
            assumptions,
        })
    }
}

/// How a joint is measured: a robot file does not say.
fn channel(body: &Body) -> Channel {
    Channel {
        name: body.joint.clone(),
        position_noise: None,
        position_resolution: None,
        velocity: Velocity::Measured { noise: None },
        input_noise: None,
        torque_peak: body.effort.filter(|x| *x > 0.0),
        speed_scale: body.speed.filter(|x| SPEEDS.contains(x)),
    }
}

/// What friction and rotors are measured by.
struct Scales {
    /// Per body: largest torque or force of its joint, N·m or N.
    torques: Vec<f64>,
    total: f64,
}

impl Scales {
    fn new(mechanism: &Mechanism) -> Self {
        let carried = mechanism.carried(&vec![0.0; mechanism.bodies.len()]);
        // Weight at the radius of gyration about the axis: at least the lever of the centre of mass.
        let weights: Vec<f64> = mechanism
            .bodies
            .iter()
            .zip(&carried)
            .map(|(body, all)| match body.prismatic {
                true => GRAVITY * all.mass.max(0.0),
                false => {
                    let felt = all.felt(false, [0.0; 3], body.axis);
                    GRAVITY * (all.mass * felt).max(0.0).sqrt()
                }
            })
            .collect();
        let most = |prismatic: bool| {
            let all = mechanism.bodies.iter().zip(&weights);
            let kind = all.filter(|(body, _)| body.prismatic == prismatic);
            kind.fold(0.0_f64, |most, (_, weight)| most.max(*weight))
        };
        let torque = |(body, &weight): (&Body, &f64)| match body.effort {
            Some(effort) if effort > 0.0 => effort.min(PLACEHOLDER * most(body.prismatic)),
            _ => weight,
        };
        Self {
            torques: mechanism.bodies.iter().zip(&weights).map(torque).collect(),
            total: mechanism.bodies.iter().map(|b| b.mass.max(0.0)).sum(),
        }
    }

    fn joint(
        &self,
        index: usize,
        body: &Body,
        class: Provenance,
        assumptions: &mut Vec<String>,
    ) -> JointValues {
        let inertials = Inertials::new(body, class, self.total);
        if body.mass <= 0.0 {
            assumptions.push(format!(
                "link `{}` has no mass; it starts with {:.3e} kg, up to {:.3} kg",
                body.link, inertials.mass.nominal, inertials.mass.half_width
            ));
        }
        let torque = self.torques[index];
        let default = if body.prismatic { SPEED.1 } else { SPEED.0 };
        let speed = body.speed.filter(|x| SPEEDS.contains(x)).unwrap_or(default);
        let unit = if body.prismatic {
            ["kg", "N", "N·s/m"]
        } else {
            ["kg·m²", "N·m", "N·m·s/rad"]
        };
        // A stated value is the start, and may be as wrong as one that is not.
        let mut missing = Vec::new();
        let mut unknown = |stated: Option<f64>, scale: f64, what: &str, unit: &str| {
            if stated.is_none() && body.follows.is_none() {
                missing.push(format!("{what} ({} {unit})", digits(scale)));
            }
            let nominal = stated.unwrap_or(scale);
            Value {
                nominal,
                half_width: UNKNOWN * nominal.max(scale),
            }
        };
        let (rotor_inertia, coulomb, viscous) = (
            unknown(body.rotor, ROTOR * torque, "rotor inertia", unit[0]),
            unknown(body.coulomb, COULOMB * torque, "Coulomb friction", unit[1]),
            unknown(
                body.viscous,
                VISCOUS * torque / speed,
                "viscous friction",
                unit[2],
            ),
        );
        if !missing.is_empty() {
            assumptions.push(format!(
                "joint `{}` states no {}; it starts with these and may have 0 to {:.0} times of each",
                body.joint,
                missing.join(", "),
                1.0 + UNKNOWN
            ));
        }
        JointValues {
            name: body.joint.clone(),
            prismatic: body.prismatic,
            axis: body.axis,
            parent: body.parent,
            origin: body.origin,
            rpy: body.rpy,
            limits: body.limits,
            mass: inertials.mass,
            com: inertials.com,
            inertia: inertials.inertia,
            rotor_inertia,
            coulomb,
            viscous,
            gain: Value {
                nominal: 1.0,
                half_width: 0.0,
            },
            input_unit: if body.prismatic { "N" } else { "N*m" }.to_owned(),
            sharpness: measured::sharpness(channel(body).speed_scale),
        }
    }
}

/// The description of a mechanism with followers: friction and rotor of a joint that follows count
/// as those of the joint it follows.
fn coupled(mechanism: &Mechanism, joints: Vec<JointValues>, measurement: Measurement) -> Nominal {
    let mut coordinates = vec![None; joints.len()];
    let free = (0..joints.len()).filter(|&k| mechanism.bodies[k].follows.is_none());
    for (coordinate, k) in free.enumerate() {
        coordinates[k] = Some(coordinate);
    }
    let mut robot = Robot::new(mechanism.name.clone(), mechanism.gravity.map(Expr::Num));
    robot.order = (0..joints.len()).collect();
    let mut drives = Vec::new();
    for (k, values) in joints.into_iter().enumerate() {
        let follows = mechanism.bodies[k].follows;
        // The equations as a whole are declared with the tolerances of all parameters.
        let mut own = |name: String, unit: &str, doc: &str, role: Role, value: Value| {
            param(
                &mut robot,
                &mut Vec::new(),
                None,
                (name, unit, doc),
                role,
                value,
            )
        };
        let inertial = inertial(&values, &mut own);
        let rotor = follows.is_none().then(|| {
            let unit = if values.prismatic { "kg" } else { "kg*m^2" };
            let name = format!("rotor_{}", values.name);
            let doc = "Rotor inertia at the joint.";
            own(name, unit, doc, Role::RotorInertia, values.rotor_inertia)
        });
        robot.links.push(Link {
            name: format!("link_{}", values.name),
            docs: Vec::new(),
            inertial,
        });
        let axis = values.axis;
        robot.joints.push(Joint {
            name: values.name.clone(),
            docs: Vec::new(),
            kind: match values.prismatic {
                true => JointKind::Prismatic(axis),
                false => JointKind::Revolute(axis),
            },
            coord: coordinates[k],
            follows: follows.map(|f| Affine {
                terms: coordinates[f.body]
                    .map(|coordinate| (coordinate, Expr::Num(f.ratio)))
                    .into_iter()
                    .collect(),
                offset: Expr::Num(f.offset),
            }),
            parent: values.parent,
            child: k,
            origin: values.origin.map(Expr::Num),
            rpy: values.rpy.map(Expr::Num),
            limits: values.limits,
            armature: rotor,
            force: None,
        });
        if follows.is_none() {
            drives.push(DriveValues {
                gain: values.gain,
                coulomb: values.coulomb,
                viscous: values.viscous,
                sharpness: values.sharpness,
                input_unit: values.input_unit,
            });
        }
    }
    let last = robot
        .joints
        .iter()
        .rev()
        .find(|joint| joint.coord.is_some());
    let tool_link = last.map(|joint| joint.child);
    let (robot, tolerances) = general::with_drives(robot, &drives, &measurement);
    Nominal {
        robot,
        tolerances,
        measurement,
        effects: Vec::new(),
        simulated: None,
        servos: Vec::new(),
        drive_models: Vec::new(),
        file: PathBuf::new(),
        tool_link,
        drives: None,
    }
}

/// A number in three digits, without an exponent where it needs none.
fn digits(x: f64) -> String {
    let rounded: f64 = format!("{x:.2e}").parse().unwrap_or(x);
    if (1e-4..1e6).contains(&rounded) {
        rounded.to_string()
    } else {
        format!("{rounded:e}")
    }
}
