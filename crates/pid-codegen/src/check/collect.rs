//! Lists the declared names; refuses those that collide, also once generated.

use proc_macro2::{Ident, Span};

use super::names::{
    InputSymbol, JointSymbol, LinkSymbol, Origin, ParamSymbol, Symbols, is_own, twice,
    unknown_joint, variant_name,
};
use crate::diag::Diagnostics;
use crate::syntax::{Ast, Motion, MotorDecl, PerJoint};
use pid_derive::model::About;

/// Suffixes of the parameters of `inertial: free`.
pub(crate) const LINEAR: [&str; 10] = [
    "m", "mx", "my", "mz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];
const AT_COM: [&str; 10] = [
    "m", "sx", "sy", "sz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];

const RESERVED: [&str; 5] = ["q", "v", "a", "t", "pi"];

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
