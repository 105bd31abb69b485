//! The functions of a robot before they get a face: values, derivatives, linear form.

use pid_symbolic::diff::Entry;
use pid_symbolic::{Cost, Graph, Id};
use proc_macro2::{Literal, TokenStream};
use quote::quote;

use super::functions::{Function, Layout, Scalar};
use super::names::Face;
use pid_derive::model::Robot;
use pid_derive::{BaseParameters, Derivatives, Equations, Regressor};

/// The functions behind all values.
#[derive(Debug, Clone)]
pub struct Bodies {
    pub(super) residual: Function,
    pub(super) mass_matrix: Function,
    pub(super) bias: Function,
    pub(super) gravity: Function,
    pub(super) applied_force: Function,
    pub(super) kinetic_energy: Function,
    pub(super) potential_energy: Function,
    /// Lower triangle of M, then f_L − b: the system that forward dynamics solves.
    pub(super) forward: Function,
    pub(super) residual_dual: Function,
    pub(super) forward_dual: Function,
}

impl Bodies {
    /// Writes the bodies.
    pub fn new(g: &mut Graph, layout: &Layout, equations: &Equations, scalar: Scalar) -> Self {
        let net: Vec<Id> = equations
            .applied_force
            .iter()
            .zip(&equations.bias)
            .map(|(&force, &bias)| g.sub(force, bias))
            .collect();
        let forward: Vec<Id> = equations.mass_matrix.iter().copied().chain(net).collect();
        let write = |name: &str, doc: &str, outputs: &[Id], scalar| {
            Function::new(g, layout, name, doc, outputs, scalar)
        };
        let plain = |name: &str, doc: &str, outputs: &[Id]| write(name, doc, outputs, scalar);
        let dual = |name: &str, doc: &str, outputs: &[Id]| write(name, doc, outputs, Scalar::Dual);
        let residual_doc = format!("r = M a + b − f_L, by {}.", equations.derivation);
        let forward_doc = "M (lower triangle, row by row), then f_L − b.";
        Self {
            residual: plain("residual_values", &residual_doc, &equations.residual),
            mass_matrix: plain(
                "mass_matrix_values",
                "M, lower triangle, row by row.",
                &equations.mass_matrix,
            ),
            bias: plain("bias_values", "b = r + f_L at a = 0.", &equations.bias),
            gravity: plain("gravity_values", "b at v = 0.", &equations.gravity),
            applied_force: plain("applied_force_values", "f_L.", &equations.applied_force),
            kinetic_energy: plain("kinetic_energy_values", "T.", &[equations.energies.kinetic]),
            potential_energy: plain(
                "potential_energy_values",
                "U.",
                &[equations.energies.potential],
            ),
            forward: plain("forward_values", forward_doc, &forward),
            residual_dual: dual("residual_dual", &residual_doc, &equations.residual),
            forward_dual: dual("forward_dual", forward_doc, &forward),
        }
    }

