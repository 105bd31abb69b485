//! Start values of terms in which a law is not linear, read off the force that a model still misses.
//!
//! The additional force of a term is linear in its amplitudes once the other parameters are given. A
//! grid of these is tried by linear regressions on the missing force w of the train records (see
//! [`residuals`]), with what friction, springs and gravity can take of it projected out,
//!
//! ```text
//! gain = wᵀ P Φ (Φᵀ P Φ)⁻¹ Φᵀ P w,    P = I − B (Bᵀ B)⁻¹ Bᵀ,    B: 1, q, sin q, cos q, v, sign v
//! ```
//!
//! with the force Φ per unit of each amplitude. The best points of the grid are starts.

use std::f64::consts::{PI, SQRT_2, TAU};

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use pid_data::Role;

use crate::case::Case;
use crate::constants::Constants;
use crate::effect::{Commands, Forces, Friction, Over, ReadOff, Site, Term};
use crate::fit::Fit;
use crate::locate::{Residual, residuals};

/// Samples of the missing force that are looked at, at most.
const SAMPLES: usize = 3000;
/// One of so many of them is looked at first where a grid is large.
const FEWER: usize = 8;
/// Points of a grid that are looked at with all samples: chance alone gives a point about 2/375 of what is missing
/// there, so one of a few hundredths is among these.
const POINTS: usize = 200;
/// Starts of a term.
const STARTS: usize = 3;
/// Values of a place: quantiles of what the records pass through.
const PLACES: usize = 19;
/// Ratios of two positions, in ranges of the motion.
const RATIOS: [f64; 6] = [-2.0, -1.0, -0.5, 0.5, 1.0, 2.0];
/// Time constants, in lengths of the records.
const TIMES: [f64; 5] = [0.05, 0.15, 0.4, 1.0, 3.0];
/// Most periods of a wave over the range of a motion.
const PERIODS: f64 = 12.0;
/// Most points of a grid over the time.
const FREQUENCIES: usize = 1500;

/// The missing force of all train records and the motion beside it, thinned.
pub(super) struct Missing<'a> {
    all: Samples<'a>,
    /// A part of them.
    fewer: Samples<'a>,
}

/// Some samples of the missing force.
struct Samples<'a> {
    case: &'a Case,
    /// Time of each sample since the start of its record, s.
    t: Vec<f64>,
    /// Positions, velocities and loads, joint by joint, at each sample.
    q: Vec<Vec<f64>>,
    v: Vec<Vec<f64>>,
    load: Vec<Vec<f64>>,
    /// Missing force of each joint without what its background takes.
    force: Vec<DVector<f64>>,
    /// Orthonormal background of each joint.
    background: Vec<DMatrix<f64>>,
}

/// The background of a joint's missing force, orthonormal.
fn background(case: &Case, j: usize, q: &[f64], v: &[f64]) -> DMatrix<f64> {
    let speed = case.scale[j].speed;
    let row = |k: usize| {
        let (s, c) = q[k].sin_cos();
        [1.0, q[k], s, c, v[k] / speed, v[k].signum()]
    };
    let mut b = DMatrix::from_fn(q.len(), 6, |k, i| row(k)[i]);
    // Gram-Schmidt; what depends on the columns before is left out as zero.
    for i in 0..b.ncols() {
        let before = b.column(i).norm();
        for _ in 0..2 {
            for k in 0..i {
                let along = b.column(i).dot(&b.column(k));
                let other = b.column(k).into_owned();
                b.column_mut(i).axpy(-along, &other, 1.0);
            }
        }
        let norm = b.column(i).norm();
        let scale = if norm > 1e-8 * before {
            1.0 / norm
        } else {
            0.0
        };
        b.column_mut(i).scale_mut(scale);
    }
    b
}

