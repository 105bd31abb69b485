//! `simtrue check`: records against a robot, before anything is fitted.

use std::path::Path;

use pid_interpret::nominal::Nominal;
use pid_logs::Found;
use pid_preflight::{Finding, Settings, Severity, check, fix, mended_gravity, open as open_folder};

use crate::args::open::CheckArgs;
use crate::error::CliError;
use crate::open::{Opened, as_stated, folders, open, robot_and_logs, wrong};
use crate::output;

/// Exit code where something contradicts the robot.
const WRONG: u8 = 1;

/// Checks a robot file with its logs, or every folder; the worst of them decides the exit code.
pub(crate) fn run(args: &CheckArgs) -> Result<u8, CliError> {
    if let Some((robot, logs)) = robot_and_logs(&args.paths) {
        let opened = open(robot, logs, &args.open)?;
        return one(&opened, &[], args);
    }
    let paths = folders(&args.paths, &args.open)?;
    if args.fix.is_some() && paths.len() > 1 {
        return Err(CliError::FixOfSeveral {
            number: paths.len(),
        });
    }
    let mut code = 0;
    for folder in paths {
        let (opened, repeated) = read(folder)?;
        if paths.len() > 1 {
            output::print(&format!("{}:\n", folder.display()));
        }
        code = code.max(one(&opened, &repeated, args)?);
    }
    Ok(code)
}

/// A folder, without the rows whose time does not increase.
fn read(folder: &Path) -> Result<(Opened, Vec<Finding>), CliError> {
    let nominal = Nominal::read(folder.join("nominal.toml"))?;
    let folder = open_folder(folder)?;
    let opened = Opened {
        nominal,
        records: as_stated(folder.dataset),
    };
    Ok((opened, folder.findings))
}

fn one(opened: &Opened, repeated: &[Finding], args: &CheckArgs) -> Result<u8, CliError> {
    let own = check(
        &opened.records.dataset,
        &opened.nominal,
        &Settings::default(),
    );
    let all: Vec<&Finding> = repeated.iter().chain(&own).collect();
    if args.json {
        let text = serde_json::to_string_pretty(&all).map_err(CliError::Json)?;
        output::print(&format!("{text}\n"));
    } else {
        output::print(&words(&all, &opened.nominal));
    }
    if let Some(folder) = &args.fix {
        let (dataset, done) = fix(&opened.records.dataset, &own);
        for line in &done {
            output::message(&format!("mended: {line}"));
        }
        if let Some(gravity) = mended_gravity(&own) {
            output::message(&format!(
                "not mended: gravity in the description; state {gravity:?}"
            ));
        }
        let records = Found {
            dataset,
            ..opened.records.clone()
        };
        let nominal = opened.nominal.clone();
        Opened { nominal, records }.write(folder)?;
    }
    let wrong = all.iter().any(|f| f.severity == Severity::Wrong);
    Ok(if wrong { WRONG } else { 0 })
}

/// Findings name joints by number: what the numbers stand for, in one line. Empty where no finding has a joint.
fn legend<'a>(findings: impl IntoIterator<Item = &'a Finding>, nominal: &Nominal) -> String {
    if findings.into_iter().all(|f| f.joints.is_empty()) {
        return String::new();
    }
    let joints = nominal.robot().joints.iter().enumerate();
    let names: Vec<String> = joints
        .map(|(j, joint)| format!("{} {}", j + 1, joint.name))
        .collect();
    format!("joints: {}\n", names.join(", "))
}

/// Findings for the terminal, the worst first.
fn words(findings: &[&Finding], nominal: &Nominal) -> String {
    let mut text = legend(findings.iter().copied(), nominal);
    for finding in findings {
        text.push_str(&format!("{finding}\n"));
    }
    let count = |severity| findings.iter().filter(|f| f.severity == severity).count();
    text.push_str(&format!(
        "{} wrong, {} doubtful, {} notes\n",
        count(Severity::Wrong),
        count(Severity::Doubtful),
        count(Severity::Note)
    ));
    text
}

/// Says what contradicts the robot and ends a run that follows, unless it is to go on `anyway`.
pub(crate) fn refuse_wrong(opened: &Opened, anyway: bool) -> Result<(), CliError> {
    let wrong = wrong(opened);
    let legend = legend(&wrong, &opened.nominal);
    if !legend.is_empty() {
        output::message(legend.trim_end());
    }
    for finding in &wrong {
        output::message(&finding.to_string());
    }
    match wrong.is_empty() || anyway {
        true => Ok(()),
        false => Err(CliError::Contradicts {
            number: wrong.len(),
        }),
    }
}
