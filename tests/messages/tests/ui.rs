//! The messages of `robot!`: one mistake per file in `ui/<stage>`, several in `ui/several`.
//!
//! After a change of a message: `TRYBUILD=overwrite cargo test -p pid-messages`, then read
//! the difference. Good robots are in `robot.rs`: without them nothing has to be linked here.

#[test]
fn messages() {
    let t = trybuild::TestCases::new();
    for stage in [
        "syntax", "names", "units", "values", "tree", "physics", "urdf", "several",
    ] {
        t.compile_fail(format!("tests/ui/{stage}/*.rs"));
    }
}
