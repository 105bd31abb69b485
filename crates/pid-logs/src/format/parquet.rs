//! Parquet tables: columns of numbers and columns of lists of numbers.

mod pages;

use std::sync::Arc;

use bytes::Bytes;
use parquet::basic::Type as Physical;
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use parquet::schema::types::Type;

use super::broken;
use crate::budget::Budget;
use crate::error::LogError;
use crate::log::{Channel, Clock, Log};

/// A channel while it is read.
enum Column {
    Reals(Vec<f64>),
    Integers(Vec<Option<i64>>),
}

/// The numeric columns of a file. Lists give one column for each element, `name[0]`, `name[1]`, …
struct Table {
    names: Vec<String>,
    columns: Vec<Column>,
    rows: usize,
}

/// Reads one Parquet file; a column `episode_index` parts it into several logs.
pub(super) fn read(file: &str, bytes: Vec<u8>) -> Result<Vec<Log>, LogError> {
    let table = table(file, bytes)?;
    if table.rows == 0 {
        return Err(LogError::Empty {
            file: file.to_owned(),
            what: "the table has no rows".to_owned(),
            mend: "write at least two samples".to_owned(),
        });
    }
    let mut log = Log::new(file);
    log.clocks = vec![Clock {
        rows: table.rows,
        ..Clock::default()
    }];
    for (name, column) in table.names.into_iter().zip(table.columns) {
        log.channels.push(match column {
            Column::Reals(values) => Channel::new(name, 0, values),
            Column::Integers(values) => Channel::of_integers(name, 0, &values),
        });
    }
    Ok(episodes(log))
}

/// Longest list whose elements become channels.
const LONGEST: usize = 256;
/// Columns at most, lists taken apart.
const COLUMNS: usize = 4096;
/// Why a file is refused.
const LARGE: &str = "it unpacks to far more than its size";
const HEAD: &str = "the head of a page is not readable";
/// What a value takes while its row is read, bytes.
const VALUE: usize = 32;

fn table(file: &str, bytes: Vec<u8>) -> Result<Table, LogError> {
    let fault = |e: parquet::errors::ParquetError| broken(file, "Parquet", e);
    let mut budget = Budget::of(bytes.len());
    let bytes = Bytes::from(bytes);
    let reader = SerializedFileReader::new(bytes.clone()).map_err(fault)?;
    let schema = reader
        .metadata()
        .file_metadata()
        .schema_descr()
        .root_schema_ptr();
    let numeric = schema
        .get_fields()
        .iter()
        .filter(|f| is_numeric(f))
        .cloned()
        .collect();
    let projection = Type::group_type_builder(schema.name())
        .with_fields(numeric)
        .build()
        .map_err(fault)?;
    let mut table = Table {
        names: Vec::new(),
        columns: Vec::new(),
        rows: 0,
    };
    if projection.get_fields().is_empty() {
        return Ok(table);
    }
    let refused = |why: &str| broken(file, "Parquet", why);
    allowed(&reader, &bytes, &projection, budget.left()).map_err(refused)?;
    let mut cells = Vec::new();
    for row in reader.get_row_iter(Some(projection)).map_err(fault)? {
        let row = row.map_err(fault)?;
        cells.clear();
        for (name, field) in row.get_column_iter() {
            take_apart(name, field, &mut cells);
        }
        if !budget.take(32 + 16 * cells.len()) || cells.len() > COLUMNS {
            return Err(refused(LARGE));
        }
        table.push(&cells);
    }
    Ok(table)
}

/// Whether the pages of the columns of a projection claim no more than so many bytes: of each column one is held at
/// once, with its values.
fn allowed(
    reader: &SerializedFileReader<Bytes>,
    bytes: &Bytes,
    projection: &Type,
    most: usize,
) -> Result<(), &'static str> {
    for group in reader.metadata().row_groups() {
        let mut held: usize = 0;
        for column in group.columns() {
            let root = column.column_path().parts().first();
            let mut fields = projection.get_fields().iter();
            if !fields.any(|f| root.is_some_and(|root| f.name() == root)) {
                continue;
            }
            let mut largest = 0;
            for page in pages::claimed(chunk(column, bytes).ok_or(HEAD)?) {
                let page = page.ok_or(HEAD)?;
                let values = VALUE.saturating_mul(page.values);
                largest = largest.max(page.bytes.saturating_add(values));
                if held.saturating_add(largest) > most {
                    return Err(LARGE);
                }
            }
            held += largest;
        }
    }
    Ok(())
}

/// The bytes of a column.
fn chunk<'a>(column: &ColumnChunkMetaData, bytes: &'a Bytes) -> Option<&'a [u8]> {
    let start = column.dictionary_page_offset();
    let start = start.unwrap_or_else(|| column.data_page_offset());
    let length = usize::try_from(column.compressed_size()).ok()?;
    bytes.get(usize::try_from(start).ok()?..)?.get(..length)
}

/// Whether all leaves of a column are numbers.
fn is_numeric(field: &Arc<Type>) -> bool {
    if field.is_group() {
        return !field.get_fields().is_empty() && field.get_fields().iter().all(is_numeric);
    }
    matches!(
        field.get_physical_type(),
        Physical::BOOLEAN | Physical::INT32 | Physical::INT64 | Physical::FLOAT | Physical::DOUBLE
    )
}

/// A number of a cell.
#[derive(Clone, Copy)]
enum Number {
    Real(f64),
    Integer(i64),
    Missing,
}

