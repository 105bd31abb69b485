use std::fmt;
use std::ops::Range;

use crate::mend;

/// A place in a file, written `file:line:column`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Name of the file.
    pub file: Box<str>,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
}

impl Place {
    /// The place of a byte of a text.
    pub(crate) fn of(file: &str, text: &str, byte: usize) -> Self {
        let before = text.get(..byte.min(text.len())).unwrap_or(text);
        let start = before.rfind('\n').map_or(0, |at| at + 1);
        Self {
            file: file.into(),
            line: count(before.bytes().filter(|&b| b == b'\n').count()),
            column: count(before[start..].chars().count()),
        }
    }
}

/// A count from 0 as a number from 1.
fn count(before: usize) -> u32 {
    u32::try_from(before).unwrap_or(u32::MAX).saturating_add(1)
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.file, self.line, self.column)
    }
}

/// A file that is not TOML, or not of its format. The text shows place, message, line and mend.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {message}{shown}\n  help: {mend}")]
pub struct Mistake {
    /// Where.
    pub place: Place,
    /// What is wrong.
    pub message: String,
    /// The line with the wrong part marked, each line of it begun by a line break; empty for a file
    /// without text.
    pub shown: String,
    /// What to write instead.
    pub mend: String,
}

impl Mistake {
    pub(crate) fn new(file: &str, text: &str, span: Range<usize>, message: &str) -> Self {
        let message = message.trim_end().replace('\n', ", ");
        let place = Place::of(file, text, span.start);
        Self {
            shown: shown(text, &place, &span),
            mend: mend::of(&message),
            place,
            message,
        }
    }
}

/// The line with carets below the span, as far as the span goes on this line.
fn shown(text: &str, place: &Place, span: &Range<usize>) -> String {
    let Some(line) = text.lines().nth(place.line as usize - 1) else {
        return String::new();
    };
    let marked = text
        .get(span.clone())
        .and_then(|part| part.lines().next())
        .map_or(1, |part| part.chars().count().max(1));
    let number = place.line.to_string();
    let blank = " ".repeat(number.len());
    // A tab stays a tab, so that the carets stand below their part.
    let indent: String = line
        .chars()
        .take(place.column as usize - 1)
        .map(|c| if c == '\t' { '\t' } else { ' ' })
        .collect();
    format!(
        "\n  {blank} |\n  {number} | {line}\n  {blank} | {indent}{}",
        "^".repeat(marked)
    )
}
