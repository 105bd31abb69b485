//! Torques of the nominal robot along the record, and how much of the recorded torque they explain.

use pid_derive::model::{Expr, Param};
use pid_interpret::Model;
use pid_interpret::nominal::{Nominal, Role};
use pid_runtime::dynamics::{At, Dynamics, Jacobian};

use crate::criteria::Criteria;
use crate::motion::Motion;

/// Most that is taken for possible: wider tolerances say that values were guessed, and a guess is compared
/// like a value that is known to so much of it.
const RELATIVE: f64 = 0.3;
/// Likewise for centres of mass, m.
const CENTRE: f64 = 0.02;

/// The nominal robot, with gravity as three further parameters.
pub(crate) struct Bench {
    pub(crate) model: Model,
    /// Nominal values of the parameters.
    pub(crate) p: Vec<f64>,
    /// Place of the first component of gravity among them; `None` where gravity is not a number.
    pub(crate) gravity: Option<usize>,
    /// Torque per unit of input, joint by joint.
    pub(crate) gain: Vec<f64>,
    /// Deviation of each parameter that is taken for possible.
    pub(crate) widths: Vec<f64>,
}

/// Torques at the points of a motion, points × joints.
#[derive(Debug, Clone)]
pub(crate) struct Torques {
    /// Inertia, Coriolis and other forces that do not depend on the sign of the velocity, without gravity.
    pub(crate) rigid: Vec<f64>,
    /// Per unit of gravity along the axes of the base; empty if gravity is part of `rigid`.
    pub(crate) unit: Vec<Vec<f64>>,
}

impl Torques {
    /// With gravity as given.
    pub(crate) fn with(&self, gravity: [f64; 3]) -> Vec<f64> {
        let mut out = self.rigid.clone();
        for (unit, g) in self.unit.iter().zip(gravity) {
            out.iter_mut().zip(unit).for_each(|(x, y)| *x += g * y);
        }
        out
    }
}

impl Bench {
    /// Derives the robot.
    pub(crate) fn new(nominal: &Nominal) -> Result<Self, pid_interpret::Error> {
        let mut robot = nominal.robot().clone();
        let mut p: Vec<f64> = robot.params.iter().map(|p| p.nominal).collect();
        let numbers: Vec<f64> = robot
            .gravity
            .iter()
            .filter_map(|g| if let Expr::Num(g) = g { Some(*g) } else { None })
            .collect();
        let place = (numbers.len() == 3 && robot.lagrangian.is_none()).then_some(p.len());
        if let Some(place) = place {
            for (k, g) in numbers.iter().enumerate() {
                robot.params.push(Param {
                    name: format!("preflight_gravity_{}", ["x", "y", "z"][k]),
                    docs: Vec::new(),
                    unit: "m/s^2".to_owned(),
                    nominal: *g,
                    lower: f64::NEG_INFINITY,
                    upper: f64::INFINITY,
                    fixed: true,
                });
                robot.gravity[k] = Expr::Param(place + k);
                p.push(*g);
            }
        }
        let model = Model::new(&robot)?;
        let dims = model.dims();
        let (n, nu) = (dims.nq, dims.nu);
        let (q, zero) = (vec![0.3; n], vec![0.0; n]);
        let force = |u: &[f64]| {
            let mut f = vec![0.0; n];
            let at = At {
                q: &q,
                v: &zero,
                a: &zero,
                u,
                p: &p,
            };
            model.applied_force(&at, &mut f);
            f
        };
        let rest = force(&vec![0.0; nu]);
        let gain = (0..n.min(nu))
            .map(|j| {
                let mut u = vec![0.0; nu];
                u[j] = 1.0;
                force(&u)[j] - rest[j]
            })
            .collect();
        Ok(Self {
            model,
            p,
            gravity: place,
            gain,
            widths: widths(nominal),
        })
    }

