//! Findings of single families on small made records, their form as text and as JSON.

use pid_data::{Dataset, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind};
use pid_preflight::{Finding, FindingKind, Missing, Settings, Severity, check, fix};

use crate::plant::described;

/// A pendulum of 2 kg at 0.4 m, friction 0.2 N·m and 0.1 N·m·s/rad.
pub(crate) const PENDULUM: &str = r#"
[robot]
name = "pendulum"
gravity = [0.0, 0.0, -9.81]

[tolerance]
mass_rel = 0.05
com_abs_m = 0.003
inertia_rel = 0.05
rotor_inertia_rel = 0.05
motor_gain_rel = 0.01
friction_rel = 0.4

[[joint]]
name = "j1"
type = "revolute"
axis = [0.0, 1.0, 0.0]
origin = [0.0, 0.0, 0.0]
limits = [-2.0, 2.0]
mass = 2.0
com = [0.0, 0.0, -0.4]
inertia = [0.02, 0.02, 0.002, 0.0, 0.0, 0.0]
rotor_inertia = 0.01
coulomb = 0.2
viscous = 0.1
motor_gain = 1.0
input = "torque"
velocity = "measured"
torque_peak = 8.0
speed_scale = 2.0
"#;

/// Records of that pendulum, of inverse dynamics along a sum of sines: 10 s at 200 Hz.
pub(crate) fn swinging(amplitude: f64) -> Dataset {
    let tones = [(1.0, 1.3, 0.0), (0.4, 3.7, 1.0), (0.25, 8.1, 2.0)];
    let (mut t, mut q, mut v, mut u) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for k in 0..2000 {
        let time = 0.005 * f64::from(k);
        let sum = |f: &dyn Fn(f64, f64) -> f64| {
            tones
                .iter()
                .map(|&(a, w, p)| amplitude * a * f(w, w * time + p))
                .sum::<f64>()
        };
        let (x, dx, ddx) = (
            sum(&|_, s| s.sin()),
            sum(&|w, s| w * s.cos()),
            sum(&|w, s| -w * w * s.sin()),
        );
        t.push(time);
        q.push(x);
        v.push(dx);
        let inertia = 2.0 * 0.4 * 0.4 + 0.02 + 0.01;
        u.push(inertia * ddx + 2.0 * 9.81 * 0.4 * x.sin() + 0.2 * (50.0 * dx).tanh() + 0.1 * dx);
    }
    let joint = JointChannels {
        name: "j1".into(),
        prismatic: false,
        input: InputQuantity::Torque,
        input_unit: "N*m".into(),
        velocity: VelocityKind::Measured,
    };
    let experiment = pid_data::Experiment {
        name: "swing".into(),
        role: Role::Train,
        note: String::new(),
        nq: 1,
        t,
        q,
        v: Some(v),
        u,
        tau: None,
        qref: None,
        missing: 0,
        gain_factors: Default::default(),
    };
    Dataset {
        name: "made".into(),
        title: String::new(),
        source: String::new(),
        license: String::new(),
        kind: Kind::Simulated,
        input_hold: InputHold::Linear,
        joints: vec![joint],
        experiments: vec![experiment],
        warnings: Vec::new(),
    }
}

fn found(data: &Dataset) -> Vec<Finding> {
    check(data, &described(PENDULUM), &Settings::default())
}

/// The one finding of a kind.
fn only(findings: &[Finding], name: &str) -> Finding {
    let of: Vec<&Finding> = findings.iter().filter(|f| f.kind.name() == name).collect();
    assert_eq!(of.len(), 1, "{name} in {findings:#?}");
    of[0].clone()
}

#[test]
fn a_right_record_has_no_findings() {
    let all = found(&swinging(0.8));
    let worse: Vec<&Finding> = all.iter().filter(|f| f.severity > Severity::Note).collect();
    assert!(worse.is_empty(), "{worse:#?}");
    assert!(
        !all.iter().any(|f| matches!(
            f.kind,
            FindingKind::RateLow { .. } | FindingKind::Jitter { .. } | FindingKind::Outliers { .. }
        )),
        "{all:#?}"
    );
}

/// Targets are no torques: nothing is compared with the robot, and inputs that a log without any has
/// as zeros contradict nothing.
#[test]
fn targets_of_position_loops_are_not_taken_for_torques() {
    let drive = "[joint.drive]\nlaw = \"pd\"\nkp = 40.0\nkd = 1.0\n";
    let nominal = described(&format!("{PENDULUM}{drive}"));
    let mut data = swinging(0.8);
    let e = &mut data.experiments[0];
    e.qref = Some(e.q.clone());
    e.u.fill(0.0);
    let wrong = |data: &Dataset| {
        let all = check(data, &nominal, &Settings::default());
        let worse: Vec<&Finding> = all
            .iter()
            .filter(|f| f.severity == Severity::Wrong)
            .collect();
        assert!(worse.is_empty(), "{worse:#?}");
        let sentence = only(&all, "not-comparable").sentence;
        assert!(sentence.contains("targets of position loops"), "{sentence}");
    };
    wrong(&data);
    data.joints[0].input = InputQuantity::Position;
    data.joints[0].input_unit = "rad".into();
    data.experiments[0].u = data.experiments[0].q.clone();
    wrong(&data);
    // A target that is held while the joint goes on to it.
    let held = data.experiments[0].u[300] + 0.01;
    data.experiments[0].u[300..420].fill(held);
    wrong(&data);
    let all = check(&data, &nominal, &Settings::default());
    assert!(
        all.iter().all(|f| f.kind.name() != "frozen-channel"),
        "{all:#?}"
    );
    // Without a loop zeros are a fault of the record.
    data.joints[0].input = InputQuantity::Torque;
    data.joints[0].input_unit = "N*m".into();
    data.experiments[0].u.fill(0.0);
    assert_eq!(only(&found(&data), "zero-input").severity, Severity::Wrong);
}

