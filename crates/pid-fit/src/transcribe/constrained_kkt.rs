//! The KKT system of a constrained program on the structured form of its transcription.
//!
//! Rows of constraints `g + s = 0` and `g = 0` are eliminated before the structure sees them. With
//! `G = ∂g/∂(x_i, p)`, `w` the barrier's diagonal of the slack, or `1/δ` for an equality,
//!
//! ```text
//! dν = w (G dx − r_g) + r_s      ds = r_g − G dx
//! (H + Gᵀ w G) dx + Jᵀ dλ = r_x − Gᵀ (r_s − w r_g)
//! ```
//!
//! `Gᵀ w G` couples the state of one node with itself and with the parameters: it adds to entries
//! that a step's Hessian has, or may have. For equalities the system is that with `−δ` in place of
//! the zero; solutions are refined to the one without (method of multipliers). Every equality and
//! every slack adds one negative eigenvalue, as required.

use super::constrained::{Constrained, States};
use super::{FullDiscretization, Shooting, ShootingKkt};
use faer::Mat;
use pid_nlp::Nlp;
use pid_nlp::solver::kkt::{Condensing, Kkt, KktError, KktValues, Regularisation};

/// 1/δ of an equality.
const STIFF: f64 = 1e8;
/// Refinements for equalities at most, and the relative residual at which they end.
const PASSES: usize = 8;
const REFINED: f64 = 1e-12;

/// A structured system with room for the Hessian of constraints at nodes and on parameters.
pub struct Roomy {
    /// The system.
    kkt: Box<dyn Condensing>,
    /// Hessian values that it takes.
    len: usize,
    /// Where runs of the program's own values go: from, to, how many.
    own: Vec<[usize; 3]>,
    /// First value of each node's block: the lower triangle over its state, then a row over the
    /// state per parameter.
    nodes: Vec<usize>,
    /// First value of the lower triangle over the parameters.
    between: usize,
    /// Row of each parameter in these, where it has one.
    rows: Vec<Option<usize>>,
    nx: usize,
}

impl Roomy {
    /// Value between two positions of (x, p) at a node; without one between parameters.
    fn at(&self, node: Option<usize>, i: usize, j: usize) -> Option<usize> {
        let triangle = |i: usize, j: usize| i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
        let (i, j) = (i.max(j), i.min(j));
        let row = |i: usize| self.rows[i - self.nx];
        if j >= self.nx {
            return Some(self.between + triangle(row(i)?, row(j)?));
        }
        let first = self.nodes[node?];
        Some(if i < self.nx {
            first + triangle(i, j)
        } else {
            first + self.nx * (self.nx + 1) / 2 + row(i)? * self.nx + j
        })
    }
}

/// A program whose structured system can be given room for constraints.
pub trait Structured: States {
    /// The system with some parameters held and entries for the marked parameters.
    fn roomy(&self, held: &[bool], parameters: &[bool]) -> Roomy;
}

impl Structured for FullDiscretization<'_> {
    fn roomy(&self, held: &[bool], parameters: &[bool]) -> Roomy {
        let mut layout = self.layout().clone();
        let (nx, ny) = (layout.nx, layout.ny);
        let used: Vec<usize> = (0..layout.np).filter(|j| parameters[*j]).collect();
        let own_step = layout.step_hessian.len();
        let own_between = layout.parameter_hessian.len();
        // The state before a step, then that after it: the last node of a window has no step behind it.
        for first in [0, ny] {
            for i in 0..nx {
                let entry = |j: usize| ((first + i) as u32, (first + j) as u32);
                layout.step_hessian.extend((0..=i).map(entry));
            }
            for j in &used {
                let entry = |i: usize| ((nx + ny + j) as u32, (first + i) as u32);
                layout.step_hessian.extend((0..nx).map(entry));
            }
        }
        for (k, &i) in used.iter().enumerate() {
            let entry = |j: &usize| (i as u32, *j as u32);
            layout
                .parameter_hessian
                .extend(used[..=k].iter().map(entry));
        }
        let size = layout.step_hessian.len();
        let block = (size - own_step) / 2;
        let steps = layout.steps();
        let mut own: Vec<[usize; 3]> = (0..steps)
            .map(|k| [k * own_step, k * size, own_step])
            .collect();
        let (from, to) = (steps * own_step, layout.node_values());
        own.push([from, to, layout.nodes() * nx + own_between]);
        let mut nodes = Vec::with_capacity(layout.nodes());
        for window in &layout.windows {
            let behind = window.first_step..window.first_step + window.steps;
            nodes.extend(behind.clone().map(|step| step * size + own_step));
            nodes.push((behind.end - 1) * size + own_step + block);
        }
        let mut rows = vec![None; layout.np];
        used.iter()
            .enumerate()
            .for_each(|(k, &j)| rows[j] = Some(k));
        let between = layout.parameter_values() + own_between;
        Roomy {
            len: layout.parameter_values() + layout.parameter_hessian.len(),
            own,
            nodes,
            between,
            rows,
            nx,
            kkt: Box::new(self.system_of(layout, held)),
        }
    }
}

