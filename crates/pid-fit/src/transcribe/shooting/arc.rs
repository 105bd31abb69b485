//! One shooting interval: its motion, sensitivities, and the exact Hessian of what depends on it.
//!
//! Along the steps `c(x_k, y_k, p) = 0`, `x_{k+1}` the last part of `y_k`, with z = (x at the node, p):
//!
//! ```text
//! forward     S_0 = [I 0],    T_k = ∂y_k/∂z = −C_y⁻¹ (C_x S_k + [0 C_p]),    S_{k+1} = last rows of T_k
//! adjoint     μ_N = λ,    ν_k = −C_yᵀ⁻¹ (0, μ_{k+1}),    μ_k = C_xᵀ ν_k + ∂ℓ_k/∂x
//! Hessian     Σ_k [S_k; T_k; E]ᵀ ∇²(ν_kᵀ c) [S_k; T_k; E]  +  Σ_k [S_k; E]ᵀ ∇²ℓ_k [S_k; E],     E = ∂p/∂z
//! ```
//!
//! (H. G. Bock 1981 for the sensitivities; the second-order sweep is the adjoint of the tangent of
//! the same recursion.) The work is linear in the number of steps.

use super::super::fit::{Fit, FitScratch};
use super::super::step::{Interval, Rule};
use super::lu;
use super::records::Records;
use super::stepper::{Stepper, unknowns_matrix};
use super::stepping::{Adaptive, Stepping};

/// A step of the integration: where it stands, and the sample at its end if there is one.
#[derive(Debug, Clone, Copy)]
struct Piece {
    h: f64,
    sample: usize,
    from: f64,
    share: f64,
    ends_at: Option<usize>,
}

/// The sampling interval after a sample, and what moves the state over it.
struct Crossing<'a, 'm> {
    rule: &'a Rule<'m>,
    records: &'a Records,
    p: &'a [f64],
    sample: usize,
    /// Length, s.
    length: f64,
}

/// A shooting interval.
pub(super) struct Arc<'m> {
    /// Position of the state at its node among the variables.
    pub(super) x: usize,
    /// Position of the state at the next node, and the first row of the continuity to it.
    pub(super) next: Option<(usize, usize)>,
    /// First sample, and number of sampling intervals it integrates over.
    first: usize,
    intervals: usize,
    pieces: Vec<Piece>,
    /// States before each piece and after the last one.
    states: Vec<f64>,
    unknowns: Vec<f64>,
    /// S and T of each piece; LU factors of C_y.
    sensitivities: Vec<f64>,
    tangents: Vec<f64>,
    factors: Vec<f64>,
    pivots: Vec<usize>,
    stepper: Stepper<'m>,
    fit: FitScratch,
    nx: usize,
    ny: usize,
    np: usize,
    /// Whether the motion could be integrated to its end.
    pub(super) finite: bool,
    /// Per evaluation: gradient or Hessian of this interval, dense over z.
    pub(super) gradient: Vec<f64>,
    pub(super) hessian: Vec<f64>,
    /// Work space: rows of G, ∂²ℓ.
    rows: Vec<f64>,
    point: Vec<f64>,
    cross: Vec<f64>,
}

