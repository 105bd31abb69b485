//! Sizes and sparsity of the programs, counted from the programs themselves (Table I and figure 4
//! of the paper).

use std::collections::BTreeSet;

use pid_data::{Dataset, Role};
use pid_fit::transcribe::{
    Curvature, ExplicitForm, FullDiscretization, Loss, Scheme, Setup, Shooting, Track,
};
use pid_models::TwoLink;
use pid_nlp::{Nlp, SparsePattern};
use pid_runtime::dynamics::Dynamics;
use serde::Serialize;

/// Size and non-zeros of one program.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Size {
    /// Nodes M; `None` for full discretization.
    pub(super) nodes: Option<usize>,
    /// Variables and constraints.
    pub(super) n: usize,
    pub(super) m: usize,
    /// Non-zeros of Dr, Dg and of the lower triangle of DH.
    pub(super) nnz: [usize; 3],
}

impl Size {
    /// Relative densities of Dr, Dg and DH by the paper's formulas; no Dg without constraints.
    pub(super) fn densities(&self) -> [Option<f64>; 3] {
        let (n, m) = (self.n as f64, self.m as f64);
        let [r, g, h] = self.nnz.map(|v| v as f64);
        [
            Some(r / n),
            (self.m > 0).then(|| g / (n * m)),
            Some(h / (0.5 * n * (n + 1.0))),
        ]
    }
}

fn track(dataset: &Dataset) -> Option<Track> {
    let e = dataset.with_role(Role::Train).next()?;
    let v = e.v.as_ref()?;
    let rows = |k: usize| k * e.nq..(k + 1) * e.nq;
    let states: Vec<f64> = (0..e.len())
        .flat_map(|k| [&e.q[rows(k)], &v[rows(k)]].concat())
        .collect();
    Some(Track {
        t: e.t.clone(),
        measured: states.clone(),
        guess: states,
        u: e.u.clone(),
        weights: vec![1.0; 2 * e.nq],
    })
}

fn setup() -> Setup {
    let infos = TwoLink.params();
    Setup {
        scheme: Scheme::ExplicitEuler,
        curvature: Curvature::Exact,
        lower: infos.iter().map(|p| p.lower).collect(),
        upper: infos.iter().map(|p| p.upper).collect(),
        scale: vec![1.0; infos.len()],
        inertia: vec![1.0; TwoLink.dims().nq],
        hold_initial: false,
        linear_inputs: false,
        substeps: 1,
        output: None,
        loss: Loss::Square,
        priors: Vec::new(),
        bodies: Vec::new(),
        bodies_weight: 0.0,
    }
}

/// Positions with a value that is not zero.
fn occupied(pattern: &SparsePattern, values: &[f64]) -> usize {
    let entries = pattern.rows.iter().zip(&pattern.cols).zip(values);
    let there: BTreeSet<(u32, u32)> = entries
        .filter(|(_, v)| **v != 0.0)
        .map(|((r, c), _)| (*r, *c))
        .collect();
    there.len()
}

/// Counts at a general point, where an entry that can be other than zero is.
fn count(problem: &mut dyn Nlp, start: &[f64], nodes: Option<usize>) -> Size {
    let (n, m) = (problem.n(), problem.m());
    let moved: Vec<f64> = start
        .iter()
        .enumerate()
        .map(|(k, x)| x + 1e-3 * ((k * 7 + 3) as f64).sin())
        .collect();
    let mut gradient = vec![0.0; n];
    problem.gradient(&moved, &mut gradient);
    let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
    problem.jacobian(&moved, &mut jacobian);
    let lambda: Vec<f64> = (0..m).map(|k| ((k * 5 + 1) as f64).cos()).collect();
    let mut hessian = vec![0.0; problem.hessian_pattern().nnz()];
    problem.hessian(&moved, 1.0, &lambda, &mut hessian);
    Size {
        nodes,
        n,
        m,
        nnz: [
            gradient.iter().filter(|g| **g != 0.0).count(),
            occupied(problem.jacobian_pattern(), &jacobian),
            occupied(problem.hessian_pattern(), &hessian),
        ],
    }
}

/// Sizes for every number of nodes and for full discretization, which comes last.
pub(super) fn sizes(dataset: &Dataset, nodes: &[usize], p: &[f64]) -> Vec<Size> {
    let Some(track) = track(dataset) else {
        return Vec::new();
    };
    let tracks = [track];
    let mut out = Vec::new();
    // Steep friction saturates: its derivatives are then zero to the last digit, though not by structure.
    let mut p = p.to_vec();
    for (value, info) in p.iter_mut().zip(TwoLink.params()) {
        if info.name.starts_with("sharp") {
            *value = 1.0;
        }
    }
    for &nodes in nodes {
        let mut problem = Shooting::new(&TwoLink, &tracks, setup(), nodes, None);
        let start = problem.starting_point(&p);
        out.push(count(&mut problem, &start, Some(nodes)));
    }
    let form = ExplicitForm::new(&TwoLink);
    let mut problem = FullDiscretization::new(&form, &tracks, setup());
    let start = problem.starting_point(&p);
    out.push(count(&mut problem, &start, None));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::robot;

    /// The counts that CasADi finds for the same programs: Dg by 93 an interval of several steps,
    /// DH dense in (x, p).
    #[test]
    fn counts_agree_with_those_of_an_independent_tool() {
        let dataset = robot::records().unwrap();
        let p = robot::starts(1, 0).remove(0);
        let found = sizes(&dataset, &[1, 2, 5, 50], &p);
        let expected = [
            (23, 0, 0, 276),
            (27, 4, 93, 362),
            (39, 16, 372, 620),
            (219, 196, 4557, 4490),
        ];
        for (size, (n, m, g, h)) in found.iter().zip(expected) {
            assert_eq!((size.n, size.m, size.nnz[1], size.nnz[2]), (n, m, g, h));
        }
        let full = found.last().unwrap();
        assert_eq!((full.n, full.m), (1223, 1200));
    }
}
