//! The unit of time, from whatever tells it: the stated sample time, the velocities, the torques.

use pid_data::{Dataset, Experiment};

use crate::clock;
use crate::contest::Contest;
use crate::criteria::Settings;
use crate::finding::Finding;
use crate::fix;
use crate::motion::Motion;
use crate::torque::Bench;
use crate::velocity;

/// Median step from which torques are asked for the unit, s: robots are read more often.
const SLOW: f64 = 0.25;

/// Time in another unit than seconds.
pub(crate) fn time(data: &Dataset, bench: Option<&Bench>, settings: &Settings) -> Option<Finding> {
    let criteria = &settings.criteria;
    clock::stated_unit(data, criteria)
        .or_else(|| velocity::time_unit(data, settings))
        .or_else(|| by_torque(data, bench?, settings))
}

fn by_torque(data: &Dataset, bench: &Bench, settings: &Settings) -> Option<Finding> {
    let criteria = &settings.criteria;
    let step = data
        .experiments
        .iter()
        .map(Experiment::sample_time)
        .fold(f64::INFINITY, f64::min);
    if step < SLOW || !step.is_finite() {
        return None;
    }
    let total = |data: &Dataset| {
        let motion = Motion::sample(data, settings);
        let torques = bench.torques(&motion);
        Contest::new(bench, &motion, &torques, criteria).total()
    };
    let before = total(data);
    let (after, finding) = clock::UNITS
        .into_iter()
        .map(|(factor, unit)| {
            let finding = clock::unit_finding(factor, unit);
            let mut mended = data.clone();
            fix::apply(&mut mended, &finding);
            (total(&mended), finding)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    // A step of seconds is suspicious by itself, so that any gain at all decides.
    (after < before - 0.1).then(|| {
        finding.with("median step of t", step, "of t").with(
            "fall of the log of the torque left",
            before - after,
            "1",
        )
    })
}
