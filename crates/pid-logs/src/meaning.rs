//! What the channels of a log mean: quantity, joint, and the groups they form.

use std::collections::BTreeMap;

use crate::log::{Hint, Log};
use crate::map::Kind;
use crate::names::{JointWords, Parsed, Word, commands, excludes, measures, parse, quantity_of};
use crate::units::{Dimension, Unit};

/// What one channel is by its name.
#[derive(Debug, Clone)]
pub(crate) struct Meaning {
    pub(crate) parsed: Parsed,
    /// The unit of the format, otherwise that of the name.
    pub(crate) unit: Option<Unit>,
    /// A unit that is stated and not known.
    pub(crate) strange_unit: Option<String>,
    pub(crate) what: Option<What>,
}

/// A quantity, and where it comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct What {
    pub(crate) kind: Kind,
    pub(crate) word: Word,
    /// Asked for, not measured.
    pub(crate) command: bool,
    /// Whether the name says that it was measured.
    pub(crate) measured: bool,
}

/// The meanings of all channels.
pub(crate) fn meanings(log: &Log, joints: &[JointWords]) -> Vec<Meaning> {
    let mut meanings = by_names(log, joints);
    // Beside `u1`, `tau1` is the sensor of a data set's records, by docs/data-format.md.
    let named =
        |m: &Meaning, word: &str| m.parsed.number.is_some() && m.parsed.words == [word, "#"];
    if meanings.iter().any(|m| named(m, "u")) {
        for meaning in meanings.iter_mut().filter(|m| named(m, "tau")) {
            if let Some(what) = &mut meaning.what {
                what.kind = Kind::Sensor;
            }
        }
    }
    meanings
}

fn by_names(log: &Log, joints: &[JointWords]) -> Vec<Meaning> {
    log.channels
        .iter()
        .map(|channel| {
            let parsed = parse(&channel.name, joints);
            let stated = channel.unit.as_deref();
            let unit = stated.and_then(Unit::parse).or_else(|| parsed.unit.clone());
            let strange_unit = stated
                .filter(|u| Unit::parse(u).is_none())
                .map(str::to_owned)
                .or_else(|| parsed.strange_unit.clone());
            let empty = channel.bad.is_none() && channel.values.iter().all(|v| v.is_nan());
            let what = match channel.hint {
                _ if empty => None,
                Some(Hint::Position) => Some(measured_position()),
                Some(Hint::Target) => Some(What {
                    kind: Kind::Target,
                    command: true,
                    ..measured_position()
                }),
                None => what(&parsed, unit.as_ref(), joints.len()),
            };
            Meaning {
                parsed,
                unit,
                strange_unit,
                what,
            }
        })
        .collect()
}

fn measured_position() -> What {
    What {
        kind: Kind::Position,
        word: Word::Position,
        command: false,
        measured: true,
    }
}

