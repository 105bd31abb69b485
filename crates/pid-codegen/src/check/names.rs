//! The declared names and those generated from them.

use proc_macro2::{Ident, Span};

use crate::diag::{Diagnostics, nearest, one_of};
use crate::syntax::{
    Expr, ExprKind, InputDecl, JointDecl, LinkDecl, Motion, MotorDecl, ParamDecl, PerJoint,
};
use pid_derive::model::About;

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

/// Whether a joint has a coordinate of its own, unless it is locked.
pub(super) fn is_own(decl: &JointDecl) -> bool {
    !matches!(decl.motion, Motion::Fixed) && decl.follows.is_none()
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

/// Says that there is no such joint, with the one that may be meant.
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

/// Says that a name is declared twice.
pub(super) fn twice(diag: &mut Diagnostics, second: &Ident, first: &Ident) {
    diag.error2(
        second,
        format!("the name `{second}` is declared twice"),
        first,
        format!("`{first}` was first declared here"),
    );
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

    /// The coordinate of a bare Lagrangian with this name.
    pub(super) fn coordinate(&self, name: &Ident) -> Option<usize> {
        self.joints
            .iter()
            .position(|j| matches!(j.decl.motion, Motion::Coordinate(_)) && j.decl.name == *name)
    }
}
