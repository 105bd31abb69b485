//! One record: header, rows, and what the manifest says of it.

use super::columns::{Columns, find_columns};
use crate::manifest::Listed;
use crate::{DataError, DataWarning, Experiment, JointChannels};

/// A record from its text, with warnings.
pub(super) fn read_experiment(
    file: &str,
    text: &str,
    listed: &Listed,
    joints: &[JointChannels],
) -> Result<(Experiment, Vec<DataWarning>), DataError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let empty = |what| DataError::Empty {
        file: file.to_owned(),
        what,
    };
    if text.trim().is_empty() {
        return Err(empty("is empty"));
    }
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let broken = |e: csv::Error| DataError::Csv {
        file: file.to_owned(),
        line: e.position().map_or(0, csv::Position::line),
        message: e.to_string(),
    };
    let header: Vec<String> = reader
        .headers()
        .map_err(broken)?
        .iter()
        .map(str::to_owned)
        .collect();
    let mut warnings = Vec::new();
    let columns = find_columns(file, &header, joints, &mut warnings)?;

    let mut experiment = blank(listed, joints.len(), &columns);
    let rows = text.bytes().filter(|b| *b == b'\n').count();
    reserve(&mut experiment, rows);
    let mut line = 1;
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(broken)? {
        line = record.position().map_or(line + 1, csv::Position::line);
        let row = Row {
            file,
            line,
            header: &header,
            record: &record,
        };
        row.append(&columns, &mut experiment)?;
    }
    match experiment.len() {
        0 => return Err(empty("has a header but no samples")),
        1 => {
            return Err(DataError::OneSample {
                file: file.to_owned(),
                line,
            });
        }
        _ => {}
    }
    compare_with_manifest(file, listed, &experiment, &mut warnings);
    Ok((experiment, warnings))
}

/// A record without samples, with the channels that have columns.
fn blank(listed: &Listed, nq: usize, columns: &Columns) -> Experiment {
    Experiment {
        name: listed.name.clone(),
        role: listed.role,
        note: listed.note.clone(),
        nq,
        t: Vec::new(),
        q: Vec::new(),
        v: columns.v.iter().any(Option::is_some).then(Vec::new),
        u: Vec::new(),
        tau: columns.tau.is_some().then(Vec::new),
        qref: columns.qref.is_some().then(Vec::new),
        missing: 0,
        gain_factors: listed.gain_factors.clone(),
    }
}

/// Makes room for samples in every channel.
fn reserve(experiment: &mut Experiment, rows: usize) {
    let e = experiment;
    e.t.reserve(rows);
    let channels = [Some(&mut e.q), Some(&mut e.u)].into_iter();
    let others = [e.v.as_mut(), e.tau.as_mut(), e.qref.as_mut()];
    for channel in channels.chain(others).flatten() {
        channel.reserve(rows * e.nq);
    }
}

/// One row of a file.
struct Row<'a> {
    file: &'a str,
    line: u64,
    header: &'a [String],
    record: &'a csv::StringRecord,
}

impl Row<'_> {
    /// Adds the row as a sample.
    fn append(&self, columns: &Columns, e: &mut Experiment) -> Result<(), DataError> {
        let (file, line) = (self.file, self.line);
        if self.record.len() != self.header.len() {
            return Err(DataError::CellCount {
                file: file.to_owned(),
                line,
                found: self.record.len(),
                expected: self.header.len(),
            });
        }
        let missing = &mut e.missing;
        let mut cell = |column: usize| -> Result<f64, DataError> {
            let value = number(file, line, &self.header[column], &self.record[column])?;
            *missing += usize::from(value.is_nan());
            Ok(value)
        };
        let time = cell(columns.t)?;
        if time.is_nan() {
            return Err(DataError::MissingTime {
                file: file.to_owned(),
                line,
            });
        }
        if let Some(&previous) = e.t.last()
            && time <= previous
        {
            return Err(DataError::TimeNotIncreasing {
                file: file.to_owned(),
                line,
                value: time,
                previous,
            });
        }
        e.t.push(time);
        for &c in &columns.q {
            e.q.push(cell(c)?);
        }
        if let Some(v) = &mut e.v {
            for c in &columns.v {
                v.push(c.map_or(Ok(f64::NAN), &mut cell)?);
            }
        }
        for &c in &columns.u {
            e.u.push(cell(c)?);
        }
        for (out, place) in [(&mut e.tau, &columns.tau), (&mut e.qref, &columns.qref)] {
            if let (Some(out), Some(place)) = (out, place) {
                for &c in place {
                    out.push(cell(c)?);
                }
            }
        }
        Ok(())
    }
}

/// A cell's value; NaN for an empty one.
fn number(file: &str, line: u64, column: &str, text: &str) -> Result<f64, DataError> {
    if text.is_empty() {
        return Ok(f64::NAN);
    }
    let place = || (file.to_owned(), column.to_owned(), text.to_owned());
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => {
            let (file, column, value) = place();
            Err(DataError::NotFinite {
                file,
                line,
                column,
                value,
            })
        }
        Err(_) => {
            let (file, column, value) = place();
            Err(DataError::NotANumber {
                file,
                line,
                column,
                value,
            })
        }
    }
}

fn compare_with_manifest(
    file: &str,
    listed: &Listed,
    experiment: &Experiment,
    warnings: &mut Vec<DataWarning>,
) {
    if let Some(stated) = listed.samples
        && stated != experiment.len()
    {
        let found = experiment.len();
        warnings.push(DataWarning::SampleCount {
            file: file.to_owned(),
            found,
            stated,
        });
    }
    if let Some(stated) = listed.sample_time {
        let found = experiment.sample_time();
        if (found - stated).abs() > 0.01 * stated.abs() {
            warnings.push(DataWarning::SampleTime {
                file: file.to_owned(),
                found,
                stated,
            });
        }
    }
    if experiment.missing > 0 {
        let count = experiment.missing;
        warnings.push(DataWarning::Missing {
            file: file.to_owned(),
            count,
        });
    }
}
