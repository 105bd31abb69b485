//! A controller within the model: the commanded position becomes the input, and the loop is simulated.
//!
//! ```text
//! u_j = e_j sat(P_j (q_ref,j − q_j) − D_j v_j; L_j) + (1 − e_j) k_j v_j
//! ```
//!
//! P, D: gains; L: limit of the drive, in the unit of the model's own input; e: 1 while the drive is on. A drive that is off
//! passes no current: with a voltage as input the terminals are open, and `k` is the motor's constant (the parameter
//! `gain_JOINT`), so that the voltage equals the back-EMF; with any other input `k` is 0. The saturation is smooth,
//! `sat(x; L) = (√((x + L)² + δ²) − √((x − L)² + δ²))/2` with δ = 0.02 L.
//!
//! All constants of the law are inputs too, in the order q_ref, P, D, L, e (each one per joint): they differ between records.

use std::borrow::Cow;
use std::cell::RefCell;

use num_dual::{DualNum, HyperDual64};
use pid_runtime::data::{Dataset, Experiment, InputQuantity};
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};
use serde::Deserialize;

/// Rounding of the saturation, as a share of the limit.
const ROUND: f64 = 0.02;
/// Arguments of the law: q, v, q_ref, P, D, L, e, k.
const ARGUMENTS: usize = 8;
/// Inputs of the law per joint: q_ref, P, D, L, e.
const INPUTS: usize = 5;
/// A limit that is never met, in place of none: derivatives stay finite.
const UNLIMITED: f64 = 1e12;

fn law<D: DualNum<Primitive = f64> + Copy>(x: [D; ARGUMENTS]) -> D {
    let [q, v, reference, p, d, limit, on, k] = x;
    let wanted = p * (reference - q) - d * v;
    let driven = if limit.re() >= UNLIMITED {
        wanted
    } else {
        let round = limit * ROUND;
        let (above, below) = (wanted + limit, wanted - limit);
        ((above * above + round * round).sqrt() - (below * below + round * round).sqrt()) * 0.5
    };
    on * driven + (D::from(1.0) - on) * k * v
}

/// Gradient and Hessian of the law.
struct Law {
    gradient: [f64; ARGUMENTS],
    hessian: [[f64; ARGUMENTS]; ARGUMENTS],
}

fn differentiate(x: [f64; ARGUMENTS], second: bool) -> Law {
    let mut out = Law {
        gradient: [0.0; ARGUMENTS],
        hessian: [[0.0; ARGUMENTS]; ARGUMENTS],
    };
    let mut seeded = x.map(HyperDual64::from_re);
    for i in 0..ARGUMENTS {
        seeded[i].eps1 = 1.0;
        let first = if second { 0 } else { i };
        for j in first..=i {
            seeded[j].eps2 = 1.0;
            let f = law(seeded);
            seeded[j].eps2 = 0.0;
            out.gradient[i] = f.eps1;
            out.hessian[i][j] = f.eps1eps2;
            out.hessian[j][i] = f.eps1eps2;
        }
        seeded[i].eps1 = 0.0;
    }
    out
}

/// A factor of a contribution: 1, or ∂u_j/∂(argument).
type Factor = Option<(usize, usize)>;

/// Part of an entry: the inner entry it comes from, times two factors.
#[derive(Debug, Clone, Copy)]
struct Share {
    slot: usize,
    inner: usize,
    factors: [Factor; 2],
    twice: bool,
}

struct Entries {
    rows: Vec<u32>,
    cols: Vec<u32>,
    shares: Vec<Share>,
}

impl Entries {
    /// Merges contributions at (row, column) into a sorted pattern.
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
}

thread_local! {
    /// Inner inputs and inner derivative values; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<(Vec<f64>, Vec<f64>, Vec<f64>)> = const { RefCell::new((Vec::new(), Vec::new(), Vec::new())) };
}

/// A model with its controller; parameters are those of the model.
pub struct ClosedLoop<'m> {
    inner: Box<dyn Hessian + 'm>,
    dims: Dims,
    inputs: Vec<InputInfo>,
    /// Position of the back-EMF constant of each joint.
    constants: Vec<Option<usize>>,
    jacobian: Entries,
    hessian: Entries,
    /// Slot in the Hessian of ∂²u_j/∂(a, b), b ≤ a, j after j; arguments without a place have none.
    curvature: Vec<(usize, usize, usize, usize)>,
}

