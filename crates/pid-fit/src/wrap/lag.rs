//! Late velocity readings: a first-order lag between a joint's velocity and its velocity channel.
//!
//! ```text
//! T ẇ = v − w          w: the reading, T: time constant, a parameter (`velocity_lag_JOINT`, s)
//! ```
//!
//! The lag is one more coordinate s of the model, whose velocity is the reading: `w = ṡ`, with the
//! equation `T s̈ − (v − ṡ) = 0` in the form of all others. Estimators, schemes and exact
//! derivatives treat it as a joint. Nothing depends on the value of s; it starts at zero.

use std::borrow::Cow;
use std::cell::RefCell;

use pid_data::{Dataset, InputQuantity, JointChannels, VelocityKind};
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

/// Range and start of a time constant, s.
const TIME: (f64, f64, f64) = (1e-4, 0.01, 0.5);

/// A lag that does not fit the model or the records.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LagError {
    /// A joint that the model does not have.
    #[error("the model has no joint `{joint}`; its joints are {joints}")]
    UnknownJoint {
        /// The name.
        joint: String,
        /// The model's joints.
        joints: String,
    },
    /// A joint without recorded velocity.
    #[error(
        "joint `{joint}` of the data set `{dataset}` has no recorded velocity that could lag\n  help: leave it out"
    )]
    NoVelocity {
        /// The joint.
        joint: String,
        /// The data set.
        dataset: String,
    },
}

/// A lag and what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Lag {
    /// Joint whose velocity reading it is.
    pub joint: String,
    /// Name of its parameter.
    pub name: String,
    /// Start, lower and upper end of the time constant, s.
    pub range: (f64, f64, f64),
    /// Whether it is held at its start.
    pub fixed: bool,
    /// How much sooner the reading answers than a lag in continuous time, s: a filter that runs at
    /// the samples has half a sample less delay.
    pub sooner: f64,
}

impl Lag {
    /// Of a joint, unknown.
    fn unknown(joint: &str) -> Self {
        Self {
            joint: joint.to_owned(),
            name: format!("velocity_lag_{joint}"),
            range: (TIME.1, TIME.0, TIME.2),
            fixed: false,
            sooner: 0.0,
        }
    }
}

thread_local! {
    /// Inner inputs; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

/// A model and the lags of its velocity channels. Coordinates, inputs (which do nothing) and
/// parameters of the lags follow the joints', the joints' inputs and the model's parameters.
pub struct Lagging<'m> {
    inner: Box<dyn Hessian + 'm>,
    /// Joint of each lag.
    lags: Vec<usize>,
    /// How much sooner each answers, s.
    sooner: Vec<f64>,
    dims: Dims,
    joints: Vec<JointInfo>,
    params: Vec<ParamInfo>,
    inputs: Vec<InputInfo>,
    jacobian: Places,
    hessian: Places,
}

impl<'m> Lagging<'m> {
    /// Adds lags to the velocities of the named joints (of all joints if none is named), and puts
    /// the records' velocities where the readings are.
    ///
    /// # Errors
    /// [`LagError`].
    pub fn new(
        inner: Box<dyn Hessian + 'm>,
        names: &[String],
        dataset: &mut Dataset,
    ) -> Result<Self, LagError> {
        let all: Vec<String> = match names {
            [] => inner.joints().iter().map(|j| j.name.to_string()).collect(),
            names => names.to_vec(),
        };
        let lags: Vec<Lag> = all.iter().map(|name| Lag::unknown(name)).collect();
        Self::of(inner, &lags, dataset)
    }

    /// Adds stated lags.
    ///
    /// # Errors
    /// [`LagError`].
    pub fn of(
        inner: Box<dyn Hessian + 'm>,
        stated: &[Lag],
        dataset: &mut Dataset,
    ) -> Result<Self, LagError> {
        let each = placed(inner.as_ref(), stated, dataset)?;
        let lags: Vec<usize> = each.iter().map(|(joint, _)| *joint).collect();
        let (before, n) = (inner.dims(), lags.len());
        let dims = Dims {
            nq: before.nq + n,
            nu: before.nu + n,
            np: before.np + n,
        };
        let (mut joints, mut params) = (inner.joints().to_vec(), inner.params().to_vec());
        let mut inputs = inner.inputs().to_vec();
        for (k, &(j, lag)) in each.iter().enumerate() {
            let joint = &inner.joints()[j];
            joints.push(JointInfo {
                name: Cow::Owned(format!("reading_{}", joint.name)),
                limits: None,
                ..joint.clone()
            });
            params.push(ParamInfo {
                name: Cow::Owned(lag.name.clone()),
                unit: Cow::Borrowed("s"),
                doc: Cow::Borrowed("time constant between the velocity and its reading"),
                nominal: lag.range.0,
                lower: lag.range.1,
                upper: lag.range.2,
                fixed: lag.fixed,
            });
            inputs.insert(
                before.nq + k,
                InputInfo {
                    name: Cow::Owned(format!("nothing_{}", joint.name)),
                    unit: Cow::Borrowed(joint.force_unit()),
                    joint: Some(before.nq + k),
                },
            );
        }
        let (jacobian, hessian) = patterns(inner.as_ref(), dims, &lags);
        read_late(dataset, &lags);
        Ok(Self {
            inner,
            sooner: each.iter().map(|(_, lag)| lag.sooner).collect(),
            lags,
            dims,
            joints,
            params,
            inputs,
            jacobian,
            hessian,
        })
    }

