//! Equations behind loops: derivatives against differences, laws and stages by hand.

use pid_data::{Dataset, InputHold, InputQuantity};
use pid_interpret::nominal::{self as description, Servo, ServoGain, ServoLaw};

use super::*;
use crate::described::in_loops;
use crate::with_effects::tests::{ARM, assert_derivatives, at, model, point, records};

/// The loop of a law with its gains in the order of the law.
fn loop_of(law: ServoLaw, gains: &[f64], limit: Option<f64>) -> Servo {
    let mut servo = Servo::new(law);
    for (&gain, &value) in law.gains().iter().zip(gains) {
        let stated = ServoGain {
            value: Some(value),
            half_width: 0.3 * value,
        };
        servo.set(gain, stated);
    }
    servo.limit = limit;
    servo
}

/// The arm behind loops: one with an integral at the shoulder, PD at the elbow, both within a limit if
/// there is one.
fn behind_loops(law: ServoLaw, limit: Option<f64>) -> (WithLoops<'static>, Dataset) {
    let first = loop_of(law, &[3.0, 0.4, 1.5], limit);
    let pd = loop_of(ServoLaw::Pd, &[2.0, 0.3], limit);
    let mut dataset = records();
    for joint in &mut dataset.joints {
        (joint.input, joint.input_unit) = (InputQuantity::Position, "rad".to_owned());
    }
    let model = WithLoops::new(
        model(),
        &[Some(&first), Some(&pd)],
        &described(PD),
        &mut dataset,
    );
    (model, dataset)
}

#[test]
fn derivatives_behind_loops_are_those_of_differences() {
    for law in [ServoLaw::Pid, ServoLaw::Cascade] {
        for limit in [None, Some(1.3)] {
            let (with, dataset) = behind_loops(law, limit);
            dataset.check_model(&with).expect("columns for all");
            let d = with.dims();
            let free: Vec<usize> = (0..d.u() + 2).chain(d.p()..d.nz()).collect();
            for speed in [1.0, 0.1] {
                assert_derivatives("loops", &with, &point(&with, speed), &free);
            }
        }
    }
}

/// The residual of the arm itself under inputs of its motors, where the arm behind loops is at `here`.
pub(super) fn arm_under(here: &At<'_>, u: &[f64]) -> Vec<f64> {
    let (arm, mut r) = (model(), vec![0.0; 2]);
    let inside = At {
        q: &here.q[..2],
        v: &here.v[..2],
        a: &here.a[..2],
        u,
        p: &here.p[..arm.dims().np],
    };
    arm.residual(&inside, &mut r);
    r
}

/// Gains of the arm's motors.
pub(super) fn motor_gains(here: &At<'_>) -> [f64; 2] {
    ["gain_shoulder", "gain_elbow"].map(|name| {
        let k = model().params().iter().position(|p| p.name == name);
        here.p[k.expect("a gain")]
    })
}

/// The equations are those of the arm under the inputs of the drives' own laws, here by hand.
#[test]
fn loops_are_the_laws_of_the_drives() {
    for law in [ServoLaw::Pid, ServoLaw::Cascade] {
        let (with, _) = behind_loops(law, None);
        let (d, own) = (with.dims(), model().dims());
        assert_eq!((d.nq, d.nu, d.np), (own.nq + 1, own.nu + 1, own.np + 5));
        let z = point(&with, 1.0);
        let here = at(&z, &d);
        let error = [here.u[0] - here.q[0], here.u[1] - here.q[1]];
        let lack = 3.0 * error[0] - here.v[0];
        // The integral is the velocity of the third coordinate. A cascade has kp, kv, ki.
        let (first, rate) = match law {
            ServoLaw::Cascade => (0.4 * lack, 1.5 * lack),
            _ => (3.0 * error[0] - 0.4 * here.v[0], 1.5 * error[0]),
        };
        let u = [first + here.v[2], 2.0 * error[1] - 0.3 * here.v[1]];
        let expected = arm_under(&here, &u);
        let mut r = vec![0.0; 3];
        with.residual(&here, &mut r);
        for j in 0..2 {
            assert!((r[j] - expected[j]).abs() < 1e-12, "{r:?} {expected:?}");
        }
        assert!((r[2] - (here.a[2] - rate)).abs() < 1e-14, "{r:?}");
        let (mut m, mut b, mut f) = (vec![0.0; d.nm()], vec![0.0; 3], vec![0.0; 3]);
        with.mass_matrix(&here, &mut m);
        with.bias(&here, &mut b);
        with.applied_force(&here, &mut f);
        assert_eq!((&m[3..], b[2]), (&[0.0, 0.0, 1.0][..], 0.0));
        assert!((f[2] - rate).abs() < 1e-14);
        // At the limit nothing pushes further, and the integral rests.
        let (limited, _) = behind_loops(law, Some(1e-3));
        limited.residual(&here, &mut r);
        assert!((r[2] - here.a[2]).abs() < 1e-3 * rate.abs(), "{r:?}");
    }
}

