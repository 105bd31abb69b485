//! Equations with effects: derivatives against differences and against the library's own equation.

use num_dual::Dual64;
use pid_data::{Dataset, Experiment, InputHold, InputQuantity, JointChannels, Role, VelocityKind};
use pid_interpret::Model;
use pid_interpret::nominal::{EncoderSide, Servo, ServoGain, ServoLaw};

use super::*;
use crate::effect::{Friction, Site};
use crate::effects::{all, by_id};

const ARM: &str = include_str!("arm.toml");

fn arm() -> description::Nominal {
    description::Nominal::parse("arm.toml", ARM).expect("a robot")
}

fn model() -> Box<dyn Hessian> {
    Box::new(Model::new(arm().robot()).expect("equations"))
}

/// An effect at a joint, its parameters at `0.3 + 0.1 i`.
fn placed(id: &str, joint: usize) -> Placed {
    let effect = by_id(id).expect("an effect");
    let n = effect.info().parameters.len();
    Placed {
        term: Term { effect, joint },
        ranges: (0..n).map(|i| (0.3 + 0.1 * i as f64, -2.0, 2.0)).collect(),
        units: vec!["1".to_owned(); n],
    }
}

fn smooth() -> Vec<&'static str> {
    let library = all();
    let own = library.iter().filter(|e| takes(&***e).is_ok());
    own.map(|e| e.info().id).collect()
}

#[test]
fn the_library_says_what_has_equations() {
    let without = [
        ("presliding_hysteresis", Obstacle::Memory),
        ("friction_drift", Obstacle::Time),
        ("joint_elasticity", Obstacle::Gear),
        ("backlash", Obstacle::Gear),
        ("actuator_lag", Obstacle::Memory),
        ("input_delay", Obstacle::Delay),
        ("command_filter", Obstacle::Loop),
        ("command_average", Obstacle::Loop),
        ("command_speed_limit", Obstacle::Loop),
        ("command_acceleration_limit", Obstacle::Loop),
        ("inertia_feed_forward", Obstacle::Loop),
        ("gravity_feed_forward", Obstacle::Loop),
        ("velocity_feed_forward", Obstacle::Loop),
        ("feedback_delay", Obstacle::Loop),
        ("payload", Obstacle::Structure),
        ("base_tilt", Obstacle::Structure),
        ("external_force", Obstacle::Tool),
        ("encoder_offset", Obstacle::Reading),
        ("encoder_eccentricity", Obstacle::Reading),
        ("velocity_filter_lag", Obstacle::Reading),
        ("sensor_delay", Obstacle::Reading),
    ];
    for (id, obstacle) in without {
        let effect = by_id(id).expect("an effect");
        assert_eq!(takes(&*effect), Err(obstacle), "{id}");
    }
    assert_eq!(smooth().len() + without.len(), all().len());
}

#[test]
fn roles_are_recognised() {
    let model = model();
    let found = roles(model.as_ref());
    for (roles, joint) in found.iter().zip(["shoulder", "elbow"]) {
        let name = |k: Option<usize>| k.map(|k| model.params()[k].name.clone());
        assert_eq!(name(roles.gain), Some(format!("gain_{joint}").into()));
        assert_eq!(name(roles.coulomb), Some(format!("coulomb_{joint}").into()));
        assert_eq!(name(roles.viscous), Some(format!("viscous_{joint}").into()));
        let rest = roles.rest.expect("a transition");
        assert!((rest - 0.02).abs() < 1e-6, "{rest}");
    }
}

/// Parts of a stacked point.
fn at<'a>(z: &'a [f64], d: &Dims) -> At<'a> {
    At {
        q: &z[..d.v()],
        v: &z[d.v()..d.a()],
        a: &z[d.a()..d.u()],
        u: &z[d.u()..d.p()],
        p: &z[d.p()..],
    }
}

