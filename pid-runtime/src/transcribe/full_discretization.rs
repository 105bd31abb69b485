//! Full discretization: the states at every sample are unknowns, the scheme's steps are constraints.
//!
//! ```text
//! minimise    J = 1/N Σ_i Σ_c w_c (x_c(t_i) − x^d_c(t_i))²
//! subject to  c_k(x_k, s_k, x_{k+1}, p) = 0      for every step of every window
//!             p in its bounds
//! ```
//!
//! (K. Schäfer et al., Section III-C, with x = (q, v), several windows, weights and missing samples.) The dynamic rows are
//! the implicit residual times h / M_jj, so that all rows are changes of state: nothing is inverted, and the problem is
//! affine in the inertial parameters.

use super::expansion::{Contribution, Expansion};
use super::scheme::{Block, Scheme, Tableau, Term};
use crate::dynamics::{At, Hessian};
use crate::nlp::{Nlp, SparsePattern};
use crate::solver::kkt::layout::Layout;
use rayon::prelude::*;

/// A window of samples to follow.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Times, s, strictly increasing; at least two.
    pub t: Vec<f64>,
    /// Measured states (q, v) sample by sample, length `2 nq` each; NaN where nothing was measured.
    pub measured: Vec<f64>,
    /// States to start from, same layout, finite. Held initial states take their value from here.
    pub guess: Vec<f64>,
    /// Inputs sample by sample, `nu` each.
    pub u: Vec<f64>,
    /// Weight per channel of the state in this window, length `2 nq`; 1 each is the paper's objective.
    pub weights: Vec<f64>,
}

/// What is asked of the discretization.
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
    /// Whether the initial state of each window is held at its guess.
    pub hold_initial: bool,
    /// Whether inputs move linearly between samples (otherwise they are held).
    pub linear_inputs: bool,
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
    /// Sample index of the inputs at its start.
    sample: usize,
}

/// Powers h^-2 … h^3.
fn powers(h: f64) -> [f64; 6] {
    let i = 1.0 / h;
    [i * i, i, 1.0, h, h * h, h * h * h]
}

#[inline(always)]
fn pow(table: &[f64; 6], power: i32) -> f64 {
    table[(power + 2) as usize]
}

/// Scratch of one thread.
struct Scratch {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    u: Vec<f64>,
    r: Vec<f64>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
    lambda: Vec<f64>,
    parameter_hessian: Vec<f64>,
    /// Coefficients for the step length they were made for.
    h: f64,
    jacobian_factors: Vec<f64>,
    hessian_factors: Vec<f64>,
}

/// The program; see the module's documentation.
pub struct FullDiscretization<'m> {
    model: &'m dyn Hessian,
    tableau: Tableau,
    expansion: Expansion,
    layout: Layout,
    setup: Setup,
    steps: Vec<Step>,
    /// Position of the state of each node among the variables.
    nodes: Vec<usize>,
    measured: Vec<f64>,
    /// Weight of each entry of `measured`, 0 where nothing was measured, 1/N included.
    weights: Vec<f64>,
    start: Vec<f64>,
    u: Vec<f64>,
    jacobian_pattern: SparsePattern,
    hessian_pattern: SparsePattern,
    parameters: Vec<f64>,
    /// Steps handled by one task.
    chunk: usize,
    scratch: Vec<Scratch>,
}

/// Steps below which everything runs on the calling thread.
const PARALLEL_STEPS: usize = 1500;

