//! 3-vectors, rotations and frames of expressions.

use pid_symbolic::{Graph, Id};

/// A vector.
pub type Vector = [Id; 3];
/// A matrix, row by row.
pub type Matrix = [[Id; 3]; 3];

/// Cosines and sines of multiples of π/2 come out of floating point as 6e-17 and the like; they are
/// exact zeros.
const SNAP: f64 = 1e-15;

/// The zero vector.
pub fn zero(g: &mut Graph) -> Vector {
    [g.zero(); 3]
}

/// A constant vector.
pub fn constant(g: &mut Graph, x: [f64; 3]) -> Vector {
    x.map(|x| g.constant(x))
}

/// x + y.
pub fn add(g: &mut Graph, x: Vector, y: Vector) -> Vector {
    [0, 1, 2].map(|k| g.add(x[k], y[k]))
}

/// −x.
pub fn neg(g: &mut Graph, x: Vector) -> Vector {
    x.map(|x| g.neg(x))
}

/// s x.
pub fn scale(g: &mut Graph, s: Id, x: Vector) -> Vector {
    x.map(|x| g.mul(s, x))
}

/// x · y.
pub fn dot(g: &mut Graph, x: Vector, y: Vector) -> Id {
    let terms = [0, 1, 2].map(|k| g.mul(x[k], y[k]));
    g.sum(terms)
}

/// x × y.
pub fn cross(g: &mut Graph, x: Vector, y: Vector) -> Vector {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let (left, right) = (g.mul(x[i], y[j]), g.mul(x[j], y[i]));
        g.sub(left, right)
    })
}

/// A x.
pub fn apply(g: &mut Graph, a: &Matrix, x: Vector) -> Vector {
    a.map(|row| dot(g, row, x))
}

/// Aᵀ x.
pub fn apply_transposed(g: &mut Graph, a: &Matrix, x: Vector) -> Vector {
    apply(g, &transpose(a), x)
}

/// Aᵀ.
pub fn transpose(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// A B.
pub fn multiply(g: &mut Graph, a: &Matrix, b: &Matrix) -> Matrix {
    let columns = transpose(b);
    a.map(|row| columns.map(|column| dot(g, row, column)))
}

/// The identity.
pub fn identity(g: &mut Graph) -> Matrix {
    let (zero, one) = (g.zero(), g.one());
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { one } else { zero }))
}

/// Sine and cosine, exact zeros at multiples of π/2.
fn sin_cos(g: &mut Graph, angle: Id) -> (Id, Id) {
    let snapped = |g: &mut Graph, x: Id| match g.value(x) {
        Some(value) if value.abs() < SNAP => g.zero(),
        _ => x,
    };
    let (s, c) = (g.sin(angle), g.cos(angle));
    (snapped(g, s), snapped(g, c))
}

/// Rotation about a unit axis: `cos θ · 1 + (1 − cos θ) n nᵀ + sin θ [n]×` (O. Rodrigues, 1840).
pub fn rotation(g: &mut Graph, axis: [f64; 3], angle: Id) -> Matrix {
    let (s, c) = sin_cos(g, angle);
    let one = g.one();
    let versine = g.sub(one, c);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            if i == j && axis[i].abs() == 1.0 {
                return one;
            }
            let square = g.constant(axis[i] * axis[j]);
            let mut entry = g.mul(square, versine);
            if i == j {
                entry = g.add(entry, c);
            } else {
                // [n]× has −n₂ at (0, 1), n₁ at (0, 2), −n₀ at (1, 2).
                let k = 3 - i - j;
                let sign = if (i + 1) % 3 == j { -1.0 } else { 1.0 };
                let component = g.constant(sign * axis[k]);
                let skew = g.mul(component, s);
                entry = g.add(entry, skew);
            }
            entry
        })
    })
}

/// `R = Rz(yaw) Ry(pitch) Rx(roll)`, as in URDF.
pub fn roll_pitch_yaw(g: &mut Graph, rpy: Vector) -> Matrix {
    let x = rotation(g, [1.0, 0.0, 0.0], rpy[0]);
    let y = rotation(g, [0.0, 1.0, 0.0], rpy[1]);
    let z = rotation(g, [0.0, 0.0, 1.0], rpy[2]);
    let zy = multiply(g, &z, &y);
    multiply(g, &zy, &x)
}

/// A frame in a parent frame: `x_parent = R x + origin`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// R: columns are the frame's axes in the parent frame.
    pub rotation: Matrix,
    /// The frame's origin in the parent frame.
    pub origin: Vector,
}

impl Frame {
    /// The parent frame itself.
    pub fn identity(g: &mut Graph) -> Self {
        Self {
            rotation: identity(g),
            origin: zero(g),
        }
    }

    /// A frame given in this frame, seen from the parent.
    pub fn then(&self, g: &mut Graph, inner: &Self) -> Self {
        let offset = apply(g, &self.rotation, inner.origin);
        Self {
            rotation: multiply(g, &self.rotation, &inner.rotation),
            origin: add(g, self.origin, offset),
        }
    }
}