/// A controller that does not fit the model or the records.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// The model's inputs are not one per joint.
    #[error(
        "`{model}` has {inputs} inputs for {joints} joints; a controller needs one per joint, in order"
    )]
    Inputs {
        /// The model.
        model: String,
        /// Its inputs.
        inputs: usize,
        /// Its joints.
        joints: usize,
    },
    /// Not TOML of this format.
    #[error("{file}: {message}\n  help: docs/controller-format.md describes the keys")]
    Toml {
        /// The file.
        file: String,
        /// What the parser says, with line and column.
        message: String,
    },
    /// Numbers for more or fewer joints than there are.
    #[error("{file}: record `{record}`: {key} has {found} values, the model has {joints} joints")]
    Length {
        /// The file.
        file: String,
        /// Pattern of the record.
        record: String,
        /// The key.
        key: &'static str,
        /// Values given.
        found: usize,
        /// Joints.
        joints: usize,
    },
    /// A record that no entry names.
    #[error(
        "{file}: no [[record]] matches the record `{record}`\n  help: add one; `name = \"*\"` matches every record"
    )]
    NoEntry {
        /// The file.
        file: String,
        /// The record.
        record: String,
    },
    /// A record without commanded positions.
    #[error(
        "record `{record}` has no commanded positions (columns qref1 …), which its controller would follow\n  help: say `off = true` for it in the controller's file, or leave it out"
    )]
    NoReference {
        /// The record.
        record: String,
    },
    /// A number that cannot be meant.
    #[error("{file}: record `{record}`: {key} = {value}: {demand}")]
    Value {
        /// The file.
        file: String,
        /// Pattern of the record.
        record: String,
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
        /// What is needed.
        demand: &'static str,
    },
}

impl<'m> ClosedLoop<'m> {
    /// Puts the controller around a model.
    ///
    /// # Errors
    /// [`ControlError::Inputs`] unless there is one input per joint, in order.
    pub fn new(inner: Box<dyn Hessian + 'm>) -> Result<Self, ControlError> {
        let own = inner.dims();
        let nq = own.nq;
        let in_order = inner
            .inputs()
            .iter()
            .enumerate()
            .all(|(j, i)| i.joint == Some(j));
        if own.nu != nq || !in_order {
            return Err(ControlError::Inputs {
                model: inner.name().to_owned(),
                inputs: own.nu,
                joints: nq,
            });
        }
        let dims = Dims {
            nu: INPUTS * nq,
            ..own
        };
        let mut inputs = Vec::with_capacity(dims.nu);
        for kind in 0..INPUTS {
            for (info, input) in inner.joints().iter().zip(inner.inputs()) {
                let length = info.unit();
                let (word, unit) = match kind {
                    0 => ("reference", length.to_owned()),
                    1 => ("p", format!("{}/{length}", input.unit)),
                    2 => ("d", format!("{}*s/{length}", input.unit)),
                    3 => ("limit", input.unit.to_string()),
                    _ => ("on", "1".to_owned()),
                };
                inputs.push(InputInfo {
                    name: Cow::Owned(format!("{word}_{}", info.name)),
                    unit: Cow::Owned(unit),
                    joint: (kind == 0).then_some(inputs.len()),
                });
            }
        }
        let constants: Vec<Option<usize>> = (0..nq)
            .map(|j| {
                let name = format!("gain_{}", inner.joints()[j].name);
                let voltage = inner.inputs()[j].unit == "V";
                inner
                    .params()
                    .iter()
                    .position(|p| voltage && p.name == name)
            })
            .collect();
        let place = |j: usize, argument: usize| -> Option<usize> {
            match argument {
                0 => Some(j),
                1 => Some(dims.v() + j),
                7 => constants[j].map(|k| dims.p() + k),
                a => Some(dims.u() + (a - 2) * nq + j),
            }
        };
        // Where a position of the inner z goes.
        let spread = |z: usize| -> Vec<(u32, Factor)> {
            if z < own.u() {
                vec![(z as u32, None)]
            } else if z >= own.p() {
                vec![((dims.p() + z - own.p()) as u32, None)]
            } else {
                let j = z - own.u();
                (0..ARGUMENTS)
                    .filter_map(|a| Some((place(j, a)? as u32, Some((j, a)))))
                    .collect()
            }
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
            for (place, factor) in spread(col as usize) {
                parts.push(((row, place), share(k, [factor, None], false)));
            }
        }
        let jacobian = Entries::new(parts, &[]);
        let pattern = inner.hessian_pattern();
        let mut parts = Vec::new();
        for (k, (&row, &col)) in pattern.rows.iter().zip(pattern.cols).enumerate() {
            for (a, fa) in spread(row as usize) {
                for (b, fb) in spread(col as usize) {
                    if row == col && b > a {
                        continue;
                    }
                    let twice = row != col && a == b;
                    parts.push(((a.max(b), a.min(b)), share(k, [fa, fb], twice)));
                }
            }
        }
        let mut seconds = Vec::new();
        for j in 0..nq {
            for a in 0..ARGUMENTS {
                for b in 0..=a {
                    if let (Some(x), Some(y)) = (place(j, a), place(j, b)) {
                        seconds.push(((x.max(y) as u32, x.min(y) as u32), (j, a, b)));
                    }
                }
            }
        }
        let places: Vec<(u32, u32)> = seconds.iter().map(|s| s.0).collect();
        let hessian = Entries::new(parts, &places);
        let curvature = seconds
            .iter()
            .map(|&(place, (j, a, b))| (hessian.slot(place), j, a, b))
            .collect();
        Ok(Self {
            inner,
            dims,
            inputs,
            constants,
            jacobian,
            hessian,
            curvature,
        })
    }

