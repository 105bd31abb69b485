//! The Radau IIA method of order 5 on the implicit residual.
//!
//! Its stages are solved for the accelerations `a_i` at the three nodes, with velocities and
//! positions following from them (A the matrix of the method, h the step):
//!
//! ```text
//! v_i = v_0 + h Σ_j A_ij a_j,        q_i = q_0 + c_i h v_0 + h² Σ_j (A²)_ij a_j,        r(q_i, v_i, a_i, u_i, p) = 0
//! ```
//!
//! These are a third of the unknowns of the usual form. M need not be factorised, and the Jacobian
//! `δ_ij ∂r/∂a + h A_ij ∂r/∂v + h² (A²)_ij ∂r/∂q` is exact at every stage, so Newton's method
//! converges quadratically even across the kink of dry friction.

use super::forward::ForwardDynamics;
use super::linear::solve;
use super::{Fault, Interval, Settings, scaled_norm};
use pid_runtime::dynamics::{At, Jacobian};

/// The step is cut after this many Newton iterations.
const MAX_NEWTON: usize = 12;

/// Constants of the method.
struct Tableau {
    c: [f64; 3],
    a: [[f64; 3]; 3],
    /// A².
    a2: [[f64; 3]; 3],
    /// Real eigenvalue of A.
    gamma: f64,
    /// Weights of the stage increments in the error estimate.
    e: [f64; 3],
}

impl Tableau {
    fn new() -> Self {
        let s = 6.0_f64.sqrt();
        let a = [
            [
                (88.0 - 7.0 * s) / 360.0,
                (296.0 - 169.0 * s) / 1800.0,
                (-2.0 + 3.0 * s) / 225.0,
            ],
            [
                (296.0 + 169.0 * s) / 1800.0,
                (88.0 + 7.0 * s) / 360.0,
                (-2.0 - 3.0 * s) / 225.0,
            ],
            [(16.0 - s) / 36.0, (16.0 + s) / 36.0, 1.0 / 9.0],
        ];
        let a2 = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..3).map(|k| a[i][k] * a[k][j]).sum())
        });
        let gamma = (6.0 + 81.0_f64.cbrt() - 9.0_f64.cbrt()) / 30.0;
        let e = [-13.0 - 7.0 * s, -13.0 + 7.0 * s, -1.0].map(|x| x * gamma / 3.0);
        Tableau {
            c: [(4.0 - s) / 10.0, (4.0 + s) / 10.0, 1.0],
            a,
            a2,
            gamma,
            e,
        }
    }
}

/// Memory of the implicit method.
pub(super) struct Implicit<'m> {
    model: &'m dyn Jacobian,
    nq: usize,
    tableau: Tableau,
    /// Stage positions, velocities, accelerations, 3 × nq.
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    u: Vec<f64>,
    /// Values of ∂r/∂z at the model's pattern.
    values: Vec<f64>,
    /// ∂r/∂(q, v, a) of one stage, nq × 3 nq.
    block: Vec<f64>,
    /// Newton matrix (3 nq)² and right-hand side.
    matrix: Vec<f64>,
    rhs: Vec<f64>,
    a0: Vec<f64>,
    error: Vec<f64>,
    shifted: Vec<f64>,
    /// The solution of the last step, (q, v).
    pub(super) x1: Vec<f64>,
}

impl<'m> Implicit<'m> {
    pub(super) fn new(model: &'m dyn Jacobian) -> Self {
        let dims = model.dims();
        let nq = dims.nq;
        Implicit {
            model,
            nq,
            tableau: Tableau::new(),
            q: vec![0.0; 3 * nq],
            v: vec![0.0; 3 * nq],
            a: vec![0.0; 3 * nq],
            u: vec![0.0; 3 * dims.nu],
            values: vec![0.0; model.jacobian_pattern().nnz()],
            block: vec![0.0; 3 * nq * nq],
            matrix: vec![0.0; 9 * nq * nq],
            rhs: vec![0.0; 3 * nq],
            a0: vec![0.0; nq],
            error: vec![0.0; 2 * nq],
            shifted: vec![0.0; 2 * nq],
            x1: vec![0.0; 2 * nq],
        }
    }

