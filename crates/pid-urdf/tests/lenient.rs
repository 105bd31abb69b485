//! What public files have and other readers take: each kind with the value that is read.

use pid_derive::mechanism::{InertiaSource, Mechanism};
use pid_urdf::{Description, Guess, Missing, Reading, UrdfError};

#[path = "common/arm.rs"]
mod common_arm;
use common_arm::{BODY, GRAVITY, arm, close, read};

fn mechanism(text: &str) -> Mechanism {
    read(text).mechanism(GRAVITY)
}

fn strict(text: &str) -> Result<Description, UrdfError> {
    let mut reading = Reading::default();
    reading.strict = true;
    Description::parse_with("a.urdf", text, &reading)
}

#[test]
fn the_nearest_inertia_takes_the_place_of_one_that_no_body_has() {
    let text = arm(&BODY.replace("0.01\"", "0.002\""), "");
    let text = text.replace("0.012", "0.009");
    let description = read(&text);
    // J = 9, 6, 2: a third of the excess of 1 from the largest to each other one.
    let body = &description.mechanism(GRAVITY).bodies[0];
    let third = 0.001 / 3.0;
    close(
        &body.inertia,
        &[0.002 + third, 0.009 - third, 0.006 + third, 0.0, 0.0, 0.0],
    );
    assert_eq!(body.source, InertiaSource::Corrected);
    let [warning] = &description.warnings[..] else {
        panic!("{:?}", description.warnings)
    };
    assert!(
        warning.starts_with("a.urdf:3: link `arm`: no body has this inertia"),
        "{warning}"
    );
    assert!(warning.contains("1.000e-3 kg m^2 (11.11 %)"), "{warning}");
    let error = strict(&text).unwrap_err().to_string();
    assert!(
        error.contains("link `arm`") && error.contains("must not exceed"),
        "{error}"
    );
}

/// Off-diagonal entries and an `rpy` on the inertial: the axes of the correction are those of the body.
#[test]
fn the_correction_is_in_the_axes_of_the_body() {
    let turned = BODY
        .replace("xyz=\"0 0 0.1\"", "xyz=\"0 0 0.1\" rpy=\"0.3 -0.4 0.5\"")
        .replace("0.01\"", "0.002\"")
        .replace("0.012", "0.009");
    let found = mechanism(&arm(&turned, "")).bodies[0].inertia;
    let place = pid_derive::mechanism::Place::new([0.0; 3], [0.3, -0.4, 0.5]);
    let third = 0.001 / 3.0;
    close(
        &found,
        &place.tensor([0.002 + third, 0.009 - third, 0.006 + third, 0.0, 0.0, 0.0]),
    );
}

#[test]
fn the_body_counts_and_not_its_parts() {
    let camera = r#"<link name="camera"><inertial><mass value="0.05"/>
        <inertia ixx="0.001" iyy="0.0006" izz="8e-06" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="mount" type="fixed"><parent link="arm"/><child link="camera"/><origin xyz="0 0 0.1"/></joint>
        </robot>"#;
    let text = arm(BODY, "").replace("</robot>", camera);
    let description = strict(&text).expect("a body");
    assert!(
        description.warnings.is_empty(),
        "{:?}",
        description.warnings
    );
    let body = &description.mechanism(GRAVITY).bodies[0];
    close(&[body.mass], &[1.05]);
    close(&body.inertia, &[0.011, 0.0126, 0.006008, 0.0, 0.0, 0.0]);
    assert_eq!(body.source, InertiaSource::Stated);
}

