//! A URDF as written, in numbers.

use std::ops::Range;
use std::path::PathBuf;

use pid_derive::mechanism::{Distribution, InertiaSource, Place};

use crate::names;

/// Links and joints of a URDF, checked: one tree, bodies with inertias that a body can have, names that
/// stay apart as identifiers.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    pub(crate) file: PathBuf,
    pub(crate) text: String,
    /// Name of the robot as written.
    pub name: String,
    /// Links in the order of the file.
    pub links: Vec<Link>,
    /// Joints in the order of the file.
    pub joints: Vec<Joint>,
    /// Index of the link without a parent, the base.
    pub root: usize,
    /// Joints so that each comes after the joint that carries its parent link.
    pub order: Vec<usize>,
    /// Warnings, with lines.
    pub warnings: Vec<String>,
}

/// A link.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name as written.
    pub name: String,
    /// Name as an identifier.
    pub identifier: String,
    /// Mass distribution; `None` for a link without mass and inertia.
    pub inertial: Option<Inertial>,
    /// Where it comes from.
    pub source: InertiaSource,
    pub(crate) places: Places,
}

/// `<inertial>`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertial {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the frame of the link, m.
    pub com: [f64; 3],
    /// Roll, pitch and yaw of the axes of `inertia` in the frame of the link, rad.
    pub rpy: [f64; 3],
    /// Inertia about the centre of mass in those axes, xx, yy, zz, xy, xz, yz, kg·m².
    pub inertia: [f64; 6],
}

/// A joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name as written.
    pub name: String,
    /// Name as an identifier.
    pub identifier: String,
    /// Kind of motion.
    pub motion: Motion,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// Origin of the joint frame in the frame of the parent, m.
    pub origin: [f64; 3],
    /// Roll, pitch, yaw of the joint frame, rad.
    pub rpy: [f64; 3],
    /// Range of the coordinate, rad or m.
    pub limits: Option<(f64, f64)>,
    /// Largest torque or force, N·m or N.
    pub effort: Option<f64>,
    /// Largest velocity, rad/s or m/s.
    pub speed: Option<f64>,
    /// Viscous friction, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// Dry friction, N·m or N.
    pub friction: f64,
    /// Another joint that this one follows.
    pub mimic: Option<Mimic>,
    /// Position at which the joint is held, rad or m; `None` for a joint that is not.
    pub held: Option<f64>,
    pub(crate) places: JointPlaces,
}

impl Link {
    /// A link without anything.
    pub(crate) fn bare(name: &str, line: u32) -> Self {
        Self {
            name: name.to_owned(),
            identifier: names::identifier(name),
            inertial: None,
            source: InertiaSource::Stated,
            places: Places {
                line,
                inertial_line: line,
                ..Places::default()
            },
        }
    }
}

impl Inertial {
    /// In the frame of the link.
    pub fn distribution(&self) -> Distribution {
        Distribution {
            mass: self.mass,
            com: self.com,
            inertia: self.axes().tensor(self.inertia),
        }
    }

    /// The axes of `inertia` in the frame of the link.
    pub(crate) fn axes(&self) -> Place {
        Place::new([0.0; 3], self.rpy)
    }
}

impl Joint {
    /// Whether it moves, on its own or with another joint.
    pub fn moves(&self) -> bool {
        self.motion != Motion::Fixed && self.held.is_none()
    }

    /// Whether it moves on its own.
    pub fn is_free(&self) -> bool {
        self.moves() && self.mimic.is_none()
    }

    /// Place of the child link in the parent link at a position.
    pub fn place(&self, position: f64) -> Place {
        let moved = match self.motion {
            Motion::Fixed => Place::IDENTITY,
            Motion::Revolute(axis) => Place::moved(false, axis, position),
            Motion::Prismatic(axis) => Place::moved(true, axis, position),
        };
        Place::new(self.origin, self.rpy).then(&moved)
    }
}

/// The motion that a joint allows. Axes are of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Nothing.
    Fixed,
    /// Rotation, with or without limits.
    Revolute([f64; 3]),
    /// Translation.
    Prismatic([f64; 3]),
}

/// `multiplier · position + offset` of a joint that moves on its own; chains are resolved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mimic {
    /// Index of that joint.
    pub joint: usize,
    /// Ratio.
    pub multiplier: f64,
    /// Offset, rad or m.
    pub offset: f64,
}

/// Places in the text where values of a link are written back.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Places {
    pub(crate) line: u32,
    /// Line of `<inertial>`, or that of the link.
    pub(crate) inertial_line: u32,
    /// Where an `<inertial>` goes that the link does not have; `true` in a tag `<link/>`, at its `/`.
    pub(crate) new: Option<(usize, bool)>,
    /// Just after the start tag of `<inertial>`.
    pub(crate) inside: Option<usize>,
    /// `origin`: after its name, and its `xyz`.
    pub(crate) origin: Option<(usize, Option<Range<usize>>)>,
    pub(crate) mass: Option<Range<usize>>,
    /// In the order of [`Inertial::inertia`].
    pub(crate) inertia: [Option<Range<usize>>; 6],
    /// After the name of `<inertia>`.
    pub(crate) inertia_tag: Option<usize>,
}

/// Places in the text where values of a joint are written back.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct JointPlaces {
    pub(crate) line: u32,
    /// Just after the start tag of `<joint>`.
    pub(crate) inside: Option<usize>,
    /// After the name of `<dynamics>`.
    pub(crate) dynamics: Option<usize>,
    pub(crate) damping: Option<Range<usize>>,
    pub(crate) friction: Option<Range<usize>>,
}
