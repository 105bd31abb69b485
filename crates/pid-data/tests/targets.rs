//! Joints whose input is a target position.

use pid_data::{Dataset, InputQuantity};

fn manifest(kind: &str, unit: &str) -> String {
    format!(
        "name = \"a\"\ntitle = \"a\"\nsource = \"a\"\nlicense = \"a\"\nkind = \"real\"\n\
         [[joint]]\nname = \"x\"\ntype = \"{kind}\"\ninput = \"position\"\ninput_unit = \"{unit}\"\nvelocity = \"absent\"\n\
         [[experiment]]\nfile = \"a.csv\"\nrole = \"train\"\n"
    )
}

fn read(kind: &str, unit: &str, csv: &str) -> Result<Dataset, String> {
    let manifest = manifest(kind, unit);
    let files = [("dataset.toml", manifest.as_str()), ("a.csv", csv)];
    Dataset::from_embedded(&files).map_err(|e| e.to_string())
}

#[test]
fn a_target_is_the_input_and_no_other_is_needed() {
    let data = read("revolute", "rad", "t,q1,qref1\n0,0.1,0.5\n0.1,0.2,0.6\n").expect("a data set");
    assert_eq!(data.joints[0].input, InputQuantity::Position);
    let e = &data.experiments[0];
    assert_eq!(
        (&e.u, e.qref.as_ref()),
        (&vec![0.5, 0.6], Some(&vec![0.5, 0.6]))
    );
    // A recorded input of the motor stays unread, with a remark.
    let both = read(
        "prismatic",
        "m",
        "t,q1,u1,qref1\n0,0.1,3,0.5\n0.1,0.2,4,0.6\n",
    )
    .expect("a data set");
    assert_eq!(both.experiments[0].u, [0.5, 0.6]);
    assert!(
        both.warnings.iter().any(|w| w.to_string().contains("`u1`")),
        "{:?}",
        both.warnings
    );
}

#[test]
fn a_missing_target_and_a_wrong_unit_are_told() {
    let error = read("revolute", "rad", "t,q1,u1\n0,0.1,3\n0.1,0.2,4\n").expect_err("no target");
    assert!(
        error.contains("qref1") && error.contains("its input is a position"),
        "{error}"
    );
    for (kind, unit, expected) in [
        ("revolute", "m", "recorded in rad"),
        ("prismatic", "rad", "recorded in m,"),
    ] {
        let error = read(kind, unit, "t,q1,qref1\n0,0.1,0.5\n").expect_err(kind);
        assert!(
            error.contains(expected) && error.contains("position"),
            "{error}"
        );
    }
}
