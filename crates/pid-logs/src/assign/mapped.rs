//! The channels that the user maps.

use std::collections::BTreeMap;

use super::{Finder, Source};
use crate::error::LogError;
use crate::log::Log;
use crate::map::{Entry, Kind};
use crate::names::{Word, words};
use crate::settings::Joint;
use crate::units::{Dimension, Unit};

/// Sources by kind and joint; inputs with the quantity of their unit.
#[derive(Debug, Default)]
pub(crate) struct Mapped {
    sources: BTreeMap<(Kind, usize), Source>,
    pub(crate) time: Option<(usize, Option<Unit>)>,
    /// Inputs whose quantity is known by the unit in the map or in the name.
    pub(crate) inputs: BTreeMap<usize, Word>,
}

impl Mapped {
    pub(crate) fn of(&self, kind: Kind, joint: usize) -> Option<Source> {
        self.sources.get(&(kind, joint)).cloned()
    }

    /// Channels that are spoken for.
    pub(crate) fn channels(&self) -> Vec<usize> {
        let of = |s: &Source| match s {
            Source::Channel(i, _) => Some(*i),
            Source::Constant(_) => None,
        };
        self.sources
            .values()
            .filter_map(of)
            .chain(self.time.iter().map(|t| t.0))
            .collect()
    }
}

impl Finder<'_> {
    /// Reads the entries of the map against this log.
    pub(crate) fn mapped(&mut self) -> Result<Mapped, LogError> {
        let mut mapped = Mapped::default();
        let settings = self.settings;
        for entry in settings.map.iter().filter(|e| !e.column.is_empty()) {
            let here = present(self.log, self.joints, entry);
            if !here && self.elsewhere.iter().any(|e| e == entry) {
                continue;
            }
            if entry.kind == Kind::Time {
                mapped.time = Some((self.channel(entry, &entry.column)?, entry.unit()));
                continue;
            }
            for (joint, source) in self.sources(entry)? {
                let joint_name = &self.joints[joint].name;
                let source = match source {
                    Found::Constant(value) => Source::Constant(value),
                    Found::Channel(i) => {
                        let unit = entry.unit().or_else(|| self.meanings[i].unit.clone());
                        let word = unit.as_ref().and_then(|u| input_word(u.dimension));
                        let spoken = self.meanings[i].what.map(|w| w.word);
                        let word = word.or(spoken).unwrap_or(Word::Input);
                        if entry.kind == Kind::Input {
                            mapped.inputs.insert(joint, word);
                        }
                        let si = self.dimension(entry.kind, word, joint);
                        let unit = match unit {
                            Some(unit) => self.fitting(unit, entry.kind, si, i)?,
                            None => Unit::si(si),
                        };
                        Source::Channel(i, unit)
                    }
                };
                if mapped.sources.insert((entry.kind, joint), source).is_some() {
                    return Err(LogError::Map {
                        place: entry.place.clone(),
                        what: format!(
                            "the {} of joint `{joint_name}` is mapped twice",
                            entry.kind.name()
                        ),
                        mend: "keep one of the two".to_owned(),
                    });
                }
            }
        }
        Ok(mapped)
    }

    /// Joints and channels of one entry.
    fn sources(&self, entry: &Entry) -> Result<Vec<(usize, Found)>, LogError> {
        if let Some(name) = &entry.joint {
            let joint = self.joint(entry, name)?;
            if let Ok(value) = entry.column.parse::<f64>()
                && value.is_finite()
                && find(self.log, &entry.column).is_empty()
            {
                return Ok(vec![(joint, Found::Constant(value))]);
            }
            return Ok(vec![(
                joint,
                Found::Channel(self.channel(entry, &entry.column)?),
            )]);
        }
        let n = self.joints.len();
        if entry.column.contains('*') {
            let name = |j: usize| entry.column.replace('*', &self.joints[j].name);
            return (0..n)
                .map(|j| Ok((j, Found::Channel(self.channel(entry, &name(j))?))))
                .collect();
        }
        let mut found: Vec<usize> = (0..self.log.channels.len())
            .filter(|&i| within(&self.log.channels[i].name, &entry.column))
            .collect();
        if found.is_empty() && n == 1 {
            found.push(self.channel(entry, &entry.column)?);
        }
        if found.len() != n {
            return Err(LogError::Map {
                place: entry.place.clone(),
                what: format!(
                    "{}: `{}` has {} channels, the robot {n} joints",
                    self.log.file,
                    entry.column,
                    found.len()
                ),
                mend: format!("map each joint: {}:JOINT=CHANNEL", entry.kind.word()),
            });
        }
        Ok(found.into_iter().map(Found::Channel).enumerate().collect())
    }

    /// The joint of a name, without case and signs.
    fn joint(&self, entry: &Entry, name: &str) -> Result<usize, LogError> {
        let exact = self.joints.iter().position(|j| j.name == name);
        let alike = || {
            self.joints
                .iter()
                .position(|j| words(&j.name) == words(name))
        };
        exact.or_else(alike).ok_or_else(|| LogError::Map {
            place: entry.place.clone(),
            what: format!("the robot has no joint `{name}`"),
            mend: pid_toml::one_of(name, self.joints.iter().map(|j| j.name.as_str())),
        })
    }

    /// The one channel of a name.
    fn channel(&self, entry: &Entry, name: &str) -> Result<usize, LogError> {
        let found = find(self.log, name);
        match found.as_slice() {
            [one] => Ok(*one),
            [] => Err(LogError::Map {
                place: entry.place.clone(),
                what: format!("{}: no channel `{name}`", self.log.file),
                mend: pid_toml::one_of(
                    name,
                    self.log.channels.iter().take(40).map(|c| c.name.as_str()),
                ),
            }),
            several => Err(LogError::Map {
                place: entry.place.clone(),
                what: format!(
                    "{}: {} channels are called `{name}`",
                    self.log.file,
                    several.len()
                ),
                mend: "rename all but one of them, or write the whole path".to_owned(),
            }),
        }
    }
}

