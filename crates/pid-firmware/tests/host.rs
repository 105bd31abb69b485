//! Generated C and Rust against the library's own inverse dynamics, on this machine.

mod common;

use common::{
    Built, DOUBLE, SINGLE, State, arm6, compare, declared, in_c, in_library, in_rust, reread,
    states, with,
};
use pid_effects::with_effects::{Placed, WithEffects};
use pid_firmware::Precision;
use pid_interpret::Model;
use pid_runtime::dynamics::{At, Dynamics, Hessian};

/// Every effect that the code expresses.
const ALL: &[(&str, usize, &[f64])] = &[
    ("stribeck", 0, &[0.6, 0.1]),
    ("coulomb_asymmetry", 0, &[0.2]),
    ("load_dependent_friction", 1, &[0.15]),
    ("coulomb_asymmetry", 1, &[-0.1]),
    ("quadratic_drag", 2, &[1.3]),
    ("saturating_friction", 3, &[0.6, 0.2]),
    ("cogging", 2, &[0.8, -0.5, 12.0]),
    ("spring", 3, &[4.0, 1.5]),
    ("joint_coupling", 4, &[3.0, -0.7, 0.4]),
    ("motor_coupling", 5, &[0.6, 0.5, 1.2, 0.05]),
    ("unmodelled_rotor_inertia", 1, &[0.7]),
    ("current_offset", 0, &[0.25]),
    ("gain_error_nonlinear", 3, &[1e-3]),
    ("drive_dead_zone", 4, &[0.12]),
    ("torque_saturation", 5, &[500.0]),
    ("encoder_offset", 2, &[0.03]),
    ("payload", 0, &[1.7]),
    ("base_tilt", 0, &[0.05, -0.08]),
];

