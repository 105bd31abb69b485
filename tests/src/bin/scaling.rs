//! How time and memory of an identification grow with the record: trapezoidal rule, one window, noise, and a plant with Stribeck
//! friction that the model lacks.
//!
//! ```text
//! scaling [--two-link N,N,…] [--arm N,N,…] [--limit SECONDS]
//! ```
//!
//! The two-link robot moves under sums of sines at 50 Hz, the six-axis arm (84 parameters) under inverse-dynamics control at 100 Hz;
//! the record grows with N. Starts are the true values times 0.8. Seconds are of the processor, all threads together;
//! memory is the largest of the process so far, so numbers of samples shall grow.
#![allow(clippy::print_stdout, reason = "a command that prints a table")]

use std::f64::consts::TAU;
use std::ops::ControlFlow;
use std::time::Duration;

use cpu_time::ProcessTime;
use pid_models::{Arm6, TwoLink};
use pid_runtime::data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_runtime::dynamics::{At, Dynamics, Hessian, JointInfo};
use pid_runtime::ident::{Settings, Weighting, identify};
use pid_runtime::integrate::{self, Drive, Simulator};
use pid_runtime::solver;
use pid_runtime::transcribe::Scheme;
use pid_tests::two_link;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut sizes = [vec![1_000, 10_000, 100_000], vec![1_000, 10_000]];
    let mut limit = 600.0;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let value = args
            .next()
            .ok_or("every option takes a value; see the head of this file")?;
        let list = || -> Result<Vec<usize>, Failure> {
            let numbers = value.split(',').filter(|n| !n.is_empty());
            Ok(numbers.map(str::parse).collect::<Result<_, _>>()?)
        };
        match arg.as_str() {
            "--two-link" => sizes[0] = list()?,
            "--arm" => sizes[1] = list()?,
            "--limit" => limit = value.parse()?,
            other => {
                return Err(format!("unknown option {other}; see the head of this file").into());
            }
        }
    }
    let limit = Duration::try_from_secs_f64(limit)?;
    let two_link: (&dyn Hessian, &Control) = (&TwoLink, &sines);
    let arm: (&dyn Hessian, &Control) = (&Arm6, &follow);
    for ((model, control), (sizes, step)) in [two_link, arm]
        .into_iter()
        .zip(sizes.iter().zip([0.02, 0.01]))
    {
        if sizes.is_empty() {
            continue;
        }
        println!(
            "{}: {} parameters, step {step} s",
            model.name(),
            model.dims().np
        );
        println!(
            "samples  iterations            J   seconds  ms/iteration  µs/iteration/sample  peak MiB"
        );
        for &samples in sizes {
            grow(model, control, samples, step, limit)?;
        }
    }
    Ok(())
}

fn grow(
    model: &dyn Hessian,
    control: &Control,
    samples: usize,
    step: f64,
    limit: Duration,
) -> Result<(), Failure> {
    let dataset = record(model, control, samples, step)?;
    let start: Vec<f64> = model
        .params()
        .iter()
        .map(|p| (0.8 * p.nominal).clamp(p.lower, p.upper))
        .collect();
    let settings = Settings {
        weighting: Weighting::Spread,
        solver: solver::Settings {
            max_time: Some(limit),
            ..Settings::default().solver
        },
        ..two_link::settings(Scheme::Trapezoidal)
    };
    let clock = ProcessTime::now();
    let found = identify(model, &dataset, &settings, Some(&start), &mut |_| {
        ControlFlow::Continue(())
    })?;
    let run = found.best();
    let seconds = clock.elapsed().as_secs_f64();
    let each = seconds / run.iterations.max(1) as f64;
    println!(
        "{samples:7} {:11} {:12.4e} {seconds:9.3} {:13.2} {:20.2} {:>9}  {}",
        run.iterations,
        run.objective,
        1e3 * each,
        1e6 * each / samples as f64,
        peak_memory().map_or_else(|| "-".to_owned(), |m| format!("{m:.0}")),
        run.status.reason()
    );
    Ok(())
}

/// Largest memory of this process so far, MiB, where the system tells.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

/// Inputs at a time from what is measured: (t, q, v, gains) → u.
type Control = dyn Fn(f64, &[f64], &[f64], &[f64]) -> Vec<f64>;

/// Currents of the two-link robot.
fn sines(t: f64, _: &[f64], _: &[f64], _: &[f64]) -> Vec<f64> {
    const PARTS: [[(f64, f64, f64); 4]; 2] = [
        [
            (12.0, 0.25, 0.0),
            (12.0, 0.61, 1.0),
            (10.0, 1.13, 2.0),
            (8.0, 1.97, 0.5),
        ],
        [
            (70.0, 0.21, 0.3),
            (60.0, 0.47, 2.1),
            (50.0, 0.83, 4.0),
            (40.0, 1.39, 1.2),
        ],
    ];
    let sum = |parts: &[(f64, f64, f64); 4]| {
        parts
            .iter()
            .map(|(a, f, phase)| a * (TAU * f * t + phase).sin())
            .sum()
    };
    PARTS.iter().map(sum).collect()
}

