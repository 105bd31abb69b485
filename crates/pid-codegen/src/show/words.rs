//! Expressions in the words of `robot!`, each number with the unit that its place needs.

use pid_derive::model::{Expr, Func, JointKind, Robot};

use crate::si::Unit;
use crate::syntax::UnitExpr;

/// A robot that no declaration can state.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Unsaid {
    /// A name that the language does not take.
    #[error("`{name}` is no name in `robot!`\n  help: rename it to letters, digits and `_`")]
    Name {
        /// The name.
        name: String,
    },
    /// A unit that the language does not have.
    #[error("`{name}` is in `{unit}`, which is no unit of `robot!`")]
    Unit {
        /// The parameter or input.
        name: String,
        /// Its unit.
        unit: String,
    },
    /// Numbers whose unit cannot be found.
    #[error("the unit of a number in {place} cannot be found\n  help: declare it as a parameter")]
    Number {
        /// Where it stands.
        place: String,
    },
    /// A joint that stands at a value.
    #[error(
        "joint `{joint}` is held away from zero\n  help: declare it `fixed`, its place turned with `rpy`"
    )]
    Held {
        /// The joint.
        joint: String,
    },
}

/// Names and units of what an expression may hold.
pub(super) struct Words<'a> {
    params: Vec<(&'a str, Unit)>,
    inputs: Vec<(&'a str, Unit)>,
    /// Joints by coordinate, with the unit of their positions.
    joints: Vec<(&'a str, Unit)>,
    /// Parameters that are not declared: their entries are `_`, or their link is free.
    pub(super) absent: Vec<bool>,
}

/// How tightly a text holds together: what needs parentheses where.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Sum,
    Product,
    Atom,
}

impl<'a> Words<'a> {
    pub(super) fn new(robot: &'a Robot) -> Result<Self, Unsaid> {
        let named =
            |name: &'a String, unit: &String| Ok((name.as_str(), unit_of_text(name, unit)?));
        let params = robot.params.iter().map(|p| named(&p.name, &p.unit));
        let inputs = robot.inputs.iter().map(|u| named(&u.name, &u.unit));
        let moving = robot.joints.iter().filter(|j| j.coord.is_some());
        Ok(Self {
            params: params.collect::<Result<_, _>>()?,
            inputs: inputs.collect::<Result<_, _>>()?,
            joints: moving
                .map(|j| (j.name.as_str(), position(j.kind)))
                .collect(),
            absent: vec![false; robot.params.len()],
        })
    }

    /// Three entries: plain numbers share their unit.
    pub(super) fn vector(&self, e: &[Expr; 3], unit: &Unit, place: &str) -> Result<String, Unsaid> {
        let numbers: Vec<&f64> = e.iter().filter_map(number).collect();
        if numbers.len() == 3 {
            return Ok(format!("{numbers:?} {unit}"));
        }
        let entries: Result<Vec<String>, Unsaid> =
            e.iter().map(|e| self.entry(e, unit, place)).collect();
        Ok(format!("[{}]", entries?.join(", ")))
    }

    /// An entry of a link or vector; `_` for what does not enter.
    pub(super) fn entry(&self, e: &Expr, unit: &Unit, place: &str) -> Result<String, Unsaid> {
        match e {
            Expr::Blank(_) => Ok("_".to_owned()),
            Expr::Param(k) if self.absent[*k] => Ok("_".to_owned()),
            e => self.expression(e, unit, place),
        }
    }

    /// The expression as text, in this unit; `place` names it in errors.
    pub(super) fn expression(&self, e: &Expr, unit: &Unit, place: &str) -> Result<String, Unsaid> {
        match self.write(e, unit) {
            Some((text, _)) => Ok(text),
            None => Err(Unsaid::Number {
                place: place.to_owned(),
            }),
        }
    }

    /// The unit that the names of an expression give it; `None` where numbers leave it open.
    fn unit(&self, e: &Expr) -> Option<Unit> {
        let second = || Unit::of(&[("s", 1)]);
        match e {
            Expr::Num(_) | Expr::Blank(_) => None,
            Expr::Param(k) => Some(self.params[*k].1.clone()),
            Expr::Input(k) => Some(self.inputs[*k].1.clone()),
            Expr::Position(k) => Some(self.joints[*k].1.clone()),
            Expr::Velocity(k) => Some(self.joints[*k].1.div(&second())),
            Expr::Neg(x) => self.unit(x),
            Expr::Add(x, y) | Expr::Sub(x, y) => self.unit(x).or_else(|| self.unit(y)),
            Expr::Mul(x, y) => Some(self.unit(x)?.mul(&self.unit(y)?)),
            Expr::Div(x, y) => Some(self.unit(x)?.div(&self.unit(y)?)),
            Expr::Powi(x, n) => Some(self.unit(x)?.powi(*n)),
            Expr::Call(Func::Abs, x) => self.unit(x),
            Expr::Call(Func::Sqrt, x) => self.unit(x)?.root(2),
            Expr::Call(..) => Some(Unit::one()),
        }
    }

    fn write(&self, e: &Expr, unit: &Unit) -> Option<(String, Level)> {
        let atom = |text: String| Some((text, Level::Atom));
        match e {
            Expr::Num(x) => Some(literal(*x, unit)),
            Expr::Blank(_) => None,
            Expr::Param(k) => atom(self.params[*k].0.to_owned()),
            Expr::Input(k) => atom(self.inputs[*k].0.to_owned()),
            Expr::Position(k) => atom(format!("q.{}", self.joints[*k].0)),
            Expr::Velocity(k) => atom(format!("v.{}", self.joints[*k].0)),
            Expr::Neg(x) => {
                let text = self.at(x, unit, Level::Atom)?;
                Some((format!("-{text}"), Level::Sum))
            }
            Expr::Add(x, y) => {
                let (x, y) = (
                    self.at(x, unit, Level::Sum)?,
                    self.at(y, unit, Level::Product)?,
                );
                Some((format!("{x} + {y}"), Level::Sum))
            }
            Expr::Sub(x, y) => {
                let (x, y) = (
                    self.at(x, unit, Level::Sum)?,
                    self.at(y, unit, Level::Product)?,
                );
                Some((format!("{x} - {y}"), Level::Sum))
            }
            Expr::Mul(x, y) => {
                let (left, right) = match (self.unit(x), self.unit(y)) {
                    (Some(left), Some(right)) => (left, right),
                    (None, Some(right)) => (unit.div(&right), right),
                    (Some(left), None) => (left.clone(), unit.div(&left)),
                    (None, None) => (unit.clone(), Unit::one()),
                };
                let x = self.at(x, &left, Level::Product)?;
                let y = self.at(y, &right, Level::Atom)?;
                Some((format!("{x}*{y}"), Level::Product))
            }
            Expr::Div(x, y) => {
                let (above, below) = match (self.unit(x), self.unit(y)) {
                    (Some(above), Some(below)) => (above, below),
                    (None, Some(below)) => (unit.mul(&below), below),
                    (Some(above), None) => (above.clone(), above.div(unit)),
                    (None, None) => (unit.clone(), Unit::one()),
                };
                let x = self.at(x, &above, Level::Product)?;
                let y = self.at(y, &below, Level::Atom)?;
                Some((format!("{x}/{y}"), Level::Product))
            }
            Expr::Powi(x, n) => {
                let base = self.unit(x).or_else(|| unit.root(*n))?;
                atom(format!("{}^{n}", self.base(x, &base)?))
            }
            Expr::Call(f, x) => {
                let argument = match f {
                    Func::Abs => unit.clone(),
                    Func::Sqrt => unit.powi(2),
                    _ => Unit::one(),
                };
                let argument = self.unit(x).unwrap_or(argument);
                atom(format!("{}({})", name(*f), self.write(x, &argument)?.0))
            }
        }
    }

    /// In parentheses where it holds together less tightly than `least`.
    fn at(&self, e: &Expr, unit: &Unit, least: Level) -> Option<String> {
        let (text, level) = self.write(e, unit)?;
        Some(match level < least {
            true => format!("({text})"),
            false => text,
        })
    }

    /// What a power is of: a power of a power needs parentheses.
    fn base(&self, e: &Expr, unit: &Unit) -> Option<String> {
        match e {
            Expr::Powi(..) => Some(format!("({})", self.write(e, unit)?.0)),
            e => self.at(e, unit, Level::Atom),
        }
    }
}

/// A number; one with a unit or a sign stands in parentheses within a product, since a name behind
/// it may be that of a unit.
fn literal(x: f64, unit: &Unit) -> (String, Level) {
    let text = unit.to_string();
    let plain = unit.is_dimensionless() && text.starts_with('1');
    let level = match (plain, x.is_sign_negative()) {
        (true, false) => Level::Atom,
        _ => Level::Sum,
    };
    match plain {
        true => (format!("{x:?}"), level),
        false => (format!("{x:?} {text}"), level),
    }
}

fn name(f: Func) -> &'static str {
    match f {
        Func::Sin => "sin",
        Func::Cos => "cos",
        Func::Tan => "tan",
        Func::Tanh => "tanh",
        Func::Atan => "atan",
        Func::Exp => "exp",
        Func::Ln => "ln",
        Func::Sqrt => "sqrt",
        Func::Abs => "abs",
        Func::Sign => "sign",
    }
}

/// A unit as [`Unit`]'s own `Display` writes it.
fn unit_of_text(name: &str, text: &str) -> Result<Unit, Unsaid> {
    let read = UnitExpr::of_text(text).and_then(|u| {
        u.factors.iter().try_fold(Unit::one(), |unit, (name, n)| {
            Some(unit.mul(&Unit::named(&name.to_string())?.powi(*n)))
        })
    });
    let unknown = || Unsaid::Unit {
        name: name.to_owned(),
        unit: text.to_owned(),
    };
    let mut unit = read.ok_or_else(unknown)?;
    // Values of a resolved robot are in SI.
    unit.scale = 1.0;
    Ok(unit)
}

/// Unit of a position.
pub(super) fn position(kind: JointKind) -> Unit {
    Unit::of(&[(if kind.is_length() { "m" } else { "rad" }, 1)])
}

fn number(e: &Expr) -> Option<&f64> {
    match e {
        Expr::Num(x) => Some(x),
        _ => None,
    }
}
