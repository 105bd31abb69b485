//! Refinement of a solution.

use super::StructuredKkt;

impl StructuredKkt {
    /// Solves with the regularised matrix, refined; returns the relative residual that is left.
    pub(super) fn refine(
        &mut self,
        rx: &[f64],
        rc: &[f64],
        dx: &mut [f64],
        dlambda: &mut [f64],
    ) -> f64 {
        let scale = rx.iter().chain(rc).fold(0.0_f64, |a, v| a.max(v.abs()));
        dx.fill(0.0);
        dlambda.fill(0.0);
        let mut relative = f64::INFINITY;
        for pass in 0..4 {
            self.residual_x.copy_from_slice(rx);
            self.residual_c.copy_from_slice(rc);
            if pass > 0 {
                self.subtract_product(dx, dlambda);
            }
            self.hold();
            let norm = self
                .residual_x
                .iter()
                .chain(&self.residual_c)
                .fold(0.0_f64, |a, v| a.max(v.abs()));
            let next = if scale > 0.0 { norm / scale } else { 0.0 };
            if next <= self.refined || pass > 1 && next > 0.5 * relative {
                return next.min(relative);
            }
            relative = next;
            self.solve_once();
            if pass == 0 {
                self.reduced.remember(&self.dp);
            }
            for (d, s) in dx.iter_mut().zip(&self.step_x) {
                *d += s;
            }
            for (d, s) in dlambda.iter_mut().zip(&self.step_c) {
                *d += s;
            }
        }
        relative
    }

    /// `residual −= K (dx, dλ)` with the regularised matrix.
    pub(super) fn subtract_product(&mut self, dx: &[f64], dlambda: &[f64]) {
        let (rx, rc) = (&mut self.residual_x, &mut self.residual_c);
        // Accumulate the product with its sign reversed.
        for (r, (s, d)) in rx.iter_mut().zip(self.sigma.iter().zip(dx)) {
            *r = s * d - *r;
        }
        rc.iter_mut().for_each(|r| *r = -*r);
        let (layout, nx) = (&self.layout, self.sizes.nx);
        let p = layout.p();
        let (rest, parameters) = rx.split_at_mut(p);
        for group in &self.groups {
            let to = (&mut *rest, rc.as_mut_slice());
            group.add_product(layout, (dx, dlambda), to, (&mut self.local, parameters));
        }
        let (nodes, between) = self.diagonal.split_at(layout.nodes() * nx);
        let mut diagonal = nodes.chunks_exact(nx);
        for window in &layout.windows {
            for (k, values) in (0..=window.steps).zip(&mut diagonal) {
                let at = layout.state(window, k);
                for i in 0..nx {
                    rest[at + i] += values[i] * dx[at + i];
                }
            }
        }
        for (&(i, j), a) in layout.parameter_hessian.iter().zip(between) {
            let (i, j) = (i as usize, j as usize);
            parameters[i] += a * dx[p + j];
            if i != j {
                parameters[j] += a * dx[p + i];
            }
        }
        for (segment, start) in self
            .groups
            .iter()
            .flat_map(|g| &g.segments)
            .zip(&self.start_at)
        {
            if start.is_some() {
                let at = layout.state(&segment.window, segment.start);
                for i in at..at + nx {
                    rx[i] += self.delta_x * dx[i];
                }
            }
        }
        let p = self.layout.p();
        for (a, i) in self
            .columns
            .iter()
            .enumerate()
            .filter_map(|(a, c)| c.map(|i| (a, i)))
        {
            for (b, j) in self
                .columns
                .iter()
                .enumerate()
                .filter_map(|(b, c)| c.map(|j| (b, j)))
            {
                rx[p + a] += self.reduced.modification[(i as usize, j as usize)] * dx[p + b];
            }
        }
        rx.iter_mut().for_each(|r| *r = -*r);
        rc.iter_mut().for_each(|r| *r = -*r);
    }

    /// Clears the rows of held variables.
    pub(super) fn hold(&mut self) {
        let p = self.layout.p();
        for (j, column) in self.columns.iter().enumerate() {
            if column.is_none() {
                self.residual_x[p + j] = 0.0;
            }
        }
        for window in self.layout.windows.iter().filter(|w| w.held) {
            self.residual_x[window.x..window.x + self.sizes.nx].fill(0.0);
        }
    }
}
