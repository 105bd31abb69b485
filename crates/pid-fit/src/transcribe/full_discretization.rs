//! Full discretization: the states at every sample are unknowns, the scheme's steps are constraints.
//!
//! ```text
//! minimise    J = 1/N Σ_i Σ_c w_c (x_c(t_i) − x^d_c(t_i))²
//! subject to  c_k(x_k, s_k, x_{k+1}, p) = 0      for every step of every window
//!             p in its bounds
//! ```
//!
//! (K. Schäfer et al., Section III-C, with x = (q, v), several windows, weights and missing
//! samples.) The dynamic rows are the implicit residual times h / M_jj, so that all rows are
//! changes of state: nothing is inverted, and the problem is affine in the inertial parameters.

use super::bodies::{Barrier, Body};
use super::explicit_form::ExplicitForm;
use super::fit::{Fit, FitScratch, Output};
use super::loss::{Loss, Prior, prior_terms};
use super::scheme::Scheme;
use super::step::{Interval, Rule};
use super::step_lanes::{LaneScratch, Steps};
use super::tableau::Tableau;
use pid_nlp::solver::kkt::layout::Layout;
use pid_nlp::solver::kkt::structured::StructuredKkt;
use pid_nlp::{Nlp, SparsePattern};
use pid_runtime::dynamics::Hessian;
use pid_runtime::lanes::LANES;
use rayon::prelude::*;

/// A window of samples to follow.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Times, s, strictly increasing; at least two.
    pub t: Vec<f64>,
    /// Measured states (q, v) sample by sample, length `2 nq` each, or measured outputs; NaN where
    /// nothing was measured.
    pub measured: Vec<f64>,
    /// States to start from, same layout, finite. Held initial states take their value from here.
    pub guess: Vec<f64>,
    /// Inputs sample by sample, `nu` each.
    pub u: Vec<f64>,
    /// Weight per channel in this window (length `2 nq`, or that of the output); 1 each is the
    /// paper's objective. Or one per channel and sample, laid out like `measured`.
    pub weights: Vec<f64>,
}

impl Track {
    /// Weight of a channel at a sample.
    pub(super) fn weight(&self, sample: usize, channel: usize, channels: usize) -> f64 {
        if self.weights.len() == channels {
            self.weights[channel]
        } else {
            self.weights[sample * channels + channel]
        }
    }
}

/// Settings of the discretization.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// One-step scheme.
    pub scheme: Scheme,
    /// Second derivatives given to the solver.
    pub curvature: Curvature,
    /// Parameter bounds, `np` each; equal ones fix a parameter.
    pub lower: Vec<f64>,
    /// Upper bounds.
    pub upper: Vec<f64>,
    /// Unit of each parameter's variable in the program (positive).
    pub scale: Vec<f64>,
    /// Typical diagonal of M, kg·m² or kg, that makes the dynamic rows changes of velocity.
    pub inertia: Vec<f64>,
    /// Whether the initial state of each window is held at its first value.
    pub hold_initial: bool,
    /// Whether inputs move linearly between samples (otherwise they are held).
    pub linear_inputs: bool,
    /// Steps per sampling interval, at least 1: the integration grid is the data grid refined by it.
    pub substeps: usize,
    /// Measured output; `None` for the state itself.
    pub output: Option<Output>,
    /// Loss of deviations.
    pub loss: Loss,
    /// Prior knowledge of parameters; meant for weights of one over the variance of the noise.
    pub priors: Vec<Prior>,
    /// Links that stay bodies of positive density. A start must have such links.
    pub bodies: Vec<Body>,
    /// Smallest weight of their barrier in the objective times the number of samples.
    pub bodies_weight: f64,
}

/// Second derivatives given to the solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Curvature {
    /// The exact Hessian of the Lagrangian.
    Exact,
    /// The Hessian of the objective alone (for least squares: Gauss-Newton).
    GaussNewton,
}

#[derive(Debug, Clone, Copy)]
struct Step {
    /// Position of x_k and of y_k among the variables.
    x: usize,
    y: usize,
    h: f64,
    /// Index of the sample at or before its start.
    sample: usize,
    /// Where it starts in its sampling interval, and the share it covers.
    from: f64,
    share: f64,
}

