//! Unknown gains of position loops whose range about their start is too narrow.
//!
//! A gain that is not stated may lie anywhere, and a fit has ranges. Where the fit of the nominal structure ends at
//! the end of the range of such a gain, the range moves there, until no gain is held by it.

use pid_interpret::nominal::{Gain, Role as Part, ServoGain};

use super::begin::reach;
use crate::case::Case;
use crate::fit::{Effort, Point, basis, fit};
use crate::hypothesis::Hypothesis;
use crate::nominal::Nominal;

/// Deviation, in ranges, from which a gain counts as held by its range.
const HELD: f64 = 0.999;
/// A range that moves up has its middle so many times as far as its end was: it reaches 3.6 times as far.
const UP: f64 = 1.9;
/// Moves at most before the search: the last range reaches 90 times as far as the first.
const MOVES: usize = 4;
/// Steps of each fit: what is asked is whether it runs against a range.
const STEPS: usize = 8;
/// Fits at most: one that neither rests nor is held by a range goes on.
const FITS: usize = 8;
/// Share of a range below which a gain counts as none: the range would vanish with it.
const NONE: f64 = 1e-3;

/// A case whose unknown gains have ranges that hold the fit of the nominal structure; `None` where they have as
/// it is.
pub(crate) fn centred(case: &Case) -> Option<Case> {
    if unknown(&case.nominal).is_empty() {
        return None;
    }
    let mut out = case.clone();
    let mut moves = 0;
    let mut theta = vec![0.0; case.nominal.size()];
    for _ in 0..FITS {
        let at = Point {
            theta,
            e: Vec::new(),
        };
        let effort = Effort::on_the_way(STEPS);
        let found = fit(&out, &basis(&out), &Hypothesis::default(), at, effort);
        theta = found.point.theta;
        if moves < MOVES && moved(&mut out.nominal, &mut theta) {
            moves += 1;
        } else if found.steps < STEPS {
            break;
        }
    }
    (moves > 0).then_some(out)
}

/// A case whose ranges of unknown gains have moved to where a fit with deviations `theta` ran against them;
/// `None` where it did not.
pub(crate) fn recentred(case: &Case, theta: &[f64]) -> Option<Case> {
    let mut out = case.clone();
    moved(&mut out.nominal, &mut theta.to_vec()).then_some(out)
}

/// Moves the ranges of unknown gains that hold a fit, and its deviations with them; whether there are any.
fn moved(nominal: &mut Nominal, theta: &mut [f64]) -> bool {
    let mut any = false;
    for (joint, gain, place) in unknown(nominal) {
        let own = &nominal.values[place];
        let end = own.nominal + own.half_width * theta[place];
        if theta[place].abs() < HELD || end.abs() < NONE * own.half_width {
            continue;
        }
        let middle = match end.abs() > own.nominal.abs() {
            true => UP * end,
            false => end,
        };
        let half_width = reach(gain, middle.abs());
        let value = Some(middle);
        let start = ServoGain { value, half_width };
        nominal.begin_servo(joint, gain, start);
        theta[place] = (end - middle) / half_width;
        any = true;
    }
    any
}

/// Joints, gains and places of the values that are not stated.
fn unknown(nominal: &Nominal) -> Vec<(usize, Gain, usize)> {
    let looped = (0..nominal.n()).filter_map(|j| Some((j, nominal.description.servo(j)?)));
    let each = looped.flat_map(|(j, servo)| {
        let open = servo.gains().filter(|&g| servo.gain(g).value.is_none());
        open.filter_map(move |g| Some((j, g, nominal.place(j, Part::Servo(g))?)))
    });
    each.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bar behind a loop whose kp is unknown and whose kd is stated.
    const BAR: &str = r#"
        [robot]
        name = "bar"
        gravity = [0.0, 0.0, -9.81]
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
        origin = [0.0, 0.0, 0.0]
        mass = 1.0
        com = [0.0, 0.0, -0.1]
        inertia = [0.01, 0.01, 0.001, 0.0, 0.0, 0.0]
        rotor_inertia = 0.01
        coulomb = 0.1
        viscous = 0.1
        motor_gain = 1.0
        input = "torque"
        velocity = "absent"
        [joint.drive]
        law = "pd"
        kp = { unknown = true }
        kd = { value = 0.5, tolerance = 0.1 }
    "#;

    #[test]
    fn a_range_moves_where_a_fit_runs_against_it() {
        let mut bar = Nominal::parse(BAR, "nominal.toml".as_ref()).expect("a description");
        let begun = |value: f64| ServoGain {
            value: Some(value),
            half_width: reach(Gain::Kp, value),
        };
        bar.begin_servo(0, Gain::Kp, begun(2.0));
        let open = unknown(&bar);
        let [(0, Gain::Kp, kp)] = open[..] else {
            panic!("{open:?}")
        };
        let mut theta = vec![0.0; bar.size()];
        assert!(!moved(&mut bar, &mut theta), "nothing holds it");
        let kd = bar.place(0, Part::Servo(Gain::Kd)).expect("a gain");
        theta[kd] = 1.0;
        assert!(!moved(&mut bar, &mut theta), "kd is stated");
        // From 0.2 to 3.8 about 2.
        for (end, ended, most) in [(1.0, 3.8, 3.8 * 1.9 * 1.9), (-1.0, 0.2, 0.2 * 1.9)] {
            let (mut out, mut theta) = (bar.clone(), theta.clone());
            theta[kp] = end;
            assert!(moved(&mut out, &mut theta));
            let own = &out.values[kp];
            let reached = own.nominal + own.half_width;
            assert!((reached / most - 1.0).abs() < 1e-9, "{reached} {most}");
            // The fit goes on from where it ended.
            let value = own.nominal + own.half_width * theta[kp];
            assert!((value / ended - 1.0).abs() < 1e-9, "{value} {ended}");
        }
    }
}
