//! Columns of records for states that no sensor reads and for inputs of the samples before.

use pid_data::{Dataset, Experiment, InputQuantity, VelocityKind};

/// Median time between the samples of the first record, s.
pub(in super::super) fn step(dataset: &Dataset) -> f64 {
    let t = dataset.experiments.first().map_or(&[][..], |e| &e.t);
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(1.0)
}

/// Where a coordinate that no sensor reads starts along the records.
#[derive(Debug, Clone, Copy)]
pub(in super::super) enum Starts<'a> {
    /// The rotor of a gear: where the joint is.
    Joint,
    /// A memory of which no record tells anything: at zero.
    Zero,
    /// Where these columns say, one for each record.
    Along(&'a [Vec<f64>]),
}

/// Adds a coordinate that no sensor reads to the records.
pub(in super::super) fn add_state(
    dataset: &mut Dataset,
    joint: usize,
    starts: Starts<'_>,
    name: &str,
) {
    let nq = dataset.nq();
    for (i, e) in dataset.experiments.iter_mut().enumerate() {
        add_column(e, nq, joint, (starts, i));
    }
    let mut channel = dataset.joints[joint].clone();
    channel.name = name.to_owned();
    channel.input_unit = dataset.joints[joint].force_unit().to_owned();
    channel.input = match channel.prismatic {
        true => InputQuantity::Force,
        false => InputQuantity::Torque,
    };
    if !matches!(starts, Starts::Joint) {
        channel.velocity = VelocityKind::Absent;
    }
    dataset.joints.push(channel);
}

fn add_column(e: &mut Experiment, nq: usize, joint: usize, (starts, record): (Starts<'_>, usize)) {
    let nu = e.nu();
    let wide = |x: &[f64], fill: &dyn Fn(usize, f64) -> f64| -> Vec<f64> {
        let rows = x.chunks_exact(nq).enumerate();
        rows.flat_map(|(i, row)| {
            let more = fill(i, row[joint]);
            row.iter().copied().chain([more]).collect::<Vec<f64>>()
        })
        .collect()
    };
    let nothing = |_: usize, _: f64| f64::NAN;
    match starts {
        Starts::Joint => {
            e.q = wide(&e.q, &|_, x| x);
            e.v = e.v.take().map(|v| wide(&v, &|_, x| x));
        }
        Starts::Zero => {
            // The value is zero at the start of the record and is read nowhere else.
            e.q = wide(&e.q, &|i, _| if i == 0 { 0.0 } else { f64::NAN });
            e.v = e.v.take().map(|v| wide(&v, &nothing));
        }
        Starts::Along(columns) => {
            e.q = wide(&e.q, &|i, _| columns[record][i]);
            e.v = e.v.take().map(|v| wide(&v, &nothing));
        }
    }
    e.tau = e.tau.take().map(|x| wide(&x, &nothing));
    e.qref = e.qref.take().map(|x| wide(&x, &nothing));
    let rows = e.u.chunks_exact(nu);
    e.u = rows
        .flat_map(|row| [&row[..nq], &[0.0], &row[nq..]].concat())
        .collect();
    e.nq += 1;
}

/// Adds the inputs of the samples before as columns, oldest first; before the first there is the first.
pub(super) fn add_past(dataset: &mut Dataset, input: usize, count: usize) {
    for e in &mut dataset.experiments {
        let nu = e.nu();
        let own: Vec<f64> = e.u.iter().skip(input).step_by(nu).copied().collect();
        let rows = e.u.chunks_exact(nu).enumerate();
        e.u = rows
            .flat_map(|(k, row)| {
                let past = (1..=count).rev().map(|b| own[k.saturating_sub(b)]);
                row.iter().copied().chain(past).collect::<Vec<f64>>()
            })
            .collect();
    }
}
