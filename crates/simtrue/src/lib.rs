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
//! | `firmware` | feed-forward as Rust without std and as C (feature `firmware`) |
//! | `cli` | the command line, for robots of one's own (feature `cli`) |
//!
//! All features are on by default. `default-features = false` leaves `robot!`, data and identification.

use std::ops::ControlFlow;

pub use pid_data as data;
pub use pid_data::Dataset;
/// ```
/// use simtrue::fit::gap::metrics::{FreeRunSettings, free_run};
/// use simtrue::{cli, data::Horizon};
///
/// // Free runs of a tenth of a second stay within 0.05 rad of a record of the embedded data.
/// let data = cli::demo::dataset()?;
/// let model = cli::by_name("two_link")?.model;
/// let nominal: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
/// let settings = FreeRunSettings::new(Horizon::Seconds(0.1));
/// let run = free_run(model, &nominal, &data, &data.experiments[0], &settings)?;
/// assert_eq!((run.windows.len(), run.diverged.len()), (60, 0));
/// let misses = run.q.iter().zip(&data.experiments[0].q).map(|(run, read)| (run - read).abs());
/// assert!(misses.fold(0.0, f64::max) < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub use pid_fit as fit;
pub use pid_fit::ident::Identification;
/// ```
/// use simtrue::data::Horizon;
/// use simtrue::{Request, Settings};
///
/// // Simulations that restart every second.
/// let request = Request {
///     settings: Settings { horizon: Horizon::Seconds(1.0), ..Settings::default() },
///     ..Request::default()
/// };
/// assert!(request.start.is_none(), "from nominal values");
/// ```
pub use pid_fit::ident::Settings;
/// ```
/// use std::ops::ControlFlow;
/// use simtrue::{IdentifyError, Request, cli, fit::identify};
///
/// // A start has one value per parameter.
/// let data = cli::demo::dataset()?;
/// let model = cli::by_name("two_link")?.model;
/// let request = Request { start: Some(vec![1.0]), ..Request::default() };
/// let failed = identify::identify(model, &data, &request, &|_| ControlFlow::Continue(()));
/// assert!(matches!(failed, Err(IdentifyError::Fit(_))));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub use pid_fit::identify::{IdentifyError, Request};
/// ```
/// use simtrue::{cli, synthetic};
///
/// let recipe = synthetic::Recipe {
///     records: 1, seconds: 1.0, step: 0.01, amplitude: vec![5.0, 20.0], highest: 2.0,
///     start: vec![0.0, 3.1], noise: vec![1e-4, 1e-4, 1e-3, 1e-3], outliers: (0.0, 1.0),
/// };
/// let model = cli::by_name("two_link")?.model;
/// let nominal: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
/// let data = synthetic::records(model, &nominal, &recipe, 1)?;
/// assert_eq!(data.experiments.len(), 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub use pid_fit::synthetic;
/// ```
/// use simtrue::dynamics::At;
///
/// // Torques that hold the two-link robot: none where it stands upright.
/// let model = simtrue::cli::by_name("two_link")?.model;
/// let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
/// let zero = [0.0; 2];
/// let mut hold = [0.0; 2];
/// model.residual(&At { q: &zero, v: &zero, a: &zero, u: &zero, p: &p }, &mut hold);
/// assert!(hold.iter().all(|torque| torque.abs() < 1e-12));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub use pid_runtime::dynamics;
pub use pid_runtime::robot;

/// Where the code of [`robot!`] finds what it needs.
#[doc(hidden)]
pub use pid_runtime;

#[cfg(feature = "cli")]
pub use pid_cli as cli;
#[cfg(feature = "diagnose")]
pub use pid_diagnose as diagnosis;
#[cfg(feature = "diagnose")]
pub use pid_diagnose::case::Case;
/// ```
/// use simtrue::{Outcome, Verdict};
///
/// let friction = Verdict::Effect { id: "stribeck".into(), joint: Some(2) };
/// assert_eq!(friction.word(), "stribeck");
/// assert_eq!(Outcome::of(&friction, 1).word(), "one cause");
/// assert_eq!(Outcome::of(&Verdict::Unknown, 0).word(), "unknown");
/// ```
#[cfg(feature = "diagnose")]
pub use pid_diagnose::diagnosis::{Outcome, Verdict};
/// ```
/// use simtrue::diagnosis::{nominal::Nominal, search::Settings};
/// use simtrue::{Case, cli, diagnose};
///
/// // The embedded records of a robot whose elbow has Stribeck friction that the model lacks.
/// let data = cli::demo::dataset()?;
/// let nominal = Nominal::of_declared(cli::by_name("two_link")?.model, None)?;
/// let found = diagnose(&Case::new(nominal, &data)?, &Settings::default());
/// assert_eq!(found.verdict.word(), "stribeck");
/// assert_eq!(found.verdict.joint(), Some(2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "diagnose")]
pub use pid_diagnose::search::diagnose;
#[cfg(feature = "firmware")]
pub use pid_firmware as firmware;
#[cfg(feature = "diagnose")]
pub use pid_interpret as interpret;
#[cfg(feature = "logs")]
pub use pid_logs as logs;
#[cfg(feature = "simulators")]
pub use pid_mjcf as mjcf;
/// ```
/// use simtrue::interpret::nominal::Nominal;
/// use simtrue::preflight::{Settings, Severity, check};
///
/// // Nothing of the embedded records contradicts their robot.
/// let data = simtrue::cli::demo::dataset()?;
/// let nominal = Nominal::of_declared(simtrue::cli::by_name("two_link")?.model, None)?;
/// let findings = check(&data, &nominal, &Settings::default());
/// assert!(findings.iter().all(|f| f.severity != Severity::Wrong));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "logs")]
pub use pid_preflight as preflight;
/// ```
/// use std::ops::ControlFlow;
/// use simtrue::report::{Subject, report};
/// use simtrue::fit::{gap::force::States, identify::identify};
/// use simtrue::{Request, cli};
///
/// let data = cli::demo::dataset()?;
/// let entry = cli::by_name("two_link")?;
/// let found = identify(entry.model, &data, &Request::default(), &|_| ControlFlow::Continue(()))?;
/// let subject = Subject {
///     name: entry.name,
///     summary: entry.summary,
///     source: entry.source,
///     model: entry.model,
///     judged: (entry.model, &data, &found.identification.best().parameters),
///     states: States::NONE,
/// };
/// let report = report(&subject, &data, &found, &|_step| {})?;
/// assert!(report.to_html().contains("two_link identified on demo"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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
/// ```
/// // The robot behind the embedded records has friction that the model lacks; the fit holds it in
/// // the other parameters.
/// let data = simtrue::cli::demo::dataset()?;
/// let found = simtrue::identify(simtrue::cli::by_name("two_link")?.model, &data)?;
/// assert!(found.best().objective < 0.01);
/// assert!(found.undetermined > 0, "gains and masses change together");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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
