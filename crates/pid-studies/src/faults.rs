//! `pid-studies faults`: faults planted into drawn records, and what the preflight finds of them.
//!
//! A case is a drawn robot of `pid-withheld`, five out of six with an effect that its nominal description
//! lacks. Each case is checked twice: clean, and with one planted fault. The kinds take turns.

#[path = "../../pid-preflight/tests/plant.rs"]
mod plant;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use pid_cli::progress::Progress;
use pid_data::Dataset;
use pid_fleet::Slice;
use pid_preflight::{Finding, Settings, Severity, check};
use pid_withheld::{Drawing, Plan, lay_out};
use rayon::prelude::*;

use crate::Failure;
use plant::{Draws, KINDS, described, names, plant};

/// Arguments of `pid-studies faults`.
#[derive(Debug, Clone, Args)]
pub struct FaultsArgs {
    /// Seed of robots, effects, motions, noise and faults.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of cases.
    #[arg(long, default_value_t = 30)]
    cases: usize,
    /// First case: a study may run in parts.
    #[arg(long, default_value_t = 0)]
    first: usize,
    /// Only the K-th of N parts of the cases, K from 1.
    #[arg(long, value_name = "K/N", default_value = "1/1")]
    slice: Slice,
    /// Most joints of a robot.
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u8).range(1..=6))]
    joints: u8,
    /// Folder for the drawn cases.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-faults")]
    out: PathBuf,
    /// Print what was found of every fault that is not named, and of every clean record with a finding.
    #[arg(long)]
    verbose: bool,
}

/// What was found of a planted fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Planted {
    /// Its kind.
    pub kind: &'static str,
    /// A finding has its kind and its joints.
    pub named: bool,
    /// Other findings that are wrong.
    pub others: usize,
    /// Anything is wrong or doubtful.
    pub any: bool,
}

/// A case: the worst finding of its clean record, and its planted fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Case {
    /// `None`: notes at most.
    pub clean: Option<Severity>,
    /// `None`: neither the robot nor its record can have any of the faults.
    pub planted: Option<Planted>,
    /// What is worth printing.
    pub words: String,
}

/// Runs the study and prints its table.
///
/// # Errors
/// What stops it.
pub fn run(args: &FaultsArgs) -> Result<(), Failure> {
    let progress = Progress::start("drawing and checking cases");
    let plan = Plan {
        seed: args.seed,
        cases: args.first + args.cases,
        fewest: 1,
        joints: usize::from(args.joints),
        causes: Drawing::All,
    };
    let wanted: Vec<usize> = args.slice.of(args.cases).collect();
    let cases: Vec<Case> = wanted
        .into_par_iter()
        .map(|i| case(&plan, args.first + i, &args.out))
        .collect::<Result<_, _>>()?;
    drop(progress);
    if args.verbose {
        cases.iter().for_each(|case| print!("{}", case.words));
    }
    println!(
        "seed {}, cases {} to {} of up to {} joints, part {}/{}\n",
        args.seed,
        args.first,
        plan.cases.saturating_sub(1),
        args.joints,
        args.slice.part,
        args.slice.of
    );
    print!("{}", table(&cases));
    Ok(())
}

/// Draws a case and checks it, clean and with a fault.
///
/// # Errors
/// A case that cannot be drawn, written or read.
pub fn case(plan: &Plan, i: usize, folder: &std::path::Path) -> Result<Case, Failure> {
    let settings = Settings {
        determinable: false,
        ..Settings::default()
    };
    let here = lay_out(plan, i, folder)?;
    let data = Dataset::read(&here)?;
    let text = std::fs::read_to_string(here.join("nominal.toml"))?;
    let found = check(&data, &described(&text), &settings);
    let worst = found.iter().map(|f| f.severity).max();
    let causes = plan.truth(i)?.causes;
    let mut words = String::new();
    let mut tell = |what: &str, found: &[Finding]| {
        let _ = writeln!(words, "-- {} {what}; effects {causes:?}", plan.id(i));
        for finding in found.iter().filter(|f| f.severity > Severity::Note) {
            let _ = writeln!(words, "   {}", finding.to_string().replace('\n', "\n   "));
        }
    };
    let clean = worst.filter(|s| *s > Severity::Note);
    if clean.is_some() {
        tell("clean", &found);
    }
    // The kinds take turns; a kind that this robot cannot have gives its turn to the next.
    let mut draws = Draws(plan.seed ^ (i as u64) << 20);
    let mut turns = (0..KINDS.len()).map(|k| KINDS[(i + k) % KINDS.len()]);
    let planted = turns.find_map(|kind| plant(kind, &data, &text, &mut draws));
    let planted = planted.map(|planted| {
        let found = check(&planted.data, &described(&planted.nominal), &settings);
        let named = found.iter().any(|f| names(f, &planted));
        let wrong = |f: &&Finding| f.severity == Severity::Wrong && !names(f, &planted);
        let others = found.iter().filter(wrong).count();
        if !named || others > 0 {
            let what = format!(
                "planted {} at {:?} {}",
                planted.kind, planted.joints, planted.place
            );
            tell(&what, &found);
        }
        Planted {
            kind: planted.kind,
            named,
            others,
            any: found.iter().any(|f| f.severity > Severity::Note),
        }
    });
    Ok(Case {
        clean,
        planted,
        words,
    })
}

/// Found, named otherwise and missed by kind, and the findings of clean records.
#[must_use]
pub fn table(cases: &[Case]) -> String {
    let mut lines: BTreeMap<&str, [usize; 5]> = BTreeMap::new();
    for planted in cases.iter().filter_map(|case| case.planted.as_ref()) {
        for key in [planted.kind, "~all"] {
            let line = lines.entry(key).or_default();
            let counts = [
                true,
                planted.named,
                planted.named && planted.others == 0,
                !planted.named && planted.any,
                !planted.any,
            ];
            line.iter_mut()
                .zip(counts)
                .for_each(|(n, x)| *n += usize::from(x));
        }
    }
    let mut out = format!(
        "{:<18} {:>6} {:>6} {:>12} {:>16} {:>7}\n",
        "planted", "cases", "found", "and no more", "named otherwise", "missed"
    );
    for (kind, [all, found, alone, otherwise, missed]) in &lines {
        // The sum stands last in the order of the table.
        let kind = kind.trim_start_matches('~');
        out += &format!("{kind:<18} {all:>6} {found:>6} {alone:>12} {otherwise:>16} {missed:>7}\n");
    }
    let clean = |severity| {
        cases
            .iter()
            .filter(|case| case.clean == Some(severity))
            .count()
    };
    out + &format!(
        "\nclean: {}, with a finding `wrong` {}, `doubtful` at most {}\n",
        cases.len(),
        clean(Severity::Wrong),
        clean(Severity::Doubtful)
    )
}
