//! A diagnosis in plain words: what the command prints and what the page begins with.

use pid_page::number;

use crate::diagnosis::{Diagnosis, Magnitude, Named, Outcome, Share, Verdict};
use crate::effects::by_id;

/// The budget of the gap, a line for each cause and one for what is left: share, cause, joint and
/// magnitudes. Empty where nothing is named and nothing is left.
pub fn budget(d: &Diagnosis) -> Vec<String> {
    let whole = whole(d);
    let mut lines: Vec<String> = d
        .effects
        .iter()
        .map(|e| line(e, e.share.or(whole)))
        .collect();
    lines.extend(own_law(d));
    lines.extend(left(d));
    lines
}

/// The law of its own: its share and its terms.
fn own_law(d: &Diagnosis) -> Option<String> {
    let law = d.remainder.as_ref()?.law.as_ref()?;
    let terms: Vec<String> = law.terms.iter().map(described).collect();
    let share = portion(law.share, law.share_interval);
    Some(format!("{share}: no name, but a law: {}", terms.join("; ")))
}

/// A cause with its joint and its magnitudes: `the drive acts later at joint 2 (input_delay): delay 14 ± 1 ms`.
fn described(e: &Named) -> String {
    let title = by_id(&e.effect).map(|effect| effect.info().title);
    let title = title.unwrap_or(match e.effect.as_str() {
        Verdict::SERVO_GAIN => "The drive has other gains than stated",
        _ => "Friction is outside its stated tolerance",
    });
    let (first, rest) = title.split_at(1);
    let first = first.to_lowercase();
    let joint = e.joint.map_or(String::new(), |j| format!(" at joint {j}"));
    let sizes: Vec<String> = e.parameters.iter().map(size).collect();
    format!("{first}{rest}{joint} ({}): {}", e.effect, sizes.join(", "))
}

/// The verdict in a few words: how much of the gap has a name.
pub fn headline(d: &Diagnosis) -> String {
    match d.outcome() {
        Outcome::Nothing => "Nothing is missing beyond parameters within their tolerances.",
        Outcome::OneCause if matches!(d.verdict, Verdict::OutsideTolerance { .. }) => {
            "No effect is missing, but friction lies outside its stated tolerance."
        }
        Outcome::OneCause if matches!(d.verdict, Verdict::ServoGain { .. }) => {
            "No effect is missing, but a drive has other gains than stated."
        }
        Outcome::OneCause => "One cause explains the gap.",
        Outcome::Several => "Several causes together explain the gap.",
        Outcome::PartlyUnknown => "A part of the gap has a name, a part has none.",
        Outcome::Unknown => "Something is missing, but no effect of the library explains it.",
    }
    .to_owned()
}

/// The share of a single effect that no free run had to tell from others.
fn whole(d: &Diagnosis) -> Option<f64> {
    let square = |x: f64| x * x;
    let all = square(d.gap_before) - square(d.gap_floor);
    let explained = (square(d.gap_before) - square(d.gap_after)) / all;
    let one = d.effects.len() == 1 && all > 0.0;
    one.then_some(explained)
        .filter(|share| share.is_finite() && *share > 0.0)
        .map(|share| share.min(1.0))
}

fn percent(share: f64) -> String {
    format!("{:.0} % of the gap", 100.0 * share)
}

/// A share with its interval: `62 % of the gap (55 to 68 %)`.
fn portion(share: f64, interval: Option<(f64, f64)>) -> String {
    let interval = interval.map_or(String::new(), |(low, high)| {
        format!(" ({:.0} to {:.0} %)", 100.0 * low, 100.0 * high)
    });
    percent(share) + &interval
}

/// A cause: `62 % of the gap: the drive acts later at joint 2 (input_delay): delay 14.2 ± 0.6 ms`.
fn line(e: &Named, share: Option<f64>) -> String {
    let share = share.map_or("cause".to_owned(), |share| portion(share, e.share_interval));
    format!("{share}: {}", described(e))
}

