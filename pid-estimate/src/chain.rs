//! Models some of whose variables are functions of others: the residual's exact derivatives by the chain rule.
//!
//! With inner variables `z_i = g_i(y)` for some i and `z_i = y_i` for the others,
//!
//! ```text
//! ∂r/∂y = ∂r/∂z ∂z/∂y        ∂²(λᵀr)/∂y² = (∂z/∂y)ᵀ ∂²(λᵀr)/∂z² ∂z/∂y + Σ_i λᵀ∂r/∂z_i ∂²g_i/∂y²
//! ```
//!
//! A [`Group`] is a set of inner variables that are functions of the same arguments.

use std::cell::RefCell;

use pid_runtime::dynamics::{At, Hessian, Pattern};

/// Inner variables that are functions of the same outer ones.
pub(crate) struct Group {
    /// Positions in the inner z.
    pub(crate) replaces: Vec<usize>,
    /// Positions in the outer z; arguments without a place are constants.
    pub(crate) arguments: Vec<Option<usize>>,
}

/// A factor of a contribution: 1, or an entry of the groups' gradients.
type Factor = Option<usize>;

/// Part of an entry: the inner entry it comes from, times two factors.
#[derive(Debug, Clone, Copy)]
struct Share {
    slot: usize,
    inner: usize,
    factors: [Factor; 2],
    twice: bool,
}

/// A pattern and what its entries are made of.
struct Entries {
    rows: Vec<u32>,
    cols: Vec<u32>,
    shares: Vec<Share>,
}

impl Entries {
    /// Merges contributions at (row, column) and further places into a sorted pattern.
    fn new(parts: Vec<((u32, u32), Share)>, more: &[(u32, u32)]) -> Self {
        let mut places: Vec<(u32, u32)> = parts
            .iter()
            .map(|p| p.0)
            .chain(more.iter().copied())
            .collect();
        places.sort_unstable();
        places.dedup();
        let mut entries = Self {
            rows: places.iter().map(|p| p.0).collect(),
            cols: places.iter().map(|p| p.1).collect(),
            shares: Vec::new(),
        };
        entries.shares = parts
            .into_iter()
            .map(|(place, share)| Share {
                slot: entries.slot(place),
                ..share
            })
            .collect();
        entries
    }

    fn slot(&self, place: (u32, u32)) -> usize {
        let first = self.rows.partition_point(|r| *r < place.0);
        let row = self.rows[first..].partition_point(|r| *r == place.0);
        first + self.cols[first..first + row].partition_point(|c| *c < place.1)
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.rows,
            cols: &self.cols,
        }
    }

    /// Adds the shares of inner values.
    fn add(&self, inner: &[f64], gradients: &[f64], values: &mut [f64]) {
        let factor = |f: Factor| f.map_or(1.0, |k| gradients[k]);
        for share in &self.shares {
            let product = factor(share.factors[0]) * factor(share.factors[1]);
            let one = inner[share.inner] * product;
            values[share.slot] += if share.twice { 2.0 * one } else { one };
        }
    }
}

/// The structure of a substitution.
pub(crate) struct Chain {
    jacobian: Entries,
    hessian: Entries,
    /// Replaced inner variables, group by group.
    replaced: Vec<usize>,
    /// Slot in the Hessian, and place in the groups' contracted second derivatives.
    curvature: Vec<(usize, usize)>,
}

