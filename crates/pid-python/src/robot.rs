//! The robot.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pyo3::prelude::*;
use simtrue::cli::open::{self, ClassArg, DriveArg, OpenArgs};
use simtrue::dynamics::Hessian;
use simtrue::interpret::nominal::Nominal;

use crate::error::raised;
use crate::work::{Stops, run};

/// A robot: its nominal description, and what reading its file told.
#[pyclass(frozen, module = "simtrue")]
pub(crate) struct Robot {
    pub(crate) read: Arc<open::Robot>,
    /// The declaration it comes from, if it comes from one.
    pub(crate) declared: Option<&'static dyn Hessian>,
}

/// Forms of robot files.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Urdf,
    Mjcf,
    Description,
}

impl Form {
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Form::Urdf => ("a URDF", "from_urdf"),
            Form::Mjcf => ("an MJCF", "from_mjcf"),
            Form::Description => ("a nominal description", "from_description"),
        }
    }

    fn of(path: &Path) -> Self {
        let toml = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let mujoco = || std::fs::read_to_string(path).is_ok_and(|text| text.contains("<mujoco"));
        match toml {
            true => Form::Description,
            false if mujoco() => Form::Mjcf,
            false => Form::Urdf,
        }
    }
}

/// Reads a robot; `wanted`: the form it must have.
fn of_file(py: Python<'_>, path: PathBuf, wanted: Option<Form>, args: OpenArgs) -> PyResult<Robot> {
    let file = match path.join("nominal.toml") {
        inside if inside.is_file() => inside,
        _ => path,
    };
    if let Some(wanted) = wanted
        && file.exists()
        && Form::of(&file) != wanted
    {
        let (found, method) = Form::of(&file).words();
        return Err(raised(format!(
            "{}: {found}, not {}\n  help: use Robot.{method}, or load_robot for any form",
            file.display(),
            wanted.words().0
        )));
    }
    let (read, _) = run(py, Stops::Never, None, move |_| {
        open::Robot::read(&file, &args)
    })?;
    Ok(Robot {
        read: Arc::new(read),
        declared: None,
    })
}

/// How a robot file is read; `trust`: how far its masses are; `drive`: law of its loops.
fn reading(
    trust: &str,
    joints: Option<Vec<String>>,
    guess_inertias: bool,
    strict: bool,
    drive: Option<&str>,
) -> PyResult<OpenArgs> {
    let class = match trust {
        "cad" => ClassArg::Cad,
        "data-sheet" => ClassArg::DataSheet,
        "guessed" => ClassArg::Guessed,
        other => {
            return Err(raised(format!(
                "trust: `{other}` says nothing of where masses come from\n  help: use 'cad', 'data-sheet' or 'guessed'"
            )));
        }
    };
    let drive = match drive {
        None => None,
        Some("p") => Some(DriveArg::P),
        Some("pd") => Some(DriveArg::Pd),
        Some("pid") => Some(DriveArg::Pid),
        Some("cascade") => Some(DriveArg::Cascade),
        Some("none") => Some(DriveArg::None),
        Some(other) => {
            return Err(raised(format!(
                "drive: `{other}` is no law of a loop\n  help: use 'p', 'pd', 'pid', 'cascade' or 'none'"
            )));
        }
    };
    Ok(OpenArgs {
        drive,
        class,
        joints: joints.unwrap_or_default(),
        guess_inertias,
        strict,
        ..OpenArgs::default()
    })
}

#[pymethods]
impl Robot {
    /// Reads a URDF, an MJCF, a nominal description or a folder with one.
    #[staticmethod]
    #[pyo3(signature = (path, *, trust="cad", joints=None, guess_inertias=false, strict=false, drive=None))]
    fn load(
        py: Python<'_>,
        path: PathBuf,
        trust: &str,
        joints: Option<Vec<String>>,
        guess_inertias: bool,
        strict: bool,
        drive: Option<&str>,
    ) -> PyResult<Self> {
        let args = reading(trust, joints, guess_inertias, strict, drive)?;
        of_file(py, path, None, args)
    }

    /// Reads a URDF.
    #[staticmethod]
    #[pyo3(signature = (path, *, trust="cad", joints=None, guess_inertias=false, strict=false))]
    fn from_urdf(
        py: Python<'_>,
        path: PathBuf,
        trust: &str,
        joints: Option<Vec<String>>,
        guess_inertias: bool,
        strict: bool,
    ) -> PyResult<Self> {
        let args = reading(trust, joints, guess_inertias, strict, None)?;
        of_file(py, path, Some(Form::Urdf), args)
    }

    /// Reads an MJCF.
    #[staticmethod]
    #[pyo3(signature = (path, *, trust="cad"))]
    fn from_mjcf(py: Python<'_>, path: PathBuf, trust: &str) -> PyResult<Self> {
        of_file(
            py,
            path,
            Some(Form::Mjcf),
            reading(trust, None, false, false, None)?,
        )
    }

    /// Reads a nominal description, or that of a folder.
    #[staticmethod]
    fn from_description(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        of_file(py, path, Some(Form::Description), OpenArgs::default())
    }

    /// A robot that is declared in the program.
    #[staticmethod]
    fn from_model(name: &str) -> PyResult<Self> {
        let model = simtrue::cli::by_name(name).map_err(raised)?.model;
        let nominal = Nominal::of_declared(model, None).map_err(raised)?;
        Ok(Self {
            read: Arc::new(open::Robot::described(nominal)),
            declared: Some(model),
        })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.read.nominal.robot().name
    }

    #[getter]
    fn joints(&self) -> Vec<String> {
        self.read.joints().into_iter().map(|j| j.name).collect()
    }

    #[getter]
    fn input_units(&self) -> Vec<String> {
        let inputs = self.read.nominal.robot().inputs.iter();
        inputs.map(|i| i.unit.clone()).collect()
    }

    #[getter]
    fn parameters(&self) -> BTreeMap<String, f64> {
        let all = self.read.nominal.tolerances().iter();
        all.map(|t| (t.name.clone(), t.nominal)).collect()
    }

    #[getter]
    fn tolerances(&self) -> BTreeMap<String, f64> {
        let all = self.read.nominal.tolerances().iter();
        all.map(|t| (t.name.clone(), t.half_width)).collect()
    }

    #[getter]
    fn parameter_units(&self) -> BTreeMap<String, String> {
        let all = self.read.nominal.robot().params.iter();
        all.map(|p| (p.name.clone(), p.unit.to_string())).collect()
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.read.warnings.clone()
    }

    #[getter]
    fn assumptions(&self) -> Vec<String> {
        self.read.assumptions.clone()
    }

    /// The text of its nominal description.
    fn to_toml(&self) -> PyResult<String> {
        self.read.nominal.to_toml().ok_or_else(|| {
            raised(format!(
                "robot `{}`: a nominal description cannot state joints that follow others, drives on several joints or declared potentials\n  help: keep the robot's own file",
                self.name()
            ))
        })
    }

    fn __repr__(&self) -> String {
        format!("Robot({:?}, joints={:?})", self.name(), self.joints())
    }
}
