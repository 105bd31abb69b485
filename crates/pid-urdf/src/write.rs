//! Writes parameter values back into the text of a URDF.
//!
//! Only the numbers behind the parameters change; visuals, meshes, comments, unknown elements and
//! the layout stay. Read again with inertias as numbers, the text gives the dynamics of the robot
//! with those parameters.

use std::ops::Range;

use pid_derive::mechanism::{Distribution, InertiaSource, Place};
use pid_derive::plausible::{self, Implausible};

use crate::bodies::Rigid;
use crate::description::{Description, Inertial, Joint, Link, Places};
use crate::robot::{Options, STANDARD, free_links};

/// A text, and the values that it could not hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The URDF.
    pub text: String,
    /// Parameters that have no field, or no value a field may have.
    pub lost: Vec<Lost>,
}

/// A parameter that URDF cannot express.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Lost {
    /// A drive's inertia is not zero: URDF has no field for it.
    Armature {
        /// The parameter.
        parameter: String,
        /// Its value.
        value: f64,
    },
    /// Values that no body or joint can have; the text keeps its own.
    Refused {
        /// The link or joint.
        item: String,
        /// Why.
        reason: String,
    },
    /// No value was given for a parameter; the text keeps its own.
    NotGiven {
        /// The parameter.
        parameter: String,
    },
}

impl std::fmt::Display for Lost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Armature { parameter, value } => write!(
                f,
                "`{parameter}` is {value}; URDF has no field for the inertia of a drive, state it where the simulator expects it"
            ),
            Self::Refused { item, reason } => write!(f, "{item} keeps its old values: {reason}"),
            Self::NotGiven { parameter } => {
                write!(f, "no value given for `{parameter}`, the old one stays")
            }
        }
    }
}

/// The text of a description with the values of the parameters of its [`robot`](crate::robot()).
/// `value` gives the value of a parameter by its name.
pub fn write(
    description: &Description,
    options: &Options,
    value: impl Fn(&str) -> Option<f64>,
) -> Written {
    let mut writer = Writer {
        description,
        value: &value,
        edits: Edits::default(),
        lost: Vec::new(),
    };
    let bodies = description.rigid();
    for ((index, link), free) in
        (description.links.iter().enumerate()).zip(free_links(description, options))
    {
        if free {
            writer.link(index, link, &bodies);
        } else if let (InertiaSource::Guessed, Some(guessed)) = (link.source, &link.inertial) {
            // A guess is no part of the text yet, and other readers need it.
            writer.edits.insert_inertial(link.places.new, guessed);
        }
    }
    for joint in description.joints.iter().filter(|joint| joint.moves()) {
        if options.friction {
            writer.friction(joint);
        }
        if options.armature {
            writer.armature(joint);
        }
    }
    Written {
        text: writer.edits.apply(&description.text),
        lost: writer.lost,
    }
}

/// What becomes of the text of a description.
struct Writer<'a> {
    description: &'a Description,
    /// The value of a parameter by its name.
    value: &'a dyn Fn(&str) -> Option<f64>,
    edits: Edits,
    lost: Vec<Lost>,
}

impl Writer<'_> {
    /// Mass, centre of mass and inertia of a link.
    fn link(&mut self, index: usize, link: &Link, bodies: &[Rigid]) {
        let mut p = [0.0; 10];
        let mut complete = true;
        for (place, stem) in p.iter_mut().zip(STANDARD) {
            let parameter = format!("{}_{stem}", link.identifier);
            match (self.value)(&parameter) {
                Some(x) => *place = x,
                None => {
                    complete = false;
                    self.lost.push(Lost::NotGiven { parameter });
                }
            }
        }
        if !complete {
            return;
        }
        let rpy = link.inertial.map_or([0.0; 3], |inertial| inertial.rpy);
        let (mass, com, inertia) = about_com(p, rpy);
        let new = Inertial {
            mass,
            com,
            rpy,
            inertia,
        };
        if let Err(reason) = check(self.description, bodies, index, new) {
            self.lost.push(Lost::Refused {
                item: format!("link `{}`", link.name),
                reason: reason.to_string(),
            });
            return;
        }
        self.edits.inertial(&link.places, &new);
    }

    /// The value of a coefficient of friction; the old one where it has none that a joint can have.
    fn coefficient(&mut self, joint: &Joint, stem: &str, old: f64) -> f64 {
        let parameter = format!("{stem}_{}", joint.identifier);
        match (self.value)(&parameter) {
            Some(x) if x >= 0.0 && x.is_finite() => x,
            Some(x) => {
                self.lost.push(Lost::Refused {
                    item: format!("joint `{}`", joint.name),
                    reason: format!("`{parameter}` is {x}; friction is zero or positive"),
                });
                old
            }
            None => {
                self.lost.push(Lost::NotGiven { parameter });
                old
            }
        }
    }

    /// Dry and viscous friction of a joint.
    fn friction(&mut self, joint: &Joint) {
        let dry = self.coefficient(joint, "dry", joint.friction).to_string();
        let viscous = self
            .coefficient(joint, "viscous", joint.damping)
            .to_string();
        let places = &joint.places;
        match places.dynamics {
            Some(tag) => {
                self.edits
                    .attribute(places.damping.clone(), Some(tag), "damping", &viscous);
                self.edits
                    .attribute(places.friction.clone(), Some(tag), "friction", &dry);
            }
            None => self.edits.insert(
                places.inside,
                format!("<dynamics damping=\"{viscous}\" friction=\"{dry}\"/>"),
            ),
        }
    }

    /// What the inertia of a joint's drive loses.
    fn armature(&mut self, joint: &Joint) {
        let parameter = format!("rotor_{}", joint.identifier);
        match (self.value)(&parameter) {
            Some(0.0) => {}
            Some(value) => self.lost.push(Lost::Armature { parameter, value }),
            None => self.lost.push(Lost::NotGiven { parameter }),
        }
    }
}

