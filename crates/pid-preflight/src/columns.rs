//! Columns of a record by their names: values, spread, quantiles, readings that are outliers.

use pid_data::Experiment;
use pid_data::signal::{column, outliers};

/// Stem of a column and its joint from 0.
pub(crate) fn split(column: &str) -> Option<(&str, usize)> {
    let digits = column.find(|c: char| c.is_ascii_digit())?;
    let (stem, number) = column.split_at(digits);
    Some((stem, number.parse::<usize>().ok()?.checked_sub(1)?))
}

/// A column of an experiment by its name; NaN where it has no values.
pub(crate) fn named(e: &Experiment, name: &str) -> Option<Vec<f64>> {
    let (stem, j) = split(name)?;
    match stem {
        "q" => Some(column(&e.q, e.nq, j)),
        "dq" => e.v.as_ref().map(|v| column(v, e.nq, j)),
        "u" => Some(column(&e.u, e.nu(), j)),
        _ => None,
    }
}

/// Largest less smallest value, without missing ones; 0 of nothing.
pub(crate) fn spread(x: &[f64]) -> f64 {
    let known = x.iter().filter(|x| x.is_finite());
    let (low, high) = known.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &x| {
        (l.min(x), h.max(x))
    });
    (high - low).max(0.0)
}

/// A quantile of the values that are known; 0 of nothing.
pub(crate) fn quantile(x: &[f64], share: f64) -> f64 {
    let mut known: Vec<f64> = x.iter().copied().filter(|x| x.is_finite()).collect();
    if known.is_empty() {
        return 0.0;
    }
    let place = ((known.len() - 1) as f64 * share).round() as usize;
    *known.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Readings per part in which outliers are looked for: deviations are local, and the time grows with the
/// length of the record only.
const PART: usize = 2000;

/// Rows of a column that hold outliers.
pub(crate) fn outlier_rows(e: &Experiment, name: &str) -> Vec<usize> {
    let Some(x) = named(e, name) else {
        return Vec::new();
    };
    // Chatter of inputs and steps of velocities are no errors: below a hundredth of the range nothing is.
    let least = if name.starts_with('q') { 1e-5 } else { 1e-3 } * spread(&x);
    if least == 0.0 {
        return Vec::new();
    }
    let mut out = Vec::new();
    let mut start = 0;
    while start < x.len() {
        let end = if x.len() - start < 2 * PART {
            x.len()
        } else {
            start + PART
        };
        let found = outliers(&e.t[start..end], &x[start..end], least);
        out.extend(found.into_iter().map(|i| start + i));
        start = end;
    }
    out
}
