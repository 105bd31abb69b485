//! Rigid chain over any [`Scalar`]: mass matrix by composite bodies, bias forces by the recursive Newton-Euler algorithm
//! (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, tables 5.1 and 6.2, written with 3-vectors in link frames).

use crate::scalar::Scalar;

/// Three components.
pub type V3<D> = [D; 3];
pub(crate) type M3<D> = [[D; 3]; 3];

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
fn add<D: Scalar>(a: V3<D>, b: V3<D>) -> V3<D> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
#[inline(always)]
fn cross<D: Scalar>(a: V3<D>, b: V3<D>) -> V3<D> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
#[inline(always)]
fn dot<D: Scalar>(a: V3<D>, b: V3<f64>) -> D {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
#[inline(always)]
fn scale<D: Scalar>(a: V3<f64>, x: D) -> V3<D> {
    [x * a[0], x * a[1], x * a[2]]
}
#[inline(always)]
fn times<D: Scalar>(a: V3<D>, x: D) -> V3<D> {
    [a[0] * x, a[1] * x, a[2] * x]
}
#[inline(always)]
fn lift<D: Scalar>(a: V3<f64>) -> V3<D> {
    [D::constant(a[0]), D::constant(a[1]), D::constant(a[2])]
}
#[inline(always)]
fn turn<D: Scalar>(r: &M3<D>, a: V3<D>) -> V3<D> {
    [
        r[0][0] * a[0] + r[0][1] * a[1] + r[0][2] * a[2],
        r[1][0] * a[0] + r[1][1] * a[1] + r[1][2] * a[2],
        r[2][0] * a[0] + r[2][1] * a[1] + r[2][2] * a[2],
    ]
}
#[inline(always)]
fn turn_back<D: Scalar>(r: &M3<D>, a: V3<D>) -> V3<D> {
    [
        r[0][0] * a[0] + r[1][0] * a[1] + r[2][0] * a[2],
        r[0][1] * a[0] + r[1][1] * a[1] + r[2][1] * a[2],
        r[0][2] * a[0] + r[1][2] * a[1] + r[2][2] * a[2],
    ]
}
#[inline(always)]
fn symmetric<D: Scalar>(i: &[D; 6], a: V3<D>) -> V3<D> {
    [
        i[0] * a[0] + i[3] * a[1] + i[4] * a[2],
        i[3] * a[0] + i[1] * a[1] + i[5] * a[2],
        i[4] * a[0] + i[5] * a[1] + i[2] * a[2],
    ]
}

impl Hinge {
    /// Rotation from the link's frame to the parent's.
    #[inline(always)]
    fn rotation_at<D: Scalar>(&self, q: D) -> M3<D> {
        let base = &self.rotation;
        if !self.revolute {
            return [lift(base[0]), lift(base[1]), lift(base[2])];
        }
        // R0 (E + sin q K + (1 - cos q) K K) as R0 a aᵀ + cos q R0 (E - a aᵀ) + sin q R0 K.
        let (s, c) = (q.sine(), q.cosine());
        let a = self.axis;
        let k = [[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]];
        let mut out = [[D::nil(); 3]; 3];
        for i in 0..3 {
            let along = base[i][0] * a[0] + base[i][1] * a[1] + base[i][2] * a[2];
            for j in 0..3 {
                let p = along * a[j];
                let r = base[i][0] * k[0][j] + base[i][1] * k[1][j] + base[i][2] * k[2][j];
                out[i][j] = c * (base[i][j] - p) + s * r + p;
            }
        }
        out
    }
}

/// Room for one evaluation.
#[derive(Debug, Clone)]
pub struct Workspace<D> {
    rotation: Vec<M3<D>>,
    arm: Vec<V3<D>>,
    force: Vec<V3<D>>,
    torque: Vec<V3<D>>,
    composite: Vec<Body<D>>,
}

impl<D: Scalar> Workspace<D> {
    /// For a chain of `n` links.
    pub fn new(n: usize) -> Self {
        let zero = [D::nil(); 3];
        Workspace {
            rotation: vec![[zero; 3]; n],
            arm: vec![zero; n],
            force: vec![zero; n],
            torque: vec![zero; n],
            composite: vec![
                Body {
                    mass: D::nil(),
                    moment: zero,
                    inertia: [D::nil(); 6],
                };
                n
            ],
        }
    }
}

/// What the chain is subject to beside its drives.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<D> {
    /// Acceleration of gravity in base axes, m/s².
    pub gravity: V3<D>,
    /// A force on the last link, in base axes, N.
    pub tip_force: Option<V3<D>>,
    /// Where it acts, in the last link's frame, m.
    pub tool: V3<f64>,
}

