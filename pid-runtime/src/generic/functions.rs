//! Functions of a state and the parameters given by the user: outputs and constraints,
//! differentiated exactly.
//!
//! ```text
//! g(x, p) ∈ Rᵏ,      x = (q, v),      p the parameters in their own units
//! ```
//!
//! A type implements [`GenericFunction`] once, over any dual number; [`Exact`] makes values,
//! Jacobian and Hessian of it by forward mode (one evaluation per column, one per pair of columns).
//! Functions are small and few; models are differentiated symbolically instead.
//!
//! # Example
//! The height of the tip of a pendulum as a measured output:
//! ```
//! use pid_runtime::generic::functions::{Exact, GenericFunction, PointFunction};
//! use pid_runtime::num_dual::DualNum;
//!
//! struct Height;
//! impl GenericFunction for Height {
//!     fn outputs(&self) -> usize {
//!         1
//!     }
//!     fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D], out: &mut [D]) {
//!         out[0] = -p[0] * x[0].cos();
//!     }
//! }
//!
//! let height = Exact::new(Height, 2, 1);
//! let (mut y, mut jacobian) = ([0.0], [0.0; 3]);
//! height.jacobian(&[0.5, 0.0], &[2.0], &mut y, &mut jacobian);
//! assert_eq!(jacobian, [2.0 * 0.5_f64.sin(), 0.0, -0.5_f64.cos()]);
//! ```

use num_dual::{Dual64, DualNum, HyperDual64};

/// A function of (x, p) over any dual number.
pub trait GenericFunction: Send + Sync {
    /// Number of values.
    fn outputs(&self) -> usize;

    /// Positions in (x, p) that the values depend on, ascending; `None` for all of them.
    /// Derivatives are evaluated there alone and are zero elsewhere. State them: the cost of a
    /// constraint at every node grows with the square of their number.
    fn variables(&self) -> Option<Vec<usize>> {
        None
    }

    /// The values; lengths: `x` 2 nq, `p` np, `out` [`Self::outputs`].
    fn evaluate<D: DualNum<Primitive = f64> + Copy>(&self, x: &[D], p: &[D], out: &mut [D]);
}

/// A function of (x, p) with exact derivatives. Values that are not finite mean "not here".
pub trait PointFunction: Send + Sync {
    /// Number of values.
    fn outputs(&self) -> usize;
    /// Positions in (x, p) that the values depend on, ascending; `None` for all of them.
    fn variables(&self) -> Option<Vec<usize>> {
        None
    }
    /// Lengths of x and p that it takes; `None` if it takes any.
    fn lengths(&self) -> Option<(usize, usize)> {
        None
    }
    /// The values.
    fn value(&self, x: &[f64], p: &[f64], out: &mut [f64]);
    /// The values and ∂g/∂(x, p), dense, row by row: `jacobian[row * (nx + np) + column]`.
    fn jacobian(&self, x: &[f64], p: &[f64], out: &mut [f64], jacobian: &mut [f64]);
    /// ∂²(λᵀ g)/∂(x, p)², dense and symmetric, (nx + np)².
    fn hessian(&self, x: &[f64], p: &[f64], lambda: &[f64], hessian: &mut [f64]);
}

/// Exact derivatives of a [`GenericFunction`] by dual numbers.
#[derive(Debug, Clone)]
pub struct Exact<F> {
    function: F,
    nx: usize,
    np: usize,
    variables: Vec<usize>,
}

impl<F: GenericFunction> Exact<F> {
    /// Of a function of `nx` states (2 nq) and `np` parameters.
    pub fn new(function: F, nx: usize, np: usize) -> Self {
        let variables = function.variables();
        let mut variables = variables.unwrap_or_else(|| (0..nx + np).collect());
        variables.retain(|i| *i < nx + np);
        Self {
            function,
            nx,
            np,
            variables,
        }
    }

    fn over<D: DualNum<Primitive = f64> + Copy>(&self, x: &[f64], p: &[f64]) -> (Vec<D>, Vec<D>) {
        assert_eq!(
            (x.len(), p.len()),
            (self.nx, self.np),
            "lengths as announced"
        );
        let z = x.iter().chain(p).map(|&z| D::from(z)).collect();
        (z, vec![D::from(0.0); self.function.outputs()])
    }

    fn at<D: DualNum<Primitive = f64> + Copy>(&self, z: &[D], out: &mut [D]) {
        let (x, p) = z.split_at(self.nx);
        self.function.evaluate(x, p, out);
    }
}

impl<F: GenericFunction> PointFunction for Exact<F> {
    fn outputs(&self) -> usize {
        self.function.outputs()
    }

    fn variables(&self) -> Option<Vec<usize>> {
        Some(self.variables.clone())
    }

    fn lengths(&self) -> Option<(usize, usize)> {
        Some((self.nx, self.np))
    }

    fn value(&self, x: &[f64], p: &[f64], out: &mut [f64]) {
        self.function.evaluate(x, p, out);
    }

    fn jacobian(&self, x: &[f64], p: &[f64], out: &mut [f64], jacobian: &mut [f64]) {
        let (mut z, mut y) = self.over::<Dual64>(x, p);
        let nz = z.len();
        self.function.evaluate(x, p, out);
        jacobian[..nz * y.len()].fill(0.0);
        for &column in &self.variables {
            z[column].eps = 1.0;
            self.at(&z, &mut y);
            z[column].eps = 0.0;
            for (row, y) in y.iter().enumerate() {
                jacobian[row * nz + column] = y.eps;
            }
        }
    }

    fn hessian(&self, x: &[f64], p: &[f64], lambda: &[f64], hessian: &mut [f64]) {
        let (mut z, mut y) = self.over::<HyperDual64>(x, p);
        let nz = z.len();
        hessian[..nz * nz].fill(0.0);
        for (k, &i) in self.variables.iter().enumerate() {
            for &j in &self.variables[..=k] {
                z[i].eps1 = 1.0;
                z[j].eps2 = 1.0;
                self.at(&z, &mut y);
                z[i].eps1 = 0.0;
                z[j].eps2 = 0.0;
                let sum: f64 = lambda.iter().zip(&y).map(|(l, y)| l * y.eps1eps2).sum();
                hessian[i * nz + j] = sum;
                hessian[j * nz + i] = sum;
            }
        }
    }
}
