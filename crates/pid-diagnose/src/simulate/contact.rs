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
            reduced(
                m,
                &self.values,
                &self.value_rhs,
                &self.status,
                &mut self.value_scratch,
                &mut x,
            );
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
        self.value_x = x;
        for c in 0..m {
            self.rhs[c] = match (self.levels[c], self.status[c]) {
                (Some((f, _)), 1) => self.rhs[c] - f,
                (Some((_, b)), -1) => self.rhs[c] + b,
                _ => self.rhs[c],
            };
        }
        reduced(
            m,
            &self.matrix,
            &self.rhs,
            &self.status,
            &mut self.scratch,
            &mut self.next,
        );
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

/// Solves the rows and columns whose status is not 0 by Cholesky factorization; the others are zero.
#[inline(always)]
fn reduced<D: Scalar>(m: usize, a: &[D], b: &[D], status: &[i8], l: &mut [D], x: &mut [D]) {
    for i in 0..m {
        if status[i] == 0 {
            x[i] = D::nil();
            continue;
        }
        for j in 0..=i {
            if status[j] == 0 {
                continue;
            }
            let mut entry = a[i * m + j];
            for k in 0..j {
                if status[k] != 0 {
                    entry -= l[i * m + k] * l[j * m + k];
                }
            }
            l[i * m + j] = if i == j {
                entry.root().inverse()
            } else {
                entry * l[j * m + j]
            };
        }
        let mut y = b[i];
        for k in 0..i {
            if status[k] != 0 {
                y -= l[i * m + k] * x[k];
            }
        }
        x[i] = y * l[i * m + i];
    }
    for i in (0..m).rev() {
        if status[i] == 0 {
            continue;
        }
        let mut y = x[i];
        for k in i + 1..m {
            if status[k] != 0 {
                y -= l[k * m + i] * x[k];
            }
        }
        x[i] = y * l[i * m + i];
    }
}
