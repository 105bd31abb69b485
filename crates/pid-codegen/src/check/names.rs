//! Names: the declared ones, those generated from them, and the meaning of a name at its use.

use proc_macro2::{Ident, Span};

use crate::diag::{Diagnostics, nearest, one_of};
use crate::syntax::{
    Ast, Expr, ExprKind, InputDecl, JointDecl, LinkDecl, Motion, MotorDecl, ParamDecl, PerJoint,
};
use pid_derive::model::{About, Func};

/// Everything declared, ranges and `per joint` blocks expanded.
#[derive(Debug, Default)]
pub struct Symbols<'a> {
    /// Parameters in the order of the generated struct.
    pub params: Vec<ParamSymbol<'a>>,
    /// Inputs in the order of the generated struct.
    pub inputs: Vec<InputSymbol<'a>>,
    /// Links.
    pub links: Vec<LinkSymbol<'a>>,
    /// Joints, or the coordinates of a bare Lagrangian.
    pub joints: Vec<JointSymbol<'a>>,
    /// Motors. Where a "joint" is meant by its index, motor `k` is number `joints.len() + k`.
    pub motors: Vec<&'a MotorDecl>,
    /// Names whose declaration was refused: their uses are not reported again.
    pub refused: Vec<String>,
    /// `per joint` blocks with the joints they cover.
    pub blocks: Vec<(&'a PerJoint, Vec<usize>)>,
}

/// A parameter of the generated struct.
#[derive(Debug)]
pub struct ParamSymbol<'a> {
    /// Its field, with the place given to it.
    pub field: Ident,
    /// Where it was declared.
    pub decl: Span,
    /// Its origin.
    pub origin: Origin<'a>,
}

/// The origin of a parameter.
#[derive(Debug, Clone, Copy)]
pub enum Origin<'a> {
    /// The `params` block.
    Declared(&'a ParamDecl),
    /// A `per joint` block.
    PerJoint {
        /// The declaration.
        decl: &'a ParamDecl,
        /// Index of the block.
        block: usize,
        /// Index of the joint.
        joint: usize,
        /// Position of the joint in the block.
        nth: usize,
    },
    /// `inertial: free` of a link.
    Free {
        /// Index of the link.
        link: usize,
        /// Which of the ten.
        entry: usize,
        /// The form.
        about: About,
    },
}

/// An input of the generated struct.
#[derive(Debug)]
pub struct InputSymbol<'a> {
    /// Its field.
    pub field: Ident,
    /// The declaration.
    pub decl: &'a InputDecl,
    /// Index of the joint or motor; none of inputs of the whole robot.
    pub joint: Option<usize>,
}

/// A link, taken out of a range.
#[derive(Debug)]
pub struct LinkSymbol<'a> {
    /// Its name.
    pub ident: Ident,
    /// The declaration.
    pub decl: &'a LinkDecl,
}

/// A joint.
#[derive(Debug)]
pub struct JointSymbol<'a> {
    /// The declaration.
    pub decl: &'a JointDecl,
    /// Its coordinate, if it moves on its own.
    pub coord: Option<usize>,
    /// Where a variant holds it.
    pub lock: Option<&'a Expr>,
}

