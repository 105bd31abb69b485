//! The documentation says of every effect what the library says.

use std::path::Path;

use pid_effects::{effects, terms};
use pid_simulators::mujoco::expression;

#[test]
fn the_table_of_the_documentation_is_that_of_the_library() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/simulators.md");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    for own in effects::all().into_iter().chain(terms::all()) {
        let id = own.info().id;
        let (file, wrapper) = expression(id).unwrap_or_else(|| panic!("no row for {id}"));
        let row = format!("| {id} | {file} | {wrapper} |");
        assert!(text.contains(&row), "write into docs/simulators.md:\n{row}");
    }
}
