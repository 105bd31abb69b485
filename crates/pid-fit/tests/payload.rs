//! Regressions over records that differ: a payload, offsets of each record, torques with outliers,
//! prior knowledge.

use pid_data::{Dataset, Experiment, InputHold, Role};
use pid_fit::inertia::pseudo_inertia::SUFFIXES;
use pid_fit::regress::judge::Errors;
use pid_fit::regress::record::Filtering;
use pid_fit::regress::solution::JointWeights;
use pid_fit::regress::{Options, Regression, regress};
use pid_fit::transcribe::Loss;
use pid_models::Ur10e;
use pid_runtime::dynamics::{At, Dynamics};
use pid_runtime::extend::Extended;

/// A body of 2.5 kg at the flange, in the frame of the last link: mass, first moment, inertia about
/// the origin.
const BODY: [f64; 10] = [2.5, 0.1, 0.4, 0.3, 0.12, 0.06, 0.08, -0.02, -0.015, -0.05];

fn model() -> Extended<'static> {
    Extended::new(&Ur10e, &["offset".parse().expect("a term")]).expect("fits")
}

fn position(name: &str) -> usize {
    let found = model().params().iter().position(|p| p.name == name);
    found.expect("a parameter")
}

/// Sums of sines, and the torques that the inverse dynamics ask for; with outliers, two samples of
/// forty are off by 60 N·m at one joint.
fn record(name: &str, role: Role, seed: f64, p: &[f64], outliers: bool) -> Experiment {
    let model = model();
    let (n, nq, step) = (2400, 6, 0.01);
    let (mut t, mut q, mut v, mut u) = (vec![], vec![], vec![], vec![]);
    for i in 0..n {
        let time = step * i as f64;
        let (mut x, mut dx, mut ddx) = ([0.0; 6], [0.0; 6], [0.0; 6]);
        for j in 0..nq {
            for k in 1..=4 {
                let w = 0.55 * f64::from(k) * (1.0 + 0.07 * j as f64);
                let phase = seed * (1.0 + j as f64) + 2.3 * f64::from(k * k);
                let a = 0.9 / f64::from(k);
                x[j] += a * (w * time + phase).sin();
                dx[j] += a * w * (w * time + phase).cos();
                ddx[j] -= a * w * w * (w * time + phase).sin();
            }
        }
        let at = At {
            q: &x,
            v: &dx,
            a: &ddx,
            u: &[0.0; 6],
            p,
        };
        let mut r = [0.0; 6];
        model.residual(&at, &mut r);
        if outliers && i % 40 < 2 {
            r[(i / 40) % nq] += 60.0;
        }
        t.push(time);
        q.extend(x);
        v.extend(dx);
        u.extend(r);
    }
    Experiment {
        name: name.into(),
        role,
        note: String::new(),
        nq,
        t,
        q,
        v: Some(v),
        u,
        tau: None,
        qref: None,
        missing: 0,
        gain_factors: Default::default(),
    }
}

/// Two records without the body and one with it, each with an offset of its own at the elbow; one
/// of each kind to be judged.
fn dataset(outliers: bool) -> Dataset {
    let model = model();
    let nominal: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let made = |name: &str, role, seed, offset| {
        let mut p = nominal.clone();
        p[position("offset_elbow")] = offset;
        if name.ends_with("_load") {
            for (suffix, value) in SUFFIXES.iter().zip(BODY) {
                p[position(&format!("wrist_3_{suffix}"))] += value;
            }
        }
        record(name, role, seed, &p, outliers)
    };
    let recipe = pid_fit::synthetic::Recipe {
        records: 1,
        seconds: 0.1,
        step: 0.01,
        amplitude: vec![0.0; 6],
        highest: 1.0,
        start: vec![0.0; 6],
        noise: vec![1e-6; 12],
        outliers: (0.0, 1.0),
    };
    let frame = pid_fit::synthetic::records(&model, &nominal, &recipe, 0).expect("simulates");
    Dataset {
        input_hold: InputHold::Linear,
        experiments: vec![
            made("a", Role::Train, 0.3, 1.0),
            made("b", Role::Train, 1.9, -2.0),
            made("c_load", Role::Train, 1.1, 4.0),
            made("d", Role::Test, 2.6, 1.0),
            made("e_load", Role::Test, 3.3, 1.0),
        ],
        ..frame
    }
}

/// An error of a gain scales the torques of one joint in all records. The deviation that a stated
/// error adds is therefore the slope of the whole regression along that scale.
#[test]
fn a_gain_known_to_a_tenth_leaves_the_payload_to_what_it_does_to_it() {
    let data = dataset(false);
    let plain = || Options {
        weights: JointWeights::Common,
        ..Options::default()
    };
    let mass = |found: &Regression| {
        let (value, deviation) = found.payload.as_ref().expect("a payload").values[0];
        (value, deviation.expect("pinned"))
    };
    let alone = mass(&run(&data, plain())).1;
    for joint in 0..6 {
        let scaled = |factor: f64| {
            let mut data = data.clone();
            for e in &mut data.experiments {
                e.u.iter_mut()
                    .skip(joint)
                    .step_by(6)
                    .for_each(|u| *u *= factor);
            }
            mass(&run(&data, plain())).0
        };
        let slope = (scaled(1.001) - scaled(0.999)) / 0.002;
        let mut gains = vec![0.0; 6];
        gains[joint] = 0.1;
        let with = mass(&run(&data, Options { gains, ..plain() })).1;
        let expected = (alone.powi(2) + (0.1 * slope).powi(2)).sqrt();
        assert!(
            (with / expected - 1.0).abs() < 1e-3,
            "joint {joint}: {with} {expected}"
        );
        // The payload hangs on the joints that bear it.
        assert!(joint != 1 || with > 0.02, "{with}");
    }
}