impl Chain {
    /// Of a model; `direct` says where an inner variable that no group replaces stands in the outer z.
    pub(crate) fn new(
        inner: &dyn Hessian,
        groups: &[Group],
        direct: impl Fn(usize) -> usize,
    ) -> Self {
        let mut replaced = Vec::new();
        // Where a position of the inner z goes.
        let mut spread: Vec<Option<Vec<(u32, Factor)>>> = vec![None; inner.dims().nz()];
        let (mut gradient, mut second) = (0, 0);
        let mut places = Vec::new();
        for group in groups {
            let m = group.arguments.len();
            for &z in &group.replaces {
                let with_place = group.arguments.iter().enumerate();
                spread[z] = Some(
                    with_place
                        .filter_map(|(a, place)| Some(((*place)? as u32, Some(gradient + a))))
                        .collect(),
                );
                replaced.push(z);
                gradient += m;
            }
            for a in 0..m {
                for b in 0..=a {
                    if let (Some(x), Some(y)) = (group.arguments[a], group.arguments[b]) {
                        places.push(((x.max(y) as u32, x.min(y) as u32), second + a * m + b));
                    }
                }
            }
            second += m * m;
        }
        let spread = |z: u32| match &spread[z as usize] {
            Some(list) => list.clone(),
            None => vec![(direct(z as usize) as u32, None)],
        };
        let share = |inner, factors, twice| Share {
            slot: 0,
            inner,
            factors,
            twice,
        };
        let pattern = inner.jacobian_pattern();
        let mut parts = Vec::new();
        for (k, (&row, &col)) in pattern.rows.iter().zip(pattern.cols).enumerate() {
            for (place, factor) in spread(col) {
                parts.push(((row, place), share(k, [factor, None], false)));
            }
        }
        let jacobian = Entries::new(parts, &[]);
        let pattern = inner.hessian_pattern();
        let mut parts = Vec::new();
        for (k, (&row, &col)) in pattern.rows.iter().zip(pattern.cols).enumerate() {
            for (a, fa) in spread(row) {
                for (b, fb) in spread(col) {
                    if row == col && b > a {
                        continue;
                    }
                    let twice = row != col && a == b;
                    parts.push(((a.max(b), a.min(b)), share(k, [fa, fb], twice)));
                }
            }
        }
        let at: Vec<(u32, u32)> = places.iter().map(|p| p.0).collect();
        let hessian = Entries::new(parts, &at);
        let curvature = places
            .iter()
            .map(|&(place, from)| (hessian.slot(place), from))
            .collect();
        Self {
            jacobian,
            hessian,
            replaced,
            curvature,
        }
    }

    pub(crate) fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }

    pub(crate) fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
}

thread_local! {
    /// Inner values, gradients, contracted second derivatives, weights; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<[Vec<f64>; 4]> = const { RefCell::new([Vec::new(), Vec::new(), Vec::new(), Vec::new()]) };
}

/// A model with replaced variables. [`substituted`] makes a model of it.
pub(crate) trait Substituted {
    /// The model within.
    fn inner(&self) -> &dyn Hessian;
    /// The structure.
    fn chain(&self) -> &Chain;
    /// Calls with the inner variables in place of the outer ones.
    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R;
    /// Appends ∂g/∂(arguments) of every replaced variable, group by group, row by row.
    fn gradients(&self, at: &At<'_>, out: &mut Vec<f64>);
    /// Appends `Σ_i w_i ∂²g_i/∂(arguments)²` of every group, row by row; `weights` are of the replaced variables.
    fn curvatures(&self, at: &At<'_>, weights: &[f64], out: &mut Vec<f64>);

    /// Values of the outer Jacobian.
    fn outer_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let [mut own, mut gradients, second, weights] =
            SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        own.resize(self.inner().jacobian_pattern().nnz(), 0.0);
        gradients.clear();
        self.gradients(at, &mut gradients);
        self.within(at, |at| self.inner().residual_jacobian(at, r, &mut own));
        values.fill(0.0);
        self.chain().jacobian.add(&own, &gradients, values);
        SCRATCH.with(|s| *s.borrow_mut() = [own, gradients, second, weights]);
    }

    /// Values of the outer Hessian.
    fn outer_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let [mut own, mut gradients, mut second, mut weights] =
            SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        let inner = self.inner();
        let (first, count) = (inner.jacobian_pattern(), inner.hessian_pattern().nnz());
        own.resize(first.nnz().max(count), 0.0);
        gradients.clear();
        gradients.resize(inner.dims().nq, 0.0);
        self.within(at, |at| {
            inner.residual_jacobian(at, &mut gradients, &mut own[..first.nnz()]);
        });
        // What each replaced variable weighs in λᵀr.
        let mut per_variable = std::mem::take(&mut second);
        per_variable.clear();
        per_variable.resize(inner.dims().nz(), 0.0);
        for ((&row, &col), value) in first.rows.iter().zip(first.cols).zip(&own) {
            per_variable[col as usize] += lambda[row as usize] * value;
        }
        weights.clear();
        weights.extend(self.chain().replaced.iter().map(|&z| per_variable[z]));
        second = per_variable;
        self.within(at, |at| {
            inner.residual_hessian(at, lambda, &mut own[..count]);
        });
        gradients.clear();
        self.gradients(at, &mut gradients);
        second.clear();
        self.curvatures(at, &weights, &mut second);
        values.fill(0.0);
        self.chain().hessian.add(&own, &gradients, values);
        for &(slot, from) in &self.chain().curvature {
            values[slot] += second[from];
        }
        SCRATCH.with(|s| *s.borrow_mut() = [own, gradients, second, weights]);
    }
}

