//! Pages of the catalogue: one per effect, and a list of all.

use std::fmt::Write;

use pid_effects::effect::{Effect, EqualWhen, Info, Kind, Parameter, Unit};
use pid_effects::effects;
use pid_page::number;
use pid_simulators::mujoco::expression;

use crate::Failure;
use crate::draw::svg;
use crate::reference::Reference;
use crate::views::view;

/// A file of the catalogue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct File {
    /// Its name in the folder of the catalogue.
    pub name: String,
    /// Its content.
    pub text: String,
}

/// First line of every page.
const MADE: &str =
    "<!-- Written by `cargo run --release -p pid-book`; changes here are lost. -->\n";

/// All files of the catalogue, a page and a plot for each effect of the library and the list.
///
/// # Errors
/// An effect that no view shows.
pub fn files() -> Result<Vec<File>, Failure> {
    let robot = Reference::new()?;
    let all = effects::all();
    let mut files = vec![File {
        name: "README.md".to_owned(),
        text: list(&all.iter().map(|e| e.info()).collect::<Vec<_>>()),
    }];
    for effect in &all {
        let id = effect.info().id;
        let shown = view(&robot, effect.as_ref())?;
        files.push(File {
            name: format!("{id}.svg"),
            text: svg(&shown),
        });
        files.push(File {
            name: format!("{id}.md"),
            text: page(&robot, effect.as_ref(), shown.what),
        });
    }
    Ok(files)
}

/// Lines of the table of contents, for `docs/SUMMARY.md`.
pub fn contents() -> String {
    let mut text = String::new();
    for effect in effects::all() {
        let id = effect.info().id;
        let _ = writeln!(text, "  - [{id}](book/effects/{id}.md)");
    }
    text
}

fn list(all: &[&Info]) -> String {
    let mut text = format!(
        "{MADE}# Catalogue of effects\n\n\
         The {} effects of the library: what each does, where it shows, what it is easily taken for, and what\n\
         models it in simulators. `simtrue diagnose` looks for all of them at every joint. `simtrue identify\n\
         --with ID:JOINT` adds one by hand.\n\n\
         | effect | what it is | a law over |\n|---|---|---|\n",
        all.len()
    );
    for info in all {
        let _ = writeln!(
            text,
            "| [{0}]({0}.md) | {1} | {2} |",
            info.id,
            info.title,
            info.class.words()
        );
    }
    text
}

fn page(robot: &Reference, effect: &dyn Effect, what: &str) -> String {
    let info = effect.info();
    let mut text = format!("{MADE}# {}\n\n{}.\n\n", info.id, info.title);
    let _ = write!(
        text,
        "```text\n{}\n```\n\n![{what}]({}.svg)\n\nPlot: {what}, at {}.\n\n",
        info.equation,
        info.id,
        values(info.parameters, &robot.size(effect))
    );
    let _ = write!(
        text,
        "| | |\n|---|---|\n| where it acts | {} |\n| a law over | {} |\n| at | {} |\n| shows in | {} |\n| source | {} |\n\n",
        kind(info.kind),
        info.class.words(),
        match (info.has_joint, effect.needs_partner()) {
            (true, true) => "one joint that has another before it",
            (true, false) => "one joint",
            (false, _) => "the whole robot",
        },
        info.regime,
        info.source
    );
    parameters(&mut text, info);
    taken_for(&mut text, info);
    simulators(&mut text, info);
    if let Some(source) = effect.source() {
        let _ = write!(
            text,
            "## In `robot!`\n\nThe force on the joint, with the joint's own names in braces:\n\n```text\n{}\n```\n",
            source.own
        );
        if let Some(before) = source.before {
            let _ = write!(text, "\nOn the joint before:\n\n```text\n{before}\n```\n");
        }
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    text
}

fn values(parameters: &[Parameter], e: &[f64]) -> String {
    let one = |(p, &x): (&Parameter, &f64)| {
        let unit = match p.si {
            "1" => String::new(),
            si => format!(" {}", number::unit(si)),
        };
        format!("`{}` = {}{unit}", p.name, number::short(x))
    };
    // Times after the end of the plot stand for "never".
    let drawn = parameters.iter().zip(e).filter(|(_, x)| x.abs() < 1e5);
    drawn.map(one).collect::<Vec<_>>().join(", ")
}

fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::Force => "a force, or a change of the robot's constants",
        Kind::State => "a force with a state of its own",
        Kind::Channel => "between data and model: a command or a reading",
    }
}