/// The numbers in a field with their names.
fn take_apart(name: &str, field: &Field, cells: &mut Vec<(String, Number)>) {
    let number = match field {
        Field::Null => Number::Missing,
        Field::Bool(b) => Number::Integer(i64::from(*b)),
        Field::Byte(v) => Number::Integer(i64::from(*v)),
        Field::Short(v) => Number::Integer(i64::from(*v)),
        Field::Int(v) | Field::Date(v) | Field::TimeMillis(v) => Number::Integer(i64::from(*v)),
        Field::Long(v)
        | Field::TimestampMillis(v)
        | Field::TimestampMicros(v)
        | Field::TimeMicros(v) => Number::Integer(*v),
        Field::UByte(v) => Number::Integer(i64::from(*v)),
        Field::UShort(v) => Number::Integer(i64::from(*v)),
        Field::UInt(v) => Number::Integer(i64::from(*v)),
        Field::ULong(v) => Number::Real(*v as f64),
        Field::Float(v) => Number::Real(f64::from(*v)),
        Field::Double(v) => Number::Real(*v),
        Field::ListInternal(list) if list.elements().len() <= LONGEST => {
            for (i, element) in list.elements().iter().enumerate() {
                take_apart(&format!("{name}[{i}]"), element, cells);
            }
            return;
        }
        Field::Group(row) => {
            for (inner, field) in row.get_column_iter() {
                take_apart(&format!("{name}/{inner}"), field, cells);
            }
            return;
        }
        _ => return,
    };
    cells.push((name.to_owned(), number));
}

impl Table {
    /// Adds a row; columns that come up late are missing before, those that stay away are missing.
    fn push(&mut self, cells: &[(String, Number)]) {
        let same = cells.len() == self.names.len()
            && cells.iter().zip(&self.names).all(|(c, n)| c.0 == *n);
        for (i, (name, number)) in cells.iter().enumerate() {
            let at = if same {
                Some(i)
            } else {
                self.names.iter().position(|n| n == name)
            };
            let at = at.unwrap_or_else(|| {
                self.names.push(name.clone());
                self.columns.push(match number {
                    Number::Real(_) => Column::Reals(vec![f64::NAN; self.rows]),
                    Number::Integer(_) | Number::Missing => Column::Integers(vec![None; self.rows]),
                });
                self.names.len() - 1
            });
            self.columns[at].push(*number);
        }
        self.rows += 1;
        if !same {
            for column in &mut self.columns {
                column.fill(self.rows);
            }
        }
    }
}

impl Column {
    fn push(&mut self, number: Number) {
        match (&mut *self, number) {
            (Column::Reals(values), Number::Real(v)) => values.push(v),
            (Column::Reals(values), Number::Integer(v)) => values.push(v as f64),
            (Column::Reals(values), Number::Missing) => values.push(f64::NAN),
            (Column::Integers(values), Number::Integer(v)) => values.push(Some(v)),
            (Column::Integers(values), Number::Missing) => values.push(None),
            (Column::Integers(values), Number::Real(v)) => {
                let before = values.iter().map(|v| v.map_or(f64::NAN, |v| v as f64));
                *self = Column::Reals(before.chain([v]).collect());
            }
        }
    }

    fn fill(&mut self, rows: usize) {
        match self {
            Column::Reals(values) => values.resize(rows, f64::NAN),
            Column::Integers(values) => values.resize(rows, None),
        }
    }
}

/// Parts a table where `episode_index` changes.
pub(super) fn episodes(log: Log) -> Vec<Log> {
    let Some(index) = log.channels.iter().find(|c| c.name == "episode_index") else {
        return vec![log];
    };
    let mut starts: Vec<usize> = (1..index.values.len())
        .filter(|&i| index.values[i].to_bits() != index.values[i - 1].to_bits())
        .collect();
    starts.insert(0, 0);
    let ends = starts.iter().skip(1).copied().chain([index.values.len()]);
    let episodes = starts.iter().copied().zip(ends);
    let part = |(start, end): (usize, usize)| Log {
        file: log.file.clone(),
        name: format!("episode_{:06}", index.values[start] + index.offset),
        clocks: vec![Clock {
            rows: end - start,
            ..Clock::default()
        }],
        channels: log
            .channels
            .iter()
            .filter(|c| c.name != "episode_index")
            .map(|c| Channel {
                values: c.values[start..end].to_vec(),
                ..c.without_values()
            })
            .collect(),
        notes: log.notes.clone(),
        warnings: log.warnings.clone(),
    };
    episodes.map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The last column claims to unpack to a thousand times what a file of its size may.
    #[test]
    fn a_page_that_claims_to_be_huge_is_not_made_room_for() {
        let whole = std::fs::read("tests/fixtures/lists.parquet").expect("a fixture");
        let reader = SerializedFileReader::new(Bytes::from(whole.clone())).expect("a table");
        let last = reader.metadata().row_group(0).columns().last();
        let start = last.and_then(|c| c.dictionary_page_offset());
        // Its head begins with the kind of page and the bytes it unpacks to, 640 in zigzag form.
        let at = start.expect("a dictionary") as usize + 3;
        assert_eq!(whole[at - 1..at + 2], [0x15, 0x80, 0x0a]);
        let mut bytes = whole[..at].to_vec();
        bytes.extend([0xfe, 0xff, 0xff, 0xff, 0x0f]);
        bytes.extend(&whole[at + 2..]);
        let mistake = |bytes| match read("a.parquet", bytes) {
            Ok(_) => panic!("it is read"),
            Err(e) => e.to_string(),
        };
        let words = mistake(bytes);
        assert!(words.contains("far more than its size"), "{words}");
        // Without the head nothing is read of it.
        let mut bytes = whole.clone();
        bytes[at - 3..at].fill(0xff);
        let words = mistake(bytes);
        assert!(words.contains("head of a page"), "{words}");
        assert!(read("a.parquet", whole).is_ok());
    }
}
