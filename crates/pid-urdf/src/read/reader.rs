//! Elements and attributes of the text, each error with its line.

use std::cell::RefCell;
use std::path::Path;

use roxmltree::{Attribute, Document, Node};

use super::Names;
use crate::error::{TreeFault, UrdfError};

/// The text of a file.
pub(super) struct Reader<'a> {
    pub(super) file: &'a Path,
    pub(super) text: &'a str,
    pub(super) document: &'a Document<'a>,
    /// What is odd but usable, with its line.
    warnings: RefCell<Vec<String>>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(file: &'a Path, text: &'a str, document: &'a Document<'a>) -> Self {
        Self {
            file,
            text,
            document,
            warnings: RefCell::new(Vec::new()),
        }
    }

    /// Notes what is odd but usable.
    pub(super) fn warn(&self, line: u32, message: impl std::fmt::Display) {
        self.warn_at(&format!("{line}: {message}"));
    }

    /// The same with the line ahead of the message.
    pub(super) fn warn_at(&self, message: &str) {
        let message = format!("{}:{message}", self.file.display());
        self.warnings.borrow_mut().push(message);
    }

    /// All that was noted.
    pub(super) fn warnings(self) -> Vec<String> {
        self.warnings.into_inner()
    }

    /// Whether an element is not one of macros.
    ///
    /// # Errors
    /// If it is.
    pub(super) fn no_xacro(&self, node: Node<'_, '_>) -> Result<(), UrdfError> {
        let namespace = node.tag_name().namespace().unwrap_or("");
        if !namespace.contains("xacro") {
            return Ok(());
        }
        Err(UrdfError::Xacro {
            file: self.file.to_owned(),
            line: self.line(node.range().start),
            found: format!("xacro:{}", node.tag_name().name()),
        })
    }

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

    /// The child element of a name; of several the first, as other readers take it.
    pub(super) fn child(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &'static str,
    ) -> Option<Node<'a, 'a>> {
        let mut found = node
            .children()
            .filter(|n| n.is_element() && n.tag_name().name() == name);
        let first = found.next();
        if let Some(second) = found.next() {
            let line = self.line(second.range().start);
            self.warn(
                line,
                format!("{item} has a second <{name}>; the first one is read"),
            );
        }
        first
    }

    /// A number that enters no equation: what is no finite number is left out, with a warning.
    pub(super) fn hint(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &str,
        key: &'static str,
    ) -> Result<Option<f64>, UrdfError> {
        match self.number(node, item, name, key) {
            Err(UrdfError::Value { line, value, .. }) => {
                // An infinite limit is none.
                if !value
                    .trim_start_matches(['+', '-'])
                    .eq_ignore_ascii_case("inf")
                {
                    self.warn(
                        line,
                        format!("{item}: {key} is \"{value}\"; it is left out"),
                    );
                }
                Ok(None)
            }
            other => other,
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
        let line = self.line(attribute.range().start);
        if value.contains("${") || value.contains("$(") {
            return Err(UrdfError::Xacro {
                file: self.file.to_owned(),
                line,
                found: value.to_owned(),
            });
        }
        let words: Vec<&str> = value.split_ascii_whitespace().collect();
        if let Some(out) = parsed(&words) {
            return Ok(Some(out));
        }
        // Vectors with commas between their numbers, or with a number too many, as other readers
        // take them. One number with a comma may be a decimal, so it is not guessed at.
        let spaced = value.replace(',', " ");
        let words: Vec<&str> = spaced.split_ascii_whitespace().collect();
        let taken = match N {
            1 => None,
            _ => words.get(..N).and_then(parsed),
        };
        let Some(out) = taken else {
            return Err(self.value(&attribute, item, key, plural(N)));
        };
        self.warn(
            line,
            format!("{item}: {key} is \"{value}\"; the first {N} numbers are read"),
        );
        Ok(Some(out))
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

    /// Indices by name; names must differ.
    pub(super) fn apart<'n>(
        &self,
        what: &'static str,
        all: impl Iterator<Item = (&'n str, u32)>,
    ) -> Result<Names, UrdfError> {
        let mut names = Names::new();
        for (index, (name, line)) in all.enumerate() {
            if names.insert(name.to_owned(), index).is_some() {
                return Err(UrdfError::NotUnique {
                    file: self.file.to_owned(),
                    line,
                    what,
                    name: name.to_owned(),
                });
            }
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
        known: &Names,
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
            nearest: nearest(name, known.keys().filter(close)),
        }
    }
}

/// The name that was probably meant.
pub(super) fn nearest<'n>(name: &str, known: impl Iterator<Item = &'n String>) -> Option<String> {
    known
        .map(|n| (strsim::osa_distance(name, n), n))
        .filter(|(distance, n)| *distance <= n.chars().count() / 2)
        .min()
        .map(|(_, n)| n.clone())
}

/// Finite numbers, as many as there are words.
fn parsed<const N: usize>(words: &[&str]) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    if words.len() != N {
        return None;
    }
    for (place, word) in out.iter_mut().zip(words) {
        *place = word.parse().ok().filter(|x: &f64| x.is_finite())?;
    }
    Some(out)
}

fn plural(count: usize) -> String {
    match count {
        1 => "write one finite number".to_owned(),
        _ => format!("write {count} finite numbers with blanks between them"),
    }
}
