//! From the file to robot, tolerances and measurement: every value checked once.

use pid_derive::model::{
    About, Emit, Expr, Func, Inertial, Input, Joint, JointKind, Link, Param, Robot, Tensor,
};
use pid_derive::plausible;

use super::error::NominalError;
use super::file::{RawFile, RawJoint, RawTolerance, Source};
use super::{Channel, EncoderSide, Measurement, Nominal, Ranges, Role, Tolerance, Velocity};

/// Where neither a sharpness nor a typical velocity is stated, 1/(rad/s) or 1/(m/s).
const SHARPNESS: f64 = 50.0;
/// Share of the typical velocity at which `tanh` reaches 0.76.
const TRANSITION: f64 = 0.02;

pub(super) fn nominal(source: &Source<'_>) -> Result<Nominal, NominalError> {
    let raw = source.parse()?;
    if raw.joint.is_empty() {
        return Err(NominalError::NoJoint {
            file: source.file.to_owned(),
        });
    }
    let shares = Shares::new(source, &raw.tolerance)?;
    let measurement = measurement(source, &raw)?;
    let mut builder = Builder {
        source,
        shares,
        names: Vec::new(),
        tolerances: Vec::new(),
        robot: Robot {
            name: raw.robot.name.clone(),
            docs: Vec::new(),
            gravity: source
                .list(&raw.robot.gravity, "robot", "gravity")?
                .map(Expr::Num),
            params: Vec::new(),
            inputs: Vec::new(),
            links: Vec::new(),
            joints: Vec::new(),
            order: (0..raw.joint.len()).collect(),
            motors: vec![],
            potential: None,
            lagrangian: None,
            blanks: Vec::new(),
            emit: Emit {
                first_derivatives: true,
                second_derivatives: true,
                ..Emit::default()
            },
        },
    };
    for joint in &raw.joint {
        builder.joint(joint)?;
    }
    Ok(Nominal {
        robot: builder.robot,
        tolerances: builder.tolerances,
        measurement,
    })
}

/// Tolerances as the file states them.
struct Shares {
    mass: f64,
    com: f64,
    inertia: f64,
    rotor_inertia: f64,
    gain: f64,
    friction: f64,
}

impl Shares {
    fn new(source: &Source<'_>, raw: &RawTolerance) -> Result<Self, NominalError> {
        let number = |value, key| {
            let mend = "a tolerance is zero (the value is exact) or positive";
            source.number(value, "tolerance", key, |x| x >= 0.0, mend)
        };
        Ok(Self {
            mass: number(&raw.mass_rel, "mass_rel")?,
            com: number(&raw.com_abs_m, "com_abs_m")?,
            inertia: number(&raw.inertia_rel, "inertia_rel")?,
            rotor_inertia: number(&raw.rotor_inertia_rel, "rotor_inertia_rel")?,
            gain: number(&raw.motor_gain_rel, "motor_gain_rel")?,
            friction: number(&raw.friction_rel, "friction_rel")?,
        })
    }
}

struct Builder<'a> {
    source: &'a Source<'a>,
    shares: Shares,
    /// Names of the joints so far.
    names: Vec<String>,
    tolerances: Vec<Tolerance>,
    robot: Robot,
}

