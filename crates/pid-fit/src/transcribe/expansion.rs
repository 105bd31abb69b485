//! How derivatives of the residual become derivatives of a step.
//!
//! Built once per problem: for every structural non-zero of the model's Jacobian and Hessian, the
//! entries of the step it contributes to, with coefficients. Only the powers of the step length
//! change from step to step.

use super::tableau::{Tableau, Term};
use pid_runtime::dynamics::{Dims, Hessian};
use std::collections::BTreeMap;

/// `entry += coefficient · h^power · value[source] (· row scale)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contribution {
    pub(super) source: u32,
    pub(super) entry: u32,
    pub(super) coefficient: f64,
    pub(super) power: i32,
}

/// Contributions of one evaluation.
#[derive(Debug, Clone, Default)]
pub(super) struct EvaluationMap {
    pub(super) jacobian: Vec<Contribution>,
    pub(super) hessian: Vec<Contribution>,
    /// To entries between parameters.
    pub(super) parameter_hessian: Vec<Contribution>,
}

/// Patterns of a step and the contributions to it.
pub(super) struct Expansion {
    pub(super) step_jacobian: Vec<(u32, u32)>,
    pub(super) step_hessian: Vec<(u32, u32)>,
    pub(super) parameter_hessian: Vec<(u32, u32)>,
    /// Values of the linear rows: entry, coefficient, power.
    pub(super) linear: Vec<(u32, f64, i32)>,
    pub(super) evaluations: Vec<EvaluationMap>,
}

struct Indexed {
    map: BTreeMap<(u32, u32), u32>,
}

impl Indexed {
    fn of(mut entries: Vec<(u32, u32)>) -> (Self, Vec<(u32, u32)>) {
        entries.sort_unstable();
        entries.dedup();
        let map = entries
            .iter()
            .enumerate()
            .map(|(k, &e)| (e, k as u32))
            .collect();
        (Self { map }, entries)
    }
    fn at(&self, (row, col): (usize, usize)) -> u32 {
        self.map[&(row as u32, col as u32)]
    }
}

/// The local variables behind position `z` of the model: (local position, coefficient, power).
fn sources(
    dims: Dims,
    tableau: &Tableau,
    evaluation: usize,
    z: usize,
    first_p: usize,
    scale: &[f64],
) -> Vec<(usize, f64, i32)> {
    let e = &tableau.evaluations[evaluation];
    let nq = dims.nq;
    let combine = |terms: &[Term], j: usize| {
        terms
            .iter()
            .map(|t| (tableau.position(t.block, nq) + j, t.coefficient, t.power))
            .collect()
    };
    if z < dims.v() {
        combine(&e.q, z)
    } else if z < dims.a() {
        combine(&e.v, z - dims.v())
    } else if z < dims.u() {
        combine(&e.a, z - dims.a())
    } else if z < dims.p() {
        Vec::new()
    } else {
        vec![(first_p + z - dims.p(), scale[z - dims.p()], 0)]
    }
}

/// A contribution whose entry has a place, but no number yet.
struct Placed {
    source: usize,
    /// Row and column.
    entry: (usize, usize),
    coefficient: f64,
    power: i32,
}

impl Placed {
    fn numbered(&self, entry: u32) -> Contribution {
        Contribution {
            source: self.source as u32,
            entry,
            coefficient: self.coefficient,
            power: self.power,
        }
    }
}

/// Contributions of one evaluation by the places of their entries.
struct Places {
    jacobian: Vec<Placed>,
    hessian: Vec<Placed>,
}