    fn arguments(&self, at: &At<'_>, j: usize) -> [f64; ARGUMENTS] {
        let nq = self.dims.nq;
        let input = |kind: usize| at.u[kind * nq + j];
        [
            at.q[j],
            at.v[j],
            input(0),
            input(1),
            input(2),
            input(3),
            input(4),
            self.constants[j].map_or(0.0, |k| at.p[k]),
        ]
    }

    /// Calls with the inner inputs in place of the outer ones.
    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R {
        let mut u = SCRATCH.with(|s| std::mem::take(&mut s.borrow_mut().0));
        u.clear();
        u.extend((0..self.dims.nq).map(|j| law(self.arguments(at, j))));
        let out = work(&At { u: &u, ..*at });
        SCRATCH.with(|s| s.borrow_mut().0 = u);
        out
    }
}

impl Dynamics for ClosedLoop<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }
    fn dims(&self) -> Dims {
        self.dims
    }
    fn params(&self) -> &[ParamInfo] {
        self.inner.params()
    }
    fn joints(&self) -> &[JointInfo] {
        self.inner.joints()
    }
    fn inputs(&self) -> &[InputInfo] {
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

/// Product of a share's factors, from the laws' gradients (`ARGUMENTS` values a joint).
fn product(share: &Share, gradients: &[f64]) -> f64 {
    let factor = |f: Factor| f.map_or(1.0, |(j, a)| gradients[j * ARGUMENTS + a]);
    let one = factor(share.factors[0]) * factor(share.factors[1]);
    if share.twice { 2.0 * one } else { one }
}

impl Jacobian for ClosedLoop<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let (mut own, mut gradients) = SCRATCH.with(|s| {
            let mut s = s.borrow_mut();
            (std::mem::take(&mut s.1), std::mem::take(&mut s.2))
        });
        own.resize(self.inner.jacobian_pattern().nnz(), 0.0);
        gradients.clear();
        for j in 0..self.dims.nq {
            gradients.extend(differentiate(self.arguments(at, j), false).gradient);
        }
        self.within(at, |at| self.inner.residual_jacobian(at, r, &mut own));
        values.fill(0.0);
        for share in &self.jacobian.shares {
            values[share.slot] += own[share.inner] * product(share, &gradients);
        }
        SCRATCH.with(|s| {
            let mut s = s.borrow_mut();
            (s.1, s.2) = (own, gradients);
        });
    }
}

