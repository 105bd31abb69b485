//! What is read of a model, against values by hand; messages.

mod common;

use std::f64::consts::{FRAC_PI_2, PI};

use common::{body_of, close, hinge, model, read};
use pid_derive::mechanism::Place;
use pid_mjcf::{Mjcf, MjcfError};

fn refused(text: &str) -> String {
    Mjcf::parse("a.xml", text).expect_err(text).to_string()
}

const STATED: &str = "<inertial pos=\"0 0 0.1\" mass=\"2\" diaginertia=\"0.03 0.02 0.01\"/>";

#[test]
fn joints_have_what_they_state() {
    let joint = "<joint name=\"lift\" type=\"slide\" pos=\"0.1 0 0\" range=\"-1 2\" armature=\"0.3\" damping=\"4\" \
                 frictionloss=\"5\" actuatorfrcrange=\"-70 60\"/>";
    let text = model(
        &format!("<body pos=\"1 2 3\" name=\"a\">{joint}{STATED}</body>"),
        "<option gravity=\"0 0 -1.62\" timestep=\"0.01\"/>",
    );
    let read = read(&text);
    assert_eq!(
        (read.timestep, read.mechanism.gravity),
        (0.01, [0.0, 0.0, -1.62])
    );
    assert_eq!(read.mechanism.name, "TestRobot");
    let body = &read.mechanism.bodies[0];
    assert!(body.prismatic);
    assert_eq!((body.axis, body.origin), ([0.0, 0.0, 1.0], [1.1, 2.0, 3.0]));
    close(&body.com, &[-0.1, 0.0, 0.1]);
    assert_eq!(body.limits, Some((-1.0, 2.0)));
    assert_eq!(
        (body.rotor, body.viscous, body.coulomb, body.effort),
        (Some(0.3), Some(4.0), Some(5.0), Some(70.0))
    );
    // Degrees unless the compiler says radians; a range that holds only if it is said to.
    let turning = |rest: &str| {
        let text = model(
            &hinge(STATED).replace("axis", "range=\"-90 180\" axis"),
            rest,
        );
        body_of(&text).limits
    };
    let body_limits = turning("").expect("limits");
    close(&[body_limits.0, body_limits.1], &[-FRAC_PI_2, PI]);
    assert_eq!(
        turning("<compiler angle=\"radian\"/>"),
        Some((-90.0, 180.0))
    );
    assert_eq!(turning("<compiler autolimits=\"false\"/>"), None);
}

#[test]
fn orientations_in_five_ways() {
    // All turn x to y, y to z, z to x: 120° about (1, 1, 1).
    for way in [
        "quat=\"0.5 0.5 0.5 0.5\"",
        "axisangle=\"1 1 1 120\"",
        "xyaxes=\"0 3 0 0 1 2\"",
        "euler=\"90 0 90\"",
    ] {
        let text = model(
            &hinge(STATED).replace("name=\"arm\"", &format!("name=\"arm\" {way}")),
            if way.starts_with("euler") {
                "<compiler eulerseq=\"zyx\"/>"
            } else {
                ""
            },
        );
        let place = Place::new([0.0; 3], body_of(&text).rpy);
        for (from, to) in [
            ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
            ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
        ] {
            close(&place.vector(from), &to);
        }
    }
    let text = model(
        &hinge(STATED).replace("name=\"arm\"", "zaxis=\"1 0 1\""),
        "",
    );
    let place = Place::new([0.0; 3], body_of(&text).rpy);
    let half = 0.5_f64.sqrt();
    close(&place.vector([0.0, 0.0, 1.0]), &[half, 0.0, half]);
    close(&place.vector([0.0, 1.0, 0.0]), &[0.0, 1.0, 0.0]);
    // Capitals turn in the frame outside: the reverse order of lower case.
    let euler = |sequence: &str, angles: &str| {
        let text = model(
            &hinge(STATED).replace("name=\"arm\"", &format!("euler=\"{angles}\"")),
            &format!("<compiler eulerseq=\"{sequence}\"/>"),
        );
        body_of(&text).rpy
    };
    close(&euler("XYZ", "10 20 30"), &euler("zyx", "30 20 10"));
}