impl<'m> FullDiscretization<'m> {
    /// Builds the program for a set of windows.
    ///
    /// # Panics
    /// If lengths disagree with the model's dimensions: callers build tracks and setups from checked data.
    pub fn new(model: &'m dyn Hessian, tracks: &[Track], setup: Setup) -> Self {
        let dims = model.dims();
        let (nq, nx) = (dims.nq, 2 * dims.nq);
        assert_eq!(setup.scale.len(), dims.np, "setup fits the model");
        let tableau = Tableau::new(setup.scheme);
        let ny = (2 + tableau.stages) * nq;
        let expansion = Expansion::new(model, &tableau, &setup.scale);
        let lengths: Vec<usize> = tracks.iter().map(|t| t.t.len() - 1).collect();
        let layout = Layout {
            nx,
            ny,
            np: dims.np,
            windows: Layout::windows(nx, ny, &lengths, setup.hold_initial),
            step_jacobian: expansion.step_jacobian.clone(),
            step_hessian: expansion.step_hessian.clone(),
            parameter_hessian: expansion.parameter_hessian.clone(),
        };
        let samples: usize = tracks.iter().map(|t| t.t.len()).sum();
        let (mut steps, mut nodes) = (Vec::new(), Vec::new());
        let (mut measured, mut weights, mut u) = (Vec::new(), Vec::new(), Vec::new());
        let mut start = vec![0.0; layout.n()];
        for (track, window) in tracks.iter().zip(&layout.windows) {
            assert_eq!(
                track.measured.len(),
                nx * track.t.len(),
                "measured states fit the times"
            );
            let sample = window.first_node;
            for k in 0..track.t.len() {
                let at = layout.state(window, k);
                nodes.push(at);
                start[at..at + nx].copy_from_slice(&track.guess[k * nx..(k + 1) * nx]);
            }
            let mut h = 0.0_f64;
            for k in 0..window.steps {
                // Times written in decimals differ in the last bits: equal steps are made equal.
                let difference = track.t[k + 1] - track.t[k];
                if k == 0 || (difference - h).abs() > 1e-9 * h {
                    h = difference;
                }
                let (x, y) = (layout.state(window, k), layout.step(window, k));
                for stage in 0..tableau.stages {
                    for j in 0..nq {
                        let slope =
                            (track.guess[(k + 1) * nx + nq + j] - track.guess[k * nx + nq + j]) / h;
                        start[y + stage * nq + j] = slope;
                    }
                }
                steps.push(Step {
                    x,
                    y,
                    h,
                    sample: sample + k,
                });
            }
            for (k, value) in track.measured.iter().enumerate() {
                let missing = value.is_nan();
                measured.push(if missing { 0.0 } else { *value });
                let weight = track.weights[k % nx] / samples as f64;
                weights.push(if missing { 0.0 } else { weight });
            }
            u.extend_from_slice(&track.u);
        }
        let chunk = if steps.len() < PARALLEL_STEPS {
            steps.len().max(1)
        } else {
            steps
                .len()
                .div_ceil(8 * rayon::current_num_threads())
                .max(64)
        };
        let scratch = (0..steps.len().div_ceil(chunk))
            .map(|_| Scratch {
                q: vec![0.0; nq],
                v: vec![0.0; nq],
                a: vec![0.0; nq],
                u: vec![0.0; dims.nu],
                r: vec![0.0; nq],
                jacobian: vec![0.0; model.jacobian_pattern().nnz()],
                hessian: vec![0.0; model.hessian_pattern().nnz()],
                lambda: vec![0.0; nq],
                parameter_hessian: vec![0.0; expansion.parameter_hessian.len()],
                h: 0.0,
                jacobian_factors: Vec::new(),
                hessian_factors: Vec::new(),
            })
            .collect();
        Self {
            model,
            jacobian_pattern: layout.jacobian_pattern(),
            hessian_pattern: layout.hessian_pattern(),
            parameters: vec![0.0; dims.np],
            tableau,
            expansion,
            layout,
            setup,
            steps,
            nodes,
            measured,
            weights,
            start,
            u,
            chunk,
            scratch,
        }
    }

    /// Where unknowns and values stand; what [`crate::solver::kkt::structured::StructuredKkt`] needs.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The model.
    pub fn model(&self) -> &'m dyn Hessian {
        self.model
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

    /// The states in a point, node by node, windows one after another.
    pub fn states(&self, x: &[f64]) -> Vec<f64> {
        self.nodes
            .iter()
            .flat_map(|&at| &x[at..at + self.layout.nx])
            .copied()
            .collect()
    }

    /// Weighted residuals `√w (x − x^d)` sample by sample, and the number of channels; NaN where nothing was measured and in
    /// a row between two windows.
    pub fn residuals(&self, x: &[f64]) -> (Vec<f64>, usize) {
        let nx = self.layout.nx;
        let mut out = Vec::with_capacity(self.measured.len() + nx * self.layout.windows.len());
        for window in &self.layout.windows {
            for k in window.first_node..=window.first_node + window.steps {
                for i in 0..nx {
                    let (e, at) = (k * nx + i, self.nodes[k] + i);
                    let w = self.weights[e];
                    let residual = w.sqrt() * (x[at] - self.measured[e]);
                    out.push(if w > 0.0 { residual } else { f64::NAN });
                }
            }
            out.extend(std::iter::repeat_n(f64::NAN, nx));
        }
        (out, nx)
    }

    /// Number of unknown entries of initial states.
    pub fn free_initial_states(&self) -> usize {
        self.layout.windows.iter().filter(|w| !w.held).count() * self.layout.nx
    }

    /// Changes the second derivatives that are given to the solver.
    pub fn set_curvature(&mut self, curvature: Curvature) {
        self.setup.curvature = curvature;
    }

    fn load_parameters(&mut self, x: &[f64]) {
        let p = &x[self.layout.p()..];
        for ((out, p), s) in self.parameters.iter_mut().zip(p).zip(&self.setup.scale) {
            *out = p * s;
        }
    }
}

