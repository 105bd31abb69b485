//! Named arrays, as NPZ and MAT files hold them, as channels of one table.

use crate::error::LogError;
use crate::log::{Channel, Clock, Log};
use crate::names::{Word, quantity_of, words};

/// An array of one or two dimensions.
#[derive(Debug)]
pub(super) struct Array {
    pub(super) name: String,
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Row by row.
    pub(super) values: Vec<f64>,
    /// What was taken off whole numbers.
    pub(super) offset: f64,
}

impl Array {
    /// The value of a row and a column.
    fn at(&self, row: usize, column: usize) -> f64 {
        self.values
            .get(row * self.columns + column)
            .copied()
            .unwrap_or(f64::NAN)
    }
}

/// The log of some arrays: the samples are those of the time, or of the longest array.
pub(super) fn log(file: &str, arrays: &[Array]) -> Result<Log, LogError> {
    let long = |a: &&Array| a.rows.max(a.columns) > 1 && a.rows > 0 && a.columns > 0;
    let is_time = |a: &&Array| {
        let time = words(&a.name)
            .iter()
            .any(|w| quantity_of(w) == Some(Word::Time));
        time && a.rows.min(a.columns) == 1
    };
    let used = || arrays.iter().filter(long);
    let samples = used()
        .find(is_time)
        .or_else(|| used().max_by_key(|a| a.rows.max(a.columns)));
    let Some(samples) = samples.map(|a| a.rows.max(a.columns)) else {
        return Err(LogError::Empty {
            file: file.to_owned(),
            what: "no array of numbers with two or more samples".to_owned(),
            mend: "save t [N], q [N, n], dq [N, n], u [N, n] as plain arrays of doubles; structures and cells are not read"
                .to_owned(),
        });
    };
    let mut log = Log::new(file);
    log.clocks = vec![Clock {
        rows: samples,
        ..Clock::default()
    }];
    for array in used() {
        if array.rows == samples {
            for c in 0..array.columns {
                let name = if array.columns == 1 {
                    array.name.clone()
                } else {
                    format!("{}[{c}]", array.name)
                };
                log.channels
                    .push(channel(name, array, (0..samples).map(|r| array.at(r, c))));
            }
        } else if array.columns == samples {
            // One row for each joint.
            for r in 0..array.rows {
                let name = if array.rows == 1 {
                    array.name.clone()
                } else {
                    format!("{}[{r}]", array.name)
                };
                log.channels
                    .push(channel(name, array, (0..samples).map(|c| array.at(r, c))));
            }
        } else {
            log.warnings.push(format!(
                "array `{}` of {} × {} is left out: the log has {samples} samples",
                array.name, array.rows, array.columns
            ));
        }
    }
    Ok(log)
}

fn channel(name: String, array: &Array, values: impl Iterator<Item = f64>) -> Channel {
    Channel {
        offset: array.offset,
        ..Channel::new(name, 0, values.collect())
    }
}
