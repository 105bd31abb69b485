//! Reading a data set from a folder or from texts.

use std::borrow::Cow;
use std::path::Path;

use rayon::prelude::*;

use super::manifest::{self, Listed};
use super::{
    DataError, DataWarning, Dataset, Difference, Experiment, JointChannels, Role, VelocityKind,
    difference,
};

/// The manifest's file name.
const MANIFEST: &str = "dataset.toml";

/// Gives the text of a file, and the name to use for it in messages.
type Load<'a> = dyn Fn(&str) -> Result<(String, Cow<'a, str>), DataError> + Sync + 'a;

impl Dataset {
    /// Reads a data set from its folder; the files are read in parallel.
    ///
    /// # Errors
    /// The first thing that is wrong, with file, line, column and mend; see [`DataError`].
    pub fn read(folder: &Path) -> Result<Self, DataError> {
        load(&|name| {
            let path = folder.join(name);
            let file = path.display().to_string();
            match std::fs::read_to_string(&path) {
                Ok(text) => Ok((file, Cow::Owned(text))),
                Err(error) => Err(DataError::Unreadable { file, error }),
            }
        })
    }

    /// Reads a data set from texts: pairs of file name and content, `dataset.toml` among them.
    ///
    /// # Errors
    /// As [`Dataset::read`].
    pub fn from_embedded(files: &[(&str, &str)]) -> Result<Self, DataError> {
        load(&|name| match files.iter().find(|(file, _)| *file == name) {
            Some((file, text)) => Ok(((*file).to_owned(), Cow::Borrowed(*text))),
            None => Err(DataError::NotEmbedded {
                file: name.to_owned(),
            }),
        })
    }
}

fn load(load: &Load<'_>) -> Result<Dataset, DataError> {
    let (file, text) = load(MANIFEST)?;
    let manifest = manifest::parse(&file, &text)?;
    let read: Vec<(Experiment, Vec<DataWarning>)> = manifest
        .experiments
        .par_iter()
        .map(|listed| {
            let (file, text) = load(&listed.file)?;
            read_experiment(&file, &text, listed, &manifest.joints)
        })
        .collect::<Result<_, _>>()?;

    let mut experiments = Vec::with_capacity(read.len());
    let mut warnings = Vec::new();
    for (experiment, odd) in read {
        experiments.push(experiment);
        warnings.extend(odd);
    }
    warnings.extend(differences(&file, &experiments, &manifest.joints));
    for role in [Role::Train, Role::Test] {
        if !experiments.iter().any(|e| e.role == role) {
            warnings.push(DataWarning::NoExperiment { role });
        }
    }
    Ok(Dataset {
        name: manifest.name,
        title: manifest.title,
        source: manifest.source,
        license: manifest.license,
        kind: manifest.kind,
        input_hold: manifest.input_hold,
        joints: manifest.joints,
        experiments,
        warnings,
    })
}

/// Where each channel stands in a row.
struct Columns {
    t: usize,
    q: Vec<usize>,
    /// Per joint; `None` where the velocity is said to be absent. If all are `None`, so is `v`.
    v: Vec<Option<usize>>,
    u: Vec<usize>,
    tau: Option<Vec<usize>>,
    qref: Option<Vec<usize>>,
}

