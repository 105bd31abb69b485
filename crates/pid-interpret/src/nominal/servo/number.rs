//! Numbers of a position loop that may be uncertain.

use std::fmt;

use pid_toml::Spanned;
use serde::Deserialize;
use serde::de::{self, MapAccess, Visitor, value::MapAccessDeserializer};

use super::{Driven, ServoLaw};
use crate::nominal::error::NominalError;
use crate::nominal::source::Source;

/// A gain of a position loop, or another number of it that may be uncertain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Gain {
    /// Of the error of the position; in a cascade the velocity per error.
    Kp,
    /// Of the velocity.
    Kd,
    /// Of the integral of the error; in a cascade of that of the velocity.
    Ki,
    /// Of the error of the velocity, in a cascade.
    Kv,
    /// Voltage that the motor induces per velocity.
    BackEmf,
    /// Share of the gravity of its model that the drive makes up for.
    Gravity,
    /// Share of the input that moves its model of the robot as the targets are accelerated.
    InertiaAhead,
    /// Share of the target's velocity that the loop adds to the velocity it wants.
    VelocityAhead,
    /// Largest speed at which what is followed goes to the target, rad/s or m/s.
    TargetSpeed,
    /// Acceleration with which what is followed goes to the target and brakes before it, rad/s² or m/s².
    TargetAcceleration,
    /// Time over which what is followed is averaged, s.
    TargetAverage,
    /// Time constant of a filter of the target, s.
    TargetTime,
    /// Time constant of a filter of the velocity that the loop uses, s.
    VelocityTime,
    /// By how much the loop reads its encoder late, s.
    FeedbackDelay,
}

impl Gain {
    /// All of them.
    pub const ALL: [Gain; 14] = [
        Gain::Kp,
        Gain::Kd,
        Gain::Ki,
        Gain::Kv,
        Gain::BackEmf,
        Gain::Gravity,
        Gain::InertiaAhead,
        Gain::VelocityAhead,
        Gain::TargetSpeed,
        Gain::TargetAcceleration,
        Gain::TargetAverage,
        Gain::TargetTime,
        Gain::VelocityTime,
        Gain::FeedbackDelay,
    ];
    /// Those that may stand beside a law.
    pub const BESIDE: &[Gain] = Self::ALL.split_at(Gain::BackEmf as usize).1;

    /// Its key in a description.
    pub fn key(self) -> &'static str {
        match self {
            Gain::Kp => "kp",
            Gain::Kd => "kd",
            Gain::Ki => "ki",
            Gain::Kv => "kv",
            Gain::BackEmf => "back_emf",
            Gain::Gravity => "gravity",
            Gain::InertiaAhead => "inertia_feed_forward",
            Gain::VelocityAhead => "velocity_feed_forward",
            Gain::TargetSpeed => "target_speed",
            Gain::TargetAcceleration => "target_acceleration",
            Gain::TargetAverage => "target_average_s",
            Gain::TargetTime => "target_filter_s",
            Gain::VelocityTime => "velocity_filter_s",
            Gain::FeedbackDelay => "feedback_delay_s",
        }
    }

    /// Whether it is a time.
    pub fn is_time(self) -> bool {
        matches!(
            self,
            Gain::TargetAverage | Gain::TargetTime | Gain::VelocityTime | Gain::FeedbackDelay
        )
    }

    /// Whether it is of a stage that the target passes before the loop follows it.
    pub fn shapes_target(self) -> bool {
        matches!(
            self,
            Gain::TargetSpeed | Gain::TargetAcceleration | Gain::TargetAverage | Gain::TargetTime
        )
    }

    /// Whether it is a share of what a drive's model of the robot says.
    pub fn needs_model(self) -> bool {
        matches!(self, Gain::Gravity | Gain::InertiaAhead)
    }

    /// Whether the gain of a law has the sign of the motor gain.
    pub fn follows_motor(self, law: ServoLaw) -> bool {
        match self {
            Gain::Kp => law != ServoLaw::Cascade,
            Gain::Kd | Gain::Ki | Gain::Kv | Gain::BackEmf => true,
            _ => false,
        }
    }

    /// Whether it needs a law that uses the velocity.
    pub fn needs_velocity(self) -> bool {
        matches!(self, Gain::VelocityAhead | Gain::VelocityTime)
    }

    /// Whether a loop works with the number at zero.
    fn may_vanish(self) -> bool {
        matches!(
            self,
            Gain::Kd | Gain::Ki | Gain::Gravity | Gain::InertiaAhead | Gain::VelocityAhead
        )
    }
}

/// A gain as it is stated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServoGain {
    /// Value, in the unit of [`Servo::unit`](super::Servo::unit); `None` if it is unknown.
    pub value: Option<f64>,
    /// The real value lies within the value ± this; 0 if it is exact.
    pub half_width: f64,
}

/// Half width of a gain that was found at most, as a share of it: its range may not reach across zero.
const WIDEST: f64 = 0.9;

impl ServoGain {
    /// A gain that was found, with the half width of where it was looked for; far from where it started
    /// that is less.
    pub fn found(value: f64, half_width: f64) -> Self {
        Self {
            value: Some(value),
            half_width: half_width.min(WIDEST * value.abs()),
        }
    }
}

