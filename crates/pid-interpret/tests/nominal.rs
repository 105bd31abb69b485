//! Nominal descriptions: the structure they state, tolerances, noise, and messages.

use pid_interpret::Model;
use pid_interpret::nominal::{
    Channel, EncoderSide, FallingLimit, Gain, Nominal, Ranges, Role, Servo, ServoLaw, Velocity,
};
use pid_runtime::dynamics::{At, Dynamics};

/// A pendulum about y and a slide on its rod.
const TEXT: &str = r#"
[robot]
name = "slider"
gravity = [0.0, 0.0, -9.81]
tool = [0.0, 0.0, -0.1]
encoder_side = "motor"
velocity_filter_hz = 40.0
input_noise = 0.01
horizon_s = 2.0

[tolerance]
mass_rel = 0.05
com_abs_m = 0.003
inertia_rel = 0.1
rotor_inertia_rel = 0.05
motor_gain_rel = 0.0
friction_rel = 0.4

[[joint]]
name = "swing"
type = "revolute"
axis = [0.0, 2.0, 0.0]
origin = [0.0, 0.0, 1.0]
mass = 1.5
com = [0.0, 0.0, -0.25]
inertia = [0.02, 0.021, 0.003, 0.0, 0.0, 0.0]
rotor_inertia = 0.012
coulomb = 0.25
viscous = 0.08
motor_gain = 1.8
input = "current"
velocity = "measured"
q_resolution = 1.2e-4
q_noise_std = 1.0e-4
dq_noise_std = 0.015
torque_peak = 4.5
speed_scale = 1.25

[[joint]]
name = "slide"
type = "prismatic"
axis = [0.0, 0.0, -1.0]
origin = [0.0, 0.0, -0.1]
rpy = [0.0, 0.0, 0.0]
limits = [0.0, 0.4]
mass = 0.5
com = [0.0, 0.0, 0.0]
inertia = [0.001, 0.001, 0.001, 0.0, 0.0, 0.0]
rotor_inertia = 0.3
coulomb = 0.0
viscous = 2.0
sharpness = 200.0
motor_gain = -1.0
input = "force"
velocity = "derived"
torque_peak = 20.0
"#;

