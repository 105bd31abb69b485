//! The text of a file, and errors at the places of its values.

use std::path::Path;

use pid_toml::{Place, Spanned};
use serde::de::DeserializeOwned;

use super::error::NominalError;

/// Text and name of a file, from which an error finds its place.
pub(super) struct Source<'a> {
    pub(super) file: &'a Path,
    pub(super) text: &'a str,
}

impl Source<'_> {
    /// The text as a value.
    pub(super) fn parse<T: DeserializeOwned>(&self) -> Result<T, NominalError> {
        let name = self.file.display().to_string();
        let source = pid_toml::Source::new(&name, self.text);
        source.parse().map_err(NominalError::Syntax)
    }

    /// Where a value stands.
    pub(super) fn place<T>(&self, value: &Spanned<T>) -> Place {
        let name = self.file.display().to_string();
        pid_toml::Source::new(&name, self.text).place_of(value)
    }

    /// An error at a value.
    pub(super) fn error<T>(
        &self,
        value: &Spanned<T>,
        item: &str,
        key: &'static str,
        found: impl ToString,
        mend: impl Into<String>,
    ) -> NominalError {
        NominalError::Value {
            place: self.place(value),
            item: item.to_owned(),
            key,
            found: found.to_string(),
            mend: mend.into(),
        }
    }

    /// A finite number that satisfies a condition.
    pub(super) fn number(
        &self,
        value: &Spanned<f64>,
        item: &str,
        key: &'static str,
        holds: impl Fn(f64) -> bool,
        mend: &str,
    ) -> Result<f64, NominalError> {
        let x = *value.get_ref();
        if x.is_finite() && holds(x) {
            return Ok(x);
        }
        Err(self.error(value, item, key, x, mend))
    }

    /// As [`number`](Self::number) for a number that may be left out.
    pub(super) fn optional(
        &self,
        value: Option<&Spanned<f64>>,
        item: &str,
        key: &'static str,
        holds: impl Fn(f64) -> bool,
        mend: &str,
    ) -> Result<Option<f64>, NominalError> {
        value
            .map(|value| self.number(value, item, key, holds, mend))
            .transpose()
    }

    /// Finite numbers.
    pub(super) fn list<const N: usize>(
        &self,
        value: &Spanned<[f64; N]>,
        item: &str,
        key: &'static str,
    ) -> Result<[f64; N], NominalError> {
        match value.get_ref().iter().find(|x| !x.is_finite()) {
            Some(x) => Err(self.error(value, item, key, x, "give finite numbers")),
            None => Ok(*value.get_ref()),
        }
    }

    /// One of some words.
    pub(super) fn word<T: Copy>(
        &self,
        value: &Spanned<String>,
        item: &str,
        key: &'static str,
        words: &[(&str, T)],
    ) -> Result<T, NominalError> {
        let found = value.get_ref();
        match words.iter().find(|(word, _)| word == found) {
            Some(&(_, meaning)) => Ok(meaning),
            None => {
                let names = words.iter().map(|(word, _)| *word);
                let known: Vec<String> = names.clone().map(|w| format!("\"{w}\"")).collect();
                let meant = pid_toml::nearest(found, names)
                    .map_or_else(String::new, |w| format!("; did you mean \"{w}\"?"));
                Err(self.error(
                    value,
                    item,
                    key,
                    format!("\"{found}\""),
                    format!("write one of {}{meant}", known.join(", ")),
                ))
            }
        }
    }
}
