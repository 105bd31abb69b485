//! Links with their mass distribution.

use roxmltree::Node;

use super::reader::Reader;
use crate::description::{Inertial, Link};
use crate::error::UrdfError;

impl<'a> Reader<'a> {
    /// A link.
    pub(super) fn link(&self, node: Node<'a, 'a>) -> Result<Link, UrdfError> {
        let name = self.name(node, "a link")?;
        let item = format!("link `{name}`");
        let mut link = Link::bare(name, self.line(node.range().start));
        let text = self.text.get(node.range()).unwrap_or("");
        let closed = !node.has_children() && text.ends_with("/>");
        link.places.new = Some((self.after_tag(node), closed));
        let Some(inertial) = self.child(node, &item, "inertial") else {
            return Ok(link);
        };
        link.places.inertial_line = self.line(inertial.range().start);
        let origin = self.child(inertial, &item, "origin");
        let mass = self.child(inertial, &item, "mass").ok_or_else(|| {
            self.missing(
                inertial,
                &item,
                "<mass>",
                "write <mass value=\"…\"/> in kg, or take <inertial> out",
            )
        })?;
        let (com, rpy) = match origin {
            None => ([0.0; 3], [0.0; 3]),
            Some(origin) => (
                self.numbers(origin, &item, "xyz", "inertial origin xyz")?
                    .unwrap_or_default(),
                self.numbers(origin, &item, "rpy", "inertial origin rpy")?
                    .unwrap_or_default(),
            ),
        };
        let mass_value = self
            .number(mass, &item, "value", "mass value")?
            .ok_or_else(|| {
                self.missing(mass, &item, "value of <mass>", "write value=\"…\" in kg")
            })?;
        let tensor = self.child(inertial, &item, "inertia");
        let mut entries = [0.0; 6];
        const KEYS: [(&str, &str); 6] = [
            ("ixx", "inertia ixx"),
            ("iyy", "inertia iyy"),
            ("izz", "inertia izz"),
            ("ixy", "inertia ixy"),
            ("ixz", "inertia ixz"),
            ("iyz", "inertia iyz"),
        ];
        for ((place, entry), (name, key)) in
            link.places.inertia.iter_mut().zip(&mut entries).zip(KEYS)
        {
            let Some(tensor) = tensor else { continue };
            *entry = self.number(tensor, &item, name, key)?.unwrap_or(0.0);
            *place = tensor.attribute_node(name).map(|a| a.range_value());
        }
        link.places.inside = Some(self.after_tag(inertial));
        link.places.origin = origin.map(|o| {
            (
                self.after_name(o),
                o.attribute_node("xyz").map(|a| a.range_value()),
            )
        });
        link.places.mass = mass.attribute_node("value").map(|a| a.range_value());
        link.places.inertia_tag = tensor.map(|t| self.after_name(t));

        // Placeholders without any mass are common on frames.
        if mass_value == 0.0 && entries == [0.0; 6] {
            return Ok(link);
        }
        link.inertial = Some(Inertial {
            mass: mass_value,
            com,
            rpy,
            inertia: entries,
        });
        Ok(link)
    }
}
