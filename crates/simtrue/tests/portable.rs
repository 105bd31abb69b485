//! The command gives the same results with the vectors of this processor and without them.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// The embedded example, with what a processor of this architecture may lack or without.
fn run(folder: &Path, portable: bool) -> (Value, Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_simtrue"));
    command.arg("--out").arg(folder);
    if portable {
        command.env("PID_LANES", "portable");
    } else {
        command.env_remove("PID_LANES");
    }
    let output = command.output().expect("the command runs");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{told}");
    let read = |name: &str| {
        let text = std::fs::read_to_string(folder.join(name)).expect("the result");
        serde_json::from_str(&text).expect("JSON")
    };
    (read("fit.json"), read("diagnosis/diagnosis.json"))
}

fn number(value: &Value, key: &str) -> f64 {
    value[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key} in {value}"))
}

#[test]
fn results_without_wide_vectors_are_those_with_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let (wide, found) = run(&folder.path().join("wide"), false);
    let (portable, also) = run(&folder.path().join("portable"), true);

    // Estimates to a ten-thousandth of their standard deviation: both runs end where the tolerance of 1e-8 lets them.
    // One without a deviation is left open by the record, and any of its values is as good.
    let parameters = |fit: &Value| fit["parameters"].as_array().expect("parameters").clone();
    let (a, b) = (parameters(&wide), parameters(&portable));
    assert_eq!(a.len(), b.len());
    let mut told = 0;
    for (a, b) in a.iter().zip(&b) {
        let off = (number(a, "value") - number(b, "value")).abs();
        if let Some(deviation) = a["deviation"].as_f64() {
            eprintln!("{}: {off:e} of {deviation:e}", a["name"]);
            assert!(off <= 1e-4 * deviation, "{a}\n{b}");
            told += 1;
        }
    }
    assert!(told > 0, "the records tell no parameter");
    let objective = |fit: &Value| number(&fit["outcome"], "objective");
    let off = (objective(&wide) / objective(&portable) - 1.0).abs();
    assert!(off < 1e-9, "{off:e}");

    // The diagnosis names the same effects with the same values: to a hundredth of their standard deviation, since its
    // searches end at coarser tolerances.
    assert_eq!(found["verdict"], also["verdict"]);
    let effects = |found: &Value| found["effects"].as_array().expect("effects").clone();
    let (a, b) = (effects(&found), effects(&also));
    assert!(!a.is_empty() && a.len() == b.len());
    for (a, b) in a.iter().zip(&b) {
        assert_eq!((&a["effect"], &a["joint"]), (&b["effect"], &b["joint"]));
        let parameters = |effect: &Value| effect["parameters"].as_array().expect("some").clone();
        for (a, b) in parameters(a).iter().zip(&parameters(b)) {
            let off = (number(a, "value") - number(b, "value")).abs();
            eprintln!("{}: {off:e} of {:e}", a["name"], number(a, "std"));
            assert!(off <= 1e-2 * number(a, "std"), "{a}\n{b}");
        }
    }
}
