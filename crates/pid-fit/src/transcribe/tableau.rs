//! Schemes written so that every evaluation of the residual is an affine map of a step's unknowns.
//!
//! Because `q' = v` is linear, any Runge-Kutta scheme of the implicit residual can take its stage
//! accelerations K as unknowns:
//!
//! ```text
//! q_i = q_0 + c_i h v_0 + h² Σ_j (A²)_ij K_j,     v_i = v_0 + h Σ_j A_ij K_j,     a_i = K_i
//! q_1 = q_0 + h v_0 + h² Σ_j (bᵀA)_j K_j,         v_1 = v_0 + h Σ_j b_j K_j
//! ```
//!
//! The last line gives the last K from v_1, so that a step has the unknowns (K_1 … K_{s−1}, q_1,
//! v_1): positions, velocities and accelerations of each evaluation are linear combinations of the
//! blocks (q_0, v_0, K, q_1, v_1) with coefficients that are powers of the step. No mass matrix is
//! inverted.

use super::butcher::Butcher;
use super::scheme::Scheme;

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

/// Smallest and largest power of the step in derivatives of second order.
pub(super) const LOWEST_POWER: i32 = -2;
/// See [`LOWEST_POWER`].
pub(super) const POWERS: usize = 7;

/// Powers h^-2 … h^4.
pub(super) fn powers(h: f64) -> [f64; POWERS] {
    let i = 1.0 / h;
    [i * i, i, 1.0, h, h * h, h * h * h, h * h * h * h]
}

/// `h^power` from the table.
#[inline(always)]
pub(super) fn pow(table: &[f64; POWERS], power: i32) -> f64 {
    table[(power - LOWEST_POWER) as usize]
}

/// A sum of terms, one per block and power.
#[derive(Debug, Clone, Default)]
struct Sum(Vec<Term>);

impl Sum {
    fn add(&mut self, coefficient: f64, power: i32, block: Block) {
        if coefficient == 0.0 {
            return;
        }
        let same = |t: &&mut Term| t.block == block && t.power == power;
        match self.0.iter_mut().find(same) {
            Some(term) => term.coefficient += coefficient,
            None => self.0.push(Term {
                block,
                coefficient,
                power,
            }),
        }
    }

    fn with(mut self, coefficient: f64, power: i32, block: Block) -> Self {
        self.add(coefficient, power, block);
        self
    }

    /// Adds `coefficient h^power K_j` with the last K expressed by the others and the change of velocity.
    fn add_stage(&mut self, method: &Butcher, coefficient: f64, power: i32, j: usize) {
        let last = method.stages() - 1;
        if j < last {
            self.add(coefficient, power, Block::Stage(j));
            return;
        }
        let share = coefficient / method.b[last];
        self.add(share, power - 1, Block::V1);
        self.add(-share, power - 1, Block::V0);
        for k in 0..last {
            self.add(-share * method.b[k], power, Block::Stage(k));
        }
    }

    /// The terms, without those that cancelled up to rounding.
    fn terms(self) -> Vec<Term> {
        let largest = self
            .0
            .iter()
            .fold(0.0_f64, |m, t| m.max(t.coefficient.abs()));
        let counts = |t: &Term| t.coefficient.abs() > 1e-14 * largest;
        self.0.into_iter().filter(counts).collect()
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
    /// Group of rows that the residual is added to, and its weight there.
    pub(super) group: usize,
    pub(super) weight: f64,
}

/// A scheme's rows: `linear` ones are combinations of blocks that vanish, then groups of rows with
/// weighted sums of residuals, in general one residual each.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tableau {
    /// Number of stage blocks among the unknowns.
    pub(super) stages: usize,
    pub(super) linear: Vec<Vec<Term>>,
    pub(super) evaluations: Vec<Evaluation>,
    /// The method behind it.
    pub(super) butcher: Butcher,
}

impl Tableau {
    pub(super) fn new(scheme: Scheme) -> Self {
        let mut tableau = Self::of(scheme.butcher());
        if scheme == Scheme::ImplicitMidpoint {
            // The same step by the mean of its ends, which keeps more zeros than the form with c = 1/2.
            let mean = |a, b| Sum::default().with(0.5, 0, a).with(0.5, 0, b).terms();
            tableau.evaluations[0].q = mean(Block::Q0, Block::Q1);
            tableau.evaluations[0].v = mean(Block::V0, Block::V1);
        }
        tableau
    }

