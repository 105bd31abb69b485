//! LeRobot data sets of version 2 and 3: names of `observation.state` and `action` in
//! `meta/info.json`, samples in `data/chunk-*/*.parquet`, one experiment for each episode.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::{broken, guarded, parquet};
use crate::error::LogError;
use crate::log::{Channel, Hint, Log};
use crate::names::{quantity_of, words};

/// Features that hold joints: what they are where their names do not say it.
const FEATURES: [(&str, Hint); 2] = [
    ("observation.state", Hint::Position),
    ("action", Hint::Target),
];

/// Reads a LeRobot folder.
pub(super) fn read(folder: &Path) -> Result<Vec<Log>, LogError> {
    let meta = folder.join("meta").join("info.json");
    let name = meta.display().to_string();
    let text = std::fs::read_to_string(&meta).map_err(|error| LogError::File {
        file: name.clone(),
        action: "read",
        error,
    })?;
    let info: Value = serde_json::from_str(&text).map_err(|e| broken(&name, "LeRobot", e))?;
    let files = data_files(folder)?;
    let mut logs: Vec<Log> = Vec::new();
    for file in &files {
        let file_name = file.display().to_string();
        let bytes = std::fs::read(file).map_err(|error| LogError::File {
            file: file_name.clone(),
            action: "read",
            error,
        })?;
        let read = guarded(&file_name, "Parquet", || parquet::read(&file_name, bytes))?;
        for mut log in read {
            rename(&mut log, &info);
            match logs.last_mut() {
                // An episode that goes on in the next file.
                Some(last)
                    if last.name == log.name && last.channels.len() == log.channels.len() =>
                {
                    append(last, log)
                }
                _ => logs.push(log),
            }
        }
    }
    if logs.is_empty() {
        return Err(LogError::Empty {
            file: folder.display().to_string(),
            what: "there is no file data/chunk-*/*.parquet".to_owned(),
            mend: "download the whole data set; videos are not needed".to_owned(),
        });
    }
    Ok(logs)
}

/// `data/chunk-*/*.parquet`, sorted.
fn data_files(folder: &Path) -> Result<Vec<PathBuf>, LogError> {
    let list = |path: &Path| -> Result<Vec<PathBuf>, LogError> {
        let entries = std::fs::read_dir(path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let entries = entries.map_err(|error| LogError::File {
            file: path.display().to_string(),
            action: "read",
            error,
        })?;
        let mut paths: Vec<PathBuf> = entries.iter().map(std::fs::DirEntry::path).collect();
        paths.sort();
        Ok(paths)
    };
    let mut files = Vec::new();
    for chunk in list(&folder.join("data"))? {
        if chunk.is_dir() {
            let parquet = |p: &PathBuf| p.extension().is_some_and(|e| e == "parquet");
            files.extend(list(&chunk)?.into_iter().filter(parquet));
        }
    }
    Ok(files)
}

/// Gives the elements of states and actions their names: `observation.state/elbow.pos`.
fn rename(log: &mut Log, info: &Value) {
    for (feature, hint) in FEATURES {
        let names = names_of(&info["features"][feature]["names"]);
        let mut said = false;
        for channel in &mut log.channels {
            let Some(index) = index_within(&channel.name, feature) else {
                continue;
            };
            if let Some(name) = names.get(index) {
                channel.name = format!("{feature}/{name}");
            }
            let silent = |c: &Channel| {
                let spoken = c.name.strip_prefix(feature).unwrap_or(&c.name);
                !words(spoken).iter().any(|w| quantity_of(w).is_some())
            };
            if silent(channel) {
                channel.hint = Some(hint);
                said = true;
            }
        }
        if said {
            let what = match hint {
                Hint::Position => "measured positions",
                Hint::Target => "commanded positions",
            };
            log.notes.push(format!(
                "`{feature}` does not name its quantity: {what}, as LeRobot records by default"
            ));
        }
    }
}

/// `i` of `feature[i]`.
fn index_within(name: &str, feature: &str) -> Option<usize> {
    name.strip_prefix(feature)?
        .strip_prefix('[')?
        .strip_suffix(']')?
        .parse()
        .ok()
}

/// Names as a list, or as a table of lists.
fn names_of(value: &Value) -> Vec<String> {
    match value {
        Value::Array(list) => list
            .iter()
            .filter_map(Value::as_str)
            .map(str::to_owned)
            .collect(),
        Value::Object(table) => table.values().flat_map(names_of).collect(),
        _ => Vec::new(),
    }
}

fn append(log: &mut Log, next: Log) {
    for (channel, more) in log.channels.iter_mut().zip(next.channels) {
        let shift = more.offset - channel.offset;
        channel.values.extend(more.values.iter().map(|v| v + shift));
    }
    for (clock, more) in log.clocks.iter_mut().zip(next.clocks) {
        clock.rows += more.rows;
    }
}
