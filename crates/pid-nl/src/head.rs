//! The ten lines at the head of a file.

use std::path::Path;

use crate::NlError;
use crate::lines::Lines;

/// What the head says.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Head {
    /// Options for the solver, which go back with its answer.
    pub(crate) options: Vec<String>,
    /// Variables.
    pub(crate) n: usize,
    /// Constraints.
    pub(crate) m: usize,
    /// Objectives.
    pub(crate) objectives: usize,
    /// Linear terms of constraints and of objectives, those with the factor 0 included.
    pub(crate) terms: [usize; 2],
    /// Defined variables.
    pub(crate) defined: usize,
}

/// Reads the head. Programs that are not smooth or not continuous are refused here where the head says so.
pub(crate) fn read(lines: &mut Lines<'_>, file: &Path) -> Result<Head, NlError> {
    let first = lines.next("the head")?;
    if !first.starts_with('g') {
        let mend = if first.starts_with('b') {
            "it is in binary form; have AMPL write text: ampl -og"
        } else {
            "have AMPL (ampl -og) or Pyomo write a `.nl` file"
        };
        let begin = first.chars().take(20).collect();
        return Err(NlError::Form {
            file: file.to_owned(),
            begin,
            mend,
        });
    }
    // `g`, how many options follow, the options; a tolerance may stand behind them.
    let mut words = first[1..].split_whitespace();
    let count = words.next().unwrap_or("0");
    let most = lines.whole::<usize>("the number of options", count)?.min(9);
    let options = words.take(most).map(str::to_owned).collect();

    let [n, m, objectives, _, _, logical] =
        numbers(lines, "the number of variables, constraints and objectives")?;
    for (what, count) in [
        ("variables", n),
        ("constraints", m),
        ("objectives", objectives),
    ] {
        // Each of them has a line of its own at least.
        lines.count(&format!("the number of {what}"), &count.to_string())?;
    }
    if logical > 0 {
        return Err(lines.not_smooth("a logical constraint", "write the model without it"));
    }
    let [_, _, complementary, more, _, _] =
        numbers(lines, "the number of nonlinear constraints and objectives")?;
    if complementary + more > 0 {
        return Err(lines.not_smooth(
            "a complementarity",
            "write it as inequalities and a product",
        ));
    }
    numbers::<2>(lines, "the number of network constraints")?;
    numbers::<3>(lines, "the number of nonlinear variables")?;
    let [_, functions, _, _] = numbers(lines, "the number of network variables and functions")?;
    if functions > 0 {
        return Err(lines.not_smooth("an imported function", "write it out in the model"));
    }
    let discrete: [usize; 5] = numbers(lines, "the number of discrete variables")?;
    if discrete.iter().any(|&count| count > 0) {
        return Err(lines.not_smooth(
            "a whole or binary variable",
            "relax it: option relax_integrality 1",
        ));
    }
    let terms = numbers(lines, "the number of non-zeros")?;
    numbers::<2>(lines, "the longest names")?;
    let common: [usize; 5] = numbers(lines, "the number of common expressions")?;
    let defined = common
        .iter()
        .try_fold(0_usize, |sum, &count| sum.checked_add(count))
        .unwrap_or(usize::MAX);
    lines.count("the number of common expressions", &defined.to_string())?;
    Ok(Head {
        options,
        n,
        m,
        objectives,
        terms,
        defined,
    })
}

/// The first numbers of a line; those that it lacks are 0.
fn numbers<const N: usize>(lines: &mut Lines<'_>, item: &str) -> Result<[usize; N], NlError> {
    let line = lines.next(item)?;
    let mut out = [0; N];
    for (out, word) in out.iter_mut().zip(line.split_whitespace()) {
        *out = lines.whole::<u32>(item, word)? as usize;
    }
    Ok(out)
}
