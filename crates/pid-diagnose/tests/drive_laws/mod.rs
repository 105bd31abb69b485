//! Laws of position loops, from records of a bar that an integrator of its own makes (see [`rig`]).

mod identified;
mod integrals;
mod off;
mod rig;
mod simulated;
mod stages;

use pid_data::{Dataset, Role};
use pid_diagnose::case::Case;
use pid_diagnose::diagnosis::Diagnosis;
use pid_diagnose::fit::{Direction, Point, all_gains, linearise};
use pid_diagnose::hypothesis::Hypothesis;
use pid_diagnose::loop_gain::Told;
use pid_diagnose::report::Report;
use pid_diagnose::search::Settings;
use pid_interpret::nominal::{Gain, Role as Part};
use rig::{BAR, CASCADE, Loop, PD, PID, described, records};

use crate::common::{among, runs_as_diagnosed};

fn diagnosed(drive: &str, dataset: &Dataset) -> Report {
    Report::new(described(drive), dataset, &Settings::default(), false).expect("a diagnosis")
}

/// Effects that a loop, or what follows it, hides or imitates.
const RIVALS: [&str; 17] = [
    "command_acceleration_limit",
    "command_average",
    "command_filter",
    "command_speed_limit",
    "feedback_delay",
    "gravity_feed_forward",
    "inertia_feed_forward",
    "velocity_feed_forward",
    "input_delay",
    "joint_elasticity",
    "payload",
    "quadratic_drag",
    "sensor_delay",
    "spring",
    "stribeck",
    "torque_saturation",
    "unmodelled_rotor_inertia",
];

/// The same among the effects of [`RIVALS`]: half of the library takes half of the time.
fn told_from_rivals(drive: &str, dataset: &Dataset) -> Report {
    Report::new(described(drive), dataset, &among(&RIVALS), false).expect("a diagnosis")
}

/// What is called determined lies within 5 % of the truth.
fn gains_hold(d: &Diagnosis, truth: &[(&str, f64)]) {
    let stated: Vec<&str> = d.loop_gains.iter().map(|g| g.gain.as_str()).collect();
    let names: Vec<&str> = truth.iter().map(|(name, _)| *name).collect();
    assert_eq!(stated, names);
    for (g, (_, truth)) in d.loop_gains.iter().zip(truth) {
        eprintln!("{} (is {truth})", g.words());
        if g.told == Told::Determined {
            assert!((g.value / truth - 1.0).abs() < 0.05, "{g:?} {truth}");
        }
    }
}

fn told(d: &Diagnosis, gain: &str) -> Told {
    let own = d.loop_gains.iter().find(|g| g.gain == gain);
    own.expect("a gain").told
}

/// A value with a tolerance of 30 %.
fn about(x: f64) -> String {
    format!("{{ value = {x}, tolerance_rel = 0.3 }}")
}

const PID_TRUTH: [(&str, f64); 3] = [("kp", 12.0), ("kd", 0.9), ("ki", 25.0)];

fn stated_pid() -> String {
    let [kp, kd, ki] = [about(14.4), about(0.8), about(21.0)];
    format!("law = \"pid\"\nkp = {kp}\nkd = {kd}\nki = {ki}\nlimit = 6.0\n")
}

#[test]
fn a_pid_without_a_missing_effect_has_its_gains_and_none() {
    let dataset = records(&PID, None, 0.0, 11);
    for drive in [
        stated_pid(),
        "law = \"pid\"\nkp = { unknown = true }\nkd = { unknown = true }\nki = { unknown = true }\nlimit = 6.0\n"
            .to_owned(),
    ] {
        let report = diagnosed(&drive, &dataset);
        let d = report.diagnosis();
        assert_eq!(d.verdict.word(), "none", "{d:?}");
        gains_hold(d, &PID_TRUTH);
        for gain in ["kp", "ki"] {
            assert_eq!(told(d, gain), Told::Determined, "{:?}", d.loop_gains);
        }
        runs_as_diagnosed(&report, &dataset);
    }
}

#[test]
fn stribeck_friction_is_found_behind_a_pid_and_behind_a_cascade() {
    let cascade = format!(
        "law = \"cascade\"\nkp = {}\nkv = {}\nki = {}\nvelocity_limit = 3.0\nlimit = 6.0\n",
        about(10.5),
        about(1.25),
        about(9.0)
    );
    let cascade_truth = [("kp", 12.0), ("ki", 8.0), ("kv", 1.1)];
    for (own, drive, truth) in [
        (PID, stated_pid(), PID_TRUTH),
        (CASCADE, cascade, cascade_truth),
    ] {
        let dataset = records(&own, Some([2.2, 0.1]), 0.0, 12);
        let report = told_from_rivals(&drive, &dataset);
        let d = report.diagnosis();
        assert_eq!(
            (d.verdict.word(), d.verdict.joint()),
            ("stribeck", Some(1)),
            "{d:?}"
        );
        gains_hold(d, &truth);
    }
}

