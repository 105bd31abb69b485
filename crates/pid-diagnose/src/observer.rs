//! Steady-state Kalman gains of one joint: how an innovation corrects the predicted state.
//!
//! Drive side alone, or rotor and link with a gear between them, `x = (q, v)` or
//! `(q_m, v_m, q_l, v_l)`; with the integral of a position loop, `dz/dt = −kᵀ (q, v)`, and behind a velocity
//! reading that lags, `w⁺ = a w + (1 − a) v⁺`, these states too; linear:
//!
//! ```text
//! x⁺ = A x + w,   w from torque noise held over a sample,   y = q (and v) + noise
//! P = A (P − P Cᵀ S⁻¹ C P) Aᵀ + Q,   S = C P Cᵀ + R,   K = P Cᵀ S⁻¹
//! ```
//!
//! (B. D. O. Anderson, J. B. Moore, Optimal Filtering, 1979, chapter 4). The predictor is
//! consistent with any gain; this one makes its innovations nearly white where model and noise
//! levels are right, which is what their weights rest on.

use nalgebra::{DMatrix, Matrix2};

/// What the gain is designed for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Design {
    /// Sample time, s.
    pub h: f64,
    /// Rotor inertia where there is a gear, all of it otherwise.
    pub inertia: f64,
    /// Viscous friction.
    pub viscous: f64,
    /// Link inertia, stiffness and damping of the gear; encoder on the link side.
    pub gear: Option<(f64, f64, f64, bool)>,
    /// By how much a position loop of the drive lowers its torque per unit of the position and of the
    /// velocity that the encoder reads.
    pub servo: (f64, f64),
    /// The integral of that loop, if it has one.
    pub integral: Option<Integral>,
    /// Standard deviation of the torque of its own drive.
    pub torque: f64,
    /// Of the torque that the noise of the other drives amounts to, on the link.
    pub passed: f64,
    /// Of a position reading.
    pub q: f64,
    /// Of a velocity reading, if there is one.
    pub v: Option<f64>,
    /// Time constant of a lag of the velocity reading.
    pub lag: Option<f64>,
}

/// The integral of a position loop, in torque.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Integral {
    /// By how much it falls in a second per unit of the position and of the velocity that the encoder reads.
    pub falls: [f64; 2],
    /// Standard deviation of what else it does in a sample.
    pub strays: f64,
}

/// States that are corrected; see [`Gain::rows`].
pub(crate) const ROWS: usize = 6;
/// Row of the lagging velocity.
pub(crate) const LAGGING: usize = 4;
/// Row of the integral of a position loop.
pub(crate) const INTEGRAL: usize = 5;

/// Gain of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Corrections of `(q_m, v_m, q_l, v_l)`, of the lagging velocity and of the integral of a position loop (in
    /// what dry friction holds) per unit of position innovation and velocity innovation.
    pub rows: [[f64; 2]; ROWS],
    /// The same shortly after a loop came to the limit of its output or left it.
    pub stirred: [[f64; 2]; ROWS],
    /// Inverse of the lower Cholesky factor of S: whitens (position, velocity) innovations.
    pub whiten: [[f64; 2]; 2],
    /// How far the states that no sensor reads are from rest at the start: position and velocity of
    /// the side of the gear without encoder, memory of a bristle, part of the integral of a position
    /// loop in what dry friction holds. Zero unless they were looked for.
    pub hidden: [f64; 4],
    /// Whether the covariance it rests on has settled; it does not where the sensors do not see a state.
    pub settled: bool,
}

impl Design {
    /// Number of states before readings lag.
    fn size(&self) -> usize {
        let moving = if self.gear.is_some() { 4 } else { 2 };
        moving + usize::from(self.integral.is_some())
    }
}

/// Most doublings of [`steady_covariance`]: 2¹⁶ samples, minutes at the usual rates. A state whose
/// covariance still grows then is not seen by the sensors.
const DOUBLINGS: usize = 16;
/// Change of the covariance, relative to its diagonal, at which it has settled. Doubling converges
/// quadratically: the next change is below rounding.
const SETTLED: f64 = 1e-9;