/// Effects that the code has no words for.
const WITHOUT: &[(&str, usize, &[f64])] = &[
    ("presliding_hysteresis", 0, &[1e-3, 1e-3]),
    ("friction_drift", 0, &[0.4, 5.0]),
    ("joint_elasticity", 1, &[1e-4, 1e-3]),
    ("backlash", 2, &[1e-3, 1e-3, 0.0, 3e-4]),
    ("actuator_lag", 0, &[0.01]),
    ("input_delay", 1, &[0.004]),
    (
        "external_force",
        0,
        &[5.0, 0.0, 3.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
    ),
    ("encoder_eccentricity", 1, &[0.01, 0.01]),
    ("velocity_filter_lag", 1, &[0.01]),
    ("sensor_delay", 2, &[0.003]),
];

#[test]
fn c_equals_the_library_with_every_effect() {
    let nominal = reread(&with(&arm6(), ALL));
    compare(&nominal, &in_c(&nominal, Precision::F64), DOUBLE, "f64");
    compare(&nominal, &in_c(&nominal, Precision::F32), SINGLE, "f32");
}

#[test]
fn rust_equals_the_library_with_every_effect() {
    let nominal = with(&arm6(), ALL);
    compare(&nominal, &in_rust(&nominal, Precision::F64), DOUBLE, "f64");
    compare(&nominal, &in_rust(&nominal, Precision::F32), SINGLE, "f32");
}

#[test]
fn the_static_library_is_the_crate() {
    let nominal = with(&arm6(), ALL);
    let (library, own) = (
        in_library(&nominal, Precision::F32),
        in_rust(&nominal, Precision::F32),
    );
    let states = states(6, 20, 3);
    assert_eq!(library.answers(&states), own.answers(&states));
}

#[test]
fn every_model_equals_the_library() {
    for name in [
        "two_link",
        "double_pendulum",
        "scara",
        "ur10e",
        "panda",
        "servo_pendulum",
        "vs050",
    ] {
        let nominal = declared(name);
        compare(&nominal, &in_c(&nominal, Precision::F64), DOUBLE, name);
    }
}

/// Against equations that share only the declaration: the residual of the interpreter, derived twice.
#[test]
fn without_effects_it_is_the_residual_of_the_interpreter() {
    let nominal = arm6();
    let built = in_c(&nominal, Precision::F64);
    let model: Box<dyn Hessian> = Box::new(Model::new(nominal.robot()).expect("equations"));
    agrees(&built, model.as_ref(), DOUBLE);
}

/// Laws of the library as estimators take them: the same residual.
#[test]
fn with_effects_it_is_the_residual_of_the_extended_model() {
    let own: Vec<_> = ALL
        .iter()
        // Smooth models round corners, and take the torque at the gear from the drive.
        .filter(|(id, ..)| {
            ![
                "load_dependent_friction",
                "drive_dead_zone",
                "torque_saturation",
                "encoder_offset",
                "payload",
                "base_tilt",
            ]
            .contains(id)
        })
        .copied()
        .collect();
    let nominal = with(&arm6(), &own);
    let placed = Placed::of(&nominal).expect("effects");
    let model = Box::new(Model::new(nominal.robot()).expect("equations"));
    let model = WithEffects::new(model, &placed).expect("a model");
    // The model reads the sharpness of the transition at rest off a slope.
    agrees(&in_c(&nominal, Precision::F64), &model, 1e-10);
}

fn agrees(built: &Built, model: &dyn Dynamics, close: f64) {
    let states = states(6, 60, 11);
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    for (state, [torque, _, residual]) in states.iter().zip(built.answers(&states)) {
        let State { q, v, a, u } = state;
        let mut r = vec![0.0; 6];
        let at = At { q, v, a, u, p: &p };
        model.residual(&at, &mut r);
        let size = torque.1.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let error = r.iter().zip(&residual.1).map(|(x, y)| (x - y).abs() / size);
        let error = error.fold(0.0, f64::max);
        assert!(error < close, "{error:e}: {r:?} {residual:?}");
    }
}

#[test]
fn a_state_or_a_look_back_leaves_the_torque_and_is_named() {
    let (plain, nominal) = (arm6(), with(&arm6(), WITHOUT));
    let files = common::files(&nominal, pid_firmware::Target::C, Precision::F64);
    let told = common::text(&files, "not_expressed.md");
    for (id, ..) in WITHOUT {
        let row = told.lines().find(|line| line.contains(id)).expect(id);
        assert!(row.contains("| nothing: "), "{row}");
    }
    let source = common::text(&files, ".c");
    let without = common::files(&plain, pid_firmware::Target::C, Precision::F64);
    assert_eq!(source, common::text(&without, ".c"));
}

/// Finite inputs give finite outputs, or zeros and `false`; what is no number does too.
#[test]
fn no_input_gives_a_number_that_is_none() {
    let nominal = with(&arm6(), ALL);
    for precision in [Precision::F32, Precision::F64] {
        let (c, rust) = (in_c(&nominal, precision), in_rust(&nominal, precision));
        let extremes = [
            0.0,
            -0.0,
            1e-300,
            1e-40,
            1e10,
            -1e20,
            3e38,
            -1e150,
            1.7e308,
            f64::INFINITY,
            f64::NAN,
        ];
        let mut hostile = Vec::new();
        for (k, &x) in extremes.iter().enumerate() {
            for part in 0..4 {
                let mut state = states(6, 1, k as u64).remove(0);
                let own = [&mut state.q, &mut state.v, &mut state.a, &mut state.u];
                own.into_iter().nth(part).expect("a part")[k % 6] = x;
                hostile.push(state);
            }
        }
        for (built, what) in [(&c, "C"), (&rust, "Rust")] {
            for (state, answer) in hostile.iter().zip(built.answers(&hostile)) {
                for (found, all) in answer {
                    assert!(all.iter().all(|x| x.is_finite()), "{what}: {state:?}");
                    assert!(found || all.iter().all(|&x| x == 0.0), "{what}: {all:?}");
                }
            }
        }
        let same = c.answers(&hostile).into_iter().zip(rust.answers(&hostile));
        for (state, (c, rust)) in hostile.iter().zip(same) {
            let found = |answer: &common::Answer| answer.each_ref().map(|(found, _)| *found);
            assert_eq!(found(&c), found(&rust), "{state:?}");
        }
    }
}

#[test]
fn an_input_out_of_reach_is_the_nearest_one() {
    let own: &[(&str, usize, &[f64])] = &[
        ("torque_saturation", 0, &[2.0]),
        // The most that acts is 1/(2 √b) = 5, at an input of 10.
        ("gain_error_nonlinear", 1, &[0.01]),
        ("drive_dead_zone", 2, &[0.5]),
    ];
    let nominal = with(&arm6(), own);
    let still = |a: f64| State {
        q: vec![0.0; 6],
        v: vec![0.0; 6],
        a: vec![a; 6],
        u: vec![0.0; 6],
    };
    for built in [
        in_c(&nominal, Precision::F64),
        in_rust(&nominal, Precision::F64),
    ] {
        for (a, sign) in [(300.0, 1.0), (-300.0, -1.0)] {
            let [_, (found, u), _] = &built.answers(&[still(a)])[0];
            assert!(found);
            assert_eq!(u[0], 2.0 * sign);
            assert!((u[1] - 10.0 * sign).abs() < 1e-9, "{u:?}");
            assert!(u[2] * sign > 0.5);
        }
    }
}
