//! The columns of a record by the names in its header.

use crate::{DataError, DataWarning, InputQuantity, JointChannels, VelocityKind};

/// Where each channel stands in a row.
pub(super) struct Columns {
    pub(super) t: usize,
    pub(super) q: Vec<usize>,
    /// Per joint; `None` where the velocity is said to be absent. If all are `None`, so is `v`.
    pub(super) v: Vec<Option<usize>>,
    pub(super) u: Vec<usize>,
    pub(super) tau: Option<Vec<usize>>,
    pub(super) qref: Option<Vec<usize>>,
}

/// Finds the columns of the joints; what is odd but usable goes to `warnings`.
pub(super) fn find_columns(
    file: &str,
    header: &[String],
    joints: &[JointChannels],
    warnings: &mut Vec<DataWarning>,
) -> Result<Columns, DataError> {
    for (i, name) in header.iter().enumerate() {
        if header[..i].contains(name) {
            return Err(DataError::DuplicateColumn {
                file: file.to_owned(),
                column: name.clone(),
            });
        }
    }
    let mut header = Header {
        file,
        names: header,
        used: vec![false; header.len()],
    };
    let n = joints.len();
    let columns = Columns {
        t: header.required("t", "time of the samples")?,
        q: header.each("q", n, "every joint needs its position")?,
        u: header.inputs(joints)?,
        v: header.velocities(joints, warnings)?,
        tau: header.all_or_none("tau", n)?,
        qref: header.all_or_none("qref", n)?,
    };
    let unused = header
        .names
        .iter()
        .zip(&header.used)
        .filter(|(_, used)| !**used);
    warnings.extend(unused.map(|(name, _)| DataWarning::UnusedColumn {
        file: file.to_owned(),
        column: name.clone(),
    }));
    Ok(columns)
}

/// The names of the columns, and which have found their use.
struct Header<'a> {
    file: &'a str,
    names: &'a [String],
    used: Vec<bool>,
}

impl Header<'_> {
    fn find(&mut self, name: &str) -> Option<usize> {
        let place = self.names.iter().position(|h| h == name)?;
        self.used[place] = true;
        Some(place)
    }

    fn missing(&self, column: &str, reason: &'static str, help: String) -> DataError {
        DataError::MissingColumn {
            file: self.file.to_owned(),
            column: column.to_owned(),
            reason,
            help,
        }
    }

    fn required(&mut self, name: &str, reason: &'static str) -> Result<usize, DataError> {
        self.find(name).ok_or_else(|| {
            let help = format!(
                "the header has `{}`; add or rename a column",
                self.names.join(",")
            );
            self.missing(name, reason, help)
        })
    }

    /// One column for each of `n` joints.
    fn each(
        &mut self,
        stem: &str,
        n: usize,
        reason: &'static str,
    ) -> Result<Vec<usize>, DataError> {
        (1..=n)
            .map(|j| self.required(&format!("{stem}{j}"), reason))
            .collect()
    }

    /// Inputs; the target of a joint whose input is a position.
    fn inputs(&mut self, joints: &[JointChannels]) -> Result<Vec<usize>, DataError> {
        let of = |(j, joint): (usize, &JointChannels)| {
            let (stem, reason) = match joint.input {
                InputQuantity::Position => ("qref", "its input is a position: the target"),
                _ => (
                    "u",
                    "every joint needs its input; write zeros for a joint without drive",
                ),
            };
            self.required(&format!("{stem}{}", j + 1), reason)
        };
        joints.iter().enumerate().map(of).collect()
    }

    /// Velocities, where the manifest says that there are some.
    fn velocities(
        &mut self,
        joints: &[JointChannels],
        warnings: &mut Vec<DataWarning>,
    ) -> Result<Vec<Option<usize>>, DataError> {
        let mut v = Vec::with_capacity(joints.len());
        for (j, joint) in joints.iter().enumerate() {
            let name = format!("dq{}", j + 1);
            let place = self.find(&name);
            let absent = joint.velocity == VelocityKind::Absent;
            if absent && place.is_some() {
                warnings.push(DataWarning::VelocityNotUsed {
                    file: self.file.to_owned(),
                    column: name,
                });
            } else if !absent && place.is_none() {
                let help = "add the column, or write velocity = \"absent\" for this joint";
                let reason = "dataset.toml says the velocity is recorded";
                return Err(self.missing(&name, reason, help.to_owned()));
            }
            v.push(place.filter(|_| !absent));
        }
        Ok(v)
    }

    /// A column for each of `n` joints, or for none.
    fn all_or_none(&mut self, stem: &str, n: usize) -> Result<Option<Vec<usize>>, DataError> {
        let places: Vec<Option<usize>> =
            (1..=n).map(|j| self.find(&format!("{stem}{j}"))).collect();
        if places.iter().all(Option::is_none) {
            return Ok(None);
        }
        let whole: Option<Vec<usize>> = places.iter().copied().collect();
        whole.map(Some).ok_or_else(|| {
            let gap = places.iter().position(Option::is_none).unwrap_or(0) + 1;
            let help = "add it (empty cells where nothing was recorded), or remove the others";
            let name = format!("{stem}{gap}");
            self.missing(&name, "the other joints have one", help.to_owned())
        })
    }
}