/// What has no name.
fn left(d: &Diagnosis) -> Option<String> {
    let remainder = d.remainder.as_ref()?;
    if let (Some(law), None) = (&remainder.nameless, &remainder.law) {
        let share = percent(law.explained);
        return Some(format!("{share}, better than the library: {}", law.words()));
    }
    let law = remainder.law.as_ref().map_or(0.0, |law| law.share);
    let rest = 1.0 - remainder.explained - law;
    // Less is zero percent.
    if rest < 0.005 {
        return None;
    }
    let place = remainder.missing_force.iter();
    let place = place.max_by(|a, b| a.share.total_cmp(&b.share));
    let place = place.map_or(String::new(), |m| {
        let along = m
            .quantity()
            .map(|quantity| format!("; it goes with {quantity}"));
        format!(", most at joint {}{}", m.joint, along.unwrap_or_default())
    });
    Some(format!("{}: no name{place}", percent(rest)))
}

/// Part of a missing force from which on it is said to go with a quantity. 0.1: as a cause counts from a tenth of the
/// gap on.
const TELLS: f64 = 0.1;

impl Share {
    /// The quantity it goes with, if it goes with one.
    pub fn quantity(&self) -> Option<&str> {
        (self.explained >= TELLS).then_some(&*self.regime)
    }
}

/// A magnitude with its deviation and unit, such as `delay 14.2 ± 0.6 ms`.
pub fn size(m: &Magnitude) -> String {
    let name = name(m);
    let (factor, unit) = scaled(m.value, &m.unit);
    let unit = match unit.as_str() {
        "" | "1" => String::new(),
        unit => format!(" {unit}"),
    };
    let value = m.value * factor;
    match m.std.map(|std| std * factor) {
        Some(std) => format!("{name} {}{unit}", number::plus_minus(value, std)),
        None => format!(
            "{name} {}{unit} (not determined)",
            number::significant(value, 4)
        ),
    }
}

/// The name of a magnitude for people, without the unit that some names carry.
pub fn name(m: &Magnitude) -> String {
    let plain = m.name.strip_suffix("_s").unwrap_or(&m.name);
    plain.replace('_', " ")
}

/// Factor and unit in which a value reads well: thousandths of seconds, radians and metres below a
/// tenth.
fn scaled(value: f64, unit: &str) -> (f64, String) {
    let small = value.abs() < 0.1;
    match unit {
        "s" | "rad" | "m" if small => (1e3, format!("m{unit}")),
        _ => (1.0, number::unit(unit)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn magnitude(name: &str, value: f64, std: Option<f64>, unit: &str) -> Magnitude {
        Magnitude {
            name: name.to_owned(),
            value,
            unit: unit.to_owned(),
            std,
        }
    }

    #[test]
    fn a_magnitude_has_the_digits_of_its_deviation_and_a_unit_that_reads_well() {
        let of = |name, value, std, unit| size(&magnitude(name, value, std, unit));
        let delay = of("delay_s", 0.014_23, Some(0.000_61), "s");
        assert_eq!(delay, "delay 14.23 ± 0.61 ms");
        let stiffness = of("stiffness", 12_859.8, Some(412.0), "N*m/rad");
        assert_eq!(stiffness, "stiffness 12860 ± 412 N·m/rad");
        let excess = of("load_coefficient", 0.5, None, "1");
        assert_eq!(excess, "load coefficient 0.5 (not determined)");
        let slow = of("time_constant_s", 3.456, Some(0.12), "s");
        assert_eq!(slow, "time constant 3.46 ± 0.12 s");
    }

    #[test]
    fn a_cause_is_a_sentence_with_its_share_first() {
        let named = Named {
            effect: "input_delay".to_owned(),
            joint: Some(2),
            parameters: vec![magnitude("delay_s", 0.0142, Some(0.0006), "s")],
            regime: String::new(),
            share: Some(0.62),
            share_interval: None,
        };
        assert_eq!(
            line(&named, named.share),
            "62 % of the gap: the drive acts later at joint 2 (input_delay): delay 14.20 ± 0.60 ms"
        );
        let sure = Named {
            share_interval: Some((0.549, 0.683)),
            ..named
        };
        let words = line(&sure, sure.share);
        assert!(
            words.starts_with("62 % of the gap (55 to 68 %): the drive"),
            "{words}"
        );
    }

    #[test]
    fn a_force_goes_with_a_quantity_only_where_that_explains_some_of_it() {
        let force = |explained| Share {
            joint: 1,
            share: 1.0,
            rms: 0.1,
            regime: "load".to_owned(),
            explained,
        };
        assert_eq!(force(0.001).quantity(), None);
        assert_eq!(force(0.4).quantity(), Some("load"));
    }
}
