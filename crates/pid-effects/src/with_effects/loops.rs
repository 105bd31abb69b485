//! A model behind the position loops of its drives: targets r are the inputs, gains are parameters.
//!
//! ```text
//! u = sat(law(r, q, v) + w; limit),        ẇ = growth(r, q, v) sat′
//! ```
//!
//! The law, as in kp (r − q) − kd v with the growth ki (r − q), is that of [`drives`](crate::drives).
//! Here it answers at once, whatever the rate of the drive, and its limit is rounded as every one of [`Smooth`].
//! An integral w is one more coordinate s with w = ṡ, as other states are; it rests where the output is limited.
//! Effects that act between a drive and its motor act on u; the loop reads the coordinate of its joint.

use std::borrow::Cow;
use std::cell::RefCell;

use pid_data::{Dataset, InputQuantity};
use pid_interpret::nominal::{Gain, Servo};
use pid_runtime::chain::{self, Chain, Substituted};
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

use super::DECADE;
use super::arguments::{self, narrowed, widened};
use super::merge::Merged;
use super::states::add_state;
use crate::drives::{Gains, Seen, growth, unlimited};
use crate::scalar::Scalar;
use crate::smooth::{CORNER, Smooth};

/// Places of the arguments: position, velocity, target, gains, integral, and how fast that grows.
const Q: usize = 0;
const V: usize = 1;
const R: usize = 2;
const KP: usize = 3;
const KD: usize = 4;
const KI: usize = 5;
const KV: usize = 6;
const W: usize = 7;
const W_DOT: usize = 8;
const MOST: usize = 9;

/// Place of a gain among the arguments; `None` of one that equations of motion do not hold.
fn argument(gain: Gain) -> Option<usize> {
    match gain {
        Gain::Kp => Some(KP),
        Gain::Kd => Some(KD),
        Gain::Ki => Some(KI),
        Gain::Kv => Some(KV),
        _ => None,
    }
}

/// The loop of one drive.
struct Loop {
    servo: Servo,
    /// Place of each argument in z.
    places: [Option<usize>; MOST],
    /// Coordinate of the integral.
    state: Option<usize>,
}

impl Loop {
    fn arguments(&self, at: &At<'_>, d: &Dims) -> [Smooth; MOST] {
        arguments::arguments(&self.places, at, d)
    }

    /// Gains, and what the law sees.
    fn seen(x: &[Smooth; MOST]) -> (Gains<Smooth>, Seen<Smooth>) {
        let none = Smooth::constant(0.0);
        let k = Gains::of(|gain| argument(gain).map(|a| x[a]));
        let at = Seen {
            r: x[R],
            q: x[Q],
            v: x[V],
            ahead: none,
            gravity: none,
            inertia: none,
        };
        (k, at)
    }

    /// Input of the motor, and the slope of its limit.
    fn input(&self, x: &[Smooth; MOST]) -> (Smooth, Smooth) {
        let (k, at) = Self::seen(x);
        let free = unlimited(&self.servo, &k, &at, x[W]).u;
        let Some(limit) = self.servo.limit else {
            return (free, Smooth::constant(1.0));
        };
        let round = (2.0 * limit * CORNER).powi(2);
        let slope = |end: f64| {
            let x = free - end;
            x / (x * x + round).root()
        };
        let end = Smooth::constant(limit);
        let slope = (slope(-limit) - slope(limit)) * 0.5;
        (free.limit(-end, end), slope)
    }

    /// Arguments on which the input depends.
    fn acting(&self) -> impl Iterator<Item = usize> + '_ {
        let all = [Q, V, R, KP, KD, KV, W].into_iter();
        all.filter(|&a| self.places[a].is_some())
    }

    /// Residual of the integral.
    fn integral(&self, x: &[Smooth; MOST]) -> Smooth {
        let (k, at) = Self::seen(x);
        x[W_DOT] - growth(&self.servo, &k, &at) * self.input(x).1
    }

    /// Arguments on which the residual of the integral depends.
    fn active(&self) -> Vec<usize> {
        let limited = self.servo.limit.is_some();
        let cascade = self.servo.has(Gain::Kv);
        let all = [Q, R, KI, W_DOT].into_iter();
        let own = [V, KP].into_iter().filter(|_| limited || cascade);
        let more = [KD, KV, W].into_iter().filter(|_| limited);
        let mut all: Vec<usize> = all.chain(own).chain(more).collect();
        all.retain(|&a| self.places[a].is_some());
        all.sort_unstable();
        all
    }
}

