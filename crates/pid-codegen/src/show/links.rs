//! Bodies of links in the words of `robot!`, and the parameters that only they have.

use std::fmt::Write as _;

use pid_derive::facts;
use pid_derive::model::{About, Affine, Expr, Inertial, Link, Param, Robot, Tensor};

use super::words::{Unsaid, Words};
use crate::check::LINEAR;
use crate::si::Unit;

/// Which parameters the declaration leaves out: those that stand as `_`, since they do not enter
/// the equations, and those of free links.
pub(super) fn absent(robot: &Robot) -> Vec<bool> {
    let mut absent = vec![false; robot.params.len()];
    for k in facts(robot).unused_params {
        // A parameter within a larger expression has to be declared.
        absent[k] = uses(robot, k) == whole_entries(robot, k);
    }
    for first in robot.links.iter().filter_map(|link| free(robot, link)) {
        absent[first..first + LINEAR.len()].fill(true);
    }
    absent
}

/// What stands between the braces of a link.
pub(super) fn body(robot: &Robot, words: &Words<'_>, link: &Link) -> Result<String, Unsaid> {
    let place = format!("link `{}`", link.name);
    let (mass, com, inertia, about) = match &link.inertial {
        Inertial::None => return Ok(String::new()),
        Inertial::Body {
            mass,
            com,
            inertia,
            about,
        } => (mass, com.clone(), inertia, *about),
        Inertial::Linear {
            mass,
            first_moment,
            inertia,
        } => {
            if let Some(first) = free(robot, link) {
                return free_body((robot, words), first, &place);
            }
            let [x, y, z] = first_moment.each_ref().map(|h| per_mass(h, mass));
            (mass, [x, y, z], inertia, About::Origin)
        }
    };
    let (kg, metre) = (Unit::of(&[("kg", 1)]), Unit::of(&[("m", 1)]));
    let mut out = String::new();
    if *mass != Expr::Num(0.0) {
        let mass = words.entry(mass, &kg, &place)?;
        let com = words.vector(&com, &metre, &place)?;
        let _ = write!(out, " mass: {mass}; com: {com};");
    }
    if *inertia != Tensor::default() {
        let tensor = tensor(words, inertia, &kg.mul(&metre.powi(2)), &place)?;
        let about = match about {
            About::Com => "com",
            About::Origin => "origin",
        };
        let _ = write!(out, " inertia at {about}: {tensor};");
    }
    Ok(out)
}

/// The first parameter of a body that the language declares by `inertial: free`.
fn free(robot: &Robot, link: &Link) -> Option<usize> {
    let Some(Expr::Param(first)) = entries(&link.inertial).first().copied() else {
        return None;
    };
    let own = robot.params.get(*first..first + LINEAR.len())?;
    let mut all = entries(&link.inertial).into_iter().zip(*first..);
    let open = |(p, suffix): (&Param, &&str)| {
        let lower = if *suffix == "m" {
            0.0
        } else {
            f64::NEG_INFINITY
        };
        p.name == format!("{}_{suffix}", link.name)
            && (p.lower, p.upper, p.fixed) == (lower, f64::INFINITY, false)
    };
    let free = all.all(|(e, k)| *e == Expr::Param(k)) && own.iter().zip(&LINEAR).all(open);
    free.then_some(*first)
}

