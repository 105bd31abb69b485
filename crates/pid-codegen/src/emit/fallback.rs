//! Expansion of a robot with mistakes: the errors, and the public items of a good robot without
//! bodies.
//!
//! So `TwoLinkParams { m2: … }` elsewhere gives no error of its own and keeps its completion while
//! the declaration is being written. Only accepted names appear, each once.

use proc_macro2::{Ident, TokenStream};
use quote::quote;

use super::names::{Face, Names, derived};
use super::types;
use crate::check::{
    collect,
    names::{Origin, Symbols},
};
use crate::diag::Diagnostics;
use crate::syntax::Ast;
use pid_derive::model::{Emit, Input, Joint, JointKind, Param, Robot};

/// Errors and stubs, of the robot and its variants.
pub fn fallback(ast: &Ast, diag: &Diagnostics, face: Face) -> TokenStream {
    let mut tokens = diag.errors_to_tokens();
    tokens.extend(stub(ast, false, face));
    for (k, variant) in ast.variants.iter().enumerate() {
        let taken = ast.variants[..k].iter().any(|v| v.name == variant.name);
        if !taken && variant.name != ast.name {
            tokens.extend(stub(&ast.variant(k), true, face));
        }
    }
    tokens
}

/// The items of one model.
fn stub(ast: &Ast, variant: bool, face: Face) -> TokenStream {
    // Names that were refused have been reported; here only the accepted ones count.
    let mut silent = Diagnostics::new();
    let symbols = collect::collect(ast, &mut silent);
    let mut names = Names {
        face,
        vis: ast.visibility(),
        robot: ast.name.clone(),
        params: symbols.params.iter().map(|p| p.field.clone()).collect(),
        joints: symbols
            .joints
            .iter()
            .filter(|j| j.coord.is_some())
            .map(|j| j.decl.name.clone())
            .collect(),
        inputs: symbols.inputs.iter().map(|u| u.field.clone()).collect(),
    };
    if variant {
        names = names.without_places();
    }
    stub_of(&skeleton(ast, &symbols), &names)
}

/// The items of a robot whose names are known, without the body of any function.
pub fn stub_of(robot: &Robot, names: &Names) -> TokenStream {
    let types = types::types(robot, names, &robot.docs);
    let functions = functions(names);
    let full = names.face == Face::Full;
    let more = full.then(|| functions_of_full(names));
    let traits = full.then(|| traits(&names.robot));
    quote! {
        #types
        #[allow(clippy::all, missing_docs, unused_variables)]
        const _: () = {
            #functions
            #more
            #traits
        };
    }
}

/// A robot of which nothing but its own name is known.
pub fn nameless(ast: &Ast) -> Robot {
    skeleton(ast, &Symbols::default())
}

/// A robot with names and nothing else.
fn skeleton(ast: &Ast, symbols: &Symbols<'_>) -> Robot {
    let zero = || [0, 1, 2].map(|_| pid_derive::model::Expr::Num(0.0));
    Robot {
        docs: ast.docs.clone(),
        params: symbols
            .params
            .iter()
            .map(|p| Param {
                name: p.field.to_string(),
                docs: match p.origin {
                    Origin::Declared(d) | Origin::PerJoint { decl: d, .. } => d.docs.clone(),
                    Origin::Free { .. } => Vec::new(),
                },
                unit: String::new(),
                nominal: 0.0,
                lower: 0.0,
                upper: 0.0,
                fixed: false,
            })
            .collect(),
        inputs: symbols
            .inputs
            .iter()
            .map(|u| Input {
                name: u.field.to_string(),
                docs: u.decl.docs.clone(),
                unit: String::new(),
                coord: None,
            })
            .collect(),
        joints: symbols
            .joints
            .iter()
            .map(|j| Joint {
                name: j.decl.name.to_string(),
                docs: j.decl.docs.clone(),
                kind: JointKind::Fixed,
                coord: j.coord,
                follows: None,
                parent: None,
                child: 0,
                origin: zero(),
                rpy: zero(),
                limits: None,
                armature: None,
                force: None,
            })
            .collect(),
        emit: Emit {
            first_derivatives: true,
            second_derivatives: true,
            regressor: true,
            base_parameters: true,
            lanes: false,
        },
        ..Robot::new(ast.name.to_string(), zero())
    }
}