/// The place of an expression, which decides what it may use.
#[derive(Debug, Clone, Copy)]
pub enum Scope {
    /// Numbers only: ranges, nominal values, axes.
    Constant(&'static str),
    /// Parameters: gravity, links, origins of joints.
    Geometry(&'static str),
    /// Parameters, those of the joint by their bare names: armature.
    Drive(usize),
    /// Everything: force laws of a joint.
    Force(usize),
    /// Parameters, and joints by their bare names: what a joint or motor follows.
    Coupling,
    /// Parameters and positions: potentials.
    Potential,
    /// Parameters, positions and velocities.
    Lagrangian,
}

/// The meaning of a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// A parameter.
    Param(usize),
    /// An input.
    Input(usize),
    /// The position of a joint or motor.
    Position(usize),
    /// The velocity of a joint or motor.
    Velocity(usize),
    /// π.
    Pi,
}

/// Suffixes of the parameters of `inertial: free`.
const LINEAR: [&str; 10] = [
    "m", "mx", "my", "mz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];
const AT_COM: [&str; 10] = [
    "m", "sx", "sy", "sz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];

const RESERVED: [&str; 5] = ["q", "v", "a", "t", "pi"];

/// Functions of force laws.
pub const FUNCTIONS: [(&str, Func); 10] = [
    ("sin", Func::Sin),
    ("cos", Func::Cos),
    ("tan", Func::Tan),
    ("tanh", Func::Tanh),
    ("atan", Func::Atan),
    ("exp", Func::Exp),
    ("ln", Func::Ln),
    ("sqrt", Func::Sqrt),
    ("abs", Func::Abs),
    ("sign", Func::Sign),
];

/// The variant of an enum made of a snake-case name: `dry_shoulder` to `DryShoulder`.
pub fn variant_name(name: &str) -> String {
    name.split('_')
        .flat_map(|word| {
            let mut chars = word.chars();
            chars
                .next()
                .into_iter()
                .flat_map(char::to_uppercase)
                .chain(chars)
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Lists everything declared and reports names that are declared twice, reserved, or collide once generated.
pub fn collect<'a>(ast: &'a Ast, diag: &mut Diagnostics) -> Symbols<'a> {
    let links = collect_links(ast, diag);
    let joints = collect_joints(ast, diag);
    let motors = collect_motors(ast, &joints, diag);
    let blocks = ast.per_joint.iter().map(|b| (b, covered(b, &joints, diag)));
    let driven = (joints.len()..)
        .zip(&motors)
        .map(|(j, m)| (&m.body, vec![j]));
    let blocks = blocks.chain(driven).collect();
    let mut s = Symbols {
        params: Vec::new(),
        inputs: Vec::new(),
        links,
        joints,
        motors,
        refused: Vec::new(),
        blocks,
    };
    s.declare_params(ast, diag);
    s.declare_inputs(ast, diag);
    s.declare_free(diag);
    s.declare_per_joint(diag);
    s.refuse_shadowing(ast, diag);
    s.refuse_equal_variants(diag);
    s
}

fn collect_links<'a>(ast: &'a Ast, diag: &mut Diagnostics) -> Vec<LinkSymbol<'a>> {
    let mut links: Vec<LinkSymbol<'a>> = Vec::new();
    for decl in &ast.links {
        for ident in &decl.names.idents {
            if ident == "base" {
                diag.error(
                    ident,
                    "`base` is the frame the robot stands on and cannot be declared as a link",
                );
            } else if let Some(first) = links.iter().find(|l| l.ident == *ident) {
                twice(diag, ident, &first.ident);
            } else if usable(ident, diag) {
                links.push(LinkSymbol {
                    ident: ident.clone(),
                    decl,
                });
            }
        }
    }
    links
}

fn collect_joints<'a>(ast: &'a Ast, diag: &mut Diagnostics) -> Vec<JointSymbol<'a>> {
    let mut joints: Vec<JointSymbol<'a>> = Vec::new();
    let mut coords = 0;
    for decl in &ast.joints {
        let name = &decl.name;
        if let Some(first) = joints.iter().find(|j| j.decl.name == *name) {
            twice(diag, name, &first.decl.name);
        } else if let Some(first) = joints
            .iter()
            .find(|j| variant_name(&j.decl.name.to_string()) == variant_name(&name.to_string()))
        {
            same_variant(diag, name, &first.decl.name);
        } else if usable(name, diag) {
            if matches!(decl.motion, Motion::Coordinate(_)) && !declarable(name, diag) {
                continue;
            }
            let held = ast
                .locks
                .iter()
                .find(|l| l.joints.idents.iter().any(|i| i == name));
            let lock = held.map(|l| &l.value);
            let own = is_own(decl) && lock.is_none();
            let coord = own.then_some(coords);
            coords += usize::from(own);
            joints.push(JointSymbol { decl, coord, lock });
        }
    }
    joints
}