/// The arm's records with targets as inputs.
pub(super) fn targets() -> Dataset {
    let mut dataset = records();
    for joint in &mut dataset.joints {
        (joint.input, joint.input_unit) = (InputQuantity::Position, "rad".to_owned());
    }
    dataset
}

/// The arm behind the loops of a text of `[drive]`.
pub(super) fn described(drive: &str) -> description::Nominal {
    let text = format!("{ARM}\n[drive]\n{drive}");
    description::Nominal::parse("arm.toml", &text).expect(&text)
}

/// The same around the arm alone, with the records as they become.
fn behind(drive: &str) -> (WithLoops<'static>, Dataset) {
    let (nominal, mut dataset) = (described(drive), targets());
    let servos = [nominal.servo(0), nominal.servo(1)];
    let with = WithLoops::new(model(), &servos, &nominal, &mut dataset);
    dataset.check_model(&with).expect("columns for all");
    (with, dataset)
}

pub(super) const PD: &str =
    "law = \"pd\"\nkp = { value = 3.0, tolerance = 1.0 }\nkd = { value = 0.4, tolerance = 0.1 }\n";
pub(super) const CASCADE: &str = "law = \"cascade\"\nkp = 3.0\nkv = 0.4\nki = 1.5\n";
pub(super) const PID: &str = "law = \"pid\"\nkp = 3.0\nkd = 0.4\nki = 1.5\n";
const WEIGHED: &str = "gravity = { value = 0.8, tolerance = 0.2 }\n";
const AHEAD: &str = "velocity_feed_forward = { value = 0.6, tolerance = 0.3 }\n";
const FILTER: &str = "velocity_filter_s = { value = 0.05, tolerance = 0.02 }\n";

#[test]
fn derivatives_behind_stages_are_those_of_differences() {
    for (law, stages) in [
        (PD, AHEAD),
        (PD, FILTER),
        (PD, "dead_band = 0.2\n"),
        (
            PD,
            "dead_band = 0.2\nlimit = 1.3\nvelocity_feed_forward = 0.7\n",
        ),
        (CASCADE, "velocity_limit = 0.9\n"),
        (PD, WEIGHED),
        (
            PD,
            "stall = 2.0\nno_load_speed = 1.5\nvelocity_filter_s = 0.05\n",
        ),
        (
            CASCADE,
            "gravity = { value = 0.8, tolerance = 0.2 }\nlimit = 1.3\n",
        ),
        (CASCADE, "integral_limit = 1.1\n"),
        (PID, "integral_limit = 1.1\nlimit = 1.3\n"),
        (
            PD,
            "feedback_delay_s = { value = 0.05, tolerance = 0.02 }\ngravity = 0.8\n",
        ),
        (
            PD,
            "inertia_feed_forward = { value = 0.7, tolerance = 0.3 }\n",
        ),
    ] {
        for joint in [0, 1] {
            let (nominal, mut dataset) = (described(&format!("{law}{stages}")), targets());
            // One coordinate more at most, as the weights of the check have it.
            let servos = [0, 1].map(|j| nominal.servo(j).filter(|_| j == joint));
            let with = WithLoops::new(model(), &servos, &nominal, &mut dataset);
            let d = with.dims();
            let free: Vec<usize> = (0..d.nz()).collect();
            for speed in [1.0, 0.1] {
                assert_derivatives(
                    &format!("{law}{stages}"),
                    &with,
                    &point(&with, speed),
                    &free,
                );
            }
        }
    }
}

