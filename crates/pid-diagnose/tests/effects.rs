//! Every effect against its equation written independently, and its derivatives against differences.

use std::sync::OnceLock;

use num_dual::Dual64;
use pid_diagnose::constants::{Constant, Constants};
use pid_diagnose::effect::{After, Commands, Forces, Friction, Law, Pick, Site, Wide};
use pid_diagnose::effects;
use pid_diagnose::nominal::Nominal;
use pid_interpret::nominal::Gain;

const ROBOT: &str = r#"
[robot]
name = "two"
gravity = [0.0, 0.0, -9.81]
tool = [0.1, 0.0, -0.3]
[tolerance]
mass_rel = 0.05
com_abs_m = 0.003
inertia_rel = 0.05
rotor_inertia_rel = 0.05
motor_gain_rel = 0.01
friction_rel = 0.4
[[joint]]
name = "a"
type = "revolute"
axis = [0.0, 1.0, 0.0]
origin = [0.0, 0.0, 0.5]
mass = 3.0
com = [0.0, 0.01, -0.2]
inertia = [0.05, 0.06, 0.02, 0.001, 0.0, 0.002]
rotor_inertia = 0.1
coulomb = 1.5
viscous = 0.7
motor_gain = 4.0
input = "current"
velocity = "measured"
[[joint]]
name = "b"
type = "revolute"
axis = [1.0, 0.0, 0.0]
origin = [0.0, 0.0, -0.4]
rpy = [0.1, 0.2, -0.3]
mass = 1.0
com = [0.02, 0.0, -0.1]
inertia = [0.01, 0.012, 0.004, 0.0, 0.0, 0.0]
rotor_inertia = 0.0
coulomb = 0.5
viscous = 0.2
motor_gain = 2.0
input = "current"
velocity = "measured"
[joint.drive]
law = "pd"
kp = 30.0
kd = 1.0
"#;

fn constants<D: Pick>() -> Constants<'static, D> {
    static NOMINAL: OnceLock<Nominal> = OnceLock::new();
    let nominal = NOMINAL
        .get_or_init(|| Nominal::parse(ROBOT, "nominal.toml".as_ref()).expect("a valid robot"));
    Constants::new(nominal, &vec![D::constant(0.0); nominal.size()])
}

/// Everything an effect can say at one point, as one list of numbers.
fn answers<D: Pick>(law: &dyn Law<D>, e: &[D], memory: usize, joint: usize, v: f64) -> Vec<D> {
    let c = D::constant;
    let mut out = Vec::new();
    let mut cells: Vec<D> = (0..memory).map(|i| c(0.3 + 0.1 * i as f64)).collect();
    let u = [0.4, 0.9, -0.2, 1.3, 0.1, -0.6, 0.2];
    let commands = Commands {
        u: &u,
        h: 0.01,
        linear: false,
        begin: 0.0,
        t: 0.042,
        dt: 0.004,
    };
    let mut p = constants::<D>();
    law.constants(e, joint, &mut p);
    out.extend([0, 1, 2].map(|i| p.get(Constant::Gravity(i))));
    out.push(p.get(Constant::Rotor(joint)));
    out.push(p.get(Constant::Mass(1)));
    out.extend([0, 1, 2].map(|i| p.get(Constant::Moment(1, i))));
    out.extend([0, 1, 2, 3, 4, 5].map(|i| p.get(Constant::Inertia(1, i))));
    out.extend(Gain::ALL.map(|gain| p.get(Constant::Servo(gain, joint))));
    let (q, w) = ([c(0.35), c(-0.5)], [c(0.2), c(v)]);
    let load = [c(1.2), c(-0.8)];
    let site = Site {
        joint,
        q: &q,
        v: &w,
        load: &load,
        t: 0.9,
        dt: 0.004,
        rest: None,
    };
    let mut friction = Friction {
        forward: c(0.5),
        backward: c(0.5),
        viscous: c(0.2),
    };
    law.friction(e, &site, &cells, &mut friction);
    out.extend([friction.forward, friction.backward, friction.viscous]);
    let (mut value, mut rate) = ([c(0.0); 2], [c(0.0); 2]);
    law.force(
        e,
        &site,
        &cells,
        &mut Forces {
            value: &mut value,
            rate: &mut rate,
        },
        &p,
    );
    out.extend(value);
    out.extend(rate);
    out.push(law.input(e, c(commands.now()), &commands, &mut cells));
    law.advance(
        e,
        &After {
            v: c(v),
            dt: 0.004,
            coulomb: c(0.5),
        },
        &mut cells,
    );
    out.extend(cells);
    if let Some(f) = law.tip_force(e, 0.9, 0.004) {
        out.extend(f);
    }
    if let Some(g) = law.gear(e) {
        out.extend([g.stiffness, g.damping, g.open, g.gap]);
    }
    let (a, b) = law.sense(e, c(0.35), c(v));
    out.extend([a, b]);
    out.extend(law.reading_delay(e));
    out.extend(law.velocity_lag(e));
    out
}

