//! Velocities after a step, with dry friction.

use super::Machine;
use crate::effect::Pick;
use crate::scalar::Scalar;

/// Rounds of `Machine::solve` in which all joints may change between sticking and sliding at
/// once. After them one joint changes at a time, the first that must, which cannot cycle where
/// numbers are exact (K. G. Murty, Note on a Bard-type scheme for solving the complementarity
/// problem, Opsearch 11, 1974).
const TOGETHER: usize = 6;
/// Most rounds: many times the number of joints. A step that needs more goes on with what it has,
/// and is counted.
const ROUNDS: usize = 40;

impl<D: Pick> Machine<'_, D> {
    /// Velocities after the step, with dry friction: the active set is found on values, derivatives
    /// belong to it.
    #[inline(always)]
    pub(super) fn solve(&mut self, m: usize) {
        for i in 0..m * m {
            self.values[i] = self.matrix[i].value();
        }
        let mut x = std::mem::take(&mut self.value_x);
        for round in 0..=ROUNDS {
            if round == ROUNDS {
                self.unsettled += 1;
                break;
            }
            for c in 0..m {
                self.value_rhs[c] = self.rhs[c].value() - self.dry(c);
            }
            factor(m, &self.values, &self.status, &mut self.factor);
            substitute(m, &self.factor, &self.status, &self.value_rhs, &mut x);
            let mut stable = true;
            for c in 0..m {
                let Some((forward, backward)) = self.levels[c] else {
                    continue;
                };
                let old = self.status[c];
                let new = if old == 0 {
                    // The impulse that holds it.
                    let mut pull = self.rhs[c].value();
                    for d in 0..m {
                        pull -= self.values[c * m + d] * x[d];
                    }
                    if pull > forward.value() {
                        1
                    } else if pull < -backward.value() {
                        -1
                    } else {
                        0
                    }
                } else if f64::from(old) * x[c] < 0.0 {
                    0
                } else {
                    old
                };
                if new != old {
                    self.status[c] = new;
                    stable = false;
                    // After a while one change at a time, which cannot cycle.
                    if round > TOGETHER {
                        break;
                    }
                }
            }
            if stable && D::PLAIN {
                for (next, x) in self.next.iter_mut().zip(&x) {
                    *next = D::constant(*x);
                }
                self.value_x = x;
                return;
            }
            if stable {
                break;
            }
        }
        for c in 0..m {
            self.rhs[c] = match (self.levels[c], self.status[c]) {
                (Some((f, _)), 1) => self.rhs[c] - f,
                (Some((_, b)), -1) => self.rhs[c] + b,
                _ => self.rhs[c],
            };
        }
        // A x = b, so A x' = b' − A' x: the factor of the values serves for the derivatives.
        for c in 0..m {
            let mut rest = self.rhs[c];
            for d in (0..m).filter(|&d| self.status[d] != 0) {
                rest -= self.matrix[c * m + d] * x[d];
            }
            self.rhs[c] = rest;
        }
        substitute(m, &self.factor, &self.status, &self.rhs, &mut self.next);
        for (next, &x) in self.next.iter_mut().zip(&x) {
            *next += D::constant(x - next.value());
        }
        self.value_x = x;
    }

    #[inline(always)]
    fn dry(&self, c: usize) -> f64 {
        match (self.levels[c], self.status[c]) {
            (Some((f, _)), 1) => f.value(),
            (Some((_, b)), -1) => -b.value(),
            _ => 0.0,
        }
    }
}

/// Factors `L D Lᵀ` of the rows and columns whose status is not 0: L below the diagonal, `1 / D` on it, `D Lᵀ`
/// above it. A matrix that is not positive definite has no such factors here: they are no numbers.
#[inline(always)]
fn factor(m: usize, a: &[f64], status: &[i8], l: &mut [f64]) {
    for i in (0..m).filter(|&i| status[i] != 0) {
        let mut pivot = a[i * m + i];
        for j in (0..i).filter(|&j| status[j] != 0) {
            let mut entry = a[i * m + j];
            for k in (0..j).filter(|&k| status[k] != 0) {
                entry -= l[k * m + i] * l[j * m + k];
            }
            let scaled = entry * l[j * m + j];
            pivot -= entry * scaled;
            (l[j * m + i], l[i * m + j]) = (entry, scaled);
        }
        l[i * m + i] = if pivot > 0.0 { 1.0 / pivot } else { f64::NAN };
    }
}

/// Solves by these factors; rows whose status is 0 are zero.
#[inline(always)]
fn substitute<D: Scalar>(m: usize, l: &[f64], status: &[i8], b: &[D], x: &mut [D]) {
    for i in 0..m {
        x[i] = D::nil();
        if status[i] != 0 {
            let mut y = b[i];
            for k in (0..i).filter(|&k| status[k] != 0) {
                y -= x[k] * l[i * m + k];
            }
            x[i] = y;
        }
    }
    for i in (0..m).rev().filter(|&i| status[i] != 0) {
        let mut y = x[i] * l[i * m + i];
        for k in (i + 1..m).filter(|&k| status[k] != 0) {
            y -= x[k] * l[k * m + i];
        }
        x[i] = y;
    }
}
