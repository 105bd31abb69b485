//! From a data set and a description to a [`Case`]: equal times, wrong readings left out, typical
//! sizes and noise levels.

use std::path::Path;

use pid_data::signal;
use pid_data::{Dataset, Experiment, InputHold, Role, VelocityKind};
use pid_interpret::links;

use crate::case::{Case, CaseError, Channel, Noise, Outlier, Record, Scale, Velocity, smoothed};
use crate::channel;
use crate::constants::{Constant, Constants};
use crate::hypothesis::Run;
use crate::known::Known;
use crate::nominal::{Joint, Nominal, NominalError};
use crate::outlier::least_deviation;
use crate::{first, regular, servo};

/// Fewest samples of a record.
const SHORTEST: usize = 50;

/// Drive noise to start from where it is not stated, share of the typical torque.
const FIRST_GUESS: f64 = 0.003;

/// A record in the coordinates of a description, at equal times and without wrong readings, which go
/// to `outliers`; inputs are straight lines between samples where `linear`.
fn record(
    e: &Experiment,
    nominal: &Nominal,
    velocity: &[Velocity],
    linear: bool,
    outliers: &mut Vec<Outlier>,
) -> Result<Record, CaseError> {
    if e.len() < SHORTEST {
        return Err(CaseError::Short {
            record: e.name.clone(),
            samples: e.len(),
            needed: SHORTEST,
        });
    }
    let n = nominal.n();
    let column = |x: &[f64], j: usize| x.iter().skip(j).step_by(n).copied().collect::<Vec<f64>>();
    let equal = regular::needed(&e.t);
    let t = equal.as_deref().unwrap_or(&e.t);
    let reading = |x: Vec<f64>| match &equal {
        Some(at) => regular::readings(&e.t, &x, at),
        None => x,
    };
    let input = |mut u: Vec<f64>| {
        signal::fill_missing(&e.t, &mut u);
        match &equal {
            Some(at) if linear => regular::lines(&e.t, &u, at),
            Some(at) => regular::held(&e.t, &u, at),
            None => u,
        }
    };
    let mut gated = |channel: Channel, j: usize, x: Vec<f64>| {
        let joint = &nominal.joints[j];
        let step = (channel == Channel::Velocity && velocity[j] == Velocity::Derived)
            .then(|| e.sample_time());
        let least = least_deviation(channel, joint, &x, step);
        without_outliers(e, (joint, channel), (x, least), outliers)
    };
    let q: Vec<Vec<f64>> = (0..n)
        .map(|j| reading(gated(Channel::Position, j, column(&e.q, j))))
        .collect();
    let v = (0..n)
        .map(|j| match e.v.as_deref().map(|v| column(v, j)) {
            Some(v) => reading(gated(Channel::Velocity, j, v)),
            None => vec![f64::NAN; t.len()],
        })
        .collect();
    let u = (0..n)
        .map(|j| {
            let own = column(&e.u, j);
            // A target is commanded, not read.
            input(match nominal.description.servo(j) {
                Some(_) => own,
                None => gated(Channel::Input, j, own),
            })
        })
        .collect();
    let smooth = q.iter().map(|q| {
        let mut q = q.clone();
        signal::fill_missing(t, &mut q);
        smoothed(t, q)
    });
    let (smooth_q, smooth_v): (Vec<Vec<f64>>, Vec<Vec<f64>>) = smooth.unzip();
    let h = match equal.is_some() {
        true => t[1] - t[0],
        false => e.sample_time(),
    };
    Ok(Record {
        name: e.name.clone(),
        role: e.role,
        h,
        uneven: equal.is_some(),
        first_v: first_velocities(&q, &smooth_v, h),
        begin: 0.0,
        q,
        v,
        u,
        smooth_q,
        smooth_v,
        gain_factors: e.gain_factors.clone(),
        whole: None,
    })
}

/// Velocities of all joints at the first sample, by the readings of the positions.
fn first_velocities(q: &[Vec<f64>], smooth_v: &[Vec<f64>], h: f64) -> Vec<f64> {
    let speed = |v: &[f64]| v.iter().fold(0.0_f64, |largest, v| largest.max(v.abs()));
    let each = q.iter().zip(smooth_v);
    each.map(|(q, v)| first::velocity(q, h, speed(v))).collect()
}

/// Readings of a joint with those that are errors of the recording missing; these go to `outliers`.
fn without_outliers(
    e: &Experiment,
    (joint, channel): (&Joint, Channel),
    (mut x, least): (Vec<f64>, f64),
    outliers: &mut Vec<Outlier>,
) -> Vec<f64> {
    for k in signal::outliers(&e.t, &x, least) {
        x[k] = f64::NAN;
        outliers.push(Outlier {
            record: e.name.clone(),
            joint: joint.name.clone(),
            channel,
            t: e.t[k],
        });
    }
    x
}

