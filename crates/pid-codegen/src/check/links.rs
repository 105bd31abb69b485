//! Links: mass, centre of mass, inertia, and free inertial parameters.

use super::builder::{Builder, all};
use super::meaning::Scope;
use super::names::Origin;
use super::numbers::constant;
use super::units::{self, Role};
use super::values;
use crate::si::Unit;
use crate::syntax::{self, Entry, LinkDecl, Vector};
use pid_derive::model::{About, Blank, Expr, Inertial, Link, Param, Tensor};

/// Links, and the nominal values of their free parameters.
type Links = (Vec<Link>, Vec<(usize, f64)>);

impl Builder<'_, '_> {
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

    pub(super) fn links(&mut self, params: Option<&[Param]>) -> Option<Links> {
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