#[test]
fn several_joints_of_a_body_are_a_chain() {
    let text = model(
        "<body name=\"a\" pos=\"0 0 1\">\
         <joint name=\"x\" type=\"slide\" axis=\"1 0 0\"/><joint name=\"turn\" axis=\"0 0 1\" pos=\"0.2 0 0\" ref=\"30\"/>\
         <inertial pos=\"0.5 0 0\" mass=\"1\" diaginertia=\"0.1 0.1 0.1\"/>\
         <body name=\"b\" pos=\"1 0 0\"><joint name=\"hand\" axis=\"0 1 0\"/>\
         <inertial pos=\"0 0 0.1\" mass=\"1\" diaginertia=\"0.1 0.1 0.1\"/></body></body>",
        "",
    );
    let bodies = read(&text).mechanism.bodies;
    let names: Vec<&str> = bodies.iter().map(|b| &*b.joint).collect();
    assert_eq!(names, ["x", "turn", "hand"]);
    assert_eq!((bodies[0].mass, bodies[1].mass), (0.0, 1.0));
    assert_eq!((bodies[1].parent, bodies[2].parent), (Some(0), Some(1)));
    close(&bodies[1].com, &[0.3, 0.0, 0.0]);
    // The body stands as the file places it where the joint is at its reference, 30°.
    let reference = bodies[1].place(PI / 6.0);
    close(&reference.origin, &[0.2, 0.0, 0.0]);
    close(&reference.vector([1.0, 0.0, 0.0]), &[1.0, 0.0, 0.0]);
    close(&bodies[2].origin, &[0.8, 0.0, 0.0]);
}

#[test]
fn inertias_of_geoms() {
    let of = |geom: &str| body_of(&model(&hinge(&format!("<geom {geom}/>")), ""));
    // 1000 kg/m³ unless something else is stated.
    let ball = of("size=\"0.1\"");
    let mass = 1000.0 * 4.0 / 3.0 * PI * 1e-3;
    close(&[ball.mass, ball.inertia[0]], &[mass, 0.4 * mass * 0.01]);
    let cuboid = of("type=\"box\" size=\"0.1 0.2 0.3\" density=\"500\" pos=\"0 0 1\"");
    close(&[cuboid.mass, cuboid.com[2]], &[24.0, 1.0]);
    close(&cuboid.inertia[..3], &[8.0 * 0.13, 8.0 * 0.1, 8.0 * 0.05]);
    let cylinder = of("type=\"cylinder\" size=\"0.1 0.3\" mass=\"6\"");
    close(
        &cylinder.inertia[..3],
        &[0.5 * (0.03 + 0.36), 0.5 * (0.03 + 0.36), 0.03],
    );
    let ellipsoid = of("type=\"ellipsoid\" size=\"0.1 0.2 0.3\" mass=\"5\"");
    close(&ellipsoid.inertia[..3], &[0.13, 0.1, 0.05]);
    // A capsule along x by its ends: a cylinder and two half balls, by the parallel axis theorem.
    let capsule = of("type=\"capsule\" size=\"0.1\" fromto=\"0 0 0 0.6 0 0\"");
    let (cylinder, ball) = (1000.0 * PI * 0.01 * 0.6, 1000.0 * 4.0 / 3.0 * PI * 1e-3);
    close(&[capsule.mass, capsule.com[0]], &[cylinder + ball, 0.3]);
    let (centre, distance) = (0.4 * 0.01 - (3.0_f64 / 80.0).powi(2), 0.3 + 3.0 / 80.0);
    let across = cylinder * (0.03 + 0.36) / 12.0 + ball * (centre + distance * distance);
    close(&[capsule.inertia[1]], &[across]);
    close(
        &[capsule.inertia[0]],
        &[0.5 * cylinder * 0.01 + 0.4 * ball * 0.01],
    );
    // Stated ones hold before geoms, unless the compiler says otherwise; planes have no mass.
    let both = hinge(&format!(
        "{STATED}<geom size=\"0.1\"/><geom type=\"plane\" size=\"1 1 1\"/>"
    ));
    assert_eq!(body_of(&model(&both, "")).mass, 2.0);
    close(
        &[body_of(&model(&both, "<compiler inertiafromgeom=\"true\"/>")).mass],
        &[mass],
    );
}