    /// For a residual `a − a*(q, v, u, p)`. Rows are then sums of accelerations, so that those of
    /// the trapezoidal rule need no stage: `(v_1 − v_0) / h = ½ (a*_0 + a*_1)`. The same motions,
    /// two thirds of the unknowns.
    pub(super) fn solved(scheme: Scheme) -> Self {
        let mut tableau = Self::new(scheme);
        if scheme == Scheme::Trapezoidal {
            tableau.stages = 0;
            for evaluation in &mut tableau.evaluations {
                evaluation.a = Sum::default()
                    .with(1.0, -1, Block::V1)
                    .with(-1.0, -1, Block::V0)
                    .terms();
                evaluation.group = 0;
                evaluation.weight = 0.5;
            }
        }
        tableau
    }

    fn of(method: Butcher) -> Self {
        let s = method.stages();
        let (squared, weighted) = (method.squared(), method.weighted());
        let mut end = Sum::default()
            .with(1.0, 0, Block::Q1)
            .with(-1.0, 0, Block::Q0)
            .with(-1.0, 1, Block::V0);
        for (j, &weight) in weighted.iter().enumerate() {
            end.add_stage(&method, -weight, 2, j);
        }
        let evaluations = (0..s)
            .map(|i| {
                let mut a = Sum::default();
                a.add_stage(&method, 1.0, 0, i);
                let (mut q, mut v) = (Sum::default(), Sum::default());
                if i + 1 == s && method.ends_in_last_stage() {
                    q.add(1.0, 0, Block::Q1);
                    v.add(1.0, 0, Block::V1);
                } else {
                    q.add(1.0, 0, Block::Q0);
                    q.add(method.c[i], 1, Block::V0);
                    v.add(1.0, 0, Block::V0);
                    for j in 0..s {
                        q.add_stage(&method, squared[i * s + j], 2, j);
                        v.add_stage(&method, method.a[i * s + j], 1, j);
                    }
                }
                Evaluation {
                    q: q.terms(),
                    v: v.terms(),
                    a: a.terms(),
                    u: method.c[i],
                    group: i,
                    weight: 1.0,
                }
            })
            .collect();
        Self {
            stages: s - 1,
            linear: vec![end.terms()],
            evaluations,
            butcher: method,
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

    /// Unknowns of a step.
    pub(super) fn unknowns(&self, nq: usize) -> usize {
        (2 + self.stages) * nq
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(terms: &[Term], h: f64, blocks: &dyn Fn(Block) -> f64) -> f64 {
        let table = powers(h);
        let value = |t: &Term| t.coefficient * pow(&table, t.power) * blocks(t.block);
        terms.iter().map(value).sum()
    }

    /// A motion whose acceleration is a polynomial of degree `s − 2`, its velocity one of `s − 1`,
    /// fulfils every combination of a collocation exactly.
    #[test]
    fn polynomial_motions_fulfil_the_combinations() {
        let h = 0.3;
        for scheme in [
            "gauss-legendre-3",
            "radau-4",
            "hermite-simpson",
            "trapezoidal",
        ] {
            let tableau = Tableau::new(scheme.parse().unwrap());
            let s = tableau.butcher.stages() - 1;
            let a = |t: f64| {
                (1..=s)
                    .map(|k| (k as f64) * t.powi(k as i32 - 1))
                    .sum::<f64>()
            };
            let v = |t: f64| 0.4 + (1..=s).map(|k| t.powi(k as i32)).sum::<f64>();
            let q = |t: f64| {
                let power = |k: usize| t.powi(k as i32 + 1) / (k as f64 + 1.0);
                0.2 + 0.4 * t + (1..=s).map(power).sum::<f64>()
            };
            let blocks = |block| match block {
                Block::Q0 => q(0.0),
                Block::V0 => v(0.0),
                Block::Stage(i) => a(h * tableau.butcher.c[i]),
                Block::Q1 => q(h),
                Block::V1 => v(h),
            };
            assert!(at(&tableau.linear[0], h, &blocks).abs() < 1e-13, "{scheme}");
            for e in &tableau.evaluations {
                let t = h * e.u;
                for (terms, exact) in [(&e.q, q(t)), (&e.v, v(t)), (&e.a, a(t))] {
                    let found = at(terms, h, &blocks);
                    assert!(
                        (found - exact).abs() < 1e-12,
                        "{scheme}: {found} for {exact}"
                    );
                }
            }
        }
    }

    #[test]
    fn simple_schemes_have_their_simple_forms() {
        let euler = Tableau::new(Scheme::ExplicitEuler);
        assert_eq!(euler.stages, 0);
        assert_eq!(euler.evaluations[0].q.len(), 1);
        let trapezoidal = Tableau::new(Scheme::Trapezoidal);
        // q1 = q0 + h/2 (v0 + v1).
        assert_eq!(trapezoidal.linear[0].len(), 4);
        assert!(trapezoidal.linear[0].iter().all(|t| t.power <= 1));
    }
}
