//! Files that other tools wrote (tests/fixtures/make.py) give the numbers that those tools had.

use std::path::{Path, PathBuf};

use pid_data::{Dataset, InputHold, InputQuantity, Role, VelocityKind};
use pid_logs::{Entry, Found, Joint, LogError, Settings, read, write_folder};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn robot() -> [Joint; 2] {
    [Joint::revolute("shoulder"), Joint::revolute("elbow")]
}

fn torque() -> Settings {
    Settings {
        input: Some(InputQuantity::Torque),
        ..Settings::default()
    }
}

fn mapped(entries: &[&str]) -> Settings {
    let map = entries.iter().map(|e| Entry::parse(e).unwrap()).collect();
    Settings {
        map,
        ..Settings::default()
    }
}

fn found(name: &str, settings: &Settings) -> Found {
    read(&[fixture(name)], &robot(), settings).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn refused(name: &str, settings: &Settings) -> LogError {
    read(&[fixture(name)], &robot(), settings).expect_err("must be refused")
}

/// Columns of expected.csv: t, q1, q2, dq1, dq2, u1, u2, qref1, qref2.
fn expected() -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(fixture("expected.csv")).unwrap();
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|l| l.split(',').map(|c| c.parse().unwrap()).collect())
        .collect();
    (0..9)
        .map(|c| rows.iter().map(|r| r[c]).collect())
        .collect()
}

/// All records one after the other, by the columns of expected.csv.
fn columns(found: &Found) -> Vec<Vec<f64>> {
    let mut out = vec![Vec::new(); 9];
    for e in &found.dataset.experiments {
        out[0].extend(&e.t);
        let channels = [Some(&e.q), e.v.as_ref(), Some(&e.u), e.qref.as_ref()];
        for (c, values) in channels.into_iter().enumerate() {
            for (k, value) in values.into_iter().flatten().enumerate() {
                out[1 + 2 * c + k % 2].push(*value);
            }
        }
    }
    out
}

/// Compares columns; `tolerance` is absolute, zero for the very same numbers.
fn compare(name: &str, found: &Found, which: std::ops::Range<usize>, tolerance: f64) {
    let (have, want) = (columns(found), expected());
    for c in which {
        assert_eq!(have[c].len(), 40, "{name}: rows of column {c}");
        for (i, (a, b)) in have[c].iter().zip(&want[c]).enumerate() {
            assert!(
                (a - b).abs() <= tolerance,
                "{name}: column {c}, row {i}: {a} is not {b}"
            );
        }
    }
}

fn says(found: &Found, piece: &str) -> bool {
    found
        .assumptions
        .iter()
        .any(|a| a.to_string().contains(piece))
}

#[test]
fn joint_states_in_mcap_and_db3_are_the_same_numbers() {
    for name in [
        "joint_states_zstd.mcap",
        "joint_states_lz4.mcap",
        "joint_states_plain.mcap",
        "joint_states.db3",
    ] {
        let found = found(name, &torque());
        compare(name, &found, 1..7, 0.0);
        // Header stamps are whole nanoseconds; numpy's 0.01 · i is not.
        compare(name, &found, 0..1, 1e-15);
        assert!(
            says(&found, "time is that of the header stamps"),
            "{:?}",
            found.assumptions
        );
        assert_eq!(
            found.dataset.input_hold,
            InputHold::Linear,
            "effort of joint states is measured"
        );
        let roles: Vec<Role> = found.dataset.experiments.iter().map(|e| e.role).collect();
        assert_eq!(roles, [Role::Train, Role::Test]);
    }
}

#[test]
fn an_effort_without_a_stated_quantity_is_asked_for() {
    let told = refused("joint_states_zstd.mcap", &Settings::default());
    assert!(matches!(told, LogError::InputUnknown { .. }));
    let told = told.to_string();
    for piece in [
        "/joint_states/shoulder/effort",
        "--input current",
        "u:shoulder=/joint_states/shoulder/effort[N*m]",
    ] {
        assert!(told.contains(piece), "{told}");
    }
    // The robot's description says it.
    let drive = |name| Joint {
        input: Some(InputQuantity::Current),
        ..Joint::revolute(name)
    };
    let path = [fixture("joint_states_zstd.mcap")];
    let found = read(
        &path,
        &[drive("shoulder"), drive("elbow")],
        &Settings::default(),
    )
    .unwrap();
    assert_eq!(found.dataset.joints[1].input_unit, "A");
    assert!(says(&found, "as the robot's description says"));
}