    /// The functions with the symbols of their values, for the robot's documentation.
    pub fn table(&self) -> [(&'static str, &Function); 8] {
        [
            ("r", &self.residual),
            ("M", &self.mass_matrix),
            ("b", &self.bias),
            ("b at v = 0", &self.gravity),
            ("M and f_L − b", &self.forward),
            ("f_L", &self.applied_force),
            ("T", &self.kinetic_energy),
            ("U", &self.potential_energy),
        ]
    }

    pub(super) fn definitions(&self, face: Face) -> TokenStream {
        let plain = [
            &self.residual,
            &self.mass_matrix,
            &self.bias,
            &self.gravity,
            &self.applied_force,
            &self.kinetic_energy,
            &self.potential_energy,
        ];
        let more = [&self.forward, &self.residual_dual, &self.forward_dual];
        let more = more.into_iter().filter(|_| face == Face::Full);
        let definitions = plain.into_iter().chain(more).map(|f| &f.definition);
        quote!(#(#definitions)*)
    }
}

/// A derivative's pattern and the function that writes its values.
#[derive(Debug, Clone)]
pub struct Body {
    /// Non-zeros in order.
    pub entries: Vec<Entry>,
    /// Its function.
    pub function: Function,
}

impl Body {
    /// Rows and columns.
    pub(super) fn pattern(&self) -> (TokenStream, TokenStream) {
        let list = |of: fn(&Entry) -> usize| {
            let positions = self
                .entries
                .iter()
                .map(|entry| Literal::usize_unsuffixed(of(entry)));
            quote!([#(#positions),*])
        };
        (list(|entry| entry.row), list(|entry| entry.col))
    }
}

/// The body of r and ∂r/∂z: r first, then the non-zeros.
pub fn jacobian(
    g: &Graph,
    layout: &Layout,
    equations: &Equations,
    derivatives: &Derivatives,
    scalar: Scalar,
) -> Body {
    let values = derivatives.jacobian.iter().map(|entry| entry.value);
    let outputs: Vec<Id> = equations.residual.iter().copied().chain(values).collect();
    let doc = "r and the non-zeros of ∂r/∂z.";
    Body {
        entries: derivatives.jacobian.clone(),
        function: Function::new(g, layout, "jacobian_values", doc, &outputs, scalar),
    }
}

/// The body of the lower triangle of ∂²(λᵀr)/∂z².
pub fn hessian(g: &Graph, layout: &Layout, derivatives: &Derivatives, scalar: Scalar) -> Body {
    let outputs: Vec<Id> = derivatives
        .hessian
        .iter()
        .map(|entry| entry.value)
        .collect();
    let doc = "The non-zeros of the lower triangle of ∂²(λᵀr)/∂z².";
    Body {
        entries: derivatives.hessian.clone(),
        function: Function::new(g, layout, "hessian_values", doc, &outputs, scalar),
    }
}

/// The linear form of a robot with its functions.
#[derive(Debug, Clone)]
pub struct Linear {
    pub(super) regressor: Regressor,
    pub(super) base: Option<BaseParameters>,
    pub(super) bodies: LinearBodies,
}

impl Linear {
    /// Derives it and writes the functions.
    ///
    /// # Errors
    /// If the equations are not linear in parameters that multiply each other.
    pub(super) fn new(
        g: &mut Graph,
        robot: &Robot,
        equations: &pid_derive::Equations,
        layout: &Layout,
    ) -> Result<Self, pid_derive::Error> {
        let linear = pid_derive::regressor(g, equations).map_err(|found| {
            let name = |k: usize| robot.params[k].name.clone();
            pid_derive::Error::NotLinear {
                robot: robot.name.clone(),
                first: name(found.first),
                second: name(found.second),
            }
        })?;
        let base = robot
            .emit
            .base_parameters
            .then(|| pid_derive::base_parameters(g, robot, equations, &linear));
        let bodies = LinearBodies::new(g, layout, &linear);
        Ok(Self {
            regressor: linear,
            base,
            bodies,
        })
    }
}

/// The functions of a regressor.
#[derive(Debug, Clone)]
pub struct LinearBodies {
    /// r₀, then the non-zeros of Y.
    pub(super) all: Function,
    /// The non-zeros of the constant columns.
    pub(super) constant: Function,
    /// r at u = 0 without them.
    pub(super) offset: Function,
}

impl LinearBodies {
    /// Writes the bodies.
    pub fn new(g: &Graph, layout: &Layout, regressor: &Regressor) -> Self {
        let of = |name: &str, doc: &str, outputs: &[Id]| {
            Function::new(g, layout, name, doc, outputs, Scalar::F64)
        };
        let values = regressor.entries.iter().map(|entry| entry.value);
        let all: Vec<Id> = regressor.offset.iter().copied().chain(values).collect();
        let constant: Vec<Id> = constant(regressor).map(|entry| entry.value).collect();
        Self {
            all: of("regressor_values", "r₀ and the non-zeros of Y.", &all),
            constant: of(
                "constant_regressor_values",
                "The non-zeros of the constant columns of Y.",
                &constant,
            ),
            offset: of(
                "regressor_offset_values",
                "r at u = 0 without the constant columns of Y.",
                &regressor.constant_offset,
            ),
        }
    }

    /// The functions with the symbols of their values, for the robot's documentation.
    pub fn table(&self) -> [(&'static str, &Function); 3] {
        [
            ("r₀ and Y", &self.all),
            ("Y(q, v, a)", &self.constant),
            ("tau − Y p", &self.offset),
        ]
    }
}

/// The non-zeros of the columns that depend on no parameter.
pub(super) fn constant(regressor: &Regressor) -> impl Iterator<Item = &Entry> {
    regressor
        .entries
        .iter()
        .filter(|entry| entry.col < regressor.constant)
}

/// Formulas of all base parameters.
pub fn formulas(robot: &Robot, regressor: &Regressor, base: &BaseParameters) -> Vec<String> {
    let name = |column: usize| robot.params[regressor.params[column]].name.clone();
    (0..base.terms.len())
        .map(|k| base.formula(k, name))
        .collect()
}

/// Operations of the base parameters of the constant columns.
pub fn cost(base: &BaseParameters) -> Cost {
    let terms = || base.terms[..base.constant].iter();
    Cost {
        additions: terms().map(|terms| terms.len() - 1).sum(),
        multiplications: terms()
            .flatten()
            .filter(|term| term.coefficient.abs() != 1.0)
            .count(),
        ..Cost::default()
    }
}