/// A point away from kinks.
fn point(id: &str) -> Vec<f64> {
    match id {
        "stribeck" => vec![0.8, 0.3],
        "coulomb_asymmetry" => vec![0.25],
        "load_dependent_friction" => vec![0.15],
        "quadratic_drag" => vec![0.4],
        "saturating_friction" => vec![0.4, 0.3],
        "presliding_hysteresis" => vec![0.01, 0.001],
        "cogging" => vec![0.4, -0.2, 9.0],
        "friction_drift" => vec![0.5, 2.0],
        "joint_elasticity" => vec![0.01, 0.002],
        "backlash" => vec![0.02, 0.001, 0.0004, 0.0001],
        "unmodelled_rotor_inertia" => vec![0.07],
        "joint_coupling" => vec![3.0, -0.7, 0.4],
        "motor_coupling" => vec![0.4, 0.3, 0.8, 0.5],
        "actuator_lag" => vec![0.013],
        "input_delay" => vec![0.0137],
        "command_filter" | "feedback_delay" => vec![0.03],
        "command_average" => vec![0.05],
        "command_speed_limit" => vec![1.2],
        "command_acceleration_limit" => vec![6.0],
        "gravity_feed_forward" | "inertia_feed_forward" | "velocity_feed_forward" => vec![0.7],
        "torque_saturation" => vec![0.06],
        "gain_error_nonlinear" => vec![0.2],
        "current_offset" => vec![0.11],
        "drive_dead_zone" => vec![0.05],
        "payload" => vec![0.3],
        "base_tilt" => vec![0.05, -0.08],
        "spring" => vec![2.0, 0.3],
        "external_force" => vec![1.0, -2.0, 0.5, 0.901, 2.0, 3.0, 4.0, 5.0, 6.0],
        "encoder_offset" => vec![0.02],
        "encoder_eccentricity" => vec![0.03, -0.02],
        "velocity_filter_lag" => vec![0.02],
        "sensor_delay" => vec![0.01],
        other => panic!("no test point for {other}"),
    }
}

#[test]
fn derivatives_are_exact() {
    for effect in effects::all() {
        let id = effect.info().id;
        let e = point(id);
        assert_eq!(e.len(), effect.info().parameters.len(), "{id}");
        let n = effect.memory();
        let plain = |e: &[f64]| answers::<f64>(effect.plain(), e, n, 1, 0.6);
        let mut moved_at_all = false;
        for i in 0..e.len() {
            let mut dual: Vec<Dual64> = e.iter().map(|x| Dual64::from(*x)).collect();
            dual[i].eps = 1.0;
            let mut wide: Vec<Wide> = e.iter().map(|&re| Wide { re, eps: [0.0; 8] }).collect();
            wide[i].eps[5] = 1.0;
            let duals = answers::<Dual64>(effect.dual(), &dual, n, 1, 0.6);
            let wides = answers::<Wide>(effect.wide(), &wide, n, 1, 0.6);
            let step = 1e-6 * e[i].abs();
            let (mut up, mut down) = (e.clone(), e.clone());
            up[i] += step;
            down[i] -= step;
            let (up, down) = (plain(&up), plain(&down));
            for k in 0..duals.len() {
                let central = (up[k] - down[k]) / (2.0 * step);
                let scale = duals[k].eps.abs() + 1e-6 * (up[k].abs() + 1.0) / e[i].abs();
                assert!(
                    (duals[k].eps - central).abs() < 1e-5 * scale.max(1e-3),
                    "{id}: answer {k} by parameter {i}: {} {central}",
                    duals[k].eps
                );
                assert!(
                    (duals[k].eps - wides[k].eps[5]).abs() <= 1e-12 * (1.0 + duals[k].eps.abs()),
                    "{id}: lanes differ from duals"
                );
                assert!(
                    (duals[k].re - wides[k].re).abs() <= 1e-14 * (1.0 + duals[k].re.abs()),
                    "{id}"
                );
                moved_at_all |= duals[k].eps != 0.0;
            }
        }
        assert!(moved_at_all, "{id} answers nowhere");
    }
}

