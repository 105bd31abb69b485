//! Straight-line bodies.
//!
//! A list of outputs becomes one function, or, above [`BLOCK`] operations, a driver and several
//! functions that share a workspace on the stack: rustc's time grows faster than linearly with the
//! length of a function.
//!
//! Bodies are written against a [`Scalar`], so that the same plan can be emitted for another one
//! (lanes over time nodes).

use pid_symbolic::{Cost, Function as Call, Graph, Id, Node, Plan, schedule};
use proc_macro2::{Ident, Literal, Span, TokenStream};
use quote::{format_ident, quote};

use pid_derive::model::Robot;

/// Operations of one function. Splitting halves rustc's time or better, and the code runs no
/// slower.
pub const BLOCK: usize = 500;

/// An argument of the bodies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// Coordinates.
    Q,
    /// Velocities.
    V,
    /// Accelerations.
    A,
    /// Inputs.
    U,
    /// Parameters.
    P,
    /// Multipliers.
    Lambda,
}

impl Part {
    /// All arguments, in the order of the variables.
    pub const ALL: [Self; 6] = [Self::Q, Self::V, Self::A, Self::U, Self::P, Self::Lambda];

    /// Its identifier.
    pub fn ident(self) -> Ident {
        let name = match self {
            Self::Q => "q",
            Self::V => "v",
            Self::A => "a",
            Self::U => "u",
            Self::P => "p",
            Self::Lambda => "lambda",
        };
        Ident::new(name, Span::call_site())
    }
}

/// Sizes of a robot, and where each variable is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Number of coordinates.
    pub nq: usize,
    /// Number of inputs.
    pub nu: usize,
    /// Number of parameters.
    pub np: usize,
}

impl Layout {
    /// The layout of a robot.
    pub fn of(robot: &Robot) -> Self {
        Self {
            nq: robot.nq(),
            nu: robot.inputs.len(),
            np: robot.params.len(),
        }
    }

    /// Length of an argument.
    pub fn len(&self, part: Part) -> usize {
        match part {
            Part::U => self.nu,
            Part::P => self.np,
            _ => self.nq,
        }
    }

    /// Argument and index of a variable.
    pub(super) fn locate(&self, var: usize) -> (Part, usize) {
        let mut index = var;
        for part in Part::ALL {
            if index < self.len(part) {
                return (part, index);
            }
            index -= self.len(part);
        }
        unreachable!("emitted expressions have no variables beyond the multipliers")
    }
}

/// The number type a body is written for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    /// `f64`.
    F64,
    /// `f64` whose functions are those of `pid-runtime`: `core` has none.
    Core,
    /// A type parameter `D: DualNum<Primitive = f64> + Copy`.
    Dual,
}

impl Scalar {
    fn ty(self) -> TokenStream {
        match self {
            Self::F64 | Self::Core => quote!(f64),
            Self::Dual => quote!(D),
        }
    }

    fn generics(self) -> TokenStream {
        match self {
            Self::F64 | Self::Core => TokenStream::new(),
            Self::Dual => {
                quote!(<D: ::pid_runtime::num_dual::DualNum<Primitive = f64> + ::core::marker::Copy>)
            }
        }
    }

