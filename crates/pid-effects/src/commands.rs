//! Inputs of a joint over a substep, now and earlier.

use crate::scalar::Scalar;

/// Inputs of one joint, for effects that look back in time.
#[derive(Debug, Clone, Copy)]
pub struct Commands<'a> {
    /// Commanded input at the samples.
    pub u: &'a [f64],
    /// Sample time, s.
    pub h: f64,
    /// Straight lines between samples instead of steps.
    pub linear: bool,
    /// Time of the first sample since the start of what was recorded, s.
    pub begin: f64,
    /// Start of the substep, s from the first sample.
    pub t: f64,
    /// Its length, s.
    pub dt: f64,
}

impl Commands<'_> {
    /// Mean of the command over the substep.
    #[inline(always)]
    pub fn now(&self) -> f64 {
        let i = ((self.t / self.h + 1e-9) as usize).min(self.u.len() - 1);
        if !self.linear {
            return self.u[i];
        }
        let next = self.u[(i + 1).min(self.u.len() - 1)];
        self.u[i] + (next - self.u[i]) * ((self.t + 0.5 * self.dt) / self.h - i as f64)
    }

    /// Mean of the command over the substep, `delay` earlier; commands before the first sample
    /// equal it. Differentiable from the right at a delay of zero.
    #[inline(always)]
    pub fn mean<D: Scalar>(&self, delay: D) -> D {
        let (mut from, end) = (-delay + self.t, -delay + (self.t + self.dt));
        let mut total = D::nil();
        let mut cell = (from.value() / self.h - 1e-9).floor();
        loop {
            let edge = (cell + 1.0) * self.h;
            let inside = edge < end.value() - 1e-9 * self.h;
            let to = if inside { D::constant(edge) } else { end };
            total += (to - from) * self.within((from + to) * 0.5, cell);
            if !inside {
                return total / self.dt;
            }
            from = to;
            cell += 1.0;
        }
    }

    #[inline(always)]
    fn within<D: Scalar>(&self, t: D, cell: f64) -> D {
        let last = self.u.len() - 1;
        if cell < 0.0 {
            return D::constant(self.u[0]);
        }
        let i = (cell as usize).min(last);
        if self.linear {
            let next = self.u[(i + 1).min(last)];
            (t / self.h - i as f64) * (next - self.u[i]) + self.u[i]
        } else {
            D::constant(self.u[i])
        }
    }
}
