//! Behind a position servo: targets and positions alone, at 100 Hz, with gains that are not known.

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_diagnose::case::Case;
use pid_diagnose::diagnosis::Diagnosis;
use pid_diagnose::effect::Term;
use pid_diagnose::effects::by_id;
use pid_diagnose::extended::free_run_gap;
use pid_diagnose::hypothesis::{Hypothesis, Run};
use pid_diagnose::loop_gain::{LoopGain, Told};
use pid_diagnose::nominal::Nominal;
use pid_diagnose::predict::Runner;
use pid_diagnose::report::Report;
use pid_diagnose::screen::candidates;
use pid_diagnose::search::Settings;
use pid_diagnose::terms;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::common::{identified, runs_as_diagnosed};

const STEP: f64 = 0.01;
const SAMPLES: usize = 800;
/// Deviation of a position reading, rad: as the descriptions state it.
const READING: f64 = 3e-4;

/// Drives of the joints: `[kp, kd]` as the robot has them.
type Loops<'a> = &'a [[f64; 2]];

/// A bar on a servo, or a leg of three joints, with loops as a text.
fn robot(joints: usize, drive: &dyn Fn(usize) -> String) -> Nominal {
    let mut text = String::from(
        "[robot]\nname = \"leg\"\ngravity = [0.0, 0.0, -9.81]\nhorizon_s = 1.0\ninput_noise = 0.002\n\
         [tolerance]\nmass_rel = 0.02\ncom_abs_m = 0.002\ninertia_rel = 0.03\nrotor_inertia_rel = 0.03\n\
         motor_gain_rel = 0.0\nfriction_rel = 0.5\n",
    );
    let rows = [
        (
            "[1.0, 0.0, 0.0]",
            "[0.0, 0.0, 0.0]",
            1.4,
            "[0.01, 0.02, -0.03]",
            "[0.003, 0.004, 0.004, 0.0, 0.0, 0.0]",
            0.4,
            0.16,
        ),
        (
            "[0.0, 1.0, 0.0]",
            "[0.0, 0.06, 0.0]",
            2.1,
            "[0.0, 0.01, -0.08]",
            "[0.017, 0.017, 0.003, 0.0, 0.0, 0.0]",
            0.5,
            0.24,
        ),
        (
            "[0.0, 1.0, 0.0]",
            "[0.0, 0.01, -0.22]",
            0.6,
            "[0.0, 0.0, -0.1]",
            "[0.0046, 0.0046, 0.0003, 0.0, 0.0, 0.0]",
            0.25,
            0.14,
        ),
    ];
    let first = if joints == 1 { 1 } else { 0 };
    for (j, (axis, origin, mass, com, inertia, coulomb, viscous)) in
        rows[first..first + joints].iter().enumerate()
    {
        text.push_str(&format!(
            "[[joint]]\nname = \"j{}\"\ntype = \"revolute\"\naxis = {axis}\norigin = {origin}\nmass = {mass}\ncom = {com}\n\
             inertia = {inertia}\nrotor_inertia = 0.032\ncoulomb = {coulomb}\nviscous = {viscous}\nmotor_gain = 1.0\n\
             input = \"torque\"\nvelocity = \"absent\"\nq_noise_std = {READING}\ntorque_peak = 4.0\n{}",
            j + 1,
            drive(j)
        ));
    }
    Nominal::parse(&text, "nominal.toml".as_ref()).expect("a robot")
}

fn pd(kp: &str, kd: &str) -> String {
    format!("[joint.drive]\nlaw = \"pd\"\nkp = {kp}\nkd = {kd}\nlimit = 20.0\n")
}

/// The robot as it is.
fn real(loops: Loops<'_>) -> Nominal {
    robot(loops.len(), &|j| {
        let [kp, kd] = loops[j];
        pd(&kp.to_string(), &kd.to_string())
    })
}

/// The robot as it is described: gains off by a factor, within ± 30 %.
fn stated(loops: Loops<'_>, off: f64) -> Nominal {
    robot(loops.len(), &|j| {
        let gain = |x: f64| format!("{{ value = {}, tolerance_rel = 0.3 }}", x * off);
        pd(&gain(loops[j][0]), &gain(loops[j][1]))
    })
}

