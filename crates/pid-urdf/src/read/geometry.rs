//! Shapes of links, for inertias that are guessed from them.

use pid_derive::mechanism::{Distribution, Place};
use roxmltree::Node;

use super::mesh;
use super::reader::Reader;
use crate::reading::Guess;

/// Shapes of a link: those it collides with, and those that are shown.
#[derive(Debug, Default)]
pub(super) struct Shapes {
    collision: Vec<Shape>,
    visual: Vec<Shape>,
}

/// A shape in the frame of its link.
#[derive(Debug)]
struct Shape {
    place: Place,
    form: Result<Form, String>,
}

/// What fills it. Lengths in m.
#[derive(Debug)]
enum Form {
    Box([f64; 3]),
    Cylinder { radius: f64, length: f64 },
    Sphere(f64),
    Mesh { path: String, scale: [f64; 3] },
}

/// A mass distribution of unit density, and what it was made of.
pub(super) struct Filled {
    pub(super) distribution: Distribution,
    pub(super) of: String,
}

impl Shapes {
    pub(super) fn of<'a>(reader: &Reader<'a>, link: Node<'a, 'a>) -> Self {
        let all = |name: &str| -> Vec<Shape> {
            let elements = link.children().filter(|n| n.has_tag_name(name));
            elements.map(|n| Shape::of(reader, n)).collect()
        };
        Self {
            collision: all("collision"),
            visual: all("visual"),
        }
    }

    /// All shapes of the link filled with unit density: those it collides with or, if it has none,
    /// those that are shown.
    ///
    /// # Errors
    /// Why a shape cannot be filled.
    pub(super) fn filled(&self, file: &std::path::Path, guess: &Guess) -> Result<Filled, String> {
        let (shapes, kind) = match (self.collision.is_empty(), self.visual.is_empty()) {
            (false, _) => (&self.collision, "collision"),
            (true, false) => (&self.visual, "visual"),
            (true, true) => return Err("it has no geometry".to_owned()),
        };
        let mut all = Distribution::default();
        let mut words = Vec::new();
        for shape in shapes {
            let (part, word) = shape.filled(file, guess)?;
            all = all.with(&part.placed(&shape.place));
            if !words.contains(&word) {
                words.push(word);
            }
        }
        if all.mass.is_finite() && all.mass > 0.0 {
            return Ok(Filled {
                distribution: all,
                of: format!("{kind} geometry ({})", words.join(", ")),
            });
        }
        Err("its geometry has no volume".to_owned())
    }
}

impl Shape {
    fn of<'a>(reader: &Reader<'a>, node: Node<'a, 'a>) -> Self {
        let vector = |n: Node<'a, 'a>, key: &str| -> [f64; 3] {
            let read = reader.numbers::<3>(n, "a shape", key, "origin");
            read.ok().flatten().unwrap_or_default()
        };
        let place = match node.children().find(|n| n.has_tag_name("origin")) {
            Some(origin) => Place::new(vector(origin, "xyz"), vector(origin, "rpy")),
            None => Place::IDENTITY,
        };
        let form = node
            .children()
            .find(|n| n.has_tag_name("geometry"))
            .and_then(|geometry| geometry.first_element_child())
            .map_or_else(
                || Err("a shape has no geometry".to_owned()),
                |form| Form::of(reader, form),
            );
        Self { place, form }
    }

    /// Filled with unit density, in its own frame.
    fn filled(
        &self,
        file: &std::path::Path,
        guess: &Guess,
    ) -> Result<(Distribution, String), String> {
        let at = |com: [f64; 3], sides: [f64; 3]| Distribution {
            com,
            ..cuboid(sides)
        };
        Ok(match self.form.as_ref().map_err(Clone::clone)? {
            Form::Box(sides) => (cuboid(*sides), "box".to_owned()),
            Form::Sphere(r) => {
                let mass = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
                let j = 0.4 * mass * r * r;
                (body(mass, [j, j, j]), "sphere".to_owned())
            }
            Form::Cylinder { radius, length } => {
                let mass = std::f64::consts::PI * radius * radius * length;
                let across = mass * (3.0 * radius * radius + length * length) / 12.0;
                let along = 0.5 * mass * radius * radius;
                (body(mass, [across, across, along]), "cylinder".to_owned())
            }
            Form::Mesh { path, scale } => {
                let (bounds, moved) = mesh::bounds(file, path, &guess.packages)?;
                let sides = [0, 1, 2].map(|k| ((bounds.high[k] - bounds.low[k]) * scale[k]).abs());
                let com = [0, 1, 2].map(|k| 0.5 * (bounds.high[k] + bounds.low[k]) * scale[k]);
                let word = moved.map_or_else(
                    || "bounding box of a mesh".to_owned(),
                    |found| {
                        let found = found.display();
                        format!("bounding box of a mesh: `{path}` leads nowhere, {found} is read")
                    },
                );
                (at(com, sides), word)
            }
        })
    }
}

/// A body about its centre, kg and kg·m².
fn body(mass: f64, [xx, yy, zz]: [f64; 3]) -> Distribution {
    Distribution {
        mass,
        com: [0.0; 3],
        inertia: [xx, yy, zz, 0.0, 0.0, 0.0],
    }
}

/// A cuboid of unit density.
fn cuboid([x, y, z]: [f64; 3]) -> Distribution {
    let mass = x * y * z;
    let j = |a: f64, b: f64| mass * (a * a + b * b) / 12.0;
    body(mass, [j(y, z), j(x, z), j(x, y)])
}

impl Form {
    fn of<'a>(reader: &Reader<'a>, node: Node<'a, 'a>) -> Result<Self, String> {
        let name = node.tag_name().name();
        let text = |e: crate::error::UrdfError| e.to_string();
        let numbers = |key: &str| -> Result<[f64; 3], String> {
            let read = reader.numbers::<3>(node, "a shape", key, "size or scale");
            read.map_err(text)?
                .ok_or_else(|| format!("a {name} has no {key}"))
        };
        let number = |key: &str| -> Result<f64, String> {
            let read = reader.number(node, "a shape", key, "radius or length");
            read.map_err(text)?
                .map(f64::abs)
                .ok_or_else(|| format!("a {name} has no {key}"))
        };
        match name {
            "box" => Ok(Self::Box(numbers("size")?.map(f64::abs))),
            "sphere" => Ok(Self::Sphere(number("radius")?)),
            "cylinder" => Ok(Self::Cylinder {
                radius: number("radius")?,
                length: number("length")?,
            }),
            "mesh" => Ok(Self::Mesh {
                path: node.attribute("filename").unwrap_or("").to_owned(),
                scale: match node.attribute("scale") {
                    Some(_) => numbers("scale")?,
                    None => [1.0; 3],
                },
            }),
            other => Err(format!("a {other} is no box, cylinder, sphere or mesh")),
        }
    }
}
