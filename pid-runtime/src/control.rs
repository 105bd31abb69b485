//! A controller within the model: the commanded position is the input, and the loop is simulated.
//!
//! ```text
//! u_j = e_j sat(P_j (q_ref,j − q_j) − D_j v_j; L_j) + (1 − e_j) k_j v_j
//! ```
//!
//! P, D: gains; L: limit of the drive, in the unit of the model's own input; e: 1 while the drive
//! is on. A drive that is off passes no current: with a voltage as input the terminals are open,
//! and `k` is the motor's constant (the parameter `gain_JOINT`), so that the voltage equals the
//! back-EMF; with any other input `k` is 0. The saturation is smooth,
//! `sat(x; L) = (√((x + L)² + δ²) − √((x − L)² + δ²))/2` with δ = 0.02 L.
//!
//! All constants of the law are inputs too, in the order q_ref, P, D, L, e (each one per joint):
//! they differ between records.

use std::borrow::Cow;
use std::cell::RefCell;

use crate::dynamics::{At, Dims, Hessian, InputInfo, ParamInfo};
use num_dual::{DualNum, HyperDual64};

use crate::chain::{Chain, Group, Substituted};
use crate::substituted;

/// Rounding of the saturation, as a share of the limit.
const ROUND: f64 = 0.02;
/// Arguments of the law: q, v, q_ref, P, D, L, e, k.
const ARGUMENTS: usize = 8;
/// Inputs of the law per joint: q_ref, P, D, L, e.
pub const INPUTS: usize = 5;
/// Stands for "no limit": it is never met, and derivatives stay finite.
pub const UNLIMITED: f64 = 1e12;

fn law<D: DualNum<Primitive = f64> + Copy>(x: [D; ARGUMENTS]) -> D {
    let [q, v, reference, p, d, limit, on, k] = x;
    let wanted = p * (reference - q) - d * v;
    let driven = if limit.re() >= UNLIMITED {
        wanted
    } else {
        let round = limit * ROUND;
        let (above, below) = (wanted + limit, wanted - limit);
        ((above * above + round * round).sqrt() - (below * below + round * round).sqrt()) * 0.5
    };
    on * driven + (D::from(1.0) - on) * k * v
}

/// The model's inputs are not one per joint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{model}` has {inputs} inputs for {joints} joints; a controller needs one per joint, in order"
)]
pub struct NotOnePerJoint {
    /// The model.
    pub model: String,
    /// Its inputs.
    pub inputs: usize,
    /// Its joints.
    pub joints: usize,
}

/// Gradient and Hessian of the law.
struct Law {
    gradient: [f64; ARGUMENTS],
    hessian: [[f64; ARGUMENTS]; ARGUMENTS],
}

fn differentiate(x: [f64; ARGUMENTS], second: bool) -> Law {
    let mut out = Law {
        gradient: [0.0; ARGUMENTS],
        hessian: [[0.0; ARGUMENTS]; ARGUMENTS],
    };
    let mut seeded = x.map(HyperDual64::from_re);
    for i in 0..ARGUMENTS {
        seeded[i].eps1 = 1.0;
        let first = if second { 0 } else { i };
        for j in first..=i {
            seeded[j].eps2 = 1.0;
            let f = law(seeded);
            seeded[j].eps2 = 0.0;
            out.gradient[i] = f.eps1;
            out.hessian[i][j] = f.eps1eps2;
            out.hessian[j][i] = f.eps1eps2;
        }
        seeded[i].eps1 = 0.0;
    }
    out
}

thread_local! {
    /// Inner inputs; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

/// A model with its controller; parameters are those of the model.
pub struct ClosedLoop<'m> {
    inner: Box<dyn Hessian + 'm>,
    dims: Dims,
    params: Vec<ParamInfo>,
    inputs: Vec<InputInfo>,
    /// Position of the back-EMF constant of each joint.
    constants: Vec<Option<usize>>,
    chain: Chain,
}

