//! Constraints of the user on parameters and states, added to any program.
//!
//! ```text
//! minimise    f(x)
//! subject to  c(x) = 0
//!             g_k(x_i, p) + s = 0,     s = 0 for an equality, s ≥ 0 for an inequality g ≤ 0
//!             lower ≤ x ≤ upper
//! ```
//!
//! A constraint holds for the parameters alone, at one node, or at every node of the program (a
//! path constraint). It is a function over any dual number ([`pid_runtime::generic::functions`]),
//! so its derivatives are exact. The linear system is [`super::ConstrainedKkt`], which eliminates
//! the constraints' rows into those of their nodes; [`pid_nlp::solver::kkt::sparse::SparseKkt`]
//! serves as well and forgets the structure.

use super::{FullDiscretization, Shooting};
use pid_nlp::{Nlp, SparsePattern};
use pid_runtime::generic::functions::PointFunction;
use std::fmt;
use std::sync::Arc;

/// A program whose variables contain states and scaled parameters.
pub trait States: Nlp {
    /// Length of a state.
    fn nx(&self) -> usize;
    /// Positions of the node states among the variables.
    fn state_positions(&self) -> Vec<usize>;
    /// Position of the first parameter, and each parameter's value per unit of its variable.
    fn parameter_scale(&self) -> (usize, &[f64]);
}

impl States for FullDiscretization<'_> {
    fn nx(&self) -> usize {
        self.layout().nx
    }
    fn state_positions(&self) -> Vec<usize> {
        let layout = self.layout();
        let nodes = |w: usize| (0..=layout.windows[w].steps).map(move |k| (w, k));
        let all = (0..layout.windows.len()).flat_map(nodes);
        all.map(|(w, k)| layout.state(&layout.windows[w], k))
            .collect()
    }
    fn parameter_scale(&self) -> (usize, &[f64]) {
        (self.layout().p(), &self.setup().scale)
    }
}

impl States for Shooting<'_> {
    fn nx(&self) -> usize {
        2 * self.model().dims().nq
    }
    fn state_positions(&self) -> Vec<usize> {
        self.node_positions()
    }
    fn parameter_scale(&self) -> (usize, &[f64]) {
        (self.n() - self.setup().scale.len(), &self.setup().scale)
    }
}

/// Where a constraint holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// For the parameters; the function sees a state of zeros.
    Parameters,
    /// At one node, counted over all windows.
    Node(usize),
    /// At every node.
    EveryNode,
}

/// Relation that the values must satisfy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sense {
    /// g = 0.
    Equal,
    /// g ≤ 0.
    AtMost,
}

/// A constraint of the user.
#[derive(Clone)]
pub struct Constraint {
    /// Its name in messages.
    pub name: String,
    /// Where it holds.
    pub place: Place,
    /// Equality or inequality.
    pub sense: Sense,
    /// g(x, p).
    pub function: Arc<dyn PointFunction>,
}

impl Constraint {
    /// Nodes at which it holds among so many, `None` for the parameters.
    fn nodes(&self, nodes: usize) -> Result<Vec<Option<usize>>, ConstraintError> {
        Ok(match self.place {
            Place::Parameters => vec![None],
            Place::EveryNode => (0..nodes).map(Some).collect(),
            Place::Node(node) => match node < nodes {
                true => vec![Some(node)],
                false => {
                    return Err(ConstraintError::NoSuchNode {
                        name: self.name.clone(),
                        node,
                        nodes,
                    });
                }
            },
        })
    }
}

impl fmt::Debug for Constraint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, place, sense) = (&self.name, self.place, self.sense);
        write!(f, "Constraint({name}, {place:?}, {sense:?})")
    }
}

/// Two constraints are equal if they share their function.
impl PartialEq for Constraint {
    fn eq(&self, other: &Self) -> bool {
        (&self.name, self.place, self.sense) == (&other.name, other.place, other.sense)
            && Arc::ptr_eq(&self.function, &other.function)
    }
}

