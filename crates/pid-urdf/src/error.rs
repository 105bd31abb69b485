use std::io;
use std::path::PathBuf;

use pid_derive::plausible::Implausible;
use thiserror::Error;

/// Why a URDF cannot be used. Lines count from 1.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {error}\n  help: give the path of a URDF file", .file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// Message of the operating system.
        error: io::Error,
    },
    /// Not XML.
    #[error("{}: {error}\n  help: a URDF is an XML file with the root element <robot>", .file.display())]
    Xml {
        /// The file.
        file: PathBuf,
        /// Message of the parser, with line and column.
        error: roxmltree::Error,
    },
    /// Another root element than `<robot>`.
    #[error("{}:{line}: the root element is <{found}>\n  help: a URDF has the root element <robot>", .file.display())]
    Root {
        /// The file.
        file: PathBuf,
        /// Line of the element.
        line: u32,
        /// Its name.
        found: String,
    },
    /// A macro file.
    #[error(
        "{}:{line}: `{found}` is not expanded\n  help: this is a xacro file; expand it first (`xacro robot.xacro > robot.urdf`)",
        .file.display()
    )]
    Xacro {
        /// The file.
        file: PathBuf,
        /// Line.
        line: u32,
        /// The macro element or expression.
        found: String,
    },
    /// An element or attribute that must be there.
    #[error("{}:{line}: {item} has no {what}\n  help: {mend}", .file.display())]
    Missing {
        /// The file.
        file: PathBuf,
        /// Line of the element that lacks it.
        line: u32,
        /// Which link or joint.
        item: String,
        /// The missing part.
        what: &'static str,
        /// The mend: text to write.
        mend: &'static str,
    },
    /// A value that cannot be.
    #[error("{}:{line}: {item}: {key} is \"{value}\"\n  help: {mend}", .file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// Line of the value.
        line: u32,
        /// Which link or joint.
        item: String,
        /// Element and attribute.
        key: &'static str,
        /// The value as written.
        value: String,
        /// The mend: text to write instead.
        mend: String,
    },
    /// A name that no link or joint has.
    #[error("{}:{line}: {item}: there is no {what} `{name}`{}", .file.display(), nearest_hint(.nearest.as_deref()))]
    Unknown {
        /// The file.
        file: PathBuf,
        /// Line.
        line: u32,
        /// Which joint.
        item: String,
        /// `link` or `joint`.
        what: &'static str,
        /// The name.
        name: String,
        /// The name that was probably meant.
        nearest: Option<String>,
    },
    /// Two links or two joints have one name.
    #[error("{}:{line}: another {what} has the name `{name}`\n  help: rename one of them", .file.display())]
    NotUnique {
        /// The file.
        file: PathBuf,
        /// Line of the second one.
        line: u32,
        /// `link` or `joint`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// Two parameters would have one name.
    #[error(
        "{}: `{name}` and `{other}` both have a parameter `{identifier}`\n  help: rename one of them",
        .file.display()
    )]
    Collision {
        /// The file.
        file: PathBuf,
        /// The second link or joint.
        name: String,
        /// The first one.
        other: String,
        /// The parameter.
        identifier: String,
    },
    /// A mass or inertia that no body has.
    #[error("{}:{line}: link `{link}`: {fault}", .file.display())]
    Inertia {
        /// The file.
        file: PathBuf,
        /// Line of the `<inertial>`.
        line: u32,
        /// The link.
        link: String,
        /// The fault.
        fault: Implausible,
    },
    /// Moving links without mass and inertia.
    #[error(
        "{}:{line}: these links move, but neither they nor what they carry has mass or inertia: {list}\n  help: give them \
         <inertial>, let it be guessed from their geometry or from masses that you state, or hold their joints",
        .file.display()
    )]
    NoInertia {
        /// The file.
        file: PathBuf,
        /// Line of the first one.
        line: u32,
        /// Their names.
        links: Vec<String>,
        /// Their names with those of their joints, as text.
        list: String,
    },
    /// A joint that settings name and the file does not have.
    #[error("{}: there is no joint `{name}`{}", .file.display(), nearest_hint(.nearest.as_deref()))]
    NoJoint {
        /// The file.
        file: PathBuf,
        /// The name.
        name: String,
        /// The name that was probably meant.
        nearest: Option<String>,
    },
    /// A link with two parents.
    #[error(
        "{}:{line}: link `{link}` is the child of joint `{joint}` and of joint `{first}`\n  help: closed loops are not supported; cut the loop at one of the joints",
        .file.display()
    )]
    TwoParents {
        /// The file.
        file: PathBuf,
        /// Line of the second joint.
        line: u32,
        /// The link.
        link: String,
        /// The second joint.
        joint: String,
        /// The first joint.
        first: String,
    },
    /// The links form more or less than one tree.
    #[error("{}: {found}", .file.display())]
    Tree {
        /// The file.
        file: PathBuf,
        /// The structure they form, and the mend.
        found: TreeFault,
    },
}

/// Why links are no tree.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TreeFault {
    /// No link at all.
    #[error("there is no link\n  help: a robot has a <link> and joints that carry further ones")]
    Empty,
    /// Every link has a parent.
    #[error(
        "every link has a parent: link `{link}` is in a loop\n  help: one link is the base and no joint's child"
    )]
    NoRoot {
        /// One of the links.
        link: String,
    },
    /// Several links without a parent.
    #[error(
        "links `{first}` and `{second}` both have no parent\n  help: connect one to the other by a joint of type \"fixed\""
    )]
    TwoRoots {
        /// First root.
        first: String,
        /// Second root.
        second: String,
    },
    /// A loop apart from the root.
    #[error(
        "link `{link}` is in a loop that hangs on nothing\n  help: cut the loop, and connect it to `{root}`"
    )]
    Loop {
        /// A link of the loop.
        link: String,
        /// The root.
        root: String,
    },
    /// Multipliers whose product is not finite.
    #[error(
        "joint `{joint}` mimics others with multipliers whose product is not finite\n  help: give smaller multipliers"
    )]
    MimicRange {
        /// The joint.
        joint: String,
    },
    /// A joint that follows itself.
    #[error(
        "joint `{joint}` mimics itself, directly or through others\n  help: let one of them move on its own"
    )]
    MimicLoop {
        /// The joint.
        joint: String,
    },
}

fn nearest_hint(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |n| format!("\n  help: did you mean `{n}`?"))
}
