//! From files to [`Log`]s; the format is found by the first bytes, not by the name.

#[cfg(any(feature = "npz", feature = "mat"))]
mod arrays;
#[cfg(feature = "bag")]
mod bag;
#[cfg(feature = "parquet")]
mod lerobot;
#[cfg(feature = "mat")]
mod mat;
#[cfg(feature = "mcap")]
mod mcap;
#[cfg(feature = "npz")]
mod npz;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(any(feature = "mcap", feature = "bag"))]
mod ros;
mod text;

use std::path::{Path, PathBuf};

use crate::error::LogError;
use crate::log::Log;

/// Reads one log: a file, a folder of a ROS 2 bag, a LeRobot folder or a folder of logs. Several
/// logs come out where the file holds several episodes or the folder several files.
///
/// # Errors
/// What is wrong with file, row and mend; see [`LogError`].
pub fn open(path: &Path) -> Result<Vec<Log>, LogError> {
    let file = path.display().to_string();
    if path.is_dir() {
        return folder(path, &file);
    }
    let bytes = std::fs::read(path).map_err(|error| LogError::File {
        file: file.clone(),
        action: "read",
        error,
    })?;
    parse(&file, bytes)
}

fn folder(path: &Path, file: &str) -> Result<Vec<Log>, LogError> {
    if path.join("meta").join("info.json").is_file() {
        #[cfg(feature = "parquet")]
        return lerobot::read(path);
        #[cfg(not(feature = "parquet"))]
        return Err(left_out(file, "LeRobot folder", "parquet"));
    }
    if path.join("dataset.toml").is_file() {
        return Err(LogError::Format {
            file: file.to_owned(),
            found: "is a data set, with its `dataset.toml`".to_owned(),
            mend: "give the folder itself as data set, not as log".to_owned(),
        });
    }
    let mut logs = Vec::new();
    for inner in files_of(path)? {
        logs.extend(open(&inner)?);
    }
    if logs.is_empty() {
        return Err(LogError::Empty {
            file: file.to_owned(),
            what: "the folder has no log".to_owned(),
            mend: "give a folder with .mcap, .db3, .csv, .parquet, .npz or .mat files, or with meta/info.json"
                .to_owned(),
        });
    }
    Ok(logs)
}

/// The files of a folder that are logs by their ending, sorted by name.
fn files_of(path: &Path) -> Result<Vec<PathBuf>, LogError> {
    const ENDINGS: [&str; 8] = ["mcap", "db3", "csv", "tsv", "txt", "parquet", "npz", "mat"];
    let fault = |error| LogError::File {
        file: path.display().to_string(),
        action: "read",
        error,
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).map_err(fault)? {
        let inner = entry.map_err(fault)?.path();
        let ending = inner.extension().and_then(|e| e.to_str()).unwrap_or("");
        if inner.is_file() && ENDINGS.contains(&ending.to_lowercase().as_str()) {
            files.push(inner);
        }
    }
    files.sort();
    Ok(files)
}

/// Reads the bytes of one file; `file` is its name in messages.
///
/// # Errors
/// As [`open`].
pub fn parse(file: &str, bytes: Vec<u8>) -> Result<Vec<Log>, LogError> {
    if bytes.is_empty() {
        return Err(LogError::Empty {
            file: file.to_owned(),
            what: "the file is empty".to_owned(),
            mend: "copy or record it again".to_owned(),
        });
    }
    let other = |found: &str, mend: &str| {
        Err(LogError::Format {
            file: file.to_owned(),
            found: found.to_owned(),
            mend: mend.to_owned(),
        })
    };
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if starts(b"\x89MCAP0\r\n") {
        #[cfg(feature = "mcap")]
        return guarded(file, "MCAP", || mcap::read(file, &bytes));
        #[cfg(not(feature = "mcap"))]
        return Err(left_out(file, "MCAP file", "mcap"));
    }
    if starts(b"SQLite format 3\0") {
        #[cfg(feature = "bag")]
        return guarded(file, "rosbag2", || bag::read(file, bytes));
        #[cfg(not(feature = "bag"))]
        return Err(left_out(file, "rosbag2 file", "bag"));
    }
    if starts(b"PAR1") {
        #[cfg(feature = "parquet")]
        return guarded(file, "Parquet", || parquet::read(file, bytes));
        #[cfg(not(feature = "parquet"))]
        return Err(left_out(file, "Parquet file", "parquet"));
    }
    if starts(b"PK\x03\x04") {
        #[cfg(feature = "npz")]
        return guarded(file, "NPZ", || npz::read(file, &bytes));
        #[cfg(not(feature = "npz"))]
        return Err(left_out(file, "NPZ file", "npz"));
    }
    if starts(b"MATLAB 5.0") {
        #[cfg(feature = "mat")]
        return guarded(file, "MAT", || mat::read(file, &bytes));
        #[cfg(not(feature = "mat"))]
        return Err(left_out(file, "MAT file", "mat"));
    }
    if starts(b"\x89HDF\r\n\x1a\n") || starts(b"MATLAB 7.3") {
        return other(
            "is an HDF5 file (MAT 7.3 is one)",
            "in MATLAB save(…, '-v7'); from Python write NPZ or CSV",
        );
    }
    if starts(b"#ROSBAG") {
        return other(
            "is a ROS 1 bag",
            "run `rosbags-convert --src FILE --dst FOLDER`",
        );
    }
    if starts(b"\x93NUMPY") {
        return other(
            "is a single NumPy array",
            "write times and arrays together: numpy.savez(FILE, t=t, q=q, u=u)",
        );
    }
    if starts(b"\x1f\x8b") || starts(&[0x28, 0xb5, 0x2f, 0xfd]) {
        return other("is packed by gzip or zstd", "unpack it first");
    }
    text::read(file, &bytes)
}

/// Runs a reader of a library; a panic within it is a broken file.
#[cfg(any(
    feature = "mcap",
    feature = "bag",
    feature = "parquet",
    feature = "npz",
    feature = "mat"
))]
fn guarded(
    file: &str,
    format: &'static str,
    read: impl FnOnce() -> Result<Vec<Log>, LogError>,
) -> Result<Vec<Log>, LogError> {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        Err(broken(
            file,
            format,
            "the reader stopped in the middle of it",
        ))
    })
}

/// A broken file, with the mend of its format.
fn broken(file: &str, format: &'static str, message: impl ToString) -> LogError {
    LogError::Broken {
        file: file.to_owned(),
        format,
        message: message.to_string(),
        mend: match format {
            "MCAP" => "`mcap recover FILE -o NEW` saves what is whole",
            "rosbag2" => "`ros2 bag convert` may save what is whole",
            "text" => "save it as UTF-8 text",
            _ => "write it with another program",
        },
    }
}

/// A format that this build does not have.
#[cfg(not(all(
    feature = "mcap",
    feature = "bag",
    feature = "parquet",
    feature = "npz",
    feature = "mat"
)))]
fn left_out(file: &str, found: &str, feature: &str) -> LogError {
    LogError::Format {
        file: file.to_owned(),
        found: format!("is a {found}, which this build does not read"),
        mend: format!("build with the feature `{feature}` of pid-logs"),
    }
}