fn parse(text: &str) -> Nominal {
    Nominal::parse("nominal.toml", text).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn the_structure_is_the_one_stated() {
    let nominal = parse(TEXT);
    let model = Model::new(nominal.robot()).unwrap();
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let (q, v, a, u) = ([0.4, 0.3], [1.1, -0.7], [2.0, 5.0], [3.0, 6.0]);
    let mut r = [0.0; 2];
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

    // A rod with a bead at distance s = 0.1 + q2 from the pivot, by hand.
    let (m1, c, m2, g) = (1.5, 0.25, 0.5, 9.81);
    let s = 0.1 + q[1];
    let inertia = 0.021 + m1 * c * c + 0.001 + m2 * s * s + 0.012;
    let sharp = 1.0 / (0.02 * 1.25);
    let swing = inertia * a[0]
        + 2.0 * m2 * s * v[1] * v[0]
        + (m1 * c + m2 * s) * g * q[0].sin()
        + 0.08 * v[0]
        + 0.25 * (sharp * v[0]).tanh()
        - 1.8 * u[0];
    let slide = (m2 + 0.3) * a[1] - m2 * s * v[0] * v[0] - m2 * g * q[0].cos() + 2.0 * v[1] + u[1];
    for (found, expected) in r.into_iter().zip([swing, slide]) {
        assert!((found - expected).abs() < 1e-13, "{found} for {expected}");
    }
    assert_eq!(model.joints()[1].limits, Some((0.0, 0.4)));
    let units: Vec<&str> = ["gain_swing", "gain_slide", "rotor_slide", "viscous_swing"]
        .map(|name| &*model.params().iter().find(|p| p.name == name).unwrap().unit)
        .to_vec();
    assert_eq!(units, ["N*m/A", "1", "kg", "N*m*s/rad"]);
}

#[test]
fn tolerances_become_ranges() {
    let nominal = parse(TEXT);
    let find = |name: &str| {
        let k = nominal
            .tolerances()
            .iter()
            .position(|t| t.name == name)
            .unwrap();
        (&nominal.tolerances()[k], &nominal.robot().params[k])
    };
    for (name, role, half_width) in [
        ("mass_swing", Role::Mass, 0.075),
        ("com_z_swing", Role::CenterOfMass(2), 0.003),
        // Of the largest principal moment, 0.021.
        ("izz_swing", Role::Inertia(2), 0.0021),
        ("ixy_swing", Role::Inertia(3), 0.0021),
        ("rotor_swing", Role::RotorInertia, 0.0006),
        ("coulomb_swing", Role::Coulomb, 0.1),
        ("gain_swing", Role::Gain, 0.0),
        ("sharp_swing", Role::Sharpness, 0.0),
    ] {
        let (tolerance, param) = find(name);
        assert_eq!((tolerance.role, tolerance.joint), (role, Some(0)), "{name}");
        assert!((tolerance.half_width - half_width).abs() < 1e-15, "{name}");
        assert_eq!(param.name, name);
        assert_eq!(param.fixed, half_width == 0.0, "{name}");
        assert!(
            (param.upper - param.nominal - half_width).abs() < 1e-15,
            "{name}"
        );
        assert!(
            (param.nominal - param.lower - half_width).abs() < 1e-15,
            "{name}"
        );
    }
    // Friction of nominal value 0 with a relative tolerance is exactly 0.
    assert!(find("coulomb_slide").1.fixed);
    let physical = nominal.robot_with(Ranges::Physical);
    let k = nominal
        .tolerances()
        .iter()
        .position(|t| t.name == "izz_swing")
        .unwrap();
    assert_eq!(
        (physical.params[k].lower, physical.params[k].upper),
        (f64::NEG_INFINITY, f64::INFINITY)
    );
}

#[test]
fn measurement_is_read() {
    let nominal = parse(TEXT);
    let m = nominal.measurement();
    assert_eq!(
        (m.horizon, m.encoder_side, m.tool),
        (Some(2.0), EncoderSide::Motor, Some([0.0, 0.0, -0.1]))
    );
    let [swing, slide] = m.channels.as_slice() else {
        panic!("two joints")
    };
    assert_eq!(swing.velocity, Velocity::Measured { noise: Some(0.015) });
    assert_eq!(
        slide.velocity,
        Velocity::Derived {
            filter_hz: Some(40.0)
        }
    );
    let noise = |channel: &Channel| channel.input_noise.expect("stated");
    assert!((noise(swing) - 0.01 * 4.5 / 1.8).abs() < 1e-15);
    assert!((noise(slide) - 0.2).abs() < 1e-15);
    // 1.2e-4 / √12 = 3.464e-5.
    let std = swing.position_std().expect("stated");
    assert!((std - 1.058_300_524_425_836e-4).abs() < 1e-15);
}

/// One mistake at a time: the message names file, line, key and value.
#[test]
fn mistakes_are_named() {
    for (right, wrong, message) in [
        (
            "mass = 1.5",
            "mass = -1.5",
            "nominal.toml:24:8: joint swing: `mass` is -1.5\n  help: a mass is positive",
        ),
        (
            "mass = 1.5",
            "mass = nan",
            "nominal.toml:24:8: joint swing: `mass` is NaN",
        ),
        (
            "axis = [0.0, 2.0, 0.0]",
            "axis = [0.0, 0.0, 0.0]",
            "nominal.toml:22:8: joint swing: `axis` is [0.0, 0.0, 0.0]",
        ),
        (
            "0.02, 0.021, 0.003,",
            "0.02, 0.021, 0.3,",
            "the largest must not exceed the sum of the others",
        ),
        (
            "\"revolute\"",
            "\"hinge\"",
            "nominal.toml:21:8: joint swing: `type` is \"hinge\"\n  help: write one of \"revolute\", \"prismatic\"",
        ),
        (
            "\"current\"",
            "\"force\"",
            "`input` is \"force\"\n  help: write one of \"torque\", \"current\", \"voltage\"",
        ),
        (
            "name = \"slide\"",
            "name = \"swing\"",
            "nominal.toml:40:8: joint 2: `name` is \"swing\"\n  help: another joint has this name",
        ),
        (
            "name = \"slide\"",
            "name = \"slide 1\"",
            "starts with a letter",
        ),
        (
            "limits = [0.0, 0.4]",
            "limits = [0.4, 0.0]",
            "`limits` is [0.4, 0]",
        ),
        (
            "limits = [0.0, 0.4]",
            "parent = \"elbow\"",
            "`parent` is \"elbow\"\n  help: name a joint listed before",
        ),
        (
            "motor_gain = 1.8",
            "motor_gain = 0.0",
            "a drive with gain 0 does nothing",
        ),
        (
            "friction_rel = 0.4",
            "friction_rel = -0.4",
            "tolerance: `friction_rel` is -0.4",
        ),
        ("torque_peak = 20.0", "", "which joint slide does not state"),
        (
            "mass_rel = 0.05",
            "mass_rell = 0.05",
            "help: did you mean `mass_rel`?",
        ),
        ("coulomb = 0.25", "", "missing field `coulomb`"),
        (
            "coulomb = 0.25",
            "",
            "help: add `coulomb = …` to this table",
        ),
        (
            "com = [0.0, 0.0, -0.25]",
            "com = [0.0, -0.25]",
            "nominal.toml:25:7: invalid length 2",
        ),
    ] {
        assert!(TEXT.contains(right), "{right}");
        let error = Nominal::parse("nominal.toml", &TEXT.replacen(right, wrong, 1)).unwrap_err();
        assert!(error.to_string().contains(message), "{wrong}: {error}");
    }
    let joints = TEXT.find("[[joint]]").unwrap();
    let none = format!("joint = []\n{}", &TEXT[..joints]);
    let error = Nominal::parse("nominal.toml", &none)
        .unwrap_err()
        .to_string();
    assert!(
        error.starts_with("nominal.toml: no joint listed"),
        "{error}"
    );
    let error = Nominal::read("nowhere/nominal.toml")
        .unwrap_err()
        .to_string();
    assert!(
        error.starts_with("nowhere/nominal.toml: cannot be read")
            && error.contains("help: give the path of a nominal.toml"),
        "{error}"
    );
}

#[test]
fn a_branch_hangs_on_the_joint_it_names() {
    let nominal = parse(&TEXT.replacen("limits = [0.0, 0.4]", "parent = \"base\"", 1));
    assert_eq!(nominal.robot().joints[1].parent, None);
    assert_eq!(parse(TEXT).robot().joints[1].parent, Some(0));
}

/// Descriptions beside the workspace, where they are.
#[test]
fn shared_descriptions_become_models() {
    let Some(folder) = pid_records::shared("blind") else {
        return;
    };
    let mut read = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path().join("nominal.toml");
        if !path.exists() {
            continue;
        }
        let nominal = Nominal::read(&path).unwrap_or_else(|e| panic!("{e}"));
        let joints = nominal.measurement().channels.len();
        assert_eq!(nominal.robot().params.len(), 15 * joints);
        assert_eq!(nominal.tolerances().len(), 15 * joints);
        if joints < 6 {
            let model =
                Model::new(nominal.robot()).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            assert_eq!(model.dims().nq, joints);
        }
        read += 1;
    }
    assert!(read > 0, "no description in {}", folder.display());
}