#[test]
fn deviations_of_gains_that_do_not_fit_are_refused() {
    let model = model();
    let start: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    for (gains, words) in [
        (vec![0.1; 5], "5 deviations of gains for 6 joints"),
        (
            vec![0.1, 0.1, -0.2, 0.1, 0.1, 0.1],
            "joint 3 has the deviation -0.2",
        ),
        (vec![f64::NAN; 6], "joint 1 has the deviation NaN"),
    ] {
        let options = Options {
            gains,
            ..Options::default()
        };
        let error = regress(&model, &dataset(false), &start, &options).expect_err("refused");
        let text = error.to_string();
        assert!(text.contains(words) && text.contains("help"), "{text}");
    }
}

fn run(dataset: &Dataset, options: Options) -> Regression {
    let model = model();
    let start: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let options = Options {
        filtering: Filtering {
            cutoff: Some(10.0),
            decimate: Some(2),
        },
        poses: 50,
        consistent: false,
        payload: Some("wrist_3=*_load".parse().expect("a payload")),
        private: vec!["offset_*".into()],
        ..options
    };
    regress(&model, dataset, &start, &options).expect("regresses")
}

fn value(found: &Regression, name: &str) -> f64 {
    let row = found.rows.iter().find(|r| r.formula == name);
    row.unwrap_or_else(|| {
        panic!(
            "{name}: {:?}",
            found.rows.iter().map(|r| &r.formula).collect::<Vec<_>>()
        )
    })
    .value
}

#[test]
fn one_fit_tells_robot_payload_and_offsets_apart() {
    let nominal: Vec<f64> = model().params().iter().map(|p| p.nominal).collect();
    let options = Options {
        judge: vec![("the robot alone".into(), nominal)],
        ..Options::default()
    };
    let found = run(&dataset(false), options);
    let payload = found.payload.as_ref().expect("asked for");
    for ((value, deviation), truth) in payload.values.iter().zip(BODY) {
        assert!((value - truth).abs() < 2e-3, "{value} {truth}");
        assert!(deviation.is_some_and(|d| d < 1e-2), "{deviation:?}");
    }
    for (record, offset) in [("a", 1.0), ("b", -2.0), ("c_load", 4.0)] {
        let found = value(&found, &format!("offset_elbow@{record}"));
        assert!((found - offset).abs() < 2e-2, "{record}: {found}");
    }
    // With the mean of the offsets, 1.0, the fit meets the unseen records, loaded or not, up to the
    // effect of the filter on dry friction where a joint reverses. The robot alone misses the
    // loaded one.
    let overall = |errors: &[Errors], record: &str| {
        let row = errors.iter().find(|e| e.records == record);
        row.and_then(|e| e.overall).expect("judged")
    };
    for record in ["d", "e_load"] {
        let error = overall(&found.errors, record);
        assert!(error < 1e-2, "{record}: {error}");
    }
    let alone = overall(&found.given[0].1, "e_load");
    assert!(alone > 0.1, "{alone}");
}

#[test]
fn outliers_of_the_torque_count_less_with_a_robust_loss() {
    let data = dataset(true);
    let error = |loss| {
        let found = run(
            &data,
            Options {
                loss,
                ..Options::default()
            },
        );
        let body = found.payload.expect("asked for").values;
        (body[0].0 - BODY[0]).abs()
    };
    let square = error(Loss::Square);
    for loss in [
        Loss::Huber { threshold: 1.345 },
        Loss::StudentT { freedom: 4.0 },
    ] {
        let robust = error(loss);
        assert!(robust < 0.5 * square, "{loss:?}: {robust} {square}");
    }
}

#[test]
fn a_prior_settles_what_the_records_leave_open() {
    let prior = |deviation| Options {
        priors: vec![("payload_m".into(), 3.0, deviation)],
        ..Options::default()
    };
    let data = dataset(false);
    // Against noise-free records a wide prior says nothing, a narrow one everything.
    let mass = |deviation| {
        run(&data, prior(deviation))
            .payload
            .expect("asked for")
            .values[0]
            .0
    };
    assert!((mass(10.0) - 2.5).abs() < 2e-3);
    assert!((mass(1e-9) - 3.0).abs() < 1e-3);
    let unknown = regress(
        &model(),
        &data,
        &model()
            .params()
            .iter()
            .map(|p| p.nominal)
            .collect::<Vec<f64>>(),
        &Options {
            priors: vec![("payload_m".into(), 3.0, 1.0)],
            ..Options::default()
        },
    );
    let message = unknown.expect_err("no payload").to_string();
    assert!(message.contains("`payload_m`"), "{message}");
}
