//! Descriptions that become no code say why, and every effect of the library has a row.

mod common;

use common::{arm6, with};
use pid_effects::effects::all;
use pid_firmware::{Options, Precision, Target, export, expression};
use pid_interpret::nominal::Role;

fn refusal(nominal: &pid_interpret::nominal::Nominal, precision: Precision) -> String {
    let mut options = Options::default();
    options.precision = precision;
    let error = export(nominal, Target::Rust, &options).expect_err("no code");
    error.to_string()
}

#[test]
fn a_coordinate_without_a_drive_is_named() {
    let nominal = arm6();
    let values: Vec<f64> = (nominal.tolerances().iter())
        .map(|t| match (t.role, t.joint) {
            (Role::Gain, Some(3)) => 0.0,
            _ => t.nominal,
        })
        .collect();
    let message = refusal(&nominal.extended(&values, Vec::new(), None), Precision::F64);
    assert!(
        message.contains("joint `j4`") && message.contains("gain of zero"),
        "{message}"
    );
    assert!(message.contains("help:"), "{message}");
}

#[test]
fn a_number_beyond_single_precision_asks_for_double() {
    let nominal = with(&arm6(), &[("spring", 0, &[1e300, 0.0])]);
    let message = refusal(&nominal, Precision::F32);
    assert!(
        message.contains("1e300") && message.contains("--precision f64"),
        "{message}"
    );
    let mut options = Options::default();
    options.precision = Precision::F64;
    assert!(export(&nominal, Target::C, &options).is_ok());
}

#[test]
fn every_effect_has_a_row_and_the_page_has_it() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/firmware.md");
    let page = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    for effect in all() {
        let id = effect.info().id;
        let text = expression(id).unwrap_or_else(|| panic!("no row for {id}"));
        // A law of equations of motion is expressed.
        let is_law = common::is_law(&*effect);
        assert!(!is_law || !text.starts_with("nothing"), "{id}");
        let row = format!("| {id} | {text} |");
        assert!(page.contains(&row), "write into docs/firmware.md:\n{row}");
    }
    assert_eq!(expression("gremlins"), None);
}
