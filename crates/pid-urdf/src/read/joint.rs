//! Joints: ends, motion, limits, friction, what they follow.

use std::ops::Range;

use roxmltree::Node;

use super::Names;
use super::reader::{Reader, nearest};
use crate::description::{Description, Joint, JointPlaces, Mimic, Motion};
use crate::error::{TreeFault, UrdfError};
use crate::names;
use crate::reading::Reading;

impl<'a> Reader<'a> {
    /// A joint; what is odd but usable is a warning.
    pub(super) fn joint(&self, node: Node<'a, 'a>, links: &Names) -> Result<Joint, UrdfError> {
        let name = self.name(node, "a joint")?;
        let item = format!("joint `{name}`");
        let line = self.line(node.range().start);
        let parent = self.end(node, &item, "parent", links)?;
        let child = self.end(node, &item, "child", links)?;
        let motion = self.motion(node, &item)?;
        let (origin, rpy) = match self.child(node, &item, "origin") {
            None => ([0.0; 3], [0.0; 3]),
            Some(origin) => (
                self.numbers(origin, &item, "xyz", "origin xyz")?
                    .unwrap_or_default(),
                self.numbers(origin, &item, "rpy", "origin rpy")?
                    .unwrap_or_default(),
            ),
        };
        let limits = self.limits(node, &item, motion)?;
        let (mut effort, mut speed) = (None, None);
        if let Some(limit) = self.child(node, &item, "limit") {
            effort = self.hint(limit, &item, "effort", "limit effort")?;
            speed = self.hint(limit, &item, "velocity", "limit velocity")?;
        }
        let dynamics = self.child(node, &item, "dynamics");
        let (damping, damping_place) = self.friction(dynamics, &item, "damping")?;
        let (friction, friction_place) = self.friction(dynamics, &item, "friction")?;
        Ok(Joint {
            name: name.to_owned(),
            identifier: names::identifier(name),
            motion,
            parent,
            child,
            origin,
            rpy,
            limits,
            effort,
            speed,
            damping,
            friction,
            mimic: None,
            held: None,
            places: JointPlaces {
                line,
                inside: Some(self.after_tag(node)),
                dynamics: dynamics.map(|d| self.after_name(d)),
                damping: damping_place,
                friction: friction_place,
            },
        })
    }

    /// The range of a joint that has one.
    fn limits(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        motion: Motion,
    ) -> Result<Option<(f64, f64)>, UrdfError> {
        let continuous = node.attribute("type") == Some("continuous");
        let Some(limit) = self.child(node, item, "limit") else {
            return Ok(None);
        };
        if motion == Motion::Fixed || continuous {
            return Ok(None);
        }
        let infinite = |name: &str| {
            let text = limit.attribute(name).unwrap_or("");
            text.parse::<f64>().is_ok_and(f64::is_infinite)
        };
        let lower = self.hint(limit, item, "lower", "limit lower")?;
        let upper = self.hint(limit, item, "upper", "limit upper")?;
        if infinite("lower") || infinite("upper") {
            return Ok(None);
        }
        let (low, high) = (lower.unwrap_or(0.0), upper.unwrap_or(0.0));
        let line = self.line(limit.range().start);
        if low < high {
            return Ok(Some((low, high)));
        }
        if low > high {
            self.warn(
                line,
                format!(
                    "{item}: the lower limit {low} is above the upper one, {high}; they are exchanged"
                ),
            );
            return Ok(Some((high, low)));
        }
        self.warn(
            line,
            format!("{item}: lower and upper limit are both {low}; read as no limits"),
        );
        Ok(None)
    }

