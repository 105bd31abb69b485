//! How columns are found, what is refused, how records are parted.

use std::fmt::Write as _;

use pid_data::{InputHold, InputQuantity, Role, VelocityKind};
use pid_logs::{Entry, Found, Joint, LogError, Settings, from_logs, parse};

fn arm() -> [Joint; 2] {
    [
        Joint::revolute("shoulder_joint"),
        Joint::revolute("elbow_joint"),
    ]
}

fn read_as(text: &str, joints: &[Joint], settings: &Settings) -> Result<Found, LogError> {
    let logs = parse("log.csv", text.as_bytes().to_vec())?;
    from_logs(&logs, joints, settings)
}

fn read(text: &str) -> Result<Found, LogError> {
    read_as(text, &arm(), &Settings::default())
}

fn mapped(entries: &[&str]) -> Settings {
    let map = entries.iter().map(|e| Entry::parse(e).unwrap()).collect();
    Settings {
        map,
        ..Settings::default()
    }
}

/// Four rows `k, k+1, k+2, …` below a header, with a separator.
fn rows(header: &str, sign: &str) -> String {
    let columns = header.split(sign).count();
    let mut text = format!("{header}\n");
    for k in 0..4 {
        let cells: Vec<String> = (0..columns).map(|c| (k + c).to_string()).collect();
        writeln!(text, "{}", cells.join(sign)).unwrap();
    }
    text
}

/// The second sample: q, dq, u, qref.
fn second(found: &Found) -> (Vec<f64>, Vec<f64>, Vec<f64>, Vec<f64>) {
    let e = &found.dataset.experiments[0];
    let of = |x: &[f64]| x[2..4].to_vec();
    let may = |x: &Option<Vec<f64>>| x.as_deref().map(of).unwrap_or_default();
    (of(&e.q), may(&e.v), of(&e.u), may(&e.qref))
}

#[test]
fn columns_of_many_spellings_are_found() {
    let degrees = [2.0_f64, 3.0]
        .map(|d| d * std::f64::consts::PI / 180.0)
        .to_vec();
    let plain = vec![2.0, 3.0];
    for (header, sign, q) in [
        ("t,q1,q2,tau1,tau2", ",", &plain),
        (
            "time [s];q1 [deg];q2 [deg];torque 1 [N*m];torque 2 [N*m]",
            ";",
            &degrees,
        ),
        (
            "Time\tPos_0\tPos_1\tEffort_0 (Nm)\tEffort_1 (Nm)",
            "\t",
            &plain,
        ),
        (
            "__time,/joint_states/shoulder_joint/position,/joint_states/elbow_joint/position,/joint_states/shoulder_joint/effort [N*m],/joint_states/elbow_joint/effort [N*m]",
            ",",
            &plain,
        ),
        (
            "stamp,shoulder.angle_deg,elbow.angle_deg,shoulder.torque_nm,elbow.torque_nm",
            ",",
            &degrees,
        ),
        (
            "t ShoulderPosition ElbowPosition ShoulderTorque ElbowTorque",
            " ",
            &plain,
        ),
        (
            "timestamp,position[0],position[1],effort[0] [Nm],effort[1] [Nm]",
            ",",
            &plain,
        ),
        (
            "elapsed,/js/pos/shoulder,/js/pos/elbow,/js/torque/shoulder,/js/torque/elbow",
            ",",
            &plain,
        ),
        (
            "t|shoulder_joint [rad]|elbow_joint [rad]|shoulder_joint [Nm]|elbow_joint [Nm]",
            "|",
            &plain,
        ),
    ] {
        let found = read(&rows(header, sign)).unwrap_or_else(|e| panic!("{header}: {e}"));
        let (have, _, u, _) = second(&found);
        assert_eq!(&have, q, "{header}");
        assert_eq!(u, [4.0, 5.0], "{header}");
        assert_eq!(
            found.dataset.experiments[0].t,
            [0.0, 1.0, 2.0, 3.0],
            "{header}"
        );
        assert_eq!(found.dataset.joints[0].input, InputQuantity::Torque);
    }
}