/// The quantity of a name; `None` for names that do not say it.
fn what(parsed: &Parsed, unit: Option<&Unit>, joints: usize) -> Option<What> {
    let leaf = parsed.leaf_words();
    // `error/positions` is a difference: what follows the joint counts with the leaf.
    let after = parsed
        .words
        .iter()
        .rposition(|w| w == "#")
        .filter(|at| *at < parsed.leaf)
        .unwrap_or(parsed.leaf);
    if parsed.words[after..].iter().any(|w| excludes(w)) {
        return None;
    }
    let mut words: Vec<Word> = leaf.iter().filter_map(|w| quantity_of(w)).collect();
    words.sort_unstable();
    words.dedup();
    let of_joint = !parsed.joints.is_empty() || parsed.number.is_some() || joints == 1;
    let mut word = match words.as_slice() {
        [word] => *word,
        // `torque_cmd_time`, `velocity_torque`: two quantities are none.
        [_, ..] => return None,
        [] => unit
            .filter(|_| of_joint)
            .and_then(|u| word_of(u.dimension))?,
    };
    let follows =
        |first: &str, second: &str| leaf.windows(2).any(|w| w[0] == first && w[1] == second);
    if word == Word::Position
        && (leaf.iter().any(|w| w == "dot") || follows("d", "q") || follows("d", "theta"))
    {
        word = Word::Velocity;
    }
    if word == Word::Time {
        let kind = Kind::Time;
        return parsed.joints.is_empty().then_some(What {
            kind,
            word,
            command: false,
            measured: false,
        });
    }
    if !of_joint {
        return None;
    }
    // `states` is part of a type's name too: `/target_joint_states` is a command.
    let said = parsed
        .words
        .iter()
        .rev()
        .find(|w| commands(w) || measures(w));
    let weak = || {
        parsed
            .words
            .iter()
            .any(|w| matches!(w.as_str(), "state" | "states"))
    };
    let desired = leaf
        .windows(2)
        .any(|w| quantity_of(&w[0]).is_some() && w[1] == "d");
    let command = desired || said.is_some_and(|w| commands(w));
    let measured = !command && (said.is_some() || weak());
    let kind = match word {
        Word::Position if command => Kind::Target,
        Word::Position => Kind::Position,
        Word::Velocity if command => return None,
        Word::Velocity => Kind::Velocity,
        _ if leaf.iter().any(|w| w == "sensor") => Kind::Sensor,
        _ => Kind::Input,
    };
    Some(What {
        kind,
        word,
        command,
        measured,
    })
}

/// The quantity of a unit.
fn word_of(dimension: Dimension) -> Option<Word> {
    Some(match dimension {
        Dimension::Angle | Dimension::Length => Word::Position,
        Dimension::AngularVelocity | Dimension::Velocity => Word::Velocity,
        Dimension::Torque => Word::Torque,
        Dimension::Force => Word::Force,
        Dimension::Current => Word::Current,
        Dimension::Voltage => Word::Voltage,
        Dimension::Time | Dimension::Raw => return None,
    })
}

/// Channels that differ by their joint only.
#[derive(Debug, Clone)]
pub(crate) struct Group {
    pub(crate) what: What,
    /// Words that the names share.
    pub(crate) key: String,
    /// For each joint its channels; more than one if names repeat.
    pub(crate) channels: Vec<Vec<usize>>,
    /// All channels.
    pub(crate) members: Vec<usize>,
    /// How joints were found.
    pub(crate) by: By,
    /// Why numbers do not tell the joints; empty if they do.
    pub(crate) fault: String,
}

/// How the joints of a group were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum By {
    /// By their names.
    Name,
    /// By a part of their names that no other joint has.
    Part,
    /// By numbers, in the order of the robot.
    Number,
    /// There is one joint.
    Only,
}

impl Group {
    /// Whether every joint has a channel.
    pub(crate) fn complete(&self) -> bool {
        self.channels.iter().all(|c| !c.is_empty())
    }

    /// All channels.
    pub(crate) fn all(&self) -> impl Iterator<Item = usize> {
        self.channels.iter().flatten().copied()
    }
}

/// The groups of a log, without those channels that are spoken for.
pub(crate) fn groups(meanings: &[Meaning], joints: &[JointWords], taken: &[usize]) -> Vec<Group> {
    let mut found: BTreeMap<(What, String, By), Vec<usize>> = BTreeMap::new();
    for (i, meaning) in meanings.iter().enumerate() {
        let Some(what) = meaning
            .what
            // A name with two joints belongs to neither.
            .filter(|w| {
                w.kind != Kind::Time && !taken.contains(&i) && meaning.parsed.joints.len() < 2
            })
        else {
            continue;
        };
        let parsed = &meaning.parsed;
        let by = match (parsed.joints.len(), parsed.number) {
            (0, Some(_)) => By::Number,
            (0, None) => By::Only,
            _ if parsed.part => By::Part,
            _ => By::Name,
        };
        found.entry((what, parsed.key(), by)).or_default().push(i);
    }
    found
        .into_iter()
        .map(|((what, key, by), members)| {
            let mut channels = vec![Vec::new(); joints.len()];
            let mut fault = String::new();
            if by == By::Number {
                fault = number(meanings, joints, &members, &mut channels);
            } else {
                for &i in &members {
                    let named: &[usize] = if by == By::Only {
                        &[0]
                    } else {
                        &meanings[i].parsed.joints
                    };
                    named.iter().for_each(|&j| channels[j].push(i));
                }
            }
            Group {
                what,
                key,
                channels,
                by,
                fault,
                members,
            }
        })
        .collect()
}

