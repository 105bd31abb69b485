//! Readings that are errors of the recording.

use std::f64::consts::SQRT_2;

use crate::nominal::Joint;

/// A channel of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Position.
    Position,
    /// Velocity.
    Velocity,
    /// Input.
    Input,
}

/// A reading that was taken for an error of the recording ([`pid_data::signal::outliers`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Outlier {
    /// Record.
    pub record: String,
    /// Joint.
    pub joint: String,
    /// Channel.
    pub channel: Channel,
    /// Its time stamp, s.
    pub t: f64,
}

/// Share of the largest input that counts as the least deviation of an input: a commanded pulse of
/// a few percent is no error.
const LEAST_INPUT: f64 = 0.01;

/// Deviation of a channel below which no reading is noticed: a step of the encoder or the stated
/// noise of the reading; of a velocity that is derived from positions in steps of so many s (`derived`) what
/// two of these make of it.
pub(crate) fn least_deviation(
    channel: Channel,
    joint: &Joint,
    x: &[f64],
    derived: Option<f64>,
) -> f64 {
    let resolution = joint.resolution.unwrap_or(0.0);
    let position = resolution.max(joint.position_noise.unwrap_or(0.0));
    match channel {
        Channel::Position => position,
        Channel::Velocity => {
            let derived = derived.map_or(0.0, |step| SQRT_2 * position / step);
            derived.max(joint.velocity_noise.unwrap_or(0.0))
        }
        Channel::Input => {
            let largest = x.iter().filter(|x| x.is_finite());
            LEAST_INPUT * largest.fold(0.0, |m: f64, x| m.max(x.abs()))
        }
    }
}

/// One line for each channel with left-out readings: record, joint, channel, number and times.
pub(crate) fn warnings(outliers: &[Outlier]) -> Vec<String> {
    let mut lines = Vec::new();
    let mut rest = outliers;
    while let Some(first) = rest.first() {
        let same = |o: &&Outlier| {
            (&o.record, &o.joint, o.channel) == (&first.record, &first.joint, first.channel)
        };
        let count = rest.iter().take_while(same).count();
        let (own, others) = rest.split_at(count);
        rest = others;
        let word = match first.channel {
            Channel::Position => "position",
            Channel::Velocity => "velocity",
            Channel::Input => "input",
        };
        let mut times: Vec<String> = own.iter().take(5).map(|o| format!("{:.3}", o.t)).collect();
        if count > times.len() {
            times.push("…".to_owned());
        }
        let (record, joint, times) = (&first.record, &first.joint, times.join(", "));
        let leave = match count {
            1 => "reading leaves the motion around it for a sample or two and counts as missing",
            _ => "readings leave the motion around them for a sample or two and count as missing",
        };
        lines.push(format!(
            "record `{record}`, joint `{joint}`: {count} {word} {leave}, at t = {times} s"
        ));
    }
    lines
}
