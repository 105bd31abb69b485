//! MATLAB files of version 5 (`save -v6` and `-v7`).

use matfile::{MatFile, NumericData};

use super::arrays::{Array, log};
use super::broken;
use crate::error::LogError;
use crate::log::{Channel, Log};

/// Reads one file.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Vec<Log>, LogError> {
    let mat = MatFile::parse(bytes).map_err(|e| broken(file, "MAT", e))?;
    let arrays: Vec<Array> = mat.arrays().iter().filter_map(array).collect();
    log(file, &arrays).map(|log| vec![log])
}

/// An array row by row; the file has it column by column.
fn array(array: &matfile::Array) -> Option<Array> {
    let [rows, columns] = array.size().as_slice() else {
        return None;
    };
    let (rows, columns) = (*rows, *columns);
    let (values, offset) = numbers(array.data())?;
    if Some(values.len()) != rows.checked_mul(columns) {
        return None;
    }
    let values = (0..values.len())
        .map(|i| values[(i % columns) * rows + i / columns])
        .collect();
    Some(Array {
        name: array.name().to_owned(),
        rows,
        columns,
        values,
        offset,
    })
}

/// The numbers of any type, and what was taken off whole ones; `None` for complex ones.
fn numbers(data: &NumericData) -> Option<(Vec<f64>, f64)> {
    macro_rules! reals {
        ($real:expr) => {
            Some(($real.iter().map(|v| f64::from(*v)).collect(), 0.0))
        };
    }
    match data {
        NumericData::Double { real, imag: None } => reals!(real),
        NumericData::Single { real, imag: None } => reals!(real),
        NumericData::Int8 { real, imag: None } => reals!(real),
        NumericData::UInt8 { real, imag: None } => reals!(real),
        NumericData::Int16 { real, imag: None } => reals!(real),
        NumericData::UInt16 { real, imag: None } => reals!(real),
        NumericData::Int32 { real, imag: None } => reals!(real),
        NumericData::UInt32 { real, imag: None } => reals!(real),
        NumericData::Int64 { real, imag: None } => integers(real.iter().map(|v| Some(*v))),
        NumericData::UInt64 { real, imag: None } => {
            integers(real.iter().map(|v| i64::try_from(*v).ok()))
        }
        _ => None,
    }
}

fn integers(values: impl Iterator<Item = Option<i64>>) -> Option<(Vec<f64>, f64)> {
    let values: Vec<Option<i64>> = values.collect();
    let channel = Channel::of_integers(String::new(), 0, &values);
    Some((channel.values, channel.offset))
}