/// `M(q)` (full, row by row, n × n) and `b(q, v)`, the torque at zero acceleration.
///
/// Lengths: `hinges`, `bodies`, `q`, `v`, `bias`: n; `mass`: n².
#[inline(always)]
pub fn mass_and_bias<D: Scalar>(
    hinges: &[Hinge],
    bodies: &[Body<D>],
    around: &Surroundings<D>,
    (q, v): (&[D], &[D]),
    work: &mut Workspace<D>,
    mass: &mut [D],
    bias: &mut [D],
) {
    let n = hinges.len();
    let zero = [D::nil(); 3];
    let (mut w, mut al, mut acc) = (zero, zero, around.gravity.map(|g| -g));
    let mut push = around.tip_force;
    for k in 0..n {
        let (hinge, body) = (&hinges[k], &bodies[k]);
        let r = hinge.rotation_at(q[k]);
        let mut arm: V3<D> = lift(hinge.origin);
        if !hinge.revolute {
            let direction = [0, 1, 2].map(|i| {
                hinge.rotation[i][0] * hinge.axis[0]
                    + hinge.rotation[i][1] * hinge.axis[1]
                    + hinge.rotation[i][2] * hinge.axis[2]
            });
            arm = add(arm, scale(direction, q[k]));
        }
        let at = add(acc, add(cross(al, arm), cross(w, cross(w, arm))));
        let (wp, alp) = (turn_back(&r, w), turn_back(&r, al));
        acc = turn_back(&r, at);
        let rate = scale(hinge.axis, v[k]);
        if hinge.revolute {
            w = add(wp, rate);
            al = add(alp, cross(wp, rate));
        } else {
            w = wp;
            al = alp;
            let c = cross(wp, rate);
            acc = add(acc, add(c, c));
        }
        let (h, m) = (body.moment, body.mass);
        work.force[k] = add(times(acc, m), add(cross(al, h), cross(w, cross(w, h))));
        work.torque[k] = add(
            symmetric(&body.inertia, al),
            add(cross(w, symmetric(&body.inertia, w)), cross(h, acc)),
        );
        if let Some(f) = push {
            let f = turn_back(&r, f);
            push = Some(f);
            if k + 1 == n {
                let t = cross(lift(around.tool), f);
                for i in 0..3 {
                    work.force[k][i] -= f[i];
                    work.torque[k][i] -= t[i];
                }
            }
        }
        work.rotation[k] = r;
        work.arm[k] = arm;
        work.composite[k] = *body;
    }
    for k in (0..n).rev() {
        let hinge = &hinges[k];
        bias[k] = if hinge.revolute {
            dot(work.torque[k], hinge.axis)
        } else {
            dot(work.force[k], hinge.axis)
        };
        let own = work.composite[k];
        // The force and torque that accelerate the composite body by one unit of joint k, then carried towards the base.
        let (mut f, mut t) = if hinge.revolute {
            let a = lift(hinge.axis);
            (cross(a, own.moment), symmetric(&own.inertia, a))
        } else {
            let a: V3<D> = lift(hinge.axis);
            (times(a, own.mass), cross(own.moment, a))
        };
        mass[k * n + k] = if hinge.revolute {
            dot(t, hinge.axis)
        } else {
            dot(f, hinge.axis)
        };
        for p in (0..k).rev() {
            let r = &work.rotation[p + 1];
            f = turn(r, f);
            t = add(turn(r, t), cross(work.arm[p + 1], f));
            let entry = if hinges[p].revolute {
                dot(t, hinges[p].axis)
            } else {
                dot(f, hinges[p].axis)
            };
            mass[k * n + p] = entry;
            mass[p * n + k] = entry;
        }
        if k > 0 {
            let (r, arm) = (work.rotation[k], work.arm[k]);
            let force = turn(&r, work.force[k]);
            let torque = add(turn(&r, work.torque[k]), cross(arm, force));
            work.force[k - 1] = add(work.force[k - 1], force);
            work.torque[k - 1] = add(work.torque[k - 1], torque);
            join(&mut work.composite[k - 1], &own, &r, arm);
        }
    }
}

/// Adds a body to its parent: rotated by `r`, then moved by `arm`.
#[inline(always)]
fn join<D: Scalar>(parent: &mut Body<D>, child: &Body<D>, r: &M3<D>, arm: V3<D>) {
    let h = turn(r, child.moment);
    let i = &child.inertia;
    let full = [[i[0], i[3], i[4]], [i[3], i[1], i[5]], [i[4], i[5], i[2]]];
    let columns = [turn(r, full[0]), turn(r, full[1]), turn(r, full[2])]; // rows of I Rᵀ, I symmetric: columns[j] = R I e_j
    let entry = |a: usize, b: usize| {
        // (R I Rᵀ)_ab = Σ_j R_bj (R I e_j)_a
        columns[0][a] * r[b][0] + columns[1][a] * r[b][1] + columns[2][a] * r[b][2]
    };
    // ∫ (x + s)ᵀ(x + s) E − (x + s)(x + s)ᵀ dm = I + 2 h·s E − h sᵀ − s hᵀ + m (s·s E − s sᵀ).
    let m = child.mass;
    let d = (h[0] * arm[0] + h[1] * arm[1] + h[2] * arm[2]) * 2.0
        + m * (arm[0].square() + arm[1].square() + arm[2].square());
    let shift = |a: usize, b: usize| {
        let off = h[a] * arm[b] + arm[a] * h[b] + m * arm[a] * arm[b];
        if a == b { d - off } else { -off }
    };
    for (slot, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
        .into_iter()
        .enumerate()
    {
        parent.inertia[slot] += entry(a, b) + shift(a, b);
    }
    for a in 0..3 {
        parent.moment[a] += h[a] + m * arm[a];
    }
    parent.mass += m;
}

/// Adds a point mass at `at` (link frame) to a body.
pub fn add_point<D: Scalar>(body: &mut Body<D>, mass: D, at: V3<f64>) {
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
