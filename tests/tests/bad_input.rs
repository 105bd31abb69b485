//! Unusable input: every mistake is refused with its place and a mend, and nothing panics.

use std::ops::ControlFlow;

use pid_data::{DataError, Dataset};
use pid_fit::ident::{IdentError, Identification, Method, Settings, identify};
use pid_models::{DoublePendulum, Emps, TwoLink};
use pid_runtime::dynamics::{Dynamics, Hessian};

const MANIFEST: &str = r#"
name = "cart"
title = "A cart"
source = "made up"
license = "CC0-1.0"
kind = "simulated"
input_hold = "zero-order"

[[joint]]
name = "x"
type = "prismatic"
input = "force"
input_unit = "N"
velocity = "absent"

[[experiment]]
file = "train.csv"
role = "train"
"#;

/// A cart that speeds up under a constant force.
fn record() -> String {
    let rows = (0..40).map(|k| {
        let t = 0.01 * f64::from(k);
        format!("{t:.2},{:.6},100", 0.5 * t * t)
    });
    format!("t,q1,u1\n{}\n", rows.collect::<Vec<_>>().join("\n"))
}

/// The record with a line (counted from 1, the header included) replaced.
fn with_line(line: usize, text: &str) -> String {
    let record = record();
    let mut lines: Vec<&str> = record.lines().collect();
    lines[line - 1] = text;
    lines.join("\n") + "\n"
}

fn read(manifest: &str, csv: &str) -> Result<Dataset, DataError> {
    Dataset::from_embedded(&[("dataset.toml", manifest), ("train.csv", csv)])
}

fn fit(
    model: &dyn Hessian,
    dataset: &Dataset,
    start: Option<&[f64]>,
    method: Method,
) -> Result<Identification, IdentError> {
    let settings = Settings {
        method,
        ..Settings::default()
    };
    identify(model, dataset, &settings, start, &mut |_| {
        ControlFlow::Continue(())
    })
}

/// The error's text holds every part.
fn assert_says<T>(result: Result<T, impl std::error::Error>, parts: &[&str]) {
    let Err(error) = result else {
        panic!("accepted; expected {parts:?}")
    };
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "no `{part}` in:\n{text}");
    }
}

#[test]
fn the_record_itself_is_accepted() {
    let dataset = read(MANIFEST, &record()).unwrap();
    for method in [Method::FullDiscretization, Method::EquationError] {
        fit(&Emps, &dataset, None, method).unwrap_or_else(|e| panic!("{method:?}: {e}"));
    }
}

#[test]
fn files_that_cannot_be_read_name_file_line_and_mend() {
    let without_input = record().replace(",100\n", "\n").replace("t,q1,u1", "t,q1");
    let cases: [(&str, String, &[&str]); 8] = [
        (
            "missing column",
            without_input,
            &["train.csv", "line 1", "`u1`", "help:"],
        ),
        (
            "NaN",
            with_line(7, "0.05,NaN,100"),
            &["train.csv", "line 7", "`q1`", "`NaN`", "help:", "empty"],
        ),
        (
            "infinity",
            with_line(9, "0.07,0.1,inf"),
            &["train.csv", "line 9", "`u1`", "`inf`", "help:"],
        ),
        (
            "text",
            with_line(8, "0.06,wide,100"),
            &["train.csv", "line 8", "`q1`", "`wide`", "help:"],
        ),
        (
            "time that goes back",
            with_line(6, "0.02,0.1,100"),
            &["train.csv", "line 6", "0.02", "0.03", "help:", "sort"],
        ),
        (
            "empty file",
            String::new(),
            &["train.csv", "empty", "help:"],
        ),
        (
            "header alone",
            "t,q1,u1\n".to_owned(),
            &["train.csv", "no samples", "help:"],
        ),
        (
            "short row",
            with_line(5, "0.03,0.1"),
            &["train.csv", "line 5", "2 cells", "has 3", "help:"],
        ),
    ];
    for (name, csv, parts) in cases {
        eprintln!("{name}");
        assert_says(read(MANIFEST, &csv), parts);
    }
}