/// The text with a loop for all joints.
fn with_drive(lines: &str) -> Result<Nominal, String> {
    let text = TEXT.replacen("[tolerance]", &format!("[drive]\n{lines}\n[tolerance]"), 1);
    Nominal::parse("nominal.toml", &text).map_err(|e| e.to_string())
}

/// The loop of the first joint, wherever it stands.
fn loops(n: &Nominal) -> Option<Servo> {
    let mut servo = n.servo(0)?.clone();
    servo.place = None;
    Some(servo)
}

#[test]
fn stages_of_position_loops_are_read_and_written() {
    let lines = "law = \"cascade\"\nkp = 12.0\nkv = { value = 1.1, tolerance_rel = 0.2 }\nki = { unknown = true }\n\
                 gravity = { value = 0.9, tolerance = 0.9 }\nvelocity_limit = 3.0\nvelocity_filter_s = 0.01\nfeedback_delay_s = 0.004\ndead_band = 0.02\n\
                 target_step = 0.001\ntarget_rate_hz = 50.0\ntarget_speed = { value = 2.0, tolerance_rel = 0.25 }\nvelocity_feed_forward = 0.8\ninertia_feed_forward = { value = 0.5, tolerance = 0.5 }\n\
                 target_acceleration = 9.0\ntarget_average_s = 0.05\ntarget_filter_s = { unknown = true }\nlimit = 6.0\nstall = 8.0\nno_load_speed = 20.0\n";
    let own = TEXT.replacen(
        "[[joint]]\nname = \"slide\"",
        &format!("[joint.drive]\n{lines}[[joint]]\nname = \"slide\""),
        1,
    );
    let nominal = parse(&own);
    let servo = nominal.servo(0).unwrap();
    assert_eq!(servo.law, ServoLaw::Cascade);
    let of = |gain| (servo.gain(gain).value, servo.gain(gain).half_width);
    assert_eq!(of(Gain::Kp), (Some(12.0), 0.0));
    assert_eq!(of(Gain::Kv).0, Some(1.1));
    assert!((of(Gain::Kv).1 - 0.22).abs() < 1e-15);
    assert_eq!(of(Gain::Gravity), (Some(0.9), 0.9));
    assert_eq!(of(Gain::VelocityTime), (Some(0.01), 0.0));
    assert!(servo.has(Gain::TargetTime) && of(Gain::TargetTime).0.is_none());
    assert!(!servo.has(Gain::Kd));
    assert_eq!(
        (servo.velocity_limit, servo.dead_band),
        (Some(3.0), Some(0.02))
    );
    let falling = FallingLimit {
        stall: 8.0,
        no_load_speed: 20.0,
    };
    assert_eq!((servo.limit, servo.falling), (Some(6.0), Some(falling)));
    let shaping = &servo.shaping;
    assert_eq!((shaping.step, shaping.rate_hz), (Some(0.001), Some(50.0)));
    assert_eq!(of(Gain::TargetSpeed), (Some(2.0), 0.5));
    assert_eq!(of(Gain::VelocityAhead), (Some(0.8), 0.0));
    assert_eq!(of(Gain::FeedbackDelay), (Some(0.004), 0.0));
    assert_eq!(of(Gain::InertiaAhead), (Some(0.5), 0.5));
    assert_eq!(of(Gain::TargetAcceleration), (Some(9.0), 0.0));
    assert_eq!(of(Gain::TargetAverage), (Some(0.05), 0.0));
    let units = Gain::ALL.map(|gain| servo.unit(gain, "A", "rad"));
    assert_eq!(
        units,
        [
            "1/s", "A*s/rad", "A/rad", "A*s/rad", "A*s/rad", "1", "1", "1", "rad/s", "rad/s^2",
            "s", "s", "s", "s"
        ]
    );
    let again = parse(&nominal.to_toml().unwrap());
    assert_eq!(loops(&again), loops(&nominal));
    assert!(again.drive_model(0).is_none());
    // Other values of the robot are none of its drives.
    let mut values: Vec<f64> = nominal.tolerances().iter().map(|t| t.nominal).collect();
    let mass = |n: &Nominal| n.tolerances()[0].nominal;
    assert_eq!(nominal.tolerances()[0].role, Role::Mass);
    values[0] *= 2.0;
    let heavier = nominal.extended(&values, Vec::new(), None);
    let again = parse(&heavier.to_toml().unwrap());
    assert_eq!(mass(&again), 2.0 * mass(&nominal));
    let known = again.drive_model(0).unwrap();
    assert_eq!(known.mass, mass(&nominal));
    let of = |role: Role| {
        nominal
            .tolerances()
            .iter()
            .find(|t| t.joint == Some(0) && t.role == role)
    };
    assert_eq!(
        Some(known.rotor_inertia),
        of(Role::RotorInertia).map(|t| t.nominal)
    );
    assert_eq!(
        Some(known.inertia[2]),
        of(Role::Inertia(2)).map(|t| t.nominal)
    );
    assert_eq!(Some(known), heavier.drive_model(0));
}

