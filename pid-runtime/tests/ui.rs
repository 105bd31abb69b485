//! The messages of `robot!`: one mistake per file in `ui/<stage>`, several in `ui/several`, good robots in `ui/pass`.
//!
//! After a change of a message: `TRYBUILD=overwrite cargo test -p pid-runtime --test ui`, then read the difference.

#[test]
fn messages() {
    let t = trybuild::TestCases::new();
    t.pass("tests/ui/pass/*.rs");
    for stage in [
        "syntax", "names", "units", "values", "tree", "physics", "several",
    ] {
        t.compile_fail(format!("tests/ui/{stage}/*.rs"));
    }
}
