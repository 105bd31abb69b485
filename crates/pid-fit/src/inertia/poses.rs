//! Definiteness of the mass matrix over the workspace.

use nalgebra::DMatrix;
use pid_runtime::dynamics::{At, Dynamics};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Share of random poses in which M(q, p) is not positive definite.
///
/// Positions are drawn evenly within the joints' limits, ±π (±1 m) where there are none. NaN for no poses.
pub fn indefinite_share(model: &dyn Dynamics, p: &[f64], poses: usize, seed: u64) -> f64 {
    let dims = model.dims();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let idle = vec![0.0; dims.nq.max(dims.nu)];
    let mut m = vec![0.0; dims.nm()];
    let mut q = vec![0.0; dims.nq];
    let mut bad = 0_usize;
    for _ in 0..poses {
        for (q, joint) in q.iter_mut().zip(model.joints()) {
            let reach = if joint.prismatic {
                1.0
            } else {
                std::f64::consts::PI
            };
            let (low, high) = joint.limits.unwrap_or((-reach, reach));
            *q = low + (high - low) * random.random::<f64>();
        }
        let at = At {
            q: &q,
            v: &idle[..dims.nq],
            a: &idle[..dims.nq],
            u: &idle[..dims.nu],
            p,
        };
        model.mass_matrix(&at, &mut m);
        let full = DMatrix::from_fn(dims.nq, dims.nq, |i, j| {
            let (i, j) = (i.max(j), i.min(j));
            m[i * (i + 1) / 2 + j]
        });
        bad += usize::from(full.cholesky().is_none());
    }
    bad as f64 / poses as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_models::{Scara, Ur10e};

    #[test]
    fn bodies_have_positive_mass_matrices_and_a_negative_one_does_not() {
        let nominal = |m: &dyn Dynamics| m.params().iter().map(|i| i.nominal).collect::<Vec<f64>>();
        assert_eq!(indefinite_share(&Scara, &nominal(&Scara), 500, 1), 0.0);
        let mut p = nominal(&Ur10e);
        assert_eq!(indefinite_share(&Ur10e, &p, 500, 1), 0.0);
        // The last axis turns wrist_3 alone: its mass matrix entry is izz.
        let izz = Ur10e
            .params()
            .iter()
            .position(|i| i.name == "wrist_3_izz")
            .unwrap();
        p[izz] = -1e-3;
        assert_eq!(indefinite_share(&Ur10e, &p, 500, 1), 1.0);
    }
}
