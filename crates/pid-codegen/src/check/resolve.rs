//! Units, values and geometry: from declarations to the lists of the resolved robot. The tree of
//! links comes after.

use proc_macro2::Span;

use crate::diag::Diagnostics;
use crate::si::Unit;
use crate::syntax::{
    self, Ast, Axis, AxisKind, Entry, InputDecl, JointDecl, LinkDecl, Motion, UnitExpr, Vector,
};
use pid_derive::model::{
    About, Blank, Expr, Inertial, Input, Joint, JointKind, Link, Motor, Param, Robot, Tensor,
};

use super::names::{Origin, Scope, Symbols};
use super::numbers::constant;
use super::units::{self, Role, Units};
use super::{Places, Resolved, motion, values};

/// The resolved robot without `order` and the links of the joints. `None` after an error.
pub(super) fn robot(ast: &Ast, symbols: &Symbols<'_>, diag: &mut Diagnostics) -> Option<Resolved> {
    let mut units = Units::new(
        symbols,
        declared_units(symbols, diag),
        input_units(symbols, diag),
    );
    motion::resolve(symbols, &mut units, diag);
    let params = values::params(symbols, &units, diag);
    let mut b = Builder {
        symbols,
        units: &units,
        diag,
        blanks: Vec::new(),
        blank_places: Vec::new(),
    };
    let gravity = match ast.is_bare() {
        true => Some([0, 1, 2].map(|_| Expr::Num(0.0))),
        false => ast.gravity.as_ref().and_then(|g| b.gravity(g)),
    };
    let potential = b.energies(&ast.potentials, Scope::Potential, "the potential");
    let lagrangian = b.energies(
        ast.lagrangian.as_slice(),
        Scope::Lagrangian,
        "the Lagrangian",
    );
    let links = b.links(params.as_deref());
    let joints: Vec<Option<Joint>> = (0..symbols.joints.len()).map(|j| b.joint(ast, j)).collect();
    let motors: Vec<Option<Motor>> = (0..symbols.motors.len()).map(|k| b.motor(ast, k)).collect();
    let (blanks, blank_places) = (b.blanks, b.blank_places);
    if !diag.is_ok() {
        return None;
    }
    let (links, nominal) = links?;
    let mut params = params?;
    for (k, x) in nominal {
        params[k].nominal = x;
    }
    let inputs = symbols.inputs.iter().zip(&units.inputs).map(|(u, unit)| {
        Some(Input {
            name: u.field.to_string(),
            docs: u.decl.docs.clone(),
            unit: unit.as_ref()?.to_string(),
            coord: u.joint.and_then(|j| coordinate(symbols, &units, j)),
        })
    });
    let robot = Robot {
        name: ast.name.to_string(),
        docs: ast.docs.clone(),
        gravity: gravity?,
        params,
        inputs: inputs.collect::<Option<_>>()?,
        links,
        joints: joints.into_iter().collect::<Option<_>>()?,
        order: Vec::new(),
        motors: motors.into_iter().collect::<Option<_>>()?,
        potential: potential?,
        lagrangian: lagrangian?,
        blanks,
        emit: super::emit(ast),
    };
    Some(Resolved {
        robot,
        places: places(symbols, blank_places),
        identifiability: Default::default(),
    })
}

/// Gravity without parameters.
pub(super) fn constant_gravity(
    given: &Vector,
    symbols: &Symbols<'_>,
    units: &Units<'_>,
    diag: &mut Diagnostics,
) -> Option<[f64; 3]> {
    let mut b = Builder {
        symbols,
        units,
        diag,
        blanks: Vec::new(),
        blank_places: Vec::new(),
    };
    let [x, y, z] = b.gravity(given)?;
    Some([constant(&x)?, constant(&y)?, constant(&z)?])
}

/// The coordinate of an input: that of its joint, or the last one that the joint or motor moves.
fn coordinate(symbols: &Symbols<'_>, units: &Units<'_>, joint: usize) -> Option<usize> {
    let own = symbols.joints.get(joint).and_then(|j| j.coord);
    own.or_else(|| {
        let affine = units.moves[joint].as_ref()?.affine.as_ref()?;
        affine.terms.iter().map(|t| t.0).max()
    })
}

