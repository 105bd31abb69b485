//! Arrays of numbers as bytes, row by row.

use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// The numbers in these bytes.
pub(crate) fn reals(bytes: &[u8]) -> Vec<f64> {
    let (numbers, _) = bytes.as_chunks::<8>();
    numbers.iter().map(|b| f64::from_ne_bytes(*b)).collect()
}

/// The whole numbers in these bytes.
pub(crate) fn integers(bytes: &[u8]) -> Vec<i64> {
    let (numbers, _) = bytes.as_chunks::<8>();
    numbers.iter().map(|b| i64::from_ne_bytes(*b)).collect()
}

/// A numpy array of one dimension, or of `columns` columns.
pub(crate) fn array<'py>(
    py: Python<'py>,
    values: &[f64],
    columns: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let flat = py
        .import("numpy")?
        .call_method1("frombuffer", (PyBytes::new(py, &bytes),))?;
    let shaped = match columns {
        Some(columns) => flat.call_method1("reshape", (values.len() / columns.max(1), columns))?,
        None => flat,
    };
    // What is made from bytes cannot be written to.
    shaped.call_method0("copy")
}