fn at(id: &str, e: &[f64], v: f64) -> (Friction<f64>, [f64; 2], [f64; 2]) {
    let effect = effects::by_id(id).expect("in the library");
    let law = effect.plain();
    let (q, w, load) = ([0.35, -0.5], [0.2, v], [1.2, -0.8]);
    let site = Site {
        joint: 1,
        q: &q,
        v: &w,
        load: &load,
        t: 0.9,
        dt: 0.004,
        rest: None,
    };
    let mut friction = Friction {
        forward: 0.5,
        backward: 0.5,
        viscous: 0.2,
    };
    let memory = vec![0.3; effect.memory()];
    law.friction(e, &site, &memory, &mut friction);
    let (mut value, mut rate) = ([0.0; 2], [0.0; 2]);
    law.force(
        e,
        &site,
        &memory,
        &mut Forces {
            value: &mut value,
            rate: &mut rate,
        },
        &constants(),
    );
    (friction, value, rate)
}

fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()), "{a} against {b}");
}

#[test]
fn friction_effects_follow_their_equations() {
    for v in [-0.7, -0.05, 0.02, 0.9] {
        let s = at("stribeck", &[0.8, 0.3], v).0;
        near(
            s.forward,
            0.5 * (1.0 + (1.8 - 1.0) * (-(v / 0.3_f64).powi(2)).exp()),
        );
        near(s.backward, s.forward);
        near(s.viscous, 0.2);
        // The whole friction (f_c sgn v + f_v v)(1 + a sgn v).
        let a = at("coulomb_asymmetry", &[0.25], v).0;
        let level = if v > 0.0 { a.forward } else { -a.backward };
        near(
            level + a.viscous * v,
            (0.5 * v.signum() + 0.2 * v) * (1.0 + 0.25 * v.signum()),
        );
        near(
            at("load_dependent_friction", &[0.15], v).0.forward,
            0.5 + 0.15 * 0.8,
        );
        let drag = at("quadratic_drag", &[0.4], v);
        near(drag.1[1] - drag.2[1] * v, -0.4 * v * v.abs());
        let rising = at("saturating_friction", &[0.4, 0.3], v).0;
        near(rising.forward, 0.5 * (0.6 + 0.4 * (v.abs() / 0.3).tanh()));
        near(rising.backward, rising.forward);
        let drift = at("friction_drift", &[0.5, 2.0], v).0;
        near(drift.forward, 0.5 * (1.0 + 0.5 * (-0.45_f64).exp()));
        near(drift.viscous, 0.2 * (1.0 + 0.5 * (-0.45_f64).exp()));
    }
}

#[test]
fn position_effects_follow_their_equations() {
    let ripple = at("cogging", &[0.4, -0.2, 9.0], 0.1).1;
    let (amplitude, phase) = (0.4_f64.hypot(0.2), (-0.2_f64).atan2(0.4));
    near(ripple[1], amplitude * (9.0 * -0.5 + phase).sin());
    near(at("spring", &[2.0, 0.3], 0.1).1[1], -2.0 * (-0.5 - 0.15));
    let (k, ratio, rest) = (3.0, -0.7, 0.4 / 3.0);
    let stretch = -0.5 + ratio * 0.35 - rest;
    let pull = at("joint_coupling", &[k, ratio, 0.4], 0.1).1;
    near(pull[1], -k * stretch);
    near(pull[0], -k * ratio * stretch);
}

#[test]
fn the_bristle_reaches_the_coulomb_level_and_remembers() {
    let effect = effects::by_id("presliding_hysteresis").expect("in the library");
    let law = effect.plain();
    let e = [0.01, 0.0];
    let mut memory = vec![0.0];
    let mut push = |v: f64, steps: usize| {
        for _ in 0..steps {
            law.advance(
                &e,
                &After {
                    v,
                    dt: 1e-4,
                    coulomb: 0.5,
                },
                &mut memory,
            );
        }
        memory[0]
    };
    // dz/dt = v − |v| z/z_s has z/z_s = 1 − exp(−x/z_s) over the distance x.
    let x = 0.2 * 1e-4 * 200.0;
    let after = push(0.2, 200);
    assert!(
        (after - (1.0 - (-x / 0.01_f64).exp())).abs() < 1e-12,
        "{after}"
    );
    assert!((push(0.2, 20_000) - 1.0).abs() < 1e-9);
    assert!((push(-0.2, 20_000) + 1.0).abs() < 1e-9);
}

