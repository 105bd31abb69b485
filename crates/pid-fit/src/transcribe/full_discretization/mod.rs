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

mod grid;
mod nlp;
mod steps;

use pid_nlp::solver::kkt::layout::Layout;
use pid_nlp::solver::kkt::structured::StructuredKkt;
use pid_nlp::{Nlp, SparsePattern};
use pid_runtime::dynamics::Hessian;

use super::bodies::Barrier;
use super::explicit_form::ExplicitForm;
use super::fit::{Fit, FitScratch};
use super::scheme::Scheme;
use super::setup::{Curvature, Setup, Track};
use super::step::Rule;
use super::step_lanes::LaneScratch;
use super::tableau::Tableau;
use grid::Grid;
use steps::{Step, chunk};

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
        let nx = 2 * dims.nq;
        assert_eq!(setup.scale.len(), dims.np, "setup fits the model");
        assert!(setup.substeps > 0, "a sampling interval has steps");
        let ny = rule.ny();
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
        let mut grid = Grid::new(&layout, samples, setup.substeps);
        for (track, window) in tracks.iter().zip(&layout.windows) {
            grid.push(&layout, window, track, &mut fit);
        }
        let chunk = chunk(grid.steps.len());
        let scratch = (0..grid.steps.len().div_ceil(chunk))
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
            steps: grid.steps,
            nodes: grid.nodes,
            sampled: grid.sampled,
            fit_scratch: fit.scratch(),
            fit,
            start: grid.start,
            barrier,
            share: 1.0 / samples.max(1) as f64,
            u: grid.u,
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

    /// The bodies' barrier, and the parameters last loaded.
    pub(super) fn bodies(&self) -> (&Barrier, &[f64]) {
        (&self.barrier, &self.parameters)
    }

    /// Value of the bodies' barrier in the objective at a point.
    pub fn barrier(&mut self, x: &[f64]) -> f64 {
        self.load_parameters(x);
        self.barrier.value(&self.parameters, |_, _| {})
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
