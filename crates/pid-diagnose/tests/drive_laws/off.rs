//! Drives that are off in some records: open terminals, without back-EMF.

use pid_data::{Dataset, Role};
use pid_diagnose::extended::free_run_gap;
use pid_diagnose::loop_gain::Told;
use pid_diagnose::nominal::Nominal;
use pid_diagnose::report::Report;

use super::rig::{Loop, PD, described, records};
use super::{RIVALS, told};
use crate::common::{among, runs_as_diagnosed};

/// A servo without damping of its own but that by the voltage which its motor induces.
const HOBBY: Loop = Loop {
    kd: 0.0,
    back_emf: 0.35,
    ..PD
};

fn robot(drive: &str) -> Nominal {
    let bar = described("law = \"p\"\nkp = 1.0");
    let text = (bar.description.to_toml()).expect("a description");
    let (head, _) = text.split_once("[joint.drive]").expect("a drive");
    let head = head.replace("input = \"current\"", "input = \"voltage\"");
    let text = format!("{head}[joint.drive]\nlaw = \"p\"\nlimit = 6.0\n{drive}\n");
    Nominal::parse(&text, "nominal.toml".as_ref()).expect("a description")
}

/// Samples of a fall before its record begins: at 0.15 s the bar moves.
const LATER: usize = 15;

/// Driven records, and two in which the bar falls from 1.2 and from 0.8 rad.
fn driven_and_falling(seed: u64) -> Dataset {
    let mut out = records(&HOBBY, None, 0.0, seed);
    let off = Loop { off: true, ..HOBBY };
    let blank = out.experiments[0].clone();
    for (name, role, from) in [("drop_a", Role::Train, 1.2), ("drop_b", Role::Test, 0.8)] {
        let start = vec![from; blank.len() + LATER];
        let noise = blank.q.iter().zip(HOBBY.run(&blank.u, None, 0.0));
        let noise: Vec<f64> = noise.map(|(read, q)| read - q).collect();
        let falls = off.run(&start, None, 0.0).split_off(LATER);
        let mut e = blank.clone();
        (e.name, e.role, e.qref) = (name.to_owned(), role, None);
        e.q = falls
            .iter()
            .zip(noise)
            .map(|(q, noise)| q + noise)
            .collect();
        e.u = vec![0.0; e.len()];
        out.experiments.push(e);
    }
    out
}

/// What the drive brakes with and what friction does: both together in driven records, friction alone in the others.
#[test]
fn a_drive_that_is_off_tells_friction_from_back_emf() {
    let falls = "kp = { value = 13.5, tolerance_rel = 0.3 }\nback_emf = { value = 0.25, tolerance_rel = 0.8 }";
    let (dataset, rule) = (
        driven_and_falling(31),
        "drop_*=off".parse().expect("a rule"),
    );
    let off = dataset
        .clone()
        .with_gain_factors(&[rule])
        .expect("a rule that fits");
    let report = Report::new(robot(falls), &off, &among(&RIVALS), false).expect("a diagnosis");
    let d = report.diagnosis();
    assert_eq!(d.verdict.word(), "none", "{d:?}");
    let gain = |own: &str| d.loop_gains.iter().find(|g| g.gain == own).expect("a gain");
    for (name, truth, within) in [("kp", 12.0, 0.05), ("back_emf", 0.35, 0.1)] {
        let value = gain(name).value;
        assert!(
            (value / truth - 1.0).abs() < within,
            "{name} {value} {truth}"
        );
    }
    assert_eq!(told(d, "kp"), Told::Determined, "{:?}", d.loop_gains);
    runs_as_diagnosed(&report, &off);

    // With the drive on the bar would be held where it is.
    let exact = || robot("kp = 12.0\nback_emf = 0.35");
    let gap = |dataset: &Dataset| free_run_gap(exact(), dataset).expect("a gap").total;
    let mut held = dataset.clone();
    for e in &mut held.experiments {
        e.u = e.qref.clone().unwrap_or_else(|| vec![e.q[0]; e.len()]);
    }
    let (right, wrong) = (gap(&off), gap(&held));
    assert!(wrong > 10.0 * right, "{wrong} {right}");
}
