//! Shared records: the cases of public reports, and records that are right though their robots have effects.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use pid_data::Dataset;
use pid_interpret::nominal::Nominal;
use pid_preflight::{Channel, Finding, FindingKind, Settings, Severity, check};
use pid_records::shared;

fn folders(path: &Path) -> Vec<std::path::PathBuf> {
    let mut out: Vec<_> = std::fs::read_dir(path)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.join("nominal.toml").exists())
        .collect();
    out.sort();
    out
}

fn worst_of(folder: &Path, allowed: Severity) {
    let settings = Settings {
        determinable: false,
        ..Settings::default()
    };
    for case in folders(folder) {
        let nominal = Nominal::read(case.join("nominal.toml")).unwrap();
        let found = check(&Dataset::read(&case).unwrap(), &nominal, &settings);
        let worse: Vec<&Finding> = found.iter().filter(|f| f.severity > allowed).collect();
        assert!(worse.is_empty(), "{}: {worse:#?}", case.display());
    }
}

#[test]
fn records_with_effects_are_not_wrong() {
    for name in ["blind", "messy", "robots"] {
        if let Some(folder) = shared(name) {
            worst_of(&folder, Severity::Doubtful);
        }
    }
}

/// The practice case of a robot that lacks nothing, with a change.
fn changed(change: impl Fn(&mut Dataset)) -> Option<Vec<Finding>> {
    let folder = shared("blind/p14")?;
    let mut data = Dataset::read(&folder).unwrap();
    change(&mut data);
    let nominal = Nominal::read(folder.join("nominal.toml")).unwrap();
    Some(check(&data, &nominal, &Settings::default()))
}

fn has(found: Option<Vec<Finding>>, joints: &[usize], kind: impl Fn(&FindingKind) -> bool) {
    let Some(found) = found else { return };
    let named = found.iter().any(|f| f.joints == joints && kind(&f.kind));
    assert!(named, "{found:#?}");
    let others = found
        .iter()
        .filter(|f| f.severity == Severity::Wrong && !kind(&f.kind))
        .count();
    assert_eq!(others, 0, "{found:#?}");
}

#[test]
fn the_public_logs_get_their_findings() {
    let clean = changed(|_| ());
    assert!(clean.is_none_or(|found| found.is_empty()));
    let swap = |d: &mut Dataset| {
        d.experiments
            .iter_mut()
            .for_each(|e| e.u.chunks_exact_mut(2).for_each(|row| row.swap(0, 1)))
    };
    has(
        changed(swap),
        &[1, 2],
        |k| matches!(k, FindingKind::Swapped { channel: Channel::Input, order } if *order == [2, 1]),
    );
    let flip = |d: &mut Dataset| {
        d.experiments
            .iter_mut()
            .for_each(|e| e.u.iter_mut().skip(1).step_by(2).for_each(|u| *u = -*u))
    };
    has(changed(flip), &[2], |k| {
        matches!(
            k,
            FindingKind::SignFlipped {
                channel: Channel::Input,
                ..
            }
        )
    });
    let degrees = |d: &mut Dataset| {
        for e in &mut d.experiments {
            e.q.iter_mut()
                .chain(e.v.as_mut().unwrap())
                .for_each(|q| *q *= 180.0 / PI);
        }
    };
    has(
        changed(degrees),
        &[1, 2],
        |k| matches!(k, FindingKind::Unit { channel: Channel::Motion, unit, .. } if unit == "degrees"),
    );
    let late = |d: &mut Dataset| {
        for e in &mut d.experiments {
            let old = e.u.clone();
            let rows = e.len();
            (0..rows).for_each(|i| {
                e.u[2 * i..2 * i + 2].copy_from_slice(&old[2 * i.saturating_sub(20)..][..2])
            });
        }
    };
    // 20 rows at 400 Hz.
    has(
        changed(late),
        &[1, 2],
        |k| matches!(k, FindingKind::InputClock { late } if (late - 0.05).abs() < 0.003),
    );
    let wrap = |d: &mut Dataset| {
        for e in &mut d.experiments {
            e.q.iter_mut()
                .step_by(2)
                .for_each(|q| *q = (*q + 2.6 + PI).rem_euclid(TAU) - PI - 2.6);
        }
    };
    has(changed(wrap), &[1], |k| {
        matches!(k, FindingKind::Wrapped { .. })
    });
    let milli = |d: &mut Dataset| {
        d.experiments
            .iter_mut()
            .for_each(|e| e.u.iter_mut().for_each(|u| *u *= 1e3))
    };
    has(
        changed(milli),
        &[1, 2],
        |k| matches!(k, FindingKind::Unit { channel: Channel::Input, factor, .. } if *factor == 1e-3),
    );
    let turns = |d: &mut Dataset| {
        d.experiments
            .iter_mut()
            .for_each(|e| e.q.iter_mut().step_by(2).for_each(|q| *q += 3.0 * TAU))
    };
    assert!(changed(turns).is_none_or(|found| found.is_empty()));
}
