//! The slice face of a model: one object-safe trait per capability.
//!
//! Every model is the implicit residual
//!
//! ```text
//! r(q, v, a, u, p) = M(q, p) a + b(q, v, p) − f_L(q, v, p, u)          [N·m or N, one per coordinate]
//! ```
//!
//! (Euler-Lagrange with forcing; K. Schäfer et al., Section V-A). Its arguments are stacked as
//! `z = (q, v, a, u, p)`, of length [`Dims::nz`]; patterns of derivatives refer to positions in `z`.
//!
//! Evaluation allocates nothing, does not panic on finite slices of the stated lengths and returns
//! no `Result`: a value that is not finite means "cannot be evaluated here".

use std::borrow::Cow;

pub use crate::at::At;
pub use crate::inverse::InverseDynamicsDerivatives;
use crate::lanes::{Lane, LanesAt, one_by_one};

/// Sizes of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dims {
    /// Number of coordinates.
    pub nq: usize,
    /// Number of inputs.
    pub nu: usize,
    /// Number of parameters.
    pub np: usize,
}

impl Dims {
    /// Length of `z = (q, v, a, u, p)`.
    pub const fn nz(&self) -> usize {
        3 * self.nq + self.nu + self.np
    }
    /// Position of the first velocity in `z`.
    pub const fn v(&self) -> usize {
        self.nq
    }
    /// Position of the first acceleration in `z`.
    pub const fn a(&self) -> usize {
        2 * self.nq
    }
    /// Position of the first input in `z`.
    pub const fn u(&self) -> usize {
        3 * self.nq
    }
    /// Position of the first parameter in `z`.
    pub const fn p(&self) -> usize {
        3 * self.nq + self.nu
    }
    /// Length of a packed lower triangle of M: `nq (nq + 1) / 2`.
    pub const fn nm(&self) -> usize {
        self.nq * (self.nq + 1) / 2
    }
}

/// Name, unit, range and nominal value of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ParamInfo {
    /// Name, `dry_shoulder`.
    pub name: Cow<'static, str>,
    /// Unit, `kg*m^2`.
    pub unit: Cow<'static, str>,
    /// First line of its documentation.
    pub doc: Cow<'static, str>,
    /// Nominal value.
    pub nominal: f64,
    /// Lower bound, `-inf` if none.
    pub lower: f64,
    /// Upper bound, `+inf` if none.
    pub upper: f64,
    /// Identifications hold it at its nominal value unless their settings say otherwise.
    pub fixed: bool,
}

/// Name, kind and range of a coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct JointInfo {
    /// Name of the joint.
    pub name: Cow<'static, str>,
    /// Whether the coordinate is a length (`true`) or an angle.
    pub prismatic: bool,
    /// Range of the coordinate, rad or m.
    pub limits: Option<(f64, f64)>,
}

impl JointInfo {
    /// Unit of the coordinate: `m` or `rad`.
    pub fn unit(&self) -> &'static str {
        if self.prismatic { "m" } else { "rad" }
    }
    /// Unit of the velocity: `m/s` or `rad/s`.
    pub fn velocity_unit(&self) -> &'static str {
        if self.prismatic { "m/s" } else { "rad/s" }
    }
    /// Unit of the generalised force: `N` or `N*m`.
    pub fn force_unit(&self) -> &'static str {
        if self.prismatic { "N" } else { "N*m" }
    }
}

/// Name, unit and joint of an input.
#[derive(Debug, Clone, PartialEq)]
pub struct InputInfo {
    /// Name, `current_shoulder`.
    pub name: Cow<'static, str>,
    /// Unit, `A`.
    pub unit: Cow<'static, str>,
    /// Coordinate of the joint it belongs to, if it belongs to one.
    pub joint: Option<usize>,
}

/// Rank of a set of parameters: how many combinations of them a motion can determine if every
/// coordinate is measured and every input is known.
#[derive(Debug, Clone, PartialEq)]
pub struct StructuralRank {
    /// Number of parameters considered.
    pub params: usize,
    /// Combinations determined at almost all parameter values.
    pub generic: usize,
    /// Combinations determined at the nominal values. There are fewer where symmetry hides more.
    pub nominal: usize,
    /// Combinations lost at almost all values, one line per group: "`m1` and `iz1` enter only
    /// through one combination".
    pub groups: Cow<'static, [Cow<'static, str>]>,
}

