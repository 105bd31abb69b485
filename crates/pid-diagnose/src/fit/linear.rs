//! Innovations and their exact derivatives, a few directions per pass; the directions that the
//! records determine.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};
use pid_data::Role;
use pid_interpret::nominal::Role as Part;
use rayon::prelude::*;

use super::products::gram;
use super::value::{LARGEST, all_gains, tame};
use crate::case::{Case, Record};
use crate::effect::{FEW, LANES, Pick};
use crate::hypothesis::{Hypothesis, Run};
use crate::observer::Gain;
use crate::point::Point;
use crate::predict::Runner;
use crate::scalar::{Lanes, Scalar};

/// Innovations and, on request, derivatives in directions.
#[derive(Debug, Clone)]
pub struct Linear {
    /// Innovations.
    pub r: DVector<f64>,
    /// Derivatives, one column per direction.
    pub j: DMatrix<f64>,
}

/// Directions of θ that the records determine, as columns.
#[derive(Debug, Clone)]
pub struct Basis {
    /// Deviations × r, orthonormal.
    pub columns: DMatrix<f64>,
}

impl Basis {
    /// The directions, one by one.
    pub fn directions(&self) -> Vec<Vec<f64>> {
        self.columns
            .column_iter()
            .map(|c| c.iter().copied().collect())
            .collect()
    }

    /// No directions: a fit moves the effects' parameters only.
    pub fn frozen(&self) -> Self {
        Basis {
            columns: DMatrix::zeros(self.columns.nrows(), 0),
        }
    }
}

/// A direction in which to differentiate.
#[derive(Debug, Clone, Copy)]
pub enum Direction<'a> {
    /// Of the deviations.
    Theta(&'a [f64]),
    /// A parameter of the effects.
    Effect(usize),
}

/// Innovations and derivatives on the records of a role, the states that no sensor reads where their gains have them.
pub fn linearise(
    case: &Case,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Vec<Gain>],
    role: Role,
    directions: &[Direction<'_>],
) -> Linear {
    let records: Vec<usize> = (0..case.records.len())
        .filter(|&i| case.records[i].role == role)
        .collect();
    gathered(records.len(), directions, |part, own| {
        let r = records[part];
        let over = if own.len() > FEW {
            one_pass::<LANES>
        } else {
            one_pass::<FEW>
        };
        over(case, &case.records[r], hypothesis, at, &gains[r], own)
    })
}

/// The errors of parts of the records and their derivatives, a few directions per pass. `one_pass`
/// gives those of a part, each followed by its derivatives in at most [`LANES`] directions.
pub(super) fn gathered<T: Sync>(
    parts: usize,
    directions: &[T],
    one_pass: impl Fn(usize, &[T]) -> Vec<f64> + Sync,
) -> Linear {
    // Wide passes as long as they are more than half full.
    let mut passes: Vec<&[T]> = Vec::new();
    let mut left = directions;
    while left.len() > FEW {
        let (pass, rest) = left.split_at(left.len().min(LANES));
        passes.push(pass);
        left = rest;
    }
    if !left.is_empty() || passes.is_empty() {
        passes.push(left);
    }
    let jobs: Vec<(usize, usize)> = (0..passes.len())
        .flat_map(|pass| (0..parts).map(move |part| (pass, part)))
        .collect();
    let results: Vec<Vec<f64>> = jobs
        .par_iter()
        .map(|&(pass, part)| one_pass(part, passes[pass]))
        .collect();
    let width = |pass: usize| 1 + passes[pass].len();
    let lengths: Vec<usize> = (0..parts)
        .map(|part| results[part].len() / width(0))
        .collect();
    let mut out = Linear {
        r: DVector::zeros(lengths.iter().sum()),
        j: DMatrix::zeros(lengths.iter().sum(), directions.len()),
    };
    let mut column = 0;
    for (pass, of_parts) in results.chunks(parts.max(1)).enumerate() {
        let mut row = 0;
        for rows in of_parts {
            for x in rows.chunks_exact(width(pass)) {
                out.r[row] = x[0];
                for (lane, slope) in x[1..].iter().enumerate() {
                    out.j[(row, column + lane)] = *slope;
                }
                row += 1;
            }
        }
        column += passes[pass].len();
    }
    out
}

/// Deviations and parameters with a derivative in each of the directions, at most `N`.
pub(super) fn lifted<'a, const N: usize>(
    at: &Point,
    directions: impl IntoIterator<Item = Direction<'a>>,
) -> (Vec<Lanes<N>>, Vec<Lanes<N>>)
where
    Lanes<N>: Pick,
{
    let lift = |x: &[f64]| x.iter().map(|&x| Lanes::<N>::constant(x)).collect();
    let (mut theta, mut e): (Vec<Lanes<N>>, Vec<Lanes<N>>) = (lift(&at.theta), lift(&at.e));
    for (lane, d) in directions.into_iter().enumerate() {
        match d {
            Direction::Theta(x) => {
                for (t, x) in theta.iter_mut().zip(x) {
                    t.eps[lane] = *x;
                }
            }
            Direction::Effect(i) => e[i].eps[lane] = 1.0,
        }
    }
    (theta, e)
}

