//! What each number of the criteria decides: drawn cases are diagnosed with one number lower and higher, all others as
//! they are, and the right answers are counted.
//!
//! ```text
//! pid-studies criteria --seed 91201
//! ```

use std::path::PathBuf;

use clap::Args;
use pid_cli::output;
use pid_cli::progress::Progress;
use pid_diagnose::criteria::Criteria;
use pid_diagnose::diagnosis::Diagnosis;
use pid_diagnose::search::Settings;
use pid_withheld::{Drawing, Plan, UntidyPlan};
use rayon::prelude::*;
use serde_json::{Map, Value};

use super::right;
use super::study::diagnose_one;
use crate::untidy::{Effect, LEAST, Row, row};
use crate::{Failure, make_folder};

/// Arguments of `pid-studies criteria`.
#[derive(Debug, Clone, Args)]
pub struct CriteriaArgs {
    /// Cases with one effect, none, or one outside the list.
    #[arg(long, default_value_t = 30)]
    cases: usize,
    /// Cases with several effects and untidy records.
    #[arg(long, default_value_t = 6)]
    untidy: usize,
    /// Seed of both.
    #[arg(long, default_value_t = 91201)]
    seed: u64,
    /// Most joints of a robot.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=6))]
    joints: u8,
    /// Only these numbers.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    only: Vec<String>,
    /// Factors on each number.
    #[arg(long, value_delimiter = ',', default_values_t = [0.5, 2.0])]
    factors: Vec<f64>,
    /// Folder for cases and diagnoses; those that are there already are kept.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-criteria")]
    out: PathBuf,
}

/// What a factor acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scale {
    /// The number.
    Value,
    /// What it is above one: a ratio that chance leaves at one.
    AboveOne,
    /// What it is below one: a share of a whole.
    BelowOne,
    /// Nothing: a convention, or a share of right verdicts that is stated.
    Fixed,
}

impl Scale {
    fn of(name: &str) -> Scale {
        match name {
            "calm" | "nominal_misfit" | "largest_misfit" | "unseen" | "near" | "nominal_spread"
            | "unexplained" => Scale::AboveOne,
            "majority" | "majority_of_all" => Scale::BelowOne,
            "rare" | "chance" | "right_stated" | "right_estimated" | "right_unknown" => {
                Scale::Fixed
            }
            _ => Scale::Value,
        }
    }

    /// The number after a factor.
    fn apply(self, x: f64, factor: f64) -> f64 {
        match self {
            Scale::Value => factor * x,
            Scale::AboveOne => 1.0 + factor * (x - 1.0),
            Scale::BelowOne => 1.0 - factor * (1.0 - x),
            Scale::Fixed => x,
        }
    }
}

/// The criteria with one number changed; `None` where it is none that changes.
fn changed(names: &Map<String, Value>, name: &str, factor: f64) -> Option<(f64, Criteria)> {
    let now = names.get(name)?;
    let next = Scale::of(name).apply(now.as_f64()?, factor);
    let mut all = names.clone();
    let (next, value) = if now.is_u64() {
        let whole = next.round().max(0.0) as u64;
        (whole as f64, Value::from(whole))
    } else {
        (next, Value::from(next))
    };
    if *now == value {
        return None;
    }
    all.insert(name.to_owned(), value);
    let criteria = serde_json::from_value(Value::Object(all)).ok()?;
    Some((next, criteria))
}

/// What is said of one case and whether that is right.
#[derive(Debug, Clone, PartialEq)]
struct Said {
    id: String,
    words: String,
    /// Right answers and wrong names.
    right: usize,
    wrong: usize,
}

/// The verdict of a diagnosis and its names in one line.
fn words(d: &Diagnosis) -> String {
    let verdict = d.verdict.word();
    if d.effects.is_empty() {
        return verdict.to_owned();
    }
    let name = |effect: &str, joint: Option<usize>| {
        joint.map_or_else(|| effect.to_owned(), |j| format!("{effect}:{j}"))
    };
    let names: Vec<String> = (d.effects.iter())
        .map(|e| name(&e.effect, e.joint))
        .collect();
    let law = d.remainder.as_ref().is_some_and(|r| r.law.is_some());
    let law = if law { " + law" } else { "" };
    format!("{verdict}: {}{law}", names.join(" "))
}

/// Effects of some share that are named, and wrong names.
fn score(row: &Row) -> (usize, usize) {
    let counted = |e: &&Effect| e.listed() && e.share.is_some_and(|s| s >= LEAST);
    let found = row.hidden.iter().filter(counted);
    (
        found.filter(|e| e.partner.is_some()).count(),
        row.named.iter().filter(|e| e.partner.is_none()).count(),
    )
}

