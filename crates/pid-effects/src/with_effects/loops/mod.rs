//! A model behind the position loops of its drives: targets r are the inputs, gains are parameters.
//!
//! ```text
//! u = sat(law(r, q, v) + w; limit),        ẇ = growth(r, q, v) sat′
//! ```
//!
//! The law, as in kp (r − q) − kd v with the growth ki (r − q), is that of [`drives`](crate::drives).
//! Here it answers at once, whatever the rate of the drive; limits and bands are rounded as all of
//! [`Smooth`](crate::smooth::Smooth). An integral w is one more coordinate s with w = ṡ, as other states are; it rests
//! where the output is limited. The velocity behind a filter is another. Stages of a target act on the records.
//! Effects that act between a drive and its motor act on u; the loop reads the coordinate of its joint.

mod drive;
mod targets;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::cell::RefCell;

use pid_data::{Dataset, InputQuantity};
use pid_interpret::nominal::{Gain, Servo};
use pid_runtime::chain::{self, Chain, Substituted};
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

use self::drive::{Loop, MOST, Memory, Q, R, R_DOT, V, argument, parameters};
use super::DECADE;
use super::arguments::{self, narrowed, widened};
use super::merge::Merged;
use super::states::add_state;

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
    states: Vec<State>,
    /// Input of the motor of each loop in the inner u.
    motors: Vec<usize>,
    chain: Chain,
    jacobian: Merged,
    hessian: Merged,
}

/// What a loop remembers, as a coordinate.
struct State {
    /// The loop.
    own: usize,
    memory: Memory,
    coordinate: usize,
    /// Arguments on which its residual depends.
    active: Vec<usize>,
}

/// Name of the parameter of a gain.
pub fn gain_name(gain: Gain, joint: &str) -> String {
    format!("{}_{joint}", gain.key())
}

