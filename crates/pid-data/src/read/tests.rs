use super::*;

const TOML: &str = r#"
name = "arm"
title = "An arm"
source = "made up"
license = "CC0-1.0"
kind = "simulated"
input_hold = "linear"

[[joint]]
name = "shoulder"
type = "revolute"
input = "torque"
input_unit = "N*m"
velocity = "measured"

[[joint]]
name = "slide"
type = "prismatic"
input = "voltage"
input_unit = "V"
velocity = "absent"

[[experiment]]
file = "a.csv"
role = "train"
sample_time_s = 0.1
samples = 3
note = "short"

[[experiment]]
file = "b.csv"
role = "test"
"#;
const CSV: &str = "t,q1,q2,dq1,u1,u2\n0,1,2,3,4,5\n0.1,1.5,2.5,,4.5,5.5\n0.2,2,3,3.5,5,6\n";

fn read(toml: &str, csv: &str) -> Result<Dataset, DataError> {
    Dataset::from_embedded(&[("dataset.toml", toml), ("a.csv", csv), ("b.csv", CSV)])
}

#[test]
fn reads_channels_row_by_row_and_counts_what_is_missing() {
    let d = read(TOML, CSV).unwrap();
    assert_eq!((d.nq(), d.input_hold), (2, crate::InputHold::Linear));
    let e = &d.experiments[0];
    assert_eq!(
        (e.name.as_str(), e.role, e.note.as_str()),
        ("a", Role::Train, "short")
    );
    assert_eq!(e.t, [0.0, 0.1, 0.2]);
    assert_eq!(e.q, [1.0, 2.0, 1.5, 2.5, 2.0, 3.0]);
    assert_eq!(e.u, [4.0, 5.0, 4.5, 5.5, 5.0, 6.0]);
    let v = e.v.as_ref().unwrap();
    assert_eq!((v[0], v[4]), (3.0, 3.5));
    assert!(
        v[1].is_nan() && v[2].is_nan(),
        "absent channel and empty cell"
    );
    assert_eq!(e.missing, 1, "only the empty cell counts");
    assert!((e.sample_time() - 0.1).abs() < 1e-15);
    let w = e.window(1..3);
    assert_eq!((w.len(), w.q, w.t[0]), (2, &e.q[2..6], 0.1));
    // One empty cell in each of the two files.
    assert_eq!(d.warnings.len(), 2, "{:?}", d.warnings);
}

/// Each mistake gives an error whose text holds all of the pieces.
fn check(result: Result<Dataset, DataError>, pieces: &[&str]) {
    let text = result.expect_err("must be refused").to_string();
    for piece in pieces.iter().chain(&["help:"]) {
        assert!(text.contains(piece), "{piece:?} not in: {text}");
    }
}

#[test]
fn bad_records_name_file_line_column_value_and_mend() {
    let csv = |from: &str, to: &str| {
        assert!(CSV.contains(from));
        read(TOML, &CSV.replacen(from, to, 1))
    };
    check(
        csv("u2", "x2"),
        &["a.csv", "line 1", "`u2`", "every joint needs its input"],
    );
    check(
        csv("dq1", "w"),
        &["a.csv", "`dq1`", "velocity = \"absent\""],
    );
    check(csv("t,", "time,"), &["a.csv", "`t`"]);
    check(csv("dq1", "q1"), &["a.csv", "`q1`", "twice"]);
    check(
        csv("2.5", "2;5"),
        &["a.csv", "line 3", "`q2`", "`2;5` is not a number"],
    );
    check(
        csv("5.5", "NaN"),
        &["a.csv", "line 3", "`u2`", "`NaN` is not a finite number"],
    );
    check(csv("3.5", "-inf"), &["a.csv", "line 4", "`dq1`", "`-inf`"]);
    check(
        csv("0.2,", "0.05,"),
        &["a.csv", "line 4", "0.05 s", "0.1 s", "sort the rows"],
    );
    check(
        csv("0.2,", "0.1,"),
        &["a.csv", "line 4", "does not increase"],
    );
    check(csv("0.1,1.5", ",1.5"), &["a.csv", "line 3", "`t` is empty"]);
    check(
        csv("2.5,,", "2.5,"),
        &["a.csv", "line 3", "5 cells", "has 6"],
    );
    check(read(TOML, ""), &["a.csv", "is empty"]);
    check(read(TOML, "\n\n"), &["a.csv", "is empty"]);
    check(read(TOML, "t,q1,q2,dq1,u1,u2\n"), &["a.csv", "no samples"]);
    check(
        read(TOML, "t,q1,q2,dq1,u1,u2\n0,1,2,3,4,5\n"),
        &["a.csv", "line 2", "two samples"],
    );
    check(
        csv("u2", "u2,tau1"),
        &["a.csv", "`tau2`", "the other joints have one"],
    );
}

