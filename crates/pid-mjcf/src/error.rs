use std::io;
use std::path::PathBuf;

use thiserror::Error;

/// Why an MJCF model cannot be used. Lines count from 1.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MjcfError {
    /// The file, or one that it includes, cannot be read.
    #[error("{}: cannot be read: {error}\n  help: give the path of an MJCF file; an included file is sought beside the file that includes it", .file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// Message of the operating system.
        error: io::Error,
    },
    /// Not XML.
    #[error("{}: {error}\n  help: an MJCF model is an XML file with the root element <mujoco>", .file.display())]
    Xml {
        /// The file.
        file: PathBuf,
        /// Message of the parser, with line and column.
        error: roxmltree::Error,
    },
    /// Another root element than `<mujoco>`.
    #[error("{}:{line}: the root element is <{found}>\n  help: an MJCF model has the root element <mujoco>", .file.display())]
    Root {
        /// The file.
        file: PathBuf,
        /// Line of the element.
        line: u32,
        /// Its name.
        found: String,
    },
    /// Elements or files in each other without end.
    #[error("{}:{line}: elements stand in each other more than {most} deep\n  help: check <include> for a file that includes itself", .file.display())]
    Deep {
        /// The file.
        file: PathBuf,
        /// Line.
        line: u32,
        /// The deepest that is read.
        most: usize,
    },
    /// A value that cannot be.
    #[error("{}:{line}: {item}: {key} is \"{value}\"\n  help: {mend}", .file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// Line of the element.
        line: u32,
        /// The element.
        item: String,
        /// The attribute.
        key: String,
        /// The value as written.
        value: String,
        /// The mend.
        mend: String,
    },
    /// A name that nothing has.
    #[error("{}:{line}: {item}: there is no {what} `{name}`{}", .file.display(), hint(.nearest.as_deref()))]
    Unknown {
        /// The file.
        file: PathBuf,
        /// Line.
        line: u32,
        /// The element.
        item: String,
        /// What it should name.
        what: &'static str,
        /// The name.
        name: String,
        /// The name that was probably meant.
        nearest: Option<String>,
    },
    /// An element whose motion or structure is not covered.
    #[error("{}:{line}: {item} {what}\n  help: {mend}", .file.display())]
    Unsupported {
        /// The file.
        file: PathBuf,
        /// Line.
        line: u32,
        /// The element.
        item: String,
        /// What it is.
        what: &'static str,
        /// The mend.
        mend: &'static str,
    },
    /// Moving bodies without mass and inertia.
    #[error(
        "{}: these bodies move, but neither they nor what they carry has mass or inertia: {list}\n  help: give them <inertial>, \
         or geoms that are no meshes",
        .file.display()
    )]
    NoInertia {
        /// The file.
        file: PathBuf,
        /// Their names with those of their joints.
        list: String,
    },
    /// No joint moves.
    #[error("{}: no joint moves\n  help: the model has only fixed bodies and held bases", .file.display())]
    NothingMoves {
        /// The file.
        file: PathBuf,
    },
}

fn hint(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |n| format!("\n  help: did you mean `{n}`?"))
}
