//! A URDF as written, in numbers.

use std::ops::Range;
use std::path::PathBuf;

/// Links and joints of a URDF, checked: one tree, plausible inertias, names that stay apart as identifiers.
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
    /// Mass distribution; `None` for a link without mass.
    pub inertial: Option<Inertial>,
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
    /// Viscous friction, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// Dry friction, N·m or N.
    pub friction: f64,
    /// Another joint that this one follows.
    pub mimic: Option<Mimic>,
    pub(crate) places: JointPlaces,
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

/// `R = Rz(yaw) Ry(pitch) Rx(roll)`, row by row.
pub(crate) fn rotation([roll, pitch, yaw]: [f64; 3]) -> [[f64; 3]; 3] {
    let ((sx, cx), (sy, cy), (sz, cz)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
}

/// `R I Rᵀ` of a tensor xx, yy, zz, xy, xz, yz. The identity leaves the numbers exactly as they
/// are.
pub(crate) fn turned(r: [[f64; 3]; 3], inertia: [f64; 6]) -> [f64; 6] {
    if r == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
        return inertia;
    }
    let [xx, yy, zz, xy, xz, yz] = inertia;
    let t = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let entry = |i: usize, j: usize| -> f64 {
        (0..3)
            .map(|k| (0..3).map(|l| r[i][k] * t[k][l] * r[j][l]).sum::<f64>())
            .sum()
    };
    [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(i, j)| entry(i, j))
}

/// Rᵀ.
pub(crate) fn transposed(r: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]))
}
