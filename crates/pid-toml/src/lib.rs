//! TOML files with places. A mistake in a file is told in one form everywhere: file, line and
//! column, the line itself with the wrong part marked, and what to write instead.
//!
//! ```
//! use pid_toml::{Source, Spanned};
//!
//! #[derive(Debug, serde::Deserialize)]
//! #[serde(deny_unknown_fields)]
//! struct Joint {
//!     mass: Spanned<f64>,
//! }
//!
//! let source = Source::new("robot.toml", "masss = 1.5\n");
//! let mistake = source.parse::<Joint>().unwrap_err().to_string();
//! assert!(mistake.starts_with("robot.toml:1:1: unknown field `masss`"));
//! assert!(mistake.ends_with("help: did you mean `mass`?"));
//!
//! let source = Source::new("robot.toml", "mass = -1.5\n");
//! let joint: Joint = source.parse()?;
//! assert_eq!(source.place_of(&joint.mass).to_string(), "robot.toml:1:8");
//! # Ok::<(), pid_toml::Mistake>(())
//! ```

mod mend;
mod place;

use std::ops::Range;

use serde::de::DeserializeOwned;
pub use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

pub use mend::{list, nearest, one_of};
pub use place::{Mistake, Place};

/// Name and text of a file.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    file: &'a str,
    text: &'a str,
}

impl<'a> Source<'a> {
    /// A file by its name in messages and its text.
    pub fn new(file: &'a str, text: &'a str) -> Self {
        Self { file, text }
    }

    /// The name in messages.
    pub fn file(&self) -> &'a str {
        self.file
    }

    /// Reads the whole file. `T` says by `deny_unknown_fields` which keys there are.
    ///
    /// # Errors
    /// [`Mistake`] where the text is not TOML, a key is unknown or missing, or a value has another type.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, Mistake> {
        toml::from_str(self.text).map_err(|e| self.mistake(&e))
    }

    /// Splits the file into its top-level keys, in the order of the file, for files whose keys are
    /// names of joints.
    ///
    /// # Errors
    /// [`Mistake`] where the text is not TOML.
    pub fn tables(&self) -> Result<Vec<Item<'a>>, Mistake> {
        let root = DeTable::parse(self.text).map_err(|e| self.mistake(&e))?;
        let mut items: Vec<Item<'a>> = root
            .into_inner()
            .into_iter()
            .map(|(key, value)| {
                let span = key.span();
                Item {
                    key: Spanned::new(span, key.into_inner().into_owned()),
                    value,
                }
            })
            .collect();
        items.sort_by_key(|item| item.key.span().start);
        Ok(items)
    }

    /// Reads the value of one top-level key.
    ///
    /// # Errors
    /// [`Mistake`] as of [`parse`](Self::parse).
    pub fn read<T: DeserializeOwned>(&self, item: Item<'a>) -> Result<T, Mistake> {
        let key = item.key.span();
        T::deserialize(ValueDeserializer::from(item.value)).map_err(|e| {
            let span = e.span().unwrap_or(key);
            self.told(span, e.message())
        })
    }

    /// Where a span of bytes begins.
    pub fn place(&self, span: Range<usize>) -> Place {
        Place::of(self.file, self.text, span.start)
    }

    /// Where a value begins.
    pub fn place_of<T>(&self, value: &Spanned<T>) -> Place {
        self.place(value.span())
    }

    fn mistake(&self, error: &toml::de::Error) -> Mistake {
        self.told(error.span().unwrap_or(0..0), error.message())
    }

    fn told(&self, span: Range<usize>, message: &str) -> Mistake {
        Mistake::new(self.file, self.text, span, message)
    }
}

/// A top-level key with its value, not yet read.
#[derive(Debug)]
pub struct Item<'a> {
    /// The key and its place.
    pub key: Spanned<String>,
    value: Spanned<DeValue<'a>>,
}

impl Item<'_> {
    /// Whether the value is a table, `[key]`; otherwise it is an array of tables or a plain value.
    pub fn is_table(&self) -> bool {
        self.value.get_ref().is_table()
    }
}

#[cfg(test)]
mod tests;
