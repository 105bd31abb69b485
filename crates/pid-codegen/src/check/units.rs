//! Units: every quantity gets one, and every use is compared with the unit that its place needs.

use crate::diag::{Diagnostics, Loc, nearest};
use crate::si::{Unit, unit_names};
use crate::syntax::{Entry, Expr, ExprKind, Op, Range, UnitExpr};
use pid_derive::model::{self, Func};

use super::meaning::{FUNCTIONS, Meaning, Scope};
use super::moves::Moves;
use super::names::Symbols;
use super::numbers::constant;

/// An expression with its unit.
#[derive(Debug, Clone)]
pub struct Typed {
    /// The expression, SI.
    pub expr: model::Expr,
    /// Its unit.
    pub unit: Unit,
    /// A constant written without any unit.
    pub bare: bool,
}

/// The requirement of a place.
#[derive(Debug, Clone)]
pub struct Role {
    /// "mass of link `fore`".
    pub what: String,
    /// Its unit.
    pub unit: Unit,
}

/// Finds units. Parameters and inputs with an unknown unit are `None`; expressions that use them
/// get no further message.
#[derive(Debug)]
pub struct Units<'a> {
    symbols: &'a Symbols<'a>,
    /// Unit of each parameter as declared, with its scale.
    pub params: Vec<Option<Unit>>,
    /// Unit of each input as declared.
    pub inputs: Vec<Option<Unit>>,
    /// Motion of each joint, then of each motor; unknown if fixed, or after an error.
    pub moves: Vec<Option<Moves>>,
}

/// The unit as written, or an error at the name that is none.
pub fn unit(u: &UnitExpr, diag: &mut Diagnostics) -> Option<Unit> {
    let mut out = Some(Unit::one());
    for (name, n) in &u.factors {
        let text = name.to_string();
        match Unit::named(&text) {
            Some(f) => out = out.map(|o| o.mul(&f.powi(*n))),
            None => {
                let help = match text.as_str() {
                    "Nm" => "write `N*m`".to_string(),
                    "Nms" => "write `N*m*s/rad`".to_string(),
                    "kgm2" => "write `kg*m^2`".to_string(),
                    "ohm" | "Ω" => "write `Ohm`".to_string(),
                    "degrees" | "degree" => "write `deg`".to_string(),
                    "sec" | "second" | "seconds" => "write `s`".to_string(),
                    _ => match nearest(&text, unit_names()) {
                        Some(n) if text.len() > 1 => format!("did you mean `{n}`?"),
                        _ => "use `kg`, `m`, `s`, `A`, `K`, `rad`, `deg`, `N`, `J`, `W`, `V` and `*`, `/`, `^`; `1` for a number".to_string(),
                    },
                };
                diag.error(name, format!("unknown unit `{text}`\nhelp: {help}"));
                out = None;
            }
        }
    }
    out
}

impl<'a> Units<'a> {
    /// Units of everything declared; `params` and `inputs` as resolved from the declarations.
    /// `moves` is still unknown.
    pub fn new(
        symbols: &'a Symbols<'a>,
        params: Vec<Option<Unit>>,
        inputs: Vec<Option<Unit>>,
    ) -> Self {
        Units {
            symbols,
            params,
            inputs,
            moves: vec![None; symbols.joints.len() + symbols.motors.len()],
        }
    }

    fn meaning(&self, m: Meaning) -> Option<Typed> {
        let si = |u: &Option<Unit>| {
            u.clone().map(|mut u| {
                u.scale = 1.0;
                u
            })
        };
        let (expr, unit) = match m {
            Meaning::Param(k) => (model::Expr::Param(k), si(&self.params[k])?),
            Meaning::Input(k) => (model::Expr::Input(k), si(&self.inputs[k])?),
            Meaning::Position(j) => (self.moves[j].as_ref()?.position.clone(), self.position(j)),
            Meaning::Velocity(j) => (
                self.moves[j].as_ref()?.velocity.clone(),
                self.position(j).div(&Unit::of(&[("s", 1)])),
            ),
            Meaning::Pi => {
                return Some(Typed {
                    expr: model::Expr::Num(std::f64::consts::PI),
                    unit: Unit::one(),
                    bare: true,
                });
            }
        };
        Some(Typed {
            expr,
            unit,
            bare: false,
        })
    }

    fn is_length(&self, joint: usize) -> bool {
        self.moves[joint].as_ref().is_some_and(|m| m.length)
    }

    /// Unit of the position of a joint or motor.
    pub fn position(&self, joint: usize) -> Unit {
        Unit::of(&[(if self.is_length(joint) { "m" } else { "rad" }, 1)])
    }

