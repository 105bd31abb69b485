//! Nominal descriptions of declared robots: the same dynamics as the declaration, tolerances from
//! its ranges, and messages.

use pid_interpret::Model;
use pid_interpret::nominal::{
    DeclaredError, Nominal, NominalError, Role, Tolerance, Velocity, declaration,
};
use pid_runtime::dynamics::{At, Dynamics};
use pid_runtime::robot;

robot! {
    /// Two links of which the outer one carries a weight bolted to it.
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            m1: kg = 1.5 in 1.4..=1.8;
            l1: m = 0.25 in 0.24..=0.26;
            m2: kg = 0.5 fixed;
        }
        link rod { mass: m1; com: [0, 0, -l1]; inertia at com: diag(0.02, 0.021, 0.003) kg*m^2; }
        link tip { mass: m2; com: [0.01, 0, 0] m; inertia at com: diag(0.001, 0.001, 0.001) kg*m^2; }
        link weight { mass: 0.2 kg; com: [0, 0, -0.05] m; inertia at com: diag(0.0001, 0.0001, 0.00015) kg*m^2; }
        joint swing: revolute about y { base -> rod at [0, 0, 1] m; }
        joint turn: revolute about [0, 0, -1] { rod -> tip at [0, 0, -0.1] m rpy [0.3, -0.2, 0.5] rad; limits: -1..=2 rad; }
        joint bolt: fixed { tip -> weight at [0, 0.02, -0.3] m rpy [0.1, 0.2, 0.3] rad; }
        per joint {
            input current: A;
            gain: N*m/A = 1.8 in 1.7..=1.9;
            rotor: kg*m^2 = 0.012 in 0.01..=0.02;
            dry: N*m = 0.25 in 0.1..=0.3;
            viscous: N*m*s/rad = 0.08 in 0.0..=0.2;
            armature = rotor;
            force = gain*current - viscous*v - dry*tanh(40 s/rad * v);
        }
        emit { second_derivatives }
        expect rank 9;
    }
}

/// A carriage whose friction falls with the speed.
mod stribeck {
    use pid_runtime::robot;
    robot! {
        pub robot Carriage {
            gravity: [0, 0, -9.81] m/s^2;
            params { mass: kg = 95.0 in 80.0..=110.0; }
            link body { mass: mass; com: [_, _, _]; inertia at com: diag(_, _, _); }
            joint x: prismatic about x { base -> body; }
            per joint {
                input push: N;
                dry: N = 20.0 in 0.0..=100.0;
                breakaway: N = 5.0 in 0.0..=100.0;
                force = push - (dry + breakaway*exp(-(v/(0.01 m/s))^2)) * tanh(1000 s/m * v);
            }
        }
    }
}

/// A pendulum of unknown length between its joints.
mod long {
    use pid_runtime::robot;
    robot! {
        pub robot Chain {
            gravity: [0, 0, -9.81] m/s^2;
            params {
                length: m = 0.5 in 0.4..=0.6;
                tilt: rad = 0.0 fixed;
            }
            link one { mass: 1 kg; com: [0, 0, -0.2] m; inertia at com: diag(0.01, 0.01, 0.001) kg*m^2; }
            link two { mass: 1 kg; com: [0, 0, -0.2] m; inertia at com: diag(0.01, 0.01, 0.001) kg*m^2; }
            joint a: revolute about y { base -> one at [0, 0, 0] m rpy [tilt, 0, 0]; }
            joint b: revolute about y { one -> two at [0, 0, -length]; }
            per joint { input torque: N*m; force = torque; }
        }
    }
}

fn describe(model: &dyn Dynamics) -> Result<Nominal, NominalError> {
    Nominal::of_declared(model, None)
}

/// A value between −1 and 1 that depends on `k` in no simple way.
fn scatter(k: usize) -> f64 {
    ((k as f64 + 1.0) * 12.9898).sin()
}