/// Structural identifiability: ranks of the forward dynamics' derivatives by the parameters over
/// all states and inputs.
///
/// This is a property of the equations. A record determines at most so many combinations, and fewer
/// where it does not excite them.
#[derive(Debug, Clone, PartialEq)]
pub struct Identifiability {
    /// Rank of all parameters.
    pub all: StructuralRank,
    /// Rank of the parameters not marked `fixed`, with the others known.
    pub free: StructuralRank,
}

/// A model's values.
pub trait Dynamics: Send + Sync {
    /// Name of the robot.
    fn name(&self) -> &str;
    /// Sizes.
    fn dims(&self) -> Dims;
    /// Parameters, in the order of `p`.
    fn params(&self) -> &[ParamInfo];
    /// Coordinates, in the order of `q`.
    fn joints(&self) -> &[JointInfo];
    /// Inputs, in the order of `u`.
    fn inputs(&self) -> &[InputInfo];
    /// Which combinations of the parameters a motion determines, if it was derived.
    fn identifiability(&self) -> Option<&Identifiability> {
        None
    }
    /// The declaration behind the model as text, which `nominal::declaration` reads. `None` if the
    /// model was not declared by `robot!`, or has forces added.
    fn declaration(&self) -> Option<&str> {
        None
    }
    /// Lower triangle of M(q, p), row by row: `m[i (i+1)/2 + j]`, j ≤ i. Reads `q`, `p`.
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]);
    /// Coriolis, centrifugal and gravity forces b(q, v, p). Reads `q`, `v`, `p`.
    fn bias(&self, at: &At<'_>, b: &mut [f64]);
    /// Generalised forces of drives and friction f_L(q, v, u, p). Reads `q`, `v`, `u`, `p`.
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]);
    /// r = M a + b − f_L. Reads everything.
    fn residual(&self, at: &At<'_>, r: &mut [f64]);
    /// Kinetic energy, J. Reads `q`, `v`, `p`.
    fn kinetic_energy(&self, at: &At<'_>) -> f64;
    /// Potential energy, J. Reads `q`, `p`.
    fn potential_energy(&self, at: &At<'_>) -> f64;
    /// [`mass_matrix`](Self::mass_matrix) of four nodes; see [`lanes`](crate::lanes).
    fn mass_matrix_lanes(&self, at: &LanesAt<'_>, m: &mut [Lane]) {
        one_by_one(at, &[], m, &mut [], |at, _, m, _| self.mass_matrix(at, m));
    }
    /// [`applied_force`](Self::applied_force) of four nodes; see [`lanes`](crate::lanes).
    fn applied_force_lanes(&self, at: &LanesAt<'_>, f: &mut [Lane]) {
        one_by_one(at, &[], f, &mut [], |at, _, f, _| self.applied_force(at, f));
    }
    /// [`residual`](Self::residual) of four nodes; see [`lanes`](crate::lanes).
    fn residual_lanes(&self, at: &LanesAt<'_>, r: &mut [Lane]) {
        one_by_one(at, &[], r, &mut [], |at, _, r, _| self.residual(at, r));
    }
}

/// Structural non-zeros of a derivative, in the order in which values are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pattern<'a> {
    /// Row of each entry.
    pub rows: &'a [u32],
    /// Column of each entry.
    pub cols: &'a [u32],
}

impl Pattern<'_> {
    /// Number of structural non-zeros.
    pub fn nnz(&self) -> usize {
        self.rows.len()
    }
}

/// Exact first derivatives of the residual.
pub trait Jacobian: Dynamics {
    /// Rows: residuals; columns: positions in `z`. Sorted by row, then column.
    fn jacobian_pattern(&self) -> Pattern<'_>;
    /// The residual and the values of ∂r/∂z at the pattern's entries.
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]);
    /// [`residual_jacobian`](Self::residual_jacobian) of four nodes; see [`lanes`](crate::lanes).
    fn residual_jacobian_lanes(&self, at: &LanesAt<'_>, r: &mut [Lane], values: &mut [Lane]) {
        one_by_one(at, &[], r, values, |at, _, r, values| {
            self.residual_jacobian(at, r, values);
        });
    }
}