fn read_experiment(
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

/// Warns of velocities that count as measured but are differences of the positions, in all records
/// or in some.
fn differences(
    file: &str,
    experiments: &[Experiment],
    joints: &[JointChannels],
) -> Vec<DataWarning> {
    let nq = joints.len();
    let made = |e: &Experiment, j: usize| {
        let q = e.q.iter().skip(j).step_by(nq);
        let v = e.v.iter().flatten().skip(j).step_by(nq);
        let samples = e.t.iter().zip(q).zip(v);
        let samples: Vec<(f64, f64, f64)> = samples.map(|((t, q), v)| (*t, *q, *v)).collect();
        difference::made_by(&samples)
    };
    let measured = (0..nq).filter(|&j| joints[j].velocity == VelocityKind::Measured);
    measured
        .filter_map(|j| {
            let found = experiments.iter().filter_map(|e| made(e, j));
            let found: Vec<Difference> = found.collect();
            Some(DataWarning::VelocityIsDifference {
                file: file.to_owned(),
                joint: j + 1,
                difference: *found.first()?,
                records: found.len(),
                of: experiments.len(),
            })
        })
        .collect()
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

fn find_columns(
    file: &str,
    header: &[String],
    joints: &[JointChannels],
    warnings: &mut Vec<DataWarning>,
) -> Result<Columns, DataError> {
    for (i, name) in header.iter().enumerate() {
        if header[..i].contains(name) {
            return Err(DataError::DuplicateColumn {
                file: file.to_owned(),
                column: name.clone(),
            });
        }
    }
    let mut used = vec![false; header.len()];
    let mut find = |name: &str| {
        let place = header.iter().position(|h| h == name);
        if let Some(i) = place {
            used[i] = true;
        }
        place
    };
    let missing = |column: &str, reason: &'static str, help: String| DataError::MissingColumn {
        file: file.to_owned(),
        column: column.to_owned(),
        reason,
        help,
    };
    let has = format!(
        "the header has `{}`; add or rename a column",
        header.join(",")
    );

    let t = find("t").ok_or_else(|| missing("t", "time of the samples", has.clone()))?;
    let mut required = |stem: &str, reason: &'static str| -> Result<Vec<usize>, DataError> {
        (1..=joints.len())
            .map(|j| {
                let name = format!("{stem}{j}");
                find(&name).ok_or_else(|| missing(&name, reason, has.clone()))
            })
            .collect()
    };
    let q = required("q", "every joint needs its position")?;
    let u = required(
        "u",
        "every joint needs its input; write zeros for a joint without drive",
    )?;

    let mut v = Vec::with_capacity(joints.len());
    for (j, joint) in joints.iter().enumerate() {
        let name = format!("dq{}", j + 1);
        let place = find(&name);
        if joint.velocity == VelocityKind::Absent {
            if place.is_some() {
                warnings.push(DataWarning::VelocityNotUsed {
                    file: file.to_owned(),
                    column: name,
                });
            }
            v.push(None);
        } else if place.is_some() {
            v.push(place);
        } else {
            let help = "add the column, or write velocity = \"absent\" for this joint".to_owned();
            return Err(missing(
                &name,
                "dataset.toml says the velocity is recorded",
                help,
            ));
        }
    }

    let mut optional = |stem: &str| -> Result<Option<Vec<usize>>, DataError> {
        let places: Vec<Option<usize>> = (1..=joints.len())
            .map(|j| find(&format!("{stem}{j}")))
            .collect();
        if places.iter().all(Option::is_none) {
            return Ok(None);
        }
        let whole: Option<Vec<usize>> = places.iter().copied().collect();
        whole.map(Some).ok_or_else(|| {
            let gap = places.iter().position(Option::is_none).unwrap_or(0) + 1;
            let help =
                "add it (empty cells where nothing was recorded), or remove the others".to_owned();
            missing(&format!("{stem}{gap}"), "the other joints have one", help)
        })
    };
    let tau = optional("tau")?;
    let qref = optional("qref")?;

    for (name, used) in header.iter().zip(&used) {
        if !used {
            let column = name.clone();
            warnings.push(DataWarning::UnusedColumn {
                file: file.to_owned(),
                column,
            });
        }
    }
    Ok(Columns {
        t,
        q,
        v,
        u,
        tau,
        qref,
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    const TOML: &str = r#"
name = "arm"
title = "An arm"
source = "made up"
license = "CC0-1.0"
kind = "simulated"
input_hold = "linear"

[[joint]]
name = "shoulder"
type = "revolute"
input = "torque"
input_unit = "N*m"
velocity = "measured"

[[joint]]
name = "slide"
type = "prismatic"
input = "voltage"
input_unit = "V"
velocity = "absent"

[[experiment]]
file = "a.csv"
role = "train"
sample_time_s = 0.1
samples = 3
note = "short"

[[experiment]]
file = "b.csv"
role = "test"
"#;
    const CSV: &str = "t,q1,q2,dq1,u1,u2\n0,1,2,3,4,5\n0.1,1.5,2.5,,4.5,5.5\n0.2,2,3,3.5,5,6\n";

    fn read(toml: &str, csv: &str) -> Result<Dataset, DataError> {
        Dataset::from_embedded(&[("dataset.toml", toml), ("a.csv", csv), ("b.csv", CSV)])
    }

    #[test]
    fn reads_channels_row_by_row_and_counts_what_is_missing() {
        let d = read(TOML, CSV).unwrap();
        assert_eq!((d.nq(), d.input_hold), (2, super::super::InputHold::Linear));
        let e = &d.experiments[0];
        assert_eq!(
            (e.name.as_str(), e.role, e.note.as_str()),
            ("a", Role::Train, "short")
        );
        assert_eq!(e.t, [0.0, 0.1, 0.2]);
        assert_eq!(e.q, [1.0, 2.0, 1.5, 2.5, 2.0, 3.0]);
        assert_eq!(e.u, [4.0, 5.0, 4.5, 5.5, 5.0, 6.0]);
        let v = e.v.as_ref().unwrap();
        assert_eq!((v[0], v[4]), (3.0, 3.5));
        assert!(
            v[1].is_nan() && v[2].is_nan(),
            "absent channel and empty cell"
        );
        assert_eq!(e.missing, 1, "only the empty cell counts");
        assert!((e.sample_time() - 0.1).abs() < 1e-15);
        let w = e.window(1..3);
        assert_eq!((w.len(), w.q, w.t[0]), (2, &e.q[2..6], 0.1));
        // One empty cell in each of the two files.
        assert_eq!(d.warnings.len(), 2, "{:?}", d.warnings);
    }

    /// Each mistake gives an error whose text holds all of the pieces.
    fn check(result: Result<Dataset, DataError>, pieces: &[&str]) {
        let text = result.expect_err("must be refused").to_string();
        for piece in pieces.iter().chain(&["help:"]) {
            assert!(text.contains(piece), "{piece:?} not in: {text}");
        }
    }

    #[test]
    fn bad_records_name_file_line_column_value_and_mend() {
        let csv = |from: &str, to: &str| {
            assert!(CSV.contains(from));
            read(TOML, &CSV.replacen(from, to, 1))
        };
        check(
            csv("u2", "x2"),
            &["a.csv", "line 1", "`u2`", "every joint needs its input"],
        );
        check(
            csv("dq1", "w"),
            &["a.csv", "`dq1`", "velocity = \"absent\""],
        );
        check(csv("t,", "time,"), &["a.csv", "`t`"]);
        check(csv("dq1", "q1"), &["a.csv", "`q1`", "twice"]);
        check(
            csv("2.5", "2;5"),
            &["a.csv", "line 3", "`q2`", "`2;5` is not a number"],
        );
        check(
            csv("5.5", "NaN"),
            &["a.csv", "line 3", "`u2`", "`NaN` is not a finite number"],
        );
        check(csv("3.5", "-inf"), &["a.csv", "line 4", "`dq1`", "`-inf`"]);
        check(
            csv("0.2,", "0.05,"),
            &["a.csv", "line 4", "0.05 s", "0.1 s", "sort the rows"],
        );
        check(
            csv("0.2,", "0.1,"),
            &["a.csv", "line 4", "does not increase"],
        );
        check(csv("0.1,1.5", ",1.5"), &["a.csv", "line 3", "`t` is empty"]);
        check(
            csv("2.5,,", "2.5,"),
            &["a.csv", "line 3", "5 cells", "has 6"],
        );
        check(read(TOML, ""), &["a.csv", "is empty"]);
        check(read(TOML, "\n\n"), &["a.csv", "is empty"]);
        check(read(TOML, "t,q1,q2,dq1,u1,u2\n"), &["a.csv", "no samples"]);
        check(
            read(TOML, "t,q1,q2,dq1,u1,u2\n0,1,2,3,4,5\n"),
            &["a.csv", "line 2", "two samples"],
        );
        check(
            csv("u2", "u2,tau1"),
            &["a.csv", "`tau2`", "the other joints have one"],
        );
    }

    #[test]
    fn bad_manifests_name_the_key_and_its_values() {
        let toml = |from: &str, to: &str| {
            assert!(TOML.contains(from));
            read(&TOML.replacen(from, to, 1), CSV)
        };
        check(
            toml("\"V\"", "\"furlong\""),
            &["joint `slide`", "input_unit `furlong`", "`N*m`"],
        );
        check(
            toml("\"V\"", "\"A\""),
            &["`slide`", "voltage", "in V", "`A`"],
        );
        check(
            toml("\"train\"", "\"fit\""),
            &["experiment `a.csv`", "role `fit`", "`train`"],
        );
        check(
            toml("\"revolute\"", "\"revolut\""),
            &[
                "joint `shoulder`",
                "type `revolut`",
                "did you mean `revolute`?",
            ],
        );
        check(toml("\"linear\"", "\"cubic\""), &["input_hold `cubic`"]);
        check(toml("kind = \"simulated\"", ""), &["dataset.toml", "kind"]);
        check(
            toml("name = \"arm\"", "name = \"arm"),
            &["dataset.toml:2:12: ", "  2 | name = \"arm"],
        );
        check(
            toml("note =", "remark ="),
            &[
                "dataset.toml:28:1: unknown field `remark`",
                "use one of `file`",
            ],
        );
        check(
            toml("samples = 3", "sample = 3"),
            &["unknown field `sample`", "did you mean `samples`?"],
        );
        check(
            toml("samples = 3", "samples = \"3\""),
            &["samples = \"3\"", "write a whole number"],
        );
        check(
            toml("\"slide\"", "\"shoulder\""),
            &["joint `shoulder`", "twice"],
        );
        check(toml("b.csv", "c.csv"), &["c.csv", "not among the embedded"]);
        let none = TOML.split("[[experiment]]").next().unwrap();
        check(read(none, CSV), &["no experiment listed", "[[experiment]]"]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        check(
            Dataset::read(Path::new("no/such/folder")),
            &["no/such/folder", "dataset.toml"],
        );
    }

    #[test]
    fn odd_but_usable_data_give_warnings() {
        let toml = TOML
            .replace("samples = 3", "samples = 4")
            .replace("0.1", "0.2");
        let csv = CSV
            .replace("u2\n", "u2,temperature\n")
            .replace("5\n", "5,20\n")
            .replace("6\n", "6,20\n");
        let d = read(&toml, &csv).unwrap();
        let text: Vec<String> = d.warnings.iter().map(ToString::to_string).collect();
        for piece in [
            "3 samples, dataset.toml says 4",
            "`temperature` is not used",
            "0.1 s",
            "1 empty",
        ] {
            assert!(text.iter().any(|w| w.contains(piece)), "{piece}: {text:?}");
        }
    }

    #[test]
    fn a_measured_velocity_that_is_a_difference_is_named() {
        let mut csv = "t,q1,q2,dq1,u1,u2\n0,0,2,0,4,5\n".to_owned();
        let q = |k: i32| f64::from(k).powi(2).sin();
        for k in 1..40 {
            let v = (q(k) - q(k - 1)) / 0.5;
            csv += &format!("{},{},2,{v},4,5\n", 0.5 * f64::from(k), q(k));
        }
        let toml = TOML.replace("samples = 3\n", "").replace("0.1", "0.5");
        let told = |toml: &str| read(toml, &csv).unwrap().warnings;
        let velocity = |w: &&DataWarning| matches!(w, DataWarning::VelocityIsDifference { .. });
        let warned = told(&toml);
        let warned: Vec<String> = warned
            .iter()
            .filter(velocity)
            .map(ToString::to_string)
            .collect();
        assert_eq!(
            warned,
            [
                "dataset.toml: joint 1: velocity = \"measured\", but `dq1` is the backward difference of `q1` (1 of 2 records)\n  help: write \
             velocity = \"derived\": it tells nothing that the positions do not"
            ]
        );
        let stated = told(&toml.replace("measured", "derived"));
        assert!(!stated.iter().any(|w| velocity(&w)));
    }

    #[test]
    fn windows_line_ends_and_a_byte_order_mark_do_not_matter() {
        let csv = format!("\u{feff}{}", CSV.replace('\n', "\r\n"));
        assert_eq!(read(TOML, &csv).unwrap().experiments[0].t, [0.0, 0.1, 0.2]);
    }
}
