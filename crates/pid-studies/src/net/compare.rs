//! The first difference between two files of JSON or text.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::ErrorKind;
use std::path::Path;

use serde_json::value::RawValue;

use super::Failure;

/// Fields that hold times of a run: they differ between any two runs.
const TIMES: [&str; 2] = ["seconds", "created"];

/// The first place at which two files differ.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Path in the JSON, `ranking[2].score`, or line of a text.
    pub place: String,
    /// As recorded.
    pub before: String,
    /// As it is now.
    pub now: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, before, now } = self;
        write!(f, "{place}: {before} before, {now} now")
    }
}

/// What stands for a value that one side does not have.
const ABSENT: &str = "(absent)";

/// A value in at most 80 characters.
fn short(text: Option<&str>) -> String {
    let text = text.unwrap_or(ABSENT);
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

fn unequal(place: String, before: Option<&str>, now: Option<&str>) -> Difference {
    Difference {
        place,
        before: short(before),
        now: short(now),
    }
}

/// The first difference of two JSON values, digits as they are written; times are left out. `None`
/// where they are equal.
///
/// # Errors
/// If one of them is not JSON.
pub fn difference(before: &str, now: &str) -> Result<Option<Difference>, serde_json::Error> {
    values("", before.trim(), now.trim())
}

fn values(place: &str, before: &str, now: &str) -> Result<Option<Difference>, serde_json::Error> {
    match (before.chars().next(), now.chars().next()) {
        (Some('{'), Some('{')) => {
            let before: BTreeMap<String, &RawValue> = serde_json::from_str(before)?;
            let now: BTreeMap<String, &RawValue> = serde_json::from_str(now)?;
            let names: BTreeSet<&String> = before.keys().chain(now.keys()).collect();
            for name in names.into_iter().filter(|n| !TIMES.contains(&n.as_str())) {
                let dot = if place.is_empty() { "" } else { "." };
                let place = format!("{place}{dot}{name}");
                if let Some(d) = both(&place, before.get(name), now.get(name))? {
                    return Ok(Some(d));
                }
            }
            Ok(None)
        }
        (Some('['), Some('[')) => {
            let before: Vec<&RawValue> = serde_json::from_str(before)?;
            let now: Vec<&RawValue> = serde_json::from_str(now)?;
            for k in 0..before.len().max(now.len()) {
                if let Some(d) = both(&format!("{place}[{k}]"), before.get(k), now.get(k))? {
                    return Ok(Some(d));
                }
            }
            Ok(None)
        }
        _ => Ok((before != now).then(|| unequal(place.to_owned(), Some(before), Some(now)))),
    }
}

fn both(
    place: &str,
    before: Option<&&RawValue>,
    now: Option<&&RawValue>,
) -> Result<Option<Difference>, serde_json::Error> {
    match (before.map(|v| v.get()), now.map(|v| v.get())) {
        (Some(before), Some(now)) => values(place, before, now),
        (before, now) => Ok(Some(unequal(place.to_owned(), before, now))),
    }
}

/// The first line in which two texts differ.
fn lines(before: &str, now: &str) -> Option<Difference> {
    let (mut a, mut b) = (before.lines(), now.lines());
    for number in 1.. {
        match (a.next(), b.next()) {
            (None, None) => break,
            (x, y) if x == y => {}
            (x, y) => return Some(unequal(format!("line {number}"), x, y)),
        }
    }
    None
}

/// The first difference between two files; one that is missing differs as a whole.
pub(super) fn of_files(before: &Path, now: &Path) -> Result<Option<Difference>, Failure> {
    let read = |path: &Path| match std::fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(Failure::from(format!("{}: {e}", path.display()))),
    };
    match (read(before)?, read(now)?) {
        (Some(a), Some(b)) if before.extension().is_some_and(|e| e == "json") => {
            difference(&a, &b).map_err(|e| format!("{}: {e}", now.display()).into())
        }
        (Some(a), Some(b)) => Ok(lines(&a, &b)),
        (a, b) => {
            let words = |side: &Option<String>| side.as_ref().map(|_| "there");
            Ok(Some(unequal("file".to_owned(), words(&a), words(&b))))
        }
    }
}

/// Paths of all files below a folder, relative to it and sorted; none where the folder is absent.
pub(super) fn files(folder: &Path) -> Result<BTreeSet<String>, Failure> {
    below(folder, &|_| true)
}

/// The same of the source files of a workspace that may declare robots: folders of builds, hidden
/// folders and the catalogue of refused declarations are left out.
pub(super) fn sources(root: &Path) -> Result<BTreeSet<String>, Failure> {
    let enters = |folder: &Path| {
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        !name.starts_with('.') && name != "ui" && !folder.join("CACHEDIR.TAG").exists()
    };
    let mut found = below(root, &enters)?;
    found.retain(|name| name.ends_with(".rs"));
    Ok(found)
}

fn below(folder: &Path, enters: &dyn Fn(&Path) -> bool) -> Result<BTreeSet<String>, Failure> {
    let mut found = BTreeSet::new();
    let mut left = vec![folder.to_owned()];
    while let Some(here) = left.pop() {
        let entries = match std::fs::read_dir(&here) {
            Ok(entries) => entries,
            Err(e) if e.kind() == ErrorKind::NotFound => continue,
            Err(e) => return Err(format!("{}: {e}", here.display()).into()),
        };
        for entry in entries {
            let path = entry?.path();
            if path.is_dir() {
                if enters(&path) {
                    left.push(path);
                }
            } else if let Ok(name) = path.strip_prefix(folder) {
                found.insert(name.to_string_lossy().into_owned());
            }
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(before: &str, now: &str) -> Option<Difference> {
        difference(before, now).expect("JSON")
    }

    #[test]
    fn the_last_digit_counts_and_times_do_not() {
        let before = r#"{"seconds": 1.5, "a": [1.0, {"b": 0.1}]}"#;
        assert_eq!(
            found(before, r#"{"a": [1.0, {"b": 0.1}], "seconds": 2}"#),
            None
        );
        let d = found(
            before,
            r#"{"seconds": 1.5, "a": [1.0, {"b": 0.10000000000000002}]}"#,
        );
        assert_eq!(
            d.expect("they differ").to_string(),
            "a[1].b: 0.1 before, 0.10000000000000002 now"
        );
    }

    #[test]
    fn what_one_side_lacks_is_a_difference() {
        assert_eq!(found("[1]", "[1, 2]").expect("longer").before, ABSENT);
        assert_eq!(found(r#"{"a": 1}"#, "{}").expect("shorter").now, ABSENT);
        assert!(difference("{", "{").is_err());
        assert_eq!(lines("a\nb", "a\nc").expect("differ").place, "line 2");
        assert_eq!(lines("a\n", "a\n"), None);
    }
}
