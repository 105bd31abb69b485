//! Conjugate residuals, for systems in which refinement hardly contracts.

use super::StructuredKkt;

/// Most directions that are kept.
const DIRECTIONS: usize = 12;

/// A direction and its product with the matrix, of unit length.
struct Direction {
    along: Vec<f64>,
    product: Vec<f64>,
}

impl StructuredKkt {
    /// Improves a refined solution by generalised conjugate residuals with the factorization as
    /// preconditioner (S. C. Eisenstat, H. C. Elman, M. H. Schultz, SIAM J. Numer. Anal. 20
    /// (1983)). Entries of the reduced Hessian carry rounding errors above its smallest
    /// eigenvalues, in as many directions as parameters are hardly determined; as many passes
    /// remove their effect. Returns the relative residual that is left.
    pub(super) fn conjugate(
        &mut self,
        rx: &[f64],
        rc: &[f64],
        dx: &mut [f64],
        dlambda: &mut [f64],
    ) -> f64 {
        let scale = largest(rx).max(largest(rc));
        self.load_residual(rx, rc, dx, dlambda);
        let mut residual = [&self.residual_x[..], &self.residual_c[..]].concat();
        let n = rx.len();
        let mut directions: Vec<Direction> = Vec::with_capacity(DIRECTIONS);
        while directions.len() < DIRECTIONS && largest(&residual) > self.refined * scale {
            self.residual_x.copy_from_slice(&residual[..n]);
            self.residual_c.copy_from_slice(&residual[n..]);
            self.solve_once();
            let mut along = [&self.step_x[..], &self.step_c[..]].concat();
            self.residual_x.fill(0.0);
            self.residual_c.fill(0.0);
            self.subtract_product(&along[..n], &along[n..]);
            self.hold();
            let parts = self.residual_x.iter().chain(&self.residual_c);
            let mut product: Vec<f64> = parts.map(|r| -r).collect();
            for earlier in &directions {
                let share = dot(&product, &earlier.product);
                add(&mut product, -share, &earlier.product);
                add(&mut along, -share, &earlier.along);
            }
            let length = dot(&product, &product).sqrt();
            if length == 0.0 || !length.is_finite() {
                break;
            }
            product.iter_mut().for_each(|p| *p /= length);
            along.iter_mut().for_each(|a| *a /= length);
            let step = dot(&residual, &product);
            add(&mut residual, -step, &product);
            add(dx, step, &along[..n]);
            add(dlambda, step, &along[n..]);
            directions.push(Direction { along, product });
        }
        self.load_residual(rx, rc, dx, dlambda);
        let left = largest(&self.residual_x).max(largest(&self.residual_c));
        left / scale
    }

    fn load_residual(&mut self, rx: &[f64], rc: &[f64], dx: &[f64], dlambda: &[f64]) {
        self.residual_x.copy_from_slice(rx);
        self.residual_c.copy_from_slice(rc);
        self.subtract_product(dx, dlambda);
        self.hold();
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |a, v| a.max(v.abs()))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add(to: &mut [f64], factor: f64, values: &[f64]) {
    to.iter_mut()
        .zip(values)
        .for_each(|(t, v)| *t += factor * v);
}