    fn constant(self, value: f64) -> TokenStream {
        let literal = number(value);
        match self {
            Self::F64 | Self::Core => literal,
            Self::Dual => quote!(<D as ::core::convert::From<f64>>::from(#literal)),
        }
    }

    fn call(self, f: Call, x: &TokenStream) -> TokenStream {
        let name = format_ident!("{}", f.name());
        match (self, f) {
            (Self::F64 | Self::Core, Call::Sign) => quote!(::pid_runtime::__private::sign(#x)),
            (Self::F64, _) => quote!(f64::#name(#x)),
            (Self::Core, _) => quote!(::pid_runtime::__private::real::#name(#x)),
            (Self::Dual, Call::Sign | Call::Abs | Call::Tanh) => {
                let name = format_ident!("dual_{}", f.name());
                quote!(::pid_runtime::__private::#name(#x))
            }
            (Self::Dual, _) => quote!(::pid_runtime::num_dual::DualNum::#name(&#x)),
        }
    }

    fn powi(self, x: &TokenStream, n: i32) -> TokenStream {
        match self {
            Self::F64 | Self::Core => {
                let power = power(x, n.unsigned_abs());
                if n < 0 { quote!(1.0 / #power) } else { power }
            }
            Self::Dual => quote!(::pid_runtime::num_dual::DualNum::powi(&#x, #n)),
        }
    }
}

/// xⁿ by squaring.
fn power(x: &TokenStream, n: u32) -> TokenStream {
    match n {
        0 => quote!(1.0),
        1 => x.clone(),
        2 => quote!((#x * #x)),
        _ if n.is_multiple_of(2) => {
            let half = power(x, n / 2);
            quote!({ let s = #half; s * s })
        }
        _ => {
            let rest = power(x, n - 1);
            quote!((#rest * #x))
        }
    }
}

/// A number as an expression that means exactly this `f64`.
pub fn number(value: f64) -> TokenStream {
    if value.is_nan() {
        return quote!(f64::NAN);
    }
    let magnitude = if value.is_infinite() {
        quote!(f64::INFINITY)
    } else {
        let literal = Literal::f64_suffixed(value.abs());
        quote!(#literal)
    };
    if value.is_sign_negative() && value != 0.0 {
        quote!((-#magnitude))
    } else {
        magnitude
    }
}

/// A generated function.
#[derive(Debug, Clone)]
pub struct Function {
    /// Its definition, with the functions it is split into.
    pub definition: TokenStream,
    /// Its name.
    pub name: Ident,
    /// The arguments it reads, in order.
    pub reads: Vec<Part>,
    /// Number of its outputs.
    pub outputs: usize,
    /// Its operations.
    pub cost: Cost,
}

impl Function {
    /// `fn name(<parts read>, out: &mut [_; outputs])` for the given outputs. `doc` opens its comment.
    pub fn new(
        g: &Graph,
        layout: &Layout,
        name: &str,
        doc: &str,
        outputs: &[Id],
        scalar: Scalar,
    ) -> Self {
        let plan = Plan::new(g, outputs, BLOCK);
        let cost = Cost::of(g, outputs);
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
        let (ty, generics, count) = (scalar.ty(), scalar.generics(), outputs.len());
        let arguments: Vec<TokenStream> = reads
            .iter()
            .map(|&part| {
                let (ident, len) = (part.ident(), layout.len(part));
                quote!(#ident: &[#ty; #len])
            })
            .collect();
        let header = format!(
            " {doc} Generated by robot!: {cost} operations, {} blocks.",
            plan.blocks.len()
        );
        let writer = Writer::new(g, layout, &plan, scalar);
        let definition = if let [block] = plan.blocks.as_slice() {
            let body = writer.block(outputs, block);
            quote! {
                #[doc = #header]
                #[inline(never)]
                fn #name #generics(#(#arguments,)* out: &mut [#ty; #count]) { #body }
            }
        } else {
            let slots = plan.slots;
            let parts: Vec<Ident> = (0..plan.blocks.len())
                .map(|k| format_ident!("{name}_{k}"))
                .collect();
            let bodies = plan.blocks.iter().map(|block| writer.block(outputs, block));
            let forwarded: Vec<Ident> = reads.iter().map(|part| part.ident()).collect();
            let forwarded = quote!(#(#forwarded,)*);
            let arguments = quote!(#(#arguments,)*);
            let zero = scalar.constant(0.0);
            quote! {
                #(
                    #[inline(never)]
                    fn #parts #generics(#arguments w: &mut [#ty; #slots], out: &mut [#ty; #count]) { #bodies }
                )*
                #[doc = #header]
                fn #name #generics(#arguments out: &mut [#ty; #count]) {
                    let mut w = [#zero; #slots];
                    #( #parts(#forwarded &mut w, out); )*
                }
            }
        };
        Self {
            definition,
            name,
            reads,
            outputs: count,
            cost,
        }
    }

    /// A call, each argument given by `argument` as a reference to an array, `out` the array that is written.
    pub fn call(&self, argument: impl Fn(Part) -> TokenStream, out: &TokenStream) -> TokenStream {
        let name = &self.name;
        let arguments = self.reads.iter().map(|&part| argument(part));
        quote!(#name(#(#arguments,)* #out))
    }
}

/// Writes the blocks of one plan.
struct Writer<'a> {
    g: &'a Graph,
    layout: &'a Layout,
    scalar: Scalar,
    /// Number of the temporary of each operation.
    temporary: Vec<usize>,
}

impl<'a> Writer<'a> {
    fn new(g: &'a Graph, layout: &'a Layout, plan: &Plan, scalar: Scalar) -> Self {
        let mut temporary = vec![usize::MAX; g.len()];
        for (number, id) in plan
            .blocks
            .iter()
            .flat_map(|block| &block.nodes)
            .enumerate()
        {
            temporary[id.index()] = number;
        }
        Self {
            g,
            layout,
            scalar,
            temporary,
        }
    }

    fn name(&self, id: Id) -> Ident {
        Ident::new(
            &format!("t{}", self.temporary[id.index()]),
            Span::mixed_site(),
        )
    }

    fn value(&self, id: Id) -> TokenStream {
        match self.g.node(id) {
            Node::Const(c) => self.scalar.constant(c.value()),
            Node::Var(i) => {
                let (part, index) = self.layout.locate(i as usize);
                let (ident, index) = (part.ident(), Literal::usize_unsuffixed(index));
                quote!(#ident[#index])
            }
            _ => {
                let name = self.name(id);
                quote!(#name)
            }
        }
    }

    fn block(&self, outputs: &[Id], block: &schedule::Block) -> TokenStream {
        let loads = block.loads.iter().map(|&(id, slot)| {
            let (name, slot) = (self.name(id), Literal::usize_unsuffixed(slot));
            quote!(let #name = w[#slot];)
        });
        let mut statements = Vec::with_capacity(block.nodes.len());
        let mut nodes = block.nodes.iter().copied().peekable();
        while let Some(id) = nodes.next() {
            let node = self.g.node(id);
            let twin = schedule::twin(self.g, node).filter(|twin| nodes.peek() == Some(twin));
            statements.push(match (node, twin) {
                (Node::Call(f, x), Some(twin)) => {
                    nodes.next();
                    let (sin, cos) = if f == Call::Sin { (id, twin) } else { (twin, id) };
                    let (sin, cos, x) = (self.name(sin), self.name(cos), self.value(x));
                    match self.scalar {
                        Scalar::F64 => quote!(let (#sin, #cos) = f64::sin_cos(#x);),
                        Scalar::Core => quote!(let (#sin, #cos) = ::pid_runtime::__private::real::sin_cos(#x);),
                        Scalar::Dual => quote!(let (#sin, #cos) = ::pid_runtime::num_dual::DualNum::sin_cos(&#x);),
                    }
                }
                _ => {
                    let (name, value) = (self.name(id), self.operation(node));
                    quote!(let #name = #value;)
                }
            });
        }
        let stores = block.stores.iter().map(|&(id, slot)| {
            let (name, slot) = (self.name(id), Literal::usize_unsuffixed(slot));
            quote!(w[#slot] = #name;)
        });
        let results = block.outputs.iter().map(|&position| {
            let (value, position) = (
                self.value(outputs[position]),
                Literal::usize_unsuffixed(position),
            );
            quote!(out[#position] = #value;)
        });
        quote!(#(#loads)* #(#statements)* #(#stores)* #(#results)*)
    }

    /// A dual number meets a constant as a dual number times an `f64`, which costs less than two duals.
    fn operation(&self, node: Node) -> TokenStream {
        let dual_constant = |id: Id| {
            (self.scalar == Scalar::Dual)
                .then(|| self.g.value(id).map(number))
                .flatten()
        };
        match node {
            Node::Const(_) | Node::Var(_) => unreachable!("leaves are not scheduled"),
            Node::Neg(x) => {
                let x = self.value(x);
                quote!(-#x)
            }
            Node::Add(x, y) => match (dual_constant(x), dual_constant(y)) {
                (Some(c), _) => self.with_constant(y, &quote!(+), &c),
                (_, Some(c)) => self.with_constant(x, &quote!(+), &c),
                _ => self.binary(x, &quote!(+), y),
            },
            Node::Sub(x, y) => match (dual_constant(x), dual_constant(y)) {
                (Some(c), _) => {
                    let y = self.value(y);
                    quote!(-#y + #c)
                }
                (_, Some(c)) => self.with_constant(x, &quote!(-), &c),
                _ => self.binary(x, &quote!(-), y),
            },
            Node::Mul(x, y) => match dual_constant(x) {
                Some(c) => self.with_constant(y, &quote!(*), &c),
                None => self.binary(x, &quote!(*), y),
            },
            Node::Div(x, y) => match dual_constant(x) {
                Some(c) => {
                    let y = self.value(y);
                    quote!(::pid_runtime::num_dual::DualNum::recip(&#y) * #c)
                }
                None => self.binary(x, &quote!(/), y),
            },
            Node::Powi(x, n) => self.scalar.powi(&self.value(x), n),
            Node::Call(f, x) => self.scalar.call(f, &self.value(x)),
        }
    }

    fn binary(&self, x: Id, operator: &TokenStream, y: Id) -> TokenStream {
        let (x, y) = (self.value(x), self.value(y));
        quote!(#x #operator #y)
    }

    fn with_constant(&self, x: Id, operator: &TokenStream, c: &TokenStream) -> TokenStream {
        let x = self.value(x);
        quote!(#x #operator #c)
    }
}

/// Statements that make arrays of the slices of `at` (and of `lambda`) which a function reads, and the call.
pub fn from_slices(
    function: &Function,
    layout: &Layout,
    out: &TokenStream,
) -> (TokenStream, TokenStream) {
    let statements = function.reads.iter().map(|&part| {
        let (ident, len) = (part.ident(), layout.len(part));
        let name = ident.to_string();
        let slice = if part == Part::Lambda {
            quote!(lambda)
        } else {
            quote!(at.#ident)
        };
        quote!(let #ident: &[f64; #len] = ::pid_runtime::__private::exact(#slice, #name);)
    });
    let call = function.call(
        |part| {
            let ident = part.ident();
            quote!(#ident)
        },
        out,
    );
    (quote!(#(#statements)*), call)
}
