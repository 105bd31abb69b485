//! Loops in simulation against the integrator of the rig.

use pid_diagnose::case::Case;
use pid_diagnose::hypothesis::Hypothesis;
use pid_diagnose::predict::Runner;
use rayon::prelude::*;

use super::rig::{BAR, CASCADE, Loop, PD, PID, SAMPLES, described, exact_records};

/// The loops with their descriptions as they are.
fn loops() -> Vec<(Loop, String)> {
    let p = "law = \"p\"\nkp = 12.0\nlimit = 6.0\n";
    let pd = "law = \"pd\"\nkp = 12.0\nkd = 0.9\nlimit = 6.0\n";
    let pid = "law = \"pid\"\nkp = 12.0\nkd = 0.9\nki = 25.0\nlimit = 6.0\n";
    let cascade =
        "law = \"cascade\"\nkp = 12.0\nkv = 1.1\nki = 8.0\nvelocity_limit = 3.0\nlimit = 6.0\n";
    let with = |own: Loop, text: &str, more: &str| (own, format!("{text}{more}"));
    vec![
        with(PD, pd, ""),
        with(PID, pid, ""),
        with(
            Loop {
                limit: Some(2.0),
                ..PID
            },
            &pid.replace("6.0", "2.0"),
            "",
        ),
        with(
            Loop {
                hz: Some(50.0),
                ..PID
            },
            pid,
            "rate_hz = 50.0\n",
        ),
        // Without damping of its own a loop shows by how much its held output is late.
        with(
            Loop {
                kd: 0.0,
                hz: Some(1000.0),
                ..PD
            },
            p,
            "rate_hz = 1000.0\n",
        ),
        with(
            Loop {
                kd: 0.0,
                hz: Some(500.0),
                ..PD
            },
            p,
            "rate_hz = 500.0\n",
        ),
        with(
            Loop {
                kd: 0.0,
                hz: Some(800.0),
                ..PD
            },
            p,
            "rate_hz = 800.0\n",
        ),
        with(
            Loop {
                kd: 0.0,
                hz: Some(1000.0),
                speed: Some(1.5),
                ..PD
            },
            p,
            "rate_hz = 1000.0\ntarget_speed = 1.5\n",
        ),
        with(
            Loop {
                kd: 0.0,
                speed: Some(1.5),
                ..PD
            },
            p,
            "target_speed = 1.5\n",
        ),
        with(Loop { kd: 0.0, ..PD }, p, ""),
        with(CASCADE, cascade, ""),
        with(
            Loop {
                hz: Some(100.0),
                ..CASCADE
            },
            cascade,
            "rate_hz = 100.0\n",
        ),
        with(
            Loop {
                gravity: Some((0.8, BAR[0])),
                ..PD
            },
            pd,
            "gravity = 0.8\n",
        ),
        with(
            Loop {
                gravity: Some((1.0, 1.2)),
                hz: Some(100.0),
                ..PD
            },
            pd,
            "gravity = 1.0\nrate_hz = 100.0\n[joint.drive_model]\nmass = 1.2\ncom = [0.0, 0.0, -0.2]\nmotor_gain = 1.8\n",
        ),
        with(
            Loop {
                ahead: Some(0.8),
                ..PD
            },
            pd,
            "velocity_feed_forward = 0.8\n",
        ),
        with(
            Loop {
                ahead: Some(0.8),
                hz: Some(50.0),
                ..PD
            },
            pd,
            "velocity_feed_forward = 0.8\nrate_hz = 50.0\n",
        ),
        with(
            Loop {
                ahead: Some(1.0),
                target_filter: Some(0.03),
                hz: Some(500.0),
                ..CASCADE
            },
            cascade,
            "velocity_feed_forward = 1.0\ntarget_filter_s = 0.03\nrate_hz = 500.0\n",
        ),
        with(
            Loop {
                late: Some(0.012),
                ..PD
            },
            pd,
            "feedback_delay_s = 0.012\n",
        ),
        with(
            Loop {
                late: Some(0.0046),
                velocity_filter: Some(0.01),
                hz: Some(200.0),
                ..PID
            },
            pid,
            "feedback_delay_s = 0.0046\nvelocity_filter_s = 0.01\nrate_hz = 200.0\n",
        ),
        with(
            Loop {
                most: Some(0.3),
                ..PID
            },
            pid,
            "integral_limit = 0.3\n",
        ),
        with(
            Loop {
                velocity_filter: Some(0.03),
                ..PD
            },
            pd,
            "velocity_filter_s = 0.03\n",
        ),
        with(
            Loop {
                velocity_filter: Some(0.02),
                hz: Some(200.0),
                ..PD
            },
            pd,
            "velocity_filter_s = 0.02\nrate_hz = 200.0\n",
        ),
        with(
            Loop {
                limit: Some(2.5),
                no_load: Some(4.0),
                ..PD
            },
            &pd.replace("limit = 6.0", "limit = 2.5"),
            "no_load_speed = 4.0\n",
        ),
        with(
            Loop {
                limit: Some(2.5),
                no_load: Some(4.0),
                hz: Some(200.0),
                ..PID
            },
            &pid.replace("limit = 6.0", "limit = 2.5"),
            "no_load_speed = 4.0\nrate_hz = 200.0\n",
        ),
        with(
            Loop {
                dead_band: Some(0.02),
                ..PD
            },
            pd,
            "dead_band = 0.02\n",
        ),
        with(
            Loop {
                step: Some(0.05),
                ..PD
            },
            pd,
            "target_step = 0.05\n",
        ),
        with(
            Loop {
                target_hz: Some(25.0),
                ..PD
            },
            pd,
            "target_rate_hz = 25.0\n",
        ),
        with(
            Loop {
                speed: Some(0.8),
                ..PD
            },
            pd,
            "target_speed = 0.8\n",
        ),
        with(
            Loop {
                target_filter: Some(0.06),
                ..PD
            },
            pd,
            "target_filter_s = 0.06\n",
        ),
        with(
            Loop {
                acceleration: Some(5.0),
                ..PD
            },
            pd,
            "target_acceleration = 5.0\n",
        ),
        with(
            Loop {
                acceleration: Some(5.0),
                speed: Some(0.8),
                hz: Some(200.0),
                ..CASCADE
            },
            cascade,
            "target_acceleration = 5.0\ntarget_speed = 0.8\nrate_hz = 200.0\n",
        ),
        with(
            Loop {
                average: Some(0.08),
                ..PD
            },
            pd,
            "target_average_s = 0.08\n",
        ),
        with(
            Loop {
                acceleration: Some(8.0),
                average: Some(0.05),
                inertia: Some(0.9),
                ahead: Some(0.7),
                ..PD
            },
            pd,
            "target_acceleration = 8.0\ntarget_average_s = 0.05\ninertia_feed_forward = 0.9\nvelocity_feed_forward = 0.7\n",
        ),
        with(
            Loop {
                inertia: Some(0.9),
                target_filter: Some(0.03),
                hz: Some(500.0),
                ..PD
            },
            pd,
            "inertia_feed_forward = 0.9\ntarget_filter_s = 0.03\nrate_hz = 500.0\n",
        ),
        with(
            Loop {
                inertia: Some(0.6),
                target_hz: Some(25.0),
                ..PD
            },
            pd,
            "inertia_feed_forward = 0.6\ntarget_rate_hz = 25.0\n",
        ),
        with(
            Loop {
                step: Some(0.01),
                target_hz: Some(50.0),
                speed: Some(1.5),
                target_filter: Some(0.04),
                dead_band: Some(0.005),
                velocity_filter: Some(0.01),
                hz: Some(200.0),
                ..PID
            },
            pid,
            "target_step = 0.01\ntarget_rate_hz = 50.0\ntarget_speed = 1.5\ntarget_filter_s = 0.04\ndead_band = 0.005\n\
             velocity_filter_s = 0.01\nrate_hz = 200.0\n",
        ),
    ]
}