fn free_body(
    (robot, words): (&Robot, &Words<'_>),
    first: usize,
    place: &str,
) -> Result<String, Unsaid> {
    let x = |k: usize| robot.params[first + k].nominal;
    let mass = x(0);
    let com = [1, 2, 3].map(|k| Expr::Num(x(k) / mass));
    let (kg, metre) = (Unit::of(&[("kg", 1)]), Unit::of(&[("m", 1)]));
    let com = words.vector(&com, &metre, place)?;
    let inertia = [4, 5, 6, 7, 8, 9].map(|k| Expr::Num(x(k)));
    let tensor = tensor(words, &inertia.into(), &kg.mul(&metre.powi(2)), place)?;
    Ok(format!(
        " inertial: free; mass: {mass:?} kg; com: {com}; inertia at origin: {tensor};"
    ))
}

fn tensor(words: &Words<'_>, t: &Tensor, unit: &Unit, place: &str) -> Result<String, Unsaid> {
    let entry = |e: &Expr| words.entry(e, unit, place);
    let products = [&t.xy, &t.xz, &t.yz];
    let [xx, yy, zz] = [entry(&t.xx)?, entry(&t.yy)?, entry(&t.zz)?];
    if products.iter().all(|e| **e == Expr::Num(0.0)) {
        return Ok(format!("diag({xx}, {yy}, {zz})"));
    }
    let [xy, xz, yz] = [entry(&t.xy)?, entry(&t.xz)?, entry(&t.yz)?];
    Ok(format!(
        "[xx: {xx}, yy: {yy}, zz: {zz}, xy: {xy}, xz: {xz}, yz: {yz}]"
    ))
}

/// Centre of mass from a first moment, a number where both are multiples of the same expression.
fn per_mass(moment: &Expr, mass: &Expr) -> Expr {
    let (h, m) = match (moment, mass) {
        (Expr::Num(h), Expr::Num(m)) => (Some(*h), *m),
        (Expr::Mul(a, x), Expr::Mul(b, y)) if x == y => match (&**a, &**b) {
            (Expr::Num(h), Expr::Num(m)) => (Some(*h), *m),
            _ => (None, 0.0),
        },
        _ => (None, 0.0),
    };
    match h {
        Some(h) if h == 0.0 || m != 0.0 => Expr::Num(if h == 0.0 { 0.0 } else { h / m }),
        _ => Expr::Div(Box::new(moment.clone()), Box::new(mass.clone())),
    }
}

/// How often a parameter occurs.
fn uses(robot: &Robot, k: usize) -> usize {
    let mut count = 0;
    let mut add = |e: &Expr| count += occurrences(e, k);
    for link in &robot.links {
        entries(&link.inertial).into_iter().for_each(&mut add);
    }
    robot.gravity.iter().for_each(&mut add);
    for joint in &robot.joints {
        joint.origin.iter().chain(&joint.rpy).for_each(&mut add);
        joint.armature.iter().chain(&joint.force).for_each(&mut add);
        joint.follows.iter().flat_map(parts).for_each(&mut add);
    }
    for motor in &robot.motors {
        motor.armature.iter().chain(&motor.force).for_each(&mut add);
        parts(&motor.moves).for_each(&mut add);
    }
    let energies = robot.potential.iter().chain(&robot.lagrangian);
    energies.for_each(&mut add);
    count
}

fn parts(affine: &Affine) -> impl Iterator<Item = &Expr> {
    let ratios = affine.terms.iter().map(|(_, ratio)| ratio);
    ratios.chain([&affine.offset])
}

/// How often it is the whole of an entry of a link.
fn whole_entries(robot: &Robot, k: usize) -> usize {
    let links = robot.links.iter();
    let all = links.filter(|l| !matches!(l.inertial, Inertial::Linear { .. }));
    let all = all.flat_map(|l| entries(&l.inertial));
    all.filter(|e| **e == Expr::Param(k)).count()
}

fn entries(inertial: &Inertial) -> Vec<&Expr> {
    let (mass, vector, t) = match inertial {
        Inertial::None => return Vec::new(),
        Inertial::Body {
            mass, com, inertia, ..
        } => (mass, com, inertia),
        Inertial::Linear {
            mass,
            first_moment,
            inertia,
        } => (mass, first_moment, inertia),
    };
    let [x, y, z] = vector;
    vec![mass, x, y, z, &t.xx, &t.yy, &t.zz, &t.xy, &t.xz, &t.yz]
}

fn occurrences(e: &Expr, k: usize) -> usize {
    match e {
        Expr::Param(j) => usize::from(*j == k),
        Expr::Num(_) | Expr::Input(_) | Expr::Position(_) | Expr::Velocity(_) | Expr::Blank(_) => 0,
        Expr::Neg(x) | Expr::Powi(x, _) | Expr::Call(_, x) => occurrences(x, k),
        Expr::Add(x, y) | Expr::Sub(x, y) | Expr::Mul(x, y) | Expr::Div(x, y) => {
            occurrences(x, k) + occurrences(y, k)
        }
    }
}
