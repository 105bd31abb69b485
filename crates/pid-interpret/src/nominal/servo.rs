//! The position loop of a drive: `[drive]` for all joints, `[joint.drive]` for one. With it the input
//! of the joint is a target position, and the drive makes its own input of the motor,
//!
//! ```text
//! p     u = kp (r − q)
//! pd    u = kp (r − q) − kd v
//! pid   u = kp (r − q) − kd v + ki ∫ (r − q) dt
//! ```
//!
//! in the unit of the joint's `input`, within ± `limit` (K. J. Åström, T. Hägglund, PID Controllers, 1995,
//! chapter 3).

use std::fmt;

use pid_toml::{Place, Spanned};
use serde::Deserialize;
use serde::de::{self, MapAccess, Visitor, value::MapAccessDeserializer};

use super::error::NominalError;
use super::source::Source;

/// Law of a position loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ServoLaw {
    /// Proportional.
    P,
    /// Proportional, with damping by the velocity.
    Pd,
    /// The same with an integral of the error.
    Pid,
}

impl ServoLaw {
    /// Its word in a description.
    pub fn word(self) -> &'static str {
        match self {
            ServoLaw::P => "p",
            ServoLaw::Pd => "pd",
            ServoLaw::Pid => "pid",
        }
    }

    /// The gains it has.
    pub fn gains(self) -> &'static [Gain] {
        match self {
            ServoLaw::P => &[Gain::Kp],
            ServoLaw::Pd => &[Gain::Kp, Gain::Kd],
            ServoLaw::Pid => &[Gain::Kp, Gain::Kd, Gain::Ki],
        }
    }
}

/// A gain of a position loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Gain {
    /// Of the error of the position.
    Kp,
    /// Of the velocity.
    Kd,
    /// Of the integral of the error.
    Ki,
}

impl Gain {
    /// All of them.
    pub const ALL: [Gain; 3] = [Gain::Kp, Gain::Kd, Gain::Ki];

    /// Its key in a description.
    pub fn key(self) -> &'static str {
        match self {
            Gain::Kp => "kp",
            Gain::Kd => "kd",
            Gain::Ki => "ki",
        }
    }
}

/// A gain as it is stated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServoGain {
    /// Value, in the unit of the input per rad, rad/s or rad·s (m likewise); `None` if it is unknown.
    pub value: Option<f64>,
    /// The real value lies within the value ± this; 0 if it is exact.
    pub half_width: f64,
}

/// The position loop of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Servo {
    /// Its law.
    pub law: ServoLaw,
    /// kp, kd, ki; zero where the law has none.
    pub gains: [ServoGain; 3],
    /// Largest size of its output, in the unit of the joint's input.
    pub limit: Option<f64>,
    /// Largest size of the part of the integral.
    pub integral_limit: Option<f64>,
    /// Rate at which it reads and answers, Hz; its output is held between. `None`: faster than the motion.
    pub rate_hz: Option<f64>,
    /// Where it stands; `None` if it was not read from a file.
    pub place: Option<Place>,
}

impl Servo {
    /// A gain as stated.
    pub fn gain(&self, gain: Gain) -> ServoGain {
        self.gains[gain as usize]
    }
}

/// A table `drive` as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawDrive {
    law: Spanned<String>,
    kp: Option<Spanned<RawGain>>,
    kd: Option<Spanned<RawGain>>,
    ki: Option<Spanned<RawGain>>,
    limit: Option<Spanned<f64>>,
    integral_limit: Option<Spanned<f64>>,
    rate_hz: Option<Spanned<f64>>,
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

#[derive(Debug, Clone)]
struct RawGain(GainTable);

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

/// What the checks of a loop need of its joint.
pub(super) struct Driven<'a> {
    /// As messages name it: `joint a, drive`.
    pub(super) item: &'a str,
    /// Torque or force per unit of the input.
    pub(super) motor_gain: f64,
}

/// The loop of a joint, from its own table or that for all joints; `None` where it has none.
pub(super) fn servo(
    source: &Source<'_>,
    raw: &RawDrive,
    joint: &Driven<'_>,
) -> Result<Option<Servo>, NominalError> {
    let item = joint.item;
    let words = [
        ("p", Some(ServoLaw::P)),
        ("pd", Some(ServoLaw::Pd)),
        ("pid", Some(ServoLaw::Pid)),
        ("none", None),
    ];
    let Some(law) = source.word(&raw.law, item, "law", &words)? else {
        return Ok(None);
    };
    let mut gains = [ServoGain::default(); 3];
    for (gain, own) in Gain::ALL.into_iter().zip([&raw.kp, &raw.kd, &raw.ki]) {
        let key = gain.key();
        match (own, law.gains().contains(&gain)) {
            (Some(own), true) => {
                gains[gain as usize] = read_gain(source, own, gain, joint)?;
            }
            (None, true) => {
                let mend = format!(
                    "the law \"{}\" has this gain: state it, as in {key} = {{ value = 1.0, tolerance_rel = 0.3 }}, or {key} = {{ unknown = true }}",
                    law.word()
                );
                return Err(source.error(&raw.law, item, key, "absent", mend));
            }
            (Some(own), false) => {
                let mend = format!("the law \"{}\" has no such gain: leave it out", law.word());
                return Err(source.error(own, item, key, "stated", mend));
            }
            (None, false) => {}
        }
    }
    let positive = |value: &Option<Spanned<f64>>, key| {
        let mend = "give a positive number, or leave the key out";
        source.optional(value.as_ref(), item, key, |x| x > 0.0, mend)
    };
    if let (Some(limit), false) = (&raw.integral_limit, law == ServoLaw::Pid) {
        let mend = "only the law \"pid\" has an integral: leave it out";
        return Err(source.error(limit, item, "integral_limit", "stated", mend));
    }
    Ok(Some(Servo {
        law,
        gains,
        limit: positive(&raw.limit, "limit")?,
        integral_limit: positive(&raw.integral_limit, "integral_limit")?,
        rate_hz: positive(&raw.rate_hz, "rate_hz")?,
        place: Some(source.place(&raw.law)),
    }))
}

fn read_gain(
    source: &Source<'_>,
    own: &Spanned<RawGain>,
    gain: Gain,
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
    // A loop with the other sign pushes away from its target.
    let least = matches!(gain, Gain::Kp).then_some(0.0);
    let signed = value * joint.motor_gain.signum();
    if signed < 0.0 || least == Some(signed) {
        let sign = if joint.motor_gain < 0.0 {
            "negative, as `motor_gain` is"
        } else {
            "positive, as `motor_gain` is"
        };
        let mend = format!("a loop holds its joint only with a gain that is {sign}");
        return refuse(value.to_string(), &mend);
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
    let fits = half_width >= 0.0 && (half_width < most || (least.is_none() && half_width == most));
    if !fits {
        let mend = "the range may not reach across zero: a smaller tolerance, or `unknown = true`";
        return refuse(format!("{value} ± {half_width}"), mend);
    }
    Ok(ServoGain {
        value: Some(value),
        half_width,
    })
}

/// A gain as the text of a file.
pub(super) fn written(gain: ServoGain) -> String {
    match gain.value {
        None => "{ unknown = true }".to_owned(),
        Some(value) => format!("{{ value = {value:?}, tolerance = {:?} }}", gain.half_width),
    }
}