#[test]
fn position_loops_are_read_and_written() {
    let swing = "[joint.drive]\nlaw = \"pid\"\nkp = { value = 40.0, tolerance_rel = 0.3 }\nkd = { unknown = true }\n\
                 ki = { value = 2, tolerance = 0.5 }\nlimit = 6.0\nintegral_limit = 1.5\nrate_hz = 500.0\n";
    let own = TEXT.replacen(
        "[[joint]]\nname = \"slide\"",
        &format!("{swing}[[joint]]\nname = \"slide\""),
        1,
    );
    let nominal = parse(&own);
    assert!(nominal.has_servos() && nominal.servo(1).is_none());
    let servo = nominal.servo(0).unwrap();
    assert_eq!(servo.law, ServoLaw::Pid);
    let of = |gain| (servo.gain(gain).value, servo.gain(gain).half_width);
    assert_eq!(of(Gain::Kp), (Some(40.0), 12.0));
    assert_eq!(of(Gain::Kd), (None, 0.0));
    assert_eq!(of(Gain::Ki), (Some(2.0), 0.5));
    assert_eq!(
        (servo.limit, servo.integral_limit, servo.rate_hz),
        (Some(6.0), Some(1.5), Some(500.0))
    );
    let again = parse(&nominal.to_toml().unwrap());
    assert_eq!(loops(&again), loops(&nominal));
    assert!(again.servo(1).is_none());
    // Robots without one are as they were.
    assert!(!parse(TEXT).has_servos() && !parse(TEXT).to_toml().unwrap().contains("drive"));
}