/// Gains of a record that are four and a half and three times the described ones are those of a drive that has them.
#[test]
fn gains_by_record_are_factors_of_the_described_ones() {
    let rules = ["*=kp:4", "*=kd:0.5", "*=ki:3", "*=kv:0.5"].map(|rule| rule.parse());
    let rules: Vec<_> = rules
        .into_iter()
        .map(|rule| rule.expect("a rule"))
        .collect();
    for (law, other) in [
        (
            PD,
            "law = \"pd\"\nkp = { value = 12.0, tolerance = 1.0 }\nkd = { value = 0.2, tolerance = 0.1 }\n",
        ),
        (PID, "law = \"pid\"\nkp = 12.0\nkd = 0.2\nki = 4.5\n"),
        (
            CASCADE,
            "law = \"cascade\"\nkp = 12.0\nkv = 0.2\nki = 4.5\n",
        ),
    ] {
        let nominal = described(law);
        let mut dataset = targets().with_gain_factors(&rules).expect("factors");
        let servos = [nominal.servo(0), None];
        let with = WithLoops::new(model(), &servos, &nominal, &mut dataset);
        let d = with.dims();
        let factors = &[4.0, 0.5, 3.0][..nominal.servo(0).expect("a loop").law.gains().len()];
        let last = d.nu - factors.len();
        assert_eq!(dataset.experiments[0].u[last..d.nu], *factors);
        let mut z = point(&with, 1.0);
        let free: Vec<usize> = (0..d.nz()).collect();
        assert_derivatives(law, &with, &z, &free);
        z[d.u() + last..d.u() + d.nu].copy_from_slice(factors);
        let (stated, mut plain) = (described(other), targets());
        let servos = [stated.servo(0), None];
        let multiplied = WithLoops::new(model(), &servos, &stated, &mut plain);
        let few = multiplied.dims();
        assert_eq!(few.nu, last);
        let mut y: Vec<f64> = z[..d.u() + last].to_vec();
        y.extend(&z[d.p()..]);
        for gain in stated.servo(0).expect("a loop").law.gains() {
            let name = gain_name(*gain, "shoulder");
            let place = multiplied.params().iter().position(|p| p.name == name);
            let place = few.p() + place.expect("a gain");
            y[place] *= dataset.experiments[0].gain_factors.at(*gain as usize, 0);
        }
        let (mut r, mut expected) = (vec![0.0; d.nq], vec![0.0; few.nq]);
        with.residual(&at(&z, &d), &mut r);
        multiplied.residual(&at(&y, &few), &mut expected);
        for (r, expected) in r.iter().zip(&expected) {
            assert!((r - expected).abs() < 1e-12, "{law}: {r} {expected}");
        }
    }
}

/// The law damps what its filter lets through, less the share of the target's velocity; a band of the error counts as
/// none.
#[test]
fn stages_are_those_of_the_drives() {
    let (with, _) = behind(&format!("{PD}{AHEAD}{FILTER}dead_band = 0.2\n"));
    let (d, own) = (with.dims(), model().dims());
    // Two filters, two velocities of targets; kp, kd, share and time of each.
    assert_eq!((d.nq, d.nu, d.np), (own.nq + 2, own.nu + 4, own.np + 8));
    let z = point(&with, 1.0);
    let here = at(&z, &d);
    let (filtered, rates) = (&here.v[2..], &here.u[4..]);
    let input = |j: usize| {
        let error = here.u[j] - here.q[j];
        let beyond = error.signum() * (error.abs() - 0.2).max(0.0);
        3.0 * beyond - 0.4 * (filtered[j] - 0.6 * rates[j])
    };
    let u = [input(0), input(1)];
    let (mut r, expected) = (vec![0.0; 4], arm_under(&here, &u));
    with.residual(&here, &mut r);
    for j in 0..2 {
        // The band's corners are rounded by half a percent of its width.
        let rounded = 3.0 * 0.4 * 5e-3;
        assert!((r[j] - expected[j]).abs() < rounded, "{r:?} {expected:?}");
        let growth = (here.v[j] - filtered[j]) / 0.05;
        assert!((r[2 + j] - (here.a[2 + j] - growth)).abs() < 1e-12, "{r:?}");
    }
}

