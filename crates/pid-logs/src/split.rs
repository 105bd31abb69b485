//! Which records are fitted and which judge, and their names.

use std::collections::BTreeSet;
use std::path::Path;

use pid_data::Role;

use crate::error::LogError;
use crate::record::Record;
use crate::settings::{Sentences, Settings};

/// A record shorter than this is not parted: a third of it says nothing.
const SHORTEST: usize = 12;

/// Records with their roles; names differ.
pub(crate) fn split(
    mut records: Vec<Record>,
    settings: &Settings,
    said: &mut Sentences,
) -> Result<Vec<(Record, Role)>, LogError> {
    name(&mut records, said);
    if !settings.test.is_empty() {
        return stated(records, settings);
    }
    if records.len() > 1 {
        let test = (records.len() / 4).max(1);
        let train = records.len() - test;
        let role = |i: usize| if i < train { Role::Train } else { Role::Test };
        let to_fit = if train == 1 {
            "1 record is".to_owned()
        } else {
            format!("{train} records are")
        };
        let last = if test == 1 {
            "the last one".to_owned()
        } else {
            format!("the last {test}")
        };
        said.say("", format!("{to_fit} to fit on and {last} to judge with: a quarter at the end, one at least, since no split is stated"));
        return Ok(records
            .into_iter()
            .enumerate()
            .map(|(i, r)| (r, role(i)))
            .collect());
    }
    let Some(record) = records.pop() else {
        return Ok(Vec::new());
    };
    if settings.whole || record.t.len() < SHORTEST {
        return Ok(vec![(record, Role::Train)]);
    }
    let cut = slowest(&record);
    said.say(
        &record.file,
        format!("the record is cut at {} s, where the robot is slowest near two thirds of the time: the part before is to fit on, the rest to judge with", record.t[cut]),
    );
    let (train, test) = (
        part(&record, 0, cut, "train"),
        part(&record, cut, record.t.len(), "test"),
    );
    Ok(vec![(train, Role::Train), (test, Role::Test)])
}

/// Roles as the user states them.
fn stated(records: Vec<Record>, settings: &Settings) -> Result<Vec<(Record, Role)>, LogError> {
    let names: Vec<String> = records.iter().map(|r| r.name.clone()).collect();
    if let Some(test) = settings.test.iter().find(|t| !names.contains(t)) {
        return Err(LogError::Map {
            place: format!("--test {test}"),
            what: format!("no record named `{test}`"),
            mend: pid_toml::one_of(test, names.iter().map(String::as_str)),
        });
    }
    let role = |r: &Record| {
        if settings.test.contains(&r.name) {
            Role::Test
        } else {
            Role::Train
        }
    };
    Ok(records
        .into_iter()
        .map(|r| (role(&r), r))
        .map(|(role, r)| (r, role))
        .collect())
}

/// The row near two thirds of the time where the robot is slowest.
fn slowest(record: &Record) -> usize {
    let n = record.t.len();
    let (start, end) = (record.t[0], record.t[n - 1]);
    let at = |share: f64| {
        record
            .t
            .partition_point(|&t| t < start + share * (end - start))
    };
    // A little more than a fortieth of the record around each row, against the steps of encoders.
    let span = (n / 80).max(1);
    let (low, high) = (
        at(0.6).clamp(span, n - 1 - span),
        at(0.75).clamp(span, n - 1 - span),
    );
    let ranges: Vec<f64> = record
        .q
        .iter()
        .map(|q| {
            let finite = || q.iter().copied().filter(|v| v.is_finite());
            finite().fold(f64::MIN, f64::max) - finite().fold(f64::MAX, f64::min)
        })
        .collect();
    let speed = |i: usize| -> f64 {
        let step = record.t[i + span] - record.t[i - span];
        let moves = record
            .q
            .iter()
            .zip(&ranges)
            .filter(|(_, range)| **range > 0.0);
        let speeds = moves.map(|(q, range)| ((q[i + span] - q[i - span]) / (range * step)).powi(2));
        speeds.filter(|s| s.is_finite()).sum()
    };
    let middle = at(2.0 / 3.0);
    let rows = low..=high.max(low);
    rows.min_by(|&a, &b| {
        speed(a)
            .total_cmp(&speed(b))
            .then(a.abs_diff(middle).cmp(&b.abs_diff(middle)))
    })
    .unwrap_or(middle)
    .clamp(2, n - 2)
}

fn part(record: &Record, from: usize, to: usize, suffix: &str) -> Record {
    let cut = |x: &Vec<f64>| x[from..to].to_vec();
    let all = |x: &Vec<Vec<f64>>| x.iter().map(cut).collect();
    Record {
        file: record.file.clone(),
        name: format!("{}_{suffix}", record.name),
        t: cut(&record.t),
        q: all(&record.q),
        v: record.v.iter().map(|v| v.as_ref().map(cut)).collect(),
        u: all(&record.u),
        tau: record.tau.as_ref().map(all),
        qref: record.qref.as_ref().map(all),
    }
}

/// Gives records names that are file names and differ.
fn name(records: &mut [Record], said: &mut Sentences) {
    let mut seen = BTreeSet::new();
    for record in records {
        let plain = |text: &str| -> String {
            text.chars()
                .map(|c| {
                    if c.is_alphanumeric() || matches!(c, '-' | '_') {
                        c
                    } else {
                        '_'
                    }
                })
                .collect()
        };
        let base = Some(plain(&record.name))
            .filter(|n| !n.is_empty())
            .unwrap_or_else(|| "log".to_owned());
        let parent = Path::new(&record.file)
            .parent()
            .and_then(Path::file_name)
            .and_then(std::ffi::OsStr::to_str);
        let with_parent = parent.map(|p| format!("{}_{base}", plain(p)));
        let numbered = (2..).map(|k| format!("{base}_{k}"));
        // File systems without case: names differ without it.
        let candidates = [base.clone()]
            .into_iter()
            .chain(with_parent)
            .chain(numbered);
        let chosen = candidates
            .into_iter()
            .find(|c| seen.insert(c.to_lowercase()));
        let chosen = chosen.unwrap_or_else(|| base.clone());
        if chosen != base {
            said.say(
                &record.file,
                format!("the record is called `{chosen}`, since another one is `{base}`"),
            );
        }
        record.name = chosen;
    }
}