/// The program; see the module's documentation.
pub struct FullDiscretization<'m> {
    rule: Rule<'m>,
    layout: Layout,
    setup: Setup,
    steps: Vec<Step>,
    /// Position of the state of each node among the variables, and whether it is one of the samples.
    nodes: Vec<usize>,
    sampled: Vec<bool>,
    /// Node by node; nothing is measured between samples.
    fit: Fit,
    fit_scratch: FitScratch,
    start: Vec<f64>,
    barrier: Barrier,
    /// 1/N.
    share: f64,
    u: Vec<f64>,
    jacobian_pattern: SparsePattern,
    hessian_pattern: SparsePattern,
    parameters: Vec<f64>,
    /// Steps handled by one task.
    chunk: usize,
    scratch: Vec<LaneScratch>,
}

/// Steps below which everything runs on the calling thread.
const PARALLEL_STEPS: usize = 1500;
/// The number of parts of the steps. Threads share the parts, and sums run over parts, so it must
/// not depend on the number of threads.
const CHUNKS: usize = 64;

impl<'m> FullDiscretization<'m> {
    /// Builds the program for a set of windows.
    ///
    /// # Panics
    /// If lengths disagree with the model's dimensions: callers build tracks and setups from checked data.
    pub fn new(model: &'m dyn Hessian, tracks: &[Track], setup: Setup) -> Self {
        let rule = rule(model, Tableau::new(setup.scheme), &setup);
        Self::with(rule, tracks, setup)
    }

    /// Builds the program for a model with its accelerations solved for. The trapezoidal rule then
    /// needs no stage accelerations: it has two thirds of the unknowns for the same motions.
    ///
    /// # Panics
    /// As [`FullDiscretization::new`].
    pub fn solved(form: &'m ExplicitForm<'m>, tracks: &[Track], setup: Setup) -> Self {
        let rule = rule(form, Tableau::solved(setup.scheme), &setup).remembering(form);
        Self::with(rule, tracks, setup)
    }

    fn with(rule: Rule<'m>, tracks: &[Track], setup: Setup) -> Self {
        let dims = rule.model().dims();
        let (nq, nx) = (dims.nq, 2 * dims.nq);
        assert_eq!(setup.scale.len(), dims.np, "setup fits the model");
        assert!(setup.substeps > 0, "a sampling interval has steps");
        let ny = rule.ny();
        let stages = ny - nx;
        let lengths: Vec<usize> = tracks
            .iter()
            .map(|t| (t.t.len() - 1) * setup.substeps)
            .collect();
        let layout = Layout {
            nx,
            ny,
            np: dims.np,
            windows: Layout::windows(nx, ny, &lengths, setup.hold_initial),
            step_jacobian: rule.expansion().step_jacobian.clone(),
            step_hessian: step_hessian(&rule, nx, dims.np, setup.output.is_some()),
            parameter_hessian: parameter_hessian(&rule, dims.np, &setup),
        };
        let samples: usize = tracks.iter().map(|t| t.t.len()).sum();
        let mut fit = Fit::new(nx, dims.np, setup.output.clone(), setup.loss, samples);
        let channels = fit.channels();
        let (mut steps, mut nodes, mut sampled) = (Vec::new(), Vec::new(), Vec::new());
        let mut u = Vec::new();
        let mut start = vec![0.0; layout.n()];
        let mut first_sample = 0;
        for (track, window) in tracks.iter().zip(&layout.windows) {
            assert_eq!(
                track.measured.len(),
                channels * track.t.len(),
                "measured states fit the times"
            );
            for node in 0..=window.steps {
                let at = layout.state(window, node);
                let (k, part) = (node / setup.substeps, node % setup.substeps);
                let from = part as f64 / setup.substeps as f64;
                let guess = &track.guess[k * nx..];
                nodes.push(at);
                sampled.push(part == 0);
                for i in 0..nx {
                    start[at + i] = if part == 0 {
                        guess[i]
                    } else {
                        (1.0 - from) * guess[i] + from * guess[nx + i]
                    };
                }
                if part == 0 {
                    let measured = &track.measured[k * channels..(k + 1) * channels];
                    let weight = |c| track.weight(k, c, channels) / samples as f64;
                    fit.push(measured.iter().copied(), (0..channels).map(weight));
                } else {
                    fit.push_empty();
                }
            }
            let mut interval = 0.0_f64;
            for node in 0..window.steps {
                let (k, part) = (node / setup.substeps, node % setup.substeps);
                // Times written in decimals differ in their last bits: equal steps are made equal.
                let difference = track.t[k + 1] - track.t[k];
                if node == 0 || (difference - interval).abs() > 1e-9 * interval {
                    interval = difference;
                }
                let (x, y) = (layout.state(window, node), layout.step(window, node));
                for entry in 0..stages {
                    let j = nq + entry % nq;
                    let rise = track.guess[(k + 1) * nx + j] - track.guess[k * nx + j];
                    start[y + entry] = rise / interval;
                }
                steps.push(Step {
                    x,
                    y,
                    h: interval / setup.substeps as f64,
                    sample: first_sample + k,
                    from: part as f64 / setup.substeps as f64,
                    share: 1.0 / setup.substeps as f64,
                });
            }
            first_sample += track.t.len();
            u.extend_from_slice(&track.u);
        }
        let chunk = if steps.len() < PARALLEL_STEPS {
            steps.len().max(1)
        } else {
            let each = steps.len().div_ceil(CHUNKS);
            each.max(64).next_multiple_of(LANES)
        };
        let scratch = (0..steps.len().div_ceil(chunk))
            .map(|_| rule.lane_scratch())
            .collect();
        let floor = setup.bodies_weight / samples.max(1) as f64;
        let barrier = Barrier::new(&setup.bodies, &setup.scale, floor);
        Self {
            jacobian_pattern: layout.jacobian_pattern(),
            hessian_pattern: layout.hessian_pattern(),
            parameters: vec![0.0; dims.np],
            rule,
            layout,
            setup,
            steps,
            nodes,
            sampled,
            fit_scratch: fit.scratch(),
            fit,
            start,
            barrier,
            share: 1.0 / samples.max(1) as f64,
            u,
            chunk,
            scratch,
        }
    }