fn places(symbols: &Symbols<'_>, blanks: Vec<Span>) -> Places {
    Places {
        params: symbols.params.iter().map(|p| p.field.clone()).collect(),
        param_decls: symbols.params.iter().map(|p| p.decl).collect(),
        inputs: symbols.inputs.iter().map(|u| u.field.clone()).collect(),
        input_decls: symbols.inputs.iter().map(|u| u.decl.name.span()).collect(),
        links: symbols.links.iter().map(|l| l.ident.clone()).collect(),
        joints: symbols.joints.iter().map(|j| j.decl.name.clone()).collect(),
        blanks,
    }
}

/// Units of the parameters; an unknown one is reported once, also for `per joint` declarations.
fn declared_units(symbols: &Symbols<'_>, diag: &mut Diagnostics) -> Vec<Option<Unit>> {
    let mut silent = Diagnostics::new();
    let params = symbols.params.iter().map(|p| match p.origin {
        Origin::Declared(d) => units::unit(&d.unit, diag),
        Origin::PerJoint { decl, nth: 0, .. } => units::unit(&decl.unit, diag),
        Origin::PerJoint { decl, .. } => units::unit(&decl.unit, &mut silent),
        Origin::Free { entry, about, .. } => Some(match (entry, about) {
            (0, _) => Unit::of(&[("kg", 1)]),
            (1..=3, About::Com) => Unit::of(&[("m", 1)]),
            (1..=3, About::Origin) => Unit::of(&[("kg", 1), ("m", 1)]),
            _ => Unit::of(&[("kg", 1), ("m", 2)]),
        }),
    });
    params.collect()
}

fn input_units(symbols: &Symbols<'_>, diag: &mut Diagnostics) -> Vec<Option<Unit>> {
    let mut known: Vec<(&InputDecl, Option<Unit>)> = Vec::new();
    let mut out = Vec::new();
    for u in &symbols.inputs {
        let unit = match known.iter().find(|k| std::ptr::eq(k.0, u.decl)) {
            Some(k) => k.1.clone(),
            None => {
                let unit = units::unit(&u.decl.unit, diag);
                known.push((u.decl, unit.clone()));
                unit
            }
        };
        out.push(unit);
    }
    out
}

pub(super) struct Builder<'a, 'd> {
    pub(super) symbols: &'a Symbols<'a>,
    pub(super) units: &'a Units<'a>,
    pub(super) diag: &'d mut Diagnostics,
    blanks: Vec<Blank>,
    blank_places: Vec<Span>,
}

/// Links, and the nominal values of their free parameters.
type Links = (Vec<Link>, Vec<(usize, f64)>);

impl Builder<'_, '_> {
    fn gravity(&mut self, given: &Vector) -> Option<[Expr; 3]> {
        let role = Role {
            what: "gravity".to_string(),
            unit: Unit::of(&[("m", 1), ("s", -2)]),
        };
        self.vector(given, Scope::Geometry("gravity"), &role)
    }

    /// A vector in which `_` has no place.
    pub(super) fn vector(&mut self, v: &Vector, scope: Scope, role: &Role) -> Option<[Expr; 3]> {
        let trailing = self.units.trailing(v.unit.as_ref(), role, self.diag)?;
        let e = [0, 1, 2].map(|k| match units::split(&v.entries[k]) {
            Ok(e) => self
                .units
                .entry(e, scope, role, trailing.as_ref(), self.diag),
            Err(at) => {
                self.diag.error(
                    at,
                    format!(
                        "`_` cannot stand in {}: the entry is known or a parameter",
                        role.what
                    ),
                );
                None
            }
        });
        all(e)
    }