impl<'a> Missing<'a> {
    /// Of a fit on the train records of a case.
    pub(super) fn new(case: &'a Case, fit: &Fit) -> Self {
        let records: Vec<Residual> = residuals(case, fit, Role::Train);
        let count: usize = records.iter().map(|r| r.t.len()).sum();
        let every = count.div_ceil(SAMPLES).max(1);
        let all: Vec<usize> = (0..count).step_by(every).collect();
        // Unequal steps: equal ones would show a wave as slower ones alike.
        let step = |k: usize| (k as f64 * SQRT_2).fract() * FEWER as f64;
        let fewer: Vec<usize> = all
            .chunks(FEWER)
            .enumerate()
            .map(|(k, chunk)| chunk[(step(k) as usize).min(chunk.len() - 1)])
            .collect();
        Missing {
            all: Samples::new(case, &records, &all),
            fewer: Samples::new(case, &records, &fewer),
        }
    }

    /// Starts of a term: the best points of the grid of what it is not linear in, with the amplitudes
    /// that the regression gives.
    pub(super) fn starts(&self, term: &Term) -> Vec<Vec<f64>> {
        let Some(over) = term.effect.read_off() else {
            return Vec::new();
        };
        if self.all.t.len() < 2 * self.all.background[0].ncols() {
            return Vec::new();
        }
        if let ReadOff::BaseWave { wave } = over {
            return self.all.shared_lines(term, wave);
        }
        let grid = self.all.grid(term.joint, over);
        let mut points: Vec<usize> = (0..grid.len()).collect();
        if points.len() > POINTS && self.fewer.t.len() > POINTS {
            points = self.fewer.best(term, &grid, POINTS);
        }
        let tried = points
            .into_iter()
            .filter_map(|i| self.all.tried(term, &grid[i]).map(|(gain, e)| (i, gain, e)));
        apart(tried.collect())
    }
}

impl<'a> Samples<'a> {
    /// The samples at some places of the records, one after the other.
    fn new(case: &'a Case, records: &[Residual], places: &[usize]) -> Self {
        let n = case.n();
        let gather = |of: &dyn Fn(&Residual) -> &[f64]| -> Vec<f64> {
            let all: Vec<f64> = records.iter().flat_map(|r| of(r).iter().copied()).collect();
            places.iter().map(|&k| all[k]).collect()
        };
        let joints = |of: &dyn Fn(&Residual, usize) -> &[f64]| -> Vec<Vec<f64>> {
            (0..n).map(|j| gather(&|r| of(r, j))).collect()
        };
        let q = joints(&|r, j| &r.joints[j].q);
        let v = joints(&|r, j| &r.joints[j].v);
        let w = joints(&|r, j| &r.joints[j].force);
        let background: Vec<DMatrix<f64>> =
            (0..n).map(|j| background(case, j, &q[j], &v[j])).collect();
        let mut samples = Samples {
            case,
            t: gather(&|r| &r.t),
            load: joints(&|r, j| &r.joints[j].load),
            q,
            v,
            force: Vec::new(),
            background,
        };
        samples.force = w
            .into_iter()
            .enumerate()
            .map(|(j, w)| samples.projected(j, DVector::from_vec(w)))
            .collect();
        samples
    }

    /// The points of a grid at which a term gains most, as many as are asked for.
    fn best(&self, term: &Term, grid: &[Vec<(usize, f64)>], many: usize) -> Vec<usize> {
        let gain = |i: usize| self.tried(term, &grid[i]).map(|(gain, _)| (i, gain));
        let mut gains: Vec<(usize, f64)> = (0..grid.len()).filter_map(gain).collect();
        gains.sort_by(|a, b| b.1.total_cmp(&a.1));
        gains.truncate(many);
        gains.into_iter().map(|(i, _)| i).collect()
    }

    /// A force on a joint without what its background takes.
    fn projected(&self, j: usize, mut x: DVector<f64>) -> DVector<f64> {
        let b = &self.background[j];
        let along = b.tr_mul(&x);
        x.gemv(-1.0, b, &along, 1.0);
        x
    }

