//! How records are untidy: clocks, losses, outliers, coloured noise, measured currents.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// How the records of a case are untidy; the default is tidy.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Mess {
    /// Largest lateness of a sample, share of a period.
    pub jitter: f64,
    /// Standard deviation of a time stamp about the true time, share of a period.
    pub stamp: f64,
    /// Share of rows or cells that get lost.
    pub lost: f64,
    /// Whether single cells get lost, not rows.
    pub cells: bool,
    /// Wrong readings per second of a record.
    pub outliers: f64,
    /// Corner of the noise of positions, Hz; `None`: white.
    pub colour: Option<f64>,
    /// How currents are measured; `None`: the command is recorded.
    pub current: Option<Current>,
}

/// A current sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Current {
    /// Standard deviation, share of the largest usual torque.
    pub noise: f64,
    /// Corner of its filter of first order, Hz.
    pub corner: f64,
}

impl Mess {
    /// Draws each kind of untidiness.
    pub(crate) fn draw(random: &mut ChaCha8Rng) -> Self {
        let (noise, corner) = (
            random.random_range(0.002..0.007),
            random.random_range(250.0..450.0),
        );
        Self {
            jitter: random.random_range(0.0..0.12),
            stamp: random.random_range(0.01..0.03),
            lost: random.random_range(0.0..0.005),
            cells: random.random_bool(0.5),
            outliers: random.random_range(0.0..0.3),
            colour: Some(random.random_range(10.0..30.0)),
            current: (random.random_bool(0.5)).then_some(Current { noise, corner }),
        }
    }
}
