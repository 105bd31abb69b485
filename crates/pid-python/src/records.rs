//! Records of a robot from files, frames and arrays.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use simtrue::cli::open::{self, HoldArg, InputArg, OpenArgs};
use simtrue::data::{Experiment, GainRule, InputQuantity, Role};
use simtrue::logs::{Channel, Clock, Entry, Found, Joint, Kind, Log};

use crate::arrays::{array, integers, reals};
use crate::error::raised;
use crate::robot::Robot;
use crate::work::{Stops, run};

/// Records in SI units, and what was assumed of them.
#[pyclass(frozen, module = "simtrue")]
pub(crate) struct Records {
    pub(crate) found: Arc<Found>,
}

/// Columns of a table: names, units where the table says them, numbers, and whether these are whole.
type Columns = Vec<(String, Option<String>, Vec<u8>, bool)>;

/// A record by arrays: times, and channels by the word of their column, one column per joint.
#[derive(FromPyObject)]
pub(crate) struct Arrays {
    #[pyo3(item)]
    name: String,
    #[pyo3(item)]
    t: Vec<u8>,
    #[pyo3(item)]
    channels: Vec<(String, Vec<u8>)>,
}

/// Where records come from.
#[derive(FromPyObject)]
pub(crate) enum Source {
    File(PathBuf),
    Table((String, Columns)),
    Arrays(Arrays),
}

/// Sources as logs, with entries of a map for those that need no names.
#[derive(Default)]
struct Logs {
    files: Vec<PathBuf>,
    /// Logs, each before the file of this number.
    logs: Vec<(usize, Log)>,
    map: Vec<Entry>,
}

impl Logs {
    fn add(&mut self, source: Source, joints: &[Joint], input: Option<InputArg>) -> PyResult<()> {
        match source {
            Source::File(path) => self.files.push(path),
            Source::Table((name, columns)) => {
                self.logs.push((self.files.len(), table(&name, columns)))
            }
            Source::Arrays(arrays) => {
                let log = self.arrays(&arrays, joints, input)?;
                self.logs.push((self.files.len(), log));
            }
        }
        Ok(())
    }

    /// Columns in the order of the joints.
    fn arrays(
        &mut self,
        arrays: &Arrays,
        joints: &[Joint],
        input: Option<InputArg>,
    ) -> PyResult<Log> {
        let t = reals(&arrays.t);
        let rows = t.len().max(1);
        let mut log = Log::new(&arrays.name);
        log.clocks = vec![Clock {
            rows: t.len(),
            t: Some(t),
            ..Clock::default()
        }];
        for (word, values) in &arrays.channels {
            let values = reals(values);
            let columns = values.len() / rows;
            if columns != joints.len() {
                let names: Vec<&str> = joints.iter().map(|j| j.name.as_str()).collect();
                return Err(raised(format!(
                    "{}: `{word}` has {columns} columns, the robot {} joints: {}\n  help: give one column per joint, base to tip",
                    arrays.name,
                    joints.len(),
                    names.join(", ")
                )));
            }
            let kind = match word.as_str() {
                "q" => Kind::Position,
                "v" => Kind::Velocity,
                "tau_sensor" => Kind::Sensor,
                "qref" => Kind::Target,
                _ => Kind::Input,
            };
            for (j, joint) in joints.iter().enumerate() {
                let name = format!("{word} of {}", joint.name);
                let entry = Entry {
                    kind,
                    joint: Some(joint.name.clone()),
                    column: name.clone(),
                    unit: Some(unit(word, joint, input).to_owned()),
                    place: format!("{}: `{word}`", arrays.name),
                };
                if !self.map.iter().any(|e| e.column == name) {
                    self.map.push(entry);
                }
                let column = values.iter().skip(j).step_by(columns).copied().collect();
                log.channels.push(Channel::new(name, 0, column));
            }
        }
        Ok(log)
    }

    /// Reads the files and puts the logs in their order.
    fn read(self) -> Result<Vec<Log>, simtrue::logs::LogError> {
        let mut all = Vec::new();
        let mut logs = self.logs.into_iter().peekable();
        for (k, file) in self.files.iter().enumerate() {
            while let Some((_, log)) = logs.next_if(|(before, _)| *before <= k) {
                all.push(log);
            }
            all.extend(simtrue::logs::open(file)?);
        }
        all.extend(logs.map(|(_, log)| log));
        Ok(all)
    }
}