/// The share of gravity is that of the forces which hold the arm at rest: here those of its own equations.
#[test]
fn drives_make_up_for_gravity() {
    let (with, _) = behind(&format!("{PD}{WEIGHED}"));
    let (d, own) = (with.dims(), model().dims());
    assert_eq!((d.nq, d.nu, d.np), (own.nq, own.nu, own.np + 6));
    let z = point(&with, 1.0);
    let here = at(&z, &d);
    let (none, mut held) = (vec![0.0; 2], vec![0.0; 2]);
    let rest = At {
        v: &none,
        a: &none,
        u: &none,
        p: &here.p[..own.np],
        ..here
    };
    model().residual(&rest, &mut held);
    let gains = motor_gains(&here);
    let u =
        [0, 1].map(|j| 3.0 * (here.u[j] - here.q[j]) - 0.4 * here.v[j] + 0.8 * held[j] / gains[j]);
    let (mut r, expected) = (vec![0.0; 2], arm_under(&here, &u));
    with.residual(&here, &mut r);
    for j in 0..2 {
        assert!(held[j].abs() > 0.1, "{held:?}");
        assert!((r[j] - expected[j]).abs() < 1e-9, "{r:?} {expected:?}");
    }
}

/// A step of 0.5 rad at 0.1 s, every 20 ms, in the first joint's targets; the records become what loops follow.
fn stepped(stages: &str, hold: InputHold) -> Vec<f64> {
    let (nominal, mut dataset) = (described(&format!("{PD}{stages}")), targets());
    dataset.input_hold = hold;
    for e in &mut dataset.experiments {
        let nu = e.nu();
        e.t = (0..e.t.len()).map(|i| 0.02 * i as f64).collect();
        for (i, row) in e.u.chunks_exact_mut(nu).enumerate() {
            row[0] = if i < 5 { 0.0 } else { 0.5 };
        }
    }
    let servos = [nominal.servo(0), None];
    let with = WithLoops::new(model(), &servos, &nominal, &mut dataset);
    assert_eq!(with.dims().nq, 2, "stages of targets have no coordinates");
    let e = &dataset.experiments[0];
    e.u.iter().step_by(e.nu()).copied().collect()
}

#[test]
fn targets_become_what_loops_follow() {
    let plain = stepped("", InputHold::ZeroOrder);
    let close = |x: f64, y: f64, within: f64| assert!((x - y).abs() < within, "{x} {y}");
    // In the mean from one sample to the next: 1 − (1 − exp(−h/T)) T/h of a step of one in the first.
    let filtered = stepped("target_filter_s = 0.05\n", InputHold::ZeroOrder);
    assert_eq!(filtered.len(), plain.len());
    let (h, time) = (0.02_f64, 0.05);
    let share = (1.0 - (-h / time).exp()) * time / h;
    close(filtered[4], 0.0, 1e-12);
    close(filtered[5], 0.5 * (1.0 - share), 2e-4);
    close(filtered[6], 0.5 * (1.0 - share * (-h / time).exp()), 2e-4);
    // At 1 rad/s the step takes half a second: 25 samples.
    let slow = stepped("target_speed = 1.0\n", InputHold::ZeroOrder);
    close(slow[5], 0.01, 3e-4);
    close(slow[15], 0.21, 3e-4);
    // Targets are taken every 80 ms, so the step comes at 0.16 s.
    let taken = stepped("target_rate_hz = 12.5\n", InputHold::ZeroOrder);
    let rises = taken.iter().position(|r| *r > 0.25);
    assert_eq!(rises, Some(8));
    // Rounded to multiples of 0.3 rad.
    let coarse = stepped("target_step = 0.3\n", InputHold::ZeroOrder);
    close(coarse[5], 0.6, 1e-12);
    // Along a straight line from 0.08 s to 0.1 s a filter lets through, at its end, T less of the slope's exponential.
    let straight = stepped("target_filter_s = 0.05\n", InputHold::Linear);
    close(straight[4], 0.0, 1e-3);
    let end = 0.5 - 0.5 * share;
    close(straight[5], end, 4e-3);
}