#[test]
fn what_no_joint_feels_is_no_matter() {
    // The base never moves.
    let base = r#"<link name="base"><inertial><mass value="-8"/>
        <inertia ixx="0.4" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"#;
    let text = arm(BODY, "").replace("<link name=\"base\"/>", base);
    let description = strict(&text).expect("a base that does not move");
    assert!(description.warnings.is_empty());
    assert_eq!(mechanism(&text), mechanism(&arm(BODY, "")));
    // A sliding joint feels the mass alone.
    let slides = arm(&BODY.replace("0.01\"", "0.9\""), "").replace("revolute", "prismatic");
    assert!(strict(&slides).expect("a slider").warnings.is_empty());
    // 0.02 kg m^2 are felt at the joint, of which the correction is 5e-6.
    let slightly = arm(&BODY.replace("0.012", "0.016015"), "");
    assert!(strict(&slightly).expect("a little off").warnings.is_empty());
    // Left of a rounding to seven decimals, and still the nearest body.
    let tip = BODY
        .replace("\"1\"", "\"0.001\"")
        .replace("0 0 0.1", "0 0 0");
    let tip = tip
        .replace("0.012", "0")
        .replace("0.01\"", "3e-08\"")
        .replace("0.006", "0");
    let description = strict(&arm(&tip, "")).expect("rounded");
    close(
        &description.mechanism(GRAVITY).bodies[0]
            .inertia
            .map(|x| 1e8 * x),
        &[2.0, 1.0, 1.0, 0.0, 0.0, 0.0],
    );
}

#[test]
fn the_ground_need_not_be_declared() {
    let text = arm(BODY, "").replace(
        "</robot>",
        "<joint name=\"weld\" type=\"fixed\"><parent link=\"world\"/><child link=\"base\"/></joint></robot>",
    );
    let description = read(&text);
    assert_eq!(description.links[description.root].name, "world");
    assert_eq!(description.mechanism(GRAVITY), mechanism(&arm(BODY, "")));
    assert_eq!(description.warnings, [""; 0]);
    // A part of a robot hangs on a link of another file: the base, with a warning.
    let part = read(&text.replace("\"world\"", "\"pelvis\""));
    assert_eq!(part.links[part.root].name, "pelvis");
    assert_eq!(part.mechanism(GRAVITY), mechanism(&arm(BODY, "")));
    let [warning] = &part.warnings[..] else {
        panic!("{:?}", part.warnings)
    };
    assert!(
        warning.contains("link `pelvis` carries the others and is not declared"),
        "{warning}"
    );
    // A name beside a root that is declared, two such names, and one that is carried are mistakes.
    let weld = |parent: &str, child: &str| {
        let joint = "<joint name=\"NAME\" type=\"fixed\"><parent link=\"PARENT\"/><child link=\"CHILD\"/></joint></robot>";
        let joint = joint.replace("NAME", &format!("to_{child}"));
        joint.replace("PARENT", parent).replace("CHILD", child)
    };
    let camera = arm(BODY, "").replace("</robot>", "<link name=\"camera\"/></robot>");
    let end = |more: &str| camera.replace("</robot>", more);
    let second = weld("sky", "base") + &weld("ground", "camera");
    for (text, unknown) in [
        (end(&weld("ground", "camera")), "ground"),
        (end(&second.replacen("</robot>", "", 1)), "sky"),
        (
            text.replace("\"world\"", "\"ground\"").replace(
                "</robot>",
                &weld("ground", "ground").replace("to_ground", "self"),
            ),
            "ground",
        ),
    ] {
        let error = Description::parse("a.urdf", &text).unwrap_err().to_string();
        assert!(
            error.contains(&format!("there is no link `{unknown}`")),
            "{error}"
        );
    }
}

#[test]
fn every_link_without_inertia_is_named_at_once() {
    let bare = |name: &str, parent: &str| {
        format!(
            "<link name=\"{name}\"><collision><geometry><box size=\"0.1 0.2 0.4\"/></geometry></collision></link>\
             <joint name=\"of_{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{name}\"/></joint>"
        )
    };
    let text = format!(
        "<robot><link name=\"base\"/>{}{}</robot>",
        bare("x", "base"),
        bare("y", "x")
    );
    let error = Description::parse("a.urdf", &text).unwrap_err();
    let UrdfError::NoInertia { links, .. } = &error else {
        panic!("{error}")
    };
    assert_eq!(links, &["x", "y"]);
    let message = error.to_string();
    for part in [
        "`x` (joint `of_x`), `y` (joint `of_y`)",
        "guessed",
        "hold their joints",
    ] {
        assert!(message.contains(part), "{message}");
    }
    // Guessed: 8 litres of water, and 5 kg as stated.
    let mut guess = Guess::default();
    guess.masses.insert("y".to_owned(), 5.0);
    let mut reading = Reading::default();
    reading.missing = Missing::Guess(guess);
    let description = Description::parse_with("a.urdf", &text, &reading).expect("guessed");
    assert_eq!(description.warnings.len(), 2, "{:?}", description.warnings);
    assert!(
        description.warnings[0].contains("8.0000 kg is guessed from its collision geometry (box)")
    );
    let bodies = description.mechanism(GRAVITY).bodies;
    assert!(bodies.iter().all(|b| b.source == InertiaSource::Guessed));
    close(&[bodies[0].mass, bodies[1].mass], &[8.0, 5.0]);
    // m/12 (y² + z²) and so on.
    close(
        &bodies[1].inertia.map(|x| x * 12.0 / 5.0),
        &[0.2, 0.17, 0.05, 0.0, 0.0, 0.0],
    );
    // Held: what is left has to resist.
    let mut reading = Reading::default();
    reading.held.insert("of_y".to_owned(), 0.2);
    let error = Description::parse_with("a.urdf", &text, &reading).unwrap_err();
    assert!(matches!(error, UrdfError::NoInertia { links, .. } if links == ["x"]));
}

