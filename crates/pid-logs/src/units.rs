//! Units by their usual spellings, and the way from them to SI.

use std::f64::consts::PI;

/// What a unit measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dimension {
    Time,
    Angle,
    Length,
    AngularVelocity,
    Velocity,
    Torque,
    Force,
    Current,
    Voltage,
    /// A bare factor, `*0.001`.
    Raw,
}

impl Dimension {
    /// The SI unit.
    pub(crate) fn si(self) -> &'static str {
        match self {
            Dimension::Time => "s",
            Dimension::Angle => "rad",
            Dimension::Length => "m",
            Dimension::AngularVelocity => "rad/s",
            Dimension::Velocity => "m/s",
            Dimension::Torque => "N*m",
            Dimension::Force => "N",
            Dimension::Current => "A",
            Dimension::Voltage => "V",
            Dimension::Raw => "raw",
        }
    }
}

/// A unit: dimension and the value of one unit in SI.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Unit {
    pub(crate) text: String,
    pub(crate) dimension: Dimension,
    /// SI = value · numerator / denominator. A quotient keeps milli, micro and nano exact to the
    /// last digit, where a factor of 0.001 does not.
    pub(crate) numerator: f64,
    pub(crate) denominator: f64,
}

impl Unit {
    /// The SI unit of a dimension.
    pub(crate) fn si(dimension: Dimension) -> Self {
        Self {
            text: dimension.si().to_owned(),
            dimension,
            numerator: 1.0,
            denominator: 1.0,
        }
    }

    /// A value in SI.
    pub(crate) fn to_si(&self, value: f64) -> f64 {
        value * self.numerator / self.denominator
    }

    /// A unit from its text: a spelling of the table, a factor `*0.001`, or both, `deg*-1`.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        if let Some((unit, factor)) = text.rsplit_once('*')
            && let Ok(factor) = factor.trim().parse::<f64>()
        {
            if !factor.is_finite() || factor == 0.0 {
                return None;
            }
            let mut unit = match unit.trim() {
                "" | "raw" => Self::si(Dimension::Raw),
                unit => Self::parse(unit)?,
            };
            unit.numerator *= factor;
            unit.text = text.to_owned();
            return Some(unit);
        }
        let spelled = spelled(text);
        let (_, dimension, numerator, denominator) = UNITS
            .iter()
            .find(|(names, ..)| names.contains(&spelled.as_str()))?;
        Some(Self {
            text: text.to_owned(),
            dimension: *dimension,
            numerator: *numerator,
            denominator: *denominator,
        })
    }
}

/// A spelling without case, blanks and signs of products, `per` and `_` as `/`.
fn spelled(text: &str) -> String {
    let lower = text
        .to_lowercase()
        .replace(" per ", "/")
        .replace("_per_", "/");
    lower
        .chars()
        .filter_map(|c| match c {
            ' ' | '*' | '.' | '·' | '⋅' | '-' => None,
            '_' => Some('/'),
            'μ' => Some('µ'),
            '−' => None,
            c => Some(c),
        })
        .collect()
}

type Row = (&'static [&'static str], Dimension, f64, f64);

