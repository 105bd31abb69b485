//! A resolved robot as the text of a declaration: `robot!` makes the same equations of it.
//!
//! Units of numbers were dropped when the robot was resolved. Each is found again from the units of
//! the names beside it and from that of its place. Entries of links that do not enter the equations
//! become `_`.

use std::fmt::Write as _;

use pid_derive::model::{Affine, Emit, Expr, Input, Joint, JointKind, Motor, Param, Robot};

use super::links;
use super::words::{Unsaid, Words, position};
use crate::si::Unit;

/// The declaration of a robot, `pub robot Name { … }`, with further items at its end.
///
/// # Errors
/// [`Unsaid`].
pub fn declaration(robot: &Robot, items: &str) -> Result<String, Unsaid> {
    let writer = Writer::new(robot)?;
    let mut out = docs(&robot.docs, "");
    // Parameters that only combinations of enter are a warning; the robot is as it was.
    out.push_str("#[allow(deprecated)]\n");
    let _ = writeln!(out, "pub robot {} {{", writer.name(&robot.name)?);
    writer.parameters(&mut out)?;
    match &robot.lagrangian {
        None => writer.tree(&mut out)?,
        Some(_) => writer.coordinates(&mut out)?,
    }
    writer.energies(&mut out)?;
    writer.drives(&mut out)?;
    for item in items.lines() {
        let indent = if item.is_empty() { "" } else { "    " };
        let _ = writeln!(out, "{indent}{item}");
    }
    let _ = writeln!(out, "    emit {{ {} }}", emitted(&robot.emit));
    out.push_str("}\n");
    Ok(out)
}

fn emitted(emit: &Emit) -> String {
    let parts = [
        (true, "dynamics"),
        (emit.first_derivatives, "first_derivatives"),
        (emit.second_derivatives, "second_derivatives"),
        (emit.regressor, "regressor"),
        (emit.base_parameters, "base_parameters"),
        (emit.lanes, "lanes"),
    ];
    let asked = parts.iter().filter(|(asked, _)| *asked);
    asked.map(|(_, word)| *word).collect::<Vec<_>>().join(", ")
}

fn docs(lines: &[String], indent: &str) -> String {
    let lines = lines.iter().flat_map(|l| l.lines());
    lines.map(|line| format!("{indent}///{line}\n")).collect()
}

struct Writer<'a> {
    robot: &'a Robot,
    words: Words<'a>,
}

impl<'a> Writer<'a> {
    fn new(robot: &'a Robot) -> Result<Self, Unsaid> {
        let mut words = Words::new(robot)?;
        words.absent = links::absent(robot);
        Ok(Self { robot, words })
    }