    /// Unit of the generalised force on a joint or motor.
    pub fn force(&self, joint: usize) -> Unit {
        match self.is_length(joint) {
            true => Unit::of(&[("N", 1)]),
            false => Unit::of(&[("N", 1), ("m", 1)]),
        }
    }

    /// Unit of the inertia of a joint or motor.
    pub fn armature(&self, joint: usize) -> Unit {
        match self.is_length(joint) {
            true => Unit::of(&[("kg", 1)]),
            false => Unit::of(&[("kg", 1), ("m", 2)]),
        }
    }

    /// Expression and unit; `None` after an error, reported here or, for names, before.
    pub fn expr(&self, e: &Expr, scope: Scope, diag: &mut Diagnostics) -> Option<Typed> {
        match &e.kind {
            ExprKind::Number(x, None) => Some(Typed {
                expr: model::Expr::Num(*x),
                unit: Unit::one(),
                bare: true,
            }),
            ExprKind::Number(x, Some(u)) => {
                let mut unit = unit(u, diag)?;
                let value = x * unit.scale;
                unit.scale = 1.0;
                Some(Typed {
                    expr: model::Expr::Num(value),
                    unit,
                    bare: false,
                })
            }
            ExprKind::Name(name) => self.meaning(self.symbols.lookup(name, scope)?),
            ExprKind::Member(what, joint) => self.meaning(self.symbols.member(what, joint)?),
            ExprKind::Neg(x) => {
                let x = self.expr(x, scope, diag)?;
                Some(Typed {
                    expr: negated(x.expr),
                    ..x
                })
            }
            ExprKind::Binary(op, at, a, b) => {
                let (ta, tb) = (self.expr(a, scope, diag), self.expr(b, scope, diag));
                let (ta, tb) = (ta?, tb?);
                let unit = match op {
                    Op::Mul => ta.unit.mul(&tb.unit),
                    Op::Div => ta.unit.div(&tb.unit),
                    Op::Add | Op::Sub => sum_unit((*at).into(), (a, &ta), (b, &tb), *op, diag)?,
                };
                let bare = ta.bare && tb.bare;
                let (x, y) = (Box::new(ta.expr), Box::new(tb.expr));
                let expr = match op {
                    Op::Add => model::Expr::Add(x, y),
                    Op::Sub => model::Expr::Sub(x, y),
                    Op::Mul => model::Expr::Mul(x, y),
                    Op::Div => model::Expr::Div(x, y),
                };
                Some(Typed { expr, unit, bare })
            }
            ExprKind::Pow(x, n) => {
                let x = self.expr(x, scope, diag)?;
                Some(Typed {
                    unit: x.unit.powi(*n),
                    expr: model::Expr::Powi(Box::new(x.expr), *n),
                    bare: x.bare,
                })
            }
            ExprKind::Call(f, args) => {
                let name = f.to_string();
                let func = FUNCTIONS.iter().find(|k| k.0 == name)?.1;
                let arg = args.first()?;
                self.call(func, &name, arg, scope, diag)
            }
        }
    }

    fn call(
        &self,
        func: Func,
        name: &str,
        arg: &Expr,
        scope: Scope,
        diag: &mut Diagnostics,
    ) -> Option<Typed> {
        let x = self.expr(arg, scope, diag)?;
        let unit = match func {
            Func::Abs => x.unit.clone(),
            Func::Sign => Unit::one(),
            Func::Sqrt => match x.unit.sqrt() {
                Some(u) => u,
                None => {
                    diag.error(
                        arg.loc,
                        format!(
                            "`sqrt` needs a unit with even exponents; `{arg}` has unit `{}`",
                            x.unit
                        ),
                    );
                    return None;
                }
            },
            _ if x.unit.is_dimensionless() => Unit::one(),
            _ => {
                let help = match &arg.kind {
                    ExprKind::Name(n) => format!(
                        "\nhelp: divide it by a parameter in `{}`, or multiply it: `50 {} * {n}`",
                        x.unit,
                        Unit::one().div(&x.unit)
                    ),
                    ExprKind::Binary(Op::Mul, _, a, b) => match &a.kind {
                        ExprKind::Number(k, None) => {
                            format!(
                                "\nhelp: give the number its unit: `{k} {} * {b}`",
                                Unit::one().div(&x.unit)
                            )
                        }
                        _ => String::new(),
                    },
                    _ => String::new(),
                };
                diag.error(
                    arg.loc,
                    format!(
                        "argument of `{name}` must be dimensionless; `{arg}` has unit `{}`{help}",
                        x.unit
                    ),
                );
                return None;
            }
        };
        Some(Typed {
            expr: model::Expr::Call(func, Box::new(x.expr)),
            unit,
            bare: x.bare,
        })
    }