/// Largest difference of the residuals of declared and described robot at nominal parameters,
/// relative to the largest residual.
fn difference(model: &dyn Dynamics, nominal: &Nominal) -> f64 {
    let described = Model::new(nominal.robot()).unwrap();
    let dims = model.dims();
    let values = |m: &dyn Dynamics| m.params().iter().map(|p| p.nominal).collect::<Vec<_>>();
    let (p, p_described) = (values(model), values(&described));
    let (mut worst, mut size) = (0.0_f64, 0.0_f64);
    for point in 0..40 {
        let draw = |part: usize, len: usize, scale: f64| -> Vec<f64> {
            (0..len)
                .map(|i| scale * scatter(97 * point + 31 * part + i))
                .collect()
        };
        let (q, v, a) = (
            draw(0, dims.nq, 2.0),
            draw(1, dims.nq, 1.5),
            draw(2, dims.nq, 3.0),
        );
        // Joints without an input have one in the description, which is zero.
        let u = draw(3, dims.nu, 2.0);
        let mut u_described = vec![0.0; dims.nq];
        for (k, (input, u)) in model.inputs().iter().zip(&u).enumerate() {
            u_described[input.joint.unwrap_or(k)] = *u;
        }
        let mut r = vec![0.0; dims.nq];
        let mut r_described = r.clone();
        model.residual(
            &At {
                q: &q,
                v: &v,
                a: &a,
                u: &u,
                p: &p,
            },
            &mut r,
        );
        described.residual(
            &At {
                q: &q,
                v: &v,
                a: &a,
                u: &u_described,
                p: &p_described,
            },
            &mut r_described,
        );
        for (x, y) in r.iter().zip(&r_described) {
            worst = worst.max((x - y).abs());
            size = size.max(x.abs());
        }
    }
    worst / size
}

fn tolerance(nominal: &Nominal, joint: usize, role: Role) -> &Tolerance {
    (nominal.tolerances().iter())
        .find(|t| t.joint == Some(joint) && t.role == role)
        .unwrap()
}

#[test]
fn the_same_dynamics_as_the_declaration() {
    let nominal = describe(&Arm).unwrap();
    assert!(difference(&Arm, &nominal) < 1e-12);
}

#[test]
fn tolerances_are_the_reach_of_the_parameters() {
    let nominal = describe(&Arm).unwrap();
    let of = |joint, role| {
        let t = tolerance(&nominal, joint, role);
        (t.nominal, t.half_width)
    };
    let close = |(x, y): (f64, f64), (a, b): (f64, f64)| {
        assert!(
            (x - a).abs() < 1e-9 && (y - b).abs() < 1e-9,
            "{x} ± {y} is not {a} ± {b}"
        );
    };
    close(of(0, Role::Mass), (1.5, 0.3));
    close(of(0, Role::CenterOfMass(2)), (-0.25, 0.01));
    close(of(0, Role::Inertia(1)), (0.021, 0.0));
    close(of(1, Role::Mass), (0.7, 0.0));
    close(of(0, Role::RotorInertia), (0.012, 0.008));
    close(of(1, Role::Gain), (1.8, 0.1));
    close(of(1, Role::Coulomb), (0.25, 0.15));
    close(of(0, Role::Viscous), (0.08, 0.12));
    let sharp = tolerance(&nominal, 0, Role::Sharpness);
    assert!((sharp.nominal / 40.0 - 1.0).abs() < 1e-9);
    assert_eq!(nominal.robot().joints[1].limits, Some((-1.0, 2.0)));
}

#[test]
fn the_declaration_is_read_back_whole() {
    let robot = declaration(&Arm).unwrap();
    assert_eq!(robot.name, "Arm");
    let names: Vec<&str> = Arm.params().iter().map(|p| &*p.name).collect();
    assert_eq!(
        robot.params.iter().map(|p| &*p.name).collect::<Vec<_>>(),
        names
    );
    // An interpreted model of it computes what the compiled one does.
    let interpreted = Model::new(&robot).unwrap();
    let (q, v, a, u) = ([0.3, -0.8], [0.7, 0.2], [1.0, -2.0], [0.5, 0.1]);
    let p: Vec<f64> = Arm.params().iter().map(|p| p.nominal).collect();
    let at = At {
        q: &q,
        v: &v,
        a: &a,
        u: &u,
        p: &p,
    };
    let (mut x, mut y) = ([0.0; 2], [0.0; 2]);
    Arm.residual(&at, &mut x);
    interpreted.residual(&at, &mut y);
    for (x, y) in x.iter().zip(&y) {
        assert!((x - y).abs() < 1e-13 * x.abs().max(1.0));
    }
}

