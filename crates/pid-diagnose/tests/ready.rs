//! The ready descriptions of robots behind position loops (`examples`): free runs against an integrator of its own, on
//! the study's rigid bodies. Joints are without dry friction here.

use nalgebra::{DMatrix, DVector};
use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_diagnose::case::Case;
use pid_diagnose::hypothesis::Hypothesis;
use pid_diagnose::nominal::Nominal;
use pid_diagnose::predict::Runner;
use pid_withheld::linkage::{Linkage, Surroundings};
use pid_withheld::plant::{PER_JOINT, Plant};

/// Samples of a record, their distance and the step of the integrator, s.
const SAMPLES: usize = 300;
const H: f64 = 0.01;
const STEP: f64 = 5e-5;

/// A ready description, and values for its unknown gains.
struct Ready {
    text: &'static str,
    kp: f64,
    kd: f64,
    ki: f64,
    /// Largest velocity that a cascade asks for.
    cascade: Option<f64>,
    /// Period of the loop and of the targets, s.
    period: f64,
    target: f64,
    unknown: usize,
}

const HOBBY_SERVO: Ready = Ready {
    text: include_str!("../../../examples/hobby_servo/nominal.toml"),
    kp: 60.0,
    kd: 0.0,
    ki: 0.0,
    cascade: None,
    period: STEP,
    target: H,
    unknown: 1,
};
const LEG: Ready = Ready {
    text: include_str!("../../../examples/leg/nominal.toml"),
    kp: 40.0,
    kd: 1.0,
    ki: 0.0,
    cascade: None,
    period: 1e-3,
    target: 0.02,
    unknown: 6,
};
const ARM: Ready = Ready {
    text: include_str!("../../../examples/arm_cascade/nominal.toml"),
    kp: 6.0,
    kd: 8.0,
    ki: 20.0,
    cascade: Some(3.0),
    period: 2e-3,
    target: H,
    unknown: 9,
};

impl Ready {
    /// The description with its gains, without dry friction and velocities.
    fn exact(&self) -> String {
        let line = |line: &str| -> String {
            let key = line.split(' ').next().unwrap_or_default();
            let gain = match key {
                "kp" => self.kp,
                "kd" | "kv" => self.kd,
                "ki" => self.ki,
                "coulomb" => return "coulomb = 1e-9".to_owned(),
                "velocity" => return "velocity = \"absent\"".to_owned(),
                _ => return line.to_owned(),
            };
            format!("{key} = {gain:?}")
        };
        let lines: Vec<String> = self.text.lines().map(line).collect();
        lines.join("\n")
    }

    /// Targets of all joints at a sample: from zero, within half a radian.
    fn targets(n: usize) -> Vec<f64> {
        let mut out = Vec::new();
        for k in 0..SAMPLES {
            let t = H * k as f64;
            let grown = 1.0 - (-t * t).exp();
            let wave = |j: usize| grown * 0.5 * ((1.7 + 0.6 * j as f64) * t + j as f64).sin();
            out.extend((0..n).map(wave));
        }
        out
    }