    /// Stated gravity; zeros where it is no number.
    pub(crate) fn stated(&self) -> [f64; 3] {
        match self.gravity {
            Some(k) => [self.p[k], self.p[k + 1], self.p[k + 2]],
            None => [0.0; 3],
        }
    }

    /// Torques along a motion.
    pub(crate) fn torques(&self, motion: &Motion) -> Torques {
        let with = |gravity: [f64; 3]| {
            let mut p = self.p.clone();
            if let Some(k) = self.gravity {
                p[k..k + 3].copy_from_slice(&gravity);
            }
            self.rigid(motion, &p)
        };
        let rigid = with([0.0; 3]);
        let mut unit = Vec::new();
        if self.gravity.is_some() {
            for k in 0..3 {
                let mut axis = [0.0; 3];
                axis[k] = 1.0;
                let mut along = with(axis);
                along.iter_mut().zip(&rigid).for_each(|(x, y)| *x -= y);
                unit.push(along);
            }
        }
        Torques { rigid, unit }
    }

    /// Torques along a motion under the stated gravity only.
    pub(crate) fn stated_torques(&self, motion: &Motion) -> Vec<f64> {
        self.rigid(motion, &self.p)
    }

    /// `M a + b` and forces of position, points × joints: the residual without inputs, less what the
    /// velocity adds to the forces of drives and friction.
    fn rigid(&self, motion: &Motion, p: &[f64]) -> Vec<f64> {
        let n = motion.n;
        let zero = vec![0.0; n];
        let u = vec![0.0; self.model.dims().nu];
        let (mut moving, mut still) = (vec![0.0; n], vec![0.0; n]);
        let mut out = vec![0.0; motion.q.len()];
        for (i, r) in out.chunks_exact_mut(n).enumerate() {
            let row = i * n..(i + 1) * n;
            let (q, v) = (&motion.q[row.clone()], &motion.v[row.clone()]);
            let at = At {
                q,
                v,
                a: &motion.a[row],
                u: &u,
                p,
            };
            self.model.residual(&at, r);
            self.model.applied_force(&at, &mut moving);
            let at = At { v: &zero, ..at };
            self.model.applied_force(&at, &mut still);
            for j in 0..n {
                r[j] += moving[j] - still[j];
            }
        }
        out
    }

    /// Derivatives of the residual by the parameters at one state, rows × parameters, without gravity.
    pub(crate) fn by_parameters(&self, q: &[f64], v: &[f64], a: &[f64], out: &mut [f64]) {
        let dims = self.model.dims();
        let u = vec![0.0; dims.nu];
        let pattern = self.model.jacobian_pattern();
        let (mut r, mut values) = (vec![0.0; dims.nq], vec![0.0; pattern.nnz()]);
        let at = At {
            q,
            v,
            a,
            u: &u,
            p: &self.p,
        };
        self.model.residual_jacobian(&at, &mut r, &mut values);
        let np = self.gravity.unwrap_or(dims.np);
        out.fill(0.0);
        for ((&row, &col), value) in pattern.rows.iter().zip(pattern.cols).zip(&values) {
            let Some(k) = (col as usize).checked_sub(dims.p()) else {
                continue;
            };
            if k < np {
                out[row as usize * np + k] = *value;
            }
        }
    }
}

/// How a torque is explained.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fit {
    /// Share of the mean square of the torque that is left.
    pub(crate) left: f64,
    /// Factors: torque of the robot, dry friction, viscous friction, constant.
    pub(crate) x: [f64; 4],
    /// Root mean square of the torque.
    pub(crate) size: f64,
}

/// Sums of products of four columns with each other, with a torque, and of the torque with itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    pub(crate) xx: [[f64; 4]; 4],
    pub(crate) xy: [f64; 4],
    pub(crate) yy: f64,
    pub(crate) count: f64,
}

impl Sums {
    pub(crate) fn add(&mut self, x: [f64; 4], y: f64) {
        for i in 0..4 {
            for j in 0..4 {
                self.xx[i][j] += x[i] * x[j];
            }
            self.xy[i] += x[i] * y;
        }
        self.yy += y * y;
        self.count += 1.0;
    }

