//! Bodies and joints as a tree of bodies with one joint each.
//!
//! A body with several joints becomes a chain: all but the last are massless, each frame sits at the
//! anchor of its joint. A body without joints is part of the one that carries it.

use pid_derive::mechanism::{Body, Distribution, InertiaSource, Place};
use pid_derive::plausible;
use pid_urdf::names;

use crate::element::Element;
use crate::error::MjcfError;
use crate::place::unit;
use crate::reader::{Range, Reader};

/// Where a body of the file hangs: on a body of the mechanism, in a place of its frame.
#[derive(Clone, Copy)]
pub(crate) struct Carrier {
    pub(crate) body: Option<usize>,
    pub(crate) place: Place,
}

impl Carrier {
    /// The ground.
    pub(crate) const GROUND: Self = Self {
        body: None,
        place: Place::IDENTITY,
    };

    fn at(&self, place: &Place) -> Self {
        Self {
            place: self.place.then(place),
            ..*self
        }
    }
}

impl Reader {
    /// Bodies, frames and geoms that stand in an element, carried by a body.
    pub(crate) fn children(
        &mut self,
        element: &Element,
        carrier: Carrier,
        class: Option<&str>,
    ) -> Result<(), MjcfError> {
        for child in &element.children {
            match child.name.as_str() {
                "body" => self.body(child, carrier, class)?,
                "frame" => {
                    let place = self.angles.place(child)?;
                    let class = child.get("childclass").or(class);
                    self.children(child, carrier.at(&place), class)?;
                }
                "composite" | "flexcomp" => {
                    self.warn(child, "is a soft body; it is not read, and has no mass");
                }
                "attach" => {
                    return Err(child.unsupported(
                        "makes bodies that are not written out",
                        "save the model as MuJoCo compiles it (mj_saveLastXML), and read that",
                    ));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn body(
        &mut self,
        body: &Element,
        carrier: Carrier,
        class: Option<&str>,
    ) -> Result<(), MjcfError> {
        let class = body.get("childclass").or(class);
        let mut carrier = carrier.at(&self.angles.place(body)?);
        if body.number("gravcomp")?.is_some_and(|x| x != 0.0) {
            self.warn(body, "has gravity compensation, which is not read");
        }
        // Joints may stand in frames, which place them.
        let mut joints = Vec::new();
        self.gather(body, &Place::IDENTITY, class, &mut joints)?;
        // The place of the body's own frame in that of the last joint.
        let mut inner = Place::IDENTITY;
        for (joint, place) in joints {
            if joint.name == "freejoint" || joint.get("type") == Some("free") {
                self.warn(&joint, "is free; what it carries is held in its place");
                continue;
            }
            for joint in self.hinges(&joint, &place)? {
                let at = carrier.place.then(&inner).then(&Place {
                    origin: joint.anchor,
                    ..Place::IDENTITY
                });
                inner = Place {
                    origin: joint.anchor.map(|x| -x),
                    ..Place::IDENTITY
                };
                self.push(
                    body,
                    joint,
                    Carrier {
                        place: at,
                        ..carrier
                    },
                );
                carrier = Carrier {
                    body: Some(self.bodies.len() - 1),
                    place: Place::IDENTITY,
                };
            }
        }
        let carrier = carrier.at(&inner);
        let all = self.inertia(body, class)?;
        if let Some(index) = carrier.body {
            let own = self.bodies[index].distribution();
            let all = own.with(&all.placed(&carrier.place));
            let carried = &mut self.bodies[index];
            (carried.mass, carried.com, carried.inertia) = (all.mass, all.com, all.inertia);
        }
        self.children(body, carrier, class)
    }

    /// Joints of a body with the places of the frames around them.
    fn gather(
        &self,
        element: &Element,
        place: &Place,
        class: Option<&str>,
        out: &mut Vec<(Element, Place)>,
    ) -> Result<(), MjcfError> {
        for child in &element.children {
            match child.name.as_str() {
                "joint" => out.push((self.defaults.applied(child, class)?, *place)),
                "freejoint" => out.push((child.clone(), *place)),
                "frame" => {
                    let inner = place.then(&self.angles.place(child)?);
                    let class = child.get("childclass").or(class);
                    self.gather(child, &inner, class, out)?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// The joint itself, or three hinges for a ball joint: about x, then the y that turned with it, then
    /// the z that turned with both. These are the angles of the body in MuJoCo's sequence `xyz`.
    fn hinges(&mut self, joint: &Element, place: &Place) -> Result<Vec<Joint>, MjcfError> {
        let one = self.joint(joint, place)?;
        if joint.get("type") != Some("ball") {
            return Ok(vec![one]);
        }
        self.warn(
            joint,
            "is a ball joint; it is read as three hinges about x, y and z, each with its damping, friction \
             and armature",
        );
        let name = one.name.clone();
        self.balls.extend(name.clone());
        let axes = [
            ("x", [1.0, 0.0, 0.0]),
            ("y", [0.0, 1.0, 0.0]),
            ("z", [0.0, 0.0, 1.0]),
        ];
        let each = axes.map(|(letter, axis)| Joint {
            name: Some(match &name {
                Some(name) => format!("{name}_{letter}"),
                None => format!("ball_{}_{letter}", self.bodies.len()),
            }),
            axis: place.vector(axis),
            reference: 0.0,
            // The range of a ball joint is that of its whole angle.
            limits: None,
            effort: None,
            ..one.clone()
        });
        Ok(each.into())
    }

    fn joint(&mut self, joint: &Element, place: &Place) -> Result<Joint, MjcfError> {
        let prismatic = match joint.get("type").unwrap_or("hinge") {
            "hinge" | "ball" => false,
            "slide" => true,
            _ => return Err(joint.error("type", "use hinge, slide, ball or free")),
        };
        let unit_of = if prismatic { 1.0 } else { self.angles.unit };
        let axis = place.vector(joint.numbers("axis")?.unwrap_or([0.0, 0.0, 1.0]));
        let axis = unit(axis).ok_or_else(|| joint.error("axis", "an axis has a direction"))?;
        for key in ["stiffness", "springdamper"] {
            if joint
                .list(key)?
                .is_some_and(|x| x.iter().any(|x| *x != 0.0))
            {
                self.warn(joint, &format!("has a spring (`{key}`), which is not read"));
            }
        }
        let range = self.range(joint, "range", "limited")?;
        // A damping that is a polynomial of the velocity has its linear part first.
        let damping = joint.list("damping")?.unwrap_or_default();
        if damping.iter().skip(1).any(|x| *x != 0.0) {
            self.warn(
                joint,
                "has damping that is not linear; its linear part is read",
            );
        }
        let stated = |x: Option<f64>| x.filter(|x| *x > 0.0);
        Ok(Joint {
            name: joint.get("name").map(str::to_owned),
            prismatic,
            axis,
            anchor: place.point(joint.numbers("pos")?.unwrap_or_default()),
            reference: unit_of * joint.number("ref")?.unwrap_or(0.0),
            limits: range.map(|(low, high)| (unit_of * low, unit_of * high)),
            rotor: stated(joint.number("armature")?),
            viscous: stated(damping.first().copied()),
            coulomb: stated(joint.number("frictionloss")?),
            effort: self
                .range(joint, "actuatorfrcrange", "actuatorfrclimited")?
                .map(|(low, high)| low.abs().max(high.abs())),
        })
    }

    /// Adds a body without mass.
    fn push(&mut self, body: &Element, joint: Joint, carrier: Carrier) {
        let link = body.get("name").unwrap_or("unnamed").to_owned();
        let name = joint.name.unwrap_or_else(|| format!("joint_{link}"));
        // At the reference position the body is where the file places it.
        let back = Place::moved(joint.prismatic, joint.axis, -joint.reference);
        let place = carrier.place.then(&back);
        self.joint_names.push(name.clone());
        self.bodies.push(Body {
            joint: names::identifier(&name),
            link,
            prismatic: joint.prismatic,
            axis: joint.axis,
            parent: carrier.body,
            origin: place.origin,
            rpy: place.rpy(),
            follows: None,
            limits: joint.limits,
            mass: 0.0,
            com: [0.0; 3],
            inertia: [0.0; 6],
            source: InertiaSource::Stated,
            rotor: joint.rotor,
            coulomb: joint.coulomb,
            viscous: joint.viscous,
            effort: joint.effort,
            speed: None,
        });
    }

    /// Mass and inertia of a body in its frame: as stated, or those of its geoms.
    fn inertia(&mut self, body: &Element, class: Option<&str>) -> Result<Distribution, MjcfError> {
        let inertial = body.all("inertial").next();
        let mut all = match inertial {
            Some(inertial) if self.from_geoms != Some(true) => self.stated(inertial)?,
            _ if self.from_geoms == Some(false) => Distribution::default(),
            _ => self.geoms(body, &Place::IDENTITY, class)?,
        };
        let (mass, moment) = self.bounds;
        all.mass = all.mass.max(mass);
        if moment > 0.0 {
            all.inertia = plausible::raised(all.inertia, moment);
        }
        self.weighed += all.mass;
        Ok(all)
    }

    fn stated(&self, inertial: &Element) -> Result<Distribution, MjcfError> {
        let mass = inertial.number("mass")?.unwrap_or(0.0);
        if mass < 0.0 {
            return Err(inertial.error("mass", "a mass is zero or positive"));
        }
        let place = self.angles.place(inertial)?;
        let inertia = match inertial.numbers::<6>("fullinertia")? {
            Some(full) => full,
            None => {
                let [xx, yy, zz] = inertial.numbers("diaginertia")?.unwrap_or_default();
                [xx, yy, zz, 0.0, 0.0, 0.0]
            }
        };
        let own = Distribution {
            mass,
            com: [0.0; 3],
            inertia,
        };
        Ok(own.placed(&place))
    }

    fn geoms(
        &mut self,
        element: &Element,
        place: &Place,
        class: Option<&str>,
    ) -> Result<Distribution, MjcfError> {
        let mut all = Distribution::default();
        for child in &element.children {
            match child.name.as_str() {
                "geom" => {
                    let geom = self.defaults.applied(child, class)?;
                    let group = geom.number("group")?.unwrap_or(0.0);
                    if group < self.groups.0 || group > self.groups.1 {
                        continue;
                    }
                    match crate::geom::filled(&geom, &self.angles, &mut self.meshes)? {
                        Ok(part) => all = all.with(&part.placed(place)),
                        Err(what) => self.warn(
                            &geom,
                            &format!("is {what}, whose mass is left out; state <inertial> instead"),
                        ),
                    }
                }
                "frame" => {
                    let inner = place.then(&self.angles.place(child)?);
                    let class = child.get("childclass").or(class);
                    all = all.with(&self.geoms(child, &inner, class)?);
                }
                _ => {}
            }
        }
        Ok(all)
    }

    /// A range that holds: one that is stated, unless a word says otherwise.
    pub(crate) fn range(&self, element: &Element, key: &str, limited: &str) -> Range {
        let Some([low, high]) = element.numbers::<2>(key)? else {
            return Ok(None);
        };
        let holds = match element.get(limited) {
            Some("true") => true,
            Some("false") => false,
            _ => self.autolimits,
        };
        Ok((holds && low < high).then_some((low, high)))
    }
}

/// A joint in the frame of its body.
#[derive(Debug, Clone)]
struct Joint {
    name: Option<String>,
    prismatic: bool,
    axis: [f64; 3],
    anchor: [f64; 3],
    reference: f64,
    limits: Option<(f64, f64)>,
    rotor: Option<f64>,
    viscous: Option<f64>,
    coulomb: Option<f64>,
    effort: Option<f64>,
}
