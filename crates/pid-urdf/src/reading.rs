//! Settings of reading: what is done about what a file states badly or not at all.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// How a URDF is read.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct Reading {
    /// Refuse inertias that no body has. Otherwise the nearest one that a body has takes their place,
    /// with a warning.
    pub strict: bool,
    /// Moving links without mass and inertia.
    pub missing: Missing,
    /// Joints to hold, by name, at a position, rad or m.
    pub held: BTreeMap<String, f64>,
    /// Joints that move, by name; all others are held at zero, or at the limit next to it. `None`:
    /// all that can move do.
    pub moving: Option<Vec<String>>,
}

/// What is done about moving links without mass and inertia whose joints would move nothing.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub enum Missing {
    /// One error that names them all.
    #[default]
    Refuse,
    /// They stay without; a caller gives the joints an armature.
    Keep,
    /// Mass and inertia of every moving body without them from its geometry, each with a warning.
    Guess(Guess),
}

/// How masses are guessed from geometry.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Guess {
    /// Density, kg/m³.
    pub density: f64,
    /// Masses of links by name, kg, instead of density times volume.
    pub masses: BTreeMap<String, f64>,
    /// Mass of a link that moves nothing otherwise and whose geometry cannot be read, kg: a rod from
    /// its origin to the farthest joint it carries, or a sphere, of the density above. `None`: 0.5 %
    /// of the mass that the moving links have together, or none if they have none.
    pub otherwise: Option<f64>,
    /// Folders that hold the packages of `package://` paths; folders above the file are looked in
    /// without being named.
    pub packages: Vec<PathBuf>,
}

impl Default for Guess {
    /// The density of water. Links of arms are hollow aluminium with motors of steel and copper; over
    /// their collision geometry the mean is near that of water, and MuJoCo assumes the same.
    fn default() -> Self {
        Self {
            density: 1000.0,
            masses: BTreeMap::new(),
            otherwise: None,
            packages: Vec::new(),
        }
    }
}