/// Covariance P of the predicted state in steady state, and whether it has settled: the recursion
/// above from P = 0, two, four, eight … samples at a time,
///
/// ```text
/// W = (I + G H)⁻¹,   A⁺ = A W A,   G⁺ = G + A W G Aᵀ,   H⁺ = H + Aᵀ H W A,   H → P,
/// ```
///
/// from the transposed step, `G = Cᵀ R⁻¹ C` and `H = Q` (E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, C.-S.
/// Wang, Structure-Preserving Algorithms for Periodic Discrete-Time Algebraic Riccati Equations,
/// International Journal of Control 77, 2004, with period one).
fn steady_covariance(
    step: &DMatrix<f64>,
    c: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
) -> (DMatrix<f64>, bool) {
    let size = q.nrows();
    // Readings of different joints and channels have independent noise: R is diagonal.
    let weighted = DMatrix::from_fn(r.nrows(), size, |o, i| c[(o, i)] / r[(o, o)]);
    let (mut a, mut g, mut h) = (step.transpose(), c.transpose() * weighted, q.clone());
    let symmetric = |x: DMatrix<f64>| (&x + x.transpose()) * 0.5;
    for _ in 0..DOUBLINGS {
        let Some(w) = (DMatrix::identity(size, size) + &g * &h).try_inverse() else {
            return (h, false);
        };
        let (forward, back) = (&a * &w, a.transpose() * &h);
        let next = symmetric(&h + &back * &w * &a);
        g = symmetric(&g + &forward * &g * a.transpose());
        a = &forward * &a;
        // Entry by entry: variances of positions and of velocities are apart by many powers of ten.
        let size_of = |i: usize| next[(i, i)].max(1e-300).sqrt();
        let change = next
            .iter()
            .zip(h.iter())
            .enumerate()
            .map(|(at, (x, y))| (x - y).abs() / (size_of(at % size) * size_of(at / size)));
        let largest = change.fold(0.0, f64::max);
        h = next;
        if largest < SETTLED {
            return (h, true);
        }
    }
    (h, false)
}

/// Rates of the states, before readings lag, and where among them the state stands that the encoder reads.
fn rates(d: &Design) -> (DMatrix<f64>, usize) {
    let size = d.size();
    let mut a = DMatrix::<f64>::zeros(size, size);
    a[(0, 1)] = 1.0;
    a[(1, 1)] = -d.viscous / d.inertia;
    let mut read = 0;
    if let Some((link, k, c, on_link)) = d.gear {
        read = if on_link { 2 } else { 0 };
        a[(1, 0)] = -k / d.inertia;
        a[(1, 2)] = k / d.inertia;
        a[(1, 1)] -= c / d.inertia;
        a[(1, 3)] = c / d.inertia;
        a[(2, 3)] = 1.0;
        a[(3, 0)] = k / link;
        a[(3, 2)] = -k / link;
        a[(3, 1)] = c / link;
        a[(3, 3)] = -c / link;
    }
    a[(1, read)] -= d.servo.0 / d.inertia;
    a[(1, read + 1)] -= d.servo.1 / d.inertia;
    if let Some(integral) = d.integral {
        let own = size - 1;
        a[(1, own)] = 1.0 / d.inertia;
        a[(own, read)] = -integral.falls[0];
        a[(own, read + 1)] = -integral.falls[1];
    }
    (a, read)
}

/// Covariance that the noise of the torques adds in a sample.
fn disturbances(d: &Design) -> DMatrix<f64> {
    let size = d.size();
    let mut q = DMatrix::<f64>::zeros(size, size);
    let mut put = |at: usize, inertia: f64, torque: f64| {
        let v = d.h * torque / inertia;
        let p = 0.5 * d.h * v;
        q[(at, at)] += p * p;
        q[(at, at + 1)] += p * v;
        q[(at + 1, at)] += p * v;
        q[(at + 1, at + 1)] += v * v;
    };
    if let Some((link, ..)) = d.gear {
        put(0, d.inertia, d.torque);
        put(2, link, (0.5 * d.torque).hypot(d.passed));
    } else {
        put(0, d.inertia, d.torque.hypot(d.passed));
    }
    if let Some(integral) = d.integral {
        q[(size - 1, size - 1)] = integral.strays * integral.strays;
    }
    q
}

