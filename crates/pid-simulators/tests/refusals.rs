//! What is refused, and how it is told.

mod common;

use common::{described, effect};
use pid_simulators::{Options, Results, Target, export};

fn told(options: &Options<'_>, effects: &str) -> String {
    let error = export(&described(effects), Target::Mujoco, options);
    error
        .err()
        .unwrap_or_else(|| panic!("{effects} is taken"))
        .to_string()
}

#[test]
fn a_file_of_results_of_another_form_is_told() {
    for (text, what) in [
        ("{", "no JSON"),
        ("{}", "it has no list `parameters`"),
        (
            r#"{"parameters": [{"name": "mass_j1"}]}"#,
            "no name or no value",
        ),
        (
            r#"{"parameters": [], "correlations": [["a", "b"]]}"#,
            "its list `correlations`",
        ),
    ] {
        let mut options = Options::default();
        options.fit = Some(Results {
            name: "fit.json",
            text,
        });
        let message = told(&options, "");
        assert!(
            message.starts_with("fit.json: ") && message.contains(what),
            "{message}"
        );
        assert!(message.contains("`simtrue identify` wrote"), "{message}");
    }
    let mut options = Options::default();
    options.diagnosis = Some(Results {
        name: "d.json",
        text: "[]",
    });
    assert!(told(&options, "").starts_with("d.json: it has no list `effects`"));
}

#[test]
fn a_payload_that_leaves_no_mass_is_told() {
    let message = told(
        &Options::default(),
        &effect("payload", None, &[("mass", -3.0)]),
    );
    assert!(
        message.contains("joint `j3`: a mass of -1 kg") && message.contains("`payload`"),
        "{message}"
    );
}

/// The value of an interval's half width over 1.96, and what a fit states.
#[test]
fn ranges_have_values_and_deviations() {
    let stribeck = "[[effect]]\nid = \"stribeck\"\njoint = \"j2\"\n[effect.parameters]\n\
        excess = { value = 0.5, interval = [0.402, 0.598] }\nstribeck_velocity = { value = 0.03 }\n";
    let mut options = Options::default();
    let fit = r#"{"parameters": [{"name": "mass_j1", "value": 2.02, "deviation": 0.01}, {"name": "excess_j2", "value": 0.4, "deviation": null}],
        "correlations": [["mass_j1", "mass_j2", -0.75]]}"#;
    options.fit = Some(Results {
        name: "fit.json",
        text: fit,
    });
    let files = export(&described(stribeck), Target::Mujoco, &options).expect("files");
    let text = &files
        .iter()
        .find(|f| f.name == "ranges.json")
        .expect("ranges")
        .text;
    let ranges: serde_json::Value = serde_json::from_str(text).expect("JSON");
    let of = |name: &str| {
        let all = ranges["parameters"].as_array().expect("a list");
        all.iter()
            .find(|p| p["name"] == name)
            .unwrap_or_else(|| panic!("no {name}"))
            .clone()
    };
    assert_eq!(
        (&of("mass_j1")["value"], &of("mass_j1")["std"]),
        (&2.02.into(), &0.01.into())
    );
    let pair = &ranges["correlations"][0];
    assert_eq!(
        (&pair[0], &pair[1], &pair[2]),
        (&"mass_j1".into(), &"mass_j2".into(), &(-0.75).into())
    );
    let (lower, upper) = (
        of("mass_j2")["lower"].as_f64(),
        of("mass_j2")["upper"].as_f64(),
    );
    assert!(
        (lower.expect("an end") - 1.9).abs() < 1e-12
            && (upper.expect("an end") - 2.1).abs() < 1e-12
    );
    let std = of("stribeck/j2/excess")["std"]
        .as_f64()
        .expect("a deviation");
    assert!((std - 0.05).abs() < 1e-5, "{std}");
    assert!(of("stribeck/j2/stribeck_velocity")["std"].is_null());
}

#[test]
fn a_step_that_is_none_is_told() {
    for step in [0.0, -1e-3, f64::NAN] {
        let mut options = Options::default();
        options.timestep = Some(step);
        assert!(told(&options, "").contains("timestep: "), "{step}");
    }
}
