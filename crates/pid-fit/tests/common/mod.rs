//! What several tests share.

use std::path::PathBuf;

use pid_data::Dataset;

/// The data set of this name, if the records lie beside the workspace.
pub(crate) fn records(name: &str) -> Option<Dataset> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/data")
        .join(name);
    if !folder.is_dir() {
        eprintln!("skipped: no records at {}", folder.display());
        return None;
    }
    Some(Dataset::read(&folder).expect("readable"))
}
