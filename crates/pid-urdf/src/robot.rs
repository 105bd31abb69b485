//! From a description to a robot that can be derived.
//!
//! Per joint that moves on its own, with input u at the joint,
//!
//! ```text
//! f = u − viscous·v − dry·tanh(sharpness·v)
//! ```
//!
//! A joint with `<mimic>` has friction but no input, and moves with the joint it follows.

use std::collections::BTreeMap;

use pid_derive::model::{
    About, Affine, Expr, Func, Inertial, Input, Joint, JointKind, Link, Param, Robot, Tensor,
};

use crate::description::{self, Description, Motion};
use crate::error::UrdfError;
use crate::names;

/// Which numbers of a URDF become parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// Gravity in the frame of the root link, m/s²; a URDF does not state it.
    pub gravity: [f64; 3],
    /// Masses and inertias.
    pub inertias: Inertias,
    /// `dry_<joint>` and `viscous_<joint>` as parameters, nominal values from `<dynamics>`;
    /// otherwise numbers.
    pub friction: bool,
    /// `rotor_<joint>` as a parameter: inertia or mass of the drive at the joint, for which URDF
    /// has no field, nominal 0.
    pub armature: bool,
    /// Sharpness of the transition of dry friction at rest, s/rad or s/m.
    pub sharpness: f64,
}

impl Default for Options {
    /// Standard parameters and friction free, no armature; standard gravity downwards.
    fn default() -> Self {
        Self {
            gravity: [0.0, 0.0, -9.81],
            inertias: Inertias::Standard,
            friction: true,
            armature: false,
            sharpness: 50.0,
        }
    }
}

/// Whether masses and inertias are numbers or parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Inertias {
    /// Numbers, as written.
    Numbers,
    /// The ten standard parameters of one link per moving body, `<link>_m`, `_mx`, `_my`, `_mz`
    /// (first moment), `_ixx`, `_iyy`, `_izz`, `_ixy`, `_ixz`, `_iyz` (about the link's origin). It
    /// is the moving link itself or, if that has no mass, the first link with a mass that is fixed
    /// to it. Other links fixed to it stay numbers, since they cannot be told apart.
    Standard,
}

/// Names of the standard parameters after that of the link.
pub(crate) const STANDARD: [&str; 10] = [
    "m", "mx", "my", "mz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];
/// A free mass stays above this share of its nominal value, so that the mass matrix stays regular.
const SMALLEST_MASS: f64 = 1e-3;

/// The robot of a description.
///
/// # Errors
/// If names of parameters collide.
pub fn robot(description: &Description, options: &Options) -> Result<Robot, UrdfError> {
    let mut builder = Builder {
        description,
        options,
        names: BTreeMap::new(),
        robot: Robot {
            order: (0..description.joints.len()).collect(),
            ..Robot::new(
                names::type_name(&description.name),
                options.gravity.map(Expr::Num),
            )
        },
    };
    let free = free_links(description, options);
    for (index, link) in description.links.iter().enumerate() {
        if index != description.root {
            let inertial = builder.inertial(link, free[index])?;
            builder.robot.links.push(Link {
                name: link.identifier.clone(),
                docs: vec![format!(" Link `{}`.", link.name)],
                inertial,
            });
        }
    }
    let mut coords: Vec<Option<usize>> = vec![None; description.joints.len()];
    let mut next = 0;
    for &index in &description.order {
        let joint = &description.joints[index];
        if joint.is_free() {
            coords[index] = Some(next);
            next += 1;
        }
    }
    for &index in &description.order {
        builder.joint(index, &coords)?;
    }
    Ok(builder.robot)
}

/// For each link whether its standard parameters are free.
pub(crate) fn free_links(description: &Description, options: &Options) -> Vec<bool> {
    let mut free = vec![false; description.links.len()];
    if options.inertias == Inertias::Numbers {
        return free;
    }
    // The moving link that carries each link, and whether that body has its free link already.
    let mut body: Vec<Option<usize>> = vec![None; description.links.len()];
    let mut done = vec![false; description.links.len()];
    for &index in &description.order {
        let joint = &description.joints[index];
        let carrier = match joint.moves() {
            false => body[joint.parent],
            true => Some(joint.child),
        };
        body[joint.child] = carrier;
        if let Some(carrier) = carrier
            && description.links[joint.child].inertial.is_some()
            && !std::mem::replace(&mut done[carrier], true)
        {
            free[joint.child] = true;
        }
    }
    free
}

/// The ten standard parameters in numbers, in the frame of the link.
pub(crate) fn standard(inertial: &description::Inertial) -> [f64; 10] {
    let (m, c) = (inertial.mass, inertial.com);
    let [xx, yy, zz, xy, xz, yz] = inertial.distribution().about([0.0; 3]);
    let [mx, my, mz] = c.map(|c| m * c);
    [m, mx, my, mz, xx, yy, zz, xy, xz, yz]
}

struct Builder<'a> {
    description: &'a Description,
    options: &'a Options,
    /// Parameters and inputs so far, with what they belong to.
    names: BTreeMap<String, String>,
    robot: Robot,
}