impl Case {
    /// Reads a folder with `dataset.toml`, its records and `nominal.toml`.
    ///
    /// # Errors
    /// If something is absent, malformed or too short.
    pub fn read(folder: &Path) -> Result<Self, CaseError> {
        let dataset = Dataset::read(folder)?;
        let nominal = Nominal::read(folder)?;
        Self::new(nominal.clone(), &nominal.records(&dataset))
    }

    /// From a description and records in its coordinates ([`Nominal::records`]).
    ///
    /// # Errors
    /// As [`Case::read`].
    pub fn new(nominal: Nominal, dataset: &Dataset) -> Result<Self, CaseError> {
        let n = nominal.n();
        if dataset.nq() != n {
            return Err(NominalError::Joints {
                nominal: n,
                data: dataset.nq(),
            }
            .into());
        }
        for role in [Role::Train, Role::Test] {
            if dataset.with_role(role).next().is_none() {
                return Err(CaseError::NoRole { role });
            }
        }
        let velocity: Vec<Velocity> = dataset
            .joints
            .iter()
            .map(|j| match j.velocity {
                VelocityKind::Measured => Velocity::Measured,
                VelocityKind::Derived => Velocity::Derived,
                VelocityKind::Absent => Velocity::Absent,
            })
            .collect();
        let commanded = servo::targets(&nominal, dataset)?;
        let (dataset, recorded) = match &commanded {
            Some((targets, recorded)) => (targets, Some(recorded)),
            None => (dataset, None),
        };
        let mut outliers = Vec::new();
        let linear = dataset.input_hold == InputHold::Linear;
        let records = (dataset.experiments.iter())
            .map(|e| record(e, &nominal, &velocity, linear, &mut outliers))
            .collect::<Result<Vec<Record>, CaseError>>()?;
        let mut case = Case {
            name: dataset.name.clone(),
            linear_hold: linear,
            velocity,
            scale: Vec::new(),
            noise: Vec::new(),
            tip: (1.0, 1.0),
            passing: Vec::new(),
            known: Known::of(&nominal.description).map_err(NominalError::from)?,
            outliers,
            loop_warnings: Vec::new(),
            staged: Vec::new(),
            shared_lag: 0.0,
            ahead: 1.0,
            nominal,
            records,
        };
        case.shared_lag = channel::shared_lag(&case);
        case.measure();
        if let Some(recorded) = recorded {
            let mut odd = servo::begin(&mut case, recorded)?;
            odd.extend(servo::checked(&case)?);
            case.loop_warnings = odd;
        }
        case.as_simulated();
        Ok(case)
    }

    /// Levels, sizes and substeps as an earlier diagnosis had them, where the description states them.
    fn as_simulated(&mut self) {
        let Some(simulated) = self.nominal.description.simulated() else {
            return;
        };
        for ((noise, scale), own) in self
            .noise
            .iter_mut()
            .zip(&mut self.scale)
            .zip(&simulated.joints)
        {
            noise.q = own.position_noise;
            noise.v = own.velocity_noise;
            noise.torque = own.torque_noise;
            noise.passed = own.passed_noise;
            scale.torque = own.torque;
            scale.inertia = own.inertia;
        }
        self.known.hypothesis.run = Run {
            finer: simulated.substeps,
            short: simulated.short_substeps,
            initial_states: simulated.hidden_states,
        };
    }

    /// Typical sizes and noise levels.
    fn measure(&mut self) {
        let n = self.n();
        let (inertia, passing) = self.inertia();
        self.passing = passing;
        let forces = match self.nominal.description.has_servos() {
            true => servo::needed(self),
            false => Vec::new(),
        };
        for j in 0..n {
            let (joint, gain) = (&self.nominal.joints[j], self.nominal.gain(j));
            let all = |f: &dyn Fn(&Record) -> &Vec<f64>| -> Vec<f64> {
                let mut x: Vec<f64> = self
                    .records
                    .iter()
                    .flat_map(|r| f(r).iter().copied())
                    .collect();
                x.sort_by(f64::total_cmp);
                x
            };
            let q = all(&|r| &r.smooth_q[j]);
            let v = all(&|r| &r.smooth_v[j]);
            let u = match self.nominal.description.servo(j) {
                None => all(&|r| &r.u[j]),
                // What acts is the output of the loop: that which the motion takes.
                Some(_) => {
                    let force = forces.iter().flat_map(|f| f[j].iter().copied());
                    let mut u: Vec<f64> = force.map(|f| f / gain).collect();
                    u.sort_by(f64::total_cmp);
                    u
                }
            };
            let at = |x: &[f64], share: f64| x[((x.len() - 1) as f64 * share) as usize];
            let largest = at(&u, 0.002).abs().max(at(&u, 0.998).abs());
            let torque = joint
                .torque_peak
                .unwrap_or((largest * gain).abs())
                .max(1e-9);
            self.scale.push(Scale {
                torque,
                input: largest.max(1e-9),
                speed: at(&v, 0.002).abs().max(at(&v, 0.998).abs()).max(1e-9),
                range: (q[q.len() - 1] - q[0]).max(1e-9),
                inertia: inertia[j],
            });
            self.noise.push(self.noise_of(j, torque));
        }
        self.pass_on();
        let second = 1.min(n - 1);
        self.tip = (
            self.scale[second].torque / self.nominal.reach.max(0.05),
            self.last_mass().max(1e-6),
        );
    }