impl Places {
    fn of(
        model: &dyn Hessian,
        tableau: &Tableau,
        evaluation: usize,
        first_p: usize,
        scale: &[f64],
    ) -> Self {
        let dims = model.dims();
        let row0 = (tableau.linear.len() + tableau.evaluations[evaluation].group) * dims.nq;
        let of = |z: usize| sources(dims, tableau, evaluation, z, first_p, scale);
        let mut jacobian = Vec::new();
        let pattern = model.jacobian_pattern();
        for (k, (&r, &z)) in pattern.rows.iter().zip(pattern.cols).enumerate() {
            for (col, coefficient, power) in of(z as usize) {
                jacobian.push(Placed {
                    source: k,
                    entry: (row0 + r as usize, col),
                    coefficient,
                    power,
                });
            }
        }
        let mut hessian = Vec::new();
        let pattern = model.hessian_pattern();
        for (k, (&z1, &z2)) in pattern.rows.iter().zip(pattern.cols).enumerate() {
            let (s1, s2) = (of(z1 as usize), of(z2 as usize));
            for (i, &(l1, c1, p1)) in s1.iter().enumerate() {
                for (j, &(l2, c2, p2)) in s2.iter().enumerate() {
                    // On the diagonal of z each unordered pair counts once; off it, a pair that meets
                    // on one local variable stands for two symmetric terms.
                    if z1 == z2 && j > i {
                        continue;
                    }
                    let pair = z1 != z2 || i != j;
                    let twice = if pair && l1 == l2 { 2.0 } else { 1.0 };
                    hessian.push(Placed {
                        source: k,
                        entry: (l1.max(l2), l1.min(l2)),
                        coefficient: twice * c1 * c2,
                        power: p1 + p2,
                    });
                }
            }
        }
        Self { jacobian, hessian }
    }
}

impl Expansion {
    /// `scale[j]` is the model's value of a parameter per unit of the problem's variable.
    pub(super) fn new(model: &dyn Hessian, tableau: &Tableau, scale: &[f64]) -> Self {
        let dims = model.dims();
        let nq = dims.nq;
        let ny = (2 + tableau.stages) * nq;
        let first_p = 2 * nq + ny;
        let short = |(row, col): (usize, usize)| (row as u32, col as u32);
        let linear: Vec<((usize, usize), &Term)> = (tableau.linear.iter().enumerate())
            .flat_map(|(group, terms)| (0..nq).map(move |j| (group * nq + j, j, terms)))
            .flat_map(|(row, j, terms)| terms.iter().map(move |t| (row, j, t)))
            .map(|(row, j, t)| ((row, tableau.position(t.block, nq) + j), t))
            .collect();
        let mut jacobian_entries: Vec<_> = linear.iter().map(|(entry, _)| short(*entry)).collect();
        let mut hessian_entries = Vec::new();
        let mut parameter_entries: Vec<(u32, u32)> = (0..dims.np as u32).map(|j| (j, j)).collect();
        let between_parameters =
            |(row, col): (usize, usize)| (col >= first_p).then(|| (row - first_p, col - first_p));
        // Two passes: first collect the entries, then number the contributions.
        let places: Vec<Places> = (0..tableau.evaluations.len())
            .map(|evaluation| Places::of(model, tableau, evaluation, first_p, scale))
            .collect();
        for place in &places {
            jacobian_entries.extend(place.jacobian.iter().map(|c| short(c.entry)));
            for c in &place.hessian {
                match between_parameters(c.entry) {
                    Some(entry) => parameter_entries.push(short(entry)),
                    None => hessian_entries.push(short(c.entry)),
                }
            }
        }
        let (jacobian_index, step_jacobian) = Indexed::of(jacobian_entries);
        let (hessian_index, step_hessian) = Indexed::of(hessian_entries);
        let (parameter_index, parameter_hessian) = Indexed::of(parameter_entries);
        let number = |place: &Places| {
            let mut map = EvaluationMap::default();
            let jacobian = place.jacobian.iter();
            map.jacobian
                .extend(jacobian.map(|c| c.numbered(jacobian_index.at(c.entry))));
            for c in &place.hessian {
                match between_parameters(c.entry) {
                    Some(entry) => {
                        let entry = parameter_index.at(entry);
                        map.parameter_hessian.push(c.numbered(entry));
                    }
                    None => map.hessian.push(c.numbered(hessian_index.at(c.entry))),
                }
            }
            map
        };
        Self {
            evaluations: places.iter().map(number).collect(),
            linear: (linear.iter())
                .map(|(entry, t)| (jacobian_index.at(*entry), t.coefficient, t.power))
                .collect(),
            step_jacobian,
            step_hessian,
            parameter_hessian,
        }
    }
}