#[test]
fn a_massless_link_may_carry_others() {
    let text = arm("", "").replace(
        "</robot>",
        &format!(
            "<link name=\"tool\">{BODY}</link><joint name=\"j2\" type=\"revolute\"><parent link=\"arm\"/>\
             <child link=\"tool\"/><axis xyz=\"1 0 0\"/></joint></robot>"
        ),
    );
    let bodies = mechanism(&text).bodies;
    assert_eq!((bodies[0].mass, bodies[1].mass), (0.0, 1.0));
    // A point on the axis of the last joint resists nothing.
    let point = text.replace("0 0 0.1", "0 0 0").replace("0.01\"", "0\"");
    let point = point.replace("0.012", "0").replace("0.006", "0");
    let error = Description::parse("a.urdf", &point).unwrap_err();
    assert!(matches!(error, UrdfError::NoInertia { links, .. } if links == ["arm", "tool"]));
}

#[test]
fn floating_and_planar_bases_are_held() {
    for kind in ["floating", "planar"] {
        let text = arm(BODY, "").replace("<link name=\"base\"/>", "<link name=\"w\"/><link name=\"base\"/>").replace(
            "</robot>",
            &format!(
                "<joint name=\"root\" type=\"{kind}\"><parent link=\"w\"/><child link=\"base\"/>\
                 <origin xyz=\"1 0 2\" rpy=\"0 0 1\"/></joint></robot>"
            ),
        );
        let description = read(&text);
        assert_eq!(description.warnings.len(), 1);
        assert!(
            description.warnings[0]
                .contains(&format!("joint `root` is {kind}; what it carries is held")),
            "{:?}",
            description.warnings
        );
        let bodies = description.mechanism(GRAVITY).bodies;
        assert_eq!(bodies.len(), 1);
        close(&bodies[0].origin, &[1.0, 0.0, 2.0]);
        close(&bodies[0].rpy, &[0.0, 0.0, 1.0]);
    }
}

