//! Nodes and steps of the windows: what is measured there, and where the search starts.

use pid_nlp::solver::kkt::layout::{Layout, Window};

use super::steps::Step;
use crate::transcribe::fit::Fit;
use crate::transcribe::setup::Track;

/// Nodes and steps of all windows.
pub(super) struct Grid {
    pub(super) steps: Vec<Step>,
    /// Position of the state of each node among the variables, and whether it is one of the samples.
    pub(super) nodes: Vec<usize>,
    pub(super) sampled: Vec<bool>,
    pub(super) u: Vec<f64>,
    pub(super) start: Vec<f64>,
    /// Samples of the windows so far, and of all.
    samples: (usize, usize),
    substeps: usize,
}

impl Grid {
    /// Without windows; `samples`: how many there will be.
    pub(super) fn new(layout: &Layout, samples: usize, substeps: usize) -> Self {
        Self {
            steps: Vec::new(),
            nodes: Vec::new(),
            sampled: Vec::new(),
            u: Vec::new(),
            start: vec![0.0; layout.n()],
            samples: (0, samples),
            substeps,
        }
    }

    /// Adds a window.
    pub(super) fn push(&mut self, layout: &Layout, window: &Window, track: &Track, fit: &mut Fit) {
        assert_eq!(
            track.measured.len(),
            fit.channels() * track.t.len(),
            "measured states fit the times"
        );
        self.push_nodes(layout, window, track, fit);
        self.push_steps(layout, window, track);
        self.samples.0 += track.t.len();
        self.u.extend_from_slice(&track.u);
    }

    fn push_nodes(&mut self, layout: &Layout, window: &Window, track: &Track, fit: &mut Fit) {
        let (nx, channels) = (layout.nx, fit.channels());
        for node in 0..=window.steps {
            let at = layout.state(window, node);
            let (k, part) = (node / self.substeps, node % self.substeps);
            let from = part as f64 / self.substeps as f64;
            let guess = &track.guess[k * nx..];
            self.nodes.push(at);
            self.sampled.push(part == 0);
            for i in 0..nx {
                self.start[at + i] = if part == 0 {
                    guess[i]
                } else {
                    (1.0 - from) * guess[i] + from * guess[nx + i]
                };
            }
            if part == 0 {
                let measured = &track.measured[k * channels..(k + 1) * channels];
                let weight = |c| track.weight(k, c, channels) / self.samples.1 as f64;
                fit.push(measured.iter().copied(), (0..channels).map(weight));
            } else {
                fit.push_empty();
            }
        }
    }

    fn push_steps(&mut self, layout: &Layout, window: &Window, track: &Track) {
        let (nx, nq) = (layout.nx, layout.nx / 2);
        let stages = layout.ny - nx;
        let mut interval = 0.0_f64;
        for node in 0..window.steps {
            let (k, part) = (node / self.substeps, node % self.substeps);
            // Times written in decimals differ in their last bits: equal steps are made equal.
            let difference = track.t[k + 1] - track.t[k];
            if node == 0 || (difference - interval).abs() > 1e-9 * interval {
                interval = difference;
            }
            let (x, y) = (layout.state(window, node), layout.step(window, node));
            for entry in 0..stages {
                let j = nq + entry % nq;
                let rise = track.guess[(k + 1) * nx + j] - track.guess[k * nx + j];
                self.start[y + entry] = rise / interval;
            }
            self.steps.push(Step {
                x,
                y,
                h: interval / self.substeps as f64,
                sample: self.samples.0 + k,
                from: part as f64 / self.substeps as f64,
                share: 1.0 / self.substeps as f64,
            });
        }
    }
}
