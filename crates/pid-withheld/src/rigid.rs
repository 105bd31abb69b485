//! Rigid links over any [`Number`]: where they hang, their inertial parameters, and 3-vectors; the
//! tree of them is [`linkage`](crate::linkage).

use num_dual::DualNum;

/// A real number, or one with a derivative: rates of change are taken by it.
pub trait Number: DualNum<Primitive = f64> + Copy + Send + Sync {}

impl<D: DualNum<Primitive = f64> + Copy + Send + Sync> Number for D {}

/// Three components.
pub type V3<D> = [D; 3];
/// Three rows of three.
pub type M3<D> = [[D; 3]; 3];

/// Inertial parameters of one link in its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body<D> {
    /// Mass, kg.
    pub mass: D,
    /// First moment m c, kg m.
    pub moment: V3<D>,
    /// Inertia about the frame's origin, xx yy zz xy xz yz, kg m².
    pub inertia: [D; 6],
}

/// Where a link hangs on its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct Hinge {
    /// The link it hangs on, listed before; `None`: the base.
    pub parent: Option<usize>,
    /// Turns (`true`) or slides.
    pub revolute: bool,
    /// Unit axis in the link's frame.
    pub axis: V3<f64>,
    /// Position in the parent's frame, m.
    pub origin: V3<f64>,
    /// Rotation from the link's frame at q = 0 to the parent's.
    pub rotation: M3<f64>,
}

#[inline(always)]
pub(crate) fn add<D: Number>(a: V3<D>, b: V3<D>) -> V3<D> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
#[inline(always)]
pub(crate) fn cross<D: Number>(a: V3<D>, b: V3<D>) -> V3<D> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
#[inline(always)]
pub(crate) fn times<D: Number>(a: V3<D>, x: D) -> V3<D> {
    [a[0] * x, a[1] * x, a[2] * x]
}

/// Adds a point mass at `at` (link frame) to a body.
pub fn add_point<D: Number>(body: &mut Body<D>, mass: D, at: V3<f64>) {
    let [x, y, z] = at;
    let share = [
        y * y + z * z,
        x * x + z * z,
        x * x + y * y,
        -x * y,
        -x * z,
        -y * z,
    ];
    body.mass += mass;
    for i in 0..3 {
        body.moment[i] += mass * at[i];
    }
    for i in 0..6 {
        body.inertia[i] += mass * share[i];
    }
}
