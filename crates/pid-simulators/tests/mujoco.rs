//! `robot.xml`, read back; what is said of each effect.

mod common;

use common::{
    LOOP, behind_loop, described, effect, equations, in_order_of, reduced, same, state, tree,
};
use pid_derive::mechanism::Mechanism;
use pid_effects::{effects, terms};
use pid_interpret::nominal::{Nominal, Provenance};
use pid_mjcf::Mjcf;
use pid_simulators::{Options, Target, export};
use pid_symbolic::random::Random;

fn file(nominal: &Nominal, name: &str) -> String {
    let files =
        export(nominal, Target::Mujoco, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    let found = files.into_iter().find(|f| f.name == name);
    found.unwrap_or_else(|| panic!("no {name}")).text
}

fn read(text: &str) -> Mechanism {
    Mjcf::parse("robot.xml", text)
        .unwrap_or_else(|e| panic!("{e}\n{text}"))
        .mechanism
}

fn of(mechanism: &Mechanism) -> Nominal {
    let described = Nominal::of_mechanism(mechanism, Provenance::Cad);
    described.unwrap_or_else(|e| panic!("{e}")).nominal
}

/// Mass matrix and bias survive the file, rotors included: trees of turning and sliding joints, any
/// gravity, with a joint that follows another.
#[test]
fn the_equations_survive_the_file() {
    let mut random = Random::new(5);
    for seed in 0..24 {
        let bodies = 1 + seed as usize % 6;
        let mechanism = tree(seed, bodies, bodies > 1 && seed % 3 == 0);
        let nominal = of(&mechanism);
        let again = in_order_of(&read(&file(&nominal, "robot.xml")), &mechanism);
        for _ in 0..5 {
            let [q, v] = state(&mut random, nominal.robot().nq());
            let expected = equations(nominal.robot(), true, &q, &v);
            let found = reduced(&again, &mechanism, &q, &v);
            same(&found, &expected, &format!("seed {seed}"));
        }
    }
}

/// A joint that follows another is an equality, and the wrapper starts it where it belongs.
#[test]
fn a_follower_is_an_equality() {
    let mechanism = tree(3, 4, true);
    let nominal = of(&mechanism);
    let follows = mechanism.bodies[3].follows.expect("a follower");
    let (ratio, offset) = (follows.ratio, follows.offset);
    let text = file(&nominal, "robot.xml");
    let equality = format!(
        r#"<joint joint1="joint_3" joint2="joint_0" polycoef="{offset:?} {ratio:?} 0 0 0""#
    );
    assert!(text.contains(&equality), "{equality}\n{text}");
    let data: serde_json::Value =
        serde_json::from_str(&file(&nominal, "robot_effects.json")).expect("JSON");
    let expected = serde_json::json!([{"joint": "joint_3", "leader": "joint_0", "ratio": ratio, "offset": offset}]);
    assert_eq!(data["followers"], expected);
}

#[test]
fn drives_survive_the_file() {
    let mechanism = tree(2, 3, false);
    let again = in_order_of(&read(&file(&of(&mechanism), "robot.xml")), &mechanism);
    for (body, own) in again.bodies.iter().zip(&mechanism.bodies) {
        assert_eq!(
            (body.rotor, body.coulomb, body.viscous, body.limits),
            (own.rotor, own.coulomb, own.viscous, own.limits)
        );
    }
    let text = file(
        &described(&effect("current_offset", Some("j2"), &[("offset", -0.4)])),
        "robot.xml",
    );
    let actuators = Mjcf::parse("robot.xml", &text).expect("a model").actuators;
    let laws: Vec<_> = actuators.iter().map(|a| (a.gain, a.bias[0])).collect();
    assert_eq!(laws, [(3.0, 0.0), (3.0, 3.0 * -0.4), (3.0, 0.0)]);
}

/// A payload is a point mass: by the parallel axis theorem, with the last body's 2 kg.
#[test]
fn a_payload_is_in_the_last_body() {
    let text = file(
        &described(&effect("payload", None, &[("mass", 0.5)])),
        "robot.xml",
    );
    let body = read(&text).bodies.pop().expect("three bodies");
    assert!((body.mass - 2.5).abs() < 1e-12);
    let com = [0.01, 0.02, -0.15];
    let tool = [0.1, 0.02, -0.3];
    for k in 0..3 {
        assert!((body.com[k] - (2.0 * com[k] + 0.5 * tool[k]) / 2.5).abs() < 1e-12);
    }
    // Reduced mass 2·0.5/2.5 kg at the distance (0.09, 0, -0.15) m.
    let reduced = 0.4;
    let expected = [
        0.03 + reduced * 0.15 * 0.15,
        0.031 + reduced * (0.09 * 0.09 + 0.15 * 0.15),
        0.008 + reduced * 0.09 * 0.09,
        0.001,
        reduced * 0.09 * 0.15,
        0.002,
    ];
    for (x, y) in body.inertia.iter().zip(expected) {
        assert!((x - y).abs() < 1e-12, "{:?} {expected:?}", body.inertia);
    }
}

/// A base turned by x about its x axis: gravity turns the other way in its axes.
#[test]
fn a_tilted_base_turns_gravity() {
    let tilt = effect("base_tilt", None, &[("tilt_x", 0.1), ("tilt_y", 0.0)]);
    let gravity = read(&file(&described(&tilt), "robot.xml")).gravity;
    let expected = [0.0, -9.81 * 0.1_f64.sin(), -9.81 * 0.1_f64.cos()];
    for (x, y) in gravity.iter().zip(expected) {
        assert!((x - y).abs() < 1e-7, "{gravity:?} {expected:?}");
    }
}

/// A heavier rotor adds to the armature.
#[test]
fn a_heavier_rotor_is_in_the_armature() {
    let rotor = effect(
        "unmodelled_rotor_inertia",
        Some("j2"),
        &[("extra_inertia", 0.05)],
    );
    let bodies = read(&file(&described(&rotor), "robot.xml")).bodies;
    let rotors: Vec<_> = bodies.iter().map(|b| b.rotor.expect("a rotor")).collect();
    assert!(
        (rotors[1] - 0.15).abs() < 1e-15 && rotors[0] == 0.1,
        "{rotors:?}"
    );
}

/// With rotor q_m and twist d the link is at q_m + d: T = J q̇_m²/2 + I (q̇_m + ḋ)²/2.
#[test]
fn an_elastic_joint_has_two_coordinates() {
    let nominal = described(&effect(
        "joint_elasticity",
        Some("j1"),
        &[("compliance", 0.004), ("damping_time", 0.002)],
    ));
    let text = file(&nominal, "robot.xml");
    assert!(
        text.contains(r#"name="j1_twist" type="hinge" axis="0 1 0" stiffness="250" damping="0.5""#),
        "{text}"
    );
    let again = read(&text);
    assert_eq!(again.bodies.len(), 4);
    let mut random = Random::new(3);
    for _ in 0..5 {
        let [q, v] = state(&mut random, 4);
        let rigid = |q: &[f64]| vec![q[0] + q[1], q[2], q[3]];
        let link = equations(nominal.robot(), false, &rigid(&q), &rigid(&v));
        let found = equations(&again.robot(), true, &q, &v);
        // Rows of rotor and twist are both that of the link; rotors add to their own coordinate.
        let of = [0, 0, 1, 2];
        let rotors = [0.1, 0.0, 0.1, 0.1];
        let expected = common::Equations {
            mass: (0..4)
                .map(|i| {
                    let rotor = |j: usize| if i == j { rotors[i] } else { 0.0 };
                    (0..4).map(|j| link.mass[of[i]][of[j]] + rotor(j)).collect()
                })
                .collect(),
            bias: of.iter().map(|&i| link.bias[i]).collect(),
        };
        same(&found, &expected, "elastic");
    }
}

/// Every effect of the library and every term has its row, and the module knows each that it has to apply.
#[test]
fn every_effect_is_told() {
    let mut text = String::new();
    for own in effects::all().into_iter().chain(terms::all()) {
        let info = own.info();
        let values: Vec<(&str, f64)> = info
            .parameters
            .iter()
            .map(|p| {
                (
                    p.name,
                    if p.lower > 0.0 {
                        p.lower
                    } else {
                        0.1 * p.upper.min(0.1)
                    },
                )
            })
            .collect();
        text.push_str(&effect(info.id, info.has_joint.then_some("j2"), &values));
        assert!(
            pid_simulators::mujoco::expression(info.id).is_some(),
            "{}",
            info.id
        );
    }
    let nominal = behind_loop(LOOP, &text);
    let list = file(&nominal, "not_expressed.md");
    let data: serde_json::Value =
        serde_json::from_str(&file(&nominal, "robot_effects.json")).expect("JSON");
    let module = file(&nominal, "robot_effects.py");
    for own in effects::all().into_iter().chain(terms::all()) {
        let info = own.info();
        let place = if info.has_joint { "j2" } else { "whole robot" };
        assert!(
            list.contains(&format!("| {} | {place} |", info.id)),
            "{}",
            info.id
        );
    }
    let known = data["effects"].as_array().expect("a list");
    assert!(known.len() > 15, "{}", known.len());
    for own in known {
        let id = own["id"].as_str().expect("a name");
        assert!(module.contains(&format!("\"{id}\"")), "{id}");
        for name in own["parameters"].as_object().expect("parameters").keys() {
            let read = format!("\"{name}\"");
            let counted = name.starts_with("on_") || name.starts_with("off_");
            // The law of play is that of its gear.
            assert!(
                id == "backlash" || counted || module.contains(&read),
                "{id}: {name}"
            );
        }
    }
}

/// The loop of j2 is that of an actuator which reads its target: gain 3, kp 20, kd 2, at most 4 of its output.
#[test]
fn a_position_loop_is_an_actuator() {
    let nominal = behind_loop(&format!("{LOOP}limit = 4.0\nrate_hz = 500.0\n"), "");
    let text = file(&nominal, "robot.xml");
    let actuators = Mjcf::parse("robot.xml", &text).expect("a model").actuators;
    let loops: Vec<_> = actuators.iter().map(|a| a.position_loop()).collect();
    let own = loops[1].as_ref().expect("a loop");
    assert_eq!((own.kp, own.kd), (60.0, 6.0));
    assert!(loops[0].is_none() && loops[2].is_none());
    assert_eq!(actuators[1].force_on_joint(), Some(12.0));
    let data: serde_json::Value =
        serde_json::from_str(&file(&nominal, "robot_effects.json")).expect("JSON");
    let expected =
        serde_json::json!({"law": "pd", "kp": 20.0, "kd": 2.0, "limit": 4.0, "rate_hz": 500.0});
    assert_eq!(data["joints"][1]["loop"], expected);
    assert!(data["joints"][0]["loop"].is_null() && data["drive_model"].is_null());
    let list = file(&nominal, "not_expressed.md");
    assert!(
        list.contains("The actuator of robot.xml has its gains, without rate_hz;"),
        "{list}"
    );
    assert!(file(&nominal, "position_loops.py").contains("class Loop"));
}

/// What a drive knows of the robot is a file of its own: the masses of its table, whatever was found since.
#[test]
fn what_drives_know_is_a_file() {
    let known = "[joint.drive_model]\nmass = 1.5\ncom = [0.0, 0.0, -0.2]\nrotor_inertia = 0.02\nmotor_gain = 1.8\n";
    let payload = effect("payload", None, &[("mass", 0.5)]);
    let nominal = behind_loop(&format!("{LOOP}gravity = 1.0\n{known}"), &payload);
    let bodies = read(&file(&nominal, "drive_model.xml")).bodies;
    let masses: Vec<f64> = bodies.iter().map(|b| b.mass).collect();
    assert_eq!(masses, [2.0, 1.5, 2.0]);
    assert_eq!((bodies[1].rotor, bodies[0].rotor), (Some(0.02), Some(0.1)));
    let data: serde_json::Value =
        serde_json::from_str(&file(&nominal, "robot_effects.json")).expect("JSON");
    let gains: Vec<_> = (0..3)
        .map(|j| data["joints"][j]["known_gain"].as_f64())
        .collect();
    assert_eq!(gains, [Some(3.0), Some(1.8), Some(3.0)]);
    assert_eq!(data["drive_model"], "drive_model.xml");
}

/// An inertia that no body has becomes one, and is told.
#[test]
fn an_inertia_that_no_body_has_is_told() {
    let mut mechanism = tree(1, 1, false);
    mechanism.bodies[0].inertia = [0.01, 0.01, 0.05, 0.0, 0.0, 0.0];
    let nominal = of(&mechanism);
    let body = read(&file(&nominal, "robot.xml")).bodies.remove(0);
    let [x, y, z] = [body.inertia[0], body.inertia[1], body.inertia[2]];
    assert!(z <= x + y + 1e-15, "{:?}", body.inertia);
    let list = file(&nominal, "not_expressed.md");
    assert!(
        list.contains("joint `joint_0` has an inertia that no body has")
            && list.contains("3.000e-2"),
        "{list}"
    );
}
