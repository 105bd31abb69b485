//! The files of a report.

use std::path::Path;

use crate::page::page;
use crate::report::{Report, WriteError};

impl Report {
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
        // Whole or not at all: a reader never sees half a file.
        let put = |name: &str, text: &str| {
            let (part, path) = (out.join(format!("{name}.part")), out.join(name));
            std::fs::write(&part, text).map_err(at(&part))?;
            std::fs::rename(&part, &path).map_err(at(&path))
        };
        // What an earlier run left there belongs to another result.
        for name in ["diagnosis.json", "next_experiment.csv", "extended.toml"] {
            let path = out.join(name);
            match std::fs::remove_file(&path) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                    return Err(at(&path)(error));
                }
                _ => {}
            }
        }
        put("report.html", &page(self))?;
        if let Some(next) = &self.next {
            put("next_experiment.csv", &next.to_csv())?;
        }
        if let Some(extended) = self.extended.to_toml() {
            put("extended.toml", &extended)?;
        }
        put("diagnosis.json", &self.diagnosis.to_json())
    }
}
