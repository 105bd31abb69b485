//! Numbers of loops with stages, by the program with exact derivatives.

use pid_data::Dataset;
use pid_diagnose::nominal::Nominal;
use pid_fit::gap::force::missing_force;

use super::about;
use super::rig::{BAR, CASCADE, Loop, PD, PID, described, records};
use crate::common::{identified, identified_model};

/// A policy's targets behind a filter, a derivative behind another and a band: what is stated of the target acts on
/// it, the filter of the velocity is found.
#[test]
fn a_pd_with_filters_and_a_band_has_its_gains() {
    let own = Loop {
        target_hz: Some(25.0),
        target_filter: Some(0.06),
        velocity_filter: Some(0.03),
        dead_band: Some(0.01),
        ..PD
    };
    let drive = format!(
        "law = \"pd\"\nkp = {}\nkd = {}\nlimit = 6.0\ntarget_rate_hz = 25.0\ntarget_filter_s = 0.06\ndead_band = 0.01\n\
         velocity_filter_s = {}\n",
        about(10.0),
        about(1.1),
        about(0.025)
    );
    let found = identified(&described(&drive), &records(&own, None, 0.0, 31));
    hold(
        &found,
        &[
            ("kp", 12.0, 0.03),
            ("kd", 0.9, 0.1),
            ("velocity_filter_s", 0.03, 0.15),
        ],
    );
}

/// A profile's targets, a share of their velocity that is not known, and a velocity that the loop asks for at most.
#[test]
fn a_cascade_behind_a_profile_has_its_share_of_the_velocity() {
    let own = Loop {
        acceleration: Some(6.0),
        ahead: Some(0.7),
        ..CASCADE
    };
    let drive = format!(
        "law = \"cascade\"\nkp = {}\nkv = {}\nki = {}\nvelocity_limit = 3.0\nlimit = 6.0\ntarget_acceleration = 6.0\n\
         velocity_feed_forward = {{ unknown = true }}\n",
        about(10.5),
        about(1.25),
        about(9.0)
    );
    let found = identified(&described(&drive), &records(&own, None, 0.0, 32));
    hold(
        &found,
        &[
            ("kp", 12.0, 0.05),
            ("kv", 1.1, 0.1),
            ("velocity_feed_forward", 0.7, 0.1),
        ],
    );
}

/// A drive that makes up for most of gravity, by a mass of its own.
#[test]
fn a_cascade_has_its_share_of_gravity() {
    let own = Loop {
        gravity: Some((0.8, BAR[0])),
        ..CASCADE
    };
    let drive = format!(
        "law = \"cascade\"\nkp = {}\nkv = {}\nki = {}\nvelocity_limit = 3.0\nlimit = 6.0\n\
         gravity = {{ value = 1.0, tolerance = 0.5 }}\n",
        about(10.5),
        about(1.25),
        about(9.0)
    );
    let found = identified(&described(&drive), &records(&own, None, 0.0, 33));
    hold(
        &found,
        &[("kp", 12.0, 0.05), ("kv", 1.1, 0.1), ("gravity", 0.8, 0.1)],
    );
}

/// A loop that reads 20 ms late, by a time that is not known.
fn late() -> (Nominal, Dataset) {
    let own = Loop {
        late: Some(0.02),
        ..PD
    };
    let drive = format!(
        "law = \"pd\"\nkp = {}\nkd = {}\nlimit = 6.0\nfeedback_delay_s = {}\n",
        about(10.5),
        about(1.05),
        about(0.014)
    );
    (described(&drive), records(&own, None, 0.0, 34))
}

#[test]
fn a_late_reading_has_its_time() {
    let (nominal, dataset) = late();
    let found = identified(&nominal, &dataset);
    hold(
        &found,
        &[
            ("kp", 12.0, 0.03),
            ("kd", 0.9, 0.1),
            ("feedback_delay_s", 0.02, 0.15),
        ],
    );
}

/// Nothing is missing of a loop that reads late: neither a force at its joint nor one at what its position lags, which
/// no sensor reads.
#[test]
fn no_force_is_missing_at_states_of_loops() {
    let (nominal, dataset) = late();
    let (with, dataset, p) = identified_model(&nominal, &dataset);
    assert_eq!(with.states.unread, [1]);
    let e = &dataset.experiments[3];
    let force = missing_force(with.model.as_ref(), &p, &dataset, e, &with.states);
    let force = force.expect("a force");
    let rms = |x: &[f64], j: usize| {
        let own = x.iter().skip(j).step_by(2);
        (own.clone().map(|x| x * x).sum::<f64>() / own.count() as f64).sqrt()
    };
    let (missing, whole) = (rms(&force.w, 0), rms(&force.total, 0));
    eprintln!("missing: {missing} of {whole} N·m");
    assert!(missing < 0.06 * whole, "{missing} of {whole}");
    assert!(rms(&force.w, 1) < 1e-2 * rms(&force.total, 1));
}

/// A drive that feeds part of the inertia forward that its profile asks for.
#[test]
fn a_pd_behind_a_profile_has_its_share_of_inertia() {
    let own = Loop {
        acceleration: Some(6.0),
        inertia: Some(0.7),
        ..PD
    };
    let drive = format!(
        "law = \"pd\"\nkp = {}\nkd = {}\nlimit = 6.0\ntarget_acceleration = 6.0\n\
         inertia_feed_forward = {{ value = 1.0, tolerance = 0.5 }}\n",
        about(10.5),
        about(1.05)
    );
    let found = identified(&described(&drive), &records(&own, None, 0.0, 35));
    hold(
        &found,
        &[
            ("kp", 12.0, 0.03),
            ("kd", 0.9, 0.1),
            ("inertia_feed_forward", 0.7, 0.1),
        ],
    );
}

/// An integral that holds a third of what gravity asks for at most.
#[test]
fn a_pid_with_a_limited_integral_has_its_gains() {
    let own = Loop {
        most: Some(0.3),
        ..PID
    };
    let drive = format!(
        "law = \"pid\"\nkp = {}\nkd = {}\nki = {}\nlimit = 6.0\nintegral_limit = 0.3\n",
        about(10.5),
        about(1.05),
        about(20.0)
    );
    let found = identified(&described(&drive), &records(&own, None, 0.0, 36));
    hold(
        &found,
        &[("kp", 12.0, 0.03), ("kd", 0.9, 0.1), ("ki", 25.0, 0.15)],
    );
}

/// Numbers lie within a share of the truth.
fn hold(found: &std::collections::BTreeMap<String, f64>, truth: &[(&str, f64, f64)]) {
    for (name, value, within) in truth {
        let own = found[&format!("{name}_a")];
        eprintln!("{name}: {own} (is {value})");
        assert!(
            (own / value - 1.0).abs() < *within,
            "{name}: {own} for {value}"
        );
    }
}