    /// Gain of a term with all but its amplitudes given, and its parameters.
    fn tried(&self, term: &Term, at: &[(usize, f64)]) -> Option<(f64, Vec<f64>)> {
        let info = term.effect.info();
        let mut e = vec![0.0; info.parameters.len()];
        for &(i, x) in at {
            e[i] = x;
        }
        let own = term.joint;
        let joints: Vec<usize> = std::iter::once(own)
            .chain(term.effect.partner(own))
            .collect();
        let columns: Vec<Vec<DVector<f64>>> = info
            .amplitudes
            .iter()
            .map(|&a| {
                let mut unit = e.clone();
                unit[a] = 1.0;
                self.forces(term, &unit, &joints)
            })
            .collect();
        let m = columns.len();
        let gram = DMatrix::from_fn(m, m, |i, k| dot(&columns[i], columns[k].iter()));
        let force = || joints.iter().map(|&j| &self.force[j]);
        let pull = DVector::from_fn(m, |i, _| dot(&columns[i], force()));
        let amplitudes = gram.cholesky()?.solve(&pull);
        for (&a, x) in info.amplitudes.iter().zip(amplitudes.iter()) {
            let (p, unit) = (
                &info.parameters[a],
                self.case.unit(info.parameters[a].unit, own),
            );
            e[a] = x.clamp(0.9 * p.lower * unit, 0.9 * p.upper * unit);
        }
        let gain = amplitudes.dot(&pull);
        gain.is_finite().then_some((gain, e))
    }

    /// Additional forces of a term on joints, background projected out.
    fn forces(&self, term: &Term, e: &[f64], joints: &[usize]) -> Vec<DVector<f64>> {
        let law = term.effect.plain();
        let (n, own) = (self.case.n(), term.joint);
        let constants = Constants::none(&self.case.nominal);
        let mut out = vec![DVector::zeros(self.t.len()); joints.len()];
        let (mut q, mut v, mut load) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let (mut value, mut rate) = (vec![0.0; n], vec![0.0; n]);
        for (k, &t) in self.t.iter().enumerate() {
            for j in 0..n {
                (q[j], v[j], load[j]) = (self.q[j][k], self.v[j][k], self.load[j][k]);
            }
            let site = Site {
                joint: own,
                q: &q,
                v: &v,
                load: &load,
                t,
                dt: 0.0,
                rest: None,
            };
            value.fill(0.0);
            rate.fill(0.0);
            let mut forces = Forces {
                value: &mut value,
                rate: &mut rate,
            };
            law.force(e, &site, &[], &mut forces, &constants);
            let mut friction = Friction {
                forward: 0.0,
                backward: 0.0,
                viscous: 0.0,
            };
            law.friction(e, &site, &[], &mut friction);
            let dry = match v[own] > 0.0 {
                true => -friction.forward,
                false => friction.backward,
            };
            // The torque of the drive is what its gear passes, but for its own friction and inertia.
            let commands = Commands {
                u: &load[own..=own],
                h: 1.0,
                linear: false,
                begin: t,
                t: 0.0,
                dt: 0.0,
            };
            let drive = law.input(e, load[own], &commands, &mut []) - load[own];
            for (out, &j) in out.iter_mut().zip(joints) {
                out[k] = value[j] - rate[j] * v[j];
                if j == own {
                    out[k] += dry + drive - friction.viscous * v[j];
                }
            }
        }
        let all = out.into_iter().zip(joints);
        all.map(|(x, &j)| self.projected(j, x)).collect()
    }

