//! Structural identifiability: which combinations of the parameters a motion determines.
//!
//! With every coordinate measured and every input known, the parameters act on a motion through the
//! forward dynamics `a(q, v, u, p)` alone. A direction `n` in the parameters with `∂a/∂p · n = 0`
//! at every state and input changes no motion; the rank of `∂a/∂p`, stacked over many states, is
//! the number of combinations that can be found from any record (R. Bellman, K. J. Åström, *On
//! structural identifiability*, 1970; the numerical test as in E. Walter, L. Pronzato, 1997).
//!
//! `M ∂a/∂p = −∂r/∂p` at `r = 0`, and M is regular: both have the same null space, and the second
//! needs no inverse. It is exact (derived on the graph) and evaluated at random states with a fixed
//! seed; [`crate::dense::rank`] decides.
//!
//! - *generic*: parameters drawn at random from their ranges; the largest rank found over several draws;
//! - *nominal*: parameters at their nominal values, where symmetry may lose more (a centre of mass
//!   on the axis).

mod groups;

pub use groups::{Group, GroupKind};

use pid_symbolic::random::Random;
use pid_symbolic::{Graph, Id, Tape, diff, pattern};

use crate::dense::{self, Matrix};
use crate::equations::Equations;
use crate::model::Robot;
use crate::{Error, sample};

/// Draws of the parameters for the generic rank.
const DRAWS: usize = 3;
/// States per draw, at least; with many parameters so many that there are [`OVERSAMPLING`] rows per column.
const STATES: usize = 48;
/// Rows per parameter.
const OVERSAMPLING: usize = 4;
/// An effect below this share of the largest in its equation is a rounding error.
const ROUNDING: f64 = 1e-11;

/// Rank of a set of parameters, and the lost directions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Structure {
    /// The parameters considered.
    pub params: Vec<usize>,
    /// Number of combinations that the motion determines.
    pub rank: usize,
    /// Smallest pivot kept and largest dropped, relative to the largest.
    pub gap: (f64, f64),
    /// Groups of lost directions: as many directions as parameters beyond the rank.
    pub groups: Vec<Group>,
}

/// Ranks at parameters drawn from their ranges, and at the nominal values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Structures {
    /// At almost all parameter values.
    pub generic: Structure,
    /// At the nominal values.
    pub nominal: Structure,
}

/// Structural identifiability of a robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Identifiability {
    /// Of all parameters.
    pub all: Structures,
    /// Rank of the parameters that are not marked `fixed`, with those held; the same as `all` if
    /// none is `fixed`.
    pub free: Structures,
}

/// Structural identifiability of a robot.
///
/// # Errors
/// As [`equations`](crate::equations()).
pub fn identifiability(robot: &Robot) -> Result<Identifiability, Error> {
    let mut g = Graph::new();
    let equations = crate::equations(&mut g, robot)?;
    Ok(of_equations(&mut g, robot, &equations))
}

/// As [`identifiability`], of equations at hand.
pub fn of_equations(g: &mut Graph, robot: &Robot, equations: &Equations) -> Identifiability {
    let np = robot.params.len();
    let all: Vec<usize> = (0..np).collect();
    let free: Vec<usize> = (0..np).filter(|&k| !robot.params[k].fixed).collect();
    let sampler = Sampler::new(g, robot, equations);

    let mut random = Random::new(0x1de7);
    let mut draws = Vec::new();
    for _ in 0..DRAWS {
        let p = sample::parameters(robot, &mut random);
        draws.push((sampler.sensitivities(&p, &mut random), p));
    }
    let nominal: Vec<f64> = robot.params.iter().map(|param| param.nominal).collect();
    let at_nominal = sampler.sensitivities(&nominal, &mut random);

    let of = |params: &[usize]| Structures {
        generic: draws
            .iter()
            .map(|(y, p)| structure(y, p, params))
            .reduce(|best, next| if next.rank > best.rank { next } else { best })
            .unwrap_or_default(),
        nominal: structure(&at_nominal, &nominal, params),
    };
    let of_all = of(&all);
    Identifiability {
        free: if free.len() == np {
            of_all.clone()
        } else {
            of(&free)
        },
        all: of_all,
    }
}

fn structure(y: &Matrix, p: &[f64], params: &[usize]) -> Structure {
    let selected = y.select(params);
    let found = dense::rank(&selected);
    let values: Vec<f64> = params.iter().map(|&k| p[k]).collect();
    let mut groups = groups::groups(&selected, &found.null, &values);
    for group in &mut groups {
        for k in group.params.iter_mut().chain(&mut group.touched) {
            *k = params[*k];
        }
    }
    Structure {
        params: params.to_vec(),
        rank: found.rank,
        gap: found.gap,
        groups,
    }
}

