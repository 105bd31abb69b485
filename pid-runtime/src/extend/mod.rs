//! A model with further force terms: every estimator that takes a model takes this one.

mod added;
mod merged;
mod term;

use crate::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};
use crate::memory::Memory;
use crate::term::{Law, Request};
pub use added::ExtendError;
use added::{Added, places};
use merged::{Merged, Part, hessian_entries, jacobian_entries};
use term::Term;

/// A model and the terms added to it. Parameters of the terms follow those of the model.
///
/// ```
/// use pid_runtime::extend::Extended;
/// use pid_models::Emps;
/// use pid_runtime::dynamics::Dynamics;
///
/// let model = Extended::new(&Emps, &["asymmetric".parse()?])?;
/// assert_eq!(model.params().last().unwrap().name, "asymmetric_x");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Extended<'m> {
    inner: &'m dyn Hessian,
    dims: Dims,
    params: Vec<ParamInfo>,
    terms: Vec<Term>,
    /// The model's inputs and the states of laws with a memory.
    inputs: Vec<InputInfo>,
    memories: Vec<Memory>,
    jacobian: Merged,
    hessian: Merged,
}

impl<'m> Extended<'m> {
    /// Adds terms to a model.
    ///
    /// # Errors
    /// [`ExtendError`] where a term names a joint that does not exist, or a parameter that does.
    pub fn new(inner: &'m dyn Hessian, requests: &[Request]) -> Result<Self, ExtendError> {
        let mut added = Added {
            params: inner.params().to_vec(),
            inputs: inner.inputs().to_vec(),
            memories: Vec::new(),
            terms: Vec::new(),
        };
        for request in requests {
            for joints in places(inner, request)? {
                match request.law.has_memory() {
                    true => added.remember(inner, request, &joints)?,
                    false => added.place(inner, request, joints)?,
                }
            }
        }
        let Added {
            params,
            inputs,
            memories,
            terms,
        } = added;
        let dims = Dims {
            nu: inner.dims().nu + memories.len(),
            np: params.len(),
            ..inner.dims()
        };
        // Further inputs lie before the parameters.
        let (first, further) = (inner.dims().p(), memories.len());
        let moved = |z: u32| match z as usize {
            z if z >= first => (z + further) as u32,
            z => z as u32,
        };
        let own = |pattern: Pattern<'_>, row: &dyn Fn(u32) -> u32| -> Vec<(u32, u32)> {
            let places = pattern.rows.iter().zip(pattern.cols);
            places.map(|(&r, &c)| (row(r), moved(c))).collect()
        };
        let jacobian = Merged::new(
            own(inner.jacobian_pattern(), &|row| row),
            &terms
                .iter()
                .map(|t| jacobian_entries(t, dims))
                .collect::<Vec<_>>(),
        );
        let hessian = Merged::new(
            own(inner.hessian_pattern(), &moved),
            &terms
                .iter()
                .map(|t| hessian_entries(t, dims))
                .collect::<Vec<_>>(),
        );
        Ok(Self {
            inner,
            dims,
            params,
            terms,
            inputs,
            memories,
            jacobian,
            hessian,
        })
    }

    /// States of laws with a memory, in the order in which the model takes them: after the inputs
    /// of the model without terms.
    pub fn memories(&self) -> &[Memory] {
        &self.memories
    }

    fn own<'a>(&self, at: &At<'a>) -> At<'a> {
        let dims = self.inner.dims();
        At {
            // Records may have more channels than the model has inputs.
            u: match self.memories.is_empty() {
                true => at.u,
                false => &at.u[..dims.nu],
            },
            p: &at.p[..dims.np],
            ..*at
        }
    }
}

impl Dynamics for Extended<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }
    fn dims(&self) -> Dims {
        self.dims
    }
    fn params(&self) -> &[ParamInfo] {
        &self.params
    }
    fn joints(&self) -> &[JointInfo] {
        self.inner.joints()
    }
    fn inputs(&self) -> &[InputInfo] {
        &self.inputs
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        self.inner.mass_matrix(&self.own(at), m);
        for term in self.terms.iter().filter(|t| t.law == Law::Armature) {
            let c = at.p[term.coefficient];
            for &i in &term.joints {
                for &j in term.joints.iter().filter(|&&j| j <= i) {
                    m[i * (i + 1) / 2 + j] += c;
                }
            }
        }
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        self.inner.bias(&self.own(at), b);
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        self.inner.applied_force(&self.own(at), f);
        for term in self.terms.iter().filter(|t| t.law != Law::Armature) {
            let force = term.force(at);
            term.joints.iter().for_each(|&j| f[j] -= force);
        }
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        self.inner.residual(&self.own(at), r);
        for term in &self.terms {
            let force = term.force(at);
            term.joints.iter().for_each(|&j| r[j] += force);
        }
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        let rotors: f64 = self
            .terms
            .iter()
            .filter(|t| t.law == Law::Armature)
            .map(|t| {
                let w: f64 = t.joints.iter().map(|&j| at.v[j]).sum();
                0.5 * at.p[t.coefficient] * w * w
            })
            .sum();
        self.inner.kinetic_energy(&self.own(at)) + rotors
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.inner.potential_energy(&self.own(at))
    }
}

impl Jacobian for Extended<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let own = self.jacobian.inner.len();
        self.inner
            .residual_jacobian(&self.own(at), r, &mut values[..own]);
        self.jacobian.spread(values);
        for (term, shares) in self.terms.iter().zip(&self.jacobian.shares) {
            let c = at.p[term.coefficient];
            let (value, gradient, _) = term.law.derivatives(term.arguments(at), term.rest);
            term.joints.iter().for_each(|&j| r[j] += c * value);
            for share in shares {
                values[share.slot] += match share.part {
                    Part::Value => value,
                    Part::Scaled(i) => c * gradient[i],
                    Part::Gradient(_) | Part::Curvature(..) => 0.0,
                };
            }
        }
    }
}

impl Hessian for Extended<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let own = self.hessian.inner.len();
        self.inner
            .residual_hessian(&self.own(at), lambda, &mut values[..own]);
        self.hessian.spread(values);
        for (term, shares) in self.terms.iter().zip(&self.hessian.shares) {
            let l: f64 = term.joints.iter().map(|&j| lambda[j]).sum();
            let c = at.p[term.coefficient];
            let (_, gradient, curvature) = term.law.derivatives(term.arguments(at), term.rest);
            for share in shares {
                values[share.slot] += l * match share.part {
                    Part::Gradient(i) => gradient[i],
                    Part::Curvature(i, j) => c * curvature[i][j],
                    Part::Value | Part::Scaled(_) => 0.0,
                };
            }
        }
    }
}
