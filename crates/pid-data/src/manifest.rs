//! `dataset.toml`: parsed with its places, checked word by word.

use std::collections::BTreeMap;

use pid_toml::{Source, Spanned};
use serde::Deserialize;

use super::{
    DataError, GainFactors, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};

/// `dataset.toml` as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawManifest {
    name: String,
    title: String,
    source: String,
    license: String,
    kind: Spanned<String>,
    input_hold: Option<Spanned<String>>,
    #[serde(default)]
    joint: Vec<RawJoint>,
    #[serde(default)]
    experiment: Vec<RawExperiment>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawJoint {
    name: Spanned<String>,
    r#type: Spanned<String>,
    input: Spanned<String>,
    input_unit: Spanned<String>,
    velocity: Spanned<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawExperiment {
    file: Spanned<String>,
    role: Spanned<String>,
    sample_time_s: Option<f64>,
    samples: Option<usize>,
    #[serde(default)]
    note: String,
    #[serde(default)]
    gain_factors: BTreeMap<String, Spanned<RawFactors>>,
    off: Option<Spanned<RawOff>>,
}

/// Whether drives are off, as written.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "true, false, or a list of one per joint")]
enum RawOff {
    All(bool),
    Each(Vec<bool>),
}

/// Factors of a gain as written.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "a number, or a list of one per joint")]
enum RawFactors {
    All(f64),
    Each(Vec<f64>),
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
    pub(super) gain_factors: GainFactors,
}

/// Parses and checks the text of a `dataset.toml`; `file` is its name in messages.
pub(super) fn parse(file: &str, text: &str) -> Result<Manifest, DataError> {
    let source = Source::new(file, text);
    let raw: RawManifest = source.parse()?;
    let kinds = [("real", Kind::Real), ("simulated", Kind::Simulated)];
    let kind = word(&source, &raw.kind, "data set", "kind", &kinds)?;
    let holds = [
        ("zero-order", InputHold::ZeroOrder),
        ("linear", InputHold::Linear),
    ];
    let input_hold = match &raw.input_hold {
        None => InputHold::ZeroOrder,
        Some(hold) => word(&source, hold, "data set", "input_hold", &holds)?,
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
    let names = raw
        .joint
        .iter()
        .map(|j| (j.name.as_ref().as_str(), &j.name));
    twice(&source, "joint", names)?;
    let names = raw
        .experiment
        .iter()
        .map(|e| (stem(e.file.as_ref()), &e.file));
    twice(&source, "experiment", names)?;

    let joints = raw.joint.len();
    Ok(Manifest {
        name: raw.name,
        title: raw.title,
        source: raw.source,
        license: raw.license,
        kind,
        input_hold,
        joints: raw
            .joint
            .into_iter()
            .map(|joint| check_joint(&source, joint))
            .collect::<Result<_, _>>()?,
        experiments: raw
            .experiment
            .into_iter()
            .map(|experiment| check_experiment(&source, experiment, joints))
            .collect::<Result<_, _>>()?,
    })
}

/// One of some words.
fn word<T: Copy>(
    source: &Source<'_>,
    value: &Spanned<String>,
    item: &str,
    key: &'static str,
    words: &[(&str, T)],
) -> Result<T, DataError> {
    let found = value.as_ref();
    match words.iter().find(|(word, _)| word == found) {
        Some(&(_, meaning)) => Ok(meaning),
        None => {
            let names = words.iter().map(|(word, _)| *word);
            let known: Vec<String> = names.clone().map(|w| format!("`{w}`")).collect();
            let meant = pid_toml::nearest(found, names)
                .map_or_else(String::new, |w| format!("; did you mean `{w}`?"));
            Err(DataError::UnknownValue {
                place: source.place_of(value),
                item: item.to_owned(),
                key,
                value: found.clone(),
                known: known.join(", ") + &meant,
            })
        }
    }
}

fn check_experiment(
    source: &Source<'_>,
    e: RawExperiment,
    joints: usize,
) -> Result<Listed, DataError> {
    let roles = [("train", Role::Train), ("test", Role::Test)];
    let item = format!("experiment `{}`", e.file.as_ref());
    let role = word(source, &e.role, &item, "role", &roles)?;
    let mut gain_factors = factors(source, &item, &e.gain_factors, joints)?;
    if let Some(own) = &e.off {
        let set = match own.as_ref() {
            RawOff::All(x) => gain_factors.set_off(&[*x], joints),
            RawOff::Each(all) => gain_factors.set_off(all, joints),
        };
        set.map_err(|why| DataError::Off {
            place: source.place_of(own),
            item: item.clone(),
            why,
        })?;
    }
    let file = e.file.into_inner();
    Ok(Listed {
        name: stem(&file).to_owned(),
        file,
        role,
        sample_time: e.sample_time_s,
        samples: e.samples,
        note: e.note,
        gain_factors,
    })
}

/// Factors of gains as they are stated.
fn factors(
    source: &Source<'_>,
    item: &str,
    raw: &BTreeMap<String, Spanned<RawFactors>>,
    joints: usize,
) -> Result<GainFactors, DataError> {
    let mut out = GainFactors::default();
    for (key, own) in raw {
        let refuse = |why: String| DataError::GainFactors {
            place: source.place_of(own),
            item: item.to_owned(),
            key: key.clone(),
            why,
        };
        let keys = GainFactors::KEYS;
        let Some(gain) = keys.iter().position(|known| known == key) else {
            let known = keys.join(", ");
            return Err(refuse(format!("no gain of a position loop: {known}")));
        };
        let set = match own.as_ref() {
            RawFactors::All(x) => out.set(gain, &[*x], joints),
            RawFactors::Each(all) => out.set(gain, all, joints),
        };
        set.map_err(refuse)?;
    }
    Ok(out)
}

/// Name of an experiment: its file without folder and ending.
fn stem(file: &str) -> &str {
    let stem = std::path::Path::new(file).file_stem();
    stem.and_then(std::ffi::OsStr::to_str).unwrap_or(file)
}

fn check_joint(source: &Source<'_>, joint: RawJoint) -> Result<JointChannels, DataError> {
    let item = format!("joint `{}`", joint.name.as_ref());
    let types = [("revolute", false), ("prismatic", true)];
    let prismatic = word(source, &joint.r#type, &item, "type", &types)?;
    let quantities = [
        InputQuantity::Torque,
        InputQuantity::Force,
        InputQuantity::Current,
        InputQuantity::Voltage,
        InputQuantity::Position,
    ]
    .map(|quantity| (quantity.word(), quantity));
    let input = word(source, &joint.input, &item, "input", &quantities)?;
    let stated = joint.input_unit.as_ref().as_str();
    let input_unit = match stated {
        // The SI brochure's spelling of the product, with either of the two dots.
        "N·m" | "N⋅m" | "Nm" => "N*m",
        _ => {
            let units = ["N*m", "N", "A", "V", "rad", "m"].map(|unit| (unit, unit));
            word(source, &joint.input_unit, &item, "input_unit", &units)?
        }
    };
    let expected = match input {
        InputQuantity::Position if prismatic => "m",
        _ => input.unit(),
    };
    if input_unit != expected {
        return Err(DataError::UnitOfQuantity {
            place: source.place_of(&joint.input_unit),
            joint: joint.name.into_inner(),
            quantity: input.word(),
            expected,
            unit: input_unit.to_owned(),
        });
    }
    let velocities = [
        ("measured", VelocityKind::Measured),
        ("derived", VelocityKind::Derived),
        ("absent", VelocityKind::Absent),
    ];
    let velocity = word(source, &joint.velocity, &item, "velocity", &velocities)?;
    Ok(JointChannels {
        name: joint.name.into_inner(),
        prismatic,
        input,
        input_unit: input_unit.to_owned(),
        velocity,
    })
}

fn twice<'a>(
    source: &Source<'_>,
    what: &'static str,
    names: impl Iterator<Item = (&'a str, &'a Spanned<String>)>,
) -> Result<(), DataError> {
    let mut seen = std::collections::BTreeSet::new();
    for (name, at) in names {
        if !seen.insert(name) {
            return Err(DataError::ListedTwice {
                place: source.place_of(at),
                what,
                name: name.to_owned(),
            });
        }
    }
    Ok(())
}
