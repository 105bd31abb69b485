//! Fits to records that start with an integral that no sensor reads.

use nalgebra::DVector;
use pid_data::Role;
use pid_diagnose::case::Case;
use pid_diagnose::fit::{Direction, Effort, Fit, Point, all_gains, basis, fit, linearise};
use pid_diagnose::hypothesis::Hypothesis;
use pid_diagnose::predict::Runner;

use super::rig::{BAR, CASCADE, Loop, PID, described, records};
use super::{about, stated_pid};

/// A PID and a cascade as they are stated, their gains off by up to 20 %, with records of each.
fn cases() -> Vec<(Loop, Case)> {
    let [kp, kv, ki] = [about(10.5), about(1.25), about(9.0)];
    let limits = "velocity_limit = 3.0\nlimit = 6.0\n";
    let cascade = format!("law = \"cascade\"\nkp = {kp}\nkv = {kv}\nki = {ki}\n{limits}");
    let of = |(own, drive): (Loop, String)| {
        let dataset = records(&own, None, 0.0, 19);
        let case = Case::new(described(&drive), &dataset);
        (own, case.expect("a case"))
    };
    [(PID, stated_pid()), (CASCADE, cascade)].map(of).into()
}

/// A PID with every stage that may be uncertain, as it is stated.
fn staged() -> (Loop, Case) {
    let own = Loop {
        ahead: Some(0.8),
        speed: Some(1.2),
        acceleration: Some(9.0),
        average: Some(0.05),
        inertia: Some(0.7),
        target_filter: Some(0.04),
        velocity_filter: Some(0.01),
        late: Some(0.0046),
        gravity: Some((0.8, BAR[0])),
        ..PID
    };
    let stages = [
        ("velocity_feed_forward", 0.7),
        ("target_speed", 1.1),
        ("target_acceleration", 8.0),
        ("target_average_s", 0.0433),
        ("inertia_feed_forward", 0.6),
        ("target_filter_s", 0.05),
        ("velocity_filter_s", 0.011),
        // Between two substeps: a reading at the start of one has a slope to either side.
        ("feedback_delay_s", 0.0053),
        ("gravity", 0.9),
    ];
    let stages = stages.map(|(key, value)| format!("{key} = {}\n", about(value)));
    let drive = stated_pid() + &stages.concat();
    let case = Case::new(described(&drive), &records(&own, None, 0.0, 19));
    (own, case.expect("a case"))
}

/// Fitted from the stated values.
fn fitted(case: &Case) -> Fit {
    let at = Point {
        theta: vec![0.0; case.nominal.size()],
        e: Vec::new(),
    };
    let nothing = Hypothesis::default();
    fit(case, &basis(case), &nothing, at, Effort::full(14))
}

/// With integrals that readings correct, slopes along every value are those of the innovations: central differences
/// with the same predictor.
#[test]
fn slopes_are_those_of_the_innovations() {
    const STEP: f64 = 1e-6;
    let nothing = Hypothesis::default();
    for (own, case) in cases().into_iter().chain([staged()]) {
        let at = Point {
            theta: vec![0.0; case.nominal.size()],
            e: Vec::new(),
        };
        let gains = all_gains(&case, &nothing, &at);
        let innovations = |theta: &[f64]| {
            let mut out = Vec::new();
            let train = case.records.iter().zip(&gains);
            for (record, gains) in train.filter(|(record, _)| record.role == Role::Train) {
                let mut runner = Runner::<f64>::new(&case, record, &nothing, theta, &[]);
                runner.predict(gains, &mut |_, _, _, x| out.push(x), &mut |_, _| {});
            }
            DVector::from_vec(out)
        };
        let values = case.nominal.values.iter().enumerate();
        for (i, value) in values.filter(|(_, value)| value.half_width > 0.0) {
            let mut unit = vec![0.0; at.theta.len()];
            unit[i] = 1.0;
            let along = [Direction::Theta(&unit)];
            let slopes = linearise(&case, &nothing, &at, &gains, Role::Train, &along).j;
            let [up, down] = [STEP, -STEP].map(|step| {
                unit[i] = step;
                innovations(&unit)
            });
            let difference = (up - down) / (2.0 * STEP);
            let off = (slopes.column(0) - &difference).norm();
            assert!(
                off < 1e-3 * difference.norm() + 1e-6,
                "{:?} {own:?}: {off} of {}",
                value.role,
                difference.norm()
            );
        }
    }
}

/// Integrals that a fit left behind would let it go on from its own end.
#[test]
fn a_fit_begun_again_stays() {
    for (own, case) in cases() {
        let first = fitted(&case);
        let (nothing, from) = (Hypothesis::default(), first.point.clone());
        let again = fit(&case, &basis(&case), &nothing, from, Effort::full(14));
        let (first, again) = (first.train.objective(), again.train.objective());
        assert!(again > 0.999 * first, "{own:?}: {first} {again}");
    }
}

/// A PID that comes to its limit and leaves it again stops its integral for whole periods: one more or less moves it by
/// more than the motor is disturbed, and a fit would stop there.
#[test]
fn a_fit_behind_a_limit_comes_to_the_noise() {
    for (hz, limit, seed) in [200.0, 1000.0]
        .into_iter()
        .flat_map(|hz| [1.2, 1.7, 2.5].map(|limit| (hz, limit)))
        .flat_map(|(hz, limit)| [19, 20, 21].map(|seed| (hz, limit, seed)))
    {
        let own = Loop {
            ki: 45.0,
            limit: Some(limit),
            hz: Some(hz),
            target_hz: Some(50.0),
            ..PID
        };
        let [kp, kd, ki] = [about(10.5), about(1.0), about(40.0)];
        let stages = format!("limit = {limit}\nrate_hz = {hz:.1}\ntarget_rate_hz = 50.0\n");
        let drive = format!("law = \"pid\"\nkp = {kp}\nkd = {kd}\nki = {ki}\n{stages}");
        let case = Case::new(described(&drive), &records(&own, None, 0.0, seed)).expect("a case");
        let train = fitted(&case).train;
        let most = 1.5 * train.number();
        assert!(
            train.objective() < most,
            "{hz} {limit} {seed}: {} {most}",
            train.objective()
        );
    }
}
