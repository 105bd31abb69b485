//! Regressor and base parameters: typed functions, trait.

use proc_macro2::{Ident, Literal, TokenStream};
use quote::quote;

use super::bodies::{LinearBodies as Bodies, constant, cost, formulas};
use super::docs;
use super::functions::{Layout, Part, from_slices, number};
use super::names::{Names, derived};
use pid_derive::model::Robot;
use pid_derive::{BaseParameters, Regressor};

/// Typed functions and trait of the regressor, with base parameters where asked for.
pub fn impls(
    robot: &Robot,
    names: &Names,
    layout: &Layout,
    regressor: &Regressor,
    base: Option<&BaseParameters>,
    bodies: &Bodies,
) -> TokenStream {
    let ty = &names.robot;
    let (params, param) = (derived(names, "Params"), derived(names, "Param"));
    let (nq, nl) = (layout.nq, regressor.constant);
    let definitions = [&bodies.all, &bodies.constant, &bodies.offset].map(|f| &f.definition);
    let [_, constant_ops, offset_ops] =
        [&bodies.all, &bodies.constant, &bodies.offset].map(docs::operations);

    let columns = regressor.params[..nl]
        .iter()
        .map(|&k| Literal::usize_unsuffixed(k));
    let values = bodies.constant.outputs;
    let argument = |part| idle_argument(part, layout.nu);
    let constant_call = bodies.constant.call(argument, &quote!(&mut out));
    let offset_call = bodies.offset.call(argument, &quote!(&mut out));
    let scatter = constant(regressor).enumerate().map(|(k, entry)| {
        let [row, col, k] = [entry.row, entry.col, k].map(Literal::usize_unsuffixed);
        quote!(y[#row][#col] = out[#k];)
    });

    let statics = pattern(regressor);
    let (base_typed, base_static) = match base {
        Some(base) => {
            let formulas = formulas(robot, regressor, base);
            (
                base_parameters(names, regressor, (base, &formulas), bodies, layout),
                base_table(base, &formulas),
            )
        }
        None => Default::default(),
    };
    let slices = slices(ty, layout, base.is_some(), bodies);
    quote! {
        #statics
        #(#definitions)*
        #base_static

        impl #ty {
            /// Number of parameters of the regressor of the inverse dynamics.
            pub const NL: usize = #nl;
            /// The parameters of the regressor's columns: those whose effect on `tau` depends on no parameter.
            pub const REGRESSOR_PARAMS: [#param; #nl] = [#(#param::ALL[#columns]),*];

            /// Regressor Y of the inverse dynamics: `tau = Y p + tau₀` with the parameters of
            /// [`REGRESSOR_PARAMS`](Self::REGRESSOR_PARAMS) and [`regressor_offset`](Self::regressor_offset).
            #constant_ops
            pub fn regressor(q: &[f64; #nq], v: &[f64; #nq], a: &[f64; #nq]) -> [[f64; #nl]; #nq] {
                let mut out = [0.0_f64; #values];
                #constant_call;
                let mut y = [[0.0_f64; #nl]; #nq];
                #(#scatter)*
                y
            }

            /// The inverse dynamics with all parameters of the regressor zero: known bodies, and forces that are not linear
            /// in their parameters.
            #offset_ops
            pub fn regressor_offset(q: &[f64; #nq], v: &[f64; #nq], a: &[f64; #nq], params: &#params) -> [f64; #nq] {
                let mut out = [0.0_f64; #nq];
                #offset_call;
                out
            }

            #base_typed
        }

        #slices
    }
}

/// What a typed function without inputs gives to a body for a part of its variables.
fn idle_argument(part: Part, nu: usize) -> TokenStream {
    match part {
        Part::U => quote!(&[0.0_f64; #nu]),
        Part::P => quote!(&params.as_array()),
        _ => {
            let ident = part.ident();
            quote!(#ident)
        }
    }
}

/// Statics of the parameters on which the torques depend linearly, and of the places of their values.
fn pattern(regressor: &Regressor) -> TokenStream {
    let linear: Vec<Literal> = regressor
        .params
        .iter()
        .map(|&k| Literal::usize_unsuffixed(k))
        .collect();
    let all = regressor.params.len();
    let count = regressor.entries.len();
    let list = |of: fn(&pid_symbolic::diff::Entry) -> usize| {
        let positions = regressor
            .entries
            .iter()
            .map(|entry| Literal::usize_unsuffixed(of(entry)));
        quote!([#(#positions),*])
    };
    let (rows, cols) = (list(|entry| entry.row), list(|entry| entry.col));
    quote! {
        static LINEAR_PARAMS: [usize; #all] = [#(#linear),*];
        static REGRESSOR_ROWS: [u32; #count] = #rows;
        static REGRESSOR_COLS: [u32; #count] = #cols;
    }
}

/// The trait of the regressor, with the base parameters where there are some.
fn slices(ty: &Ident, layout: &Layout, base: bool, bodies: &Bodies) -> TokenStream {
    let nq = layout.nq;
    let total = bodies.all.outputs;
    let (convert, call) = from_slices(&bodies.all, layout, &quote!(&mut out));
    let base_function = base.then(|| {
        quote! {
            fn base_parameters(&self) -> ::core::option::Option<&::pid_runtime::dynamics::BaseParameters> {
                ::core::option::Option::Some(&BASE_PARAMETERS)
            }
        }
    });
    quote! {
        #[automatically_derived]
        impl ::pid_runtime::dynamics::Regressor for #ty {
            fn linear_params(&self) -> &[usize] {
                &LINEAR_PARAMS
            }
            fn regressor_pattern(&self) -> ::pid_runtime::dynamics::Pattern<'_> {
                ::pid_runtime::dynamics::Pattern { rows: &REGRESSOR_ROWS, cols: &REGRESSOR_COLS }
            }
            fn regressor(&self, at: &::pid_runtime::dynamics::At<'_>, offset: &mut [f64], values: &mut [f64]) {
                #convert
                let mut out = [0.0_f64; #total];
                #call;
                let (first, rest) = out.split_at(#nq);
                offset.copy_from_slice(first);
                values.copy_from_slice(rest);
            }
            #base_function
        }
    }
}

/// Typed functions of the base parameters.
fn base_parameters(
    names: &Names,
    regressor: &Regressor,
    (base, formulas): (&BaseParameters, &[String]),
    bodies: &Bodies,
    layout: &Layout,
) -> TokenStream {
    let params = derived(names, "Params");
    let nb = base.constant;
    let nq = layout.nq;
    let typed_formulas = &formulas[..nb];
    let doc: Vec<String> = typed_formulas
        .iter()
        .enumerate()
        .map(|(k, formula)| format!("{k}. `{formula}`"))
        .collect();
    let doc = docs::attributes(&doc);
    let sums = base.terms[..nb].iter().map(|terms| {
        let terms = terms.iter().enumerate().map(|(position, term)| {
            let field = &names.params[regressor.params[term.column]];
            let size = number(term.coefficient.abs());
            let value = if term.coefficient.abs() == 1.0 {
                quote!(params.#field)
            } else {
                quote!(#size * params.#field)
            };
            match (position, term.coefficient < 0.0) {
                (0, false) => value,
                (_, false) => quote!(+ #value),
                (_, true) => quote!(- #value),
            }
        });
        quote!(#(#terms)*)
    });
    let ops = docs::operations_of(&cost(base));
    let columns = base.independent[..nb]
        .iter()
        .map(|&k| Literal::usize_unsuffixed(k));
    let regressor_ops = docs::operations(&bodies.constant);
    quote! {
        /// Number of base parameters of the inverse dynamics.
        pub const NB: usize = #nb;
        /// Formulas of the base parameters, the combinations of parameters on which `tau` depends:
        ///
        #doc
        pub const BASE: [&'static str; #nb] = [#(#typed_formulas),*];

        /// The base parameters with the formulas of [`BASE`](Self::BASE):
        /// `tau = Y_b β + tau₀` with [`base_regressor`](Self::base_regressor).
        #ops
        pub fn base_parameters(params: &#params) -> [f64; #nb] {
            [#(#sums),*]
        }

        /// The columns of [`regressor`](Self::regressor) that belong to the base parameters; linearly independent.
        #regressor_ops
        pub fn base_regressor(q: &[f64; #nq], v: &[f64; #nq], a: &[f64; #nq]) -> [[f64; #nb]; #nq] {
            Self::regressor(q, v, a).map(|row| [#(row[#columns]),*])
        }
    }
}

/// The static that states the base parameters: columns, combinations and their formulas.
fn base_table(base: &BaseParameters, formulas: &[String]) -> TokenStream {
    let all = base.independent.len();
    let independent = base
        .independent
        .iter()
        .map(|&k| Literal::usize_unsuffixed(k));
    let terms: Vec<(usize, &pid_derive::base_parameters::Term)> = base
        .terms
        .iter()
        .enumerate()
        .flat_map(|(row, terms)| terms.iter().map(move |term| (row, term)))
        .collect();
    let rows = terms.iter().map(|t| Literal::usize_unsuffixed(t.0));
    let cols = terms.iter().map(|t| Literal::usize_unsuffixed(t.1.column));
    let coefficients = terms.iter().map(|t| number(t.1.coefficient));
    let borrowed = quote!(::std::borrow::Cow::Borrowed);
    debug_assert_eq!(all, formulas.len());
    quote! {
        static BASE_PARAMETERS: ::pid_runtime::dynamics::BaseParameters = ::pid_runtime::dynamics::BaseParameters {
            columns: #borrowed(&[#(#independent),*]),
            rows: #borrowed(&[#(#rows),*]),
            cols: #borrowed(&[#(#cols),*]),
            coefficients: #borrowed(&[#(#coefficients),*]),
            formulas: #borrowed(&[#(#borrowed(#formulas)),*]),
        };
    }
}
