//! Records kept beside the workspace.

use std::path::{Path, PathBuf};

use pid_data::Dataset;

/// A file or folder below `../shared` beside the workspace; `None`, with a printed line, when it is absent.
pub fn path(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared")
        .join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: there is no ../shared/{name} beside the workspace");
    None
}

/// The data set of that name, if the folder is there.
///
/// # Panics
/// If the folder is there and cannot be read.
pub fn dataset(name: &str) -> Option<Dataset> {
    let folder = path(&format!("data/{name}"))?;
    Some(Dataset::read(&folder).unwrap_or_else(|e| panic!("{e}")))
}
