//! Names of channels taken apart: joint, number, words, unit.

use crate::units::{Dimension, Unit};

/// A joint's name as words, for the search in names of channels.
#[derive(Debug, Clone)]
pub(crate) struct JointWords {
    /// All of them.
    whole: Vec<String>,
    /// Those that tell the joint from the others; empty if none does.
    telling: Vec<String>,
    /// The number at the end of the name.
    pub(crate) number: Option<usize>,
}

/// Words that say nothing about which joint is meant.
const GENERIC: [&str; 6] = ["joint", "motor", "axis", "link", "j", "servo"];

/// The words of all joints of a robot.
pub(crate) fn joint_words<'a>(names: impl Iterator<Item = &'a str>) -> Vec<JointWords> {
    let all: Vec<Vec<String>> = names.map(words).collect();
    let common = |word: &String| all.len() > 1 && all.iter().all(|w| w.contains(word));
    all.iter()
        .map(|whole| {
            let tells = |w: &&String| !GENERIC.contains(&w.as_str()) && !common(w);
            let telling: Vec<String> = whole.iter().filter(tells).cloned().collect();
            let spoken = telling.iter().any(|w| w.parse::<u64>().is_err());
            JointWords {
                number: whole.last().and_then(|w| w.parse().ok()),
                telling: if spoken && telling.len() < whole.len() {
                    telling
                } else {
                    Vec::new()
                },
                whole: whole.clone(),
            }
        })
        .collect()
}

/// The name of a channel, taken apart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parsed {
    /// Joints whose name stands in it; several if none is named better than another.
    pub(crate) joints: Vec<usize>,
    /// Whether the joint is known by a part of its name only.
    pub(crate) part: bool,
    /// The last number that is not part of the joint's name.
    pub(crate) number: Option<usize>,
    /// The other words, with `#` where joint or number stood.
    pub(crate) words: Vec<String>,
    /// Index of the first word of the last part of a path.
    pub(crate) leaf: usize,
    /// The unit in the name.
    pub(crate) unit: Option<Unit>,
    /// A text in brackets that is no unit known here.
    pub(crate) strange_unit: Option<String>,
}

impl Parsed {
    /// Words of the last part of the path.
    pub(crate) fn leaf_words(&self) -> &[String] {
        self.words.get(self.leaf..).unwrap_or(&[])
    }

    /// Name of the group of channels that differ by their joint only.
    pub(crate) fn key(&self) -> String {
        self.words.join(" ")
    }
}

/// Takes the name of a channel apart.
pub(crate) fn parse(name: &str, joints: &[JointWords]) -> Parsed {
    let (rest, bracket) = bracket(name);
    let mut unit = bracket.and_then(Unit::parse);
    let strange_unit = bracket.filter(|_| unit.is_none()).map(str::to_owned);
    let cut = rest.rfind('/').map_or(0, |at| at + 1);
    let mut found = words(&rest[..cut]);
    let mut leaf = found.len();
    found.extend(words(&rest[cut..]));

    let (mut named, part) = find_joint(&found, joints);
    if let Some((_, start, length)) = named.first().copied() {
        found.splice(start..start + length, ["#".to_owned()]);
        if start + length <= leaf {
            leaf -= length - 1;
        } else if start < leaf {
            leaf = start;
        }
    }
    named.sort_unstable();
    let joints: Vec<usize> = named.into_iter().map(|(j, ..)| j).collect();
    if unit.is_none() {
        unit = unit_at_end(&mut found, leaf, &rest[cut..]);
    }
    let place = found.iter().rposition(|w| w.parse::<usize>().is_ok());
    let number = place.filter(|_| joints.is_empty()).and_then(|at| {
        let number = found[at].parse().ok();
        found[at] = "#".to_owned();
        number
    });
    // A path that ends with the joint, `/joint_states/position/elbow`: the part before says what it is.
    while leaf > 0
        && found[leaf..]
            .iter()
            .all(|w| matches!(w.as_str(), "#" | "data" | "value"))
    {
        leaf -= 1;
    }
    Parsed {
        joints,
        part,
        number,
        words: found,
        leaf,
        unit,
        strange_unit,
    }
}

/// The name without a text in brackets at its end, and that text; an index is no unit.
fn bracket(name: &str) -> (&str, Option<&str>) {
    let name = name.trim();
    for (open, close) in [('[', ']'), ('(', ')')] {
        if let Some(inner) = name.strip_suffix(close)
            && let Some((rest, unit)) = inner.rsplit_once(open)
            && unit.trim().parse::<usize>().is_err()
            && !unit.trim().is_empty()
        {
            return (rest.trim_end(), Some(unit.trim()));
        }
    }
    (name, None)
}

