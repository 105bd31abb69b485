//! The columns of a record by the names in its header.

use crate::{DataError, DataWarning, JointChannels, VelocityKind};

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
    let mut used = vec![false; header.len()];
    let mut find = |name: &str| {
        let place = header.iter().position(|h| h == name);
        if let Some(i) = place {
            used[i] = true;
        }
        place
    };
    let missing = |column: &str, reason: &'static str, help: String| DataError::MissingColumn {
        file: file.to_owned(),
        column: column.to_owned(),
        reason,
        help,
    };
    let has = format!(
        "the header has `{}`; add or rename a column",
        header.join(",")
    );

    let t = find("t").ok_or_else(|| missing("t", "time of the samples", has.clone()))?;
    let mut required = |stem: &str, reason: &'static str| -> Result<Vec<usize>, DataError> {
        (1..=joints.len())
            .map(|j| {
                let name = format!("{stem}{j}");
                find(&name).ok_or_else(|| missing(&name, reason, has.clone()))
            })
            .collect()
    };
    let q = required("q", "every joint needs its position")?;
    let u = required(
        "u",
        "every joint needs its input; write zeros for a joint without drive",
    )?;

    let mut v = Vec::with_capacity(joints.len());
    for (j, joint) in joints.iter().enumerate() {
        let name = format!("dq{}", j + 1);
        let place = find(&name);
        if joint.velocity == VelocityKind::Absent {
            if place.is_some() {
                warnings.push(DataWarning::VelocityNotUsed {
                    file: file.to_owned(),
                    column: name,
                });
            }
            v.push(None);
        } else if place.is_some() {
            v.push(place);
        } else {
            let help = "add the column, or write velocity = \"absent\" for this joint".to_owned();
            return Err(missing(
                &name,
                "dataset.toml says the velocity is recorded",
                help,
            ));
        }
    }

    let mut optional = |stem: &str| -> Result<Option<Vec<usize>>, DataError> {
        let places: Vec<Option<usize>> = (1..=joints.len())
            .map(|j| find(&format!("{stem}{j}")))
            .collect();
        if places.iter().all(Option::is_none) {
            return Ok(None);
        }
        let whole: Option<Vec<usize>> = places.iter().copied().collect();
        whole.map(Some).ok_or_else(|| {
            let gap = places.iter().position(Option::is_none).unwrap_or(0) + 1;
            let help =
                "add it (empty cells where nothing was recorded), or remove the others".to_owned();
            missing(&format!("{stem}{gap}"), "the other joints have one", help)
        })
    };
    let tau = optional("tau")?;
    let qref = optional("qref")?;

    for (name, used) in header.iter().zip(&used) {
        if !used {
            let column = name.clone();
            warnings.push(DataWarning::UnusedColumn {
                file: file.to_owned(),
                column,
            });
        }
    }
    Ok(Columns {
        t,
        q,
        v,
        u,
        tau,
        qref,
    })
}