/// A step and its disturbances with one more state: the velocity at `from` as a lagging reading shows it, of
/// which the share `fade` is left after a sample.
fn lagging(
    step: &DMatrix<f64>,
    q: &DMatrix<f64>,
    from: usize,
    fade: f64,
) -> (DMatrix<f64>, DMatrix<f64>) {
    let size = step.nrows();
    let widened = |x: &DMatrix<f64>| x.clone().resize(size + 1, size + 1, 0.0);
    let mut wide = DMatrix::identity(size + 1, size + 1);
    wide[(size, from)] = 1.0 - fade;
    wide[(size, size)] = fade;
    // First the motion, then the reading that follows it.
    let mut step = &wide * widened(step);
    step[(size, size)] = fade;
    wide[(size, size)] = 0.0;
    (step, &wide * widened(q) * wide.transpose())
}

/// Gain from the steady state of the Riccati recursion.
pub(crate) fn gain(d: &Design) -> Gain {
    let (a, at) = rates(d);
    let (mut step, mut q) = ((a * d.h).exp(), disturbances(d));
    let time = d.lag.filter(|t| *t > 0.0 && d.v.is_some());
    if let Some(time) = time {
        (step, q) = lagging(&step, &q, at + 1, (-d.h / time).exp());
    }
    let size = step.nrows();
    let outputs = if d.v.is_some() { 2 } else { 1 };
    let mut c = DMatrix::<f64>::zeros(outputs, size);
    c[(0, at)] = 1.0;
    let mut r = DMatrix::<f64>::zeros(outputs, outputs);
    r[(0, 0)] = d.q * d.q;
    if let Some(v) = d.v {
        c[(1, if time.is_some() { size - 1 } else { at + 1 })] = 1.0;
        r[(1, 1)] = v * v;
    }
    let (p, settled) = steady_covariance(&step, &c, &q, &r);
    let s = &c * &p * c.transpose() + &r;
    // S contains R, which is positive: without an inverse the covariance is not finite, and nothing
    // is corrected.
    let k = match s.clone().try_inverse() {
        Some(inverse) => &p * c.transpose() * inverse,
        None => DMatrix::zeros(size, outputs),
    };
    let mut rows = [[0.0; 2]; ROWS];
    for i in 0..size {
        let row = match i + 1 {
            last if time.is_some() && last == size => LAGGING,
            last if d.integral.is_some() && last == d.size() => INTEGRAL,
            _ => i,
        };
        for o in 0..outputs {
            rows[row][o] = k[(i, o)];
        }
    }
    Gain {
        rows,
        stirred: rows,
        whiten: whitening(&s),
        hidden: [0.0; 4],
        settled,
    }
}