/// Lower-case words of a name: runs of letters and runs of digits; `jointPosition` is two words.
pub(crate) fn words(name: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let mut before = ' ';
    for c in name.chars() {
        let kind = |c: char| (c.is_alphabetic() || c == '°', c.is_ascii_digit());
        let hump = before.is_lowercase() && c.is_uppercase();
        if kind(c) == (false, false) {
            before = ' ';
            continue;
        }
        if kind(c) != kind(before) || hump {
            out.push(String::new());
        }
        if let Some(word) = out.last_mut() {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    for word in &mut out {
        // `joint01` and `joint1` are the same.
        if let Ok(number) = word.parse::<u64>() {
            *word = number.to_string();
        }
    }
    out
}

/// Joint, first word and number of words.
type Place = (usize, usize, usize);

/// The joints whose name is longest among those that stand in the words; whether by a part of it.
fn find_joint(words: &[String], joints: &[JointWords]) -> (Vec<Place>, bool) {
    let search = |of: fn(&JointWords) -> &[String]| {
        let mut best: Vec<Place> = Vec::new();
        for (j, joint) in joints.iter().enumerate() {
            let sought = of(joint);
            if sought.is_empty() {
                continue;
            }
            let at = words.windows(sought.len()).rposition(|w| w == sought);
            let Some(start) = at else { continue };
            let longest = best.first().map_or(0, |b| b.2);
            if sought.len() > longest {
                best.clear();
            }
            if sought.len() >= longest {
                best.push((j, start, sought.len()));
            }
        }
        best
    };
    let whole = search(|j| &j.whole);
    if !whole.is_empty() {
        return (whole, false);
    }
    let part = search(|j| &j.telling);
    let found = !part.is_empty();
    (part, found)
}

/// Takes a unit off the end of the words: `pos_rad`, `vel_deg_s`, `time_ms`, `current_mA`. `last` is
/// the last part of the path as written, since `mA` is two words.
fn unit_at_end(words: &mut Vec<String>, leaf: usize, last: &str) -> Option<Unit> {
    for length in [2, 1] {
        let mut parts = last.rsplitn(length + 1, ['_', ' ', '.', '-']);
        let mut tail: Vec<&str> = parts.by_ref().take(length).collect();
        tail.reverse();
        // A unit alone is a name.
        if tail.len() < length || parts.next().is_none_or(str::is_empty) {
            continue;
        }
        let text = tail.join("_");
        let Some(unit) = Unit::parse(&text) else {
            continue;
        };
        let start = words
            .len()
            .saturating_sub(tail.iter().map(|t| self::words(t).len()).sum());
        // The end of a joint's name is no unit.
        if start <= leaf || words[start..].iter().any(|w| w == "#") {
            continue;
        }
        let fits = |w: &str| quantity_of(w).is_some_and(|q| q.has(unit.dimension));
        // One letter is a unit only beside a word it fits: `current_a`, not `joint_a`.
        let alone = text.chars().count() == 1 && !words[leaf..start].iter().any(|w| fits(w));
        if alone || matches!(text.as_str(), "min" | "hz" | "um") {
            continue;
        }
        words.truncate(start);
        return Some(unit);
    }
    None
}

/// What a word says about a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Word {
    Time,
    Position,
    Velocity,
    /// An input whose quantity is not said: `effort`, `u`.
    Input,
    Torque,
    Force,
    Current,
    Voltage,
}

impl Word {
    /// Whether a unit of this dimension fits.
    pub(crate) fn has(self, dimension: Dimension) -> bool {
        use Dimension as D;
        match self {
            Word::Time => dimension == D::Time,
            Word::Position => matches!(dimension, D::Angle | D::Length),
            Word::Velocity => matches!(dimension, D::AngularVelocity | D::Velocity),
            Word::Input => {
                matches!(dimension, D::Torque | D::Force | D::Current | D::Voltage)
            }
            Word::Torque => dimension == D::Torque,
            Word::Force => dimension == D::Force,
            Word::Current => dimension == D::Current,
            Word::Voltage => dimension == D::Voltage,
        }
    }
}

/// The quantity of a word.
pub(crate) fn quantity_of(word: &str) -> Option<Word> {
    Some(match word {
        "t" | "time" | "times" | "timestamp" | "timestamps" | "stamp" | "elapsed" => Word::Time,
        "pos" | "position" | "positions" | "q" | "angle" | "angles" | "ang" | "qpos" | "theta"
        | "phi" | "encoder" | "enc" | "qref" | "qdes" | "qcmd" => Word::Position,
        "vel" | "velocity" | "velocities" | "dq" | "qd" | "speed" | "speeds" | "qdot" | "qvel"
        | "omega" | "thetadot" | "dtheta" => Word::Velocity,
        "effort" | "efforts" | "u" | "input" | "inputs" => Word::Input,
        "torque" | "torques" | "tau" | "trq" => Word::Torque,
        "force" | "forces" => Word::Force,
        "current" | "currents" | "curr" | "i" | "amps" => Word::Current,
        "voltage" | "voltages" | "volt" | "volts" => Word::Voltage,
        _ => return None,
    })
}

/// Whether the word says that a value was asked for.
pub(crate) fn commands(word: &str) -> bool {
    matches!(
        word,
        "cmd"
            | "command"
            | "commanded"
            | "commands"
            | "target"
            | "targets"
            | "desired"
            | "des"
            | "ref"
            | "reference"
            | "references"
            | "setpoint"
            | "goal"
            | "action"
            | "actions"
            | "output"
            | "qref"
            | "qdes"
            | "qcmd"
    )
}

/// Whether the word says that a value was measured.
pub(crate) fn measures(word: &str) -> bool {
    matches!(
        word,
        "measured" | "actual" | "meas" | "feedback" | "act" | "estimated" | "est" | "sensor"
    )
}

/// Whether the word says that the channel is none of the quantities.
pub(crate) fn excludes(word: &str) -> bool {
    matches!(
        word,
        "error"
            | "errors"
            | "err"
            | "temperature"
            | "temp"
            | "acceleration"
            | "accelerations"
            | "accel"
            | "acc"
            | "ddq"
            | "qdd"
            | "limit"
            | "limits"
            | "min"
            | "max"
            | "std"
            | "variance"
            | "covariance"
            | "ext"
            | "external"
            | "stiffness"
            | "damping"
            | "kp"
            | "kd"
            | "ki"
            | "gain"
            | "gains"
            | "jerk"
            | "gravity"
            | "coriolis"
            | "imu"
            | "tcp"
            | "pose"
            | "orientation"
            | "cartesian"
            | "euler"
            | "from"
            | "duration"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(name: &str, joints: &[&str]) -> Parsed {
        parse(name, &joint_words(joints.iter().copied()))
    }

    #[test]
    fn joints_are_found_without_case_and_signs() {
        let arm = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"];
        for (name, joint, part) in [
            ("/joint_states/elbow_joint/position", 2, false),
            ("ELBOW-JOINT.pos", 2, false),
            ("shoulderPanJoint_velocity", 0, false),
            ("shoulder_lift.pos", 1, true),
            ("/js/position/elbow", 2, true),
        ] {
            let p = parsed(name, &arm);
            assert_eq!((p.joints, p.part), (vec![joint], part), "{name}");
        }
        assert!(parsed("shoulder.pos", &arm).joints.is_empty());
        let numbered = ["joint1", "joint10"];
        assert_eq!(parsed("joint10_pos", &numbered).joints, [1]);
        assert_eq!(parsed("joint_01_pos", &numbered).joints, [0]);
    }

    #[test]
    fn units_stand_in_brackets_or_at_the_end() {
        for (name, unit) in [
            ("q1 [deg]", Some("deg")),
            ("effort (Nm)", Some("Nm")),
            ("elbow_pos_rad", Some("rad")),
            ("vel_deg_s_2", None),
            ("elbow_vel_deg_s", Some("deg_s")),
            ("time_ms", Some("ms")),
            ("elbow_current_a", Some("a")),
            ("elbow_current_mA", Some("mA")),
            ("elbow_torque_Nm", Some("Nm")),
            ("position[3]", None),
            ("joint_a", None),
        ] {
            let found = parsed(name, &["elbow"]).unit.map(|u| u.text);
            assert_eq!(found.as_deref(), unit, "{name}");
        }
        let strange = parsed("q1 [furlong]", &["elbow"]).strange_unit;
        assert_eq!(strange.as_deref(), Some("furlong"));
    }

    #[test]
    fn the_last_part_of_a_path_says_the_quantity() {
        let p = parsed("/position_controller/state/elbow/effort", &["elbow"]);
        assert_eq!(p.leaf_words(), ["effort"]);
        let p = parsed("/joint_states/position/elbow", &["elbow"]);
        assert!(p.leaf_words().contains(&"position".to_owned()));
        let p = parsed("/joint_states/position[1]", &["elbow", "wrist"]);
        assert_eq!(
            (p.number, p.key().as_str()),
            (Some(1), "joint states position #")
        );
    }
}
