//! Jacobian and Hessian: their patterns and traits.

use proc_macro2::{Literal, TokenStream};
use quote::quote;

use super::bodies::Body;
use super::docs;
use super::functions::{Layout, Part, from_slices};
use super::lanes::Lanes;
use super::names::{Face, Names, derived};

/// Typed functions and trait of the first derivatives.
pub fn jacobian_impls(
    names: &Names,
    layout: &Layout,
    body: &Body,
    lanes: Option<&Lanes>,
) -> TokenStream {
    let lanes = lanes.map(|lanes| lanes.jacobian(layout));
    let robot = &names.robot;
    let params = derived(names, "Params");
    let (nq, np, nu) = (layout.nq, layout.np, layout.nu);
    let (count, total) = (body.entries.len(), body.function.outputs);
    let (rows, cols) = body.pattern();
    let definition = &body.function.definition;
    let ops = docs::operations(&body.function);
    let typed = body.function.call(typed_argument, &quote!(&mut out));
    let (convert, slices) = from_slices(&body.function, layout, &quote!(&mut out));

    // Where each entry of the blocks by q, v, a and p is found in the values; u is held at zero.
    let mut scatter = Vec::new();
    for (k, entry) in body.entries.iter().enumerate() {
        let Some((block, col)) = [
            ("dtau_dq", 0, nq),
            ("dtau_dv", nq, nq),
            ("dtau_da", 2 * nq, nq),
            ("dtau_dp", 3 * nq + nu, np),
        ]
        .into_iter()
        .find(|&(_, first, len)| (first..first + len).contains(&entry.col))
        .map(|(name, first, _)| (quote::format_ident!("{name}"), entry.col - first)) else {
            continue;
        };
        let [row, col, k] = [entry.row, col, nq + k].map(Literal::usize_unsuffixed);
        scatter.push(quote!(d.#block[#row][#col] = out[#k];));
    }
    let traits = (names.face == Face::Full).then(|| {
        quote! {
            #[automatically_derived]
            impl ::pid_runtime::dynamics::Jacobian for #robot {
                fn jacobian_pattern(&self) -> ::pid_runtime::dynamics::Pattern<'_> {
                    ::pid_runtime::dynamics::Pattern { rows: &JACOBIAN_ROWS, cols: &JACOBIAN_COLS }
                }
                fn residual_jacobian(&self, at: &::pid_runtime::dynamics::At<'_>, r: &mut [f64], values: &mut [f64]) {
                    #convert
                    let mut out = [0.0_f64; #total];
                    #slices;
                    let (first, rest) = out.split_at(#nq);
                    r.copy_from_slice(first);
                    values.copy_from_slice(rest);
                }
                #lanes
            }
        }
    });
    quote! {
        static JACOBIAN_ROWS: [u32; #count] = #rows;
        static JACOBIAN_COLS: [u32; #count] = #cols;
        #definition

        impl #robot {
            /// Number of structural non-zeros of ∂r/∂z.
            pub const JACOBIAN_NNZ: usize = #count;

            /// First derivatives of the inverse dynamics `tau = r` at `u = 0`, by q, v, a and p.
            #ops
            pub fn inverse_dynamics_derivatives(
                q: &[f64; #nq], v: &[f64; #nq], a: &[f64; #nq], params: &#params,
            ) -> ::pid_runtime::dynamics::InverseDynamicsDerivatives<#nq, #np> {
                let (p, u) = (&params.as_array(), &[0.0_f64; #nu]);
                let mut out = [0.0_f64; #total];
                #typed;
                let mut d = ::pid_runtime::dynamics::InverseDynamicsDerivatives::ZERO;
                #(#scatter)*
                d
            }
        }

        #traits
    }
}

/// Typed function and trait of the second derivatives.
pub fn hessian_impls(
    names: &Names,
    layout: &Layout,
    body: &Body,
    lanes: Option<&Lanes>,
) -> TokenStream {
    let lanes = lanes.map(|lanes| lanes.hessian(layout));
    let robot = &names.robot;
    let (params, inputs) = (derived(names, "Params"), derived(names, "Inputs"));
    let (nq, count) = (layout.nq, body.entries.len());
    let (rows, cols) = body.pattern();
    let definition = &body.function.definition;
    let ops = docs::operations(&body.function);
    let typed = body.function.call(typed_argument, &quote!(&mut out));
    let (convert, slices) = from_slices(&body.function, layout, &quote!(out));
    let traits = (names.face == Face::Full).then(|| {
        quote! {
            #[automatically_derived]
            impl ::pid_runtime::dynamics::Hessian for #robot {
                fn hessian_pattern(&self) -> ::pid_runtime::dynamics::Pattern<'_> {
                    ::pid_runtime::dynamics::Pattern { rows: &HESSIAN_ROWS, cols: &HESSIAN_COLS }
                }
                fn residual_hessian(&self, at: &::pid_runtime::dynamics::At<'_>, lambda: &[f64], values: &mut [f64]) {
                    #convert
                    let out: &mut [f64; #count] = ::pid_runtime::__private::exact_mut(values, "values");
                    #slices;
                }
                #lanes
            }
        }
    });
    quote! {
        static HESSIAN_ROWS: [u32; #count] = #rows;
        static HESSIAN_COLS: [u32; #count] = #cols;
        #definition

        impl #robot {
            /// Number of structural non-zeros of the lower triangle of ∂²(λᵀr)/∂z².
            pub const HESSIAN_NNZ: usize = #count;

            /// Lower triangle of ∂²(λᵀr)/∂z², `z = (q, v, a, u, p)`; entries in the order of
            /// [`hessian_pattern`](::pid_runtime::dynamics::Hessian::hessian_pattern).
            #ops
            pub fn lagrangian_hessian(
                q: &[f64; #nq], v: &[f64; #nq], a: &[f64; #nq], inputs: &#inputs, params: &#params, lambda: &[f64; #nq],
            ) -> [f64; #count] {
                let (u, p) = (&inputs.as_array(), &params.as_array());
                let mut out = [0.0_f64; #count];
                #typed;
                out
            }
        }

        #traits
    }
}

fn typed_argument(part: Part) -> TokenStream {
    let ident = part.ident();
    quote!(#ident)
}
