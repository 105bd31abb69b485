//! Mass matrix and bias forces of a tree of links, in frames whose third axis is the hinge's.
//!
//! The same algorithms as in R. Featherstone, Rigid Body Dynamics Algorithms, 2008, tables 5.1
//! (recursive Newton-Euler) and 6.2 (composite bodies), with 3-vectors. In these frames a hinge
//! turns two components and leaves the third, the axis picks one component, and links that do not
//! rotate or rotate about their own axis alone lose most of their terms.

use std::ops::Mul;

use crate::rigid::{Body, Hinge, M3, Number, V3, add, cross, times};

/// Three components, each by its own expression: `map` is not inlined in the large kernels.
macro_rules! three {
    ($i:ident => $component:expr) => {
        [
            {
                let $i = 0_usize;
                $component
            },
            {
                let $i = 1_usize;
                $component
            },
            {
                let $i = 2_usize;
                $component
            },
        ]
    };
}

/// What the links are subject to beside its drives.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<D> {
    /// Acceleration of gravity in base axes, m/s².
    pub gravity: V3<D>,
    /// A force on the tool point, in base axes, N.
    pub tip_force: Option<V3<D>>,
}

/// How a link can rotate in space.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rotation {
    /// Not at all.
    Still,
    /// About the third axis of its frame.
    Planar,
    /// In any way.
    General,
}

/// Constant rotation from the frame of a link at q = 0 to its parent's.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mount {
    /// None: the axes of both hinges are parallel.
    Same,
    /// Half a turn about the first axis: they are opposite.
    Opposite,
    /// Any other.
    Turned(M3<f64>),
}

/// One link.
#[derive(Debug, Clone)]
struct Link<D> {
    parent: Option<usize>,
    /// Whether the last link is this one or hangs on it.
    carries_tool: bool,
    revolute: bool,
    rotation: Rotation,
    mount: Mount,
    /// Position in the parent's frame at q = 0, m.
    arm: V3<f64>,
    body: Body<D>,
    /// Sine and cosine of the coordinate of a revolute hinge, or the coordinate of a slide and 0.
    at: (D, D),
    motion: Motion<D>,
    force: V3<D>,
    torque: V3<D>,
    composite: Body<D>,
}

/// How a link moves without acceleration of the hinges.
#[derive(Debug, Clone, Copy)]
struct Motion<D> {
    /// Angular velocity.
    w: V3<D>,
    /// Its rate of change.
    al: V3<D>,
    /// Acceleration of the frame's origin, less gravity.
    acc: V3<D>,
}

/// A tree of links, ready to be evaluated.
#[derive(Debug, Clone)]
pub struct Linkage<D> {
    links: Vec<Link<D>>,
    /// Where a force on the tool acts, in the last link's frame, m.
    tool: V3<f64>,
}

/// Largest deviation of an axis from another to count as parallel: rounding of the sine and cosine
/// of a right angle.
const PARALLEL: f64 = 1e-12;