    /// A coefficient of `<dynamics>` and its place.
    fn friction(
        &self,
        dynamics: Option<Node<'a, 'a>>,
        item: &str,
        name: &'static str,
    ) -> Result<(f64, Option<Range<usize>>), UrdfError> {
        let Some((dynamics, attribute)) = dynamics.and_then(|d| Some((d, d.attribute_node(name)?)))
        else {
            return Ok((0.0, None));
        };
        let key = match name {
            "damping" => "dynamics damping",
            _ => "dynamics friction",
        };
        let x = self.number(dynamics, item, name, key)?.unwrap_or(0.0);
        let place = Some(attribute.range_value());
        if x < 0.0 {
            self.warn(
                self.line(attribute.range().start),
                format!("{item}: {key} is {x}; friction takes energy away, so zero is read"),
            );
            return Ok((0.0, place));
        }
        Ok((x, place))
    }

    fn end(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        which: &'static str,
        links: &Names,
    ) -> Result<usize, UrdfError> {
        let (element, attribute) = match which {
            "parent" => ("<parent>", "link of <parent>"),
            _ => ("<child>", "link of <child>"),
        };
        let end = self.child(node, item, which).ok_or_else(|| {
            self.missing(
                node,
                item,
                element,
                "a joint has <parent link=\"…\"/> and <child link=\"…\"/>",
            )
        })?;
        let name = end.attribute("link").ok_or_else(|| {
            self.missing(
                end,
                item,
                attribute,
                "write link=\"…\" with the name of a link",
            )
        })?;
        links
            .get(name)
            .copied()
            .ok_or_else(|| self.unknown(end, item, "link", name, links))
    }

    fn motion(&self, node: Node<'a, 'a>, item: &str) -> Result<Motion, UrdfError> {
        let kind = node.attribute_node("type").ok_or_else(|| {
            self.missing(
                node,
                item,
                "type",
                "write type=\"revolute\", \"continuous\", \"prismatic\" or \"fixed\"",
            )
        })?;
        match kind.value() {
            "fixed" => Ok(Motion::Fixed),
            "revolute" | "continuous" => Ok(Motion::Revolute(self.axis(node, item)?)),
            "prismatic" => Ok(Motion::Prismatic(self.axis(node, item)?)),
            "floating" | "planar" => {
                let line = self.line(kind.range().start);
                let kind = kind.value();
                self.warn(
                    line,
                    format!("{item} is {kind}; what it carries is held at its origin"),
                );
                Ok(Motion::Fixed)
            }
            "ball" | "spherical" => {
                let mend = "a ball joint has three coordinates that no drive of one coordinate moves: write it as three \
                            revolute joints with massless links between them, or as \"fixed\"";
                Err(self.value(&kind, item, "type", mend))
            }
            _ => Err(self.value(
                &kind,
                item,
                "type",
                "use \"revolute\", \"continuous\", \"prismatic\" or \"fixed\"",
            )),
        }
    }

    fn axis(&self, node: Node<'a, 'a>, item: &str) -> Result<[f64; 3], UrdfError> {
        const X: [f64; 3] = [1.0, 0.0, 0.0];
        let Some(element) = self.child(node, item, "axis") else {
            return Ok(X);
        };
        let Some(axis) = self.numbers::<3>(element, item, "xyz", "axis xyz")? else {
            return Ok(X);
        };
        // Scaled first, since squares of large or small components overflow or underflow.
        let largest = axis.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
        let scaled = axis.map(|x| x / largest);
        let length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length.is_finite() && length >= 1.0 {
            return Ok(scaled.map(|x| x / length));
        }
        match element.attribute_node("xyz") {
            Some(attribute) => Err(self.value(
                &attribute,
                item,
                "axis xyz",
                "an axis has a direction, as in \"0 0 1\"",
            )),
            None => Ok(X),
        }
    }