    /// An entry of a mass, vector or tensor; bare numbers in it take the `trailing` unit. Not for `_`.
    pub fn entry(
        &self,
        e: &Expr,
        scope: Scope,
        role: &Role,
        trailing: Option<&Unit>,
        diag: &mut Diagnostics,
    ) -> Option<model::Expr> {
        let t = self.expr(e, scope, diag)?;
        if t.bare {
            let value = constant(&t.expr)?;
            return match trailing {
                Some(u) => Some(model::Expr::Num(value * u.scale)),
                None if value == 0.0 || role.unit == Unit::one() => Some(model::Expr::Num(value)),
                None => {
                    diag.error(
                        e.loc,
                        format!(
                            "{} must be in `{}`, but `{e}` has no unit\nhelp: write {}",
                            role.what,
                            role.unit,
                            match role.unit.is_dimensionless() {
                                true => format!("`{e} rad` or `{e} deg`"),
                                false => format!("`{e} {}`", role.unit),
                            }
                        ),
                    );
                    None
                }
            };
        }
        if t.unit.same_dims(&role.unit) {
            return Some(t.expr);
        }
        let message = format!(
            "{} must be in `{}`, but `{e}` is in `{}`",
            role.what, role.unit, t.unit
        );
        match self.declaration(e, scope) {
            Some((at, name, unit)) => diag.error2(
                e.loc,
                message,
                at,
                format!("`{name}` is declared in `{unit}` here"),
            ),
            None => diag.error(e.loc, message),
        }
        None
    }

    /// The unit that follows a list, which must be that of its role.
    pub fn trailing(
        &self,
        u: Option<&UnitExpr>,
        role: &Role,
        diag: &mut Diagnostics,
    ) -> Option<Option<Unit>> {
        let Some(u) = u else { return Some(None) };
        let found = unit(u, diag)?;
        if found.same_dims(&role.unit) {
            return Some(Some(found));
        }
        diag.error(
            u.loc,
            format!("{} must be in `{}`, found `{u}`", role.what, role.unit),
        );
        None
    }

    /// A force law or an energy: each of its terms must be one.
    pub fn law(
        &self,
        e: &Expr,
        scope: Scope,
        role: &Role,
        diag: &mut Diagnostics,
    ) -> Option<model::Expr> {
        let mut terms = Vec::new();
        flatten(e, false, &mut terms);
        let mut sum: Option<model::Expr> = None;
        let mut ok = true;
        for (term, minus) in terms {
            let Some(t) = self.expr(term, scope, diag) else {
                ok = false;
                continue;
            };
            let zero = t.bare && constant(&t.expr) == Some(0.0);
            if !zero && !t.unit.same_dims(&role.unit) {
                self.wrong_term(term, &t, scope, role, diag);
                ok = false;
                continue;
            }
            sum = Some(match (sum, minus) {
                (None, false) => t.expr,
                (None, true) => negated(t.expr),
                (Some(s), false) => model::Expr::Add(Box::new(s), Box::new(t.expr)),
                (Some(s), true) => model::Expr::Sub(Box::new(s), Box::new(t.expr)),
            });
        }
        sum.filter(|_| ok)
    }

    fn wrong_term(
        &self,
        term: &Expr,
        t: &Typed,
        scope: Scope,
        role: &Role,
        diag: &mut Diagnostics,
    ) {
        if t.bare {
            diag.error(
                term.loc,
                format!(
                    "`{term}` has no unit, but {} is in `{}`\nhelp: write `{term} {}`",
                    role.what, role.unit, role.unit
                ),
            );
            return;
        }
        let mut message = format!(
            "`{term}` has unit `{}`, but {} is in `{}`",
            t.unit, role.what, role.unit
        );
        let mut factors = Vec::new();
        factors_of(term, &mut factors);
        let suspect = factors
            .iter()
            .find_map(|f| self.declaration(f, scope).map(|d| (*f, d)));
        let Some((factor, (at, name, unit))) = suspect else {
            diag.error(term.loc, message);
            return;
        };
        let needed = role.unit.div(&t.unit.div(&unit));
        let dry = factors.iter().find_map(|f| match &f.kind {
            ExprKind::Call(g, _) if g == "tanh" || g == "sign" => Some(g.to_string()),
            _ => None,
        });
        let help = match dry {
            Some(g)
                if matches!(scope, Scope::Force(_))
                    && needed.to_string() == role.unit.to_string() =>
            {
                format!("a factor of `{g}(..)` is dry friction and should be in `{needed}`")
            }
            _ => format!("`{factor}` would have to be in `{needed}`"),
        };
        message.push_str("\nhelp: ");
        message.push_str(&help);
        diag.error2(
            term.loc,
            message,
            at,
            format!("`{name}` is declared in `{unit}` here"),
        );
    }

