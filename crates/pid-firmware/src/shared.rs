//! What both languages say alike: what stands above the functions, and laws of inputs.

use crate::equations::{Drive, Equations};
use crate::input::Step;
use crate::names::comment;
use crate::program::Language;

/// What stands above the functions in the words of both languages.
pub(crate) fn about(equations: &Equations) -> Vec<String> {
    let mut about = vec![
        format!(
            "Feed-forward of the robot {}, written by simtrue export. Edit the description, not this file.",
            comment(&equations.name)
        ),
        String::new(),
        format!("Operations of the torques: {}.", equations.cost()),
        format!("Operations of the residual: {}.", equations.residual_cost()),
        String::new(),
        "Coordinates, SI units:".to_owned(),
    ];
    for (j, drive) in equations.drives.iter().enumerate() {
        let unit = comment(&drive.unit.replace('*', " "));
        let (length, force) = match drive.prismatic {
            true => ("m", "N"),
            false => ("rad", "N m"),
        };
        about.push(format!(
            "{j}: {}, {length}, {force}, input in {unit}",
            comment(&drive.name)
        ));
    }
    about
}

/// A law of the input as code that C and Rust read alike.
pub(crate) fn direct(drive: &Drive, input: &str, language: &dyn Language) -> String {
    let mut text = input.to_owned();
    for step in &drive.steps {
        text = match *step {
            Step::Shift(x) => format!("({text} + ({}))", language.number(x)),
            Step::Limit(x) => format!("limit({text}, {})", language.number(x.abs())),
            Step::Droop(x) => format!("droop({text}, {})", language.number(x)),
            Step::DeadZone(x) => format!("beyond({text}, {})", language.number(x)),
        };
    }
    match drive.gain == 1.0 {
        true => text,
        false => format!("({}) * {text}", language.number(drive.gain)),
    }
}

/// The input at which a drive makes a torque, as code that C and Rust read alike.
pub(crate) fn inverse(drive: &Drive, torque: &str, language: &dyn Language) -> String {
    let mut text = match drive.gain == 1.0 {
        true => torque.to_owned(),
        false => format!("{torque} / ({})", language.number(drive.gain)),
    };
    for step in drive.steps.iter().rev() {
        text = match *step {
            Step::Shift(x) => format!("({text} - ({}))", language.number(x)),
            Step::Limit(x) => format!("limit({text}, {})", language.number(x.abs())),
            Step::Droop(x) => {
                let top = match x > 0.0 {
                    true => 1.0 / x.sqrt(),
                    false => 0.0,
                };
                format!(
                    "undroop({text}, {}, {})",
                    language.number(x),
                    language.number(top)
                )
            }
            Step::DeadZone(x) => format!("around({text}, {})", language.number(x)),
        };
    }
    text
}

/// Which functions the code calls: sign; limit; droop and its inverse; dead zone and its inverse.
pub(crate) fn needed(equations: &Equations, body: &str) -> [bool; 4] {
    let has = |law: fn(&Step) -> bool| equations.drives.iter().any(|d| d.steps.iter().any(law));
    [
        body.contains("sign("),
        has(|s| matches!(s, Step::Limit(_))),
        has(|s| matches!(s, Step::Droop(_))),
        has(|s| matches!(s, Step::DeadZone(_))),
    ]
}