    /// The sum of energies, each of whose terms must be one.
    #[allow(
        clippy::option_option,
        reason = "outer: an error was reported; inner: none is given"
    )]
    fn energies(&mut self, all: &[syntax::Expr], scope: Scope, what: &str) -> Option<Option<Expr>> {
        let role = Role {
            what: what.to_string(),
            unit: Unit::of(&[("J", 1)]),
        };
        let each: Vec<Option<Expr>> = all
            .iter()
            .map(|e| self.units.law(e, scope, &role, self.diag))
            .collect();
        let each: Option<Vec<Expr>> = each.into_iter().collect();
        Some(each?.into_iter().reduce(motion::plus))
    }

    /// An entry of a link, where `_` may stand.
    fn entry(
        &mut self,
        e: &Entry,
        role: &Role,
        trailing: Option<&Unit>,
        blank: (usize, &str),
    ) -> Option<Expr> {
        match units::split(e) {
            Ok(e) => self
                .units
                .entry(e, Scope::Geometry("a link"), role, trailing, self.diag),
            Err(at) => {
                self.blanks.push(Blank {
                    link: blank.0,
                    entry: blank.1.to_string(),
                });
                self.blank_places.push(at);
                Some(Expr::Blank(self.blanks.len() - 1))
            }
        }
    }

    fn links(&mut self, params: Option<&[Param]>) -> Option<Links> {
        let mut nominal = Vec::new();
        let mut out = Vec::new();
        for (k, l) in self.symbols.links.iter().enumerate() {
            // A mistake in a range of links is reported once.
            let first = l.decl.names.idents.first() == Some(&l.ident);
            let before = self.diag.count();
            let given = self.inertial(k, &l.ident.to_string(), l.decl, params);
            while !first && self.diag.count() > before {
                self.diag.pop();
            }
            let Some(given) = given else { continue };
            let inertial = match l.decl.free {
                None => given,
                Some(free) => {
                    let base = self.symbols.params.iter().position(
                        |p| matches!(p.origin, Origin::Free { link, entry: 0, .. } if link == k),
                    )?;
                    if l.decl.mass.is_none() && first {
                        self.diag.warn(
                            free.loc.start,
                            format!(
                                "the parameters of link `{}` have no nominal values; `nominal()` will use 1 kg and 0.01 kg*m^2 at the origin of the link: give `mass`, `com` and `inertia` beside `inertial: free`",
                                l.ident
                            ),
                        );
                    }
                    for (n, x) in nominal_of(&given, free.about).into_iter().enumerate() {
                        nominal.push((base + n, x));
                    }
                    free_inertial(base, free.about)
                }
            };
            out.push(Link {
                name: l.ident.to_string(),
                docs: l.decl.docs.clone(),
                inertial,
            });
        }
        (out.len() == self.symbols.links.len()).then_some((out, nominal))
    }

    fn inertial(
        &mut self,
        k: usize,
        name: &str,
        decl: &LinkDecl,
        params: Option<&[Param]>,
    ) -> Option<Inertial> {
        let role = |what: &str, terms: &[(&str, i32)]| Role {
            what: format!("{what} of link `{name}`"),
            unit: Unit::of(terms),
        };
        if let Some(shape) = &decl.shape {
            let com = decl.com.as_ref();
            return self.homogeneous(k, name, shape, com, params);
        }
        let mass_role = role("mass", &[("kg", 1)]);
        let inertia_role = role("inertia", &[("kg", 1), ("m", 2)]);
        let zero = || Expr::Num(0.0);
        let mass = match &decl.mass {
            None => Some(zero()),
            Some(e) => self.entry(e, &mass_role, None, (k, "mass")),
        };
        let com = self.com(k, name, decl.com.as_ref());
        let (inertia, about) = match &decl.inertia {
            None => (Some(Default::default()), About::Com),
            Some(i) => (self.tensor(k, i, &inertia_role), i.about),
        };
        let (mass, com, inertia) = (mass?, com?, inertia?);
        if decl.mass.is_none() && decl.com.is_none() && decl.inertia.is_none() {
            return Some(Inertial::None);
        }
        let inertial = Inertial::Body {
            mass,
            com,
            inertia,
            about,
        };
        if let (Some(at), Some(params), Inertial::Body { mass, .. }) =
            (&decl.mass, params, &inertial)
        {
            values::mass(self.symbols, params, name, at, mass, self.diag);
        }
        if let (Some(at), Some(params), Inertial::Body { com, .. }) = (&decl.com, params, &inertial)
        {
            values::com(params, name, at, com, self.diag);
        }
        if let (Some(i), Some(params)) = (&decl.inertia, params) {
            values::inertia(params, name, i.loc, &inertial, self.diag);
        }
        if let (None, Some(v)) = (&decl.mass, &decl.com) {
            self.diag.error(
                v.loc,
                format!(
                    "link `{name}` has a centre of mass but no mass\nhelp: write `mass: value kg;`"
                ),
            );
        }
        Some(inertial)
    }

    /// Centre of mass of link `k`; the origin if it is not given.
    pub(super) fn com(&mut self, k: usize, name: &str, com: Option<&Vector>) -> Option<[Expr; 3]> {
        let Some(v) = com else {
            return Some([0, 1, 2].map(|_| Expr::Num(0.0)));
        };
        let role = Role {
            what: format!("centre of mass of link `{name}`"),
            unit: Unit::of(&[("m", 1)]),
        };
        let t = self.units.trailing(v.unit.as_ref(), &role, self.diag)?;
        let e = [(0, "com x"), (1, "com y"), (2, "com z")]
            .map(|(i, n)| self.entry(&v.entries[i], &role, t.as_ref(), (k, n)));
        all(e)
    }

    fn tensor(&mut self, k: usize, i: &syntax::Inertia, role: &Role) -> Option<Tensor> {
        let trailing = self.units.trailing(i.unit.as_ref(), role, self.diag)?;
        let t = trailing.as_ref();
        let [xx, yy, zz] = [(0, "Ixx"), (1, "Iyy"), (2, "Izz")]
            .map(|(n, name)| self.entry(&i.diagonal[n], role, t, (k, name)));
        let [xy, xz, yz] = match &i.products {
            None => [0, 1, 2].map(|_| Some(Expr::Num(0.0))),
            Some(p) => [(0, "Ixy"), (1, "Ixz"), (2, "Iyz")]
                .map(|(n, name)| self.entry(&p[n], role, t, (k, name))),
        };
        Some(Tensor {
            xx: xx?,
            yy: yy?,
            zz: zz?,
            xy: xy?,
            xz: xz?,
            yz: yz?,
        })
    }

    fn joint(&mut self, ast: &Ast, j: usize) -> Option<Joint> {
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

pub(super) fn all(e: [Option<Expr>; 3]) -> Option<[Expr; 3]> {
    let [x, y, z] = e;
    Some([x?, y?, z?])
}

/// The parameters from `base` on as the inertia of a link.
fn free_inertial(base: usize, about: About) -> Inertial {
    let p = |n: usize| Expr::Param(base + n);
    let inertia = Tensor {
        xx: p(4),
        yy: p(5),
        zz: p(6),
        xy: p(7),
        xz: p(8),
        yz: p(9),
    };
    let middle = [p(1), p(2), p(3)];
    match about {
        About::Origin => Inertial::Linear {
            mass: p(0),
            first_moment: middle,
            inertia,
        },
        About::Com => Inertial::Body {
            mass: p(0),
            com: middle,
            inertia,
            about,
        },
    }
}

/// The ten numbers of a constant body in the asked form.
fn nominal_of(given: &Inertial, form: About) -> [f64; 10] {
    let Inertial::Body {
        mass,
        com,
        inertia,
        about,
    } = given
    else {
        return [1.0, 0.0, 0.0, 0.0, 0.01, 0.01, 0.01, 0.0, 0.0, 0.0];
    };
    let value = |e: &Expr| constant(e).unwrap_or(0.0);
    let m = value(mass);
    let [x, y, z] = [value(&com[0]), value(&com[1]), value(&com[2])];
    let given = [
        &inertia.xx,
        &inertia.yy,
        &inertia.zz,
        &inertia.xy,
        &inertia.xz,
        &inertia.yz,
    ]
    .map(value);
    // Steiner's part, about the origin minus about the centre of mass.
    let steiner = [
        y * y + z * z,
        x * x + z * z,
        x * x + y * y,
        -x * y,
        -x * z,
        -y * z,
    ];
    let shift = match (about, form) {
        (About::Com, About::Origin) => m,
        (About::Origin, About::Com) => -m,
        _ => 0.0,
    };
    let k = match form {
        About::Origin => m,
        About::Com => 1.0,
    };
    let i = |n: usize| given[n] + shift * steiner[n];
    [m, k * x, k * y, k * z, i(0), i(1), i(2), i(3), i(4), i(5)]
}
