//! Values: nominal values, ranges, list lengths, and masses and inertias that a body can have.

use crate::diag::{Diagnostics, Loc};
use crate::si::Unit;
use crate::syntax::{Entry, Expr, Nominal, ParamDecl, Range, Ranges, Vector};
use pid_derive::model::{self, About, Inertial, Param, Tensor};

use super::meaning::Scope;
use super::names::{Origin, Symbols};
use super::numbers::{at_params, constant};
use super::units::{Role, Units, finite};

/// Parameters with their values in SI.
///
/// The parameters of `inertial: free` get their nominal values from the link ([`super::resolve`]).
pub fn params(
    symbols: &Symbols<'_>,
    units: &Units<'_>,
    diag: &mut Diagnostics,
) -> Option<Vec<Param>> {
    let mut out = Vec::new();
    let mut complete = true;
    for (k, p) in symbols.params.iter().enumerate() {
        let Some(unit) = &units.params[k] else {
            complete = false;
            continue;
        };
        let (decl, nth) = match p.origin {
            Origin::Declared(d) => (d, None),
            Origin::PerJoint {
                decl, nth, block, ..
            } => (decl, Some((nth, &symbols.blocks[block].1))),
            Origin::Free { entry, .. } => {
                let lower = if entry == 0 { 0.0 } else { f64::NEG_INFINITY };
                out.push(Param {
                    name: p.field.to_string(),
                    docs: Vec::new(),
                    unit: unit.to_string(),
                    nominal: 0.0,
                    lower,
                    upper: f64::INFINITY,
                    fixed: false,
                });
                continue;
            }
        };
        // A mistake in a `per joint` declaration as a whole is reported once, at its first joint.
        let first = nth.is_none_or(|(n, _)| n == 0);
        let mut silent = Diagnostics::new();
        let sink = if first { &mut *diag } else { &mut silent };
        match value(symbols, units, decl, unit, nth, sink) {
            Some(v) => out.push(Param {
                name: p.field.to_string(),
                docs: decl.docs.clone(),
                unit: unit.to_string(),
                nominal: v.nominal,
                lower: v.lower,
                upper: v.upper,
                fixed: decl.fixed.is_some(),
            }),
            None => complete = false,
        }
    }
    complete.then_some(out)
}

struct Value {
    nominal: f64,
    lower: f64,
    upper: f64,
}

/// The joints of a `per joint` declaration, and which of them is meant.
type Nth<'a> = Option<(usize, &'a Vec<usize>)>;

fn value(
    symbols: &Symbols<'_>,
    units: &Units<'_>,
    decl: &ParamDecl,
    unit: &Unit,
    nth: Nth<'_>,
    diag: &mut Diagnostics,
) -> Option<Value> {
    let role = Role {
        what: format!("the value of `{}`", decl.name),
        unit: unit.clone(),
    };
    let ranges: Vec<Option<(f64, f64)>> = match &decl.range {
        None => vec![Some((f64::NEG_INFINITY, f64::INFINITY))],
        Some(all) => {
            if let Ranges::List(r, loc) = all {
                one_per_joint(symbols, decl, (r.len(), "range"), *loc, nth, diag)?;
            }
            all.iter()
                .map(|r| range(units, decl, unit, &role, r, diag))
                .collect()
        }
    };
    let entries: Vec<&Expr> = match &decl.nominal {
        None => Vec::new(),
        Some(Nominal::One(e)) => vec![e],
        Some(Nominal::List(all, loc)) => {
            one_per_joint(symbols, decl, (all.len(), "value"), *loc, nth, diag)?;
            all.iter().collect()
        }
    };
    // All entries of a list are checked at the first joint; each joint takes its own.
    let mut values = Vec::new();
    for e in &entries {
        let scope = Scope::Constant("a nominal value");
        let x = units.entry(e, scope, &role, Some(unit), diag);
        values.push(x.and_then(|x| finite(constant(&x)?, e, diag)));
    }
    for k in 0..values.len().max(ranges.len()) {
        let (at, of) = (
            k.min(values.len().saturating_sub(1)),
            k.min(ranges.len() - 1),
        );
        if let (Some(Some(x)), Some((lo, hi))) = (values.get(at), ranges[of])
            && !(lo..=hi).contains(x)
        {
            diag.error(
                entries[at].loc,
                format!(
                    "nominal value {} of `{}` is outside {}",
                    x / unit.scale,
                    decl.name,
                    shown(lo / unit.scale, hi / unit.scale)
                ),
            );
            break;
        }
    }
    let n = nth.map_or(0, |n| n.0);
    let (lower, upper) = ranges[n.min(ranges.len() - 1)]?;
    let nominal = match values.len() {
        0 => without_nominal(decl, lower, upper, diag)?,
        len => values[n.min(len - 1)]?,
    };
    Some(Value {
        nominal,
        lower,
        upper,
    })
}