/// Free runs of eight seconds from rest, at substeps of half the usual length.
#[test]
fn the_simulation_is_that_of_an_integrator_of_its_own() {
    let wrong = |(own, text): (Loop, String)| {
        let dataset = exact_records(&own, 1);
        let case = Case::new(described(&text), &dataset).expect("a case");
        let mut nothing = Hypothesis::default();
        nothing.run.finer = 2;
        let theta = vec![0.0; case.nominal.size()];
        let mut most = 0.0_f64;
        for (record, e) in case.records.iter().zip(&dataset.experiments) {
            let mut runner = Runner::<f64>::new(&case, record, &nothing, &theta, &[]);
            let state = runner.start(0);
            runner.free(&state, 0, SAMPLES - 1, &mut |k, _, q, _| {
                most = most.max((q - e.q[k]).abs());
            });
        }
        eprintln!("{most:.1e} rad: {}", text.replace('\n', " "));
        // Of motions over 1 rad; at a limit of the output the order of the steps is one, and without damping in the
        // loop what a reversal leaves swings on.
        let undamped = own.kd == 0.0 && own.cascade.is_none();
        let coarse = own.limit == Some(2.0) || undamped;
        (most > if coarse { 1e-3 } else { 3e-4 }).then_some((most, text))
    };
    let wrong: Vec<(f64, String)> = loops().into_par_iter().filter_map(wrong).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
}