impl Builder<'_> {
    fn take(&mut self, name: &str, owner: &str) -> Result<(), UrdfError> {
        match self.names.insert(name.to_owned(), owner.to_owned()) {
            None => Ok(()),
            Some(other) => Err(UrdfError::Collision {
                file: self.description.file.clone(),
                name: owner.to_owned(),
                other,
                identifier: name.to_owned(),
            }),
        }
    }

    fn param(
        &mut self,
        name: String,
        owner: &str,
        unit: &str,
        doc: &str,
        (nominal, lower, upper): (f64, f64, f64),
    ) -> Result<Expr, UrdfError> {
        self.take(&name, owner)?;
        self.robot.params.push(Param {
            name,
            docs: vec![format!(" {doc}")],
            unit: unit.to_owned(),
            nominal,
            lower,
            upper,
            fixed: false,
        });
        Ok(Expr::Param(self.robot.params.len() - 1))
    }

    fn inertial(&mut self, link: &description::Link, free: bool) -> Result<Inertial, UrdfError> {
        let Some(inertial) = &link.inertial else {
            return Ok(Inertial::None);
        };
        if !free {
            return Ok(Inertial::Body {
                mass: Expr::Num(inertial.mass),
                com: inertial.com.map(Expr::Num),
                inertia: Tensor::from(inertial.distribution().inertia.map(Expr::Num)),
                about: About::Com,
            });
        }
        let mut entries = Vec::with_capacity(10);
        for (stem, nominal) in STANDARD.into_iter().zip(standard(inertial)) {
            let (unit, lower, what) = match stem {
                "m" => ("kg", SMALLEST_MASS * nominal, "Mass"),
                "mx" | "my" | "mz" => ("kg*m", f64::NEG_INFINITY, "First moment"),
                "ixx" | "iyy" | "izz" => ("kg*m^2", 0.0, "Inertia about the link's origin"),
                _ => (
                    "kg*m^2",
                    f64::NEG_INFINITY,
                    "Inertia about the link's origin",
                ),
            };
            let name = format!("{}_{stem}", link.identifier);
            let doc = format!("{what} of link `{}`.", link.name);
            entries.push(self.param(
                name,
                &link.name,
                unit,
                &doc,
                (nominal, lower, f64::INFINITY),
            )?);
        }
        let [mass, mx, my, mz, xx, yy, zz, xy, xz, yz] = entries
            .try_into()
            .unwrap_or_else(|_| unreachable!("ten parameters"));
        Ok(Inertial::Linear {
            mass,
            first_moment: [mx, my, mz],
            inertia: Tensor::from([xx, yy, zz, xy, xz, yz]),
        })
    }

    fn joint(&mut self, index: usize, coords: &[Option<usize>]) -> Result<(), UrdfError> {
        let joint = &self.description.joints[index];
        let kind = match joint.motion {
            Motion::Fixed => JointKind::Fixed,
            Motion::Revolute(axis) => JointKind::Revolute(axis),
            Motion::Prismatic(axis) => JointKind::Prismatic(axis),
        };
        let follows = joint.mimic.map(|mimic| Affine {
            terms: coords[mimic.joint]
                .map(|coord| (coord, Expr::Num(mimic.multiplier)))
                .into_iter()
                .collect(),
            offset: Expr::Num(mimic.offset),
        });
        let follows = match joint.held {
            Some(position) => Some(Affine {
                terms: Vec::new(),
                offset: Expr::Num(position),
            }),
            None => follows,
        };
        let velocity = match (coords[index], &follows) {
            (Some(coord), _) => Some(Expr::Velocity(coord)),
            (None, Some(follows)) => follows
                .terms
                .first()
                .map(|(coord, ratio)| product(ratio.clone(), Expr::Velocity(*coord))),
            (None, None) => None,
        };
        let (mut armature, mut force) = (None, None);
        if let Some(velocity) = velocity {
            (armature, force) = self.drive(index, coords[index], velocity)?;
        }
        // The root is the base; links after it move up by one.
        let root = self.description.root;
        let link = |index: usize| if index > root { index - 1 } else { index };
        self.robot.joints.push(Joint {
            name: joint.identifier.clone(),
            docs: vec![format!(" Joint `{}`.", joint.name)],
            kind,
            coord: coords[index],
            follows,
            parent: (joint.parent != root).then(|| link(joint.parent)),
            child: link(joint.child),
            origin: joint.origin.map(Expr::Num),
            rpy: joint.rpy.map(Expr::Num),
            limits: joint.limits,
            armature,
            force,
        });
        Ok(())
    }

    /// Armature and force of a joint that moves, and its input if it moves on its own.
    fn drive(
        &mut self,
        index: usize,
        coord: Option<usize>,
        velocity: Expr,
    ) -> Result<(Option<Expr>, Option<Expr>), UrdfError> {
        let joint = &self.description.joints[index];
        let (name, owner) = (&joint.identifier, joint.name.clone());
        let prismatic = matches!(joint.motion, Motion::Prismatic(_));
        let (force_unit, viscous_unit, rotor_unit, stem) = if prismatic {
            ("N", "N*s/m", "kg", "force")
        } else {
            ("N*m", "N*m*s/rad", "kg*m^2", "torque")
        };
        let (dry, viscous) = if self.options.friction {
            let most = joint.effort.filter(|&effort| effort > joint.friction);
            let range = (joint.friction, 0.0, most.unwrap_or(f64::INFINITY));
            let dry = self.param(
                format!("dry_{name}"),
                &owner,
                force_unit,
                "Dry friction.",
                range,
            )?;
            let range = (joint.damping, 0.0, f64::INFINITY);
            let viscous = self.param(
                format!("viscous_{name}"),
                &owner,
                viscous_unit,
                "Viscous friction.",
                range,
            )?;
            (Some(dry), Some(viscous))
        } else {
            let number = |x: f64| (x != 0.0).then_some(Expr::Num(x));
            (number(joint.friction), number(joint.damping))
        };
        let armature = match self.options.armature {
            false => None,
            true => {
                let doc = "Inertia or mass of the drive at the joint.";
                let range = (0.0, 0.0, f64::INFINITY);
                Some(self.param(format!("rotor_{name}"), &owner, rotor_unit, doc, range)?)
            }
        };
        let mut force = None;
        if coord.is_some() {
            let input = format!("{stem}_{name}");
            self.take(&input, &owner)?;
            self.robot.inputs.push(Input {
                name: input,
                docs: vec![format!(" Drive of joint `{owner}`, at the joint.")],
                unit: force_unit.to_owned(),
                coord,
            });
            force = Some(Expr::Input(self.robot.inputs.len() - 1));
        }
        if let Some(viscous) = viscous {
            force = Some(minus(force, product(viscous, velocity.clone())));
        }
        if let Some(dry) = dry {
            let argument = product(Expr::Num(self.options.sharpness), velocity);
            let transition = Expr::Call(Func::Tanh, Box::new(argument));
            force = Some(minus(force, product(dry, transition)));
        }
        Ok((armature, force))
    }
}

fn product(x: Expr, y: Expr) -> Expr {
    Expr::Mul(Box::new(x), Box::new(y))
}

fn minus(x: Option<Expr>, y: Expr) -> Expr {
    match x {
        None => Expr::Neg(Box::new(y)),
        Some(x) => Expr::Sub(Box::new(x), Box::new(y)),
    }
}
