//! Feed-forward of identified robots as firmware: straight-line code of the equations of motion with the
//! effects that a diagnosis named, identified values as constants.
//!
//! - [`Target::Rust`]: a `no_std` crate without allocation and without panic paths, `libm` its only
//!   dependency; its feature `c` makes a static library with the functions of the header;
//! - [`Target::C`]: a header and a source of C99.
//!
//! Both have three functions of positions, velocities and accelerations, which return `None` or `false`
//! where a result is no finite number:
//!
//! ```text
//! inverse_dynamics   τ = M(q) a + b(q, v) + rotors + friction − forces of effects
//! feed_forward       u, the input of each drive that makes τ
//! residual           r = τ − gain · applied(u), zero along a motion of the robot
//! ```
//!
//! `not_expressed.md` says for each effect what carries it. Effects with a state or a look back in time
//! are no function of a reference; they are named there.
//!
//! ```
//! use pid_firmware::{Options, Target, export};
//! use pid_interpret::nominal::Nominal;
//!
//! let nominal = Nominal::of_declared(&pid_models::two_link::TwoLink, None)?;
//! let files = export(&nominal, Target::C, &Options::default())?;
//! assert_eq!(files[0].name, "twolink.h");
//! assert!(files[0].text.contains("bool twolink_feed_forward(const float q[2]"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod c;
mod carrier;
mod equations;
mod error;
mod input;
mod names;
mod program;
mod rust;
mod shared;
mod told;

use pid_interpret::nominal::Nominal;

pub use error::FirmwareError;
pub use told::expression;

use equations::Equations;

/// A language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Target {
    /// A `no_std` crate of Rust.
    Rust,
    /// A header and a source of C99.
    C,
}

/// Floating-point numbers of the code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// 32 bits: what a Cortex-M4F computes with.
    #[default]
    F32,
    /// 64 bits: by software on a Cortex-M4F, by hardware on an M7.
    F64,
}

/// How code is written.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Options {
    /// Its numbers.
    pub precision: Precision,
}

/// A file to write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct File {
    /// Its name below the folder of the export, with `/` between folders.
    pub name: String,
    /// Its text.
    pub text: String,
}

impl File {
    fn new(name: impl Into<String>, text: String) -> Self {
        Self {
            name: name.into(),
            text,
        }
    }
}

/// Files of a robot for a target.
///
/// # Errors
/// If an effect is not one of the library, a coordinate has no drive, or a value has no place among the
/// numbers of the code.
pub fn export(
    nominal: &Nominal,
    target: Target,
    options: &Options,
) -> Result<Vec<File>, FirmwareError> {
    let equations = Equations::new(nominal)?;
    equations.check(options.precision)?;
    let mut files = match target {
        Target::Rust => rust::files(&equations, options.precision),
        Target::C => c::files(&equations, options.precision),
    };
    files.push(File::new("not_expressed.md", told::list(&equations)));
    Ok(files)
}