impl<D: Number> Linkage<D> {
    /// From hinges and bodies (one each per link) and the tool point in the last link's frame, m.
    pub fn new(hinges: &[Hinge], bodies: &[Body<D>], tool: V3<f64>) -> Self {
        let base = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        // Rotations from the frames used here to the links' own.
        let mut frames: Vec<M3<f64>> = Vec::with_capacity(hinges.len());
        let mut links: Vec<Link<D>> = Vec::with_capacity(hinges.len());
        for (hinge, body) in hinges.iter().zip(bodies) {
            let (outer, rotation) = hinge
                .parent
                .map_or((base, Rotation::Still), |p| (frames[p], links[p].rotation));
            let home = product(&transposed(&outer), &hinge.rotation);
            let [x, y, z] = turned(&home, hinge.axis);
            let (frame, mount) = if x.abs().max(y.abs()) > PARALLEL {
                let own = frame_about(hinge.axis);
                (own, Mount::Turned(product(&home, &own)))
            } else if z > 0.0 {
                (transposed(&home), Mount::Same)
            } else {
                let half_turn = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
                (product(&transposed(&home), &half_turn), Mount::Opposite)
            };
            let body = seen(body, &frame);
            let zero = [D::from(0.0); 3];
            links.push(Link {
                parent: hinge.parent,
                carries_tool: false,
                revolute: hinge.revolute,
                rotation: match (rotation, hinge.revolute, mount) {
                    (Rotation::Still, false, _) => Rotation::Still,
                    (Rotation::Still, true, _) => Rotation::Planar,
                    (Rotation::Planar, _, Mount::Same | Mount::Opposite) => Rotation::Planar,
                    _ => Rotation::General,
                },
                mount,
                arm: turned_back(&outer, hinge.origin),
                body,
                at: (D::from(0.0), D::from(0.0)),
                motion: Motion {
                    w: zero,
                    al: zero,
                    acc: zero,
                },
                force: zero,
                torque: zero,
                composite: body,
            });
            frames.push(frame);
        }
        let mut next = links.len().checked_sub(1);
        while let Some(k) = next {
            links[k].carries_tool = true;
            next = links[k].parent;
        }
        Linkage {
            links,
            tool: frames.last().map_or(tool, |frame| turned_back(frame, tool)),
        }
    }

    /// `M(q)` (full, row by row, n × n) and `b(q, v)`, the torque at zero acceleration.
    ///
    /// Lengths: `q`, `v`, `bias`: n; `mass`: n².
    #[inline(always)]
    pub fn mass_and_bias(
        &mut self,
        around: &Surroundings<D>,
        (q, v): (&[D], &[D]),
        mass: &mut [D],
        bias: &mut [D],
    ) {
        self.outwards(around, q, v);
        self.inwards(mass, bias);
    }

    /// Forces on every link that move it as the hinges do without acceleration.
    #[inline(always)]
    fn outwards(&mut self, around: &Surroundings<D>, q: &[D], v: &[D]) {
        let zero = [D::from(0.0); 3];
        let base = Motion {
            w: zero,
            al: zero,
            acc: three!(i => -around.gravity[i]),
        };
        let mut push = around.tip_force;
        let n = self.links.len();
        for k in 0..n {
            let (before, rest) = self.links.split_at_mut(k);
            let link = &mut rest[0];
            let (outer, Motion { mut w, mut al, acc }) = match link.parent {
                Some(p) => (before[p].rotation, before[p].motion),
                None => (Rotation::Still, base),
            };
            let acc = if link.revolute {
                link.at = q[k].sin_cos();
                carried(outer, acc, w, al, link.arm)
            } else {
                link.at = (q[k], D::from(0.0));
                carried(outer, acc, w, al, link.reach())
            };
            let mut acc = link.back(acc);
            match link.rotation {
                Rotation::Still => {}
                Rotation::Planar => {
                    if outer == Rotation::Planar && link.mount == Mount::Opposite {
                        w[2] = -w[2];
                    }
                    if link.revolute {
                        w[2] += v[k];
                    }
                }
                Rotation::General => {
                    w = link.back(w);
                    al = link.back(al);
                    let (x, y) = (w[1] * v[k], -(w[0] * v[k]));
                    if link.revolute {
                        al[0] += x;
                        al[1] += y;
                        w[2] += v[k];
                    } else {
                        acc[0] += x + x;
                        acc[1] += y + y;
                    }
                }
            }
            link.motion = Motion { w, al, acc };
            link.balance();
            if let Some(f) = push.filter(|_| link.carries_tool) {
                let f = link.back(f);
                push = Some(f);
                if k + 1 == n {
                    let t = cross_fixed(self.tool, f);
                    for i in 0..3 {
                        link.force[i] -= f[i];
                        link.torque[i] -= t[i];
                    }
                }
            }
            link.composite = link.body;
        }
    }

