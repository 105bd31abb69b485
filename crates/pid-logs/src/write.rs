//! A data set as text: `dataset.toml` and one CSV file for each record.

use std::fmt::Write as _;

use pid_data::{Dataset, Experiment, InputHold, JointChannels, Kind, VelocityKind};

use crate::settings::Assumption;

/// File name and text of all files of a data set, `dataset.toml` first.
pub(crate) fn files(
    dataset: &Dataset,
    assumptions: &[Assumption],
    warnings: &[String],
) -> Vec<(String, String)> {
    let mut files = vec![(
        "dataset.toml".to_owned(),
        manifest(dataset, assumptions, warnings),
    )];
    files.extend(
        dataset
            .experiments
            .iter()
            .map(|e| (format!("{}.csv", e.name), csv(e, &dataset.joints))),
    );
    files
}

fn manifest(d: &Dataset, assumptions: &[Assumption], warnings: &[String]) -> String {
    let mut out = String::new();
    let mut comment = |head: &str, lines: Vec<String>| {
        if !lines.is_empty() {
            let _ = writeln!(out, "# {head}");
        }
        for line in lines {
            let line = line.replace(|c: char| c.is_control(), " ");
            let _ = writeln!(out, "# - {line}");
        }
    };
    comment(
        "What was assumed when the logs were read:",
        assumptions.iter().map(ToString::to_string).collect(),
    );
    comment("What was odd:", warnings.to_vec());
    let kind = match d.kind {
        Kind::Real => "real",
        Kind::Simulated => "simulated",
    };
    let hold = match d.input_hold {
        InputHold::ZeroOrder => "zero-order",
        InputHold::Linear => "linear",
    };
    for (key, value) in [
        ("name", d.name.as_str()),
        ("title", &d.title),
        ("source", &d.source),
        ("license", &d.license),
        ("kind", kind),
        ("input_hold", hold),
    ] {
        let _ = writeln!(out, "{key} = {}", quoted(value));
    }
    for joint in &d.joints {
        let velocity = match joint.velocity {
            VelocityKind::Measured => "measured",
            VelocityKind::Derived => "derived",
            VelocityKind::Absent => "absent",
        };
        let kind = if joint.prismatic {
            "prismatic"
        } else {
            "revolute"
        };
        let _ = write!(
            out,
            "\n[[joint]]\nname = {}\ntype = \"{kind}\"\ninput = \"{}\"\ninput_unit = \"{}\"\nvelocity = \"{velocity}\"\n",
            quoted(&joint.name),
            joint.input.word(),
            joint.input_unit
        );
    }
    for e in &d.experiments {
        let file = quoted(&format!("{}.csv", e.name));
        let _ = write!(
            out,
            "\n[[experiment]]\nfile = {file}\nrole = \"{}\"\nsamples = {}\nnote = {}\n",
            e.role,
            e.len(),
            quoted(&e.note)
        );
        let own: Vec<String> = (e.gain_factors.stated())
            .map(|(key, factors)| format!("{key} = {factors:?}"))
            .collect();
        if !own.is_empty() {
            let _ = writeln!(out, "gain_factors = {{ {} }}", own.join(", "));
        }
        if !e.gain_factors.off().is_empty() {
            let _ = writeln!(out, "off = {:?}", e.gain_factors.off());
        }
    }
    out
}

/// A basic string of TOML.
fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// One record. Numbers have as many digits as it takes to read the same number back.
fn csv(e: &Experiment, joints: &[JointChannels]) -> String {
    let n = e.nq;
    let each = |stem: &'static str| (1..=n).map(move |j| format!("{stem}{j}"));
    let moving: Vec<usize> = (0..n)
        .filter(|&j| joints[j].velocity != VelocityKind::Absent)
        .collect();
    let mut names = vec!["t".to_owned()];
    names.extend(each("q"));
    if e.v.is_some() {
        names.extend(moving.iter().map(|j| format!("dq{}", j + 1)));
    }
    names.extend(each("u"));
    names.extend(e.tau.iter().flat_map(|_| each("tau")));
    names.extend(e.qref.iter().flat_map(|_| each("qref")));
    let mut out = names.join(",");
    out.push('\n');
    for (i, t) in e.t.iter().enumerate() {
        let _ = write!(out, "{t:?}");
        let mut cell = |value: f64| {
            out.push(',');
            if value.is_finite() {
                let _ = write!(out, "{value:?}");
            }
        };
        let row = i * n..(i + 1) * n;
        e.q[row.clone()].iter().copied().for_each(&mut cell);
        if let Some(v) = &e.v {
            moving.iter().map(|j| v[i * n + j]).for_each(&mut cell);
        }
        e.u[row.clone()].iter().copied().for_each(&mut cell);
        for channel in [&e.tau, &e.qref].into_iter().flatten() {
            channel[row.clone()].iter().copied().for_each(&mut cell);
        }
        out.push('\n');
    }
    out
}
