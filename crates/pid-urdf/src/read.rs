//! From text to [`Description`]: every element once, every value checked.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use pid_derive::plausible;
use roxmltree::{Attribute, Document, Node};

use crate::description::{Description, Inertial, Joint, JointPlaces, Link, Mimic, Motion, Places};
use crate::error::{TreeFault, UrdfError};
use crate::names;

pub(crate) fn description(file: &Path, text: &str) -> Result<Description, UrdfError> {
    let document = Document::parse(text).map_err(|error| UrdfError::Xml {
        file: file.to_owned(),
        error,
    })?;
    let reader = Reader {
        file,
        text,
        document: &document,
    };
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(UrdfError::Root {
            file: file.to_owned(),
            line: reader.line(root.range().start),
            found: root.tag_name().name().to_owned(),
        });
    }
    let mut links = Vec::new();
    let mut raw_joints = Vec::new();
    for node in root.children().filter(Node::is_element) {
        if node
            .tag_name()
            .namespace()
            .is_some_and(|n| n.contains("xacro"))
        {
            return Err(UrdfError::Xacro {
                file: file.to_owned(),
                line: reader.line(node.range().start),
                found: format!("xacro:{}", node.tag_name().name()),
            });
        }
        match node.tag_name().name() {
            "link" => links.push(reader.link(node)?),
            "joint" => raw_joints.push(node),
            _ => {}
        }
    }
    let mut warnings = Vec::new();
    let by_name = reader.apart(
        "link",
        links
            .iter()
            .map(|(l, line)| (l.name.as_str(), l.identifier.as_str(), *line)),
    )?;
    let mut joints = Vec::new();
    for &node in &raw_joints {
        joints.push(reader.joint(node, &by_name, &mut warnings)?);
    }
    let links: Vec<Link> = links.into_iter().map(|(link, _)| link).collect();
    let joint_names = reader.apart(
        "joint",
        joints
            .iter()
            .map(|j| (j.name.as_str(), j.identifier.as_str(), j.places.line)),
    )?;
    let mut mimics = Vec::new();
    for (node, joint) in raw_joints.iter().zip(&joints) {
        mimics.push(reader.mimic(*node, joint, &joint_names, &joints)?);
    }
    resolve_mimics(&mut joints, &mimics).map_err(|found| reader.tree(found))?;
    let (root_link, order) = reader.order(&links, &joints)?;
    Ok(Description {
        file: file.to_owned(),
        text: text.to_owned(),
        name: root.attribute("name").unwrap_or("robot").to_owned(),
        links,
        joints,
        root: root_link,
        order,
        warnings,
    })
}

struct Reader<'a> {
    file: &'a Path,
    text: &'a str,
    document: &'a Document<'a>,
}

impl<'a> Reader<'a> {
    fn line(&self, at: usize) -> u32 {
        self.document.text_pos_at(at).row
    }

    fn tree(&self, found: TreeFault) -> UrdfError {
        UrdfError::Tree {
            file: self.file.to_owned(),
            found,
        }
    }

    fn missing(
        &self,
        node: Node<'_, '_>,
        item: &str,
        what: &'static str,
        mend: &'static str,
    ) -> UrdfError {
        UrdfError::Missing {
            file: self.file.to_owned(),
            line: self.line(node.range().start),
            item: item.to_owned(),
            what,
            mend,
        }
    }

    fn value(
        &self,
        attribute: &Attribute<'_, '_>,
        item: &str,
        key: &'static str,
        mend: impl Into<String>,
    ) -> UrdfError {
        UrdfError::Value {
            file: self.file.to_owned(),
            line: self.line(attribute.range().start),
            item: item.to_owned(),
            key,
            value: attribute.value().to_owned(),
            mend: mend.into(),
        }
    }

    /// The child element of a name, at most one.
    fn child(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &'static str,
    ) -> Result<Option<Node<'a, 'a>>, UrdfError> {
        let mut found = node
            .children()
            .filter(|n| n.is_element() && n.tag_name().name() == name);
        let first = found.next();
        match found.next() {
            None => Ok(first),
            Some(second) => Err(UrdfError::Twice {
                file: self.file.to_owned(),
                line: self.line(second.range().start),
                item: item.to_owned(),
                what: name,
            }),
        }
    }