    /// Gathers forces and composite bodies from the tips to the base.
    #[inline(always)]
    fn inwards(&mut self, mass: &mut [D], bias: &mut [D]) {
        let n = self.links.len();
        for k in (0..n).rev() {
            let (before, rest) = self.links.split_at_mut(k);
            let link = &rest[0];
            bias[k] = link.along(link.force, link.torque);
            // The force and torque that accelerate the composite body by one unit of joint k, then
            // carried towards the base.
            let (h, i) = (link.composite.moment, &link.composite.inertia);
            let (mut f, mut t) = if link.revolute {
                mass[k * n + k] = i[2];
                ([-h[1], h[0], D::from(0.0)], [i[4], i[5], i[2]])
            } else {
                let m = link.composite.mass;
                mass[k * n + k] = m;
                ([D::from(0.0), D::from(0.0), m], [h[1], -h[0], D::from(0.0)])
            };
            let mut child = link;
            for p in (0..k).rev() {
                let entry = if child.parent == Some(p) {
                    (f, t) = child.towards_base(f, t);
                    child = &before[p];
                    child.along(f, t)
                } else {
                    // Another branch.
                    D::from(0.0)
                };
                mass[k * n + p] = entry;
                mass[p * n + k] = entry;
            }
            if let Some(p) = link.parent {
                let parent = &mut before[p];
                let (f, t) = link.towards_base(link.force, link.torque);
                if parent.parent.is_some() {
                    parent.force = add(parent.force, f);
                    parent.torque = add(parent.torque, t);
                    link.join(&mut parent.composite);
                } else {
                    // Of a link on the base only what its hinge feels counts.
                    let felt = parent.along(f, t);
                    if parent.revolute {
                        parent.torque[2] += felt;
                    } else {
                        parent.force[2] += felt;
                    }
                    link.join_root(parent);
                }
            }
        }
    }
}

impl<D: Number> Link<D> {
    /// Position in the parent's frame, for a slide.
    #[inline(always)]
    fn reach(&self) -> V3<D> {
        let a = self.arm;
        let q = self.at.0;
        match &self.mount {
            Mount::Same => [D::from(a[0]), D::from(a[1]), q + a[2]],
            Mount::Opposite => [D::from(a[0]), D::from(a[1]), -q + a[2]],
            Mount::Turned(r) => three!(i => q * r[i][2] + a[i]),
        }
    }