#[test]
fn drive_effects_follow_their_equations() {
    let u = [0.4, 0.9, -0.2, 1.3, 0.1];
    let commands = Commands {
        u: &u,
        h: 0.01,
        linear: false,
        begin: 0.0,
        t: 0.03,
        dt: 0.01,
    };
    let input = |id: &str, e: &[f64], x: f64, memory: &mut [f64]| {
        effects::by_id(id)
            .expect("in the library")
            .plain()
            .input(e, x, &commands, memory)
    };
    near(commands.now(), 1.3);
    // Half a sample late: half of either command.
    near(
        input("input_delay", &[0.005], 1.3, &mut []),
        0.5 * (-0.2 + 1.3),
    );
    near(input("input_delay", &[0.0], 1.3, &mut []), 1.3);
    near(input("input_delay", &[0.1], 1.3, &mut []), 0.4);
    near(input("torque_saturation", &[0.7], -1.3, &mut []), -0.7);
    near(
        input("gain_error_nonlinear", &[0.2], 1.3, &mut []),
        1.3 / (1.0 + 0.2 * 1.69),
    );
    near(input("current_offset", &[0.11], 1.3, &mut []), 1.41);
    for (x, y) in [(1.3, 1.25), (-1.3, -1.25), (0.03, 0.0)] {
        near(input("drive_dead_zone", &[0.05], x, &mut []), y);
    }
    // First-order lag from 0.2 towards 1.3: mean over the step and end value of the exact response.
    let (t, mut memory) = (0.013, [0.2]);
    let mean = input("actuator_lag", &[t], 1.3, &mut memory);
    let samples = 200_000;
    let numeric = (0..samples)
        .map(|i| 1.3 - 1.1 * (-(0.01 * (f64::from(i) + 0.5) / f64::from(samples)) / t).exp())
        .sum::<f64>()
        / f64::from(samples);
    assert!((mean - numeric).abs() < 1e-9);
    near(memory[0], 1.3 - 1.1 * (-0.01 / t).exp());
}

#[test]
fn constants_follow_their_definitions() {
    let change = |id: &str, e: &[f64]| {
        let mut p = constants::<f64>();
        effects::by_id(id)
            .expect("in the library")
            .plain()
            .constants(e, 1, &mut p);
        p
    };
    // The base turned by a about (x, y, 0)/a: gravity turned by −a, by nalgebra's rotation.
    let (x, y) = (0.12, -0.2);
    let axis = nalgebra::Vector3::new(x, y, 0.0);
    let expected = nalgebra::Rotation3::new(-axis) * nalgebra::Vector3::new(0.0, 0.0, -9.81);
    let tilted = change("base_tilt", &[x, y]);
    let g = [0, 1, 2].map(|i| tilted.get(Constant::Gravity(i)));
    for i in 0..3 {
        assert!((g[i] - expected[i]).abs() < 1e-8, "{g:?} {expected:?}");
    }
    let (before, after) = (constants::<f64>(), change("payload", &[0.3]));
    near(
        after.get(Constant::Mass(1)),
        before.get(Constant::Mass(1)) + 0.3,
    );
    let r = nalgebra::Vector3::new(0.1, 0.0, -0.3);
    let i: nalgebra::Matrix3<f64> =
        0.3 * (r.norm_squared() * nalgebra::Matrix3::identity() - r * r.transpose());
    for (k, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
        .into_iter()
        .enumerate()
    {
        near(
            after.get(Constant::Inertia(1, k)) - before.get(Constant::Inertia(1, k)),
            i[(a, b)],
        );
    }
    let rotor = change("unmodelled_rotor_inertia", &[0.07]).get(Constant::Rotor(1));
    near(rotor, 0.07);
}

#[test]
fn a_force_counts_only_inside_its_windows() {
    let effect = effects::by_id("external_force").expect("in the library");
    let e = [1.0, -2.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let x = |t: f64, dt: f64| effect.plain().tip_force(&e, t, dt).map(|f| f[1]);
    near(x(0.5, 0.1).expect("a force"), 0.0);
    near(x(1.5, 0.1).expect("a force"), -2.0);
    near(x(1.9, 0.4).expect("a force"), -2.0 * 0.25);
    near(x(1.5, 2.0).expect("a force"), -2.0 * 0.5);
}

#[test]
fn descriptions_are_complete() {
    let ids: Vec<&str> = effects::all().iter().map(|e| e.info().id).collect();
    assert_eq!(ids.len(), 35);
    for effect in effects::all() {
        let info = effect.info();
        assert!(
            !info.source.is_empty() && !info.equation.is_empty() && !info.starts.is_empty(),
            "{}",
            info.id
        );
        for start in info.starts {
            assert_eq!(start.len(), info.parameters.len(), "{}", info.id);
            for (x, p) in start.iter().zip(info.parameters) {
                assert!(
                    (p.lower..=p.upper).contains(x),
                    "{}: {} starts at {x}",
                    info.id,
                    p.name
                );
            }
        }
        for (rival, _) in info.confusions {
            assert!(
                ids.contains(rival),
                "{} is confused with {rival}, which is not in the library",
                info.id
            );
        }
    }
}
