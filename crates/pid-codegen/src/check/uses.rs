//! Uses of names: every name in an expression must exist and be allowed there.

use proc_macro2::Ident;

use crate::diag::{Diagnostics, Loc, nearest, one_of};
use crate::syntax::{
    Amount, Ast, AxisKind, Entry, Expr, ExprKind, ForceOn, JointDecl, LinkDecl, Motion, Nominal,
    ParamDecl, PerJoint, Range, Shape, ShapeKind, Vector,
};

use super::meaning::{FUNCTIONS, Scope};
use super::names::{Origin, Symbols, unknown_joint};

/// Reports every use of a name that does not exist.
pub fn check(ast: &Ast, symbols: &Symbols<'_>, diag: &mut Diagnostics) {
    constants(
        ast.params
            .iter()
            .chain(ast.per_joint.iter().flat_map(|b| &b.params))
            .chain(ast.motors.iter().flat_map(|m| &m.body.params)),
        symbols,
        diag,
    );
    let mut c = Uses { symbols, diag };
    if ast.is_bare() {
        c.bare(ast);
    } else if let Some(g) = &ast.gravity {
        c.vector(g, Scope::Geometry("gravity"));
    } else {
        c.diag.error(
            &ast.name,
            format!(
                "robot `{}` has no gravity\nhelp: add `gravity: [0, 0, -9.81] m/s^2;`, or `[0, 0, 0] m/s^2` if it has no effect",
                ast.name
            ),
        );
    }
    for l in &ast.links {
        c.link(l);
    }
    for j in &ast.joints {
        c.joint(j);
    }
    for m in &symbols.motors {
        c.expr(&m.moves, Scope::Coupling);
    }
    for e in &ast.potentials {
        c.expr(e, Scope::Potential);
    }
    for lock in ast
        .locks
        .iter()
        .chain(ast.variants.iter().flat_map(|v| &v.locks))
    {
        c.expr(
            &lock.value,
            Scope::Constant("the position of a locked joint"),
        );
    }
    for (block, joints) in &symbols.blocks {
        c.block(block, joints);
    }
    for f in &ast.forces {
        c.force(f);
    }
}

/// Nominal values and ranges must be numbers.
pub(super) fn constants<'p>(
    params: impl Iterator<Item = &'p ParamDecl>,
    symbols: &Symbols<'_>,
    diag: &mut Diagnostics,
) {
    let mut c = Uses { symbols, diag };
    for p in params {
        let values: &[Expr] = match &p.nominal {
            Some(Nominal::One(e)) => std::slice::from_ref(e),
            Some(Nominal::List(all, _)) => all,
            None => &[],
        };
        for e in values {
            c.expr(e, Scope::Constant("a nominal value"));
        }
        for r in p.range.iter().flat_map(|r| r.iter()) {
            c.range(r);
        }
    }
}

/// The entries of a vector must be numbers.
pub(super) fn constant_vector(v: &Vector, symbols: &Symbols<'_>, diag: &mut Diagnostics) {
    Uses { symbols, diag }.vector(v, Scope::Constant("gravity"));
}

struct Uses<'a, 'd> {
    symbols: &'a Symbols<'a>,
    diag: &'d mut Diagnostics,
}

fn is_fixed(symbols: &Symbols<'_>, joint: usize) -> bool {
    let joint = symbols.joints.get(joint);
    joint.is_some_and(|j| matches!(j.decl.motion, Motion::Fixed))
}