/// Whether a joint has a coordinate of its own, unless it is locked.
pub(super) fn is_own(decl: &JointDecl) -> bool {
    !matches!(decl.motion, Motion::Fixed) && decl.follows.is_none()
}

fn collect_motors<'a>(
    ast: &'a Ast,
    joints: &[JointSymbol<'a>],
    diag: &mut Diagnostics,
) -> Vec<&'a MotorDecl> {
    let mut motors: Vec<&MotorDecl> = Vec::new();
    for decl in &ast.motors {
        let name = &decl.name;
        let declared = joints.iter().map(|j| &j.decl.name);
        let mut declared = declared.chain(motors.iter().map(|m| &m.name));
        if let Some(first) = declared.find(|first| *first == name) {
            twice(diag, name, first);
        } else if usable(name, diag) {
            motors.push(decl);
        }
    }
    motors
}

/// All names in an expression, functions left out.
pub(super) fn names_in<'e>(e: &'e Expr, out: &mut Vec<&'e Ident>) {
    match &e.kind {
        ExprKind::Number(..) => {}
        ExprKind::Name(name) => out.push(name),
        ExprKind::Member(_, joint) => out.push(joint),
        ExprKind::Neg(x) | ExprKind::Pow(x, _) => names_in(x, out),
        ExprKind::Binary(_, _, a, b) => {
            names_in(a, out);
            names_in(b, out);
        }
        ExprKind::Call(_, args) => args.iter().for_each(|a| names_in(a, out)),
    }
}