    /// The model within.
    pub fn inner(&self) -> &(dyn Hessian + 'm) {
        self.inner.as_ref()
    }

    /// Number of parameters of the model within; those of the lags follow.
    pub fn inner_params(&self) -> usize {
        self.inner.dims().np
    }

    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R {
        let (nq, n) = (self.inner.dims().nq, self.lags.len());
        let mut u = SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        u.clear();
        u.extend_from_slice(&at.u[..nq]);
        u.extend_from_slice(&at.u[nq + n..]);
        let out = work(&At {
            q: &at.q[..nq],
            v: &at.v[..nq],
            a: &at.a[..nq],
            u: &u,
            p: &at.p[..self.inner.dims().np],
        });
        SCRATCH.with(|s| *s.borrow_mut() = u);
        out
    }

    /// Of each lag: its coordinate, joint, and the factor of its acceleration.
    fn each<'a>(&'a self, at: &'a At<'_>) -> impl Iterator<Item = (usize, usize, f64)> + 'a {
        let (nq, np) = (self.inner.dims().nq, self.inner.dims().np);
        self.lags
            .iter()
            .enumerate()
            .map(move |(k, &j)| (nq + k, j, at.p[np + k] - self.sooner[k]))
    }
}

/// The stated lags, each once, by the joints whose velocities were recorded.
fn placed<'l>(
    inner: &dyn Hessian,
    stated: &'l [Lag],
    dataset: &Dataset,
) -> Result<Vec<(usize, &'l Lag)>, LagError> {
    let mut each = Vec::new();
    for lag in stated {
        let joint = inner.joints().iter().position(|j| j.name == lag.joint);
        let joint = joint.ok_or_else(|| {
            let all = inner.joints().iter().map(|j| j.name.as_ref());
            LagError::UnknownJoint {
                joint: lag.joint.clone(),
                joints: all.collect::<Vec<_>>().join(", "),
            }
        })?;
        each.push((joint, lag));
    }
    each.sort_by_key(|(joint, _)| *joint);
    each.dedup_by_key(|(joint, _)| *joint);
    for &(j, _) in &each {
        if dataset.joints[j].velocity == VelocityKind::Absent {
            return Err(LagError::NoVelocity {
                joint: dataset.joints[j].name.clone(),
                dataset: dataset.name.clone(),
            });
        }
    }
    Ok(each)
}

/// Rows and columns of entries.
type Places = (Vec<u32>, Vec<u32>);

/// Entries of the Jacobian and of the Hessian: those of the model within, then those of the lags.
fn patterns(inner: &dyn Hessian, dims: Dims, lags: &[usize]) -> (Places, Places) {
    let (before, n) = (inner.dims(), lags.len());
    let place = |z: usize| -> u32 {
        let place = if z < before.v() {
            z
        } else if z < before.a() {
            dims.v() + z - before.v()
        } else if z < before.u() {
            dims.a() + z - before.a()
        } else if z < before.u() + before.nq {
            dims.u() + z - before.u()
        } else if z < before.p() {
            dims.u() + n + z - before.u()
        } else {
            dims.p() + z - before.p()
        };
        place as u32
    };
    // Places keep their order, and the lags' own entries come after all others.
    let moved = |list: &[u32]| -> Vec<u32> { list.iter().map(|&z| place(z as usize)).collect() };
    let pattern = inner.jacobian_pattern();
    let mut jacobian = (pattern.rows.to_vec(), moved(pattern.cols));
    let pattern = inner.hessian_pattern();
    let mut hessian = (moved(pattern.rows), moved(pattern.cols));
    for (k, &j) in lags.iter().enumerate() {
        let s = before.nq + k;
        let time = (dims.p() + before.np + k) as u32;
        jacobian.0.extend([s as u32; 4]);
        jacobian.1.extend([
            (dims.v() + j) as u32,
            (dims.v() + s) as u32,
            (dims.a() + s) as u32,
            time,
        ]);
        hessian.0.push(time);
        hessian.1.push((dims.a() + s) as u32);
    }
    (jacobian, hessian)
}

