//! From text to [`Description`]: every element once, every value checked.

mod joint;
mod link;
mod reader;
mod tree;

use std::fs;
use std::path::Path;

use roxmltree::{Document, Node};

use crate::description::{Description, Link};
use crate::error::UrdfError;
use joint::resolve_mimics;
use reader::Reader;

impl Description {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read or used; see [`UrdfError`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, UrdfError> {
        let path = path.as_ref();
        let text = fs::read_to_string(path).map_err(|error| UrdfError::Unreadable {
            file: path.to_owned(),
            error,
        })?;
        Self::parse(path, &text)
    }

    /// Reads a text; `file` is its name in messages.
    ///
    /// # Errors
    /// If it cannot be used; see [`UrdfError`].
    pub fn parse(file: impl AsRef<Path>, text: &str) -> Result<Self, UrdfError> {
        description(file.as_ref(), text)
    }
}

fn description(file: &Path, text: &str) -> Result<Description, UrdfError> {
    let document = Document::parse(text).map_err(|error| UrdfError::Xml {
        file: file.to_owned(),
        error,
    })?;
    let reader = Reader {
        file,
        text,
        document: &document,
    };
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(UrdfError::Root {
            file: file.to_owned(),
            line: reader.line(root.range().start),
            found: root.tag_name().name().to_owned(),
        });
    }
    let mut links = Vec::new();
    let mut raw_joints = Vec::new();
    for node in root.children().filter(Node::is_element) {
        if node
            .tag_name()
            .namespace()
            .is_some_and(|n| n.contains("xacro"))
        {
            return Err(UrdfError::Xacro {
                file: file.to_owned(),
                line: reader.line(node.range().start),
                found: format!("xacro:{}", node.tag_name().name()),
            });
        }
        match node.tag_name().name() {
            "link" => links.push(reader.link(node)?),
            "joint" => raw_joints.push(node),
            _ => {}
        }
    }
    let mut warnings = Vec::new();
    let by_name = reader.apart(
        "link",
        links
            .iter()
            .map(|(l, line)| (l.name.as_str(), l.identifier.as_str(), *line)),
    )?;
    let mut joints = Vec::new();
    for &node in &raw_joints {
        joints.push(reader.joint(node, &by_name, &mut warnings)?);
    }
    let links: Vec<Link> = links.into_iter().map(|(link, _)| link).collect();
    let joint_names = reader.apart(
        "joint",
        joints
            .iter()
            .map(|j| (j.name.as_str(), j.identifier.as_str(), j.places.line)),
    )?;
    let mut mimics = Vec::new();
    for (node, joint) in raw_joints.iter().zip(&joints) {
        mimics.push(reader.mimic(*node, joint, &joint_names, &joints)?);
    }
    resolve_mimics(&mut joints, &mimics).map_err(|found| reader.tree(found))?;
    let (root_link, order) = reader.order(&links, &joints)?;
    Ok(Description {
        file: file.to_owned(),
        text: text.to_owned(),
        name: root.attribute("name").unwrap_or("robot").to_owned(),
        links,
        joints,
        root: root_link,
        order,
        warnings,
    })
}
