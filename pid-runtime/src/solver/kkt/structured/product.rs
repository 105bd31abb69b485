//! The product with the KKT matrix, step by step: one pattern of a step serves all of them, so that refinement reads values and
//! no indices of the whole matrix.

use super::super::layout::Layout;

/// `rx += H dx + Jᵀ dλ`, `rc += J dx` for values in the order of the layout's patterns.
pub(super) fn add(
    layout: &Layout,
    (hessian, jacobian): (&[f64], &[f64]),
    (dx, dlambda): (&[f64], &[f64]),
    (rx, rc): (&mut [f64], &mut [f64]),
) {
    let (nx, ny, np, p) = (layout.nx, layout.ny, layout.np, layout.p());
    let (nj, nh) = (layout.step_jacobian.len(), layout.step_hessian.len());
    // x_k and y_k stand side by side: a step's variables are one run of them, then the parameters.
    let own = nx + ny;
    let mut x = vec![0.0; own + np];
    let mut r = vec![0.0; own + np];
    x[own..].copy_from_slice(&dx[p..p + np]);
    for window in &layout.windows {
        for k in 0..window.steps {
            let (at, row) = (layout.state(window, k), window.row + k * ny);
            let step = window.first_step + k;
            x[..own].copy_from_slice(&dx[at..at + own]);
            r[..own].copy_from_slice(&rx[at..at + own]);
            let values = &hessian[step * nh..(step + 1) * nh];
            for (&(i, j), a) in layout.step_hessian.iter().zip(values) {
                let (i, j) = (i as usize, j as usize);
                r[i] += a * x[j];
                if i != j {
                    r[j] += a * x[i];
                }
            }
            let (lambda, c) = (&dlambda[row..row + ny], &mut rc[row..row + ny]);
            let values = &jacobian[step * nj..(step + 1) * nj];
            for (&(i, j), a) in layout.step_jacobian.iter().zip(values) {
                let (i, j) = (i as usize, j as usize);
                c[i] += a * x[j];
                r[j] += a * lambda[i];
            }
            rx[at..at + own].copy_from_slice(&r[..own]);
        }
    }
    for (to, from) in rx[p..p + np].iter_mut().zip(&r[own..]) {
        *to += from;
    }
    let mut diagonal = hessian[layout.node_values()..].chunks_exact(nx);
    for window in &layout.windows {
        for (k, values) in (0..=window.steps).zip(&mut diagonal) {
            let at = layout.state(window, k);
            for i in 0..nx {
                rx[at + i] += values[i] * dx[at + i];
            }
        }
    }
    let values = &hessian[layout.parameter_values()..];
    for (&(i, j), a) in layout.parameter_hessian.iter().zip(values) {
        let (i, j) = (i as usize, j as usize);
        rx[p + i] += a * dx[p + j];
        if i != j {
            rx[p + j] += a * dx[p + i];
        }
    }
}
