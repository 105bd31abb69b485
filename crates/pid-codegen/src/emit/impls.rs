//! The typed face (inherent functions on arrays) and the slice face (traits of `pid-runtime`) of a
//! robot's values.

use proc_macro2::TokenStream;
use quote::quote;

use super::bodies::Bodies;
use super::docs;
use super::functions::{Function, Layout, Part, from_slices, number};
use super::lanes::Lanes;
use super::names::{Face, Names, derived};
use pid_derive::Identifiability;
use pid_derive::identifiability::Structures;
use pid_derive::model::{Joint, Robot};

/// Bodies, typed functions and traits of a robot's values.
pub fn values(
    robot: &Robot,
    names: &Names,
    layout: &Layout,
    bodies: &Bodies,
    identifiability: &Identifiability,
    lanes: Option<&Lanes>,
) -> TokenStream {
    let definitions = bodies.definitions(names.face);
    let typed = typed(names, layout, bodies, identifiability);
    if names.face == Face::Core {
        return quote!(#definitions #typed);
    }
    let infos = infos(robot, identifiability);
    let slices = slices(robot, names, layout, bodies, lanes);
    let generic = generic(names, layout, bodies);
    quote!(#infos #definitions #typed #slices #generic)
}

/// Static descriptions of parameters, joints and inputs, and of the combinations that a motion
/// determines.
fn infos(robot: &Robot, found: &Identifiability) -> TokenStream {
    let (np, nq, nu) = (robot.params.len(), robot.nq(), robot.inputs.len());
    let text = |text: &str| quote!(::std::borrow::Cow::Borrowed(#text));
    let params = robot.params.iter().map(|param| {
        let (name, unit, doc) = (text(&param.name), text(&param.unit), text(docs::first_line(&param.docs)));
        let [nominal, lower, upper] = [param.nominal, param.lower, param.upper].map(number);
        let fixed = param.fixed;
        quote!(::pid_runtime::dynamics::ParamInfo {
            name: #name, unit: #unit, doc: #doc, nominal: #nominal, lower: #lower, upper: #upper, fixed: #fixed,
        })
    });
    let mut moving: Vec<&Joint> = robot
        .joints
        .iter()
        .filter(|joint| joint.coord.is_some())
        .collect();
    moving.sort_by_key(|joint| joint.coord);
    let joints = moving.into_iter().map(|joint| {
        let name = text(&joint.name);
        let prismatic = joint.kind.is_length();
        let limits = match joint.limits {
            None => quote!(::core::option::Option::None),
            Some((lower, upper)) => {
                let (lower, upper) = (number(lower), number(upper));
                quote!(::core::option::Option::Some((#lower, #upper)))
            }
        };
        quote!(::pid_runtime::dynamics::JointInfo { name: #name, prismatic: #prismatic, limits: #limits })
    });
    let inputs = robot.inputs.iter().map(|input| {
        let (name, unit) = (text(&input.name), text(&input.unit));
        let joint = match input.coord {
            None => quote!(::core::option::Option::None),
            Some(coord) => quote!(::core::option::Option::Some(#coord)),
        };
        quote!(::pid_runtime::dynamics::InputInfo { name: #name, unit: #unit, joint: #joint })
    });
    let structure = |structures: &Structures| {
        let (params, generic, nominal) = (
            structures.generic.params.len(),
            structures.generic.rank,
            structures.nominal.rank,
        );
        let groups = structures
            .generic
            .groups
            .iter()
            .map(|group| text(&group.text(|k| robot.params[k].name.clone())));
        quote!(::pid_runtime::dynamics::StructuralRank {
            params: #params, generic: #generic, nominal: #nominal, groups: ::std::borrow::Cow::Borrowed(&[#(#groups),*]),
        })
    };
    let (all, free) = (structure(&found.all), structure(&found.free));
    quote! {
        static IDENTIFIABILITY: ::pid_runtime::dynamics::Identifiability =
            ::pid_runtime::dynamics::Identifiability { all: #all, free: #free };
        static PARAMS: [::pid_runtime::dynamics::ParamInfo; #np] = [#(#params),*];
        static JOINTS: [::pid_runtime::dynamics::JointInfo; #nq] = [#(#joints),*];
        static INPUTS: [::pid_runtime::dynamics::InputInfo; #nu] = [#(#inputs),*];
    }
}

fn typed(
    names: &Names,
    layout: &Layout,
    bodies: &Bodies,
    identifiability: &Identifiability,
) -> TokenStream {
    let (rank, rank_nominal) = (
        identifiability.free.generic.rank,
        identifiability.free.nominal.rank,
    );
    let robot = &names.robot;
    let (nq, nu, np) = (layout.nq, layout.nu, layout.np);
    let call = |function: &Function| {
        function.call(
            |part| match part {
                Part::U => quote!(&inputs.as_array()),
                Part::P => quote!(&params.as_array()),
                _ => {
                    let ident = part.ident();
                    quote!(#ident)
                }
            },
            &quote!(&mut out),
        )
    };
    let terms = equation_terms(names, layout, bodies, &call);
    let residual = residual(names, layout, bodies, &call);
    let forward =
        (names.face == Face::Full).then(|| forward_dynamics(names, layout, bodies, &call));
    let energies = energies(names, layout, bodies, &call);
    quote! {
        impl #robot {
            /// Number of coordinates.
            pub const NQ: usize = #nq;
            /// Number of inputs.
            pub const NU: usize = #nu;
            /// Number of parameters.
            pub const NP: usize = #np;

            /// Number of combinations of the parameters (those marked `fixed` known) that the motion determines, at almost
            /// all parameter values.
            pub const RANK: usize = #rank;
            /// As [`RANK`](Self::RANK), at the nominal values.
            pub const RANK_NOMINAL: usize = #rank_nominal;

            #terms

            #residual

            #forward

            #energies
        }
    }
}

/// The typed functions of M, b, gravity and f_L; `call` writes a call of a body.
fn equation_terms(
    names: &Names,
    layout: &Layout,
    bodies: &Bodies,
    call: &dyn Fn(&Function) -> TokenStream,
) -> TokenStream {
    let (params, inputs) = (derived(names, "Params"), derived(names, "Inputs"));
    let (nq, nm) = (layout.nq, layout.nq * (layout.nq + 1) / 2);
    let (mass_matrix, mass_matrix_ops) = (
        call(&bodies.mass_matrix),
        docs::operations(&bodies.mass_matrix),
    );
    let (bias, bias_ops) = (call(&bodies.bias), docs::operations(&bodies.bias));
    let (gravity, gravity_ops) = (call(&bodies.gravity), docs::operations(&bodies.gravity));
    let (applied_force, applied_force_ops) = (
        call(&bodies.applied_force),
        docs::operations(&bodies.applied_force),
    );
    quote! {
        /// Mass matrix M(q, p), symmetric.
        #mass_matrix_ops
        pub fn mass_matrix(q: &[f64; #nq], params: &#params) -> [[f64; #nq]; #nq] {
            let mut out = [0.0_f64; #nm];
            #mass_matrix;
            ::pid_runtime::__private::symmetric(&out)
        }

        /// Coriolis, centrifugal and gravity forces b(q, v, p).
        #bias_ops
        pub fn bias(q: &[f64; #nq], v: &[f64; #nq], params: &#params) -> [f64; #nq] {
            let mut out = [0.0_f64; #nq];
            #bias;
            out
        }

        /// Gravity forces b(q, 0, p).
        #gravity_ops
        pub fn gravity(q: &[f64; #nq], params: &#params) -> [f64; #nq] {
            let mut out = [0.0_f64; #nq];
            #gravity;
            out
        }

        /// Generalised forces of drives and friction f_L(q, v, p, u).
        #applied_force_ops
        pub fn applied_force(q: &[f64; #nq], v: &[f64; #nq], inputs: &#inputs, params: &#params) -> [f64; #nq] {
            let mut out = [0.0_f64; #nq];
            #applied_force;
            out
        }
    }
}

/// The typed functions of r and of r without inputs; `call` writes a call of a body.
fn residual(
    names: &Names,
    layout: &Layout,
    bodies: &Bodies,
    call: &dyn Fn(&Function) -> TokenStream,
) -> TokenStream {
    let (params, inputs) = (derived(names, "Params"), derived(names, "Inputs"));
    let (nq, nu) = (layout.nq, layout.nu);
    let (residual, residual_ops) = (call(&bodies.residual), docs::operations(&bodies.residual));
    quote! {
        /// r = M a + b − f_L.
        #residual_ops
        pub fn residual(
            q: &[f64; #nq], v: &[f64; #nq], a: &[f64; #nq], inputs: &#inputs, params: &#params,
        ) -> [f64; #nq] {
            let mut out = [0.0_f64; #nq];
            #residual;
            out
        }

        /// Inverse dynamics: r at u = 0, the generalised force that the inputs have to bring up.
        pub fn inverse_dynamics(q: &[f64; #nq], v: &[f64; #nq], a: &[f64; #nq], params: &#params) -> [f64; #nq] {
            Self::residual(q, v, a, &#inputs::from_array([0.0_f64; #nu]), params)
        }
    }
}

/// The typed functions of T and U; `call` writes a call of a body.
fn energies(
    names: &Names,
    layout: &Layout,
    bodies: &Bodies,
    call: &dyn Fn(&Function) -> TokenStream,
) -> TokenStream {
    let params = derived(names, "Params");
    let nq = layout.nq;
    let (kinetic_energy, kinetic_energy_ops) = (
        call(&bodies.kinetic_energy),
        docs::operations(&bodies.kinetic_energy),
    );
    let (potential_energy, potential_energy_ops) = (
        call(&bodies.potential_energy),
        docs::operations(&bodies.potential_energy),
    );
    quote! {
        /// Kinetic energy T(q, v, p), J.
        #kinetic_energy_ops
        pub fn kinetic_energy(q: &[f64; #nq], v: &[f64; #nq], params: &#params) -> f64 {
            let mut out = [0.0_f64; 1];
            #kinetic_energy;
            out[0]
        }

        /// Potential energy U(q, p), J.
        #potential_energy_ops
        pub fn potential_energy(q: &[f64; #nq], params: &#params) -> f64 {
            let mut out = [0.0_f64; 1];
            #potential_energy;
            out[0]
        }
    }
}

/// The typed function of forward dynamics; `call` writes a call of a body.
fn forward_dynamics(
    names: &Names,
    layout: &Layout,
    bodies: &Bodies,
    call: &dyn Fn(&Function) -> TokenStream,
) -> TokenStream {
    let (params, inputs) = (derived(names, "Params"), derived(names, "Inputs"));
    let (nq, nm) = (layout.nq, layout.nq * (layout.nq + 1) / 2);
    let total = nm + nq;
    let forward = call(&bodies.forward);
    let forward_ops = {
        let text = format!(
            " Operations before the factorization: {}.",
            bodies.forward.cost
        );
        quote!(#[doc = ""] #[doc = #text])
    };
    quote! {
        /// Forward dynamics: a with r = 0, by a Cholesky factorization of M.
        ///
        /// # Errors
        /// If M is not positive definite at `q` with these parameters.
        #forward_ops
        pub fn forward_dynamics(
            q: &[f64; #nq], v: &[f64; #nq], inputs: &#inputs, params: &#params,
        ) -> ::core::result::Result<[f64; #nq], ::pid_runtime::dynamics::SingularMassMatrix> {
            let mut out = [0.0_f64; #total];
            #forward;
            let (m, force) = out.split_at_mut(#nm);
            ::pid_runtime::generic::cholesky_solve(m, force)?;
            ::core::result::Result::Ok(*::pid_runtime::__private::exact(force, "force"))
        }
    }
}

fn slices(
    robot: &Robot,
    names: &Names,
    layout: &Layout,
    bodies: &Bodies,
    lanes: Option<&Lanes>,
) -> TokenStream {
    let lanes = lanes.map(|lanes| lanes.dynamics(layout));
    let ty = &names.robot;
    let name = &robot.name;
    let (nq, nu, np, nm) = (
        layout.nq,
        layout.nu,
        layout.np,
        layout.nq * (layout.nq + 1) / 2,
    );
    let vector = |function: &Function, slice: TokenStream, len: usize| {
        let label = slice.to_string();
        let (convert, call) = from_slices(function, layout, &quote!(out));
        quote! {
            #convert
            let out: &mut [f64; #len] = ::pid_runtime::__private::exact_mut(#slice, #label);
            #call;
        }
    };
    let scalar = |function: &Function| {
        let (convert, call) = from_slices(function, layout, &quote!(&mut out));
        quote! {
            #convert
            let mut out = [0.0_f64; 1];
            #call;
            out[0]
        }
    };
    let mass_matrix = vector(&bodies.mass_matrix, quote!(m), nm);
    let bias = vector(&bodies.bias, quote!(b), nq);
    let applied_force = vector(&bodies.applied_force, quote!(f), nq);
    let residual = vector(&bodies.residual, quote!(r), nq);
    let kinetic_energy = scalar(&bodies.kinetic_energy);
    let potential_energy = scalar(&bodies.potential_energy);
    let declaration = declaration(robot);
    quote! {
        #[automatically_derived]
        impl ::pid_runtime::dynamics::Dynamics for #ty {
            fn name(&self) -> &str {
                #name
            }
            #declaration
            fn dims(&self) -> ::pid_runtime::dynamics::Dims {
                ::pid_runtime::dynamics::Dims { nq: #nq, nu: #nu, np: #np }
            }
            fn params(&self) -> &[::pid_runtime::dynamics::ParamInfo] {
                &PARAMS
            }
            fn joints(&self) -> &[::pid_runtime::dynamics::JointInfo] {
                &JOINTS
            }
            fn inputs(&self) -> &[::pid_runtime::dynamics::InputInfo] {
                &INPUTS
            }
            fn identifiability(&self) -> ::core::option::Option<&::pid_runtime::dynamics::Identifiability> {
                ::core::option::Option::Some(&IDENTIFIABILITY)
            }
            fn mass_matrix(&self, at: &::pid_runtime::dynamics::At<'_>, m: &mut [f64]) { #mass_matrix }
            fn bias(&self, at: &::pid_runtime::dynamics::At<'_>, b: &mut [f64]) { #bias }
            fn applied_force(&self, at: &::pid_runtime::dynamics::At<'_>, f: &mut [f64]) { #applied_force }
            fn residual(&self, at: &::pid_runtime::dynamics::At<'_>, r: &mut [f64]) { #residual }
            fn kinetic_energy(&self, at: &::pid_runtime::dynamics::At<'_>) -> f64 { #kinetic_energy }
            fn potential_energy(&self, at: &::pid_runtime::dynamics::At<'_>) -> f64 { #potential_energy }
            #lanes
        }
    }
}

fn generic(names: &Names, layout: &Layout, bodies: &Bodies) -> TokenStream {
    let robot = &names.robot;
    let (nq, nm) = (layout.nq, layout.nq * (layout.nq + 1) / 2);
    let total = nm + nq;
    let arrays = |function: &Function| {
        let statements = function.reads.iter().map(|&part| {
            let (ident, len) = (part.ident(), layout.len(part));
            let name = ident.to_string();
            quote!(let #ident: &[D; #len] = ::pid_runtime::__private::exact(#ident, #name);)
        });
        quote!(#(#statements)*)
    };
    let call = |function: &Function, out: &TokenStream| {
        function.call(
            |part| {
                let ident = part.ident();
                quote!(#ident)
            },
            out,
        )
    };
    let residual_arrays = arrays(&bodies.residual_dual);
    let residual = call(&bodies.residual_dual, &quote!(out));
    let forward_arrays = arrays(&bodies.forward_dual);
    let forward = call(&bodies.forward_dual, &quote!(&mut out));
    let bound = quote!(D: ::pid_runtime::num_dual::DualNum<Primitive = f64> + ::core::marker::Copy);
    quote! {
        impl #robot {
            /// [`residual`](Self::residual) over any dual number: exact derivatives of r, and of what is composed with it,
            /// by forward mode. Slices as in [`Dynamics`](::pid_runtime::dynamics::Dynamics).
            ///
            /// # Panics
            /// If a slice has another length than the model says.
            pub fn residual_generic<#bound>(q: &[D], v: &[D], a: &[D], u: &[D], p: &[D], r: &mut [D]) {
                #residual_arrays
                let out: &mut [D; #nq] = ::pid_runtime::__private::exact_mut(r, "r");
                #residual;
            }

            /// [`forward_dynamics`](Self::forward_dynamics) over any dual number: the accelerations with r = 0.
            ///
            /// # Errors
            /// If M is not positive definite; `a` is then left as it was.
            ///
            /// # Panics
            /// If a slice has another length than the model says.
            pub fn vector_field_generic<#bound>(
                q: &[D], v: &[D], u: &[D], p: &[D], a: &mut [D],
            ) -> ::core::result::Result<(), ::pid_runtime::dynamics::SingularMassMatrix> {
                #forward_arrays
                let mut out = [<D as ::core::convert::From<f64>>::from(0.0_f64); #total];
                #forward;
                let (m, force) = out.split_at_mut(#nm);
                ::pid_runtime::generic::cholesky_solve(m, force)?;
                a.copy_from_slice(force);
                ::core::result::Result::Ok(())
            }
        }

        #[automatically_derived]
        impl ::pid_runtime::generic::GenericDynamics for #robot {
            fn residual_generic<#bound>(&self, q: &[D], v: &[D], a: &[D], u: &[D], p: &[D], r: &mut [D]) {
                #robot::residual_generic(q, v, a, u, p, r);
            }
            fn vector_field_generic<#bound>(
                &self, q: &[D], v: &[D], u: &[D], p: &[D], a: &mut [D],
            ) -> ::core::result::Result<(), ::pid_runtime::dynamics::SingularMassMatrix> {
                #robot::vector_field_generic(q, v, u, p, a)
            }
        }
    }
}

/// The declaration that the compiled robot carries. A checked robot holds no number that JSON cannot.
#[cfg(feature = "declaration")]
fn declaration(robot: &Robot) -> Option<TokenStream> {
    let text = serde_json::to_string(robot).ok()?;
    Some(quote! {
        fn declaration(&self) -> ::core::option::Option<&str> {
            ::core::option::Option::Some(#text)
        }
    })
}

#[cfg(not(feature = "declaration"))]
fn declaration(_: &Robot) -> Option<TokenStream> {
    None
}