impl<'m> Arc<'m> {
    #[allow(
        clippy::too_many_arguments,
        reason = "the place of an interval in the program"
    )]
    pub(super) fn new(
        rule: &Rule<'m>,
        fit: &Fit,
        np: usize,
        x: usize,
        next: Option<(usize, usize)>,
        first: usize,
        intervals: usize,
    ) -> Self {
        let (nx, ny) = (2 * rule.model().dims().nq, rule.ny());
        let nz = nx + np;
        Self {
            x,
            next,
            first,
            intervals,
            pieces: Vec::new(),
            states: Vec::new(),
            unknowns: Vec::new(),
            sensitivities: Vec::new(),
            tangents: Vec::new(),
            factors: Vec::new(),
            pivots: Vec::new(),
            stepper: Stepper::new(rule),
            fit: fit.scratch(),
            nx,
            ny,
            np,
            finite: false,
            gradient: vec![0.0; nz],
            hessian: vec![0.0; nz * nz],
            rows: vec![0.0; nx + ny],
            point: vec![0.0; nz * nz],
            cross: vec![0.0; np * nz],
        }
    }

    /// The sample at its node.
    pub(super) fn first(&self) -> usize {
        self.first
    }

    /// Number of steps of the last integration.
    pub(super) fn steps(&self) -> usize {
        self.pieces.len()
    }

    fn interval<'r>(records: &'r Records, piece: &Piece) -> Interval<'r> {
        Interval {
            h: piece.h,
            u0: records.input(piece.sample),
            u1: records.input(piece.sample + 1),
            from: piece.from,
            share: piece.share,
        }
    }

    /// Samples that count in this interval: the one at its node and those its pieces end at, not
    /// that of the next node.
    fn counts(&self, sample: usize) -> bool {
        self.next.is_none() || sample < self.first + self.intervals
    }

    /// Integrates from `x0`.
    pub(super) fn integrate(
        &mut self,
        rule: &Rule<'m>,
        records: &Records,
        stepping: Stepping,
        x0: &[f64],
        p: &[f64],
    ) {
        self.pieces.clear();
        self.states.clear();
        self.unknowns.clear();
        self.states.extend_from_slice(x0);
        self.finite = x0.iter().all(|x| x.is_finite());
        let mut state = x0.to_vec();
        let mut y = vec![0.0; self.ny];
        let mut proposal = 0.0;
        for sample in self.first..self.first + self.intervals {
            if !self.finite {
                return;
            }
            let over = Crossing {
                rule,
                records,
                p,
                sample,
                length: records.t[sample + 1] - records.t[sample],
            };
            self.finite = match stepping {
                Stepping::Fixed { substeps } => {
                    self.cross_in_parts(&over, substeps, &mut state, &mut y)
                }
                Stepping::Adaptive(tolerances) => {
                    self.cross_adaptively(&over, tolerances, &mut state, &mut proposal)
                }
            };
        }
    }

    /// Steps over the interval after a sample in equal parts; `false` where a step has no solution.
    fn cross_in_parts(
        &mut self,
        over: &Crossing<'_, 'm>,
        substeps: usize,
        state: &mut [f64],
        y: &mut [f64],
    ) -> bool {
        let share = 1.0 / substeps as f64;
        for part in 0..substeps {
            let piece = Piece {
                h: over.length * share,
                sample: over.sample,
                from: part as f64 * share,
                share,
                ends_at: (part + 1 == substeps).then_some(over.sample + 1),
            };
            let interval = Self::interval(over.records, &piece);
            if !self.stepper.advance(over.rule, state, over.p, &interval, y) {
                return false;
            }
            state.copy_from_slice(&y[self.ny - self.nx..]);
            self.pieces.push(piece);
            self.unknowns.extend_from_slice(y);
            self.states.extend_from_slice(state);
        }
        true
    }

    /// Steps over the interval after a sample in controlled steps; `false` where they do not reach its end.
    fn cross_adaptively(
        &mut self,
        over: &Crossing<'_, 'm>,
        tolerances: Adaptive,
        state: &mut [f64],
        proposal: &mut f64,
    ) -> bool {
        let (sample, length) = (over.sample, over.length);
        let whole = Interval {
            h: length,
            u0: over.records.input(sample),
            u1: over.records.input(sample + 1),
            from: 0.0,
            share: 1.0,
        };
        if *proposal <= 0.0 || *proposal > length {
            *proposal = length;
        }
        let (pieces, unknowns, states) = (&mut self.pieces, &mut self.unknowns, &mut self.states);
        let nx = self.nx;
        let keep = |y: &[f64], step: &Interval<'_>| {
            pieces.push(Piece {
                h: step.h,
                sample,
                from: step.from,
                share: step.share,
                ends_at: None,
            });
            unknowns.extend_from_slice(y);
            states.extend_from_slice(&y[y.len() - nx..]);
        };
        let stepper = &mut self.stepper;
        let crossed = stepper.adapt(over.rule, state, over.p, &whole, tolerances, proposal, keep);
        if let Some(last) = self.pieces.last_mut() {
            last.ends_at = Some(sample + 1);
        }
        crossed
    }

    /// The state before piece `k`, or at the end.
    fn state(&self, k: usize) -> &[f64] {
        &self.states[k * self.nx..(k + 1) * self.nx]
    }

    /// The state that the last integration ended at.
    pub(super) fn end(&self) -> &[f64] {
        self.state(self.pieces.len())
    }

    /// The samples of this interval with the positions of their states.
    fn samples(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let start = std::iter::once((0, self.first));
        let ends = self.pieces.iter().enumerate();
        start
            .chain(ends.filter_map(|(k, piece)| Some((k + 1, piece.ends_at?))))
            .filter(|(_, sample)| self.counts(*sample))
    }

    /// Visits the samples of this interval and their states.
    pub(super) fn for_samples(&self, mut visit: impl FnMut(usize, &[f64])) {
        for (k, sample) in self.samples() {
            visit(sample, self.state(k));
        }
    }

    /// Σ ℓ over the samples of this interval; NaN if it could not be integrated.
    pub(super) fn objective(&mut self, fit: &Fit, p: &[f64]) -> f64 {
        if !self.finite {
            return f64::NAN;
        }
        let mut scratch = std::mem::take(&mut self.fit);
        let sum = self
            .samples()
            .map(|(k, sample)| fit.value(sample, self.state(k), p, &mut scratch))
            .sum();
        self.fit = scratch;
        sum
    }

    /// S and T of every piece, after an integration that succeeded.
    pub(super) fn differentiate(&mut self, rule: &Rule<'m>, records: &Records, p: &[f64]) {
        if !self.finite {
            return;
        }
        let (nx, ny, nz) = (self.nx, self.ny, self.nx + self.np);
        let steps = self.pieces.len();
        self.sensitivities.resize((steps + 1) * nx * nz, 0.0);
        self.tangents.resize(steps * ny * nz, 0.0);
        self.factors.resize(steps * ny * ny, 0.0);
        self.pivots.resize(steps * ny, 0);
        self.sensitivities[..nx * nz].fill(0.0);
        (0..nx).for_each(|i| self.sensitivities[i * nz + i] = 1.0);
        for k in 0..steps {
            let interval = Self::interval(records, &self.pieces[k]);
            let (x, y) = (
                &self.states[k * nx..(k + 1) * nx],
                &self.unknowns[k * ny..(k + 1) * ny],
            );
            let s = &mut self.stepper;
            rule.jacobian(x, y, p, &interval, &mut s.scratch, &mut s.jacobian);
            let factors = &mut self.factors[k * ny * ny..(k + 1) * ny * ny];
            let pivots = &mut self.pivots[k * ny..(k + 1) * ny];
            unknowns_matrix(rule, nx, &s.jacobian, factors);
            let (before, after) = self.sensitivities.split_at_mut((k + 1) * nx * nz);
            let before = &before[k * nx * nz..];
            let tangent = &mut self.tangents[k * ny * nz..(k + 1) * ny * nz];
            tangent.fill(0.0);
            for (&(row, col), value) in rule.expansion().step_jacobian.iter().zip(&s.jacobian) {
                let (row, col) = (row as usize, col as usize);
                let out = &mut tangent[row * nz..(row + 1) * nz];
                if col < nx {
                    for (o, s) in out.iter_mut().zip(&before[col * nz..(col + 1) * nz]) {
                        *o -= value * s;
                    }
                } else if col >= nx + ny {
                    out[col - ny] -= value;
                }
            }
            if !lu::factor(factors, ny, pivots) {
                self.finite = false;
                return;
            }
            lu::solve(factors, ny, pivots, tangent, nz);
            after[..nx * nz].copy_from_slice(&tangent[(ny - nx) * nz..]);
        }
    }

    /// Sensitivity of the end state, nx × nz, after [`Self::differentiate`].
    pub(super) fn end_sensitivity(&self) -> &[f64] {
        let (nx, nz) = (self.nx, self.nx + self.np);
        let at = self.pieces.len() * nx * nz;
        &self.sensitivities[at..at + nx * nz]
    }

    /// Gradient of Σ ℓ over z.
    pub(super) fn gradient(&mut self, fit: &Fit, p: &[f64], scale: &[f64]) {
        let (nx, nz) = (self.nx, self.nx + self.np);
        self.gradient.fill(0.0);
        if !self.finite {
            self.gradient.fill(f64::NAN);
            return;
        }
        let mut out = std::mem::take(&mut self.gradient);
        let mut scratch = std::mem::take(&mut self.fit);
        let mut local = vec![0.0; nz];
        for (k, sample) in self.samples() {
            local.fill(0.0);
            fit.gradient(sample, (self.state(k), p), 1.0, &mut scratch, &mut local);
            let s = &self.sensitivities[k * nx * nz..(k + 1) * nx * nz];
            for i in 0..nx {
                axpy(local[i], &s[i * nz..(i + 1) * nz], &mut out);
            }
            for j in 0..self.np {
                out[nx + j] += local[nx + j] * scale[j];
            }
        }
        self.fit = scratch;
        self.gradient = out;
    }

    /// Lower triangle of the Hessian of `σ Σ ℓ + λᵀ end` over z, dense; only its part of first
    /// order if `gauss_newton`.
    #[allow(
        clippy::too_many_arguments,
        reason = "a point, multipliers, and what to compute"
    )]
    pub(super) fn hessian(
        &mut self,
        rule: &Rule<'m>,
        records: &Records,
        fit: &Fit,
        p: &[f64],
        scale: &[f64],
        sigma: f64,
        lambda: &[f64],
        gauss_newton: bool,
    ) {
        let (nx, ny, np) = (self.nx, self.ny, self.np);
        let nz = nx + np;
        self.hessian.fill(0.0);
        if !self.finite {
            self.hessian.fill(f64::NAN);
            return;
        }
        self.cross.fill(0.0);
        self.stepper.scratch.parameter_hessian.fill(0.0);
        let mut mu = vec![0.0; nx];
        if lambda.len() == nx {
            mu.copy_from_slice(lambda);
        }
        let mut nu = vec![0.0; ny];
        let mut local = vec![0.0; nz];
        let steps = self.pieces.len();
        for k in (0..=steps).rev() {
            // The sample at the state after piece k − 1, that of the node for k = 0.
            let sample = if k == 0 {
                Some(self.first)
            } else {
                self.pieces[k - 1].ends_at
            };
            if k < steps && !gauss_newton {
                self.step_curvature(rule, records, p, k, &mut mu, &mut nu);
            }
            if let Some(sample) = sample.filter(|s| self.counts(*s)) {
                self.sample_curvature(fit, (k, sample), p, scale, sigma, gauss_newton);
                if !gauss_newton {
                    local.fill(0.0);
                    let x = &self.states[k * nx..(k + 1) * nx];
                    fit.gradient(sample, (x, p), sigma, &mut self.fit, &mut local);
                    mu.iter_mut().zip(&local).for_each(|(m, g)| *m += g);
                }
            }
        }
        // Mixed derivatives with a parameter, and those between two.
        for j in 0..np {
            let cross = &self.cross[j * nz..(j + 1) * nz];
            for i in 0..nz {
                // cross is H_pz: it stands in row nx + j and, transposed, in column nx + j.
                let (row, col) = (nx + j, i);
                if row >= col {
                    self.hessian[row * nz + col] += cross[i];
                }
                if col >= row {
                    self.hessian[col * nz + row] += cross[i];
                }
            }
        }
        for (&(i, j), value) in rule
            .expansion()
            .parameter_hessian
            .iter()
            .zip(&self.stepper.scratch.parameter_hessian)
        {
            self.hessian[(nx + i as usize) * nz + nx + j as usize] += value;
        }
    }

    /// Adds the curvature of step k and moves the adjoint before it.
    fn step_curvature(
        &mut self,
        rule: &Rule<'m>,
        records: &Records,
        p: &[f64],
        k: usize,
        mu: &mut [f64],
        nu: &mut [f64],
    ) {
        let (nx, ny, nz) = (self.nx, self.ny, self.nx + self.np);
        let interval = Self::interval(records, &self.pieces[k]);
        let x = &self.states[k * nx..(k + 1) * nx];
        let y = &self.unknowns[k * ny..(k + 1) * ny];
        nu.fill(0.0);
        for i in 0..nx {
            nu[ny - nx + i] = -mu[i];
        }
        let factors = &self.factors[k * ny * ny..(k + 1) * ny * ny];
        lu::solve_transpose(factors, ny, &self.pivots[k * ny..(k + 1) * ny], nu);
        let s = &mut self.stepper;
        rule.jacobian(x, y, p, &interval, &mut s.scratch, &mut s.jacobian);
        mu.fill(0.0);
        for (&(row, col), value) in rule.expansion().step_jacobian.iter().zip(&s.jacobian) {
            if (col as usize) < nx {
                mu[col as usize] += value * nu[row as usize];
            }
        }
        rule.hessian(x, y, p, &interval, nu, &mut s.scratch, &mut s.hessian);
        // Rows of [S; T].
        let sens = &self.sensitivities[k * nx * nz..(k + 1) * nx * nz];
        let tang = &self.tangents[k * ny * nz..(k + 1) * ny * nz];
        let row = |i: usize| {
            if i < nx {
                &sens[i * nz..(i + 1) * nz]
            } else {
                &tang[(i - nx) * nz..(i - nx + 1) * nz]
            }
        };
        let ns = nx + ny;
        self.rows.clear();
        self.rows.resize(ns * nz, 0.0);
        for (&(i, j), &value) in rule.expansion().step_hessian.iter().zip(&s.hessian) {
            let (i, j) = (i as usize, j as usize);
            if i < ns {
                // Half of the symmetric product: the other half is its transpose.
                let factor = if i == j { 0.5 * value } else { value };
                axpy(factor, row(j), &mut self.rows[i * nz..(i + 1) * nz]);
            } else {
                let at = (i - ns) * nz;
                axpy(value, row(j), &mut self.cross[at..at + nz]);
            }
        }
        // H += Rᵀ G + Gᵀ R.
        for a in 0..ns {
            let (r, g) = (row(a), &self.rows[a * nz..(a + 1) * nz]);
            for i in 0..nz {
                let (ri, gi) = (r[i], g[i]);
                let out = &mut self.hessian[i * nz..i * nz + i + 1];
                if ri != 0.0 {
                    axpy(ri, &g[..=i], out);
                }
                if gi != 0.0 {
                    axpy(gi, &r[..=i], out);
                }
            }
        }
    }

    /// Adds σ [S; E]ᵀ ∇²ℓ [S; E] of a sample.
    fn sample_curvature(
        &mut self,
        fit: &Fit,
        (k, sample): (usize, usize),
        p: &[f64],
        scale: &[f64],
        sigma: f64,
        gauss_newton: bool,
    ) {
        let (nx, np) = (self.nx, self.np);
        let nz = nx + np;
        let s = &self.sensitivities[k * nx * nz..(k + 1) * nx * nz];
        if fit.is_state() {
            let (x, hessian) = (&self.states[k * nx..(k + 1) * nx], &mut self.hessian);
            fit.state_curvature(sample, x, sigma, gauss_newton, |c, value| {
                let row = &s[c * nz..(c + 1) * nz];
                for i in 0..nz {
                    let factor = value * row[i];
                    if factor != 0.0 {
                        axpy(factor, &row[..=i], &mut hessian[i * nz..i * nz + i + 1]);
                    }
                }
            });
            return;
        }
        let x = &self.states[k * nx..(k + 1) * nx];
        self.point.fill(0.0);
        fit.hessian(
            sample,
            (x, p),
            sigma,
            gauss_newton,
            &mut self.fit,
            &mut self.point,
        );
        // Full rows D of [S; E] = ∂(x, p)/∂z: S for a state, scale e_j for a parameter.
        let mut product = vec![0.0; nz * nz];
        for a in 0..nz {
            for b in 0..nz {
                let value = self.point[a * nz + b];
                if value == 0.0 {
                    continue;
                }
                let out = &mut product[a * nz..(a + 1) * nz];
                if b < nx {
                    axpy(value, &s[b * nz..(b + 1) * nz], out);
                } else {
                    out[b] += value * scale[b - nx];
                }
            }
        }
        for a in 0..nz {
            let g = &product[a * nz..(a + 1) * nz];
            if a < nx {
                let row = &s[a * nz..(a + 1) * nz];
                for i in 0..nz {
                    axpy(row[i], &g[..=i], &mut self.hessian[i * nz..i * nz + i + 1]);
                }
            } else {
                axpy(
                    scale[a - nx],
                    &g[..=a],
                    &mut self.hessian[a * nz..a * nz + a + 1],
                );
            }
        }
    }
}

/// `y += a x`.
fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}
