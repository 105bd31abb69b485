//! Channels judged by themselves: whether the velocity reading follows from the positions as
//! stated, and when the input acts.

use pid_data::signal;
use pid_interpret::Model;
use pid_runtime::dynamics::{At, Dynamics};
use serde::{Deserialize, Serialize};

use crate::case::{Case, Record, Velocity, smoothed};
use crate::criteria::Criteria;
use crate::levels::shared;
use crate::timing::{Alignment, Channels, align, golden};

/// Check of the velocity channel of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Consistency {
    /// Root mean square mismatch between the reading and the velocity that the stated filter makes
    /// of the positions, relative to the standard deviation of the reading.
    pub mismatch: f64,
    /// The same with an additional first-order lag.
    pub with_lag: f64,
    /// Time constant of that lag, s.
    pub lag: f64,
    /// Its standard deviation, from the remaining mismatch and how long that keeps its sign, s.
    pub lag_std: Option<f64>,
    /// Whether the plain mismatch is more than rounding can explain.
    pub lagging: bool,
}

/// Range of time constants in which a lag is sought, s, and steps of the search over their
/// logarithm.
const SHORTEST: f64 = 1e-4;
const LONGEST: f64 = 0.5;
const STEPS: usize = 40;

/// Judges every joint with a derived velocity whose filter is stated; `None` for the others.
pub fn consistency(case: &Case, criteria: &Criteria) -> Vec<Option<Consistency>> {
    (0..case.n())
        .map(|j| {
            let hz = case.nominal.velocity_filter_hz?;
            if case.velocity[j] != Velocity::Derived {
                return None;
            }
            let known = case.known.parameters("velocity_filter_lag", j);
            let plain = mismatch(case, j, hz, known.map_or(0.0, |e| e[0]));
            let left = |log: f64| mismatch(case, j, hz, log.exp());
            let lag = golden(STEPS, (SHORTEST.ln(), LONGEST.ln()), left).exp();
            let with_lag = mismatch(case, j, hz, lag);
            Some(Consistency {
                mismatch: plain,
                with_lag,
                lag,
                lag_std: deviation(case, j, hz, lag),
                lagging: plain > criteria.reading_mismatch
                    && with_lag < criteria.lag_leaves * plain,
            })
        })
        .collect()
}

/// Root mean square mismatch with a lag, relative to the reading.
fn mismatch(case: &Case, j: usize, hz: f64, lag: f64) -> f64 {
    let (mut square, mut size) = (0.0, 0.0);
    passed(case, j, hz, lag, |error, _, v| {
        square += error * error;
        size += v * v;
    });
    (square / f64::max(size, 1e-300)).sqrt()
}

/// Deviation of the lag by a Gauss-Newton step.
fn deviation(case: &Case, j: usize, hz: f64, lag: f64) -> Option<f64> {
    let (mut errors, mut curvature) = (Vec::new(), 0.0);
    passed(case, j, hz, lag, |error, slope, _| {
        errors.push(error);
        curvature += slope * slope;
    });
    let square: f64 = errors.iter().map(|e| e * e).sum();
    let level = square / errors.len() as f64 * shared(&errors);
    let std = (level / curvature).sqrt();
    std.is_finite().then_some(std)
}

/// Velocity that the stated filter and a lag make of the positions less the reading, its derivative
/// by the lag, and the reading.
fn passed(case: &Case, j: usize, hz: f64, lag: f64, mut each: impl FnMut(f64, f64, f64)) {
    for r in &case.records {
        let fade = (-2.0 * std::f64::consts::PI * hz * r.h).exp();
        let (late, later) = if lag > 0.0 {
            let late = (-r.h / lag).exp();
            (late, late * r.h / (lag * lag))
        } else {
            (0.0, 0.0)
        };
        let (mut w, mut x, mut slope) = (r.v[j][0], r.v[j][0], 0.0);
        for k in 1..r.len() {
            let (q, before, v) = (r.q[j][k], r.q[j][k - 1], r.v[j][k]);
            if !(q.is_finite() && before.is_finite() && v.is_finite()) {
                continue;
            }
            w = fade * w + (1.0 - fade) * (q - before) / r.h;
            slope = late * slope + later * (x - w);
            x = late * x + (1.0 - late) * w;
            if k as f64 * r.h > 0.3 {
                each(x - v, slope, v);
            }
        }
    }
}

/// Delay and factor of the velocity reading of one joint against the derivative of its positions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Its delay; the stated delay is that of the difference and of the stated filter.
    #[serde(flatten)]
    pub timing: Alignment,
    /// Factor of the reading on the derivative of the position.
    pub scale: f64,
}