/// The unit of a column of arrays; `u` is what the call or the description says, or acts at the joint.
fn unit(word: &str, joint: &Joint, input: Option<InputArg>) -> &'static str {
    let force = match joint.prismatic {
        true => InputQuantity::Force,
        false => InputQuantity::Torque,
    };
    match (word, joint.prismatic) {
        ("q" | "qref", true) => "m",
        ("q" | "qref", false) => "rad",
        ("v", true) => "m/s",
        ("v", false) => "rad/s",
        ("u", _) => match input {
            Some(InputArg::Torque) => force.unit(),
            Some(InputArg::Current) => InputQuantity::Current.unit(),
            Some(InputArg::Voltage) => InputQuantity::Voltage.unit(),
            None => joint.input.unwrap_or(force).unit(),
        },
        _ => force.unit(),
    }
}

fn table(name: &str, columns: Columns) -> Log {
    let mut log = Log::new(name);
    let mut rows = 0;
    for (name, unit, values, whole) in columns {
        let mut channel = match whole {
            false => Channel::new(name, 0, reals(&values)),
            true => {
                let values: Vec<Option<i64>> = integers(&values).into_iter().map(Some).collect();
                Channel::of_integers(name, 0, &values)
            }
        };
        channel.unit = unit;
        rows = channel.values.len();
        log.channels.push(channel);
    }
    log.clocks = vec![Clock {
        rows,
        ..Clock::default()
    }];
    log
}

/// Reads sources as records of a robot.
#[pyfunction]
#[pyo3(signature = (robot, sources, *, map=None, map_file=None, input=None, gain=None, input_hold=None, targets=false, gain_factor=None, passive=false, test=None, sample_time=None))]
#[allow(clippy::too_many_arguments)] // keyword arguments of Python
pub(crate) fn read(
    py: Python<'_>,
    robot: &Robot,
    sources: Vec<Source>,
    map: Option<Vec<String>>,
    map_file: Option<PathBuf>,
    input: Option<&str>,
    gain: Option<Vec<f64>>,
    input_hold: Option<&str>,
    targets: bool,
    gain_factor: Option<Vec<String>>,
    passive: bool,
    test: Option<Vec<String>>,
    sample_time: Option<f64>,
) -> PyResult<Records> {
    let robot = robot.read.clone();
    let joints = robot.joints();
    let input = input.map(quantity).transpose()?;
    let mut logs = Logs::default();
    for source in sources {
        logs.add(source, &joints, input)?;
    }
    let stated = map.unwrap_or_default();
    let mut map = stated
        .iter()
        .map(|text| Entry::parse(text).map_err(raised))
        .collect::<PyResult<Vec<Entry>>>()?;
    map.append(&mut logs.map);
    let args = OpenArgs {
        map,
        map_file,
        input,
        gain: finite("gain", gain.unwrap_or_default())?,
        input_hold: input_hold.map(hold).transpose()?,
        targets,
        gain_factor: rules(gain_factor.unwrap_or_default())?,
        passive,
        test: test.unwrap_or_default(),
        sample_time: positive("sample_time", sample_time)?,
        ..OpenArgs::default()
    };
    let (found, _) = run(py, Stops::Never, None, move |_| {
        open_all(&robot, logs, &args)
    })?;
    Ok(Records {
        found: Arc::new(found),
    })
}

fn open_all(robot: &open::Robot, logs: Logs, args: &OpenArgs) -> Result<Found, String> {
    if let ([folder], []) = (logs.files.as_slice(), logs.logs.as_slice())
        && folder.join("dataset.toml").is_file()
    {
        return robot.folder(folder, args).map_err(|e| e.to_string());
    }
    let logs = logs.read().map_err(|e| e.to_string())?;
    robot.records(&logs, args).map_err(|e| e.to_string())
}

/// Factors of gains by record.
fn rules(texts: Vec<String>) -> PyResult<Vec<GainRule>> {
    let rule = |text: &String| {
        text.parse()
            .map_err(|why| raised(format!("gain_factor: {why}")))
    };
    texts.iter().map(rule).collect()
}

