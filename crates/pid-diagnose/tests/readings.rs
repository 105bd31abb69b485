//! Readings that are errors of the recording count as missing, those of derived velocities too.

use pid_data::{Dataset, VelocityKind};
use pid_diagnose::case::Case;
use pid_diagnose::nominal::Nominal;

use crate::drawn::first;

/// A bit error in the velocity of a drive that derives it: its position is right.
#[test]
fn a_wrong_reading_of_a_derived_velocity_counts_as_missing() {
    let nothing = first("nothing-readings", |kind| kind.is_none());
    let nominal = Nominal::read(nothing.folder()).expect("a robot");
    let mut dataset = Dataset::read(nothing.folder()).expect("records");
    dataset.joints[0].velocity = VelocityKind::Derived;
    // The reading of a sensor derived from positions without noise of its own.
    for e in &mut dataset.experiments {
        let v: Vec<f64> = (0..e.len())
            .map(|k| match k {
                0 => 0.0,
                k => (e.q[k] - e.q[k - 1]) / (e.t[k] - e.t[k - 1]),
            })
            .collect();
        e.v = Some(v);
    }
    let clean = Case::new(nominal.clone(), &dataset).expect("a case");
    let odd = |case: &Case| {
        let all = case.outliers.iter();
        all.filter(|o| format!("{:?}", o.channel) == "Velocity")
            .map(|o| (o.record.clone(), o.t))
            .collect::<Vec<_>>()
    };
    assert_eq!(odd(&clean), []);

    let spoilt = dataset.experiments.len() - 1;
    let e = &mut dataset.experiments[spoilt];
    let v = e.v.as_mut().expect("velocities");
    let fastest = |v: &[f64]| v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let (at, size) = (v.len() / 2, fastest(v));
    v[at] += 2.0 * size;
    let (name, t) = (e.name.clone(), e.t[at]);
    let case = Case::new(nominal, &dataset).expect("a case");
    assert_eq!(odd(&case), [(name, t)]);
    let record = case.records.last().expect("records");
    assert!(record.v[0][at].is_nan(), "{}", record.v[0][at]);
    assert!(record.q[0][at].is_finite());
}
