//! The meaning of a name at its use.

use proc_macro2::Ident;

use super::names::{Origin, Symbols};
use crate::syntax::Motion;
use pid_derive::model::Func;

/// The place of an expression, which decides what it may use.
#[derive(Debug, Clone, Copy)]
pub enum Scope {
    /// Numbers only: ranges, nominal values, axes.
    Constant(&'static str),
    /// Parameters: gravity, links, origins of joints.
    Geometry(&'static str),
    /// Parameters, those of the joint by their bare names: armature.
    Drive(usize),
    /// Everything: force laws of a joint.
    Force(usize),
    /// Parameters, and joints by their bare names: what a joint or motor follows.
    Coupling,
    /// Parameters and positions: potentials.
    Potential,
    /// Parameters, positions and velocities.
    Lagrangian,
}

/// The meaning of a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// A parameter.
    Param(usize),
    /// An input.
    Input(usize),
    /// The position of a joint or motor.
    Position(usize),
    /// The velocity of a joint or motor.
    Velocity(usize),
    /// π.
    Pi,
}

/// Functions of force laws.
pub(super) const FUNCTIONS: [(&str, Func); 10] = [
    ("sin", Func::Sin),
    ("cos", Func::Cos),
    ("tan", Func::Tan),
    ("tanh", Func::Tanh),
    ("atan", Func::Atan),
    ("exp", Func::Exp),
    ("ln", Func::Ln),
    ("sqrt", Func::Sqrt),
    ("abs", Func::Abs),
    ("sign", Func::Sign),
];

impl Symbols<'_> {
    /// The meaning of `name` in `scope`.
    pub fn lookup(&self, name: &Ident, scope: Scope) -> Option<Meaning> {
        if name == "pi" {
            return Some(Meaning::Pi);
        }
        let joint = match scope {
            Scope::Constant(_) => return None,
            Scope::Drive(j) | Scope::Force(j) => Some(j),
            _ => None,
        };
        if let Scope::Force(j) = scope {
            if name == "q" {
                return Some(Meaning::Position(j));
            }
            if name == "v" {
                return Some(Meaning::Velocity(j));
            }
            let found = self
                .inputs
                .iter()
                .position(|u| (u.joint == Some(j) && u.decl.name == *name) || u.field == *name);
            if let Some(k) = found {
                return Some(Meaning::Input(k));
            }
        }
        if let Scope::Force(_) | Scope::Potential | Scope::Lagrangian = scope
            && let Some(j) = self.coordinate(name)
        {
            return Some(Meaning::Position(j));
        }
        if let Scope::Coupling = scope
            && let Some(j) = self.joints.iter().position(|j| j.decl.name == *name)
        {
            return Some(Meaning::Position(j));
        }
        let own = joint.and_then(|j| {
            self.params.iter().position(|p| {
                matches!(p.origin, Origin::PerJoint { decl, joint, .. } if joint == j && decl.name == *name)
            })
        });
        own.or_else(|| self.params.iter().position(|p| p.field == *name))
            .map(Meaning::Param)
    }

    /// The meaning of `q.joint` or `v.joint`.
    pub fn member(&self, what: &Ident, joint: &Ident) -> Option<Meaning> {
        let j = self.mover(joint)?;
        match what.to_string().as_str() {
            "q" => Some(Meaning::Position(j)),
            "v" => Some(Meaning::Velocity(j)),
            _ => None,
        }
    }

    /// Names that the user may have meant in `scope`.
    pub(super) fn candidates(&self, scope: Scope) -> Vec<String> {
        let mut out = Vec::new();
        let joint = match scope {
            Scope::Constant(_) => return out,
            Scope::Drive(j) | Scope::Force(j) => Some(j),
            _ => None,
        };
        for p in &self.params {
            match p.origin {
                Origin::PerJoint { decl, joint: j, .. } if Some(j) == joint => {
                    out.push(decl.name.to_string());
                }
                _ => out.push(p.field.to_string()),
            }
        }
        if let Scope::Force(j) = scope {
            let own = self
                .inputs
                .iter()
                .filter(|u| u.joint.is_none_or(|of| of == j));
            out.extend(own.map(|u| u.decl.name.to_string()));
        }
        let joints = self.joints.iter().filter(|j| match scope {
            Scope::Coupling => true,
            Scope::Force(_) | Scope::Potential | Scope::Lagrangian => {
                matches!(j.decl.motion, Motion::Coordinate(_))
            }
            _ => false,
        });
        out.extend(joints.map(|j| j.decl.name.to_string()));
        out
    }
}
