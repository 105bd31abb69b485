//! Opens a folder whose records the reader would refuse for their time stamps.

use std::path::Path;

use pid_data::{DataError, Dataset};
use pid_toml::Source;

use crate::finding::{Channel, Finding, FindingKind, Severity, number};

/// A folder as it was opened.
#[derive(Debug, Clone)]
pub struct Opened {
    /// The records, without the rows that were taken out.
    pub dataset: Dataset,
    /// What was taken out.
    pub findings: Vec<Finding>,
    /// Files that changed: name within the folder, new text.
    pub mended: Vec<(String, String)>,
}

/// The part of `dataset.toml` that names the files.
#[derive(serde::Deserialize)]
struct Listing {
    #[serde(default)]
    experiment: Vec<Listed>,
}

#[derive(serde::Deserialize)]
struct Listed {
    file: String,
}

/// Reads a folder as [`Dataset::read`] does, but takes out rows whose time does not increase, and says so.
///
/// # Errors
/// As [`Dataset::read`], for everything else.
pub fn open(folder: &Path) -> Result<Opened, DataError> {
    let first = match Dataset::read(folder) {
        Ok(dataset) => {
            return Ok(Opened {
                dataset,
                findings: Vec::new(),
                mended: Vec::new(),
            });
        }
        Err(error @ DataError::TimeNotIncreasing { .. }) => error,
        Err(error) => return Err(error),
    };
    let text = |name: &str| {
        let path = folder.join(name);
        std::fs::read_to_string(&path).map_err(|error| DataError::Unreadable {
            file: path.display().to_string(),
            error,
        })
    };
    let manifest = text("dataset.toml")?;
    let Ok(listing) = Source::new("dataset.toml", &manifest).parse::<Listing>() else {
        return Err(first);
    };
    let mut files = vec![("dataset.toml".to_owned(), manifest)];
    let (mut findings, mut mended) = (Vec::new(), Vec::new());
    for listed in listing.experiment {
        let old = text(&listed.file)?;
        let new = match increasing(&old) {
            Some(kept) if kept.dropped > 0 => {
                findings.push(finding(&listed.file, &kept));
                mended.push((listed.file.clone(), kept.text.clone()));
                kept.text
            }
            _ => old,
        };
        files.push((listed.file, new));
    }
    let files: Vec<(&str, &str)> = files
        .iter()
        .map(|(a, b)| (a.as_str(), b.as_str()))
        .collect();
    let dataset = Dataset::from_embedded(&files)?;
    Ok(Opened {
        dataset,
        findings,
        mended,
    })
}

/// A record without rows whose time does not increase.
struct Kept {
    text: String,
    /// Rows taken out.
    dropped: usize,
    /// Of these, rows whose time goes back.
    back: usize,
    /// First and last row taken out, from 0 after the header.
    rows: (usize, usize),
    /// Times there, s.
    time: (f64, f64),
}

/// `None` where the text has no column `t`.
fn increasing(text: &str) -> Option<Kept> {
    let mut lines = text.lines();
    let header = lines.next()?;
    let names = header.trim_start_matches('\u{feff}').split(',');
    let column = names
        .map(|n| n.trim().trim_matches('"'))
        .position(|n| n == "t")?;
    let mut kept = Kept {
        text: format!("{header}\n"),
        dropped: 0,
        back: 0,
        rows: (0, 0),
        time: (0.0, 0.0),
    };
    let mut before = f64::NEG_INFINITY;
    for (row, line) in lines.enumerate() {
        let cell = line
            .split(',')
            .nth(column)
            .map(|c| c.trim().trim_matches('"'));
        let time = cell.and_then(|c| c.parse::<f64>().ok());
        if let Some(time) = time.filter(|t| *t <= before) {
            if kept.dropped == 0 {
                (kept.rows.0, kept.time.0) = (row, time);
            }
            (kept.rows.1, kept.time.1) = (row, time);
            kept.dropped += 1;
            kept.back += usize::from(time < before);
            continue;
        }
        before = time.unwrap_or(before);
        kept.text.push_str(line);
        kept.text.push('\n');
    }
    Some(kept)
}

fn finding(file: &str, kept: &Kept) -> Finding {
    let stem = Path::new(file)
        .file_stem()
        .and_then(std::ffi::OsStr::to_str)
        .unwrap_or(file);
    let count = kept.dropped;
    let (sentence, mend) = match kept.back {
        0 => (
            format!("{count} rows of {file} repeat the time of the row before"),
            "remove them; `--fix` keeps the first row of each time",
        ),
        back => (
            format!("{count} rows of {file} do not go on in time, {back} of them go back"),
            "sort the rows by time, or cut the record where the clock was set; `--fix` removes these rows",
        ),
    };
    let mut finding = Finding::new(
        FindingKind::DuplicateStamps { count },
        Severity::Wrong,
        sentence,
        mend,
    )
    .of(&[], Channel::Time)
    .within(stem)
    .with("first of them at", kept.time.0, "s");
    finding.rows = Some(kept.rows);
    finding.time = Some(kept.time);
    if kept.back > 0 {
        finding.sentence = format!("{} (first: {} s)", finding.sentence, number(kept.time.0));
    }
    finding
}
