//! Records results of this build bit for bit, and compares those of a later build with them.
//!
//! ```text
//! pid-studies net record DIR [--practice FOLDER] [--only PREFIX]...
//! pid-studies net compare DIR [--with DIR] [--practice FOLDER] [--only PREFIX]...
//! ```
//!
//! `PREFIX` is of `PART/ITEM`: `demo`, `expansions`, `hock_schittkowski`, `draws`, `study`,
//! `practice`, `practice/p01`. The practice set is that beside the workspace unless it is given.
//! `compare` runs this build, or reads the folder that another build recorded (`--with`). Exit code
//! 0: equal; 1: different, or an error.
use std::path::PathBuf;

use super::{Failure, Request, compare, compare_folders, record};

/// Runs the command; exit code 0 where all is equal, 1 where something differs.
///
/// # Errors
/// A wrong word, or files that cannot be read or written.
pub fn run(words: &[String]) -> Result<u8, Failure> {
    equal(words).map(|equal| u8::from(!equal))
}

/// Whether nothing differs.
fn equal(words: &[String]) -> Result<bool, Failure> {
    const USAGE: &str =
        "net record|compare DIR [--practice FOLDER] [--with DIR] [--only PREFIX]...";
    let mut args = words.iter().cloned();
    let (verb, folder) = args.next().zip(args.next()).ok_or(USAGE)?;
    let mut request = Request {
        folder: PathBuf::from(folder),
        practice: pid_records::beside("blind"),
        only: Vec::new(),
    };
    let mut with = None;
    while let Some(arg) = args.next() {
        let value = args.next().ok_or(USAGE)?;
        match arg.as_str() {
            "--practice" => request.practice = value.into(),
            "--only" => request.only.push(value),
            "--with" => with = Some(PathBuf::from(value)),
            other => return Err(format!("unknown option {other}; {USAGE}").into()),
        }
    }
    let say = |line: &str| println!("{line}");
    let outcome = match (verb.as_str(), with) {
        ("record", None) => {
            record(&request, &say)?;
            println!("recorded in {}", request.folder.display());
            return Ok(true);
        }
        ("compare", None) => compare(&request, &say)?,
        ("compare", Some(now)) => compare_folders(&request, &now)?,
        _ => return Err(USAGE.into()),
    };
    for (name, difference) in &outcome.different {
        println!("{name}: {difference}");
    }
    println!(
        "{} of {} files are equal, {} differ",
        outcome.files - outcome.different.len(),
        outcome.files,
        outcome.different.len()
    );
    if outcome.files == 0 {
        return Err("nothing was compared: no file begins with what --only asks for".into());
    }
    Ok(outcome.different.is_empty())
}