impl Hessian for ClosedLoop<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let (mut own, mut gradients) = SCRATCH.with(|s| {
            let mut s = s.borrow_mut();
            (std::mem::take(&mut s.1), std::mem::take(&mut s.2))
        });
        let nq = self.dims.nq;
        let first = self.inner.jacobian_pattern();
        own.resize(
            first.nnz().max(self.inner.hessian_pattern().nnz()) + nq,
            0.0,
        );
        // Residual, then what each input weighs in λᵀr, then the laws' gradients.
        gradients.clear();
        gradients.resize(2 * nq, 0.0);
        let (r, weights) = gradients.split_at_mut(nq);
        let entries = &mut own[..first.nnz()];
        self.within(at, |at| self.inner.residual_jacobian(at, r, entries));
        let inputs = self.inner.dims().u()..self.inner.dims().p();
        for ((&row, &col), value) in first.rows.iter().zip(first.cols).zip(&*entries) {
            if inputs.contains(&(col as usize)) {
                weights[col as usize - inputs.start] += lambda[row as usize] * value;
            }
        }
        let count = self.inner.hessian_pattern().nnz();
        self.within(at, |at| {
            self.inner.residual_hessian(at, lambda, &mut own[..count]);
        });
        values.fill(0.0);
        let mut curvature = self.curvature.iter().peekable();
        for j in 0..nq {
            let law = differentiate(self.arguments(at, j), true);
            while let Some(&(slot, _, a, b)) = curvature.next_if(|c| c.1 == j) {
                values[slot] += gradients[nq + j] * law.hessian[a][b];
            }
            gradients.extend(law.gradient);
        }
        for share in &self.hessian.shares {
            values[share.slot] += own[share.inner] * product(share, &gradients[2 * nq..]);
        }
        SCRATCH.with(|s| {
            let mut s = s.borrow_mut();
            (s.1, s.2) = (own, gradients);
        });
    }
}

/// Controllers of the records of a data set (`docs/controller-format.md`).
#[derive(Debug, Clone, PartialEq)]
pub struct Controllers {
    file: String,
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    #[serde(default)]
    p: Vec<f64>,
    #[serde(default)]
    d: Vec<f64>,
    #[serde(default)]
    limit: Vec<f64>,
    #[serde(default)]
    off: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    record: Vec<Entry>,
}

impl Controllers {
    /// Reads a text; `file` is its name in messages.
    ///
    /// # Errors
    /// [`ControlError`].
    pub fn parse(file: &str, text: &str, joints: usize) -> Result<Self, ControlError> {
        let read: File = toml::from_str(text).map_err(|e| ControlError::Toml {
            file: file.to_owned(),
            message: e.to_string().trim_end().to_owned(),
        })?;
        for entry in &read.record {
            let lists = [("p", &entry.p), ("d", &entry.d), ("limit", &entry.limit)];
            for (key, list) in lists {
                let needed = key == "p" && !entry.off;
                if list.len() != joints && (needed || !list.is_empty()) {
                    return Err(ControlError::Length {
                        file: file.to_owned(),
                        record: entry.name.clone(),
                        key,
                        found: list.len(),
                        joints,
                    });
                }
                let bad = |x: &&f64| !x.is_finite() || key == "limit" && **x <= 0.0;
                if let Some(value) = list.iter().find(bad) {
                    return Err(ControlError::Value {
                        file: file.to_owned(),
                        record: entry.name.clone(),
                        key,
                        value: *value,
                        demand: "a finite number, for a limit above zero, is needed",
                    });
                }
            }
        }
        Ok(Self {
            file: file.to_owned(),
            entries: read.record,
        })
    }

    /// The records with the controllers' inputs in place of the recorded ones.
    ///
    /// # Errors
    /// [`ControlError::NoEntry`], [`ControlError::NoReference`].
    pub fn close(&self, mut dataset: Dataset) -> Result<Dataset, ControlError> {
        let nq = dataset.nq();
        for experiment in &mut dataset.experiments {
            let entry = self
                .entries
                .iter()
                .find(|e| matches(&e.name, &experiment.name))
                .ok_or_else(|| ControlError::NoEntry {
                    file: self.file.clone(),
                    record: experiment.name.clone(),
                })?;
            experiment.u = inputs(entry, experiment, nq)?;
        }
        for joint in &mut dataset.joints {
            joint.input = InputQuantity::Position;
            joint.input_unit = joint.unit().to_owned();
        }
        Ok(dataset)
    }
}