    /// Positions at the samples, from rest at zero.
    fn run(&self, nominal: &Nominal, targets: &[f64]) -> Vec<f64> {
        let n = nominal.n();
        let plant = Plant::<f64>::new(&nominal.description, &vec![0.0; n * PER_JOINT]);
        let around = Surroundings {
            gravity: plant.gravity,
            tip_force: None,
        };
        let mut linkage: Linkage<f64> = plant.linkage();
        let mut terms = |q: &[f64], v: &[f64]| {
            let (mut mass, mut bias) = (vec![0.0; n * n], vec![0.0; n]);
            linkage.mass_and_bias(&around, (q, v), &mut mass, &mut bias);
            (mass, bias)
        };
        let (mut q, mut v, mut output) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let (mut integral, mut taken) = (vec![0.0; n], vec![0.0; n]);
        let each = |time: f64| (time / STEP).round() as usize;
        let mut out = Vec::new();
        for k in 0..SAMPLES * each(H) {
            let sample = k / each(H);
            if k % each(H) == 0 {
                out.extend_from_slice(&q);
            }
            if k % each(self.target) == 0 {
                taken.copy_from_slice(&targets[sample * n..(sample + 1) * n]);
            }
            if k % each(self.period) == 0 {
                let (_, weight) = terms(&q, &vec![0.0; n]);
                for j in 0..n {
                    let error = taken[j] - q[j];
                    output[j] = match self.cascade {
                        None => self.kp * error - self.kd * v[j],
                        Some(most) => {
                            let lacks = (self.kp * error).clamp(-most, most) - v[j];
                            integral[j] += self.ki * lacks * self.period;
                            self.kd * lacks + integral[j] + weight[j]
                        }
                    };
                }
            }
            let (mut mass, bias) = terms(&q, &v);
            let mut force = bias;
            for j in 0..n {
                mass[j * n + j] += plant.rotor[j];
                force[j] = plant.gain[j] * output[j] - plant.viscous[j] * v[j] - force[j];
            }
            let a = DMatrix::from_vec(n, n, mass)
                .lu()
                .solve(&DVector::from_vec(force));
            let a = a.expect("a mass matrix");
            for j in 0..n {
                v[j] += STEP * a[j];
                q[j] += STEP * v[j];
            }
        }
        out
    }
}

fn record(nominal: &Nominal, q: Vec<f64>, targets: Vec<f64>) -> Dataset {
    let joint = |j: &pid_diagnose::nominal::Joint| JointChannels {
        name: j.name.clone(),
        prismatic: false,
        input: InputQuantity::Position,
        input_unit: "rad".to_owned(),
        velocity: VelocityKind::Absent,
    };
    let experiment = |(name, role): (&str, Role)| Experiment {
        name: name.to_owned(),
        role,
        note: String::new(),
        nq: nominal.n(),
        t: (0..SAMPLES).map(|k| H * k as f64).collect(),
        q: q.clone(),
        v: None,
        u: targets.clone(),
        tau: None,
        qref: Some(targets.clone()),
        missing: 0,
        gain_factors: Default::default(),
    };
    Dataset {
        name: "ready".to_owned(),
        title: String::new(),
        source: "simulated".to_owned(),
        license: "none".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: nominal.joints.iter().map(joint).collect(),
        experiments: [("a", Role::Train), ("b", Role::Test)]
            .map(experiment)
            .to_vec(),
        warnings: Vec::new(),
    }
}

#[test]
fn ready_descriptions_are_simulated_as_by_an_integrator_of_its_own() {
    for ready in [HOBBY_SERVO, LEG, ARM] {
        let read = |text: &str| {
            Nominal::parse(text, "nominal.toml".as_ref()).unwrap_or_else(|e| panic!("{e}"))
        };
        let (stated, exact) = (read(ready.text), read(&ready.exact()));
        let name = exact.name.clone();
        let n = exact.n();
        let targets = Ready::targets(n);
        let q = ready.run(&exact, &targets);
        let dataset = record(&exact, q.clone(), targets);
        let free = |case: &Case| {
            let values = case.nominal.values.iter();
            values.filter(|value| value.half_width > 0.0).count()
        };
        let open = Case::new(stated, &dataset).expect("a case");
        let case = Case::new(exact, &dataset).expect("a case");
        assert_eq!(free(&open), free(&case) + ready.unknown, "{name}");
        let theta = vec![0.0; case.nominal.size()];
        let nothing = Hypothesis::default();
        let mut runner = Runner::<f64>::new(&case, &case.records[1], &nothing, &theta, &[]);
        let state = runner.start(0);
        let (mut off, mut most) = (0.0_f64, 0.0_f64);
        runner.free(&state, 0, SAMPLES - 1, &mut |k, j, at, _| {
            off = off.max((at - q[k * n + j]).abs());
            most = most.max(q[k * n + j].abs());
        });
        eprintln!("{name}: {off:.1e} of {most:.2} rad");
        assert!(most > 0.3 && off < 2e-3, "{name}: {off} of {most}");
    }
}
