//! Position loops of the wrapper for MuJoCo against those of the library.

mod common;

use std::fmt::Write;

use common::{LOOP, behind_loop, described};
use pid_effects::drives::target::{Motion, Shaped, followed};
use pid_effects::drives::{Gains, Seen, filter, integrated, output};
use pid_interpret::nominal::{Nominal, Servo};
use pid_simulators::{Options, Target, export};

/// Step, number of steps and of those between two outputs, as `check/position_loops.py` has them.
const STEP: f64 = 1e-3;
const COUNT: u32 = 1200;
const EVERY: u32 = 60;

/// What the loop is to follow: a sine, and a step at 0.4 s.
fn target(t: f64) -> Motion<f64> {
    let (s, c) = (3.0 * t).sin_cos();
    Motion {
        r: 0.5 * s + if t >= 0.4 { 0.6 } else { 0.0 },
        rate: 1.5 * c,
        acceleration: -4.5 * s,
    }
}

fn motion(t: f64) -> (f64, f64) {
    let (s, c) = (3.0 * t - 0.3).sin_cos();
    (0.4 * s, 1.2 * c)
}

/// The outputs of a loop by the functions of the library; one that reads at a rate does so every so many steps.
fn outputs(servo: &Servo) -> Vec<f64> {
    let k = Gains::of(|gain| servo.gain(gain).value);
    let every = servo
        .rate_hz
        .map_or(1, |hz| (1.0 / hz / STEP).round() as u32);
    let (period, middle) = match servo.rate_hz {
        Some(hz) => (1.0 / hz, 0.0),
        None => (STEP, 0.5),
    };
    let mut shaped = Shaped::at_rest(target(0.0).r);
    let (mut integral, mut velocity, mut u) = (0.0, motion(0.0).1, 0.0);
    let mut out = Vec::new();
    for i in 0..COUNT {
        let t = STEP * f64::from(i);
        if i % every == 0 {
            let both = followed(servo, &k, &mut shaped, &target(t), (t, period), 0.0);
            let follows = both[usize::from(servo.rate_hz.is_some())];
            let (q, v) = motion(t + middle * STEP);
            let end = k
                .velocity_time
                .map_or(v, |time| filter::after(velocity, v, time, period));
            let seen = k.velocity_time.filter(|_| servo.rate_hz.is_none());
            let own = seen.map_or(end, |time| filter::after(velocity, v, time, 0.5 * STEP));
            velocity = end;
            let at = Seen {
                r: follows.r,
                q,
                v: own,
                ahead: k.ahead.unwrap_or(0.0) * follows.rate,
                gravity: t.cos(),
                inertia: 0.1 * follows.acceleration,
            };
            let next = integrated(servo, &k, &at, (integral, period));
            let mean = if every == 1 {
                0.5 * (integral + next)
            } else {
                next
            };
            integral = next;
            u = output(servo, &k, &at, mean).u;
        }
        if i % EVERY == EVERY - 1 {
            out.push(u);
        }
    }
    out
}

#[test]
fn loops_of_the_wrapper_are_those_of_the_library() {
    let table = include_str!("../check/position_loops.json");
    let table: Vec<serde_json::Value> = serde_json::from_str(table).expect("a table");
    assert!(table.len() > 6);
    for case in table {
        let mut text = String::from("[joint.drive]\n");
        for (key, value) in case["loop"].as_object().expect("numbers") {
            writeln!(text, "{key} = {value}").expect("a text");
        }
        let nominal = behind_loop(&text, "");
        let own = outputs(nominal.servo(1).expect("a loop"));
        let theirs: Vec<f64> = serde_json::from_value(case["u"].clone()).expect("outputs");
        assert_eq!(own.len(), theirs.len());
        for (k, (a, b)) in own.iter().zip(&theirs).enumerate() {
            assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{text}{k}: {a} {b}");
        }
        let spread = theirs.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
        assert!(spread > 0.1 && spread.is_finite(), "{text}");
    }
}

/// Steps of the engine are of first order: behind a loop they are shorter, unless one is asked for.
#[test]
fn robots_behind_loops_have_shorter_steps() {
    let step = |nominal: &Nominal, asked: Option<f64>| {
        let mut options = Options::default();
        options.timestep = asked;
        let files = export(nominal, Target::Mujoco, &options).expect("files");
        let xml = files.iter().find(|f| f.name == "robot.xml");
        let text = &xml.expect("a robot").text;
        let from = text.find("timestep=\"").expect("a step") + 10;
        let to = text[from..].find('"').expect("an end") + from;
        text[from..to].parse::<f64>().expect("a number")
    };
    let looped = behind_loop(LOOP, "");
    assert_eq!(step(&described(""), None), 5e-4);
    assert_eq!(step(&looped, None), 1e-4);
    assert_eq!(step(&looped, Some(2e-3)), 2e-3);
}
