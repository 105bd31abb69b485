//! Which parameters of a model are the gain and the friction of a joint, by what they do to its equation.

use pid_runtime::dynamics::{At, Hessian};

/// Parameters of one joint, as positions in p.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointRoles {
    /// Torque or force per unit of the input: ∂r/∂p = −u.
    pub gain: Option<usize>,
    /// Coulomb friction: ∂r/∂p is ±1 in motion.
    pub coulomb: Option<usize>,
    /// Viscous friction: ∂r/∂p = v.
    pub viscous: Option<usize>,
    /// Position of the joint's input in u.
    pub input: Option<usize>,
    /// Velocity v₀ of the transition at rest, tanh(v/v₀), where there is Coulomb friction.
    pub rest: Option<f64>,
}

/// Velocity at which every transition is over.
const FAST: f64 = 1e3;
/// Relative error of a probe.
const CLOSE: f64 = 1e-9;

/// Roles of all joints. A parameter that does anything else besides (a factor of two joints, an
/// exponent) has none.
pub fn roles(model: &dyn Hessian) -> Vec<JointRoles> {
    let dims = model.dims();
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let mut values = vec![0.0; model.jacobian_pattern().nnz()];
    let mut r = vec![0.0; dims.nq];
    let zero = vec![0.0; dims.nq];
    // Column ∂r/∂p_k of joint j at a velocity and an input of that joint alone, all parameters.
    let mut probe = |j: usize, speed: f64, input: Option<(usize, f64)>| -> Vec<f64> {
        let mut v = zero.clone();
        v[j] = speed;
        let mut u = vec![0.0; dims.nu];
        if let Some((i, x)) = input {
            u[i] = x;
        }
        let at = At {
            q: &zero,
            v: &v,
            a: &zero,
            u: &u,
            p: &p,
        };
        model.residual_jacobian(&at, &mut r, &mut values);
        let pattern = model.jacobian_pattern();
        let mut column = vec![0.0; dims.np];
        for ((&row, &col), value) in pattern.rows.iter().zip(pattern.cols).zip(&values) {
            if row as usize == j && col as usize >= dims.p() {
                column[col as usize - dims.p()] = *value;
            }
        }
        column
    };
    (0..dims.nq)
        .map(|j| {
            let input = model.inputs().iter().position(|i| i.joint == Some(j));
            let still = probe(j, 0.0, None);
            let (fast, faster, back) = (
                probe(j, FAST, None),
                probe(j, 2.0 * FAST, None),
                probe(j, -FAST, None),
            );
            let close = |x: f64, y: f64| (x - y).abs() <= CLOSE * y.abs();
            let find = |holds: &dyn Fn(usize) -> bool| {
                let mut all = (0..dims.np).filter(|&k| still[k] == 0.0 && holds(k));
                all.next().filter(|_| all.next().is_none())
            };
            let coulomb =
                find(&|k| close(fast[k], 1.0) && close(faster[k], 1.0) && close(back[k], -1.0));
            let viscous = find(&|k| {
                close(fast[k], FAST) && close(faster[k], 2.0 * FAST) && close(back[k], -FAST)
            });
            let gain = input.and_then(|i| {
                let (one, two) = (probe(j, 0.0, Some((i, 1.0))), probe(j, 0.0, Some((i, 2.0))));
                find(&|k| close(one[k], -1.0) && close(two[k], -2.0))
            });
            // From the slope at rest.
            let slow = 1e-7;
            let rest = coulomb.map(|k| slow / probe(j, slow, None)[k].abs().max(1e-12));
            JointRoles {
                gain,
                coulomb,
                viscous,
                input,
                rest,
            }
        })
        .collect()
}