#[test]
fn controller_states_have_targets_and_outputs() {
    let found = found("controller_state.mcap", &torque());
    compare("controller_state", &found, 1..9, 0.0);
    assert_eq!(
        found.dataset.input_hold,
        InputHold::ZeroOrder,
        "the output is a command"
    );
    assert!(says(
        &found,
        "commanded position: `/arm_controller/controller_state/shoulder/reference/positions`"
    ));
}

#[test]
fn dynamic_joint_states_are_read_by_their_interfaces() {
    let found = found("dynamic_joint_states.mcap", &torque());
    compare("dynamic_joint_states", &found, 1..7, 0.0);
}

#[test]
fn of_the_topics_of_a_robot_joint_states_come_first() {
    let found = found("bringup.mcap", &torque());
    compare("bringup", &found, 1..9, 0.0);
    assert!(
        says(&found, "`/joint_states/elbow/position` is taken and not")
            || says(&found, "`/joint_states/shoulder/position` is taken and not"),
        "{:?}",
        found.assumptions
    );
}

#[test]
fn commands_of_another_topic_are_held_at_the_stamps_of_the_positions() {
    let settings = mapped(&["u=/effort_controller/commands/data[N*m]"]);
    let found = found("commands.mcap", &settings);
    assert!(
        says(&found, "held from sample to sample"),
        "{:?}",
        found.assumptions
    );
    let (have, want) = (columns(&found), expected());
    // Commands come 6 ms before the positions, every 10 ms: each row has its own.
    assert_eq!(have[5], want[5]);
    assert_eq!(have[1], want[1]);
    assert!(
        found
            .dataset
            .joints
            .iter()
            .all(|j| j.velocity == VelocityKind::Absent)
    );
    let told = refused("commands.mcap", &torque()).to_string();
    assert!(
        told.contains("no input of joints shoulder, elbow"),
        "{told}"
    );
}

#[test]
fn messages_of_vendors_are_read_by_a_map() {
    let settings = mapped(&[
        "q:shoulder=/low_state/motors[0]/counts[rad*0.001]",
        "q:elbow=/low_state/motors[1]/counts[*0.001]",
        "u:shoulder=/low_state/motors[0]/milliamps[mA]",
        "u:elbow=motors[1]/milliamps[mA]",
    ]);
    let found = found("vendor.mcap", &settings);
    compare("vendor", &found, 1..3, 0.5e-3);
    compare("vendor", &found, 5..7, 1e-7);
    assert_eq!(found.dataset.joints[0].input, InputQuantity::Current);
    assert!(says(&found, "time is that of the receive stamps"));
}

#[test]
fn parquet_tables_and_lists() {
    let table = found("table.parquet", &Settings::default());
    compare("table", &table, 0..3, 1e-15);
    compare("table", &table, 5..7, 1e-15);
    assert_eq!(table.dataset.joints[0].input, InputQuantity::Current);
    assert!(
        says(&table, "is a current in mA, as name and unit say"),
        "{:?}",
        table.assumptions
    );
    let lists = found("lists.parquet", &Settings::default());
    compare("lists", &lists, 0..1, 1e-15);
    compare("lists", &lists, 1..3, 0.0);
    compare("lists", &lists, 5..7, 0.0);
    assert!(
        says(&lists, "in ns: its stamps are Unix times in no other unit"),
        "{:?}",
        lists.assumptions
    );
}

