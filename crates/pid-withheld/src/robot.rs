//! A drawn robot before it becomes text; SI units.

use pid_interpret::nominal::Nominal;

use crate::motion::Room;
use crate::plant::{PER_JOINT, Plant};

/// Corner of the filter behind a derived velocity, Hz.
pub(crate) const VELOCITY_HZ: f64 = 40.0;

/// One joint before it becomes text.
pub(crate) struct Joint {
    pub(crate) prismatic: bool,
    pub(crate) axis: [f64; 3],
    /// Position in the frame of the link before.
    pub(crate) origin: [f64; 3],
    pub(crate) mass: f64,
    /// Centre of mass in the link's frame.
    pub(crate) com: [f64; 3],
    /// Principal moments about the centre of mass.
    pub(crate) inertia: [f64; 3],
    /// Inertia of the rotor, seen by the joint.
    pub(crate) rotor: f64,
    pub(crate) coulomb: f64,
    pub(crate) viscous: f64,
    /// Torque or force per ampere.
    pub(crate) gain: f64,
    /// Largest usual torque or force.
    pub(crate) torque: f64,
    /// Standard deviation of a position reading.
    pub(crate) q_noise: f64,
    /// Step of the encoder.
    pub(crate) q_step: f64,
    /// Standard deviation of a velocity reading.
    pub(crate) v_noise: f64,
    /// Where it may move.
    pub(crate) room: Room,
    /// A radian, or the unit of length of a slide.
    pub(crate) length: f64,
}

pub(crate) struct Robot {
    pub(crate) joints: Vec<Joint>,
    /// Tool point in the last link's frame.
    pub(crate) tool: [f64; 3],
    /// Whether all hinges turn about y and all slides go along x.
    pub(crate) planar: bool,
    /// Readings per second.
    pub(crate) rate: f64,
    /// Window of a free run.
    pub(crate) horizon: f64,
    /// Noise of the drive, share of the largest usual torque.
    pub(crate) drive_noise: f64,
    /// Length of a record, s.
    pub(crate) length: f64,
    /// How far the stated values may be off.
    pub(crate) tolerance: Tolerance,
}

/// Half widths of the stated values; all but that of the centre of mass are shares.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tolerance {
    pub(crate) mass: f64,
    /// Centre of mass, m.
    pub(crate) com: f64,
    /// Share of the largest moment.
    pub(crate) inertia: f64,
    pub(crate) rotor: f64,
    pub(crate) gain: f64,
    pub(crate) friction: f64,
}

impl Tolerance {
    /// Of a robot that was measured part by part.
    pub(crate) const TIGHT: Self = Self {
        mass: 0.05,
        com: 0.003,
        inertia: 0.05,
        rotor: 0.05,
        gain: 0.01,
        friction: 0.4,
    };
    /// Of a robot known from drawings: friction is within a factor of two.
    pub(crate) const LOOSE: Self = Self {
        mass: 0.2,
        com: 0.01,
        inertia: 0.3,
        rotor: 0.2,
        gain: 0.03,
        friction: 1.0,
    };
}

impl Robot {
    /// Diagonal of the mass matrix with rotors, in the middle of the motion.
    pub(crate) fn inertia(&self, nominal: &Nominal) -> Vec<f64> {
        let n = self.joints.len();
        let plant = Plant::<f64>::new(nominal, &vec![0.0; n * PER_JOINT]);
        let q: Vec<f64> = self.joints.iter().map(|j| j.room.centre).collect();
        let (m, _) = plant.mass_and_bias(&q, &vec![0.0; n]);
        (0..n).map(|j| m[(j, j)] + plant.rotor[j]).collect()
    }

    /// Largest torque of gravity at each joint, at the middle of the motion and at the ends of its own.
    pub(crate) fn pull(&self, nominal: &Nominal) -> Vec<f64> {
        let n = self.joints.len();
        let plant = Plant::<f64>::new(nominal, &vec![0.0; n * PER_JOINT]);
        let at = |j: usize, side: f64| {
            let mut q: Vec<f64> = self.joints.iter().map(|j| j.room.centre).collect();
            q[j] += side * self.joints[j].room.amplitude;
            plant.mass_and_bias(&q, &vec![0.0; n]).1[j].abs()
        };
        let most = |j| [-1.0, 0.0, 1.0].map(|side| at(j, side)).into_iter();
        (0..n).map(|j| most(j).fold(0.0, f64::max)).collect()
    }
}