/// A constraint that does not fit its program.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ConstraintError {
    /// A node that is not there.
    #[error(
        "constraint `{name}` asks for node {node}, the program has {nodes} nodes\n  help: count nodes from 0 over all windows"
    )]
    NoSuchNode {
        /// Name of the constraint.
        name: String,
        /// The node asked for.
        node: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// A function of states or parameters of another number.
    #[error(
        "constraint `{name}` takes {found} states and parameters, the program has {expected}\n  help: states are positions, then velocities of all joints; parameters are those of the model, in its order"
    )]
    Lengths {
        /// Name of the constraint.
        name: String,
        /// States and parameters of the program.
        expected: String,
        /// Those of the function.
        found: String,
    },
}

/// One evaluation of a constraint.
pub(super) struct Block {
    pub(super) constraint: usize,
    /// Node and position of its state, `None` for constraints on the parameters.
    pub(super) node: Option<usize>,
    state: Option<usize>,
    /// First row.
    pub(super) row: usize,
    /// First slack, for inequalities.
    pub(super) slack: Option<usize>,
}

/// A program with constraints added; see the module's documentation.
pub struct Constrained<P> {
    inner: P,
    constraints: Vec<Constraint>,
    blocks: Vec<Block>,
    /// Positions in (x, p) that each constraint depends on at its place.
    local: Vec<Vec<usize>>,
    n: usize,
    m: usize,
    nx: usize,
    first_p: usize,
    scale: Vec<f64>,
    jacobian_pattern: SparsePattern,
    hessian_pattern: SparsePattern,
    zero: Vec<f64>,
    p: Vec<f64>,
    g: Vec<f64>,
    jacobian: Vec<f64>,
    hessian: Vec<f64>,
}

impl<P: States> Constrained<P> {
    /// Adds constraints to a program.
    ///
    /// # Errors
    /// [`ConstraintError`] if a constraint asks for a node that is not there, or its function for
    /// other states and parameters.
    pub fn new(inner: P, constraints: Vec<Constraint>) -> Result<Self, ConstraintError> {
        let nodes = inner.state_positions();
        let (first_p, scale) = inner.parameter_scale();
        let scale = scale.to_vec();
        let (nx, np) = (inner.nx(), scale.len());
        let (mut row, mut variable) = (inner.m(), inner.n());
        let mut blocks = Vec::new();
        let mut largest = 0;
        let mut local = Vec::new();
        for (k, constraint) in constraints.iter().enumerate() {
            let size = constraint.function.outputs();
            largest = largest.max(size);
            let variables = constraint.function.variables();
            check_lengths(constraint, variables.as_deref(), (nx, np))?;
            let mut variables = variables.unwrap_or_else(|| (0..nx + np).collect());
            if constraint.place == Place::Parameters {
                variables.retain(|i| *i >= nx);
            }
            local.push(variables);
            for node in constraint.nodes(nodes.len())? {
                let slack = (constraint.sense == Sense::AtMost).then_some(variable);
                variable += if slack.is_some() { size } else { 0 };
                blocks.push(Block {
                    constraint: k,
                    node,
                    state: node.map(|node| nodes[node]),
                    row,
                    slack,
                });
                row += size;
            }
        }
        let mut jacobian_pattern = inner.jacobian_pattern().clone();
        let mut hessian_pattern = inner.hessian_pattern().clone();
        let nz = nx + np;
        for block in &blocks {
            let local = &local[block.constraint];
            let place = |i: usize| place(block.state, first_p, nx, i);
            for r in 0..constraints[block.constraint].function.outputs() {
                for &i in local {
                    jacobian_pattern.push(block.row + r, place(i));
                }
                if let Some(slack) = block.slack {
                    jacobian_pattern.push(block.row + r, slack + r);
                }
            }
            for (k, &i) in local.iter().enumerate() {
                for &j in &local[..=k] {
                    let (a, b) = (place(i), place(j));
                    hessian_pattern.push(a.max(b), a.min(b));
                }
            }
        }
        Ok(Self {
            n: variable,
            m: row,
            nx,
            first_p,
            scale,
            blocks,
            local,
            jacobian_pattern,
            hessian_pattern,
            zero: vec![0.0; nx],
            p: vec![0.0; np],
            g: vec![0.0; largest],
            jacobian: vec![0.0; largest * nz],
            hessian: vec![0.0; nz * nz],
            constraints,
            inner,
        })
    }