/// Channels of a name: as written, without unit, without case, or by the end of the path.
fn find(log: &Log, name: &str) -> Vec<usize> {
    let channels = &log.channels;
    let bare = |c: &str| c.split([' ', '(']).next().unwrap_or(c).to_owned();
    let unitless = |c: &str| {
        c.rsplit_once('[')
            .filter(|(_, u)| Unit::parse(u.trim_end_matches(']')).is_some())
            .map(|(n, _)| n.trim_end().to_owned())
    };
    type Test<'t> = Box<dyn Fn(&str) -> bool + 't>;
    let tests: [Test<'_>; 5] = [
        Box::new(|c: &str| c == name),
        Box::new(|c: &str| unitless(c).as_deref() == Some(name)),
        Box::new(|c: &str| bare(c) == name),
        Box::new(|c: &str| c.eq_ignore_ascii_case(name)),
        Box::new(|c: &str| c.ends_with(&format!("/{name}"))),
    ];
    for test in tests {
        let found: Vec<usize> = (0..channels.len())
            .filter(|&i| test(&channels[i].name))
            .collect();
        if !found.is_empty() {
            return found;
        }
    }
    Vec::new()
}

/// Whether a log has what an entry names: of logs of different kinds, each has its own names.
pub(crate) fn present(log: &Log, joints: &[Joint], entry: &Entry) -> bool {
    let column = entry.column.as_str();
    let there = |name: &str| !find(log, name).is_empty();
    let number = entry.joint.is_some() && column.parse::<f64>().is_ok();
    let pattern = || {
        let mut names = joints.iter().map(|j| column.replace('*', &j.name));
        column.contains('*') && names.any(|name| there(&name))
    };
    let array = || {
        let mut channels = log.channels.iter();
        entry.joint.is_none() && channels.any(|c| within(&c.name, column))
    };
    column.is_empty() || number || there(column) || pattern() || array()
}

/// Whether a channel is an element of an array: `data[2]` and `state/elbow` are, of `data` and `state`.
fn within(name: &str, array: &str) -> bool {
    let rest = name.strip_prefix(array);
    rest.is_some_and(|r| r.starts_with('[') || r.starts_with('/'))
}

/// A channel, or a number.
enum Found {
    Channel(usize),
    Constant(f64),
}

/// The quantity of an input by its unit.
fn input_word(dimension: Dimension) -> Option<Word> {
    match dimension {
        Dimension::Torque => Some(Word::Torque),
        Dimension::Force => Some(Word::Force),
        Dimension::Current => Some(Word::Current),
        Dimension::Voltage => Some(Word::Voltage),
        _ => None,
    }
}