impl Uses<'_, '_> {
    /// A system given by its Lagrangian.
    fn bare(&mut self, ast: &Ast) {
        let mut coordinates = ast
            .joints
            .iter()
            .filter(|j| matches!(j.motion, Motion::Coordinate(_)));
        match &ast.lagrangian {
            Some(e) => self.expr(e, Scope::Lagrangian),
            None => {
                if let Some(first) = coordinates.next() {
                    self.diag.error(
                        &first.name,
                        "`coordinates` without a Lagrangian\nhelp: add `lagrangian = kinetic - potential;`",
                    );
                }
            }
        }
        if let (Some(e), None) = (&ast.lagrangian, coordinates.next())
            && ast
                .joints
                .iter()
                .all(|j| !matches!(j.motion, Motion::Coordinate(_)))
        {
            self.diag.error(
                e.loc,
                "a Lagrangian without coordinates\nhelp: declare them: `coordinates x: m, th: rad;`",
            );
        }
        if let Some(g) = &ast.gravity {
            self.diag.error(
                g.loc,
                "gravity acts on links, and a `lagrangian` has none\nhelp: write its potential energy into the Lagrangian",
            );
        }
        let links = ast.links.iter().map(|l| (l.names.loc, "links"));
        let joints = ast
            .joints
            .iter()
            .filter(|j| !matches!(j.motion, Motion::Coordinate(_)));
        let joints = joints.map(|j| (Loc::from(&j.name), "joints"));
        let motors = ast.motors.iter().map(|m| (Loc::from(&m.name), "motors"));
        for (at, what) in links.chain(joints).chain(motors) {
            self.diag.error(
                at,
                format!("a robot has {what}, or `coordinates` and a `lagrangian`, not both\nhelp: declare two robots"),
            );
        }
    }

    fn joint(&mut self, j: &JointDecl) {
        if let Motion::Revolute(axis) | Motion::Prismatic(axis) = &j.motion
            && let AxisKind::Given(v) = &axis.direction
        {
            self.vector(v, Scope::Constant("an axis"));
        }
        for v in j.at.iter().chain(&j.rpy) {
            self.vector(v, Scope::Geometry("the place of a joint"));
        }
        if let Some(r) = &j.limits {
            self.range(r);
        }
        if let Some(e) = &j.follows {
            self.follower(j, e);
        }
    }

    /// Laws of `per joint`, at every joint that has them.
    fn block(&mut self, block: &PerJoint, joints: &[usize]) {
        if joints.is_empty() && block.joints.is_none() {
            self.diag.error(
                block.at,
                "`per joint` covers no joint: all joints are fixed\nhelp: declare a `revolute` or `prismatic` joint",
            );
        }
        // The law is the same for all joints: one report is enough.
        let drive = block.drive.iter().flat_map(|d| {
            let fields = [&d.ratio, &d.rotor, &d.gain, &d.resistance];
            fields.map(|e| (e, Scope::Drive as fn(usize) -> Scope))
        });
        let laws = [
            (&block.armature, Scope::Drive as fn(usize) -> Scope),
            (&block.force, Scope::Force as fn(usize) -> Scope),
        ];
        for (law, scope) in laws.into_iter().chain(drive) {
            let Some(e) = law else { continue };
            for &j in joints {
                if self.symbols.is_held(j) {
                    continue;
                }
                let before = self.diag.count();
                self.expr(e, scope(j));
                if self.diag.count() > before {
                    break;
                }
            }
        }
    }

    /// A force acts on a joint that moves.
    fn force(&mut self, f: &ForceOn) {
        match self.symbols.mover(&f.joint) {
            None => unknown_joint(self.diag, &f.joint, &self.symbols.joints),
            Some(j) if self.symbols.is_held(j) => {}
            Some(j) if is_fixed(self.symbols, j) => self.diag.error(
                &f.joint,
                format!("joint `{}` is fixed: no force can act on it", f.joint),
            ),
            Some(j) => self.expr(&f.force, Scope::Force(j)),
        }
    }

    /// A joint can only follow joints that move on their own.
    fn follower(&mut self, j: &JointDecl, e: &Expr) {
        if matches!(j.motion, Motion::Fixed) {
            self.diag.error(
                e.loc,
                format!("joint `{}` is fixed: it can follow nothing", j.name),
            );
            return;
        }
        self.expr(e, Scope::Coupling);
    }

    fn link(&mut self, l: &LinkDecl) {
        let scope = match l.free {
            Some(_) => Scope::Constant("a nominal value of `inertial: free`"),
            None => Scope::Geometry("a link"),
        };
        if let Some(shape) = &l.shape {
            self.shape(l, shape);
        }
        let inertia = l
            .inertia
            .iter()
            .flat_map(|i| i.diagonal.iter().chain(i.products.iter().flatten()));
        for e in l.mass.iter().chain(inertia) {
            self.entry(e, scope);
        }
        if let Some(v) = &l.com {
            self.vector(v, scope);
        }
    }