/// Innovations of one record, each followed by its derivatives in at most `N` directions.
fn one_pass<const N: usize>(
    case: &Case,
    record: &Record,
    hypothesis: &Hypothesis,
    at: &Point,
    gains: &[Gain],
    directions: &[Direction<'_>],
) -> Vec<f64>
where
    Lanes<N>: Pick,
{
    let (theta, e) = lifted::<N>(at, directions.iter().copied());
    let mut rows = Vec::with_capacity(record.len() * case.n() * 2 * (1 + directions.len()));
    let mut runner = Runner::<Lanes<N>>::new(case, record, hypothesis, &theta, &e);
    runner.predict_while(
        runner.counted(),
        gains,
        &mut |_, _, _, x| {
            let fine = x.re.abs() < LARGEST && x.eps.iter().all(|e| e.abs() < 1e12);
            if fine {
                rows.push(x.re);
                rows.extend_from_slice(&x.eps[..directions.len()]);
            } else {
                rows.push(tame(x.re));
                rows.resize(rows.len() + directions.len(), 0.0);
            }
        },
        &mut |_, _| ControlFlow::Continue(()),
    );
    rows
}

/// Curvature from which a direction counts as told: the prior's is ten times as much.
const TOLD: f64 = 0.3;
/// Component of a direction, in tolerances of gains, from which it turns with them; those of links alone have
/// rounding there.
const IN_GAINS: f64 = 0.01;

/// Directions of θ that the train records determine beyond their tolerance, from the Jacobian at
/// the nominal values.
pub fn basis(case: &Case) -> Basis {
    basis_as_run(case, Run::default())
}

/// The same of the nominal structure run in a way.
pub(crate) fn basis_as_run(case: &Case, run: Run) -> Basis {
    let at = Point {
        theta: vec![0.0; case.nominal.size()],
        e: Vec::new(),
    };
    let terms = Vec::new();
    basis_beside(case, &Hypothesis { terms, run }, &at)
}

/// The same beside effects, at a point: a gear that gives way tells the inertia of its rotor from
/// that of the link behind it.
pub fn basis_beside(case: &Case, hypothesis: &Hypothesis, at: &Point) -> Basis {
    let size = case.nominal.size();
    let unit = DMatrix::<f64>::identity(size, size);
    let directions: Vec<Direction<'_>> = (0..size)
        .map(|i| Direction::Theta(&unit.as_slice()[i * size..(i + 1) * size]))
        .collect();
    let gains = all_gains(case, hypothesis, at);
    let lin = linearise(case, hypothesis, at, &gains, Role::Train, &directions);
    let eigen = gram(&lin.j).symmetric_eigen();
    let (kept, lost): (Vec<usize>, Vec<usize>) =
        (0..size).partition(|&i| eigen.eigenvalues[i] > TOLD);
    let vectors = |of: &[usize]| eigen.eigenvectors.select_columns(of);
    let turning = turning(case, &vectors(&lost));
    let mut columns = vectors(&kept).resize_horizontally(kept.len() + turning.ncols(), 0.0);
    let mut rest = columns.columns_mut(kept.len(), turning.ncols());
    rest.copy_from(&turning);
    Basis { columns }
}

/// Those of the directions that records do not tell, orthonormal in columns, which have gains of position loops
/// in them: they turn on the way to the fit, and a fit that left them out would stay where it began.
///
/// Gains multiply what the motor does and stand at unknown values: a common factor of all forces and gains is
/// never told, and it is another direction where a gain is twice what was stated. What links hide from each
/// other is the same everywhere.
fn turning(case: &Case, lost: &DMatrix<f64>) -> DMatrix<f64> {
    let values = case.nominal.values.iter().enumerate();
    let loose = values.filter(|(_, v)| v.half_width > 0.0);
    let gains: Vec<usize> = loose
        .filter_map(|(i, v)| matches!(v.role, Part::Servo(_)).then_some(i))
        .collect();
    if gains.is_empty() || lost.ncols() == 0 {
        return DMatrix::zeros(lost.nrows(), 0);
    }
    let own = lost.select_rows(&gains);
    let eigen = gram(&own).symmetric_eigen();
    let some: Vec<usize> = (0..lost.ncols())
        .filter(|&i| eigen.eigenvalues[i] > IN_GAINS * IN_GAINS)
        .collect();
    lost * eigen.eigenvectors.select_columns(&some)
}
