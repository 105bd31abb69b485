use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Why a nominal description cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NominalError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {error}\n  help: give the path of a nominal.toml; `simtrue new FOLDER --from ROBOT LOG` writes one", .file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// Message of the operating system.
        error: io::Error,
    },
    /// Not TOML, or with keys that are unknown, missing or of the wrong type.
    #[error("{0}\n  the keys: docs/nominal-format.md")]
    Syntax(pid_toml::Mistake),
    /// No joint.
    #[error("{}: no joint listed\n  help: add a `[[joint]]` table per moving link, base to tip", .file.display())]
    NoJoint {
        /// The file.
        file: PathBuf,
    },
    /// A mechanism none of whose joints moves on its own.
    #[error(
        "no joint of `{robot}` moves on its own\n  help: hold fewer joints, or give a robot with revolute or prismatic ones"
    )]
    NothingMoves {
        /// Name of the robot.
        robot: String,
    },
    /// A declared robot without a nominal description.
    #[error(transparent)]
    Declared(#[from] DeclaredError),
    /// A value that cannot be.
    #[error("{place}: {item}: `{key}` is {found}\n  help: {mend}")]
    Value {
        /// Where the value stands.
        place: pid_toml::Place,
        /// `robot`, `tolerance` or `joint j2`.
        item: String,
        /// The key.
        key: &'static str,
        /// The value.
        found: String,
        /// The mend: text to write instead.
        mend: String,
    },
}

/// Why a model has no nominal description.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DeclaredError {
    /// It was not compiled from a declaration.
    #[error(
        "`{robot}` carries no declaration\n  help: only models that `robot!` generates have one, as they are; leave out forces that were added to it"
    )]
    NotDeclared {
        /// Name of the model.
        robot: String,
    },
    /// Its declaration is of another version.
    #[error(
        "the declaration of `{robot}` cannot be read: {message}\n  help: compile it with the version of pid-runtime that this program uses"
    )]
    Unreadable {
        /// Name of the model.
        robot: String,
        /// Message of the reader.
        message: String,
    },
    /// A structure beyond open chains of bodies with a drive each.
    #[error(
        "`{robot}` {what}\n  help: a nominal description takes bodies on revolute and prismatic joints, each with a drive of its own"
    )]
    Structure {
        /// Name of the model.
        robot: String,
        /// The structure.
        what: String,
    },
    /// A free parameter in the geometry.
    #[error(
        "`{robot}`: the free parameter `{parameter}` changes {what}, which a nominal description takes as exact\n  help: mark it `fixed`"
    )]
    Geometry {
        /// Name of the model.
        robot: String,
        /// The parameter.
        parameter: String,
        /// The quantity it changes.
        what: String,
    },
    /// A drive of another form.
    #[error(
        "the force on joint `{joint}` of `{robot}` is not gain·input less viscous and Coulomb friction: {what}\n  help: leave the term out of the declaration; a diagnosis looks for it as an effect"
    )]
    Law {
        /// Name of the model.
        robot: String,
        /// The joint.
        joint: String,
        /// The difference.
        what: String,
    },
}