#[test]
fn names_beat_the_order_of_columns() {
    let found = read(&rows("elbow_tau,t_ms,elbow_vel_rpm,shoulder_pos,elbow_pos,shoulder_vel_rpm,shoulder_tau,elbow_pos_ref,shoulder_pos_ref", ",")).unwrap();
    let (q, v, u, qref) = second(&found);
    assert_eq!(q, [4.0, 5.0]);
    let rpm = std::f64::consts::PI / 30.0;
    assert!(
        (v[0] - 6.0 * rpm).abs() < 1e-15 && (v[1] - 3.0 * rpm).abs() < 1e-15,
        "{v:?}"
    );
    assert_eq!((u, qref), (vec![7.0, 1.0], vec![9.0, 8.0]));
    assert_eq!(found.dataset.experiments[0].t, [0.001, 0.002, 0.003, 0.004]);
    assert!(
        found
            .dataset
            .joints
            .iter()
            .all(|j| j.velocity == VelocityKind::Measured)
    );
}

#[test]
fn a_map_says_what_names_do_not() {
    let settings = mapped(&[
        "t=c0[ms]",
        "q:elbow_joint=c1[deg]",
        "q:shoulder_joint=c2[deg*-1]",
        "u:elbow_joint=c3[mA]",
        "u:shoulder_joint=0",
    ]);
    let found = read_as(&rows("c0,c1,c2,c3", ","), &arm(), &settings);
    // A number for an input says nothing of its quantity: a torque beside a current.
    let found = found.unwrap();
    let (q, _, u, _) = second(&found);
    let degree = std::f64::consts::PI / 180.0;
    assert!(
        (q[0] + 3.0 * degree).abs() < 1e-15 && (q[1] - 2.0 * degree).abs() < 1e-15,
        "{q:?}"
    );
    assert_eq!(u, [0.0, 0.004]);
    let inputs: Vec<InputQuantity> = found.dataset.joints.iter().map(|j| j.input).collect();
    assert_eq!(inputs, [InputQuantity::Torque, InputQuantity::Current]);
}

#[test]
fn each_of_several_logs_follows_the_entries_it_has_names_for() {
    let logs: Vec<_> = [
        ("a.csv", "t,x1,x2,tau1,tau2"),
        ("b.csv", "t,y1,y2,tau1,tau2"),
    ]
    .iter()
    .flat_map(|(file, header)| parse(file, rows(header, ",").into_bytes()).unwrap())
    .collect();
    let entries = [
        "q:shoulder_joint=x1",
        "q:elbow_joint=x2",
        "q:shoulder_joint=y2",
        "q:elbow_joint=y1",
    ];
    let found = from_logs(&logs, &arm(), &mapped(&entries)).unwrap();
    let first: Vec<&[f64]> = found
        .dataset
        .experiments
        .iter()
        .map(|e| &e.q[..2])
        .collect();
    assert_eq!(first, [[1.0, 2.0], [2.0, 1.0]]);
    let typo = [&entries[..], &["q:elbow_joint=z1"]].concat();
    let told = from_logs(&logs, &arm(), &mapped(&typo))
        .unwrap_err()
        .to_string();
    assert!(
        told.contains("--map 'q:elbow_joint=z1': a.csv: no channel `z1`"),
        "{told}"
    );
}

#[test]
fn sliding_joints_have_metres_and_newtons() {
    let joints = [Joint::prismatic("x")];
    let found = read_as(
        &rows("t,x_pos_mm,x_force_N", ","),
        &joints,
        &Settings::default(),
    )
    .unwrap();
    assert_eq!(found.dataset.experiments[0].q, [0.001, 0.002, 0.003, 0.004]);
    assert_eq!(found.dataset.joints[0].input_unit, "N");
    let told = read_as(
        &rows("t,x_pos_deg,x_force", ","),
        &joints,
        &Settings::default(),
    )
    .unwrap_err()
    .to_string();
    assert!(
        told.contains("channel `x_pos_deg`: unit `deg` does not fit position in m"),
        "{told}"
    );
}