/// Makes the recorded velocities of these joints readings, which are coordinates of their own.
fn read_late(dataset: &mut Dataset, lags: &[usize]) {
    for experiment in &mut dataset.experiments {
        late(experiment, lags);
    }
    for &j in lags {
        let reading = JointChannels {
            name: format!("reading_{}", dataset.joints[j].name),
            input: match dataset.joints[j].prismatic {
                true => InputQuantity::Force,
                false => InputQuantity::Torque,
            },
            input_unit: dataset.joints[j].force_unit().to_owned(),
            // A user who asks for a lag takes the velocity for a reading of its own.
            velocity: VelocityKind::Measured,
            ..dataset.joints[j].clone()
        };
        dataset.joints[j].velocity = VelocityKind::Absent;
        dataset.joints.push(reading);
    }
}

/// The record with the readings as velocities of coordinates of their own.
fn late(experiment: &mut pid_data::Experiment, lags: &[usize]) {
    let (nq, n, nu) = (experiment.nq, lags.len(), experiment.nu());
    let wide = |x: &[f64], fill: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        x.chunks_exact(nq)
            .enumerate()
            .flat_map(|(i, row)| {
                let more = lags.iter().map(move |&j| fill(i, j));
                row.iter().copied().chain(more).collect::<Vec<f64>>()
            })
            .collect()
    };
    let v = experiment
        .v
        .clone()
        .unwrap_or_else(|| vec![f64::NAN; experiment.len() * nq]);
    // The position of a reading is zero at the start of the record and is read nowhere else.
    let first = |i: usize, _: usize| if i == 0 { 0.0 } else { f64::NAN };
    experiment.q = wide(&experiment.q, &first);
    let mut velocities = wide(&v, &|i, j| v[i * nq + j]);
    for row in velocities.chunks_exact_mut(nq + n) {
        lags.iter().for_each(|&j| row[j] = f64::NAN);
    }
    experiment.v = Some(velocities);
    experiment.tau = experiment.tau.take().map(|t| wide(&t, &|_, _| f64::NAN));
    experiment.qref = experiment.qref.take().map(|q| wide(&q, &|_, _| f64::NAN));
    experiment.u = experiment
        .u
        .chunks_exact(nu)
        .flat_map(|row| {
            let mut row = row.to_vec();
            row.splice(nq..nq, std::iter::repeat_n(0.0, n));
            row
        })
        .collect();
    experiment.nq += n;
}

impl Dynamics for Lagging<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }
    fn dims(&self) -> Dims {
        self.dims
    }
    fn params(&self) -> &[ParamInfo] {
        &self.params
    }
    fn joints(&self) -> &[JointInfo] {
        &self.joints
    }
    fn inputs(&self) -> &[InputInfo] {
        &self.inputs
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        let own = self.inner.dims().nm();
        m[own..].fill(0.0);
        self.within(at, |at| self.inner.mass_matrix(at, &mut m[..own]));
        for (s, _, time) in self.each(at) {
            m[s * (s + 1) / 2 + s] = time;
        }
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        let nq = self.inner.dims().nq;
        b[nq..].fill(0.0);
        self.within(at, |at| self.inner.bias(at, &mut b[..nq]));
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        let nq = self.inner.dims().nq;
        self.within(at, |at| self.inner.applied_force(at, &mut f[..nq]));
        for (s, j, _) in self.each(at) {
            f[s] = at.v[j] - at.v[s];
        }
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        let nq = self.inner.dims().nq;
        self.within(at, |at| self.inner.residual(at, &mut r[..nq]));
        for (s, j, time) in self.each(at) {
            r[s] = time * at.a[s] + at.v[s] - at.v[j];
        }
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        self.within(at, |at| self.inner.kinetic_energy(at))
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.within(at, |at| self.inner.potential_energy(at))
    }
}

fn pattern((rows, cols): &(Vec<u32>, Vec<u32>)) -> Pattern<'_> {
    Pattern { rows, cols }
}

impl Jacobian for Lagging<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        pattern(&self.jacobian)
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let (nq, own) = (self.inner.dims().nq, self.inner.jacobian_pattern().nnz());
        self.within(at, |at| {
            self.inner
                .residual_jacobian(at, &mut r[..nq], &mut values[..own]);
        });
        let entries = values[own..].chunks_exact_mut(4);
        for ((s, j, time), entries) in self.each(at).zip(entries) {
            r[s] = time * at.a[s] + at.v[s] - at.v[j];
            entries.copy_from_slice(&[-1.0, 1.0, time, at.a[s]]);
        }
    }
}