impl Structured for Shooting<'_> {
    fn roomy(&self, held: &[bool], _: &[bool]) -> Roomy {
        let (nx, np) = (self.nx(), held.len());
        let block = nx * (nx + 1) / 2 + np * nx;
        let nodes = self.state_positions().len();
        let len = self.hessian_pattern().nnz();
        Roomy {
            kkt: Box::new(ShootingKkt::new(self, held)),
            len,
            own: vec![[0, 0, len]],
            nodes: (0..nodes).map(|k| k * block).collect(),
            between: nodes * block,
            rows: (0..np).map(Some).collect(),
            nx,
        }
    }
}

/// Rows of one constraint at one place.
struct Rows {
    /// Node, `None` for constraints on the parameters.
    node: Option<usize>,
    /// Its positions in (x, p), and the variables there.
    local: Vec<usize>,
    variables: Vec<usize>,
    /// Number of rows, the first of them, and the first slack of inequalities.
    count: usize,
    first: usize,
    slack: Option<usize>,
    /// First of its values among those of the constraints.
    jacobian: usize,
}

impl Rows {
    fn width(&self) -> usize {
        self.local.len() + usize::from(self.slack.is_some())
    }

    /// Derivatives of a row.
    fn row<'a>(&self, jacobian: &'a [f64], r: usize) -> &'a [f64] {
        &jacobian[self.jacobian + r * self.width()..][..self.local.len()]
    }

    /// `G dx` of a row.
    fn product(&self, jacobian: &[f64], r: usize, dx: &[f64]) -> f64 {
        let row = self.row(jacobian, r).iter().zip(&self.variables);
        row.map(|(g, v)| g * dx[*v]).sum()
    }
}

/// Structured system for [`Constrained`] programs; see the module's documentation.
pub struct ConstrainedKkt {
    inner: Roomy,
    blocks: Vec<Rows>,
    /// Variables, rows, Jacobian and Hessian values of the program without constraints.
    n: usize,
    m: usize,
    jacobian_len: usize,
    hessian_len: usize,
    hessian: Vec<f64>,
    /// Derivatives of the constraints and w of each row, as last factorised.
    jacobian: Vec<f64>,
    weights: Vec<f64>,
    /// 1/δ of an equality.
    stiffness: f64,
    rx: Vec<f64>,
    rc: Vec<f64>,
    dx: Vec<f64>,
    dl: Vec<f64>,
}

impl ConstrainedKkt {
    /// For a program; `held` has one entry per parameter.
    pub fn new<P: Structured>(problem: &Constrained<P>, held: &[bool]) -> Self {
        let program = problem.inner();
        let (n, m) = (program.n(), program.m());
        let (nx, (first_p, _)) = (program.nx(), program.parameter_scale());
        let states = program.state_positions();
        let mut parameters = vec![false; held.len()];
        let (mut blocks, mut jacobian) = (Vec::new(), 0);
        for block in problem.blocks() {
            let local = problem.local(block.constraint).to_vec();
            for i in local.iter().filter(|i| **i >= nx) {
                parameters[i - nx] = true;
            }
            let variable = |i: &usize| match i.checked_sub(nx) {
                Some(j) => first_p + j,
                None => block.node.map_or(0, |k| states[k]) + i,
            };
            let rows = Rows {
                node: block.node,
                variables: local.iter().map(variable).collect(),
                local,
                count: problem.outputs(block.constraint),
                first: block.row,
                slack: block.slack,
                jacobian,
            };
            jacobian += rows.count * rows.width();
            blocks.push(rows);
        }
        let inner = program.roomy(held, &parameters);
        Self {
            hessian: vec![0.0; inner.len],
            jacobian: vec![0.0; jacobian],
            stiffness: STIFF,
            weights: vec![0.0; problem.m() - m],
            jacobian_len: program.jacobian_pattern().nnz(),
            hessian_len: program.hessian_pattern().nnz(),
            rx: vec![0.0; n],
            rc: vec![0.0; m],
            dx: vec![0.0; n],
            dl: vec![0.0; m],
            n,
            m,
            blocks,
            inner,
        }
    }

    /// Equalities by the penalty ½ w g² instead of nearly exactly; solutions are still refined to g = 0.
    #[must_use]
    pub fn with_stiffness(mut self, w: f64) -> Self {
        self.stiffness = w;
        self
    }

    /// Adds `Gᵀ t` of one row to `rx`.
    fn spread(rx: &mut [f64], rows: &Rows, jacobian: &[f64], r: usize, t: f64) {
        for (g, v) in rows.row(jacobian, r).iter().zip(&rows.variables) {
            rx[*v] += g * t;
        }
    }
}

impl Condensing for ConstrainedKkt {
    fn reduced_hessian(&self) -> (&Mat<f64>, Vec<usize>) {
        self.inner.kkt.reduced_hessian()
    }
}

