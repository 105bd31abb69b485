//! The table `drive` as written, and its checks.

use pid_toml::Spanned;
use serde::Deserialize;

use super::number::{RawGain, read_gain};
use super::{FallingLimit, Gain, Servo, ServoGain, ServoLaw, Shaping};
use crate::nominal::error::NominalError;
use crate::nominal::source::Source;

/// A table `drive` as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::nominal) struct RawDrive {
    law: Spanned<String>,
    kp: Option<Spanned<RawGain>>,
    kd: Option<Spanned<RawGain>>,
    ki: Option<Spanned<RawGain>>,
    kv: Option<Spanned<RawGain>>,
    back_emf: Option<Spanned<RawGain>>,
    gravity: Option<Spanned<RawGain>>,
    inertia_feed_forward: Option<Spanned<RawGain>>,
    limit: Option<Spanned<f64>>,
    stall: Option<Spanned<f64>>,
    no_load_speed: Option<Spanned<f64>>,
    integral_limit: Option<Spanned<f64>>,
    velocity_limit: Option<Spanned<f64>>,
    velocity_filter_s: Option<Spanned<RawGain>>,
    feedback_delay_s: Option<Spanned<RawGain>>,
    dead_band: Option<Spanned<f64>>,
    target_step: Option<Spanned<f64>>,
    target_rate_hz: Option<Spanned<f64>>,
    target_speed: Option<Spanned<RawGain>>,
    target_acceleration: Option<Spanned<RawGain>>,
    target_average_s: Option<Spanned<RawGain>>,
    velocity_feed_forward: Option<Spanned<RawGain>>,
    target_filter_s: Option<Spanned<RawGain>>,
    rate_hz: Option<Spanned<f64>>,
}

impl RawDrive {
    fn gain(&self, gain: Gain) -> Option<&Spanned<RawGain>> {
        match gain {
            Gain::Kp => self.kp.as_ref(),
            Gain::Kd => self.kd.as_ref(),
            Gain::Ki => self.ki.as_ref(),
            Gain::Kv => self.kv.as_ref(),
            Gain::BackEmf => self.back_emf.as_ref(),
            Gain::Gravity => self.gravity.as_ref(),
            Gain::InertiaAhead => self.inertia_feed_forward.as_ref(),
            Gain::VelocityAhead => self.velocity_feed_forward.as_ref(),
            Gain::TargetSpeed => self.target_speed.as_ref(),
            Gain::TargetAcceleration => self.target_acceleration.as_ref(),
            Gain::TargetAverage => self.target_average_s.as_ref(),
            Gain::TargetTime => self.target_filter_s.as_ref(),
            Gain::VelocityTime => self.velocity_filter_s.as_ref(),
            Gain::FeedbackDelay => self.feedback_delay_s.as_ref(),
        }
    }
}

/// What the checks of a loop need of its joint.
pub(in crate::nominal) struct Driven<'a> {
    /// As messages name it: `joint a, drive`.
    pub(in crate::nominal) item: &'a str,
    /// Torque or force per unit of the input.
    pub(in crate::nominal) motor_gain: f64,
    /// The word of what the input is.
    pub(in crate::nominal) input: &'a str,
}