/// The typed face.
fn functions(names: &Names) -> TokenStream {
    let robot = &names.robot;
    let (params, inputs) = (derived(names, "Params"), derived(names, "Inputs"));
    let (nq, nu, np) = (names.joints.len(), names.inputs.len(), names.params.len());
    let a = quote!(&[f64; #nq]);
    let out = quote!([f64; #nq]);
    let never = quote!({ ::core::unreachable!() });
    quote! {
        impl #robot {
            pub const NQ: usize = #nq;
            pub const NU: usize = #nu;
            pub const NP: usize = #np;
            pub const RANK: usize = 0;
            pub const RANK_NOMINAL: usize = 0;
            pub const JACOBIAN_NNZ: usize = 0;
            pub const HESSIAN_NNZ: usize = 0;
            pub fn mass_matrix(q: #a, params: &#params) -> [[f64; #nq]; #nq] #never
            pub fn bias(q: #a, v: #a, params: &#params) -> #out #never
            pub fn gravity(q: #a, params: &#params) -> #out #never
            pub fn applied_force(q: #a, v: #a, inputs: &#inputs, params: &#params) -> #out #never
            pub fn residual(q: #a, v: #a, a: #a, inputs: &#inputs, params: &#params) -> #out #never
            pub fn inverse_dynamics(q: #a, v: #a, a: #a, params: &#params) -> #out #never
            pub fn kinetic_energy(q: #a, v: #a, params: &#params) -> f64 #never
            pub fn potential_energy(q: #a, params: &#params) -> f64 #never
            pub fn inverse_dynamics_derivatives(q: #a, v: #a, a: #a, params: &#params)
                -> ::pid_runtime::dynamics::InverseDynamicsDerivatives<#nq, #np> #never
            pub fn lagrangian_hessian(q: #a, v: #a, a: #a, inputs: &#inputs, params: &#params, lambda: #a)
                -> [f64; 0] #never
        }
    }
}

/// What the full face has beside it.
fn functions_of_full(names: &Names) -> TokenStream {
    let robot = &names.robot;
    let (params, inputs) = (derived(names, "Params"), derived(names, "Inputs"));
    let param = derived(names, "Param");
    let nq = names.joints.len();
    let a = quote!(&[f64; #nq]);
    let out = quote!([f64; #nq]);
    let singular = quote!(::pid_runtime::dynamics::SingularMassMatrix);
    let never = quote!({ ::core::unreachable!() });
    let d = quote!(<D: ::pid_runtime::num_dual::DualNum<Primitive = f64> + ::core::marker::Copy>);
    quote! {
        impl #robot {
            pub fn forward_dynamics(q: #a, v: #a, inputs: &#inputs, params: &#params)
                -> ::core::result::Result<#out, #singular> #never
            pub const NL: usize = 0;
            pub const NB: usize = 0;
            pub const REGRESSOR_PARAMS: [#param; 0] = [];
            pub const BASE: [&'static str; 0] = [];
            pub fn regressor(q: #a, v: #a, a: #a) -> [[f64; 0]; #nq] #never
            pub fn regressor_offset(q: #a, v: #a, a: #a, params: &#params) -> #out #never
            pub fn base_parameters(params: &#params) -> [f64; 0] #never
            pub fn base_regressor(q: #a, v: #a, a: #a) -> [[f64; 0]; #nq] #never
            pub fn residual_generic #d (q: &[D], v: &[D], a: &[D], u: &[D], p: &[D], r: &mut [D]) #never
            pub fn vector_field_generic #d (q: &[D], v: &[D], u: &[D], p: &[D], a: &mut [D])
                -> ::core::result::Result<(), #singular> #never
        }
        #[automatically_derived]
        impl ::pid_runtime::generic::GenericDynamics for #robot {
            fn residual_generic #d (&self, q: &[D], v: &[D], a: &[D], u: &[D], p: &[D], r: &mut [D]) #never
            fn vector_field_generic #d (&self, q: &[D], v: &[D], u: &[D], p: &[D], a: &mut [D])
                -> ::core::result::Result<(), #singular> #never
        }
    }
}

/// The slice face.
fn traits(robot: &Ident) -> TokenStream {
    let d = quote!(::pid_runtime::dynamics);
    let at = quote!(at: &#d::At<'_>);
    let never = quote!({ ::core::unreachable!() });
    quote! {
        #[automatically_derived]
        impl #d::Dynamics for #robot {
            fn name(&self) -> &str #never
            fn dims(&self) -> #d::Dims #never
            fn params(&self) -> &[#d::ParamInfo] #never
            fn joints(&self) -> &[#d::JointInfo] #never
            fn inputs(&self) -> &[#d::InputInfo] #never
            fn mass_matrix(&self, #at, m: &mut [f64]) #never
            fn bias(&self, #at, b: &mut [f64]) #never
            fn applied_force(&self, #at, f: &mut [f64]) #never
            fn residual(&self, #at, r: &mut [f64]) #never
            fn kinetic_energy(&self, #at) -> f64 #never
            fn potential_energy(&self, #at) -> f64 #never
        }
        #[automatically_derived]
        impl #d::Jacobian for #robot {
            fn jacobian_pattern(&self) -> #d::Pattern<'_> #never
            fn residual_jacobian(&self, #at, r: &mut [f64], values: &mut [f64]) #never
        }
        #[automatically_derived]
        impl #d::Regressor for #robot {
            fn linear_params(&self) -> &[usize] #never
            fn regressor_pattern(&self) -> #d::Pattern<'_> #never
            fn regressor(&self, #at, offset: &mut [f64], values: &mut [f64]) #never
        }
        #[automatically_derived]
        impl #d::Hessian for #robot {
            fn hessian_pattern(&self) -> #d::Pattern<'_> #never
            fn residual_hessian(&self, #at, lambda: &[f64], values: &mut [f64]) #never
        }
    }
}
