//! The robot's joints, what the user says, what was assumed.

use std::fmt;

use pid_data::{InputHold, InputQuantity, Kind as Origin};

use crate::map::Entry;

/// A joint of the robot. The order of a list of them is base to tip.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Joint {
    /// Its name in the robot's description.
    pub name: String,
    /// Whether it slides (m) or turns (rad).
    pub prismatic: bool,
    /// What drives it, where the description states it.
    pub input: Option<InputQuantity>,
}

impl Joint {
    /// A joint that turns, with an input that is not stated.
    pub fn revolute(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            prismatic: false,
            input: None,
        }
    }

    /// A joint that slides, with an input that is not stated.
    pub fn prismatic(name: &str) -> Self {
        Self {
            prismatic: true,
            ..Self::revolute(name)
        }
    }
}

/// What the user says of the logs. Nothing is said by default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {
    /// Which channel is what; see [`Entry`].
    pub map: Vec<Entry>,
    /// The quantity of inputs whose name and unit do not say it, and the one to take where a log
    /// has several. A torque is a force where the joint slides. Without it, the description counts.
    pub input: Option<InputQuantity>,
    /// Whether no joint was driven: inputs are zeros, and channels of inputs are left alone.
    pub passive: bool,
    /// What inputs do between samples; by default linear for measured ones, zero-order otherwise.
    pub input_hold: Option<InputHold>,
    /// Step of logs without times, s.
    pub sample_time: Option<f64>,
    /// Names of the experiments to judge with. Empty: the last quarter of several logs, at least
    /// one, or the last third of a single one.
    pub test: Vec<String>,
    /// Whether a single log stays whole, to fit on.
    pub whole: bool,
    /// Whether the logs come from hardware; real by default.
    pub origin: Option<Origin>,
    /// Name of the data set; by default that of the first experiment.
    pub name: Option<String>,
}

/// Something the log does not say, decided by a stated rule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Assumption {
    /// The log, or how many logs; empty for all of them.
    pub place: String,
    /// A sentence: column, quantity, unit, and why.
    pub sentence: String,
}

impl fmt::Display for Assumption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.place.is_empty() {
            write!(f, "{}: ", self.place)?;
        }
        f.write_str(&self.sentence)
    }
}

/// Sentences with their logs; the same sentence about several logs stands once.
#[derive(Debug, Default)]
pub(crate) struct Sentences {
    said: Vec<(String, Vec<String>)>,
}

impl Sentences {
    pub(crate) fn say(&mut self, file: &str, sentence: impl Into<String>) {
        let sentence = sentence.into();
        match self.said.iter_mut().find(|(s, _)| *s == sentence) {
            Some((_, files)) if files.iter().any(|f| f == file) => {}
            Some((_, files)) => files.push(file.to_owned()),
            None => self.said.push((sentence, vec![file.to_owned()])),
        }
    }

    pub(crate) fn collected(self) -> Vec<Assumption> {
        let place = |files: Vec<String>| match files.as_slice() {
            [first] => first.clone(),
            [first, rest @ ..] => format!("{first} and {} more", rest.len()),
            [] => String::new(),
        };
        self.said
            .into_iter()
            .map(|(sentence, files)| Assumption {
                place: place(files),
                sentence,
            })
            .collect()
    }
}