/// Targets of a joint: slow sines and steps between rests.
fn targets(random: &mut ChaCha8Rng, record: usize) -> Vec<f64> {
    let waves: Vec<[f64; 3]> = (0..4)
        .map(|k| {
            let f = 0.2 + 0.5 * f64::from(k) + 0.2 * random.random::<f64>();
            let size = 0.35 / (1.0 + f64::from(k));
            [f, size, std::f64::consts::TAU * random.random::<f64>()]
        })
        .collect();
    let mut step = 0.0;
    (0..SAMPLES)
        .map(|k| {
            if k % 80 == 0 {
                step = 0.5 * (random.random::<f64>() - 0.5);
            }
            let t = STEP * k as f64;
            let wave =
                |[f, a, p]: &[f64; 3]| a * ((std::f64::consts::TAU * f * t + p).sin() - p.sin());
            match record % 2 {
                0 => waves.iter().map(wave).sum(),
                _ => step,
            }
        })
        .collect()
}

/// Records of the robot with an effect at a joint (from 0): targets and noisy positions.
fn records(loops: Loops<'_>, effect: Option<(&str, usize, &[f64])>, seed: u64) -> Dataset {
    let (n, mut random) = (loops.len(), ChaCha8Rng::seed_from_u64(seed));
    let experiments = (0..5)
        .map(|i| {
            let r: Vec<Vec<f64>> = (0..n).map(|_| targets(&mut random, i)).collect();
            let rows: Vec<f64> = (0..SAMPLES)
                .flat_map(|k| r.iter().map(move |r| r[k]))
                .collect();
            Experiment {
                name: format!("r{i}"),
                role: if i < 3 { Role::Train } else { Role::Test },
                note: String::new(),
                nq: n,
                t: (0..SAMPLES).map(|k| STEP * k as f64).collect(),
                q: vec![0.0; n * SAMPLES],
                v: None,
                u: rows.clone(),
                tau: None,
                qref: Some(rows),
                missing: 0,
                gain_factors: Default::default(),
            }
        })
        .collect();
    let mut dataset = Dataset {
        name: "servo".to_owned(),
        title: String::new(),
        source: "simulated".to_owned(),
        license: "none".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: (0..n)
            .map(|j| JointChannels {
                name: format!("j{}", j + 1),
                prismatic: false,
                input: InputQuantity::Position,
                input_unit: "rad".to_owned(),
                velocity: VelocityKind::Absent,
            })
            .collect(),
        experiments,
        warnings: Vec::new(),
    };
    let case = Case::new(real(loops), &dataset).expect("a case");
    let terms = effect.iter().map(|&(id, joint, _)| Term {
        effect: by_id(id).expect("an effect"),
        joint,
    });
    let hypothesis = Hypothesis {
        terms: terms.collect(),
        // Steps of a quarter of those of the diagnosis.
        run: Run {
            finer: 4,
            initial_states: false,
            short: false,
        },
    };
    let theta = vec![0.0; case.nominal.size()];
    for (i, record) in case.records.iter().enumerate() {
        let e = effect.map_or(&[][..], |(_, _, e)| e);
        let mut runner = Runner::<f64>::new(&case, record, &hypothesis, &theta, e);
        let state = runner.start(0);
        let q = &mut dataset.experiments[i].q;
        for (j, q) in q.iter_mut().take(n).enumerate() {
            *q = state.drive_q[j] + READING * random.sample::<f64, _>(StandardNormal);
        }
        runner.free(&state, 0, SAMPLES - 1, &mut |k, j, position, _| {
            q[n * k + j] = position + READING * random.sample::<f64, _>(StandardNormal);
        });
    }
    dataset
}

fn diagnosed(nominal: Nominal, dataset: &Dataset) -> Report {
    Report::new(nominal, dataset, &Settings::default(), false).expect("a diagnosis")
}

/// What is called determined lies within 5 % of the truth; what is not is not printed as known.
fn gains_hold(d: &Diagnosis, loops: Loops<'_>) {
    assert_eq!(d.loop_gains.len(), 2 * loops.len(), "{:?}", d.loop_gains);
    for g in &d.loop_gains {
        let truth = loops[g.joint - 1][usize::from(g.gain == "kd")];
        if g.told == Told::Determined {
            assert!((g.value / truth - 1.0).abs() < 0.05, "{g:?} {truth}");
        } else {
            assert!(!g.words().contains(" instead of "));
        }
    }
}

fn kp(d: &Diagnosis, joint: usize) -> &LoopGain {
    let own = d
        .loop_gains
        .iter()
        .find(|g| g.joint == joint && g.gain == "kp");
    own.expect("a gain")
}

fn found(d: &Diagnosis) -> (String, Option<usize>) {
    (d.verdict.word().to_owned(), d.verdict.joint())
}

const ONE: Loops<'_> = &[[30.0, 2.0]];
const THREE: Loops<'_> = &[[40.0, 3.0], [37.0, 3.0], [14.0, 1.1]];

