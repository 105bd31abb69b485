//! The elements of a model with the files it includes, and their attributes as numbers.

use std::fs;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use roxmltree::{Document, Node};

use crate::error::MjcfError;

/// Elements in each other, and files including files.
const DEEPEST: usize = 200;

/// An element; included files stand where they are included.
#[derive(Debug, Clone)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) attributes: Vec<(String, String)>,
    pub(crate) children: Vec<Element>,
    pub(crate) file: Rc<PathBuf>,
    pub(crate) line: u32,
}

/// Reads a text and the files it includes.
pub(crate) fn read(file: &Path, text: &str) -> Result<Element, MjcfError> {
    let mut root = parsed(file, text)?;
    if root.name != "mujoco" {
        return Err(MjcfError::Root {
            file: file.to_owned(),
            line: root.line,
            found: root.name,
        });
    }
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    include(&mut root, &folder, 0)?;
    Ok(root)
}

fn parsed(file: &Path, text: &str) -> Result<Element, MjcfError> {
    let document = Document::parse(text).map_err(|error| MjcfError::Xml {
        file: file.to_owned(),
        error,
    })?;
    owned(
        &document,
        document.root_element(),
        &Rc::new(file.to_owned()),
        0,
    )
}

fn owned(
    document: &Document<'_>,
    node: Node<'_, '_>,
    file: &Rc<PathBuf>,
    depth: usize,
) -> Result<Element, MjcfError> {
    let line = document.text_pos_at(node.range().start).row;
    if depth > DEEPEST {
        return Err(MjcfError::Deep {
            file: file.to_path_buf(),
            line,
            most: DEEPEST,
        });
    }
    let children = node.children().filter(Node::is_element);
    Ok(Element {
        name: node.tag_name().name().to_owned(),
        attributes: node
            .attributes()
            .map(|a| (a.name().to_owned(), a.value().to_owned()))
            .collect(),
        children: children
            .map(|child| owned(document, child, file, depth + 1))
            .collect::<Result<_, _>>()?,
        file: Rc::clone(file),
        line,
    })
}

/// Puts the elements of included files in the places of `<include>`. Paths are relative to the folder
/// of the model.
fn include(element: &mut Element, folder: &Path, depth: usize) -> Result<(), MjcfError> {
    if depth > DEEPEST {
        return Err(MjcfError::Deep {
            file: element.file.to_path_buf(),
            line: element.line,
            most: DEEPEST,
        });
    }
    let mut children = Vec::new();
    for mut child in std::mem::take(&mut element.children) {
        if child.name != "include" {
            include(&mut child, folder, depth + 1)?;
            children.push(child);
            continue;
        }
        let path = folder.join(child.get("file").unwrap_or(""));
        let text = fs::read_to_string(&path).map_err(|error| MjcfError::Unreadable {
            file: path.clone(),
            error,
        })?;
        let mut other = parsed(&path, &text)?;
        include(&mut other, folder, depth + 1)?;
        children.append(&mut other.children);
    }
    element.children = children;
    Ok(())
}

impl Element {
    /// An attribute as written.
    pub(crate) fn get(&self, key: &str) -> Option<&str> {
        let found = self.attributes.iter().find(|(name, _)| name == key);
        found.map(|(_, value)| value.as_str())
    }

    /// Sets an attribute that is not there.
    pub(crate) fn or_set(&mut self, key: &str, value: &str) {
        if self.get(key).is_none() {
            self.attributes.push((key.to_owned(), value.to_owned()));
        }
    }

    /// Children of a name.
    pub(crate) fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// The element in messages.
    pub(crate) fn item(&self) -> String {
        match self.get("name") {
            Some(name) => format!("{} `{name}`", self.name),
            None => format!("a <{}>", self.name),
        }
    }

    pub(crate) fn error(&self, key: &str, mend: impl Into<String>) -> MjcfError {
        MjcfError::Value {
            file: self.file.to_path_buf(),
            line: self.line,
            item: self.item(),
            key: key.to_owned(),
            value: self.get(key).unwrap_or("").to_owned(),
            mend: mend.into(),
        }
    }

    pub(crate) fn unsupported(&self, what: &'static str, mend: &'static str) -> MjcfError {
        MjcfError::Unsupported {
            file: self.file.to_path_buf(),
            line: self.line,
            item: self.item(),
            what,
            mend,
        }
    }

    /// Finite numbers of an attribute, however many; `None` if it is not there.
    pub(crate) fn list(&self, key: &str) -> Result<Option<Vec<f64>>, MjcfError> {
        let Some(value) = self.get(key) else {
            return Ok(None);
        };
        let number = |word: &str| word.parse().ok().filter(|x: &f64| x.is_finite());
        let words = value.split_ascii_whitespace().map(number);
        match words.collect() {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.error(key, "write finite numbers with blanks between them")),
        }
    }

    /// As many numbers as asked for; more are an error.
    pub(crate) fn numbers<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>, MjcfError> {
        let Some(list) = self.list(key)? else {
            return Ok(None);
        };
        match list.try_into() {
            Ok(numbers) => Ok(Some(numbers)),
            Err(_) => Err(self.error(key, format!("write {N} finite numbers"))),
        }
    }

    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>, MjcfError> {
        Ok(self.numbers::<1>(key)?.map(|[x]| x))
    }
}