    /// The program without the constraints.
    pub fn inner(&self) -> &P {
        &self.inner
    }

    /// The program without the constraints, to read states and residuals from the first variables of a point.
    pub fn inner_mut(&mut self) -> &mut P {
        &mut self.inner
    }

    /// Whether each inequality holds a solution, slack by slack from the first: the multiplier `z`
    /// of the slack, for an objective that is a mean over so many samples, exceeds the slack
    /// itself.
    pub(crate) fn held(&self, x: &[f64], z: &[f64], samples: usize) -> Vec<bool> {
        let own = self.inner.n()..self.n;
        own.map(|k| samples as f64 * z[k] > x[k]).collect()
    }

    /// One sentence for each constraint: where a solution lies on it, or how much room it leaves.
    pub(crate) fn remarks(&self, x: &[f64], z: &[f64], samples: usize) -> Vec<String> {
        let (n, held) = (self.inner.n(), self.held(x, z, samples));
        let remark = |(k, constraint): (usize, &Constraint)| {
            let size = constraint.function.outputs();
            let slacks = self.blocks.iter().filter(|b| b.constraint == k);
            let slacks = slacks.filter_map(|b| b.slack).flat_map(|s| s..s + size);
            let (mut all, mut active, mut room) = (0, 0, f64::INFINITY);
            for slack in slacks {
                all += 1;
                active += usize::from(held[slack - n]);
                room = room.min(x[slack]);
            }
            let name = &constraint.name;
            match (all, active) {
                (0, _) => format!("constraint `{name}`: an equality"),
                (1, 1) => format!("constraint `{name}`: active"),
                (1, 0) => format!("constraint `{name}`: not active, room {room:.3e}"),
                (_, 0) => format!("constraint `{name}`: active nowhere, room {room:.3e}"),
                _ => format!("constraint `{name}`: active at {active} of {all} places"),
            }
        };
        self.constraints.iter().enumerate().map(remark).collect()
    }

    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Positions in (x, p) that a constraint depends on at its place.
    pub(super) fn local(&self, constraint: usize) -> &[usize] {
        &self.local[constraint]
    }

    /// Number of values of a constraint.
    pub(super) fn outputs(&self, constraint: usize) -> usize {
        self.constraints[constraint].function.outputs()
    }

    /// A start of the program without constraints, extended by slacks that fulfil the inequalities
    /// where they can.
    pub fn extend(&mut self, start: &[f64]) -> Vec<f64> {
        let mut x = start.to_vec();
        x.resize(self.n, 0.0);
        self.load(&x);
        for block in &self.blocks {
            let Some(slack) = block.slack else { continue };
            let function = &self.constraints[block.constraint].function;
            let g = &mut self.g[..function.outputs()];
            let state = block
                .state
                .map_or(&self.zero[..], |at| &start[at..at + self.nx]);
            function.value(state, &self.p, g);
            for (r, g) in g.iter().enumerate() {
                x[slack + r] = (-g).max(1e-4);
            }
        }
        x
    }

    fn load(&mut self, x: &[f64]) {
        let p = &x[self.first_p..];
        for ((out, p), s) in self.p.iter_mut().zip(p).zip(&self.scale) {
            *out = p * s;
        }
    }
}

fn check_lengths(
    constraint: &Constraint,
    variables: Option<&[usize]>,
    (nx, np): (usize, usize),
) -> Result<(), ConstraintError> {
    let wrong = |found: String| ConstraintError::Lengths {
        name: constraint.name.clone(),
        expected: format!("{nx} and {np}"),
        found,
    };
    if let Some((x, p)) = constraint.function.lengths().filter(|l| *l != (nx, np)) {
        return Err(wrong(format!("{x} and {p}")));
    }
    let last = variables.unwrap_or_default().iter().max();
    match last.filter(|last| **last >= nx + np) {
        Some(last) => Err(wrong(format!("at least {}", last + 1))),
        None => Ok(()),
    }
}

