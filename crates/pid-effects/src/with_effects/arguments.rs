//! Arguments of a change of the residual: where they stand among the variables z of a model.

use pid_runtime::dynamics::{At, Dims};

use crate::scalar::Scalar;
use crate::smooth::Smooth;

/// Arguments at a point, each from its place in z = (q, v, a, u, p), zero without one; accelerations
/// are zero where none are given.
pub(super) fn arguments<const MOST: usize>(
    places: &[Option<usize>],
    at: &At<'_>,
    d: &Dims,
) -> [Smooth; MOST] {
    let mut x = [Smooth::constant(0.0); MOST];
    for (x, place) in x.iter_mut().zip(places) {
        let Some(z) = *place else { continue };
        let value = if z < d.v() {
            at.q[z]
        } else if z < d.a() {
            at.v[z - d.v()]
        } else if z < d.u() {
            at.a.get(z - d.a()).copied().unwrap_or(0.0)
        } else if z < d.p() {
            at.u[z - d.u()]
        } else {
            at.p[z - d.p()]
        };
        *x = Smooth::constant(value);
    }
    x
}

/// Where a variable z of a model stands once further coordinates, each with an input, follow its own:
/// `before` are its sizes, `after` those with them. The order of variables stays.
pub(super) fn widened(before: &Dims, after: &Dims, z: usize) -> usize {
    if z < before.v() {
        z
    } else if z < before.a() {
        after.v() + z - before.v()
    } else if z < before.u() {
        after.a() + z - before.a()
    } else if z < before.u() + before.nq {
        after.u() + z - before.u()
    } else if z < before.p() {
        after.u() + after.nq - before.nq + z - before.u()
    } else {
        after.p() + z - before.p()
    }
}

/// Calls with the point of a model to whose coordinates others were added, as [`widened`] says; `change`
/// changes its inputs, which are put into `u`.
pub(super) fn narrowed<R>(
    (before, after): (&Dims, &Dims),
    at: &At<'_>,
    u: &mut Vec<f64>,
    change: impl FnOnce(&mut [f64]),
    work: impl FnOnce(&At<'_>) -> R,
) -> R {
    let states = after.nq - before.nq;
    u.clear();
    u.extend_from_slice(&at.u[..before.nq]);
    u.extend_from_slice(&at.u[before.nq + states..before.nu + states]);
    change(u);
    work(&At {
        q: &at.q[..before.nq],
        v: &at.v[..before.nq],
        a: at.a.get(..before.nq).unwrap_or(&[]),
        u,
        p: &at.p[..before.np],
    })
}

/// Rows and columns of the derivatives of some rows by the active arguments, row by row.
pub(super) fn jacobian_places(
    places: &[Option<usize>],
    rows: &[usize],
    active: &[usize],
) -> Vec<(u32, u32)> {
    let column = |a: usize| places[a].unwrap_or(0) as u32;
    let entries = rows
        .iter()
        .flat_map(|&row| active.iter().map(move |&a| (row as u32, column(a))));
    entries.collect()
}

/// Places of the second derivatives by the active arguments, the lower triangle.
pub(super) fn hessian_places(places: &[Option<usize>], active: &[usize]) -> Vec<(u32, u32)> {
    let place = |a: usize| places[a].unwrap_or(0) as u32;
    let mut out = Vec::new();
    for (i, &a) in active.iter().enumerate() {
        for &b in &active[..=i] {
            let (x, y) = (place(a), place(b));
            out.push((x.max(y), x.min(y)));
        }
    }
    out
}