    /// One step from (t, x). `Ok(Some(error))` with the scaled error and the solution in `x1`;
    /// `Ok(None)` if Newton's method does not converge.
    pub(super) fn step(
        &mut self,
        forward: &mut ForwardDynamics<'_>,
        interval: &Interval<'_>,
        p: &[f64],
        (t, x, h): (f64, &[f64], f64),
        settings: &Settings,
    ) -> Result<Option<f64>, Fault> {
        let (nq, nu) = (self.nq, self.u.len() / 3);
        let (q0, v0) = x.split_at(nq);
        interval.input(t, &mut self.u[..nu]);
        forward.evaluate(q0, v0, &self.u[..nu], p, &mut self.a0)?;
        for s in 0..3 {
            let time = t + self.tableau.c[s] * h;
            interval.input(time, &mut self.u[s * nu..(s + 1) * nu]);
            self.a[s * nq..(s + 1) * nq].copy_from_slice(&self.a0);
        }
        if !self.newton(p, q0, v0, h, settings)? {
            return Ok(None);
        }
        self.x1[..nq].copy_from_slice(&self.q[2 * nq..]);
        self.x1[nq..].copy_from_slice(&self.v[2 * nq..]);

        let error = self.estimate(interval, p, (t, x, h), settings)?;
        if error <= 1.0 {
            return Ok(Some(error));
        }
        // A large estimate may come from a fast transient that has died out: filter it once more
        // (Hairer and Wanner, equation IV.8.20).
        for (s, (x, e)) in self.shifted.iter_mut().zip(x.iter().zip(&self.error)) {
            *s = x + e;
        }
        interval.input(t, &mut self.u[..nu]);
        let (q, v) = self.shifted.split_at(nq);
        let again = forward.evaluate(q, v, &self.u[..nu], p, &mut self.a0);
        match again {
            Ok(()) => self.estimate(interval, p, (t, x, h), settings).map(Some),
            Err(_) => Ok(Some(error)),
        }
    }

    /// Solves for the stages; false if it does not converge.
    fn newton(
        &mut self,
        p: &[f64],
        q0: &[f64],
        v0: &[f64],
        h: f64,
        settings: &Settings,
    ) -> Result<bool, Fault> {
        let nq = self.nq;
        let n = 3 * nq;
        let mut last = f64::INFINITY;
        for iteration in 0..MAX_NEWTON {
            self.place_stages(q0, v0, h);
            for s in 0..3 {
                self.linearize(s, p, None);
                for i in 0..nq {
                    let row = &self.block[i * n..(i + 1) * n];
                    for r in 0..3 {
                        let (av, aq) = (h * self.tableau.a[s][r], h * h * self.tableau.a2[s][r]);
                        for j in 0..nq {
                            let mass = if r == s { row[2 * nq + j] } else { 0.0 };
                            self.matrix[(s * nq + i) * n + r * nq + j] =
                                mass + av * row[nq + j] + aq * row[j];
                        }
                    }
                }
            }
            if self.rhs.iter().any(|r| !r.is_finite()) {
                return if iteration == 0 {
                    Err(Fault::NotFinite)
                } else {
                    Ok(false)
                };
            }
            if solve(&mut self.matrix, n, &mut self.rhs).is_none() {
                return Ok(false);
            }
            let mut size = 0.0_f64;
            for (k, (a, d)) in self.a.iter_mut().zip(&self.rhs).enumerate() {
                *a -= d;
                let scale = settings.atol + settings.rtol * v0[k % nq].abs();
                size = size.max((h * d / scale).abs());
            }
            if !size.is_finite() || (iteration > 3 && size > 2.0 * last) {
                return Ok(false);
            }
            // Convergence is quadratic: the next correction would be far below the tolerance.
            // Iterating below rounding gains nothing.
            let largest = self.a.iter().fold(0.0_f64, |m, a| m.max(a.abs()));
            let rounding = self
                .rhs
                .iter()
                .all(|d| d.abs() <= 64.0 * f64::EPSILON * largest);
            if size < 1e-3 || rounding {
                self.place_stages(q0, v0, h);
                return Ok(true);
            }
            last = size;
        }
        Ok(false)
    }

