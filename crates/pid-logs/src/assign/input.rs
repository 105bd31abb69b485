//! Inputs of drives. Whether an effort is a torque at the joint, a current or a voltage is stated by
//! its name, its unit, the user or the robot's description, and never guessed.

use pid_data::InputQuantity;

use super::{Finder, Source, mapped::Mapped};
use crate::error::LogError;
use crate::map::Kind;
use crate::meaning::{Group, Meaning};
use crate::names::{Word, commands};
use crate::units::{Dimension, Unit};

/// The inputs of all joints.
#[derive(Debug)]
pub(crate) struct Inputs {
    pub(crate) sources: Vec<Source>,
    pub(crate) quantities: Vec<InputQuantity>,
    pub(crate) measured: bool,
    pub(crate) none: bool,
}

impl Finder<'_> {
    pub(crate) fn input(&mut self, mapped: &Mapped, targets: bool) -> Result<Inputs, LogError> {
        let n = self.joints.len();
        if self.settings.passive {
            self.said.say(
                &self.log.file,
                "input: zeros, since no joint was driven (--passive)",
            );
            return Ok(self.zeros(false));
        }
        let given: Vec<Option<Source>> = (0..n).map(|j| mapped.of(Kind::Input, j)).collect();
        let free: Vec<usize> = (0..n).filter(|&j| given[j].is_none()).collect();
        let group = if free.is_empty() {
            None
        } else {
            self.input_group(&free)?
        };
        if group.is_none() && !free.is_empty() {
            if free.len() < n {
                return Err(self.missing_input(&free));
            }
            if targets {
                self.said.say(
                    &self.log.file,
                    "input: zeros, since the log has commanded positions and no input",
                );
                return Ok(self.zeros(true));
            }
            return Err(self.missing_input(&free));
        }
        let mut inputs = Inputs {
            sources: Vec::new(),
            quantities: Vec::new(),
            measured: false,
            none: false,
        };
        for (j, source) in given.into_iter().enumerate() {
            let (source, word) = match (source, &group) {
                (Some(source), _) => (
                    source,
                    mapped.inputs.get(&j).copied().unwrap_or(Word::Input),
                ),
                (None, Some(group)) => {
                    let i = group.channels[j]
                        .first()
                        .copied()
                        .ok_or_else(|| self.missing_input(&[j]))?;
                    (
                        Source::Channel(i, Unit::si(Dimension::Raw)),
                        self.word(group, i),
                    )
                }
                (None, None) => return Err(self.missing_input(&[j])),
            };
            let quantity = self.quantity(j, word, &source)?;
            let source = match source {
                Source::Channel(i, unit) => {
                    let fixed = unit.dimension != Dimension::Raw;
                    let word = word_of(quantity);
                    let unit = if fixed {
                        unit
                    } else {
                        self.unit(Kind::Input, word, j, i)?
                    };
                    Source::Channel(
                        i,
                        self.fitting(unit, Kind::Input, self.dimension(Kind::Input, word, j), i)?,
                    )
                }
                constant => constant,
            };
            inputs.sources.push(source);
            inputs.quantities.push(quantity);
        }
        if let Some(group) = group {
            inputs.measured = group.what.measured;
            self.say_input(&inputs, &free);
        }
        Ok(inputs)
    }

    /// The group of inputs for the joints that are not mapped.
    fn input_group(&mut self, free: &[usize]) -> Result<Option<Group>, LogError> {
        let all: Vec<Group> = self
            .groups
            .iter()
            .filter(|g| g.what.kind == Kind::Input)
            .cloned()
            .collect();
        let fits = |g: &Group| {
            free.iter().all(|&j| {
                let Some(&i) = g.channels[j].first() else {
                    return true;
                };
                let word = self.word(g, i);
                self.wanted(j).is_none_or(|w| {
                    word == Word::Input || quantity_of(word, self.joints[j].prismatic) == Some(w)
                })
            })
        };
        let candidates: Vec<Group> = all.iter().filter(|g| fits(g)).cloned().collect();
        if candidates.is_empty() && !all.is_empty() {
            let found: Vec<&str> = all
                .iter()
                .flat_map(Group::all)
                .map(|i| self.log.channels[i].name.as_str())
                .take(6)
                .collect();
            let wanted = self.wanted(free[0]).map_or("input", InputQuantity::word);
            return Err(LogError::Missing {
                file: self.log.file.clone(),
                quantity: "input",
                of: format!(" that is a {wanted}, as the description or --input says"),
                found: format!("; the log has {}", found.join(", ")),
                mend: format!(
                    "correct --input or the description, or map the channel: --map 'u:{}=CHANNEL[UNIT]'",
                    self.joints[free[0]].name
                ),
            });
        }
        let complete: Vec<&Group> = candidates.iter().filter(|g| g.complete()).collect();
        let alike = complete
            .windows(2)
            .all(|w| w[0].what == w[1].what && !w[0].what.command);
        if complete.len() > 1 && !alike {
            // Measured or commanded, effort or current: the user decides.
            let channels = complete
                .iter()
                .filter_map(|g| g.channels[free[0]].first().copied())
                .collect();
            return Err(self.ambiguous(Kind::Input, free[0], channels));
        }
        self.choose(Kind::Input, candidates, free)
    }

    /// The quantity of a channel by name and unit; [`Word::Input`] if neither says it.
    fn word(&self, group: &Group, channel: usize) -> Word {
        if group.what.word != Word::Input {
            return group.what.word;
        }
        match self.meanings[channel].unit.as_ref().map(|u| u.dimension) {
            Some(Dimension::Torque) => Word::Torque,
            Some(Dimension::Force) => Word::Force,
            Some(Dimension::Current) => Word::Current,
            Some(Dimension::Voltage) => Word::Voltage,
            _ => Word::Input,
        }
    }

    /// What the user or the description says drives a joint.
    fn wanted(&self, joint: usize) -> Option<InputQuantity> {
        let said = self.settings.input.or(self.joints[joint].input)?;
        Some(match said {
            InputQuantity::Torque | InputQuantity::Force => force(self.joints[joint].prismatic),
            other => other,
        })
    }

    fn quantity(
        &self,
        joint: usize,
        word: Word,
        source: &Source,
    ) -> Result<InputQuantity, LogError> {
        let slides = self.joints[joint].prismatic;
        let wanted = self.wanted(joint);
        let spoken = quantity_of(word, slides);
        match (wanted, spoken, source) {
            (Some(w), Some(s), Source::Channel(i, _)) if w != s => Err(LogError::Unit {
                file: self.log.file.clone(),
                channel: self.log.channels[*i].name.clone(),
                unit: s.unit().to_owned(),
                quantity: format!(
                    "the input of joint `{}`, a {} as the description or --input says",
                    self.joints[joint].name,
                    w.word()
                ),
                mend: "correct --input or the description, or map another channel".to_owned(),
            }),
            (_, Some(s), _) => Ok(s),
            (Some(w), None, _) => Ok(w),
            (None, None, Source::Constant(_)) => Ok(force(slides)),
            (None, None, Source::Channel(i, _)) => Err(LogError::InputUnknown {
                file: self.log.file.clone(),
                channel: self.log.channels[*i].name.clone(),
                joint: self.joints[joint].name.clone(),
            }),
        }
    }

    fn zeros(&self, none: bool) -> Inputs {
        let quantity = |j: usize| {
            self.wanted(j)
                .unwrap_or_else(|| force(self.joints[j].prismatic))
        };
        Inputs {
            sources: vec![Source::Constant(0.0); self.joints.len()],
            quantities: (0..self.joints.len()).map(quantity).collect(),
            measured: false,
            none,
        }
    }

    fn missing_input(&self, joints: &[usize]) -> LogError {
        match self.missing(Kind::Input, joints) {
            LogError::Missing {
                file,
                quantity,
                of,
                found,
                mend,
            } => {
                let joint = joints
                    .first()
                    .map_or("JOINT", |&j| self.joints[j].name.as_str());
                let target = self
                    .target_without_quantity()
                    .map_or_else(String::new, |name| {
                        format!("; --map 'qref:{joint}={name}' if it is a commanded position")
                    });
                let mend = format!(
                    "{mend}{target}; --map 'u:{joint}=0' for a joint without drive, --passive if none was driven"
                );
                LogError::Missing {
                    file,
                    quantity,
                    of,
                    found,
                    mend,
                }
            }
            other => other,
        }
    }

    /// A channel that was asked for by its name, which does not say of what.
    fn target_without_quantity(&self) -> Option<&str> {
        let mut all = self.meanings.iter().zip(&self.log.channels);
        let asked = |m: &Meaning| m.what.is_none() && m.parsed.words.iter().any(|w| commands(w));
        all.find(|(m, _)| asked(m)).map(|(_, c)| c.name.as_str())
    }

    fn say_input(&mut self, inputs: &Inputs, free: &[usize]) {
        let mut parts = Vec::new();
        for &j in free {
            if let Source::Channel(i, unit) = &inputs.sources[j] {
                let (name, joint) = (&self.log.channels[*i].name, &self.joints[j].name);
                parts.push(format!(
                    "`{name}` ({joint}) is a {} in {}",
                    inputs.quantities[j].word(),
                    unit.text
                ));
            }
        }
        let by_name = free.iter().any(|&j| match &inputs.sources[j] {
            Source::Channel(i, _) => self.meanings[*i]
                .what
                .is_some_and(|w| w.word != Word::Input),
            Source::Constant(_) => false,
        });
        let by_unit = free.iter().any(|&j| match &inputs.sources[j] {
            Source::Channel(i, _) => self.meanings[*i].unit.is_some(),
            Source::Constant(_) => false,
        });
        let why = match (by_name, by_unit, self.settings.input.is_some()) {
            (true, true, _) => "as name and unit say",
            (true, false, _) => "as the name says, in SI since no unit is stated",
            (false, true, _) => "as the unit says",
            (false, false, true) => "as --input says",
            (false, false, false) => "as the robot's description says",
        };
        self.said.say(
            &self.log.file,
            format!("input: {}, {why}", parts.join(", ")),
        );
    }
}

/// Torque or force.
fn force(slides: bool) -> InputQuantity {
    if slides {
        InputQuantity::Force
    } else {
        InputQuantity::Torque
    }
}

fn quantity_of(word: Word, slides: bool) -> Option<InputQuantity> {
    match word {
        Word::Torque | Word::Force => Some(force(slides)),
        Word::Current => Some(InputQuantity::Current),
        Word::Voltage => Some(InputQuantity::Voltage),
        _ => None,
    }
}

fn word_of(quantity: InputQuantity) -> Word {
    match quantity {
        InputQuantity::Current => Word::Current,
        InputQuantity::Voltage => Word::Voltage,
        _ => Word::Torque,
    }
}