#[test]
fn a_cascade_without_a_missing_effect_has_its_gains_and_none() {
    let unknown = "{ unknown = true }";
    let drive = format!(
        "law = \"cascade\"\nkp = {unknown}\nkv = {unknown}\nki = {unknown}\nvelocity_limit = 3.0\nlimit = 6.0\n"
    );
    let report = diagnosed(&drive, &records(&CASCADE, None, 0.0, 13));
    let d = report.diagnosis();
    assert_eq!(d.verdict.word(), "none", "{d:?}");
    gains_hold(d, &[("kp", 12.0), ("ki", 8.0), ("kv", 1.1)]);
    assert_eq!(told(d, "kp"), Told::Determined, "{:?}", d.loop_gains);
}

/// Masses, friction and gains that are all the same factor higher move the robot as before, whatever an integral
/// starts with: records of positions do not tell that factor.
#[test]
fn a_common_factor_of_all_forces_is_not_told() {
    let pid = [("kp", 14.4), ("kd", 0.8), ("ki", 21.0)];
    let cascade = [("kp", 10.5), ("kv", 1.25), ("ki", 9.0)];
    let forces = [Gain::Kp, Gain::Kd, Gain::Kv, Gain::Ki];
    for (own, law, gains) in [(PID, "pid", pid), (CASCADE, "cascade", cascade)] {
        let gains = gains.map(|(name, x)| format!("{name} = {}\n", about(x)));
        let drive = format!("law = \"{law}\"\n{}", gains.concat());
        let case = Case::new(described(&drive), &records(&own, None, 0.0, 19)).expect("a case");
        let (nothing, values) = (Hypothesis::default(), &case.nominal.values);
        let at = Point {
            theta: vec![0.0; case.nominal.size()],
            e: Vec::new(),
        };
        let found = all_gains(&case, &nothing, &at);
        let unbalanced = found.iter().any(|g| g[0].hidden[3].abs() > 1e-3);
        assert!(
            unbalanced,
            "an integral that starts elsewhere than gravity needs"
        );
        let along = |takes: &dyn Fn(Part) -> bool| -> Vec<f64> {
            let one = values
                .iter()
                .map(|v| match takes(v.role) && v.nominal != 0.0 {
                    true => v.nominal / v.half_width,
                    false => 0.0,
                });
            one.collect()
        };
        let force = |part| match part {
            // Of a cascade kp is a rate.
            Part::Servo(gain) => forces[usize::from(law == "cascade")..].contains(&gain),
            part => matches!(
                part,
                Part::Mass | Part::Inertia(_) | Part::RotorInertia | Part::Coulomb | Part::Viscous
            ),
        };
        let (all, links) = (
            along(&force),
            along(&|part| force(part) && !matches!(part, Part::Servo(_))),
        );
        let directions = [Direction::Theta(&all), Direction::Theta(&links)];
        let slopes = linearise(&case, &nothing, &at, &found, Role::Train, &directions).j;
        let [common, alone] = [0, 1].map(|c| slopes.column(c).norm());
        assert!(common < 1e-6 * alone, "{law}: {common} of {alone}");
    }
}

/// The drive makes up for the bar, not for a load that it does not know. Where its share is not exact, share,
/// kp and load trade off: only the two ratios of inertia and of net gravity to kp are told.
#[test]
fn a_payload_is_found_behind_a_drive_that_makes_up_for_gravity() {
    let own = Loop {
        gravity: Some((0.9, BAR[0])),
        ..PD
    };
    let dataset = records(&own, None, 0.4, 14);
    for (share, exact) in [("0.9", true), ("{ value = 1.0, tolerance = 0.2 }", false)] {
        let [kp, kd] = [about(12.0), about(1.0)];
        let drive = format!("law = \"pd\"\nkp = {kp}\nkd = {kd}\ngravity = {share}\nlimit = 6.0\n");
        let report = told_from_rivals(&drive, &dataset);
        let d = report.diagnosis();
        assert_eq!(d.verdict.word(), "payload", "{d:?}");
        let mass = &d.effects[0].parameters[0];
        eprintln!("{mass:?}");
        if exact {
            assert!((mass.value / 0.4 - 1.0).abs() < 0.1, "{mass:?}");
            gains_hold(d, &[("kp", 12.0), ("kd", 0.9)]);
        } else {
            let std = mass.std.expect("a deviation");
            assert!((mass.value - 0.4).abs() < 3.0 * std, "{mass:?}");
            gains_hold(d, &[("kp", 12.0), ("kd", 0.9), ("gravity", 0.9)]);
            assert_ne!(told(d, "gravity"), Told::Determined);
        }
        // The masses that were found are not those that the drive counts with.
        let text = runs_as_diagnosed(&report, &dataset);
        assert!(text.contains("[joint.drive_model]\nmass = 1.5\n"), "{text}");
    }
}

