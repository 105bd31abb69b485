//! What the user says of channels: entries `KIND:JOINT=COLUMN[UNIT]`, from the command line or a file.

use std::collections::BTreeMap;
use std::path::Path;

use pid_toml::{Source, Spanned};

use crate::error::LogError;
use crate::units::Unit;

/// The quantity of a channel, by the column of a data set it goes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// `t`, time.
    Time,
    /// `q`, measured position.
    Position,
    /// `dq`, measured velocity.
    Velocity,
    /// `u`, input of the drive.
    Input,
    /// `tau`, torque or force of a sensor at the joint.
    Sensor,
    /// `qref`, commanded position.
    Target,
}

impl Kind {
    /// The letters in a map.
    pub fn word(self) -> &'static str {
        match self {
            Kind::Time => "t",
            Kind::Position => "q",
            Kind::Velocity => "dq",
            Kind::Input => "u",
            Kind::Sensor => "tau",
            Kind::Target => "qref",
        }
    }

    /// The name in sentences.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Time => "time",
            Kind::Position => "position",
            Kind::Velocity => "velocity",
            Kind::Input => "input",
            Kind::Sensor => "sensor torque",
            Kind::Target => "commanded position",
        }
    }

    const ALL: [Kind; 6] = [
        Kind::Time,
        Kind::Position,
        Kind::Velocity,
        Kind::Input,
        Kind::Sensor,
        Kind::Target,
    ];

    fn parse(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.word() == word)
    }
}

/// One entry: which channel is which quantity of which joint.
///
/// | text | meaning |
/// |---|---|
/// | `q:elbow=/js/elbow/pos[deg]` | position of the joint `elbow`, in degrees |
/// | `u:elbow=raw2[N*m*0.001]` | input of the elbow: a torque, the column times 0.001 |
/// | `u:elbow=0` | the elbow has no drive: zeros |
/// | `q=data` | `data[0]`, `data[1]`, … are the positions, in the order of the robot |
/// | `q=/*/angle[deg]` | one channel for each joint, its name in the place of `*` |
/// | `q=[deg]` | positions without a unit are in degrees |
/// | `t=stamp[ms]` | time, in milliseconds |
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The quantity.
    pub kind: Kind,
    /// The joint; `None` for time and for all joints.
    pub joint: Option<String>,
    /// Name of the channel, an array of them, or a pattern; empty if the entry only states a unit.
    pub column: String,
    /// The unit as written.
    pub unit: Option<String>,
    /// Where the entry stands, for messages.
    pub place: String,
}

impl Entry {
    /// An entry from the text after `--map`.
    ///
    /// # Errors
    /// [`LogError::Map`].
    pub fn parse(text: &str) -> Result<Self, LogError> {
        let place = format!("--map '{text}'");
        let Some((left, right)) = text.split_once('=') else {
            return Err(LogError::Map {
                place,
                what: "no `=`".to_owned(),
                mend: "write KIND:JOINT=COLUMN[UNIT], such as q:elbow=/js/elbow/pos[deg]"
                    .to_owned(),
            });
        };
        let (kind, joint) = match left.split_once(':') {
            Some((kind, joint)) => (kind, Some(joint)),
            None => (left, None),
        };
        Self::of(place, kind, joint, right)
    }

    fn of(place: String, kind: &str, joint: Option<&str>, right: &str) -> Result<Self, LogError> {
        let known = Kind::ALL.map(Kind::word);
        let fault = |what: String, mend: String| LogError::Map {
            place: place.clone(),
            what,
            mend,
        };
        let kind = kind.trim();
        let kind = Kind::parse(kind).ok_or_else(|| {
            fault(
                format!("unknown quantity `{kind}`"),
                pid_toml::one_of(kind, known),
            )
        })?;
        let (column, unit) = split_unit(right.trim());
        if let Some(unit) = unit
            && Unit::parse(unit).is_none()
        {
            let mend = "use rad, deg, rad/s, deg/s, rpm, m, mm, s, ms, us, ns, N*m, mNm, N, A, mA, V, or a factor such as *0.001";
            return Err(fault(format!("unknown unit `{unit}`"), mend.to_owned()));
        }
        if column.is_empty() && (unit.is_none() || joint.is_some()) {
            let mend = "write the channel's name after `=`";
            return Err(fault("no channel".to_owned(), mend.to_owned()));
        }
        if kind == Kind::Time && joint.is_some() {
            return Err(fault(
                "time has no joint".to_owned(),
                "write t=COLUMN[UNIT]".to_owned(),
            ));
        }
        Ok(Self {
            kind,
            joint: joint.map(|j| j.trim().to_owned()),
            column: column.to_owned(),
            unit: unit.map(str::to_owned),
            place,
        })
    }

