//! From checked values to the nominal structure: links, joints, drives, and the parameter of every value.

use std::path::PathBuf;

use pid_derive::model::{About, Expr, Func, Inertial, Input, Joint, JointKind, Link, Param, Robot};

use super::{Measurement, Nominal, Ranges, Role, Tolerance};

/// A value and its tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Value {
    pub(super) nominal: f64,
    /// The real value lies within nominal ± this.
    pub(super) half_width: f64,
}

/// A joint, the link it moves and its drive.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct JointValues {
    pub(super) name: String,
    pub(super) prismatic: bool,
    /// Of unit length.
    pub(super) axis: [f64; 3],
    /// Joint that carries the parent link.
    pub(super) parent: Option<usize>,
    pub(super) origin: [f64; 3],
    pub(super) rpy: [f64; 3],
    pub(super) limits: Option<(f64, f64)>,
    pub(super) mass: Value,
    pub(super) com: [Value; 3],
    /// About the centre of mass: xx, yy, zz, xy, xz, yz.
    pub(super) inertia: [Value; 6],
    pub(super) rotor_inertia: Value,
    pub(super) coulomb: Value,
    pub(super) viscous: Value,
    pub(super) gain: Value,
    pub(super) input_unit: String,
    /// Of the transition of Coulomb friction at rest.
    pub(super) sharpness: f64,
}

/// Gain and friction of one coordinate.
#[derive(Debug, Clone)]
pub(super) struct DriveValues {
    pub(super) gain: Value,
    pub(super) coulomb: Value,
    pub(super) viscous: Value,
    pub(super) sharpness: f64,
    pub(super) input_unit: String,
}

/// A nominal structure in the making.
pub(super) struct Assembly {
    robot: Robot,
    tolerances: Vec<Tolerance>,
}

impl Assembly {
    pub(super) fn new(name: String, gravity: [f64; 3]) -> Self {
        Self {
            robot: Robot::new(name, gravity.map(Expr::Num)),
            tolerances: Vec::new(),
        }
    }

    /// The description. Joints must have been added parents first.
    pub(super) fn finish(mut self, measurement: Measurement) -> Nominal {
        self.robot.order = (0..self.robot.joints.len()).collect();
        Nominal {
            tool_link: self.robot.links.len().checked_sub(1),
            robot: self.robot,
            tolerances: self.tolerances,
            measurement,
            effects: Vec::new(),
            simulated: None,
            file: PathBuf::new(),
            drives: None,
            servos: Vec::new(),
            drive_models: Vec::new(),
        }
    }

    /// Adds a joint.
    pub(super) fn joint(&mut self, values: JointValues) {
        let index = self.robot.joints.len();
        let inertial = inertial(&values, &mut |name, unit, doc, role, value| {
            self.param(name, unit, doc, role, value)
        });
        let name = &values.name;
        let rotor_unit = if values.prismatic { "kg" } else { "kg*m^2" };
        let rotor = self.param(
            format!("rotor_{name}"),
            rotor_unit,
            "Rotor inertia at the joint.",
            Role::RotorInertia,
            values.rotor_inertia,
        );
        let drive = DriveValues {
            gain: values.gain,
            coulomb: values.coulomb,
            viscous: values.viscous,
            sharpness: values.sharpness,
            input_unit: values.input_unit.clone(),
        };
        let [gain, coulomb, viscous, sharp] = drive_params(
            &mut self.robot,
            &mut self.tolerances,
            index,
            name,
            values.prismatic,
            &drive,
        );
        let force = drive_force(index, gain, coulomb, viscous, sharp);
        self.robot.inputs.push(Input {
            name: format!("u_{name}"),
            docs: Vec::new(),
            unit: values.input_unit,
            coord: Some(index),
        });
        self.robot.links.push(Link {
            name: format!("link_{name}"),
            docs: Vec::new(),
            inertial,
        });
        self.robot.joints.push(Joint {
            name: values.name,
            docs: Vec::new(),
            kind: if values.prismatic {
                JointKind::Prismatic(values.axis)
            } else {
                JointKind::Revolute(values.axis)
            },
            coord: Some(index),
            follows: None,
            parent: values.parent,
            child: index,
            origin: values.origin.map(Expr::Num),
            rpy: values.rpy.map(Expr::Num),
            limits: values.limits,
            armature: Some(rotor),
            force: Some(force),
        });
    }

    /// A parameter of the joint that is being added.
    fn param(&mut self, name: String, unit: &str, doc: &str, role: Role, value: Value) -> Expr {
        let joint = self.robot.joints.len();
        param(
            &mut self.robot,
            &mut self.tolerances,
            Some(joint),
            (name, unit, doc),
            role,
            value,
        )
    }
}

