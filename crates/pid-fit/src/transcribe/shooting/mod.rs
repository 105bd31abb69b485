//! Single and multiple shooting: states at few nodes are unknowns, the motion between them is integrated.
//!
//! ```text
//! minimise    J = 1/N Σ_i Σ_c w_c (x_c(t_i; p, x_τσ(i)) − x^d_c(t_i))²
//! subject to  x(τ_{j+1}; p, x_τj) − x_τ{j+1} = 0     for 1 ≤ j ≤ M − 1
//!             p in its bounds
//! ```
//!
//! (K. Schäfer et al., equations (4) and (5).) The M nodes of a window of N samples stand at the
//! samples ⌊jN/M⌋, j = 0 … M − 1: M = 1 is single shooting, M = N with explicit Euler has the
//! variables of full discretization. Integration takes any [`Scheme`] with equal steps between
//! samples, or Dormand-Prince with controlled steps.
//!
//! **Derivatives** are those of the steps taken, by forward and adjoint recursion over them (see
//! the module `arc`), exact to rounding. With controlled steps the sequence is chosen anew in every
//! evaluation and then differentiated as it is (internal numerical differentiation, H. G. Bock
//! 1981): the program's functions then jump by the tolerated error where the sequence changes, so
//! tolerances of the solver below those of the integration mean nothing.
//!
//! A motion that cannot be integrated (it explodes, an implicit step has no solution) gives values
//! that are not finite.

mod arc;
mod kkt;
mod lu;
mod nlp;
mod records;
mod stepper;
mod stepping;

pub use kkt::ShootingKkt;

use super::bodies::Barrier;
use super::fit::Fit;
use super::scheme::Scheme;
use super::setup::{Curvature, Setup, Track};
use super::step::Rule;
use super::tableau::Tableau;
use arc::Arc;
use pid_nlp::SparsePattern;
use pid_runtime::dynamics::Hessian;
use rayon::prelude::*;
use records::Records;
pub use stepping::{Adaptive, Stepping};

/// Nodes of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Chain {
    /// Number of nodes.
    nodes: usize,
    /// Position of the first node's state among the variables.
    x: usize,
    /// First sample of the window.
    first_sample: usize,
}

/// The point and level of the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Nothing,
    Motion,
    Derivatives,
}

/// The program; see the module's documentation.
pub struct Shooting<'m> {
    rule: Rule<'m>,
    records: Records,
    fit: Fit,
    barrier: Barrier,
    setup: Setup,
    stepping: Stepping,
    chains: Vec<Chain>,
    arcs: Vec<Arc<'m>>,
    start: Vec<f64>,
    /// Windows whose first state is held.
    n: usize,
    m: usize,
    nx: usize,
    np: usize,
    jacobian_pattern: SparsePattern,
    hessian_pattern: SparsePattern,
    /// The point at which the arcs stand.
    at: Vec<f64>,
    level: Level,
    parameters: Vec<f64>,
    parallel: bool,
    samples: usize,
}

/// Sampling intervals below which everything runs on the calling thread.
const PARALLEL_INTERVALS: usize = 1500;

/// What the windows come to, one after the other.
struct Windows<'m> {
    records: Records,
    chains: Vec<Chain>,
    arcs: Vec<Arc<'m>>,
    /// States at the nodes, as the tracks guess them.
    start: Vec<f64>,
    /// Rows of continuity.
    rows: usize,
}

impl<'m> Windows<'m> {
    /// Adds a window with its nodes; there are `samples` in all windows together.
    fn add(&mut self, rule: &Rule<'m>, fit: &mut Fit, track: &Track, nodes: usize, samples: usize) {
        let dims = rule.model().dims();
        let (nx, np, channels) = (2 * dims.nq, dims.np, fit.channels());
        let first_sample = self.records.t.len();
        let len = track.t.len();
        assert_eq!(
            track.measured.len(),
            channels * len,
            "measurements fit the times"
        );
        let count = nodes.min(len);
        self.chains.push(Chain {
            nodes: count,
            x: self.start.len(),
            first_sample,
        });
        for j in 0..count {
            let at = j * len / count;
            let end = if j + 1 < count {
                (j + 1) * len / count
            } else {
                len - 1
            };
            let x = self.start.len();
            self.start
                .extend_from_slice(&track.guess[at * nx..(at + 1) * nx]);
            let next = (j + 1 < count).then_some((x + nx, self.rows));
            self.rows += if next.is_some() { nx } else { 0 };
            let first = first_sample + at;
            self.arcs
                .push(Arc::new(rule, fit, np, x, next, first, end - at));
        }
        for k in 0..len {
            let measured = track.measured[k * channels..(k + 1) * channels].iter();
            let weights = (0..channels).map(|c| track.weight(k, c, channels) / samples as f64);
            fit.push(measured.copied(), weights);
        }
        self.records.t.extend_from_slice(&track.t);
        self.records.u.extend_from_slice(&track.u);
    }
}

