//! Robots from URDF files: what they expand to, and messages on the path.

use std::path::Path;

use pid_codegen::expand_in;

fn expand(text: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pid-urdf/tests/robots");
    expand_in(text.parse().expect("tokens"), &folder).to_string()
}

#[test]
fn the_file_becomes_a_robot_and_is_tracked() {
    let out = expand(
        "/// An arm.\npub robot Arm from urdf \"planar_arm.urdf\" { inertial: free; emit { dynamics } }",
    );
    syn::parse_str::<syn::File>(&out).expect("items");
    for part in [
        "pub struct Arm ;",
        "upper_ixx",
        "viscous_elbow",
        "torque_shoulder",
        "An arm.",
        "include_bytes",
    ] {
        assert!(out.contains(part), "{part}");
    }
    assert!(!out.contains("compile_error"), "no message");
    let numbers = expand(
        "robot Arm from urdf \"planar_arm.urdf\" { inertial: fixed; friction: fixed; emit { dynamics } }",
    );
    assert!(!numbers.contains("upper_ixx") && numbers.contains("torque_shoulder"));
}

#[test]
fn mistakes_are_named() {
    for (text, message) in [
        (
            "robot A from urdf \"nowhere.urdf\" {}",
            "nowhere.urdf: cannot be read",
        ),
        (
            "robot A from urdf \"planar_arm.urdf\" { inertia: free; }",
            "expected `inertial` or `friction` or `armature` or `emit`, found `inertia`",
        ),
        (
            "robot A from urdf \"planar_arm.urdf\" { inertial: open; }",
            "expected `free` or `fixed`, found `open`",
        ),
        (
            "robot A from sdf \"planar_arm.urdf\" {}",
            "expected `urdf`, found `sdf`",
        ),
    ] {
        let out = expand(text);
        assert!(
            out.contains("compile_error") && out.contains(message),
            "{text}: {out}"
        );
    }
}