#[test]
fn lost_rows_jitter_and_empty_cells_are_counted() {
    let mut data = swinging(0.8);
    let e = &mut data.experiments[0];
    for x in [&mut e.t, &mut e.q, &mut e.u, e.v.as_mut().unwrap()] {
        x.drain(700..710);
    }
    e.q[5] = f64::NAN;
    e.missing = 1;
    let jitter = |i: usize| if i.is_multiple_of(2) { 2e-4 } else { -2e-4 };
    e.t.iter_mut()
        .enumerate()
        .for_each(|(i, t)| *t += jitter(i));
    let all = found(&data);
    assert_eq!(
        only(&all, "lost-rows").kind,
        FindingKind::LostRows { count: 10 }
    );
    assert_eq!(only(&all, "lost-rows").rows, Some((699, 700)));
    assert_eq!(
        only(&all, "missing-samples").kind,
        FindingKind::MissingSamples { count: 1 }
    );
    let FindingKind::Jitter { share } = only(&all, "jitter").kind else {
        unreachable!()
    };
    // Every other row early, every other late: steps differ from their mean by two shifts.
    assert!((share - 0.08).abs() < 1e-3, "{share}");
}

#[test]
fn outliers_are_counted_and_set_aside() {
    let mut data = swinging(0.8);
    for row in [100, 700, 1500] {
        data.experiments[0].q[row] += 0.5;
    }
    let all = found(&data);
    assert_eq!(
        only(&all, "outliers").kind,
        FindingKind::Outliers { count: 3 }
    );
    assert!(all.iter().all(|f| f.severity == Severity::Note), "{all:#?}");
    let (mended, done) = fix(&data, &all);
    assert_eq!(done, ["took 3 outliers of q1 as missing"]);
    assert_eq!(mended.experiments[0].missing, 3);
    assert!(mended.experiments[0].q[700].is_nan() && mended.experiments[0].q[701].is_finite());
}

#[test]
fn a_jump_that_stays_is_no_wrap() {
    let mut data = swinging(0.5);
    data.experiments[0].q[1200..]
        .iter_mut()
        .for_each(|q| *q += 0.7);
    let jump = only(&found(&data), "jump");
    assert_eq!(jump.kind, FindingKind::Jump { count: 1 });
    assert!((jump.evidence[0].value - 0.7).abs() < 0.05, "{jump}");
    assert!(jump.sentence.contains("row 1200"), "{jump}");
}

#[test]
fn a_fast_motion_is_no_wrap() {
    // Degrees that are read as rad: 6.3 from row to row, there and back.
    let mut data = swinging(0.5);
    let burst = &mut data.experiments[0].q[1200..1220];
    for (k, q) in burst.iter_mut().enumerate() {
        *q += 6.3 * (k + 1).min(20 - k) as f64;
    }
    let all = found(&data);
    assert!(all.iter().all(|f| f.kind.name() != "wrapped"), "{all:#?}");
}

#[test]
fn a_bound_of_the_input_is_said() {
    let mut data = swinging(0.8);
    data.experiments[0]
        .u
        .iter_mut()
        .for_each(|u| *u = u.clamp(-4.0, 4.0));
    let saturated = only(&found(&data), "saturated");
    let FindingKind::Saturated { level } = saturated.kind else {
        unreachable!()
    };
    assert_eq!(level.abs(), 4.0);
}

#[test]
fn limits_of_the_description_are_compared_whole_turns_aside() {
    let mut data = swinging(1.6);
    let reached = only(&found(&data), "outside-limits");
    let FindingKind::OutsideLimits { limits, .. } = reached.kind else {
        unreachable!()
    };
    assert_eq!(limits, [-2.0, 2.0]);
    data = swinging(0.8);
    data.experiments[0]
        .q
        .iter_mut()
        .for_each(|q| *q -= std::f64::consts::TAU);
    assert!(
        found(&data)
            .iter()
            .all(|f| f.kind.name() != "outside-limits")
    );
}