thread_local! {
    /// Inner inputs; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

/// A model with the loops of its drives. Coordinates and (idle) inputs of integrals follow the joints',
/// gains as in `kp_JOINT` follow the parameters of the model.
pub struct WithLoops<'m> {
    inner: Box<dyn Hessian + 'm>,
    dims: Dims,
    joints: Vec<JointInfo>,
    params: Vec<ParamInfo>,
    inputs: Vec<InputInfo>,
    loops: Vec<Loop>,
    /// Loops with an integral and the arguments on which that depends.
    integrals: Vec<(usize, Vec<usize>)>,
    /// Input of the motor of each loop in the inner u.
    motors: Vec<usize>,
    chain: Chain,
    jacobian: Merged,
    hessian: Merged,
}

/// Name of the parameter of a gain.
pub fn gain_name(gain: Gain, joint: &str) -> String {
    format!("{}_{joint}", gain.key())
}

/// A gain as a parameter: within a decade of where it starts, with its sign; held where it is exact.
fn parameter(servo: &Servo, gain: Gain, joint: &str, unit: String) -> ParamInfo {
    let own = servo.gain(gain);
    let value = own.value.unwrap_or(0.0);
    let fixed = own.half_width == 0.0;
    let (least, most) = match fixed {
        true => (value, value),
        false => (value / DECADE, value * DECADE),
    };
    ParamInfo {
        name: Cow::Owned(gain_name(gain, joint)),
        unit: Cow::Owned(unit),
        doc: Cow::Borrowed("Gain of the position loop"),
        nominal: value,
        lower: least.min(most),
        upper: least.max(most),
        fixed,
    }
}

/// A joint whose input in the records is a target, its loop and the place of its input.
struct Driven<'a> {
    joint: usize,
    servo: &'a Servo,
    motor: usize,
}

impl<'m> WithLoops<'m> {
    /// Puts loops around a model where the records have targets as inputs, and adds columns of their
    /// integrals to the records. `servos` are the loops by coordinate; every gain of theirs has a value.
    pub fn new(
        inner: Box<dyn Hessian + 'm>,
        servos: &[Option<&Servo>],
        dataset: &mut Dataset,
    ) -> Self {
        let before = inner.dims();
        let driven: Vec<Driven<'_>> = (servos.iter().enumerate())
            .filter(|(j, _)| dataset.joints[*j].input == InputQuantity::Position)
            .filter_map(|(joint, servo)| {
                let motor = inner.inputs().iter().position(|i| i.joint == Some(joint))?;
                Some(Driven {
                    joint,
                    servo: (*servo)?,
                    motor,
                })
            })
            .collect();
        let integrates = |d: &&Driven<'_>| d.servo.law.integrates();
        let states = driven.iter().filter(integrates).count();
        let gains: usize = driven.iter().map(|d| d.servo.law.gains().len()).sum();
        let dims = Dims {
            nq: before.nq + states,
            nu: before.nu + states,
            np: before.np + gains,
        };
        let mut out = Self {
            joints: inner.joints().to_vec(),
            params: inner.params().to_vec(),
            inputs: inner.inputs().to_vec(),
            motors: driven.iter().map(|d| d.motor).collect(),
            loops: Vec::new(),
            integrals: Vec::new(),
            chain: Chain::new(inner.as_ref(), &[], |z| widened(&before, &dims, z)),
            jacobian: Merged::new(inner.jacobian_pattern(), std::iter::empty()),
            hessian: Merged::new(inner.hessian_pattern(), std::iter::empty()),
            inner,
            dims,
        };
        for own in &driven {
            out.add(own, dataset);
        }
        out.settle();
        out
    }