/// The joints a `per joint` block covers.
fn covered(block: &PerJoint, joints: &[JointSymbol<'_>], diag: &mut Diagnostics) -> Vec<usize> {
    let Some(named) = &block.joints else {
        return (0..joints.len())
            .filter(|&j| is_own(joints[j].decl))
            .collect();
    };
    let mut out = Vec::new();
    for ident in named.iter().flat_map(|n| &n.idents) {
        match joints.iter().position(|j| j.decl.name == *ident) {
            None => unknown_joint(diag, ident, joints),
            Some(j) if matches!(joints[j].decl.motion, Motion::Fixed) => diag.error(
                ident,
                format!(
                    "joint `{ident}` is fixed: it has no drive\nhelp: leave it out of `per joint`"
                ),
            ),
            Some(j) if out.contains(&j) => {
                diag.error(ident, format!("joint `{ident}` is named twice"));
            }
            Some(j) => out.push(j),
        }
    }
    out
}

pub(super) fn unknown_joint(diag: &mut Diagnostics, ident: &Ident, joints: &[JointSymbol<'_>]) {
    let names: Vec<String> = joints.iter().map(|j| j.decl.name.to_string()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let help = match nearest(&ident.to_string(), names.iter().copied()) {
        Some(n) => format!("\nhelp: a joint with a similar name exists: `{n}`"),
        None if names.is_empty() => String::new(),
        None if names.len() == 1 => format!("\nhelp: the only joint is `{}`", names[0]),
        None => format!(
            "\nhelp: the joints are {}",
            one_of(&names).replace(" or ", " and ")
        ),
    };
    diag.error(ident, format!("no joint named `{ident}`{help}"));
}

pub(super) fn twice(diag: &mut Diagnostics, second: &Ident, first: &Ident) {
    diag.error2(
        second,
        format!("the name `{second}` is declared twice"),
        first,
        format!("`{first}` was first declared here"),
    );
}

fn same_variant(diag: &mut Diagnostics, second: &Ident, first: &Ident) {
    diag.error2(
        second,
        format!(
            "`{second}` and `{first}` both become the variant `{}`\nhelp: rename one of them",
            variant_name(&second.to_string())
        ),
        first,
        format!("`{first}` is declared here"),
    );
}

/// Whether Rust lets the name be a field, and its variant a variant.
fn usable(ident: &Ident, diag: &mut Diagnostics) -> bool {
    let name = ident.to_string();
    let why = if name.starts_with("r#") || syn::parse_str::<Ident>(&name).is_err() || name == "self"
    {
        "is a keyword of Rust"
    } else if !name.starts_with(char::is_alphabetic) {
        "does not start with a letter"
    } else {
        return true;
    };
    diag.error(
        ident,
        format!("`{name}` cannot be declared: it {why}\nhelp: choose another name"),
    );
    false
}

impl<'a> Symbols<'a> {
    /// Name of a joint or motor.
    pub fn name(&self, joint: usize) -> &'a Ident {
        match self.joints.get(joint) {
            Some(j) => &j.decl.name,
            None => &self.motors[joint - self.joints.len()].name,
        }
    }

    /// Index of the joint or motor with this name.
    pub fn mover(&self, name: &Ident) -> Option<usize> {
        (0..self.joints.len() + self.motors.len()).find(|&j| self.name(j) == name)
    }

    /// The joints that a joint or motor without a coordinate of its own follows.
    pub fn follows(&self, joint: usize) -> Option<&'a Expr> {
        match self.joints.get(joint) {
            Some(j) => j.decl.follows.as_ref(),
            None => Some(&self.motors[joint - self.joints.len()].moves),
        }
    }

    /// Whether a joint or motor is at rest in this variant: locked, or following nothing but locked joints.
    pub fn is_held(&self, joint: usize) -> bool {
        if self.joints.get(joint).is_some_and(|j| j.lock.is_some()) {
            return true;
        }
        let Some(e) = self.follows(joint) else {
            return false;
        };
        let mut names = Vec::new();
        names_in(e, &mut names);
        let mut leaders = self
            .joints
            .iter()
            .filter(|j| names.iter().any(|n| j.decl.name == **n))
            .peekable();
        leaders.peek().is_some() && leaders.all(|j| j.lock.is_some())
    }

    fn coordinate(&self, name: &Ident) -> Option<usize> {
        self.joints
            .iter()
            .position(|j| matches!(j.decl.motion, Motion::Coordinate(_)) && j.decl.name == *name)
    }

    fn declare_inputs(&mut self, ast: &'a Ast, diag: &mut Diagnostics) {
        for decl in &ast.inputs {
            let name = &decl.name;
            let params = self.params.iter().map(|p| &p.field);
            let mut fields = params.chain(self.inputs.iter().map(|u| &u.field));
            let first = fields.find(|f| *f == name).cloned();
            let coordinate = self.coordinate(name).map(|j| self.name(j).clone());
            if let Some(first) = first.or(coordinate) {
                twice(diag, name, &first);
            } else if declarable(name, diag) {
                self.inputs.push(InputSymbol {
                    field: name.clone(),
                    decl,
                    joint: None,
                });
            } else {
                self.refused.push(name.to_string());
            }
        }
    }

    fn declare_params(&mut self, ast: &'a Ast, diag: &mut Diagnostics) {
        for decl in &ast.params {
            if let Some(first) = self.params.iter().find(|p| p.field == decl.name) {
                twice(diag, &decl.name, &first.field);
            } else if let Some(first) = self.coordinate(&decl.name) {
                twice(diag, &decl.name, self.name(first));
            } else if declarable(&decl.name, diag) {
                self.params.push(ParamSymbol {
                    field: decl.name.clone(),
                    decl: decl.name.span(),
                    origin: Origin::Declared(decl),
                });
            } else {
                self.refused.push(decl.name.to_string());
            }
        }
    }

    fn declare_free(&mut self, diag: &mut Diagnostics) {
        for (k, link) in self.links.iter().enumerate() {
            let Some(free) = link.decl.free else { continue };
            let suffixes = match free.about {
                About::Origin => LINEAR,
                About::Com => AT_COM,
            };
            for (entry, suffix) in suffixes.iter().enumerate() {
                let name = format!("{}_{suffix}", link.ident);
                if let Some(first) = self.params.iter().find(|p| p.field == name) {
                    diag.error2(
                        link.ident.span(),
                        format!(
                            "`{name}` is generated for link `{}` (`inertial: free`) and also declared in `params`",
                            link.ident
                        ),
                        first.decl,
                        format!("`{name}` is declared here\nhelp: rename it"),
                    );
                    continue;
                }
                self.params.push(ParamSymbol {
                    field: Ident::new(&name, Span::call_site()),
                    decl: link.ident.span(),
                    origin: Origin::Free {
                        link: k,
                        entry,
                        about: free.about,
                    },
                });
            }
        }
    }

    fn declare_per_joint(&mut self, diag: &mut Diagnostics) {
        for b in 0..self.blocks.len() {
            let (block, joints) = &self.blocks[b].clone();
            let mut own: Vec<&Ident> = Vec::new();
            let mut fresh = |name: &'a Ident, diag: &mut Diagnostics| {
                if let Some(first) = own.iter().find(|i| **i == name) {
                    twice(diag, name, first);
                    return false;
                }
                own.push(name);
                declarable(name, diag)
            };
            let inputs = block.inputs.iter().filter(|d| fresh(&d.name, diag));
            for decl in inputs.collect::<Vec<_>>() {
                self.per_joint(&decl.name, joints, diag, |symbols, field, joint, _| {
                    symbols.inputs.push(InputSymbol {
                        field,
                        decl,
                        joint: Some(joint),
                    });
                });
            }
            let params = block.params.iter().filter(|d| fresh(&d.name, diag));
            for decl in params.collect::<Vec<_>>() {
                self.per_joint(&decl.name, joints, diag, |symbols, field, joint, nth| {
                    symbols.params.push(ParamSymbol {
                        field,
                        decl: decl.name.span(),
                        origin: Origin::PerJoint {
                            decl,
                            block: b,
                            joint,
                            nth,
                        },
                    });
                });
            }
        }
    }

    /// Adds the fields of a name for each joint of its block that is not held.
    fn per_joint(
        &mut self,
        name: &Ident,
        joints: &[usize],
        diag: &mut Diagnostics,
        add: impl Fn(&mut Self, Ident, usize, usize),
    ) {
        for (nth, &joint) in joints.iter().enumerate() {
            if self.is_held(joint) {
                continue;
            }
            let Some(field) = self.generated(name, joint, nth, diag) else {
                self.refused.push(name.to_string());
                break;
            };
            add(self, field, joint, nth);
        }
    }

    /// The field `dry_shoulder` of `dry`; an error if it exists already.
    fn generated(
        &self,
        name: &Ident,
        joint: usize,
        nth: usize,
        diag: &mut Diagnostics,
    ) -> Option<Ident> {
        let joint = self.name(joint);
        let field = format!("{name}_{joint}");
        let taken = self
            .params
            .iter()
            .map(|p| (&p.field, p.decl))
            .chain(self.inputs.iter().map(|u| (&u.field, u.decl.name.span())))
            .find(|(f, _)| **f == field);
        if let Some((_, first)) = taken {
            diag.error2(
                name,
                format!("`{field}` is generated for joint `{joint}` (`{name}` per joint) and also declared elsewhere"),
                first,
                format!("`{field}` comes from here\nhelp: rename one of them"),
            );
            return None;
        }
        let span = if nth == 0 {
            name.span()
        } else {
            Span::call_site()
        };
        Some(Ident::new(&field, span))
    }

    /// A bare name must not mean a parameter of the robot and one of the joint at once.
    fn refuse_shadowing(&self, ast: &Ast, diag: &mut Diagnostics) {
        for block in ast
            .per_joint
            .iter()
            .chain(ast.motors.iter().map(|m| &m.body))
        {
            let bare =
                (block.params.iter().map(|p| &p.name)).chain(block.inputs.iter().map(|u| &u.name));
            for name in bare {
                let params = ast.params.iter().map(|p| &p.name);
                let mut all = params.chain(ast.inputs.iter().map(|u| &u.name));
                if let Some(first) = all.find(|first| *first == name) {
                    twice(diag, name, first);
                }
            }
        }
    }

    fn refuse_equal_variants(&self, diag: &mut Diagnostics) {
        for (k, p) in self.params.iter().enumerate() {
            let variant = variant_name(&p.field.to_string());
            let earlier = self.params[..k]
                .iter()
                .find(|e| variant_name(&e.field.to_string()) == variant);
            if let Some(first) = earlier {
                let at = |s: &ParamSymbol<'_>| Ident::new(&s.field.to_string(), s.decl);
                same_variant(diag, &at(p), &at(first));
            }
        }
    }

    /// The meaning of `name` in `scope`.
    pub fn lookup(&self, name: &Ident, scope: Scope) -> Option<Meaning> {
        if name == "pi" {
            return Some(Meaning::Pi);
        }
        let joint = match scope {
            Scope::Constant(_) => return None,
            Scope::Drive(j) | Scope::Force(j) => Some(j),
            _ => None,
        };
        if let Scope::Force(j) = scope {
            if name == "q" {
                return Some(Meaning::Position(j));
            }
            if name == "v" {
                return Some(Meaning::Velocity(j));
            }
            let found = self
                .inputs
                .iter()
                .position(|u| (u.joint == Some(j) && u.decl.name == *name) || u.field == *name);
            if let Some(k) = found {
                return Some(Meaning::Input(k));
            }
        }
        if let Scope::Force(_) | Scope::Potential | Scope::Lagrangian = scope
            && let Some(j) = self.coordinate(name)
        {
            return Some(Meaning::Position(j));
        }
        if let Scope::Coupling = scope
            && let Some(j) = self.joints.iter().position(|j| j.decl.name == *name)
        {
            return Some(Meaning::Position(j));
        }
        let own = joint.and_then(|j| {
            self.params.iter().position(|p| {
                matches!(p.origin, Origin::PerJoint { decl, joint, .. } if joint == j && decl.name == *name)
            })
        });
        own.or_else(|| self.params.iter().position(|p| p.field == *name))
            .map(Meaning::Param)
    }

    /// The meaning of `q.joint` or `v.joint`.
    pub fn member(&self, what: &Ident, joint: &Ident) -> Option<Meaning> {
        let j = self.mover(joint)?;
        match what.to_string().as_str() {
            "q" => Some(Meaning::Position(j)),
            "v" => Some(Meaning::Velocity(j)),
            _ => None,
        }
    }

    /// Names that the user may have meant in `scope`.
    pub(super) fn candidates(&self, scope: Scope) -> Vec<String> {
        let mut out = Vec::new();
        let joint = match scope {
            Scope::Constant(_) => return out,
            Scope::Drive(j) | Scope::Force(j) => Some(j),
            _ => None,
        };
        for p in &self.params {
            match p.origin {
                Origin::PerJoint { decl, joint: j, .. } if Some(j) == joint => {
                    out.push(decl.name.to_string());
                }
                _ => out.push(p.field.to_string()),
            }
        }
        if let Scope::Force(j) = scope {
            let own = self
                .inputs
                .iter()
                .filter(|u| u.joint.is_none_or(|of| of == j));
            out.extend(own.map(|u| u.decl.name.to_string()));
        }
        let joints = self.joints.iter().filter(|j| match scope {
            Scope::Coupling => true,
            Scope::Force(_) | Scope::Potential | Scope::Lagrangian => {
                matches!(j.decl.motion, Motion::Coordinate(_))
            }
            _ => false,
        });
        out.extend(joints.map(|j| j.decl.name.to_string()));
        out
    }
}

/// Whether a parameter or input may have this name.
fn declarable(ident: &Ident, diag: &mut Diagnostics) -> bool {
    let name = ident.to_string();
    if RESERVED.contains(&name.as_str()) {
        let what = match name.as_str() {
            "q" => "the coordinate",
            "v" => "the velocity",
            "a" => "the acceleration",
            "t" => "the time",
            _ => "the number 3.14…",
        };
        diag.error(
            ident,
            format!("`{name}` cannot be declared: it means {what}\nhelp: choose another name"),
        );
        return false;
    }
    usable(ident, diag)
}