/// Gives numbered channels to joints in order. The numbers must be 0 to n-1 or 1 to n; otherwise the
/// reason comes back.
fn number(
    meanings: &[Meaning],
    joints: &[JointWords],
    members: &[usize],
    channels: &mut [Vec<usize>],
) -> String {
    let n = joints.len();
    let number = |i: &usize| meanings[*i].parsed.number.unwrap_or(0);
    let low = members.iter().map(number).min().unwrap_or(0);
    let high = members.iter().map(number).max().unwrap_or(0);
    let distinct: std::collections::BTreeSet<usize> = members.iter().map(number).collect();
    if low > 1 || high + 1 - low != n || distinct.len() != n {
        let count = distinct.len();
        return format!(
            "the numbers go from {low} to {high} ({count} of them), the robot has {n} joints"
        );
    }
    let own: Option<Vec<usize>> = joints.iter().map(|j| j.number).collect();
    if own.is_some_and(|own| own.windows(2).any(|w| w[0] >= w[1])) {
        return "the numbers in the names of the joints are in another order than the joints"
            .to_owned();
    }
    for i in members {
        channels[number(i) - low].push(*i);
    }
    String::new()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Channel;
    use crate::names::joint_words;

    fn told(name: &str) -> Option<(Kind, Word, bool)> {
        let log = Log {
            channels: vec![Channel::new(name.to_owned(), 0, vec![1.0])],
            ..Log::default()
        };
        let joints = joint_words(["shoulder", "elbow"].into_iter());
        meanings(&log, &joints)[0]
            .what
            .map(|w| (w.kind, w.word, w.command))
    }

    #[test]
    fn names_say_quantity_and_origin() {
        use Kind as K;
        use Word as W;
        for (name, expected) in [
            ("q1", Some((K::Position, W::Position, false))),
            (
                "/joint_states/elbow/pos",
                Some((K::Position, W::Position, false)),
            ),
            ("dq2", Some((K::Velocity, W::Velocity, false))),
            ("d_q2", Some((K::Velocity, W::Velocity, false))),
            ("q_d_1", Some((K::Target, W::Position, true))),
            ("target_q_0", Some((K::Target, W::Position, true))),
            ("action/elbow.pos", Some((K::Target, W::Position, true))),
            (
                "/jtc/state/elbow/reference/positions",
                Some((K::Target, W::Position, true)),
            ),
            (
                "/jtc/state/elbow/feedback/positions",
                Some((K::Position, W::Position, false)),
            ),
            ("/jtc/state/elbow/reference/velocities", None),
            ("/jtc/state/elbow/error/positions", None),
            (
                "/jtc/state/elbow/output/effort",
                Some((K::Input, W::Input, true)),
            ),
            ("actual_current_1", Some((K::Input, W::Current, false))),
            (
                "/target_joint_states/elbow/position",
                Some((K::Target, W::Position, true)),
            ),
            (
                "shoulder_elbow_pos",
                Some((K::Position, W::Position, false)),
            ),
            ("elbow_torque_cmd", Some((K::Input, W::Torque, true))),
            ("elbow torque sensor", Some((K::Sensor, W::Torque, false))),
            ("tau_ext_1", None),
            ("elbow [deg]", Some((K::Position, W::Position, false))),
            ("elbow", None),
            ("motor_temperature_1", None),
            ("__time", Some((K::Time, W::Time, false))),
            ("header/stamp", Some((K::Time, W::Time, false))),
        ] {
            assert_eq!(told(name), expected, "{name}");
        }
    }
}
