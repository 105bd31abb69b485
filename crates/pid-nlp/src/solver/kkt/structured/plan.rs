//! Where the values of a step go in the condensing.
//!
//! A step's unknowns are `y = (s, x')`. Leading rows without parameters that fix one component of
//! x' each (the kinematics `q' = q + h v …`) are substituted before anything is factorised: they
//! leave the core unknowns `z`, the rest of y, and
//!
//! ```text
//! x'_e = E x + S z + e
//! ```
//!
//! Steps without such rows have z = y.

use super::super::layout::Layout;

/// Sizes shared by all segments, the width of a row of (x, p) coefficients rounded up for vector units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sizes {
    pub(super) nx: usize,
    pub(super) ny: usize,
    /// Free parameters.
    pub(super) np: usize,
    /// Row length: `nx + np`, rounded up to a multiple of 4.
    pub(super) w: usize,
    /// Substituted components of the next state: its first `ne`, by the first `ne` rows.
    pub(super) ne: usize,
    /// Core unknowns, `ny − ne`.
    pub(super) nz: usize,
}

impl Sizes {
    /// Stage variables.
    pub(super) fn ns(&self) -> usize {
        self.ny - self.nx
    }

    /// Core position of component `i ≥ ne` of the next state.
    pub(super) fn core(&self, i: usize) -> usize {
        self.ns() + i - self.ne
    }
}

/// `work[at] += sign · value`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    pub(super) value: u32,
    pub(super) at: u32,
    pub(super) sign: f64,
}

/// Offsets of the matrices of one step in its workspace.
#[derive(Debug, Clone, Copy)]
pub(super) struct Offsets {
    /// Core rows with respect to z, nz × nz.
    pub(super) b: usize,
    /// Core rows with respect to x'_e, nz × ne.
    pub(super) d: usize,
    /// Minus the core rows with respect to (x, p), nz × w.
    pub(super) t: usize,
    /// Substituted rows with respect to x'_e: its diagonal, ne.
    pub(super) r: usize,
    /// Minus the substituted rows with respect to x, ne × nx.
    pub(super) rx: usize,
    /// Minus the substituted rows with respect to z, ne × nz.
    pub(super) rz: usize,
    /// Hessian: z with z (both triangles), nz × nz.
    pub(super) m: usize,
    /// z with (x, p), nz × w.
    pub(super) n: usize,
    /// x with (x, p), x with x in both triangles, nx × w.
    pub(super) q: usize,
    /// x'_e with z, ne × nz.
    pub(super) fz: usize,
    /// x'_e with (x, p), ne × w.
    pub(super) fx: usize,
    /// x'_e with x'_e (both triangles), ne × ne.
    pub(super) fe: usize,
    /// Length of the workspace.
    pub(super) len: usize,
}

/// The plan of one step.
pub(super) struct Plan {
    pub(super) sizes: Sizes,
    pub(super) offsets: Offsets,
    pub(super) jacobian: Vec<Target>,
    pub(super) hessian: Vec<Target>,
}

/// Counts the leading rows without parameters that have a component of x' of their own each.
fn substituted_rows(layout: &Layout) -> usize {
    // The next state follows x and the stages.
    let (nx, first) = (layout.nx, layout.ny);
    let mut ne = 0;
    'rows: while ne < nx && ne < layout.ny {
        let mut own = false;
        for &(row, col) in &layout.step_jacobian {
            let (row, col) = (row as usize, col as usize);
            // The block of the rows so far must stay diagonal.
            if row <= ne && col >= first && col <= first + ne && col - first != row {
                break 'rows;
            }
            if row == ne {
                if col >= nx + layout.ny {
                    break 'rows;
                }
                own |= col == first + ne;
            }
        }
        if !own {
            break;
        }
        ne += 1;
    }
    ne
}

impl Sizes {
    fn of(layout: &Layout, np: usize) -> Self {
        let (nx, ny) = (layout.nx, layout.ny);
        let ne = substituted_rows(layout);
        Sizes {
            nx,
            ny,
            np,
            w: (nx + np).next_multiple_of(4),
            ne,
            nz: ny - ne,
        }
    }
}

impl Offsets {
    fn of(sizes: &Sizes) -> Self {
        let &Sizes { nx, ne, nz, w, .. } = sizes;
        let mut len = 0;
        let mut take = |n: usize| {
            len += n;
            len - n
        };
        let o = Offsets {
            b: take(nz * nz),
            d: take(nz * ne),
            t: take(nz * w),
            r: take(ne),
            rx: take(ne * nx),
            rz: take(ne * nz),
            m: take(nz * nz),
            n: take(nz * w),
            q: take(nx * w),
            fz: take(ne * nz),
            fx: take(ne * w),
            fe: take(ne * ne),
            len: 0,
        };
        Offsets { len, ..o }
    }

