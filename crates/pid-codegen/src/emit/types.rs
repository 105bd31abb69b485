//! The types a user names: the robot, its parameters, joints and inputs.

use proc_macro2::{Ident, Span, TokenStream};
use quote::quote;

use super::docs;
use super::functions::number;
use super::names::{Names, derived};
use pid_derive::model::{Joint, Robot};

/// All types of a robot, with their functions.
pub fn types(robot: &Robot, names: &Names, robot_docs: &[String]) -> TokenStream {
    let (vis, name) = (&names.vis, &names.robot);
    let robot_docs = docs::attributes(robot_docs);
    let params = params(robot, names);
    let param_enum = param_enum(robot, names);
    let joints = joints(robot, names);
    let inputs = inputs(robot, names);
    quote! {
        #robot_docs
        #[derive(
            ::core::fmt::Debug, ::core::clone::Clone, ::core::marker::Copy, ::core::default::Default,
            ::core::cmp::PartialEq, ::core::cmp::Eq
        )]
        #vis struct #name;
        #params
        #param_enum
        #joints
        #inputs
    }
}

/// `dry_shoulder` as `DryShoulder`. Names that differ only in underscores get one appended until they differ.
fn variants<'a>(names: impl Iterator<Item = &'a Ident>, keep_span: bool) -> Vec<Ident> {
    let mut variants: Vec<Ident> = Vec::new();
    for name in names {
        let plain = name.to_string();
        let plain = plain.strip_prefix("r#").unwrap_or(&plain);
        let mut camel = String::new();
        let mut upper = true;
        for c in plain.chars() {
            if c == '_' {
                upper = true;
            } else if std::mem::take(&mut upper) {
                camel.extend(c.to_uppercase());
            } else {
                camel.push(c);
            }
        }
        // `_1` and `Self` are no variants.
        if camel.is_empty() || camel.starts_with(|c: char| c.is_ascii_digit()) || camel == "Self" {
            camel.insert(0, 'X');
        }
        while variants.iter().any(|variant| *variant == camel) {
            camel.push('_');
        }
        variants.push(Ident::new(
            &camel,
            if keep_span {
                name.span()
            } else {
                Span::call_site()
            },
        ));
    }
    variants
}

