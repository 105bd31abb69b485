//! Elements and attributes of the text, each error with its line.

use std::collections::BTreeMap;
use std::path::Path;

use roxmltree::{Attribute, Document, Node};

use crate::error::{TreeFault, UrdfError};

/// The text of a file.
pub(super) struct Reader<'a> {
    pub(super) file: &'a Path,
    pub(super) text: &'a str,
    pub(super) document: &'a Document<'a>,
}

impl<'a> Reader<'a> {
    pub(super) fn line(&self, at: usize) -> u32 {
        self.document.text_pos_at(at).row
    }

    pub(super) fn tree(&self, found: TreeFault) -> UrdfError {
        UrdfError::Tree {
            file: self.file.to_owned(),
            found,
        }
    }

    pub(super) fn missing(
        &self,
        node: Node<'_, '_>,
        item: &str,
        what: &'static str,
        mend: &'static str,
    ) -> UrdfError {
        UrdfError::Missing {
            file: self.file.to_owned(),
            line: self.line(node.range().start),
            item: item.to_owned(),
            what,
            mend,
        }
    }

    pub(super) fn value(
        &self,
        attribute: &Attribute<'_, '_>,
        item: &str,
        key: &'static str,
        mend: impl Into<String>,
    ) -> UrdfError {
        UrdfError::Value {
            file: self.file.to_owned(),
            line: self.line(attribute.range().start),
            item: item.to_owned(),
            key,
            value: attribute.value().to_owned(),
            mend: mend.into(),
        }
    }

    /// The child element of a name, at most one.
    pub(super) fn child(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &'static str,
    ) -> Result<Option<Node<'a, 'a>>, UrdfError> {
        let mut found = node
            .children()
            .filter(|n| n.is_element() && n.tag_name().name() == name);
        let first = found.next();
        match found.next() {
            None => Ok(first),
            Some(second) => Err(UrdfError::Twice {
                file: self.file.to_owned(),
                line: self.line(second.range().start),
                item: item.to_owned(),
                what: name,
            }),
        }
    }

    /// Numbers of an attribute, `None` if it is not there.
    pub(super) fn numbers<const N: usize>(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &str,
        key: &'static str,
    ) -> Result<Option<[f64; N]>, UrdfError> {
        let Some(attribute) = node.attribute_node(name) else {
            return Ok(None);
        };
        let value = attribute.value();
        if value.contains("${") {
            return Err(UrdfError::Xacro {
                file: self.file.to_owned(),
                line: self.line(attribute.range().start),
                found: value.to_owned(),
            });
        }
        let mut out = [0.0; N];
        let mut words = value.split_ascii_whitespace();
        for place in &mut out {
            *place = words
                .next()
                .and_then(|word| word.parse::<f64>().ok())
                .filter(|x| x.is_finite())
                .ok_or_else(|| self.value(&attribute, item, key, plural(N)))?;
        }
        match words.next() {
            None => Ok(Some(out)),
            Some(_) => Err(self.value(&attribute, item, key, plural(N))),
        }
    }

    pub(super) fn number(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &str,
        key: &'static str,
    ) -> Result<Option<f64>, UrdfError> {
        Ok(self.numbers::<1>(node, item, name, key)?.map(|[x]| x))
    }

    pub(super) fn name(&self, node: Node<'a, 'a>, item: &str) -> Result<&'a str, UrdfError> {
        node.attribute("name")
            .ok_or_else(|| self.missing(node, item, "name", "write name=\"…\""))
    }

    /// Indices by name; names must differ, and so must their identifiers.
    pub(super) fn apart<'n>(
        &self,
        what: &'static str,
        all: impl Iterator<Item = (&'n str, &'n str, u32)>,
    ) -> Result<BTreeMap<String, usize>, UrdfError> {
        let mut names = BTreeMap::new();
        let mut identifiers: BTreeMap<&str, &str> = BTreeMap::new();
        for (index, (name, identifier, line)) in all.enumerate() {
            if let Some(other) = identifiers.insert(identifier, name) {
                return Err(UrdfError::Collision {
                    file: self.file.to_owned(),
                    line,
                    what,
                    name: name.to_owned(),
                    other: other.to_owned(),
                    identifier: identifier.to_owned(),
                });
            }
            names.insert(name.to_owned(), index);
        }
        Ok(names)
    }

    /// The place after the name of a start tag, where attributes may be inserted.
    pub(super) fn after_name(&self, node: Node<'_, '_>) -> usize {
        let start = node.range().start + 1;
        let rest = self.text.get(start..).unwrap_or("");
        start
            + rest
                .find(|c: char| c.is_ascii_whitespace() || c == '/' || c == '>')
                .unwrap_or(0)
    }

    /// The place after a start tag: before the first child, or, of an element without children,
    /// before its end tag. For an element written `<a/>` the place of its `/`.
    pub(super) fn after_tag(&self, node: Node<'_, '_>) -> usize {
        if let Some(child) = node.first_child() {
            return child.range().start;
        }
        let range = node.range();
        let text = self.text.get(range.clone()).unwrap_or("");
        let end = if text.ends_with("/>") {
            Some(text.len() - 2)
        } else {
            text.rfind("</")
        };
        range.start + end.unwrap_or(0)
    }

    pub(super) fn unknown(
        &self,
        node: Node<'_, '_>,
        item: &str,
        what: &'static str,
        name: &str,
        known: &BTreeMap<String, usize>,
    ) -> UrdfError {
        // A name beyond some length is no slip of another, and the distance costs the product of
        // the lengths.
        let close = |n: &&String| n.len() < 200 && name.len() < 200;
        UrdfError::Unknown {
            file: self.file.to_owned(),
            line: self.line(node.range().start),
            item: item.to_owned(),
            what,
            name: name.to_owned(),
            nearest: known
                .keys()
                .filter(close)
                .map(|n| (strsim::osa_distance(name, n), n))
                .filter(|(distance, n)| *distance <= n.chars().count() / 2)
                .min()
                .map(|(_, n)| n.clone()),
        }
    }
}

fn plural(count: usize) -> String {
    match count {
        1 => "write one finite number".to_owned(),
        _ => format!("write {count} finite numbers with blanks between them"),
    }
}