    /// Points of the grid: parameters by place.
    fn grid(&self, j: usize, over: ReadOff) -> Vec<Vec<(usize, f64)>> {
        let range = self.case.scale[j].range;
        // Five points for a period at the ends of the range.
        let step = TAU / (5.0 * range);
        let waves = |first: usize| (first..(5.0 * PERIODS) as usize).map(move |i| i as f64 * step);
        let ratio = |i: usize| range / self.case.scale[i].range;
        match over {
            ReadOff::Place { parameter, of } => {
                let values = match of {
                    Over::Position => self.q[j].clone(),
                    Over::Speed => self.v[j].iter().map(|v| v.abs()).collect(),
                    Over::Load => self.load[j].iter().map(|l| l.abs()).collect(),
                };
                let places = quantiles(values).into_iter();
                places.map(|x| vec![(parameter, x)]).collect()
            }
            ReadOff::PlaceOfTwo {
                parameter,
                ratio: place,
            } => {
                let Some(other) = j.checked_sub(1) else {
                    return Vec::new();
                };
                let of = |r: f64| {
                    let both = self.q[j].iter().zip(&self.q[other]);
                    quantiles(both.map(|(a, b)| a + r * b).collect())
                };
                let ratios = RATIOS.map(|r| r * ratio(other)).into_iter();
                let points = ratios.flat_map(|r| of(r).into_iter().map(move |x| (x, r)));
                points
                    .map(|(x, r)| vec![(parameter, x), (place, r)])
                    .collect()
            }
            ReadOff::TimeConstant { parameter } => {
                let length = self.t.iter().copied().fold(0.0, f64::max);
                TIMES.map(|part| vec![(parameter, part * length)]).into()
            }
            ReadOff::TimeWave { wave } | ReadOff::BaseWave { wave } => {
                self.frequencies().map(|w| vec![(wave, w)]).collect()
            }
            ReadOff::FrictionWave { wave } => waves(1).map(|w| vec![(wave, w)]).collect(),
            ReadOff::WaveOfTwo { wave, ratio: place } => {
                let Some(other) = j.checked_sub(1) else {
                    return Vec::new();
                };
                // Waves over both positions in the same steps.
                let all = waves(1).flat_map(|w| {
                    let most = 5.0 * PERIODS;
                    let steps = (-most as i64)..=(most as i64);
                    let r = ratio(other);
                    steps.map(move |i| vec![(wave, w), (place, i as f64 * step / w * r)])
                });
                all.collect()
            }
        }
    }

    /// Angular frequencies in steps of half a period over the length of the records, rad/s.
    fn frequencies(&self) -> impl Iterator<Item = f64> + use<> {
        let length = self.t.iter().copied().fold(1e-9, f64::max);
        let step = PI / length;
        let count = ((self.highest() / step) as usize).min(FREQUENCIES);
        (2..count).map(move |i| i as f64 * step)
    }

    /// Starts of a term that shakes all joints: frequencies at which their missing forces, each over its
    /// own size, have the largest lines together. Its amplitudes are zero.
    fn shared_lines(&self, term: &Term, wave: usize) -> Vec<Vec<f64>> {
        let line = |w: f64| {
            let own = |j: usize| {
                let column = |of: &dyn Fn(f64) -> f64| {
                    self.projected(
                        j,
                        DVector::from_iterator(self.t.len(), self.t.iter().map(|t| of(w * t))),
                    )
                };
                let (s, c) = (column(&f64::sin), column(&f64::cos));
                let gram = Matrix2::new(s.dot(&s), s.dot(&c), s.dot(&c), c.dot(&c));
                let pull = Vector2::new(s.dot(&self.force[j]), c.dot(&self.force[j]));
                let inverse = gram.try_inverse().unwrap_or_default();
                pull.dot(&(inverse * pull)) / self.force[j].norm_squared().max(1e-300)
            };
            (0..self.case.n()).map(own).sum::<f64>()
        };
        let start = |w: f64| {
            let mut e = vec![0.0; term.effect.info().parameters.len()];
            e[wave] = w;
            e
        };
        let grid = self.frequencies().enumerate();
        apart(grid.map(|(i, w)| (i, line(w), start(w))).collect())
    }

    /// Highest angular frequency that the thinned samples show, rad/s.
    fn highest(&self) -> f64 {
        let steps = self.t.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0);
        let (sum, count) = steps.fold((0.0, 0.0), |(s, n), d| (s + d, n + 1.0));
        PI * count / f64::max(sum, 1e-9)
    }
}