    fn place_stages(&mut self, q0: &[f64], v0: &[f64], h: f64) {
        let nq = self.nq;
        for s in 0..3 {
            for i in 0..nq {
                let (mut dv, mut dq) = (0.0, 0.0);
                for r in 0..3 {
                    let a = self.a[r * nq + i];
                    dv += self.tableau.a[s][r] * a;
                    dq += self.tableau.a2[s][r] * a;
                }
                self.v[s * nq + i] = v0[i] + h * dv;
                self.q[s * nq + i] = q0[i] + h * self.tableau.c[s] * v0[i] + h * h * dq;
            }
        }
    }

    /// Residual into `rhs[s nq ..]` and ∂r/∂(q, v, a) into `block`, at stage `s` or at a point (q,
    /// v, u) with `a0`.
    fn linearize(&mut self, s: usize, p: &[f64], point: Option<[&[f64]; 3]>) {
        let nq = self.nq;
        let nu = self.u.len() / 3;
        let of = s * nq..(s + 1) * nq;
        let at = match point {
            Some([q, v, u]) => At {
                q,
                v,
                a: &self.a0,
                u,
                p,
            },
            None => At {
                q: &self.q[of.clone()],
                v: &self.v[of.clone()],
                a: &self.a[of.clone()],
                u: &self.u[s * nu..(s + 1) * nu],
                p,
            },
        };
        self.model
            .residual_jacobian(&at, &mut self.rhs[of], &mut self.values);
        self.block.fill(0.0);
        let pattern = self.model.jacobian_pattern();
        for ((row, col), value) in pattern.rows.iter().zip(pattern.cols).zip(&self.values) {
            if (*col as usize) < 3 * nq {
                self.block[*row as usize * 3 * nq + *col as usize] = *value;
            }
        }
    }