    /// Noise levels of joint `j`, stated or read off the records; `torque` is its typical torque.
    fn noise_of(&self, j: usize, torque: f64) -> Noise {
        let (joint, gain) = (&self.nominal.joints[j], self.nominal.gain(j));
        let level = |f: &dyn Fn(&Record) -> &Vec<f64>| {
            let mut x: Vec<f64> = self
                .records
                .iter()
                .map(|r| signal::noise_level_without_jumps(f(r)))
                .filter(|x| x.is_finite())
                .collect();
            x.sort_by(f64::total_cmp);
            x.first().copied().unwrap_or(0.0)
        };
        let quantum = joint.resolution.unwrap_or(0.0) / 12f64.sqrt();
        let q_noise = joint
            .position_noise
            .unwrap_or_else(|| level(&|r| &r.q[j]).max(quantum));
        let v_noise = match joint.velocity_noise {
            Some(x) if x > 0.0 => x,
            _ => level(&|r| &r.v[j]),
        };
        Noise {
            q: q_noise.max(1e-12),
            v: v_noise.max(1e-9),
            // A first guess where it is not stated; it is settled with the fit.
            torque: match joint.input_noise {
                Some(x) => (x * gain.abs()).max(1e-6 * torque),
                None => FIRST_GUESS * torque,
            },
            passed: 0.0,
            stated: joint.input_noise.is_some(),
        }
    }

    /// Mass of the body that carries the tool, kg; 1 of a robot without bodies.
    fn last_mass(&self) -> f64 {
        let constants = Constants::<f64>::new(&self.nominal, &vec![0.0; self.nominal.size()]);
        let tool = self.nominal.links.tool();
        tool.map_or(1.0, |(body, _)| constants.get(Constant::Mass(body)))
    }

    /// Inertia of each joint with the others free, median over the records, and [`Case::passing`].
    fn inertia(&self) -> (Vec<f64>, Vec<Vec<f64>>) {
        let n = self.n();
        let constants = Constants::<f64>::new(&self.nominal, &vec![0.0; self.nominal.size()]);
        let (mut work, mut bias) = (constants.prepared(), vec![0.0; n]);
        let mut seen = vec![Vec::new(); n];
        let (mut passing, mut count) = (vec![vec![0.0; n]; n], 0.0_f64);
        for r in &self.records {
            for k in (0..r.len()).step_by((r.len() / 20).max(1)) {
                let q: Vec<f64> = (0..n).map(|j| r.smooth_q[j][k]).collect();
                let at = links::At {
                    q: &q,
                    v: &vec![0.0; n],
                    force: None,
                };
                let programs = &self.nominal.links;
                programs.evaluate(&mut work, &at, f64::sin_cos, &mut bias);
                let mut m = nalgebra::DMatrix::from_fn(n, n, |i, j| {
                    let (row, column) = (i.max(j), i.min(j));
                    work.mass()[row * (row + 1) / 2 + column]
                });
                for j in 0..n {
                    m[(j, j)] += constants.get(Constant::Rotor(j));
                }
                if let Some(inverse) = m.try_inverse() {
                    count += 1.0;
                    for j in 0..n {
                        seen[j].push(1.0 / inverse[(j, j)]);
                        for i in (0..n).filter(|&i| i != j) {
                            passing[j][i] += (inverse[(j, i)] / inverse[(j, j)]).powi(2);
                        }
                    }
                }
            }
        }
        for share in passing.iter_mut().flatten() {
            *share = (*share / count.max(1.0)).sqrt();
        }
        let inertia = seen
            .into_iter()
            .map(|mut x| {
                x.sort_by(f64::total_cmp);
                x.get(x.len() / 2).copied().unwrap_or(1.0).max(1e-9)
            })
            .collect();
        (inertia, passing)
    }
}
