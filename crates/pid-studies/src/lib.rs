//! Studies of the project, each a command of the binary `pid-studies`.
//!
//! ```text
//! cargo run --release -p pid-studies -- STUDY     # withheld, paper, coverage, scaling, net, …
//! ```
#![allow(clippy::print_stdout, reason = "commands that print tables")]

pub mod build_budget;
pub mod constrained;
pub mod coverage;
pub mod dynamics_speed;
pub mod faults;
pub mod fleet;
pub mod hock_schittkowski;
pub mod intervals;
pub mod net;
pub mod paper;
pub mod robot_files;
pub mod scaling;
pub mod seed_study;
pub mod servo;
pub mod shooting_study;
pub mod untidy;
pub mod withheld;

use std::path::Path;

/// What ends a study early.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Fewest and most joints of a study's robots.
///
/// # Errors
/// Where there are no such robots.
fn joints(fewest: u8, most: u8) -> Result<(usize, usize), Failure> {
    if fewest > most {
        let mend = format!("give --joints {fewest} or more, or a smaller --fewest");
        return Err(
            format!("no robot has at least {fewest} and at most {most} joints: {mend}").into(),
        );
    }
    Ok((usize::from(fewest), usize::from(most)))
}

/// Writes a file and names it in the error.
fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text)
        .map_err(|error| format!("{}: cannot be written: {error}", path.display()).into())
}

/// Makes a folder and names it in the error.
fn make_folder(path: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(path)
        .map_err(|error| format!("{}: cannot be made: {error}", path.display()).into())
}

#[cfg(test)]
mod tests {
    #[test]
    fn fewest_joints_are_at_most_the_most() {
        assert_eq!(super::joints(2, 3).expect("robots"), (2, 3));
        assert_eq!(super::joints(6, 6).expect("robots"), (6, 6));
        let error = super::joints(6, 3).expect_err("no robots").to_string();
        assert!(error.contains("at least 6 and at most 3"), "{error}");
    }
}
