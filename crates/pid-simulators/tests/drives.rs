//! Drives for Isaac Lab and Newton.

mod common;

use common::{LOOP, behind_loop, described, effect};
use pid_effects::effects;
use pid_interpret::nominal::Nominal;
use pid_simulators::{Options, Target, export};

/// Values by hand: gain 3, Coulomb 0.8, viscous 0.5, rotor 0.1 and 0.05 more.
#[test]
fn drives_have_the_values_of_their_effects() {
    let text = [
        effect(
            "unmodelled_rotor_inertia",
            Some("j2"),
            &[("extra_inertia", 0.05)],
        ),
        effect(
            "stribeck",
            Some("j2"),
            &[("excess", 0.5), ("stribeck_velocity", 0.03)],
        ),
        effect("torque_saturation", Some("j2"), &[("limit_input", 4.0)]),
        effect("input_delay", Some("j2"), &[("delay_s", 0.0075)]),
        effect("current_offset", Some("j1"), &[("offset", -0.2)]),
    ]
    .concat();
    for target in [Target::IsaacLab, Target::Newton] {
        let files = export(&described(&text), target, &Options::default()).expect("files");
        let data = files
            .iter()
            .find(|f| f.name == "robot_drives.json")
            .expect("drives");
        let data: serde_json::Value = serde_json::from_str(&data.text).expect("JSON");
        let of = |k: usize, name: &str| data["drives"][k][name].as_f64().expect("a number");
        for (k, name, expected) in [
            (1, "armature", 0.15),
            (1, "friction", 0.8),
            (1, "static_friction", 1.2),
            (1, "viscous", 0.5),
            (1, "effort_limit", 12.0),
            (1, "delay_s", 0.0075),
            (0, "constant_effort", -0.6),
            (0, "static_friction", 0.8),
            (0, "delay_s", 0.0),
        ] {
            assert!((of(k, name) - expected).abs() < 1e-12, "{k} {name}");
        }
        assert!(data["drives"][0]["effort_limit"].is_null());
    }
}

/// The loop of j2, by hand: gain 3, kp 20, kd 2, at most 4 of its output, and 5 at rest.
#[test]
fn position_loops_are_stiffness_and_damping() {
    let limits = "limit = 4.0\nstall = 5.0\nno_load_speed = 9.0\nrate_hz = 500.0\n";
    let nominal = behind_loop(&format!("{LOOP}{limits}"), "");
    for target in [Target::IsaacLab, Target::Newton] {
        let files = export(&nominal, target, &Options::default()).expect("files");
        let text = |name: &str| &files.iter().find(|f| f.name == name).expect("a file").text;
        let data: serde_json::Value =
            serde_json::from_str(text("robot_drives.json")).expect("JSON");
        let of = |k: usize, name: &str| data["drives"][k][name].as_f64();
        for (name, own, other) in [
            ("stiffness", Some(60.0), Some(0.0)),
            ("damping", Some(6.0), Some(0.0)),
            ("effort_limit", Some(12.0), None),
            ("stall_effort", Some(15.0), None),
            ("no_load_speed", Some(9.0), None),
        ] {
            assert_eq!((of(1, name), of(0, name)), (own, other), "{name}");
        }
        let list = text("not_expressed.md");
        assert!(
            list.contains("whose gains are stiffness and damping; left out: rate_hz."),
            "{list}"
        );
    }
}