    /// Adds a loop, its parameters, and the coordinate of its integral.
    fn add(&mut self, own: &Driven<'_>, dataset: &mut Dataset) {
        let (before, dims) = (self.inner.dims(), self.dims);
        let info = self.inner.joints()[own.joint].clone();
        let unit = self.inner.inputs()[own.motor].unit.to_string();
        let target = widened(&before, &dims, before.u() + own.motor);
        let mut places = [None; MOST];
        (places[Q], places[V]) = (Some(own.joint), Some(dims.v() + own.joint));
        places[R] = Some(target);
        for &gain in own.servo.law.gains() {
            if let Some(argument) = argument(gain) {
                places[argument] = Some(dims.p() + self.params.len());
            }
            let unit = own.servo.unit(gain, &unit, info.unit());
            let parameter = parameter(own.servo, gain, &info.name, unit);
            self.params.push(parameter);
        }
        let at = self.inputs.iter().position(|i| i.joint == Some(own.joint));
        if let Some(at) = at {
            self.inputs[at] = InputInfo {
                name: Cow::Owned(format!("target_{}", info.name)),
                unit: Cow::Borrowed(info.unit()),
                joint: Some(own.joint),
            };
        }
        let state = own.servo.law.integrates().then(|| {
            let state = self.joints.len();
            let name = format!("integral_{}", info.name);
            (places[W], places[W_DOT]) = (Some(dims.v() + state), Some(dims.a() + state));
            add_state(dataset, own.joint, false, &name);
            let idle = InputInfo {
                name: Cow::Owned(format!("nothing_{name}")),
                unit: Cow::Borrowed(info.force_unit()),
                joint: Some(state),
            };
            self.inputs.insert(state, idle);
            self.joints.push(JointInfo {
                name: Cow::Owned(name),
                limits: None,
                ..info.clone()
            });
            state
        });
        let own = Loop {
            servo: own.servo.clone(),
            places,
            state,
        };
        if state.is_some() {
            self.integrals.push((self.loops.len(), own.active()));
        }
        self.loops.push(own);
    }

    /// Patterns, once all loops are there.
    fn settle(&mut self) {
        let (before, dims) = (self.inner.dims(), self.dims);
        let group = |(own, &motor): (&Loop, &usize)| {
            let mut arguments = vec![None; MOST];
            own.acting().for_each(|a| arguments[a] = own.places[a]);
            chain::Group {
                replaces: vec![before.u() + motor],
                arguments,
            }
        };
        let groups: Vec<chain::Group> = self.loops.iter().zip(&self.motors).map(group).collect();
        let direct = |z| widened(&before, &dims, z);
        self.chain = Chain::new(self.inner.as_ref(), &groups, direct);
        let (loops, integrals) = (&self.loops, self.integrals.iter());
        let rows = integrals.clone().map(|(i, active)| {
            let own = &loops[*i];
            arguments::jacobian_places(&own.places, own.state.as_slice(), active)
        });
        let curved =
            integrals.map(|(i, active)| arguments::hessian_places(&loops[*i].places, active));
        self.jacobian = Merged::new(self.chain.jacobian_pattern(), rows);
        self.hessian = Merged::new(self.chain.hessian_pattern(), curved);
    }

    /// Number of coordinates of integrals; they are the last ones, and no sensor reads them.
    pub fn integrals(&self) -> usize {
        self.integrals.len()
    }

    /// Residuals of the integrals: coordinate and value.
    fn rates<'a>(&'a self, at: &'a At<'_>) -> impl Iterator<Item = (usize, f64)> + 'a {
        let each = self.loops.iter();
        each.filter_map(|own| {
            let state = own.state?;
            let x = own.arguments(at, &self.dims);
            Some((state, own.integral(&x).0.re))
        })
    }
}

