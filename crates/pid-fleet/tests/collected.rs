//! What is collected of results whose hierarchy is known, and what is said of results that are none.

use std::fs;
use std::path::Path;

use pid_fleet::collect::Lost;
use pid_fleet::drift::Shape;
use pid_fleet::plan::{Cause, Kind, Quantity, SCHEMA};
use pid_fleet::run::{Entry, plan_digest};
use pid_fleet::{Fleet, FleetError, Job, Measured, Plan, Summary, collect};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Mean, spread between units, from log to log, and of a log, per quantity.
const HIERARCHY: [[f64; 4]; 3] = [
    [10.0, 0.8, 0.1, 0.2],
    [0.5, 0.02, 0.0, 0.01],
    [-3.0, 0.0, 0.05, 0.05],
];
/// Growth of the second quantity per day, in all units.
const TREND: f64 = 1e-4;

fn plan() -> Plan {
    let quantity = |name: &str, kind: Kind| Quantity {
        name: name.to_owned(),
        unit: "N*m".to_owned(),
        formula: name.to_owned(),
        nominal: 1.0,
        kind,
    };
    let joint = "a".to_owned();
    Plan {
        schema: SCHEMA,
        robot: "arm".to_owned(),
        reading: pid_fleet::Reading::default(),
        dates: true,
        cutoff: 10.0,
        held: Vec::new(),
        quantities: vec![
            quantity("coulomb_a", Kind::Parameter),
            quantity("viscous_a", Kind::Parameter),
            quantity("residual_a", Kind::Residual { joint }),
        ],
        causes: vec![Cause {
            name: "gain_a".to_owned(),
            unit: "1".to_owned(),
            moves: vec![-10.0, -0.5, 0.0],
        }],
    }
}

/// A fleet whose results are drawn; `added` is what a unit has on a day, per quantity.
fn drawn(
    folder: &Path,
    (units, logs): (usize, usize),
    seed: u64,
    added: impl Fn(usize, f64) -> [f64; 3],
) -> Fleet {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { random.sample(StandardNormal) };
    let day = |k: usize| 20_000.0 + 36.0 * k as f64;
    let jobs: Vec<Job> = (0..units * logs)
        .map(|i| Job {
            unit: format!("u{:03}", i / logs),
            time: day(i % logs),
            log: format!("{i}.csv").into(),
        })
        .collect();
    let fleet = Fleet {
        folder: folder.to_owned(),
        plan: plan(),
        jobs,
    };
    fleet.write("").expect("written");
    let digest = plan_digest(folder).expect("a digest");
    for unit in 0..units {
        let level = HIERARCHY.map(|[mean, spread, ..]| mean + spread * normal());
        for k in 0..logs {
            let (mut values, mut deviations) = (Vec::new(), Vec::new());
            for (q, [.., within, own]) in HIERARCHY.into_iter().enumerate() {
                let trend = if q == 1 {
                    TREND * (day(k) - day(0))
                } else {
                    0.0
                };
                values.push(
                    level[q] + within * normal() + own * normal() + trend + added(unit, day(k))[q],
                );
                deviations.push(own);
            }
            let job = unit * logs + k;
            let entry = Entry {
                schema: SCHEMA,
                job,
                plan: digest.clone(),
                log: String::new(),
                measured: Some(Measured { values, deviations }),
                error: None,
            };
            let text = serde_json::to_string(&entry).expect("JSON");
            fs::write(fleet.result(job), text).expect("written");
        }
    }
    fleet
}

fn named(summary: &Summary) -> Vec<&str> {
    summary.standing_out().map(|u| u.name.as_str()).collect()
}

#[test]
fn the_hierarchy_is_found_and_healthy_units_stay_unnamed() {
    let folder = tempfile::tempdir().expect("a folder");
    let fleet = drawn(folder.path(), (600, 8), 1, |_, _| [0.0; 3]);
    let summary = collect(&fleet, 0.01).expect("a summary");
    assert!(summary.gaps.is_empty());
    for (over, [mean, spread, within, own]) in summary.quantities.iter().zip(HIERARCHY) {
        // The level counts at the middle of the time.
        let middle = if over.name == "viscous_a" {
            TREND * 126.0
        } else {
            0.0
        };
        assert!(
            (over.mean - mean - middle).abs() < 4.0 * over.deviation,
            "{over:?}"
        );
        assert!(
            (over.spread - spread).abs() < 0.1 * spread + 0.2 * own,
            "{over:?}"
        );
        assert!(
            (over.within - within).abs() < 0.1 * within + 0.3 * own,
            "{over:?}"
        );
        assert!((over.of_a_log - own).abs() < 1e-9, "{over:?}");
        assert!(over.far < 0.02, "{over:?}");
    }
    let drifts: Vec<bool> = summary.quantities.iter().map(|q| q.drifts).collect();
    assert_eq!(drifts, [false, true, false]);
    let (slope, deviation) = summary.quantities[1].trend.expect("a trend");
    assert!((slope - TREND).abs() < 4.0 * deviation && deviation < 0.1 * TREND);
    assert!(named(&summary).len() <= 2, "{:?}", named(&summary));
}

