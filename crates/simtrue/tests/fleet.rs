//! `simtrue fleet` as a command: killed at any moment, run through an array's script, collected.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use pid_withheld::fleet::FleetPlan;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn command(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_simtrue"));
    command.args(words);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Asserts that a command ended with a code; what it printed.
fn ended(output: &Output, code: i32) -> String {
    let (out, told) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{out}\n{told}");
    out
}

fn run(words: &[&str], code: i32) -> String {
    ended(&command(words).output().expect("the command runs"), code)
}

/// Logs of a fleet with their manifest, planned; the folder of the fleet.
fn planned(at: &Path, plan: FleetPlan, slices: &str) -> PathBuf {
    let drawn = plan.draw().expect("a robot");
    let mut manifest = "unit,time,log\n".to_owned();
    for unit in 0..plan.units {
        for k in 0..plan.logs {
            let (day, log) = drawn.log(unit, k);
            fs::write(at.join(format!("{unit}_{k}.csv")), log).expect("written");
            manifest.push_str(&format!("u{unit:02},{day:.3},{unit}_{k}.csv\n"));
        }
    }
    fs::write(at.join("fleet.csv"), manifest).expect("written");
    fs::write(at.join("nominal.toml"), drawn.nominal()).expect("written");
    let path = |name: &str| at.join(name).display().to_string();
    let words = [
        "fleet",
        "plan",
        &path("nominal.toml"),
        &path("fleet.csv"),
        "--out",
        &path("fleet"),
        "--slices",
        slices,
    ];
    let said = run(&words, 0);
    assert!(
        said.contains(&format!("hq submit --array 1-{slices}")),
        "{said}"
    );
    at.join("fleet")
}

/// Results by name; every one is whole.
fn results(fleet: &Path) -> BTreeMap<String, String> {
    let files = fs::read_dir(fleet.join("results")).expect("results");
    let files = files.map(|file| {
        let file = file.expect("a file").path();
        let text = fs::read_to_string(&file).expect("a result");
        pid_fleet::run::Entry::read(&file).expect("a whole result");
        (
            file.file_name()
                .expect("a name")
                .to_string_lossy()
                .into_owned(),
            text,
        )
    });
    files.collect()
}

/// A copy of a planned fleet without results.
fn copied(fleet: &Path, to: &Path) -> PathBuf {
    for folder in ["results", "part"] {
        fs::create_dir_all(to.join(folder)).expect("made");
    }
    for name in ["fleet.toml", "nominal.toml", "jobs.csv"] {
        fs::copy(fleet.join(name), to.join(name)).expect("copied");
    }
    to.to_owned()
}

#[test]
fn a_killed_run_loses_its_log_at_most_and_leaves_no_wrong_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = FleetPlan {
        seed: 5,
        units: 12,
        logs: 5,
        odd: 0,
    };
    let fleet = planned(folder.path(), plan, "2");
    let whole = copied(&fleet, &folder.path().join("whole"));
    let said = run(&["fleet", "run", &whole.display().to_string()], 0);
    assert!(
        said.starts_with("60 logs: 60 measured, 0 were done, 0 tell nothing"),
        "{said}"
    );
    let expected = results(&whole);
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let place = fleet.display().to_string();
    for kill in 1..=12_usize {
        let before = results(&fleet).len();
        let mut child = command(&["fleet", "run", &place])
            .stdout(Stdio::null())
            .spawn()
            .expect("it starts");
        // Some are killed before their first result, most behind a few, between reading and renaming.
        let wanted = before + random.random_range(0..4);
        let count = || {
            fs::read_dir(fleet.join("results"))
                .expect("results")
                .count()
        };
        while count() < wanted && child.try_wait().expect("a state").is_none() {
            std::thread::sleep(Duration::from_micros(100));
        }
        std::thread::sleep(Duration::from_micros(random.random_range(0..8_000)));
        child.kill().expect("killed");
        child.wait().expect("ended");
        let found = results(&fleet);
        assert!(found.len() >= wanted.min(60), "{kill}: results are lost");
        assert!(
            found
                .iter()
                .all(|(name, text)| expected.get(name) == Some(text)),
            "{kill}"
        );
        // What a kill leaves unfinished lies elsewhere, one file at most.
        let parts = fs::read_dir(fleet.join("part")).expect("parts").count();
        assert!(parts <= kill, "{parts} parts of {kill} kills");
    }
    let done = results(&fleet).len();
    let said = run(&["fleet", "run", &place], 0);
    let told = format!("60 logs: {} measured, {done} were done", 60 - done);
    assert!(said.starts_with(&told), "{said}");
    assert_eq!(results(&fleet), expected);
    // A corrupt result is named, and made again.
    let third = fleet.join("results/000003.json");
    fs::write(&third, "{\"schema\":1,").expect("written");
    let said = run(&["fleet", "collect", &place], 3);
    assert!(said.contains("corrupt  job 3 (u00)"), "{said}");
    run(&["fleet", "run", &place, "--job", "3"], 0);
    assert_eq!(results(&fleet), expected);
    // A changed log is measured again, and only that one.
    let log = folder.path().join("0_1.csv");
    let mut text = fs::read_to_string(&log).expect("a log");
    text = text.replacen(",0.", ",0.0", 1);
    fs::write(&log, text).expect("written");
    let said = run(&["fleet", "run", &place], 0);
    assert!(
        said.starts_with("60 logs: 1 measured, 59 were done"),
        "{said}"
    );
}