#[test]
fn the_compiler_changes_masses() {
    let two = format!(
        "<body><geom size=\"0.1\" mass=\"6\"/></body>{}",
        hinge(STATED)
    );
    // 2 kg of 8 kg in all; the body that does not move counts.
    let scaled = body_of(&model(&two, "<compiler settotalmass=\"4\"/>"));
    close(&[scaled.mass, scaled.inertia[0]], &[1.0, 0.015]);
    let bound = body_of(&model(
        &hinge(STATED),
        "<compiler boundmass=\"3\" boundinertia=\"0.015\"/>",
    ));
    close(
        &[bound.mass, bound.inertia[1], bound.inertia[2]],
        &[3.0, 0.02, 0.015],
    );
    let none = read(&model(
        &hinge(STATED),
        "<option gravity=\"0 0 -1\"><flag gravity=\"disable\"/></option>",
    ));
    assert_eq!(none.mechanism.gravity, [0.0; 3]);
}

#[test]
fn full_inertia_and_bodies_without_joints() {
    let fixed = "<body pos=\"0 0 0.5\" euler=\"0 0 90\"><inertial pos=\"0 0 0\" mass=\"2\" \
                 fullinertia=\"0.03 0.02 0.01 0.001 0.002 0.003\"/></body>";
    let found = body_of(&model(&hinge(&format!("{STATED}{fixed}")), ""));
    // 2 kg at 0.1 m and 2 kg at 0.5 m: 0.04 each about the middle. 90° about z: x to y, y to −x.
    close(&[found.mass, found.com[2]], &[4.0, 0.3]);
    close(
        &found.inertia,
        &[
            0.03 + 0.02 + 0.16,
            0.02 + 0.03 + 0.16,
            0.02,
            -0.001,
            -0.003,
            0.002,
        ],
    );
}

#[test]
fn defaults_by_class() {
    let rest = "<default><joint damping=\"1\" armature=\"0.1\"/><geom density=\"100\"/>\
                <default class=\"big\"><joint damping=\"2\"/><default class=\"biggest\"><joint frictionloss=\"3\"/></default>\
                </default></default>";
    let arm = |name: &str, class: &str, inner: &str| {
        format!(
            "<body name=\"b{name}\" {inner}><joint name=\"{name}\" {class}/><geom type=\"box\" size=\".5 .5 .5\"/></body>"
        )
    };
    let text = model(
        &[
            arm("plain", "", ""),
            arm("big", "class=\"big\"", ""),
            arm("inner", "", "childclass=\"biggest\""),
            arm(
                "own",
                "class=\"big\" damping=\"9\"",
                "childclass=\"biggest\"",
            ),
        ]
        .concat(),
        rest,
    );
    let bodies = read(&text).mechanism.bodies;
    let found: Vec<_> = bodies
        .iter()
        .map(|b| (b.rotor, b.viscous, b.coulomb))
        .collect();
    assert_eq!(
        found,
        [
            (Some(0.1), Some(1.0), None),
            (Some(0.1), Some(2.0), None),
            (Some(0.1), Some(2.0), Some(3.0)),
            (Some(0.1), Some(9.0), None),
        ]
    );
    assert_eq!(bodies[0].mass, 100.0);
    let error = refused(&text.replace("class=\"big\" damping", "class=\"bigg\" damping"));
    assert!(
        error.contains("there is no default class `bigg`\n  help: did you mean `big`?"),
        "{error}"
    );
}