    /// The error estimate of Hairer and Wanner, equation IV.8.19,
    /// `(I − hγJ)⁻¹ (hγ f + Σ e_i (x_i − x_0))`, with the slope `f = (v_0, a_0)`; the system is
    /// reduced to the velocities, `(∂r/∂a + hγ ∂r/∂v + h²γ² ∂r/∂q) δv = ∂r/∂a E_v − hγ ∂r/∂q
    /// E_q`, `δq = E_q + hγ δv`.
    fn estimate(
        &mut self,
        interval: &Interval<'_>,
        p: &[f64],
        (t, x, h): (f64, &[f64], f64),
        settings: &Settings,
    ) -> Result<f64, Fault> {
        let nq = self.nq;
        let nu = self.u.len() / 3;
        let (q0, v0) = x.split_at(nq);
        let g = h * self.tableau.gamma;
        for i in 0..nq {
            let (mut eq, mut ev) = (g * v0[i], g * self.a0[i]);
            for s in 0..3 {
                eq += self.tableau.e[s] * (self.q[s * nq + i] - q0[i]);
                ev += self.tableau.e[s] * (self.v[s * nq + i] - v0[i]);
            }
            self.error[i] = eq;
            self.error[nq + i] = ev;
        }
        let mut u = std::mem::take(&mut self.u);
        interval.input(t, &mut u[..nu]);
        self.linearize(0, p, Some([q0, v0, &u[..nu]]));
        self.u = u;
        for i in 0..nq {
            let row = &self.block[i * 3 * nq..(i + 1) * 3 * nq];
            let mut right = 0.0;
            for j in 0..nq {
                let (k, d, m) = (row[j], row[nq + j], row[2 * nq + j]);
                self.matrix[i * nq + j] = m + g * d + g * g * k;
                right += m * self.error[nq + j] - g * k * self.error[j];
            }
            self.rhs[i] = right;
        }
        let n2 = nq * nq;
        solve(&mut self.matrix[..n2], nq, &mut self.rhs[..nq]).ok_or(Fault::NotFinite)?;
        for i in 0..nq {
            self.error[nq + i] = self.rhs[i];
            self.error[i] += g * self.rhs[i];
        }
        Ok(scaled_norm(&self.error, x, &self.x1, settings))
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_models::Pendulum;
    use super::*;
    use pid_data::InputHold;

    /// Steps of length 1/n over one second from (2, 0.5).
    fn second(p: &[f64], n: usize) -> Vec<f64> {
        let settings = Settings {
            rtol: 1e-14,
            atol: 1e-14,
            ..Settings::default()
        };
        let mut forward = ForwardDynamics::new(&Pendulum);
        let mut implicit = Implicit::new(&Pendulum);
        let interval = Interval {
            t0: 0.0,
            t1: 1.0,
            u0: &[0.7],
            u1: &[0.2],
            hold: InputHold::Linear,
        };
        let h = 1.0 / n as f64;
        let mut x = vec![2.0, 0.5];
        for i in 0..n {
            let step = (i as f64 * h, x.as_slice(), h);
            let error = implicit
                .step(&mut forward, &interval, p, step, &settings)
                .unwrap();
            assert!(error.is_some(), "Newton's method must converge");
            x.copy_from_slice(&implicit.x1);
        }
        x
    }

    #[test]
    fn the_order_is_five() {
        let p = [1.2, 9.0, 0.3, 0.2, 1.0];
        let exact = second(&p, 400);
        let error = |n: usize| {
            let x = second(&p, n);
            (x[0] - exact[0]).hypot(x[1] - exact[1])
        };
        let measured = (error(10) / error(20)).log2();
        assert!((measured - 5.0).abs() < 0.25, "order {measured}");
    }

    #[test]
    fn very_fast_decay_is_damped_in_one_step() {
        // v' = −10⁸ v: an A-stable method that is not L-stable would keep |v|.
        let p = [1.0, 0.0, 1e8, 0.0, 0.0];
        let x = second(&p, 1);
        assert!(x[1].abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn the_tableau_satisfies_the_conditions_of_order_five() {
        let t = Tableau::new();
        for i in 0..3 {
            for k in 1..=3 {
                // C(3): Σ_j A_ij c_j^{k−1} = c_i^k / k.
                let sum: f64 = (0..3).map(|j| t.a[i][j] * t.c[j].powi(k - 1)).sum();
                assert!(
                    (sum - t.c[i].powi(k) / f64::from(k)).abs() < 1e-14,
                    "C: {i} {k}"
                );
            }
        }
        for k in 1..=5 {
            // B(5): Σ_j b_j c_j^{k−1} = 1/k, b the last row of A.
            let sum: f64 = (0..3).map(|j| t.a[2][j] * t.c[j].powi(k - 1)).sum();
            assert!((sum - 1.0 / f64::from(k)).abs() < 1e-14, "B: {k}");
        }
        // γ is an eigenvalue of A: det(A − γ I) = 0.
        let m = |i: usize, j: usize| t.a[i][j] - if i == j { t.gamma } else { 0.0 };
        let det = m(0, 0) * (m(1, 1) * m(2, 2) - m(1, 2) * m(2, 1))
            - m(0, 1) * (m(1, 0) * m(2, 2) - m(1, 2) * m(2, 0))
            + m(0, 2) * (m(1, 0) * m(2, 1) - m(1, 1) * m(2, 0));
        assert!(det.abs() < 1e-14, "{det}");
    }
}
