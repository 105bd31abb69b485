//! NumPy archives, `.npz`.

use std::io::{Cursor, Read};

use npyz::{NpyFile, Order};
use zip::ZipArchive;

use super::arrays::{Array, log};
use super::broken;
use crate::budget::Budget;
use crate::error::LogError;
use crate::log::{Channel, Log};

/// Arrays of an archive at most.
const ENTRIES: usize = 4096;

/// Reads one archive.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<Vec<Log>, LogError> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| broken(file, "NPZ", e))?;
    let mut budget = Budget::of(bytes.len());
    let mut arrays = Vec::new();
    let mut left_out = Vec::new();
    for index in 0..archive.len().min(ENTRIES) {
        let entry = archive
            .by_index(index)
            .map_err(|e| broken(file, "NPZ", e))?;
        let Some(name) = entry.name().strip_suffix(".npy").map(str::to_owned) else {
            continue;
        };
        let limit = budget.left();
        let mut data = Vec::new();
        let taken = entry.take(limit as u64 + 1).read_to_end(&mut data);
        taken.map_err(|e| broken(file, "NPZ", format!("array `{name}`: {e}")))?;
        if !budget.take(data.len()) {
            return Err(broken(file, "NPZ", "it unpacks to far more than its size"));
        }
        match array(&name, &data) {
            Ok(Some(array)) => arrays.push(array),
            Ok(None) => left_out.push(name),
            Err(e) => return Err(broken(file, "NPZ", format!("array `{name}`: {e}"))),
        }
    }
    let mut log = log(file, &arrays)?;
    for name in left_out {
        log.warnings.push(format!(
            "array `{name}` is left out: it is no array of numbers of one or two dimensions"
        ));
    }
    Ok(vec![log])
}

/// One array; `None` for those that are not numbers or have other dimensions.
fn array(name: &str, data: &[u8]) -> std::io::Result<Option<Array>> {
    let npy = NpyFile::new(data)?;
    let (rows, columns) = match *npy.shape() {
        [rows] => (rows, 1),
        [rows, columns] => (rows, columns),
        _ => return Ok(None),
    };
    let short = || std::io::Error::from(std::io::ErrorKind::UnexpectedEof);
    let cells = rows
        .checked_mul(columns)
        .filter(|n| *n <= data.len() as u64)
        .ok_or_else(short)?;
    let (Ok(rows), Ok(columns), Ok(cells)) = (
        usize::try_from(rows),
        usize::try_from(columns),
        usize::try_from(cells),
    ) else {
        return Ok(None);
    };
    let order = npy.order();
    let Some((values, offset)) = numbers(npy)? else {
        return Ok(None);
    };
    if values.len() != cells {
        return Err(short());
    }
    let values = match order {
        Order::C => values,
        Order::Fortran => (0..cells)
            .map(|i| values[(i % columns) * rows + i / columns])
            .collect(),
    };
    Ok(Some(Array {
        name: name.to_owned(),
        rows,
        columns,
        values,
        offset,
    }))
}

/// The numbers of any type, and what was taken off whole ones.
fn numbers(npy: NpyFile<&[u8]>) -> std::io::Result<Option<(Vec<f64>, f64)>> {
    macro_rules! reals {
        ($npy:expr, $type:ty) => {
            match $npy.try_data::<$type>() {
                Ok(reader) => {
                    let values = reader.map(|v| v.map(f64::from)).collect::<Result<_, _>>()?;
                    return Ok(Some((values, 0.0)));
                }
                Err(npy) => npy,
            }
        };
    }
    let npy = reals!(npy, f64);
    let npy = reals!(npy, f32);
    let npy = reals!(npy, i32);
    let npy = reals!(npy, u32);
    let npy = reals!(npy, i16);
    let npy = reals!(npy, u16);
    let npy = reals!(npy, i8);
    let npy = reals!(npy, u8);
    let npy = reals!(npy, bool);
    match npy.try_data::<i64>() {
        Ok(reader) => {
            let values = reader.map(|v| v.map(Some)).collect::<Result<Vec<_>, _>>()?;
            let channel = Channel::of_integers(String::new(), 0, &values);
            Ok(Some((channel.values, channel.offset)))
        }
        Err(_) => Ok(None),
    }
}