#[test]
fn joints_are_held_by_name() {
    let text = arm(BODY, "<limit lower=\"0.4\" upper=\"2\"/>").replace(
        "</robot>",
        &format!(
            "<link name=\"tool\">{BODY}</link><joint name=\"j2\" type=\"prismatic\"><parent link=\"arm\"/>\
             <child link=\"tool\"/><origin xyz=\"0 0 0.5\"/><axis xyz=\"1 0 0\"/></joint></robot>"
        ),
    );
    let mut reading = Reading::default();
    reading.moving = Some(vec!["j2".to_owned()]);
    let description = Description::parse_with("a.urdf", &text, &reading).expect("one joint");
    // Zero is outside the limits of j1: it is held at the next one.
    assert_eq!(description.joints[0].held, Some(0.4));
    let bodies = description.mechanism(GRAVITY).bodies;
    assert_eq!(bodies.len(), 1);
    close(
        &bodies[0].origin,
        &[0.5 * 0.4_f64.sin(), 0.0, 0.5 * 0.4_f64.cos()],
    );
    // The tool, 0.1 m beyond 0.5 m and slid by 0.3 m, becomes part of the arm.
    let mut reading = Reading::default();
    reading.held.insert("j2".to_owned(), 0.3);
    let description = Description::parse_with("a.urdf", &text, &reading).expect("one joint");
    let body = &description.mechanism(GRAVITY).bodies[0];
    close(&[body.mass], &[2.0]);
    close(&body.com, &[0.15, 0.0, 0.35]);
    // The mechanism holds its joints in the same way.
    let whole = mechanism(&text);
    let same = whole.holding(&[None, Some(0.3)]);
    assert_eq!(same.bodies.len(), 1);
    close(&same.bodies[0].com, &body.com);
    close(&same.bodies[0].inertia, &body.inertia);
    let tool = whole.holding(&[Some(0.4), None]);
    close(
        &tool.bodies[0].origin,
        &[0.5 * 0.4_f64.sin(), 0.0, 0.5 * 0.4_f64.cos()],
    );
    close(&tool.bodies[0].rpy, &[0.0, 0.4, 0.0]);
    assert_eq!(tool.bodies[0].parent, None);
    assert_eq!(
        pid_urdf::robot(&description, &Default::default())
            .unwrap()
            .nq(),
        1
    );
    reading.held.insert("j3".to_owned(), 0.3);
    let error = Description::parse_with("a.urdf", &text, &reading).unwrap_err();
    assert_eq!(
        error.to_string(),
        "a.urdf: there is no joint `j3`\n  help: did you mean `j1`?"
    );
}

#[test]
fn of_two_elements_the_first_is_read() {
    let text = arm(
        &format!("{BODY}<inertial><mass value=\"7\"/></inertial>"),
        "<origin xyz=\"1 0 0\"/><origin/>",
    );
    let description = read(&text);
    let body = &description.mechanism(GRAVITY).bodies[0];
    assert_eq!((body.mass, body.origin), (1.0, [1.0, 0.0, 0.0]));
    assert_eq!(description.warnings.len(), 2, "{:?}", description.warnings);
    assert!(
        description.warnings[0]
            .contains("link `arm` has a second <inertial>; the first one is read")
    );
    assert!(
        description.warnings[1].contains("joint `j1` has a second <origin>; the first one is read")
    );
}

#[test]
fn limits_and_friction_that_cannot_be_are_warnings() {
    let text = arm(
        BODY,
        "<limit lower=\"1\" upper=\"-2\" effort=\"inf\" velocity=\"fast\"/><dynamics damping=\"-1\" friction=\"0.3\"/>",
    );
    let description = read(&text);
    let body = &description.mechanism(GRAVITY).bodies[0];
    assert_eq!(body.limits, Some((-2.0, 1.0)));
    assert_eq!((body.effort, body.speed), (None, None));
    assert_eq!((body.viscous, body.coulomb), (None, Some(0.3)));
    for (part, warning) in [
        "they are exchanged",
        "velocity is \"fast\"",
        "damping is -1",
    ]
    .iter()
    .zip(&description.warnings)
    {
        assert!(warning.contains(part), "{warning}");
    }
    let stated = mechanism(&arm(
        BODY,
        "<limit lower=\"-1\" upper=\"2\" effort=\"30\" velocity=\"4\"/>",
    ));
    assert_eq!(
        (stated.bodies[0].effort, stated.bodies[0].speed),
        (Some(30.0), Some(4.0))
    );
}

#[test]
fn what_mimics_a_fixed_joint_is_held() {
    let finger = format!(
        "<link name=\"f\">{BODY}</link><joint name=\"j2\" type=\"prismatic\"><parent link=\"base\"/><child link=\"f\"/>\
         <mimic joint=\"j0\" multiplier=\"2\" offset=\"0.3\"/></joint><link name=\"g\"/>\
         <joint name=\"j0\" type=\"fixed\"><parent link=\"base\"/><child link=\"g\"/><mimic joint=\"j1\"/></joint></robot>"
    );
    let description = read(&arm(BODY, "").replace("</robot>", &finger));
    assert_eq!(description.joints[1].held, Some(0.3));
    assert_eq!(description.joints[1].mimic, None);
    assert_eq!(description.mechanism(GRAVITY).bodies.len(), 1);
    assert_eq!(description.warnings.len(), 2, "{:?}", description.warnings);
}

