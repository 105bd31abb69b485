//! Causes of like size: drawn, then made stronger or weaker until each has its part of the gap.

use pid_interpret::nominal::Nominal;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::causes::{COUPLING, Cause, Kind, LISTED, OUTSIDE, VELOCITY_LAG};
use crate::gaps::Gaps;
use crate::magnitudes;
use crate::motion::LENGTH;
use crate::plan::{same_place, sizes};
use crate::robot::Robot;

/// Least share of a cause.
const LEAST: f64 = 0.1;
/// Least and largest gap without the causes over a floor.
const RATIO: (f64, f64) = (2.5, 12.0);
/// Least floor that counts: a diagnosis starts its free runs from readings, not from the true state.
const FLOOR: f64 = 0.008;
/// Range of the strengths.
const STRENGTH: (f64, f64) = (0.1, 6.0);
/// Times that strengths are changed before a cause is drawn anew, and draws.
const CHANGES: usize = 3;
const DRAWS: usize = 3;
/// Samples per second that the length of a dropped command is meant for.
const RATE: f64 = 500.0;

/// A cause before its size.
#[derive(Clone)]
struct Candidate {
    index: usize,
    joint: usize,
    /// Seed of all but its size.
    seed: u64,
    strength: f64,
}

/// A robot whose causes are drawn.
pub(crate) struct Like<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) nominal: &'a Nominal,
    pub(crate) velocity: &'a str,
    /// Whether all joints turn about one horizontal axis.
    pub(crate) one_axis: bool,
}

impl Like<'_> {
    /// A number of listed causes and perhaps one outside the list, each with a tenth of the gap that
    /// `gaps` finds or more. Where no strengths do that, the least are left out.
    pub(crate) fn draw(
        &self,
        (listed, outside): (usize, bool),
        gaps: &dyn Fn(&[Cause]) -> Gaps,
        random: &mut ChaCha8Rng,
    ) -> Vec<Cause> {
        let count = listed + usize::from(outside);
        let goal = random.random_range(3.0_f64.ln()..9.0_f64.ln()).exp();
        let mut drawn: Vec<Candidate> = Vec::new();
        for draw in 1..=DRAWS {
            while drawn.len() < count {
                let other = outside && !drawn.iter().any(|c| c.index >= LISTED);
                let candidate = self.candidate(other, &drawn, random);
                drawn.push(candidate);
            }
            for change in 0..=CHANGES {
                let found = gaps(&self.causes(&drawn));
                let ratio = found.none / found.all.max(FLOOR);
                if found.least() >= LEAST && RATIO.0 <= ratio && ratio <= RATIO.1 {
                    return self.causes(&drawn);
                }
                if change < CHANGES {
                    resize(&mut drawn, &found, goal);
                } else if draw < DRAWS {
                    drawn.remove(weakest(&found));
                }
            }
        }
        // Those that are left; one cause has all of the gap, and is weakened until the robot is held.
        loop {
            let found = gaps(&self.causes(&drawn));
            let (one, faint) = (drawn.len() == 1, drawn[0].strength <= STRENGTH.0);
            if found.held() && (one || found.least() >= LEAST) || one && faint {
                return self.causes(&drawn);
            }
            if one {
                resize(&mut drawn, &found, goal);
            } else {
                drawn.remove(weakest(&found));
            }
        }
    }

    fn candidate(&self, outside: bool, others: &[Candidate], random: &mut ChaCha8Rng) -> Candidate {
        let n = self.robot.joints.len();
        loop {
            let index = if outside {
                LISTED + random.random_range(0..OUTSIDE)
            } else {
                random.random_range(0..LISTED)
            };
            let joint = random.random_range(0..n);
            let candidate = Candidate {
                index,
                joint,
                seed: random.random(),
                strength: random.random_range(0.6_f64.ln()..2.0_f64.ln()).exp(),
            };
            // A coupling is between a joint and the one before it.
            let there = (index != COUPLING || joint > 0)
                && Kind::fits(index, joint, n)
                && (index != VELOCITY_LAG || self.velocity != "absent");
            let mine = self.cause(&candidate);
            if there && !others.iter().any(|o| self.same(&self.cause(o), &mine)) {
                return candidate;
            }
        }
    }

    /// Whether two causes are one to every record.
    fn same(&self, a: &Cause, b: &Cause) -> bool {
        let both = |x: &str, y: &str| {
            let ids = (a.kind.id(), b.kind.id());
            ids == (x, y) || ids == (y, x)
        };
        let one_joint = self.robot.joints.len() == 1;
        let whole = a.kind.id() == b.kind.id() && (a.joint == b.joint || !a.kind.has_joint());
        whole
            || same_place(a, &b.kind, b.joint)
            || (one_joint && both("input_delay", "sensor_delay"))
            || (self.one_axis && both("base_tilt", "encoder_offset"))
    }

    fn causes(&self, drawn: &[Candidate]) -> Vec<Cause> {
        drawn.iter().map(|c| self.cause(c)).collect()
    }

    fn cause(&self, c: &Candidate) -> Cause {
        let (robot, n) = (self.robot, self.robot.joints.len());
        let inertia = robot.inertia(self.nominal);
        let size = |j: usize| sizes(robot, &inertia, j);
        let partner = (n > 1).then(|| size(if c.joint > 0 { c.joint - 1 } else { 1 }));
        let mut random = ChaCha8Rng::seed_from_u64(c.seed);
        let mut kind = magnitudes::draw(
            c.index,
            c.strength,
            &size(c.joint),
            robot.planar,
            partner,
            &mut random,
        );
        match &mut kind {
            // As often and as long at every rate.
            Kind::DroppedCommands {
                probability,
                length,
            } => {
                *probability *= RATE / robot.rate;
                *length = ((*length as f64 * robot.rate / RATE) as usize).max(1);
            }
            Kind::ExternalForce { windows, .. } => {
                for edge in windows.iter_mut().flatten() {
                    *edge *= robot.length / LENGTH;
                }
            }
            _ => {}
        }
        Cause {
            kind,
            joint: c.joint,
        }
    }
}

/// Moves each strength towards an equal part of a gap of `goal` floors: squared gaps grow about as
/// squared strengths.
fn resize(drawn: &mut [Candidate], found: &Gaps, goal: f64) {
    let wanted = (goal * goal - 1.0) * found.all.max(FLOOR).powi(2) / drawn.len() as f64;
    let whole = found.none.powi(2) - found.all.powi(2);
    for (c, part) in drawn.iter_mut().zip(&found.parts) {
        let own = part.share * whole;
        let factor = if own > 0.0 {
            (wanted / own).sqrt().clamp(0.4, 2.5)
        } else {
            2.5
        };
        c.strength = (c.strength * factor).clamp(STRENGTH.0, STRENGTH.1);
    }
}

/// The cause of the least share.
fn weakest(found: &Gaps) -> usize {
    let shares = found.parts.iter().map(|p| p.share).enumerate();
    shares
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(0, |(i, _)| i)
}