#[test]
fn drives_have_laws_and_ranges() {
    let drives = "<actuator>\
        <motor name=\"m\" joint=\"j\" gear=\"50\" ctrlrange=\"-2 1\"/>\
        <position joint=\"j\" kp=\"100\" kv=\"3\" forcerange=\"-40 40\"/>\
        <velocity joint=\"j\" kv=\"7\"/>\
        <general joint=\"j\" gainprm=\"20\" biastype=\"affine\" biasprm=\"1 -20 -2\" gear=\"2\" forcerange=\"-5 6\"/>\
        <general joint=\"j\" gainprm=\"20\" biasprm=\"1 -20 -2\"/>\
        <muscle joint=\"j\"/><motor tendon=\"t\"/></actuator>";
    let read = read(&model(&hinge(STATED), drives));
    let laws: Vec<_> = read
        .actuators
        .iter()
        .map(|a| (a.gear, a.gain, a.bias))
        .collect();
    assert_eq!(
        laws,
        [
            (50.0, 1.0, [0.0; 3]),
            (1.0, 100.0, [0.0, -100.0, -3.0]),
            (1.0, 7.0, [0.0, 0.0, -7.0]),
            (2.0, 20.0, [1.0, -20.0, -2.0]),
            (1.0, 20.0, [0.0; 3]),
        ]
    );
    let efforts: Vec<_> = read.actuators.iter().map(|a| a.effort()).collect();
    assert_eq!(efforts, [Some(100.0), Some(40.0), None, Some(12.0), None]);
    // One drive without a range: nothing is known of the joint.
    assert_eq!(read.mechanism.bodies[0].effort, None);
    assert_eq!(read.warnings.len(), 2, "{:?}", read.warnings);
    assert!(
        read.warnings[0].contains("a <muscle> is not read"),
        "{:?}",
        read.warnings
    );
    assert!(
        read.warnings[1].contains("a <motor> moves no single joint"),
        "{:?}",
        read.warnings
    );
}

#[test]
fn a_free_base_is_held_and_what_is_not_read_is_named() {
    let text = format!(
        "<mujoco><worldbody><body name=\"trunk\" pos=\"0 0 1\"><freejoint name=\"root\"/><geom size=\"0.2\"/>{}</body>\
         </worldbody><equality><joint joint1=\"j\"/></equality><tendon><spatial name=\"t\"/></tendon></mujoco>",
        hinge(STATED).replace("axis", "stiffness=\"3\" axis")
    );
    let read = read(&text);
    assert_eq!(read.mechanism.bodies.len(), 1);
    assert_eq!(read.mechanism.bodies[0].origin, [0.0, 0.0, 1.0]);
    for part in [
        "a.xml:1: freejoint `root` is free; what it carries is held",
        "joint `j` has a spring (`stiffness`)",
        "a <joint> ties joints or bodies; it is not read",
        "spatial `t` pulls on joints; it is not read",
    ] {
        assert!(
            read.warnings.iter().any(|w| w.contains(part)),
            "{part}: {:?}",
            read.warnings
        );
    }
}

#[test]
fn mistakes_are_named() {
    let good = model(&hinge(STATED), "");
    for (from, to, message) in [
        (
            "axis=\"0 2 0\"",
            "axis=\"0 0 0\"",
            "joint `j`: axis is \"0 0 0\"\n  help: an axis has a direction",
        ),
        (
            "axis=\"0 2 0\"",
            "axis=\"0 2\"",
            "axis is \"0 2\"\n  help: write 3 finite numbers",
        ),
        (
            "axis=\"0 2 0\"",
            "axis=\"0 2 x\"",
            "axis is \"0 2 x\"\n  help: write finite numbers",
        ),
        (
            STATED,
            "",
            "neither they nor what they carry has mass or inertia: `arm` (joint `j`)",
        ),
        (
            STATED,
            "<geom type=\"capsule\" mesh=\"m\"/>",
            "`arm` (joint `j`)",
        ),
        (
            STATED,
            "<geom type=\"mesh\" mesh=\"m\"/>",
            "`arm` (joint `j`)",
        ),
        (
            STATED,
            "<geom type=\"box\" size=\"1\"/>",
            "size is \"1\"\n  help: a box needs more positive sizes",
        ),
        ("<joint name=\"j\" axis=\"0 2 0\"/>", "", "no joint moves"),
        ("mass=\"2\"", "mass=\"-2\"", "a mass is zero or positive"),
        (
            "</worldbody>",
            "<attach model=\"m\" body=\"b\" prefix=\"p\"/></worldbody>",
            "makes bodies that are not written out",
        ),
        (
            "</worldbody>",
            "<replicate count=\"1.5\"/></worldbody>",
            "count is \"1.5\"\n  help: write a whole number",
        ),
        (
            "</worldbody>",
            "<replicate count=\"900000000\"><geom size=\"1\"/></replicate></worldbody>",
            "help: at most 50000 elements",
        ),
        (
            "</worldbody>",
            // Nothing is in it, and its frames are elements.
            "<replicate count=\"900000000\"/></worldbody>",
            "help: at most 50000 elements",
        ),
        (
            "<worldbody>",
            "<include file=\"nowhere.xml\"/><worldbody>",
            "nowhere.xml: cannot be read",
        ),
        ("</mujoco>", "", "a.xml: "),
    ] {
        assert!(good.contains(from), "{from}");
        let error = refused(&good.replacen(from, to, 1));
        assert!(error.contains(message), "{to}: {error}");
    }
    assert!(refused("<robot/>").contains("the root element is <robot>"));
    let deep = format!(
        "<mujoco>{}{}</mujoco>",
        "<body>".repeat(400),
        "</body>".repeat(400)
    );
    assert!(matches!(
        Mjcf::parse("a.xml", &deep),
        Err(MjcfError::Deep { .. } | MjcfError::Xml { .. })
    ));
}

