//! Equations with effects: derivatives against differences and against the library's own equation.

use num_dual::Dual64;
use pid_data::{Dataset, Experiment, InputHold, InputQuantity, JointChannels, Role, VelocityKind};
use pid_interpret::Model;
use pid_interpret::nominal::EncoderSide;

use super::*;
use crate::effect::{Friction, Site};
use crate::effects::{all, by_id};

pub(super) const ARM: &str = include_str!("arm.toml");

fn arm() -> description::Nominal {
    description::Nominal::parse("arm.toml", ARM).expect("a robot")
}

pub(super) fn model() -> Box<dyn Hessian> {
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
pub(super) fn at<'a>(z: &'a [f64], d: &Dims) -> At<'a> {
    At {
        q: &z[..d.v()],
        v: &z[d.v()..d.a()],
        a: &z[d.a()..d.u()],
        u: &z[d.u()..d.p()],
        p: &z[d.p()..],
    }
}

pub(super) fn point(model: &dyn Hessian, speed: f64) -> Vec<f64> {
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
pub(super) fn assert_derivatives(name: &str, model: &dyn Hessian, z: &[f64], free: &[usize]) {
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

/// What the drive brings is the load, the friction that the model has and μ |load|, driving and driven.
#[test]
fn load_dependent_friction_takes_what_the_load_makes_it() {
    let model =
        WithEffects::new(model(), &[placed("load_dependent_friction", 1)]).expect("an effect");
    let d = model.dims();
    let place = |name: &str| {
        let mut all = model.params().iter();
        d.p() + all.position(|p| p.name == name).expect(name)
    };
    let input = model.inputs().iter().position(|i| i.joint == Some(1));
    let input = d.u() + input.expect("an input");
    for (mu, load, speed) in [
        (0.1, 2.0, 0.8),
        (0.5, 2.0, 0.8),
        (0.5, 2.0, -0.8),
        (0.7, -3.0, 0.6),
    ] {
        let mut z = point(&model, 0.3);
        z[d.v() + 1] = speed;
        z[place("load_dependent_friction_load_coefficient_elbow")] = mu;
        // What moves the model without effects is the load and its friction: the input makes up for both.
        let inner = self::model();
        let few = inner.dims();
        let dry = z[place("coulomb_elbow")] * speed.signum() + z[place("viscous_elbow")] * speed;
        let gain = z[place("gain_elbow")];
        let (mut without, mut with) = (vec![0.0; 2], vec![0.0; 2]);
        z[input] = (load + dry) / gain;
        inner.residual(&at(&z[..few.nz()], &few), &mut without);
        z[input] += mu * f64::abs(load) * speed.signum() / gain;
        model.residual(&at(&z, &d), &mut with);
        let off = with[1] - without[1];
        assert!(
            off.abs() < 5e-3 * f64::abs(load),
            "{mu} {load} {speed}: {off}"
        );
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

pub(super) fn records() -> Dataset {
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
            gain_factors: Default::default(),
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
