//! Default classes: attributes that an element has where it does not state them.

use std::collections::BTreeMap;

use crate::element::Element;
use crate::error::MjcfError;

/// Attributes by class and by element.
#[derive(Debug, Default)]
pub(crate) struct Defaults {
    classes: BTreeMap<String, BTreeMap<String, Element>>,
}

/// The class of elements that name none.
const MAIN: &str = "main";

impl Defaults {
    pub(crate) fn new(root: &Element) -> Self {
        let mut out = Self::default();
        out.classes.insert(MAIN.to_owned(), BTreeMap::new());
        for default in root.all("default") {
            let name = default.get("class").unwrap_or(MAIN);
            let inherited = out.classes.get(MAIN).cloned().unwrap_or_default();
            out.class(default, name, inherited);
        }
        out
    }

    fn class(&mut self, default: &Element, name: &str, mut all: BTreeMap<String, Element>) {
        for child in default.children.iter().filter(|c| c.name != "default") {
            let mut merged = child.clone();
            if let Some(inherited) = all.get(&child.name) {
                for (key, value) in &inherited.attributes {
                    if !excluded(&merged, key) {
                        merged.or_set(key, value);
                        complete(&mut merged, key, value);
                    }
                }
            }
            all.insert(child.name.clone(), merged);
        }
        self.classes.insert(name.to_owned(), all.clone());
        for child in default.all("default") {
            if let Some(name) = child.get("class") {
                self.class(child, name, all.clone());
            }
        }
    }

    /// The element with the attributes of its class, of the nearest `childclass` around it, or of the
    /// main class.
    ///
    /// # Errors
    /// If the class is not there.
    pub(crate) fn applied(
        &self,
        element: &Element,
        childclass: Option<&str>,
    ) -> Result<Element, MjcfError> {
        let class = element.get("class").or(childclass).unwrap_or(MAIN);
        let Some(all) = self.classes.get(class) else {
            let nearest = (self.classes.keys())
                .map(|n| (strsim::osa_distance(class, n), n))
                .filter(|(distance, n)| *distance <= n.chars().count() / 2)
                .min();
            return Err(MjcfError::Unknown {
                file: element.file.to_path_buf(),
                line: element.line,
                item: element.item(),
                what: "default class",
                name: class.to_owned(),
                nearest: nearest.map(|(_, n)| n.clone()),
            });
        };
        let mut out = element.clone();
        if let Some(defaults) = all.get(&element.name) {
            for (key, value) in &defaults.attributes {
                if key != "class" && !excluded(element, key) {
                    out.or_set(key, value);
                    complete(&mut out, key, value);
                }
            }
        }
        for (other, defaults) in all {
            for (key, value) in &defaults.attributes {
                if shared(&element.name, other, key) {
                    out.or_set(key, value);
                }
            }
        }
        Ok(out)
    }
}

/// Drives of all kinds share these in their default class.
fn shared(element: &str, other: &str, key: &str) -> bool {
    const DRIVES: [&str; 6] = [
        "general", "motor", "position", "velocity", "damper", "cylinder",
    ];
    const KEYS: [&str; 5] = [
        "gear",
        "ctrlrange",
        "ctrllimited",
        "forcerange",
        "forcelimited",
    ];
    element != other && DRIVES.contains(&element) && DRIVES.contains(&other) && KEYS.contains(&key)
}

/// Sizes of a geom that states fewer of them than its class: the further ones are those of the class.
fn complete(element: &mut Element, key: &str, inherited: &str) {
    if (element.name.as_str(), key) != ("geom", "size") {
        return;
    }
    for (name, own) in &mut element.attributes {
        let stated = own.split_ascii_whitespace().count();
        if name == key {
            for word in inherited.split_ascii_whitespace().skip(stated) {
                own.push(' ');
                own.push_str(word);
            }
        }
    }
}

/// Orientation is stated in one of several ways: one that the element states replaces all others.
fn excluded(element: &Element, key: &str) -> bool {
    const WAYS: [&str; 6] = ["quat", "axisangle", "euler", "xyaxes", "zaxis", "fromto"];
    WAYS.contains(&key) && WAYS.iter().any(|way| element.get(way).is_some())
}
