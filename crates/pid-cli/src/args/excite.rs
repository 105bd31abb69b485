//! Arguments of `simtrue excite`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::robot::RobotArgs;

/// Arguments of `simtrue excite`.
#[derive(Debug, Clone, Args)]
pub(crate) struct ExciteArgs {
    /// Robot: a URDF, an MJCF, a nominal.toml, or a model, as `simtrue models` lists them.
    #[arg(value_name = "ROBOT")]
    pub(crate) robot: PathBuf,
    /// Folder for excitation.csv and excitation.json; made if needed.
    #[arg(
        long,
        short,
        value_name = "FOLDER",
        default_value = "simtrue-excitation"
    )]
    pub(crate) out: PathBuf,
    /// Parameters: a fit.json, or a TOML file of lines `name = value`; nominal ones if absent.
    #[arg(long, value_name = "FILE")]
    pub(crate) parameters: Option<PathBuf>,
    /// Limits: a TOML file with `[JOINT]` tables of `position = [low, high]`, `velocity`,
    /// `acceleration`, `force`, in rad or m, s, N·m or N. What a joint does not name comes from the
    /// options below, then from the robot. Tables `[[workspace]]` keep points of
    /// links in boxes: `link = "forearm"`, `point = [0, 0, 0.3]` in the link's frame (its origin if
    /// absent), `x`, `y`, `z` = `[low, high]` in the base frame, m, an end `inf` where it is open.
    #[arg(long, value_name = "FILE")]
    pub(crate) limits: Option<PathBuf>,
    /// Largest velocity of joints without their own limit, rad/s or m/s; that of the robot file if
    /// absent, and 2 where it states none.
    #[arg(long, value_name = "V")]
    pub(crate) velocity: Option<f64>,
    /// Largest acceleration of joints without their own limit, rad/s² or m/s².
    #[arg(long, value_name = "A", default_value_t = 8.0)]
    pub(crate) acceleration: f64,
    /// Largest force of joints without their own limit, N·m or N; that of the robot file if absent,
    /// and any where it states none.
    #[arg(long, value_name = "F")]
    pub(crate) force: Option<f64>,
    /// Length of a period, s.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub(crate) period: f64,
    /// Harmonics of the series.
    #[arg(long, value_name = "K", default_value_t = 5)]
    pub(crate) harmonics: usize,
    /// Samples per period at which limits hold.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub(crate) samples: usize,
    /// Criterion that is minimised.
    #[arg(long, value_enum, default_value_t = CriterionArg::Determinant)]
    pub(crate) criterion: CriterionArg,
    /// Random starts.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub(crate) starts: usize,
    /// Seed of the random starts.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Rate of excitation.csv, Hz.
    #[arg(long, value_name = "HZ", default_value_t = 100.0)]
    pub(crate) rate: f64,
    #[command(flatten)]
    pub(crate) read: RobotArgs,
}

/// `excite::Criterion` on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum CriterionArg {
    /// Volume of the confidence ellipsoid (D-optimal).
    Determinant,
    /// Its longest axis (E-optimal, smoothed).
    SmallestEigenvalue,
}