    /// Place, name and unit of the parameter or input that `e` is.
    fn declaration(&self, e: &Expr, scope: Scope) -> Option<(proc_macro2::Span, String, Unit)> {
        let ExprKind::Name(name) = &e.kind else {
            return None;
        };
        match self.symbols.lookup(name, scope)? {
            Meaning::Param(k) => Some((
                self.symbols.params[k].decl,
                name.to_string(),
                self.params[k].clone()?,
            )),
            Meaning::Input(k) => Some((
                self.symbols.inputs[k].decl.name.span(),
                name.to_string(),
                self.inputs[k].clone()?,
            )),
            _ => None,
        }
    }

    /// Ends of a range in SI; an open end is infinite.
    pub fn range(
        &self,
        r: &Range,
        role: &Role,
        default: Option<&Unit>,
        diag: &mut Diagnostics,
    ) -> Option<(f64, f64)> {
        let own = self.trailing(r.unit.as_ref(), role, diag)?;
        let unit = own.as_ref().or(default);
        let mut end = |e: &Option<Expr>, open: f64| match e {
            None => Some(open),
            Some(e) => {
                let value = self.entry(e, Scope::Constant("a range"), role, unit, diag)?;
                finite(constant(&value)?, e, diag)
            }
        };
        let lo = end(&r.lo, f64::NEG_INFINITY);
        let hi = end(&r.hi, f64::INFINITY);
        Some((lo?, hi?))
    }
}

/// The value, or an error if it is not finite (a division by zero, the logarithm of a negative number).
pub fn finite(x: f64, e: &Expr, diag: &mut Diagnostics) -> Option<f64> {
    if x.is_finite() {
        return Some(x);
    }
    diag.error(e.loc, format!("`{e}` is {x}, not a finite number"));
    None
}

fn negated(e: model::Expr) -> model::Expr {
    match e {
        model::Expr::Num(x) => model::Expr::Num(-x),
        e => model::Expr::Neg(Box::new(e)),
    }
}

fn sum_unit(
    at: Loc,
    (a, ta): (&Expr, &Typed),
    (b, tb): (&Expr, &Typed),
    op: Op,
    diag: &mut Diagnostics,
) -> Option<Unit> {
    let zero = |t: &Typed| t.bare && constant(&t.expr) == Some(0.0);
    if zero(ta) {
        return Some(tb.unit.clone());
    }
    if zero(tb) || ta.unit.same_dims(&tb.unit) {
        return Some(ta.unit.clone());
    }
    let verb = match op {
        Op::Sub => "subtract",
        _ => "add",
    };
    let mut e = at.error(format!("cannot {verb} `{}` and `{}`", ta.unit, tb.unit));
    e.combine(a.loc.error(format!("`{a}` is in `{}`", ta.unit)));
    e.combine(b.loc.error(format!("`{b}` is in `{}`", tb.unit)));
    diag.push(e);
    None
}

/// Terms of a sum with their signs.
fn flatten<'e>(e: &'e Expr, minus: bool, out: &mut Vec<(&'e Expr, bool)>) {
    match &e.kind {
        ExprKind::Binary(Op::Add, _, a, b) => {
            flatten(a, minus, out);
            flatten(b, minus, out);
        }
        ExprKind::Binary(Op::Sub, _, a, b) => {
            flatten(a, minus, out);
            flatten(b, !minus, out);
        }
        ExprKind::Neg(x) => flatten(x, !minus, out),
        _ => out.push((e, minus)),
    }
}

/// Factors of a product, signs dropped; numerators only.
fn factors_of<'e>(e: &'e Expr, out: &mut Vec<&'e Expr>) {
    match &e.kind {
        ExprKind::Binary(Op::Mul, _, a, b) => {
            factors_of(a, out);
            factors_of(b, out);
        }
        ExprKind::Binary(Op::Div, _, a, _) => factors_of(a, out),
        ExprKind::Neg(x) => factors_of(x, out),
        _ => out.push(e),
    }
}

/// The entry's expression, or the place of its `_`.
pub fn split(e: &Entry) -> Result<&Expr, proc_macro2::Span> {
    match e {
        Entry::Value(e) => Ok(e),
        Entry::Blank(at) => Err(*at),
    }
}