/// Compares every recorded velocity with the derivative of its positions, whatever it was made
/// from; `None` where there is no velocity.
pub fn readings(case: &Case) -> Vec<Option<Reading>> {
    (0..case.n())
        .map(|j| match case.velocity[j] {
            Velocity::Absent => None,
            kind => reading(case, j, kind == Velocity::Derived),
        })
        .collect()
}

fn reading(case: &Case, j: usize, derived: bool) -> Option<Reading> {
    let records: Vec<Channels> = case.records.iter().map(|r| channels(r, j)).collect();
    let stated = match derived {
        // A difference shows the middle of its step; a first-order filter is late by its time constant.
        true => case.records.first().map_or(0.0, |r| {
            let filter = case.nominal.velocity_filter_hz;
            let fade = filter.map_or(0.0, |hz| (-2.0 * std::f64::consts::PI * hz * r.h).exp());
            r.h * (0.5 + fade / (1.0 - fade))
        }),
        false => 0.0,
    };
    // The reading is moved back to the positions: a shift of −τ.
    let mut timing = align(records, -stated)?;
    let scale = -timing.columns.first().copied()?;
    timing.delay = -timing.delay;
    timing.stated = stated;
    // A lag of the positions is none of the reading.
    timing.lag = None;
    timing.curve = timing.curve.iter().rev().map(|(t, x)| (-t, *x)).collect();
    Some(Reading { timing, scale })
}

/// Joints whose measured velocity shows later than the filter that all of them share, beyond chance
/// and by enough to matter.
pub(crate) fn late_readings(case: &Case) -> Vec<usize> {
    let late = |r: &Reading| r.timing.noticeable() && r.timing.later_than(case.shared_lag);
    (0..case.n())
        .filter(|&j| case.velocity[j] == Velocity::Measured)
        .filter(|&j| reading(case, j, false).is_some_and(|r| late(&r)))
        .collect()
}

/// Joints whose input acts later than stated, beyond chance and by enough to matter, with its
/// timing; the parameters lie `theta` half tolerances from their nominal values.
pub(crate) fn late_inputs(case: &Case, theta: &[f64]) -> Vec<(usize, Alignment)> {
    // Where the structure cannot be evaluated no signal shows anything.
    let all = inputs(case, theta).unwrap_or_default().into_iter();
    let found = all.enumerate().filter_map(|(j, a)| Some((j, a?)));
    found.filter(|(_, a)| a.noticeable() && a.late()).collect()
}

/// Fewest joints whose velocities tell a filter of the recording from a lag of one sensor.
const SEVERAL: usize = 2;

/// Time constant of a first-order filter that the measured velocities of all joints share, s; else
/// zero. The firmware that records a robot filters all its velocities alike, a lag of one sensor
/// comes on top.
pub fn shared_lag(case: &Case) -> f64 {
    let Some(h) = case.records.first().map(|r| r.h) else {
        return 0.0;
    };
    let measured = (0..case.n()).filter(|&j| case.velocity[j] == Velocity::Measured);
    let readings: Vec<Reading> = measured.filter_map(|j| reading(case, j, false)).collect();
    common_lag(h, &readings)
}

/// The smallest lag of velocity readings as the time constant of a filter, if each is late beyond
/// chance; else zero, s.
fn common_lag(h: f64, readings: &[Reading]) -> f64 {
    if readings.len() < SEVERAL || !readings.iter().all(|r| r.timing.late()) {
        return 0.0;
    }
    let all = readings.iter().map(|r| r.timing.delay);
    let delay = all.fold(f64::INFINITY, f64::min);
    // Far below its corner the filter w⁺ = a w + (1 − a) v⁺ with a = exp(−h/T) is late by h a/(1 − a).
    h / (h / delay).ln_1p()
}

/// One line on a filter that all velocities share, if they do.
pub(crate) fn shared_lag_warning(case: &Case) -> Option<String> {
    (case.shared_lag > 0.0).then(|| {
        format!(
            "velocities of all joints show {:.1} ms late: taken as a filter of the recording, not as a cause",
            1e3 * case.shared_lag
        )
    })
}