impl Builder<'_> {
    fn joint(&mut self, raw: &RawJoint) -> Result<(), NominalError> {
        let source = self.source;
        let index = self.names.len();
        let name = self.name(raw)?;
        let item = format!("joint {name}");
        let (axis, prismatic) = axis(source, raw, &item)?;
        let parent = self.parent(raw, &item)?;
        let (force_unit, speed_unit) = if prismatic {
            ("N", "m")
        } else {
            ("N*m", "rad")
        };
        let inertial = self.inertial(raw, index, &name, &item)?;

        let input_unit = input_unit(source, raw, &item, prismatic)?;
        let gain = source.number(
            &raw.motor_gain,
            &item,
            "motor_gain",
            |x| x != 0.0,
            "a drive with gain 0 does nothing; give the torque or force per unit of the input",
        )?;
        let positive = |value, key| {
            let mend = "friction and rotor inertia are zero or positive";
            source.number(value, &item, key, |x| x >= 0.0, mend)
        };
        let rotor_inertia = positive(&raw.rotor_inertia, "rotor_inertia")?;
        let coulomb = positive(&raw.coulomb, "coulomb")?;
        let viscous = positive(&raw.viscous, "viscous")?;
        let sharp = sharpness(source, raw, &item)?;
        let limits = limits(source, raw, &item)?;
        let origin = source.list(&raw.origin, &item, "origin")?;
        let rpy = match &raw.rpy {
            Some(rpy) => source.list(rpy, &item, "rpy")?,
            None => [0.0; 3],
        };

        let shares = &self.shares;
        let (of_rotor, of_gain, of_friction) = (shares.rotor_inertia, shares.gain, shares.friction);
        let gain_unit = match input_unit == force_unit {
            true => "1".to_owned(),
            false => format!("{force_unit}/{input_unit}"),
        };
        let rotor_unit = if prismatic { "kg" } else { "kg*m^2" };
        let viscous_unit = format!("{force_unit}*s/{speed_unit}");
        let sharp_unit = format!("s/{speed_unit}");
        let mut param = |stem: &str, unit: &str, doc: &str, role, nominal, share: f64| {
            self.param(
                index,
                format!("{stem}_{name}"),
                unit,
                doc,
                role,
                nominal,
                share,
            )
        };
        let rotor = param(
            "rotor",
            rotor_unit,
            "Rotor inertia at the joint.",
            Role::RotorInertia,
            rotor_inertia,
            of_rotor * rotor_inertia,
        );
        let coulomb = param(
            "coulomb",
            force_unit,
            "Coulomb friction.",
            Role::Coulomb,
            coulomb,
            of_friction * coulomb,
        );
        let viscous = param(
            "viscous",
            &viscous_unit,
            "Viscous friction.",
            Role::Viscous,
            viscous,
            of_friction * viscous,
        );
        let gain = param(
            "gain",
            &gain_unit,
            "Force or torque at the joint per unit of the input.",
            Role::Gain,
            gain,
            of_gain * gain.abs(),
        );
        let sharp = param(
            "sharp",
            &sharp_unit,
            "Sharpness of the transition of Coulomb friction at rest.",
            Role::Sharpness,
            sharp,
            0.0,
        );

        // gain u − viscous v − coulomb tanh(sharp v)
        let (u, v) = (Expr::Input(index), Expr::Velocity(index));
        let transition = Expr::Call(Func::Tanh, Box::new(product(sharp, v.clone())));
        let force = difference(
            difference(product(gain, u), product(viscous, v)),
            product(coulomb, transition),
        );
        self.robot.inputs.push(Input {
            name: format!("u_{name}"),
            docs: Vec::new(),
            unit: input_unit.to_owned(),
            coord: Some(index),
        });
        self.robot.links.push(Link {
            name: format!("link_{name}"),
            docs: Vec::new(),
            inertial,
        });
        self.robot.joints.push(Joint {
            name: name.clone(),
            docs: Vec::new(),
            kind: if prismatic {
                JointKind::Prismatic(axis)
            } else {
                JointKind::Revolute(axis)
            },
            coord: Some(index),
            follows: None,
            parent,
            child: index,
            origin: origin.map(Expr::Num),
            rpy: rpy.map(Expr::Num),
            limits,
            armature: Some(rotor),
            force: Some(force),
        });
        self.names.push(name);
        Ok(())
    }

    fn name(&self, raw: &RawJoint) -> Result<String, NominalError> {
        let name = raw.name.get_ref();
        let error = |mend: &str| {
            let item = format!("joint {}", self.names.len() + 1);
            Err(self
                .source
                .error(&raw.name, &item, "name", format!("\"{name}\""), mend))
        };
        let letter = |c: char| c.is_ascii_alphabetic() || c == '_';
        if !(name.starts_with(letter) && name.chars().all(|c| letter(c) || c.is_ascii_digit())) {
            return error(
                "a name is letters, digits and `_`, and starts with a letter: parameters are named after it",
            );
        }
        if name == "base" {
            return error("`base` is what the first joint hangs on; choose another name");
        }
        if self.names.contains(name) {
            return error("another joint has this name; give each its own");
        }
        Ok(name.clone())
    }

    /// The link of the named joint; without a name that of the joint before.
    fn parent(&self, raw: &RawJoint, item: &str) -> Result<Option<usize>, NominalError> {
        let Some(parent) = &raw.parent else {
            return Ok(self.names.len().checked_sub(1));
        };
        if parent.get_ref() == "base" {
            return Ok(None);
        }
        match self.names.iter().position(|name| name == parent.get_ref()) {
            Some(index) => Ok(Some(index)),
            None => Err(self.source.error(
                parent,
                item,
                "parent",
                format!("\"{}\"", parent.get_ref()),
                "name a joint listed before this one, or \"base\"",
            )),
        }
    }

    fn inertial(
        &mut self,
        raw: &RawJoint,
        index: usize,
        name: &str,
        item: &str,
    ) -> Result<Inertial, NominalError> {
        let source = self.source;
        let mass = source.number(&raw.mass, item, "mass", |x| x > 0.0, "a mass is positive")?;
        let com = source.list(&raw.com, item, "com")?;
        let inertia = source.list(&raw.inertia, item, "inertia")?;
        if let Err(e) = plausible::check(mass, inertia) {
            let mend = format!("{e}; entries are xx, yy, zz, xy, xz, yz about the centre of mass");
            return Err(source.error(&raw.inertia, item, "inertia", format!("{inertia:?}"), mend));
        }
        let largest = plausible::principal_moments(inertia)[0];
        let (of_mass, of_com, of_inertia) = (
            self.shares.mass * mass,
            self.shares.com,
            self.shares.inertia * largest,
        );
        let mass = self.param(
            index,
            format!("mass_{name}"),
            "kg",
            "Mass.",
            Role::Mass,
            mass,
            of_mass,
        );
        let com = [0, 1, 2].map(|k| {
            let axis = ["x", "y", "z"][k];
            let doc = "Centre of mass in the frame of the link.";
            self.param(
                index,
                format!("com_{axis}_{name}"),
                "m",
                doc,
                Role::CenterOfMass(k),
                com[k],
                of_com,
            )
        });
        let [xx, yy, zz, xy, xz, yz] = std::array::from_fn(|k| {
            let entry = ["xx", "yy", "zz", "xy", "xz", "yz"][k];
            let doc = "Inertia about the centre of mass, in the axes of the link.";
            self.param(
                index,
                format!("i{entry}_{name}"),
                "kg*m^2",
                doc,
                Role::Inertia(k),
                inertia[k],
                of_inertia,
            )
        });
        Ok(Inertial::Body {
            mass,
            com,
            inertia: Tensor {
                xx,
                yy,
                zz,
                xy,
                xz,
                yz,
            },
            about: About::Com,
        })
    }

    #[allow(
        clippy::too_many_arguments,
        reason = "the columns of the table of parameters"
    )]
    fn param(
        &mut self,
        joint: usize,
        name: String,
        unit: &str,
        doc: &str,
        role: Role,
        nominal: f64,
        half_width: f64,
    ) -> Expr {
        let tolerance = Tolerance {
            name: name.clone(),
            joint,
            role,
            nominal,
            half_width,
        };
        let (lower, upper) = tolerance.range(Ranges::Tolerance);
        self.tolerances.push(tolerance);
        self.robot.params.push(Param {
            name,
            docs: vec![format!(" {doc}")],
            unit: unit.to_owned(),
            nominal,
            lower,
            upper,
            fixed: half_width == 0.0,
        });
        Expr::Param(self.robot.params.len() - 1)
    }
}

