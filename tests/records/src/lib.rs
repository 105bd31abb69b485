//! Where tests find measured records, and what they do without.
//!
//! Measured records are not part of the workspace: their licences differ. They lie in the folder
//! `shared` beside the workspace, or in the folder that the environment variable `PID_SHARED`
//! names. Where that folder is, a record that is missing fails its test. Where it is not, the test
//! is skipped, and the skip is counted: a line in the file that the environment variable
//! `PID_SKIPPED` names, in `skipped-tests.txt` in the target folder otherwise. `.ci/run` ends with
//! their number.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The environment variable with the folder of the records.
const VARIABLE: &str = "PID_SHARED";
/// The environment variable with the file that lists skipped tests.
const LIST_VARIABLE: &str = "PID_SKIPPED";

/// Name of the list of skipped tests in the target folder.
pub const LIST: &str = "skipped-tests.txt";

/// The folder of the records, and whether it must be there.
fn root() -> (PathBuf, bool) {
    if let Some(folder) = std::env::var_os(VARIABLE) {
        return (folder.into(), true);
    }
    // Where the tests run, not where they were built: a clone may have moved with its target folder.
    let here = std::env::var_os("CARGO_MANIFEST_DIR")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    let workspace = here.ancestors().find(|a| a.join("Cargo.lock").exists());
    let folder = workspace.unwrap_or(&here).join("../shared");
    let there = folder.is_dir();
    (folder, there)
}

/// Path of a record, whether it is there or not.
pub fn beside(path: &str) -> PathBuf {
    root().0.join(path)
}

/// A file or folder of the shared records; `None`, with the test counted as skipped, where there
/// are no shared records at all.
///
/// # Panics
/// If there are shared records, and not this one; or if the list of skipped tests cannot be written.
pub fn shared(path: &str) -> Option<PathBuf> {
    let (root, required) = root();
    let found = find(&root, required, path);
    if found.is_none() {
        count(path);
    }
    found
}

fn find(root: &Path, required: bool, path: &str) -> Option<PathBuf> {
    let place = root.join(path);
    let there = place.exists();
    assert!(
        there || !required,
        "the record {} is missing; put it there, or let {VARIABLE} name the folder that holds `{path}`",
        place.display()
    );
    there.then_some(place)
}

/// Prints that the running test is skipped, and appends it to the list.
///
/// # Panics
/// If the list cannot be written.
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn count(path: &str) {
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a thread of a test");
    let program = std::env::current_exe().unwrap_or_default();
    let file = program.file_stem().unwrap_or_default().to_string_lossy();
    let binary = file.rsplit_once('-').map_or(&*file, |(name, _)| name);
    let package = std::env::var("CARGO_PKG_NAME").unwrap_or_else(|_| binary.to_owned());
    let line = format!("{package} {test} needs ../shared/{path}\n");
    eprint!("skipped: {line}");
    // Test programs lie in `deps` in the folder of their profile in the target folder.
    let target = program.ancestors().nth(3).unwrap_or(&program);
    let list = std::env::var_os(LIST_VARIABLE).map_or_else(|| target.join(LIST), PathBuf::from);
    let file = OpenOptions::new().create(true).append(true).open(&list);
    let written = file.and_then(|mut f| f.write_all(line.as_bytes()));
    if let Err(e) = written {
        panic!("{}: a skipped test cannot be listed: {e}", list.display());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_found_or_absent_with_all_others() {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert_eq!(find(here, true, "src"), Some(here.join("src")));
        assert_eq!(find(&here.join("nowhere"), false, "emps"), None);
    }

    #[test]
    #[should_panic(expected = "nothing is missing; put it there, or let PID_SHARED name")]
    fn a_record_missing_among_others_fails() {
        find(Path::new(env!("CARGO_MANIFEST_DIR")), true, "nothing");
    }
}
