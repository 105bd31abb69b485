//! Joints: ends, motion, limits, friction, what they follow.

use std::collections::BTreeMap;
use std::ops::Range;

use roxmltree::Node;

use super::reader::Reader;
use crate::description::{Joint, JointPlaces, Mimic, Motion};
use crate::error::{TreeFault, UrdfError};
use crate::names;

impl<'a> Reader<'a> {
    /// A joint; what is odd but usable goes to `warnings`.
    pub(super) fn joint(
        &self,
        node: Node<'a, 'a>,
        links: &BTreeMap<String, usize>,
        warnings: &mut Vec<String>,
    ) -> Result<Joint, UrdfError> {
        let name = self.name(node, "a joint")?;
        let item = format!("joint `{name}`");
        let line = self.line(node.range().start);
        let parent = self.end(node, &item, "parent", links)?;
        let child = self.end(node, &item, "child", links)?;
        let motion = self.motion(node, &item)?;
        let (origin, rpy) = match self.child(node, &item, "origin")? {
            None => ([0.0; 3], [0.0; 3]),
            Some(origin) => (
                self.numbers(origin, &item, "xyz", "origin xyz")?
                    .unwrap_or_default(),
                self.numbers(origin, &item, "rpy", "origin rpy")?
                    .unwrap_or_default(),
            ),
        };
        let (mut limits, mut effort) = (None, None);
        if let Some(limit) = self.child(node, &item, "limit")? {
            let lower = self.number(limit, &item, "lower", "limit lower")?;
            let upper = self.number(limit, &item, "upper", "limit upper")?;
            effort = self.number(limit, &item, "effort", "limit effort")?;
            let (low, high) = (lower.unwrap_or(0.0), upper.unwrap_or(0.0));
            let continuous = node.attribute("type") == Some("continuous");
            if low > high && !continuous {
                let attribute = limit
                    .attribute_node("lower")
                    .or_else(|| limit.attribute_node("upper"));
                if let Some(attribute) = attribute {
                    let mend = format!("the lower limit must be below the upper one, {high}");
                    return Err(self.value(&attribute, &item, "limit lower", mend));
                }
            }
            if low < high && !continuous {
                limits = Some((low, high));
            } else if motion != Motion::Fixed && !continuous {
                warnings.push(format!(
                    "{}:{}: {item}: lower and upper limit are both {low}; read as no limits",
                    self.file.display(),
                    self.line(limit.range().start)
                ));
            }
        }
        let dynamics = self.child(node, &item, "dynamics")?;
        let coefficient =
            |name: &str, key: &'static str| -> Result<(f64, Option<Range<usize>>), UrdfError> {
                let Some(dynamics) = dynamics else {
                    return Ok((0.0, None));
                };
                let Some(attribute) = dynamics.attribute_node(name) else {
                    return Ok((0.0, None));
                };
                let x = self.number(dynamics, &item, name, key)?.unwrap_or(0.0);
                if x < 0.0 {
                    return Err(self.value(
                        &attribute,
                        &item,
                        key,
                        "friction takes energy away: zero or positive",
                    ));
                }
                Ok((x, Some(attribute.range_value())))
            };
        let (damping, damping_place) = coefficient("damping", "dynamics damping")?;
        let (friction, friction_place) = coefficient("friction", "dynamics friction")?;
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
            damping,
            friction,
            mimic: None,
            places: JointPlaces {
                line,
                inside: Some(self.after_tag(node)),
                dynamics: dynamics.map(|d| self.after_name(d)),
                damping: damping_place,
                friction: friction_place,
            },
        })
    }

    fn end(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        which: &'static str,
        links: &BTreeMap<String, usize>,
    ) -> Result<usize, UrdfError> {
        let (element, attribute) = match which {
            "parent" => ("<parent>", "link of <parent>"),
            _ => ("<child>", "link of <child>"),
        };
        let end = self.child(node, item, which)?.ok_or_else(|| {
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
                let mend = "joints with several coordinates are not supported: hold the robot by \"fixed\", or write the \
                            motion as prismatic and revolute joints with massless links between them";
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
        let Some(element) = self.child(node, item, "axis")? else {
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

    /// The joint that this one follows, as written.
    pub(super) fn mimic(
        &self,
        node: Node<'a, 'a>,
        joint: &Joint,
        names: &BTreeMap<String, usize>,
        joints: &[Joint],
    ) -> Result<Option<Mimic>, UrdfError> {
        let item = format!("joint `{}`", joint.name);
        let Some(mimic) = self.child(node, &item, "mimic")? else {
            return Ok(None);
        };
        let leader = mimic.attribute_node("joint").ok_or_else(|| {
            self.missing(
                mimic,
                &item,
                "joint of <mimic>",
                "write joint=\"…\" with the name of a joint",
            )
        })?;
        let &index = names
            .get(leader.value())
            .ok_or_else(|| self.unknown(mimic, &item, "joint", leader.value(), names))?;
        if joint.motion == Motion::Fixed {
            return Err(self.value(
                &leader,
                &item,
                "mimic joint",
                "a fixed joint cannot follow; take <mimic> out",
            ));
        }
        if joints[index].motion == Motion::Fixed {
            return Err(self.value(
                &leader,
                &item,
                "mimic joint",
                "that joint is fixed; follow one that moves",
            ));
        }
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
