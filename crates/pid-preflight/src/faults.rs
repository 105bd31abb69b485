//! The findings of order, sign, unit and gravity in words.

use crate::finding::{Channel, Finding, FindingKind, Severity, joints_text, list, number};

/// Says that columns stand in the wrong order.
pub(crate) fn swapped(channel: Channel, order: &[usize]) -> Finding {
    let moved: Vec<usize> = (0..order.len())
        .filter(|&j| order[j] != j)
        .map(|j| j + 1)
        .collect();
    let order: Vec<usize> = order.iter().map(|j| j + 1).collect();
    let way = moved
        .iter()
        .map(|&j| format!("joint {j} belongs what stands in place {}", order[j - 1]));
    let way = list(way);
    Finding::new(
        FindingKind::Swapped { channel, order },
        Severity::Wrong,
        match channel {
            Channel::All => format!(
                "the order of {} is not that of the robot: to {way}",
                joints_text(&moved)
            ),
            _ => format!(
                "the {} columns of {} are swapped: to {way}",
                channel.word(),
                joints_text(&moved)
            ),
        },
        format!(
            "put the columns {} into the order of the robot; `--fix` does it",
            channel.columns()
        ),
    )
    .of(&moved, channel)
}

/// Says that columns have the wrong sign.
pub(crate) fn flipped(channel: Channel, joints: &[usize], or_other: bool) -> Finding {
    let who = joints_text(joints);
    let mut sentence = match channel {
        Channel::All => {
            format!("{who} counts the other way round: motion and input have the opposite sign")
        }
        _ => format!("the {} of {who} has the opposite sign", channel.word()),
    };
    if or_other {
        sentence.push_str(" (or its motion has: this record cannot tell)");
    }
    Finding::new(
        FindingKind::SignFlipped { channel, or_other },
        Severity::Wrong,
        sentence,
        format!("change the sign of {}; `--fix` does it", channel.columns()),
    )
    .of(joints, channel)
}

/// Says that columns are in another unit.
pub(crate) fn unit_finding(channel: Channel, joints: &[usize], factor: f64, unit: &str) -> Finding {
    Finding::new(
        FindingKind::Unit {
            channel,
            factor,
            unit: unit.to_owned(),
        },
        Severity::Wrong,
        format!(
            "the {} of {} is in {unit}, not in SI units",
            channel.word(),
            joints_text(joints)
        ),
        format!(
            "multiply {} by {}; `--fix` does it",
            channel.columns(),
            number(factor)
        ),
    )
    .of(joints, channel)
}

/// Says that inputs are off by a factor that is no unit.
pub(crate) fn scale_finding(joints: &[usize], factor: f64) -> Finding {
    Finding::new(
        FindingKind::InputScale { factor },
        Severity::Doubtful,
        format!(
            "the input of {} is {} times what the robot needs",
            joints_text(joints),
            number(factor)
        ),
        "check motor_gain, the gear ratio and the unit of u: the factor is that of no usual unit",
    )
    .of(joints, Channel::Input)
}

/// Says that gravity points elsewhere.
pub(crate) fn gravity_finding(stated: [f64; 3], found: [f64; 3]) -> Finding {
    let text = |g: [f64; 3]| format!("[{}]", g.map(number).join(", "));
    let opposite = stated.iter().zip(found).all(|(a, b)| (a + b).abs() < 1e-6);
    let what = if opposite {
        "gravity has the wrong sign"
    } else {
        "gravity points along another axis"
    };
    Finding::new(
        FindingKind::Gravity { stated, found },
        Severity::Wrong,
        format!(
            "{what}: the torques of the record ask for {}, the description states {}",
            text(found),
            text(stated)
        ),
        format!(
            "write gravity = {} in the description, or check how the robot is mounted",
            text(found)
        ),
    )
}
