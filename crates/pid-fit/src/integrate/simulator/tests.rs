use super::*;
use crate::integrate::test_models::{DoublePendulum, PENDULUM, Pendulum, TwoMasses};
use crate::integrate::{Trajectory, simulate};
use pid_data::InputHold;

fn settings(method: Method, tolerance: f64) -> Settings {
    Settings {
        method,
        rtol: tolerance,
        atol: tolerance,
        ..Settings::default()
    }
}

fn swing(
    p: &[f64],
    n: usize,
    h: f64,
    u: f64,
    settings: Settings,
) -> Result<Trajectory, SimulateError> {
    let t: Vec<f64> = (0..=n).map(|i| i as f64 * h).collect();
    let inputs = vec![u; n + 1];
    let drive = Drive {
        t: &t,
        u: &inputs,
        hold: InputHold::ZeroOrder,
    };
    simulate(&Pendulum, p, &[2.0], &[0.5], &drive, settings)
}

/// Final state of a driven, damped pendulum after 1 s.
fn last(t: &Trajectory) -> [f64; 2] {
    [t.q[t.q.len() - 1], t.v[t.v.len() - 1]]
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn orders_of_convergence_are_those_of_the_methods() {
    let p = [1.2, 9.0, 0.3, 0.2, 1.0];
    let exact = last(&swing(&p, 1, 1.0, 0.7, settings(Method::Radau, 1e-13)).unwrap());
    let other = last(&swing(&p, 1, 1.0, 0.7, settings(Method::DormandPrince, 1e-13)).unwrap());
    assert!(
        distance(exact, other) < 1e-10,
        "two methods, one solution: {exact:?} {other:?}"
    );
    // One step per sample, whatever its error.
    let loose = |method| Settings {
        rtol: 1e9,
        atol: 1e9,
        ..settings(method, 1.0)
    };
    for (method, order) in [
        (Method::Rk4 { substeps: 1 }, 4.0),
        (Method::DormandPrince, 5.0),
    ] {
        let error = |n: usize| {
            let t = swing(&p, n, 1.0 / n as f64, 0.7, loose(method)).unwrap();
            assert_eq!(t.stats.steps, n);
            distance(last(&t), exact)
        };
        let measured = (error(20) / error(40)).log2();
        assert!(
            (measured - order).abs() < 0.25,
            "{method:?}: order {measured}"
        );
    }
}

#[test]
fn energy_is_kept_without_friction() {
    let p = [1.2, 9.0, 0.0, 0.0, 0.0];
    let t: Vec<f64> = (0..=1000).map(|i| 0.01 * f64::from(i)).collect();
    let u = vec![0.0; 1001];
    let drive = Drive {
        t: &t,
        u: &u,
        hold: InputHold::ZeroOrder,
    };
    let tight = Settings {
        rtol: 1e-11,
        atol: 1e-12,
        ..Settings::default()
    };
    let motion = simulate(&Pendulum, &p, &[2.5], &[0.0], &drive, tight).unwrap();
    let energy = |i: usize| 0.5 * p[0] * motion.v[i].powi(2) - p[1] * motion.q[i].cos();
    for i in 0..=1000 {
        assert!(
            (energy(i) - energy(0)).abs() < 1e-8 * p[1],
            "sample {i}: {}",
            energy(i)
        );
    }
}

#[test]
fn energy_of_a_chaotic_double_pendulum_is_kept() {
    let model = DoublePendulum;
    let t: Vec<f64> = (0..=500).map(|i| 0.01 * f64::from(i)).collect();
    let drive = Drive {
        t: &t,
        u: &[0.0; 2 * 501],
        hold: InputHold::ZeroOrder,
    };
    let tight = Settings {
        rtol: 1e-11,
        atol: 1e-12,
        ..Settings::default()
    };
    let (mut q, mut v) = (vec![0.0; 2 * 501], vec![0.0; 2 * 501]);
    let mut simulator = Simulator::new(&model, tight);
    simulator
        .run(&[], &[2.0, 1.0], &[0.0, 0.0], &drive, &mut q, &mut v)
        .unwrap();
    let energy = |i: usize| {
        let at = pid_runtime::dynamics::At {
            q: &q[2 * i..2 * i + 2],
            v: &v[2 * i..2 * i + 2],
            a: &[],
            u: &[],
            p: &[],
        };
        model.kinetic_energy(&at) + model.potential_energy(&at)
    };
    let moved = (0..=500).any(|i| (q[2 * i] - 2.0).abs() > 1.0);
    assert!(moved);
    for i in 0..=500 {
        assert!(
            (energy(i) - energy(0)).abs() < 1e-7,
            "sample {i}: {} {}",
            energy(i),
            energy(0)
        );
    }
}

#[test]
fn dry_friction_is_stiff_and_goes_to_the_implicit_method() {
    // tanh(1000 v) with a drive below the breakaway force: the pendulum comes to rest and creeps.
    let p = [0.05, 0.1, 0.0, 2.0, 1000.0];
    let auto = swing(&p, 200, 0.01, 0.5, settings(Method::Auto, 1e-7)).unwrap();
    assert!(auto.stats.implicit > 0, "{:?}", auto.stats);
    let radau = swing(&p, 200, 0.01, 0.5, settings(Method::Radau, 1e-9)).unwrap();
    assert!(
        distance(last(&auto), last(&radau)) < 1e-5,
        "{:?} {:?}",
        last(&auto),
        last(&radau)
    );
    let explicit = swing(&p, 200, 0.01, 0.5, settings(Method::DormandPrince, 1e-7)).unwrap();
    assert!(distance(last(&explicit), last(&radau)) < 1e-5);
    assert!(
        10 * auto.stats.steps < explicit.stats.steps,
        "{:?} {:?}",
        auto.stats,
        explicit.stats
    );
}

#[test]
fn coupled_masses_swing_as_their_modes_say() {
    // M = [[2, 1], [1, 2]], K = [[5, -1], [-1, 5]]: modes (1, 1) with ω² = 4/3 and (1, −1) with ω² = 6.
    let t: Vec<f64> = (0..=100).map(|i| 0.05 * f64::from(i)).collect();
    let drive = Drive {
        t: &t,
        u: &[0.0; 2 * 101],
        hold: InputHold::Linear,
    };
    for method in [Method::Radau, Method::DormandPrince] {
        let motion = simulate(
            &TwoMasses,
            &[],
            &[1.0, 0.2],
            &[0.0, 0.0],
            &drive,
            settings(method, 1e-10),
        )
        .unwrap();
        for (i, t) in t.iter().enumerate() {
            let (even, odd) = (
                0.6 * ((4.0_f64 / 3.0).sqrt() * t).cos(),
                0.4 * (6.0_f64.sqrt() * t).cos(),
            );
            assert!(
                (motion.q[2 * i] - (even + odd)).abs() < 1e-7,
                "{method:?} at {t}"
            );
            assert!(
                (motion.q[2 * i + 1] - (even - odd)).abs() < 1e-7,
                "{method:?} at {t}"
            );
        }
    }
}

#[test]
fn inputs_are_held_or_joined_by_lines() {
    // A free mass: a = u / m. Held: 1 then 2 gives v = 1·1 + 2·1; linear 1 → 2 → 4 gives 1.5 + 3.
    let p = [1.0, 0.0, 0.0, 0.0, 0.0];
    let (t, u) = ([0.0, 1.0, 2.0], [1.0, 2.0, 4.0]);
    for (hold, v) in [(InputHold::ZeroOrder, 3.0), (InputHold::Linear, 4.5)] {
        for method in [
            Method::DormandPrince,
            Method::Radau,
            Method::Rk4 { substeps: 2 },
        ] {
            let drive = Drive { t: &t, u: &u, hold };
            let m = simulate(
                &Pendulum,
                &p,
                &[0.0],
                &[0.0],
                &drive,
                settings(method, 1e-9),
            )
            .unwrap();
            assert!((m.v[2] - v).abs() < 1e-8, "{hold:?} {method:?}: {}", m.v[2]);
        }
    }
}

#[test]
fn what_cannot_be_simulated_is_said_with_its_time() {
    let text = |r: Result<Trajectory, SimulateError>| r.unwrap_err().to_string();
    let massless = text(swing(
        &[0.0, 1.0, 0.0, 0.0, 0.0],
        10,
        0.1,
        0.0,
        Settings::default(),
    ));
    assert!(
        massless.contains("singular at t = 0 s") && massless.contains("`hinge`"),
        "{massless}"
    );
    // Negative damping: v' = 40 v explodes.
    let p = [1.0, 0.0, -40.0, 0.0, 0.0];
    let e = swing(&p, 100, 0.1, 0.0, Settings::default()).unwrap_err();
    assert!(
        matches!(e, SimulateError::Diverged { .. }) && e.time() < Some(1.0),
        "{e}"
    );
    let e = swing(&PENDULUM, 10, 0.1, f64::NAN, Settings::default()).unwrap_err();
    assert!(matches!(e, SimulateError::NotFinite { .. }), "{e}");
    let e = swing(&[1.0], 10, 0.1, 0.0, Settings::default()).unwrap_err();
    assert_eq!(
        e,
        SimulateError::Shape {
            what: "p",
            expected: 5,
            found: 1
        }
    );
    let few = Settings {
        max_steps: 3,
        ..settings(Method::DormandPrince, 1e-12)
    };
    let e = swing(&PENDULUM, 1, 1.0, 0.0, few).unwrap_err();
    assert!(
        matches!(e, SimulateError::TooManySteps { steps: 3, .. }),
        "{e}"
    );
    let mut simulator = Simulator::new(&Pendulum, settings(Method::Radau, 1e-6));
    let drive = Drive {
        t: &[0.0],
        u: &[0.0],
        hold: InputHold::ZeroOrder,
    };
    let e = simulator
        .run(&PENDULUM, &[0.0], &[0.0], &drive, &mut [0.0], &mut [0.0])
        .unwrap_err();
    assert!(matches!(e, SimulateError::NoDerivatives { .. }));
}
