//! The file of limits of an exciting motion.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use pid_fit::excite::{Limits, Workspace};
use pid_interpret::Kinematics;
use pid_interpret::kinematics::{KinematicsError, Point};
use pid_interpret::nominal::Nominal;
use pid_runtime::dynamics::Hessian;
use pid_toml::{Mistake, Place, Source};
use serde::Deserialize;

use crate::args::excite::ExciteArgs;

/// Largest velocity of a joint for which nothing states one, rad/s or m/s: slow for an arm, so that a first motion
/// does no harm.
const SLOW: f64 = 2.0;

/// Key of the boxes; every other key is a joint.
const WORKSPACE: &str = "workspace";

/// `[JOINT]`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct JointLimits {
    position: Option<(f64, f64)>,
    velocity: Option<f64>,
    acceleration: Option<f64>,
    force: Option<f64>,
}

/// `[[workspace]]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointBox {
    link: String,
    #[serde(default)]
    point: [f64; 3],
    #[serde(default = "anywhere")]
    x: (f64, f64),
    #[serde(default = "anywhere")]
    y: (f64, f64),
    #[serde(default = "anywhere")]
    z: (f64, f64),
}

fn anywhere() -> (f64, f64) {
    (f64::NEG_INFINITY, f64::INFINITY)
}

/// A file of limits.
#[derive(Debug, Clone, Default)]
pub(crate) struct LimitFile {
    joints: BTreeMap<String, JointLimits>,
    boxes: Vec<PointBox>,
}

/// A file of limits that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum LimitsError {
    #[error("{0}\n  the form: `[joint]` and below it `velocity = 2.0`")]
    Toml(Mistake),
    #[error("{place}: the model has no joint `{name}`; it has {found}\n  help: {mend}")]
    Unknown {
        place: Place,
        name: String,
        found: String,
        mend: String,
    },
    #[error(
        "{}: `{WORKSPACE}`: {}{}\n  help: write `[[{WORKSPACE}]]` and below it `link = \"forearm\"` and `z = [0.1, inf]`",
        .0.place, .0.message, .0.shown
    )]
    Workspace(Mistake),
    #[error("{}: cannot be read: {error}\n  help: check the path given with --limits", path.display())]
    Read { path: PathBuf, error: io::Error },
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
}

impl LimitFile {
    /// Reads a file; without one only the options limit the motion.
    pub(crate) fn read(path: Option<&Path>, model: &dyn Hessian) -> Result<Self, LimitsError> {
        let Some(path) = path else {
            return Ok(Self::default());
        };
        let text = std::fs::read_to_string(path).map_err(|error| LimitsError::Read {
            path: path.to_owned(),
            error,
        })?;
        let name = path.display().to_string();
        Self::parse(&Source::new(&name, &text), model)
    }

    fn parse(source: &Source<'_>, model: &dyn Hessian) -> Result<Self, LimitsError> {
        let names = || model.joints().iter().map(|j| j.name.as_ref());
        let joint = |name: &str| names().any(|j| j == name);
        let mut read = Self::default();
        for item in source.tables().map_err(LimitsError::Toml)? {
            let name = item.key.as_ref().clone();
            // A joint may have the name of the boxes.
            if name == WORKSPACE && !(item.is_table() && joint(WORKSPACE)) {
                read.boxes = source.read(item).map_err(LimitsError::Workspace)?;
                continue;
            }
            if !joint(&name) {
                let found: Vec<String> = names().map(|j| format!("`{j}`")).collect();
                return Err(LimitsError::Unknown {
                    place: source.place_of(&item.key),
                    mend: pid_toml::one_of(&name, names()),
                    name,
                    found: found.join(", "),
                });
            }
            let limits = source.read(item).map_err(LimitsError::Toml)?;
            read.joints.insert(name, limits);
        }
        Ok(read)
    }

