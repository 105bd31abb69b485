//! Nominal descriptions of robot files: the dynamics of the file, tolerances by class, and the way
//! through `nominal.toml` and back.

use std::path::Path;

use pid_derive::mechanism::Mechanism;
use pid_interpret::Model;
use pid_interpret::nominal::{Described, Nominal, Provenance, Role};
use pid_runtime::dynamics::{At, Dynamics};
use pid_symbolic::random::Random;
use pid_urdf::{Description, Inertias, Options, Reading};

const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// Two turning joints and a slide behind fixed joints, one at a pitch of 90°, with a branch.
const TREE: &str = r#"<robot name="tree">
  <link name="world"/>
  <joint name="weld" type="fixed"><parent link="world"/><child link="stand"/>
    <origin xyz="0.1 0 0.4" rpy="0 1.5707963267948966 0.3"/></joint>
  <link name="stand"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="stand"/><child link="arm"/><origin xyz="0 0.1 0.2" rpy="0.4 0 0"/>
    <axis xyz="1 2 -0.5"/><limit lower="-2" upper="2.5" effort="40" velocity="3"/><dynamics damping="0.7" friction="1.5"/></joint>
  <link name="arm"><inertial><origin xyz="0.02 0.01 0.2" rpy="0.3 -0.2 1"/><mass value="3"/>
    <inertia ixx="0.05" iyy="0.06" izz="0.02" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial></link>
  <joint name="flange" type="fixed"><parent link="arm"/><child link="plate"/>
    <origin xyz="0 0.05 0.4" rpy="-0.7 1.5707963267948966 0.2"/></joint>
  <link name="plate"><inertial><origin xyz="0.01 0 0"/><mass value="0.4"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.0015"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="plate"/><child link="rod"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 0.6 0.8"/><limit lower="0" upper="0.3" effort="100" velocity="0.4"/></joint>
  <link name="rod"><inertial><origin xyz="0 0.1 0"/><mass value="1.1"/>
    <inertia ixx="0.01" iyy="0.002" izz="0.01"/></inertial></link>
  <joint name="j3" type="continuous"><parent link="plate"/><child link="wheel"/><axis xyz="0 0 -1"/></joint>
  <link name="wheel"><inertial><origin xyz="0.003 0 0.05"/><mass value="0.6"/>
    <inertia ixx="0.002" iyy="0.002" izz="0.003"/></inertial></link>
</robot>"#;