fn inputs(entry: &Entry, experiment: &Experiment, nq: usize) -> Result<Vec<f64>, ControlError> {
    if !entry.off && experiment.qref.is_none() {
        return Err(ControlError::NoReference {
            record: experiment.name.clone(),
        });
    }
    let constant = |list: &[f64], j: usize, absent: f64| list.get(j).copied().unwrap_or(absent);
    let mut u = Vec::with_capacity(experiment.len() * nq * INPUTS);
    for k in 0..experiment.len() {
        match (&experiment.qref, entry.off) {
            (Some(qref), false) => u.extend_from_slice(&qref[k * nq..(k + 1) * nq]),
            _ => u.extend(std::iter::repeat_n(0.0, nq)),
        }
        u.extend((0..nq).map(|j| constant(&entry.p, j, 0.0)));
        u.extend((0..nq).map(|j| constant(&entry.d, j, 0.0)));
        u.extend((0..nq).map(|j| constant(&entry.limit, j, UNLIMITED)));
        u.extend(std::iter::repeat_n(f64::from(u8::from(!entry.off)), nq));
    }
    Ok(u)
}

/// Whether a name fits a pattern in which `*` stands for any characters.
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, rest)) => name.strip_prefix(head).is_some_and(|tail| {
            (0..=tail.len())
                .filter(|&k| tail.is_char_boundary(k))
                .any(|k| matches(rest, &tail[k..]))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::extend::Extended;
    use pid_models::{DoublePendulum, ServoPendulum};

    fn closed<'m>(model: &'m dyn Hessian, terms: &[&str]) -> ClosedLoop<'m> {
        let terms: Vec<_> = terms.iter().map(|t| t.parse().expect("a term")).collect();
        let model = Extended::new(model, &terms).expect("fits");
        ClosedLoop::new(Box::new(model)).expect("one input per joint")
    }

    fn at<'a>(z: &'a [f64], d: &Dims) -> At<'a> {
        At {
            q: &z[..d.v()],
            v: &z[d.v()..d.a()],
            a: &z[d.a()..d.u()],
            u: &z[d.u()..d.p()],
            p: &z[d.p()..],
        }
    }

    /// A point of every regime: linear, saturated, off.
    fn point(model: &ClosedLoop<'_>, regime: usize) -> Vec<f64> {
        let (d, nq) = (model.dims(), model.dims().nq);
        let mut z: Vec<f64> = (0..d.nz()).map(|k| (0.7 + 1.3 * k as f64).sin()).collect();
        for j in 0..nq {
            let u = &mut z[d.u()..d.p()];
            u[nq + j] = [2.0, 30.0, 2.0][regime];
            u[2 * nq + j] = 0.3;
            u[3 * nq + j] = 3.0;
            u[4 * nq + j] = [1.0, 1.0, 0.25][regime];
        }
        for (k, info) in model.params().iter().enumerate() {
            z[d.p() + k] = if info.nominal == 0.0 {
                0.02
            } else {
                info.nominal
            };
        }
        z
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        for model in [
            closed(&ServoPendulum, &["stribeck", "load"]),
            closed(&DoublePendulum, &["load"]),
        ] {
            let d = model.dims();
            for regime in 0..3 {
                let z = point(&model, regime);
                let lambda: Vec<f64> = (0..d.nq).map(|j| 0.8 - 0.5 * j as f64).collect();
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
                let weighted = |z: &[f64]| -> Vec<f64> {
                    let (_, full) = dense(z);
                    (0..d.nz())
                        .map(|c| (0..d.nq).map(|j| lambda[j] * full[j * d.nz() + c]).sum())
                        .collect()
                };
                let (r, jacobian) = dense(&z);
                let mut plain = vec![0.0; d.nq];
                model.residual(&at(&z, &d), &mut plain);
                assert_eq!(r, plain);
                let pattern = model.hessian_pattern();
                let mut values = vec![f64::NAN; pattern.nnz()];
                model.residual_hessian(&at(&z, &d), &lambda, &mut values);
                let mut hessian = vec![0.0; d.nz() * d.nz()];
                for ((r, c), v) in pattern.rows.iter().zip(pattern.cols).zip(values) {
                    let (r, c) = (*r as usize, *c as usize);
                    assert!(r >= c);
                    hessian[r * d.nz() + c] += v;
                    if r != c {
                        hessian[c * d.nz() + r] += v;
                    }
                }
                for k in 0..d.nz() {
                    let h = 1e-6 * z[k].abs().max(0.1);
                    let moved = |s: f64| {
                        let mut y = z.clone();
                        y[k] += s * h;
                        y
                    };
                    let (up, down) = (moved(1.0), moved(-1.0));
                    let (above, below) = (dense(&up).0, dense(&down).0);
                    for j in 0..d.nq {
                        let slope = (above[j] - below[j]) / (2.0 * h);
                        let exact = jacobian[j * d.nz() + k];
                        assert!(
                            (slope - exact).abs() < 1e-6 * (1.0 + exact.abs()),
                            "{} {regime} r{j} z{k}: {slope} {exact}",
                            model.name()
                        );
                    }
                    for (m, (a, b)) in weighted(&up).iter().zip(weighted(&down)).enumerate() {
                        let slope = (a - b) / (2.0 * h);
                        let exact = hessian[m * d.nz() + k];
                        assert!(
                            (slope - exact).abs() < 1e-5 * (1.0 + exact.abs()),
                            "{} {regime} z{m} z{k}: {slope} {exact}",
                            model.name()
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn the_law_is_linear_within_its_limit_and_flat_beyond() {
        let u = |error: f64, limit: f64| law([0.0, 0.0, error, 2.0, 0.0, limit, 1.0, 0.4]);
        assert!((u(0.5, 10.0) - 1.0).abs() < 1e-3);
        assert_eq!(u(0.5, UNLIMITED), 1.0);
        assert!((u(50.0, 10.0) - 10.0).abs() < 2e-2 && (u(-50.0, 10.0) + 10.0).abs() < 2e-2);
    }

    #[test]
    fn a_drive_that_is_off_exerts_no_torque() {
        // Without friction, the applied force of the servo is the motor's alone: it vanishes at every velocity.
        let model = closed(&ServoPendulum, &[]);
        let mut p: Vec<f64> = model.params().iter().map(|i| i.nominal).collect();
        for (value, info) in p.iter_mut().zip(model.params()) {
            if info.name.starts_with("dry") || info.name.starts_with("viscous") {
                *value = 0.0;
            }
        }
        let mut f = [f64::NAN];
        for v in [-8.0, 0.3, 5.0] {
            let at = At {
                q: &[0.4],
                v: &[v],
                a: &[0.0],
                u: &[9.0, 5.0, 0.1, 7.3, 0.0],
                p: &p,
            };
            model.applied_force(&at, &mut f);
            assert!(f[0].abs() < 1e-12, "{v}: {f:?}");
        }
    }

    #[test]
    fn patterns_match_and_mistakes_are_named() {
        assert!(matches("*_kp100", "sin_kp100") && matches("*", "x") && matches("a*b*c", "a1b2c"));
        assert!(!matches("*_kp100", "sin_kp1000") && !matches("a", "ab") && !matches("a*b", "ac"));
        for (text, part) in [
            (
                "[[record]]\nname = \"*\"\np = [1.0, 2.0]",
                "p has 2 values, the model has 1",
            ),
            ("[[record]]\nname = \"*\"", "p has 0 values"),
            (
                "[[record]]\nname = \"*\"\np = [1.0]\nlimit = [0.0]",
                "limit = 0",
            ),
            ("[[record]]\nname = \"*\"\nkp = [1.0]", "unknown field `kp`"),
        ] {
            let message = Controllers::parse("c.toml", text, 1)
                .unwrap_err()
                .to_string();
            assert!(
                message.contains(part) && message.contains("c.toml"),
                "{message}"
            );
        }
    }
}