#[test]
fn what_may_mean_two_things_is_refused_with_both_and_the_mend() {
    for (header, pieces) in [
        (
            "t,q1,q2,target_current_1,target_current_2,actual_current_1,actual_current_2",
            &[
                "the input of joint `shoulder_joint` may be",
                "`actual_current_1` or `target_current_1`",
                "--map 'u:shoulder_joint=",
            ][..],
        ),
        (
            "t,q1,q2,torque_1,torque_2,current_1,current_2",
            &["`torque_1` or `current_1`"],
        ),
        (
            "t,motor_pos_1,motor_pos_2,link_pos_1,link_pos_2,tau_1,tau_2",
            &["the position of joint", "`link_pos_1` or `motor_pos_1`"],
        ),
        (
            "t,time,q1,q2,tau1,tau2",
            &["time may be `t` or `time`", "--map 't=t'"],
        ),
        ("t,q1,q1,q2,tau1,tau2", &["`q1` or `q1`"]),
        (
            "t,q1,q2,effort1,effort2",
            &["`effort1` is an input", "--input torque"],
        ),
        (
            "t,q1,q2,q3,tau1,tau2",
            &[
                "no position of joints",
                "the numbers go from 1 to 3",
                "2 joints",
            ],
        ),
        (
            "t,sholder_pos,elbow_pos,tau1,tau2",
            &[
                "no position of joint `shoulder_joint`",
                "'q:shoulder_joint=sholder_pos'",
            ],
        ),
        (
            "t,q1,q2,temperature1,temperature2",
            &["no input of joints", "--passive"],
        ),
        (
            "t,shoulder_elbow_pos,tau1,tau2",
            &["no position of joints", "`shoulder_elbow_pos`"],
        ),
        ("q1,q2,tau1,tau2", &["no time", "--sample-time"]),
        (
            "t,q1 [furlong],q2 [furlong],tau1,tau2",
            &["unit `furlong` does not fit"],
        ),
    ] {
        let told = read(&rows(header, ",")).expect_err(header).to_string();
        for piece in pieces {
            assert!(told.contains(piece), "{header}: {piece} is not in: {told}");
        }
        assert!(told.contains("\n  help: "), "{told}");
    }
}

#[test]
fn the_user_or_the_description_says_which_input() {
    let text = rows("t,q1,q2,torque_1,torque_2,current_1,current_2", ",");
    let current = Settings {
        input: Some(InputQuantity::Current),
        ..Settings::default()
    };
    let found = read_as(&text, &arm(), &current).unwrap();
    assert_eq!(second(&found).2, [6.0, 7.0]);
    assert_eq!(found.dataset.joints[1].input_unit, "A");
    let driven = arm().map(|j| Joint {
        input: Some(InputQuantity::Torque),
        ..j
    });
    assert_eq!(
        second(&read_as(&text, &driven, &Settings::default()).unwrap()).2,
        [4.0, 5.0]
    );
    let voltage = Settings {
        input: Some(InputQuantity::Voltage),
        ..Settings::default()
    };
    let told = read_as(&text, &arm(), &voltage).unwrap_err().to_string();
    assert!(told.contains("no input that is a voltage"), "{told}");
    let passive = Settings {
        passive: true,
        ..Settings::default()
    };
    assert_eq!(
        second(&read_as(&text, &arm(), &passive).unwrap()).2,
        [0.0, 0.0]
    );
}

#[test]
fn records_of_a_data_set_are_logs_too() {
    let text = rows("t,q1,q2,dq1,dq2,u1,u2,tau1,tau2,qref1,qref2", ",");
    let current = Settings {
        input: Some(InputQuantity::Current),
        ..Settings::default()
    };
    let found = read_as(&text, &arm(), &current).unwrap();
    let (q, v, u, qref) = second(&found);
    assert_eq!((q, v), (vec![2.0, 3.0], vec![4.0, 5.0]));
    assert_eq!((u, qref), (vec![6.0, 7.0], vec![10.0, 11.0]));
    let tau = found.dataset.experiments[0].tau.as_deref().unwrap();
    assert_eq!(tau[2..4], [8.0, 9.0]);
}

#[test]
fn rows_that_break_a_rule_are_named() {
    for (text, pieces) in [
        (
            "# rig\nt,q1,q2,tau1,tau2\n0,1,2,3,4\n2,1,2,3,4\n2,1,2,3,4\n",
            &["log.csv: line 5: time `t`", "2 s does not come after 2 s"][..],
        ),
        (
            "t,q1,q2,tau1,tau2\n0,1,2,3,4\n,1,2,3,4\n",
            &["line 3", "missing"],
        ),
        (
            "t,q1,q2,tau1,tau2\n0,1,2,3,4\n1,x,2,3,4\n",
            &["line 3", "channel `q1`", "`x`"],
        ),
        (
            "t,q1,q2,tau1,tau2\n0,1,2,3,4\n1,1,2,inf,4\n",
            &["line 3", "channel `tau1`", "`inf`"],
        ),
        (
            "t,q1,q2,tau1,tau2\n0,1,2,3,4\n",
            &["1 samples of positions"],
        ),
    ] {
        let told = read(text).expect_err(text).to_string();
        assert!(pieces.iter().all(|p| told.contains(p)), "{told}");
    }
}