/// Everything the evaluation of a step reads; split from the scratch so that steps run in parallel.
struct Context<'a> {
    model: &'a dyn Hessian,
    tableau: &'a Tableau,
    expansion: &'a Expansion,
    setup: &'a Setup,
    u: &'a [f64],
    parameters: &'a [f64],
    nq: usize,
    nu: usize,
    x: &'a [f64],
}

impl Context<'_> {
    fn combine(&self, terms: &[Term], step: &Step, powers: &[f64; 6], out: &mut [f64]) {
        out.fill(0.0);
        let nq = self.nq;
        for term in terms {
            let at = match term.block {
                Block::Q0 => step.x,
                Block::V0 => step.x + nq,
                other => step.y + self.tableau.position(other, nq) - 2 * nq,
            };
            let c = term.coefficient * pow(powers, term.power);
            for (o, x) in out.iter_mut().zip(&self.x[at..at + nq]) {
                *o += c * x;
            }
        }
    }

    /// Arguments of evaluation `e` of a step, into the scratch.
    fn arguments(&self, e: usize, step: &Step, powers: &[f64; 6], s: &mut Scratch) {
        let evaluation = &self.tableau.evaluations[e];
        self.combine(&evaluation.q, step, powers, &mut s.q);
        self.combine(&evaluation.v, step, powers, &mut s.v);
        self.combine(&evaluation.a, step, powers, &mut s.a);
        let u0 = &self.u[step.sample * self.nu..][..self.nu];
        if self.setup.linear_inputs && evaluation.u > 0.0 {
            let u1 = &self.u[(step.sample + 1) * self.nu..][..self.nu];
            for ((out, a), b) in s.u.iter_mut().zip(u0).zip(u1) {
                *out = (1.0 - evaluation.u) * a + evaluation.u * b;
            }
        } else {
            s.u.copy_from_slice(u0);
        }
    }

    fn row_scale(&self, j: usize, h: f64) -> f64 {
        h / self.setup.inertia[j]
    }

    fn constraints(&self, step: &Step, s: &mut Scratch, c: &mut [f64]) {
        let nq = self.nq;
        let powers = powers(step.h);
        let (linear, dynamic) = c.split_at_mut(self.tableau.linear.len() * nq);
        for (terms, out) in self.tableau.linear.iter().zip(linear.chunks_exact_mut(nq)) {
            self.combine(terms, step, &powers, out);
        }
        for (e, out) in dynamic.chunks_exact_mut(nq).enumerate() {
            self.arguments(e, step, &powers, s);
            let at = At {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p: self.parameters,
            };
            self.model.residual(&at, &mut s.r);
            for j in 0..nq {
                out[j] = self.row_scale(j, step.h) * s.r[j];
            }
        }
    }

    /// Fills the factors of all contributions for a step length.
    fn prepare(&self, h: f64, s: &mut Scratch) {
        if s.h == h && !s.jacobian_factors.is_empty() {
            return;
        }
        s.h = h;
        let powers = powers(h);
        let factor = |c: &Contribution| c.coefficient * pow(&powers, c.power);
        s.jacobian_factors.clear();
        s.hessian_factors.clear();
        let rows = self.model.jacobian_pattern().rows;
        for map in &self.expansion.evaluations {
            s.jacobian_factors.extend(
                map.jacobian
                    .iter()
                    .map(|c| factor(c) * self.row_scale(rows[c.source as usize] as usize, h)),
            );
            s.hessian_factors.extend(map.hessian.iter().map(factor));
            s.hessian_factors
                .extend(map.parameter_hessian.iter().map(factor));
        }
    }

    fn jacobian(&self, step: &Step, s: &mut Scratch, values: &mut [f64]) {
        self.prepare(step.h, s);
        let powers = powers(step.h);
        values.fill(0.0);
        for &(entry, coefficient, power) in &self.expansion.linear {
            values[entry as usize] = coefficient * pow(&powers, power);
        }
        let mut first = 0;
        for (e, map) in self.expansion.evaluations.iter().enumerate() {
            self.arguments(e, step, &powers, s);
            let at = At {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p: self.parameters,
            };
            self.model.residual_jacobian(&at, &mut s.r, &mut s.jacobian);
            let factors = &s.jacobian_factors[first..first + map.jacobian.len()];
            for (c, factor) in map.jacobian.iter().zip(factors) {
                values[c.entry as usize] += factor * s.jacobian[c.source as usize];
            }
            first += map.jacobian.len();
        }
    }

    /// Adds the step's part of Hess(λᵀc) to `values` and to the scratch's parameter entries.
    fn hessian(&self, step: &Step, lambda: &[f64], s: &mut Scratch, values: &mut [f64]) {
        self.prepare(step.h, s);
        let nq = self.nq;
        let powers = powers(step.h);
        values.fill(0.0);
        let dynamic = &lambda[self.tableau.linear.len() * nq..];
        let mut first = 0;
        for (e, map) in self.expansion.evaluations.iter().enumerate() {
            self.arguments(e, step, &powers, s);
            for j in 0..nq {
                s.lambda[j] = dynamic[e * nq + j] * self.row_scale(j, step.h);
            }
            let at = At {
                q: &s.q,
                v: &s.v,
                a: &s.a,
                u: &s.u,
                p: self.parameters,
            };
            self.model.residual_hessian(&at, &s.lambda, &mut s.hessian);
            let factors = &s.hessian_factors[first..first + map.hessian.len()];
            for (c, factor) in map.hessian.iter().zip(factors) {
                values[c.entry as usize] += factor * s.hessian[c.source as usize];
            }
            first += map.hessian.len();
            let factors = &s.hessian_factors[first..first + map.parameter_hessian.len()];
            for (c, factor) in map.parameter_hessian.iter().zip(factors) {
                s.parameter_hessian[c.entry as usize] += factor * s.hessian[c.source as usize];
            }
            first += map.parameter_hessian.len();
        }
    }
}