/// Lists belong to `per joint` declarations and have an entry per joint.
fn one_per_joint(
    symbols: &Symbols<'_>,
    decl: &ParamDecl,
    (found, what): (usize, &str),
    loc: Loc,
    nth: Nth<'_>,
    diag: &mut Diagnostics,
) -> Option<()> {
    let name = &decl.name;
    let plural = if found == 1 { "" } else { "s" };
    let Some((_, joints)) = nth else {
        diag.error(
            loc,
            format!(
                "`{name}` is one parameter, but has a list of {found} {what}{plural}\nhelp: lists belong to parameters declared `per joint`"
            ),
        );
        return None;
    };
    if found == joints.len() {
        return Some(());
    }
    let names: Vec<String> = joints
        .iter()
        .map(|&j| symbols.name(j).to_string())
        .collect();
    diag.error(
        loc,
        format!(
            "`{name}` has {found} {what}{plural} for {} joints ({})\nhelp: give one {what} per joint, or a single one for all",
            joints.len(),
            names.join(", ")
        ),
    );
    None
}

/// Ends of a range in SI.
fn range(
    units: &Units<'_>,
    decl: &ParamDecl,
    unit: &Unit,
    role: &Role,
    r: &Range,
    diag: &mut Diagnostics,
) -> Option<(f64, f64)> {
    let (lo, hi) = units.range(r, role, Some(unit), diag)?;
    if lo <= hi {
        return Some((lo, hi));
    }
    let (lo, hi) = (lo / unit.scale, hi / unit.scale);
    diag.error(
        r.loc,
        format!(
            "empty range {lo}..={hi} for `{}`\nhelp: did you mean `{hi}..={lo}`?",
            decl.name
        ),
    );
    None
}

fn without_nominal(decl: &ParamDecl, lo: f64, hi: f64, diag: &mut Diagnostics) -> Option<f64> {
    let name = &decl.name;
    if decl.fixed.is_some() || !(lo.is_finite() && hi.is_finite()) {
        let why = match decl.fixed {
            Some(_) => "is fixed, but has no nominal value",
            None => "has neither a nominal value nor a range with two ends",
        };
        diag.error(
            name,
            format!(
                "`{name}` {why}\nhelp: write `{name}: {} = value`",
                decl.unit
            ),
        );
        return None;
    }
    diag.warn(
        name.span(),
        format!("`{name}` has no nominal value; `nominal()` will use the middle of its range"),
    );
    Some(0.5 * (lo + hi))
}

fn shown(lo: f64, hi: f64) -> String {
    let end = |x: f64| match x.is_finite() {
        true => x.to_string(),
        false => String::new(),
    };
    match hi.is_finite() {
        true => format!("{}..={hi}", end(lo)),
        false => format!("{}..", end(lo)),
    }
}

/// Refuses masses that are or may become 0 or negative. `at` is the mass as written.
pub fn mass(
    symbols: &Symbols<'_>,
    params: &[Param],
    link: &str,
    at: &Entry,
    mass: &model::Expr,
    diag: &mut Diagnostics,
) {
    let nominal: Vec<f64> = params.iter().map(|p| p.nominal).collect();
    if let Some(m) = at_params(mass, &nominal)
        && !(m > 0.0 && m.is_finite())
    {
        let which = match constant(mass) {
            Some(_) => "",
            None => " at the nominal values",
        };
        diag.error(
            at.loc(),
            format!("mass of link `{link}` is {m}{which}, but must be positive\nhelp: leave `mass` out for a massless link"),
        );
        return;
    }
    if let model::Expr::Param(k) = mass
        && let Origin::Declared(decl) | Origin::PerJoint { decl, .. } = symbols.params[*k].origin
        && let Some(ranges) = &decl.range
        && params[*k].lower <= 0.0
    {
        let start = match params[*k].lower.is_finite() {
            true => params[*k].lower.to_string(),
            false => "-inf".to_string(),
        };
        let at = ranges.iter().next().map_or(at.loc(), |r| r.loc);
        diag.error(
            at,
            format!(
                "mass of link `{link}` may become 0 or negative: the range of `{}` starts at {start}\nhelp: start it at a small positive value",
                params[*k].name
            ),
        );
    }
}

/// Refuses a centre of mass that is not finite at the nominal values.
pub fn com(
    params: &[Param],
    link: &str,
    at: &Vector,
    com: &[model::Expr; 3],
    diag: &mut Diagnostics,
) {
    let nominal: Vec<f64> = params.iter().map(|p| p.nominal).collect();
    for (entry, e) in at.entries.iter().zip(com) {
        if let Some(x) = at_params(e, &nominal)
            && !x.is_finite()
        {
            diag.error(
                entry.loc(),
                format!("centre of mass of link `{link}` is {x} at the nominal values"),
            );
        }
    }
}

