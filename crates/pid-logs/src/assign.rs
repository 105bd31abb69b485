//! Which channel is which quantity of which joint. What the user maps comes first, then names; of
//! several candidates none is taken, except by a stated rule.

mod input;
mod mapped;
mod time;

use pid_data::InputQuantity;

pub(crate) use mapped::present;

use crate::error::LogError;
use crate::log::Log;
use crate::map::{Entry, Kind};
use crate::meaning::{By, Group, Meaning, groups, meanings};
use crate::names::{JointWords, Word, joint_words};
use crate::settings::{Joint, Sentences, Settings};
use crate::units::{Dimension, Unit};

/// Where the values of a joint come from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Source {
    /// A channel and its unit.
    Channel(usize, Unit),
    /// A number that the user states, in SI.
    Constant(f64),
}

/// The channels of one log.
#[derive(Debug)]
pub(crate) struct Assigned {
    /// For each clock the channel of its times with its unit; `None` where the format has stamps or
    /// there is none.
    pub(crate) time: Vec<Option<(usize, Unit)>>,
    pub(crate) position: Vec<Source>,
    pub(crate) velocity: Vec<Option<Source>>,
    pub(crate) input: Vec<Source>,
    pub(crate) quantity: Vec<InputQuantity>,
    /// Whether the inputs were measured rather than asked for.
    pub(crate) input_measured: bool,
    /// Whether the log has no input, only targets.
    pub(crate) no_input: bool,
    pub(crate) sensor: Option<Vec<Source>>,
    pub(crate) target: Option<Vec<Source>>,
}

/// What is known while channels are looked for.
pub(crate) struct Finder<'a> {
    pub(crate) log: &'a Log,
    pub(crate) joints: &'a [Joint],
    pub(crate) words: Vec<JointWords>,
    pub(crate) settings: &'a Settings,
    /// Entries of the map that some log can follow.
    pub(crate) elsewhere: &'a [Entry],
    pub(crate) meanings: Vec<Meaning>,
    pub(crate) groups: Vec<Group>,
    pub(crate) said: &'a mut Sentences,
}

/// Finds the channels of a log.
pub(crate) fn assign(
    log: &Log,
    joints: &[Joint],
    settings: &Settings,
    elsewhere: &[Entry],
    said: &mut Sentences,
) -> Result<Assigned, LogError> {
    let words = joint_words(joints.iter().map(|j| j.name.as_str()));
    let mut finder = Finder {
        meanings: meanings(log, &words),
        log,
        joints,
        words,
        settings,
        elsewhere,
        groups: Vec::new(),
        said,
    };
    let mapped = finder.mapped()?;
    finder.groups = groups(&finder.meanings, &finder.words, &mapped.channels());
    finder.say_left_alone();
    let position = finder.required(Kind::Position, &mapped)?;
    let clock = match position.first() {
        Some(Source::Channel(i, _)) => log.channels[*i].clock,
        _ => 0,
    };
    let velocity = finder.optional(Kind::Velocity, &mapped, Some(clock))?;
    let target = whole(finder.optional(Kind::Target, &mapped, None)?);
    let sensor = whole(finder.optional(Kind::Sensor, &mapped, None)?);
    let input = finder.input(&mapped, target.is_some())?;
    let time = finder.time(&mapped)?;
    Ok(Assigned {
        time,
        position,
        velocity,
        input: input.sources,
        quantity: input.quantities,
        input_measured: input.measured,
        no_input: input.none,
        sensor,
        target,
    })
}

/// All sources, if every joint has one.
fn whole(sources: Vec<Option<Source>>) -> Option<Vec<Source>> {
    sources.into_iter().collect()
}

