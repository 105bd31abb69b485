//! Masses of meshes: the assets of a model by name, filled with matter of unit density.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pid_derive::mechanism::{Distribution, Place};
use pid_urdf::mesh::{Mesh, Triangle};

use crate::defaults::Defaults;
use crate::element::Element;
use crate::error::MjcfError;
use crate::place::Angles;

/// Meshes by name, each measured when a geom first asks for it.
#[derive(Debug, Default)]
pub(crate) struct Meshes {
    assets: BTreeMap<String, Asset>,
    measured: BTreeMap<String, Result<Distribution, String>>,
}

#[derive(Debug)]
struct Asset {
    element: Element,
    file: Option<PathBuf>,
    /// From the frame of the file to that of the mesh.
    back: Place,
    scale: [f64; 3],
    mode: Mode,
}

/// What of a mesh is filled.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mode {
    /// Tetrahedra over the faces, each counted as positive: MuJoCo's usual way. Right for convex meshes.
    Positive,
    /// The volume inside.
    Inside,
    /// The faces, of unit density by area.
    Faces,
}

impl Meshes {
    /// The assets of a model; their files are looked for in its folder.
    ///
    /// # Errors
    /// A value that is none.
    pub(crate) fn new(
        root: &Element,
        defaults: &Defaults,
        angles: &Angles,
        folder: &Path,
    ) -> Result<Self, MjcfError> {
        let mut out = Self::default();
        let compiler = |key: &str| {
            let stated = root.all("compiler").filter_map(|c| c.get(key));
            stated.last().map(str::to_owned)
        };
        let meshes = compiler("meshdir").or_else(|| compiler("assetdir"));
        let folder = folder.join(meshes.unwrap_or_default());
        let strip = compiler("strippath").as_deref() == Some("true");
        let exact = compiler("exactmeshinertia").as_deref() == Some("true");
        for element in root.all("asset").flat_map(|asset| asset.all("mesh")) {
            let element = defaults.applied(element, None)?;
            let file = element.get("file").map(Path::new);
            let stem = file.and_then(Path::file_stem).and_then(|s| s.to_str());
            let Some(name) = element.get("name").or(stem).map(str::to_owned) else {
                continue;
            };
            let file = match file {
                Some(file) if strip => file.file_name().map(|name| folder.join(name)),
                Some(file) => Some(folder.join(file)),
                None => None,
            };
            let mode = match element.get("inertia") {
                Some("shell") => Mode::Faces,
                Some("exact") => Mode::Inside,
                Some("legacy" | "convex") => Mode::Positive,
                Some(_) => {
                    let mend = "use legacy, exact, convex or shell";
                    return Err(element.error("inertia", mend));
                }
                None if exact => Mode::Inside,
                None => Mode::Positive,
            };
            let asset = Asset {
                file,
                back: reference(&element, angles)?.inverse(),
                scale: element.numbers("scale")?.unwrap_or([1.0; 3]),
                mode,
                element,
            };
            out.assets.insert(name, asset);
        }
        Ok(out)
    }

    /// Mass distribution of a mesh at unit density, in its frame.
    ///
    /// # Errors
    /// Why there is none, as what the mesh is.
    pub(crate) fn filled(&mut self, name: &str) -> Result<Distribution, String> {
        if let Some(known) = self.measured.get(name) {
            return known.clone();
        }
        let found = match self.assets.get(name) {
            Some(asset) => asset
                .filled()
                .map_err(|why| format!("mesh `{name}`, which {why}")),
            None => Err(format!("mesh `{name}`, which is no asset")),
        };
        self.measured.insert(name.to_owned(), found.clone());
        found
    }
}

/// Place of the frame of a mesh in that of its file.
fn reference(element: &Element, angles: &Angles) -> Result<Place, MjcfError> {
    let mut frame = element.clone();
    let named = |(key, value): (String, String)| match key.as_str() {
        "refpos" => Some(("pos".to_owned(), value)),
        "refquat" => Some(("quat".to_owned(), value)),
        _ => None,
    };
    frame.attributes = frame.attributes.into_iter().filter_map(named).collect();
    angles.place(&frame)
}