#[test]
fn a_low_rate_is_said_with_what_can_still_be_told() {
    let mut data = swinging(0.8);
    let e = &mut data.experiments[0];
    for x in [&mut e.t, &mut e.q, &mut e.u, e.v.as_mut().unwrap()] {
        *x = x.iter().step_by(5).copied().collect();
    }
    let low = only(&found(&data), "rate-low");
    let FindingKind::RateLow { rate, needed } = low.kind else {
        unreachable!()
    };
    assert!((rate - 40.0).abs() < 1e-6 && needed >= 100.0, "{low}");
    assert!(
        low.mend
            .contains("gravity, inertia and friction can still be told"),
        "{low}"
    );
}

#[test]
fn motion_that_tells_nothing_is_named() {
    let mut data = swinging(0.8);
    // Fast swings only: the slow tone alone turns slowly.
    let e = &mut data.experiments[0];
    let swing = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { e.t.iter().map(|t| f(9.0 * t)).collect() };
    let (q, v) = (swing(&|s| 0.1 * s.sin()), swing(&|s| 0.9 * s.cos()));
    let u = swing(&|s| {
        let (x, dx) = (0.1 * s.sin(), 0.9 * s.cos());
        0.35 * -8.1 * s.sin() + 7.848 * x.sin() + 0.2 * (50.0 * dx).tanh() + 0.1 * dx
    });
    (e.q, e.v, e.u) = (q, Some(v), u);
    let all = found(&data);
    let missing: Vec<Missing> = all
        .iter()
        .filter_map(|f| {
            if let FindingKind::MotionMissing { motion } = f.kind {
                Some(motion)
            } else {
                None
            }
        })
        .collect();
    assert_eq!(missing, [Missing::SlowReversal, Missing::Range], "{all:#?}");
}

#[test]
fn what_a_resting_joint_does_not_tell_has_names() {
    let mut data = swinging(0.8);
    let e = &mut data.experiments[0];
    // Held at 0.5 rad with tiny noise of the encoder.
    let noise = |i: usize| 1e-5 * ((i * 7919 % 1000) as f64 / 500.0 - 1.0);
    e.q = (0..e.t.len()).map(|i| 0.5 + noise(i)).collect();
    e.v = Some((0..e.t.len()).map(|i| 10.0 * noise(i + 3)).collect());
    e.u = (0..e.t.len())
        .map(|i| 7.848 * 0.5_f64.sin() + noise(i + 5))
        .collect();
    let all = found(&data);
    only(&all, "joint-rests");
    let told = only(&all, "not-determined");
    let FindingKind::NotDetermined {
        names,
        rank,
        possible,
    } = &told.kind
    else {
        unreachable!()
    };
    assert!(names.iter().any(|n| n == "viscous_j1"), "{told}");
    assert!(rank < possible, "{told}");
}

#[test]
fn findings_are_json_and_back() {
    let mut data = swinging(0.8);
    data.experiments[0].u.iter_mut().for_each(|u| *u = -*u);
    let all = found(&data);
    let flipped = only(&all, "sign-flipped");
    let json = serde_json::to_value(&flipped).unwrap();
    assert_eq!(json["kind"], "sign-flipped");
    assert_eq!(json["severity"], "wrong");
    assert_eq!(json["joints"], serde_json::json!([1]));
    assert_eq!(json["columns"], serde_json::json!(["u1"]));
    let back: Vec<Finding> = serde_json::from_str(&serde_json::to_string(&all).unwrap()).unwrap();
    assert_eq!(back, all);
    // A pendulum cannot tell the sign of its input from that of its motion, and it is said.
    assert!(
        flipped
            .to_string()
            .starts_with("wrong: the input of joint 1 has the opposite sign (or its motion"),
        "{flipped}"
    );
    assert!(
        flipped
            .to_string()
            .contains("\n  help: change the sign of u"),
        "{flipped}"
    );
}

#[test]
fn short_and_empty_records_are_taken_without_a_panic() {
    for rows in [1, 2, 3, 5, 20, 29, 30, 31, 60] {
        let mut data = swinging(0.8);
        let e = &mut data.experiments[0];
        for x in [&mut e.t, &mut e.q, &mut e.u, e.v.as_mut().unwrap()] {
            x.truncate(rows);
        }
        let all = found(&data);
        // So few rows of a right record contradict nothing.
        let worse: Vec<&Finding> = all
            .iter()
            .filter(|f| f.severity == Severity::Wrong)
            .collect();
        assert!(worse.is_empty(), "{rows} rows: {worse:#?}");
    }
    let mut data = swinging(0.8);
    let e = &mut data.experiments[0];
    for x in [&mut e.t, &mut e.q, &mut e.u, e.v.as_mut().unwrap()] {
        x.clear();
    }
    // A record without rows has no columns that could be compared.
    assert_eq!(found(&data)[0].kind, FindingKind::NotComparable);
    let mut data = swinging(0.8);
    data.experiments[0].q.fill(f64::NAN);
    data.experiments[0].missing = 2000;
    assert_eq!(
        only(&found(&data), "missing-samples").kind,
        FindingKind::MissingSamples { count: 2000 }
    );
    let mut data = swinging(0.8);
    data.experiments[0].t[1999] = 1e9;
    let hole = only(&found(&data), "lost-rows");
    assert_eq!(hole.severity, Severity::Doubtful, "{hole}");
}
