//! Dynamics of what is read against equations written by hand and against the same tree without
//! `<mimic>`; round trips; messages.

mod common;

use common::{ROBOTS, Residual, close, text, uniform};
use pid_derive::model::{Expr, Inertial};
use pid_symbolic::random::Random;
use pid_urdf::{Description, Inertias, Lost, Options, robot, write};

fn read(file: &str) -> Description {
    Description::parse(file, text(file)).unwrap_or_else(|e| panic!("{e}"))
}

fn numbers() -> Options {
    let mut options = Options::default();
    options.inertias = Inertias::Numbers;
    options.friction = false;
    options
}

#[test]
fn a_planar_arm_is_the_double_pendulum() {
    let residual = Residual::new(&robot(&read("planar_arm.urdf"), &numbers()).unwrap());
    let mut random = Random::new(3);
    for _ in 0..20 {
        let (q, v) = (uniform(&mut random, 2, 3.0), uniform(&mut random, 2, 4.0));
        let (a, u) = (uniform(&mut random, 2, 9.0), uniform(&mut random, 2, 5.0));
        let (m1, c1, i1, l) = (2.0, 0.2, 0.03, 0.4);
        let (m2, c2, i2, g) = (1.2, 0.15, 0.012, 9.81);
        let (h, s12) = (m2 * l * c2, (q[0] + q[1]).sin());
        let m12 = i2 + m2 * c2 * c2 + h * q[1].cos();
        let m11 = i1 + m1 * c1 * c1 + m2 * l * l + m12 + h * q[1].cos();
        let coriolis = h * q[1].sin();
        let expected = [
            m11 * a[0] + m12 * a[1] - coriolis * (2.0 * v[0] * v[1] + v[1] * v[1])
                + g * ((m1 * c1 + m2 * l) * q[0].sin() + m2 * c2 * s12)
                + 0.2 * v[0]
                + 0.3 * (50.0 * v[0]).tanh()
                - u[0],
            m12 * a[0] + (i2 + m2 * c2 * c2) * a[1] + coriolis * v[0] * v[0] + g * m2 * c2 * s12
                - u[1],
        ];
        close("r", &residual.at([&q, &v, &a, &u, &[]]), &expected, 1e-13);
    }
}

/// A body on a turned inertial frame equals the body with the tensor turned by hand: 90° about z
/// swaps x and y.
#[test]
fn inertial_rpy_is_honoured() {
    let plain = text("planar_arm.urdf").replace(
        "ixx=\"0.03\" ixy=\"0\" ixz=\"0\" iyy=\"0.03\" iyz=\"0\"",
        "ixx=\"0.03\" ixy=\"0.004\" ixz=\"0.001\" iyy=\"0.02\" iyz=\"0.002\"",
    );
    let plain = plain.replace("izz=\"0.002\"", "izz=\"0.03\"");
    let turned = text("planar_arm.urdf")
        .replace(
            "<origin xyz=\"0 0 -0.2\"/>",
            "<origin xyz=\"0 0 -0.2\" rpy=\"0 0 1.5707963267948966\"/>",
        )
        .replace(
            "ixx=\"0.03\" ixy=\"0\" ixz=\"0\" iyy=\"0.03\" iyz=\"0\"",
            "ixx=\"0.02\" ixy=\"-0.004\" ixz=\"0.002\" iyy=\"0.03\" iyz=\"-0.001\"",
        )
        .replace("izz=\"0.002\"", "izz=\"0.03\"");
    assert!(plain != text("planar_arm.urdf") && turned.contains("1.57"));
    let [plain, turned] = [plain, turned].map(|text| {
        let robot = robot(&Description::parse("arm.urdf", &text).unwrap(), &numbers()).unwrap();
        let Inertial::Body { inertia, .. } = &robot.links[0].inertial else {
            panic!("a body")
        };
        [
            &inertia.xx,
            &inertia.yy,
            &inertia.zz,
            &inertia.xy,
            &inertia.xz,
            &inertia.yz,
        ]
        .map(|e| match e {
            Expr::Num(x) => *x,
            other => panic!("{other:?}"),
        })
    });
    close("tensor", &turned, &plain, 1e-15);
}