    fn shape(&mut self, l: &LinkDecl, shape: &Shape) {
        let given = l.mass.as_ref().map(Entry::loc);
        if let Some(at) = given.or(l.inertia.as_ref().map(|i| i.loc)) {
            self.diag.error(
                at,
                "a homogeneous body has its mass and inertia from its dimensions\nhelp: put `mass` into its braces, and remove `inertia`",
            );
        }
        let scope = Scope::Geometry("a link");
        let (Amount::Mass(amount) | Amount::Density(amount)) = &shape.amount;
        self.expr(amount, scope);
        match &shape.kind {
            ShapeKind::Cylinder(r, l, _) => [r, l].into_iter().for_each(|e| self.expr(e, scope)),
            ShapeKind::Tube(o, i, l, _) => {
                [o, i, l].into_iter().for_each(|e| self.expr(e, scope));
            }
            ShapeKind::Box(size) => self.vector(size, scope),
            ShapeKind::Sphere(r) => self.expr(r, scope),
        }
    }

    fn entry(&mut self, e: &Entry, scope: Scope) {
        if let Entry::Value(e) = e {
            self.expr(e, scope);
        }
    }

    fn vector(&mut self, v: &Vector, scope: Scope) {
        for e in &v.entries {
            self.entry(e, scope);
        }
    }

    fn range(&mut self, r: &Range) {
        for e in r.lo.iter().chain(&r.hi) {
            self.expr(e, Scope::Constant("a range"));
        }
    }

    fn expr(&mut self, e: &Expr, scope: Scope) {
        match &e.kind {
            ExprKind::Number(..) => {}
            ExprKind::Name(name) => {
                if matches!(scope, Scope::Coupling) {
                    self.leader(name);
                }
                if self.symbols.lookup(name, scope).is_none() {
                    self.unknown(name, scope);
                }
            }
            ExprKind::Member(what, joint) => self.member(what, joint, scope),
            ExprKind::Neg(x) | ExprKind::Pow(x, _) => self.expr(x, scope),
            ExprKind::Binary(_, _, a, b) => {
                self.expr(a, scope);
                self.expr(b, scope);
            }
            ExprKind::Call(f, args) => {
                self.call(f, args, e.loc);
                for a in args {
                    self.expr(a, scope);
                }
            }
        }
    }

    fn call(&mut self, f: &Ident, args: &[Expr], loc: Loc) {
        let name = f.to_string();
        if !FUNCTIONS.iter().any(|k| k.0 == name) {
            let names = FUNCTIONS.map(|k| k.0);
            let help = match (name.as_str(), nearest(&name, names)) {
                ("min" | "max" | "clamp", _) => {
                    "it has no derivatives where it switches; use `tanh(..)` for a saturation"
                        .to_string()
                }
                ("pow" | "powi", _) => "write `x^2`".to_string(),
                ("log", _) => "write `ln(x)`".to_string(),
                (_, Some(n)) => format!("a function with a similar name exists: `{n}`"),
                _ => format!(
                    "the functions are {}",
                    one_of(&names).replace(" or ", " and ")
                ),
            };
            self.diag
                .error(f, format!("no function named `{name}`\nhelp: {help}"));
        } else if args.len() != 1 {
            self.diag.error(
                loc,
                format!("`{name}` takes one argument, found {}", args.len()),
            );
        }
    }

    fn member(&mut self, what: &Ident, joint: &Ident, scope: Scope) {
        let name = what.to_string();
        match scope {
            Scope::Force(_) if name == "a" => return self.acceleration(what),
            Scope::Force(_) | Scope::Lagrangian => {}
            Scope::Potential if name != "v" && name != "a" => {}
            Scope::Coupling => {
                let help = format!("write `{joint}` for its position");
                self.diag.error(
                    what,
                    format!("`{name}.{joint}` cannot be followed\nhelp: {help}"),
                );
                return;
            }
            _ => return self.unknown(what, scope),
        }
        if name != "q" && name != "v" {
            self.diag.error(
                what,
                format!("`{name}.{joint}` means nothing\nhelp: write `q.{joint}` or `v.{joint}`, or a parameter of the joint as `{name}_{joint}`"),
            );
            return;
        }
        match self.symbols.mover(joint) {
            None => unknown_joint(self.diag, joint, &self.symbols.joints),
            Some(j) if is_fixed(self.symbols, j) => self.diag.error(
                joint,
                format!("joint `{joint}` is fixed: it has no coordinate"),
            ),
            Some(_) => {}
        }
    }