#[test]
fn mistakes_of_position_loops_are_named() {
    for (lines, message) in [
        (
            "law = \"pd\"\nkp = -3.0\nkd = 0.1",
            "drive, at joint swing: `kp` is -3\n  help: a loop holds its joint only with a gain that is positive, as `motor_gain` is",
        ),
        (
            "law = \"p\"\nkp = 3.0",
            "drive, at joint slide: `kp` is 3\n  help: a loop holds its joint only with a gain that is negative",
        ),
        ("law = \"p\"\nkp = 0.0", "`kp` is 0"),
        ("law = \"p\"\nkp = nan", "`kp` is NaN"),
        (
            "law = \"pd\"\nkp = 3.0",
            "nominal.toml:12:7: drive, at joint swing: `kd` is absent",
        ),
        (
            "law = \"p\"\nkp = 3.0\nkd = 1.0",
            "`kd` is stated\n  help: the law \"p\" has no such gain",
        ),
        (
            "law = \"pd\"\nkp = { value = 3.0, tolerance = 3.0 }\nkd = 1.0",
            "`kp` is 3 ± 3",
        ),
        (
            "law = \"pd\"\nkp = { value = 3.0, unknown = true }\nkd = 1.0",
            "a value, with `tolerance`",
        ),
        (
            "law = \"pd\"\nkp = { value = 3.0, tol = 1.0 }\nkd = 1.0",
            "unknown field `tol`",
        ),
        (
            "law = \"pd\"\nkp = \"high\"\nkd = 1.0",
            "a number, or a table",
        ),
        (
            "law = \"servo\"\nkp = 3.0",
            "write one of \"p\", \"pd\", \"pid\", \"cascade\", \"none\"",
        ),
        ("law = \"p\"\nkp = 3.0\nlimit = 0.0", "`limit` is 0"),
        (
            "law = \"p\"\nkp = 3.0\nno_load_speed = 9.0",
            "`no_load_speed` is stated alone\n  help: say what there is at rest",
        ),
        (
            "law = \"p\"\nkp = 3.0\nlimit = 2.0\nstall = 9.0",
            "`stall` is stated alone\n  help: say at which speed",
        ),
        (
            "law = \"p\"\nkp = 3.0\nintegral_limit = 1.0",
            "`integral_limit` is stated",
        ),
        ("law = \"p\"\nkp = 3.0\nrate_hz = -5.0", "`rate_hz` is -5"),
        (
            "law = \"cascade\"\nkp = -3.0\nkv = 1.0\nki = 0.0",
            "`kp` is -3\n  help: the velocity that a cascade asks for per error is positive",
        ),
        (
            "law = \"cascade\"\nkp = 3.0\nkv = -1.0\nki = 0.0",
            "`kv` is -1\n  help: a loop holds its joint only with a gain that is positive, as `motor_gain` is",
        ),
        ("law = \"cascade\"\nkp = 3.0\nki = 0.0", "`kv` is absent"),
        ("law = \"p\"\nkp = 3.0\nkv = 1.0", "`kv` is stated"),
        (
            "law = \"p\"\nkp = 3.0\nvelocity_limit = 1.0",
            "`velocity_limit` is stated\n  help: only the law \"cascade\"",
        ),
        (
            "law = \"p\"\nkp = 3.0\nvelocity_filter_s = 0.1",
            "`velocity_filter_s` is stated\n  help: the law \"p\" does not use the velocity",
        ),
        (
            "law = \"pd\"\nkp = 3.0\nkd = 1.0\nvelocity_filter_s = -0.1",
            "`velocity_filter_s` is -0.1\n  help: give a time above zero",
        ),
        (
            "law = \"p\"\nkp = 3.0\ntarget_filter_s = { value = 0.1, tolerance = 0.1 }",
            "`target_filter_s` is 0.1 ± 0.1",
        ),
        (
            "law = \"p\"\nkp = 3.0\ntarget_filter_s = 0.0",
            "`target_filter_s` is 0",
        ),
        (
            "law = \"p\"\nkp = 3.0\ngravity = -1.0",
            "`gravity` is -1\n  help: give the share of gravity",
        ),
        (
            "law = \"p\"\nkp = 3.0\ntarget_speed = 0.0",
            "`target_speed` is 0",
        ),
        (
            "law = \"p\"\nkp = 3.0\ntarget_step = -0.1",
            "`target_step` is -0.1",
        ),
        (
            "law = \"p\"\nkp = 3.0\ntarget_rate_hz = 0.0",
            "`target_rate_hz` is 0",
        ),
        (
            "law = \"p\"\nkp = 3.0\ndead_band = nan",
            "`dead_band` is NaN",
        ),
    ] {
        let error = with_drive(lines).expect_err(lines);
        assert!(error.contains(message), "{lines}: {error}");
    }
}
