//! Bodies over four nodes at once.
//!
//! A body becomes a second set of functions on 256-bit vectors, which the compiler builds for AVX2
//! and FMA whatever target the rest of the program has. A dispatcher runs it where the processor
//! can: `fearless_simd` asks the processor and gives the proof, so nothing here is unsafe. A
//! product that is used once, by a sum of its own block, becomes one fused operation: fewer
//! statements to compile and to run.
//!
//! Vector code uses the intrinsics themselves. They compile in little more time than plain `f64`;
//! generic vector types of a library take two to five times as long (docs/decisions/0004).

use pid_symbolic::{Function as Call, Graph, Id, Node, Plan, schedule};
use proc_macro2::{Ident, Literal, Span, TokenStream};
use quote::{format_ident, quote};

use super::bodies::Body;
use super::functions::{BLOCK, Layout, Part, number};
use pid_derive::Equations;

/// A generated function of four nodes.
#[derive(Debug, Clone)]
pub struct LaneFunction {
    /// Its vector body, for the module of such bodies.
    definition: TokenStream,
    /// Its dispatcher, which answers `false` where the processor cannot.
    dispatcher: TokenStream,
    name: Ident,
    reads: Vec<Part>,
}

/// The slices a function writes, in order: identifier and length.
pub type Results<'a> = &'a [(&'a str, usize)];

impl LaneFunction {
    /// The function `name` of the given outputs, which fill the results one after the other.
    pub fn new(
        g: &Graph,
        layout: &Layout,
        name: &str,
        outputs: &[Id],
        results: Results<'_>,
    ) -> Self {
        let plan = Plan::new(g, outputs, BLOCK);
        let writer = Writer::new(g, layout, &plan, outputs, results);
        let mut reads: Vec<Part> = g
            .reachable(outputs)
            .into_iter()
            .filter_map(|id| match g.node(id) {
                Node::Var(i) => Some(layout.locate(i as usize).0),
                _ => None,
            })
            .collect();
        reads.sort_unstable();
        reads.dedup();

        let name = format_ident!("{name}");
        let mut forwarded: Vec<Ident> = reads.iter().map(|part| part.ident()).collect();
        forwarded.extend(results.iter().map(|(name, _)| format_ident!("{name}")));

        let arguments = arguments(layout, &reads, results);
        let forwarded = quote!(#(#forwarded,)*);

        let slots = plan.slots;
        let parts: Vec<Ident> = (0..plan.blocks.len())
            .map(|k| format_ident!("{name}_{k}"))
            .collect();
        let bodies = plan.blocks.iter().map(|block| writer.block(block));
        let definition = quote! {
            #(
                #[inline(never)]
                #[target_feature(enable = "avx2,fma")]
                fn #parts(#arguments w: &mut [V; #slots]) { #bodies }
            )*
            fearless_simd::kernel! {
                pub(super) fn #name(level: Avx2, #arguments) {
                    let mut w = [all(0.0_f64); #slots];
                    #( #parts(#forwarded &mut w); )*
                }
            }
        };
        let dispatcher = quote! {
            #[allow(unused_variables)]
            fn #name(#arguments) -> bool {
                #[cfg(target_arch = "x86_64")]
                if let Some(level) = ::pid_runtime::__private::level() {
                    avx2::#name(level, #forwarded);
                    return true;
                }
                false
            }
        };
        Self {
            definition,
            dispatcher,
            name,
            reads,
        }
    }

    /// A method of the slice face: the dispatcher, and `otherwise` where it cannot. `results` are
    /// the method's slices.
    pub fn method(
        &self,
        layout: &Layout,
        results: Results<'_>,
        otherwise: &TokenStream,
    ) -> TokenStream {
        let name = &self.name;
        let lane = quote!(::pid_runtime::lanes::Lane);
        let inputs = self.reads.iter().map(|&part| {
            let (ident, len) = (part.ident(), layout.len(part));
            let label = ident.to_string();
            let ty = if part == Part::P {
                quote!(f64)
            } else {
                lane.clone()
            };
            let slice = if part == Part::Lambda {
                quote!(lambda)
            } else {
                quote!(at.#ident)
            };
            quote!(let #ident: &[#ty; #len] = ::pid_runtime::__private::exact(#slice, #label);)
        });
        let written = results.iter().map(|(label, len)| {
            let ident = format_ident!("{label}");
            quote!(let #ident: &mut [#lane; #len] = ::pid_runtime::__private::exact_mut(#ident, #label);)
        });
        let mut forwarded: Vec<Ident> = self.reads.iter().map(|part| part.ident()).collect();
        forwarded.extend(results.iter().map(|(name, _)| format_ident!("{name}")));
        quote! {
            #(#inputs)*
            #(#written)*
            if !#name(#(#forwarded,)*) {
                #otherwise
            }
        }
    }
}

/// The arguments of a function that reads these parts and writes these results.
fn arguments(layout: &Layout, reads: &[Part], results: Results<'_>) -> TokenStream {
    let lane = quote!(::pid_runtime::lanes::Lane);
    let inputs = reads.iter().map(|&part| {
        let (ident, len) = (part.ident(), layout.len(part));
        if part == Part::P {
            quote!(#ident: &[f64; #len])
        } else {
            quote!(#ident: &[#lane; #len])
        }
    });
    let written = results.iter().map(|(name, len)| {
        let name = format_ident!("{name}");
        quote!(#name: &mut [#lane; #len])
    });
    quote!(#(#inputs,)* #(#written,)*)
}

/// The functions of a robot that have a version for four nodes.
#[derive(Debug, Clone)]
pub struct Lanes {
    residual: LaneFunction,
    mass_matrix: LaneFunction,
    applied_force: LaneFunction,
    jacobian: Option<(LaneFunction, usize)>,
    hessian: Option<(LaneFunction, usize)>,
}

impl Lanes {
    /// Writes the functions; derivatives where they are emitted at all.
    pub fn new(
        g: &Graph,
        layout: &Layout,
        equations: &Equations,
        jacobian: Option<&Body>,
        hessian: Option<&Body>,
    ) -> Self {
        let nq = layout.nq;
        let values = |body: &Body| body.entries.iter().map(|entry| entry.value).collect();
        let jacobian = jacobian.map(|body| {
            let entries: Vec<Id> = values(body);
            let nnz = entries.len();
            let outputs = [equations.residual.as_slice(), &entries].concat();
            let results = [("r", nq), ("values", nnz)];
            let f = LaneFunction::new(g, layout, "jacobian_lanes", &outputs, &results);
            (f, nnz)
        });
        let hessian = hessian.map(|body| {
            let entries: Vec<Id> = values(body);
            let results = [("values", entries.len())];
            let f = LaneFunction::new(g, layout, "hessian_lanes", &entries, &results);
            (f, entries.len())
        });
        let write = |name: &str, outputs: &[Id], result: &str| {
            LaneFunction::new(g, layout, name, outputs, &[(result, outputs.len())])
        };
        Self {
            residual: write("residual_lanes", &equations.residual, "r"),
            mass_matrix: write("mass_matrix_lanes", &equations.mass_matrix, "m"),
            applied_force: write("applied_force_lanes", &equations.applied_force, "f"),
            jacobian,
            hessian,
        }
    }

    /// Methods of `Dynamics`.
    pub fn dynamics(&self, layout: &Layout) -> TokenStream {
        let (nq, nm) = (layout.nq, layout.nq * (layout.nq + 1) / 2);
        let methods = [
            (&self.residual, "residual", "r", nq),
            (&self.mass_matrix, "mass_matrix", "m", nm),
            (&self.applied_force, "applied_force", "f", nq),
        ]
        .map(|(function, of, out, len)| {
            let (name, of, slice) = (
                format_ident!("{of}_lanes"),
                format_ident!("{of}"),
                format_ident!("{out}"),
            );
            let otherwise = quote! {
                ::pid_runtime::__private::one_by_one(at, &[], #slice, &mut [], |at, _, #slice, _| {
                    ::pid_runtime::dynamics::Dynamics::#of(self, at, #slice);
                });
            };
            let body = function.method(layout, &[(out, len)], &otherwise);
            quote! {
                fn #name(
                    &self,
                    at: &::pid_runtime::lanes::LanesAt<'_>,
                    #slice: &mut [::pid_runtime::lanes::Lane],
                ) { #body }
            }
        });
        quote!(#(#methods)*)
    }

    /// The method of `Jacobian`.
    pub fn jacobian(&self, layout: &Layout) -> TokenStream {
        let Some((function, nnz)) = &self.jacobian else {
            return TokenStream::new();
        };
        let otherwise = quote! {
            ::pid_runtime::__private::one_by_one(at, &[], r, values, |at, _, r, values| {
                ::pid_runtime::dynamics::Jacobian::residual_jacobian(self, at, r, values);
            });
        };
        let results = [("r", layout.nq), ("values", *nnz)];
        let body = function.method(layout, &results, &otherwise);
        quote! {
            fn residual_jacobian_lanes(
                &self,
                at: &::pid_runtime::lanes::LanesAt<'_>,
                r: &mut [::pid_runtime::lanes::Lane],
                values: &mut [::pid_runtime::lanes::Lane],
            ) { #body }
        }
    }

    /// The method of `Hessian`.
    pub fn hessian(&self, layout: &Layout) -> TokenStream {
        let Some((function, nnz)) = &self.hessian else {
            return TokenStream::new();
        };
        let otherwise = quote! {
            ::pid_runtime::__private::one_by_one(at, lambda, values, &mut [], |at, lambda, values, _| {
                ::pid_runtime::dynamics::Hessian::residual_hessian(self, at, lambda, values);
            });
        };
        let body = function.method(layout, &[("values", *nnz)], &otherwise);
        quote! {
            fn residual_hessian_lanes(
                &self,
                at: &::pid_runtime::lanes::LanesAt<'_>,
                lambda: &[::pid_runtime::lanes::Lane],
                values: &mut [::pid_runtime::lanes::Lane],
            ) { #body }
        }
    }

    /// Vector bodies and dispatchers.
    pub fn definitions(&self) -> TokenStream {
        let derivatives = [&self.jacobian, &self.hessian];
        let derivatives = derivatives.into_iter().flatten().map(|(f, _)| f);
        let functions: Vec<&LaneFunction> =
            [&self.residual, &self.mass_matrix, &self.applied_force]
                .into_iter()
                .chain(derivatives)
                .collect();
        definitions(&functions)
    }
}

fn definitions(functions: &[&LaneFunction]) -> TokenStream {
    let bodies = functions.iter().map(|function| &function.definition);
    let dispatchers = functions.iter().map(|function| &function.dispatcher);
    quote! {
        #[cfg(target_arch = "x86_64")]
        mod avx2 {
            #[allow(unused_imports)]
            use ::pid_runtime::__private::{avx2::*, fearless_simd};
            #(#bodies)*
        }
        #(#dispatchers)*
    }
}

/// Writes the blocks of one plan.
struct Writer<'a> {
    g: &'a Graph,
    layout: &'a Layout,
    outputs: &'a [Id],
    results: Results<'a>,
    /// Number of the temporary of each operation.
    temporary: Vec<u32>,
    /// How often each value is read, as an operand or as an output.
    uses: Vec<u32>,
}

impl<'a> Writer<'a> {
    fn new(
        g: &'a Graph,
        layout: &'a Layout,
        plan: &Plan,
        outputs: &'a [Id],
        results: Results<'a>,
    ) -> Self {
        let mut temporary = vec![u32::MAX; g.len()];
        let mut uses = vec![0; g.len()];
        for (number, id) in (0..).zip(plan.blocks.iter().flat_map(|block| &block.nodes)) {
            temporary[id.index()] = number;
            for operand in g.node(*id).operands() {
                uses[operand.index()] += 1;
            }
        }
        for id in outputs {
            uses[id.index()] += 1;
        }
        Self {
            g,
            layout,
            outputs,
            results,
            temporary,
            uses,
        }
    }

    fn block(&self, block: &schedule::Block) -> TokenStream {
        let mut inside = vec![false; self.g.len()];
        for id in &block.nodes {
            inside[id.index()] = true;
        }
        // A product inside the block with one use, read by a sum, is fused into the sum.
        let product = |id: Id| match self.g.node(id) {
            Node::Mul(x, y) if inside[id.index()] && self.uses[id.index()] == 1 => Some((x, y)),
            _ => None,
        };
        let mut fused = vec![false; self.g.len()];
        for id in &block.nodes {
            if let Node::Add(x, y) | Node::Sub(x, y) = self.g.node(*id) {
                let part = [x, y].into_iter().find(|&part| product(part).is_some());
                if let Some(part) = part {
                    fused[part.index()] = true;
                }
            }
        }

        let mut out = TokenStream::new();
        for &(id, slot) in &block.loads {
            let (name, slot) = (self.name(id), Literal::usize_unsuffixed(slot));
            out.extend(quote!(let #name = w[#slot];));
        }
        // Variables and constants are brought into vectors once per block, before their first use.
        let mut bound = vec![false; self.g.len()];
        let mut bind = |id: Id, out: &mut TokenStream| {
            if self.g.node(id).is_leaf() && !std::mem::replace(&mut bound[id.index()], true) {
                let (name, value) = (self.name(id), self.leaf(id));
                out.extend(quote!(let #name = #value;));
            }
        };
        let mut nodes = block.nodes.iter().copied().peekable();
        while let Some(id) = nodes.next() {
            if fused[id.index()] {
                continue;
            }
            let node = self.g.node(id);
            for operand in node.operands() {
                match product(operand).filter(|_| fused[operand.index()]) {
                    Some((x, y)) => {
                        bind(x, &mut out);
                        bind(y, &mut out);
                    }
                    None => bind(operand, &mut out),
                }
            }
            let twin = schedule::twin(self.g, node).filter(|twin| nodes.peek() == Some(twin));
            if let (Node::Call(f, x), Some(twin)) = (node, twin) {
                nodes.next();
                let (sin, cos) = if f == Call::Sin {
                    (id, twin)
                } else {
                    (twin, id)
                };
                let (sin, cos, x) = (self.name(sin), self.name(cos), self.name(x));
                out.extend(quote!(let (#sin, #cos) = sin_cos(#x);));
                continue;
            }
            let of = |part: Id| product(part).filter(|_| fused[part.index()]);
            let (name, value) = (self.name(id), self.operation(node, of));
            out.extend(quote!(let #name = #value;));
        }
        for &(id, slot) in &block.stores {
            let (name, slot) = (self.name(id), Literal::usize_unsuffixed(slot));
            out.extend(quote!(w[#slot] = #name;));
        }
        for &position in &block.outputs {
            bind(self.outputs[position], &mut out);
            let value = self.name(self.outputs[position]);
            let (ident, index) = self.result(position);
            out.extend(quote!(#ident[#index] = store(#value);));
        }
        out
    }

    /// Slice and index of an output.
    fn result(&self, position: usize) -> (Ident, Literal) {
        let mut index = position;
        for &(name, len) in self.results {
            if index < len {
                return (format_ident!("{name}"), Literal::usize_unsuffixed(index));
            }
            index -= len;
        }
        unreachable!("the results are as long as the outputs together")
    }

    fn name(&self, id: Id) -> Ident {
        let text = match self.temporary[id.index()] {
            u32::MAX => format!("c{}", id.index()),
            number => format!("t{number}"),
        };
        Ident::new(&text, Span::call_site())
    }

    /// A constant or variable as a vector.
    fn leaf(&self, id: Id) -> TokenStream {
        if let Some(value) = self.g.value(id) {
            let value = number(value);
            return quote!(all(#value));
        }
        let Node::Var(i) = self.g.node(id) else {
            unreachable!("leaves are constants and variables")
        };
        let (part, index) = self.layout.locate(i as usize);
        let (ident, index) = (part.ident(), Literal::usize_unsuffixed(index));
        if part == Part::P {
            quote!(all(#ident[#index]))
        } else {
            quote!(load(#ident[#index]))
        }
    }

    /// An operation; `product` gives the factors of operands that are fused into it.
    fn operation(&self, node: Node, product: impl Fn(Id) -> Option<(Id, Id)>) -> TokenStream {
        let call = |f: &str, operands: &[Id]| {
            let f = Ident::new(f, Span::call_site());
            let operands = operands.iter().map(|&id| self.name(id));
            quote!(#f(#(#operands),*))
        };
        match node {
            Node::Const(_) | Node::Var(_) => unreachable!("leaves are not scheduled"),
            Node::Neg(x) => call("neg", &[x]),
            Node::Add(x, y) => match (product(x), product(y)) {
                (Some((a, b)), _) => call("mul_add", &[a, b, y]),
                (None, Some((a, b))) => call("mul_add", &[a, b, x]),
                (None, None) => call("add", &[x, y]),
            },
            Node::Sub(x, y) => match (product(x), product(y)) {
                (Some((a, b)), _) => call("mul_sub", &[a, b, y]),
                (None, Some((a, b))) => call("sub_mul", &[a, b, x]),
                (None, None) => call("sub", &[x, y]),
            },
            Node::Mul(x, y) => call("mul", &[x, y]),
            Node::Div(x, y) => call("div", &[x, y]),
            Node::Powi(x, n) => {
                let x = self.name(x);
                let power = power(&quote!(#x), n.unsigned_abs());
                if n < 0 {
                    quote!(div(all(1.0_f64), #power))
                } else {
                    power
                }
            }
            Node::Call(f, x) => call(f.name(), &[x]),
        }
    }
}

/// xⁿ by squaring.
fn power(x: &TokenStream, n: u32) -> TokenStream {
    match n {
        0 => quote!(all(1.0_f64)),
        1 => x.clone(),
        2 => quote!(mul(#x, #x)),
        _ if n.is_multiple_of(2) => {
            let half = power(x, n / 2);
            quote!({ let s = #half; mul(s, s) })
        }
        _ => {
            let rest = power(x, n - 1);
            quote!(mul(#rest, #x))
        }
    }
}
