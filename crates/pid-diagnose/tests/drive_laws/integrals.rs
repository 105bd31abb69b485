//! Fits to records that start with an integral that no sensor reads.

use nalgebra::DVector;
use pid_data::Role;
use pid_diagnose::case::Case;
use pid_diagnose::fit::{Direction, Effort, Fit, Point, all_gains, basis, fit, linearise};
use pid_diagnose::hypothesis::Hypothesis;
use pid_diagnose::predict::Runner;
use pid_interpret::nominal::{Gain, Role as Part};

use super::rig::{CASCADE, Loop, PID, described, records};
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

/// Innovations on the train records at deviations `theta`, with the predictor of a point and its integrals, or those
/// that are found `anew`.
fn innovations(case: &Case, theta: &[f64], at: &Point, anew: bool) -> DVector<f64> {
    let nothing = Hypothesis::default();
    let mut gains = all_gains(case, &nothing, at);
    if anew {
        let (theta, e) = (theta.to_vec(), Vec::new());
        let found = all_gains(case, &nothing, &Point { theta, e });
        for (own, found) in gains.iter_mut().flatten().zip(found.iter().flatten()) {
            own.hidden = found.hidden;
        }
    }
    let mut out = Vec::new();
    let train = case.records.iter().zip(&gains);
    for (record, gains) in train.filter(|(record, _)| record.role == Role::Train) {
        let mut runner = Runner::<f64>::new(case, record, &nothing, theta, &[]);
        runner.predict(gains, &mut |_, _, _, x| out.push(x), &mut |_, _| {});
    }
    DVector::from_vec(out)
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

/// Slopes along the mass and the gain of the integral are nearer to differences with integrals found anew than to those
/// with integrals that stay. They do not agree with either: integrals are found in the first second, slopes let them
/// follow all of a record. Along friction and the other gains differences depend on where the joint sticks.
#[test]
fn integrals_follow_the_parameters() {
    const STEP: f64 = 0.05;
    for (own, case) in cases() {
        let Fit { point: at, .. } = fitted(&case);
        let nothing = Hypothesis::default();
        let gains = all_gains(&case, &nothing, &at);
        for part in [Part::Mass, Part::Servo(Gain::Ki)] {
            let i = case.nominal.place(0, part).expect("a value");
            let mut unit = vec![0.0; at.theta.len()];
            unit[i] = 1.0;
            let directions = [Direction::Theta(&unit)];
            let lin = linearise(&case, &nothing, &at, &gains, Role::Train, &directions);
            let difference = |anew: bool| {
                let [up, down] = [STEP, -STEP].map(|step| {
                    let mut theta = at.theta.clone();
                    theta[i] += step;
                    innovations(&case, &theta, &at, anew)
                });
                (up - down) / (2.0 * STEP)
            };
            let [anew, held] =
                [true, false].map(|anew| (lin.j.column(0) - difference(anew)).norm());
            assert!(anew < 0.7 * held, "{part:?} {own:?}: {anew} {held}");
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