#[test]
fn a_servo_without_a_missing_effect_has_its_gains_and_none() {
    let dataset = records(ONE, None, 1);
    let report = diagnosed(stated(ONE, 1.25), &dataset);
    let d = report.diagnosis();
    assert_eq!(found(d), ("none".to_owned(), None), "{d:?}");
    gains_hold(d, ONE);
    assert_eq!(kp(d, 1).told, Told::Determined, "{:?}", d.loop_gains);
    assert!(
        kp(d, 1).words().contains(" instead of 37.5"),
        "{}",
        kp(d, 1).words()
    );
    // The description with what was found keeps the loop and runs as well.
    runs_as_diagnosed(&report, &dataset);
}

#[test]
fn a_target_that_arrives_late_is_found_without_inputs() {
    let dataset = records(ONE, Some(("input_delay", 0, &[0.022])), 2);
    let report = diagnosed(stated(ONE, 0.8), &dataset);
    let d = report.diagnosis();
    // On one joint a late reading is the same map.
    assert!(
        ["input_delay", "sensor_delay"].contains(&d.verdict.word()) && d.verdict.joint() == Some(1),
        "{d:?}"
    );
    let delay = &d.effects[0].parameters[0];
    assert!((delay.value - 0.022).abs() < 0.003, "{delay:?}");
    gains_hold(d, ONE);
}

#[test]
fn stribeck_friction_is_found_behind_a_servo() {
    let dataset = records(ONE, Some(("stribeck", 0, &[1.2, 0.08])), 3);
    let report = diagnosed(stated(ONE, 1.2), &dataset);
    let d = report.diagnosis();
    assert_eq!(found(d), ("stribeck".to_owned(), Some(1)), "{d:?}");
    gains_hold(d, ONE);
}

#[test]
fn a_leg_behind_servos_has_its_late_joint_or_none() {
    let dataset = records(THREE, None, 4);
    let report = diagnosed(stated(THREE, 1.2), &dataset);
    let d = report.diagnosis();
    assert_eq!(found(d), ("none".to_owned(), None), "{d:?}");
    gains_hold(d, THREE);
    let dataset = records(THREE, Some(("input_delay", 1, &[0.024])), 5);
    let report = diagnosed(stated(THREE, 0.8), &dataset);
    let d = report.diagnosis();
    assert_eq!(found(d), ("input_delay".to_owned(), Some(2)), "{d:?}");
    gains_hold(d, THREE);
}

/// Gains by the program with exact derivatives: `[kp, kd]` of each joint.
fn gains(nominal: &Nominal, dataset: &Dataset) -> Vec<[f64; 2]> {
    let found = identified(nominal, dataset);
    let joints = nominal.description.robot().joints.iter();
    joints
        .map(|j| ["kp", "kd"].map(|gain| found[&format!("{gain}_{}", j.name)]))
        .collect()
}

#[test]
fn gains_are_identified_from_targets_and_positions() {
    for (loops, nominal) in [
        (ONE, stated(ONE, 1.25)),
        (
            ONE,
            robot(1, &|_| pd("{ unknown = true }", "{ unknown = true }")),
        ),
        (THREE, stated(THREE, 0.8)),
    ] {
        let found = gains(&nominal, &records(loops, None, 8));
        for (own, truth) in found.iter().zip(loops) {
            // What creeps under tanh(v/v₀) where the servo sticks makes a gain 3 % smaller, whatever the steps.
            let [kp, kd] = [own[0] / truth[0] - 1.0, own[1] / truth[1] - 1.0];
            assert!(kp.abs() < 0.05 && kd.abs() < 0.1, "{found:?} {loops:?}");
        }
    }
}

/// Records of one servo with kp and of the same with twice as much, in both roles; `rules` say how the gains differ.
fn at_two_gains(seed: u64, rules: &[&str]) -> Dataset {
    let [[kp, kd]] = *ONE else {
        unreachable!("one joint")
    };
    let mut dataset = records(ONE, None, seed);
    let twice = records(&[[2.0 * kp, kd]], None, seed);
    for i in [1, 2, 4] {
        dataset.experiments[i] = twice.experiments[i].clone();
    }
    let rules: Vec<_> = rules.iter().map(|rule| rule.parse()).collect();
    let rules: Result<Vec<_>, _> = rules.into_iter().collect();
    let rules = rules.expect("rules");
    dataset.with_gain_factors(&rules).expect("factors")
}

const TWICE: [&str; 3] = ["r1=kp:2", "r2=kp:2", "r4=kp:2"];