    fn name<'n>(&self, name: &'n str) -> Result<&'n str, Unsaid> {
        match syn::parse_str::<syn::Ident>(name) {
            Ok(_) => Ok(name),
            Err(_) => Err(Unsaid::Name {
                name: name.to_owned(),
            }),
        }
    }

    fn parameters(&self, out: &mut String) -> Result<(), Unsaid> {
        let all = self.robot.params.iter().zip(&self.words.absent);
        let said: Vec<&Param> = all.filter(|(_, absent)| !**absent).map(|p| p.0).collect();
        if said.is_empty() {
            return Ok(());
        }
        out.push_str("    params {\n");
        for p in said {
            out.push_str(&docs(&p.docs, "        "));
            let (name, unit, nominal) = (self.name(&p.name)?, &p.unit, p.nominal);
            let end = |x: f64| match x.is_finite() {
                true => format!("{x:?}"),
                false => String::new(),
            };
            let range = match (p.lower < p.upper, p.upper.is_finite()) {
                (true, true) => format!(" in {}..={:?}", end(p.lower), p.upper),
                (true, false) if p.lower.is_finite() => format!(" in {:?}..", p.lower),
                _ => String::new(),
            };
            let fixed = if p.fixed { " fixed" } else { "" };
            let _ = writeln!(out, "        {name}: {unit} = {nominal:?}{range}{fixed};");
        }
        out.push_str("    }\n");
        Ok(())
    }

    /// Gravity, links and joints.
    fn tree(&self, out: &mut String) -> Result<(), Unsaid> {
        let acceleration = Unit::of(&[("m", 1), ("s", -2)]);
        let gravity = self
            .words
            .vector(&self.robot.gravity, &acceleration, "gravity")?;
        let _ = writeln!(out, "    gravity: {gravity};");
        for link in &self.robot.links {
            out.push_str(&docs(&link.docs, "    "));
            let body = links::body(self.robot, &self.words, link)?;
            let _ = writeln!(out, "    link {} {{{body} }}", self.name(&link.name)?);
        }
        for joint in &self.robot.joints {
            out.push_str(&docs(&joint.docs, "    "));
            self.joint(joint, out)?;
        }
        Ok(())
    }

    fn joint(&self, joint: &Joint, out: &mut String) -> Result<(), Unsaid> {
        let place = format!("joint `{}`", joint.name);
        let unit = position(joint.kind);
        let follows = joint.follows.as_ref().filter(|_| joint.coord.is_none());
        let held = follows.filter(|f| f.terms.is_empty());
        if held.is_some_and(|f| f.offset != Expr::Num(0.0)) {
            return Err(Unsaid::Held {
                joint: joint.name.clone(),
            });
        }
        let kind = match joint.kind {
            _ if held.is_some() => "fixed".to_owned(),
            JointKind::Revolute(axis) => format!("revolute about {}", direction(axis)),
            JointKind::Prismatic(axis) => format!("prismatic along {}", direction(axis)),
            _ => "fixed".to_owned(),
        };
        let parent = joint
            .parent
            .map_or("base", |k| self.robot.links[k].name.as_str());
        let child = &self.robot.links[joint.child].name;
        let mut edge = format!("{parent} -> {child}");
        let zero = |e: &[Expr; 3]| e.iter().all(|e| *e == Expr::Num(0.0));
        let at = [
            ("at", &joint.origin, Unit::of(&[("m", 1)])),
            ("rpy", &joint.rpy, Unit::of(&[("rad", 1)])),
        ];
        for (word, vector, unit) in at.iter().filter(|(_, v, _)| !zero(v)) {
            let _ = write!(edge, " {word} {}", self.words.vector(vector, unit, &place)?);
        }
        edge.push(';');
        if let Some(follows) = follows.filter(|_| held.is_none()) {
            let _ = write!(edge, " follows {};", self.affine(follows, &unit, &place)?);
        }
        if let Some(limits) = joint.limits.filter(|_| held.is_none()) {
            let _ = write!(edge, " limits: {};", range(limits, &unit));
        }
        let name = self.name(&joint.name)?;
        let _ = writeln!(out, "    joint {name}: {kind} {{ {edge} }}");
        Ok(())
    }

    /// A combination of joints by their bare names.
    fn affine(&self, affine: &Affine, unit: &Unit, place: &str) -> Result<String, Unsaid> {
        let coordinates: Vec<&Joint> = self.moving().collect();
        let mut text = String::new();
        for (coord, ratio) in &affine.terms {
            let joint = coordinates[*coord];
            let sign = if text.is_empty() { "" } else { " + " };
            let ratio = match ratio {
                Expr::Num(1.0) => String::new(),
                ratio => {
                    let per = unit.div(&position(joint.kind));
                    format!("({})*", self.words.expression(ratio, &per, place)?)
                }
            };
            let _ = write!(text, "{sign}{ratio}{}", joint.name);
        }
        if affine.offset != Expr::Num(0.0) {
            let offset = self.words.expression(&affine.offset, unit, place)?;
            let _ = write!(text, " + ({offset})");
        }
        Ok(text)
    }

    fn coordinates(&self, out: &mut String) -> Result<(), Unsaid> {
        let mut all = Vec::new();
        for joint in &self.robot.joints {
            let unit = position(joint.kind);
            let limits = joint.limits.map_or_else(String::new, |limits| {
                format!(" in {}", range(limits, &unit))
            });
            let name = self.name(&joint.name)?;
            let docs = docs(&joint.docs, "        ");
            all.push(format!("{docs}        {name}: {unit}{limits}"));
        }
        let _ = writeln!(out, "    coordinates\n{};", all.join(",\n"));
        Ok(())
    }

    fn energies(&self, out: &mut String) -> Result<(), Unsaid> {
        let joule = Unit::of(&[("J", 1)]);
        if let Some(e) = &self.robot.lagrangian {
            let text = self.words.expression(e, &joule, "the Lagrangian")?;
            let _ = writeln!(out, "    lagrangian = {text};");
        }
        if let Some(e) = &self.robot.potential {
            let text = self.words.expression(e, &joule, "the potential")?;
            let _ = writeln!(out, "    potential += {text};");
        }
        Ok(())
    }

    fn moving(&self) -> impl Iterator<Item = &'a Joint> {
        self.robot.joints.iter().filter(|j| j.coord.is_some())
    }

    /// Inputs, armatures and forces of joints and motors.
    fn drives(&self, out: &mut String) -> Result<(), Unsaid> {
        let mut owned = vec![false; self.robot.inputs.len()];
        let mut of_joints = Vec::new();
        for joint in self.moving() {
            let own = self.inputs_of(&joint.name, &mut owned, |u| u.coord == joint.coord);
            let (armature, force) = (joint.armature.as_ref(), joint.force.as_ref());
            let block = self.block((&joint.name, &own), (armature, force), joint.kind)?;
            if !block.is_empty() {
                let text = format!("    per joint {} {{\n{block}    }}\n", joint.name);
                let mut all = self.robot.inputs.iter();
                let place = all.position(|u| own.first().is_some_and(|o| std::ptr::eq(o.1, u)));
                of_joints.push((place.unwrap_or(usize::MAX), text));
            }
        }
        // Inputs are numbered as they are declared.
        of_joints.sort_by_key(|(place, _)| *place);
        let mut blocks: String = of_joints.into_iter().map(|(_, text)| text).collect();
        for motor in &self.robot.motors {
            blocks.push_str(&docs(&motor.docs, "    "));
            self.motor(motor, &mut owned, &mut blocks)?;
        }
        let all = self.robot.inputs.iter().zip(owned);
        for (input, _) in all.filter(|(_, owned)| !owned) {
            let name = self.name(&input.name)?;
            out.push_str(&docs(&input.docs, "    "));
            let _ = writeln!(out, "    input {name}: {};", input.unit);
        }
        out.push_str(&blocks);
        Ok(())
    }

    /// Inputs that a joint or motor declares: `robot!` adds its name to theirs.
    fn inputs_of(
        &self,
        name: &str,
        owned: &mut [bool],
        holds: impl Fn(&Input) -> bool,
    ) -> Vec<(&'a str, &'a Input)> {
        let suffix = format!("_{name}");
        let mut out = Vec::new();
        for (k, input) in self.robot.inputs.iter().enumerate() {
            let stem = input.name.strip_suffix(&suffix);
            if let Some(stem) = stem.filter(|_| !owned[k] && holds(input)) {
                owned[k] = true;
                out.push((stem, input));
            }
        }
        out
    }

    fn motor(&self, motor: &Motor, owned: &mut [bool], out: &mut String) -> Result<(), Unsaid> {
        let place = format!("motor `{}`", motor.name);
        let own = self.inputs_of(&motor.name, owned, |_| true);
        // As the language has it: a motor moves as the first joint that it turns.
        let first = motor.moves.terms.first();
        let kind = first
            .and_then(|(coord, _)| self.moving().nth(*coord))
            .map_or(JointKind::Angle, |joint| joint.kind);
        let moves = self.affine(&motor.moves, &position(kind), &place)?;
        let parts = (motor.armature.as_ref(), motor.force.as_ref());
        let block = self.block((&motor.name, &own), parts, kind)?;
        let name = self.name(&motor.name)?;
        let _ = writeln!(out, "    motor {name}: {moves} {{\n{block}    }}");
        Ok(())
    }

    fn block(
        &self,
        (name, inputs): (&str, &[(&str, &Input)]),
        (armature, force): (Option<&Expr>, Option<&Expr>),
        kind: JointKind,
    ) -> Result<String, Unsaid> {
        let place = format!("a force on `{name}`");
        let mut out = String::new();
        for (stem, input) in inputs {
            out.push_str(&docs(&input.docs, "        "));
            let _ = writeln!(out, "        input {}: {};", self.name(stem)?, input.unit);
        }
        let (newton, metre) = (Unit::of(&[("N", 1)]), Unit::of(&[("m", 1)]));
        let kg = Unit::of(&[("kg", 1)]);
        let (force_unit, inertia_unit) = match kind.is_length() {
            true => (newton, kg),
            false => (newton.mul(&metre), kg.mul(&metre.powi(2))),
        };
        if let Some(e) = armature {
            let text = self.words.expression(e, &inertia_unit, &place)?;
            let _ = writeln!(out, "        armature = {text};");
        }
        if let Some(e) = force {
            let text = self.words.expression(e, &force_unit, &place)?;
            let _ = writeln!(out, "        force = {text};");
        }
        Ok(out)
    }
}

fn range((low, high): (f64, f64), unit: &Unit) -> String {
    let end = |x: f64| match x.is_finite() {
        true => format!("{x:?}"),
        false => String::new(),
    };
    match high.is_finite() {
        true => format!("{}..={high:?} {unit}", end(low)),
        false => format!("{}.. {unit}", end(low)),
    }
}

fn direction(axis: [f64; 3]) -> String {
    let unit = |k: usize| std::array::from_fn(|i| f64::from(u8::from(i == k)));
    match (0..3).find(|&k| axis == unit(k)) {
        Some(k) => ["x", "y", "z"][k].to_owned(),
        None => format!("{axis:?}"),
    }
}
