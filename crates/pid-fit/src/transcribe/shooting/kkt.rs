//! The KKT system of a shooting program on the structured form of a discretization.
//!
//! An interval is a step whose unknown is the state at the next node. The last interval of a window
//! has no next node; here it gets one that nothing depends on, so that its Hessian has a place: its
//! row is `−e = 0`, its cost `½ e²`. Elimination and inertia of the rest are untouched.

use super::Shooting;
use faer::Mat;
use pid_nlp::Nlp;
use pid_nlp::solver::kkt::layout::Layout;
use pid_nlp::solver::kkt::structured::StructuredKkt;
use pid_nlp::solver::kkt::{Condensing, Kkt, KktError, KktValues, Regularisation};

/// About so many steps of the integration are condensed together.
const STEPS: usize = 10;

/// Structured system for [`Shooting`].
pub struct ShootingKkt {
    inner: StructuredKkt,
    /// Position in the extended system of each variable and row.
    variables: Vec<usize>,
    rows: Vec<usize>,
    /// Number of nodes of each window.
    nodes: Vec<usize>,
    /// Jacobian and Hessian values of one interval.
    jacobian_size: usize,
    hessian_size: usize,
    nx: usize,
    np: usize,
    hessian: Vec<f64>,
    jacobian: Vec<f64>,
    sigma: Vec<f64>,
    rx: Vec<f64>,
    rc: Vec<f64>,
    dx: Vec<f64>,
    dl: Vec<f64>,
}

impl ShootingKkt {
    /// For a program; `fixed_parameters` has one entry per parameter.
    pub fn new(problem: &Shooting<'_>, fixed_parameters: &[bool]) -> Self {
        let nodes = problem.nodes();
        let dims = problem.model().dims();
        let (nx, np) = (2 * dims.nq, dims.np);
        let mut step_jacobian = Vec::new();
        for i in 0..nx as u32 {
            (0..nx as u32).for_each(|j| step_jacobian.push((i, j)));
            step_jacobian.push((i, nx as u32 + i));
            (0..np as u32).for_each(|j| step_jacobian.push((i, 2 * nx as u32 + j)));
        }
        let (mut step_hessian, mut parameter_hessian) = (Vec::new(), Vec::new());
        for i in 0..nx as u32 {
            (0..=i).for_each(|j| step_hessian.push((i, j)));
        }
        for i in 0..np as u32 {
            (0..nx as u32).for_each(|j| step_hessian.push((2 * nx as u32 + i, j)));
            (0..=i).for_each(|j| parameter_hessian.push((i, j)));
        }
        let (jacobian_size, hessian_size) = (step_jacobian.len(), step_hessian.len());
        let layout = Layout {
            nx,
            ny: nx,
            np,
            windows: Layout::windows(nx, nx, &nodes, problem.setup().hold_initial),
            step_jacobian,
            step_hessian,
            parameter_hessian,
        };
        let (mut variables, mut rows) = (Vec::new(), Vec::new());
        for window in &layout.windows {
            variables.extend(window.x..window.x + window.steps * nx);
            rows.extend(window.row..window.row + (window.steps - 1) * nx);
        }
        variables.extend(layout.p()..layout.n());
        let (n, m) = (layout.n(), layout.m());
        let intervals: usize = nodes.iter().sum();
        let per_interval = problem.samples().div_ceil(intervals.max(1));
        Self {
            hessian: vec![0.0; layout.hessian_pattern().nnz()],
            jacobian: vec![0.0; layout.jacobian_pattern().nnz()],
            inner: StructuredKkt::new(
                layout,
                fixed_parameters,
                (STEPS / per_interval.max(1)).max(1),
            ),
            variables,
            rows,
            nodes,
            jacobian_size,
            hessian_size,
            nx,
            np,
            sigma: vec![1.0; n],
            rx: vec![0.0; n],
            rc: vec![0.0; m],
            dx: vec![0.0; n],
            dl: vec![0.0; m],
        }
    }
}

impl Condensing for ShootingKkt {
    fn reduced_hessian(&self) -> (&Mat<f64>, Vec<usize>) {
        self.inner.reduced_hessian()
    }
}

impl Kkt for ShootingKkt {
    fn expect_error(&mut self, error: f64) {
        self.inner.expect_error(error);
    }

    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        let intervals: usize = self.nodes.iter().sum();
        let split = intervals * self.hessian_size;
        self.hessian.fill(0.0);
        self.hessian[..split].copy_from_slice(&values.hessian[..split]);
        let parameters = self.np * (self.np + 1) / 2;
        let at = self.hessian.len() - parameters;
        self.hessian[at..].copy_from_slice(&values.hessian[split..]);
        let (mut from, mut to) = (0, 0);
        for &nodes in &self.nodes {
            let size = (nodes - 1) * self.jacobian_size;
            self.jacobian[to..to + size].copy_from_slice(&values.jacobian[from..from + size]);
            (from, to) = (from + size, to + size);
            let last = &mut self.jacobian[to..to + self.jacobian_size];
            last.fill(0.0);
            let width = self.jacobian_size / self.nx;
            for i in 0..self.nx {
                last[i * width + self.nx] = -1.0;
            }
            to += self.jacobian_size;
        }
        for (&at, sigma) in self.variables.iter().zip(values.sigma) {
            self.sigma[at] = *sigma;
        }
        self.inner.factorise(KktValues {
            hessian: &self.hessian,
            jacobian: &self.jacobian,
            sigma: &self.sigma,
        })
    }

    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        self.rx.fill(0.0);
        self.rc.fill(0.0);
        for (&at, r) in self.variables.iter().zip(rx) {
            self.rx[at] = *r;
        }
        for (&at, r) in self.rows.iter().zip(rc) {
            self.rc[at] = *r;
        }
        let left = self
            .inner
            .solve(&self.rx, &self.rc, &mut self.dx, &mut self.dl);
        for (&at, d) in self.variables.iter().zip(dx) {
            *d = self.dx[at];
        }
        for (&at, d) in self.rows.iter().zip(dlambda) {
            *d = self.dl[at];
        }
        left
    }

    fn limit(&mut self, radius: f64) -> Option<f64> {
        self.inner.limit(radius)
    }

    fn remember(&mut self, dx: &[f64]) {
        for (&at, d) in self.variables.iter().zip(dx) {
            self.dx[at] = *d;
        }
        self.inner.remember(&self.dx);
    }
}

/// The system for a program with its held parameters.
impl From<&Shooting<'_>> for ShootingKkt {
    fn from(problem: &Shooting<'_>) -> Self {
        debug_assert!(problem.n() > 0, "a program has variables");
        Self::new(problem, &problem.fixed_parameters())
    }
}