/// All cases with the settings; their diagnoses stand in the folder `of` of this name.
fn all_cases(
    args: &CriteriaArgs,
    of: &str,
    criteria: Criteria,
) -> Result<(Vec<Said>, Vec<Said>), Failure> {
    let settings = Settings {
        criteria,
        ..Settings::default()
    };
    let joints = usize::from(args.joints);
    let (seed, cases) = (args.seed, args.cases);
    let tidy = Plan {
        seed,
        cases,
        fewest: 1,
        joints,
        causes: Drawing::All,
    };
    let untidy = UntidyPlan {
        seed,
        cases: args.untidy,
        joints,
    };
    let places = ["one", "several"].map(|kind| {
        let root = args.out.join(kind);
        let results = root.join(of);
        (root, results)
    });
    for (_, results) in &places {
        make_folder(results)?;
    }
    let [one, several] = &places;
    let single = |i| -> Result<Said, Failure> {
        let o = diagnose_one(&tidy, i, &settings, &one.0, &one.1)?;
        let right = right(&o);
        Ok(Said {
            words: words(&o.diagnosis),
            right: usize::from(right),
            wrong: usize::from(!right && !o.diagnosis.effects.is_empty()),
            id: o.id,
        })
    };
    let many = |i| -> Result<Said, Failure> {
        let o = diagnose_one(&untidy, i, &settings, &several.0, &several.1)?;
        let (right, wrong) = score(&row(&o));
        Ok(Said {
            words: words(&o.diagnosis),
            right,
            wrong,
            id: o.id,
        })
    };
    type All = Result<Vec<Said>, Failure>;
    let (several, one): (All, All) = rayon::join(
        || (0..args.untidy).into_par_iter().map(many).collect(),
        || (0..cases).into_par_iter().map(single).collect(),
    );
    Ok((one?, several?))
}

fn total(said: &[Said]) -> (usize, usize) {
    (
        said.iter().map(|s| s.right).sum(),
        said.iter().map(|s| s.wrong).sum(),
    )
}

/// One line: the value, the counts of both kinds and how many answers differ from `base`.
fn line(
    name: &str,
    value: f64,
    now: &(Vec<Said>, Vec<Said>),
    base: &(Vec<Said>, Vec<Said>),
) -> String {
    let differ =
        |a: &[Said], b: &[Said]| a.iter().zip(b).filter(|(a, b)| a.words != b.words).count();
    let (one, several) = (total(&now.0), total(&now.1));
    format!(
        "{name:22} {value:9.4}  one: right {:3} wrong {:2} other {:2}   several: right {:3} wrong {:2} other {:2}\n",
        one.0,
        one.1,
        differ(&now.0, &base.0),
        several.0,
        several.1,
        differ(&now.1, &base.1)
    )
}

/// Prints a line for each number and factor, and below it the answers that differ.
///
/// # Errors
/// A name that is none, or what stops a case.
pub fn run(args: &CriteriaArgs) -> Result<u8, Failure> {
    let Value::Object(names) = serde_json::to_value(Criteria::default())? else {
        return Err("the criteria are no table".into());
    };
    if let Some(name) = args.only.iter().find(|name| !names.contains_key(*name)) {
        let all: Vec<&str> = names.keys().map(String::as_str).collect();
        return Err(format!("{name} is no criterion; those are {}", all.join(", ")).into());
    }
    let progress = Progress::start("criteria as they are");
    let base = all_cases(args, "as-they-are", Criteria::default())?;
    output::print(&line("as they are", f64::NAN, &base, &base));
    let wanted = |name: &&String| args.only.is_empty() || args.only.contains(name);
    for name in names.keys().filter(wanted) {
        for &factor in &args.factors {
            let Some((value, criteria)) = changed(&names, name, factor) else {
                continue;
            };
            progress.step(format!("{name} = {value}"));
            let now = all_cases(args, &format!("{name}-{value}"), criteria)?;
            let mut text = line(name, value, &now, &base);
            let both = (now.0.iter().zip(&base.0)).chain(now.1.iter().zip(&base.1));
            for (now, base) in both.filter(|(now, base)| now.words != base.words) {
                text.push_str(&format!(
                    "    {}: {} -> {}\n",
                    now.id, base.words, now.words
                ));
            }
            output::print(&text);
        }
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_changes_or_is_a_convention() {
        let Value::Object(names) = serde_json::to_value(Criteria::default()).unwrap() else {
            panic!("the criteria are no table");
        };
        for name in names.keys() {
            for factor in [0.5, 2.0] {
                let now = names[name].as_f64().unwrap();
                match changed(&names, name, factor) {
                    None => assert_eq!(Scale::of(name), Scale::Fixed, "{name}"),
                    Some((value, criteria)) => {
                        assert_ne!(value, now, "{name}");
                        let all = serde_json::to_value(criteria).unwrap();
                        let others = |(key, value): &(&String, &Value)| {
                            *key != name && **value != names[*key]
                        };
                        assert_eq!(all[name].as_f64(), Some(value));
                        let all = all.as_object().unwrap();
                        assert_eq!(all.iter().filter(others).count(), 0, "{name}");
                    }
                }
            }
        }
    }

    #[test]
    fn ratios_change_beyond_one_and_shares_below() {
        let x = |name, x, factor| Scale::of(name).apply(x, factor);
        assert!((x("near", 1.4, 2.0) - 1.8).abs() < 1e-15);
        assert!((x("majority", 0.7, 0.5) - 0.85).abs() < 1e-15);
        assert!((x("margin", 12.0, 0.5) - 6.0).abs() < 1e-15);
    }
}
