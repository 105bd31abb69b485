//! Simulated records with noise and with a plant whose Stribeck friction the model lacks: of the
//! two-link robot under sums of sines, of the six-axis arm under inverse-dynamics control, with and
//! without the rotors of its drives.

use std::f64::consts::TAU;

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_fit::integrate::{self, Drive, SimulateError, Simulator};
use pid_models::Arm6;
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};
use pid_runtime::lanes::{Lane, LanesAt};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Inputs at a time from what is measured: (t, q, v, gains) → u.
pub type Control = dyn Fn(f64, &[f64], &[f64], &[f64]) -> Vec<f64>;

/// Currents of the two-link robot.
pub fn sines(t: f64, _: &[f64], _: &[f64], _: &[f64]) -> Vec<f64> {
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

/// Parameters a fifth below the nominal ones, as far as their bounds allow.
pub fn start(model: &dyn Dynamics) -> Vec<f64> {
    let infos = model.params().iter();
    infos
        .map(|p| (0.8 * p.nominal).clamp(p.lower, p.upper))
        .collect()
}

/// Reference of axis `j` of the arm: position, velocity, acceleration.
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

/// Inertia of a rotor of [`Geared`] as the joint feels it, kg·m²: the `armature` of every joint of
/// the UR10e in MuJoCo Menagerie (`universal_robots_ur10e/ur10e.xml`; K. Zakka, Y. Tassa et al.,
/// 2022).
pub const ROTOR: f64 = 0.1;

/// A model whose drives have rotors of known inertia, [`ROTOR`], at every joint.
///
/// The arm of the benchmarks has none: its flange of 5e-4 kg·m² then moves behind 4 N·m of dry
/// friction, with a time constant at rest of a few microseconds.
pub struct Geared<'m> {
    inner: &'m dyn Hessian,
    /// Entry of ∂r_j/∂a_j in the pattern of the Jacobian.
    own: Vec<usize>,
}

impl<'m> Geared<'m> {
    /// The model with rotors.
    ///
    /// # Panics
    /// If a joint has no inertia of its own.
    pub fn new(inner: &'m dyn Hessian) -> Self {
        let (dims, pattern) = (inner.dims(), inner.jacobian_pattern());
        let entry = |j: usize| {
            let place = (j as u32, (dims.a() + j) as u32);
            let places = pattern.rows.iter().zip(pattern.cols);
            let mut places = places.map(|(row, col)| (*row, *col));
            places
                .position(|p| p == place)
                .expect("a joint moves something")
        };
        let own = (0..dims.nq).map(entry).collect();
        Self { inner, own }
    }
}

impl Dynamics for Geared<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }
    fn dims(&self) -> Dims {
        self.inner.dims()
    }
    fn params(&self) -> &[ParamInfo] {
        self.inner.params()
    }
    fn joints(&self) -> &[JointInfo] {
        self.inner.joints()
    }
    fn inputs(&self) -> &[InputInfo] {
        self.inner.inputs()
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        self.inner.mass_matrix(at, m);
        (0..self.own.len()).for_each(|j| m[j * (j + 3) / 2] += ROTOR);
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        self.inner.bias(at, b);
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        self.inner.applied_force(at, f);
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        self.inner.residual(at, r);
        r.iter_mut().zip(at.a).for_each(|(r, a)| *r += ROTOR * a);
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        let rotors: f64 = at.v.iter().map(|v| v * v).sum();
        self.inner.kinetic_energy(at) + 0.5 * ROTOR * rotors
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.inner.potential_energy(at)
    }
    fn mass_matrix_lanes(&self, at: &LanesAt<'_>, m: &mut [Lane]) {
        self.inner.mass_matrix_lanes(at, m);
        (0..self.own.len()).for_each(|j| m[j * (j + 3) / 2].iter_mut().for_each(|m| *m += ROTOR));
    }
    fn applied_force_lanes(&self, at: &LanesAt<'_>, f: &mut [Lane]) {
        self.inner.applied_force_lanes(at, f);
    }
    fn residual_lanes(&self, at: &LanesAt<'_>, r: &mut [Lane]) {
        self.inner.residual_lanes(at, r);
        add_rotors(at, r);
    }
}

/// Forces that accelerate the rotors.
fn add_rotors(at: &LanesAt<'_>, r: &mut [Lane]) {
    for (r, a) in r.iter_mut().zip(at.a) {
        r.iter_mut().zip(a).for_each(|(r, a)| *r += ROTOR * a);
    }
}

impl Jacobian for Geared<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.inner.jacobian_pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        self.inner.residual_jacobian(at, r, values);
        r.iter_mut().zip(at.a).for_each(|(r, a)| *r += ROTOR * a);
        self.own.iter().for_each(|&k| values[k] += ROTOR);
    }
    fn residual_jacobian_lanes(&self, at: &LanesAt<'_>, r: &mut [Lane], values: &mut [Lane]) {
        self.inner.residual_jacobian_lanes(at, r, values);
        add_rotors(at, r);
        for &k in &self.own {
            values[k].iter_mut().for_each(|v| *v += ROTOR);
        }
    }
}

impl Hessian for Geared<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.inner.hessian_pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        self.inner.residual_hessian(at, lambda, values);
    }
    fn residual_hessian_lanes(&self, at: &LanesAt<'_>, lambda: &[Lane], values: &mut [Lane]) {
        self.inner.residual_hessian_lanes(at, lambda, values);
    }
}

/// [`follow`] for the arm with rotors.
pub fn follow_geared(t: f64, q: &[f64], v: &[f64], gains: &[f64]) -> Vec<f64> {
    computed(t, q, v, (gains, ROTOR))
}

/// The arm under control by its inverse dynamics, loops of 20 rad/s with critical damping.
pub fn follow(t: f64, q: &[f64], v: &[f64], gains: &[f64]) -> Vec<f64> {
    computed(t, q, v, (gains, 0.0))
}

/// Currents of the control by inverse dynamics, with the inertia of the rotors.
fn computed(t: f64, q: &[f64], v: &[f64], (gains, rotor): (&[f64], f64)) -> Vec<f64> {
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
    let currents = force.iter().zip(&a).zip(gains);
    currents
        .map(|((f, a), gain)| (f + rotor * a) / gain)
        .collect()
}

/// Stribeck friction at a joint, which the model lacks: a share of its dry friction that fades with
/// speed.
fn stribeck(dry: f64, v: f64) -> f64 {
    0.3 * dry * (-(v / 0.3).powi(2)).exp() * (20.0 * v).tanh()
}

/// A record of so many samples, with noise of 1e-3 rad and 1e-2 rad/s.
///
/// # Errors
/// If the motion cannot be simulated.
pub fn record(
    model: &dyn Hessian,
    control: &Control,
    samples: usize,
    step: f64,
) -> Result<Dataset, SimulateError> {
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
    let mut gaussian = || -> f64 { random.sample(StandardNormal) };
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
            // The acting input is the recorded one less the friction that the model lacks, as it is
            // at the sample.
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
            gain_factors: Default::default(),
        }],
        warnings: Vec::new(),
    })
}