    /// Place and sign of the entry (row, variable) of a step's Jacobian; `None` for what is held.
    fn of_jacobian(&self, sizes: &Sizes, row: usize, variable: Variable) -> Option<(usize, f64)> {
        let &Sizes { nx, ne, nz, w, .. } = sizes;
        Some(match (row < ne, variable) {
            (_, Variable::Held) => return None,
            (true, Variable::Start(j)) => (self.rx + row * nx + j, -1.0),
            (true, Variable::Core(j)) => (self.rz + row * nz + j, -1.0),
            (true, Variable::Substituted(j)) if j == row => (self.r + j, 1.0),
            // Excluded when the rows were chosen.
            (true, Variable::Substituted(_) | Variable::Parameter(_)) => return None,
            (false, Variable::Start(j)) => (self.t + (row - ne) * w + j, -1.0),
            (false, Variable::Parameter(j)) => (self.t + (row - ne) * w + nx + j, -1.0),
            (false, Variable::Core(j)) => (self.b + (row - ne) * nz + j, 1.0),
            (false, Variable::Substituted(j)) => (self.d + (row - ne) * ne + j, 1.0),
        })
    }

    /// Places of the entry (a, b) of a step's Hessian, of which one triangle is stored: two where the
    /// workspace holds both.
    fn of_hessian(&self, sizes: &Sizes, a: Variable, b: Variable) -> [Option<usize>; 2] {
        use Variable::{Core, Held, Parameter, Start, Substituted};
        let &Sizes { nx, ne, nz, w, .. } = sizes;
        let both = |at: usize, width: usize, i: usize, j: usize| {
            let other = (i != j).then_some(at + j * width + i);
            [Some(at + i * width + j), other]
        };
        let one = |at: usize| [Some(at), None];
        match (a, b) {
            (Held, _) | (_, Held) | (Parameter(_), Parameter(_)) => [None, None],
            (Core(i), Core(j)) => both(self.m, nz, i, j),
            (Start(i), Start(j)) => both(self.q, w, i, j),
            (Substituted(i), Substituted(j)) => both(self.fe, ne, i, j),
            (Core(i), Start(j)) | (Start(j), Core(i)) => one(self.n + i * w + j),
            (Core(i), Parameter(j)) | (Parameter(j), Core(i)) => one(self.n + i * w + nx + j),
            (Start(i), Parameter(j)) | (Parameter(j), Start(i)) => one(self.q + i * w + nx + j),
            (Substituted(i), Core(j)) | (Core(j), Substituted(i)) => one(self.fz + i * nz + j),
            (Substituted(i), Start(j)) | (Start(j), Substituted(i)) => one(self.fx + i * w + j),
            (Substituted(i), Parameter(j)) | (Parameter(j), Substituted(i)) => {
                one(self.fx + i * w + nx + j)
            }
        }
    }
}

impl Plan {
    /// `columns[j]` is the position of parameter j among the `np` free ones.
    pub(super) fn new(layout: &Layout, columns: &[Option<u32>], np: usize) -> Self {
        let sizes = Sizes::of(layout, np);
        let offsets = Offsets::of(&sizes);
        let variable = |local: u32| Variable::of(local as usize, &sizes, columns);
        let jacobian = layout.step_jacobian.iter().enumerate();
        let jacobian = jacobian.filter_map(|(value, &(row, col))| {
            let (at, sign) = offsets.of_jacobian(&sizes, row as usize, variable(col))?;
            let (value, at) = (value as u32, at as u32);
            Some(Target { value, at, sign })
        });
        let hessian = layout.step_hessian.iter().enumerate();
        let hessian = hessian.flat_map(|(value, &(row, col))| {
            let places = offsets.of_hessian(&sizes, variable(row), variable(col));
            let value = value as u32;
            places.into_iter().flatten().map(move |at| Target {
                value,
                at: at as u32,
                sign: 1.0,
            })
        });
        Self {
            jacobian: jacobian.collect(),
            hessian: hessian.collect(),
            sizes,
            offsets,
        }
    }
}

/// Role of a local position of a step in the condensing.
#[derive(Debug, Clone, Copy)]
enum Variable {
    Start(usize),
    Core(usize),
    Substituted(usize),
    Parameter(usize),
    Held,
}

impl Variable {
    fn of(local: usize, s: &Sizes, columns: &[Option<u32>]) -> Self {
        let ns = s.ns();
        if local < s.nx {
            Self::Start(local)
        } else if local < s.nx + ns {
            Self::Core(local - s.nx)
        } else if local < s.nx + ns + s.ne {
            Self::Substituted(local - s.nx - ns)
        } else if local < s.nx + s.ny {
            Self::Core(s.core(local - s.nx - ns))
        } else {
            columns[local - s.nx - s.ny].map_or(Self::Held, |j| Self::Parameter(j as usize))
        }
    }
}
