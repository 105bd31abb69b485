//! Explanations of a record against each other: order, sign, unit, gravity, clock of the inputs. Each is
//! judged by the share of the recorded torque that the nominal robot leaves unexplained.

use crate::columns::quantile;
use crate::criteria::Criteria;
use crate::faults::{flipped, gravity_finding, scale_finding, swapped, unit_finding};
use crate::finding::{Channel, Finding, FindingKind, Severity, number};
use crate::lag;
use crate::motion::Motion;
use crate::open;
use crate::orders::orders;
use crate::torque::{Bench, Fit, Torques, fit, friction, sums};

/// Factors to SI and names of units of inputs.
const INPUT_UNITS: [(f64, &str); 6] = [
    (1e-3, "thousandths (N·mm, mA, mV)"),
    (1e3, "thousands (kN·m, kA)"),
    (9.80665, "kgf or kgf·m"),
    (0.0980665, "kgf·cm"),
    (
        std::f64::consts::PI / 180.0,
        "units of a gain per radian taken per degree",
    ),
    (
        180.0 / std::f64::consts::PI,
        "units of a gain per degree taken per radian",
    ),
];
/// A single joint whose input is off by less than this has a drive that gives less or more than it should, not
/// a unit of its own.
const ALONE: f64 = 30.0;

/// Shares of the inputs that a drive passes on as they are, when it is asked whether it gives less than asked
/// for: from a twelfth of them to all but a twelfth.
const LIMITS: usize = 12;

/// A share left that falls by less than this factor is the same.
const SAME: f64 = 0.8;

/// Points at which orders of whole joints are compared: 720 orders of six joints take half a second.
const FEW: usize = 150;

/// An explanation of the record.
struct Rival {
    finding: Finding,
    /// Fall of the sum over joints of the logarithms of the shares left, less the price of its changes.
    gain: f64,
    /// Largest share left at the joints that say something about it.
    left: f64,
    /// Largest share left at any joint.
    worst: f64,
}

/// The record beside the robot.
pub(crate) struct Contest<'a> {
    bench: &'a Bench,
    motion: &'a Motion,
    torques: &'a Torques,
    friction: Vec<Vec<[f64; 2]>>,
    criteria: &'a Criteria,
    /// Joints that move and have an input.
    active: Vec<usize>,
    /// The fits of the record as it is.
    pub(crate) base: Vec<Fit>,
    /// Share of each torque that the tolerances leave open; differences below it do not count.
    floor: Vec<f64>,
    /// Mean square of each torque that the tolerances leave open.
    open: Vec<f64>,
}

impl<'a> Contest<'a> {
    pub(crate) fn new(
        bench: &'a Bench,
        motion: &'a Motion,
        torques: &'a Torques,
        criteria: &'a Criteria,
    ) -> Self {
        let n = motion.n;
        let mut out = Self {
            bench,
            motion,
            torques,
            friction: (0..n).map(|j| friction(motion, j)).collect(),
            criteria,
            active: Vec::new(),
            base: Vec::new(),
            floor: Vec::new(),
            open: Vec::new(),
        };
        let rigid = torques.with(bench.stated());
        out.base = (0..n).map(|j| out.one(&rigid, j, j, 1.0)).collect();
        out.open = open::squares(bench, motion);
        out.floor = (0..n).map(|j| out.floor_of(j, &out.base[j])).collect();
        out.active = (0..n)
            .filter(|&j| motion.moves(j) && out.base[j].size > 0.0)
            .collect();
        out
    }

    /// Fit of input `i` as that of joint `j`.
    fn one(&self, rigid: &[f64], j: usize, i: usize, factor: f64) -> Fit {
        let gain = self.bench.gain[j] * factor;
        let torque = self.motion.column(&self.motion.u, i).map(|u| gain * u);
        fit(
            self.motion.column(rigid, j),
            &self.friction[j],
            torque,
            self.criteria,
        )
    }

    /// Share of a torque taken as that of joint `j` that the tolerances leave open.
    fn floor_of(&self, j: usize, fit: &Fit) -> f64 {
        let share = self.open[j] / (fit.size * fit.size);
        if share.is_finite() {
            share.clamp(self.criteria.floor, self.criteria.floor_most)
        } else {
            self.criteria.floor_most
        }
    }

    fn log(&self, j: usize, left: f64) -> f64 {
        left.max(self.floor[j]).ln()
    }