/// Entries of the Jacobian and of the Hessian: each arc ties its own node, the next one and the
/// parameters, which stand from `p` on.
fn patterns(arcs: &[Arc<'_>], nx: usize, np: usize, p: usize) -> (SparsePattern, SparsePattern) {
    let (mut jacobian_pattern, mut hessian_pattern) =
        (SparsePattern::default(), SparsePattern::default());
    for arc in arcs {
        if let Some((next, row)) = arc.next {
            for i in 0..nx {
                (0..nx).for_each(|j| jacobian_pattern.push(row + i, arc.x + j));
                jacobian_pattern.push(row + i, next + i);
                (0..np).for_each(|j| jacobian_pattern.push(row + i, p + j));
            }
        }
        for i in 0..nx {
            (0..=i).for_each(|j| hessian_pattern.push(arc.x + i, arc.x + j));
        }
        for i in 0..np {
            (0..nx).for_each(|j| hessian_pattern.push(p + i, arc.x + j));
        }
    }
    for i in 0..np {
        (0..=i).for_each(|j| hessian_pattern.push(p + i, p + j));
    }
    (jacobian_pattern, hessian_pattern)
}

impl<'m> Shooting<'m> {
    /// Builds the program; every window gets `nodes` nodes, or as many as it has samples.
    /// `setup.substeps` counts where `stepping` is `None`.
    ///
    /// # Panics
    /// If lengths disagree with the model's dimensions, or `nodes` is zero.
    pub fn new(
        model: &'m dyn Hessian,
        tracks: &[Track],
        setup: Setup,
        nodes: usize,
        stepping: Option<Adaptive>,
    ) -> Self {
        assert!(nodes > 0, "a window has a node");
        let dims = model.dims();
        let (nx, np) = (2 * dims.nq, dims.np);
        let (scheme, stepping) = match stepping {
            Some(adaptive) => (Scheme::DormandPrince, Stepping::Adaptive(adaptive)),
            None => (
                setup.scheme,
                Stepping::Fixed {
                    substeps: setup.substeps,
                },
            ),
        };
        let rule = Rule::new(
            model,
            Tableau::new(scheme),
            &setup.scale,
            &setup.inertia,
            setup.linear_inputs,
        );
        let samples: usize = tracks.iter().map(|t| t.t.len()).sum();
        let mut fit = Fit::new(nx, np, setup.output.clone(), setup.loss, samples);
        let mut windows = Windows {
            records: Records {
                t: Vec::new(),
                u: Vec::new(),
                nu: dims.nu,
            },
            chains: Vec::new(),
            arcs: Vec::new(),
            start: Vec::new(),
            rows: 0,
        };
        for track in tracks {
            windows.add(&rule, &mut fit, track, nodes, samples);
        }
        let Windows {
            records,
            chains,
            arcs,
            start,
            rows,
        } = windows;
        let p = start.len();
        let (jacobian_pattern, hessian_pattern) = patterns(&arcs, nx, np, p);
        Self {
            n: p + np,
            m: rows,
            nx,
            np,
            rule,
            parallel: records.t.len() >= PARALLEL_INTERVALS && arcs.len() > 1,
            records,
            fit,
            barrier: Barrier::new(
                &setup.bodies,
                &setup.scale,
                setup.bodies_weight / samples.max(1) as f64,
            ),
            setup,
            stepping,
            chains,
            arcs,
            start,
            jacobian_pattern,
            hessian_pattern,
            at: Vec::new(),
            level: Level::Nothing,
            parameters: vec![0.0; np],
            samples,
        }
    }

    /// The model.
    pub fn model(&self) -> &'m dyn Hessian {
        self.rule.model()
    }

    /// The setup the program was built with.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Value of the bodies' barrier in the objective at a point.
    pub fn barrier(&self, x: &[f64]) -> f64 {
        let p = &x[self.n - self.np..];
        let p: Vec<f64> = p
            .iter()
            .zip(&self.setup.scale)
            .map(|(p, s)| p * s)
            .collect();
        self.barrier.value(&p, |_, _| {})
    }

    /// Number of samples in all windows.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Number of nodes of each window.
    pub fn nodes(&self) -> Vec<usize> {
        self.chains.iter().map(|c| c.nodes).collect()
    }

    /// Number of initial states that are not held, over all windows.
    pub fn free_initial_states(&self) -> usize {
        if self.setup.hold_initial {
            0
        } else {
            self.chains.len() * 2 * self.model().dims().nq
        }
    }

    /// Positions of the node states among the variables.
    pub fn node_positions(&self) -> Vec<usize> {
        self.arcs.iter().map(|arc| arc.x).collect()
    }

    /// Samples at which the nodes stand, counted over all windows.
    pub fn node_samples(&self) -> Vec<usize> {
        self.arcs.iter().map(Arc::first).collect()
    }

    /// Number of integration steps of the last evaluation.
    pub fn steps(&self) -> usize {
        self.arcs.iter().map(Arc::steps).sum()
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

    /// Starting point: node states from the tracks' guesses, the given parameters.
    pub fn starting_point(&self, parameters: &[f64]) -> Vec<f64> {
        let scaled = parameters.iter().zip(&self.setup.scale).map(|(p, s)| p / s);
        self.start.iter().copied().chain(scaled).collect()
    }

    /// The parameters in a point, in their own units.
    pub fn parameters(&self, x: &[f64]) -> Vec<f64> {
        let p = &x[self.n - self.np..];
        p.iter()
            .zip(&self.setup.scale)
            .map(|(p, s)| p * s)
            .collect()
    }

    /// The motion at the samples, windows one after another, 2 nq each: every sample as its own
    /// interval reaches it; `None` if an interval cannot be integrated.
    pub fn states(&mut self, x: &[f64]) -> Option<Vec<f64>> {
        self.evaluate(x, Level::Motion);
        let mut out = vec![f64::NAN; self.samples * self.nx];
        for arc in &self.arcs {
            if !arc.finite {
                return None;
            }
            arc.for_samples(|sample, state| {
                out[sample * self.nx..(sample + 1) * self.nx].copy_from_slice(state);
            });
        }
        Some(out)
    }

    /// Weighted residuals `√w (y − d)` sample by sample, and the number of channels; NaN where
    /// nothing was measured and in a row between two windows.
    pub fn residuals(&mut self, x: &[f64]) -> (Vec<f64>, usize) {
        let channels = self.fit.channels();
        let mut out = Vec::new();
        let Some(states) = self.states(x) else {
            return (out, channels);
        };
        let mut scratch = self.fit.scratch();
        let nx = self.nx;
        for (w, chain) in self.chains.iter().enumerate() {
            let end = self
                .chains
                .get(w + 1)
                .map_or(self.samples, |c| c.first_sample);
            for k in chain.first_sample..end {
                let state = &states[k * nx..(k + 1) * nx];
                self.fit
                    .residual(k, state, &self.parameters, &mut scratch, &mut out);
            }
            out.extend(std::iter::repeat_n(f64::NAN, channels));
        }
        (out, channels)
    }

    /// Gradient of each window's part of the objective by the parameters' variables, its node
    /// states eliminated: `np` values a window, at a solution with the multipliers `lambda`. Priors
    /// belong to no window.
    pub fn window_scores(&mut self, x: &[f64], lambda: &[f64]) -> Vec<f64> {
        self.evaluate(x, Level::Derivatives);
        let scale = std::mem::take(&mut self.setup.scale);
        self.each(|arc, _, _, fit, p| arc.gradient(fit, p, &scale));
        self.setup.scale = scale;
        let (nx, np) = (self.nx, self.np);
        let mut scores = vec![0.0; np * self.chains.len()];
        let mut arcs = self.arcs.iter();
        for (chain, score) in self.chains.iter().zip(scores.chunks_exact_mut(np)) {
            for arc in arcs.by_ref().take(chain.nodes) {
                for (s, g) in score.iter_mut().zip(&arc.gradient[nx..]) {
                    *s += g;
                }
                let Some((_, row)) = arc.next else { continue };
                let sensitivity = arc.end_sensitivity().chunks_exact(nx + np);
                for (l, e) in lambda[row..row + nx].iter().zip(sensitivity) {
                    for (s, e) in score.iter_mut().zip(&e[nx..]) {
                        *s += l * e;
                    }
                }
            }
        }
        scores
    }

    /// Chooses the second derivatives for the solver.
    pub fn set_curvature(&mut self, curvature: Curvature) {
        self.setup.curvature = curvature;
    }

    /// 1/N.
    fn share(&self) -> f64 {
        1.0 / self.samples.max(1) as f64
    }

    fn each(&mut self, work: impl Fn(&mut Arc<'m>, &Rule<'m>, &Records, &Fit, &[f64]) + Sync) {
        let (rule, records, fit, p) = (&self.rule, &self.records, &self.fit, &self.parameters);
        if self.parallel {
            self.arcs
                .par_iter_mut()
                .for_each(|arc| work(arc, rule, records, fit, p));
        } else {
            self.arcs
                .iter_mut()
                .for_each(|arc| work(arc, rule, records, fit, p));
        }
    }

    /// Moves the arcs to a point and a level; a point that was evaluated before costs nothing.
    fn evaluate(&mut self, x: &[f64], level: Level) {
        if self.at != x {
            self.at.clear();
            self.at.extend_from_slice(x);
            self.level = Level::Nothing;
            let p = &x[self.n - self.np..];
            for ((out, p), s) in self.parameters.iter_mut().zip(p).zip(&self.setup.scale) {
                *out = p * s;
            }
        }
        if self.level < Level::Motion {
            let (stepping, nx) = (self.stepping, self.nx);
            self.each(|arc, rule, records, _, p| {
                arc.integrate(rule, records, stepping, &x[arc.x..arc.x + nx], p);
            });
            self.level = Level::Motion;
        }
        if self.level < level {
            self.each(|arc, rule, records, _, p| arc.differentiate(rule, records, p));
            self.level = level;
        }
    }
}