/// The outcome for every model of this workspace.
#[test]
fn models_have_descriptions_or_say_why_not() {
    let outcome = |name: &str| {
        let model = pid_models::by_name(name).unwrap();
        match describe(model) {
            Ok(nominal) => {
                let off = difference(model, &nominal);
                assert!(off < 1e-9, "{name}: {off:.1e}");
                "described".to_owned()
            }
            Err(NominalError::Declared(e)) => match e {
                DeclaredError::Structure { what, .. } => what,
                DeclaredError::Law { joint, what, .. } => format!("{joint}: {what}"),
                DeclaredError::Geometry { parameter, .. } => format!("{parameter} is free"),
                other => other.to_string(),
            },
            Err(other) => panic!("{name}: {other}"),
        }
    };
    let found: Vec<(&str, String)> = pid_models::all()
        .iter()
        .map(|e| (e.name, outcome(e.name)))
        .collect();
    let expected = [
        ("two_link", "described"),
        ("emps", "x: it is 3.1648 at rest without input"),
        ("double_pendulum", "described"),
        ("scara", "described"),
        ("arm6", "described"),
        ("ur10e", "described"),
        ("panda", "described"),
        ("cart_pole", "described"),
        ("servo_pendulum", "described"),
        ("tx40", "has a drive `wrist` without an input of its own"),
        ("vs050", "described"),
        ("vs050_two_axis", "described"),
    ];
    let found: Vec<(&str, &str)> = found.iter().map(|(n, o)| (*n, o.as_str())).collect();
    assert_eq!(found, expected);
}

#[test]
fn what_a_description_cannot_hold_is_named() {
    let message = |model: &dyn Dynamics| describe(model).unwrap_err().to_string();
    let text = message(&stribeck::Carriage);
    assert!(text.starts_with("the force on joint `x` of `Carriage` is not gain·input less viscous and Coulomb friction: its friction is not Coulomb and viscous: "), "{text}");
    assert_eq!(
        message(&long::Chain),
        "`Chain`: the free parameter `length` changes the place of joint `b`, which a nominal description takes as exact\n  help: mark it `fixed`"
    );
    let interpreted = Model::new(&declaration(&Arm).unwrap()).unwrap();
    assert!(message(&interpreted).starts_with("`Arm` carries no declaration"));
}

#[test]
fn what_is_known_of_the_measurement() {
    let folder = std::env::temp_dir().join(format!("pid-measured-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("measurement.toml");
    let read = |text: &str| {
        std::fs::write(&file, text).unwrap();
        Nominal::of_declared(&Arm, Some(&file))
    };
    let nominal = read(
        "[robot]\ninput_noise = 0.01\nhorizon_s = 2.0\nencoder_side = \"motor\"\n\
         [[joint]]\nname = \"turn\"\nq_noise_std = 1e-4\nvelocity = \"absent\"\ntorque_peak = 9.0\n\
         [[joint]]\nname = \"swing\"\ndq_noise_std = 0.02\ntorque_peak = 4.5\n",
    )
    .unwrap();
    let m = nominal.measurement();
    assert_eq!(m.horizon, Some(2.0));
    let [swing, turn] = m.channels.as_slice() else {
        panic!("{:?}", m.channels);
    };
    assert_eq!((swing.name.as_str(), turn.name.as_str()), ("swing", "turn"));
    assert_eq!(swing.velocity, Velocity::Measured { noise: Some(0.02) });
    assert_eq!(turn.velocity, Velocity::Absent);
    assert_eq!(turn.position_noise, Some(1e-4));
    // A share of the typical torque, as an input: 0.01 · 4.5 N·m / 1.8 N·m/A.
    assert!((swing.input_noise.unwrap() - 0.025).abs() < 1e-12);
    let text = read("[[joint]]\nname = \"elbow\"\n")
        .unwrap_err()
        .to_string();
    std::fs::remove_dir_all(&folder).unwrap();
    let expected = format!(
        "{}:2:8: joint: `name` is \"elbow\"\n  help: the joints of the robot are swing, turn",
        file.display()
    );
    assert_eq!(text, expected);
}
