//! Results of a build, recorded bit for bit and compared with those of another build.
//!
//! A pure move of code leaves every recorded file as it is; where a step changes digits on purpose,
//! the comparison says which results changed. A folder holds one folder for each [`Part`], in it
//! files of JSON or text:
//!
//! ```text
//! build.txt                    what made the folder: a hash of the program
//! demo/                        fit.json and diagnosis.json of the command without arguments
//! practice/p01.json            diagnoses of the practice set
//! draws/cases/ID, truth/ID     drawn study cases
//! study/ID.json                diagnoses of the recorded draws: new draws change nothing here
//! hock_schittkowski/           outcomes of the collection, a file for each solver
//! expansions/FILE_ROBOT.*      code, equations and operation counts of every declared robot of the workspace
//! now-HASH/                    the same of a later build, made by the comparison
//! ```
//!
//! What is there already is not made again: an interrupted run goes on where it stopped.

pub mod command;
mod compare;
mod items;

use std::error::Error;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;

pub use compare::{Difference, difference};
pub use items::as_command;

/// Why a net cannot be recorded or compared.
pub type Failure = Box<dyn Error + Send + Sync>;

/// What is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The command without arguments.
    Demo,
    /// Expansions of all declared robots.
    Expansions,
    /// The Hock-Schittkowski collection.
    HockSchittkowski,
    /// Study cases: records and causes.
    Draws,
    /// Diagnoses of the study cases.
    Study,
    /// Diagnoses of the practice set.
    Practice,
}

impl Part {
    /// All parts, the quick ones first.
    pub const ALL: [Self; 6] = [
        Self::Demo,
        Self::Expansions,
        Self::HockSchittkowski,
        Self::Draws,
        Self::Study,
        Self::Practice,
    ];

    /// Name of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Demo => "demo",
            Self::Expansions => "expansions",
            Self::HockSchittkowski => "hock_schittkowski",
            Self::Draws => "draws",
            Self::Study => "study",
            Self::Practice => "practice",
        }
    }
}

/// What to record or compare.
#[derive(Debug, Clone)]
pub struct Request {
    /// The folder of the net.
    pub folder: PathBuf,
    /// The practice set; its absence is an error unless [`Self::only`] leaves it out.
    pub practice: PathBuf,
    /// Prefixes of `PART/ITEM` to be taken; empty: everything.
    pub only: Vec<String>,
}

impl Request {
    fn takes(&self, part: Part, item: &str) -> bool {
        let name = format!("{}/{item}", part.name());
        self.only.is_empty() || self.only.iter().any(|prefix| name.starts_with(prefix))
    }

    fn asks_for(&self, part: Part) -> bool {
        let folder = format!("{}/", part.name());
        let part_of =
            |prefix: &String| folder.starts_with(prefix) || prefix.starts_with(folder.as_str());
        self.only.is_empty() || self.only.iter().any(part_of)
    }
}

/// What a run tells while it goes on.
pub type Say<'a> = dyn Fn(&str) + Sync + 'a;

/// Outcome of a comparison.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Comparison {
    /// Number of files compared.
    pub files: usize,
    /// Files that differ, with the first difference.
    pub different: Vec<(String, Difference)>,
}

/// Hash of the running program.
fn build() -> Result<String, Failure> {
    let mut hasher = DefaultHasher::new();
    std::fs::read(std::env::current_exe()?)?.hash(&mut hasher);
    Ok(format!("{:016x}", hasher.finish()))
}

/// Marks a folder as this build's.
fn claim(folder: &Path) -> Result<(), Failure> {
    let (mark, own) = (folder.join("build.txt"), build()?);
    std::fs::create_dir_all(folder)?;
    match std::fs::read_to_string(&mark) {
        Ok(other) if other.trim() != own => Err(format!(
            "{} was recorded by another build ({}; this is {own}): compare with it, or record into another folder",
            folder.display(),
            other.trim()
        )
        .into()),
        Ok(_) => Ok(()),
        Err(_) => Ok(std::fs::write(mark, own + "\n")?),
    }
}

/// Records what is asked for into the request's folder.
///
/// # Errors
/// If the folder is another build's, the practice set is asked for and absent, or a result cannot
/// be made or written.
pub fn record(request: &Request, say: &Say<'_>) -> Result<(), Failure> {
    claim(&request.folder)?;
    make(request, &request.folder, say)
}

/// Makes the items of a request into `out`; diagnoses are of the draws in the request's folder.
fn make(request: &Request, out: &Path, say: &Say<'_>) -> Result<(), Failure> {
    for part in Part::ALL.into_iter().filter(|p| request.asks_for(*p)) {
        let place = out.join(part.name());
        std::fs::create_dir_all(&place)?;
        let mut items = items::of(part, request, &place)?;
        items.retain(|item| request.takes(part, &item.name) && !(item.done)());
        let (number, finished) = (items.len(), AtomicUsize::new(0));
        items.par_iter().try_for_each(|item| {
            let clock = Instant::now();
            (item.make)().map_err(|e| format!("{}/{}: {e}", part.name(), item.name))?;
            say(&format!(
                "{}/{}: {:.1} s ({} of {number})",
                part.name(),
                item.name,
                clock.elapsed().as_secs_f64(),
                finished.fetch_add(1, Ordering::Relaxed) + 1
            ));
            Ok::<(), Failure>(())
        })?;
    }
    Ok(())
}

/// Makes what is asked for by this build and compares it with the request's folder.
///
/// # Errors
/// If the folder holds nothing of a part, or a result cannot be made, read or written.
pub fn compare(request: &Request, say: &Say<'_>) -> Result<Comparison, Failure> {
    let now = request.folder.join(format!("now-{}", build()?));
    make(request, &now, say)?;
    compare_folders(request, &now)
}

/// Compares two recorded folders: the request's and a later one.
///
/// # Errors
/// If a part is in neither, or a file cannot be read.
pub fn compare_folders(request: &Request, now: &Path) -> Result<Comparison, Failure> {
    let mut outcome = Comparison::default();
    for part in Part::ALL.into_iter().filter(|p| request.asks_for(*p)) {
        let (before, after) = (request.folder.join(part.name()), now.join(part.name()));
        let mut names = compare::files(&before)?;
        if names.is_empty() {
            return Err(format!(
                "{} holds no files: record this part first, or leave it out by --only",
                before.display()
            )
            .into());
        }
        names.extend(compare::files(&after)?);
        for name in names.iter().filter(|name| request.takes(part, name)) {
            outcome.files += 1;
            if let Some(d) = compare::of_files(&before.join(name), &after.join(name))? {
                outcome
                    .different
                    .push((format!("{}/{name}", part.name()), d));
            }
        }
    }
    Ok(outcome)
}