/// The reading, and the derivative of the positions with an offset beside it.
fn channels(r: &Record, j: usize) -> Channels {
    let t: Vec<f64> = (0..r.len()).map(|k| k as f64 * r.h).collect();
    let whole = |x: &Vec<f64>| {
        let mut x = x.clone();
        signal::fill_missing(&t, &mut x);
        x
    };
    Channels {
        h: r.h,
        still: vec![0.0; r.len()],
        shifted: whole(&r.v[j]),
        beside: vec![
            signal::central_differences(&t, &whole(&r.q[j])),
            vec![1.0; r.len()],
        ],
    }
}

/// Beside a shift, dry friction reaches three quarters of its level at this share of the largest
/// speed.
const REST: f64 = 0.02;

/// When the input of each joint acts: compares the drive's force with the force that the motion
/// takes under the nominal structure, on all records. The parameters lie `theta` half tolerances
/// from their nominal values. `None` where the records do not determine it.
///
/// Offset, viscous and dry friction, a spring, gravity, inertia (and with these the gain of the
/// drive) and the accelerations of all joints are free beside the shift, so that their errors do
/// not pass for a delay.
///
/// # Errors
/// If the structure has no equations that can be evaluated.
pub fn inputs(case: &Case, theta: &[f64]) -> Result<Vec<Option<Alignment>>, pid_interpret::Error> {
    let n = case.n();
    let model = Model::new(case.nominal.description.robot())?;
    let p = case.nominal.parameters(theta);
    let mut channels = vec![Vec::new(); n];
    for r in &case.records {
        let t: Vec<f64> = (0..r.len()).map(|k| k as f64 * r.h).collect();
        let a = r.accelerations();
        let mut forces = vec![[const { Vec::new() }; 3]; n];
        let (mut force, none) = (vec![0.0; n], vec![0.0; model.dims().nu]);
        for k in 0..t.len() {
            let row = |x: &[Vec<f64>]| -> Vec<f64> { x.iter().map(|x| x[k]).collect() };
            let (q, v, a, zero) = (row(&r.smooth_q), row(&r.smooth_v), row(&a), vec![0.0; n]);
            // Without input the residual is the force that the drives bring: in full, at rest, and
            // for acceleration from rest.
            for (part, (v, a)) in [(&v, &a), (&zero, &zero), (&zero, &a)]
                .into_iter()
                .enumerate()
            {
                let at = At {
                    q: &q,
                    v,
                    a,
                    u: &none,
                    p: &p,
                };
                model.residual(&at, &mut force);
                forces
                    .iter_mut()
                    .zip(&force)
                    .for_each(|(all, f)| all[part].push(*f));
            }
        }
        for (j, forces) in forces.into_iter().enumerate() {
            channels[j].push(drive(case, r, (&t, &a, forces), j));
        }
    }
    Ok(channels.into_iter().map(|c| align(c, 0.0)).collect())
}

