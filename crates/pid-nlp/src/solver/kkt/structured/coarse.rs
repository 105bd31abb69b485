//! The coarse system over the segment starts and the multipliers of the links, and its Schur
//! complement in the free parameters.

use pid_lanes::LANES;

use super::plan::Sizes;
use super::{STATIC, StructuredKkt};
use crate::solver::kkt::KktError;
use crate::solver::kkt::ldl::SparseLdl;

impl StructuredKkt {
    /// Visits the lower triangle of the coarse matrix without the parameters, always in the same order.
    pub(super) fn coarse_entries(&self, mut visit: impl FnMut(usize, usize, f64)) {
        let Sizes { nx, w, .. } = self.sizes;
        for s in 0..self.start_at.len() {
            let (group, l) = (&self.groups[s / LANES], s % LANES);
            if let Some(x) = self.start_at[s] {
                for i in 0..nx {
                    for j in 0..=i {
                        visit(x + i, x + j, group.v[i * w + j][l]);
                    }
                }
            }
            if let Some(link) = self.link_at[s] {
                for i in 0..nx {
                    if let Some(x) = self.start_at[s] {
                        for j in 0..nx {
                            visit(link + i, x + j, group.c[i * w + j][l]);
                        }
                    }
                    visit(link + nx + i, link + i, -1.0);
                }
            }
        }
    }

    fn load_coarse(&mut self, delta_x: f64) {
        let mut ldl = std::mem::replace(&mut self.ldl, SparseLdl::new(0, &[]));
        ldl.clear();
        let mut k = 0;
        self.coarse_entries(|_, _, value| {
            ldl.add(k, value);
            k += 1;
        });
        let Sizes { nx, w, .. } = self.sizes;
        for s in 0..self.start_at.len() {
            if let Some(x) = self.start_at[s] {
                (x..x + nx).for_each(|i| ldl.add_diagonal(i, delta_x));
            }
            if let Some(link) = self.link_at[s] {
                let (behind, l) = (&self.groups[(s + 1) / LANES], (s + 1) % LANES);
                for i in 0..nx {
                    let curvature = behind.v[i * w + i][l].abs();
                    let shift = match self.whole {
                        true => STATIC / curvature.max(1.0),
                        false => STATIC,
                    };
                    self.shifts[link + i] = shift;
                    ldl.add_diagonal(link + i, -shift);
                }
            }
        }
        self.ldl = ldl;
    }

    /// Factorises the coarse matrix, regularising the segment starts until it has one negative
    /// eigenvalue a link.
    pub(super) fn factorise_coarse(&mut self) -> Result<(f64, usize), KktError> {
        let mut delta = 0.0;
        let mut tried = 0;
        loop {
            self.load_coarse(delta);
            tried += 1;
            let inertia = self.ldl.factorise();
            if inertia.negative == self.links && inertia.zero == 0 {
                break;
            }
            delta = match (delta, self.last_delta) {
                (0.0, 0.0) => 1e-6,
                (0.0, last) => (last / 3.0).max(1e-12),
                (delta, _) => 10.0 * delta,
            };
            if delta > 1e20 {
                return Err(KktError::WrongInertia { delta });
            }
        }
        if delta > 0.0 {
            self.last_delta = delta;
        }
        Ok((delta, tried))
    }

    /// Solves with the coarse matrix without its static regularisation, for `width` right-hand
    /// sides row by row: one step of refinement, the solution as a whole is refined later.
    pub(super) fn coarse_solve(
        ldl: &mut SparseLdl,
        shifts: &[f64],
        rhs: &[f64],
        x: &mut [f64],
        r: &mut [f64],
        width: usize,
    ) {
        x.copy_from_slice(rhs);
        ldl.solve_rows(x, width);
        r.fill(0.0);
        ldl.multiply_add_rows(x, r, width);
        for (i, shift) in shifts.iter().enumerate() {
            for k in i * width..(i + 1) * width {
                r[k] = rhs[k] - (r[k] + shift * x[k]);
            }
        }
        ldl.solve_rows(r, width);
        for (x, r) in x.iter_mut().zip(r) {
            *x += *r;
        }
    }

    /// Schur complement of the coarse matrix in the free parameters.
    pub(super) fn reduce_to_parameters(&mut self) {
        let Sizes { nx, np, w, .. } = self.sizes;
        let wp = self.wp;
        let reduced = &mut self.reduced.hessian;
        reduced.fill(0.0);
        for group in &self.groups {
            for i in 0..np {
                for j in i..np {
                    reduced[(j, i)] += group.kpp[i * np + j].iter().sum::<f64>();
                }
            }
        }
        for s in 0..self.start_at.len() {
            let (group, l) = (&self.groups[s / LANES], s % LANES);
            for i in 0..nx {
                for (at, rows) in [(self.start_at[s], &group.v), (self.link_at[s], &group.c)] {
                    if let Some(at) = at {
                        let to = &mut self.kxp[(at + i) * wp..(at + i) * wp + np];
                        for (to, from) in to.iter_mut().zip(&rows[i * w + nx..]) {
                            *to = from[l];
                        }
                    }
                }
            }
        }
        let offset = self.layout.nodes() * nx;
        for (k, &(row, col)) in self.layout.parameter_hessian.iter().enumerate() {
            if let (Some(i), Some(j)) = (self.columns[row as usize], self.columns[col as usize]) {
                reduced[(i.max(j) as usize, i.min(j) as usize)] += self.diagonal[offset + k];
            }
        }
        let p = self.layout.p();
        for (j, column) in self.columns.iter().enumerate() {
            if let Some(i) = column {
                let i = *i as usize;
                reduced[(i, i)] += self.sigma[p + j];
            }
        }
        Self::coarse_solve(
            &mut self.ldl,
            &self.shifts,
            &self.kxp,
            &mut self.z,
            &mut self.correction,
            wp,
        );
        self.product.fill(0.0);
        for (k, z) in self
            .kxp
            .chunks_exact(wp.max(1))
            .zip(self.z.chunks_exact(wp.max(1)))
        {
            for j in 0..np {
                let row = &mut self.product[j * wp..(j + 1) * wp];
                for (out, k) in row.iter_mut().zip(k) {
                    *out += z[j] * k;
                }
            }
        }
        for j in 0..np {
            for i in j..np {
                reduced[(i, j)] -= self.product[j * wp + i];
            }
        }
        for j in 0..np {
            for i in 0..j {
                reduced[(i, j)] = reduced[(j, i)];
            }
        }
    }
}
