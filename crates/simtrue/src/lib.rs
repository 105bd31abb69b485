//! Mechanical models with exact derivatives: identify their parameters from records, and find what
//! they lack beside the real robot.
//!
//! Declare a robot, take records (here simulated ones), identify:
//!
//! ```
//! use simtrue::{identify, robot, synthetic};
//!
//! robot! {
//!     /// A carriage on a rail.
//!     pub robot Carriage {
//!         gravity: [0, 0, -9.81] m/s^2;
//!         params { mass: kg = 90.0 in 50.0..=150.0; viscous: N*s/m = 150.0 in 0.0..=500.0; }
//!         link body { mass: mass; }
//!         joint x: prismatic along x { base -> body; }
//!         per joint { input force: N; force = force - viscous*v; }
//!     }
//! }
//!
//! let truth = [95.0, 200.0];
//! let recipe = synthetic::Recipe {
//!     records: 1, seconds: 2.0, step: 0.01, amplitude: vec![100.0], highest: 2.0,
//!     start: vec![0.0], noise: vec![1e-4, 1e-3], outliers: (0.0, 1.0),
//! };
//! let data = synthetic::records(&Carriage, &truth, &recipe, 1)?; // or Dataset::read(folder)?
//! let found = identify(&Carriage, &data)?;
//! assert!((found.best().parameters[0] - truth[0]).abs() < 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | module | content |
//! |---|---|
//! | [`dynamics`] | the face of a model |
//! | [`data`] | records: reading, windows, filters |
//! | [`fit`] | identification with all settings, regression, excitation, simulation, the gap |
//! | `urdf` | robots from URDF files, identified values back (feature `urdf`) |
//! | `report` | HTML, text and JSON (feature `report`) |
//! | `diagnosis`, `interpret` | what a model lacks; models read at run time (feature `diagnose`) |
//! | `logs`, `preflight` | logs of robots as data sets; their check (feature `logs`) |
//! | `simulators`, `mjcf` | files of simulators out and in (feature `simulators`) |
//! | `cli` | the command line, for robots of one's own (feature `cli`) |
//!
//! All features are on by default. `default-features = false` leaves `robot!`, data and identification.

use std::ops::ControlFlow;

pub use pid_data as data;
pub use pid_data::Dataset;
pub use pid_fit as fit;
pub use pid_fit::ident::{Identification, Settings};
pub use pid_fit::identify::{IdentifyError, Request};
pub use pid_fit::synthetic;
pub use pid_runtime::{dynamics, robot};

/// Where the code of [`robot!`] finds what it needs.
#[doc(hidden)]
pub use pid_runtime;

#[cfg(feature = "cli")]
pub use pid_cli as cli;
#[cfg(feature = "diagnose")]
pub use pid_diagnose as diagnosis;
#[cfg(feature = "diagnose")]
pub use pid_diagnose::{
    case::Case,
    diagnosis::{Outcome, Verdict},
    search::diagnose,
};
#[cfg(feature = "diagnose")]
pub use pid_interpret as interpret;
#[cfg(feature = "logs")]
pub use pid_logs as logs;
#[cfg(feature = "simulators")]
pub use pid_mjcf as mjcf;
#[cfg(feature = "logs")]
pub use pid_preflight as preflight;
#[cfg(feature = "report")]
pub use pid_report as report;
#[cfg(feature = "simulators")]
pub use pid_simulators as simulators;
#[cfg(feature = "urdf")]
pub use pid_urdf as urdf;

/// Identifies a model on the training records of a data set, from nominal values, with the settings
/// that serve on measured records.
///
/// [`fit::identify::identify`] takes a [`Request`], as the command does: settings, a start, the
/// choice of the horizon, values of positive density, intervals by bootstrap and profile.
///
/// # Errors
/// [`IdentifyError`]: data that do not fit the model, no training record, a mass matrix that is
/// singular at the nominal values.
pub fn identify(
    model: &dyn dynamics::Hessian,
    data: &Dataset,
) -> Result<Identification, IdentifyError> {
    let go_on = |_: &fit::identify::News<'_>| ControlFlow::Continue(());
    let found = fit::identify::identify(model, data, &Request::default(), &go_on)?;
    Ok(found.identification)
}
