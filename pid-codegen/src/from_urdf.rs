//! `pub robot X from urdf "path" { … }`: the robot of a URDF file instead of a declaration.
//!
//! ```text
//! /// docs
//! pub robot Arm from urdf "robots/arm.urdf" {
//!     inertial: free;        // or fixed; free: ten standard parameters per moving body
//!     friction: free;        // or fixed: the numbers of <dynamics>
//!     armature: free;        // rotor_<joint>; without it there is none
//!     emit { dynamics, first_derivatives }
//! }
//! ```
//!
//! The path is relative to the folder of the crate's `Cargo.toml`. A constant with the file's contents in the expansion makes
//! the compiler build the crate anew when the file changes. Mistakes in the file are errors on the path, with line and mend.

use std::path::Path;

use pid_derive::model::{Emit, Robot};
use pid_urdf::{Description, Inertias, Options};
use proc_macro2::{Ident, TokenStream};
use quote::{format_ident, quote};
use syn::parse::{Parse, ParseStream};
use syn::{Attribute, LitStr, Token, Visibility, braced, token};

use crate::emit::{self, Names};

/// The declaration.
struct FromUrdf {
    attrs: Vec<Attribute>,
    vis: Visibility,
    name: Ident,
    path: LitStr,
    options: Options,
    emit: Emit,
}

/// Whether tokens declare a robot from a URDF: `robot X from` after attributes and visibility.
pub(crate) fn is_meant(input: &TokenStream) -> bool {
    let words: Vec<String> = input
        .clone()
        .into_iter()
        .filter_map(|tree| match tree {
            proc_macro2::TokenTree::Ident(ident) => Some(ident.to_string()),
            _ => None,
        })
        .take(5)
        .collect();
    words
        .windows(3)
        .any(|words| words[0] == "robot" && words[2] == "from")
}

/// Expands the declaration; `folder` is that of the crate.
pub(crate) fn expand(input: TokenStream, folder: &Path) -> TokenStream {
    let declared: FromUrdf = match syn::parse2(input) {
        Ok(declared) => declared,
        Err(error) => return error.into_compile_error(),
    };
    let (name, vis, path) = (&declared.name, &declared.vis, &declared.path);
    let robot = match robot(&declared, folder) {
        Ok(robot) => robot,
        Err(message) => {
            let error = syn::Error::new(path.span(), message).into_compile_error();
            return quote!(#error #[allow(missing_docs)] #vis struct #name;);
        }
    };
    let ident = |text: &str| format_ident!("{}", text, span = path.span());
    let names = Names {
        vis: vis.clone(),
        robot: name.clone(),
        params: robot.params.iter().map(|p| ident(&p.name)).collect(),
        joints: robot
            .joints
            .iter()
            .filter(|j| j.coord.is_some())
            .map(|j| ident(&j.name))
            .collect(),
        inputs: robot.inputs.iter().map(|u| ident(&u.name)).collect(),
    };
    let model = emit::model(&robot, &names);
    quote! {
        #model
        const _: &[u8] = ::core::include_bytes!(::core::concat!(::core::env!("CARGO_MANIFEST_DIR"), "/", #path));
    }
}

fn robot(declared: &FromUrdf, folder: &Path) -> Result<Robot, String> {
    let written = declared.path.value();
    let text = std::fs::read_to_string(folder.join(&written)).map_err(|error| {
        format!("{written}: cannot be read: {error}\nhelp: the path is relative to the folder of Cargo.toml")
    })?;
    let description = Description::parse(&written, &text).map_err(|error| error.to_string())?;
    let mut robot =
        pid_urdf::robot(&description, &declared.options).map_err(|error| error.to_string())?;
    if robot.nq() == 0 {
        return Err(format!(
            "{written}: no joint moves\nhelp: give a joint that is not fixed"
        ));
    }
    if let Some(coord) = pid_derive::facts(&robot).singular_mass {
        let joint = robot.joints.iter().find(|joint| joint.coord == Some(coord));
        return Err(format!(
            "{written}: what joint `{}` moves has no mass and no inertia about its axis\nhelp: give a link that it carries an <inertial>",
            joint.map_or("", |joint| &joint.name)
        ));
    }
    robot.name = declared.name.to_string();
    robot.docs = docs(&declared.attrs);
    robot.emit = declared.emit;
    Ok(robot)
}

/// The lines of `///`.
fn docs(attrs: &[Attribute]) -> Vec<String> {
    let line = |attr: &Attribute| match &attr.meta {
        syn::Meta::NameValue(pair) if pair.path.is_ident("doc") => match &pair.value {
            syn::Expr::Lit(syn::ExprLit {
                lit: syn::Lit::Str(text),
                ..
            }) => Some(text.value()),
            _ => None,
        },
        _ => None,
    };
    attrs.iter().filter_map(line).collect()
}

impl Parse for FromUrdf {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let attrs = input.call(Attribute::parse_outer)?;
        let vis = input.parse()?;
        word(input, &["robot"])?;
        let name = input.parse()?;
        word(input, &["from"])?;
        word(input, &["urdf"])?;
        let path = input.parse()?;
        let body;
        braced!(body in input);
        let mut declared = Self {
            attrs,
            vis,
            name,
            path,
            options: Options::default(),
            emit: Emit {
                first_derivatives: true,
                second_derivatives: true,
                ..Emit::default()
            },
        };
        while !body.is_empty() {
            declared.item(&body)?;
        }
        Ok(declared)
    }
}

impl FromUrdf {
    fn item(&mut self, body: ParseStream<'_>) -> syn::Result<()> {
        let item = word(body, &["inertial", "friction", "armature", "emit"])?;
        if item == "emit" {
            return self.emit(body);
        }
        body.parse::<Token![:]>()?;
        let free = word(body, &["free", "fixed"])? == "free";
        body.parse::<Token![;]>()?;
        match item.as_str() {
            "inertial" => {
                self.options.inertias = if free {
                    Inertias::Standard
                } else {
                    Inertias::Numbers
                };
            }
            "friction" => self.options.friction = free,
            _ => self.options.armature = free,
        }
        Ok(())
    }

    fn emit(&mut self, body: ParseStream<'_>) -> syn::Result<()> {
        let list;
        let _: token::Brace = braced!(list in body);
        self.emit = Emit::default();
        while !list.is_empty() {
            const PARTS: [&str; 3] = ["dynamics", "first_derivatives", "second_derivatives"];
            match word(&list, &PARTS)?.as_str() {
                "first_derivatives" => self.emit.first_derivatives = true,
                "second_derivatives" => {
                    self.emit.first_derivatives = true;
                    self.emit.second_derivatives = true;
                }
                _ => {}
            }
            if !list.is_empty() {
                list.parse::<Token![,]>()?;
            }
        }
        Ok(())
    }
}

/// One of some words.
fn word(input: ParseStream<'_>, words: &[&str]) -> syn::Result<String> {
    let ident: Ident = input.parse()?;
    let found = ident.to_string();
    if words.contains(&found.as_str()) {
        return Ok(found);
    }
    let known = words
        .iter()
        .map(|word| format!("`{word}`"))
        .collect::<Vec<_>>();
    Err(syn::Error::new(
        ident.span(),
        format!("expected {}, found `{found}`", known.join(" or ")),
    ))
}
