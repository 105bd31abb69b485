//! Encoders and velocities as they are read, with what is wrong about them.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::causes::{Cause, Kind};
use crate::robot::{Robot, VELOCITY_HZ};
use crate::world::STEP;

/// Normal number of mean 0 and standard deviation 1.
pub(crate) fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

/// Position and speed of the encoders at the ends of the steps so far: step by step, joint by joint.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track {
    /// The step at whose end the first place is.
    pub(crate) first: usize,
    pub(crate) places: Vec<Vec<(f64, f64)>>,
}

impl Track {
    /// Position and speed of the joint `j` at a time in steps; straight on beyond the last step.
    fn at(&self, j: usize, steps: f64) -> (f64, f64) {
        let now = self.places.len() - 1;
        let at = (steps - self.first as f64).max(0.0);
        if at > now as f64 {
            let (x, w) = self.places[now][j];
            return (x + w * (at - now as f64) * STEP, w);
        }
        let (i, s) = (at.floor() as usize, at.fract());
        let ((qa, va), (qb, vb)) = (self.places[i][j], self.places[(i + 1).min(now)][j]);
        (qa * (1.0 - s) + qb * s, va * (1.0 - s) + vb * s)
    }
}

/// Position and speed that reach the reading of the joint `j` at a time in steps: late, shifted,
/// eccentric.
pub(crate) fn sensed(causes: &[Cause], track: &Track, steps: f64, j: usize) -> (f64, f64) {
    let delay = causes
        .iter()
        .find_map(|c| match c.kind {
            Kind::SensorDelay { delay } if c.joint == j => Some(delay / STEP),
            _ => None,
        })
        .unwrap_or(0.0);
    prompt(causes, track.at(j, steps - delay), j)
}

/// The same of a place of the encoder, at once: what the loop of a drive reads.
pub(crate) fn prompt(causes: &[Cause], (mut x, mut w): (f64, f64), j: usize) -> (f64, f64) {
    for c in causes.iter().filter(|c| c.joint == j) {
        match c.kind {
            Kind::EncoderOffset { offset } => x += offset,
            Kind::EncoderEccentricity { amplitude, phase } => {
                w *= 1.0 + amplitude * (x + phase).cos();
                x += amplitude * (x + phase).sin();
            }
            _ => {}
        }
    }
    (x, w)
}

/// Noise of position readings: white, or of first order with a corner.
pub(crate) struct Colour {
    /// Share of the reading before, and of what is new.
    keep: (f64, f64),
    now: Vec<f64>,
}

impl Colour {
    /// Of `n` joints at the sample time `h`, s; `corner`, Hz: `None` for white noise.
    pub(crate) fn new(n: usize, corner: Option<f64>, h: f64) -> Self {
        let keep = corner.map_or(0.0, |hz| (-std::f64::consts::TAU * hz * h).exp());
        Self {
            keep: (keep, (1.0 - keep * keep).sqrt()),
            now: vec![0.0; n],
        }
    }

    /// The next noise of the joint `j`, standard deviation 1.
    fn next(&mut self, j: usize, random: &mut ChaCha8Rng) -> f64 {
        self.now[j] = self.keep.0 * self.now[j] + self.keep.1 * normal(random);
        self.now[j]
    }
}

/// Encoders and velocities, sample by sample.
pub(crate) struct Sensors<'a> {
    robot: &'a Robot,
    causes: &'a [Cause],
    measured: bool,
    h: f64,
    /// Forgetting of the filter behind a derived velocity, per sample.
    fade: f64,
    /// Derived velocities.
    pub(crate) filtered: Vec<f64>,
    /// Velocities behind a lag.
    shown: Vec<f64>,
    previous: Vec<Option<f64>>,
}

impl<'a> Sensors<'a> {
    /// `velocity`: `measured`, `derived` or `absent`.
    pub(crate) fn new(robot: &'a Robot, causes: &'a [Cause], velocity: &str) -> Self {
        let (n, h) = (robot.joints.len(), 1.0 / robot.rate);
        Self {
            robot,
            causes,
            measured: velocity == "measured",
            h,
            fade: (-std::f64::consts::TAU * VELOCITY_HZ * h).exp(),
            filtered: vec![0.0; n],
            shown: vec![0.0; n],
            previous: vec![None; n],
        }
    }

    /// Goes on from the readings `q` and `v`.
    pub(crate) fn resume(&mut self, q: &[f64], v: &[f64]) {
        self.previous = q.iter().map(|&q| Some(q)).collect();
        self.filtered.copy_from_slice(v);
        self.shown.copy_from_slice(v);
    }

    /// Readings of positions and velocities at a time in steps, `elapsed` seconds after the last;
    /// without `noise` neither noise nor quantisation.
    pub(crate) fn read(
        &mut self,
        track: &Track,
        steps: f64,
        elapsed: f64,
        mut noise: Option<(&mut Colour, &mut ChaCha8Rng)>,
    ) -> (Vec<f64>, Vec<f64>) {
        let n = self.previous.len();
        let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
        for j in 0..n {
            let (x, w) = sensed(self.causes, track, steps, j);
            let joint = &self.robot.joints[j];
            q[j] = match &mut noise {
                None => x,
                Some((colour, random)) => {
                    let noisy = x + joint.q_noise * colour.next(j, random);
                    (noisy / joint.q_step).round() * joint.q_step
                }
            };
            // The firmware knows when it reads.
            let difference = (q[j] - self.previous[j].unwrap_or(q[j])) / elapsed;
            self.previous[j] = Some(q[j]);
            self.filtered[j] = self.fade * self.filtered[j] + (1.0 - self.fade) * difference;
            let mut read = if self.measured { w } else { self.filtered[j] };
            let lag = self.causes.iter().find_map(|c| match c.kind {
                Kind::VelocityFilterLag { time } if c.joint == j => Some((-self.h / time).exp()),
                _ => None,
            });
            if let Some(a) = lag {
                self.shown[j] = a * self.shown[j] + (1.0 - a) * read;
                read = self.shown[j];
            }
            if let (true, Some((_, random))) = (self.measured, &mut noise) {
                read += joint.v_noise * normal(random);
            }
            v[j] = read;
        }
        (q, v)
    }
}