#[test]
fn gains_by_record_are_read_or_refused_with_their_place() {
    let with = |own: &str| {
        let note = "note = \"short\"";
        read(
            &TOML.replacen(note, &format!("{note}\ngain_factors = {own}"), 1),
            CSV,
        )
    };
    let d = with("{ kp = 4, kd = [1.0, 0.5] }").unwrap();
    let own = &d.experiments[0].gain_factors;
    assert_eq!(
        [own.at(0, 0), own.at(0, 1), own.at(1, 1), own.at(3, 0)],
        [4.0, 4.0, 0.5, 1.0]
    );
    assert!(d.experiments[1].gain_factors.are_one());
    for (own, piece) in [
        (
            "{ kq = 4 }",
            "gain_factors.kq: no gain of a position loop: kp, kd",
        ),
        (
            "{ kp = -1.0 }",
            "gain_factors.kp: -1: a factor is a number of at least zero",
        ),
        (
            "{ kp = [1.0, 2.0, 3.0] }",
            "gain_factors.kp: 3 values for 2 joints",
        ),
    ] {
        check(
            with(own),
            &["dataset.toml:29:", "experiment `a.csv`", piece],
        );
    }
    let text = with("{ kp = \"4\" }").expect_err("a word").to_string();
    assert!(
        text.contains("a number, or a list of one per joint"),
        "{text}"
    );
    let rules = |text: &str| d.clone().with_gain_factors(&[text.parse().unwrap()]);
    assert_eq!(
        rules("*=kp:2").unwrap().experiments[1]
            .gain_factors
            .at(0, 0),
        2.0
    );
    let text = rules("c*=kp:2").unwrap_err().to_string();
    assert!(text.contains("they are a, b"), "{text}");
}

/// Where drives are off no targets need to be recorded, and inputs of another kind do not count.
#[test]
fn drives_that_are_off_are_read_or_refused_with_their_place() {
    let with = |own: &str| {
        let note = "note = \"short\"";
        read(
            &TOML.replacen(note, &format!("{note}\noff = {own}"), 1),
            CSV,
        )
    };
    let d = with("true").unwrap();
    let own = &d.experiments[0];
    assert!(own.is_off() && own.gain_factors.is_off(1) && !d.experiments[1].is_off());
    assert_eq!(own.targets().as_deref(), Some(own.q.as_slice()));
    assert!(d.experiments[1].targets().is_none());
    let one = with("[false, true]").unwrap();
    assert!(!one.experiments[0].is_off() && one.experiments[0].gain_factors.is_off(1));
    check(
        with("[true, false, true]"),
        &[
            "dataset.toml:29:",
            "off: 3 values for 2 joints",
            "off = true",
        ],
    );
    let text = with("1").expect_err("a number").to_string();
    assert!(text.contains("true, false, or a list"), "{text}");

    let mut other = d.clone();
    other.experiments.truncate(1);
    for joint in &mut other.joints {
        joint.input_unit = "V".to_owned();
    }
    let on = with("false").unwrap();
    for (first, second, place) in [(&on, &other, 2), (&other, &on, 0)] {
        let merged = first.clone().merged(vec![second.clone()]).unwrap();
        let own = &merged.experiments[place];
        assert!(own.is_off() && own.u.iter().all(|u| *u == 0.0));
        assert_eq!(merged.joints[0].input_unit, on.joints[0].input_unit);
    }
    other.experiments[0].gain_factors = Default::default();
    assert!(on.merged(vec![other]).is_err());
}