/// The body of a joint's link; `add` makes a parameter of name, unit, what it is, role and value.
pub(super) fn inertial(
    values: &JointValues,
    add: &mut dyn FnMut(String, &str, &str, Role, Value) -> Expr,
) -> Inertial {
    let name = &values.name;
    let mass = add(
        format!("mass_{name}"),
        "kg",
        "Mass.",
        Role::Mass,
        values.mass,
    );
    let com = [0, 1, 2].map(|k| {
        let axis = ["x", "y", "z"][k];
        let doc = "Centre of mass in the frame of the link.";
        let (text, role) = (format!("com_{axis}_{name}"), Role::CenterOfMass(k));
        add(text, "m", doc, role, values.com[k])
    });
    let inertia: [Expr; 6] = std::array::from_fn(|k| {
        let entry = ["xx", "yy", "zz", "xy", "xz", "yz"][k];
        let doc = "Inertia about the centre of mass, in the axes of the link.";
        let (text, role) = (format!("i{entry}_{name}"), Role::Inertia(k));
        add(text, "kg*m^2", doc, role, values.inertia[k])
    });
    Inertial::Body {
        mass,
        com,
        inertia: inertia.into(),
        about: About::Com,
    }
}

/// A parameter of a joint: name, unit and what it is. Its range is its tolerance.
pub(super) fn param(
    robot: &mut Robot,
    tolerances: &mut Vec<Tolerance>,
    joint: Option<usize>,
    (name, unit, doc): (String, &str, &str),
    role: Role,
    value: Value,
) -> Expr {
    let tolerance = Tolerance {
        name: name.clone(),
        joint,
        role,
        nominal: value.nominal,
        half_width: value.half_width,
    };
    let (lower, upper) = tolerance.range(Ranges::Tolerance);
    tolerances.push(tolerance);
    robot.params.push(Param {
        name,
        docs: vec![format!(" {doc}")],
        unit: unit.to_owned(),
        nominal: value.nominal,
        lower,
        upper,
        fixed: value.half_width == 0.0,
    });
    Expr::Param(robot.params.len() - 1)
}

/// Parameters of the drive of a coordinate: gain, Coulomb friction, viscous friction, sharpness of
/// the transition at rest.
pub(super) fn drive_params(
    robot: &mut Robot,
    tolerances: &mut Vec<Tolerance>,
    joint: usize,
    name: &str,
    prismatic: bool,
    values: &DriveValues,
) -> [Expr; 4] {
    let (force_unit, speed_unit) = if prismatic {
        ("N", "m")
    } else {
        ("N*m", "rad")
    };
    let gain_unit = match values.input_unit == force_unit {
        true => "1".to_owned(),
        false => format!("{force_unit}/{}", values.input_unit),
    };
    let mut add = |what: &str, unit: &str, doc: &str, role: Role, value: Value| {
        let texts = (format!("{what}_{name}"), unit, doc);
        param(robot, tolerances, Some(joint), texts, role, value)
    };
    let coulomb = add(
        "coulomb",
        force_unit,
        "Coulomb friction.",
        Role::Coulomb,
        values.coulomb,
    );
    let viscous = add(
        "viscous",
        &format!("{force_unit}*s/{speed_unit}"),
        "Viscous friction.",
        Role::Viscous,
        values.viscous,
    );
    let gain = add(
        "gain",
        &gain_unit,
        "Force or torque at the joint per unit of the input.",
        Role::Gain,
        values.gain,
    );
    let sharp = add(
        "sharp",
        &format!("s/{speed_unit}"),
        "Sharpness of the transition of Coulomb friction at rest.",
        Role::Sharpness,
        Value {
            nominal: values.sharpness,
            half_width: 0.0,
        },
    );
    [gain, coulomb, viscous, sharp]
}

/// `gain u − viscous v − coulomb tanh(sharp v)`.
pub(super) fn drive_force(
    index: usize,
    gain: Expr,
    coulomb: Expr,
    viscous: Expr,
    sharp: Expr,
) -> Expr {
    let (u, v) = (Expr::Input(index), Expr::Velocity(index));
    let transition = Expr::Call(Func::Tanh, Box::new(product(sharp, v.clone())));
    difference(
        difference(product(gain, u), product(viscous, v)),
        product(coulomb, transition),
    )
}

fn product(x: Expr, y: Expr) -> Expr {
    Expr::Mul(Box::new(x), Box::new(y))
}

fn difference(x: Expr, y: Expr) -> Expr {
    Expr::Sub(Box::new(x), Box::new(y))
}