impl Substituted for WithLoops<'_> {
    fn inner(&self) -> &dyn Hessian {
        self.inner.as_ref()
    }

    fn chain(&self) -> &Chain {
        &self.chain
    }

    fn within<T>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> T) -> T {
        let mut u = SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        let sizes = (&self.inner.dims(), &self.dims);
        let drives = |u: &mut [f64]| {
            for (own, &motor) in self.loops.iter().zip(&self.motors) {
                u[motor] = own.input(&own.arguments(at, &self.dims)).0.0.re;
            }
        };
        let out = narrowed(sizes, at, &mut u, drives, work);
        SCRATCH.with(|s| *s.borrow_mut() = u);
        out
    }

    fn gradients(&self, at: &At<'_>, out: &mut Vec<f64>) {
        for own in &self.loops {
            let mut x = own.arguments(at, &self.dims);
            let first = out.len();
            out.resize(first + MOST, 0.0);
            for a in own.acting() {
                x[a].0.eps1 = 1.0;
                out[first + a] = own.input(&x).0.0.eps1;
                x[a].0.eps1 = 0.0;
            }
        }
    }

    /// The lower triangles: those the chain reads.
    fn curvatures(&self, at: &At<'_>, weights: &[f64], out: &mut Vec<f64>) {
        for (own, w) in self.loops.iter().zip(weights) {
            let mut x = own.arguments(at, &self.dims);
            let first = out.len();
            out.resize(first + MOST * MOST, 0.0);
            for a in own.acting() {
                x[a].0.eps1 = 1.0;
                for b in own.acting().take_while(|&b| b <= a) {
                    x[b].0.eps2 = 1.0;
                    out[first + a * MOST + b] = w * own.input(&x).0.0.eps1eps2;
                    x[b].0.eps2 = 0.0;
                }
                x[a].0.eps1 = 0.0;
            }
        }
    }
}

impl Dynamics for WithLoops<'_> {
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
        for s in self.inner.dims().nq..self.dims.nq {
            m[s * (s + 1) / 2 + s] = 1.0;
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
        for (s, rate) in self.rates(&At { a: &[], ..*at }) {
            f[s] = -rate;
        }
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        let nq = self.inner.dims().nq;
        self.within(at, |at| self.inner.residual(at, &mut r[..nq]));
        for (s, rate) in self.rates(at) {
            r[s] = rate;
        }
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        self.within(at, |at| self.inner.kinetic_energy(at))
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.within(at, |at| self.inner.potential_energy(at))
    }
}

impl Jacobian for WithLoops<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let (nq, own) = (self.inner.dims().nq, self.jacobian.own());
        self.outer_jacobian(at, &mut r[..nq], &mut values[..own]);
        self.jacobian.spread(values);
        for ((i, active), slots) in self.integrals.iter().zip(self.jacobian.slots()) {
            let own = &self.loops[*i];
            let mut x = own.arguments(at, &self.dims);
            for (&a, &slot) in active.iter().zip(slots) {
                x[a].0.eps1 = 1.0;
                values[slot] += own.integral(&x).0.eps1;
                x[a].0.eps1 = 0.0;
            }
        }
        for (s, rate) in self.rates(at) {
            r[s] = rate;
        }
    }
}

impl Hessian for WithLoops<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let (nq, own) = (self.inner.dims().nq, self.hessian.own());
        self.outer_hessian(at, &lambda[..nq], &mut values[..own]);
        self.hessian.spread(values);
        for ((i, active), slots) in self.integrals.iter().zip(self.hessian.slots()) {
            let own = &self.loops[*i];
            let weight = own.state.map_or(0.0, |s| lambda[s]);
            let mut x = own.arguments(at, &self.dims);
            let mut slots = slots.iter();
            for (i, &a) in active.iter().enumerate() {
                for &b in &active[..=i] {
                    let Some(&slot) = slots.next() else { return };
                    (x[a].0.eps1, x[b].0.eps2) = (1.0, 1.0);
                    values[slot] += weight * own.integral(&x).0.eps1eps2;
                    (x[a].0.eps1, x[b].0.eps2) = (0.0, 0.0);
                }
            }
        }
    }
}
