//! The position loop of a drive, as the files of a simulator have it.

use std::collections::BTreeMap;

use pid_effects::constants::{Constant, Constants};
use pid_interpret::nominal::{Gain, Nominal, ServoLaw};
use serde::Serialize;

/// A loop with all its numbers.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct PositionLoop {
    #[serde(skip)]
    servo: ServoLaw,
    law: &'static str,
    /// By their keys in a description; those of effects that are stages of the loop among them.
    #[serde(flatten)]
    numbers: BTreeMap<&'static str, f64>,
}

impl PositionLoop {
    /// Of a coordinate, with the stages that effects add. `Err` has the gains that nobody knows.
    pub(crate) fn of(
        nominal: &Nominal,
        coordinate: usize,
        constants: &Constants<'_, f64>,
        stages: &[Gain],
    ) -> Option<Result<Self, Vec<&'static str>>> {
        let servo = nominal.servo(coordinate)?;
        let unknown = servo
            .gains()
            .filter(|&gain| servo.gain(gain).value.is_none());
        let unknown: Vec<&str> = unknown.map(Gain::key).collect();
        if !unknown.is_empty() {
            return Some(Err(unknown));
        }
        let gains = Gain::ALL.into_iter();
        let gains = gains.filter(|gain| servo.has(*gain) || stages.contains(gain));
        let value = |gain| constants.get(Constant::Servo(gain, coordinate));
        let numbers = gains
            .map(|gain| (gain.key(), value(gain)))
            .chain(servo.stated());
        Some(Ok(Self {
            servo: servo.law,
            law: servo.law.word(),
            numbers: numbers.collect(),
        }))
    }

    /// The word of its law.
    pub(crate) fn law(&self) -> &'static str {
        self.law
    }

    /// A number by its key.
    pub(crate) fn get(&self, key: &str) -> Option<f64> {
        self.numbers.get(key).copied()
    }

    /// Output per error of the position, and per velocity, of the loop alone.
    pub(crate) fn gains(&self) -> [f64; 2] {
        let get = |gain: Gain| self.get(gain.key()).unwrap_or(0.0);
        match self.servo {
            ServoLaw::P => [get(Gain::Kp), 0.0],
            ServoLaw::Cascade => [get(Gain::Kp) * get(Gain::Kv), get(Gain::Kv)],
            _ => [get(Gain::Kp), get(Gain::Kd)],
        }
    }

    /// Keys of what two gains and these `further` keys leave out.
    pub(crate) fn beyond(&self, further: &[&str]) -> Vec<&'static str> {
        let gains = [Gain::Kp, Gain::Kd, Gain::Kv].map(Gain::key);
        let kept = |key: &str, value: f64| {
            let nothing = key == Gain::Ki.key() && value == 0.0;
            nothing || gains.contains(&key) || further.contains(&key)
        };
        let all = self.numbers.iter().map(|(key, value)| (*key, *value));
        let own = all.filter(|&(key, value)| !kept(key, value));
        own.map(|(key, _)| key).collect()
    }

    /// Whether the drive needs a model of the robot.
    pub(crate) fn has_model(&self) -> bool {
        let shares = [Gain::Gravity, Gain::InertiaAhead];
        shares.iter().any(|gain| self.get(gain.key()).is_some())
    }
}