impl Asset {
    fn filled(&self) -> Result<Distribution, String> {
        let mesh = match &self.file {
            Some(file) => Mesh::read(file)?,
            None => self.inline()?,
        };
        let moved = |p: [f64; 3]| {
            let p = self.back.point(p);
            [0, 1, 2].map(|k| self.scale[k] * p[k])
        };
        let triangles: Vec<Triangle> = mesh.triangles.iter().map(|t| t.map(moved)).collect();
        measured(&triangles, self.mode).ok_or_else(|| "has no volume".to_owned())
    }

    /// Points and faces that stand in the model.
    fn inline(&self) -> Result<Mesh, String> {
        let numbers = |key: &str| self.element.list(key).map_err(|e| e.to_string());
        let points = numbers("vertex")?.ok_or("has neither a file nor vertices")?;
        let faces = numbers("face")?.ok_or("states no faces")?;
        let points = points.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        let faces = faces.chunks_exact(3);
        let faces: Vec<[usize; 3]> = faces
            .map(|c| [c[0] as usize, c[1] as usize, c[2] as usize])
            .collect();
        Ok(Mesh::indexed(points, &faces))
    }
}

/// Mass distribution of triangles at unit density; `None` where there is none.
fn measured(triangles: &[Triangle], mode: Mode) -> Option<Distribution> {
    let centre = middle(triangles)?;
    let mut mass = 0.0;
    let (mut first, mut second) = ([0.0; 3], [[0.0; 3]; 3]);
    for triangle in triangles {
        let p = triangle.map(|p| [0, 1, 2].map(|k| p[k] - centre[k]));
        let normal = normal(&p);
        // A tetrahedron with its fourth corner at the centre, or the triangle itself.
        let (part, corners, pairs) = match mode {
            Mode::Faces => (0.5 * dot(normal, normal).sqrt(), 3.0, 12.0),
            Mode::Inside => (dot(p[0], normal) / 6.0, 4.0, 20.0),
            Mode::Positive => (dot(p[0], normal).abs() / 6.0, 4.0, 20.0),
        };
        let sum = [0, 1, 2].map(|k| p[0][k] + p[1][k] + p[2][k]);
        mass += part;
        for i in 0..3 {
            first[i] += part * sum[i] / corners;
            for j in 0..3 {
                let own: f64 = p.iter().map(|p| p[i] * p[j]).sum();
                second[i][j] += part * (own + sum[i] * sum[j]) / pairs;
            }
        }
    }
    // Faces that all point inwards.
    let sign = f64::signum(mass);
    let mass = mass.abs();
    if !(mass > 0.0 && mass.is_finite()) {
        return None;
    }
    let com = first.map(|x| sign * x / mass);
    let s = |i: usize, j: usize| sign * second[i][j] - mass * com[i] * com[j];
    let out = Distribution {
        mass,
        com: [0, 1, 2].map(|k| com[k] + centre[k]),
        inertia: [
            s(1, 1) + s(2, 2),
            s(0, 0) + s(2, 2),
            s(0, 0) + s(1, 1),
            -s(0, 1),
            -s(0, 2),
            -s(1, 2),
        ],
    };
    let finite = out.inertia.iter().chain(&out.com).all(|x| x.is_finite());
    finite.then_some(out)
}

/// Centre of the area of triangles.
fn middle(triangles: &[Triangle]) -> Option<[f64; 3]> {
    let (mut area, mut sum) = (0.0, [0.0; 3]);
    for triangle in triangles {
        let normal = normal(triangle);
        let part = dot(normal, normal).sqrt();
        area += part;
        for k in 0..3 {
            sum[k] += part * (triangle[0][k] + triangle[1][k] + triangle[2][k]) / 3.0;
        }
    }
    (area > 0.0 && area.is_finite()).then(|| sum.map(|x| x / area))
}

/// Across a triangle, as long as twice its area.
fn normal([a, b, c]: &Triangle) -> [f64; 3] {
    let u = [0, 1, 2].map(|k| b[k] - a[k]);
    let v = [0, 1, 2].map(|k| c[k] - a[k]);
    [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ]
}

fn dot(x: [f64; 3], y: [f64; 3]) -> f64 {
    (0..3).map(|k| x[k] * y[k]).sum()
}
