//! Stages of a loop that its description does not state.

use pid_diagnose::effects::by_id;
use pid_diagnose::loop_gain::Told;
use pid_diagnose::nominal::Nominal;

use crate::common::{identified, runs_as_diagnosed};

use super::rig::{BAR, CASCADE, Loop, PD, described, records};
use super::{about, gains_hold, told, told_from_rivals};

/// Loops with such a stage, their descriptions, the effect, and its value.
fn unstated() -> Vec<(Loop, String, &'static str, f64)> {
    let pd = format!(
        "law = \"pd\"\nkp = {}\nkd = {}\nlimit = 6.0\n",
        about(10.0),
        about(1.0)
    );
    let cascade = format!(
        "law = \"cascade\"\nkp = {}\nkv = {}\nki = {}\nvelocity_limit = 3.0\nlimit = 6.0\n",
        about(10.5),
        about(1.25),
        about(9.0)
    );
    let filter = Loop {
        target_filter: Some(0.06),
        ..PD
    };
    let speed = Loop {
        speed: Some(0.8),
        ..PD
    };
    let gravity = Loop {
        gravity: Some((0.8, BAR[0])),
        ..PD
    };
    let ahead = Loop {
        ahead: Some(0.7),
        ..CASCADE
    };
    let late = Loop {
        late: Some(0.02),
        ..PD
    };
    let profile = Loop {
        acceleration: Some(4.0),
        ..PD
    };
    let average = Loop {
        average: Some(0.12),
        ..PD
    };
    let pushed = Loop {
        inertia: Some(0.8),
        ..PD
    };
    vec![
        (profile, pd.clone(), "command_acceleration_limit", 4.0),
        (average, pd.clone(), "command_average", 0.12),
        (pushed, pd.clone(), "inertia_feed_forward", 0.8),
        (late, pd.clone(), "feedback_delay", 0.02),
        (filter, pd.clone(), "command_filter", 0.06),
        (speed, pd.clone(), "command_speed_limit", 0.8),
        (gravity, pd, "gravity_feed_forward", 0.8),
        (ahead, cascade, "velocity_feed_forward", 0.7),
    ]
}

#[test]
fn a_stage_that_is_not_stated_is_named_with_its_size() {
    for (own, drive, id, truth) in unstated() {
        let dataset = records(&own, None, 0.0, 21);
        let report = told_from_rivals(&drive, &dataset);
        let d = report.diagnosis();
        assert_eq!(
            (d.verdict.word(), d.verdict.joint()),
            (id, Some(1)),
            "{d:?}"
        );
        let found = &d.effects[0].parameters[0];
        eprintln!("{id}: {found:?} (is {truth})");
        let off = (found.value / truth - 1.0).abs();
        assert!(off < 0.05, "{id}: {found:?} for {truth}");
        // The extended description runs as the diagnosis did.
        let text = runs_as_diagnosed(&report, &dataset);
        // And the program with exact derivatives finds the same of what is a parameter of the loop.
        let again = Nominal::parse(&text, "extended.toml".as_ref()).expect("a description");
        let fitted = identified(&again, &dataset);
        let effect = by_id(id).expect("an effect");
        let stage = effect.stage().expect("a stage");
        if !stage.shapes_target() {
            let own = fitted[&format!("{}_a", stage.key())];
            eprintln!("{id}: {own} by the program");
            assert!((own / truth - 1.0).abs() < 0.1, "{id}: {own} for {truth}");
        }
    }
}

#[test]
fn a_largest_speed_and_a_share_of_the_velocity_are_told_from_nothing() {
    let own = Loop {
        speed: Some(0.8),
        ahead: Some(0.7),
        ..CASCADE
    };
    let drive = format!(
        "law = \"cascade\"\nkp = {}\nkv = {}\nki = {}\ntarget_speed = {{ unknown = true }}\n\
         velocity_feed_forward = {{ unknown = true }}\nvelocity_limit = 3.0\nlimit = 6.0\n",
        about(10.5),
        about(1.25),
        about(9.0)
    );
    let report = told_from_rivals(&drive, &records(&own, None, 0.0, 22));
    let d = report.diagnosis();
    assert_eq!(d.verdict.word(), "none", "{d:?}");
    let truth = [
        ("kp", 12.0),
        ("ki", 8.0),
        ("kv", 1.1),
        ("velocity_feed_forward", 0.7),
        ("target_speed", 0.8),
    ];
    gains_hold(d, &truth);
    assert_eq!(told(d, "target_speed"), Told::Determined);
}

/// A stage needs a loop that can have it and does not state it: place and mend.
#[test]
fn a_stage_where_it_cannot_be_is_refused() {
    let effect = |id: &str, parameter: &str| {
        format!(
            "[[effect]]\nid = \"{id}\"\njoint = \"a\"\n[effect.parameters]\n{parameter} = {{ value = 0.5 }}\n"
        )
    };
    let refused = |drive: &str, effect: &str| {
        let text = described(drive).description.to_toml().expect("a text") + effect;
        let read = Nominal::parse(&text, "nominal.toml".as_ref());
        let case = read.map_err(|e| e.to_string()).and_then(|nominal| {
            let own = pid_diagnose::described::described(&nominal.description);
            own.map(drop).map_err(|e| e.to_string())
        });
        case.err().unwrap_or_default()
    };
    let p = "law = \"p\"\nkp = 12.0\n";
    let filtered = "law = \"pd\"\nkp = 12.0\nkd = 0.9\ntarget_filter_s = 0.1\n";
    let ahead = refused(p, &effect("velocity_feed_forward", "share"));
    assert!(
        ahead.contains("nominal.toml:")
            && ahead.contains("the law \"p\" does not use the velocity"),
        "{ahead}"
    );
    let twice = refused(filtered, &effect("command_filter", "time_constant_s"));
    assert!(
        twice.contains("its loop states `target_filter_s`"),
        "{twice}"
    );
    let none = refused("law = \"none\"\n", &effect("gravity_feed_forward", "share"));
    assert!(none.contains("state the loop in [joint.drive]"), "{none}");
}
