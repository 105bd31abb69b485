//! Where the unknowns and values of a discretised identification problem stand.

use crate::nlp::SparsePattern;

/// One window: a chain of steps from a free (or held) initial state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Number of steps.
    pub steps: usize,
    /// Position of the initial state among the variables; step k's unknowns follow at `x + nx + k ny`.
    pub x: usize,
    /// First constraint row; step k has the rows `row + k ny ..`.
    pub row: usize,
    /// Number of steps in the windows before this one.
    pub first_step: usize,
    /// Number of nodes in the windows before this one.
    pub first_node: usize,
    /// Whether the initial state is held at its value.
    pub held: bool,
}

/// The repeated structure of a full discretization.
///
/// Step k of a window has the unknowns `y_k = (s_k, x_{k+1})`: stage variables first, then the next
/// state, `ny ≥ nx` in all, and `ny` constraint rows `c_k(x_k, y_k, p) = 0` whose Jacobian with
/// respect to `y_k` is square and regular. Local positions of a step count x_k (nx), y_k (ny) and p
/// (np) in this order. Variables: windows one after another, then p.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Length of a state.
    pub nx: usize,
    /// Unknowns, and rows, of a step.
    pub ny: usize,
    /// Number of parameters.
    pub np: usize,
    /// The windows.
    pub windows: Vec<Window>,
    /// Jacobian entries of one step: row, local column.
    pub step_jacobian: Vec<(u32, u32)>,
    /// Hessian entries of one step, local, row ≥ column, without those between two parameters.
    pub step_hessian: Vec<(u32, u32)>,
    /// Hessian entries between parameters, row ≥ column; every diagonal entry is among them.
    pub parameter_hessian: Vec<(u32, u32)>,
}

impl Layout {
    /// Windows of the given numbers of steps, one after another.
    pub fn windows(nx: usize, ny: usize, steps: &[usize], held: bool) -> Vec<Window> {
        let (mut x, mut row, mut first_step, mut first_node) = (0, 0, 0, 0);
        let mut windows = Vec::with_capacity(steps.len());
        for &steps in steps {
            windows.push(Window {
                steps,
                x,
                row,
                first_step,
                first_node,
                held,
            });
            x += nx + steps * ny;
            row += steps * ny;
            first_step += steps;
            first_node += steps + 1;
        }
        windows
    }

    /// Number of steps in all windows.
    pub fn steps(&self) -> usize {
        self.windows.last().map_or(0, |w| w.first_step + w.steps)
    }

    /// Number of nodes in all windows.
    pub fn nodes(&self) -> usize {
        self.windows
            .last()
            .map_or(0, |w| w.first_node + w.steps + 1)
    }

    /// Position of the first parameter among the variables.
    pub fn p(&self) -> usize {
        self.windows
            .last()
            .map_or(0, |w| w.x + self.nx + w.steps * self.ny)
    }

    /// Number of variables.
    pub fn n(&self) -> usize {
        self.p() + self.np
    }

    /// Number of constraints.
    pub fn m(&self) -> usize {
        self.steps() * self.ny
    }

    /// Position among the variables of the state at node k of a window.
    pub fn state(&self, window: &Window, k: usize) -> usize {
        if k == 0 {
            window.x
        } else {
            window.x + k * self.ny
        }
    }

    /// Position among the variables of the unknowns of step k of a window.
    pub fn step(&self, window: &Window, k: usize) -> usize {
        window.x + self.nx + k * self.ny
    }

    /// Position among the variables of a local position of step k.
    pub fn global(&self, window: &Window, k: usize, local: usize) -> usize {
        if local < self.nx {
            self.state(window, k) + local
        } else if local < self.nx + self.ny {
            self.step(window, k) + local - self.nx
        } else {
            self.p() + local - self.nx - self.ny
        }
    }

    /// Position in the Hessian values of the diagonal of the states: `nx` entries a node.
    pub fn node_values(&self) -> usize {
        self.steps() * self.step_hessian.len()
    }

    /// Position in the Hessian values of the entries between parameters.
    pub fn parameter_values(&self) -> usize {
        self.node_values() + self.nodes() * self.nx
    }

    /// Pattern of the constraint Jacobian: the steps' entries one after another.
    pub fn jacobian_pattern(&self) -> SparsePattern {
        let mut pattern = SparsePattern::default();
        for window in &self.windows {
            for k in 0..window.steps {
                for &(row, col) in &self.step_jacobian {
                    let row = window.row + k * self.ny + row as usize;
                    pattern.push(row, self.global(window, k, col as usize));
                }
            }
        }
        pattern
    }

    /// Pattern of the Lagrangian's Hessian: the steps' entries, the diagonal of the states, the
    /// parameters' entries.
    pub fn hessian_pattern(&self) -> SparsePattern {
        let mut pattern = SparsePattern::default();
        for window in &self.windows {
            for k in 0..window.steps {
                for &(row, col) in &self.step_hessian {
                    let row = self.global(window, k, row as usize);
                    pattern.push(row, self.global(window, k, col as usize));
                }
            }
        }
        for window in &self.windows {
            for k in 0..=window.steps {
                for i in 0..self.nx {
                    let at = self.state(window, k) + i;
                    pattern.push(at, at);
                }
            }
        }
        let p = self.p();
        for &(row, col) in &self.parameter_hessian {
            pattern.push(p + row as usize, p + col as usize);
        }
        pattern
    }
}
