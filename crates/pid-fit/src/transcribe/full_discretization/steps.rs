//! The steps of all windows, and work on them: four at a time, in parallel where they are many.

use pid_runtime::lanes::LANES;
use rayon::prelude::*;

use crate::transcribe::step::Interval;
use crate::transcribe::step_lanes::{LaneScratch, Steps};

/// One step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Position of x_k and of y_k among the variables.
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) h: f64,
    /// Index of the sample at or before its start.
    pub(super) sample: usize,
    /// Where it starts in its sampling interval, and the share it covers.
    pub(super) from: f64,
    pub(super) share: f64,
}

/// Steps below which everything runs on the calling thread.
const PARALLEL_STEPS: usize = 1500;
/// The number of parts of the steps. Threads share the parts, and sums run over parts, so it must
/// not depend on the number of threads.
const CHUNKS: usize = 64;

/// Steps handled by one task, of this many.
pub(super) fn chunk(steps: usize) -> usize {
    if steps < PARALLEL_STEPS {
        return steps.max(1);
    }
    steps.div_ceil(CHUNKS).max(64).next_multiple_of(LANES)
}

/// Arguments of a step beside the rule, kept apart from the scratch so that steps run in parallel.
pub(super) struct Point<'a> {
    pub(super) x: &'a [f64],
    pub(super) u: &'a [f64],
    pub(super) nu: usize,
    pub(super) nx: usize,
    pub(super) ny: usize,
}

impl Point<'_> {
    /// At most four steps: states at their starts, unknowns, intervals.
    pub(super) fn of(&self, steps: &[Step]) -> Steps<'_> {
        let step = |l: usize| &steps[l.min(steps.len() - 1)];
        let inputs = |sample: usize| &self.u[sample * self.nu..][..self.nu];
        let lanes = [0, 1, 2, 3].map(step);
        Steps {
            x: lanes.map(|s| &self.x[s.x..][..self.nx]),
            y: lanes.map(|s| &self.x[s.y..][..self.ny]),
            interval: lanes.map(|s| Interval {
                h: s.h,
                u0: inputs(s.sample),
                u1: inputs(s.sample + 1),
                from: s.from,
                share: s.share,
            }),
            count: steps.len(),
        }
    }
}

/// Calls `work` on the steps, four at a time with the position of the first and their slice of
/// `out` (`size` values a step), in parallel for long problems.
pub(super) fn for_steps(
    steps: &[Step],
    chunk: usize,
    scratch: &mut [LaneScratch],
    out: &mut [f64],
    size: usize,
    work: impl Fn(usize, &[Step], &mut LaneScratch, &mut [f64]) + Sync,
) {
    let run = |first: usize, steps: &[Step], scratch: &mut LaneScratch, out: &mut [f64]| {
        for (k, steps) in steps.chunks(LANES).enumerate() {
            scratch.slot = k;
            let from = LANES * k * size;
            let out = &mut out[from..from + steps.len() * size];
            work(first + LANES * k, steps, scratch, out);
        }
    };
    if scratch.len() == 1 || size == 0 {
        run(0, steps, &mut scratch[0], out);
        return;
    }
    steps
        .par_chunks(chunk)
        .zip(scratch.par_iter_mut())
        .zip(out.par_chunks_mut((chunk * size).max(1)))
        .enumerate()
        .for_each(|(i, ((steps, scratch), out))| run(i * chunk, steps, scratch, out));
}
