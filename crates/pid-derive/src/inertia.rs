//! Rigid-body inertia in the parameters in which the equations are linear: mass, first moment,
//! tensor about the origin.

use pid_symbolic::{Graph, Id};

use super::symbols::Symbols;
use super::vector::{self, Frame, Matrix, Vector};
use crate::model::{About, Inertial, Tensor};

/// Inertia of a body in its frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inertia {
    /// m.
    pub mass: Id,
    /// h = m c.
    pub moment: Vector,
    /// I about the origin of the frame.
    pub tensor: Matrix,
}

impl Inertia {
    /// No inertia.
    pub fn zero(g: &mut Graph) -> Self {
        Self {
            mass: g.zero(),
            moment: vector::zero(g),
            tensor: [[g.zero(); 3]; 3],
        }
    }

    /// The inertia of a declared link, in the link's frame. A tensor about the centre of mass is
    /// moved to the origin by the parallel-axis theorem, `I = I_c + m (cᵀc 1 − c cᵀ)`.
    pub fn of_link(g: &mut Graph, symbols: &Symbols, inertial: &Inertial) -> Self {
        match inertial {
            Inertial::None => Self::zero(g),
            Inertial::Linear {
                mass,
                first_moment,
                inertia,
            } => Self {
                mass: symbols.expression(g, mass),
                moment: symbols.vector(g, first_moment),
                tensor: tensor(g, symbols, inertia),
            },
            Inertial::Body {
                mass,
                com,
                inertia,
                about,
            } => {
                let mass = symbols.expression(g, mass);
                let com = symbols.vector(g, com);
                let moment = vector::scale(g, mass, com);
                let mut tensor = tensor(g, symbols, inertia);
                if *about == About::Com {
                    let shift = parallel_axis(g, com, moment);
                    tensor = symmetric(&sum(g, &tensor, &shift));
                }
                Self {
                    mass,
                    moment,
                    tensor,
                }
            }
        }
    }

    /// The same body with respect to the parent of its frame: `h' = R h + m p`, and with `d = R h`
    /// `I' = R I Rᵀ + 2 (p·d) 1 − p dᵀ − d pᵀ + m (pᵀp 1 − p pᵀ)`.
    pub fn seen_from_parent(&self, g: &mut Graph, frame: &Frame) -> Self {
        let p = frame.origin;
        let turned = vector::apply(g, &frame.rotation, self.moment);
        let moved = vector::scale(g, self.mass, p);
        let left = vector::multiply(g, &frame.rotation, &self.tensor);
        let mut tensor = vector::multiply(g, &left, &vector::transpose(&frame.rotation));
        // p dᵀ and d pᵀ, then m p pᵀ.
        for (x, y) in [(p, turned), (turned, p), (p, moved)] {
            let shift = parallel_axis(g, x, y);
            tensor = sum(g, &tensor, &shift);
        }
        Self {
            mass: self.mass,
            moment: vector::add(g, turned, moved),
            tensor: symmetric(&tensor),
        }
    }

    /// Both bodies as one.
    pub fn plus(&self, g: &mut Graph, other: &Self) -> Self {
        Self {
            mass: g.add(self.mass, other.mass),
            moment: vector::add(g, self.moment, other.moment),
            tensor: sum(g, &self.tensor, &other.tensor),
        }
    }
}

/// `(x·y) 1 − x yᵀ`.
fn parallel_axis(g: &mut Graph, x: Vector, y: Vector) -> Matrix {
    let products: Matrix = x.map(|x| y.map(|y| g.mul(x, y)));
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            if i == j {
                let (k, l) = ((i + 1) % 3, (i + 2) % 3);
                g.add(products[k][k], products[l][l])
            } else {
                g.neg(products[i][j])
            }
        })
    })
}

fn sum(g: &mut Graph, a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| g.add(a[i][j], b[i][j])))
}

/// The lower triangle mirrored: equal numbers, written once.
fn symmetric(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i.max(j)][i.min(j)]))
}

fn tensor(g: &mut Graph, symbols: &Symbols, t: &Tensor) -> Matrix {
    let [xx, yy, zz] = [&t.xx, &t.yy, &t.zz].map(|e| symbols.expression(g, e));
    let [xy, xz, yz] = [&t.xy, &t.xz, &t.yz].map(|e| symbols.expression(g, e));
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}