#[test]
fn missing_cells_stay_missing_and_velocities_may_be_absent() {
    let found =
        read("t,q1,q2,shoulder_vel,tau1,tau2\n0,1,-0,3,4,5\n1,,2,3,4,5\n2,1,2,nan,4,5\n").unwrap();
    let e = &found.dataset.experiments[0];
    assert_eq!(e.q[1].to_bits(), (-0.0_f64).to_bits());
    assert!(e.q[2].is_nan() && e.v.as_ref().unwrap()[4].is_nan());
    assert_eq!(e.missing, 2);
    let kinds: Vec<VelocityKind> = found.dataset.joints.iter().map(|j| j.velocity).collect();
    assert_eq!(kinds, [VelocityKind::Measured, VelocityKind::Absent]);
    // A single number may count from 0 or from 1.
    let found = read(&rows("t,q1,q2,dq1,tau1,tau2", ",")).unwrap();
    let told: Vec<String> = found.assumptions.iter().map(ToString::to_string).collect();
    assert!(
        told.iter()
            .any(|t| t.contains("velocity: `dq1` is left alone")),
        "{told:?}"
    );
}

#[test]
fn rows_of_several_topics_in_one_table_are_brought_together() {
    // Positions every 2 s, commands every 2 s between them.
    let mut text = "t,q1,q2,torque_cmd_1,torque_cmd_2\n".to_owned();
    for k in 0..10 {
        let t = 2 * k;
        writeln!(text, "{t},,,{k},{}\n{},{k},{},,", 10 + k, t + 1, 20 + k).unwrap();
    }
    let found = read(&text).unwrap();
    let e = &found.dataset.experiments[0];
    assert_eq!(e.t[..3], [1.0, 3.0, 5.0]);
    assert_eq!(e.u[..6], [0.0, 10.0, 1.0, 11.0, 2.0, 12.0]);
    assert_eq!(found.dataset.input_hold, InputHold::ZeroOrder);
    let told: Vec<String> = found.assumptions.iter().map(ToString::to_string).collect();
    assert!(
        told.iter()
            .any(|t| t.contains("`torque_cmd_1` has stamps of its own: its values are held")),
        "{told:?}"
    );
    assert!(
        told.iter()
            .any(|t| t.contains("10 of 20 rows have no position")),
        "{told:?}"
    );
}

#[test]
fn targets_without_input_are_kept_and_said() {
    let found = read(&rows("t,q1,q2,q1_ref,q2_ref", ",")).unwrap();
    let (_, _, u, qref) = second(&found);
    assert_eq!((u, qref), (vec![0.0, 0.0], vec![4.0, 5.0]));
    assert!(found.targets_alone);
}

#[test]
fn a_log_without_input_among_others_is_told() {
    let parsed =
        |name: &str, header: &str| parse(name, rows(header, ",").into_bytes()).expect("a log");
    let mut logs = parsed("driven.csv", "t,q1,q2,tau1,tau2");
    logs.extend(parsed("targets.csv", "t,q1,q2,q1_ref,q2_ref"));
    let found = from_logs(&logs, &arm(), &Settings::default()).expect("records");
    assert!(!found.targets_alone);
    let told = |file: &str| {
        let mut all = found.warnings.iter();
        all.any(|w| w.starts_with(file) && w.contains("there is no input beside"))
    };
    assert!(
        told("targets.csv") && !told("driven.csv"),
        "{:?}",
        found.warnings
    );
}

#[test]
fn a_target_without_a_quantity_is_offered_as_a_position() {
    let error = read(&rows("t,q1,q2,goal1,goal2", ","))
        .unwrap_err()
        .to_string();
    assert!(error.contains("--map 'qref:"), "{error}");
    assert!(
        error.contains("=goal1' if it is a commanded position"),
        "{error}"
    );
    let error = read(&rows("t,q1,q2,a,b", ",")).unwrap_err().to_string();
    assert!(!error.contains("qref"), "{error}");
}

#[test]
fn one_log_is_cut_where_the_robot_is_slowest() {
    // Stands still from 6.4 s to 6.6 s of 10 s.
    let mut text = "t,q1,q2,tau1,tau2\n".to_owned();
    for k in 0..=1000 {
        let t = f64::from(k) / 100.0;
        let q = if t < 6.4 {
            t
        } else if t < 6.6 {
            6.4
        } else {
            t - 0.2
        };
        writeln!(text, "{t},{q},{q},1,1").unwrap();
    }
    let found = read(&text).unwrap();
    let [train, test] = found.dataset.experiments.as_slice() else {
        panic!("two records")
    };
    assert_eq!(
        (train.name.as_str(), train.role),
        ("log_train", Role::Train)
    );
    assert_eq!((test.name.as_str(), test.role), ("log_test", Role::Test));
    assert!((6.4..=6.6).contains(&test.t[0]), "{}", test.t[0]);
    assert_eq!(train.len() + test.len(), 1001);
}