impl Kkt for ConstrainedKkt {
    fn expect_error(&mut self, error: f64) {
        self.inner.kkt.expect_error(error);
    }

    fn limit(&mut self, radius: f64) -> Option<f64> {
        self.inner.kkt.limit(radius)
    }

    fn remember(&mut self, dx: &[f64]) {
        self.inner.kkt.remember(&dx[..self.n]);
    }

    fn factorise(&mut self, values: KktValues<'_>) -> Result<Regularisation, KktError> {
        self.hessian.fill(0.0);
        for &[from, to, len] in &self.inner.own {
            self.hessian[to..to + len].copy_from_slice(&values.hessian[from..from + len]);
        }
        let (own, constraints) = values.jacobian.split_at(self.jacobian_len);
        self.jacobian.copy_from_slice(constraints);
        let mut second = values.hessian[self.hessian_len..].iter();
        for rows in &self.blocks {
            let weights = &mut self.weights[rows.first - self.m..][..rows.count];
            match rows.slack {
                Some(at) => weights.copy_from_slice(&values.sigma[at..at + rows.count]),
                None => weights.fill(self.stiffness),
            }
            for (a, &i) in rows.local.iter().enumerate() {
                for (b, &j) in rows.local[..=a].iter().enumerate() {
                    let mut value = second.next().copied().unwrap_or(0.0);
                    for (r, w) in weights.iter().enumerate() {
                        let g = rows.row(&self.jacobian, r);
                        value += w * g[a] * g[b];
                    }
                    if let Some(at) = self.inner.at(rows.node, i, j) {
                        self.hessian[at] += value;
                    }
                }
            }
        }
        self.inner.kkt.factorise(KktValues {
            hessian: &self.hessian,
            jacobian: own,
            sigma: &values.sigma[..self.n],
        })
    }

    fn solve(&mut self, rx: &[f64], rc: &[f64], dx: &mut [f64], dlambda: &mut [f64]) -> f64 {
        let (n, m) = (self.n, self.m);
        let g = &self.jacobian;
        let weight = |rows: &Rows, r: usize| self.weights[rows.first - m + r];
        self.rx.copy_from_slice(&rx[..n]);
        for rows in &self.blocks {
            for r in 0..rows.count {
                let own = rows.slack.map_or(0.0, |at| rx[at + r]);
                let t = own - weight(rows, r) * rc[rows.first + r];
                Self::spread(&mut self.rx, rows, g, r, -t);
            }
        }
        let (own_x, own_l) = (&mut dx[..n], &mut dlambda[..m]);
        let mut left = self.inner.kkt.solve(&self.rx, &rc[..m], own_x, own_l);
        let scale = rx.iter().chain(rc).fold(0.0_f64, |a, v| a.max(v.abs()));
        let mut worst = 0.0_f64;
        for rows in &self.blocks {
            for r in 0..rows.count {
                let moved = rows.product(g, r, &dx[..n]);
                let open = rc[rows.first + r] - moved;
                let own = rows.slack.map_or(0.0, |at| rx[at + r]);
                dlambda[rows.first + r] = own - weight(rows, r) * open;
                match rows.slack {
                    Some(at) => dx[at + r] = open,
                    None => worst = worst.max(open.abs()),
                }
            }
        }
        let mut passes = 0;
        while worst > REFINED * scale && passes < PASSES {
            passes += 1;
            self.rx.fill(0.0);
            for rows in self.blocks.iter().filter(|b| b.slack.is_none()) {
                for r in 0..rows.count {
                    let open = rc[rows.first + r] - rows.product(g, r, &dx[..n]);
                    Self::spread(&mut self.rx, rows, g, r, weight(rows, r) * open);
                }
            }
            self.inner
                .kkt
                .solve(&self.rx, &self.rc, &mut self.dx, &mut self.dl);
            let mut next = 0.0_f64;
            for rows in &self.blocks {
                for r in 0..rows.count {
                    let moved = rows.product(g, r, &self.dx);
                    match rows.slack {
                        Some(at) => {
                            dx[at + r] -= moved;
                            dlambda[rows.first + r] += weight(rows, r) * moved;
                        }
                        None => {
                            let before = rc[rows.first + r] - rows.product(g, r, &dx[..n]);
                            dlambda[rows.first + r] += weight(rows, r) * (moved - before);
                            next = next.max((before - moved).abs());
                        }
                    }
                }
            }
            for (d, s) in dx.iter_mut().zip(&self.dx) {
                *d += s;
            }
            for (d, s) in dlambda.iter_mut().zip(&self.dl) {
                *d += s;
            }
            let slow = next > 0.5 * worst;
            worst = next;
            if slow {
                break;
            }
        }
        if passes > 0 {
            self.inner.kkt.remember(&dx[..n]);
        }
        if scale > 0.0 {
            left = left.max(worst / scale);
        }
        left
    }
}