impl Hessian for Lagging<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        pattern(&self.hessian)
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let (nq, own) = (self.inner.dims().nq, self.inner.hessian_pattern().nnz());
        self.within(at, |at| {
            self.inner
                .residual_hessian(at, &lambda[..nq], &mut values[..own]);
        });
        values[own..].copy_from_slice(&lambda[nq..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derivatives::derivatives_hold;
    use crate::ident::{self, Method, Progress, Settings};
    use crate::synthetic::{Recipe, records};
    use crate::transcribe::Scheme;
    use pid_models::{DoublePendulum, ServoPendulum};
    use pid_runtime::extend::Extended;
    use std::ops::ControlFlow;

    fn recipe(joints: usize) -> Recipe {
        Recipe {
            records: 2,
            seconds: 3.0,
            step: 0.01,
            amplitude: vec![1.0; joints],
            highest: 3.0,
            start: vec![0.1; joints],
            noise: vec![1e-5; 2 * joints],
            outliers: (0.0, 1.0),
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let p: Vec<f64> = DoublePendulum.params().iter().map(|i| i.nominal).collect();
        let mut data = records(&DoublePendulum, &p, &recipe(2), 1).expect("simulates");
        let inner = Extended::new(&DoublePendulum, &["stribeck".parse().unwrap()]).expect("fits");
        let model = Lagging::new(Box::new(inner), &["elbow".to_owned()], &mut data).expect("fits");
        assert_eq!((model.dims().nq, data.nq()), (3, 3));
        data.check_model(&model).expect("fits");
        derivatives_hold(&model, &[0.3, -0.7, 1.1], &[]);
    }

    /// Velocity readings made late by the exact solution of the lag between samples.
    #[test]
    fn the_time_constant_is_found() {
        let truth: Vec<f64> = ServoPendulum.params().iter().map(|i| i.nominal).collect();
        let mut data = records(&ServoPendulum, &truth, &recipe(1), 3).expect("simulates");
        let time = 0.03;
        for experiment in &mut data.experiments {
            let (t, v) = (&experiment.t, experiment.v.as_mut().expect("recorded"));
            let mut w = v[0];
            let mut last = v[0];
            for k in 1..t.len() {
                let h = t[k] - t[k - 1];
                let slope = (v[k] - last) / h;
                let settled = |x: f64| x - slope * time;
                w = settled(v[k]) + (w - settled(last)) * (-h / time).exp();
                last = v[k];
                v[k] = w;
            }
        }
        let model = Lagging::new(
            Box::new(Extended::new(&ServoPendulum, &[]).expect("fits")),
            &[],
            &mut data,
        )
        .expect("fits");
        let at = |name: &str| model.params().iter().position(|p| p.name == name);
        let free: Vec<usize> = ["velocity_lag_shaft", "viscous_shaft"]
            .into_iter()
            .filter_map(at)
            .collect();
        for method in [Method::FullDiscretization, Method::Shooting] {
            let settings = Settings {
                method,
                scheme: "gauss-legendre-2".parse::<Scheme>().expect("a scheme"),
                hold: (0..model.dims().np).filter(|j| !free.contains(j)).collect(),
                likelihood: Some(ident::Likelihood::default()),
                ..Settings::default()
            };
            let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
            let found = ident::identify(&model, &data, &settings, None, go_on).expect("identifies");
            let best = found.best();
            assert!(best.status.converged(), "{method:?}: {:?}", best.status);
            let value = best.parameters[free[0]];
            assert!((value - time).abs() < 3e-4, "{method:?}: {value}");
            let deviation = found.deviations[free[0]].expect("determined");
            assert!(deviation < 1e-3, "{deviation}");
        }
    }

    #[test]
    fn joints_without_velocity_are_refused() {
        let p: Vec<f64> = ServoPendulum.params().iter().map(|i| i.nominal).collect();
        let mut data = records(&ServoPendulum, &p, &recipe(1), 3).expect("simulates");
        data.joints[0].velocity = VelocityKind::Absent;
        let model = || Box::new(Extended::new(&ServoPendulum, &[]).expect("fits"));
        let message = |names: &[String], data: &mut Dataset| {
            let error = Lagging::new(model(), names, data).err();
            error.expect("refused").to_string()
        };
        assert!(message(&[], &mut data).contains("no recorded velocity"));
        assert!(message(&["knee".to_owned()], &mut data).contains("`knee`"));
    }
}