/// A number, or a table with value and tolerance, or `{ unknown = true }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct GainTable {
    value: Option<f64>,
    tolerance: Option<f64>,
    tolerance_rel: Option<f64>,
    #[serde(default)]
    unknown: bool,
}

/// A gain as it is written.
#[derive(Debug, Clone)]
pub(super) struct RawGain(GainTable);

impl<'de> Deserialize<'de> for RawGain {
    fn deserialize<D: de::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = RawGain;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, or a table as in { value = 40.0, tolerance_rel = 0.3 }")
            }
            fn visit_f64<E: de::Error>(self, x: f64) -> Result<RawGain, E> {
                Ok(RawGain(GainTable {
                    value: Some(x),
                    ..GainTable::default()
                }))
            }
            fn visit_i64<E: de::Error>(self, x: i64) -> Result<RawGain, E> {
                self.visit_f64(x as f64)
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RawGain, A::Error> {
                GainTable::deserialize(MapAccessDeserializer::new(map)).map(RawGain)
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// A gain of a law, with its sign and range checked.
pub(super) fn read_gain(
    source: &Source<'_>,
    own: &Spanned<RawGain>,
    (law, gain): (ServoLaw, Gain),
    joint: &Driven<'_>,
) -> Result<ServoGain, NominalError> {
    let (raw, key) = (&own.get_ref().0, gain.key());
    let refuse = |found: String, mend: &str| Err(source.error(own, joint.item, key, found, mend));
    let value = match (raw.value, raw.unknown) {
        (None, true) if raw.tolerance.is_none() && raw.tolerance_rel.is_none() => {
            return Ok(ServoGain::default());
        }
        (Some(value), false) => value,
        _ => {
            let mend = "state a value, with `tolerance` or `tolerance_rel` where it is not exact, or `unknown = true` alone";
            return refuse("neither a value nor unknown".to_owned(), mend);
        }
    };
    if !value.is_finite() {
        return refuse(value.to_string(), "give a finite number");
    }
    let sign = match gain.follows_motor(law) {
        true => joint.motor_gain.signum(),
        false => 1.0,
    };
    if value * sign < 0.0 || (value == 0.0 && !gain.may_vanish()) {
        return refuse(value.to_string(), &signed(law, gain, sign));
    }
    let half_width = match (raw.tolerance, raw.tolerance_rel) {
        (Some(_), Some(_)) => {
            let mend = "give `tolerance` (its own unit) or `tolerance_rel` (a share of the value)";
            return refuse("given two tolerances".to_owned(), mend);
        }
        (Some(x), None) => x,
        (None, Some(share)) => share * value.abs(),
        (None, None) => 0.0,
    };
    let most = value.abs();
    let fits =
        half_width >= 0.0 && (half_width < most || (gain.may_vanish() && half_width == most));
    if !fits {
        let mend = "the range may not reach across zero: a smaller tolerance, or `unknown = true`";
        return refuse(format!("{value} ± {half_width}"), mend);
    }
    Ok(ServoGain {
        value: Some(value),
        half_width,
    })
}

/// What sign a gain needs, and why.
fn signed(law: ServoLaw, gain: Gain, sign: f64) -> String {
    // A loop with the other sign pushes away from its target.
    match (gain, gain.follows_motor(law)) {
        (Gain::BackEmf, _) => {
            let sign = if sign < 0.0 { "negative" } else { "positive" };
            format!(
                "the voltage that a motor induces brakes it: {sign}, as `motor_gain` is, or leave the key out"
            )
        }
        (_, true) if sign < 0.0 => {
            "a loop holds its joint only with a gain that is negative, as `motor_gain` is"
                .to_owned()
        }
        (_, true) => "a loop holds its joint only with a gain that is positive, as `motor_gain` is"
            .to_owned(),
        (Gain::Gravity, _) => {
            "give the share of gravity that the drive makes up for, as in 1.0, or leave the key out"
                .to_owned()
        }
        (Gain::InertiaAhead, _) => {
            "give the share of inertia that the drive makes up for, as in 1.0, or leave the key out"
                .to_owned()
        }
        (Gain::VelocityAhead, _) => {
            "give the share of the target's velocity that the loop adds, as in 1.0, or leave the key out"
                .to_owned()
        }
        (Gain::TargetSpeed, _) => "give a speed above zero, or leave the key out".to_owned(),
        (Gain::TargetAcceleration, _) => {
            "give an acceleration above zero, or leave the key out".to_owned()
        }
        (gain, _) if gain.is_time() => {
            "give a time above zero, in seconds, or leave the key out".to_owned()
        }
        _ => "the velocity that a cascade asks for per error is positive, in 1/s".to_owned(),
    }
}

/// A gain as the text of a file.
pub(in crate::nominal) fn written(gain: ServoGain) -> String {
    match gain.value {
        None => "{ unknown = true }".to_owned(),
        Some(value) => format!("{{ value = {value:?}, tolerance = {:?} }}", gain.half_width),
    }
}
