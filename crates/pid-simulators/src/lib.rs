//! Identified robots as files of simulators.
//!
//! A nominal description, with the effects that a diagnosis named, becomes what a simulator reads:
//!
//! - [`Target::Mujoco`]: `robot.xml`, a wrapper in Python for effects that MJCF cannot express, and
//!   `not_expressed.md`, which says for each effect what carries it;
//! - [`Target::Urdf`]: `robot.urdf`, and `not_expressed.md`;
//! - [`Target::IsaacLab`], [`Target::Newton`]: `robot.urdf`, the drives as data, a module in Python that
//!   hands them to the engine, and `not_expressed.md`;
//! - [`Target::Bam`]: the parameters of each joint, and `not_expressed.md`.
//!
//! Each has `ranges.json` beside it: ranges to randomise over.
//!
//! ```
//! use pid_interpret::nominal::{Nominal, Provenance};
//! use pid_simulators::{Options, Target, export};
//!
//! let cart = r#"<robot name="cart"><link name="rail"/><link name="cart"><inertial><mass value="2"/>
//!     <inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial></link>
//!     <joint name="x" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
//!     <limit lower="-1" upper="1" effort="80" velocity="2"/></joint></robot>"#;
//! let mechanism = pid_urdf::Description::parse("cart.urdf", cart)?.mechanism([0.0, 0.0, -9.81]);
//! let nominal = Nominal::of_mechanism(&mechanism, Provenance::Cad)?.nominal;
//! let files = export(&nominal, Target::Mujoco, &Options::default())?;
//! assert!(files[0].text.contains(r#"<joint name="x" type="slide" axis="1 0 0""#));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bam;
mod drives;
mod error;
mod machine;
pub mod mujoco;
mod position_loop;
mod ranges;
mod urdf;
mod xml;

use std::borrow::Cow;

use pid_interpret::nominal::Nominal;

pub use error::ExportError;
pub use ranges::Results;

use drives::Engine;
use machine::Machine;

/// A simulator, or a format that several read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Target {
    /// MuJoCo 3.5 or later.
    Mujoco,
    /// URDF.
    Urdf,
    /// Isaac Lab 3: a URDF and configurations of its actuators.
    IsaacLab,
    /// Newton 1.8: a URDF and its drives.
    Newton,
    /// Better Actuator Models: friction and motor of each turning joint.
    Bam,
}

/// How files are written.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Options<'a> {
    /// Step of the simulation, s. The engine's steps are of first order: a position is off by half a
    /// step times the velocity. By default 0.5 ms, which keeps that below usual noise of encoders; 0.1 ms
    /// with position loops, at which six of them leave at most 1.03 of the gap that a diagnosis states.
    pub timestep: Option<f64>,
    /// A `diagnosis.json`, whose magnitudes and deviations go into `ranges.json`.
    pub diagnosis: Option<Results<'a>>,
    /// A `fit.json`, whose values and deviations go into `ranges.json`.
    pub fit: Option<Results<'a>>,
}

impl Options<'_> {
    /// Step of the simulation of a robot, s.
    fn step(&self, nominal: &Nominal) -> f64 {
        self.timestep.unwrap_or(match nominal.has_servos() {
            true => 1e-4,
            false => 5e-4,
        })
    }
}

/// A file to write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct File {
    /// Its name.
    pub name: Cow<'static, str>,
    /// Its text.
    pub text: String,
}

impl File {
    fn new(name: impl Into<Cow<'static, str>>, text: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            text: text.into(),
        }
    }
}

/// Files of a robot for a target.
///
/// # Errors
/// If the step is no number above zero, the robot is no tree of bodies on revolute and prismatic
/// joints with numbers, an effect is not one of the library, a value is not finite, or a file of
/// results is of another form.
pub fn export(
    nominal: &Nominal,
    target: Target,
    options: &Options<'_>,
) -> Result<Vec<File>, ExportError> {
    let step = options.step(nominal);
    if !(step.is_finite() && step > 0.0) {
        return Err(ExportError::Value {
            robot: nominal.robot().name.clone(),
            item: "timestep".to_owned(),
            value: format!("{step} s"),
            mend: "give a number above zero, such as 5e-4",
        });
    }
    let machine = Machine::new(nominal)?;
    let mut files = match target {
        Target::Mujoco => mujoco::files(&machine, step)?,
        Target::Urdf => urdf::files(&machine)?,
        Target::IsaacLab => drives::files(&machine, Engine::IsaacLab)?,
        Target::Newton => drives::files(&machine, Engine::Newton)?,
        Target::Bam => bam::files(&machine)?,
    };
    files.push(ranges::file(
        nominal,
        &machine,
        options.diagnosis,
        options.fit,
    )?);
    Ok(files)
}