    /// Where unknowns and values stand; what [`pid_nlp::solver::kkt::structured::StructuredKkt`] needs.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The model.
    pub fn model(&self) -> &'m dyn Hessian {
        self.rule.model()
    }

    /// Steps that are condensed together. Explicit schemes of many stages get few, since their
    /// steps may grow a stiff motion by their polynomial of that degree; rounding errors then stay
    /// bounded.
    pub fn segment_steps(&self) -> usize {
        match self.setup.scheme {
            Scheme::Heun => 4,
            Scheme::RungeKutta4 | Scheme::DormandPrince => 3,
            _ => 10,
        }
    }

    /// The linear system of the program, some parameters held.
    pub fn system(&self, held: &[bool]) -> StructuredKkt {
        self.system_of(self.layout.clone(), held)
    }

    /// The same with a layout of more entries.
    pub(super) fn system_of(&self, layout: Layout, held: &[bool]) -> StructuredKkt {
        let kkt = StructuredKkt::new(layout, held, self.segment_steps());
        if self.setup.scheme.explicit() {
            // Explicit steps grow stiff motions, explicit Euler sevenfold near rest; the lengths
            // above allow for it.
            kkt.growing_to(1e9)
        } else {
            kkt
        }
    }

    /// Number of samples in all windows; with one step per sample, that of the nodes.
    pub fn samples(&self) -> usize {
        self.sampled.iter().filter(|s| **s).count()
    }

    /// The setup the program was built with.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Which parameters are held.
    pub fn fixed_parameters(&self) -> Vec<bool> {
        self.setup
            .lower
            .iter()
            .zip(&self.setup.upper)
            .map(|(l, u)| l == u)
            .collect()
    }

    /// Starting point: states from the tracks' guesses, the given parameters.
    pub fn starting_point(&self, parameters: &[f64]) -> Vec<f64> {
        let mut x = self.start.clone();
        let p = self.layout.p();
        for j in 0..self.layout.np {
            x[p + j] = parameters[j] / self.setup.scale[j];
        }
        x
    }

    /// The parameters in a point, in their own units.
    pub fn parameters(&self, x: &[f64]) -> Vec<f64> {
        x[self.layout.p()..]
            .iter()
            .zip(&self.setup.scale)
            .map(|(p, s)| p * s)
            .collect()
    }

    /// The states in a point, sample by sample, windows one after another.
    pub fn states(&self, x: &[f64]) -> Vec<f64> {
        self.nodes
            .iter()
            .zip(&self.sampled)
            .filter(|(_, sampled)| **sampled)
            .flat_map(|(&at, _)| &x[at..at + self.layout.nx])
            .copied()
            .collect()
    }

    /// Weighted residuals `√w (y − d)` sample by sample, and the number of channels; NaN where
    /// nothing was measured and in a row between two windows.
    pub fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize) {
        self.load_parameters(x);
        let (nx, channels) = (self.layout.nx, self.fit.channels());
        let mut out = Vec::with_capacity(channels * (self.nodes.len() + self.layout.windows.len()));
        for window in &self.layout.windows {
            let nodes = window.first_node..=window.first_node + window.steps;
            for k in nodes.filter(|k| self.sampled[*k]) {
                let state = &x[self.nodes[k]..self.nodes[k] + nx];
                let scratch = &mut self.fit_scratch;
                self.fit
                    .residual(k, state, &self.parameters, scratch, &mut out);
            }
            out.extend(std::iter::repeat_n(f64::NAN, channels));
        }
        (out, channels)
    }

    /// Gradient of each window's part of the objective by the parameters' variables, its states
    /// eliminated: `np` values a window, at a solution with the multipliers `lambda`. Priors belong
    /// to no window.
    pub fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64> {
        let (nx, ny, np) = (self.layout.nx, self.layout.ny, self.layout.np);
        let mut values = vec![0.0; self.jacobian_pattern.nnz()];
        self.jacobian(x, &mut values);
        let size = self.layout.step_jacobian.len();
        let mut scores = vec![0.0; np * self.layout.windows.len()];
        let mut local = vec![0.0; nx + np];
        for (window, score) in self.layout.windows.iter().zip(scores.chunks_exact_mut(np)) {
            for k in window.first_step..window.first_step + window.steps {
                let step = &values[k * size..(k + 1) * size];
                for ((row, column), value) in self.layout.step_jacobian.iter().zip(step) {
                    if let Some(j) = (*column as usize).checked_sub(nx + ny) {
                        score[j] += lambda[k * ny + *row as usize] * value;
                    }
                }
            }
            if self.fit.is_state() {
                continue;
            }
            for node in window.first_node..=window.first_node + window.steps {
                local.fill(0.0);
                let at = self.nodes[node];
                let (state, scratch) = (&x[at..at + nx], &mut self.fit_scratch);
                let point = (state, self.parameters.as_slice());
                self.fit.gradient(node, point, 1.0, scratch, &mut local);
                for j in 0..np {
                    score[j] += local[nx + j] * self.setup.scale[j];
                }
            }
        }
        scores
    }

    /// Number of unknown entries of initial states.
    pub fn free_initial_states(&self) -> usize {
        self.layout.windows.iter().filter(|w| !w.held).count() * self.layout.nx
    }

    /// Chooses the second derivatives for the solver.
    pub fn set_curvature(&mut self, curvature: Curvature) {
        self.setup.curvature = curvature;
    }

    /// Adds σ ∂²ℓ of outputs that are not the state itself, in the entries that [`step_hessian`] and
    /// [`parameter_hessian`] append for them.
    fn output_hessian(&mut self, x: &[f64], sigma: f64, steps: &mut [f64], parameters: &mut [f64]) {
        if self.fit.is_state() {
            return;
        }
        let (nx, np) = (self.layout.nx, self.layout.np);
        let nz = nx + np;
        let size = self.layout.step_hessian.len();
        let block = nx * (nx + 1) / 2 + np * nx;
        let gauss_newton = self.setup.curvature == Curvature::GaussNewton;
        let scale = |i: usize| {
            if i < nx {
                1.0
            } else {
                self.setup.scale[i - nx]
            }
        };
        let between = parameters.len() - np * (np + 1) / 2;
        let mut local = vec![0.0; nz * nz];
        for window in &self.layout.windows {
            for k in 0..=window.steps {
                let node = window.first_node + k;
                let at = self.nodes[node];
                local.fill(0.0);
                let point = (&x[at..at + nx], self.parameters.as_slice());
                let scratch = &mut self.fit_scratch;
                self.fit
                    .hessian(node, point, sigma, gauss_newton, scratch, &mut local);
                // A node's block stands in the step after it, that of the last node in the step before it.
                let (step, shift) = if k < window.steps {
                    (window.first_step + k, 2 * block)
                } else {
                    (window.first_step + k - 1, block)
                };
                let mut to = (step + 1) * size - shift;
                for i in 0..nz {
                    for j in 0..=i.min(nx - 1) {
                        steps[to] += local[i * nz + j] * scale(i) * scale(j);
                        to += 1;
                    }
                }
                let mut to = between;
                for i in nx..nz {
                    for j in nx..=i {
                        parameters[to] += local[i * nz + j] * scale(i) * scale(j);
                        to += 1;
                    }
                }
            }
        }
    }

    /// The bodies' barrier, and the parameters last loaded.
    pub(super) fn bodies(&self) -> (&Barrier, &[f64]) {
        (&self.barrier, &self.parameters)
    }

    /// Value of the bodies' barrier in the objective at a point.
    pub fn barrier(&mut self, x: &[f64]) -> f64 {
        self.load_parameters(x);
        self.barrier.value(&self.parameters, |_, _| {})
    }

    /// Adds σ ∂² of the priors to the diagonal between parameters.
    fn prior_hessian(&self, sigma: f64, parameters: &mut [f64]) {
        let scale = &self.setup.scale;
        let share = sigma * self.share;
        prior_terms(
            &self.setup.priors,
            &self.parameters,
            share,
            |j, _, curvature| {
                let pair = (j as u32, j as u32);
                let at = self
                    .layout
                    .parameter_hessian
                    .iter()
                    .position(|p| *p == pair);
                let at = at.expect("invariant: the layout has every diagonal entry");
                parameters[at] += curvature * scale[j] * scale[j];
            },
        );
    }

    fn load_parameters(&mut self, x: &[f64]) {
        let p = &x[self.layout.p()..];
        for ((out, p), s) in self.parameters.iter_mut().zip(p).zip(&self.setup.scale) {
            *out = p * s;
        }
    }
}

