//! One record: header, rows, and what the manifest says of it.

use super::columns::find_columns;
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

    let nq = joints.len();
    let rows = text.bytes().filter(|b| *b == b'\n').count();
    let channel = || Vec::with_capacity(rows * nq);
    let mut t: Vec<f64> = Vec::with_capacity(rows);
    let (mut q, mut u) = (channel(), channel());
    let mut v = columns.v.iter().any(Option::is_some).then(channel);
    let mut tau = columns.tau.is_some().then(channel);
    let mut qref = columns.qref.is_some().then(channel);
    let mut missing = 0;
    let mut line = 1;
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(broken)? {
        line = record.position().map_or(line + 1, csv::Position::line);
        if record.len() != header.len() {
            return Err(DataError::CellCount {
                file: file.to_owned(),
                line,
                found: record.len(),
                expected: header.len(),
            });
        }
        let mut cell = |column: usize| -> Result<f64, DataError> {
            let value = number(file, line, &header[column], &record[column])?;
            missing += usize::from(value.is_nan());
            Ok(value)
        };

        let time = cell(columns.t)?;
        if time.is_nan() {
            return Err(DataError::MissingTime {
                file: file.to_owned(),
                line,
            });
        }
        if let Some(&previous) = t.last()
            && time <= previous
        {
            let file = file.to_owned();
            return Err(DataError::TimeNotIncreasing {
                file,
                line,
                value: time,
                previous,
            });
        }
        t.push(time);
        for &c in &columns.q {
            q.push(cell(c)?);
        }
        if let Some(v) = &mut v {
            for c in &columns.v {
                v.push(c.map_or(Ok(f64::NAN), &mut cell)?);
            }
        }
        for &c in &columns.u {
            u.push(cell(c)?);
        }
        for (out, place) in [(&mut tau, &columns.tau), (&mut qref, &columns.qref)] {
            if let (Some(out), Some(place)) = (out, place) {
                for &c in place {
                    out.push(cell(c)?);
                }
            }
        }
    }
    match t.len() {
        0 => return Err(empty("has a header but no samples")),
        1 => {
            return Err(DataError::OneSample {
                file: file.to_owned(),
                line,
            });
        }
        _ => {}
    }

    let experiment = Experiment {
        name: listed.name.clone(),
        role: listed.role,
        note: listed.note.clone(),
        nq,
        t,
        q,
        v,
        u,
        tau,
        qref,
        missing,
    };
    compare_with_manifest(file, listed, &experiment, &mut warnings);
    Ok((experiment, warnings))
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
