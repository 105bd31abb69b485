//! XML of elements with attributes.

use std::io;

use quick_xml::Writer;
use quick_xml::events::{BytesStart, Event};

/// An element.
#[derive(Debug, Clone, Default)]
pub(crate) struct Element {
    name: &'static str,
    attributes: Vec<(&'static str, String)>,
    children: Vec<Element>,
}

impl Element {
    /// One without attributes.
    pub(crate) fn new(name: &'static str) -> Self {
        Self {
            name,
            ..Self::default()
        }
    }
    /// With a text.
    pub(crate) fn with(mut self, key: &'static str, text: impl Into<String>) -> Self {
        self.attributes.push((key, text.into()));
        self
    }
    /// With numbers, each in the fewest digits that give it back.
    pub(crate) fn numbers(self, key: &'static str, numbers: &[f64]) -> Self {
        let words: Vec<String> = numbers.iter().map(|x| number(*x)).collect();
        self.with(key, words.join(" "))
    }
    /// With a child.
    pub(crate) fn child(mut self, child: Element) -> Self {
        self.children.push(child);
        self
    }
    /// Adds a child.
    pub(crate) fn push(&mut self, child: Element) {
        self.children.push(child);
    }
    /// Whether it has no children.
    pub(crate) fn is_empty(&self) -> bool {
        self.children.is_empty()
    }

    /// The text of a file.
    pub(crate) fn text(&self) -> io::Result<String> {
        let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
        self.write(&mut writer)?;
        let mut text = String::from_utf8_lossy(&writer.into_inner()).into_owned();
        text.push('\n');
        Ok(text)
    }

    fn write(&self, writer: &mut Writer<Vec<u8>>) -> io::Result<()> {
        let mut start = BytesStart::new(self.name);
        for (key, text) in &self.attributes {
            // Escapes the text.
            start.push_attribute((*key, text.as_str()));
        }
        if self.children.is_empty() {
            return writer.write_event(Event::Empty(start));
        }
        let end = start.to_end().into_owned();
        writer.write_event(Event::Start(start.borrow()))?;
        for child in &self.children {
            child.write(writer)?;
        }
        writer.write_event(Event::End(end))
    }
}

/// A number in the fewest digits that give it back.
pub(crate) fn number(x: f64) -> String {
    let text = format!("{x:?}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}
