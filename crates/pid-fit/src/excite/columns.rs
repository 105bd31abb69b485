//! Chooses the parameters that a motion can determine, and the scale of their columns.

use super::error::ExciteError;
use super::limits::Limits;
use nalgebra::DMatrix;
use pid_runtime::dynamics::{At, Hessian};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random poses at which columns are compared.
const POSES: usize = 60;
/// Poses at which the force is checked to be a polynomial.
const SLOWED: usize = 12;
/// A column depends on the chosen ones if less than this share of it remains beside them.
const DEPENDENT: f64 = 1e-7;

/// Why a parameter has no column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Without {
    /// Held by the declaration.
    Fixed,
    /// Its effect depends on the inputs, which are known only after the motion.
    NeedsInput,
    /// The force is no polynomial of it (the sharpness of a `tanh`).
    NotPolynomial,
    /// It does not enter the motion, or only in combination with chosen ones.
    Dependent,
}

/// The chosen parameters: independent at the given values.
#[derive(Debug, Clone)]
pub(super) struct Columns {
    /// Positions in p.
    pub(super) params: Vec<usize>,
    /// One over the root mean square of each column over random poses.
    pub(super) scale: Vec<f64>,
    /// The others.
    pub(super) without: Vec<(usize, Without)>,
}

/// A pose within the limits: q, v, a.
fn pose(limits: &Limits<'_>, rng: &mut ChaCha8Rng, z: &mut [f64]) {
    let nq = limits.v.len();
    for j in 0..nq {
        let (low, high) = limits.range(j);
        z[j] = rng.random_range(low..=high);
        z[nq + j] = limits.v[j] * rng.random_range(-1.0..=1.0);
        z[2 * nq + j] = limits.a[j] * rng.random_range(-1.0..=1.0);
    }
}

/// Whether the force is a polynomial of at most the fourth degree in one parameter: fifth differences vanish.
fn polynomial(model: &dyn Hessian, p: &[f64], k: usize, z: &[f64], u: &[f64]) -> bool {
    const BINOMIAL: [f64; 6] = [-1.0, 5.0, -10.0, 10.0, -5.0, 1.0];
    let nq = model.dims().nq;
    let (mut r, mut sum, mut size) = (vec![0.0; nq], vec![0.0; nq], 0.0_f64);
    let mut shifted = p.to_vec();
    let step = 0.2 * p[k].abs().max(0.1);
    for (i, c) in BINOMIAL.iter().enumerate() {
        shifted[k] = p[k] + step * i as f64;
        let (q, v, a) = (&z[..nq], &z[nq..2 * nq], &z[2 * nq..]);
        let p = &shifted;
        model.residual(&At { q, v, a, u, p }, &mut r);
        for (sum, r) in sum.iter_mut().zip(&r) {
            *sum += c * r;
            size = size.max(r.abs());
        }
    }
    sum.iter().all(|s| s.abs() <= 1e-10 * size.max(1e-12))
}

/// Why parameters cannot be columns before any pose is seen: they are fixed, or act with the input.
fn barred(model: &dyn Hessian) -> Vec<Option<Without>> {
    let dims = model.dims();
    let mut why: Vec<Option<Without>> = model
        .params()
        .iter()
        .map(|info| info.fixed.then_some(Without::Fixed))
        .collect();
    let pattern = model.hessian_pattern();
    for (row, col) in pattern.rows.iter().zip(pattern.cols) {
        let (row, col) = (*row as usize, *col as usize);
        if row >= dims.p() && (dims.u()..dims.p()).contains(&col) {
            why[row - dims.p()].get_or_insert(Without::NeedsInput);
        }
    }
    why
}

/// Columns of `open` that are independent, in the order of a pivoted Gram-Schmidt process.
fn independent(mut rest: DMatrix<f64>, mut open: Vec<usize>) -> Vec<usize> {
    for k in &open {
        let scale = 1.0 / rest.column(*k).norm();
        rest.column_mut(*k).scale_mut(scale);
    }
    let mut params = Vec::new();
    while let Some((at, _)) = open
        .iter()
        .map(|k| rest.column(*k).norm())
        .enumerate()
        .filter(|(_, norm)| *norm > DEPENDENT)
        .max_by(|a, b| a.1.total_cmp(&b.1))
    {
        let k = open.swap_remove(at);
        params.push(k);
        let direction = rest.column(k).normalize();
        for other in &open {
            // Orthogonalise twice: near dependence the rounding of the first pass matters.
            for _ in 0..2 {
                let along = rest.column(*other).dot(&direction);
                rest.column_mut(*other).axpy(-along, &direction, 1.0);
            }
        }
    }
    params
}

/// Chooses columns by a pivoted Gram-Schmidt process over random poses.
pub(super) fn choose(
    model: &dyn Hessian,
    p: &[f64],
    limits: &Limits<'_>,
    deviations: &[f64],
    seed: u64,
) -> Result<Columns, ExciteError> {
    let dims = model.dims();
    let nq = dims.nq;
    let u = vec![0.0; dims.nu];
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut why = barred(model);
    let jacobian = model.jacobian_pattern();
    let (mut z, mut r) = (vec![0.0; 3 * nq], vec![0.0; nq]);
    let mut values = vec![0.0; jacobian.nnz()];
    let mut columns = DMatrix::<f64>::zeros(POSES * nq, dims.np);
    for i in 0..POSES {
        pose(limits, &mut rng, &mut z);
        let at = At {
            q: &z[..nq],
            v: &z[nq..2 * nq],
            a: &z[2 * nq..],
            u: &u,
            p,
        };
        model.residual_jacobian(&at, &mut r, &mut values);
        for ((row, col), value) in jacobian.rows.iter().zip(jacobian.cols).zip(&values) {
            if let Some(k) = (*col as usize).checked_sub(dims.p()) {
                columns[(i * nq + *row as usize, k)] = value / deviations[*row as usize];
            }
        }
        if i < SLOWED {
            // Slow motion too, since saturating friction shows only there.
            let slower = 10f64.powi(-((i % 4) as i32));
            z[nq..2 * nq].iter_mut().for_each(|v| *v *= slower);
            for k in 0..dims.np {
                if why[k].is_none() && !polynomial(model, p, k, &z, &u) {
                    why[k] = Some(Without::NotPolynomial);
                }
            }
        }
    }
    let rms: Vec<f64> = columns
        .column_iter()
        .map(|c| c.norm() / (POSES as f64).sqrt())
        .collect();
    if let Some(k) = rms.iter().position(|r| !r.is_finite()) {
        return Err(ExciteError::NotFinite {
            param: model.params()[k].name.to_string(),
        });
    }
    let open: Vec<usize> = (0..dims.np)
        .filter(|k| why[*k].is_none() && rms[*k] > 0.0)
        .collect();
    let mut params = independent(columns, open);
    if params.is_empty() {
        return Err(ExciteError::NothingToDetermine);
    }
    params.sort_unstable();
    let without = (0..dims.np)
        .filter(|k| params.binary_search(k).is_err())
        .map(|k| (k, why[k].unwrap_or(Without::Dependent)))
        .collect();
    Ok(Columns {
        scale: params.iter().map(|k| 1.0 / rms[*k]).collect(),
        params,
        without,
    })
}