/// A number of a loop as a parameter: within a decade of where it starts, with its sign; a share from none to twice the
/// whole; held where it is exact.
fn parameter(servo: &Servo, gain: Gain, joint: &str, unit: String) -> ParamInfo {
    let own = servo.gain(gain);
    let value = own.value.unwrap_or(0.0);
    let fixed = own.half_width == 0.0;
    let (least, most) = match (fixed, gain) {
        (true, _) => (value, value),
        (false, Gain::VelocityAhead) => (0.0, value.max(1.0) * 2.0),
        (false, _) => (value / DECADE, value * DECADE),
    };
    ParamInfo {
        name: Cow::Owned(gain_name(gain, joint)),
        unit: Cow::Owned(unit),
        doc: Cow::Borrowed(match gain {
            Gain::VelocityAhead => "Share of the target's velocity in the position loop",
            Gain::VelocityTime => "Time constant of the position loop's velocity",
            _ => "Gain of the position loop",
        }),
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
    /// states to the records. `servos` are the loops by coordinate; every gain of theirs has a value.
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
        let states: usize = driven.iter().map(|d| Memory::of(d.servo).count()).sum();
        let gains: usize = driven.iter().map(|d| parameters(d.servo).count()).sum();
        let ahead = |d: &&Driven<'_>| d.servo.has(Gain::VelocityAhead);
        let rates = driven.iter().filter(ahead).count();
        let dims = Dims {
            nq: before.nq + states,
            nu: before.nu + states + rates,
            np: before.np + gains,
        };
        let mut out = Self {
            joints: inner.joints().to_vec(),
            params: inner.params().to_vec(),
            inputs: inner.inputs().to_vec(),
            motors: driven.iter().map(|d| d.motor).collect(),
            loops: Vec::new(),
            states: Vec::new(),
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

    /// Adds a loop, its parameters, and the coordinates of its states.
    fn add(&mut self, own: &Driven<'_>, dataset: &mut Dataset) {
        let (before, dims) = (self.inner.dims(), self.dims);
        let info = self.inner.joints()[own.joint].clone();
        let unit = self.inner.inputs()[own.motor].unit.to_string();
        let target = widened(&before, &dims, before.u() + own.motor);
        let mut places = [None; MOST];
        (places[Q], places[V]) = (Some(own.joint), Some(dims.v() + own.joint));
        places[R] = Some(target);
        for gain in parameters(own.servo) {
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
        let ahead = own.servo.has(Gain::VelocityAhead);
        let followed = (ahead || targets::shapes(own.servo))
            .then(|| targets::along(dataset, own.joint, own.servo));
        if let Some(followed) = &followed {
            targets::put(dataset, own.joint, followed);
        }
        let states: Vec<(Memory, usize)> = Memory::of(own.servo)
            .map(|memory| (memory, self.coordinate(memory, own, dataset)))
            .collect();
        for &(memory, state) in &states {
            let [value, growth] = memory.places();
            (places[value], places[growth]) = (Some(dims.v() + state), Some(dims.a() + state));
        }
        if let (Some(followed), true) = (&followed, ahead) {
            // Behind the inputs of all joints and states, in the order of the loops.
            let driven = self.loops.iter().filter(|l| l.places[R_DOT].is_some());
            let place = before.nu + dims.nq - before.nq + driven.count();
            places[R_DOT] = Some(dims.u() + place);
            targets::add_rates(dataset, followed);
            self.inputs.push(InputInfo {
                name: Cow::Owned(format!("target_rate_{}", info.name)),
                unit: Cow::Owned(format!("{}/s", info.unit())),
                joint: None,
            });
        }
        let all = Loop {
            servo: own.servo.clone(),
            places,
        };
        self.states
            .extend(states.into_iter().map(|(memory, coordinate)| State {
                own: self.loops.len(),
                memory,
                coordinate,
                active: all.active(memory),
            }));
        self.loops.push(all);
    }

    /// Adds the coordinate of a state with its idle input, and its column to the records.
    fn coordinate(&mut self, memory: Memory, own: &Driven<'_>, dataset: &mut Dataset) -> usize {
        let info = self.inner.joints()[own.joint].clone();
        let state = self.joints.len();
        let name = format!("{}_{}", memory.word(), info.name);
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
            ..info
        });
        state
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
        let (loops, states) = (&self.loops, self.states.iter());
        let rows = states
            .clone()
            .map(|s| arguments::jacobian_places(&loops[s.own].places, &[s.coordinate], &s.active));
        let curved = states.map(|s| arguments::hessian_places(&loops[s.own].places, &s.active));
        self.jacobian = Merged::new(self.chain.jacobian_pattern(), rows);
        self.hessian = Merged::new(self.chain.hessian_pattern(), curved);
    }

    /// Number of coordinates of states; they are the last ones, and no sensor reads them.
    pub fn states(&self) -> usize {
        self.states.len()
    }

    /// Residuals of the states: coordinate and value.
    fn rates<'a>(&'a self, at: &'a At<'_>) -> impl Iterator<Item = (usize, f64)> + 'a {
        self.states.iter().map(|s| {
            let own = &self.loops[s.own];
            let x = own.arguments(at, &self.dims);
            (s.coordinate, own.residual(s.memory, &x).0.re)
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
        for (state, slots) in self.states.iter().zip(self.jacobian.slots()) {
            let own = &self.loops[state.own];
            let mut x = own.arguments(at, &self.dims);
            for (&a, &slot) in state.active.iter().zip(slots) {
                x[a].0.eps1 = 1.0;
                values[slot] += own.residual(state.memory, &x).0.eps1;
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
        for (state, slots) in self.states.iter().zip(self.hessian.slots()) {
            let own = &self.loops[state.own];
            let weight = lambda[state.coordinate];
            let mut x = own.arguments(at, &self.dims);
            let mut slots = slots.iter();
            for (i, &a) in state.active.iter().enumerate() {
                for &b in &state.active[..=i] {
                    let Some(&slot) = slots.next() else { return };
                    (x[a].0.eps1, x[b].0.eps2) = (1.0, 1.0);
                    values[slot] += weight * own.residual(state.memory, &x).0.eps1eps2;
                    (x[a].0.eps1, x[b].0.eps2) = (0.0, 0.0);
                }
            }
        }
    }
}
