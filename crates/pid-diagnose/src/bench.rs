//! A simulated pendulum for tests of parts.

use pid_data::Role;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::case::{Case, Noise, Record, Scale, Velocity};
use crate::effect::Term;
use crate::hypothesis::Hypothesis;
use crate::nominal::Nominal;
use crate::predict::Runner;
use crate::search::Settings;
use crate::simulate::State;

const PENDULUM: &str = include_str!("../tests/pendulum.toml");

/// Deviations of the pendulum: ten of its link, rotor, gain, two of friction.
pub(crate) const SIZE: usize = 14;
/// Readings noise of the pendulum: position and velocity.
const READING: (f64, f64) = (1e-4, 1e-2);

/// Normal numbers, always the same.
pub(crate) struct Draw(ChaCha8Rng);

impl Draw {
    pub(crate) fn new(seed: u64) -> Self {
        Draw(ChaCha8Rng::seed_from_u64(seed))
    }
    pub(crate) fn next(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }
}

/// Effects of the library, and terms without a name, at the first joint.
pub(crate) fn named(ids: &[&str]) -> Hypothesis {
    let term = |id: &&str| Term {
        effect: crate::effects::by_id(id).expect("an effect"),
        joint: 0,
    };
    Hypothesis::new(ids.iter().map(term).collect())
}

/// A search among a dozen effects of each kind of cause: a third of the library takes a third of the time.
pub(crate) fn among_a_dozen() -> Settings {
    let ids = [
        "actuator_lag",
        "cogging",
        "coulomb_asymmetry",
        "input_delay",
        "joint_elasticity",
        "load_dependent_friction",
        "payload",
        "quadratic_drag",
        "spring",
        "stribeck",
        "torque_saturation",
        "velocity_filter_lag",
    ];
    let effect = |id: &str| crate::effects::by_id(id).expect("an effect");
    Settings {
        effects: ids.map(effect).to_vec(),
        ..Settings::default()
    }
}

/// [`pendulum_under`] sines.
pub(crate) fn pendulum(
    hypothesis: &Hypothesis,
    e: &[f64],
    seconds: f64,
    start: &dyn Fn(&mut State<f64>),
) -> Case {
    pendulum_under(hypothesis, e, seconds, start, &sines)
}

fn sines(record: usize, t: f64) -> f64 {
    let w = 1.0 + 0.37 * record as f64;
    1.2 * (2.1 * w * t).sin() + 0.8 * (5.3 * w * t).sin() + 0.4 * (9.7 * t).sin()
}

/// [`pendulum`] about an upright axis: nothing but inertia pulls at a link within its gap.
pub(crate) fn waist(hypothesis: &Hypothesis, e: &[f64], seconds: f64) -> Case {
    let text = PENDULUM.replace("[0.0, 0.0, -9.81]", "[0.0, 0.0, 0.0]");
    let nominal = Nominal::parse(&text, "nominal.toml".as_ref()).expect("a robot");
    simulated(nominal, hypothesis, e, seconds, &|_| {}, &sines)
}

fn robot() -> Nominal {
    Nominal::parse(PENDULUM, "nominal.toml".as_ref()).expect("a robot")
}

/// Three records (two to fit, one to judge) of `seconds` at 500 Hz, of the pendulum with effects at
/// their parameters, from rest under an `input` by record and time; `start` may change the state at
/// the start.
pub(crate) fn pendulum_under(
    hypothesis: &Hypothesis,
    e: &[f64],
    seconds: f64,
    start: &dyn Fn(&mut State<f64>),
    input: &dyn Fn(usize, f64) -> f64,
) -> Case {
    simulated(robot(), hypothesis, e, seconds, start, input)
}

fn simulated(
    nominal: Nominal,
    hypothesis: &Hypothesis,
    e: &[f64],
    seconds: f64,
    start: &dyn Fn(&mut State<f64>),
    input: &dyn Fn(usize, f64) -> f64,
) -> Case {
    let h = 2e-3;
    let samples = (seconds / h) as usize;
    let mut draw = Draw::new(11);
    let roles = [Role::Train, Role::Train, Role::Test];
    let records = roles
        .iter()
        .enumerate()
        .map(|(i, &role)| {
            let u = (0..samples).map(|k| input(i, k as f64 * h)).collect();
            Record {
                name: format!("r{i}"),
                role,
                h,
                uneven: false,
                begin: 0.0,
                q: vec![vec![0.0; samples]],
                v: vec![vec![0.0; samples]],
                u: vec![u],
                smooth_q: vec![vec![0.0; samples]],
                smooth_v: vec![vec![0.0; samples]],
                first_v: vec![0.0],
                gain_factors: Default::default(),
                whole: None,
            }
        })
        .collect();
    let mut case = Case {
        name: "pendulum".to_owned(),
        nominal,
        records,
        linear_hold: false,
        velocity: vec![Velocity::Measured],
        scale: vec![Scale {
            torque: 4.5,
            input: 2.4,
            speed: 6.0,
            range: 3.0,
            inertia: 0.12,
        }],
        noise: vec![Noise {
            q: READING.0,
            v: READING.1,
            torque: 1.8e-3,
            passed: 0.0,
            stated: true,
        }],
        tip: (10.0, 1.5),
        passing: vec![vec![0.0]],
        known: Default::default(),
        outliers: Vec::new(),
        loop_warnings: Vec::new(),
        staged: Vec::new(),
        shared_lag: 0.0,
        ahead: 1.0,
    };
    let theta = vec![0.0; SIZE];
    for i in 0..case.records.len() {
        let plain = case.records[i].clone();
        let mut noisy = plain.clone();
        for u in &mut noisy.u[0] {
            *u += 1e-3 * draw.next();
        }
        let mut runner = Runner::<f64>::new(&case, &noisy, hypothesis, &theta, e);
        let mut state = runner.start(0);
        start(&mut state);
        let mut record = plain;
        runner.free(&state, 0, samples - 1, &mut |k, j, q, v| {
            record.smooth_q[j][k] = q;
            record.smooth_v[j][k] = v;
            record.q[j][k] = q + READING.0 * draw.next();
            record.v[j][k] = v + READING.1 * draw.next();
        });
        case.records[i] = record;
    }
    case
}