/// r of the coupled gripper is Aᵀ r of the gripper whose joints are free, at q = A q' + b.
#[test]
fn mimic_joints_follow() {
    let coupled = robot(&read("gripper.urdf"), &numbers()).unwrap();
    let free_text: String = text("gripper.urdf")
        .lines()
        .filter(|line| !line.contains("<mimic"))
        .collect();
    let free = robot(
        &Description::parse("free.urdf", &free_text).unwrap(),
        &numbers(),
    )
    .unwrap();
    let names = |robot: &pid_derive::model::Robot| -> Vec<String> {
        robot
            .joints
            .iter()
            .filter(|j| j.coord.is_some())
            .map(|j| j.name.clone())
            .collect()
    };
    assert_eq!(names(&coupled), ["wrist", "left"]);
    assert_eq!(names(&free), ["wrist", "right", "knuckle", "left"]);
    assert_eq!(coupled.inputs.len(), 2);
    // (wrist, right, knuckle, left) from (wrist, left): right = left + 0.005, knuckle = −20 right.
    let map = |x: &[f64], b: f64| vec![x[0], x[1] + b, -20.0 * (x[1] + b), x[1]];
    let [coupled, free] = [coupled, free].map(|robot| Residual::new(&robot));
    let mut random = Random::new(5);
    for _ in 0..20 {
        let [q, v, a] = [3.0, 4.0, 9.0].map(|size| uniform(&mut random, 2, size));
        let u = uniform(&mut random, 2, 5.0);
        let r = free.at([
            &map(&q, 0.005),
            &map(&v, 0.0),
            &map(&a, 0.0),
            &[u[0], 0.0, 0.0, u[1]],
            &[],
        ]);
        let expected = [r[0], r[1] - 20.0 * r[2] + r[3]];
        close("r", &coupled.at([&q, &v, &a, &u, &[]]), &expected, 1e-12);
    }
}

/// Values are written, read again as numbers, and give the same residual.
#[test]
fn written_values_are_read_again_to_the_same_dynamics() {
    for (file, text) in ROBOTS {
        let description = read(file);
        let options = Options::default();
        let with_parameters = robot(&description, &options).unwrap();
        let mut random = Random::new(11);
        // Each body heavier by a share and by a point mass: still a body.
        let mut p: Vec<f64> = with_parameters.params.iter().map(|p| p.nominal).collect();
        for (k, param) in with_parameters.params.iter().enumerate() {
            if param.name.ends_with("_m") {
                let (share, m) = (random.uniform(0.9, 1.3), random.uniform(0.0, 0.2));
                let [x, y, z] = [0, 1, 2].map(|_| random.uniform(-0.1, 0.1));
                let point = [
                    1.0,
                    x,
                    y,
                    z,
                    y * y + z * z,
                    x * x + z * z,
                    x * x + y * y,
                    -x * y,
                    -x * z,
                    -y * z,
                ];
                for (p, point) in p[k..].iter_mut().zip(point) {
                    *p = share * *p + m * point;
                }
            } else if param.name.starts_with("dry") || param.name.starts_with("viscous") {
                p[k] += random.uniform(0.0, 0.5);
            }
        }
        let value = |name: &str| {
            with_parameters
                .params
                .iter()
                .position(|p| p.name == name)
                .map(|k| p[k])
        };
        let written = write(&description, &options, value);
        assert_eq!(written.lost, [], "{file}");
        // Comments, meshes and names stay.
        for line in text.lines().filter(|l| {
            l.contains("<!--")
                || l.contains("<mesh")
                || (l.contains("<parent") && !l.contains("<dynamics"))
        }) {
            assert!(written.text.contains(line), "{file}: {line}");
        }
        let again = Description::parse(file, &written.text)
            .unwrap_or_else(|e| panic!("{e}\n{}", written.text));
        let fixed = robot(&again, &numbers()).unwrap();
        assert!(fixed.params.is_empty());
        let (nq, nu) = (fixed.nq(), fixed.inputs.len());
        let [fixed, with_parameters] =
            [fixed, with_parameters.clone()].map(|robot| Residual::new(&robot));
        for _ in 0..20 {
            let [q, v, a] = [3.0, 4.0, 9.0].map(|size| uniform(&mut random, nq, size));
            let u = uniform(&mut random, nu, 5.0);
            close(
                file,
                &fixed.at([&q, &v, &a, &u, &[]]),
                &with_parameters.at([&q, &v, &a, &u, &p]),
                1e-12,
            );
        }
    }
}

#[test]
fn what_cannot_be_written_is_named() {
    let description = read("planar_arm.urdf");
    let mut options = Options::default();
    options.armature = true;
    let model = robot(&description, &options).unwrap();
    let value = |name: &str| match name {
        "rotor_elbow" => Some(0.02),
        "upper_ixx" => Some(-1.0),
        "dry_elbow" => Some(-0.5),
        "lower_m" => None,
        _ => model
            .params
            .iter()
            .find(|p| p.name == name)
            .map(|p| p.nominal),
    };
    let written = write(&description, &options, value);
    let lost: Vec<String> = written.lost.iter().map(Lost::to_string).collect();
    assert_eq!(lost.len(), 4, "{lost:?}");
    for (part, lost) in [
        "link `upper` keeps",
        "`lower_m`",
        "`dry_elbow` is -0.5",
        "`rotor_elbow` is 0.02",
    ]
    .iter()
    .zip(&lost)
    {
        assert!(lost.contains(part), "{lost}");
    }
    let again = Description::parse("again", &written.text).unwrap();
    assert_eq!(again.links[1].inertial, description.links[1].inertial);
}