/// Force of the drive of a joint, the `force` that the motion takes, and the free columns.
fn drive(
    case: &Case,
    r: &Record,
    (t, a, [whole, rest, pushed]): (&[f64], &[Vec<f64>], [Vec<f64>; 3]),
    j: usize,
) -> Channels {
    // Beside the target of a position loop the position and velocity that it reads are free.
    let gain = case.force_per_input(r, j);
    // Under a hold, the mean of the inputs before and after a sample acts about it.
    let acts: Vec<f64> = (0..r.len())
        .map(|k| match case.linear_hold {
            true => gain * r.u[j][k],
            false => 0.5 * gain * (r.u[j][k.max(1) - 1] + r.u[j][k]),
        })
        .collect();
    // The forces come from positions through this filter.
    let acts = smoothed(t, acts).0;
    let (q, v) = (&r.smooth_q[j], &r.smooth_v[j]);
    let slow = REST * case.scale[j].speed;
    let mut beside = vec![
        vec![1.0; q.len()],
        rest,
        pushed,
        v.iter().map(|v| (v / slow).tanh()).collect(),
        q.clone(),
        v.clone(),
    ];
    beside.extend(a.iter().cloned());
    // At rest dry friction takes any value.
    let still = whole.iter().zip(v);
    let still = still.map(|(f, v)| if v.abs() > slow { *f } else { f64::NAN });
    Channels {
        h: r.h,
        still: still.collect(),
        shifted: acts,
        beside,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{Draw, SIZE, named, pendulum};

    const NOMINAL: [f64; SIZE] = [0.0; SIZE];

    fn input_and_reading(effects: &[&str], e: &[f64]) -> (Alignment, Reading) {
        judged(&pendulum(&named(effects), e, 6.0, &|_| {}))
    }

    fn judged(case: &Case) -> (Alignment, Reading) {
        let mut input = inputs(case, &NOMINAL).expect("equations");
        let mut reading = readings(case);
        let found = (input.remove(0), reading.remove(0));
        (
            found.0.expect("a moving joint"),
            found.1.expect("a velocity"),
        )
    }

    #[test]
    fn a_robot_as_stated_has_no_delay() {
        let (input, reading) = input_and_reading(&[], &[]);
        assert!(input.delay.abs() < 3e-4 && !input.noticeable(), "{input:?}");
        assert!(!reading.timing.noticeable());
        assert!((reading.scale - 1.0).abs() < 2e-3, "{}", reading.scale);
    }

    #[test]
    fn an_input_that_acts_late_is_timed() {
        for late in [0.003, 0.011] {
            let (input, reading) = input_and_reading(&["input_delay"], &[late]);
            assert!((input.delay - late).abs() < 4e-4, "{input:?}");
            assert!(input.noticeable() && !reading.timing.noticeable());
        }
    }

    #[test]
    fn friction_off_its_nominal_value_is_no_delay() {
        let case = pendulum(&named(&[]), &[], 6.0, &|_| {});
        // Half a tolerance of everything.
        let theta = [1.0; SIZE];
        let input = inputs(&case, &theta).expect("equations").remove(0);
        let input = input.expect("a moving joint");
        assert!(input.delay.abs() < 4e-4 && !input.noticeable(), "{input:?}");
    }

    #[test]
    fn the_lag_of_a_derived_velocity_has_a_deviation() {
        let (hz, lag) = (40.0, 0.015);
        let mut inside = 0;
        for seed in 0..20 {
            let mut case = pendulum(&named(&[]), &[], 3.0, &|_| {});
            case.velocity[0] = Velocity::Derived;
            case.nominal.velocity_filter_hz = Some(hz);
            let mut draw = Draw::new(seed);
            for r in &mut case.records {
                let fade = (-2.0 * std::f64::consts::PI * hz * r.h).exp();
                let late = (-r.h / lag).exp();
                let (mut w, mut x) = (0.0, 0.0);
                for k in 1..r.len() {
                    w = fade * w + (1.0 - fade) * (r.q[0][k] - r.q[0][k - 1]) / r.h;
                    x = late * x + (1.0 - late) * w;
                    r.v[0][k] = x + 0.05 * draw.next();
                }
            }
            let found = consistency(&case, &Criteria::default())[0]
                .clone()
                .expect("derived");
            let std = found.lag_std.expect("moving");
            assert!(found.lagging && (found.lag - lag).abs() < 1e-3, "{found:?}");
            inside += u32::from((found.lag - lag).abs() < 2.0 * std);
        }
        assert!((16..=20).contains(&inside), "{inside} of 20");
    }

    /// A pendulum whose velocities show through a filter of this time constant, s.
    fn filtered(lag: f64) -> Case {
        let mut case = pendulum(&named(&[]), &[], 6.0, &|_| {});
        for r in &mut case.records {
            let fade = (-r.h / lag).exp();
            let mut shown = r.v[0][0];
            for v in &mut r.v[0] {
                shown = fade * shown + (1.0 - fade) * *v;
                *v = shown;
            }
        }
        case
    }

    #[test]
    fn a_filter_that_all_velocities_share_is_the_smallest_of_their_lags() {
        let of = |case: &Case| reading(case, 0, false).expect("a velocity");
        let h = 2e-3;
        let [short, long] = [0.012, 0.02].map(|lag| of(&filtered(lag)));
        let none = of(&pendulum(&named(&[]), &[], 6.0, &|_| {}));
        let shared = common_lag(h, &[long.clone(), short.clone()]);
        assert!((shared - 0.012).abs() < 2e-4, "{shared}");
        // One joint cannot tell, and one that shows at once denies it.
        assert_eq!(common_lag(h, std::slice::from_ref(&short)), 0.0);
        assert_eq!(common_lag(h, &[long, none]), 0.0);
    }

    #[test]
    fn a_velocity_that_shows_late_is_timed() {
        let case = filtered(0.012);
        let (input, reading) = judged(&case);
        assert!(!input.noticeable());
        // Motions far below the corner of this recursion show late by h a/(1 − a).
        let fade = (-2e-3_f64 / 0.012).exp();
        let late = 2e-3 * fade / (1.0 - fade);
        let found = reading.timing.delay;
        assert!((found - late).abs() < 2e-4, "{found} {late}");
        assert!(reading.timing.noticeable() && reading.timing.left > 0.01);
    }
}
