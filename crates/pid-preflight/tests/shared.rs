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

/// Keeps the rows of every record whose index passes.
fn keep(data: &mut Dataset, passes: impl Fn(usize) -> bool) {
    for e in &mut data.experiments {
        let of = |x: &[f64], width: usize| -> Vec<f64> {
            let rows = x.chunks_exact(width).enumerate();
            let kept = rows.filter(|(i, _)| passes(*i));
            kept.flat_map(|(_, row)| row.to_vec()).collect()
        };
        (e.q, e.u) = (of(&e.q, 2), of(&e.u, 2));
        e.v = e.v.as_ref().map(|v| of(v, 2));
        e.t = of(&e.t, 1);
    }
}

#[test]
fn the_other_public_logs_get_theirs() {
    let milliseconds = |d: &mut Dataset| {
        d.experiments
            .iter_mut()
            .for_each(|e| e.t.iter_mut().for_each(|t| *t *= 1e3))
    };
    has(
        changed(milliseconds),
        &[],
        |k| matches!(k, FindingKind::TimeUnit { factor } if *factor == 1e-3),
    );
    let frozen = |d: &mut Dataset| {
        for e in &mut d.experiments {
            let middle = e.len() / 2;
            let held = e.q[2 * middle + 1];
            (middle..middle + 250).for_each(|i| e.q[2 * i + 1] = held);
        }
    };
    has(changed(frozen), &[2], |k| *k == FindingKind::FrozenChannel);
    let silent = |d: &mut Dataset| d.experiments.iter_mut().for_each(|e| e.u.fill(0.0));
    has(changed(silent), &[1, 2], |k| *k == FindingKind::ZeroInput);
    let dropped = |d: &mut Dataset| keep(d, |i| i % 20 != 7);
    // Of 2801 rows 140 are dropped in each of five records.
    has(changed(dropped), &[], |k| {
        *k == FindingKind::LostRows { count: 700 }
    });
    let outliers = |d: &mut Dataset| {
        for e in &mut d.experiments {
            (0..5).for_each(|k| e.q[2 * (300 + 500 * k)] += 0.5);
        }
    };
    has(changed(outliers), &[1], |k| {
        *k == FindingKind::Outliers { count: 25 }
    });
    let slow = |d: &mut Dataset| keep(d, |i| i.is_multiple_of(8));
    has(
        changed(slow),
        &[],
        |k| matches!(k, FindingKind::RateLow { rate, .. } if (rate - 50.0).abs() < 0.1),
    );
}

#[test]
fn gravity_upwards_is_found_with_the_right_vector() {
    let Some(folder) = shared("blind/p14") else {
        return;
    };
    let text = std::fs::read_to_string(folder.join("nominal.toml")).unwrap();
    let text = text.replace("gravity = [0.0, 0.0, -9.81]", "gravity = [0.0, 0.0, 9.81]");
    let nominal = Nominal::parse("nominal.toml", &text).unwrap();
    let found = check(
        &Dataset::read(&folder).unwrap(),
        &nominal,
        &Settings::default(),
    );
    assert_eq!(
        pid_preflight::mended_gravity(&found),
        Some([0.0, 0.0, -9.81])
    );
    assert_eq!(
        found
            .iter()
            .filter(|f| f.severity == Severity::Wrong)
            .count(),
        1,
        "{found:#?}"
    );
}