#[test]
fn bodies_without_mass_lend_their_parameters_to_what_is_fixed_to_them() {
    let model = robot(&read("scara.urdf"), &Options::default()).unwrap();
    let masses: Vec<&str> = model
        .params
        .iter()
        .map(|p| &*p.name)
        .filter(|n| n.ends_with("_m"))
        .collect();
    assert_eq!(
        masses,
        ["upper_arm_m", "fore_arm_m", "quill_body_m", "tool_m"]
    );
    assert_eq!(model.inputs[2].name, "force_slide");
    assert_eq!(
        model
            .joints
            .iter()
            .find(|j| j.name == "slide")
            .unwrap()
            .limits,
        Some((0.0, 0.21))
    );
}

/// One mistake at a time, with the place, the value and the mend.
#[test]
fn mistakes_are_named() {
    let base = text("planar_arm.urdf");
    for (right, wrong, message) in [
        (
            "mass value=\"2.0\"",
            "mass value=\"-2.0\"",
            "arm.urdf:4: link `upper`: the mass is -2 kg; it must be positive",
        ),
        (
            "mass value=\"2.0\"",
            "mass value=\"2,0\"",
            "arm.urdf:4: link `upper`: mass value is \"2,0\"\n  help: write one finite number",
        ),
        (
            "mass value=\"2.0\"",
            "mass value=\"${m}\"",
            "this is a xacro file",
        ),
        (
            "xyz=\"0 1 0\"",
            "xyz=\"0 0 0\"",
            "joint `shoulder`: axis xyz is \"0 0 0\"\n  help: an axis has a direction",
        ),
        (
            "xyz=\"0 0 -0.2\"",
            "xyz=\"0 -0.2\"",
            "inertial origin xyz is \"0 -0.2\"\n  help: write 3 finite numbers",
        ),
        (
            "type=\"continuous\"",
            "type=\"spherical\"",
            "arm.urdf:9: joint `shoulder`: type is \"spherical\"\n  help: a ball joint has three coordinates",
        ),
        (
            "type=\"continuous\"",
            "type=\"hinge\"",
            "help: use \"revolute\", \"continuous\"",
        ),
        (
            "child link=\"upper\"",
            "child link=\"uper\"",
            "there is no link `uper`\n  help: did you mean `upper`?",
        ),
        (
            "child link=\"lower\"",
            "child link=\"upper\"",
            "link `upper` is the child of joint `elbow` and of joint `shoulder`",
        ),
        (
            "parent link=\"world\"",
            "parent link=\"lower\"",
            "links `world` and `upper`|is in a loop that hangs on nothing",
        ),
        (
            "<child link=\"upper\"/>",
            "",
            "arm.urdf:9: joint `shoulder` has no <child>",
        ),
        (
            "<limit",
            "<mimic joint=\"elbow\"/><limit",
            "joint `elbow` mimics itself",
        ),
        (
            "xyz=\"0 0 -0.2\"",
            "xyz=\"$(arg x) 0 -0.2\"",
            "this is a xacro file",
        ),
        ("robot", "model", "arm.urdf:1: the root element is <model>"),
        ("</robot>", "", "arm.urdf: "),
    ] {
        assert!(base.contains(right), "{right}");
        let changed = match right {
            "robot" => base
                .replace("<robot", "<model")
                .replace("</robot", "</model"),
            _ => base.replacen(right, wrong, 1),
        };
        let result = Description::parse("arm.urdf", &changed);
        let error = result.expect_err(wrong).to_string();
        assert!(
            message.split('|').any(|m| error.contains(m)),
            "{wrong}: {error}"
        );
    }
    let twice = base.replace("</robot>", "<link name=\"upper\"/></robot>");
    let error = Description::parse("arm.urdf", &twice)
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        "arm.urdf:16: another link has the name `upper`\n  help: rename one of them"
    );
}

/// Names that differ only in characters that an identifier cannot hold stay apart.
#[test]
fn identifiers_differ() {
    let text = text("planar_arm.urdf")
        .replace("\"upper\"", "\"up per\"")
        .replace("\"lower\"", "\"up-per\"");
    let description = Description::parse("arm.urdf", &text).unwrap();
    let identifiers: Vec<&str> = description.links.iter().map(|l| &*l.identifier).collect();
    assert_eq!(identifiers, ["world", "up_per", "up_per_2"]);
}
