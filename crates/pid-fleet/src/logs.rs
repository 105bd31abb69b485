//! Which logs a fleet has: of which unit each is, and of when.
//!
//! A manifest says it: a CSV file with the columns `unit`, `time` and `log`, paths relative to its folder. A folder
//! says it by names: the folders in it are the units, and the last date in the path of a log below its unit is its
//! time.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::FleetError;
use crate::plan::Job;

/// Endings of logs in a folder.
const ENDINGS: [&str; 7] = ["csv", "mcap", "db3", "parquet", "npz", "mat", "bag"];
/// Files that make a folder one log.
const ONE_LOG: [&str; 2] = ["dataset.toml", "metadata.yaml"];

/// The logs of a fleet, and whether their times are dates (days since 1970-01-01).
///
/// # Errors
/// A manifest with a mistake, a log without a date, a place without logs.
pub fn find(places: &[PathBuf]) -> Result<(Vec<Job>, bool), FleetError> {
    let mut jobs: Vec<Job> = Vec::new();
    let mut kind = None;
    for place in places {
        let before = jobs.len();
        match place.is_dir() {
            true => {
                jobs.extend(of_folder(place)?);
                same(&mut kind, true, place, 0)?;
            }
            false => manifest(place, &mut jobs, &mut kind)?,
        }
        if jobs.len() == before {
            return Err(FleetError::NoLogs {
                path: place.clone(),
            });
        }
    }
    Ok((jobs, kind.unwrap_or(false)))
}

/// A line of a manifest.
#[derive(Deserialize)]
struct Line {
    unit: String,
    time: String,
    log: PathBuf,
}

fn manifest(path: &Path, jobs: &mut Vec<Job>, kind: &mut Option<bool>) -> Result<(), FleetError> {
    let wrong = |line: u64, reason: String| FleetError::Manifest {
        path: path.to_owned(),
        line,
        reason,
    };
    let file = fs::File::open(path).map_err(|e| wrong(1, format!("cannot be read: {e}")))?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut rows = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(file);
    for (row, line) in rows.deserialize::<Line>().zip(2_u64..) {
        let row = row.map_err(|e| wrong(line, e.to_string()))?;
        let (time, date) = match (row.time.parse::<f64>(), date(&row.time)) {
            (Ok(number), _) if number.is_finite() => (number, false),
            (_, Some(days)) => (days, true),
            _ => return Err(wrong(line, format!("`{}` is no time", row.time))),
        };
        same(kind, date, path, line)?;
        let log = folder.join(&row.log);
        let log = fs::canonicalize(&log)
            .map_err(|e| wrong(line, format!("{}: cannot be read: {e}", log.display())))?;
        jobs.push(Job {
            unit: row.unit,
            time,
            log,
        });
    }
    Ok(())
}

/// Refuses dates beside numbers.
fn same(kind: &mut Option<bool>, date: bool, path: &Path, line: u64) -> Result<(), FleetError> {
    match kind.replace(date) {
        Some(before) if before != date => Err(FleetError::Manifest {
            path: path.to_owned(),
            line,
            reason: "dates and numbers stand side by side".to_owned(),
        }),
        _ => Ok(()),
    }
}

fn of_folder(root: &Path) -> Result<Vec<Job>, FleetError> {
    let mut jobs = Vec::new();
    for unit in listed(root)?.into_iter().filter(|p| p.is_dir()) {
        let name = unit.file_name().unwrap_or_default().to_string_lossy();
        let mut logs = Vec::new();
        below(&unit, &mut logs)?;
        for log in logs {
            let words = log.strip_prefix(&unit).unwrap_or(&log).to_string_lossy();
            let time = date(&words).ok_or_else(|| FleetError::NoDate { path: log.clone() })?;
            let log = fs::canonicalize(&log).map_err(|_| FleetError::NoLogs { path: log })?;
            jobs.push(Job {
                unit: name.clone().into_owned(),
                time,
                log,
            });
        }
    }
    Ok(jobs)
}

/// Logs in a folder and those below it, by name.
fn below(folder: &Path, logs: &mut Vec<PathBuf>) -> Result<(), FleetError> {
    for path in listed(folder)? {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        let whole = ONE_LOG.iter().any(|name| path.join(name).is_file());
        match path.is_dir() {
            true if !whole => below(&path, logs)?,
            false if !ENDINGS.iter().any(|e| *e == ending) => {}
            _ => logs.push(path),
        }
    }
    Ok(())
}

fn listed(folder: &Path) -> Result<Vec<PathBuf>, FleetError> {
    let all = fs::read_dir(folder).and_then(|all| all.map(|e| e.map(|e| e.path())).collect());
    let mut all: Vec<PathBuf> = all.map_err(|_| FleetError::NoLogs {
        path: folder.to_owned(),
    })?;
    all.sort();
    Ok(all)
}

/// The last date in a text, in days since 1970-01-01: `2026-01-31` or `20260131`, with the time of day behind it if it
/// is there (`T08:30`, `_08-30-15`, `_083015`).
fn date(text: &str) -> Option<f64> {
    let bytes = text.as_bytes();
    (0..bytes.len()).rev().find_map(|at| {
        let fresh = at == 0 || !bytes[at - 1].is_ascii_digit();
        fresh.then(|| date_at(&bytes[at..])).flatten()
    })
}