    /// A joint named in a coupling must have a coordinate of its own, or be held.
    fn leader(&mut self, name: &Ident) {
        let Some(j) = self.symbols.joints.iter().find(|j| j.decl.name == *name) else {
            return;
        };
        if matches!(j.decl.motion, Motion::Fixed) {
            self.diag.error(
                name,
                format!("joint `{name}` is fixed: nothing can follow it"),
            );
        } else if let Some(e) = &j.decl.follows {
            self.diag.error(
                name,
                format!("joint `{name}` itself follows `{e}`\nhelp: follow the joints it follows"),
            );
        }
    }

    fn acceleration(&mut self, at: &Ident) {
        self.diag.error(
            at,
            "forces may use q, v, inputs and parameters, not accelerations\nhelp: for rotor inertia write `armature = …`",
        );
    }

    fn unknown(&mut self, name: &Ident, scope: Scope) {
        let text = name.to_string();
        if self.symbols.refused.contains(&text) {
            return;
        }
        if let Scope::Constant(what) = scope {
            self.diag.error(
                name,
                format!("{what} must be a number, found the name `{text}`"),
            );
            return;
        }
        let dynamic = text == "q" || text == "v" || text == "a" || text == "t";
        if text == "a" && matches!(scope, Scope::Force(_)) {
            return self.acceleration(name);
        }
        if dynamic {
            let place = match scope {
                Scope::Geometry(what) => what,
                Scope::Drive(_) => "the armature",
                Scope::Coupling => "a coupling",
                Scope::Potential | Scope::Lagrangian => {
                    let what = match scope {
                        Scope::Potential => "a potential may use parameters and positions",
                        _ => "a Lagrangian may use parameters, positions and velocities",
                    };
                    let help = match (text.as_str(), scope) {
                        ("q", _) => "name the joint: `q.joint`",
                        ("v", Scope::Lagrangian) => "name the coordinate: `v.x`",
                        _ => "write what depends on it as `force on joint = …;`",
                    };
                    self.diag
                        .error(name, format!("{what}, not `{text}`\nhelp: {help}"));
                    return;
                }
                _ => {
                    self.diag.error(
                        name,
                        "forces may use q, v, inputs and parameters, not the time\nhelp: declare an `input` and give its values with the data",
                    );
                    return;
                }
            };
            self.diag.error(
                name,
                format!("{place} may use parameters only, not `{text}`"),
            );
            return;
        }
        if let Some(u) = self.symbols.inputs.iter().find(|u| u.decl.name == *name)
            && !matches!(scope, Scope::Force(_))
        {
            self.diag.error(
                name,
                format!("input `{}` may be used in `force` only", u.decl.name),
            );
            return;
        }
        let candidates = self.symbols.candidates(scope);
        let near = nearest(&text, candidates.iter().map(String::as_str));
        let per_joint = self.symbols.params.iter().find_map(|p| match p.origin {
            Origin::PerJoint { decl, .. } if decl.name == *name => Some(p.field.to_string()),
            _ => None,
        });
        let help = match (near, per_joint) {
            (_, Some(field)) => format!(
                "\nhelp: `{text}` is declared per joint; here it needs the joint's name: `{field}`"
            ),
            (Some(n), _) => format!("\nhelp: a parameter with a similar name exists: `{n}`"),
            _ => format!("\nhelp: declare it in `params {{ {text}: unit = value in lo..=hi; }}`"),
        };
        let kinds = match scope {
            Scope::Force(_) => "parameter, input or coordinate",
            Scope::Coupling => "parameter or joint",
            Scope::Potential | Scope::Lagrangian => "parameter or coordinate",
            _ => "parameter",
        };
        self.diag
            .error(name, format!("no {kinds} named `{text}`{help}"));
    }
}