#[test]
fn several_logs_are_parted_by_files_and_have_different_names() {
    let text = rows("t,q1,q2,tau1,tau2", ",").into_bytes();
    let files = [
        "a/run.csv",
        "b/run.csv",
        "b/RUN.csv",
        "c/other.csv",
        "d/run.csv",
    ];
    let logs: Vec<_> = files
        .iter()
        .flat_map(|f| parse(f, text.clone()).unwrap())
        .collect();
    let found = from_logs(&logs, &arm(), &Settings::default()).unwrap();
    let names: Vec<&str> = found
        .dataset
        .experiments
        .iter()
        .map(|e| e.name.as_str())
        .collect();
    assert_eq!(names, ["run", "b_run", "RUN_2", "other", "d_run"]);
    let test: Vec<&str> = found
        .dataset
        .with_role(Role::Test)
        .map(|e| e.name.as_str())
        .collect();
    assert_eq!(test, ["d_run"], "a quarter of five, at least one");
    let stated = Settings {
        test: vec!["run".to_owned()],
        ..Settings::default()
    };
    let found = from_logs(&logs, &arm(), &stated).unwrap();
    assert_eq!(found.dataset.experiments[0].role, Role::Test);
    let wrong = Settings {
        test: vec!["runn".to_owned()],
        ..Settings::default()
    };
    let told = from_logs(&logs, &arm(), &wrong).unwrap_err().to_string();
    assert!(
        told.contains("no record named `runn`") && told.contains("did you mean `run`?"),
        "{told}"
    );
}

#[test]
fn units_of_a_kind_and_odd_sizes_are_said() {
    let text = rows("t,q1,q2,tau1,tau2", ",").replace("\n3,4,", "\n3,90,");
    let found = read(&text).unwrap();
    assert!(
        found
            .warnings
            .iter()
            .any(|w| w.contains("reaches 90.0 rad") && w.contains("q=[deg]")),
        "{:?}",
        found.warnings
    );
    let found = read_as(&text, &arm(), &mapped(&["q=[deg]"])).unwrap();
    assert_eq!(
        found.dataset.experiments[0].q[6],
        std::f64::consts::FRAC_PI_2
    );
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
}

/// A file of MATLAB with one packed element that unpacks to so many zeros.
fn packed_zeros(count: usize) -> Vec<u8> {
    use std::io::Write as _;

    let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    let block = vec![0; 1 << 20];
    for _ in 0..count.div_ceil(block.len()) {
        packer.write_all(&block).unwrap();
    }
    let packed = packer.finish().unwrap();
    let mut bytes = b"MATLAB 5.0 MAT-file".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M', 15, 0, 0, 0]);
    bytes.extend(u32::try_from(packed.len()).unwrap().to_le_bytes());
    bytes.extend(packed);
    bytes
}

#[test]
fn files_made_to_fill_memory_are_refused() {
    let bytes = packed_zeros(40 << 20);
    assert!(bytes.len() < 50_000, "{}", bytes.len());
    let told = parse("log.mat", bytes).unwrap_err().to_string();
    assert!(told.contains("unpacks to far more than its size"), "{told}");
}

#[test]
fn files_of_other_kinds_are_named_with_a_way_out() {
    for (bytes, pieces) in [
        (&b"#ROSBAG V2.0\n"[..], ["ROS 1 bag", "rosbags-convert"]),
        (b"\x89HDF\r\n\x1a\n", ["HDF5", "-v7"]),
        (b"\x93NUMPY\x01", ["single NumPy array", "numpy.savez"]),
        (b"\x1f\x8b\x08", ["packed by gzip", "unpack"]),
        (b"\x00\x01\x02", ["of no kind that is read", "convert"]),
        (b"", ["empty", "again"]),
        (b"\x89MCAP0\r\n\x01", ["broken MCAP file", "mcap recover"]),
        (b"PAR1PAR1", ["broken Parquet file", "another program"]),
    ] {
        let told = parse("log.bin", bytes.to_vec()).unwrap_err().to_string();
        assert!(
            told.contains("log.bin") && pieces.iter().all(|p| told.contains(p)),
            "{told}"
        );
    }
}