/// A late reading is that behind an all-pass: the loop and its filter see q − 2ξ and 4ξ/τ − v.
#[test]
fn late_readings_are_those_behind_an_all_pass() {
    let late = "feedback_delay_s = { value = 0.02, tolerance = 0.01 }\n";
    let (with, _) = behind(&format!("{PD}{late}"));
    let (filtered, _) = behind(&format!("{PD}{FILTER}{late}"));
    let (d, own) = (with.dims(), model().dims());
    assert_eq!((d.nq, d.nu, d.np), (own.nq + 2, own.nu + 2, own.np + 6));
    let z = point(&with, 1.0);
    let here = at(&z, &d);
    let read = |j: usize| {
        let lag = here.v[2 + j];
        (here.q[j] - 2.0 * lag, 4.0 * lag / 0.02 - here.v[j])
    };
    let u = [0, 1].map(|j| 3.0 * (here.u[j] - read(j).0) - 0.4 * read(j).1);
    let (mut r, expected) = (vec![0.0; 4], arm_under(&here, &u));
    with.residual(&here, &mut r);
    for j in 0..2 {
        assert!((r[j] - expected[j]).abs() < 1e-9, "{r:?} {expected:?}");
        let growth = here.v[j] - 2.0 * here.v[2 + j] / 0.02;
        assert!((r[2 + j] - (here.a[2 + j] - growth)).abs() < 1e-9, "{r:?}");
    }
    // A filter and a lag of each joint, in this order.
    let d = filtered.dims();
    let z = point(&filtered, 1.0);
    let here = at(&z, &d);
    let mut r = vec![0.0; 6];
    filtered.residual(&here, &mut r);
    for j in 0..2 {
        let (f, lag) = (2 + 2 * j, 3 + 2 * j);
        let seen = 4.0 * here.v[lag] / 0.02 - here.v[j];
        let growth = (seen - here.v[f]) / 0.05;
        assert!((r[f] - (here.a[f] - growth)).abs() < 1e-9, "{r:?}");
    }
}

/// At its limit an integral grows inwards alone, and no more than the limit acts.
#[test]
fn an_integral_keeps_within_its_limit() {
    let (with, _) = behind("law = \"pid\"\nkp = 3.0\nkd = 0.4\nki = 1.5\nintegral_limit = 0.8\n");
    let (free, _) = behind("law = \"pid\"\nkp = 3.0\nkd = 0.4\nki = 1.5\n");
    let d = with.dims();
    let growth_and_force = |model: &WithLoops<'_>, integral: f64, error: f64| {
        let mut z = point(model, 1.0);
        z[d.v() + 2] = integral;
        z[d.u()] = z[0] + error;
        let here = at(&z, &d);
        let mut r = vec![0.0; 4];
        model.residual(&here, &mut r);
        (here.a[2] - r[2], r[0])
    };
    for error in [0.3_f64, -0.3] {
        let out = error.signum();
        for (integral, grows) in [(0.3, 1.0), (-0.3, 1.0), (0.9 * out, 0.0), (-0.9 * out, 1.0)] {
            let (growth, force) = growth_and_force(&with, integral, error);
            let expected = grows * 1.5 * error;
            assert!((growth - expected).abs() < 2e-3, "{integral}: {growth}");
            // Rounded by half a percent of the distance of both limits.
            let (_, limited) = growth_and_force(&free, integral.clamp(-0.8, 0.8), error);
            assert!((force - limited).abs() < 0.03, "{force} {limited}");
        }
    }
}