/// The records were made without factors.
#[test]
fn gains_that_differ_by_record_are_one_gain() {
    let dataset = at_two_gains(9, &TWICE);
    let report = diagnosed(stated(ONE, 1.2), &dataset);
    let d = report.diagnosis();
    assert_eq!(found(d), ("none".to_owned(), None), "{d:?}");
    gains_hold(d, ONE);
    assert_eq!(kp(d, 1).told, Told::Determined, "{:?}", d.loop_gains);
    let [[kp, kd]] = gains(&stated(ONE, 1.2), &dataset)[..] else {
        panic!("one joint")
    };
    let [off, damping] = [kp / ONE[0][0] - 1.0, kd / ONE[0][1] - 1.0];
    assert!(off.abs() < 0.05 && damping.abs() < 0.1, "{kp} {kd}");
    let unknown = robot(1, &|_| pd("{ unknown = true }", "{ unknown = true }"));
    let case = Case::new(unknown, &dataset).expect("a case");
    for (i, times) in [(0, 1.0), (1, 2.0)] {
        let start = case.force_per_input(&case.records[i], 0);
        assert!((start / (times * ONE[0][0]) - 1.0).abs() < 0.3, "{start}");
    }
    // One gain for all of them leaves more than the noise.
    let gap = |dataset: &Dataset| free_run_gap(real(ONE), dataset).expect("a gap").total;
    let (right, one) = (gap(&dataset), gap(&at_two_gains(9, &[])));
    assert!(one > 5.0 * right, "{one} {right}");
}

#[test]
fn a_factor_of_a_gain_that_no_loop_has_is_refused() {
    let dataset = at_two_gains(9, &["r1=ki:2"]);
    let error = Case::new(real(ONE), &dataset).expect_err("pd has no ki");
    let text = error.to_string();
    for part in ["record `r1`", "gain_factors.ki = 2", "joint `j1`", "help:"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn unknown_gains_start_from_the_record() {
    let dataset = records(ONE, None, 6);
    let unknown = robot(1, &|_| pd("{ unknown = true }", "{ unknown = true }"));
    let case = Case::new(unknown, &dataset).expect("a case");
    let kp = case.force_per_input(&case.records[0], 0);
    assert!((kp / 30.0 - 1.0).abs() < 0.3, "{kp}");
}

#[test]
fn what_of_a_loop_cannot_be_is_told() {
    let dataset = records(ONE, None, 7);
    let told = |nominal: Nominal, data: &Dataset| {
        Case::new(nominal, data)
            .err()
            .map(|e| e.to_string())
            .unwrap_or_default()
    };
    let bare = robot(1, &|_| String::new());
    let message = told(bare, &dataset);
    assert!(
        message.contains("no position loop for it") && message.contains("[drive]"),
        "{message}"
    );

    let mut inputs = dataset.clone();
    inputs.joints[0].input = InputQuantity::Torque;
    for e in &mut inputs.experiments {
        e.qref = None;
    }
    let message = told(real(ONE), &inputs);
    assert!(message.contains("no column qref1"), "{message}");

    // 30 N m/rad on about 0.06 kg m²: 22 rad/s, far above what 5 Hz can hold.
    let slow = robot(1, &|_| pd("30.0", "2.0") + "rate_hz = 5.0\n");
    let message = told(slow, &dataset);
    assert!(
        message.contains("nominal.toml:") && message.contains("at 5 Hz the loop swings up"),
        "{message}"
    );

    let mut away = dataset.clone();
    for e in &mut away.experiments {
        e.u.iter_mut().for_each(|r| *r = -*r);
    }
    let unknown = robot(1, &|_| pd("{ unknown = true }", "{ unknown = true }"));
    let message = told(unknown, &away);
    assert!(
        message.contains("no force pushes it towards its targets"),
        "{message}"
    );

    // 30 000 N m/rad: the loop answers between the samples of the record.
    let stiff = robot(1, &|_| pd("30000.0", "60.0"));
    let case = Case::new(stiff, &dataset).expect("a case");
    assert!(
        case.loop_warnings
            .iter()
            .any(|w| w.contains("between samples")),
        "{:?}",
        case.loop_warnings
    );
}

/// A supply that sags is asked for where several drives load it, behind their loops too.
#[test]
fn a_common_supply_is_asked_for_behind_loops() {
    let loops = [[40.0, 1.2], [35.0, 1.0], [25.0, 0.5]];
    let asked = |joints: usize| {
        let own = &loops[..joints];
        let case = Case::new(real(own), &records(own, None, 31)).expect("a case");
        let found = candidates(&case, &terms::all(), &Hypothesis::default());
        let mut ids = found.iter().map(|(term, _)| term.effect.info().id);
        ids.any(|id| id == "supply_sag")
    };
    assert_eq!([1, 3].map(asked), [false, true]);
}
