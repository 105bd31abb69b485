//! The program as the solver sees it.

use pid_nlp::{Nlp, SparsePattern};

use super::{Level, Shooting};
use crate::transcribe::loss::prior_terms;
use crate::transcribe::setup::Curvature;

impl Nlp for Shooting<'_> {
    fn n(&self) -> usize {
        self.n
    }

    fn m(&self) -> usize {
        self.m
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.fill(f64::NEG_INFINITY);
        upper.fill(f64::INFINITY);
        let p = self.n - self.np;
        for j in 0..self.np {
            lower[p + j] = self.setup.lower[j] / self.setup.scale[j];
            upper[p + j] = self.setup.upper[j] / self.setup.scale[j];
        }
        if self.setup.hold_initial {
            for chain in &self.chains {
                let held = chain.x..chain.x + self.nx;
                lower[held.clone()].copy_from_slice(&self.start[held.clone()]);
                upper[held.clone()].copy_from_slice(&self.start[held]);
            }
        }
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        self.evaluate(x, Level::Motion);
        let (fit, p) = (&self.fit, &self.parameters);
        let data: f64 = self.arcs.iter_mut().map(|arc| arc.objective(fit, p)).sum();
        let priors = prior_terms(&self.setup.priors, p, self.share(), |_, _, _| {});
        data + priors + self.barrier.value(p, |_, _| {})
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        self.evaluate(x, Level::Derivatives);
        let scale = std::mem::take(&mut self.setup.scale);
        self.each(|arc, _, _, fit, p| arc.gradient(fit, p, &scale));
        self.setup.scale = scale;
        gradient.fill(0.0);
        let (p, nx) = (self.n - self.np, self.nx);
        for arc in &self.arcs {
            gradient[arc.x..arc.x + nx].copy_from_slice(&arc.gradient[..nx]);
            for (out, value) in gradient[p..].iter_mut().zip(&arc.gradient[nx..]) {
                *out += value;
            }
        }
        prior_terms(
            &self.setup.priors,
            &self.parameters,
            self.share(),
            |j, slope, _| gradient[p + j] += slope * self.setup.scale[j],
        );
        self.barrier
            .value(&self.parameters, |j, slope| gradient[p + j] += slope);
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.evaluate(x, Level::Motion);
        let nx = self.nx;
        for arc in &self.arcs {
            let Some((next, row)) = arc.next else {
                continue;
            };
            for i in 0..nx {
                c[row + i] = if arc.finite {
                    arc.end()[i] - x[next + i]
                } else {
                    f64::NAN
                };
            }
        }
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian_pattern
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        self.evaluate(x, Level::Derivatives);
        let (nx, nz) = (self.nx, self.nx + self.np);
        let linked = self.arcs.iter().filter(|arc| arc.next.is_some());
        for (arc, out) in linked.zip(values.chunks_exact_mut(nx * (nz + 1))) {
            if !arc.finite {
                out.fill(f64::NAN);
                continue;
            }
            let rows = arc.end_sensitivity().chunks_exact(nz);
            for (row, out) in rows.zip(out.chunks_exact_mut(nz + 1)) {
                out[..nx].copy_from_slice(&row[..nx]);
                out[nx] = -1.0;
                out[nx + 1..].copy_from_slice(&row[nx..]);
            }
        }
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian_pattern
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        self.evaluate(x, Level::Derivatives);
        let (nx, np) = (self.nx, self.np);
        let nz = nx + np;
        let scale = std::mem::take(&mut self.setup.scale);
        let gauss_newton = self.setup.curvature == Curvature::GaussNewton;
        self.each(|arc, rule, records, fit, p| {
            let lambda = arc.next.map_or(&[][..], |(_, row)| &lambda[row..row + nx]);
            arc.hessian(rule, records, fit, p, &scale, sigma, lambda, gauss_newton);
        });
        self.setup.scale = scale;
        let size = nx * (nx + 1) / 2 + np * nx;
        let (nodes, parameters) = values.split_at_mut(self.arcs.len() * size);
        parameters.fill(0.0);
        let share = sigma * self.share();
        prior_terms(
            &self.setup.priors,
            &self.parameters,
            share,
            |j, _, curvature| {
                parameters[j * (j + 1) / 2 + j] +=
                    curvature * self.setup.scale[j] * self.setup.scale[j];
            },
        );
        self.barrier.hessian(&self.parameters, |i, j, value| {
            parameters[i * (i + 1) / 2 + j] += sigma * value;
        });
        for (arc, out) in self.arcs.iter().zip(nodes.chunks_exact_mut(size)) {
            let mut k = 0;
            for i in 0..nz {
                let row = &arc.hessian[i * nz..];
                let states = if i < nx { i + 1 } else { nx };
                out[k..k + states].copy_from_slice(&row[..states]);
                k += states;
            }
            let mut k = 0;
            for i in 0..np {
                for j in 0..=i {
                    parameters[k] += arc.hessian[(nx + i) * nz + nx + j];
                    k += 1;
                }
            }
        }
    }

    fn barrier_changed(&mut self, mu: f64) -> bool {
        self.barrier.set(mu)
    }

    fn longest_step(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        let p = self.n - self.np;
        self.barrier.longest(&x[p..], &d[p..], share)
    }
}
