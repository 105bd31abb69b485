//! What was read of a file so far, and the settings it is read with.

use pid_derive::mechanism::Body;

use crate::actuator::Actuator;
use crate::defaults::Defaults;
use crate::element::Element;
use crate::error::MjcfError;
use crate::mesh::Meshes;
use crate::place::Angles;

/// A range or none, or a message.
pub(crate) type Range = Result<Option<(f64, f64)>, MjcfError>;

/// Elements beside bodies and drives that act on the motion and are not read.
const UNREAD: [(&str, &str); 3] = [
    ("equality", "ties joints or bodies"),
    ("tendon", "pulls on joints"),
    ("deformable", "is no rigid body"),
];

/// What was read so far, and what it is read with.
pub(crate) struct Reader {
    pub(crate) angles: Angles,
    pub(crate) autolimits: bool,
    /// Whether inertias come from geoms always, never, or where none are stated.
    pub(crate) from_geoms: Option<bool>,
    /// Groups of geoms that have mass.
    pub(crate) groups: (f64, f64),
    /// Least mass and least principal moment of a body.
    pub(crate) bounds: (f64, f64),
    /// Mass to which all bodies together are scaled.
    total: Option<f64>,
    /// Mass of all bodies so far, those that do not move too.
    pub(crate) weighed: f64,
    pub(crate) defaults: Defaults,
    pub(crate) meshes: Meshes,
    pub(crate) bodies: Vec<Body>,
    /// Names of their joints as written.
    pub(crate) joint_names: Vec<String>,
    /// Names of ball joints as written.
    pub(crate) balls: Vec<String>,
    pub(crate) actuators: Vec<Actuator>,
    pub(crate) warnings: Vec<String>,
}

impl Reader {
    pub(crate) fn new(root: &Element) -> Result<Self, MjcfError> {
        let mut out = Self {
            angles: Angles {
                unit: 1.0_f64.to_radians(),
                sequence: vec!['x', 'y', 'z'],
            },
            autolimits: true,
            from_geoms: None,
            groups: (0.0, 5.0),
            bounds: (0.0, 0.0),
            total: None,
            weighed: 0.0,
            defaults: Defaults::new(root),
            meshes: Meshes::default(),
            bodies: Vec::new(),
            joint_names: Vec::new(),
            balls: Vec::new(),
            actuators: Vec::new(),
            warnings: Vec::new(),
        };
        for compiler in root.all("compiler") {
            match compiler.get("angle") {
                Some("radian") => out.angles.unit = 1.0,
                Some("degree") => out.angles.unit = 1.0_f64.to_radians(),
                None => {}
                Some(_) => return Err(compiler.error("angle", "write \"radian\" or \"degree\"")),
            }
            if let Some(sequence) = compiler.get("eulerseq") {
                let axes: Vec<char> = sequence.chars().collect();
                if axes.len() != 3 || !axes.iter().all(|c| "xyzXYZ".contains(*c)) {
                    return Err(compiler.error("eulerseq", "write three of x, y, z, X, Y, Z"));
                }
                out.angles.sequence = axes;
            }
            match compiler.get("autolimits") {
                Some("false") => out.autolimits = false,
                Some(_) => out.autolimits = true,
                None => {}
            }
            match compiler.get("inertiafromgeom") {
                Some("true") => out.from_geoms = Some(true),
                Some("false") => out.from_geoms = Some(false),
                Some(_) => out.from_geoms = None,
                None => {}
            }
            if let Some([low, high]) = compiler.numbers("inertiagrouprange")? {
                out.groups = (low, high);
            }
            if compiler.get("coordinate") == Some("global") {
                return Err(compiler.unsupported(
                    "has coordinates in the frame of the world",
                    "convert it to local coordinates, as newer versions of MuJoCo ask for too",
                ));
            }
            out.bounds.0 = compiler.number("boundmass")?.unwrap_or(out.bounds.0);
            out.bounds.1 = compiler.number("boundinertia")?.unwrap_or(out.bounds.1);
            let total = compiler.number("settotalmass")?;
            out.total = total.map_or(out.total, |mass| (mass > 0.0).then_some(mass));
            if compiler.get("balanceinertia") == Some("true") {
                out.warn(compiler, "has `balanceinertia`, which is not read");
            }
        }
        Ok(out)
    }

    pub(crate) fn warn(&mut self, element: &Element, what: &str) {
        let (file, line) = (element.file.display(), element.line);
        let message = format!("{file}:{line}: {} {what}", element.item());
        self.warnings.push(message);
    }

    /// Scales masses and inertias to the stated total.
    pub(crate) fn scale(&mut self) {
        let Some(total) = self.total.filter(|_| self.weighed > 0.0) else {
            return;
        };
        let factor = total / self.weighed;
        for body in &mut self.bodies {
            body.mass *= factor;
            body.inertia = body.inertia.map(|x| factor * x);
        }
    }

    pub(crate) fn unread(&mut self, root: &Element) {
        for option in root.all("option") {
            for key in ["density", "viscosity"] {
                if option.get(key).is_some_and(|x| x.parse() != Ok(0.0)) {
                    self.warn(option, &format!("has a fluid (`{key}`), which is not read"));
                }
            }
        }
        for (name, what) in UNREAD {
            for element in root.all(name).flat_map(|e| &e.children) {
                self.warn(element, &format!("{what}; it is not read"));
            }
        }
    }
}
