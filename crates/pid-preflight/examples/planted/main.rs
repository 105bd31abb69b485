//! Plants faults into drawn records and counts what the check finds, and what it finds in clean ones:
//! `cargo run --release -p pid-preflight --example planted -- --seed S --cases N [--joints J] [--verbose]`
//!
//! A case is a drawn robot of `pid-withheld`, five out of six with an effect that its nominal description
//! lacks. Each case is checked twice: clean, and with one planted fault. The kinds take turns.

#[path = "../../tests/plant.rs"]
mod plant;

use std::collections::BTreeMap;
use std::error::Error;

use pid_data::Dataset;
use pid_preflight::{Finding, Settings, Severity, check};
use pid_withheld::{Plan, lay_out};
use plant::{Draws, KINDS, described, names, plant};

/// Cases, found, alone (nothing else said that is wrong) of a kind.
type Table = BTreeMap<&'static str, [usize; 3]>;

#[expect(clippy::print_stdout, reason = "a command")]
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, default: usize| -> Result<usize, Box<dyn Error>> {
        match arguments
            .iter()
            .position(|a| a == name)
            .and_then(|i| arguments.get(i + 1))
        {
            Some(text) => Ok(text.parse()?),
            None => Ok(default),
        }
    };
    let (seed, cases, joints) = (
        number("--seed", 1)?,
        number("--cases", 28)?,
        number("--joints", 6)?,
    );
    let first = number("--first", 0)?;
    let verbose = arguments.iter().any(|a| a == "--verbose");
    let plan = Plan {
        seed: seed as u64,
        cases: first + cases,
        joints,
        nulls: false,
    };
    let folder = std::env::temp_dir().join(format!("pid-preflight-planted-{seed}-{joints}"));
    let settings = Settings {
        determinable: false,
        ..Settings::default()
    };

    let mut table = Table::new();
    let (mut clean, mut wrong, mut doubtful, mut slowest) = (0, 0, 0, 0.0_f64);
    for i in first..first + cases {
        let here = lay_out(&plan, i, &folder)?;
        let data = Dataset::read(&here)?;
        let text = std::fs::read_to_string(here.join("nominal.toml"))?;
        let start = std::time::Instant::now();
        let found = check(&data, &described(&text), &settings);
        slowest = slowest.max(start.elapsed().as_secs_f64());
        let worst = found.iter().map(|f| f.severity).max();
        clean += 1;
        wrong += usize::from(worst == Some(Severity::Wrong));
        doubtful += usize::from(worst == Some(Severity::Doubtful));
        if verbose {
            print_all("clean", &plan.id(i), &found, &plan.truth(i)?.causes);
        }
        // The kinds take turns; a kind that this robot cannot have gives its turn to the next.
        let mut draws = Draws(seed as u64 ^ (i as u64) << 20);
        let turn = |k: usize| KINDS[(i + k) % KINDS.len()];
        let Some(planted) = (0..KINDS.len()).find_map(|k| plant(turn(k), &data, &text, &mut draws))
        else {
            continue;
        };
        let found = check(&planted.data, &described(&planted.nominal), &settings);
        let named = found.iter().any(|f| names(f, &planted));
        let others = found
            .iter()
            .filter(|f| f.severity == Severity::Wrong && !names(f, &planted))
            .count();
        let line = table.entry(planted.kind).or_default();
        line[0] += 1;
        line[1] += usize::from(named);
        line[2] += usize::from(named && others == 0);
        if verbose && (!named || others > 0) {
            let what = format!("planted {} at {:?}", planted.kind, planted.joints);
            print_all(&what, &plan.id(i), &found, &plan.truth(i)?.causes);
        }
    }
    println!("seed {seed}, {cases} cases of up to {joints} joints\n");
    println!(
        "{:<18} {:>6} {:>6} {:>22}",
        "planted", "cases", "found", "nothing else is wrong"
    );
    let mut sum = [0; 3];
    for (kind, line) in &table {
        println!("{kind:<18} {:>6} {:>6} {:>22}", line[0], line[1], line[2]);
        sum.iter_mut().zip(line).for_each(|(s, x)| *s += x);
    }
    println!("{:<18} {:>6} {:>6} {:>22}", "all", sum[0], sum[1], sum[2]);
    println!(
        "\nclean: {clean}, with a finding `wrong` {wrong}, `doubtful` at most {doubtful}; slowest check {slowest:.2} s"
    );
    Ok(())
}

/// Prints what is more than a note.
#[expect(clippy::print_stdout, reason = "a command")]
fn print_all(what: &str, id: &str, found: &[Finding], causes: &[pid_withheld::Cause]) {
    let told: Vec<&Finding> = found
        .iter()
        .filter(|f| f.severity > Severity::Note)
        .collect();
    if told.is_empty() && what == "clean" {
        return;
    }
    println!("-- {id} {what}; effects {causes:?}");
    told.iter()
        .for_each(|f| println!("   {}", f.to_string().replace('\n', "\n   ")));
}