/// Refuses an inertia that no body can have, if all its principal terms have values at the nominal point.
///
/// A tensor I belongs to a distribution of positive mass exactly if ½ tr(I)·1 − I, taken about the
/// centre of mass, is positive semidefinite (P. M. Wensing, S. Kim, J.-J. E. Slotine, 2018); for a
/// diagonal tensor these are the triangle inequalities Ixx + Iyy ≥ Izz and their permutations.
pub fn inertia(params: &[Param], link: &str, at: Loc, inertial: &Inertial, diag: &mut Diagnostics) {
    let Inertial::Body {
        mass,
        com,
        inertia,
        about,
    } = inertial
    else {
        return;
    };
    let nominal: Vec<f64> = params.iter().map(|p| p.nominal).collect();
    let value = |e: &model::Expr| at_params(e, &nominal);
    let Some(mut i) = tensor(inertia, &value) else {
        return;
    };
    let mut reference = "";
    if *about == About::Origin {
        let moved = (|| {
            let m = value(mass)?;
            let c = [value(&com[0])?, value(&com[1])?, value(&com[2])?];
            Some(to_com(i, m, c))
        })();
        if let Some(moved) = moved {
            i = moved;
            reference = " (about the centre of mass)";
        }
    }
    let trace = i[0][0] + i[1][1] + i[2][2];
    let slack = 1e-9 * trace.abs().max(f64::MIN_POSITIVE);
    let diagonal = [i[0][0], i[1][1], i[2][2]];
    let labels = ["Ixx", "Iyy", "Izz"];
    let head =
        format!("inertia of link `{link}` is not realisable at its nominal values{reference}");
    for k in 0..3 {
        let (a, b) = ((k + 1) % 3, (k + 2) % 3);
        let (a, b) = (a.min(b), a.max(b));
        if diagonal[a] + diagonal[b] < diagonal[k] - slack {
            diag.error(
                at,
                format!(
                    "{head}: {} + {} < {} ({} + {} < {})",
                    labels[a], labels[b], labels[k], diagonal[a], diagonal[b], diagonal[k]
                ),
            );
            return;
        }
    }
    if !is_semidefinite(second_moment(i), slack) {
        diag.error(
            at,
            format!("{head}: the products of inertia are too large for the diagonal\nhelp: products are entries of the matrix, Ixy = −∫xy dm"),
        );
    }
}

fn tensor(t: &Tensor, value: &impl Fn(&model::Expr) -> Option<f64>) -> Option<[[f64; 3]; 3]> {
    let (xx, yy, zz) = (value(&t.xx)?, value(&t.yy)?, value(&t.zz)?);
    let product = |e: &model::Expr| match e {
        model::Expr::Blank(_) => Some(0.0),
        e => value(e),
    };
    let (xy, xz, yz) = (product(&t.xy)?, product(&t.xz)?, product(&t.yz)?);
    Some([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
}

/// Steiner: I_com = I_origin − m (c·c 1 − c cᵀ).
fn to_com(mut i: [[f64; 3]; 3], m: f64, c: [f64; 3]) -> [[f64; 3]; 3] {
    let cc: f64 = c.iter().map(|x| x * x).sum();
    for (r, row) in i.iter_mut().enumerate() {
        for (s, x) in row.iter_mut().enumerate() {
            *x -= m * (if r == s { cc } else { 0.0 } - c[r] * c[s]);
        }
    }
    i
}

/// ∫ x xᵀ dm = ½ tr(I)·1 − I.
fn second_moment(i: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let half = 0.5 * (i[0][0] + i[1][1] + i[2][2]);
    let mut s = i.map(|row| row.map(|x| -x));
    for (k, row) in s.iter_mut().enumerate() {
        row[k] += half;
    }
    s
}

/// Whether all principal minors are non-negative, up to `slack` per factor.
fn is_semidefinite(s: [[f64; 3]; 3], slack: f64) -> bool {
    let size = s.iter().flatten().fold(slack, |m, x| m.max(x.abs()));
    let minor2 = |a: usize, b: usize| s[a][a] * s[b][b] - s[a][b] * s[b][a];
    let det = s[0][0] * minor2(1, 2) - s[0][1] * (s[1][0] * s[2][2] - s[1][2] * s[2][0])
        + s[0][2] * (s[1][0] * s[2][1] - s[1][1] * s[2][0]);
    (0..3).all(|k| s[k][k] >= -slack)
        && [(0, 1), (0, 2), (1, 2)]
            .iter()
            .all(|&(a, b)| minor2(a, b) >= -slack * size)
        && det >= -slack * size * size
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solid_box_is_realisable_and_too_large_a_product_is_not() {
        // Cuboid of mass 12 with sides 1, 2, 3: I = diag(4+9, 1+9, 1+4).
        let body = [[13.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 5.0]];
        assert!(is_semidefinite(second_moment(body), 1e-9));
        let mut skew = body;
        (skew[0][1], skew[1][0]) = (2.5, 2.5);
        assert!(!is_semidefinite(second_moment(skew), 1e-9));
    }

    #[test]
    fn steiner_gives_back_the_tensor_about_the_centre_of_mass() {
        // A point mass of 2 kg at (1, 2, 3): nothing is left about its own centre.
        let (m, c) = (2.0, [1.0, 2.0, 3.0]);
        let i = [[26.0, -4.0, -6.0], [-4.0, 20.0, -12.0], [-6.0, -12.0, 10.0]];
        assert_eq!(to_com(i, m, c), [[0.0; 3]; 3]);
    }
}
