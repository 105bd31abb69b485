//! The lines of a file, without comments, and the numbers in them.

use std::path::Path;
use std::str::FromStr;

use crate::NlError;

/// Reads a text line by line and says where it is.
pub(crate) struct Lines<'a> {
    file: &'a Path,
    lines: Vec<&'a str>,
    next: usize,
}

impl<'a> Lines<'a> {
    pub(crate) fn new(file: &'a Path, text: &'a str) -> Self {
        let uncommented = |line: &'a str| line.split('#').next().unwrap_or("").trim();
        Self {
            file,
            lines: text.lines().map(uncommented).collect(),
            next: 0,
        }
    }

    /// Lines that are not read yet: no count in the file can be larger.
    pub(crate) fn left(&self) -> usize {
        self.lines.len() - self.next
    }

    /// The next line that is not empty; `None` at the end.
    pub(crate) fn try_next(&mut self) -> Option<&'a str> {
        while let Some(&line) = self.lines.get(self.next) {
            self.next += 1;
            if !line.is_empty() {
                return Some(line);
            }
        }
        None
    }

    /// The next line, of something that must be there.
    pub(crate) fn next(&mut self, item: &str) -> Result<&'a str, NlError> {
        self.try_next().ok_or_else(|| self.end(item))
    }

    /// The file ends too early.
    pub(crate) fn end(&self, item: &str) -> NlError {
        NlError::End {
            file: self.file.to_owned(),
            line: self.lines.len(),
            item: item.to_owned(),
        }
    }

    /// A line that cannot be used.
    pub(crate) fn refuse(&self, item: &str, value: &str, mend: &str) -> NlError {
        NlError::Value {
            file: self.file.to_owned(),
            line: self.next,
            item: item.to_owned(),
            value: value.to_owned(),
            mend: mend.to_owned(),
        }
    }

    /// An operation without usable derivatives.
    pub(crate) fn not_smooth(&self, item: &str, mend: &str) -> NlError {
        NlError::NotSmooth {
            file: self.file.to_owned(),
            line: self.next,
            item: item.to_owned(),
            mend: mend.to_owned(),
        }
    }

    /// A whole number.
    pub(crate) fn whole<T: FromStr>(&self, item: &str, text: &str) -> Result<T, NlError> {
        let refuse = |_| self.refuse(item, text, "write a whole number, 0 or more");
        text.parse().map_err(refuse)
    }

    /// A finite number.
    pub(crate) fn number(&self, item: &str, text: &str) -> Result<f64, NlError> {
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(self.refuse(item, text, "write a finite number")),
        }
    }

    /// A position below a count.
    pub(crate) fn position(&self, item: &str, text: &str, count: usize) -> Result<usize, NlError> {
        let position: usize = self.whole(item, text)?;
        if position < count {
            return Ok(position);
        }
        let mend = format!("write a number below {count}, the count in the head of the file");
        Err(self.refuse(item, text, &mend))
    }

    /// A count of lines that follow.
    pub(crate) fn count(&self, item: &str, text: &str) -> Result<usize, NlError> {
        let count: usize = self.whole(item, text)?;
        if count <= self.left() {
            return Ok(count);
        }
        let mend = format!(
            "{} lines follow; the file is cut or the count wrong",
            self.left()
        );
        Err(self.refuse(item, text, &mend))
    }

    /// A line of a position and a number.
    pub(crate) fn pair(&mut self, item: &str, count: usize) -> Result<(usize, f64), NlError> {
        let line = self.next(item)?;
        let mut words = line.split_whitespace();
        match (words.next(), words.next()) {
            (Some(position), Some(number)) => Ok((
                self.position(item, position, count)?,
                self.number(item, number)?,
            )),
            _ => Err(self.refuse(item, line, "write a position and a number")),
        }
    }
}
