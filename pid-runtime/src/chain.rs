//! Models in which some variables are functions of others: exact derivatives of the residual by the
//! chain rule.
//!
//! With inner variables `z_i = g_i(y)` for some i and `z_i = y_i` for the others,
//!
//! ```text
//! ∂r/∂y = ∂r/∂z ∂z/∂y        ∂²(λᵀr)/∂y² = (∂z/∂y)ᵀ ∂²(λᵀr)/∂z² ∂z/∂y + Σ_i λᵀ∂r/∂z_i ∂²g_i/∂y²
//! ```
//!
//! A [`Group`] is a set of inner variables that are functions of the same arguments.

use std::cell::RefCell;

use crate::dynamics::{At, Hessian, Pattern};

/// Inner variables that are functions of the same outer ones.
pub struct Group {
    /// Positions in the inner z.
    pub replaces: Vec<usize>,
    /// Positions in the outer z; arguments without a position are constants.
    pub arguments: Vec<Option<usize>>,
}

/// A factor of a contribution: 1, or an entry of the groups' gradients.
type Factor = Option<usize>;

/// One part of an entry: an inner entry times two factors.
#[derive(Debug, Clone, Copy)]
struct Share {
    slot: usize,
    inner: usize,
    factors: [Factor; 2],
    twice: bool,
}

/// A pattern and the parts of its entries.
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
pub struct Chain {
    jacobian: Entries,
    hessian: Entries,
    /// Replaced inner variables, group by group.
    replaced: Vec<usize>,
    /// Slot in the Hessian, and place in the groups' contracted second derivatives.
    curvature: Vec<(usize, usize)>,
}

impl Chain {
    /// Of a model; `direct` says where an inner variable that no group replaces stands in the outer z.
    pub fn new(inner: &dyn Hessian, groups: &[Group], direct: impl Fn(usize) -> usize) -> Self {
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

    /// Structural non-zeros of ∂r/∂z of the outer model.
    pub fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }

    /// Structural non-zeros of ∂²(λᵀr)/∂z² of the outer model.
    pub fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
}

thread_local! {
    /// Inner values, gradients, contracted second derivatives, weights; kept so that evaluations do
    /// not allocate.
    static SCRATCH: RefCell<[Vec<f64>; 4]> = const { RefCell::new([Vec::new(), Vec::new(), Vec::new(), Vec::new()]) };
}

/// A model with replaced variables. `substituted` makes a model of it.
pub trait Substituted {
    /// The model within.
    fn inner(&self) -> &dyn Hessian;
    /// The structure.
    fn chain(&self) -> &Chain;
    /// Calls with the inner variables in place of the outer ones.
    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R;
    /// Appends ∂g/∂(arguments) of every replaced variable, group by group, row by row.
    fn gradients(&self, at: &At<'_>, out: &mut Vec<f64>);
    /// Appends `Σ_i w_i ∂²g_i/∂(arguments)²` of every group, row by row; `weights` are of the
    /// replaced variables.
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
        // Weight of each replaced variable in λᵀr.
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

/// Implements `Dynamics` for a type with `within`, `inner`, and fields `dims`, `params` and
/// `inputs`: everything else is the inner model's, at the inner point.
#[doc(hidden)]
#[macro_export]
macro_rules! within_dynamics {
    ($type:ident) => {
        impl $crate::dynamics::Dynamics for $type<'_> {
            fn name(&self) -> &str {
                self.inner.name()
            }
            fn dims(&self) -> $crate::dynamics::Dims {
                self.dims
            }
            fn params(&self) -> &[$crate::dynamics::ParamInfo] {
                &self.params
            }
            fn joints(&self) -> &[$crate::dynamics::JointInfo] {
                self.inner.joints()
            }
            fn inputs(&self) -> &[$crate::dynamics::InputInfo] {
                &self.inputs
            }
            fn mass_matrix(&self, at: &$crate::dynamics::At<'_>, m: &mut [f64]) {
                self.within(at, |at| self.inner.mass_matrix(at, m));
            }
            fn bias(&self, at: &$crate::dynamics::At<'_>, b: &mut [f64]) {
                self.within(at, |at| self.inner.bias(at, b));
            }
            fn applied_force(&self, at: &$crate::dynamics::At<'_>, f: &mut [f64]) {
                self.within(at, |at| self.inner.applied_force(at, f));
            }
            fn residual(&self, at: &$crate::dynamics::At<'_>, r: &mut [f64]) {
                self.within(at, |at| self.inner.residual(at, r));
            }
            fn kinetic_energy(&self, at: &$crate::dynamics::At<'_>) -> f64 {
                self.within(at, |at| self.inner.kinetic_energy(at))
            }
            fn potential_energy(&self, at: &$crate::dynamics::At<'_>) -> f64 {
                self.within(at, |at| self.inner.potential_energy(at))
            }
        }
    };
}

/// Implements the derivatives of a [`Substituted`] model.
#[doc(hidden)]
#[macro_export]
macro_rules! substituted {
    ($type:ident) => {
        $crate::within_dynamics!($type);

        impl $crate::dynamics::Jacobian for $type<'_> {
            fn jacobian_pattern(&self) -> $crate::dynamics::Pattern<'_> {
                self.chain.jacobian_pattern()
            }
            fn residual_jacobian(
                &self,
                at: &$crate::dynamics::At<'_>,
                r: &mut [f64],
                values: &mut [f64],
            ) {
                self.outer_jacobian(at, r, values);
            }
        }

        impl $crate::dynamics::Hessian for $type<'_> {
            fn hessian_pattern(&self) -> $crate::dynamics::Pattern<'_> {
                self.chain.hessian_pattern()
            }
            fn residual_hessian(
                &self,
                at: &$crate::dynamics::At<'_>,
                lambda: &[f64],
                values: &mut [f64],
            ) {
                self.outer_hessian(at, lambda, values);
            }
        }
    };
}