/// Inverse of the lower Cholesky factor of the covariance of the innovations; the second is one where there
/// is no velocity.
fn whitening(s: &DMatrix<f64>) -> [[f64; 2]; 2] {
    let full = match s.nrows() {
        2 => Matrix2::new(s[(0, 0)], s[(0, 1)], s[(1, 0)], s[(1, 1)]),
        _ => Matrix2::new(s[(0, 0)], 0.0, 0.0, 1.0),
    };
    let l00 = full[(0, 0)].sqrt();
    let l10 = full[(1, 0)] / l00;
    let l11 = (full[(1, 1)] - l10 * l10).max(1e-300).sqrt();
    [[1.0 / l00, 0.0], [-l10 / (l00 * l11), 1.0 / l11]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Draw;

    /// Design of a drive with a gear behind it, read at the rotor.
    fn geared() -> Design {
        Design {
            h: 2e-3,
            inertia: 0.02,
            viscous: 0.3,
            gear: Some((0.4, 900.0, 0.5, false)),
            servo: (0.0, 0.0),
            integral: None,
            torque: 0.4,
            passed: 0.1,
            q: 1e-4,
            v: None,
            lag: None,
        }
    }

    /// The covariance solves P = A (P − K C P) Aᵀ + Q: one more sample leaves it as it is.
    #[test]
    fn doubling_ends_where_the_recursion_rests() {
        let step = (DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -40.0, -3.0]) * 2e-3).exp();
        let q = DMatrix::from_row_slice(2, 2, &[1e-12, 1e-9, 1e-9, 1e-6]);
        let c = DMatrix::from_row_slice(1, 2, &[1.0, 0.0]);
        let r = DMatrix::from_element(1, 1, 1e-8);
        let (p, settled) = steady_covariance(&step, &c, &q, &r);
        assert!(settled);
        let s = (&c * &p * c.transpose() + &r)[(0, 0)];
        let k = &p * c.transpose() / s;
        let next = &step * (&p - &k * &c * &p) * step.transpose() + &q;
        for (i, j) in [(0, 0), (0, 1), (1, 1)] {
            let size = (p[(i, i)] * p[(j, j)]).sqrt();
            assert!(
                (next[(i, j)] - p[(i, j)]).abs() < 1e-10 * size,
                "{next} {p}"
            );
        }
    }

    /// Without a spring between them the rotor's encoder sees nothing of the link.
    #[test]
    fn a_state_that_no_sensor_sees_is_told() {
        assert!(gain(&geared()).settled);
        let loose = Design {
            gear: Some((0.4, 0.0, 0.0, false)),
            ..geared()
        };
        let blind = gain(&loose);
        assert!(!blind.settled);
        assert!(blind.rows.iter().flatten().all(|x| x.is_finite()));
    }

    /// A drive whose velocity reading lags, simulated: with the gain for it the whitened
    /// innovations have unit variance and no memory; with the gain of a prompt reading they have.
    #[test]
    fn a_lagging_velocity_corrects_what_it_shows() {
        let (h, time) = (2e-3, 0.02);
        let design = Design {
            h,
            inertia: 0.1,
            viscous: 0.3,
            gear: None,
            servo: (0.0, 0.0),
            integral: None,
            torque: 0.4,
            passed: 0.3,
            q: 1e-4,
            v: Some(5e-3),
            lag: Some(time),
        };
        let fade = (-h / time).exp();
        let run = |g: &Gain| {
            let mut draw = Draw::new(5);
            let (mut q, mut v, mut w) = (0.0, 0.0, 0.0);
            let (mut mq, mut mv, mut mw) = (0.0, 0.0, 0.0);
            let mut seen: Vec<[f64; 2]> = Vec::new();
            let a = (-3.0 * h).exp();
            let travel = (1.0 - a) / 3.0;
            for k in 0..60_000 {
                let (eq, ev) = (q + 1e-4 * draw.next() - mq, w + 5e-3 * draw.next() - mw);
                if k > 500 {
                    seen.push([
                        eq * g.whiten[0][0],
                        eq * g.whiten[1][0] + ev * g.whiten[1][1],
                    ]);
                }
                let fix = |row: usize| g.rows[row][0] * eq + g.rows[row][1] * ev;
                (mq, mv, mw) = (mq + fix(0), mv + fix(1), mw + fix(4));
                // Torque noise of 0.5 in all.
                let kick = h * 0.5 / 0.1 * draw.next();
                q += v * travel + 0.5 * h * kick;
                v = a * v + kick;
                w = fade * w + (1.0 - fade) * v;
                mq += mv * travel;
                mv *= a;
                mw = fade * mw + (1.0 - fade) * mv;
            }
            let n = seen.len() as f64;
            let mean = |f: &dyn Fn(usize) -> f64| (0..seen.len() - 1).map(f).sum::<f64>() / n;
            let square = [0, 1].map(|c| mean(&|k| seen[k][c] * seen[k][c]));
            let neighbour = [0, 1].map(|c| mean(&|k| seen[k][c] * seen[k + 1][c]) / square[c]);
            (square, neighbour)
        };
        let (square, neighbour) = run(&gain(&design));
        for c in 0..2 {
            assert!((square[c] - 1.0).abs() < 0.05, "{square:?}");
            assert!(neighbour[c].abs() < 0.03, "{neighbour:?}");
        }
        let (square, _) = run(&gain(&Design {
            lag: None,
            ..design
        }));
        assert!(square[0].max(square[1]) > 1.5, "{square:?}");
    }
}
