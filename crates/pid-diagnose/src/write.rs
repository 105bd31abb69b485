//! The files of a report, each written whole or not at all.

use std::path::Path;

use crate::page::page;
use crate::report::{Report, WriteError};

impl Report {
    /// The page `report.html`, with its plots and without other files.
    pub fn to_html(&self) -> String {
        page(self)
    }

    /// Writes `report.html`, `next_experiment.csv` if there is one, `extended.toml` if a file can
    /// state the robot, and last `diagnosis.json`, so that a folder is complete when that is there.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), WriteError> {
        let at = |path: &Path| {
            let path = path.to_owned();
            move |source| WriteError { path, source }
        };
        std::fs::create_dir_all(out).map_err(at(out))?;
        let put = |name: &str, text: &str| {
            let path = out.join(name);
            write_whole(&path, text).map_err(at(&path))
        };
        // What an earlier run left there belongs to another result.
        for name in ["diagnosis.json", "next_experiment.csv", "extended.toml"] {
            let path = out.join(name);
            remove_stale(&path).map_err(at(&path))?;
        }
        put("report.html", &self.to_html())?;
        if let Some(next) = &self.next {
            put("next_experiment.csv", &next.to_csv())?;
        }
        if let Some(extended) = self.extended.to_toml() {
            put("extended.toml", &extended)?;
        }
        put("diagnosis.json", &self.diagnosis.to_json())
    }
}

/// Writes a text whole or not at all: a reader never sees half a file.
///
/// # Errors
/// If the file or the one beside it (`.part`) cannot be written.
pub fn write_whole(path: &Path, text: &str) -> std::io::Result<()> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    std::fs::write(&part, text)?;
    std::fs::rename(&part, path)
}

/// Removes a file that an earlier run may have left.
///
/// # Errors
/// If the file is there and cannot be removed.
pub fn remove_stale(path: &Path) -> std::io::Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole_and_a_stale_one_goes() {
        let folder = std::env::temp_dir().join(format!("write-whole-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let path = folder.join("a.json");
        write_whole(&path, "a longer text").expect("written");
        write_whole(&path, "short").expect("written");
        assert_eq!(std::fs::read_to_string(&path).expect("read"), "short");
        assert_eq!(std::fs::read_dir(&folder).expect("listed").count(), 1);
        remove_stale(&path).expect("removed");
        remove_stale(&path).expect("nothing there is no error");
        assert!(!path.exists() && remove_stale(&folder).is_err());
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}
