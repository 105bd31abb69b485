//! `pid-studies robot-files`: reads every URDF and MJCF of a folder tree, and tells what is read, and what
//! is refused and why.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use clap::Args;
use pid_mjcf::Mjcf;
use pid_urdf::{Description, Guess, Missing, Reading};
use serde::Serialize;

use crate::{Failure, write};

/// Arguments of `pid-studies robot-files`.
#[derive(Debug, Clone, Args)]
pub struct RobotFilesArgs {
    /// Folder that is searched, with all below it.
    folder: PathBuf,
    /// Guess the inertias of links without one, as `--inertias guess` does.
    #[arg(long)]
    guess: bool,
    /// Mass of a link without inertia whose geometry cannot be read, kg.
    #[arg(long, value_name = "KG", requires = "guess")]
    otherwise: Option<f64>,
    /// File for one line of JSON a robot.
    #[arg(long, short, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// The two formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// `<robot>`.
    Urdf,
    /// `<mujoco>`.
    Mjcf,
}

/// What became of a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Read, with moving joints and warnings.
    Read {
        /// Joints that move.
        joints: usize,
        /// Warnings.
        warnings: Vec<String>,
    },
    /// Nothing in it moves.
    Still,
    /// Refused.
    Refused {
        /// Name of the error's variant.
        kind: String,
        /// The message.
        message: String,
    },
    /// A panic: a fault of the reader.
    Panicked,
}

/// A file with its outcome.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The file.
    pub file: PathBuf,
    /// Its format.
    pub format: Format,
    /// What became of it.
    pub outcome: Outcome,
}

/// Runs the command: a table, every refusal with its message, and with `--out` a line of JSON a file.
///
/// # Errors
/// A folder that cannot be read, a file that cannot be written.
pub fn run(args: &RobotFilesArgs) -> Result<(), Failure> {
    let mut reading = Reading::default();
    if args.guess {
        let mut guess = Guess::default();
        guess.otherwise = args.otherwise;
        reading.missing = Missing::Guess(guess);
    }
    let rows = read_all(&args.folder, &reading)?;
    if let Some(out) = &args.out {
        let lines: Result<Vec<String>, _> = rows.iter().map(serde_json::to_string).collect();
        write(out, &(lines?.join("\n") + "\n"))?;
    }
    print!("{}", table(&rows));
    Ok(())
}

/// Reads all robots below a folder, files of equal content once. A part that another file includes is
/// no robot.
///
/// # Errors
/// A folder that cannot be read.
pub fn read_all(folder: &Path, reading: &Reading) -> Result<Vec<Row>, Failure> {
    let mut files = Vec::new();
    walk(folder, &mut files)?;
    files.sort();
    let (mut seen, mut parts) = (BTreeSet::new(), BTreeSet::new());
    let mut robots = Vec::new();
    for file in files {
        let Ok(bytes) = fs::read(&file) else { continue };
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let Some(format) = format(&file, &text) else {
            continue;
        };
        parts.extend(included(&file, &text));
        robots.push((file, format, text));
    }
    // Copies of one robot in several repositories count once.
    robots.retain(|(file, _, text)| {
        let part = file.canonicalize().is_ok_and(|f| parts.contains(&f));
        !part && seen.insert(text.clone())
    });
    let rows = robots.into_iter().map(|(file, format, text)| Row {
        outcome: outcome(&file, format, &text, reading),
        file,
        format,
    });
    Ok(rows.collect())
}

fn walk(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let entries = fs::read_dir(folder)
        .map_err(|error| format!("{}: cannot be read: {error}", folder.display()))?;
    for entry in entries {
        let entry = entry?;
        let path = entry.path();
        if entry.file_type()?.is_dir() {
            walk(&path, files)?;
        } else if path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("urdf") || e.eq_ignore_ascii_case("xml"))
        {
            files.push(path);
        }
    }
    Ok(())
}

/// The format: every `.urdf`, and an XML file by its root element.
fn format(file: &Path, text: &str) -> Option<Format> {
    if file
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("urdf"))
    {
        return Some(Format::Urdf);
    }
    let root = text.match_indices('<').find_map(|(at, _)| {
        let name = &text[at + 1..];
        name.starts_with(|c: char| c.is_ascii_alphabetic())
            .then(|| name.split(|c: char| !c.is_ascii_alphanumeric()).next())?
    });
    (root == Some("mujoco")).then_some(Format::Mjcf)
}

