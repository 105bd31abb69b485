//! Forward dynamics: accelerations from states and inputs.

use super::Fault;
use super::linear::{cholesky, cholesky_solve};
use pid_runtime::dynamics::{At, Dims, Dynamics};

/// Forward dynamics `a = M(q, p)⁻¹ (f_L(q, v, p, u) − b(q, v, p))` with its memory.
pub struct ForwardDynamics<'m> {
    model: &'m dyn Dynamics,
    dims: Dims,
    m: Vec<f64>,
    b: Vec<f64>,
    /// Zeros in the place of accelerations, which none of the three functions reads.
    zero: Vec<f64>,
}

impl<'m> ForwardDynamics<'m> {
    /// Memory for a model.
    pub fn new(model: &'m dyn Dynamics) -> Self {
        let dims = model.dims();
        let (m, b) = (vec![0.0; dims.nm()], vec![0.0; dims.nq]);
        ForwardDynamics {
            model,
            dims,
            m,
            b,
            zero: vec![0.0; dims.nq],
        }
    }

    /// The model.
    pub fn model(&self) -> &'m dyn Dynamics {
        self.model
    }

    /// Sizes of the model.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// Accelerations; shapes `q`, `v`, `a`: nq, `u`: nu, `p`: np.
    ///
    /// `None` if M has no Cholesky factorization or a value is not finite.
    pub fn acceleration(
        &mut self,
        q: &[f64],
        v: &[f64],
        u: &[f64],
        p: &[f64],
        a: &mut [f64],
    ) -> Option<()> {
        self.evaluate(q, v, u, p, a).ok()
    }

    pub(super) fn evaluate(
        &mut self,
        q: &[f64],
        v: &[f64],
        u: &[f64],
        p: &[f64],
        a: &mut [f64],
    ) -> Result<(), Fault> {
        let at = At {
            q,
            v,
            a: &self.zero,
            u,
            p,
        };
        self.model.mass_matrix(&at, &mut self.m);
        self.model.bias(&at, &mut self.b);
        self.model.applied_force(&at, a);
        if self.m.iter().any(|x| !x.is_finite()) {
            return Err(Fault::NotFinite);
        }
        cholesky(&mut self.m, self.dims.nq)
            .map_err(|(joint, value)| Fault::Singular { joint, value })?;
        for (a, b) in a.iter_mut().zip(&self.b) {
            *a -= b;
        }
        cholesky_solve(&self.m, self.dims.nq, a);
        if a.iter().all(|x| x.is_finite()) {
            Ok(())
        } else {
            Err(Fault::NotFinite)
        }
    }
}