    /// Least squares with bounds: friction is not negative, the constant is small, the factor of the robot's
    /// torque is within bounds (coordinate descent; the quadratic is convex, so it converges).
    pub(crate) fn fit(&self, factor: (f64, f64), offset: f64) -> Fit {
        let size = (self.yy / self.count.max(1.0)).sqrt();
        let bounds = [
            factor,
            (0.0, f64::INFINITY),
            (0.0, f64::INFINITY),
            (-offset * size, offset * size),
        ];
        let mut x = [0.0; 4];
        x[0] = 1.0_f64.clamp(factor.0, factor.1);
        for _ in 0..200 {
            let mut change: f64 = 0.0;
            for i in 0..4 {
                if self.xx[i][i] <= 0.0 {
                    continue;
                }
                let others: f64 = (0..4)
                    .filter(|&k| k != i)
                    .map(|k| self.xx[i][k] * x[k])
                    .sum();
                let new = ((self.xy[i] - others) / self.xx[i][i]).clamp(bounds[i].0, bounds[i].1);
                change = change.max((new - x[i]).abs() * self.xx[i][i].sqrt());
                x[i] = new;
            }
            if change < 1e-6 * self.yy.sqrt() {
                break;
            }
        }
        let mut left = self.yy;
        for i in 0..4 {
            left -= 2.0 * x[i] * self.xy[i];
            for j in 0..4 {
                left += x[i] * x[j] * self.xx[i][j];
            }
        }
        let left = if self.yy > 0.0 {
            (left / self.yy).max(0.0)
        } else {
            1.0
        };
        Fit { left, x, size }
    }
}

/// Columns beside the torque of the robot: sign of the velocity, smoothed, and velocity.
pub(crate) fn friction(motion: &Motion, j: usize) -> Vec<[f64; 2]> {
    let square: f64 = motion.column(&motion.v, j).map(|v| v * v).sum();
    let scale = (square / motion.len().max(1) as f64).sqrt().max(1e-9);
    // The sign turns within 5 % of the usual speed: filtered reversals are no sharper.
    let sign = |v: f64| (v / (0.05 * scale)).tanh();
    motion.column(&motion.v, j).map(|v| [sign(v), v]).collect()
}

/// The fit of a recorded torque by the torque of the robot at one joint.
pub(crate) fn fit(
    rigid: impl Iterator<Item = f64>,
    friction: &[[f64; 2]],
    torque: impl Iterator<Item = f64>,
    criteria: &Criteria,
) -> Fit {
    sums(rigid, friction, torque).fit(criteria.rigid_factor, criteria.offset)
}

/// The sums behind a fit.
pub(crate) fn sums(
    rigid: impl Iterator<Item = f64>,
    friction: &[[f64; 2]],
    torque: impl Iterator<Item = f64>,
) -> Sums {
    let mut sums = Sums::default();
    for ((r, [c, v]), y) in rigid.zip(friction).zip(torque) {
        if r.is_finite() && y.is_finite() && v.is_finite() {
            sums.add([r, *c, *v, 1.0], y);
        }
    }
    sums
}

/// Deviation of each parameter of a description that is taken for possible; friction is fitted anyway.
fn widths(nominal: &Nominal) -> Vec<f64> {
    let width = |t: &pid_interpret::nominal::Tolerance| match t.role {
        Role::CenterOfMass(_) => t.half_width.min(CENTRE),
        Role::Coulomb | Role::Viscous | Role::Gain | Role::Sharpness => 0.0,
        // Products of inertia are zero often, their tolerance refers to the moments.
        Role::Inertia(k) if k > 2 => t.half_width,
        _ => t.half_width.min(RELATIVE * t.nominal.abs()),
    };
    nominal.tolerances().iter().map(width).collect()
}
