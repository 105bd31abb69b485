//! What several tests share.

use pid_data::Dataset;

/// The data set of this name, if the records lie beside the workspace.
pub(crate) fn records(name: &str) -> Option<Dataset> {
    let folder = pid_records::shared(&format!("data/{name}"))?;
    Some(Dataset::read(&folder).expect("readable"))
}
