//! The result of an identification as one value with three forms: page, JSON, terminal text.
//!
//! Everything a reader sees comes from a [`Report`]; [`Report::to_html`], [`Report::to_json`] and
//! [`Report::to_text`] only arrange it. [`motion`] and [`missing_force`] condense records: a long
//! record is reduced to the smallest and largest value of each stretch, so that no peak is lost and
//! the file stays small.
//!
//! Unknown values are `None`, in JSON `null`; a report holds no NaN.

mod build;
mod findings;
mod html;
mod identified;
mod judge;
mod plot;
mod text;
mod value;

pub use build::{ForceRecord, TraceBudget, missing_force, motion, trace};
pub use identified::{report, verdict};
pub use judge::{Fit, JudgeError, Subject, judge};
pub use value::{
    Bound, CheckRow, Correlation, DataSection, Direction, ExperimentRow, ForceBin, ForceTrace,
    MissingForce, ModelSection, Motion, MotionJoint, OutcomeSection, ParameterRow, Report,
    SCHEMA_VERSION, Setting, StartRow, Trace, Verdict,
};

/// A report that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// Not the JSON of a report.
    #[error("not a report: {0}\n  help: use the `fit.json` of an identification")]
    Json(#[from] serde_json::Error),
    /// Another version of the form.
    #[error(
        "the report has schema version {found}, this program reads version {SCHEMA_VERSION}\n  help: make it again with this program"
    )]
    Version {
        /// Its version.
        found: u32,
    },
}

impl Report {
    /// The report as JSON, with a line break at its end.
    ///
    /// # Errors
    /// [`ReportError::Json`] if a value cannot be written.
    pub fn to_json(&self) -> Result<String, ReportError> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        Ok(text)
    }

    /// Reads what [`Report::to_json`] wrote.
    ///
    /// # Errors
    /// [`ReportError`] for other files and other versions.
    pub fn from_json(text: &str) -> Result<Self, ReportError> {
        let value: serde_json::Value = serde_json::from_str(text)?;
        if let Some(found) = value
            .get("schema_version")
            .and_then(serde_json::Value::as_u64)
            && found != u64::from(SCHEMA_VERSION)
        {
            return Err(ReportError::Version {
                found: u32::try_from(found).unwrap_or(u32::MAX),
            });
        }
        Ok(serde_json::from_value(value)?)
    }

    /// The report as one page without other files: it contains its plots, and colours follow the
    /// reader's light or dark setting.
    pub fn to_html(&self) -> String {
        html::page(self)
    }

    /// The report for a terminal, at most 100 columns wide.
    pub fn to_text(&self) -> String {
        text::summary(self)
    }
}
