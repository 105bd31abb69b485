//! Reading a data set from a folder or from texts.

mod columns;
mod record;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::path::Path;

use rayon::prelude::*;

use crate::manifest;
use crate::{
    DataError, DataWarning, Dataset, Difference, Experiment, JointChannels, Role, VelocityKind,
    difference,
};
use record::read_experiment;

/// The manifest's file name.
const MANIFEST: &str = "dataset.toml";

/// Gives the text of a file, and the name to use for it in messages.
type Load<'a> = dyn Fn(&str) -> Result<(String, Cow<'a, str>), DataError> + Sync + 'a;

impl Dataset {
    /// Reads a data set from its folder; the files are read in parallel.
    ///
    /// # Errors
    /// The first thing that is wrong, with file, line, column and mend; see [`DataError`].
    pub fn read(folder: &Path) -> Result<Self, DataError> {
        load(&|name| {
            let path = folder.join(name);
            let file = path.display().to_string();
            match std::fs::read_to_string(&path) {
                Ok(text) => Ok((file, Cow::Owned(text))),
                Err(error) => Err(DataError::Unreadable { file, error }),
            }
        })
    }

    /// Reads a data set from texts: pairs of file name and content, `dataset.toml` among them.
    ///
    /// # Errors
    /// As [`Dataset::read`].
    pub fn from_embedded(files: &[(&str, &str)]) -> Result<Self, DataError> {
        load(&|name| match files.iter().find(|(file, _)| *file == name) {
            Some((file, text)) => Ok(((*file).to_owned(), Cow::Borrowed(*text))),
            None => Err(DataError::NotEmbedded {
                file: name.to_owned(),
            }),
        })
    }
}

fn load(load: &Load<'_>) -> Result<Dataset, DataError> {
    let (file, text) = load(MANIFEST)?;
    let manifest = manifest::parse(&file, &text)?;
    let read: Vec<(Experiment, Vec<DataWarning>)> = manifest
        .experiments
        .par_iter()
        .map(|listed| {
            let (file, text) = load(&listed.file)?;
            read_experiment(&file, &text, listed, &manifest.joints)
        })
        .collect::<Result<_, _>>()?;

    let mut experiments = Vec::with_capacity(read.len());
    let mut warnings = Vec::new();
    for (experiment, odd) in read {
        experiments.push(experiment);
        warnings.extend(odd);
    }
    warnings.extend(differences(&file, &experiments, &manifest.joints));
    for role in [Role::Train, Role::Test] {
        if !experiments.iter().any(|e| e.role == role) {
            warnings.push(DataWarning::NoExperiment { role });
        }
    }
    Ok(Dataset {
        name: manifest.name,
        title: manifest.title,
        source: manifest.source,
        license: manifest.license,
        kind: manifest.kind,
        input_hold: manifest.input_hold,
        joints: manifest.joints,
        experiments,
        warnings,
    })
}

/// Warns of velocities that count as measured but are differences of the positions, in all records
/// or in some.
fn differences(
    file: &str,
    experiments: &[Experiment],
    joints: &[JointChannels],
) -> Vec<DataWarning> {
    let nq = joints.len();
    let made = |e: &Experiment, j: usize| {
        let q = e.q.iter().skip(j).step_by(nq);
        let v = e.v.iter().flatten().skip(j).step_by(nq);
        let samples = e.t.iter().zip(q).zip(v);
        let samples: Vec<(f64, f64, f64)> = samples.map(|((t, q), v)| (*t, *q, *v)).collect();
        difference::made_by(&samples)
    };
    let measured = (0..nq).filter(|&j| joints[j].velocity == VelocityKind::Measured);
    measured
        .filter_map(|j| {
            let found = experiments.iter().filter_map(|e| made(e, j));
            let found: Vec<Difference> = found.collect();
            Some(DataWarning::VelocityIsDifference {
                file: file.to_owned(),
                joint: j + 1,
                difference: *found.first()?,
                records: found.len(),
                of: experiments.len(),
            })
        })
        .collect()
}
