//! Derivatives of a model against differences; used by tests of several crates.

use pid_runtime::dynamics::{At, Dims, Hessian};

/// Parts of a stacked point.
pub(crate) fn at<'a>(z: &'a [f64], d: &Dims) -> At<'a> {
    At {
        q: &z[..d.v()],
        v: &z[d.v()..d.a()],
        a: &z[d.a()..d.u()],
        u: &z[d.u()..d.p()],
        p: &z[d.p()..],
    }
}

/// Compares a model's derivatives with central differences at a point; not along the variables in `skip`.
pub(crate) fn derivatives_hold_at(model: &dyn Hessian, z: &[f64], lambda: &[f64], skip: &[usize]) {
    let d = model.dims();
    let dense = |z: &[f64]| {
        let pattern = model.jacobian_pattern();
        let (mut r, mut values) = (vec![0.0; d.nq], vec![f64::NAN; pattern.nnz()]);
        model.residual_jacobian(&at(z, &d), &mut r, &mut values);
        let mut full = vec![0.0; d.nq * d.nz()];
        for ((r, c), v) in pattern.rows.iter().zip(pattern.cols).zip(values) {
            full[*r as usize * d.nz() + *c as usize] += v;
        }
        (r, full)
    };
    let weighted = |full: &[f64]| -> Vec<f64> {
        (0..d.nz())
            .map(|c| (0..d.nq).map(|j| lambda[j] * full[j * d.nz() + c]).sum())
            .collect()
    };
    let (r, jacobian) = dense(z);
    let (mut plain, mut parts) = (vec![0.0; d.nq], vec![0.0; 2 * d.nq]);
    model.residual(&at(z, &d), &mut plain);
    assert_eq!(r, plain);
    // r = M a + b − f.
    let mut m = vec![0.0; d.nm()];
    model.mass_matrix(&at(z, &d), &mut m);
    let (b, f) = parts.split_at_mut(d.nq);
    model.bias(&at(z, &d), b);
    model.applied_force(&at(z, &d), f);
    for i in 0..d.nq {
        let inertia: f64 = (0..d.nq)
            .map(|j| {
                let (low, high) = (i.min(j), i.max(j));
                m[high * (high + 1) / 2 + low] * z[d.a() + j]
            })
            .sum();
        let sum = inertia + b[i] - f[i];
        assert!((sum - r[i]).abs() < 1e-9 * (1.0 + r[i].abs()), "r{i}");
    }
    let pattern = model.hessian_pattern();
    let mut values = vec![f64::NAN; pattern.nnz()];
    model.residual_hessian(&at(z, &d), lambda, &mut values);
    let mut hessian = vec![0.0; d.nz() * d.nz()];
    let mut last = (0, 0);
    for ((r, c), v) in pattern.rows.iter().zip(pattern.cols).zip(values) {
        assert!(*r >= *c && (*r, *c) >= last, "sorted lower triangle");
        last = (*r, *c);
        let (r, c) = (*r as usize, *c as usize);
        hessian[r * d.nz() + c] += v;
        if r != c {
            hessian[c * d.nz() + r] += v;
        }
    }
    for k in (0..d.nz()).filter(|k| !skip.contains(k)) {
        let h = 1e-6 * z[k].abs().max(0.1);
        let moved = |s: f64| {
            let mut y = z.to_vec();
            y[k] += s * h;
            y
        };
        let (up, down) = (dense(&moved(1.0)), dense(&moved(-1.0)));
        for j in 0..d.nq {
            let slope = (up.0[j] - down.0[j]) / (2.0 * h);
            let exact = jacobian[j * d.nz() + k];
            assert!(
                (slope - exact).abs() < 1e-6 * (1.0 + exact.abs()),
                "{} r{j} z{k}: {slope} {exact}",
                model.name()
            );
        }
        let (up, down) = (weighted(&up.1), weighted(&down.1));
        for m in (0..d.nz()).filter(|m| !skip.contains(m)) {
            let slope = (up[m] - down[m]) / (2.0 * h);
            let exact = hessian[m * d.nz() + k];
            assert!(
                (slope - exact).abs() < 1e-5 * (1.0 + exact.abs()),
                "{} z{m} z{k}: {slope} {exact}",
                model.name()
            );
        }
    }
}

/// A point without zeros; parameters near their nominal values, or as given.
#[allow(dead_code, reason = "not every test program has a random point")]
pub(crate) fn derivatives_hold(model: &dyn Hessian, lambda: &[f64], parameters: &[(usize, f64)]) {
    let d = model.dims();
    let mut z: Vec<f64> = (0..d.nz()).map(|k| (0.4 + 0.9 * k as f64).sin()).collect();
    for (k, info) in model.params().iter().enumerate() {
        z[d.p() + k] = info.nominal + 0.01 * (1.0 + (k % 7) as f64);
    }
    for &(k, value) in parameters {
        z[d.p() + k] = value;
    }
    derivatives_hold_at(model, &z, lambda, &[]);
}
