//! Derivatives of the predictor's innovations from the very first sample on, against differences:
//! the state at the start is read through the sensor, and moves with the sensor's parameters.

use std::fmt::Write as _;

use num_dual::Dual64;
use pid_diagnose::case::Case;
use pid_diagnose::effect::Term;
use pid_diagnose::effects;
use pid_diagnose::fit::{Point, all_gains};
use pid_diagnose::hypothesis::Hypothesis;
use pid_diagnose::predict::Runner;

const PENDULUM: &str = include_str!("pendulum.toml");

fn case() -> Case {
    let here = std::env::temp_dir().join(format!("pid-start-{}", std::process::id()));
    std::fs::create_dir_all(&here).expect("a folder");
    let mut set = String::from(
        "name = \"one\"\ntitle = \"\"\nsource = \"\"\nlicense = \"\"\nkind = \"simulated\"\ninput_hold = \"zero-order\"\n[[joint]]\nname = \"a\"\ntype = \"revolute\"\ninput = \"current\"\ninput_unit = \"A\"\nvelocity = \"measured\"\n",
    );
    for (file, role) in [("a.csv", "train"), ("b.csv", "test")] {
        let mut text = String::from("t,q1,dq1,u1\n");
        for k in 0..400 {
            let t = f64::from(k) * 2e-3;
            let (q, v) = (0.7 + 0.2 * (3.0 * t).sin(), 0.6 * (3.0 * t).cos());
            let _ = writeln!(text, "{t:.6},{q:.9},{v:.9},{:.9}", 1.0 + (5.0 * t).sin());
        }
        std::fs::write(here.join(file), text).expect("a record");
        let _ = write!(
            set,
            "[[experiment]]\nfile = \"{file}\"\nrole = \"{role}\"\nsample_time_s = 0.002\nsamples = 400\nnote = \"\"\n"
        );
    }
    std::fs::write(here.join("dataset.toml"), set).expect("a description");
    // Without dry friction the innovations are differentiable everywhere.
    let smooth = PENDULUM.replace("coulomb = 0.1", "coulomb = 0.0");
    assert_ne!(smooth, PENDULUM);
    std::fs::write(here.join("nominal.toml"), smooth).expect("a robot");
    let case = Case::read(&here).expect("a case");
    std::fs::remove_dir_all(&here).expect("removed");
    case
}

#[test]
fn innovations_of_sensor_effects_have_their_derivatives() {
    let case = case();
    for (id, e) in [
        ("encoder_offset", vec![0.03]),
        ("encoder_eccentricity", vec![0.04, 0.7]),
    ] {
        let hypothesis = Hypothesis::new(vec![Term {
            effect: effects::by_id(id).expect("in the library"),
            joint: 0,
        }]);
        let theta = vec![0.0; 14];
        let at = Point {
            theta: theta.clone(),
            e: e.clone(),
        };
        let gains = all_gains(&case, &hypothesis, &at);
        let record = &case.records[0];
        let plain = |e: &[f64]| {
            let mut out = Vec::new();
            Runner::<f64>::new(&case, record, &hypothesis, &theta, e).predict(
                &gains[0],
                &mut |_, _, _, x| out.push(x),
                &mut |_, _| {},
            );
            out
        };
        for i in 0..e.len() {
            let duals: Vec<Dual64> = e
                .iter()
                .enumerate()
                .map(|(k, x)| Dual64::new(*x, f64::from(u8::from(k == i))))
                .collect();
            let lifted: Vec<Dual64> = theta.iter().map(|x| Dual64::from(*x)).collect();
            let mut slopes = Vec::new();
            Runner::<Dual64>::new(&case, record, &hypothesis, &lifted, &duals).predict(
                &gains[0],
                &mut |_, _, _, x| slopes.push(x.eps),
                &mut |_, _| {},
            );
            let step = 1e-5;
            let (mut up, mut down) = (e.clone(), e.clone());
            up[i] += step;
            down[i] -= step;
            let (up, down) = (plain(&up), plain(&down));
            let size = slopes.iter().fold(1e-3_f64, |a, s| a.max(s.abs()));
            assert!(!slopes.is_empty());
            for (k, s) in slopes.iter().enumerate() {
                let difference = (up[k] - down[k]) / (2.0 * step);
                assert!(
                    (difference - s).abs() < 1e-4 * size,
                    "{id} {i} at row {k}: {difference} {s}"
                );
            }
        }
    }
}