/// Copies stand in frames that are done again and again: the second one is turned once and moved along
/// the axes of the first, as MuJoCo 4.0 places them.
#[test]
fn replicas_stand_where_mujoco_places_them() {
    let leaf = format!(
        "<replicate count=\"3\" offset=\"0.1 0.02 0\" euler=\"0 0 30\" sep=\"-\"><body name=\"c\" pos=\"0 0 0.1\">\
         <joint name=\"k\" type=\"slide\"/>{STATED}</body></replicate>"
    );
    let drives = "<actuator><motor name=\"d\" joint=\"k\" gear=\"3\"/></actuator>";
    let found = read(&model(&leaf, drives));
    let bodies = &found.mechanism.bodies;
    let names: Vec<&str> = bodies.iter().map(|b| b.joint.as_str()).collect();
    assert_eq!(names, ["k_0", "k_1", "k_2"]);
    close(&bodies[0].origin, &[0.0, 0.0, 0.1]);
    close(&bodies[1].origin, &[0.1, 0.02, 0.1]);
    let (c, s) = (0.75_f64.sqrt(), 0.5);
    close(
        &bodies[2].origin,
        &[0.1 + 0.1 * c - 0.02 * s, 0.02 + 0.1 * s + 0.02 * c, 0.1],
    );
    close(&bodies[2].rpy, &[0.0, 0.0, PI / 3.0]);
    let drives: Vec<(&str, usize)> = (found.actuators.iter())
        .map(|a| (a.name.as_str(), a.body))
        .collect();
    assert_eq!(drives, [("d-0", 0), ("d-1", 1), ("d-2", 2)]);
    // One within the other: the inner number comes first, and each is as long as its count.
    let nested = "<replicate count=\"10\" offset=\"1 0 0\" sep=\"-\"><replicate count=\"2\" offset=\"0 1 0\"><body name=\"c\">\
                  <joint name=\"k\"/><geom size=\"0.1\"/></body></replicate></replicate>";
    let bodies = read(&model(nested, "")).mechanism.bodies;
    assert_eq!(bodies.len(), 20);
    assert_eq!(
        (bodies[3].link.as_str(), bodies[3].origin),
        ("c1-01", [1.0, 1.0, 0.0])
    );
    // Of geoms that make the mass of a body.
    let ring = "<replicate count=\"4\" euler=\"0 0 90\"><geom size=\"0.1\" pos=\"1 0 0\" mass=\"0.5\"/></replicate>";
    let body = body_of(&model(&hinge(ring), ""));
    close(&[body.mass, body.com[0], body.com[1]], &[2.0, 0.0, 0.0]);
    let own = 0.4 * 2.0 * 0.01;
    close(&body.inertia[..3], &[1.0 + own, 1.0 + own, 2.0 + own]);
}