fn params(robot: &Robot, names: &Names) -> TokenStream {
    let vis = &names.vis;
    let ty = derived(names, "Params");
    let fields = &names.params;
    let count = fields.len();
    let field_docs = robot
        .params
        .iter()
        .map(|param| docs::attributes(&docs::param(param)));
    let nominal = robot.params.iter().map(|param| number(param.nominal));
    let lower = robot.params.iter().map(|param| number(param.lower));
    let upper = robot.params.iter().map(|param| number(param.upper));
    let text = format!(" Parameters of [`{}`], SI units.", names.robot);
    quote! {
        #[doc = #text]
        #[derive(::core::fmt::Debug, ::core::clone::Clone, ::core::marker::Copy, ::core::cmp::PartialEq)]
        #[allow(dead_code)]
        #vis struct #ty {
            #( #field_docs pub #fields: f64, )*
        }
        #[allow(dead_code)]
        impl #ty {
            /// The nominal values.
            pub const fn nominal() -> Self {
                Self::from_array([#(#nominal),*])
            }
            /// The lower bounds; `-inf` where there is none.
            pub const fn lower() -> Self {
                Self::from_array([#(#lower),*])
            }
            /// The upper bounds; `inf` where there is none.
            pub const fn upper() -> Self {
                Self::from_array([#(#upper),*])
            }
            /// The values in the order of the slice face.
            pub const fn as_array(&self) -> [f64; #count] {
                [#(self.#fields),*]
            }
            /// Parameters from values in the order of the slice face.
            pub const fn from_array(values: [f64; #count]) -> Self {
                let [#(#fields),*] = values;
                Self { #(#fields),* }
            }
        }
    }
}

/// A function of an enum: one value per variant.
fn table(variants: &[Ident], values: impl Iterator<Item = TokenStream>) -> TokenStream {
    if variants.is_empty() {
        quote!(match *self {})
    } else {
        quote!(match self { #(Self::#variants => #values,)* })
    }
}

fn enumeration(
    vis: &syn::Visibility,
    ty: &Ident,
    text: &str,
    variants: &[Ident],
    docs: &[TokenStream],
    functions: &TokenStream,
) -> TokenStream {
    let count = variants.len();
    quote! {
        #[doc = #text]
        #[derive(
            ::core::fmt::Debug, ::core::clone::Clone, ::core::marker::Copy, ::core::cmp::PartialEq, ::core::cmp::Eq,
            ::core::hash::Hash, ::core::cmp::PartialOrd, ::core::cmp::Ord
        )]
        #[allow(dead_code)]
        #vis enum #ty {
            #( #docs #variants, )*
        }
        #[allow(dead_code)]
        impl #ty {
            /// All of them, in order.
            pub const ALL: [Self; #count] = [#(Self::#variants),*];
            #functions
        }
    }
}

fn param_enum(robot: &Robot, names: &Names) -> TokenStream {
    let ty = derived(names, "Param");
    let variants = variants(names.params.iter(), false);
    let docs: Vec<TokenStream> = robot
        .params
        .iter()
        .map(|param| docs::attributes(&docs::param(param)))
        .collect();
    let name = table(
        &variants,
        robot
            .params
            .iter()
            .map(|param| &param.name)
            .map(|name| quote!(#name)),
    );
    let unit = table(
        &variants,
        robot
            .params
            .iter()
            .map(|param| &param.unit)
            .map(|unit| quote!(#unit)),
    );
    let doc = table(
        &variants,
        robot
            .params
            .iter()
            .map(|param| docs::first_line(&param.docs))
            .map(|doc| quote!(#doc)),
    );
    let index = table(&variants, (0..variants.len()).map(|index| quote!(#index)));
    let functions = quote! {
        /// Name as declared.
        pub const fn name(&self) -> &'static str { #name }
        /// Unit, `kg*m^2`.
        pub const fn unit(&self) -> &'static str { #unit }
        /// Position in the slice face and in `as_array`.
        pub const fn index(&self) -> usize { #index }
        /// First line of its documentation.
        pub const fn doc(&self) -> &'static str { #doc }
    };
    let text = format!(" A parameter of [`{}`].", names.robot);
    enumeration(&names.vis, &ty, &text, &variants, &docs, &functions)
}

fn joints(robot: &Robot, names: &Names) -> TokenStream {
    let ty = derived(names, "Joint");
    let variants = variants(names.joints.iter(), true);
    let mut moving: Vec<&Joint> = robot
        .joints
        .iter()
        .filter(|joint| joint.coord.is_some())
        .collect();
    moving.sort_by_key(|joint| joint.coord);
    let docs: Vec<TokenStream> = moving
        .iter()
        .map(|joint| docs::attributes(&docs::joint(joint)))
        .collect();
    let name = table(
        &variants,
        moving
            .iter()
            .map(|joint| &joint.name)
            .map(|name| quote!(#name)),
    );
    let index = table(&variants, (0..variants.len()).map(|index| quote!(#index)));
    let functions = quote! {
        /// Name as declared.
        pub const fn name(&self) -> &'static str { #name }
        /// Position of its coordinate in `q`.
        pub const fn index(&self) -> usize { #index }
    };
    let text = format!(" A moving joint of [`{}`].", names.robot);
    enumeration(&names.vis, &ty, &text, &variants, &docs, &functions)
}

fn inputs(robot: &Robot, names: &Names) -> TokenStream {
    let vis = &names.vis;
    let ty = derived(names, "Inputs");
    let fields = &names.inputs;
    let count = fields.len();
    let field_docs = robot
        .inputs
        .iter()
        .map(|input| docs::attributes(&docs::input(input)));
    let text = format!(" Inputs of [`{}`].", names.robot);
    quote! {
        #[doc = #text]
        #[derive(::core::fmt::Debug, ::core::clone::Clone, ::core::marker::Copy, ::core::default::Default, ::core::cmp::PartialEq)]
        #[allow(dead_code)]
        #vis struct #ty {
            #( #field_docs pub #fields: f64, )*
        }
        #[allow(dead_code)]
        impl #ty {
            /// The values in the order of the slice face.
            pub const fn as_array(&self) -> [f64; #count] {
                [#(self.#fields),*]
            }
            /// Inputs from values in the order of the slice face.
            pub const fn from_array(values: [f64; #count]) -> Self {
                let [#(#fields),*] = values;
                Self { #(#fields),* }
            }
        }
    }
}