fn date_at(text: &[u8]) -> Option<f64> {
    let (year, rest) = digits(text, 4)?;
    let dashed = rest.first() == Some(&b'-');
    let skip = |rest: &[u8]| -> Option<usize> {
        match (dashed, rest.first()) {
            (true, Some(b'-')) => Some(1),
            (true, _) => None,
            (false, _) => Some(0),
        }
    };
    let (month, rest) = digits(&rest[skip(rest)?..], 2)?;
    let (day, rest) = digits(&rest[skip(rest)?..], 2)?;
    let day = days(year, month, day)?;
    Some(day as f64 + time_of_day(rest).unwrap_or(0.0))
}

/// Share of a day: hours, minutes and perhaps seconds behind a `T`, `_` or space.
fn time_of_day(text: &[u8]) -> Option<f64> {
    let text = match text.first()? {
        b'T' | b't' | b'_' | b' ' => &text[1..],
        _ => return None,
    };
    let past = |rest: &[u8]| usize::from(matches!(rest.first(), Some(b':' | b'-')));
    let (hours, rest) = digits(text, 2)?;
    let (minutes, rest) = digits(&rest[past(rest)..], 2)?;
    let seconds = digits(&rest[past(rest)..], 2).map_or(0, |s| s.0);
    let valid = hours < 24 && minutes < 60 && seconds < 60;
    valid.then_some((3600 * hours + 60 * minutes + seconds) as f64 / 86_400.0)
}

/// A number of so many digits, and what follows.
fn digits(text: &[u8], count: usize) -> Option<(i64, &[u8])> {
    let own = text.get(..count)?;
    let number = own.iter().try_fold(0, |n, c| {
        c.is_ascii_digit().then(|| 10 * n + i64::from(c - b'0'))
    })?;
    Some((number, &text[count..]))
}

/// Days since 1970-01-01 of a day of the Gregorian calendar; `None` if there is no such day.
fn days(year: i64, month: i64, day: i64) -> Option<i64> {
    let leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    let lengths = [
        31,
        28 + i64::from(leap),
        31,
        30,
        31,
        30,
        31,
        31,
        30,
        31,
        30,
        31,
    ];
    let before: i64 = lengths
        .get(..usize::try_from(month - 1).ok()?)?
        .iter()
        .sum();
    let length = *lengths.get(usize::try_from(month - 1).ok()?)?;
    let past = year - 1;
    let leaps = past.div_euclid(4) - past.div_euclid(100) + past.div_euclid(400);
    // 719 162 days lie before 1970.
    (1..=length)
        .contains(&day)
        .then(|| 365 * past + leaps + before + day - 1 - 719_162)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_read_from_names() {
        let day =
            |text: &str| date(text).map(|d| pid_page::Date::of_day(d.floor() as i64).to_string());
        for (text, expected) in [
            ("2026-01-31", Some("2026-01-31")),
            ("arm7/2024-02-29_run3.csv", Some("2024-02-29")),
            ("log_20261125_083000.mcap", Some("2026-11-25")),
            ("2026-01-31/2026-02-01.csv", Some("2026-02-01")),
            ("1969-12-31", Some("1969-12-31")),
            ("2023-02-29", None),
            ("2026-1-31", None),
            ("run3.csv", None),
            ("2026-13-01", None),
        ] {
            assert_eq!(day(text).as_deref(), expected, "{text}");
        }
        let share = |text: &str| date(text).map(|d| d.fract());
        assert_eq!(share("2026-01-31T12:00"), Some(0.5));
        assert_eq!(share("2026-01-31_06-00-00"), Some(0.25));
        assert_eq!(share("20260131 180000"), Some(0.75));
        assert_eq!(share("2026-01-31_run3"), Some(0.0));
    }

    fn written(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(&path, text).expect("written");
        path
    }

    #[test]
    fn a_folder_and_a_manifest_name_the_same_logs() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        written(at, "all/a/2026-01-01.csv", "");
        written(at, "all/a/2026-02-01/dataset.toml", "");
        written(at, "all/a/2026-02-01/x.csv", "");
        written(at, "all/b/deep/2026-01-03.csv", "");
        written(at, "all/b/notes.txt", "");
        let (jobs, dates) = find(&[at.join("all")]).expect("logs");
        assert!(dates);
        let short: Vec<(&str, f64)> = jobs.iter().map(|j| (j.unit.as_str(), j.time)).collect();
        assert_eq!(short, [("a", 20_454.0), ("a", 20_485.0), ("b", 20_456.0)]);
        let text = "unit,time,log\na, 2026-01-01, all/a/2026-01-01.csv\na,2026-02-01,all/a/2026-02-01\nb,2026-01-03,all/b/deep/2026-01-03.csv\n";
        let list = written(at, "fleet.csv", text);
        assert_eq!(find(&[list]).expect("logs"), (jobs, true));
    }

    #[test]
    fn mistakes_are_told_with_their_place() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        written(at, "x.csv", "");
        let told = |text: &str| {
            let list = written(at, "fleet.csv", text);
            find(&[list]).expect_err(text).to_string()
        };
        assert!(told("unit,time,log\na,soon,x.csv\n").contains("fleet.csv:2: `soon` is no time"));
        assert!(
            told("unit,time,log\na,1,x.csv\na,2026-01-01,x.csv\n")
                .contains(":3: dates and numbers")
        );
        assert!(told("unit,time,log\na,1,y.csv\n").contains("y.csv: cannot be read"));
        assert!(told("unit,log\na,x.csv\n").contains("missing field `time`"));
        assert!(told("unit,time,log\n").contains("no logs of units"));
        written(at, "all/a/run.csv", "");
        let dateless = find(&[at.join("all")]).expect_err("no date").to_string();
        assert!(dateless.contains("run.csv: no date"), "{dateless}");
    }
}