/// Three hinges in a row turn a body as the product of the turns about x, y and z; they have the anchor of the ball
/// joint, and the last one has the mass.
#[test]
fn a_ball_joint_is_three_hinges() {
    let ball = "<joint name=\"b\" type=\"ball\" pos=\"0 0 0.2\" range=\"0 1\" damping=\"0.3\" armature=\"0.1\"/>";
    let world = format!("<body name=\"arm\" pos=\"1 0 0\" euler=\"0 0 90\">{ball}{STATED}</body>");
    let drives = "<actuator><motor joint=\"b\" gear=\"1 0 0\"/></actuator>";
    let found = read(&model(&world, drives));
    let bodies = &found.mechanism.bodies;
    let names: Vec<&str> = bodies.iter().map(|b| b.joint.as_str()).collect();
    assert_eq!(names, ["b_x", "b_y", "b_z"]);
    assert_eq!(bodies[2].axis, [0.0, 0.0, 1.0]);
    close(&bodies[0].origin, &[1.0, 0.0, 0.2]);
    assert_eq!((bodies[1].origin, bodies[2].origin), ([0.0; 3], [0.0; 3]));
    assert_eq!(
        (bodies[0].mass, bodies[1].mass, bodies[2].mass),
        (0.0, 0.0, 2.0)
    );
    close(&bodies[2].com, &[0.0, 0.0, -0.1]);
    assert!(
        bodies
            .iter()
            .all(|b| b.limits.is_none() && b.viscous == Some(0.3) && b.rotor == Some(0.1))
    );
    assert!(found.actuators.is_empty());
    assert!(found.warnings[0].contains("joint `b` is a ball joint; it is read as three hinges"));
    assert!(
        found.warnings[1].contains("turns a ball joint"),
        "{:?}",
        found.warnings
    );
}

/// A geom that states one size of three has the others of its class.
#[test]
fn sizes_that_are_not_stated_are_those_of_the_class() {
    let default = "<default><geom type=\"box\" size=\"0.5 0.2 0.3\"/></default>";
    let body = body_of(&model(&hinge("<geom size=\"0.1\"/>"), default));
    close(&[body.mass], &[1000.0 * 8.0 * 0.1 * 0.2 * 0.3]);
}

/// Cloth and cables beside a robot are left out, and said to be.
#[test]
fn soft_bodies_are_left_out() {
    let soft = "<flexcomp name=\"cloth\" type=\"grid\"/><composite type=\"cable\"/>";
    let found = read(&model(&format!("{soft}{}", hinge(STATED)), ""));
    assert_eq!(found.mechanism.bodies.len(), 1);
    assert_eq!(found.warnings.len(), 2);
    assert!(found.warnings[0].contains("flexcomp `cloth` is a soft body"));
}

#[test]
fn included_files_stand_where_they_are_included() {
    let folder = std::env::temp_dir().join(format!("pid_mjcf_{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("a file");
    write(
        "arm.xml",
        &format!("<mujocoinclude>{}</mujocoinclude>", hinge(STATED)),
    );
    write("loop.xml", "<mujoco><include file=\"loop.xml\"/></mujoco>");
    let main = folder.join("main.xml");
    let text = model("<body pos=\"0 0 2\"><include file=\"arm.xml\"/></body>", "");
    let found = Mjcf::parse(&main, &text).map(|m| m.mechanism.bodies[0].origin);
    let endless = Mjcf::read(folder.join("loop.xml")).map(|_| ());
    std::fs::remove_dir_all(&folder).expect("the folder");
    assert_eq!(found.expect("the included arm"), [0.0, 0.0, 2.0]);
    assert!(matches!(endless, Err(MjcfError::Deep { .. })));
}

/// Between two ends a box or an ellipsoid has one further size, for both directions across.
#[test]
fn a_box_between_two_ends_is_square() {
    for (kind, further) in [("box", ""), ("box", " 7 9"), ("ellipsoid", " 7 9")] {
        let ends = format!(
            "<geom type=\"{kind}\" size=\"0.1{further}\" fromto=\"0 0 1 2 0 1\" mass=\"3\"/>"
        );
        let body = body_of(&model(&hinge(&ends), ""));
        let sizes = format!("<geom type=\"{kind}\" size=\"1 0.1 0.1\" pos=\"1 0 1\" mass=\"3\"/>");
        let expected = body_of(&model(&hinge(&sizes), ""));
        close(&[body.mass], &[3.0]);
        close(&body.com, &expected.com);
        close(&body.inertia, &expected.inertia);
    }
}