#[test]
fn odd_units_are_named_with_what_and_since_when() {
    let folder = tempfile::tempdir().expect("a folder");
    let fleet = drawn(folder.path(), (200, 10), 2, |unit, day| match unit {
        // Friction alone; a gain, which moves both; something without a name.
        7 => [6.0, 0.0, 0.0],
        20 => [-4.0, -0.2, 0.0],
        33 => [0.0, 0.0, 1.5],
        // Since the third month, and at once between two logs.
        50 => [0.04 * (day - 20_100.0).max(0.0), 0.0, 0.0],
        60 if day > 20_150.0 => [0.0, 0.1, 0.0],
        _ => [0.0; 3],
    });
    let summary = collect(&fleet, 0.01).expect("a summary");
    assert_eq!(named(&summary), ["u007", "u020", "u033", "u050", "u060"]);
    let first = |unit: usize| summary.units[unit].suspects[0].name.as_str();
    assert_eq!(
        (first(7), first(20), first(33)),
        ("coulomb_a", "gain_a", "residual_a")
    );
    let gain = &summary.units[20].suspects[0];
    assert!((gain.amount - 0.4).abs() < 4.0 * gain.deviation, "{gain:?}");
    let changed = |unit: usize| summary.units[unit].change.as_ref().expect("a change");
    let (ramp, step) = (changed(50), changed(60));
    assert_eq!(
        (ramp.change.shape, step.change.shape),
        (Shape::Ramp, Shape::Step)
    );
    assert!((ramp.change.onset - 20_100.0).abs() < 16.0, "{ramp:?}");
    assert_eq!(step.change.between, (20_144.0, 20_180.0));
    assert_eq!(
        (
            ramp.suspects[0].name.as_str(),
            step.suspects[0].name.as_str()
        ),
        ("coulomb_a", "viscous_a")
    );
    let words = summary.in_words();
    assert!(
        words.contains("u050: coulomb_a") && words.contains("since 2025-01-"),
        "{words}"
    );
    let page = pid_page_check::page(&summary.to_html("filter 10 Hz")).expect("in order");
    assert_eq!(page.plots, 6, "all units, and five over time");
}

#[test]
fn what_is_missing_corrupt_stale_or_failed_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let fleet = drawn(folder.path(), (10, 5), 3, |_, _| [0.0; 3]);
    let change = |job: usize, from: &str, to: &str| {
        let text = fs::read_to_string(fleet.result(job)).expect("a result");
        assert!(text.contains(from), "{text}");
        fs::write(fleet.result(job), text.replace(from, to)).expect("written");
    };
    fs::remove_file(fleet.result(3)).expect("removed");
    let whole = fs::read_to_string(fleet.result(11)).expect("a result");
    fs::write(fleet.result(11), &whole[..whole.len() / 2]).expect("written");
    let digest = plan_digest(folder.path()).expect("a digest");
    change(12, &digest, "0000");
    change(13, "\"job\":13", "\"job\":14");
    let failed = Entry {
        measured: None,
        error: Some("log.csv: no column".to_owned()),
        ..Entry::read(&fleet.result(20)).expect("a result")
    };
    let text = serde_json::to_string(&failed).expect("JSON");
    fs::write(fleet.result(20), text).expect("written");
    let summary = collect(&fleet, 0.01).expect("a summary");
    let gaps: Vec<(usize, Lost)> = summary.gaps.iter().map(|g| (g.job, g.what)).collect();
    let expected = [
        (3, Lost::Missing),
        (11, Lost::Corrupt),
        (12, Lost::Stale),
        (13, Lost::Corrupt),
        (20, Lost::Failed),
    ];
    assert_eq!(gaps, expected);
    assert_eq!(summary.counted(), 45);
    let words = summary.in_words();
    assert!(words.contains("corrupt  job 11 (u002) 11.csv"), "{words}");
    assert!(words.contains("log.csv: no column"), "{words}");
    for job in 0..45 {
        let _ = fs::remove_file(fleet.result(job));
    }
    let error = collect(&fleet, 0.01).expect_err("one unit is no fleet");
    assert!(matches!(error, FleetError::TooFew { units: 1 }), "{error}");
}

#[test]
fn a_folder_without_a_plan_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let error = Fleet::read(folder.path()).expect_err("no plan").to_string();
    assert!(
        error.contains("fleet.toml: cannot be read") && error.contains("simtrue fleet plan"),
        "{error}"
    );
    let fleet = drawn(folder.path(), (3, 2), 4, |_, _| [0.0; 3]);
    assert_eq!(Fleet::read(folder.path()).expect("a fleet"), fleet);
    fs::write(folder.path().join("fleet.toml"), "schema = 1\n").expect("written");
    let error = Fleet::read(folder.path()).expect_err("no plan").to_string();
    assert!(
        error.contains("fleet.toml:1:1: missing field") && error.contains("plan the fleet again"),
        "{error}"
    );
}
