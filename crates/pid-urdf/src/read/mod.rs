//! From text to [`Description`]: every element once, every value checked.

mod geometry;
mod joint;
mod link;
mod mend;
mod mesh;
mod missing;
mod reader;
mod tolerant;
mod tree;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use roxmltree::Node;

use crate::description::{Description, Link};
use crate::error::UrdfError;
use crate::names;
use crate::reading::Reading;
use geometry::Shapes;
use joint::resolve_mimics;
use reader::Reader;

/// Link that many files name without declaring it: the ground.
const WORLD: &str = "world";

impl Description {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read or used; see [`UrdfError`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, UrdfError> {
        Self::read_with(path, &Reading::default())
    }

    /// Reads a text; `file` is its name in messages.
    ///
    /// # Errors
    /// If it cannot be used; see [`UrdfError`].
    pub fn parse(file: impl AsRef<Path>, text: &str) -> Result<Self, UrdfError> {
        Self::parse_with(file, text, &Reading::default())
    }

    /// Reads a file with other settings. Bytes that are no UTF-8 are taken as Latin-1.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_with(path: impl AsRef<Path>, reading: &Reading) -> Result<Self, UrdfError> {
        let path = path.as_ref();
        let bytes = fs::read(path).map_err(|error| UrdfError::Unreadable {
            file: path.to_owned(),
            error,
        })?;
        let text = match String::from_utf8(bytes) {
            Ok(text) => text,
            Err(error) => error.into_bytes().into_iter().map(char::from).collect(),
        };
        Self::parse_with(path, &text, reading)
    }

    /// Reads a text with other settings.
    ///
    /// # Errors
    /// As [`parse`](Self::parse).
    pub fn parse_with(
        file: impl AsRef<Path>,
        text: &str,
        reading: &Reading,
    ) -> Result<Self, UrdfError> {
        description(file.as_ref(), text, reading)
    }
}

fn description(file: &Path, text: &str, reading: &Reading) -> Result<Description, UrdfError> {
    let no_xml = |error| UrdfError::Xml {
        file: file.to_owned(),
        error,
    };
    let xml = tolerant::accepted(text).map_err(no_xml)?;
    let document = tolerant::parse(&xml.text).map_err(no_xml)?;
    let reader = Reader::new(file, text, &document);
    for warning in &xml.warnings {
        reader.warn_at(warning);
    }
    let (mut description, shapes) = elements(&reader)?;
    reader.hold(&mut description, reading)?;
    missing::guess(&reader, &mut description, &shapes, &reading.missing);
    mend::bodies(&reader, &mut description, reading.strict)?;
    missing::refuse(&reader, &description, &reading.missing)?;
    description.warnings = reader.warnings();
    Ok(description)
}

/// Links and joints as they are written, as one tree, and the geometry of each link.
fn elements<'a>(reader: &Reader<'a>) -> Result<(Description, Vec<Shapes>), UrdfError> {
    let root = reader.document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(UrdfError::Root {
            file: reader.file.to_owned(),
            line: reader.line(root.range().start),
            found: root.tag_name().name().to_owned(),
        });
    }
    let (mut links, mut shapes, mut raw_joints) = (Vec::new(), Vec::new(), Vec::new());
    for node in root.children().filter(Node::is_element) {
        reader.no_xacro(node)?;
        match node.tag_name().name() {
            "link" => {
                links.push(reader.link(node)?);
                shapes.push(Shapes::of(reader, node));
            }
            "joint" => raw_joints.push(node),
            _ => {}
        }
    }
    if let Some(base) = undeclared_base(reader, &links, &raw_joints) {
        links.push(base);
        shapes.push(Shapes::default());
    }
    let by_name = reader.apart(
        "link",
        (links.iter()).map(|l| (l.name.as_str(), l.places.line)),
    )?;
    let mut joints = Vec::new();
    for &node in &raw_joints {
        joints.push(reader.joint(node, &by_name)?);
    }
    let joint_names = reader.apart(
        "joint",
        (joints.iter()).map(|j| (j.name.as_str(), j.places.line)),
    )?;
    let mut mimics = Vec::new();
    for (node, joint) in raw_joints.iter().zip(&joints) {
        mimics.push(reader.mimic(*node, joint, &joint_names)?);
    }
    resolve_mimics(&mut joints, &mimics).map_err(|found| reader.tree(found))?;
    let (root_link, order) = reader.order(&links, &joints)?;
    names::make_apart(links.iter_mut().map(|l| &mut l.identifier));
    names::make_apart(joints.iter_mut().map(|j| &mut j.identifier));
    let description = Description {
        file: reader.file.to_owned(),
        text: reader.text.to_owned(),
        name: root.attribute("name").unwrap_or("robot").to_owned(),
        links,
        joints,
        root: root_link,
        order,
        warnings: Vec::new(),
    };
    Ok((description, shapes))
}

/// The base, where joints hang on it and no element declares it: the ground, or a link of a further file
/// that is the only root. Nothing moves it, so its inertia enters nothing.
fn undeclared_base(reader: &Reader<'_>, links: &[Link], joints: &[Node<'_, '_>]) -> Option<Link> {
    let ends = |name: &'static str| {
        let of = move |joint: &Node<'_, '_>| {
            let end = joint.children().find(|n| n.has_tag_name(name));
            end.and_then(|n| n.attribute("link")).map(str::to_owned)
        };
        joints.iter().filter_map(of)
    };
    let declared: BTreeSet<&str> = links.iter().map(|link| link.name.as_str()).collect();
    let carried: BTreeSet<String> = ends("child").collect();
    let mut missing = ends("parent").filter(|name| !declared.contains(name.as_str()));
    let base = missing.next()?;
    if base == WORLD {
        return Some(Link::bare(WORLD, 0));
    }
    let only = missing.all(|name| name == base) && declared.iter().all(|l| carried.contains(*l));
    (only && !carried.contains(&base)).then(|| {
        let line = joints.first().map_or(1, |j| reader.line(j.range().start));
        reader.warn(
            line,
            format!(
                "link `{base}` carries the others and is not declared; it is taken as the base"
            ),
        );
        Link::bare(&base, 0)
    })
}

/// Names with their places in a list.
pub(super) type Names = BTreeMap<String, usize>;
