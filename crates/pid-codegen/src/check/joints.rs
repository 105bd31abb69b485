//! Joints: motion, place, limits.

use super::builder::Builder;
use super::meaning::Scope;
use super::numbers::constant;
use super::units::{self, Role};
use crate::diag::Diagnostics;
use crate::si::Unit;
use crate::syntax::{self, Ast, Axis, AxisKind, JointDecl, Motion, UnitExpr};
use pid_derive::model::{Expr, Joint, JointKind};

impl Builder<'_, '_> {
    pub(super) fn joint(&mut self, ast: &Ast, j: usize) -> Option<Joint> {
        let s = &self.symbols.joints[j];
        let d: &JointDecl = s.decl;
        let length = Role {
            what: format!("origin of joint `{}`", d.name),
            unit: Unit::of(&[("m", 1)]),
        };
        let angle = Role {
            what: format!("orientation of joint `{}`", d.name),
            unit: Unit::of(&[("rad", 1)]),
        };
        let zero = || Some([0, 1, 2].map(|_| Expr::Num(0.0)));
        let place = Scope::Geometry("the place of a joint");
        let kind = self.motion(d);
        let origin =
            d.at.as_ref()
                .map_or_else(zero, |v| self.vector(v, place, &length));
        let rpy = d
            .rpy
            .as_ref()
            .map_or_else(zero, |v| self.vector(v, place, &angle));
        let limits = self.limits(d);
        let armature = self.armature(j);
        let force = self.force(ast, j);
        Some(Joint {
            name: d.name.to_string(),
            docs: d.docs.clone(),
            kind: kind?,
            coord: s.coord,
            follows: self.units.moves[j].as_ref().and_then(|m| m.affine.clone()),
            parent: None,
            child: 0,
            origin: origin?,
            rpy: rpy?,
            limits: limits?,
            armature: armature?,
            force: force?,
        })
    }

    fn motion(&mut self, d: &JointDecl) -> Option<JointKind> {
        match &d.motion {
            Motion::Fixed => Some(JointKind::Fixed),
            Motion::Coordinate(unit) => self.coordinate(d, unit),
            Motion::Revolute(a) => self.axis(d, a).map(JointKind::Revolute),
            Motion::Prismatic(a) => self.axis(d, a).map(JointKind::Prismatic),
        }
    }

    fn coordinate(&mut self, d: &JointDecl, written: &UnitExpr) -> Option<JointKind> {
        let unit = units::unit(written, self.diag)?;
        if unit.same_dims(&Unit::of(&[("m", 1)])) {
            return Some(JointKind::Length);
        }
        if unit.same_dims(&Unit::of(&[("rad", 1)])) && !written.factors.is_empty() {
            return Some(JointKind::Angle);
        }
        self.diag.error(
            written.loc,
            format!(
                "coordinate `{}` must be a length in `m` or an angle in `rad`, found `{written}`",
                d.name
            ),
        );
        None
    }

    fn axis(&mut self, d: &JointDecl, axis: &Axis) -> Option<[f64; 3]> {
        let v = match &axis.direction {
            AxisKind::Named(k) => {
                let mut n = [0.0; 3];
                n[*k] = 1.0;
                return Some(n);
            }
            AxisKind::Given(v) => v,
        };
        let role = Role {
            what: format!("axis of `{}`", d.name),
            unit: Unit::one(),
        };
        if let Some(u) = &v.unit {
            self.diag.error(
                u.loc,
                format!(
                    "the axis of `{}` is a direction without unit\nhelp: remove `{u}`",
                    d.name
                ),
            );
            return None;
        }
        let e = self.vector(v, Scope::Constant("an axis"), &role)?;
        let n = [constant(&e[0])?, constant(&e[1])?, constant(&e[2])?];
        let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !length.is_finite() || length < 1e-12 {
            let what = match length.is_finite() {
                true => "0",
                false => "that is not finite",
            };
            self.diag.error(
                axis.loc,
                format!("axis of `{}` has length {what}\nhelp: write `x`, `y`, `z` or a direction such as `[0, 1, 0]`", d.name),
            );
            return None;
        }
        if (length - 1.0).abs() > 1e-6 {
            self.diag.warn(
                axis.loc.start,
                format!("axis of `{}` has length {length} and is normalised", d.name),
            );
        }
        Some(n.map(|x| x / length))
    }

    #[allow(
        clippy::option_option,
        reason = "outer: an error was reported; inner: no limits"
    )]
    fn limits(&mut self, d: &JointDecl) -> Option<Option<(f64, f64)>> {
        let Some(r) = &d.limits else {
            return Some(None);
        };
        let what = match d.motion {
            Motion::Coordinate(_) => "coordinate",
            _ => "joint",
        };
        let unit = match d.motion {
            Motion::Revolute(_) => Unit::of(&[("rad", 1)]),
            Motion::Prismatic(_) => Unit::of(&[("m", 1)]),
            Motion::Coordinate(_) => self.units.position(self.symbols.mover(&d.name)?),
            Motion::Fixed => {
                self.diag.error(
                    r.loc,
                    format!("joint `{}` is fixed: it has no limits", d.name),
                );
                return None;
            }
        };
        let role = Role {
            what: format!("limits of {what} `{}`", d.name),
            unit,
        };
        // Of a coordinate, bare numbers are in the declared unit.
        let declared = match &d.motion {
            Motion::Coordinate(unit) => units::unit(unit, &mut Diagnostics::new()),
            _ => None,
        };
        let (lo, hi) = self.units.range(r, &role, declared.as_ref(), self.diag)?;
        if lo < hi {
            return Some(Some((lo, hi)));
        }
        let end =
            |e: &Option<syntax::Expr>| e.as_ref().map(ToString::to_string).unwrap_or_default();
        self.diag.error(
            r.loc,
            format!(
                "limits of {what} `{}` are empty: {} is not below {}\nhelp: write the lower limit first",
                d.name,
                end(&r.lo),
                end(&r.hi)
            ),
        );
        None
    }
}