/// Implements `Dynamics` for a type with `within`, `inner`, and fields `dims`, `params` and `inputs`: everything else is the inner
/// model's, at the inner point.
macro_rules! within_dynamics {
    ($type:ident) => {
        impl pid_runtime::dynamics::Dynamics for $type<'_> {
            fn name(&self) -> &str {
                self.inner.name()
            }
            fn dims(&self) -> pid_runtime::dynamics::Dims {
                self.dims
            }
            fn params(&self) -> &[pid_runtime::dynamics::ParamInfo] {
                &self.params
            }
            fn joints(&self) -> &[pid_runtime::dynamics::JointInfo] {
                self.inner.joints()
            }
            fn inputs(&self) -> &[pid_runtime::dynamics::InputInfo] {
                &self.inputs
            }
            fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
                self.within(at, |at| self.inner.mass_matrix(at, m));
            }
            fn bias(&self, at: &At<'_>, b: &mut [f64]) {
                self.within(at, |at| self.inner.bias(at, b));
            }
            fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
                self.within(at, |at| self.inner.applied_force(at, f));
            }
            fn residual(&self, at: &At<'_>, r: &mut [f64]) {
                self.within(at, |at| self.inner.residual(at, r));
            }
            fn kinetic_energy(&self, at: &At<'_>) -> f64 {
                self.within(at, |at| self.inner.kinetic_energy(at))
            }
            fn potential_energy(&self, at: &At<'_>) -> f64 {
                self.within(at, |at| self.inner.potential_energy(at))
            }
        }
    };
}
pub(crate) use within_dynamics;

/// Implements the derivatives of a [`Substituted`] model.
macro_rules! substituted {
    ($type:ident) => {
        crate::chain::within_dynamics!($type);

        impl pid_runtime::dynamics::Jacobian for $type<'_> {
            fn jacobian_pattern(&self) -> pid_runtime::dynamics::Pattern<'_> {
                self.chain.jacobian_pattern()
            }
            fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
                self.outer_jacobian(at, r, values);
            }
        }

        impl pid_runtime::dynamics::Hessian for $type<'_> {
            fn hessian_pattern(&self) -> pid_runtime::dynamics::Pattern<'_> {
                self.chain.hessian_pattern()
            }
            fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
                self.outer_hessian(at, lambda, values);
            }
        }
    };
}
pub(crate) use substituted;

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use pid_runtime::dynamics::Dims;

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
    pub(crate) fn derivatives_hold_at(
        model: &dyn Hessian,
        z: &[f64],
        lambda: &[f64],
        skip: &[usize],
    ) {
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
    pub(crate) fn derivatives_hold(
        model: &dyn Hessian,
        lambda: &[f64],
        parameters: &[(usize, f64)],
    ) {
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
}