/// Evaluates ∂r/∂p on motions, rows and columns scaled.
struct Sampler<'a> {
    robot: &'a Robot,
    /// Lower triangle of M, then r: at a = 0 the right-hand side of the forward dynamics, negative.
    forward: Tape,
    /// Non-zeros of ∂r/∂p.
    slopes: Tape,
    /// Where they are.
    entries: Vec<(usize, usize)>,
}

impl<'a> Sampler<'a> {
    fn new(g: &mut Graph, robot: &'a Robot, equations: &Equations) -> Self {
        let forward: Vec<Id> = equations
            .mass_matrix
            .iter()
            .chain(&equations.residual)
            .copied()
            .collect();
        let rows = diff::jacobian(g, &equations.residual, &equations.symbols.p);
        let flat: Vec<Id> = rows.into_iter().flatten().collect();
        let zero = pattern::zeros(g, &flat);
        let np = robot.params.len();
        let kept: Vec<usize> = (0..flat.len()).filter(|&k| !zero[k]).collect();
        let values: Vec<Id> = kept.iter().map(|&k| flat[k]).collect();
        Self {
            robot,
            forward: Tape::new(g, &forward),
            slopes: Tape::new(g, &values),
            entries: kept.into_iter().map(|k| (k / np, k % np)).collect(),
        }
    }

    /// Rows of ∂r/∂p at random states and inputs with the accelerations they cause, each row
    /// divided by its largest effect over the parameters' ranges. States with a singular M or a
    /// value that is not finite are left out.
    fn sensitivities(&self, p: &[f64], random: &mut Random) -> Matrix {
        let (nq, np) = (self.robot.nq(), p.len());
        let nm = nq * (nq + 1) / 2;
        let states = STATES.max((OVERSAMPLING * np).div_ceil(nq.max(1)));
        let first_param = 3 * nq + self.robot.inputs.len();
        let width: Vec<f64> = self.robot.params.iter().map(sample::width).collect();

        let mut matrix = Matrix::zeros(states * nq, np);
        let mut forward = vec![0.0; nm + nq];
        let mut slopes = vec![0.0; self.entries.len()];
        let mut work = Vec::new();
        for state in 0..states {
            let mut z = sample::motion(self.robot, random);
            z[first_param..first_param + np].copy_from_slice(p);
            z[2 * nq..3 * nq].fill(0.0);
            self.forward.eval_with(&z, &mut forward, &mut work);
            let Some(a) = accelerations(nq, &forward[..nm], &forward[nm..]) else {
                continue;
            };
            z[2 * nq..3 * nq].copy_from_slice(&a);
            self.slopes.eval_with(&z, &mut slopes, &mut work);
            if !slopes.iter().all(|slope| slope.is_finite()) {
                continue;
            }
            let mut largest = vec![0.0_f64; nq];
            for (&(row, col), slope) in self.entries.iter().zip(&slopes) {
                largest[row] = largest[row].max((slope * width[col]).abs());
            }
            for (&(row, col), slope) in self.entries.iter().zip(&slopes) {
                // An effect that is a rounding error of the others counts as none.
                if (slope * width[col]).abs() > ROUNDING * largest[row] {
                    matrix[(state * nq + row, col)] = slope / largest[row];
                }
            }
        }
        matrix
    }
}

/// −M⁻¹ r by elimination with row pivoting; M need not be positive definite at drawn parameters.
fn accelerations(nq: usize, m: &[f64], r: &[f64]) -> Option<Vec<f64>> {
    let packed = |i: usize, j: usize| m[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)];
    let mut a: Vec<Vec<f64>> = (0..nq)
        .map(|i| (0..nq).map(|j| packed(i, j)).chain([-r[i]]).collect())
        .collect();
    let size = m.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    for k in 0..nq {
        let pivot = (k..nq).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        a.swap(k, pivot);
        let head = a[k][k];
        if head.is_nan() || head.abs() <= 1e-12 * size {
            return None;
        }
        for i in k + 1..nq {
            let factor = a[i][k] / head;
            for j in k..=nq {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    let mut x = vec![0.0; nq];
    for i in (0..nq).rev() {
        let sum: f64 = (i + 1..nq).map(|j| a[i][j] * x[j]).sum();
        x[i] = (a[i][nq] - sum) / a[i][i];
    }
    x.iter().all(|x| x.is_finite()).then_some(x)
}