fn rule<'m>(model: &'m dyn Hessian, tableau: Tableau, setup: &Setup) -> Rule<'m> {
    Rule::new(
        model,
        tableau,
        &setup.scale,
        &setup.inertia,
        setup.linear_inputs,
    )
}

/// Entries of a step's Hessian: those of the rule, then, for outputs that are not the state, the
/// lower triangle over (x_k, p) without the parameters' own part, and that over (x_{k+1}, p).
fn step_hessian(rule: &Rule<'_>, nx: usize, np: usize, mapped: bool) -> Vec<(u32, u32)> {
    let mut entries = rule.expansion().step_hessian.clone();
    if mapped {
        let (ny, first_p) = (rule.ny(), nx + rule.ny());
        for first in [0, ny] {
            let place = |i: usize| if i < nx { first + i } else { first_p + i - nx };
            for i in 0..nx + np {
                let columns = 0..=i.min(nx - 1);
                entries.extend(columns.map(|j| (place(i) as u32, place(j) as u32)));
            }
        }
    }
    entries
}

/// Entries between parameters: those of the rule, then those of the bodies, then, for outputs that
/// are not the state, the lower triangle.
fn parameter_hessian(rule: &Rule<'_>, np: usize, setup: &Setup) -> Vec<(u32, u32)> {
    let mut entries = rule.expansion().parameter_hessian.clone();
    entries.extend(Barrier::pattern(&setup.bodies));
    if setup.output.is_some() {
        let triangle = (0..np as u32).flat_map(|i| (0..=i).map(move |j| (i, j)));
        entries.extend(triangle);
    }
    entries
}

