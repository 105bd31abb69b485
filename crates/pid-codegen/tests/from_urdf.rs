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
            "expected one of `inertial`, `friction`, `armature`, `gravity`, `params`, `emit`, `limit ops`, `expect`, found `inertia`",
        ),
        (
            "robot A from urdf \"planar_arm.urdf\" { inertial: open; }",
            "expected `free` or `fixed`, found `open`",
        ),
        (
            "robot A from sdf \"planar_arm.urdf\" {}",
            "expected `from urdf \\\"path\\\"` after the name of the robot, found `sdf`",
        ),
    ] {
        let out = expand(text);
        assert!(
            out.contains("compile_error") && out.contains(message),
            "{text}: {out}"
        );
    }
}

/// The messages of an expansion, in order.
fn messages(text: &str) -> Vec<String> {
    let file: syn::File = syn::parse_str(&expand(text)).expect("items");
    let text = |item: &syn::Item| match item {
        syn::Item::Macro(m) if m.mac.path.segments.last()?.ident == "compile_error" => {
            Some(m.mac.parse_body::<syn::LitStr>().ok()?.value())
        }
        _ => None,
    };
    file.items.iter().filter_map(text).collect()
}

#[test]
fn parameters_of_the_file_take_other_values() {
    let out = expand(
        "robot Arm from urdf \"planar_arm.urdf\" { gravity: [0, 0, -1.62] m/s^2; \
         params { upper_m: kg = 2500 g in 1.0..=4.0; viscous_elbow: N*m*s/rad fixed; } \
         emit { dynamics, regressor, base_parameters } limit ops 1_000; }",
    );
    assert!(!out.contains("compile_error"), "{out:.3000}");
    for part in [
        "regressor",
        "base_parameters",
        "nominal : 2.5",
        "upper : 4f64",
        "1.62",
    ] {
        assert!(out.contains(part), "{part}");
    }
    // What is known takes a direction away: the rank of the others is asked for.
    let rank = |fixed: &str, rank: usize| {
        messages(&format!(
            "robot Arm from urdf \"planar_arm.urdf\" {{ params {{ {fixed} }} emit {{ dynamics }} expect rank {rank}; }}"
        ))
    };
    let free = rank("", 0);
    assert!(
        free[0].starts_with("expected rank 0, found 10 of 24 parameters"),
        "{free:?}"
    );
    let known = rank("viscous_elbow: N*m*s/rad fixed;", 0);
    assert!(
        known[0].starts_with("expected rank 0, found 9 of 23 parameters"),
        "{known:?}"
    );
    assert_eq!(rank("", 10), Vec::<String>::new());
}

#[test]
fn several_mistakes_are_reported_at_once_and_leave_stubs() {
    let text = "pub robot Arm from urdf \"planar_arm.urdf\" { params { upper_mm: kg = 2; lower_m: m = 1; \
                viscous_elbow: N*m*s/rad = 3 in 0.0..=2.0; dry_elbow: N*m = k; upper_m: kg = 1; upper_m: kg = 1; \
                lower_mx: kg*m = [1, 2]; lower_ixx: kg*m^2 in 2..=1; } emit { dynamic } }";
    assert_eq!(
        messages(text),
        [
            "expected one of `dynamics`, `first_derivatives`, `second_derivatives`, `regressor`, `base_parameters`, `lanes`, found `dynamic`\nhelp: did you mean `dynamics`?",
            "a nominal value must be a number, found the name `k`",
            "robot `Arm` has no parameter named `upper_mm`\nhelp: a parameter with a similar name exists: `upper_m`",
            "`lower_m` must be in `kg`, found `m`",
            "nominal value 3 of `viscous_elbow` is outside 0..=2",
            "the name `upper_m` is declared twice",
            "`upper_m` was first declared here",
            "`lower_mx` is one parameter, but has a list\nhelp: lists belong to parameters declared `per joint`",
            "empty range 2..=1 for `lower_ixx`\nhelp: did you mean `1..=2`?",
        ]
    );
    let out = expand(text);
    for part in [
        "upper_ixx",
        "viscous_elbow",
        "torque_shoulder",
        "pub struct Arm ;",
    ] {
        assert!(out.contains(part), "{part}");
    }
    // Without the file there is the robot, without parameters.
    let out = expand("pub robot Arm from urdf \"nowhere.urdf\" {}");
    syn::parse_str::<syn::File>(&out).expect("items");
    assert!(out.contains("pub struct ArmParams"), "{out}");
}

#[test]
fn mistakes_in_the_file_have_its_line_and_the_mend() {
    let folder = std::env::temp_dir().join("pid_codegen_from_urdf");
    std::fs::create_dir_all(&folder).expect("a folder");
    let good = include_str!("../../pid-urdf/tests/robots/planar_arm.urdf");
    for (name, from, to, message) in [
        (
            "mass",
            "mass value=\"2.0\"",
            "mass value=\"two\"",
            "mass.urdf:4: link `upper`: mass value is \"two\"",
        ),
        (
            "axis",
            "<axis xyz=\"0 1 0\"/><dynamics",
            "<axis xyz=\"0 0 0\"/><dynamics",
            "axis.urdf:10: ",
        ),
        (
            "link",
            "<child link=\"lower\"/>",
            "<child link=\"lover\"/>",
            "link.urdf:13: joint `elbow`: there is no link `lover`\nhelp: did you mean `lower`?",
        ),
    ] {
        let text = good.replace(from, to);
        assert_ne!(text, good, "{name}");
        std::fs::write(folder.join(format!("{name}.urdf")), text).expect("a file");
        let tokens = format!("robot Arm from urdf \"{name}.urdf\" {{}}");
        let out = expand_in(tokens.parse().expect("tokens"), &folder);
        let file: syn::File = syn::parse2(out).expect("items");
        let found = file.items.iter().find_map(|item| match item {
            syn::Item::Macro(m) => m.mac.parse_body::<syn::LitStr>().ok(),
            _ => None,
        });
        let found = found.expect("a message").value();
        assert!(found.starts_with(message), "{found}");
        assert!(found.contains("\nhelp: "), "{found}");
    }
}