fn point(model: &dyn Hessian, speed: f64) -> Vec<f64> {
    let d = model.dims();
    let mut z: Vec<f64> = (0..d.nz()).map(|k| (0.4 + 0.9 * k as f64).sin()).collect();
    z[d.v()..d.a()].iter_mut().for_each(|v| *v *= speed);
    for (k, info) in model.params().iter().enumerate() {
        z[d.p() + k] = info.nominal;
    }
    z
}

/// Residual and full Jacobian, row by row.
fn dense(model: &dyn Hessian, z: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (d, pattern) = (model.dims(), model.jacobian_pattern());
    let (mut r, mut values) = (vec![0.0; d.nq], vec![f64::NAN; pattern.nnz()]);
    model.residual_jacobian(&at(z, &d), &mut r, &mut values);
    let mut full = vec![0.0; d.nq * d.nz()];
    for ((row, col), v) in pattern.rows.iter().zip(pattern.cols).zip(values) {
        full[*row as usize * d.nz() + *col as usize] += v;
    }
    (r, full)
}

/// Asserts that first and second derivatives by the variables `free` are those of central
/// differences, and that the residual beside the Jacobian is the residual.
fn assert_derivatives(name: &str, model: &dyn Hessian, z: &[f64], free: &[usize]) {
    let d = model.dims();
    let (r, jacobian) = dense(model, z);
    let mut plain = vec![0.0; d.nq];
    model.residual(&at(z, &d), &mut plain);
    assert_eq!(r, plain, "{name}");
    let lambda = &[0.7, -0.4, 0.9][..d.nq];
    let pattern = model.hessian_pattern();
    let mut values = vec![f64::NAN; pattern.nnz()];
    model.residual_hessian(&at(z, &d), lambda, &mut values);
    let mut hessian = vec![0.0; d.nz() * d.nz()];
    for ((row, col), v) in pattern.rows.iter().zip(pattern.cols).zip(values) {
        let (a, b) = (*row as usize, *col as usize);
        assert!(a >= b, "{name}");
        hessian[a * d.nz() + b] += v;
        if a != b {
            hessian[b * d.nz() + a] += v;
        }
    }
    for &k in free {
        let h = 1e-6 * z[k].abs().max(0.02);
        let moved = |s: f64| {
            let mut y = z.to_vec();
            y[k] += s * h;
            dense(model, &y)
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        for j in 0..d.nq {
            let slope = (up.0[j] - down.0[j]) / (2.0 * h);
            let exact = jacobian[j * d.nz() + k];
            assert!(
                (slope - exact).abs() < 1e-5 * (1.0 + exact.abs()),
                "{name} r{j} z{k}: {slope} {exact}"
            );
        }
        for &m in free {
            let weighted =
                |full: &[f64]| -> f64 { (0..d.nq).map(|j| lambda[j] * full[j * d.nz() + m]).sum() };
            let slope = (weighted(&up.1) - weighted(&down.1)) / (2.0 * h);
            let exact = hessian[m * d.nz() + k];
            assert!(
                (slope - exact).abs() < 1e-4 * (1.0 + exact.abs()),
                "{name} z{m} z{k}: {slope} {exact}"
            );
        }
    }
}

#[test]
fn derivatives_are_those_of_differences() {
    let mut sets: Vec<Vec<Placed>> = smooth().iter().map(|id| vec![placed(id, 1)]).collect();
    // Effects at one joint act on what the others leave.
    let together = ["stribeck", "coulomb_asymmetry", "spring", "current_offset"];
    sets.push(together.iter().map(|id| placed(id, 0)).collect());
    for effects in sets {
        let name = effects[0].term.effect.info().id;
        let model = WithEffects::new(model(), &effects).expect("equations");
        let all: Vec<usize> = (0..model.dims().nz()).collect();
        for speed in [1.0, 0.03] {
            assert_derivatives(name, &model, &point(&model, speed), &all);
        }
    }
}

/// In motion the smooth form is the library's equation over dual numbers.
#[test]
fn stribeck_is_the_librarys() {
    let model = WithEffects::new(model(), &[placed("stribeck", 1)]).expect("equations");
    let d = model.dims();
    let mut z = point(&model, 0.3);
    z[d.v() + 1] = -0.7;
    let (mut with, mut without) = (vec![0.0; 2], vec![0.0; 2]);
    model.residual(&at(&z, &d), &mut with);
    let inner = self::model();
    let few = inner.dims();
    inner.residual(&at(&z[..few.nz()], &few), &mut without);
    let level = inner
        .params()
        .iter()
        .position(|p| p.name == "coulomb_elbow");
    let level = z[d.p() + level.expect("a parameter")];
    let zero = [Dual64::from(0.0); 2];
    let v = [z[d.v()], z[d.v() + 1]].map(Dual64::from);
    let site = Site {
        joint: 1,
        q: &zero,
        v: &v,
        load: &zero,
        t: 0.0,
        dt: 1.0,
        rest: None,
    };
    let mut f = Friction {
        forward: Dual64::from(level),
        backward: Dual64::from(level),
        viscous: Dual64::from(0.0),
    };
    let effect = by_id("stribeck").expect("an effect");
    effect
        .dual()
        .friction(&[0.3, 0.4].map(Dual64::from), &site, &[], &mut f);
    let excess = (f.forward.re - level) * v[1].re.signum();
    // Beyond twenty transitions tanh is 1.
    assert!(v[1].re.abs() > 0.2, "{v:?}");
    assert!(
        (with[1] - without[1] - excess).abs() < 1e-6,
        "{with:?} {without:?} {excess}"
    );
    assert_eq!(with[0], without[0]);
}

#[test]
fn errors_say_what_to_use_instead() {
    let error = WithEffects::new(model(), &[placed("backlash", 1)]).err();
    let text = error.expect("a gap has a corner").to_string();
    assert!(
        text.contains("backlash:elbow") && text.contains("help:"),
        "{text}"
    );
    let twice = [placed("spring", 1), placed("spring", 1)];
    let text = WithEffects::new(model(), &twice)
        .err()
        .expect("twice")
        .to_string();
    assert!(text.contains("spring_stiffness_elbow"), "{text}");
}

/// An effect with a state or a delay on the arm, with records that it widens.
fn with_states(id: &str, side: EncoderSide) -> (WithStates<'static>, Dataset) {
    let nominal = arm();
    let inner = Model::new(nominal.robot()).expect("equations");
    let at = |name: &str| inner.params().iter().position(|p| p.name == name);
    let drives = Drives {
        side,
        rotors: vec![at("rotor_shoulder"), at("rotor_elbow")],
    };
    let mut dataset = records();
    let placed = match id {
        "input_delay" => Placed {
            ranges: vec![(0.0047, 0.0, 0.01)],
            ..placed(id, 1)
        },
        _ => placed(id, 1),
    };
    let model = WithStates::new(Box::new(inner), &[placed], &drives, &mut dataset);
    (model.expect("a form with a state"), dataset)
}

fn records() -> Dataset {
    let (n, h) = (40, 0.002);
    let wave = |k: usize, j: usize| (0.3 * k as f64 + j as f64).sin();
    let rows = |size: f64| -> Vec<f64> {
        (0..n)
            .flat_map(|k| [size * wave(k, 0), size * wave(k, 1)])
            .collect()
    };
    let channel = |name: &str| JointChannels {
        name: name.to_owned(),
        prismatic: false,
        input: InputQuantity::Current,
        input_unit: "A".to_owned(),
        velocity: VelocityKind::Measured,
    };
    Dataset {
        name: "waves".to_owned(),
        title: String::new(),
        source: String::new(),
        license: String::new(),
        kind: pid_data::Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: vec![channel("shoulder"), channel("elbow")],
        experiments: vec![Experiment {
            name: "a".to_owned(),
            role: Role::Train,
            note: String::new(),
            nq: 2,
            t: (0..n).map(|k| h * k as f64).collect(),
            q: rows(1.0),
            v: Some(rows(3.0)),
            u: rows(2.0),
            tau: None,
            qref: None,
            missing: 0,
        }],
        warnings: Vec::new(),
    }
}

#[test]
fn derivatives_with_states_are_those_of_differences() {
    for id in [
        "actuator_lag",
        "presliding_hysteresis",
        "joint_elasticity",
        "backlash",
        "input_delay",
    ] {
        let (model, dataset) = with_states(id, EncoderSide::Motor);
        dataset.check_model(&model).expect("columns for all");
        let d = model.dims();
        let free: Vec<usize> = (0..d.u() + 2).chain(d.p()..d.nz()).collect();
        let z = point(&model, 0.1);
        assert_derivatives(id, &model, &z, &free);
        let (r, _) = dense(&model, &z);
        // M a + b − f_L is the residual.
        let (mut m, mut b, mut f) = (vec![0.0; d.nm()], vec![0.0; d.nq], vec![0.0; d.nq]);
        model.mass_matrix(&at(&z, &d), &mut m);
        model.bias(&at(&z, &d), &mut b);
        model.applied_force(&at(&z, &d), &mut f);
        for i in 0..d.nq {
            let row = (0..d.nq).map(|k| {
                let (low, high) = (i.min(k), i.max(k));
                m[high * (high + 1) / 2 + low] * z[d.a() + k]
            });
            let sum = row.sum::<f64>() + b[i] - f[i];
            assert!(
                (sum - r[i]).abs() < 1e-12 * (1.0 + r[i].abs()),
                "{id} {i}: {sum} {}",
                r[i]
            );
        }
    }
}

/// The state in continuous time and the simulation's substep are one law.
#[test]
fn a_flow_is_the_limit_of_substeps() {
    use crate::effect::{After, Commands, Flow};
    let (v, u, w, dt) = (0.7, 1.3, 0.25, 1e-7);
    let e = [0.02, 0.004];
    let at = Flow {
        v,
        speed: f64::abs(v),
        u,
        w,
        coulomb: 0.8,
    };
    let flow = |id: &str| {
        let effect = by_id(id).expect("an effect");
        let flow = effect.plain().flow(&e, &at).expect("a flow");
        (effect, flow.rate / flow.time)
    };
    let (lag, slope) = flow("actuator_lag");
    let commands = Commands {
        u: &[u],
        h: 1.0,
        linear: false,
        begin: 0.0,
        t: 0.0,
        dt,
        others: 0.0,
    };
    let mut memory = [w];
    lag.plain().input(&e, u, &commands, &mut memory);
    assert!(((memory[0] - w) / dt - slope).abs() < 1e-5 * slope.abs());
    let (bristle, slope) = flow("presliding_hysteresis");
    let mut memory = [w];
    let after = After {
        v,
        dt,
        coulomb: 0.8,
    };
    bristle.plain().advance(&e, &after, &mut memory);
    assert!(((memory[0] - w) / dt - slope).abs() < 1e-5 * slope.abs());
}

/// With the rotor's motion that of the link an elastic joint is a rigid one.
#[test]
fn a_gear_without_travel_is_a_rigid_joint() {
    let (model, _) = with_states("joint_elasticity", EncoderSide::Joint);
    let d = model.dims();
    let mut z = point(&model, 0.1);
    for part in [0, d.v(), d.a()] {
        z[part + 2] = z[part + 1];
    }
    let mut r = vec![0.0; d.nq];
    model.residual(&at(&z, &d), &mut r);
    let inner = self::model();
    let few = inner.dims();
    let own: Vec<f64> = [0, d.v(), d.a(), d.u()]
        .iter()
        .flat_map(|&part| z[part..part + 2].to_vec())
        .chain(z[d.p()..d.p() + few.np].to_vec())
        .collect();
    let mut rigid = vec![0.0; few.nq];
    inner.residual(&at(&own, &few), &mut rigid);
    assert!((r[1] + r[2] - rigid[1]).abs() < 1e-12, "{r:?} {rigid:?}");
    assert!((r[0] - rigid[0]).abs() < 1e-12, "{r:?} {rigid:?}");
}

#[test]
fn readings_are_those_of_the_encoders_side() {
    let stated = [Some(1.0), Some(2.0), Some(3.0), Some(4.0)];
    let infinite = Some(f64::INFINITY);
    let (motor, data) = with_states("joint_elasticity", EncoderSide::Motor);
    assert_eq!(
        motor.noise(&stated),
        [
            stated[0], infinite, stated[1], stated[2], infinite, stated[3]
        ]
    );
    // Both start where the encoder is.
    assert_eq!(data.experiments[0].q[1], data.experiments[0].q[2]);
    let (joint, _) = with_states("joint_elasticity", EncoderSide::Joint);
    assert_eq!(
        joint.noise(&stated),
        [
            stated[0], stated[1], infinite, stated[2], stated[3], infinite
        ]
    );
}

#[test]
fn a_state_and_a_law_that_it_replaces_are_refused() {
    let stribeck = "[[effect]]\nid = \"stribeck\"\njoint = \"elbow\"\n[effect.parameters]\nexcess = { value = 1.0 }\nstribeck_velocity = { value = 0.2 }\n";
    let elastic = "[[effect]]\nid = \"joint_elasticity\"\njoint = \"elbow\"\n[effect.parameters]\ncompliance = { value = 0.01 }\ndamping_time = { value = 0.001 }\n";
    let assemble = |effects: &str| {
        let text = format!("{ARM}\n{effects}");
        let nominal = description::Nominal::parse("arm.toml", &text).expect(&text);
        Assembled::new(&nominal, &mut records()).map(|with| with.model.dims().nq)
    };
    let error = assemble(&format!("{stribeck}{elastic}")).expect_err("one friction");
    assert!(error.to_string().contains("stribeck:2"), "{error}");
    let elsewhere = stribeck.replace("elbow", "shoulder");
    let found = assemble(&format!("{elsewhere}{elastic}"));
    assert_eq!(found.expect("other joints"), 3);
}

/// The loop of a law with its gains in the order of the law.
fn loop_of(law: ServoLaw, gains: &[f64], limit: Option<f64>) -> Servo {
    let mut servo = Servo::new(law);
    for (&gain, &value) in law.gains().iter().zip(gains) {
        let stated = ServoGain {
            value: Some(value),
            half_width: 0.3 * value,
        };
        servo.set(gain, stated);
    }
    servo.limit = limit;
    servo
}

/// The arm behind loops: one with an integral at the shoulder, PD at the elbow, both within a limit if
/// there is one.
fn behind_loops(law: ServoLaw, limit: Option<f64>) -> (WithLoops<'static>, Dataset) {
    let first = loop_of(law, &[3.0, 0.4, 1.5], limit);
    let pd = loop_of(ServoLaw::Pd, &[2.0, 0.3], limit);
    let mut dataset = records();
    for joint in &mut dataset.joints {
        (joint.input, joint.input_unit) = (InputQuantity::Position, "rad".to_owned());
    }
    let model = WithLoops::new(model(), &[Some(&first), Some(&pd)], &mut dataset);
    (model, dataset)
}

#[test]
fn derivatives_behind_loops_are_those_of_differences() {
    for law in [ServoLaw::Pid, ServoLaw::Cascade] {
        for limit in [None, Some(1.3)] {
            let (with, dataset) = behind_loops(law, limit);
            dataset.check_model(&with).expect("columns for all");
            let d = with.dims();
            let free: Vec<usize> = (0..d.u() + 2).chain(d.p()..d.nz()).collect();
            for speed in [1.0, 0.1] {
                assert_derivatives("loops", &with, &point(&with, speed), &free);
            }
        }
    }
}

/// The equations are those of the arm under the inputs of the drives' own laws, here by hand.
#[test]
fn loops_are_the_laws_of_the_drives() {
    for law in [ServoLaw::Pid, ServoLaw::Cascade] {
        let (with, _) = behind_loops(law, None);
        let (d, arm) = (with.dims(), model());
        let own = arm.dims();
        assert_eq!((d.nq, d.nu, d.np), (own.nq + 1, own.nu + 1, own.np + 5));
        let z = point(&with, 1.0);
        let here = at(&z, &d);
        let error = [here.u[0] - here.q[0], here.u[1] - here.q[1]];
        let lack = 3.0 * error[0] - here.v[0];
        // The integral is the velocity of the third coordinate. A cascade has kp, kv, ki.
        let (first, rate) = match law {
            ServoLaw::Cascade => (0.4 * lack, 1.5 * lack),
            _ => (3.0 * error[0] - 0.4 * here.v[0], 1.5 * error[0]),
        };
        let u = [first + here.v[2], 2.0 * error[1] - 0.3 * here.v[1]];
        let mut expected = vec![0.0; 2];
        let inside = At {
            q: &here.q[..2],
            v: &here.v[..2],
            a: &here.a[..2],
            u: &u,
            p: &here.p[..own.np],
        };
        arm.residual(&inside, &mut expected);
        let mut r = vec![0.0; 3];
        with.residual(&here, &mut r);
        for j in 0..2 {
            assert!((r[j] - expected[j]).abs() < 1e-12, "{r:?} {expected:?}");
        }
        assert!((r[2] - (here.a[2] - rate)).abs() < 1e-14, "{r:?}");
        let (mut m, mut b, mut f) = (vec![0.0; d.nm()], vec![0.0; 3], vec![0.0; 3]);
        with.mass_matrix(&here, &mut m);
        with.bias(&here, &mut b);
        with.applied_force(&here, &mut f);
        assert_eq!((&m[3..], b[2]), (&[0.0, 0.0, 1.0][..], 0.0));
        assert!((f[2] - rate).abs() < 1e-14);
        // At the limit nothing pushes further, and the integral rests.
        let (limited, _) = behind_loops(law, Some(1e-3));
        limited.residual(&here, &mut r);
        assert!((r[2] - here.a[2]).abs() < 1e-3 * rate.abs(), "{r:?}");
    }
}

/// What equations of motion do not hold is refused with its key.
#[test]
fn stages_of_loops_are_refused() {
    for (line, key) in [
        ("dead_band = 0.01", "dead_band"),
        ("gravity = 1.0", "gravity"),
        ("target_filter_s = 0.05", "target_filter_s"),
        ("velocity_filter_s = 0.05", "velocity_filter_s"),
        ("target_step = 0.01", "target_step"),
        ("target_rate_hz = 50.0", "target_rate_hz"),
        ("target_speed = 2.0", "target_speed"),
        ("target_acceleration = 8.0", "target_acceleration"),
        ("target_average_s = 0.1", "target_average_s"),
        ("inertia_feed_forward = 1.0", "inertia_feed_forward"),
    ] {
        let text = format!("{ARM}\n[drive]\nlaw = \"pd\"\nkp = 3.0\nkd = 0.4\n{line}\n");
        let nominal = description::Nominal::parse("arm.toml", &text).expect(&text);
        let mut dataset = records();
        for joint in &mut dataset.joints {
            (joint.input, joint.input_unit) = (InputQuantity::Position, "rad".to_owned());
        }
        let error = Assembled::new(&nominal, &mut dataset).err();
        let error = error.map(|e| e.to_string()).unwrap_or_default();
        assert!(
            error.contains("arm.toml:") && error.contains(&format!("do not hold `{key}`")),
            "{line}: {error}"
        );
    }
}
