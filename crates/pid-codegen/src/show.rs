//! What `robot!` makes of a declaration, for people.
//!
//! The macro itself is pure: it writes no files. This crate reads a Rust source file, finds the
//! `robot! { … }` in it and runs the same pipeline on their tokens.
//!
//! # Example
//! ```
//! let source = "
//!     use pid_runtime::robot;
//!     robot! {
//!         pub robot Cart {
//!             gravity: [0, 0, -9.81] m/s^2;
//!             params { mass: kg = 2.0 in 0.1..=9.0; }
//!             link body { mass: mass; }
//!             joint rail: prismatic along x { base -> body; }
//!             per joint { input push: N; force = push; }
//!         }
//!     }";
//! let robots = pid_codegen::show::robots(source)?;
//! assert_eq!(
//!     robots[0].text()?,
//!     "Cart: M(q, p) a + b(q, v, p) = f_L(q, v, p, u)\n\
//!      M[rail, rail] = mass\n\
//!      b[rail] = 0\n\
//!      f_L[rail] = push_rail\n"
//! );
//! # Ok::<(), pid_codegen::show::Error>(())
//! ```

mod counts;
mod declaration;
mod links;
mod words;

use pid_derive::Equations;
use pid_derive::model::Robot;
use pid_derive::readable::Readable;
use pid_symbolic::Graph;
use proc_macro2::TokenStream;
use syn::visit::Visit;
use thiserror::Error;

pub use declaration::declaration;
pub use words::Unsaid;

/// Why nothing can be shown.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// The file is not Rust.
    #[error("not a Rust source file: line {line}, column {column}: {message}")]
    Syntax {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What the parser says.
        message: String,
    },
    /// There is no `robot!`.
    #[error("there is no `robot! {{ … }}` in the file")]
    NoRobot,
    /// `robot!` refuses the declaration.
    #[error("the declaration has mistakes:\n{}", .messages.join("\n"))]
    Refused {
        /// The messages, each with line and column.
        messages: Vec<String>,
    },
    /// The equations cannot be derived.
    #[error(transparent)]
    Derivation(#[from] pid_derive::Error),
    /// The expansion does not parse.
    #[error(
        "the expansion of `{robot}` is not a list of items: {message}; this is a defect of robot!, please report it with the declaration"
    )]
    Expansion {
        /// Name of the robot.
        robot: String,
        /// What the parser says.
        message: String,
    },
}

/// A robot found in a file.
#[derive(Debug, Clone)]
pub struct Dump {
    robot: Robot,
    tokens: TokenStream,
}

/// The robots of a Rust source file, in order.
///
/// # Errors
/// If the file is not Rust, has no `robot!`, or one of them is refused.
pub fn robots(source: &str) -> Result<Vec<Dump>, Error> {
    let file = syn::parse_file(source).map_err(|e| Error::Syntax {
        line: e.span().start().line,
        column: e.span().start().column + 1,
        message: e.to_string(),
    })?;
    let mut finder = Finder(Vec::new());
    finder.visit_file(&file);
    let mut dumps = Vec::new();
    for tokens in finder.0 {
        let robots =
            crate::robots(tokens.clone()).map_err(|messages| Error::Refused { messages })?;
        dumps.extend(robots.into_iter().map(|robot| Dump {
            robot,
            tokens: tokens.clone(),
        }));
    }
    if dumps.is_empty() {
        return Err(Error::NoRobot);
    }
    Ok(dumps)
}

/// Collects the tokens of every `robot!`, also of `pid_runtime::robot!`.
struct Finder(Vec<TokenStream>);

impl<'ast> Visit<'ast> for Finder {
    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        let last = call.path.segments.last();
        if last.is_some_and(|segment| segment.ident == "robot") {
            self.0.push(call.tokens.clone());
        }
    }
}

impl Dump {
    /// Name of the robot.
    pub fn name(&self) -> &str {
        &self.robot.name
    }

    fn derive(&self) -> Result<(Graph, Equations), Error> {
        let mut g = Graph::new();
        let equations = pid_derive::equations(&mut g, &self.robot)?;
        Ok((g, equations))
    }

    /// The equations of motion as text.
    ///
    /// # Errors
    /// If they cannot be derived.
    pub fn text(&self) -> Result<String, Error> {
        let (g, equations) = self.derive()?;
        Ok(Readable::new(&g, &self.robot, &equations).text())
    }

    /// The equations of motion as LaTeX, for the package `amsmath`.
    ///
    /// # Errors
    /// If they cannot be derived.
    pub fn latex(&self) -> Result<String, Error> {
        let (g, equations) = self.derive()?;
        Ok(Readable::new(&g, &self.robot, &equations).latex())
    }

    /// A table of what is generated and its operations.
    ///
    /// # Errors
    /// If the equations cannot be derived.
    pub fn counts(&self) -> Result<String, Error> {
        let (mut g, equations) = self.derive()?;
        Ok(counts::table(&mut g, &self.robot, &equations))
    }

    /// The generated code, formatted. Variants of a robot are in the code of the robot they are declared in.
    ///
    /// # Errors
    /// If the expansion does not parse, which would be a defect.
    pub fn code(&self) -> Result<String, Error> {
        let file =
            syn::parse2(crate::expand(self.tokens.clone())).map_err(|e| Error::Expansion {
                robot: self.robot.name.clone(),
                message: e.to_string(),
            })?;
        Ok(prettyplease::unparse(&file))
    }
}