/// The points of a grid that gain most, no neighbours among them: these lead to the same optimum.
fn apart(mut tried: Vec<(usize, f64, Vec<f64>)>) -> Vec<Vec<f64>> {
    tried.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut best: Vec<(usize, Vec<f64>)> = Vec::new();
    for (i, _, e) in tried {
        if best.len() < STARTS && best.iter().all(|(k, _)| i.abs_diff(*k) > 1) {
            best.push((i, e));
        }
    }
    best.into_iter().map(|(_, e)| e).collect()
}

/// Product of the forces on several joints.
fn dot<'a>(x: &[DVector<f64>], y: impl Iterator<Item = &'a DVector<f64>>) -> f64 {
    x.iter().zip(y).map(|(a, b)| a.dot(b)).sum()
}

/// Equally likely values.
fn quantiles(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    let of = |i: usize| values.get(i * last / (PLACES + 1)).copied();
    (1..=PLACES).filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, named, pendulum_under};
    use crate::fit::{Effort, Point, basis, fit};
    use crate::hypothesis::Hypothesis;

    /// Starts of a term on records that it moves, beside the nominal structure as it fits them.
    fn starts(id: &str, e: &[f64], drive: f64) -> Vec<Vec<f64>> {
        let hypothesis = named(&[id]);
        let input = |record: usize, t: f64| {
            let w = 1.0 + 0.37 * record as f64;
            drive * ((2.1 * w * t).sin() + 0.7 * (5.3 * w * t).sin() + 0.3 * (9.7 * t).sin())
        };
        let case = pendulum_under(&hypothesis, e, 10.0, &|_| {}, &input);
        let nominal = Point {
            theta: vec![0.0; SIZE],
            e: Vec::new(),
        };
        let none = Hypothesis::default();
        let fitted = fit(&case, &basis(&case), &none, nominal, Effort::full(10));
        Missing::new(&case, &fitted).starts(&hypothesis.terms[0])
    }

    /// Distance of the nearest start to the truth in a parameter, share of `size`.
    fn off(id: &str, e: &[f64], parameter: usize, size: f64) -> f64 {
        // A base that shakes pulls at a pendulum that hangs still by one frequency.
        let starts = starts(id, e, if id == "base_wave" { 0.1 } else { 1.2 });
        assert!(
            !starts.is_empty() && starts.len() <= STARTS,
            "{id}: {starts:?}"
        );
        let distances = starts.iter().map(|s| (s[parameter] - e[parameter]).abs());
        distances.fold(f64::INFINITY, f64::min) / size
    }

    #[test]
    fn starts_are_near_what_moves_the_records() {
        // Places, shares of the range of the motion and of the largest speed.
        assert!(off("hinge_above", &[6.0, 0.4], 1, 3.0) < 0.1);
        assert!(off("hinge_below", &[6.0, -0.3], 1, 3.0) < 0.1);
        assert!(off("friction_above_speed", &[0.3, 2.0], 1, 6.0) < 0.1);
        // Waves, shares of a period over the records.
        assert!(off("time_wave", &[0.4, 0.1, 17.0], 2, PI / 10.0) < 1.0);
        assert!(
            off(
                "base_wave",
                &[1.5, 0.0, 0.5, 0.3, 0.0, 0.0, 14.0],
                6,
                PI / 10.0
            ) < 1.0
        );
        assert!(off("friction_wave", &[0.3, 0.2, 6.0], 2, TAU / 3.0) < 0.5);
    }

    #[test]
    fn amplitudes_of_a_start_are_those_of_the_regression() {
        let (k, from) = (6.0, 0.4);
        let starts = starts("hinge_above", &[k, from], 1.2);
        // The observer shows most of a force that changes slowly.
        let best = &starts[0];
        assert!(best[0] > 0.3 * k && best[0] < 1.5 * k, "{starts:?}");
    }
}