    pub(crate) fn unit(&self) -> Option<Unit> {
        self.unit.as_deref().and_then(Unit::parse)
    }
}

/// The column and the unit in the last brackets; an index is part of the column.
fn split_unit(text: &str) -> (&str, Option<&str>) {
    if let Some(inner) = text.strip_suffix(']')
        && let Some((column, unit)) = inner.rsplit_once('[')
        && unit.parse::<usize>().is_err()
    {
        return (column.trim_end(), Some(unit));
    }
    (text, None)
}

/// The entries of a TOML file.
///
/// ```toml
/// t = "stamp[ms]"
/// dq = "velocities[deg/s]"
/// [q]
/// elbow = "/js/elbow/pos[deg]"
/// [u]
/// elbow = "motor2[mA]"
/// ```
///
/// # Errors
/// [`LogError::File`], [`LogError::MapFile`] and [`LogError::Map`], with the place in the file.
pub fn read_map(path: &Path) -> Result<Vec<Entry>, LogError> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|error| LogError::File {
        file: file.clone(),
        action: "read",
        error,
    })?;
    parse_map(&file, &text)
}

pub(crate) fn parse_map(file: &str, text: &str) -> Result<Vec<Entry>, LogError> {
    let source = Source::new(file, text);
    let mut entries = Vec::new();
    for item in source.tables()? {
        let kind = item.key.as_ref().clone();
        if item.is_table() {
            let table: BTreeMap<Spanned<String>, Spanned<String>> = source.read(item)?;
            for (joint, column) in table {
                let place = source.place_of(&column).to_string();
                entries.push(Entry::of(
                    place,
                    &kind,
                    Some(joint.as_ref()),
                    column.as_ref(),
                )?);
            }
        } else {
            let column: Spanned<String> = source.read(item)?;
            let place = source.place_of(&column).to_string();
            entries.push(Entry::of(place, &kind, None, column.as_ref())?);
        }
    }
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(text: &str) -> (Kind, Option<String>, String, Option<String>) {
        let e = Entry::parse(text).unwrap();
        (e.kind, e.joint, e.column, e.unit)
    }

    #[test]
    fn entries_have_kind_joint_column_and_unit() {
        let some = |s: &str| Some(s.to_owned());
        assert_eq!(
            parts("q:elbow=/js/elbow/pos[deg]"),
            (
                Kind::Position,
                some("elbow"),
                "/js/elbow/pos".into(),
                some("deg")
            )
        );
        assert_eq!(
            parts("u:elbow=data[2][mA]"),
            (Kind::Input, some("elbow"), "data[2]".into(), some("mA"))
        );
        assert_eq!(
            parts("qref:x=cmd[0]"),
            (Kind::Target, some("x"), "cmd[0]".into(), None)
        );
        assert_eq!(
            parts("t=stamp[*0.001]"),
            (Kind::Time, None, "stamp".into(), some("*0.001"))
        );
        assert_eq!(
            parts("q=[deg]"),
            (Kind::Position, None, String::new(), some("deg"))
        );
    }

    #[test]
    fn faults_name_the_entry_and_the_mend() {
        for (text, pieces) in [
            ("q:elbow", ["no `=`", "KIND:JOINT=COLUMN"]),
            ("qq:elbow=a", ["unknown quantity `qq`", "use one of"]),
            ("q:elbow=a[grad]", ["unknown unit `grad`", "deg"]),
            ("q:elbow=", ["no channel", "after `=`"]),
            ("t:elbow=a", ["time has no joint", "t=COLUMN"]),
        ] {
            let told = Entry::parse(text).unwrap_err().to_string();
            assert!(told.contains(text), "{told}");
            assert!(pieces.iter().all(|p| told.contains(p)), "{told}");
        }
    }

    #[test]
    fn a_file_gives_the_same_entries() {
        let text = "t = \"stamp[ms]\"\n[q]\nelbow = \"a[deg]\"\nwrist = \"b\"\n";
        let entries = parse_map("map.toml", text).unwrap();
        let read: Vec<_> = entries
            .iter()
            .map(|e| (e.kind, e.joint.as_deref(), e.column.as_str()))
            .collect();
        assert_eq!(
            read,
            [
                (Kind::Time, None, "stamp"),
                (Kind::Position, Some("elbow"), "a"),
                (Kind::Position, Some("wrist"), "b")
            ]
        );
        assert_eq!(entries[2].place, "map.toml:4:9");
        let told = parse_map("map.toml", "[q]\nelbow = 3\n")
            .unwrap_err()
            .to_string();
        assert!(told.contains("map.toml:2:9"), "{told}");
    }
}
