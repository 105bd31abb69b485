//! MATLAB files of version 5 (`save -v6` and `-v7`).

use std::io::{Read, copy, sink};

use flate2::read::ZlibDecoder;
use matfile::{MatFile, NumericData};

use super::arrays::{Array, log};
use super::broken;
use crate::budget::Budget;
use crate::error::LogError;
use crate::log::{Channel, Log};

/// Reads one file.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Vec<Log>, LogError> {
    if !fits(bytes) {
        return Err(broken(file, "MAT", "it unpacks to far more than its size"));
    }
    let mat = MatFile::parse(bytes).map_err(|e| broken(file, "MAT", e))?;
    let arrays: Vec<Array> = mat.arrays().iter().filter_map(array).collect();
    log(file, &arrays).map(|log| vec![log])
}

/// Whether the packed arrays unpack to no more than the file may: the library has no such limit.
/// Source of the layout: MAT-File Format, version 5, section 1: a header of 128 bytes, then elements
/// with their type and size before them.
fn fits(bytes: &[u8]) -> bool {
    const PACKED: u32 = 15;
    let big = bytes.get(126..128) == Some(b"MI");
    let mut budget = Budget::of(bytes.len());
    let mut rest = bytes.get(128..).unwrap_or(&[]);
    while let Some((&[a, b, c, d, e, f, g, h], after)) = rest.split_first_chunk::<8>() {
        let number = |n: [u8; 4]| {
            if big {
                u32::from_be_bytes(n)
            } else {
                u32::from_le_bytes(n)
            }
        };
        let (kind, size) = (number([a, b, c, d]), number([e, f, g, h]));
        let size = usize::try_from(size).unwrap_or(usize::MAX).min(after.len());
        let (element, next) = after.split_at(size);
        if kind == PACKED {
            // A fault in the packing is the library's to name. A byte may become a double.
            let limit = (budget.left() / 8) as u64 + 1;
            let unpacked = copy(&mut ZlibDecoder::new(element).take(limit), &mut sink());
            let unpacked = unpacked.map_or(0, |n| usize::try_from(n).unwrap_or(usize::MAX));
            if !budget.take(unpacked.saturating_mul(8)) {
                return false;
            }
        }
        rest = next;
    }
    true
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