/// The shared part of the program, as a [`Context`] at the point `$x`.
macro_rules! context {
    ($self:ident, $x:expr) => {
        Context {
            model: $self.model,
            tableau: &$self.tableau,
            expansion: &$self.expansion,
            setup: &$self.setup,
            u: &$self.u,
            parameters: &$self.parameters,
            nq: $self.layout.nx / 2,
            nu: $self.model.dims().nu,
            x: $x,
        }
    };
}

/// Calls `work` on every step with its slice of `out` (`size` values a step), in parallel for long problems.
fn for_steps(
    steps: &[Step],
    chunk: usize,
    scratch: &mut [Scratch],
    out: &mut [f64],
    size: usize,
    work: impl Fn(usize, &Step, &mut Scratch, &mut [f64]) + Sync,
) {
    let run = |first: usize, steps: &[Step], scratch: &mut Scratch, out: &mut [f64]| {
        if size == 0 {
            steps
                .iter()
                .enumerate()
                .for_each(|(k, step)| work(first + k, step, scratch, &mut []));
            return;
        }
        for (k, (step, out)) in steps.iter().zip(out.chunks_exact_mut(size)).enumerate() {
            work(first + k, step, scratch, out);
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
        let nx = self.layout.nx;
        let data = self
            .measured
            .chunks_exact(nx)
            .zip(self.weights.chunks_exact(nx));
        self.nodes
            .iter()
            .zip(data)
            .map(|(&at, (measured, weights))| {
                let states = &x[at..at + nx];
                let terms = states.iter().zip(measured).zip(weights);
                terms.map(|((x, d), w)| w * (x - d) * (x - d)).sum::<f64>()
            })
            .sum()
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        gradient.fill(0.0);
        let nx = self.layout.nx;
        for (k, &at) in self.nodes.iter().enumerate() {
            for i in 0..nx {
                let e = k * nx + i;
                gradient[at + i] = 2.0 * self.weights[e] * (x[at + i] - self.measured[e]);
            }
        }
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        self.load_parameters(x);
        let context = context!(self, x);
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            c,
            self.layout.ny,
            |_, step, s, c| {
                context.constraints(step, s, c);
            },
        );
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian_pattern
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        self.load_parameters(x);
        let context = context!(self, x);
        let size = self.layout.step_jacobian.len();
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            values,
            size,
            |_, step, s, out| {
                context.jacobian(step, s, out);
            },
        );
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian_pattern
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let (steps, rest) = values.split_at_mut(self.layout.node_values());
        let (nodes, parameters) = rest.split_at_mut(self.layout.nodes() * self.layout.nx);
        for (value, w) in nodes.iter_mut().zip(&self.weights) {
            *value = 2.0 * sigma * w;
        }
        parameters.fill(0.0);
        if self.setup.curvature == Curvature::GaussNewton {
            steps.fill(0.0);
            return;
        }
        self.load_parameters(x);
        let context = context!(self, x);
        let ny = self.layout.ny;
        self.scratch
            .iter_mut()
            .for_each(|s| s.parameter_hessian.fill(0.0));
        let size = self.layout.step_hessian.len();
        for_steps(
            &self.steps,
            self.chunk,
            &mut self.scratch,
            steps,
            size,
            |k, step, s, out| {
                context.hessian(step, &lambda[k * ny..(k + 1) * ny], s, out);
            },
        );
        for scratch in &self.scratch {
            for (out, value) in parameters.iter_mut().zip(&scratch.parameter_hessian) {
                *out += value;
            }
        }
    }
}