/// Arguments of a step beside the rule, kept apart from the scratch so that steps run in parallel.
struct Point<'a> {
    x: &'a [f64],
    u: &'a [f64],
    nu: usize,
    nx: usize,
    ny: usize,
}

impl Point<'_> {
    /// At most four steps: states at their starts, unknowns, intervals.
    fn of(&self, steps: &[Step]) -> Steps<'_> {
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

/// The shared part of the program, as a [`Point`] at `$x`.
macro_rules! point {
    ($self:ident, $x:expr) => {
        Point {
            x: $x,
            u: &$self.u,
            nu: $self.rule.model().dims().nu,
            nx: $self.layout.nx,
            ny: $self.layout.ny,
        }
    };
}

/// Calls `work` on the steps, four at a time with the position of the first and their slice of
/// `out` (`size` values a step), in parallel for long problems.
fn for_steps(
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

impl Nlp for FullDiscretization<'_> {
    fn n(&self) -> usize {
        self.layout.n()
    }

    fn m(&self) -> usize {
        self.layout.m()
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.fill(f64::NEG_INFINITY);
        upper.fill(f64::INFINITY);
        let p = self.layout.p();
        for j in 0..self.layout.np {
            lower[p + j] = self.setup.lower[j] / self.setup.scale[j];
            upper[p + j] = self.setup.upper[j] / self.setup.scale[j];
        }
        for window in self.layout.windows.iter().filter(|w| w.held) {
            let held = window.x..window.x + self.layout.nx;
            lower[held.clone()].copy_from_slice(&self.start[held.clone()]);
            upper[held.clone()].copy_from_slice(&self.start[held]);
        }
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        self.load_parameters(x);
        let (nx, scratch, p) = (self.layout.nx, &mut self.fit_scratch, &self.parameters);
        let fit = &self.fit;
        let value = |(k, &at): (usize, &usize)| fit.value(k, &x[at..at + nx], p, scratch);
        let data: f64 = self.nodes.iter().enumerate().map(value).sum();
        let priors = prior_terms(&self.setup.priors, p, self.share, |_, _, _| {});
        data + priors + self.barrier.value(p, |_, _| {})
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        self.load_parameters(x);
        gradient.fill(0.0);
        let (nx, first) = (self.layout.nx, self.layout.p());
        self.barrier
            .value(&self.parameters, |j, slope| gradient[first + j] += slope);
        let scratch = &mut self.fit_scratch;
        let scale = &self.setup.scale;
        prior_terms(
            &self.setup.priors,
            &self.parameters,
            self.share,
            |j, slope, _| gradient[first + j] += slope * scale[j],
        );
        if self.fit.is_state() {
            for (k, &at) in self.nodes.iter().enumerate() {
                let (state, out) = (&x[at..at + nx], &mut gradient[at..at + nx]);
                self.fit
                    .gradient(k, (state, &self.parameters), 1.0, scratch, out);
            }
            return;
        }
        let mut local = vec![0.0; nx + self.layout.np];
        for (k, &at) in self.nodes.iter().enumerate() {
            local.fill(0.0);
            let state = &x[at..at + nx];
            self.fit
                .gradient(k, (state, &self.parameters), 1.0, scratch, &mut local);
            gradient[at..at + nx].copy_from_slice(&local[..nx]);
            for (j, slope) in local[nx..].iter().enumerate() {
                gradient[first + j] += slope * self.setup.scale[j];
            }
        }
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.load_parameters(x);
        let (point, rule, p) = (point!(self, x), &self.rule, &self.parameters);
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            c,
            self.layout.ny,
            |_, steps, s, c| rule.constraints_lanes(&point.of(steps), p, s, c),
        );
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian_pattern
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        self.load_parameters(x);
        let (point, rule, p) = (point!(self, x), &self.rule, &self.parameters);
        let size = self.layout.step_jacobian.len();
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            values,
            size,
            |_, steps, s, out| rule.jacobian_lanes(&point.of(steps), p, s, out),
        );
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian_pattern
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let (steps, rest) = values.split_at_mut(self.layout.node_values());
        let (nodes, parameters) = rest.split_at_mut(self.layout.nodes() * self.layout.nx);
        parameters.fill(0.0);
        nodes.fill(0.0);
        self.load_parameters(x);
        if self.fit.is_state() {
            let nx = self.layout.nx;
            let gauss_newton = self.setup.curvature == Curvature::GaussNewton;
            for (k, values) in nodes.chunks_exact_mut(nx).enumerate() {
                let at = self.nodes[k];
                let add = |c: usize, value: f64| values[c] = value;
                self.fit
                    .state_curvature(k, &x[at..at + nx], sigma, gauss_newton, add);
            }
        }
        self.prior_hessian(sigma, parameters);
        let own = self.rule.expansion().parameter_hessian.len()..;
        let mut bodies = parameters[own].iter_mut();
        self.barrier.hessian(&self.parameters, |_, _, value| {
            if let Some(entry) = bodies.next() {
                *entry += sigma * value;
            }
        });
        if self.setup.curvature == Curvature::GaussNewton {
            steps.fill(0.0);
            self.output_hessian(x, sigma, steps, parameters);
            return;
        }
        let (point, rule, p) = (point!(self, x), &self.rule, &self.parameters);
        let ny = self.layout.ny;
        self.scratch
            .iter_mut()
            .for_each(LaneScratch::clear_parameter_hessian);
        let size = self.layout.step_hessian.len();
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            steps,
            size,
            |k, steps, s, out| {
                let lambda = &lambda[k * ny..(k + steps.len()) * ny];
                rule.hessian_lanes(&point.of(steps), p, lambda, s, out);
            },
        );
        for scratch in &self.scratch {
            scratch.add_parameter_hessian(parameters);
        }
        self.output_hessian(x, sigma, steps, parameters);
    }

    fn barrier_changed(&mut self, mu: f64) -> bool {
        self.barrier.set(mu)
    }

    fn longest_step(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        let p = self.layout.p();
        self.barrier.longest(&x[p..], &d[p..], share)
    }
}