    /// The joint that this one follows, as written; none for a joint that does not move.
    pub(super) fn mimic(
        &self,
        node: Node<'a, 'a>,
        joint: &Joint,
        names: &Names,
    ) -> Result<Option<Mimic>, UrdfError> {
        let item = format!("joint `{}`", joint.name);
        let Some(mimic) = self.child(node, &item, "mimic") else {
            return Ok(None);
        };
        if joint.motion == Motion::Fixed {
            self.warn(
                self.line(mimic.range().start),
                format!("{item} does not move and mimics another one; it stays where it is"),
            );
            return Ok(None);
        }
        let leader = mimic.attribute_node("joint").ok_or_else(|| {
            self.missing(
                mimic,
                &item,
                "joint of <mimic>",
                "write joint=\"…\" with the name of a joint",
            )
        })?;
        let Some(&index) = names.get(leader.value()) else {
            let near = nearest(leader.value(), names.keys());
            let near = near.map_or_else(String::new, |n| format!("; did you mean `{n}`?"));
            self.warn(
                self.line(mimic.range().start),
                format!(
                    "{item} mimics `{}`, which is no joint; it moves on its own{near}",
                    leader.value()
                ),
            );
            return Ok(None);
        };
        Ok(Some(Mimic {
            joint: index,
            multiplier: self
                .number(mimic, &item, "multiplier", "mimic multiplier")?
                .unwrap_or(1.0),
            offset: self
                .number(mimic, &item, "offset", "mimic offset")?
                .unwrap_or(0.0),
        }))
    }

    /// Holds joints as the settings say, and what follows a joint that does not move.
    pub(super) fn hold(
        &self,
        description: &mut Description,
        reading: &Reading,
    ) -> Result<(), UrdfError> {
        let known = |name: &String| -> Result<(), UrdfError> {
            let names = description.joints.iter().map(|joint| &joint.name);
            if names.clone().any(|n| n == name) {
                return Ok(());
            }
            Err(UrdfError::NoJoint {
                file: self.file.to_owned(),
                name: name.clone(),
                nearest: nearest(name, names),
            })
        };
        reading.held.keys().try_for_each(known)?;
        reading.moving.iter().flatten().try_for_each(known)?;
        for joint in &mut description.joints {
            let stays = reading
                .moving
                .as_ref()
                .is_some_and(|moving| !moving.contains(&joint.name));
            let (low, high) = joint.limits.unwrap_or((0.0, 0.0));
            joint.held = match reading.held.get(&joint.name) {
                _ if joint.motion == Motion::Fixed => None,
                Some(&position) => Some(position),
                None if stays && joint.mimic.is_none() => Some(0.0_f64.max(low).min(high.max(low))),
                None => None,
            };
        }
        let positions: Vec<Option<f64>> = (description.joints.iter())
            .map(|joint| match joint.moves() {
                true => None,
                false => Some(joint.held.unwrap_or(0.0)),
            })
            .collect();
        for joint in &mut description.joints {
            if let Some(mimic) = joint.mimic
                && joint.held.is_none()
                && let Some(position) = positions[mimic.joint]
            {
                joint.held = Some(mimic.multiplier * position + mimic.offset);
                self.warn(
                    joint.places.line,
                    format!(
                        "joint `{}` follows a joint that does not move; it is held",
                        joint.name
                    ),
                );
            }
            if joint.held.is_some() {
                joint.mimic = None;
            }
        }
        Ok(())
    }
}

/// Chains of joints that follow end at one that moves on its own.
pub(super) fn resolve_mimics(
    joints: &mut [Joint],
    mimics: &[Option<Mimic>],
) -> Result<(), TreeFault> {
    for index in 0..joints.len() {
        let Some(mut mimic) = mimics[index] else {
            continue;
        };
        let mut steps = 0;
        while let Some(next) = mimics[mimic.joint] {
            steps += 1;
            if steps > joints.len() {
                return Err(TreeFault::MimicLoop {
                    joint: joints[index].name.clone(),
                });
            }
            mimic = Mimic {
                joint: next.joint,
                multiplier: mimic.multiplier * next.multiplier,
                offset: mimic.multiplier * next.offset + mimic.offset,
            };
        }
        if !(mimic.multiplier.is_finite() && mimic.offset.is_finite()) {
            return Err(TreeFault::MimicRange {
                joint: joints[index].name.clone(),
            });
        }
        joints[index].mimic = Some(mimic);
    }
    Ok(())
}