    /// Sum of the logarithms of the shares left as the record is.
    pub(crate) fn total(&self) -> f64 {
        self.active
            .iter()
            .map(|&j| self.log(j, self.base[j].left))
            .sum()
    }

    /// Joints whose torque is little explained.
    pub(crate) fn suspicious(&self) -> bool {
        let much =
            |&&j: &&usize| self.base[j].left > self.criteria.suspicious.max(2.0 * self.floor[j]);
        self.active.iter().any(|j| much(&j))
    }

    /// Joints of which the tolerances leave little open.
    fn known(&self) -> impl Iterator<Item = usize> + '_ {
        self.active
            .iter()
            .copied()
            .filter(|&j| self.floor[j] < self.criteria.known)
    }

    /// The best explanation, if it beats the record as it is; alternatives are tried only where a torque
    /// is little explained, but the clock of the inputs always.
    pub(crate) fn best(&self, data: &pid_data::Dataset) -> Option<Finding> {
        if self.active.is_empty() || self.motion.len() < 50 {
            return None;
        }
        let mut rivals: Vec<Rival> = Vec::new();
        rivals.extend(self.clock());
        if self.suspicious() {
            rivals.extend(self.inputs());
            rivals.extend(self.gravity());
            rivals.extend(self.input_units());
            rivals.extend(self.motions(data));
        }
        let explained = |r: &Rival| {
            let limit = if r.gain > self.criteria.clear {
                1.0
            } else {
                self.criteria.explained
            };
            r.gain > 0.0 && r.left < limit
        };
        rivals.retain(explained);
        let good = |r: &Rival| r.worst < self.criteria.convincing;
        if self.suspicious() && !rivals.iter().any(good) {
            rivals.extend(self.whole_orders().filter(explained));
        }
        let best = rivals
            .into_iter()
            .max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        let (finding, gain) = (best.finding, best.gain);
        Some(
            finding
                .with(
                    "share of the torque left as recorded",
                    self.worst(&self.base),
                    "1",
                )
                .with("share left once mended", best.left, "1")
                .with("fall of the log of the shares left", gain, "1"),
        )
    }

    /// Joints whose torque stays unexplained.
    pub(crate) fn unexplained(&self) -> Vec<Finding> {
        let little = self
            .known()
            .filter(|&j| self.base[j].left > self.criteria.unexplained);
        little
            .map(|j| {
                let left = self.base[j].left;
                let sentence = format!(
                    "the torque that the robot needs explains little of that of joint {}: {} of its mean square is left",
                    j + 1,
                    number(left)
                );
                Finding::new(
                    FindingKind::TorqueUnexplained { left },
                    Severity::Doubtful,
                    sentence,
                    "check that the description is that of this robot, and what the input column is",
                )
                .of(&[j + 1], Channel::Input)
                .with("share left", left, "1")
                .with("root mean square of the torque", self.base[j].size, "N*m or N")
            })
            .collect()
    }

    fn worst(&self, fits: &[Fit]) -> f64 {
        self.known().map(|j| fits[j].left).fold(0.0, f64::max)
    }

    /// Gain and share left of other torques of the robot, inputs in place.
    fn judged(&self, fits: &[Fit], changes: usize) -> (f64, [f64; 2]) {
        let after: f64 = self.active.iter().map(|&j| self.log(j, fits[j].left)).sum();
        let price = self.criteria.margin * changes as f64;
        let left = self.lefts(&[], self, fits);
        (self.total() - after - price, left)
    }

    /// Largest shares left of an alternative: at the joints that say something about it, and at any joint that
    /// it knows. Where none of the former is known, all decide.
    fn lefts(&self, changed: &[usize], other: &Self, fits: &[Fit]) -> [f64; 2] {
        let worst = other.worst(fits);
        let told = |&j: &usize| changed.contains(&j) || !self.silent(j, &fits[j]);
        let left = other.known().filter(told).map(|j| fits[j].left);
        [left.max_by(f64::total_cmp).unwrap_or(worst), worst]
    }

    /// Whether a joint says nothing about an alternative: something else than faults of the record acts there,
    /// and its torque stays as little explained as it is.
    fn silent(&self, j: usize, after: &Fit) -> bool {
        let before = self.base[j].left;
        before > self.criteria.explained && after.left > SAME * before
    }

    /// Orders and signs of the inputs: all permutations up to six joints, exchanges of two beyond.
    fn inputs(&self) -> Option<Rival> {
        let n = self.motion.n;
        let rigid = self.torques.with(self.bench.stated());
        let both = |j: usize, i: usize| [1.0, -1.0].map(|s| self.one(&rigid, j, i, s));
        let grid: Vec<Vec<[Fit; 2]>> = (0..n)
            .map(|j| (0..n).map(|i| both(j, i)).collect())
            .collect();
        let log = |j: usize, fit: &Fit| fit.left.max(self.floor_of(j, fit)).ln();
        let mut best: Option<(f64, Vec<usize>, Vec<bool>)> = None;
        for order in orders(n) {
            let mut gain = 0.0;
            let mut flipped = vec![false; n];
            for &j in &self.active {
                let [same, other] = &grid[j][order[j]];
                let before = self.log(j, self.base[j].left);
                let keep = before - log(j, same);
                let mut flip = before - log(j, other) - self.criteria.margin;
                if order[j] == j && self.floor_of(j, other) >= self.criteria.known {
                    // Friction tells the sign of a torque whose size the tolerances leave open.
                    flip = (same.left / other.left).ln() - self.criteria.sign_margin;
                }
                flipped[j] = flip > keep;
                gain += keep.max(flip);
            }
            gain -= self.criteria.margin * (0..n).filter(|&j| order[j] != j).count() as f64;
            if best.as_ref().is_none_or(|(g, ..)| gain > *g) {
                best = Some((gain, order, flipped));
            }
        }
        let (gain, order, flipped) = best?;
        let moved: Vec<usize> = (0..n).filter(|&j| order[j] != j).collect();
        let turned: Vec<usize> = (0..n).filter(|&j| flipped[j]).map(|j| j + 1).collect();
        let changed = self
            .active
            .iter()
            .filter(|&&j| moved.contains(&j) || flipped[j]);
        let fits = changed.map(|&j| (j, grid[j][order[j]][usize::from(flipped[j])]));
        let known = fits.filter(|(j, fit)| self.floor_of(*j, fit) < self.criteria.known);
        let worst = known.map(|(_, fit)| fit.left).fold(0.0, f64::max);
        let finding = if moved.is_empty() {
            if turned.is_empty() {
                return None;
            }
            self.flipped_inputs(&turned, gain)
        } else {
            swapped(Channel::Input, &order)
        };
        Some(Rival {
            finding,
            gain,
            left: worst,
            worst,
        })
    }

    /// A sign of inputs; says whether the motion of the joint flipped explains the record as well.
    fn flipped_inputs(&self, joints: &[usize], gain: f64) -> Finding {
        let or_other = match joints {
            [j] => {
                let (other, _) = self.flipped_motion(*j - 1);
                other > gain - 0.5 * self.criteria.margin
            }
            _ => false,
        };
        flipped(Channel::Input, joints, or_other)
    }

    fn flipped_motion(&self, j: usize) -> (f64, [f64; 2]) {
        let motion = self.motion.scaled(j, -1.0);
        self.other_motion(&motion, &[j], 1)
    }

    /// Gain and share left of another motion of some joints under the same inputs.
    fn other_motion(&self, motion: &Motion, changed: &[usize], changes: usize) -> (f64, [f64; 2]) {
        let torques = self.bench.torques(motion);
        let other = Contest::new(self.bench, motion, &torques, self.criteria);
        let price = self.criteria.margin * changes as f64;
        let after: f64 = self
            .active
            .iter()
            .map(|&j| other.log(j, other.base[j].left))
            .sum();
        let left = self.lefts(changed, &other, &other.base);
        (self.total() - after - price, left)
    }

    /// Other orders of whole joints, looked for at few points first; it is asked last, since it costs most.
    fn whole_orders(&self) -> Option<Rival> {
        let n = self.motion.n;
        let few = self.motion.thinned(FEW);
        let total = |motion: &Motion, order: &[usize]| {
            let motion = motion.ordered(order).with_inputs_ordered(order);
            let rigid = self.bench.stated_torques(&motion);
            let left = |j: usize| {
                let torque = motion.column(&motion.u, j).map(|u| self.bench.gain[j] * u);
                let rigid = motion.column(&rigid, j);
                fit(rigid, &friction(&motion, j), torque, self.criteria).left
            };
            let log = |j: usize| left(j).max(self.criteria.floor).ln();
            let moved = (0..n).filter(|&j| order[j] != j).count();
            (0..n).map(log).sum::<f64>() + self.criteria.margin * moved as f64
        };
        let moved = orders(n)
            .into_iter()
            .filter(|o| o.iter().enumerate().any(|(j, &k)| j != k));
        let (_, order) = moved
            .map(|order| (total(&few, &order), order))
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        let motion = self.motion.ordered(&order).with_inputs_ordered(&order);
        let changed: Vec<usize> = (0..n).filter(|&j| order[j] != j).collect();
        let (gain, [left, worst]) = self.other_motion(&motion, &changed, changed.len());
        let finding = swapped(Channel::All, &order);
        Some(Rival {
            finding,
            gain,
            left,
            worst,
        })
    }

    /// Signs, order and units of the positions.
    fn motions(&self, data: &pid_data::Dataset) -> Vec<Rival> {
        let n = self.motion.n;
        let mut out = Vec::new();
        for j in 0..n {
            let (gain, [left, worst]) = self.flipped_motion(j);
            let finding = flipped(Channel::Motion, &[j + 1], false);
            // A tie with the sign of the input goes to the input.
            out.push(Rival {
                finding,
                gain: gain - 0.05,
                left,
                worst,
            });
        }
        for j in 0..n {
            let motion = self.motion.scaled(j, -1.0).with_input_scaled(j, -1.0);
            let (gain, [left, worst]) = self.other_motion(&motion, &[j], 2);
            let finding = flipped(Channel::All, &[j + 1], false);
            out.push(Rival {
                finding,
                gain,
                left,
                worst,
            });
        }
        for i in 0..n {
            for j in i + 1..n {
                let mut order: Vec<usize> = (0..n).collect();
                order.swap(i, j);
                let (gain, [left, worst]) =
                    self.other_motion(&self.motion.exchanged(i, j), &[i, j], 2);
                let finding = swapped(Channel::Motion, &order);
                out.push(Rival {
                    finding,
                    gain: gain - 0.05,
                    left,
                    worst,
                });
            }
        }
        for (prismatic, factor, unit) in [
            (false, std::f64::consts::PI / 180.0, "degrees"),
            (true, 1e-3, "millimetres"),
        ] {
            let joints: Vec<usize> = (0..n)
                .filter(|&j| data.joints[j].prismatic == prismatic)
                .collect();
            if joints.is_empty() {
                continue;
            }
            let motion = joints
                .iter()
                .fold(self.motion.points(), |m, &j| m.scaled(j, factor));
            let (gain, [left, worst]) = self.other_motion(&motion, &joints, 1);
            let finding = unit_finding(
                Channel::Motion,
                &joints.iter().map(|j| j + 1).collect::<Vec<_>>(),
                factor,
                unit,
            );
            out.push(Rival {
                finding,
                gain,
                left,
                worst,
            });
        }
        out
    }

    /// Gravity the other way, and along the other axes of the base.
    fn gravity(&self) -> Vec<Rival> {
        let stated = self.bench.stated();
        let size = stated.iter().map(|g| g * g).sum::<f64>().sqrt();
        if self.torques.unit.is_empty() || size == 0.0 {
            return Vec::new();
        }
        let n = self.motion.n;
        let mut found: Vec<[f64; 3]> = vec![stated.map(|g| -g)];
        for k in 0..3 {
            for sign in [1.0, -1.0] {
                let mut g = [0.0; 3];
                g[k] = sign * size;
                found.push(g);
            }
        }
        let cosine =
            |g: &[f64; 3]| g.iter().zip(stated).map(|(a, b)| a * b).sum::<f64>() / (size * size);
        let others = found.into_iter().filter(|g| cosine(g) < 0.9);
        others
            .map(|g| {
                let rigid = self.torques.with(g);
                let fits: Vec<Fit> = (0..n).map(|j| self.one(&rigid, j, j, 1.0)).collect();
                let (gain, [left, worst]) = self.judged(&fits, 1);
                Rival {
                    finding: gravity_finding(stated, g),
                    gain,
                    left,
                    worst,
                }
            })
            .collect()
    }

    /// Units of the inputs, of all joints or of one.
    fn input_units(&self) -> Vec<Rival> {
        let n = self.motion.n;
        let rigid = self.torques.with(self.bench.stated());
        let mut slopes = Vec::new();
        for &j in &self.active {
            let torque = self
                .motion
                .column(&self.motion.u, j)
                .map(|u| self.bench.gain[j] * u);
            let sums = sums(self.motion.column(&rigid, j), &self.friction[j], torque);
            slopes.push((j, sums.fit((0.0, f64::INFINITY), self.criteria.offset).x[0]));
        }
        let mut sets: Vec<Vec<usize>> = slopes.iter().map(|(j, _)| vec![*j]).collect();
        if self.active.len() > 1 {
            sets.push(self.active.clone());
        }
        let mut out = Vec::new();
        for set in sets {
            let logs: Vec<f64> = slopes
                .iter()
                .filter(|(j, _)| set.contains(j))
                .map(|(_, s)| s.max(1e-12).ln())
                .collect();
            let mean = logs.iter().sum::<f64>() / logs.len() as f64;
            let slope = mean.exp();
            let (low, high) = self.criteria.rigid_factor;
            // A torque without likeness to the robot's has no slope.
            if (low..high).contains(&slope) || slope < 1e-8 {
                continue;
            }
            let near = INPUT_UNITS
                .into_iter()
                .map(|(f, unit)| ((slope * f).ln().abs(), f, unit))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|(off, f, _)| {
                    let own = f.ln().abs() > ALONE.ln() || set.len() > 1 || self.motion.n == 1;
                    *off < self.criteria.factor_width.ln() && own
                });
            let factor = near.map_or(1.0 / slope, |(_, f, _)| f);
            let fits: Vec<Fit> = (0..n)
                .map(|j| {
                    if set.contains(&j) {
                        self.one(&rigid, j, j, factor)
                    } else {
                        self.base[j]
                    }
                })
                .collect();
            let (gain, _) = self.judged(&fits, 1);
            let left = set.iter().map(|&j| fits[j].left).fold(0.0, f64::max);
            let limited = |&j: &usize| self.left_of_limited(&rigid, j) < fits[j].left;
            // Factors beyond those of a limit are units, whatever else acts.
            let small = near.is_none_or(|(_, f, _)| f.ln().abs() <= ALONE.ln());
            if small && set.iter().all(limited) {
                continue;
            }
            let joints: Vec<usize> = if set.len() == self.active.len() && set.len() > 1 {
                (1..=n).collect()
            } else {
                set.iter().map(|j| j + 1).collect()
            };
            let finding = match near {
                Some((_, f, unit)) => unit_finding(Channel::Input, &joints, f, unit),
                None => scale_finding(&joints, slope),
            };
            out.push(Rival {
                finding: finding.with("slope of the input over the robot's torque", slope, "1"),
                gain,
                left,
                worst: left,
            });
        }
        out
    }

    /// Share left at joint `j` if its drive gives no more than some torque, whatever its input asks for: that
    /// is an effect of the drive, and looks like an input that is too large by some factor.
    fn left_of_limited(&self, rigid: &[f64], j: usize) -> f64 {
        let gain = self.bench.gain[j];
        let torque: Vec<f64> = self
            .motion
            .column(&self.motion.u, j)
            .map(|u| gain * u)
            .collect();
        let sizes: Vec<f64> = torque.iter().map(|x| x.abs()).collect();
        let left = |k: usize| {
            let limit = quantile(&sizes, k as f64 / LIMITS as f64);
            fit(
                self.motion.column(rigid, j),
                &self.friction[j],
                torque.iter().map(|x| x.clamp(-limit, limit)),
                self.criteria,
            )
            .left
        };
        (1..LIMITS).map(left).fold(f64::INFINITY, f64::min)
    }

    /// The clock of the inputs.
    fn clock(&self) -> Option<Rival> {
        let rigid = self.torques.with(self.bench.stated());
        let known: Vec<usize> = self.known().collect();
        let joints = if known.is_empty() {
            &self.active
        } else {
            &known
        };
        let found = lag::find(
            self.motion,
            &rigid,
            &self.friction,
            &self.bench.gain,
            joints,
            self.criteria,
        )?;
        Some(Rival {
            finding: lag::finding(&found, self.motion.n),
            gain: found.gain,
            left: found.left,
            worst: found.left,
        })
    }
}
