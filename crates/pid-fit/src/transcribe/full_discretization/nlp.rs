//! The program as the solver sees it.

use pid_nlp::{Nlp, SparsePattern};

use super::FullDiscretization;
use super::steps::{Point, for_steps};
use crate::transcribe::loss::prior_terms;
use crate::transcribe::setup::Curvature;
use crate::transcribe::step_lanes::LaneScratch;

impl FullDiscretization<'_> {
    /// Adds σ ∂²ℓ of outputs that are not the state itself, in the entries that [`step_hessian`] and
    /// [`parameter_hessian`] append for them.
    fn output_hessian(&mut self, x: &[f64], sigma: f64, steps: &mut [f64], parameters: &mut [f64]) {
        if self.fit.is_state() {
            return;
        }
        let (nx, np) = (self.layout.nx, self.layout.np);
        let nz = nx + np;
        let size = self.layout.step_hessian.len();
        let block = nx * (nx + 1) / 2 + np * nx;
        let gauss_newton = self.setup.curvature == Curvature::GaussNewton;
        let scale = |i: usize| {
            if i < nx {
                1.0
            } else {
                self.setup.scale[i - nx]
            }
        };
        let between = parameters.len() - np * (np + 1) / 2;
        let mut local = vec![0.0; nz * nz];
        for window in &self.layout.windows {
            for k in 0..=window.steps {
                let node = window.first_node + k;
                let at = self.nodes[node];
                local.fill(0.0);
                let point = (&x[at..at + nx], self.parameters.as_slice());
                let scratch = &mut self.fit_scratch;
                self.fit
                    .hessian(node, point, sigma, gauss_newton, scratch, &mut local);
                // A node's block stands in the step after it, that of the last node in the step before it.
                let (step, shift) = if k < window.steps {
                    (window.first_step + k, 2 * block)
                } else {
                    (window.first_step + k - 1, block)
                };
                let mut to = (step + 1) * size - shift;
                for i in 0..nz {
                    for j in 0..=i.min(nx - 1) {
                        steps[to] += local[i * nz + j] * scale(i) * scale(j);
                        to += 1;
                    }
                }
                let mut to = between;
                for i in nx..nz {
                    for j in nx..=i {
                        parameters[to] += local[i * nz + j] * scale(i) * scale(j);
                        to += 1;
                    }
                }
            }
        }
    }

    /// Adds σ ∂² of the priors to the diagonal between parameters.
    fn prior_hessian(&self, sigma: f64, parameters: &mut [f64]) {
        let scale = &self.setup.scale;
        let share = sigma * self.share;
        prior_terms(
            &self.setup.priors,
            &self.parameters,
            share,
            |j, _, curvature| {
                let pair = (j as u32, j as u32);
                let at = self
                    .layout
                    .parameter_hessian
                    .iter()
                    .position(|p| *p == pair);
                let at = at.expect("invariant: the layout has every diagonal entry");
                parameters[at] += curvature * scale[j] * scale[j];
            },
        );
    }
}

/// The shared part of the program, as a [`Point`] at `$x`.
macro_rules! point {
    ($self:ident, $x:expr) => {
        Point {
            x: $x,
            u: &$self.u,
            nu: $self.rule.model().dims().nu,
            nx: $self.layout.nx,
            ny: $self.layout.ny,
        }
    };
}