/// Where axis `j` of the arm shall be, how fast, and its acceleration.
fn reference(t: f64, j: usize) -> [f64; 3] {
    let centre = [0.0, -0.8, 1.2, -0.6, 0.4, 0.0][j];
    let [mut q, mut v, mut a_to] = [centre, 0.0, 0.0];
    for (a, f, phase) in [(0.45, 0.11, 0.9), (0.25, 0.37, 2.3), (0.08, 0.97, 4.1)] {
        let (f, phase) = (f * (1.0 + 0.13 * j as f64), phase * (1 + j) as f64);
        let angle = TAU * f * t + phase;
        q += a * angle.sin();
        v += a * TAU * f * angle.cos();
        a_to -= a * (TAU * f).powi(2) * angle.sin();
    }
    [q, v, a_to]
}

/// The arm under control by its inverse dynamics, loops of 20 rad/s with critical damping.
fn follow(t: f64, q: &[f64], v: &[f64], gains: &[f64]) -> Vec<f64> {
    let one = |j: usize| {
        let [to_q, to_v, to_a] = reference(t, j);
        to_a + 400.0 * (to_q - q[j]) + 40.0 * (to_v - v[j])
    };
    let a: Vec<f64> = (0..6).map(one).collect();
    let p: Vec<f64> = Arm6.params().iter().map(|p| p.nominal).collect();
    let mut force = [0.0; 6];
    let at = At {
        q,
        v,
        a: &a,
        u: &[0.0; 6],
        p: &p,
    };
    // Without input the residual is the force that the drives must bring.
    Arm6.residual(&at, &mut force);
    force.iter().zip(gains).map(|(f, gain)| f / gain).collect()
}

/// Stribeck friction at a joint, which the model does not know of: a share of its dry friction that fades with speed.
fn stribeck(dry: f64, v: f64) -> f64 {
    0.3 * dry * (-(v / 0.3).powi(2)).exp() * (20.0 * v).tanh()
}

/// A record of so many samples, with noise of 1e-3 rad and 1e-2 rad/s.
fn record(
    model: &dyn Hessian,
    control: &Control,
    samples: usize,
    step: f64,
) -> Result<Dataset, Failure> {
    let nq = model.dims().nq;
    let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let named = |prefix: &str| -> Vec<f64> {
        let wanted = model
            .params()
            .iter()
            .zip(&p)
            .filter(|(i, _)| i.name.starts_with(prefix));
        wanted.map(|(_, p)| *p).collect()
    };
    let (gains, dry) = (named("gain_"), named("dry_"));
    let loose = integrate::Settings {
        rtol: 1e-6,
        atol: 1e-8,
        ..integrate::Settings::default()
    };
    let mut simulator = Simulator::with_derivatives(model, loose);
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut gaussian = || -> f64 {
        let (a, b): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
    };
    let (mut q, mut v) = (vec![0.0; nq], vec![0.0; nq]);
    if nq == 6 {
        (0..nq).for_each(|j| [q[j], v[j], _] = reference(0.0, j));
    } else {
        q.copy_from_slice(&[0.3, 2.2]);
    }
    let (mut qs, mut vs) = (vec![0.0; 2 * nq], vec![0.0; 2 * nq]);
    let t: Vec<f64> = (0..samples).map(|k| k as f64 * step).collect();
    let (mut all_q, mut all_v, mut all_u) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..samples {
        let u = control(t[k], &q, &v, &gains);
        all_q.extend(q.iter().map(|q| q + 1e-3 * gaussian()));
        all_v.extend(v.iter().map(|v| v + 1e-2 * gaussian()));
        all_u.extend_from_slice(&u);
        if k + 1 < samples {
            // What acts is the recorded input less the friction that the model lacks, as it is at the sample.
            let mut held = [u.as_slice(), u.as_slice()].concat();
            for (k, held) in held.iter_mut().enumerate() {
                let j = k % nq;
                *held -= stribeck(dry[j], v[j]) / gains[j];
            }
            let drive = Drive {
                t: &t[k..k + 2],
                u: &held,
                hold: InputHold::ZeroOrder,
            };
            simulator.run(&p, &q, &v, &drive, &mut qs, &mut vs)?;
            q.copy_from_slice(&qs[nq..]);
            v.copy_from_slice(&vs[nq..]);
        }
    }
    let joint = |j: &JointInfo| JointChannels {
        name: j.name.to_string(),
        prismatic: false,
        input: InputQuantity::Current,
        input_unit: "A".to_owned(),
        velocity: VelocityKind::Measured,
    };
    Ok(Dataset {
        name: model.name().to_owned(),
        title: "Record for the growth of time and memory".to_owned(),
        source: "simulated with noise and Stribeck friction".to_owned(),
        license: "CC0-1.0".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: model.joints().iter().map(joint).collect(),
        experiments: vec![Experiment {
            name: "train".to_owned(),
            role: Role::Train,
            note: String::new(),
            nq,
            t,
            q: all_q,
            v: Some(all_v),
            u: all_u,
            tau: None,
            qref: None,
            missing: 0,
        }],
        warnings: Vec::new(),
    })
}