/// Values by hand: gain 3 N m/A, Coulomb 0.8, viscous 0.5, rotor 0.1.
#[test]
fn joints_become_models_of_bam() {
    let text = [
        effect(
            "stribeck",
            Some("j2"),
            &[("excess", 0.5), ("stribeck_velocity", 0.03)],
        ),
        effect(
            "load_dependent_friction",
            Some("j2"),
            &[("load_coefficient", 0.2)],
        ),
        effect(
            "load_dependent_friction",
            Some("j1"),
            &[("load_coefficient", 0.1)],
        ),
    ]
    .concat();
    let files = export(&described(&text), Target::Bam, &Options::default()).expect("files");
    let of = |joint: &str| -> serde_json::Value {
        let name = format!("bam_{joint}.json");
        let file = files.iter().find(|f| f.name == name).expect("a joint");
        serde_json::from_str(&file.text).expect("JSON")
    };
    let two = of("j2");
    for (name, expected) in [
        ("kt", 3.0),
        ("armature", 0.1),
        ("friction_base", 0.8),
        ("friction_stribeck", 0.4),
        ("load_friction_base", 0.1),
        ("load_friction_stribeck", 0.05),
        ("dtheta_stribeck", 0.03),
        ("alpha", 2.0),
        ("friction_viscous", 0.5),
    ] {
        let value = two[name].as_f64().expect(name);
        assert!((value - expected).abs() < 1e-12, "{name} {value}");
    }
    assert_eq!(
        (&two["model"], &of("j1")["model"]),
        (&"m4".into(), &"m3".into())
    );
    assert!(of("j1").get("alpha").is_none());
}

/// Per volt a motor brings kt/R, and per velocity it induces kt: 3 N m/V and 0.6 V s/rad are 0.2 ohm and brake by
/// 1.8 N m s/rad beside a viscous friction of 0.5.
#[test]
fn a_back_emf_is_the_torque_constant_of_bam() {
    let drive = "[joint.drive]\nlaw = \"p\"\nkp = 20.0\nback_emf = 0.6\n";
    let text = behind_loop("", "").to_toml().expect("a text");
    let (first, second) = text.split_once("name = \"j2\"").expect("a joint");
    let second = second.replacen("input = \"current\"", "input = \"voltage\"", 1);
    let (own, rest) = second.split_once("[[joint]]").expect("a third joint");
    let text = format!("{first}name = \"j2\"{own}{drive}[[joint]]{rest}");
    let nominal = Nominal::parse("arm.toml", &text).expect(&text);
    let file = |target, name: &str| -> serde_json::Value {
        let files = export(&nominal, target, &Options::default()).expect("files");
        let file = files.iter().find(|f| f.name == name).expect(name);
        serde_json::from_str(&file.text).expect("JSON")
    };
    let bam = file(Target::Bam, "bam_j2.json");
    for (name, expected) in [("kt", 0.6), ("R", 0.2), ("friction_viscous", 0.5)] {
        let value = bam[name].as_f64().expect(name);
        assert!((value - expected).abs() < 1e-12, "{name} {value}");
    }
    let drives = file(Target::Newton, "robot_drives.json");
    let viscous = drives["drives"][1]["viscous"].as_f64().expect("viscous");
    assert!((viscous - 2.3).abs() < 1e-12, "{viscous}");
}

/// No effect of the library is dropped without a word.
#[test]
fn every_effect_is_listed() {
    for own in effects::all() {
        let info = own.info();
        let values: Vec<(&str, f64)> = (info.parameters.iter())
            .map(|p| {
                (
                    p.name,
                    if p.lower > 0.0 {
                        p.lower
                    } else {
                        0.01 * p.upper.min(0.1)
                    },
                )
            })
            .collect();
        let joint = info.has_joint.then_some("j2");
        let drive = if own.stage().is_some() { LOOP } else { "" };
        let nominal = behind_loop(drive, &effect(info.id, joint, &values));
        for target in [Target::Urdf, Target::IsaacLab, Target::Newton, Target::Bam] {
            let files = export(&nominal, target, &Options::default()).expect("files");
            let list = &files
                .iter()
                .find(|f| f.name == "not_expressed.md")
                .expect("a list")
                .text;
            let row = format!("| {} | {} | ", info.id, joint.unwrap_or("whole robot"));
            assert!(list.contains(&row), "{target:?}: {list}");
        }
    }
}