fn quantity(word: &str) -> PyResult<InputArg> {
    match word {
        "torque" => Ok(InputArg::Torque),
        "current" => Ok(InputArg::Current),
        "voltage" => Ok(InputArg::Voltage),
        other => Err(raised(format!(
            "input: `{other}` is no input of a drive\n  help: use 'torque', 'current' or 'voltage'"
        ))),
    }
}

fn hold(word: &str) -> PyResult<HoldArg> {
    match word {
        "linear" => Ok(HoldArg::Linear),
        "zero-order" => Ok(HoldArg::ZeroOrder),
        other => Err(raised(format!(
            "input_hold: `{other}` is nothing that inputs do between samples\n  help: use 'linear' or 'zero-order'"
        ))),
    }
}

fn finite(what: &str, values: Vec<f64>) -> PyResult<Vec<f64>> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(value) => Err(raised(format!(
            "{what}: {value} is no finite number\n  help: give one number per joint"
        ))),
        None => Ok(values),
    }
}

/// A positive number, if there is one.
pub(crate) fn positive(what: &str, value: Option<f64>) -> PyResult<Option<f64>> {
    match value {
        Some(value) if !(value.is_finite() && value > 0.0) => Err(raised(format!(
            "{what}: {value} is not positive\n  help: give seconds above zero"
        ))),
        value => Ok(value),
    }
}

impl Records {
    fn experiment(&self, name: &str) -> PyResult<&Experiment> {
        let all = &self.found.dataset.experiments;
        all.iter().find(|e| e.name == name).ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|e| e.name.as_str()).collect();
            raised(format!(
                "there is no record `{name}`\n  help: the records are {}",
                names.join(", ")
            ))
        })
    }
}

#[pymethods]
impl Records {
    /// Those of the embedded example.
    #[staticmethod]
    fn example() -> PyResult<Self> {
        let found = Found {
            dataset: simtrue::cli::demo::dataset().map_err(raised)?,
            assumptions: Vec::new(),
            warnings: Vec::new(),
            targets_alone: false,
        };
        Ok(Self {
            found: Arc::new(found),
        })
    }

    #[getter]
    fn names(&self) -> Vec<String> {
        let all = self.found.dataset.experiments.iter();
        all.map(|e| e.name.clone()).collect()
    }

    #[getter]
    fn roles(&self) -> Vec<&'static str> {
        let all = self.found.dataset.experiments.iter();
        all.map(|e| match e.role {
            Role::Train => "train",
            Role::Test => "test",
        })
        .collect()
    }

    #[getter]
    fn joints(&self) -> Vec<String> {
        let joints = self.found.dataset.joints.iter();
        joints.map(|j| j.name.clone()).collect()
    }

    #[getter]
    fn input_units(&self) -> Vec<String> {
        let joints = self.found.dataset.joints.iter();
        joints.map(|j| j.input_unit.clone()).collect()
    }

    #[getter]
    fn assumptions(&self) -> Vec<String> {
        let all = self.found.assumptions.iter();
        all.map(ToString::to_string).collect()
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        let read = self.found.dataset.warnings.iter().map(ToString::to_string);
        self.found.warnings.iter().cloned().chain(read).collect()
    }

    /// Arrays of one record by the word of their column.
    fn arrays<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyDict>> {
        let e = self.experiment(name)?;
        let out = PyDict::new(py);
        out.set_item("t", array(py, &e.t, None)?)?;
        out.set_item("q", array(py, &e.q, Some(e.nq))?)?;
        out.set_item("u", array(py, &e.u, Some(e.nu()))?)?;
        let more = [("v", &e.v), ("tau_sensor", &e.tau), ("qref", &e.qref)];
        for (word, values) in more {
            if let Some(values) = values {
                out.set_item(word, array(py, values, Some(e.nq))?)?;
            }
        }
        Ok(out)
    }

    /// Writes the robot and the records as a folder that `simtrue diagnose FOLDER` reads. Whether the
    /// robot is there.
    fn save(&self, robot: &Robot, folder: PathBuf) -> PyResult<bool> {
        let opened = robot
            .read
            .as_ref()
            .clone()
            .with(self.found.as_ref().clone());
        opened.save(&folder).map_err(raised)
    }

    fn __len__(&self) -> usize {
        self.found.dataset.experiments.len()
    }

    fn __repr__(&self) -> String {
        let d = &self.found.dataset;
        format!("Records({:?}, names={:?})", d.name, self.names())
    }
}