    /// A vector of the parent's frame in this one.
    #[inline(always)]
    fn back(&self, x: V3<D>) -> V3<D> {
        let x = match &self.mount {
            Mount::Same => x,
            Mount::Opposite => [x[0], -x[1], -x[2]],
            Mount::Turned(r) => three!(i => x[0] * r[0][i] + x[1] * r[1][i] + x[2] * r[2][i]),
        };
        if !self.revolute {
            return x;
        }
        let (s, c) = self.at;
        [c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]]
    }

    /// A vector of this frame in the parent's.
    #[inline(always)]
    fn forth(&self, x: V3<D>) -> V3<D> {
        let x = if self.revolute {
            let (s, c) = self.at;
            [c * x[0] - s * x[1], s * x[0] + c * x[1], x[2]]
        } else {
            x
        };
        match &self.mount {
            Mount::Same => x,
            Mount::Opposite => [x[0], -x[1], -x[2]],
            Mount::Turned(r) => three!(i => x[0] * r[i][0] + x[1] * r[i][1] + x[2] * r[i][2]),
        }
    }

    /// The force and the torque that move the body as the link moves.
    #[inline(always)]
    fn balance(&mut self) {
        let Motion { w, al, acc } = self.motion;
        let (h, i, m) = (self.body.moment, &self.body.inertia, self.body.mass);
        self.force = times(acc, m);
        self.torque = cross(h, acc);
        match self.rotation {
            Rotation::Still => {}
            Rotation::Planar => {
                let square = w[2] * w[2];
                self.force[0] -= square * h[0];
                self.force[1] -= square * h[1];
                self.torque[0] -= square * i[5];
                self.torque[1] += square * i[4];
            }
            Rotation::General => {
                self.force = add(self.force, add(cross(al, h), cross(w, cross(w, h))));
                let own = add(symmetric(i, al), cross(w, symmetric(i, w)));
                self.torque = add(self.torque, own);
            }
        }
    }

    /// A force at this frame's origin and a torque, as they act at the parent's.
    #[inline(always)]
    fn towards_base(&self, f: V3<D>, t: V3<D>) -> (V3<D>, V3<D>) {
        let (f, t) = (self.forth(f), self.forth(t));
        let lever = if self.revolute {
            cross_fixed(self.arm, f)
        } else {
            cross(self.reach(), f)
        };
        (f, add(t, lever))
    }

    /// What the hinge of this link feels of a force and a torque.
    #[inline(always)]
    fn along(&self, f: V3<D>, t: V3<D>) -> D {
        if self.revolute { t[2] } else { f[2] }
    }

    /// The composite body, turned into the parent's axes.
    #[inline(always)]
    fn unturned(&self) -> (V3<D>, [D; 6]) {
        let body = &self.composite;
        let moment = self.forth(body.moment);
        let mut i = body.inertia;
        if self.revolute {
            let (s, c) = self.at;
            let (cc, cs) = (c * c, c * s);
            let difference = i[0] - i[1];
            let sum = i[0] + i[1];
            let xx = i[1] + cc * difference - cs * i[3] * 2.0;
            i = [
                xx,
                sum - xx,
                i[2],
                cs * difference + (cc * 2.0 - 1.0) * i[3],
                c * i[4] - s * i[5],
                s * i[4] + c * i[5],
            ];
        }
        match &self.mount {
            Mount::Same => {}
            Mount::Opposite => {
                i[3] = -i[3];
                i[4] = -i[4];
            }
            Mount::Turned(r) => i = rotated(&i, r),
        }
        (moment, i)
    }

    /// Adds the composite body to that of the parent.
    #[inline(always)]
    fn join(&self, parent: &mut Body<D>) {
        let (h, i) = self.unturned();
        let m = self.composite.mass;
        let (moment, shift) = if self.revolute {
            shifted(h, m, self.arm)
        } else {
            shifted(h, m, self.reach())
        };
        for a in 0..6 {
            parent.inertia[a] += i[a] + shift[a];
        }
        parent.moment = add(parent.moment, moment);
        parent.mass += m;
    }

    /// Adds to the composite body of a link on the base what its hinge feels of this one's.
    #[inline(always)]
    fn join_root(&self, root: &mut Link<D>) {
        if !root.revolute {
            root.composite.mass += self.composite.mass;
        } else if self.revolute && !matches!(self.mount, Mount::Turned(_)) {
            let body = &self.composite;
            let h = self.forth(body.moment);
            let (_, shift) = shifted(h, body.mass, self.arm);
            root.composite.inertia[2] += body.inertia[2] + shift[2];
        } else {
            self.join(&mut root.composite);
        }
    }
}

/// Acceleration of a point at `arm` of a link that rotates so.
#[inline(always)]
fn carried<D: Number + Mul<A, Output = D>, A: Copy>(
    rotation: Rotation,
    acc: V3<D>,
    w: V3<D>,
    al: V3<D>,
    arm: V3<A>,
) -> V3<D> {
    let by = |x: V3<D>| {
        [
            x[1] * arm[2] - x[2] * arm[1],
            x[2] * arm[0] - x[0] * arm[2],
            x[0] * arm[1] - x[1] * arm[0],
        ]
    };
    match rotation {
        Rotation::Still => acc,
        Rotation::Planar => {
            let square = w[2] * w[2];
            [acc[0] - square * arm[0], acc[1] - square * arm[1], acc[2]]
        }
        Rotation::General => add(acc, add(by(al), cross(w, by(w)))),
    }
}

