//! The equations as a linear function of parameters.
//!
//! ```text
//! r(q, v, a, u, p) = Y(q, v, a, u, p_R) p_L + r₀(q, v, a, u, p_R)
//! ```
//!
//! with the parameters split into `p_L`, in which r is linear, and the rest `p_R`. Rigid-body
//! torques are linear in mass, first moment and inertia about the link origin (C. G. Atkeson, C. H.
//! An, J. M. Hollerbach, 1986); friction and drives often in their coefficients, but not in the
//! sharpness of a `tanh`. Linearity is not assumed from the form of the declaration but proved:
//! ∂²r/∂p∂p vanishes.

use pid_symbolic::diff::{self, Entry};
use pid_symbolic::{Graph, Id, Node, pattern};

use crate::equations::Equations;

/// Two parameters whose product, or one whose power, enters the rigid-body torques.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotLinear {
    /// A parameter of the links, the geometry or a rotor.
    pub first: usize,
    /// Another one, or the same.
    pub second: usize,
}

/// Y, its columns and the remainder r₀.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Regressor {
    /// p_L: the parameter of each column. First those whose column depends on no parameter and no input.
    pub params: Vec<usize>,
    /// How many columns depend on no parameter and no input: the regressor Y(q, v, a) of the
    /// inverse dynamics.
    pub constant: usize,
    /// Non-zeros of Y, sorted by row, then column.
    pub entries: Vec<Entry>,
    /// r₀: r at p_L = 0.
    pub offset: Vec<Id>,
    /// r at u = 0 and with the parameters of the constant columns zero.
    pub constant_offset: Vec<Id>,
}

/// Splits the residual.
///
/// # Errors
/// If M a + b is not linear in all parameters that enter it.
pub fn regressor(g: &mut Graph, equations: &Equations) -> Result<Regressor, NotLinear> {
    let symbols = &equations.symbols;
    let np = symbols.p.len();
    let first_input = 3 * symbols.q.len();
    let first_param = first_input + symbols.u.len();
    let param_of = |var: u32| (var as usize).checked_sub(first_param).filter(|&k| k < np);

    let rows = diff::jacobian(g, &equations.residual, &symbols.p);
    let flat: Vec<Id> = rows.iter().flatten().copied().collect();
    let zero = pattern::zeros(g, &flat);

    let conflicts = conflicts(g, equations, &flat, &zero, &param_of);
    let rigid = rigid(g, equations, np, &param_of);
    let mut linear = vec![false; np];
    for j in (0..np).filter(|&j| rigid[j]) {
        if let Some(&k) = conflicts[j].iter().find(|&&k| rigid[k]) {
            return Err(NotLinear {
                first: j.min(k),
                second: j.max(k),
            });
        }
        linear[j] = true;
    }
    for j in (0..np).filter(|&j| !rigid[j]) {
        linear[j] = conflicts[j].iter().all(|&k| k != j && !linear[k]);
    }

    // Columns that read neither inputs nor parameters come first.
    let reads = |g: &Graph, id: Id| {
        g.reachable(&[id])
            .into_iter()
            .any(|id| matches!(g.node(id), Node::Var(i) if (i as usize) >= first_input))
    };
    let constant: Vec<bool> = (0..np)
        .map(|j| (0..rows.len()).all(|i| zero[i * np + j] || !reads(g, flat[i * np + j])))
        .collect();
    let mut params: Vec<usize> = (0..np).filter(|&j| linear[j] && constant[j]).collect();
    let count = params.len();
    params.extend((0..np).filter(|&j| linear[j] && !constant[j]));

    let without = |g: &mut Graph, outputs: &[Id], inputs: bool, set: &[usize]| {
        let nothing = g.zero();
        g.substitute(outputs, |_, var| {
            let is_input = (first_input..first_param).contains(&(var as usize));
            let gone = param_of(var).is_some_and(|k| set.contains(&k)) || (inputs && is_input);
            gone.then_some(nothing)
        })
    };
    let mut entries = Vec::new();
    for row in 0..rows.len() {
        for (col, &j) in params.iter().enumerate() {
            if !zero[row * np + j] {
                entries.push(Entry {
                    row,
                    col,
                    value: flat[row * np + j],
                });
            }
        }
    }
    // A column may mention parameters on which it does not depend.
    let values: Vec<Id> = entries.iter().map(|entry| entry.value).collect();
    for (entry, value) in entries.iter_mut().zip(without(g, &values, false, &params)) {
        entry.value = value;
    }
    let offset = without(g, &equations.residual, false, &params);
    let constant_offset = without(g, &equations.residual, true, &params[..count]);
    Ok(Regressor {
        params,
        constant: count,
        entries,
        offset,
        constant_offset,
    })
}

/// For each parameter, those with which it has a second derivative of r; itself among them if r is
/// not linear in it.
fn conflicts(
    g: &mut Graph,
    equations: &Equations,
    flat: &[Id],
    zero: &[bool],
    param_of: &impl Fn(u32) -> Option<usize>,
) -> Vec<Vec<usize>> {
    let p = &equations.symbols.p;
    let np = p.len();
    let mut conflicts = vec![Vec::new(); np];
    for (position, &id) in flat.iter().enumerate() {
        if zero[position] {
            continue;
        }
        let read: Vec<usize> = g
            .reachable(&[id])
            .into_iter()
            .filter_map(|id| match g.node(id) {
                Node::Var(i) => param_of(i),
                _ => None,
            })
            .collect();
        if read.is_empty() {
            continue;
        }
        let vars: Vec<Id> = read.iter().map(|&k| p[k]).collect();
        let second = diff::gradient(g, id, &vars);
        let vanishes = pattern::zeros(g, &second);
        let j = position % np;
        for (k, vanishes) in read.into_iter().zip(vanishes) {
            if !vanishes {
                conflicts[j].push(k);
                conflicts[k].push(j);
            }
        }
    }
    for list in &mut conflicts {
        list.sort_unstable();
        list.dedup();
    }
    conflicts
}

/// Which parameters enter M or b.
fn rigid(
    g: &Graph,
    equations: &Equations,
    np: usize,
    param_of: &impl Fn(u32) -> Option<usize>,
) -> Vec<bool> {
    let outputs = [equations.mass_matrix.as_slice(), equations.bias.as_slice()].concat();
    let mut rigid = vec![false; np];
    for id in g.reachable(&outputs) {
        if let Node::Var(i) = g.node(id)
            && let Some(k) = param_of(i)
        {
            rigid[k] = true;
        }
    }
    rigid
}