fn file(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pid-urdf/tests/robots");
    std::fs::read_to_string(folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn read(text: &str) -> Description {
    Description::parse("robot.urdf", text).unwrap_or_else(|e| panic!("{e}"))
}

fn described(mechanism: &Mechanism, class: Provenance) -> Described {
    Nominal::of_mechanism(mechanism, class).unwrap_or_else(|e| panic!("{e}"))
}

/// Mass matrix and bias at a state, rotors and friction at zero.
fn dynamics(model: &Model, [q, v]: [&[f64]; 2]) -> Vec<f64> {
    let value = |p: &pid_runtime::dynamics::ParamInfo| match p.name.starts_with("rotor_") {
        true => 0.0,
        false => p.nominal,
    };
    let p: Vec<f64> = model.params().iter().map(value).collect();
    let n = q.len();
    let zero = vec![0.0; n.max(model.dims().nu)];
    let at = At {
        q,
        v,
        a: &zero[..n],
        u: &zero[..model.dims().nu],
        p: &p,
    };
    let (mut m, mut b) = (vec![0.0; n * (n + 1) / 2], vec![0.0; n]);
    model.mass_matrix(&at, &mut m);
    model.bias(&at, &mut b);
    m.extend(b);
    m
}

/// The description has the dynamics of the robot that the file becomes by its own way.
#[test]
fn the_dynamics_are_those_of_the_file() {
    let mut held = Reading::default();
    held.held.insert("slide".to_owned(), 0.2);
    held.held.insert("j3".to_owned(), -1.0);
    let held = Description::parse_with("tree.urdf", TREE, &held).expect("held joints");
    for description in [
        read(&file("planar_arm.urdf")),
        read(&file("scara.urdf")),
        read(&file("gripper.urdf")),
        read(TREE),
        held,
    ] {
        let mut options = Options::default();
        options.inertias = Inertias::Numbers;
        options.friction = false;
        let own = Model::new(&pid_urdf::robot(&description, &options).unwrap()).unwrap();
        let nominal = described(&description.mechanism(GRAVITY), Provenance::Cad).nominal;
        let model = Model::new(nominal.robot()).unwrap();
        let nq = own.dims().nq;
        assert_eq!(model.dims().nq, nq, "{}", description.name);
        let names =
            |m: &Model| -> Vec<String> { m.joints().iter().map(|j| j.name.to_string()).collect() };
        assert_eq!(names(&model), names(&own));
        let mut random = Random::new(17);
        for _ in 0..10 {
            let mut state =
                |size: f64| -> Vec<f64> { (0..nq).map(|_| random.uniform(-size, size)).collect() };
            let (q, v) = (state(3.0), state(4.0));
            let (found, expected) = (dynamics(&model, [&q, &v]), dynamics(&own, [&q, &v]));
            let scale = expected.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
            for (x, y) in found.iter().zip(&expected) {
                assert!(
                    (x - y).abs() <= 1e-12 * scale,
                    "{}: {x:e} for {y:e}, scale {scale:e}",
                    description.name
                );
            }
        }
    }
}

#[test]
fn what_is_written_is_read_back() {
    for text in [file("planar_arm.urdf"), file("scara.urdf"), TREE.to_owned()] {
        for class in [Provenance::Cad, Provenance::DataSheet, Provenance::Guessed] {
            let nominal = described(&read(&text).mechanism(GRAVITY), class).nominal;
            let written = nominal.to_toml().expect("a tree of driven bodies");
            let again = Nominal::parse("", &written).unwrap_or_else(|e| panic!("{e}\n{written}"));
            assert_eq!(again, nominal);
        }
    }
    // Followers have no place in the file.
    let coupled = described(
        &read(&file("gripper.urdf")).mechanism(GRAVITY),
        Provenance::Cad,
    );
    assert_eq!(coupled.nominal.to_toml(), None);
}

fn width(nominal: &Nominal, name: &str) -> (f64, f64) {
    let found = nominal.tolerances().iter().find(|t| t.name == name);
    let t = found.unwrap_or_else(|| panic!("no {name}"));
    (t.nominal, t.half_width)
}

#[test]
fn tolerances_are_those_of_the_class() {
    let mechanism = read(TREE).mechanism(GRAVITY);
    // The wheel: 0.6 kg, its largest moment 0.003 kg m^2, radius of gyration √(0.0035/0.6) m.
    let radius = (0.0035_f64 / 0.6).sqrt();
    for (class, mass, com, inertia) in [
        (Provenance::Cad, 0.03, 0.005, 0.0003),
        (Provenance::DataSheet, 0.12, 0.01, 0.0009),
        (Provenance::Guessed, 0.6, 0.01 + 0.5 * radius, 0.003),
    ] {
        let nominal = described(&mechanism, class).nominal;
        for (name, expected) in [
            ("mass_j3", (0.6, mass)),
            ("com_z_j3", (0.05, com)),
            ("izz_j3", (0.003, inertia)),
            ("ixy_j3", (0.0, inertia)),
            ("gain_j3", (1.0, 0.0)),
        ] {
            let found = width(&nominal, name);
            assert!((found.0 - expected.0).abs() < 1e-15, "{name} {found:?}");
            assert!(
                (found.1 - expected.1).abs() < 1e-15,
                "{name} {found:?} {expected:?}"
            );
        }
    }
}

#[test]
fn what_the_file_states_of_drives_is_the_start() {
    let Described {
        nominal,
        assumptions,
    } = described(&read(TREE).mechanism(GRAVITY), Provenance::Cad);
    // j1 states both frictions; its range reaches zero and four times the start beyond it, or four times the
    // default. Of 40 N m that is 1.2 N m, and 4 N m at 3 rad/s.
    assert_eq!(width(&nominal, "coulomb_j1"), (1.5, 6.0));
    assert_eq!(width(&nominal, "viscous_j1"), (0.7, 4.0 * 0.1 * 40.0 / 3.0));
    assert_eq!(width(&nominal, "rotor_j1"), (0.2, 0.8));
    let (coulomb, viscous) = (
        width(&nominal, "coulomb_slide"),
        width(&nominal, "viscous_slide"),
    );
    // 100 N, 0.4 m/s.
    assert!((coulomb.0 - 3.0).abs() < 1e-12 && (viscous.0 - 25.0).abs() < 1e-12);
    assert!((coulomb.1 - 12.0).abs() < 1e-12 && (viscous.1 - 100.0).abs() < 1e-12);
    // The wheel states nothing: its weight of 0.6 kg at its radius about the axis.
    let felt = 0.003 + 0.6 * 0.003 * 0.003;
    let torque = 9.81 * (0.6_f64 * felt).sqrt();
    assert!((width(&nominal, "coulomb_j3").0 - 0.03 * torque).abs() < 1e-12);
    // One line per joint with all that it does not state, with units.
    let stated = [
        ("joint `j1`", vec!["rotor inertia (0.2 kg·m²)"]),
        (
            "joint `slide`",
            vec![
                "rotor inertia (0.5 kg)",
                "Coulomb friction (3 N)",
                "viscous friction (25 N·s/m)",
            ],
        ),
        (
            "joint `j3`",
            vec![
                "rotor inertia (",
                "Coulomb friction (",
                "viscous friction (",
            ],
        ),
    ];
    let (horizon, of_joints) = assumptions.split_last().unwrap();
    assert_eq!(of_joints.len(), stated.len(), "{assumptions:#?}");
    assert!(horizon.contains("last 1 s"), "{horizon}");
    // Without one a free run would last as long as the record.
    assert_eq!(nominal.measurement().horizon, Some(1.0));
    for (line, (joint, values)) in of_joints.iter().zip(stated) {
        let line = line.to_string();
        assert!(line.starts_with(joint), "{line}");
        assert!(values.iter().all(|value| line.contains(value)), "{line}");
        assert_eq!(line.matches('(').count(), values.len(), "{line}");
    }
    for tolerance in nominal.tolerances() {
        if matches!(
            tolerance.role,
            Role::Coulomb | Role::Viscous | Role::RotorInertia
        ) {
            assert!(
                tolerance.nominal - tolerance.half_width <= 0.0,
                "{tolerance:?}"
            );
            assert!(tolerance.nominal > 0.0, "{tolerance:?}");
        }
    }
    let channels = &nominal.measurement().channels;
    let peaks: Vec<_> = channels
        .iter()
        .map(|c| (c.torque_peak, c.speed_scale))
        .collect();
    assert_eq!(
        peaks,
        [
            (Some(40.0), Some(3.0)),
            (Some(100.0), Some(0.4)),
            (None, None)
        ]
    );
    assert_eq!(nominal.robot().joints[0].limits, Some((-2.0, 2.5)));
}

/// An effort that no drive of such a robot has says nothing about its friction.
#[test]
fn placeholders_are_no_scale() {
    let mechanism = read(&TREE.replace("effort=\"40\"", "effort=\"1e6\"")).mechanism(GRAVITY);
    let nominal = described(&mechanism, Provenance::Cad).nominal;
    let carried = mechanism.carried(&[0.0; 3])[0];
    let felt = mechanism.felt(&[0.0; 3])[0];
    let weight = 9.81 * (carried.mass * felt).sqrt();
    let (rotor, _) = width(&nominal, "rotor_j1");
    assert!(
        (rotor - 5e-3 * 10.0 * weight).abs() < 1e-12,
        "{rotor} {weight}"
    );
}

#[test]
fn an_inertia_that_no_body_has_is_known_badly() {
    let text = TREE.replace(
        "izz=\"0.003\"/></inertial></link>\n</robot>",
        "izz=\"0.005\"/></inertial></link>\n</robot>",
    );
    assert_ne!(text, TREE);
    let description = read(&text);
    assert_eq!(description.warnings.len(), 1, "{:?}", description.warnings);
    let nominal = described(&description.mechanism(GRAVITY), Provenance::Cad).nominal;
    // The nearest: a third of the excess of 0.001 goes from the largest moment.
    let (izz, half) = width(&nominal, "izz_j3");
    assert!((izz - (0.005 - 0.001 / 3.0)).abs() < 1e-15);
    assert!((half - 0.5 * izz).abs() < 1e-12);
}

#[test]
fn bodies_without_mass_become_light() {
    let text = file("planar_arm.urdf").replace(
        "</robot>",
        "<link name=\"cross\"/><joint name=\"u1\" type=\"revolute\"><parent link=\"lower\"/><child link=\"cross\"/></joint>\
         <link name=\"hand\"><inertial><origin xyz=\"0.1 0.1 0\"/><mass value=\"0.3\"/>\
         <inertia ixx=\"0.001\" iyy=\"0.001\" izz=\"0.001\"/></inertial></link>\
         <joint name=\"u2\" type=\"revolute\"><parent link=\"cross\"/><child link=\"hand\"/><axis xyz=\"0 1 0\"/></joint></robot>",
    );
    let Described {
        nominal,
        assumptions,
    } = described(&read(&text).mechanism(GRAVITY), Provenance::DataSheet);
    // 2.0, 1.2 and 0.3 kg.
    let (mass, half) = width(&nominal, "mass_u1");
    assert!((mass - 3.5e-6).abs() < 1e-18 && (half - 0.035).abs() < 1e-15);
    assert!(
        assumptions
            .iter()
            .any(|a| a.starts_with("link `cross` has no mass"))
    );
    let again = Nominal::parse("", &nominal.to_toml().expect("a chain")).unwrap();
    assert_eq!(again, nominal);
}

/// A body with two joints, an armature, and drives: through MJCF.
#[test]
fn drives_of_mjcf_are_the_start() {
    let text = r#"<mujoco model="cart"><worldbody><body name="cart">
        <joint name="x" type="slide" axis="1 0 0" damping="3" range="-1 1"/>
        <inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.01"/>
        <body name="pole" pos="0 0 0.1"><joint name="swing" axis="0 1 0" armature="0.02" frictionloss="0.1"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.6"/></body></body></worldbody>
        <actuator><motor joint="x" gear="80" ctrlrange="-1 1"/></actuator></mujoco>"#;
    let read = pid_mjcf::Mjcf::parse("cart.xml", text).expect("a cart");
    let nominal = described(&read.mechanism, Provenance::DataSheet).nominal;
    assert_eq!(width(&nominal, "rotor_swing"), (0.02, 0.08));
    assert_eq!(width(&nominal, "coulomb_swing"), (0.1, 0.4));
    assert_eq!(width(&nominal, "viscous_x"), (3.0, 4.0 * 0.1 * 80.0 / 0.5));
    assert_eq!(nominal.measurement().channels[0].torque_peak, Some(80.0));
    let again = Nominal::parse("", &nominal.to_toml().expect("a chain")).unwrap();
    assert_eq!(again, nominal);
    // The equations of a cart with a pole, at a state: m s a_x = m (h cos q a − h sin q v²).
    let own = Model::new(&read.mechanism.robot()).unwrap();
    let pole = &read.mechanism.bodies[1];
    let found = dynamics(&own, [&[0.2, 0.7], &[1.0, 2.0]]);
    let (m, h) = (pole.mass, pole.com[2]);
    let expected = [
        2.0 + m,
        m * h * 0.7_f64.cos(),
        pole.inertia[1] + m * h * h + 0.02,
        -m * h * 0.7_f64.sin() * 4.0,
        -m * 9.81 * h * 0.7_f64.sin(),
    ];
    for (x, y) in found.iter().zip(expected) {
        assert!((x - y).abs() < 1e-12, "{found:?} {expected:?}");
    }
}

#[test]
fn a_robot_that_cannot_move_is_refused() {
    let error = Nominal::of_mechanism(
        &Mechanism {
            name: "Post".to_owned(),
            gravity: GRAVITY,
            bodies: Vec::new(),
        },
        Provenance::Cad,
    );
    assert!(
        error
            .unwrap_err()
            .to_string()
            .starts_with("no joint of `Post` moves")
    );
}