impl<'m> ClosedLoop<'m> {
    /// Puts the controller around a model.
    ///
    /// # Errors
    /// [`NotOnePerJoint`] unless there is one input per joint, in order.
    pub fn new(inner: Box<dyn Hessian + 'm>) -> Result<Self, NotOnePerJoint> {
        let own = inner.dims();
        let nq = own.nq;
        let in_order = inner
            .inputs()
            .iter()
            .enumerate()
            .all(|(j, i)| i.joint == Some(j));
        if own.nu != nq || !in_order {
            return Err(NotOnePerJoint {
                model: inner.name().to_owned(),
                inputs: own.nu,
                joints: nq,
            });
        }
        let dims = Dims {
            nu: INPUTS * nq,
            ..own
        };
        let mut inputs = Vec::with_capacity(dims.nu);
        for kind in 0..INPUTS {
            for (info, input) in inner.joints().iter().zip(inner.inputs()) {
                let length = info.unit();
                let (word, unit) = match kind {
                    0 => ("reference", length.to_owned()),
                    1 => ("p", format!("{}/{length}", input.unit)),
                    2 => ("d", format!("{}*s/{length}", input.unit)),
                    3 => ("limit", input.unit.to_string()),
                    _ => ("on", "1".to_owned()),
                };
                inputs.push(InputInfo {
                    name: Cow::Owned(format!("{word}_{}", info.name)),
                    unit: Cow::Owned(unit),
                    joint: (kind == 0).then_some(inputs.len()),
                });
            }
        }
        let constants: Vec<Option<usize>> = (0..nq)
            .map(|j| {
                let name = format!("gain_{}", inner.joints()[j].name);
                let voltage = inner.inputs()[j].unit == "V";
                inner
                    .params()
                    .iter()
                    .position(|p| voltage && p.name == name)
            })
            .collect();
        let place = |j: usize, argument: usize| -> Option<usize> {
            match argument {
                0 => Some(j),
                1 => Some(dims.v() + j),
                7 => constants[j].map(|k| dims.p() + k),
                a => Some(dims.u() + (a - 2) * nq + j),
            }
        };
        let groups: Vec<Group> = (0..nq)
            .map(|j| Group {
                replaces: vec![own.u() + j],
                arguments: (0..ARGUMENTS).map(|a| place(j, a)).collect(),
            })
            .collect();
        let chain = Chain::new(inner.as_ref(), &groups, |z| match z < own.u() {
            true => z,
            false => dims.p() + z - own.p(),
        });
        Ok(Self {
            params: inner.params().to_vec(),
            inner,
            dims,
            inputs,
            constants,
            chain,
        })
    }

    fn arguments(&self, at: &At<'_>, j: usize) -> [f64; ARGUMENTS] {
        let nq = self.dims.nq;
        let input = |kind: usize| at.u[kind * nq + j];
        [
            at.q[j],
            at.v[j],
            input(0),
            input(1),
            input(2),
            input(3),
            input(4),
            self.constants[j].map_or(0.0, |k| at.p[k]),
        ]
    }
}

impl Substituted for ClosedLoop<'_> {
    fn inner(&self) -> &dyn Hessian {
        self.inner.as_ref()
    }

    fn chain(&self) -> &Chain {
        &self.chain
    }

    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R {
        let mut u = SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        u.clear();
        u.extend((0..self.dims.nq).map(|j| law(self.arguments(at, j))));
        let out = work(&At { u: &u, ..*at });
        SCRATCH.with(|s| *s.borrow_mut() = u);
        out
    }

    fn gradients(&self, at: &At<'_>, out: &mut Vec<f64>) {
        for j in 0..self.dims.nq {
            out.extend(differentiate(self.arguments(at, j), false).gradient);
        }
    }

    fn curvatures(&self, at: &At<'_>, weights: &[f64], out: &mut Vec<f64>) {
        for (j, w) in weights.iter().enumerate() {
            let law = differentiate(self.arguments(at, j), true);
            out.extend(law.hessian.as_flattened().iter().map(|h| w * h));
        }
    }
}

substituted!(ClosedLoop);

#[cfg(test)]
mod tests {
    use super::{UNLIMITED, law};

    #[test]
    fn the_law_is_linear_within_its_limit_and_flat_beyond() {
        let u = |error: f64, limit: f64| law([0.0, 0.0, error, 2.0, 0.0, limit, 1.0, 0.4]);
        assert!((u(0.5, 10.0) - 1.0).abs() < 1e-3);
        assert_eq!(u(0.5, UNLIMITED), 1.0);
        assert!((u(50.0, 10.0) - 10.0).abs() < 2e-2 && (u(-50.0, 10.0) + 10.0).abs() < 2e-2);
    }
}