fn product(x: Expr, y: Expr) -> Expr {
    Expr::Mul(Box::new(x), Box::new(y))
}

fn difference(x: Expr, y: Expr) -> Expr {
    Expr::Sub(Box::new(x), Box::new(y))
}

/// The axis, of unit length, and whether the joint slides along it.
fn axis(source: &Source<'_>, raw: &RawJoint, item: &str) -> Result<([f64; 3], bool), NominalError> {
    let kinds = [("revolute", false), ("prismatic", true)];
    let prismatic = source.word(&raw.r#type, item, "type", &kinds)?;
    let axis = source.list(&raw.axis, item, "axis")?;
    let largest = axis.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    if largest == 0.0 {
        let mend = "an axis has a direction, as in [0.0, 0.0, 1.0]";
        return Err(source.error(&raw.axis, item, "axis", format!("{axis:?}"), mend));
    }
    let scaled = axis.map(|x| x / largest);
    let length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
    Ok((scaled.map(|x| x / length), prismatic))
}

fn input_unit(
    source: &Source<'_>,
    raw: &RawJoint,
    item: &str,
    prismatic: bool,
) -> Result<&'static str, NominalError> {
    let force = if prismatic {
        ("force", "N")
    } else {
        ("torque", "N*m")
    };
    let words = [force, ("current", "A"), ("voltage", "V")];
    source.word(&raw.input, item, "input", &words)
}