#[test]
fn lerobot_folders_give_one_record_for_each_episode() {
    let found = found("lerobot", &Settings::default());
    let sizes: Vec<usize> = found.dataset.experiments.iter().map(|e| e.len()).collect();
    assert_eq!(sizes, [14, 13, 13]);
    let names: Vec<&str> = found
        .dataset
        .experiments
        .iter()
        .map(|e| e.name.as_str())
        .collect();
    assert_eq!(
        names,
        ["episode_000000", "episode_000001", "episode_000002"]
    );
    assert_eq!(found.dataset.experiments[2].role, Role::Test);
    // Single precision: half of the last of 24 bits, of values below 1.
    compare("lerobot", &found, 1..3, 0.5 / f64::from(1 << 23));
    compare("lerobot", &found, 7..9, 0.5 / f64::from(1 << 23));
    assert_eq!(found.dataset.experiments[1].t[1], f64::from(0.01_f32));
    assert!(
        found
            .dataset
            .experiments
            .iter()
            .all(|e| e.u.iter().all(|u| *u == 0.0))
    );
    assert!(found.targets_alone);
}

#[test]
fn arrays_of_numpy_and_matlab() {
    for name in ["arrays.npz", "packed.npz", "arrays.mat", "packed.mat"] {
        let found = found(name, &Settings::default());
        compare(name, &found, 0..3, 0.0);
        compare(name, &found, 5..7, 0.0);
        // arrays.npz has velocities up to 2.5 in single precision.
        compare(
            name,
            &found,
            3..5,
            if name == "arrays.npz" {
                1.0 / f64::from(1 << 23)
            } else {
                0.0
            },
        );
        assert!(
            says(&found, "joints by number, in the order of the robot"),
            "{:?}",
            found.assumptions
        );
    }
}

#[test]
fn texts_of_numpy_and_plotjuggler() {
    let saved = found("savetxt.txt", &Settings::default());
    compare("savetxt", &saved, 0..3, 0.0);
    compare("savetxt", &saved, 5..7, 0.0);
    let plot = found("plotjuggler.csv", &torque());
    compare("plotjuggler", &plot, 1..7, 0.0);
    // Unix time in doubles resolves 2.4e-7 s.
    compare("plotjuggler", &plot, 0..1, 2.4e-7);
}

#[test]
fn what_is_written_reads_back_to_the_last_digit() {
    let folder = tempfile::tempdir().unwrap();
    for (name, settings) in [
        ("joint_states_zstd.mcap", torque()),
        ("controller_state.mcap", torque()),
        ("lerobot", Settings::default()),
        ("table.parquet", Settings::default()),
    ] {
        let mut found = found(name, &settings);
        let rule = ["*=kp:4.5".parse().unwrap()];
        found.dataset = found.dataset.with_gain_factors(&rule).unwrap();
        let out = folder.path().join(name);
        write_folder(&found, &out).unwrap();
        let again = Dataset::read(&out).unwrap();
        assert_eq!(again.experiments, found.dataset.experiments, "{name}");
        assert_eq!(again.joints, found.dataset.joints, "{name}");
        assert_eq!(again.input_hold, found.dataset.input_hold, "{name}");
        let manifest = std::fs::read_to_string(out.join("dataset.toml")).unwrap();
        assert!(
            manifest.contains("# What was assumed") && manifest.contains("# - "),
            "{manifest}"
        );
    }
}

#[test]
fn logs_of_different_kinds_make_one_data_set() {
    let paths = [
        "savetxt.txt",
        "joint_states_zstd.mcap",
        "joint_states.db3",
        "arrays.npz",
    ]
    .map(fixture);
    let found = read(&paths, &robot(), &torque()).unwrap();
    let names: Vec<(&str, Role)> = found
        .dataset
        .experiments
        .iter()
        .map(|e| (e.name.as_str(), e.role))
        .collect();
    assert_eq!(
        names,
        [
            ("savetxt", Role::Train),
            ("joint_states_zstd", Role::Train),
            ("joint_states", Role::Train),
            ("arrays", Role::Test)
        ]
    );
    assert!(
        found
            .dataset
            .joints
            .iter()
            .all(|j| j.velocity == VelocityKind::Absent),
        "savetxt.txt has none"
    );
    assert!(
        found
            .warnings
            .iter()
            .any(|w| w.contains("velocity of joint `elbow` is left out"))
    );
}
