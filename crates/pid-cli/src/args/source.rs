//! Model, data and place of the results.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::open::OpenArgs;
use crate::with::With;

/// Model, data and place of the results.
#[derive(Debug, Clone, Args)]
pub(crate) struct Source {
    /// Robot file (URDF, MJCF or nominal.toml) and its logs (docs/logs.md): its tolerances are bounds
    /// and priors. Or a folder with dataset.toml and nominal.toml. Or a model, as `simtrue models` lists
    /// them, and a folder with dataset.toml (docs/data-format.md).
    #[arg(value_name = "ROBOT LOG|FOLDER|MODEL FOLDER")]
    pub(crate) paths: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) open: OpenArgs,
    /// Go on although the logs contradict the robot (`simtrue check` says how).
    #[arg(long)]
    pub(crate) anyway: bool,
    /// Robot from a URDF with free masses and inertias, and a data folder: joints and links of the
    /// file, input torque or force at each joint. Identified values are written back to
    /// identified.urdf.
    #[arg(long, value_name = "FILE")]
    pub(crate) urdf: Option<PathBuf>,
    /// Robot from a nominal description (docs/nominal-format.md) instead of a model; in
    /// identifications its tolerances are bounds and priors, its stated noise that of the channels.
    #[arg(long, value_name = "FILE", conflicts_with = "urdf")]
    pub(crate) nominal: Option<PathBuf>,
    /// With --urdf: masses and inertias are identified, or held as written.
    #[arg(long, value_enum, default_value_t, requires = "urdf")]
    pub(crate) inertias: InertiasArg,
    /// With --urdf: a rotor inertia per joint is identified.
    #[arg(long, requires = "urdf")]
    pub(crate) armature: bool,
    /// Effect of the library (as `simtrue diagnose` names them) that the model lacks, at every
    /// joint (`stribeck`) or one joint (`stribeck:elbow`); may be repeated. Regressions take its
    /// linear form. Or a force law that is linear in a coefficient, at a joint or a motor of two
    /// joints (`viscous:j5+j6`). Laws: armature, offset, viscous, coulomb, asymmetric (viscous
    /// friction that differs between the directions), stribeck, saturating, load (friction with the
    /// drive's torque), quadratic, presliding (friction that builds up over a displacement;
    /// regressions only).
    #[arg(long = "with", value_name = "TERM", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) terms: Vec<With>,
    /// The measured torques of the records (columns tau1 …) are the inputs instead of the commands.
    #[arg(long, conflicts_with_all = ["gain", "controller"])]
    pub(crate) measured_torque: bool,
    /// Controllers of the records (docs/controller-format.md): the commanded positions are the
    /// input, and the loop is part of the model.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) controller: Option<PathBuf>,
    /// Parameter of which every training record has its own value, such as an offset that is set
    /// anew; may be repeated. Test records take the mean. In regressions `*` stands for any
    /// characters.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) private: Vec<String>,
    /// Joint whose recorded velocity lags behind (`all` for every joint), by a time constant that
    /// is estimated; may be repeated.
    #[arg(long, value_name = "JOINT", conflicts_with_all = ["urdf", "nominal"])]
    pub(crate) velocity_lag: Vec<String>,
    /// Further folder with records of the same robot; may be repeated.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) also: Vec<PathBuf>,
    /// Folder for the results; made if needed.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-report")]
    pub(crate) out: PathBuf,
}

impl Source {
    /// Whether no model and no data are named: the embedded ones are used.
    pub(crate) fn embedded(&self) -> bool {
        self.paths.is_empty() && self.urdf.is_none() && self.nominal.is_none()
    }

    /// The first option that asks for a declared model or a URDF by --urdf; a robot file with logs has
    /// none of them.
    pub(crate) fn of_models(&self) -> Option<&'static str> {
        let all = [
            ("--urdf", self.urdf.is_some()),
            ("--nominal", self.nominal.is_some()),
            ("--with", !self.terms.is_empty()),
            ("--controller", self.controller.is_some()),
            ("--private", !self.private.is_empty()),
            ("--velocity-lag", !self.velocity_lag.is_empty()),
        ];
        all.iter().find(|(_, is)| *is).map(|(option, _)| *option)
    }
}

/// Masses and inertias of a URDF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum InertiasArg {
    /// Ten standard parameters per moving body, from the values of the file.
    #[default]
    Free,
    /// The numbers of the file.
    Fixed,
}