    /// Positions of the limited points; `None` without any.
    pub(crate) fn kinematics(
        &self,
        (model, nominal): (&dyn Hessian, Option<&Nominal>),
    ) -> Result<Option<Kinematics>, LimitsError> {
        let point = |of: &PointBox| Point {
            link: of.link.clone(),
            at: of.point,
        };
        let points: Vec<Point> = self.boxes.iter().map(point).collect();
        if points.is_empty() {
            return Ok(None);
        }
        Ok(Some(match nominal {
            Some(nominal) => Kinematics::new(nominal.robot(), &points)?,
            None => Kinematics::of_declared(model, &points)?,
        }))
    }

    /// The limits, completed by the options and by what the robot states.
    pub(crate) fn limits<'a>(
        &self,
        args: &ExciteArgs,
        (model, nominal): (&dyn Hessian, Option<&Nominal>),
        kinematics: Option<&'a Kinematics>,
    ) -> Limits<'a> {
        let mut limits = Limits {
            q: Vec::new(),
            v: Vec::new(),
            a: Vec::new(),
            force: Vec::new(),
            workspace: kinematics.map(|points| Workspace {
                points,
                boxes: self.boxes.iter().map(|b| [b.x, b.y, b.z]).collect(),
            }),
        };
        let channels = nominal.map_or(&[][..], |own| &own.measurement().channels);
        for joint in model.joints() {
            let own = self.joints.get(joint.name.as_ref());
            let own = own.cloned().unwrap_or_default();
            let stated = channels.iter().find(|own| own.name == joint.name);
            limits.q.push(own.position.or(joint.limits));
            let velocity = own.velocity.or(args.velocity);
            let velocity = velocity.or(stated.and_then(|own| own.speed_scale));
            limits.v.push(velocity.unwrap_or(SLOW));
            limits.a.push(own.acceleration.unwrap_or(args.acceleration));
            let force = own.force.or(args.force);
            let force = force.or(stated.and_then(|own| own.torque_peak));
            limits.force.push(force.unwrap_or(f64::INFINITY));
        }
        limits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Cli, Command};
    use clap::Parser;

    fn args(line: &str) -> ExciteArgs {
        match Cli::try_parse_from(line.split(' ')).unwrap().command {
            Some(Command::Excite(args)) => args,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn limits_of_a_file_come_first_and_unknown_joints_are_named() {
        let model: &dyn Hessian = pid_models::by_name("two_link").unwrap();
        let folder = std::env::temp_dir().join(format!("pid-excite-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("limits.toml");
        let line = format!(
            "simtrue excite two_link --velocity 3 --limits {}",
            file.display()
        );
        std::fs::write(&file, "[elbow]\nvelocity = 1.5\nposition = [-1, 1]\n").unwrap();
        let found = LimitFile::read(Some(&file), model).unwrap();
        let found = found.limits(&args(&line), (model, None), None);
        assert_eq!((found.v, found.q[1]), (vec![3.0, 1.5], Some((-1.0, 1.0))));
        for (text, message) in [
            (
                "[wrist]\nvelocity = 1",
                "limits.toml:1:2: the model has no joint `wrist`; it has `shoulder`, `elbow`",
            ),
            (
                "[elbow]\nspeed = 1",
                "limits.toml:2:1: unknown field `speed`",
            ),
            ("[elbo]\nvelocity = 1", "did you mean `elbow`?"),
            (
                "[elbow]\nvelocity = \"1\"",
                "limits.toml:2:12: invalid type",
            ),
            (
                "[workspace]\nz = [0, 1]",
                "`workspace`: invalid type: map, expected a sequence",
            ),
            (
                "[[workspace]]\nlink = \"arm\"",
                "no link `arm`; it has `upper`, `fore`",
            ),
            (
                "[[workspace]]\nlink = \"fore\"\npoint = [0, 0, nan]",
                "the point on link `fore` is at [0.0, 0.0, NaN]",
            ),
        ] {
            std::fs::write(&file, text).unwrap();
            let read = LimitFile::read(Some(&file), model);
            let error = read.and_then(|f| f.kinematics((model, None))).unwrap_err();
            let error = error.to_string();
            assert!(error.contains(message), "{error}");
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