const NAMES: [&str; 6] = ["ixx", "iyy", "izz", "ixy", "ixz", "iyz"];

/// `<inertia …/>`.
fn tensor(inertia: [f64; 6]) -> String {
    let pairs = NAMES.iter().zip(inertia);
    let pairs: String = pairs.map(|(n, v)| format!(" {n}=\"{v}\"")).collect();
    format!("<inertia{pairs}/>")
}

/// Whether the body that a link is part of is one with new values of the link, whose mass is positive.
fn check(
    description: &Description,
    bodies: &[Rigid],
    link: usize,
    new: Inertial,
) -> Result<(), Implausible> {
    let values = new.distribution();
    if values.mass <= 0.0 {
        return Err(Implausible::Mass { mass: values.mass });
    }
    let Some(body) = bodies
        .iter()
        .find(|b| b.links.iter().any(|(l, _)| *l == link))
    else {
        return plausible::check(values.mass, values.inertia);
    };
    let mut all = Distribution::default();
    for (member, place) in &body.links {
        let part = match &description.links[*member].inertial {
            _ if *member == link => values,
            Some(inertial) => inertial.distribution(),
            None => continue,
        };
        all = all.with(&part.placed(place));
    }
    plausible::check(all.mass, all.inertia)
}

/// Mass, centre of mass, and inertia about it in axes turned by `rpy`, of standard parameters.
fn about_com(p: [f64; 10], rpy: [f64; 3]) -> (f64, [f64; 3], [f64; 6]) {
    let [m, mx, my, mz, xx, yy, zz, xy, xz, yz] = p;
    let c = [mx / m, my / m, mz / m];
    let about = [
        xx - m * (c[1] * c[1] + c[2] * c[2]),
        yy - m * (c[0] * c[0] + c[2] * c[2]),
        zz - m * (c[0] * c[0] + c[1] * c[1]),
        xy + m * c[0] * c[1],
        xz + m * c[0] * c[2],
        yz + m * c[1] * c[2],
    ];
    (m, c, Place::new([0.0; 3], rpy).inverse().tensor(about))
}

/// Replacements and insertions of a text.
#[derive(Default)]
struct Edits(Vec<(Range<usize>, String)>);

impl Edits {
    /// Replaces the value of an attribute, or inserts the attribute after the name of its tag.
    fn attribute(
        &mut self,
        range: Option<Range<usize>>,
        tag: Option<usize>,
        name: &str,
        value: &str,
    ) {
        match (range, tag) {
            (Some(range), _) => self.0.push((range, value.to_owned())),
            (None, Some(tag)) => self.0.push((tag..tag, format!(" {name}=\"{value}\""))),
            (None, None) => {}
        }
    }

    fn insert(&mut self, at: Option<usize>, text: String) {
        if let Some(at) = at {
            self.0.push((at..at, text));
        }
    }

    /// The values of a link, in its `<inertial>` or in one that it gets.
    fn inertial(&mut self, places: &Places, new: &Inertial) {
        if places.inside.is_none() {
            self.insert_inertial(places.new, new);
            return;
        }
        let xyz = new.com.map(|x| x.to_string()).join(" ");
        self.attribute(places.mass.clone(), None, "value", &new.mass.to_string());
        match &places.origin {
            Some((tag, range)) => self.attribute(range.clone(), Some(*tag), "xyz", &xyz),
            None => self.insert(places.inside, format!("<origin xyz=\"{xyz}\"/>")),
        }
        let values = new.inertia.map(|x| x.to_string());
        match places.inertia_tag {
            Some(tag) => {
                for ((range, name), value) in places.inertia.iter().zip(NAMES).zip(&values) {
                    self.attribute(range.clone(), Some(tag), name, value);
                }
            }
            None => self.insert(places.inside, tensor(new.inertia)),
        }
    }

    /// An `<inertial>` for a link without one.
    fn insert_inertial(&mut self, place: Option<(usize, bool)>, new: &Inertial) {
        let Some((at, closed)) = place else {
            return;
        };
        let vector = |x: [f64; 3]| x.map(|x| x.to_string()).join(" ");
        let element = format!(
            "<inertial><origin xyz=\"{}\" rpy=\"{}\"/><mass value=\"{}\"/>{}</inertial>",
            vector(new.com),
            vector(new.rpy),
            new.mass,
            tensor(new.inertia)
        );
        match closed {
            // The `/` of `<link/>` makes room.
            true => self.0.push((at..at + 1, format!(">{element}</link"))),
            false => self.insert(Some(at), element),
        }
    }

    fn apply(mut self, text: &str) -> String {
        // Stable: insertions at one place keep their order.
        self.0.sort_by_key(|(range, _)| range.start);
        let mut out = String::with_capacity(text.len());
        let mut at = 0;
        for (range, new) in &self.0 {
            out.push_str(text.get(at..range.start).unwrap_or(""));
            out.push_str(new);
            at = range.end;
        }
        out.push_str(text.get(at..).unwrap_or(""));
        out
    }
}
