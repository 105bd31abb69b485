//! Robots of the tests, residuals of a robot, and mutated descriptions.
#![allow(dead_code, reason = "each test uses some of it")]

use pid_derive::equations;
use pid_derive::model::Robot;
use pid_symbolic::random::Random;
use pid_symbolic::{Graph, Tape};

pub(crate) const ROBOTS: [(&str, &str); 3] = [
    ("planar_arm.urdf", include_str!("../robots/planar_arm.urdf")),
    ("scara.urdf", include_str!("../robots/scara.urdf")),
    ("gripper.urdf", include_str!("../robots/gripper.urdf")),
];

pub(crate) fn text(file: &str) -> &'static str {
    ROBOTS
        .iter()
        .find(|(name, _)| *name == file)
        .expect("a robot of the tests")
        .1
}

/// r of a robot as a function of (q, v, a, u) and parameters.
pub(crate) struct Residual {
    tape: Tape,
    pub(crate) nq: usize,
}

impl Residual {
    pub(crate) fn new(robot: &Robot) -> Self {
        let mut g = Graph::new();
        let equations = equations(&mut g, robot).unwrap_or_else(|e| panic!("{e}"));
        Self {
            tape: Tape::new(&g, &equations.residual),
            nq: robot.nq(),
        }
    }

    pub(crate) fn at(&self, parts: [&[f64]; 5]) -> Vec<f64> {
        let z: Vec<f64> = parts.concat();
        assert!(z.len() >= self.tape.vars());
        let mut r = vec![f64::NAN; self.nq];
        self.tape.eval(&z, &mut r);
        r
    }
}

pub(crate) fn uniform(random: &mut Random, len: usize, size: f64) -> Vec<f64> {
    (0..len).map(|_| random.uniform(-size, size)).collect()
}

pub(crate) fn close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
    for (found, expected) in found.iter().zip(expected) {
        let error = (found - expected).abs();
        assert!(
            error <= tolerance * scale,
            "{what}: {found:e} for {expected:e}, scale {scale:e}"
        );
    }
}

/// Pieces that a mutation of the text inserts: tags, entities, and characters of several bytes.
const PIECES: [&str; 24] = [
    "\"",
    "<",
    ">",
    "/>",
    "&amp;",
    "&#0;",
    "&bogus;",
    "<!--",
    "-->",
    "<![CDATA[",
    "<?x?>",
    "é",
    "𝔐",
    "\0",
    "<robot>",
    "</robot>",
    "<link name=\"a\"/>",
    "<joint name=\"j\" type=\"floating\"/>",
    "<inertial><mass value=\"1\"/></inertial>",
    "<mimic joint=\"left\"/>",
    "${pi}",
    "base",
    " xmlns:xacro=\"http://xacro\"",
    "<!DOCTYPE a [<!ENTITY b \"bb\">]>",
];

/// Values that a mutation gives an attribute: numbers at the edges of what parses, names, types.
const VALUES: [&str; 32] = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1",
    "0",
    "1",
    "1e-320",
    "1e308",
    "-1e308",
    "0 0 0",
    "0 0 1",
    "1 2",
    "1e300 1e300 1e300",
    "1e-300 0 0",
    "",
    " ",
    "0.1",
    "left",
    "right",
    "elbow",
    "world",
    "palm",
    "upper",
    "fixed",
    "floating",
    "continuous",
    "prismatic",
    "a b",
    "é",
    "&#65;",
    "${x}",
];

fn index(random: &mut Random, len: usize) -> usize {
    (random.uniform(0.0, len as f64) as usize).min(len.saturating_sub(1))
}

/// A mutated description: one time in five as a text, else as elements with other values, so that
/// most inputs get past the parser of XML.
pub(crate) fn mutated(random: &mut Random) -> String {
    let text = ROBOTS[index(random, ROBOTS.len())].1;
    if random.uniform(0.0, 1.0) < 0.2 {
        return mutated_text(random, text);
    }
    let mut text = text.to_owned();
    for _ in 0..1 + index(random, 3) {
        if random.uniform(0.0, 1.0) < 0.7 {
            let quotes: Vec<usize> = text.match_indices('"').map(|(k, _)| k).collect();
            // Values stand between the quotes number 2 k and 2 k + 1.
            let k = 2 * index(random, quotes.len() / 2);
            if let (Some(start), Some(end)) = (quotes.get(k), quotes.get(k + 1)) {
                text.replace_range(start + 1..*end, VALUES[index(random, VALUES.len())]);
            }
        } else {
            // One element: cut, doubled, or moved.
            let tags: Vec<(usize, &str)> = text.match_indices("/>").collect();
            let Some(&(end, _)) = tags.get(index(random, tags.len())) else {
                continue;
            };
            let Some(start) = text[..end].rfind('<') else {
                continue;
            };
            let element = text[start..end + 2].to_owned();
            match index(random, 3) {
                0 => text.replace_range(start..end + 2, ""),
                1 => text.insert_str(start, &element),
                _ => {
                    text.replace_range(start..end + 2, "");
                    let places: Vec<usize> = text.match_indices('<').map(|(k, _)| k).collect();
                    text.insert_str(places[index(random, places.len())], &element);
                }
            }
        }
    }
    text
}

/// A text with pieces cut, doubled, moved or inserted, or made of pieces alone.
fn mutated_text(random: &mut Random, text: &str) -> String {
    if random.uniform(0.0, 1.0) < 0.1 {
        let count = index(random, 30);
        return (0..count)
            .map(|_| PIECES[index(random, PIECES.len())])
            .collect();
    }
    let mut text: Vec<char> = text.chars().collect();
    for _ in 0..1 + index(random, 3) {
        let start = index(random, text.len());
        let longest = if random.uniform(0.0, 1.0) < 0.7 {
            12
        } else {
            300
        };
        let end = (start + index(random, longest)).min(text.len());
        let piece: Vec<char> = match index(random, 5) {
            0 => Vec::new(),
            1 => text[start..end].repeat(2),
            2 => {
                let from = index(random, text.len());
                text[from..(from + (end - start)).min(text.len())].to_vec()
            }
            _ => PIECES[index(random, PIECES.len())].chars().collect(),
        };
        text.splice(start..end, piece);
    }
    text.into_iter().collect()
}

/// The outcome of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    NoXml,
    Refused,
    Robot,
}

/// Reads an input, makes the robot, writes it back and reads that again. Panics where a promise
/// does not hold.
pub(crate) fn exercise(text: &str) -> Outcome {
    use pid_urdf::{Description, Options, UrdfError};

    let description = match Description::parse("fuzz.urdf", text) {
        Ok(description) => description,
        Err(error) => {
            assert!(error.to_string().starts_with("fuzz.urdf"), "{error}");
            return match error {
                UrdfError::Xml { .. } => Outcome::NoXml,
                _ => Outcome::Refused,
            };
        }
    };
    let options = Options::default();
    let Ok(robot) = pid_urdf::robot(&description, &options) else {
        return Outcome::Refused;
    };
    let value = |name: &str| {
        robot
            .params
            .iter()
            .find(|p| p.name == name)
            .map(|p| p.nominal)
    };
    let written = pid_urdf::write(&description, &options, value);
    let again = Description::parse("fuzz.urdf", &written.text)
        .unwrap_or_else(|e| panic!("what was written is not read: {e}\n{}", written.text));
    assert_eq!(again.order, description.order);
    Outcome::Robot
}