/// Spellings, dimension, numerator and denominator.
const UNITS: &[Row] = &[
    (
        &["s", "sec", "secs", "second", "seconds"],
        Dimension::Time,
        1.0,
        1.0,
    ),
    (
        &["ms", "msec", "millis", "millisecond", "milliseconds"],
        Dimension::Time,
        1.0,
        1e3,
    ),
    (
        &["us", "µs", "usec", "micros", "microseconds"],
        Dimension::Time,
        1.0,
        1e6,
    ),
    (
        &["ns", "nsec", "nanos", "nanosec", "nanoseconds"],
        Dimension::Time,
        1.0,
        1e9,
    ),
    (&["min", "minutes"], Dimension::Time, 60.0, 1.0),
    (&["rad", "radian", "radians"], Dimension::Angle, 1.0, 1.0),
    (&["mrad"], Dimension::Angle, 1.0, 1e3),
    (
        &["deg", "degs", "degree", "degrees", "°"],
        Dimension::Angle,
        PI,
        180.0,
    ),
    (
        &["rev", "revs", "turn", "turns", "revolutions"],
        Dimension::Angle,
        2.0 * PI,
        1.0,
    ),
    (
        &["m", "meter", "meters", "metre", "metres"],
        Dimension::Length,
        1.0,
        1.0,
    ),
    (&["cm"], Dimension::Length, 1.0, 1e2),
    (&["mm", "millimeters"], Dimension::Length, 1.0, 1e3),
    (&["um", "µm"], Dimension::Length, 1.0, 1e6),
    (
        &["rad/s", "rad/sec", "radps"],
        Dimension::AngularVelocity,
        1.0,
        1.0,
    ),
    (&["mrad/s"], Dimension::AngularVelocity, 1.0, 1e3),
    (
        &["deg/s", "deg/sec", "degps", "dps", "°/s"],
        Dimension::AngularVelocity,
        PI,
        180.0,
    ),
    (
        &["rpm", "1/min", "rev/min", "u/min"],
        Dimension::AngularVelocity,
        PI,
        30.0,
    ),
    (&["rev/s", "hz"], Dimension::AngularVelocity, 2.0 * PI, 1.0),
    (&["m/s", "m/sec", "mps"], Dimension::Velocity, 1.0, 1.0),
    (&["cm/s"], Dimension::Velocity, 1.0, 1e2),
    (&["mm/s", "mm/sec"], Dimension::Velocity, 1.0, 1e3),
    (
        &["nm", "newtonmeter", "newtonmeters"],
        Dimension::Torque,
        1.0,
        1.0,
    ),
    (&["mnm", "nmm"], Dimension::Torque, 1.0, 1e3),
    (&["ncm"], Dimension::Torque, 1.0, 1e2),
    (&["knm"], Dimension::Torque, 1e3, 1.0),
    (&["n", "newton", "newtons"], Dimension::Force, 1.0, 1.0),
    (&["mn"], Dimension::Force, 1.0, 1e3),
    (&["kn"], Dimension::Force, 1e3, 1.0),
    (
        &["a", "amp", "amps", "ampere", "amperes"],
        Dimension::Current,
        1.0,
        1.0,
    ),
    (&["ma", "milliamps"], Dimension::Current, 1.0, 1e3),
    (&["v", "volt", "volts"], Dimension::Voltage, 1.0, 1.0),
    (&["mv", "millivolts"], Dimension::Voltage, 1.0, 1e3),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spellings_of_one_unit_mean_the_same() {
        for (texts, dimension, one) in [
            (
                &["N*m", "Nm", "N·m", "N.m", "newton-meters"][..],
                Dimension::Torque,
                1.0,
            ),
            (&["mNm", "N*mm", "N·mm"], Dimension::Torque, 0.001),
            (
                &["deg/s", "°/s", "deg_s", "dps", "deg per s"],
                Dimension::AngularVelocity,
                PI / 180.0,
            ),
            (&["rpm", "1/min"], Dimension::AngularVelocity, PI / 30.0),
            (&["us", "µs", "μs"], Dimension::Time, 1e-6),
            (&["mA"], Dimension::Current, 0.001),
        ] {
            for text in texts {
                let unit = Unit::parse(text).unwrap_or_else(|| panic!("{text}"));
                assert_eq!(
                    (unit.dimension, unit.to_si(1.0)),
                    (dimension, one),
                    "{text}"
                );
            }
        }
        assert_eq!(Unit::parse("furlong"), None);
    }

    #[test]
    fn factors_stand_alone_or_after_a_unit() {
        let raw = Unit::parse("*0.001").unwrap();
        assert_eq!((raw.dimension, raw.to_si(2000.0)), (Dimension::Raw, 2.0));
        let turned = Unit::parse("deg*-1").unwrap();
        assert_eq!(turned.to_si(180.0), -PI);
        assert_eq!(Unit::parse("N*m*2").unwrap().to_si(1.5), 3.0);
        assert_eq!(Unit::parse("deg*0"), None);
    }

    #[test]
    fn milliseconds_are_exact() {
        let ms = Unit::parse("ms").unwrap();
        assert_eq!(ms.to_si(1003.0), 1.003);
    }
}