    /// Numbers of an attribute, `None` if it is not there.
    fn numbers<const N: usize>(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &str,
        key: &'static str,
    ) -> Result<Option<[f64; N]>, UrdfError> {
        let Some(attribute) = node.attribute_node(name) else {
            return Ok(None);
        };
        let value = attribute.value();
        if value.contains("${") {
            return Err(UrdfError::Xacro {
                file: self.file.to_owned(),
                line: self.line(attribute.range().start),
                found: value.to_owned(),
            });
        }
        let mut out = [0.0; N];
        let mut words = value.split_ascii_whitespace();
        for place in &mut out {
            *place = words
                .next()
                .and_then(|word| word.parse::<f64>().ok())
                .filter(|x| x.is_finite())
                .ok_or_else(|| self.value(&attribute, item, key, plural(N)))?;
        }
        match words.next() {
            None => Ok(Some(out)),
            Some(_) => Err(self.value(&attribute, item, key, plural(N))),
        }
    }

    fn number(
        &self,
        node: Node<'a, 'a>,
        item: &str,
        name: &str,
        key: &'static str,
    ) -> Result<Option<f64>, UrdfError> {
        Ok(self.numbers::<1>(node, item, name, key)?.map(|[x]| x))
    }

    fn name(&self, node: Node<'a, 'a>, item: &str) -> Result<&'a str, UrdfError> {
        node.attribute("name")
            .ok_or_else(|| self.missing(node, item, "name", "write name=\"…\""))
    }

    /// Indices by name; names must differ, and so must their identifiers.
    fn apart<'n>(
        &self,
        what: &'static str,
        all: impl Iterator<Item = (&'n str, &'n str, u32)>,
    ) -> Result<BTreeMap<String, usize>, UrdfError> {
        let mut names = BTreeMap::new();
        let mut identifiers: BTreeMap<&str, &str> = BTreeMap::new();
        for (index, (name, identifier, line)) in all.enumerate() {
            if let Some(other) = identifiers.insert(identifier, name) {
                return Err(UrdfError::Collision {
                    file: self.file.to_owned(),
                    line,
                    what,
                    name: name.to_owned(),
                    other: other.to_owned(),
                    identifier: identifier.to_owned(),
                });
            }
            names.insert(name.to_owned(), index);
        }
        Ok(names)
    }

    fn link(&self, node: Node<'a, 'a>) -> Result<(Link, u32), UrdfError> {
        let name = self.name(node, "a link")?;
        let item = format!("link `{name}`");
        let mut link = Link {
            name: name.to_owned(),
            identifier: names::identifier(name),
            inertial: None,
            places: Places::default(),
        };
        let line = self.line(node.range().start);
        let Some(inertial) = self.child(node, &item, "inertial")? else {
            return Ok((link, line));
        };
        let origin = self.child(inertial, &item, "origin")?;
        let mass = self.child(inertial, &item, "mass")?.ok_or_else(|| {
            self.missing(
                inertial,
                &item,
                "<mass>",
                "write <mass value=\"…\"/> in kg, or take <inertial> out",
            )
        })?;
        let (com, rpy) = match origin {
            None => ([0.0; 3], [0.0; 3]),
            Some(origin) => (
                self.numbers(origin, &item, "xyz", "inertial origin xyz")?
                    .unwrap_or_default(),
                self.numbers(origin, &item, "rpy", "inertial origin rpy")?
                    .unwrap_or_default(),
            ),
        };
        let mass_value = self
            .number(mass, &item, "value", "mass value")?
            .ok_or_else(|| {
                self.missing(mass, &item, "value of <mass>", "write value=\"…\" in kg")
            })?;
        let tensor = self.child(inertial, &item, "inertia")?;
        let mut entries = [0.0; 6];
        const KEYS: [(&str, &str); 6] = [
            ("ixx", "inertia ixx"),
            ("iyy", "inertia iyy"),
            ("izz", "inertia izz"),
            ("ixy", "inertia ixy"),
            ("ixz", "inertia ixz"),
            ("iyz", "inertia iyz"),
        ];
        for ((place, entry), (name, key)) in
            link.places.inertia.iter_mut().zip(&mut entries).zip(KEYS)
        {
            let Some(tensor) = tensor else { continue };
            *entry = self.number(tensor, &item, name, key)?.unwrap_or(0.0);
            *place = tensor.attribute_node(name).map(|a| a.range_value());
        }
        link.places.inside = Some(self.after_tag(inertial));
        link.places.origin = origin.map(|o| {
            (
                self.after_name(o),
                o.attribute_node("xyz").map(|a| a.range_value()),
            )
        });
        link.places.mass = mass.attribute_node("value").map(|a| a.range_value());
        link.places.inertia_tag = tensor.map(|t| self.after_name(t));

        // Placeholders without any mass are common on frames.
        if mass_value == 0.0 && entries == [0.0; 6] {
            return Ok((link, line));
        }
        plausible::check(mass_value, entries).map_err(|fault| UrdfError::Inertia {
            file: self.file.to_owned(),
            line: self.line(inertial.range().start),
            link: name.to_owned(),
            fault,
        })?;
        link.inertial = Some(Inertial {
            mass: mass_value,
            com,
            rpy,
            inertia: entries,
        });
        Ok((link, line))
    }

    /// The place after the name of a start tag, where attributes may be inserted.
    fn after_name(&self, node: Node<'_, '_>) -> usize {
        let start = node.range().start + 1;
        let rest = self.text.get(start..).unwrap_or("");
        start
            + rest
                .find(|c: char| c.is_ascii_whitespace() || c == '/' || c == '>')
                .unwrap_or(0)
    }

    /// The place after a start tag: before the first child, or, of an element without children,
    /// before its end tag. For an element written `<a/>` the place of its `/`.
    fn after_tag(&self, node: Node<'_, '_>) -> usize {
        if let Some(child) = node.first_child() {
            return child.range().start;
        }
        let range = node.range();
        let text = self.text.get(range.clone()).unwrap_or("");
        let end = if text.ends_with("/>") {
            Some(text.len() - 2)
        } else {
            text.rfind("</")
        };
        range.start + end.unwrap_or(0)
    }

    fn joint(
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

    fn unknown(
        &self,
        node: Node<'_, '_>,
        item: &str,
        what: &'static str,
        name: &str,
        known: &BTreeMap<String, usize>,
    ) -> UrdfError {
        // A name beyond some length is no slip of another, and the distance costs the product of
        // the lengths.
        let close = |n: &&String| n.len() < 200 && name.len() < 200;
        UrdfError::Unknown {
            file: self.file.to_owned(),
            line: self.line(node.range().start),
            item: item.to_owned(),
            what,
            name: name.to_owned(),
            nearest: known
                .keys()
                .filter(close)
                .map(|n| (strsim::osa_distance(name, n), n))
                .filter(|(distance, n)| *distance <= n.chars().count() / 2)
                .min()
                .map(|(_, n)| n.clone()),
        }
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

    fn mimic(
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

    /// The root, and the joints from it outwards in the order of the file.
    fn order(&self, links: &[Link], joints: &[Joint]) -> Result<(usize, Vec<usize>), UrdfError> {
        let mut carrier: Vec<Option<usize>> = vec![None; links.len()];
        for (index, joint) in joints.iter().enumerate() {
            if let Some(first) = carrier[joint.child].replace(index) {
                return Err(UrdfError::TwoParents {
                    file: self.file.to_owned(),
                    line: joint.places.line,
                    link: links[joint.child].name.clone(),
                    joint: joint.name.clone(),
                    first: joints[first].name.clone(),
                });
            }
        }
        let mut roots = (0..links.len()).filter(|&l| carrier[l].is_none());
        let Some(root) = roots.next() else {
            let found = match links.first() {
                None => TreeFault::Empty,
                Some(link) => TreeFault::NoRoot {
                    link: link.name.clone(),
                },
            };
            return Err(self.tree(found));
        };
        if let Some(second) = roots.next() {
            return Err(self.tree(TreeFault::TwoRoots {
                first: links[root].name.clone(),
                second: links[second].name.clone(),
            }));
        }
        let mut below: Vec<Vec<usize>> = vec![Vec::new(); links.len()];
        for (index, joint) in joints.iter().enumerate() {
            below[joint.parent].push(index);
        }
        let mut order = Vec::new();
        let mut stack: Vec<usize> = below[root].iter().rev().copied().collect();
        let mut reached = vec![false; links.len()];
        reached[root] = true;
        while let Some(joint) = stack.pop() {
            order.push(joint);
            let child = joints[joint].child;
            reached[child] = true;
            stack.extend(below[child].iter().rev());
        }
        match reached.iter().position(|reached| !reached) {
            None => Ok((root, order)),
            Some(link) => Err(self.tree(TreeFault::Loop {
                link: links[link].name.clone(),
                root: links[root].name.clone(),
            })),
        }
    }
}

fn plural(count: usize) -> String {
    match count {
        1 => "write one finite number".to_owned(),
        _ => format!("write {count} finite numbers with blanks between them"),
    }
}

/// Chains of joints that follow end at one that moves on its own.
fn resolve_mimics(joints: &mut [Joint], mimics: &[Option<Mimic>]) -> Result<(), TreeFault> {
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