#[test]
fn bad_manifests_name_the_key_and_its_values() {
    let toml = |from: &str, to: &str| {
        assert!(TOML.contains(from));
        read(&TOML.replacen(from, to, 1), CSV)
    };
    check(
        toml("\"V\"", "\"furlong\""),
        &["joint `slide`", "input_unit `furlong`", "`N*m`"],
    );
    check(
        toml("\"V\"", "\"A\""),
        &["`slide`", "voltage", "in V", "`A`"],
    );
    check(
        toml("\"train\"", "\"fit\""),
        &["experiment `a.csv`", "role `fit`", "`train`"],
    );
    check(
        toml("\"revolute\"", "\"revolut\""),
        &[
            "joint `shoulder`",
            "type `revolut`",
            "did you mean `revolute`?",
        ],
    );
    check(toml("\"linear\"", "\"cubic\""), &["input_hold `cubic`"]);
    check(toml("kind = \"simulated\"", ""), &["dataset.toml", "kind"]);
    check(
        toml("name = \"arm\"", "name = \"arm"),
        &["dataset.toml:2:12: ", "  2 | name = \"arm"],
    );
    check(
        toml("note =", "remark ="),
        &[
            "dataset.toml:28:1: unknown field `remark`",
            "use one of `file`",
        ],
    );
    check(
        toml("samples = 3", "sample = 3"),
        &["unknown field `sample`", "did you mean `samples`?"],
    );
    check(
        toml("samples = 3", "samples = \"3\""),
        &["samples = \"3\"", "write a whole number"],
    );
    check(
        toml("\"slide\"", "\"shoulder\""),
        &["joint `shoulder`", "twice"],
    );
    check(toml("b.csv", "c.csv"), &["c.csv", "not among the embedded"]);
    let none = TOML.split("[[experiment]]").next().unwrap();
    check(read(none, CSV), &["no experiment listed", "[[experiment]]"]);
}

#[test]
fn a_missing_folder_is_named() {
    check(
        Dataset::read(Path::new("no/such/folder")),
        &["no/such/folder", "dataset.toml"],
    );
}

#[test]
fn odd_but_usable_data_give_warnings() {
    let toml = TOML
        .replace("samples = 3", "samples = 4")
        .replace("0.1", "0.2");
    let csv = CSV
        .replace("u2\n", "u2,temperature\n")
        .replace("5\n", "5,20\n")
        .replace("6\n", "6,20\n");
    let d = read(&toml, &csv).unwrap();
    let text: Vec<String> = d.warnings.iter().map(ToString::to_string).collect();
    for piece in [
        "3 samples, dataset.toml says 4",
        "`temperature` is not used",
        "0.1 s",
        "1 empty",
    ] {
        assert!(text.iter().any(|w| w.contains(piece)), "{piece}: {text:?}");
    }
}

#[test]
fn a_measured_velocity_that_is_a_difference_is_named() {
    let mut csv = "t,q1,q2,dq1,u1,u2\n0,0,2,0,4,5\n".to_owned();
    let q = |k: i32| f64::from(k).powi(2).sin();
    for k in 1..40 {
        let v = (q(k) - q(k - 1)) / 0.5;
        csv += &format!("{},{},2,{v},4,5\n", 0.5 * f64::from(k), q(k));
    }
    let toml = TOML.replace("samples = 3\n", "").replace("0.1", "0.5");
    let told = |toml: &str| read(toml, &csv).unwrap().warnings;
    let velocity = |w: &&DataWarning| matches!(w, DataWarning::VelocityIsDifference { .. });
    let warned = told(&toml);
    let warned: Vec<String> = warned
        .iter()
        .filter(velocity)
        .map(ToString::to_string)
        .collect();
    assert_eq!(
        warned,
        [
            "dataset.toml: joint 1: velocity = \"measured\", but `dq1` is the backward difference of `q1` (1 of 2 records)\n  help: write \
             velocity = \"derived\": it tells nothing that the positions do not"
        ]
    );
    let stated = told(&toml.replace("measured", "derived"));
    assert!(!stated.iter().any(|w| velocity(&w)));
}

#[test]
fn windows_line_ends_and_a_byte_order_mark_do_not_matter() {
    let csv = format!("\u{feff}{}", CSV.replace('\n', "\r\n"));
    assert_eq!(read(TOML, &csv).unwrap().experiments[0].t, [0.0, 0.1, 0.2]);
}
