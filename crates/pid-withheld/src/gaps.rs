//! What each cause of a case has of the gap of [free runs](crate::replay).
//!
//! With F = G(all), which noise leaves,
//!
//! ```text
//! left_out(e) = (G(all but e)² − F²) / (G(none)² − F²)
//! left_in(e)  = (G(none)² − G(e)²) / (G(none)² − F²)
//! ```
//!
//! and the share of e is the mean of both, scaled to the sum 1. Causes interact: neither left_out nor
//! left_in need sum to 1.

use serde::{Deserialize, Serialize};

use crate::record::Run;
use crate::refit::Refit;
use crate::replay::{LARGEST, errors, mean_square};
use crate::setup::Setup;

/// What one cause has of the gap.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Share of the squared gap beyond the floor; those of a case sum to 1.
    pub share: f64,
    /// What is lost without it.
    pub left_out: f64,
    /// What it explains alone.
    pub left_in: f64,
}

/// The study's own gaps of a case on its test records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gaps {
    /// Gap without a cause.
    pub none: f64,
    /// Gap with all of them: the study's own floor.
    pub all: f64,
    /// Cause by cause.
    pub parts: Vec<Part>,
}

impl Gaps {
    /// From free runs on the test records `runs`, cut into windows of `window` rows; `rough`: near enough for
    /// a draw.
    pub(crate) fn new(setup: &Setup<'_>, runs: &[Run], window: usize, rough: bool) -> Self {
        let count = setup.causes.len();
        let all = mean_square(&errors(setup, runs, window, &|_| true));
        let refit = (count > 0).then(|| Refit::new(setup, runs, window, (all, rough)));
        let square = |on: &(dyn Fn(usize) -> bool + Sync)| match &refit {
            None => all,
            Some(refit) => refit.square(setup, runs, window, on),
        };
        let none = square(&|_| false).max(all);
        let whole = (none - all).max(1e-300);
        let mut parts: Vec<Part> = (0..count)
            .map(|e| {
                let (without, alone) = match count {
                    1 => (none, all),
                    _ => (square(&|i| i != e), square(&|i| i == e)),
                };
                // What the nominal values take up is nothing, and no less.
                let part = |x: f64| (x / whole).clamp(0.0, 1.0);
                let (left_out, left_in) = (part(without - all), part(none - alone));
                Part {
                    share: 0.5 * (left_out + left_in),
                    left_out,
                    left_in,
                }
            })
            .collect();
        let sum: f64 = parts.iter().map(|p| p.share).sum();
        for p in &mut parts {
            p.share = if sum > 0.0 {
                p.share / sum
            } else {
                1.0 / count as f64
            };
        }
        Self {
            none: none.sqrt(),
            all: all.sqrt(),
            parts,
        }
    }

    /// Of a robot that its controller does not hold: far too large.
    pub(crate) fn out_of_hand(causes: usize) -> Self {
        let share = 1.0 / causes.max(1) as f64;
        let part = Part {
            share,
            left_out: share,
            left_in: share,
        };
        Self {
            none: LARGEST * LARGEST,
            all: 1.0,
            parts: vec![part; causes],
        }
    }

    /// Whether the controller holds the robot.
    pub(crate) fn held(&self) -> bool {
        self.none < LARGEST * LARGEST
    }

    /// The least share; 1 where nothing is missing.
    pub(crate) fn least(&self) -> f64 {
        let shares = self.parts.iter().map(|p| p.share);
        shares.fold(1.0, |a, b| if b.is_finite() { a.min(b) } else { -1.0 })
    }
}