impl Nlp for FullDiscretization<'_> {
    fn n(&self) -> usize {
        self.layout.n()
    }

    fn m(&self) -> usize {
        self.layout.m()
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.fill(f64::NEG_INFINITY);
        upper.fill(f64::INFINITY);
        let p = self.layout.p();
        for j in 0..self.layout.np {
            lower[p + j] = self.setup.lower[j] / self.setup.scale[j];
            upper[p + j] = self.setup.upper[j] / self.setup.scale[j];
        }
        for window in self.layout.windows.iter().filter(|w| w.held) {
            let held = window.x..window.x + self.layout.nx;
            lower[held.clone()].copy_from_slice(&self.start[held.clone()]);
            upper[held.clone()].copy_from_slice(&self.start[held]);
        }
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        self.load_parameters(x);
        let (nx, scratch, p) = (self.layout.nx, &mut self.fit_scratch, &self.parameters);
        let fit = &self.fit;
        let value = |(k, &at): (usize, &usize)| fit.value(k, &x[at..at + nx], p, scratch);
        let data: f64 = self.nodes.iter().enumerate().map(value).sum();
        let priors = prior_terms(&self.setup.priors, p, self.share, |_, _, _| {});
        data + priors + self.barrier.value(p, |_, _| {})
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        self.load_parameters(x);
        gradient.fill(0.0);
        let (nx, first) = (self.layout.nx, self.layout.p());
        self.barrier
            .value(&self.parameters, |j, slope| gradient[first + j] += slope);
        let scratch = &mut self.fit_scratch;
        let scale = &self.setup.scale;
        prior_terms(
            &self.setup.priors,
            &self.parameters,
            self.share,
            |j, slope, _| gradient[first + j] += slope * scale[j],
        );
        if self.fit.is_state() {
            for (k, &at) in self.nodes.iter().enumerate() {
                let (state, out) = (&x[at..at + nx], &mut gradient[at..at + nx]);
                self.fit
                    .gradient(k, (state, &self.parameters), 1.0, scratch, out);
            }
            return;
        }
        let mut local = vec![0.0; nx + self.layout.np];
        for (k, &at) in self.nodes.iter().enumerate() {
            local.fill(0.0);
            let state = &x[at..at + nx];
            self.fit
                .gradient(k, (state, &self.parameters), 1.0, scratch, &mut local);
            gradient[at..at + nx].copy_from_slice(&local[..nx]);
            for (j, slope) in local[nx..].iter().enumerate() {
                gradient[first + j] += slope * self.setup.scale[j];
            }
        }
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.load_parameters(x);
        let (point, rule, p) = (point!(self, x), &self.rule, &self.parameters);
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            c,
            self.layout.ny,
            |_, steps, s, c| rule.constraints_lanes(&point.of(steps), p, s, c),
        );
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian_pattern
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        self.load_parameters(x);
        let (point, rule, p) = (point!(self, x), &self.rule, &self.parameters);
        let size = self.layout.step_jacobian.len();
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            values,
            size,
            |_, steps, s, out| rule.jacobian_lanes(&point.of(steps), p, s, out),
        );
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian_pattern
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let (steps, rest) = values.split_at_mut(self.layout.node_values());
        let (nodes, parameters) = rest.split_at_mut(self.layout.nodes() * self.layout.nx);
        parameters.fill(0.0);
        nodes.fill(0.0);
        self.load_parameters(x);
        if self.fit.is_state() {
            let nx = self.layout.nx;
            let gauss_newton = self.setup.curvature == Curvature::GaussNewton;
            for (k, values) in nodes.chunks_exact_mut(nx).enumerate() {
                let at = self.nodes[k];
                let add = |c: usize, value: f64| values[c] = value;
                self.fit
                    .state_curvature(k, &x[at..at + nx], sigma, gauss_newton, add);
            }
        }
        self.prior_hessian(sigma, parameters);
        let own = self.rule.expansion().parameter_hessian.len()..;
        let mut bodies = parameters[own].iter_mut();
        self.barrier.hessian(&self.parameters, |_, _, value| {
            if let Some(entry) = bodies.next() {
                *entry += sigma * value;
            }
        });
        if self.setup.curvature == Curvature::GaussNewton {
            steps.fill(0.0);
            self.output_hessian(x, sigma, steps, parameters);
            return;
        }
        let (point, rule, p) = (point!(self, x), &self.rule, &self.parameters);
        let ny = self.layout.ny;
        self.scratch
            .iter_mut()
            .for_each(LaneScratch::clear_parameter_hessian);
        let size = self.layout.step_hessian.len();
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            steps,
            size,
            |k, steps, s, out| {
                let lambda = &lambda[k * ny..(k + steps.len()) * ny];
                rule.hessian_lanes(&point.of(steps), p, lambda, s, out);
            },
        );
        for scratch in &self.scratch {
            scratch.add_parameter_hessian(parameters);
        }
        self.output_hessian(x, sigma, steps, parameters);
    }

    fn barrier_changed(&mut self, mu: f64) -> bool {
        self.barrier.set(mu)
    }

    fn longest_step(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        let p = self.layout.p();
        self.barrier.longest(&x[p..], &d[p..], share)
    }
}