/// Files that a model includes, and models that it attaches.
fn included(file: &Path, text: &str) -> Vec<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new("."));
    let parts = text.split("<include").skip(1).filter_map(|rest| {
        let element = rest.split('>').next()?;
        let value = element.split("file=").nth(1)?;
        let quote = value.chars().next()?;
        folder
            .join(value[1..].split(quote).next()?)
            .canonicalize()
            .ok()
    });
    parts.collect()
}

fn outcome(file: &Path, format: Format, text: &str, reading: &Reading) -> Outcome {
    let read = catch_unwind(AssertUnwindSafe(|| match format {
        Format::Urdf => urdf(file, text, reading),
        Format::Mjcf => mjcf(file, text),
    }));
    read.unwrap_or(Outcome::Panicked)
}

fn urdf(file: &Path, text: &str, reading: &Reading) -> Outcome {
    let moves = ["revolute", "continuous", "prismatic", "floating", "planar"];
    let refused = |kind: String, message: String| {
        // Of a file that cannot be read, its words tell whether something would move.
        let any = moves.iter().any(|m| text.contains(&format!("\"{m}\"")));
        if any || kind == "Xacro" || kind == "Xml" {
            Outcome::Refused { kind, message }
        } else {
            Outcome::Still
        }
    };
    let description = match Description::read_with(file, reading) {
        Ok(description) => description,
        Err(error) => return refused(variant(&error), error.to_string()),
    };
    let mechanism = description.mechanism([0.0, 0.0, -9.81]);
    match mechanism.bodies.len() {
        // All joints are floating or planar, and held.
        0 => Outcome::Still,
        joints => Outcome::Read {
            joints,
            warnings: description.warnings,
        },
    }
}

fn mjcf(file: &Path, text: &str) -> Outcome {
    match Mjcf::read(file) {
        Ok(model) => Outcome::Read {
            joints: model.mechanism.bodies.len(),
            warnings: model.warnings,
        },
        Err(pid_mjcf::MjcfError::NothingMoves { .. }) => Outcome::Still,
        Err(_) if !text.contains("<joint") && !text.contains("<freejoint") => Outcome::Still,
        Err(error) => Outcome::Refused {
            kind: variant(&error),
            message: error.to_string(),
        },
    }
}

/// Name of an error's variant.
fn variant(error: &impl std::fmt::Debug) -> String {
    let text = format!("{error:?}");
    let end = text.find(|c: char| !c.is_ascii_alphanumeric());
    text[..end.unwrap_or(text.len())].to_owned()
}

/// Counts by format, then every refusal by its kind.
#[must_use]
pub fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<7} {:>7} {:>15} {:>6} {:>6} {:>14} {:>8} {:>8}\n",
        "format", "files", "nothing moves", "moving", "read", "with warnings", "refused", "panics"
    );
    let mut refusals: BTreeMap<(Format, &str), Vec<String>> = BTreeMap::new();
    for format in [Format::Urdf, Format::Mjcf] {
        let (mut files, mut still, mut read, mut warned, mut refused, mut panics) =
            (0, 0, 0, 0, 0, 0);
        for row in rows.iter().filter(|row| row.format == format) {
            files += 1;
            match &row.outcome {
                Outcome::Still => still += 1,
                Outcome::Read { warnings, .. } => {
                    read += 1;
                    warned += usize::from(!warnings.is_empty());
                }
                Outcome::Refused { kind, message } => {
                    refused += 1;
                    let all = refusals.entry((format, kind)).or_default();
                    all.push(message.replace('\n', " "));
                }
                Outcome::Panicked => {
                    panics += 1;
                    let all = refusals.entry((format, "panic")).or_default();
                    all.push(row.file.display().to_string());
                }
            }
        }
        let name = match format {
            Format::Urdf => "urdf",
            Format::Mjcf => "mjcf",
        };
        text += &format!(
            "{name:<7} {files:>7} {still:>15} {:>6} {read:>6} {warned:>14} {refused:>8} {panics:>8}\n",
            files - still
        );
    }
    for ((format, kind), all) in &refusals {
        text += &format!("\n{format:?}, {kind}: {}\n", all.len());
        for line in all {
            text += &format!("  {line}\n");
        }
    }
    text
}