/// What accelerates the arm as its targets do, by its own equations, at the positions that the loops read.
#[test]
fn drives_feed_inertia_forward() {
    let share = "inertia_feed_forward = { value = 0.7, tolerance = 0.3 }\n";
    let (with, _) = behind(&format!("{PD}{share}feedback_delay_s = 0.02\n"));
    let (d, own) = (with.dims(), model().dims());
    // Two lags, two accelerations of targets.
    assert_eq!((d.nq, d.nu, d.np), (own.nq + 2, own.nu + 4, own.np + 8));
    let z = point(&with, 1.0);
    let here = at(&z, &d);
    let read = [0, 1].map(|j| here.q[j] - 2.0 * here.v[2 + j]);
    let still = vec![0.0; 2];
    let forces = |a: &[f64]| {
        let mut r = vec![0.0; 2];
        let at = At {
            q: &read,
            v: &still,
            a,
            u: &still,
            p: &here.p[..own.np],
        };
        model().residual(&at, &mut r);
        r
    };
    let (moved, held) = (forces(&here.u[4..]), forces(&still));
    let gains = motor_gains(&here);
    let u = [0, 1].map(|j| {
        let velocity = 4.0 * here.v[2 + j] / 0.02 - here.v[j];
        let fed = 0.7 * (moved[j] - held[j]) / gains[j];
        assert!(fed.abs() > 1e-3, "{fed}");
        3.0 * (here.u[j] - read[j]) - 0.4 * velocity + fed
    });
    let (mut r, expected) = (vec![0.0; 4], arm_under(&here, &u));
    with.residual(&here, &mut r);
    for j in 0..2 {
        assert!((r[j] - expected[j]).abs() < 1e-9, "{r:?} {expected:?}");
    }
}

/// The acceleration of a target is that of its profile: as stated while it speeds up and slows down, none at rest.
#[test]
fn accelerations_of_targets_are_those_of_their_profile() {
    let stages = "inertia_feed_forward = 1.0\ntarget_acceleration = 8.0\n";
    let (nominal, mut dataset) = (described(&format!("{PD}{stages}")), targets());
    for e in &mut dataset.experiments {
        let nu = e.nu();
        e.t = (0..e.t.len()).map(|i| 0.02 * i as f64).collect();
        for (i, row) in e.u.chunks_exact_mut(nu).enumerate() {
            row.copy_from_slice(if i < 5 { &[0.0, 0.0] } else { &[0.5, -0.5] });
        }
    }
    let servos = [nominal.servo(0), nominal.servo(1)];
    let with = WithLoops::new(model(), &servos, &nominal, &mut dataset);
    assert_eq!(with.inputs()[2].name, "target_acceleration_shoulder");
    assert_eq!(with.inputs()[2].unit, "rad/s^2");
    let e = &dataset.experiments[0];
    let column = |k: usize| e.u.iter().skip(k).step_by(4).copied().collect::<Vec<f64>>();
    for (k, sign) in [(2, 1.0), (3, -1.0)] {
        let own = column(k);
        // Half the way of 0.5 rad takes a quarter of a second, from sample 5 on.
        let seen = [
            (2, 0.0),
            (10, 8.0),
            (16, 8.0),
            (22, -8.0),
            (28, -8.0),
            (35, 0.0),
        ];
        for (sample, expected) in seen {
            let off = own[sample] - sign * expected;
            assert!(off.abs() < 1e-6, "{sample}: {own:?}");
        }
    }
}

/// Effects that are stages of a loop become its numbers, one of no size becomes none, others stay.
#[test]
fn stages_that_a_diagnosis_named_are_numbers_of_the_loop() {
    let named = |delay: f64| {
        let effects = format!(
            "[[effect]]\nid = \"feedback_delay\"\njoint = \"elbow\"\n[effect.parameters]\ndelay_s = {{ value = {delay:?} }}\n\
             [[effect]]\nid = \"quadratic_drag\"\njoint = \"elbow\"\n[effect.parameters]\ndrag = {{ value = 0.1 }}\n"
        );
        let own = in_loops(&described(&format!("{PD}{effects}"))).expect("effects");
        let ids: Vec<&str> = own.effects().iter().map(|e| &*e.id.value).collect();
        assert_eq!(ids, ["quadratic_drag"]);
        [0, 1].map(|j| {
            let servo = own.servo(j).expect("a loop");
            let delay = servo.gain(Gain::FeedbackDelay);
            (servo.has(Gain::FeedbackDelay)).then_some((delay.value, delay.half_width))
        })
    };
    assert_eq!(named(0.02), [None, Some((Some(0.02), 0.02))]);
    assert_eq!(named(0.0), [None, None]);
}