/// Exact second derivatives of λᵀ r.
pub trait Hessian: Jacobian {
    /// Lower triangle (row ≥ column) of ∂²(λᵀr)/∂z², positions in `z`. Sorted by row, then column.
    fn hessian_pattern(&self) -> Pattern<'_>;
    /// The values at the pattern's entries; `lambda` has one entry per residual.
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]);
    /// [`residual_hessian`](Self::residual_hessian) of four nodes, each with its multipliers; see
    /// [`lanes`](crate::lanes).
    fn residual_hessian_lanes(&self, at: &LanesAt<'_>, lambda: &[Lane], values: &mut [Lane]) {
        one_by_one(at, lambda, values, &mut [], |at, lambda, values, _| {
            self.residual_hessian(at, lambda, values);
        });
    }
}

/// Base parameters: the combinations β = C p_L of the linear parameters on which the residual depends
/// (W. Khalil, F. Bennis, 1995; M. Gautier, 1991).
#[derive(Debug, Clone, PartialEq)]
pub struct BaseParameters {
    /// Columns of the regressor that remain: `r = Y[:, columns] β + offset`, linearly independent
    /// as functions of the motion.
    pub columns: Cow<'static, [u32]>,
    /// Base parameter of each non-zero of C.
    pub rows: Cow<'static, [u32]>,
    /// Column of the regressor of each non-zero of C.
    pub cols: Cow<'static, [u32]>,
    /// The non-zeros of C.
    pub coefficients: Cow<'static, [f64]>,
    /// β in words: `l1_izz + rotor_j1 + 0.612^2*l3_m`.
    pub formulas: Cow<'static, [Cow<'static, str>]>,
}

impl BaseParameters {
    /// Number of base parameters.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Whether there are no base parameters.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// β of the linear parameters, given in the order of [`Regressor::linear_params`]. `beta` has
    /// [`len`](Self::len) entries.
    ///
    /// # Panics
    /// If a slice is too short.
    pub fn evaluate(&self, linear: &[f64], beta: &mut [f64]) {
        beta[..self.len()].fill(0.0);
        for ((&row, &col), c) in self
            .rows
            .iter()
            .zip(self.cols.iter())
            .zip(self.coefficients.iter())
        {
            beta[row as usize] += c * linear[col as usize];
        }
    }
}

/// The residual as a linear function of parameters: `r = Y(q, v, a, u, p_R) p_L + r₀(q, v, a, u, p_R)`.
///
/// `p_L` are the parameters in which r is jointly linear: those of the links (mass, first moment,
/// inertia about the origin), rotors, and the coefficients of friction and drives. `p_R` are the
/// others, such as the sharpness of a `tanh`.
pub trait Regressor: Dynamics {
    /// p_L: position in `p` of the parameter of each column. Columns that depend on motion alone come first.
    fn linear_params(&self) -> &[usize];
    /// Rows: residuals; columns: positions in [`linear_params`](Self::linear_params). Sorted by
    /// row, then column.
    fn regressor_pattern(&self) -> Pattern<'_>;
    /// r₀ and the values of Y at the pattern's entries. Reads `q`, `v`, `a`, `u` and of `p` the
    /// parameters p_R only.
    fn regressor(&self, at: &At<'_>, offset: &mut [f64], values: &mut [f64]);
    /// The base parameters of p_L, if the robot asks for them.
    fn base_parameters(&self) -> Option<&BaseParameters> {
        None
    }
}

/// The mass matrix cannot be factorised: M is not positive definite.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the mass matrix is not positive definite: pivot {pivot:e} at coordinate {index}; \
     check that every body moved by this joint has a positive mass or inertia about its axis"
)]
pub struct SingularMassMatrix {
    /// Coordinate at which the factorization stopped.
    pub index: usize,
    /// The pivot found there, which should be positive.
    pub pivot: f64,
}