#[test]
fn what_mimics_no_joint_moves_on_its_own() {
    let text = arm(BODY, "<mimic joint=\"j2\"/>");
    let description = read(&text);
    assert_eq!(description.joints[0].mimic, None);
    assert!(
        description.warnings[0]
            .contains("mimics `j2`, which is no joint; it moves on its own; did you mean `j1`?"),
        "{:?}",
        description.warnings
    );
}

#[test]
fn vectors_may_have_commas_or_a_number_too_many() {
    for origin in ["1, -2,3", "1 -2 3 0"] {
        let description = read(&arm(BODY, &format!("<origin xyz=\"{origin}\"/>")));
        assert_eq!(description.joints[0].origin, [1.0, -2.0, 3.0]);
        assert!(description.warnings[0].contains("the first 3 numbers are read"));
    }
    // A decimal comma is not guessed at.
    let text = arm(&BODY.replace("mass value=\"1\"", "mass value=\"1,5\""), "");
    assert!(matches!(
        Description::parse("a.urdf", &text),
        Err(UrdfError::Value { .. })
    ));
}

#[test]
fn followers_are_part_of_the_mechanism() {
    let right = format!(
        "<link name=\"r\">{BODY}</link><joint name=\"j2\" type=\"revolute\"><parent link=\"base\"/><child link=\"r\"/>\
         <axis xyz=\"0 -2 0\"/><mimic joint=\"j1\" multiplier=\"-0.5\" offset=\"0.1\"/></joint></robot>"
    );
    let coupled = mechanism(&arm(BODY, "").replace("</robot>", &right));
    let bodies = &coupled.bodies;
    assert_eq!(bodies[1].axis, [0.0, -1.0, 0.0]);
    let follows = bodies[1].follows.expect("a follower");
    assert_eq!(
        (follows.body, follows.ratio, follows.offset),
        (0, -0.5, 0.1)
    );
    // The leader may come later.
    let mut turned = coupled.clone();
    turned.bodies.swap(0, 1);
    turned.bodies[0].follows = Some(pid_derive::mechanism::Follows { body: 1, ..follows });
    let affine = turned.robot().joints[0]
        .follows
        .clone()
        .expect("a follower");
    assert_eq!(affine.terms.len(), 1);
    assert_eq!(affine.terms[0].0, 0);
    // A held leader holds its follower.
    assert!(coupled.holding(&[Some(0.2), None]).bodies.is_empty());
}

#[test]
fn xml_that_other_readers_accept_is_read() {
    let plain = arm(BODY, "");
    for (text, warnings) in [
        (format!("\n\n<?xml version=\"1.0\"?>\n{plain}"), 0),
        (
            plain.replace(
                "<link name=\"base\"/>",
                "<link name=\"base\"/><!-- a -- b -->",
            ),
            0,
        ),
        (
            plain.replace(
                "</robot>",
                "<gazebo:x a:b=\"1\"><gazebo:y/></gazebo:x></robot>",
            ),
            2,
        ),
        (format!("\u{feff}{plain}"), 0),
    ] {
        let description = read(&text);
        assert_eq!(description.mechanism(GRAVITY), mechanism(&plain), "{text}");
        assert_eq!(
            description.warnings.len(),
            warnings,
            "{:?}",
            description.warnings
        );
        // Values are written back into the text as it was.
        let robot = pid_urdf::robot(&description, &Default::default()).unwrap();
        let value = |name: &str| {
            let param = robot.params.iter().find(|p| p.name == name)?;
            Some(if name == "arm_m" { 2.0 } else { param.nominal })
        };
        let written = pid_urdf::write(&description, &Default::default(), value);
        assert!(
            written.text.contains("mass value=\"2\""),
            "{}",
            written.text
        );
        assert_eq!(written.text.contains("a -- b"), text.contains("a -- b"));
    }
}

#[test]
fn a_body_without_mass_keeps_its_inertia() {
    let text = arm(&BODY.replace("mass value=\"1\"", "mass value=\"0\""), "");
    let description = read(&text);
    assert_eq!(description.warnings.len(), 1, "{:?}", description.warnings);
    let body = &description.mechanism(GRAVITY).bodies[0];
    assert_eq!((body.mass, body.inertia[1]), (0.0, 0.012));
}