/// First moment of a body after a shift by `s`, and what the shift adds to its inertia:
/// `∫ |x + s|² E − (x + s)(x + s)ᵀ dm − I`.
#[inline(always)]
fn shifted<D: Number + Mul<A, Output = D>, A: Copy>(h: V3<D>, m: D, s: V3<A>) -> (V3<D>, [D; 6]) {
    let moved = three!(a => h[a] + m * s[a]);
    let e = three!(a => (h[a] + moved[a]) * s[a]);
    let shift = [
        e[1] + e[2],
        e[0] + e[2],
        e[0] + e[1],
        -(h[0] * s[1] + moved[1] * s[0]),
        -(h[0] * s[2] + moved[2] * s[0]),
        -(h[1] * s[2] + moved[2] * s[1]),
    ];
    (moved, shift)
}

#[inline(always)]
fn cross_fixed<D: Number>(a: V3<f64>, b: V3<D>) -> V3<D> {
    [
        b[2] * a[1] - b[1] * a[2],
        b[0] * a[2] - b[2] * a[0],
        b[1] * a[0] - b[0] * a[1],
    ]
}

#[inline(always)]
fn symmetric<D: Number>(i: &[D; 6], a: V3<D>) -> V3<D> {
    [
        i[0] * a[0] + i[3] * a[1] + i[4] * a[2],
        i[3] * a[0] + i[1] * a[1] + i[5] * a[2],
        i[4] * a[0] + i[5] * a[1] + i[2] * a[2],
    ]
}

/// `R I Rᵀ`.
#[inline(always)]
fn rotated<D: Number>(i: &[D; 6], r: &M3<f64>) -> [D; 6] {
    let full = [[i[0], i[3], i[4]], [i[3], i[1], i[5]], [i[4], i[5], i[2]]];
    // Columns R I e_j.
    let c = three!(k => {
        let row = &full[k];
        three!(a => row[0] * r[a][0] + row[1] * r[a][1] + row[2] * r[a][2])
    });
    let x = three!(a => c[0][a] * r[0][0] + c[1][a] * r[0][1] + c[2][a] * r[0][2]);
    let y = three!(a => c[0][a] * r[1][0] + c[1][a] * r[1][1] + c[2][a] * r[1][2]);
    let z = three!(a => c[0][a] * r[2][0] + c[1][a] * r[2][1] + c[2][a] * r[2][2]);
    [x[0], y[1], z[2], y[0], z[0], z[1]]
}

/// A body of a link's own frame in the one that `frame` turns into it.
fn seen<D: Number>(body: &Body<D>, frame: &M3<f64>) -> Body<D> {
    let back = transposed(frame);
    let h = body.moment;
    Body {
        mass: body.mass,
        moment: back.map(|row| h[0] * row[0] + h[1] * row[1] + h[2] * row[2]),
        inertia: rotated(&body.inertia, &back),
    }
}

/// A rotation whose third column is a unit axis; axes of coordinates give permutations.
fn frame_about(axis: V3<f64>) -> M3<f64> {
    let least = (0..3)
        .min_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs()))
        .unwrap_or(0);
    let mut x = [0.0; 3];
    x[least] = 1.0;
    for (x, a) in x.iter_mut().zip(axis) {
        *x -= axis[least] * a;
    }
    let length = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let x = x.map(|c| c / length);
    let y = cross(axis, x);
    [0, 1, 2].map(|i| [x[i], y[i], axis[i]])
}

fn transposed(r: &M3<f64>) -> M3<f64> {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| r[j][i]))
}

fn product(a: &M3<f64>, b: &M3<f64>) -> M3<f64> {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn turned(r: &M3<f64>, x: V3<f64>) -> V3<f64> {
    r.map(|row| row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
}

fn turned_back(r: &M3<f64>, x: V3<f64>) -> V3<f64> {
    turned(&transposed(r), x)
}
