//! One-step schemes, written so that every evaluation of the residual is an affine map of a step's unknowns.
//!
//! Because `q' = v` is linear, any Runge-Kutta scheme of the implicit residual can take its stage accelerations as
//! unknowns; positions, velocities and accelerations of each evaluation are then linear combinations of the blocks
//! (q_k, v_k, s, q_{k+1}, v_{k+1}) with coefficients that are powers of the step. No mass matrix is inverted.

use serde::{Deserialize, Serialize};

/// A one-step scheme for `M a + b = f_L`, `q' = v`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Scheme {
    /// Explicit Euler, order 1: the paper's setting.
    ExplicitEuler,
    /// Trapezoidal rule, order 2; inputs of a zero-order hold keep their value to the end of the step.
    Trapezoidal,
    /// Implicit midpoint rule, order 2.
    ImplicitMidpoint,
}

impl Scheme {
    /// Order of convergence.
    pub fn order(self) -> u32 {
        match self {
            Self::ExplicitEuler => 1,
            Self::Trapezoidal | Self::ImplicitMidpoint => 2,
        }
    }

    /// Name for people.
    pub fn label(self) -> &'static str {
        match self {
            Self::ExplicitEuler => "explicit Euler",
            Self::Trapezoidal => "trapezoidal rule",
            Self::ImplicitMidpoint => "implicit midpoint rule",
        }
    }
}

/// A block of `nq` unknowns of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Block {
    /// Coordinates at the start of the step.
    Q0,
    /// Velocities at the start of the step.
    V0,
    /// Accelerations of a stage.
    Stage(usize),
    /// Coordinates at the end of the step.
    Q1,
    /// Velocities at the end of the step.
    V1,
}

/// `coefficient · h^power · block`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Term {
    pub(super) block: Block,
    pub(super) coefficient: f64,
    pub(super) power: i32,
}

const fn term(coefficient: f64, power: i32, block: Block) -> Term {
    Term {
        block,
        coefficient,
        power,
    }
}

/// One evaluation of the residual.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Evaluation {
    /// Coordinates as a combination of blocks.
    pub(super) q: Vec<Term>,
    /// Velocities.
    pub(super) v: Vec<Term>,
    /// Accelerations.
    pub(super) a: Vec<Term>,
    /// Share of the way from the input at the start of the step to that at its end.
    pub(super) u: f64,
}

/// A scheme's rows: `linear` ones are combinations of blocks that vanish, then one residual per evaluation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tableau {
    /// Number of stage blocks among the unknowns.
    pub(super) stages: usize,
    pub(super) linear: Vec<Vec<Term>>,
    pub(super) evaluations: Vec<Evaluation>,
}

impl Tableau {
    pub(super) fn new(scheme: Scheme) -> Self {
        use Block::{Q0, Q1, Stage, V0, V1};
        let slope = vec![term(1.0, -1, V1), term(-1.0, -1, V0)];
        match scheme {
            Scheme::ExplicitEuler => Self {
                stages: 0,
                linear: vec![vec![term(1.0, 0, Q1), term(-1.0, 0, Q0), term(-1.0, 1, V0)]],
                evaluations: vec![Evaluation {
                    q: vec![term(1.0, 0, Q0)],
                    v: vec![term(1.0, 0, V0)],
                    a: slope,
                    u: 0.0,
                }],
            },
            Scheme::ImplicitMidpoint => Self {
                stages: 0,
                linear: vec![vec![
                    term(1.0, 0, Q1),
                    term(-1.0, 0, Q0),
                    term(-0.5, 1, V0),
                    term(-0.5, 1, V1),
                ]],
                evaluations: vec![Evaluation {
                    q: vec![term(0.5, 0, Q0), term(0.5, 0, Q1)],
                    v: vec![term(0.5, 0, V0), term(0.5, 0, V1)],
                    a: slope,
                    u: 0.5,
                }],
            },
            // v1 = v0 + h/2 (s + a_end) gives a_end = 2 (v1 − v0)/h − s.
            Scheme::Trapezoidal => Self {
                stages: 1,
                linear: vec![vec![
                    term(1.0, 0, Q1),
                    term(-1.0, 0, Q0),
                    term(-0.5, 1, V0),
                    term(-0.5, 1, V1),
                ]],
                evaluations: vec![
                    Evaluation {
                        q: vec![term(1.0, 0, Q0)],
                        v: vec![term(1.0, 0, V0)],
                        a: vec![term(1.0, 0, Stage(0))],
                        u: 0.0,
                    },
                    Evaluation {
                        q: vec![term(1.0, 0, Q1)],
                        v: vec![term(1.0, 0, V1)],
                        a: vec![
                            term(2.0, -1, V1),
                            term(-2.0, -1, V0),
                            term(-1.0, 0, Stage(0)),
                        ],
                        u: 1.0,
                    },
                ],
            },
        }
    }

    /// First local position of a block; local order is (q_k, v_k, stages, q_{k+1}, v_{k+1}, p).
    pub(super) fn position(&self, block: Block, nq: usize) -> usize {
        match block {
            Block::Q0 => 0,
            Block::V0 => nq,
            Block::Stage(i) => (2 + i) * nq,
            Block::Q1 => (2 + self.stages) * nq,
            Block::V1 => (3 + self.stages) * nq,
        }
    }
}