impl Finder<'_> {
    /// States which numbered channels cannot be told to joints, where nothing else depends on them.
    fn say_left_alone(&mut self) {
        let optional =
            |g: &&Group| matches!(g.what.kind, Kind::Velocity | Kind::Target | Kind::Sensor);
        let faulty: Vec<&Group> = self
            .groups
            .iter()
            .filter(|g| !g.fault.is_empty())
            .filter(optional)
            .collect();
        let sentences: Vec<String> = faulty
            .iter()
            .map(|g| {
                format!(
                    "{}: `{}` is left alone: {}",
                    g.what.kind.name(),
                    self.example(g),
                    g.fault
                )
            })
            .collect();
        for sentence in sentences {
            self.said.say(&self.log.file, sentence);
        }
    }

    /// A quantity that every joint must have.
    fn required(&mut self, kind: Kind, mapped: &mapped::Mapped) -> Result<Vec<Source>, LogError> {
        let found = self.optional(kind, mapped, None)?;
        let missing: Vec<usize> = (0..found.len()).filter(|&j| found[j].is_none()).collect();
        match whole(found) {
            Some(sources) => Ok(sources),
            None => Err(self.missing(kind, &missing)),
        }
    }

    /// A quantity as the user maps it, otherwise by names; of the channels of one clock, if given
    /// and if it has some.
    fn optional(
        &mut self,
        kind: Kind,
        mapped: &mapped::Mapped,
        clock: Option<usize>,
    ) -> Result<Vec<Option<Source>>, LogError> {
        let mut out: Vec<Option<Source>> =
            (0..self.joints.len()).map(|j| mapped.of(kind, j)).collect();
        if out.iter().all(Option::is_some) {
            return Ok(out);
        }
        let candidates: Vec<Group> = self
            .groups
            .iter()
            .filter(|g| g.what.kind == kind)
            .cloned()
            .collect();
        let on = |g: &Group| clock.is_none_or(|c| g.all().all(|i| self.log.channels[i].clock == c));
        let near: Vec<Group> = candidates.iter().filter(|g| on(g)).cloned().collect();
        let candidates = if near.is_empty() { candidates } else { near };
        let free: Vec<usize> = (0..out.len()).filter(|&j| out[j].is_none()).collect();
        let Some(group) = self.choose(kind, candidates, &free)? else {
            return Ok(out);
        };
        for &j in &free {
            if let Some(&i) = group.channels[j].first() {
                out[j] = Some(Source::Channel(i, self.unit(kind, group.what.word, j, i)?));
            }
        }
        self.say_group(kind, &group, &free);
        Ok(out)
    }

    /// The one group that may be meant; parts are put together. `None` if there is none.
    pub(crate) fn choose(
        &mut self,
        kind: Kind,
        candidates: Vec<Group>,
        joints: &[usize],
    ) -> Result<Option<Group>, LogError> {
        let has = |g: &Group| {
            joints
                .iter()
                .filter(|&&j| !g.channels[j].is_empty())
                .count()
        };
        let mut best: Vec<Group> = candidates
            .iter()
            .filter(|g| has(g) == joints.len())
            .cloned()
            .collect();
        if best.is_empty() {
            best.extend(united(
                candidates.iter().filter(|g| g.fault.is_empty()),
                joints,
            ));
        }
        if best.len() > 1 {
            let rank = |g: &Group| rank(kind, &g.key);
            let top = best.iter().map(rank).min();
            let (first, others): (Vec<Group>, Vec<Group>) =
                best.into_iter().partition(|g| Some(rank(g)) == top);
            if first.len() == 1 && !others.is_empty() {
                let (name, other) = (self.example(&first[0]), self.example(&others[0]));
                let why = match kind {
                    Kind::Target => "it is called a reference",
                    _ => "joint states come from the drives themselves",
                };
                let sentence = format!(
                    "{}: `{name}` is taken and not `{other}`, since {why}",
                    kind.name()
                );
                self.said.say(&self.log.file, sentence);
            }
            best = first;
        }
        let repeated = |g: &Group| joints.iter().find(|&&j| g.channels[j].len() > 1).copied();
        match best.as_slice() {
            [] => Ok(None),
            [group] => match repeated(group) {
                None => Ok(Some(best.remove(0))),
                Some(j) => Err(self.ambiguous(kind, j, group.channels[j].clone())),
            },
            several => {
                let j = joints.first().copied().unwrap_or(0);
                let channels = several
                    .iter()
                    .filter_map(|g| g.channels[j].first().copied())
                    .collect();
                Err(self.ambiguous(kind, j, channels))
            }
        }
    }

    /// Name of the first channel of a group.
    fn example(&self, group: &Group) -> String {
        let name = |&i: &usize| self.log.channels[i].name.clone();
        group.members.first().map_or_else(String::new, name)
    }

    pub(crate) fn ambiguous(&self, kind: Kind, joint: usize, channels: Vec<usize>) -> LogError {
        let joint = &self.joints[joint].name;
        let names: Vec<String> = channels
            .iter()
            .map(|&i| format!("`{}`", self.log.channels[i].name))
            .collect();
        let first = channels
            .first()
            .map_or("", |&i| self.log.channels[i].name.as_str());
        LogError::Ambiguous {
            file: self.log.file.clone(),
            what: format!("the {} of joint `{joint}`", kind.name()),
            candidates: names.join(" or "),
            mend: format!("say which: --map '{}:{joint}={first}'", kind.word()),
        }
    }

    /// The unit of a channel: as mapped for the kind, as stated, otherwise SI.
    pub(crate) fn unit(
        &self,
        kind: Kind,
        word: Word,
        joint: usize,
        channel: usize,
    ) -> Result<Unit, LogError> {
        let meaning = &self.meanings[channel];
        let si = self.dimension(kind, word, joint);
        let spoken = self
            .settings
            .map
            .iter()
            .find(|e| e.kind == kind && e.joint.is_none() && e.column.is_empty());
        if let Some(strange) = &meaning.strange_unit
            && spoken.is_none()
            && meaning.unit.is_none()
        {
            return Err(self.unit_fault(channel, strange, kind, si));
        }
        let unit = meaning
            .unit
            .clone()
            .or_else(|| spoken.and_then(crate::Entry::unit));
        match unit {
            Some(unit) => self.fitting(unit, kind, si, channel),
            None => Ok(Unit::si(si)),
        }
    }

    /// The unit, if it measures what it must; factors do.
    pub(crate) fn fitting(
        &self,
        mut unit: Unit,
        kind: Kind,
        si: Dimension,
        channel: usize,
    ) -> Result<Unit, LogError> {
        if unit.dimension == Dimension::Raw {
            unit.dimension = si;
        }
        if unit.dimension == si {
            return Ok(unit);
        }
        Err(self.unit_fault(channel, &unit.text, kind, si))
    }

    fn unit_fault(&self, channel: usize, unit: &str, kind: Kind, si: Dimension) -> LogError {
        let name = self.log.channels[channel].name.clone();
        LogError::Unit {
            file: self.log.file.clone(),
            unit: unit.to_owned(),
            quantity: format!("{} in {}", kind.name(), si.si()),
            mend: format!(
                "state another unit or channel: --map '{}:JOINT={name}[{}]'; a factor is written [*0.001]",
                kind.word(),
                si.si()
            ),
            channel: name,
        }
    }

    /// What the values of a joint are measured in.
    fn dimension(&self, kind: Kind, word: Word, joint: usize) -> Dimension {
        let slides = self.joints[joint].prismatic;
        match (kind, word) {
            (Kind::Time, _) => Dimension::Time,
            (Kind::Position | Kind::Target, _) if slides => Dimension::Length,
            (Kind::Position | Kind::Target, _) => Dimension::Angle,
            (Kind::Velocity, _) if slides => Dimension::Velocity,
            (Kind::Velocity, _) => Dimension::AngularVelocity,
            (_, Word::Current) => Dimension::Current,
            (_, Word::Voltage) => Dimension::Voltage,
            _ if slides => Dimension::Force,
            _ => Dimension::Torque,
        }
    }

    /// States the columns of a quantity, their unit, and why.
    pub(crate) fn say_group(&mut self, kind: Kind, group: &Group, joints: &[usize]) {
        let found: Vec<(usize, usize)> = joints
            .iter()
            .filter_map(|&j| group.channels[j].first().map(|&i| (j, i)))
            .collect();
        let Some(&(joint, channel)) = found.first() else {
            return;
        };
        let names: Vec<String> = found
            .iter()
            .map(|&(j, i)| format!("`{}` ({})", self.log.channels[i].name, self.joints[j].name))
            .collect();
        let by = match group.by {
            By::Name => "joints by their names",
            By::Part => "joints by the part of their names that no other joint has",
            By::Number => "joints by number, in the order of the robot",
            By::Only => "the robot has one joint",
        };
        let stated = self.meanings[channel].unit.is_some();
        let spoken = self
            .settings
            .map
            .iter()
            .any(|e| e.kind == kind && e.joint.is_none() && e.column.is_empty());
        let why = if stated {
            "as stated there"
        } else if spoken {
            "as --map says"
        } else {
            "SI, since no unit is stated"
        };
        let unit = self
            .unit(kind, group.what.word, joint, channel)
            .map_or_else(|_| String::new(), |u| u.text);
        let sentence = format!(
            "{}: {}; unit {unit}, {why}; {by}",
            kind.name(),
            names.join(", ")
        );
        self.said.say(&self.log.file, sentence);
    }

    /// What is missing, and what is there instead.
    pub(crate) fn missing(&self, kind: Kind, joints: &[usize]) -> LogError {
        let names: Vec<&str> = joints
            .iter()
            .map(|&j| self.joints[j].name.as_str())
            .collect();
        let of = match joints.len() {
            0 => String::new(),
            1 => format!(" of joint `{}`", names[0]),
            _ => format!(" of joints {}", names.join(", ")),
        };
        let faults = self
            .groups
            .iter()
            .filter(|g| g.what.kind == kind && !g.fault.is_empty());
        let fault = faults
            .map(|g| format!("; `{}`: {}", self.example(g), g.fault))
            .next();
        let channels: Vec<&str> = self.log.channels.iter().map(|c| c.name.as_str()).collect();
        let shown = channels
            .iter()
            .take(12)
            .map(|c| format!("`{c}`"))
            .collect::<Vec<_>>()
            .join(", ");
        let more = if channels.len() > 12 {
            format!(" and {} more", channels.len() - 12)
        } else {
            String::new()
        };
        let joint = names.first().copied().unwrap_or("JOINT");
        let near = near(joint, kind, &channels);
        LogError::Missing {
            file: self.log.file.clone(),
            quantity: kind.name(),
            of,
            found: fault.unwrap_or_else(|| format!("; the log has {shown}{more}")),
            mend: format!(
                "say which channel: --map '{}:{joint}={}'",
                kind.word(),
                near.unwrap_or("CHANNEL[UNIT]")
            ),
        }
    }
}