fn parameters(text: &mut String, info: &Info) {
    text.push_str(
        "## Parameters\n\nRanges scale with the joint, so that they hold for every robot; typical values are those of the records.\n\n\
         | parameter | unit of a turning joint | range |\n|---|---|---|\n",
    );
    for p in info.parameters {
        let of = match scale(p.unit) {
            "" => String::new(),
            scale => format!(" × {scale}"),
        };
        let _ = writeln!(
            text,
            "| `{}` | {} | {} to {}{of} |",
            p.name,
            number::unit(p.si),
            number::short(p.lower),
            number::short(p.upper)
        );
    }
    text.push('\n');
}

/// What a range counts in, in words.
fn scale(unit: Unit) -> &'static str {
    match unit {
        Unit::One | Unit::Share | Unit::Angle | Unit::Time => "",
        Unit::Torque => "typical torque",
        Unit::Input => "typical input",
        Unit::Speed => "typical speed",
        Unit::Acceleration => "squared typical speed over range",
        Unit::Range => "range of motion",
        Unit::Inertia => "inertia at the joint",
        Unit::Stiffness => "typical torque / range of motion",
        Unit::Damping => "typical torque / typical speed",
        Unit::Drag => "typical torque / typical speed²",
        Unit::Wave => "1 / range of motion",
        Unit::Compliance => "range of motion / typical torque",
        Unit::InverseInput => "1 / typical input",
        Unit::InverseSquareInput => "1 / typical input²",
        Unit::Ratio => "range of this joint / range of the joint before",
        Unit::Mass => "mass of the last link",
        Unit::Force => "force at the tool that the second joint's typical torque balances",
    }
}

fn taken_for(text: &mut String, info: &Info) {
    if !info.confusions.is_empty() {
        text.push_str("## Easily taken for\n\n");
        for (id, why) in info.confusions {
            let _ = writeln!(text, "- [{id}]({id}.md): {why}.");
        }
        text.push('\n');
    }
    if !info.equals.is_empty() {
        text.push_str("No motion tells it from:\n\n");
        for (id, when) in info.equals {
            let _ = writeln!(text, "- [{id}]({id}.md), where {}.", circumstance(*when));
        }
        text.push('\n');
    }
}

fn circumstance(when: EqualWhen) -> &'static str {
    match when {
        EqualWhen::OneJoint => "the robot has one joint",
        EqualWhen::OneJointWithoutGravity => {
            "the robot has one joint, and gravity has no moment about it"
        }
        EqualWhen::FirstOfVerticalPlane => "the joint is the first of an arm in a vertical plane",
        EqualWhen::NoViscousFriction => "the joint has no viscous friction, and none is possible",
    }
}

fn simulators(text: &mut String, info: &Info) {
    text.push_str("## In simulators\n\n| | |\n|---|---|\n");
    let nothing = "nothing";
    let _ = writeln!(text, "| MuJoCo | {} |", info.mujoco.unwrap_or(nothing));
    if let Some((file, wrapper)) = expression(info.id) {
        let _ = writeln!(text, "| `robot.xml` of `simtrue export` | {file} |");
        let _ = writeln!(text, "| `robot_effects.py` beside it | {wrapper} |");
    }
    let _ = writeln!(
        text,
        "| Isaac Sim, Isaac Lab | {} |",
        info.isaac.unwrap_or(nothing)
    );
    let _ = write!(text, "| URDF | {} |\n\n", info.urdf.unwrap_or(nothing));
}
