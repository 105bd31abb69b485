//! `dataset.toml`: parsed with its positions by `toml`, checked word by word here.

use serde::Deserialize;

use super::{DataError, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind};

/// `dataset.toml` as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawManifest {
    name: String,
    title: String,
    source: String,
    license: String,
    kind: String,
    input_hold: Option<String>,
    #[serde(default)]
    joint: Vec<RawJoint>,
    #[serde(default)]
    experiment: Vec<RawExperiment>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawJoint {
    name: String,
    r#type: String,
    input: String,
    input_unit: String,
    velocity: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawExperiment {
    file: String,
    role: String,
    sample_time_s: Option<f64>,
    samples: Option<usize>,
    #[serde(default)]
    note: String,
}

/// `dataset.toml`, checked.
#[derive(Debug)]
pub(super) struct Manifest {
    pub(super) name: String,
    pub(super) title: String,
    pub(super) source: String,
    pub(super) license: String,
    pub(super) kind: Kind,
    pub(super) input_hold: InputHold,
    pub(super) joints: Vec<JointChannels>,
    pub(super) experiments: Vec<Listed>,
}

/// An experiment as listed, before its file is read.
#[derive(Debug)]
pub(super) struct Listed {
    pub(super) file: String,
    pub(super) name: String,
    pub(super) role: Role,
    pub(super) sample_time: Option<f64>,
    pub(super) samples: Option<usize>,
    pub(super) note: String,
}

/// Parses and checks the text of a `dataset.toml`; `file` is its name in messages.
pub(super) fn parse(file: &str, text: &str) -> Result<Manifest, DataError> {
    let raw: RawManifest = toml::from_str(text).map_err(|e| DataError::Manifest {
        file: file.to_owned(),
        message: e.to_string().trim_end().to_owned(),
    })?;
    let unknown =
        |item: &str, key: &'static str, value: &str, known: &'static str| DataError::UnknownValue {
            file: file.to_owned(),
            item: item.to_owned(),
            key,
            value: value.to_owned(),
            known,
        };

    let kind = match raw.kind.as_str() {
        "real" => Kind::Real,
        "simulated" => Kind::Simulated,
        other => return Err(unknown("data set", "kind", other, "`real`, `simulated`")),
    };
    let input_hold = match raw.input_hold.as_deref() {
        None | Some("zero-order") => InputHold::ZeroOrder,
        Some("linear") => InputHold::Linear,
        Some(other) => {
            return Err(unknown(
                "data set",
                "input_hold",
                other,
                "`zero-order`, `linear`",
            ));
        }
    };

    let nothing = |what| DataError::NothingListed {
        file: file.to_owned(),
        what,
    };
    if raw.joint.is_empty() {
        return Err(nothing("joint"));
    }
    if raw.experiment.is_empty() {
        return Err(nothing("experiment"));
    }

    let mut joints = Vec::with_capacity(raw.joint.len());
    for joint in raw.joint {
        joints.push(check_joint(file, joint, &unknown)?);
    }
    twice(file, "joint", joints.iter().map(|j| j.name.as_str()))?;

    let mut experiments = Vec::with_capacity(raw.experiment.len());
    for e in raw.experiment {
        let role = match e.role.as_str() {
            "train" => Role::Train,
            "test" => Role::Test,
            other => {
                let item = format!("experiment `{}`", e.file);
                return Err(unknown(&item, "role", other, "`train`, `test`"));
            }
        };
        let name = std::path::Path::new(&e.file)
            .file_stem()
            .map_or_else(|| e.file.clone(), |s| s.to_string_lossy().into_owned());
        experiments.push(Listed {
            file: e.file,
            name,
            role,
            sample_time: e.sample_time_s,
            samples: e.samples,
            note: e.note,
        });
    }
    twice(
        file,
        "experiment",
        experiments.iter().map(|e| e.name.as_str()),
    )?;

    Ok(Manifest {
        name: raw.name,
        title: raw.title,
        source: raw.source,
        license: raw.license,
        kind,
        input_hold,
        joints,
        experiments,
    })
}

fn check_joint(
    file: &str,
    mut joint: RawJoint,
    unknown: &dyn Fn(&str, &'static str, &str, &'static str) -> DataError,
) -> Result<JointChannels, DataError> {
    let item = format!("joint `{}`", joint.name);
    let prismatic = match joint.r#type.as_str() {
        "revolute" => false,
        "prismatic" => true,
        other => return Err(unknown(&item, "type", other, "`revolute`, `prismatic`")),
    };
    let input = match joint.input.as_str() {
        "torque" => InputQuantity::Torque,
        "force" => InputQuantity::Force,
        "current" => InputQuantity::Current,
        "voltage" => InputQuantity::Voltage,
        other => {
            let known = "`torque`, `force`, `current`, `voltage`";
            return Err(unknown(&item, "input", other, known));
        }
    };
    // The SI brochure's spelling of the product, with either of the two dots.
    if ["N·m", "N⋅m", "Nm"].contains(&joint.input_unit.as_str()) {
        joint.input_unit = "N*m".to_owned();
    }
    if !["N*m", "N", "A", "V"].contains(&joint.input_unit.as_str()) {
        return Err(unknown(
            &item,
            "input_unit",
            &joint.input_unit,
            "`N*m`, `N`, `A`, `V`",
        ));
    }
    if joint.input_unit != input.unit() {
        return Err(DataError::UnitOfQuantity {
            file: file.to_owned(),
            joint: joint.name,
            quantity: input.word(),
            expected: input.unit(),
            unit: joint.input_unit,
        });
    }
    let velocity = match joint.velocity.as_str() {
        "measured" => VelocityKind::Measured,
        "derived" => VelocityKind::Derived,
        "absent" => VelocityKind::Absent,
        other => {
            return Err(unknown(
                &item,
                "velocity",
                other,
                "`measured`, `derived`, `absent`",
            ));
        }
    };
    Ok(JointChannels {
        name: joint.name,
        prismatic,
        input,
        input_unit: joint.input_unit,
        velocity,
    })
}

fn twice<'a>(
    file: &str,
    what: &'static str,
    names: impl Iterator<Item = &'a str>,
) -> Result<(), DataError> {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            return Err(DataError::ListedTwice {
                file: file.to_owned(),
                what,
                name: name.to_owned(),
            });
        }
    }
    Ok(())
}