/// Variable of entry `i` of (x, p); constraints on the parameters have no entries of a state.
fn place(state: Option<usize>, first_p: usize, nx: usize, i: usize) -> usize {
    match i.checked_sub(nx) {
        Some(j) => first_p + j,
        None => state.unwrap_or(0) + i,
    }
}

impl<P: States> Nlp for Constrained<P> {
    fn barrier_changed(&mut self, mu: f64) -> bool {
        self.inner.barrier_changed(mu)
    }

    fn longest_step(&self, x: &[f64], d: &[f64], share: f64) -> f64 {
        let n = self.inner.n();
        self.inner.longest_step(&x[..n], &d[..n], share)
    }

    fn n(&self) -> usize {
        self.n
    }

    fn m(&self) -> usize {
        self.m
    }

    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        let n = self.inner.n();
        self.inner.bounds(&mut lower[..n], &mut upper[..n]);
        lower[n..].fill(0.0);
        upper[n..].fill(f64::INFINITY);
    }

    fn objective(&mut self, x: &[f64]) -> f64 {
        self.inner.objective(&x[..self.inner.n()])
    }

    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        let n = self.inner.n();
        self.inner.gradient(&x[..n], &mut gradient[..n]);
        gradient[n..].fill(0.0);
    }

    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        let (n, m) = (self.inner.n(), self.inner.m());
        self.inner.constraints(&x[..n], &mut c[..m]);
        self.load(x);
        for block in &self.blocks {
            let function = &self.constraints[block.constraint].function;
            let out = &mut c[block.row..block.row + function.outputs()];
            let state = block
                .state
                .map_or(&self.zero[..], |at| &x[at..at + self.nx]);
            function.value(state, &self.p, out);
            if let Some(slack) = block.slack {
                out.iter_mut().zip(&x[slack..]).for_each(|(c, s)| *c += s);
            }
        }
    }

    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian_pattern
    }

    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        let (n, nz) = (self.inner.n(), self.nx + self.p.len());
        let mut k = self.inner.jacobian_pattern().nnz();
        self.inner.jacobian(&x[..n], &mut values[..k]);
        self.load(x);
        for block in &self.blocks {
            let function = &self.constraints[block.constraint].function;
            let size = function.outputs();
            let state = block
                .state
                .map_or(&self.zero[..], |at| &x[at..at + self.nx]);
            function.jacobian(state, &self.p, &mut self.g[..size], &mut self.jacobian);
            for r in 0..size {
                for &i in &self.local[block.constraint] {
                    let factor = if i < self.nx {
                        1.0
                    } else {
                        self.scale[i - self.nx]
                    };
                    values[k] = factor * self.jacobian[r * nz + i];
                    k += 1;
                }
                if block.slack.is_some() {
                    values[k] = 1.0;
                    k += 1;
                }
            }
        }
    }

    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian_pattern
    }

    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let (n, m, nz) = (self.inner.n(), self.inner.m(), self.nx + self.p.len());
        let mut k = self.inner.hessian_pattern().nnz();
        self.inner
            .hessian(&x[..n], sigma, &lambda[..m], &mut values[..k]);
        self.load(x);
        for block in &self.blocks {
            let function = &self.constraints[block.constraint].function;
            let weights = &lambda[block.row..block.row + function.outputs()];
            let state = block
                .state
                .map_or(&self.zero[..], |at| &x[at..at + self.nx]);
            function.hessian(state, &self.p, weights, &mut self.hessian);
            let factor = |i: usize| {
                if i < self.nx {
                    1.0
                } else {
                    self.scale[i - self.nx]
                }
            };
            let local = &self.local[block.constraint];
            for (at, &i) in local.iter().enumerate() {
                for &j in &local[..=at] {
                    values[k] = factor(i) * factor(j) * self.hessian[i * nz + j];
                    k += 1;
                }
            }
        }
    }
}