/// The channel whose name is nearest to a joint's.
fn near<'a>(joint: &str, kind: Kind, channels: &[&'a str]) -> Option<&'a str> {
    // Half of the letters in place: a proposal, never a choice.
    const NEAR: f64 = 0.5;
    let wanted = format!("{joint} {}", kind.name());
    let likeness = |c: &str| {
        let words = crate::names::words(c);
        let whole = strsim::jaro_winkler(&words.join(" "), &wanted);
        words
            .iter()
            .map(|w| strsim::normalized_damerau_levenshtein(w, &joint.to_lowercase()))
            .fold(0.5 * whole, f64::max)
    };
    channels
        .iter()
        .map(|c| (likeness(c), *c))
        .filter(|(l, _)| *l >= NEAR)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| c)
}

/// Which of several topics with the same quantity is taken: the lowest.
fn rank(kind: Kind, key: &str) -> u8 {
    let has = |word: &str| key.split(' ').any(|w| w == word);
    match kind {
        Kind::Target if has("reference") || has("desired") => 0,
        Kind::Target if has("output") => 2,
        _ if has("joint") && has("states") && !has("dynamic") => 0,
        _ => 1,
    }
}

/// Groups of one quantity that have different joints, as one; `None` if they overlap or leave gaps.
fn united<'a>(groups: impl Iterator<Item = &'a Group>, joints: &[usize]) -> Option<Group> {
    let mut out: Option<Group> = None;
    for group in groups {
        match &mut out {
            None => out = Some(group.clone()),
            Some(whole)
                if whole.what.word == group.what.word
                    && whole.what.command == group.what.command =>
            {
                for (a, b) in whole.channels.iter_mut().zip(&group.channels) {
                    a.extend(b);
                }
            }
            Some(_) => return None,
        }
    }
    // Velocities may be there for some joints only; what must be whole is judged where it is asked for.
    out.filter(|g| joints.iter().any(|&j| !g.channels[j].is_empty()))
}