#[test]
fn units_that_are_not_the_models_name_column_and_mend() {
    let furlongs = MANIFEST.replace("\"N\"", "\"furlong\"");
    assert_says(
        read(&furlongs, &record()),
        &["dataset.toml", "`x`", "`furlong`", "N", "help:"],
    );
    let current = MANIFEST
        .replace("\"force\"", "\"current\"")
        .replace("\"N\"", "\"A\"");
    let dataset = read(&current, &record()).unwrap();
    let parts = ["`u1`", "`cart`", "`A`", "`N`", "Emps", "help:"];
    for method in [Method::FullDiscretization, Method::EquationError] {
        assert_says(fit(&Emps, &dataset, None, method), &parts);
    }
}

#[test]
fn another_machine_is_refused() {
    let dataset = read(MANIFEST, &record()).unwrap();
    assert_says(
        fit(&TwoLink, &dataset, None, Method::FullDiscretization),
        &["`cart`", "1 joint", "2 (shoulder, elbow)", "help:"],
    );
}

#[test]
fn a_start_outside_of_its_bounds_names_the_parameter() {
    let dataset = read(MANIFEST, &record()).unwrap();
    let mut start: Vec<f64> = Emps.params().iter().map(|p| p.nominal).collect();
    start[0] = -4.0;
    let parts = ["`mass`", "-4", "10", "300", "kg", "help:"];
    for method in [Method::FullDiscretization, Method::EquationError] {
        assert_says(fit(&Emps, &dataset, Some(&start), method), &parts);
    }
    start[0] = f64::NAN;
    assert_says(
        fit(&Emps, &dataset, Some(&start), Method::FullDiscretization),
        &["`mass`", "NaN"],
    );
    assert_says(
        fit(
            &Emps,
            &dataset,
            Some(&start[1..]),
            Method::FullDiscretization,
        ),
        &["4 values", "5 parameters"],
    );
}

#[test]
fn nothing_to_train_on_names_the_data_set() {
    let dataset = read(&MANIFEST.replace("\"train\"", "\"test\""), &record()).unwrap();
    for method in [Method::FullDiscretization, Method::EquationError] {
        assert_says(
            fit(&Emps, &dataset, None, method),
            &["`cart`", "\"train\"", "help:", "dataset.toml"],
        );
    }
}

#[test]
fn a_missing_input_names_experiment_and_row() {
    let dataset = read(MANIFEST, &with_line(12, "0.10,0.005000,")).unwrap();
    assert_says(
        fit(&Emps, &dataset, None, Method::FullDiscretization),
        &["`train`", "row 11", "help:"],
    );
}

/// The point masses of the double pendulum may be heavier than its inertias about the joints allow.
#[test]
fn a_singular_mass_matrix_names_time_joint_and_mend() {
    let joint = "\n[[joint]]\nname = \"x\"\ntype = \"revolute\"\ninput = \"torque\"\ninput_unit = \"N*m\"\nvelocity = \"absent\"\n";
    let head = MANIFEST.split("\n[[joint]]").next().unwrap();
    let manifest = format!(
        "{head}{joint}{}\n[[experiment]]\nfile = \"train.csv\"\nrole = \"train\"\n",
        joint.replace("\"x\"", "\"y\"")
    );
    let rows = (0..40).map(|k| {
        format!(
            "{},{},{},0,0\n",
            0.01 * f64::from(k),
            0.01 * f64::from(k),
            0.0
        )
    });
    let csv = format!("t,q1,q2,u1,u2\n{}", rows.collect::<String>());
    let dataset = read(&manifest, &csv).unwrap();
    let infos = DoublePendulum.params();
    let mut start: Vec<f64> = infos.iter().map(|p| p.nominal).collect();
    let set = |start: &mut [f64], name: &str, value: f64| {
        let k = infos.iter().position(|p| p.name == name).unwrap();
        start[k] = value;
    };
    // An inertia about the elbow below m r² is no body's: M loses its positive pivot.
    set(&mut start, "m2", 3.0);
    set(&mut start, "r2", 0.8);
    set(&mut start, "i2", 1e-4);
    set(&mut start, "i1", 1e-4);
    set(&mut start, "rotor", 0.0);
    let result = fit(
        &DoublePendulum,
        &dataset,
        Some(&start),
        Method::FullDiscretization,
    );
    assert_says(result, &["`train`", "t = 0", "elbow", "pivot", "help:"]);
}