fn sharpness(source: &Source<'_>, raw: &RawJoint, item: &str) -> Result<f64, NominalError> {
    let positive = "give a positive number, or leave the key out";
    let stated = source.optional(
        raw.sharpness.as_ref(),
        item,
        "sharpness",
        |x| x > 0.0,
        positive,
    )?;
    let speed = source.optional(
        raw.speed_scale.as_ref(),
        item,
        "speed_scale",
        |x| x > 0.0,
        positive,
    )?;
    let from_speed = speed.map(|speed| 1.0 / (TRANSITION * speed));
    Ok(stated.or(from_speed).unwrap_or(SHARPNESS))
}

fn limits(
    source: &Source<'_>,
    raw: &RawJoint,
    item: &str,
) -> Result<Option<(f64, f64)>, NominalError> {
    let Some(limits) = &raw.limits else {
        return Ok(None);
    };
    let [lower, upper] = source.list(limits, item, "limits")?;
    if lower < upper {
        return Ok(Some((lower, upper)));
    }
    let mend = "the first limit is below the second";
    Err(source.error(limits, item, "limits", format!("[{lower}, {upper}]"), mend))
}

fn measurement(source: &Source<'_>, raw: &RawFile) -> Result<Measurement, NominalError> {
    let robot = &raw.robot;
    let positive = "give a positive number, or leave the key out";
    let filter_hz = source.optional(
        robot.velocity_filter_hz.as_ref(),
        "robot",
        "velocity_filter_hz",
        |x| x > 0.0,
        positive,
    )?;
    let horizon = source.optional(
        robot.horizon_s.as_ref(),
        "robot",
        "horizon_s",
        |x| x > 0.0,
        positive,
    )?;
    let noise = "a standard deviation is zero or positive";
    let input_noise = source.optional(
        robot.input_noise.as_ref(),
        "robot",
        "input_noise",
        |x| x >= 0.0,
        noise,
    )?;
    let sides = [
        ("motor", EncoderSide::Motor),
        ("joint", EncoderSide::Joint),
        ("link", EncoderSide::Joint),
    ];
    let encoder_side = match &robot.encoder_side {
        Some(side) => source.word(side, "robot", "encoder_side", &sides)?,
        None => EncoderSide::Joint,
    };
    let tool = robot
        .tool
        .as_ref()
        .map(|tool| source.list(tool, "robot", "tool"))
        .transpose()?;

    let mut channels = Vec::new();
    for joint in &raw.joint {
        let item = format!("joint {}", joint.name.get_ref());
        let number = |value: &Option<_>, key| {
            source.optional(value.as_ref(), &item, key, |x| x >= 0.0, noise)
        };
        let dq_noise = number(&joint.dq_noise_std, "dq_noise_std")?;
        let kinds = [
            ("measured", Velocity::Measured { noise: dq_noise }),
            ("derived", Velocity::Derived { filter_hz }),
            ("absent", Velocity::Absent),
        ];
        let peak = source.optional(
            joint.torque_peak.as_ref(),
            &item,
            "torque_peak",
            |x| x > 0.0,
            positive,
        )?;
        if peak.is_none()
            && let Some(share) = &robot.input_noise
            && *share.get_ref() > 0.0
        {
            let mend = format!(
                "it is a share of `torque_peak`, which {item} does not state; state it, or give 0"
            );
            return Err(source.error(share, "robot", "input_noise", share.get_ref(), mend));
        }
        channels.push(Channel {
            name: joint.name.get_ref().clone(),
            position_noise: number(&joint.q_noise_std, "q_noise_std")?,
            position_resolution: number(&joint.q_resolution, "q_resolution")?,
            velocity: source.word(&joint.velocity, &item, "velocity", &kinds)?,
            input_noise: input_noise
                .map(|share| share * peak.unwrap_or(0.0) / joint.motor_gain.get_ref().abs()),
            torque_peak: peak,
            speed_scale: joint.speed_scale.as_ref().map(|x| *x.get_ref()),
        });
    }
    Ok(Measurement {
        channels,
        horizon,
        encoder_side,
        tool,
    })
}