/// A gain that is stated wrongly is named with its magnitude, stated exactly or with a tolerance that the
/// truth lies beyond.
#[test]
fn a_wrong_gain_is_named_as_one() {
    let dataset = records(&PD, None, 0.0, 16);
    for (kp, kd) in [
        ("18.0", "0.9"),
        ("{ value = 18.0, tolerance_rel = 0.1 }", "0.9"),
    ] {
        let drive = format!("law = \"pd\"\nkp = {kp}\nkd = {kd}\nlimit = 6.0\n");
        let report = told_from_rivals(&drive, &dataset);
        let d = report.diagnosis();
        assert_eq!(
            (d.verdict.word(), d.verdict.joint()),
            ("servo_gain", Some(1)),
            "{d:?}"
        );
        let found = &d.effects[0].parameters[0];
        assert_eq!((found.name.as_str(), found.unit.as_str()), ("kp", "A/rad"));
        assert!((found.value / 12.0 - 1.0).abs() < 0.05, "{found:?}");
        let words = d.beyond_tolerance[0].words();
        assert!(words.starts_with("kp of the drive of joint 1"), "{words}");
        assert!(words.contains("(stated 18"), "{words}");
        runs_as_diagnosed(&report, &dataset);
    }
}

#[test]
fn filters_of_target_and_velocity_are_told() {
    let own = Loop {
        target_filter: Some(0.06),
        velocity_filter: Some(0.03),
        ..PD
    };
    let drive = format!(
        "law = \"pd\"\nkp = {}\nkd = {}\ntarget_filter_s = {{ unknown = true }}\nvelocity_filter_s = {}\nlimit = 6.0\n",
        about(10.0),
        about(1.0),
        about(0.025)
    );
    let report = told_from_rivals(&drive, &records(&own, None, 0.0, 15));
    let d = report.diagnosis();
    assert_eq!(d.verdict.word(), "none", "{d:?}");
    gains_hold(
        d,
        &[
            ("kp", 12.0),
            ("kd", 0.9),
            ("target_filter_s", 0.06),
            ("velocity_filter_s", 0.03),
        ],
    );
    assert_eq!(told(d, "target_filter_s"), Told::Determined);
}

/// A slow integral, a slow rate and a slow filter are each refused with the place of the loop; without what
/// makes them swing up the loops are taken.
#[test]
fn loops_that_swing_up_are_refused() {
    let dataset = records(&PD, None, 0.0, 17);
    let told = |drive: &str| {
        let case = Case::new(described(drive), &dataset);
        case.err().map(|e| e.to_string()).unwrap_or_default()
    };
    let cascade = |ki: f64| format!("law = \"cascade\"\nkp = 12.0\nkv = 0.05\nki = {ki}\n");
    let pd = |more: &str| format!("law = \"pd\"\nkp = 12.0\nkd = 0.9\n{more}");
    // Routh and Hurwitz for I s³ + (f + g kv) s² + g (kv kp + ki) s + g ki kp: stable up to 0.127; a little
    // beyond, dry friction still brakes what the records show.
    let warnings = |ki| {
        let case = Case::new(described(&cascade(ki)), &dataset).expect("a case");
        case.loop_warnings.join("\n")
    };
    assert_eq!(warnings(0.12), "");
    let held = "ki = 0.1400 makes the loop swing up with the stated gains, dry friction alone holds the joint";
    assert!(warnings(0.14).contains(held), "{}", warnings(0.14));
    for (drive, why) in [
        (cascade(0.6), "ki = 0.6000 makes the loop swing up"),
        (pd("rate_hz = 5.0\n"), "at 5 Hz the loop swings up"),
        // Without its damping the delay of 25 ms of a held output outweighs the friction.
        (
            pd("rate_hz = 20.0\nvelocity_filter_s = 0.5\n"),
            "at 20 Hz the loop swings up",
        ),
    ] {
        let message = told(&drive);
        assert!(
            message.contains("nominal.toml:") && message.contains(why),
            "{drive}: {message}"
        );
    }
    assert_eq!(told(&pd("rate_hz = 50.0\n")), "");
    assert_eq!(told(&pd("velocity_filter_s = 0.5\n")), "");
}
