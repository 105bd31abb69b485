use super::*;
use crate::integrate::test_models::{PENDULUM, Pendulum};
use crate::integrate::{Drive, Settings, simulate};
use pid_data::{InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// A record of the pendulum with white noise of 1e-4 rad on the position.
fn record(noise: f64) -> (Dataset, Experiment) {
    let t: Vec<f64> = (0..4000).map(|i| 0.002 * f64::from(i)).collect();
    let u: Vec<f64> = t.iter().map(|t| 4.0 * (2.0 * t).sin()).collect();
    let drive = Drive {
        t: &t,
        u: &u,
        hold: InputHold::ZeroOrder,
    };
    let m = simulate(
        &Pendulum,
        &PENDULUM,
        &[1.0],
        &[0.0],
        &drive,
        Settings::default(),
    )
    .unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let q =
        m.q.iter()
            .map(|q| q + noise * random.sample::<f64, _>(StandardNormal))
            .collect();
    let experiment = Experiment {
        name: "e".into(),
        role: Role::Train,
        note: String::new(),
        nq: 1,
        t: t.clone(),
        q,
        v: None,
        u,
        tau: None,
        qref: None,
        missing: 0,
        gain_factors: Default::default(),
    };
    let dataset = Dataset {
        name: "d".into(),
        title: String::new(),
        source: String::new(),
        license: String::new(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: vec![JointChannels {
            name: "hinge".into(),
            prismatic: false,
            input: InputQuantity::Torque,
            input_unit: "N*m".into(),
            velocity: VelocityKind::Absent,
        }],
        experiments: Vec::new(),
        warnings: Vec::new(),
    };
    (dataset, experiment)
}

fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
}

fn share_inside(error: impl Iterator<Item = f64>, band: &[f64]) -> f64 {
    let inside = error.zip(band).filter(|(e, b)| e.abs() <= **b).count();
    inside as f64 / band.len() as f64
}

#[test]
fn a_term_taken_from_the_model_comes_back_as_missing_force() {
    let (dataset, e) = record(0.0);
    let whole = missing_force(&Pendulum, &PENDULUM, &dataset, &e, States::NONE).unwrap();
    assert!(
        rms(&whole.w) < 1e-3 * rms(&whole.total),
        "{}",
        rms(&whole.w)
    );
    // Without viscous friction the missing force is −d v (as part of f_L).
    let mut p = PENDULUM;
    p[2] = 0.0;
    let part = missing_force(&Pendulum, &p, &dataset, &e, States::NONE).unwrap();
    // The ends know one neighbour only.
    for (i, w) in part.w.iter().enumerate().skip(20).take(part.w.len() - 40) {
        let expected = -PENDULUM[2] * part.v[i];
        assert!((w - expected).abs() < 0.01, "{i}: {w} {expected}");
    }
}

#[test]
fn a_record_of_the_model_leaves_no_force_and_tells_its_noise() {
    let (dataset, e) = record(1e-4);
    let m = missing_force(&Pendulum, &PENDULUM, &dataset, &e, States::NONE).unwrap();
    assert!(m.settled);
    assert!(
        (m.noise.position[0] / 1e-4 - 1.0).abs() < 0.05,
        "{:?}",
        m.noise
    );
    assert!(m.noise.velocity[0].is_nan());
    assert!(
        rms(&m.w) < 0.01 * rms(&m.total),
        "{} {}",
        rms(&m.w),
        rms(&m.total)
    );
    let inside = share_inside(m.w.iter().copied(), &m.band);
    assert!(inside > 0.9, "{inside}");
}

#[test]
fn the_band_holds_the_missing_force() {
    let (dataset, e) = record(1e-4);
    let mut p = PENDULUM;
    p[2] = 0.0;
    let m = missing_force(&Pendulum, &p, &dataset, &e, States::NONE).unwrap();
    let exact =
        missing_force(&Pendulum, &PENDULUM, &dataset, &record(0.0).1, States::NONE).unwrap();
    let error = m.w.iter().zip(&exact.v).map(|(w, v)| w + PENDULUM[2] * v);
    let inside = share_inside(error, &m.band);
    assert!(
        (0.9..=1.0).contains(&inside),
        "two standard deviations hold 95 %: {inside}"
    );
    assert!(rms(&m.band) < 0.5 * rms(&m.w), "and say something");
}

#[test]
fn a_gap_in_the_record_widens_the_band_there() {
    let (dataset, mut e) = record(1e-4);
    let mut p = PENDULUM;
    p[2] = 0.0;
    e.q[1800..2200].fill(f64::NAN);
    let m = missing_force(&Pendulum, &p, &dataset, &e, States::NONE).unwrap();
    assert!(
        m.band[2000] > 2.0 * m.band[1500],
        "{} {}",
        m.band[2000],
        m.band[1500]
    );
    assert!(m.w.iter().all(|w| w.is_finite()));
}

#[test]
fn a_model_without_mass_is_named() {
    let (dataset, e) = record(0.0);
    let message = missing_force(&Pendulum, &[0.0; 5], &dataset, &e, States::NONE)
        .unwrap_err()
        .to_string();
    assert!(
        message.starts_with("experiment `e`, t = 0.001 s: the model has no finite value"),
        "{message}"
    );
}