/// The loop of a joint, from its own table or that for all joints; `None` where it has none.
pub(in crate::nominal) fn servo(
    source: &Source<'_>,
    raw: &RawDrive,
    joint: &Driven<'_>,
) -> Result<Option<Servo>, NominalError> {
    let item = joint.item;
    let laws = ServoLaw::ALL.map(|law| (law.word(), Some(law)));
    let words: Vec<_> = laws.into_iter().chain([("none", None)]).collect();
    let Some(law) = source.word(&raw.law, item, "law", &words)? else {
        return Ok(None);
    };
    let mut servo = Servo::new(law);
    for gain in Gain::ALL {
        if let Some(value) = number(source, raw, (law, gain), joint)? {
            servo.set(gain, value);
        }
    }
    let positive = |value: &Option<Spanned<f64>>, key| {
        let mend = "give a positive number, or leave the key out";
        source.optional(value.as_ref(), item, key, |x| x > 0.0, mend)
    };
    if let (Some(limit), false) = (&raw.integral_limit, law.integrates()) {
        let mend = "only the laws \"pid\" and \"cascade\" have an integral: leave it out";
        return Err(source.error(limit, item, "integral_limit", "stated", mend));
    }
    if let (Some(limit), false) = (&raw.velocity_limit, law == ServoLaw::Cascade) {
        let mend = "only the law \"cascade\" has a loop of the velocity: leave it out";
        return Err(source.error(limit, item, "velocity_limit", "stated", mend));
    }
    for gain in Gain::ALL.into_iter().filter(|gain| gain.needs_velocity()) {
        if let (Some(stated), true) = (raw.gain(gain), !law.uses_velocity()) {
            let mend = "the law \"p\" does not use the velocity: leave it out";
            return Err(source.error(stated, item, gain.key(), "stated", mend));
        }
    }
    if let (Some(stated), true) = (&raw.back_emf, joint.input != "voltage") {
        let mend = "a motor induces a voltage, which a drive of a torque or a current makes up for: say input = \"voltage\", or leave it out";
        let found = format!("stated beside input = \"{}\"", joint.input);
        return Err(source.error(stated, item, "back_emf", found, mend));
    }
    servo.limit = positive(&raw.limit, "limit")?;
    let stall = positive(&raw.stall, "stall")?;
    let no_load_speed = positive(&raw.no_load_speed, "no_load_speed")?;
    servo.falling = match (
        no_load_speed,
        stall.or(servo.limit),
        &raw.no_load_speed,
        &raw.stall,
    ) {
        (Some(no_load_speed), Some(stall), ..) => Some(FallingLimit {
            stall,
            no_load_speed,
        }),
        (Some(_), None, Some(at), _) => {
            let mend = "say what there is at rest: `stall`, or `limit`";
            return Err(source.error(at, item, "no_load_speed", "stated alone", mend));
        }
        (None, _, _, Some(at)) => {
            let mend =
                "say at which speed nothing is left, `no_load_speed`, or give a `limit` alone";
            return Err(source.error(at, item, "stall", "stated alone", mend));
        }
        _ => None,
    };
    servo.integral_limit = positive(&raw.integral_limit, "integral_limit")?;
    servo.velocity_limit = positive(&raw.velocity_limit, "velocity_limit")?;
    servo.dead_band = positive(&raw.dead_band, "dead_band")?;
    servo.shaping = Shaping {
        step: positive(&raw.target_step, "target_step")?,
        rate_hz: positive(&raw.target_rate_hz, "target_rate_hz")?,
    };
    servo.rate_hz = positive(&raw.rate_hz, "rate_hz")?;
    servo.place = Some(source.place(&raw.law));
    Ok(Some(servo))
}

/// A gain of a law as it is stated; `None` where it neither has nor states it.
fn number(
    source: &Source<'_>,
    raw: &RawDrive,
    (law, gain): (ServoLaw, Gain),
    joint: &Driven<'_>,
) -> Result<Option<ServoGain>, NominalError> {
    let (key, item) = (gain.key(), joint.item);
    let own = law.gains().contains(&gain);
    match raw.gain(gain) {
        Some(stated) if own || Gain::BESIDE.contains(&gain) => {
            read_gain(source, stated, (law, gain), joint).map(Some)
        }
        Some(stated) => {
            let mend = format!("the law \"{}\" has no such gain: leave it out", law.word());
            Err(source.error(stated, item, key, "stated", mend))
        }
        None if own => {
            let mend = format!(
                "the law \"{}\" has this gain: state it, as in {key} = {{ value = 1.0, tolerance_rel = 0.3 }}, or {key} = {{ unknown = true }}",
                law.word()
            );
            Err(source.error(&raw.law, item, key, "absent", mend))
        }
        None => Ok(None),
    }
}