/// A scheduler sends SIGTERM before it kills.
#[test]
#[cfg(unix)]
fn a_run_that_is_told_to_end_keeps_what_it_measured() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = FleetPlan {
        seed: 6,
        units: 12,
        logs: 5,
        odd: 0,
    };
    let fleet = planned(folder.path(), plan, "2");
    let mut child = command(&["fleet", "run", &fleet.display().to_string()])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    while results(&fleet).is_empty() && child.try_wait().expect("a state").is_none() {
        std::thread::sleep(Duration::from_micros(100));
    }
    let told = Command::new("kill")
        .args(["-TERM", &child.id().to_string()])
        .status();
    assert!(told.expect("a signal").success());
    let said = ended(&child.wait_with_output().expect("ended"), 130);
    let done = results(&fleet).len();
    assert!(done < 60, "it was done before it was told");
    let told = format!("60 logs: {done} measured, 0 were done");
    assert!(said.starts_with(&told), "{said}");
}

#[test]
#[cfg(unix)]
fn an_array_of_slurm_measures_every_log_once_and_odd_units_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = FleetPlan {
        seed: 3,
        units: 40,
        logs: 8,
        odd: 2,
    };
    let fleet = planned(folder.path(), plan, "7");
    let script = fleet.join("slurm.sh");
    let checked = Command::new("bash")
        .arg("-n")
        .arg(&script)
        .output()
        .expect("bash runs");
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    let own = Path::new(env!("CARGO_BIN_EXE_simtrue"))
        .parent()
        .expect("a folder");
    let path = format!(
        "{}:{}",
        own.display(),
        std::env::var("PATH").unwrap_or_default()
    );
    let mut measured = 0;
    for task in 1..=7 {
        let output = Command::new("bash")
            .arg(&script)
            .env("PATH", &path)
            .env("SLURM_ARRAY_TASK_ID", task.to_string())
            .output()
            .expect("bash runs");
        let said = ended(&output, 0);
        let count = said.split(' ').next().and_then(|n| n.parse::<usize>().ok());
        measured += count.expect("a number of logs");
    }
    assert_eq!((measured, results(&fleet).len()), (320, 320));
    let place = fleet.display().to_string();
    let said = run(&["fleet", "collect", &place, "--exit-code"], 10);
    let read = fs::read_to_string(fleet.join("fleet.json")).expect("a summary");
    let summary: pid_fleet::Summary = serde_json::from_str(&read).expect("a summary");
    let drawn = plan.draw().expect("a robot");
    let mut odd: Vec<String> = drawn
        .odd()
        .iter()
        .map(|o| format!("u{:02}", o.unit))
        .collect();
    odd.sort();
    let named: Vec<&str> = summary.standing_out().map(|u| u.name.as_str()).collect();
    assert_eq!(named, odd, "{said}\n{:?}", drawn.odd());
    // The next unit is described, within the tolerances of what is known now.
    let next =
        pid_interpret::nominal::Nominal::read(fleet.join("prior.toml")).expect("a description");
    let before =
        pid_interpret::nominal::Nominal::read(fleet.join("nominal.toml")).expect("a description");
    let width = |n: &pid_interpret::nominal::Nominal| {
        let own = n.tolerances().iter().find(|t| t.name == "coulomb_j1");
        own.map(|t| t.half_width / t.nominal).expect("a friction")
    };
    assert!(
        (width(&before) - 0.4).abs() < 1e-9 && (0.1..0.25).contains(&width(&next)),
        "{}",
        width(&next)
    );
    assert!(fleet.join("report.html").is_file());
}
