//! A model behind the position loops of its drives: targets r are the inputs, gains are parameters.
//!
//! ```text
//! u = sat(law(r, q, v) + w; limit),        ẇ = growth(r, q, v) sat′
//! ```
//!
//! The law, as in kp (r − q) − kd v with the growth ki (r − q), is that of [`drives`](crate::drives).
//! Here it answers at once, whatever the rate of the drive; limits and bands are rounded as all of
//! [`Smooth`](crate::smooth::Smooth). An integral w is one more coordinate s with w = ṡ, as other states are; it
//! rests where the output is limited. The velocity behind a filter is another, and what a late position lags.
//! Stages of a target act on the records.
//! Effects that act between a drive and its motor act on u; the loop reads the coordinate of its joint.

mod brake;
mod drive;
mod feed_forward;
mod memories;
mod targets;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::cell::RefCell;

use pid_data::{Dataset, Experiment, InputQuantity};
use pid_interpret::nominal::{self as description, Gain, Servo};
use pid_runtime::chain::{self, Chain, Substituted};
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

use self::brake::Brake;
use self::drive::{LAGS, Loop, MOST, Memory, ON, Q, R, R_DOT, V, argument, factor, parameters};
use self::feed_forward::{Fed, Known, Order, Read};
use super::DECADE;
use super::arguments::{self, narrowed, widened};
use super::merge::Merged;
use super::states::{Starts, add_state};
use crate::nominal::Nominal;

thread_local! {
    /// Inner inputs and parameters; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<[Vec<f64>; 2]> = const { RefCell::new([Vec::new(), Vec::new()]) };
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
    /// Motors that brake by the voltage they induce.
    brakes: Vec<Brake>,
    states: Vec<State>,
    /// The robot that the drives know, where one has a feed-forward.
    known: Option<Known>,
    /// By coordinate of a joint: that of what its late position lags, and the input that is the acceleration of its
    /// target.
    lags: Vec<Option<usize>>,
    accelerations: Vec<Option<usize>>,
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

/// A number of a loop as a parameter: within a decade of where it starts, with its sign; a share from none to twice
/// the whole; held where it is exact.
fn parameter(servo: &Servo, gain: Gain, joint: &str, unit: String) -> ParamInfo {
    let own = servo.gain(gain);
    let value = own.value.unwrap_or(0.0);
    let fixed = own.half_width == 0.0;
    let (least, most) = match (fixed, gain) {
        (true, _) => (value, value),
        (false, Gain::VelocityAhead | Gain::Gravity | Gain::InertiaAhead) => {
            (0.0, value.max(1.0) * 2.0)
        }
        (false, _) => (value / DECADE, value * DECADE),
    };
    ParamInfo {
        name: Cow::Owned(gain_name(gain, joint)),
        unit: Cow::Owned(unit),
        doc: Cow::Borrowed(match gain {
            Gain::VelocityAhead => "Share of the target's velocity in the position loop",
            Gain::Gravity => "Share of gravity that the drive makes up for",
            Gain::InertiaAhead => "Share of inertia that the drive makes up for",
            Gain::VelocityTime => "Time constant of the position loop's velocity",
            Gain::FeedbackDelay => "Time by which the position loop reads late",
            Gain::BackEmf => "Voltage that the motor induces per velocity",
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
    /// Sign of the motor gain.
    sign: f64,
}

/// Gains of a loop that a record has otherwise than the description.
fn differing(own: &Driven<'_>, dataset: &Dataset) -> Vec<Gain> {
    let differs = |gain: &Gain| {
        let mut records = dataset.experiments.iter();
        records.any(|e| e.gain_factors.at(*gain as usize, own.joint) != 1.0)
    };
    let all = own.servo.law.gains().iter().copied();
    all.filter(differs).collect()
}

/// Whether the drive is off in a record.
fn off(own: &Driven<'_>, dataset: &Dataset) -> bool {
    let mut records = dataset.experiments.iter();
    records.any(|e| e.gain_factors.is_off(own.joint))
}

impl<'m> WithLoops<'m> {
    /// Puts loops around a model where the records have targets as inputs, and adds columns of their
    /// states to the records. `servos` are the loops by coordinate; every gain of theirs has a value. What drives
    /// know of the robot is that of `nominal`.
    pub fn new(
        inner: Box<dyn Hessian + 'm>,
        servos: &[Option<&Servo>],
        nominal: &description::Nominal,
        dataset: &mut Dataset,
    ) -> Self {
        let before = inner.dims();
        let stated = Nominal::new(nominal.clone());
        let driven: Vec<Driven<'_>> = (servos.iter().enumerate())
            .filter(|(j, _)| dataset.joints[*j].input == InputQuantity::Position)
            .filter_map(|(joint, servo)| {
                let motor = inner.inputs().iter().position(|i| i.joint == Some(joint))?;
                Some(Driven {
                    joint,
                    servo: (*servo)?,
                    motor,
                    sign: stated.gain(joint).signum(),
                })
            })
            .collect();
        let states: usize = driven.iter().map(|d| Memory::of(d.servo).count()).sum();
        let gains: usize = driven.iter().map(|d| parameters(d.servo).count()).sum();
        let ahead = |d: &&Driven<'_>| d.servo.has(Gain::VelocityAhead);
        let rates = driven.iter().filter(ahead).count();
        let has = |gain| driven.iter().any(|d| d.servo.has(gain));
        let inertia = has(Gain::InertiaAhead);
        let fed = inertia || has(Gain::Gravity);
        let accelerations = if inertia { driven.len() } else { 0 };
        let factors = |d: &Driven<'_>| differing(d, dataset).len() + usize::from(off(d, dataset));
        let factors: usize = driven.iter().map(factors).sum();
        let dims = Dims {
            nq: before.nq + states,
            nu: before.nu + states + rates + accelerations + factors,
            np: before.np + gains,
        };
        let mut out = Self {
            joints: inner.joints().to_vec(),
            params: inner.params().to_vec(),
            inputs: inner.inputs().to_vec(),
            motors: driven.iter().map(|d| d.motor).collect(),
            loops: Vec::new(),
            brakes: Vec::new(),
            states: Vec::new(),
            known: fed.then(|| Known::new(stated, inertia)),
            lags: vec![None; before.nq],
            accelerations: vec![None; before.nq],
            chain: Chain::new(inner.as_ref(), &[], |z| widened(&before, &dims, z)),
            jacobian: Merged::new(inner.jacobian_pattern(), std::iter::empty()),
            hessian: Merged::new(inner.hessian_pattern(), std::iter::empty()),
            inner,
            dims,
        };
        for own in &driven {
            out.add(own, dataset, inertia);
        }
        out.settle();
        out
    }

    /// Adds a loop, its parameters, the coordinates of its states, and inputs that its target moves by: its velocity
    /// where that is fed forward, its `acceleration` where a drive feeds inertia forward.
    fn add(&mut self, own: &Driven<'_>, dataset: &mut Dataset, acceleration: bool) {
        let (before, dims) = (self.inner.dims(), self.dims);
        let info = self.inner.joints()[own.joint].clone();
        let unit = self.inner.inputs()[own.motor].unit.to_string();
        let target = widened(&before, &dims, before.u() + own.motor);
        let mut places = vec![None; MOST];
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
        let followed = (ahead || acceleration || targets::shapes(own.servo))
            .then(|| targets::along(dataset, own.joint, own.servo));
        if let Some(followed) = &followed {
            targets::put(dataset, own.joint, followed);
        }
        let rates: Option<Vec<&[f64]>> =
            (followed.as_ref()).map(|all| all.iter().map(|own| own.rate.as_slice()).collect());
        for memory in Memory::of(own.servo) {
            let state = self.coordinate(memory, own, rates.as_deref(), dataset);
            let [value, growth] = memory.places();
            (places[value], places[growth]) = (Some(dims.v() + state), Some(dims.a() + state));
            if memory == Memory::Lag {
                self.lags[own.joint] = Some(state);
            }
            self.states.push(State {
                own: self.loops.len(),
                memory,
                coordinate: state,
                active: Vec::new(),
            });
        }
        let unit = |per: &str| format!("{}/{per}", info.unit());
        if let Some(followed) = &followed {
            if let (Some(rates), true) = (rates, ahead) {
                let name = format!("target_rate_{}", info.name);
                let place = self.input((name, unit("s")), dataset, rates.into_iter());
                places[R_DOT] = Some(place);
            }
            if acceleration {
                let all = followed.iter().map(|own| own.acceleration.as_slice());
                let name = format!("target_acceleration_{}", info.name);
                let place = self.input((name, unit("s^2")), dataset, all);
                self.accelerations[own.joint] = Some(place);
            }
        }
        for gain in differing(own, dataset) {
            let of = |e: &Experiment| vec![e.gain_factors.at(gain as usize, own.joint); e.len()];
            let columns: Vec<Vec<f64>> = dataset.experiments.iter().map(of).collect();
            let name = format!("factor_{}", gain_name(gain, &info.name));
            let columns = columns.iter().map(Vec::as_slice);
            let place = self.input((name, "1".to_owned()), dataset, columns);
            if let Some(argument) = factor(gain) {
                places[argument] = Some(place);
            }
        }
        if off(own, dataset) {
            let on = |e: &Experiment| match e.gain_factors.is_off(own.joint) {
                true => vec![0.0; e.len()],
                false => vec![1.0; e.len()],
            };
            let columns: Vec<Vec<f64>> = dataset.experiments.iter().map(on).collect();
            let name = format!("on_{}", info.name);
            let columns = columns.iter().map(Vec::as_slice);
            places[ON] = Some(self.input((name, "1".to_owned()), dataset, columns));
        }
        self.loops.push(Loop {
            servo: own.servo.clone(),
            joint: own.joint,
            sign: own.sign,
            places,
            further: Vec::new(),
        });
    }

    /// Adds an input with its name and unit behind all others, with its column in each record. Its place in z.
    fn input<'r>(
        &mut self,
        (name, unit): (String, String),
        dataset: &mut Dataset,
        columns: impl Iterator<Item = &'r [f64]>,
    ) -> usize {
        targets::add_input(dataset, columns);
        // Idle inputs of states to come go before it.
        let states = self.dims.nq - self.joints.len();
        self.inputs.push(InputInfo {
            name: Cow::Owned(name),
            unit: Cow::Owned(unit),
            joint: None,
        });
        self.dims.u() + states + self.inputs.len() - 1
    }

    /// Adds the coordinate of a state with its idle input, and its column to the records.
    fn coordinate(
        &mut self,
        memory: Memory,
        own: &Driven<'_>,
        rates: Option<&[&[f64]]>,
        dataset: &mut Dataset,
    ) -> usize {
        let info = self.inner.joints()[own.joint].clone();
        let state = self.joints.len();
        let name = format!("{}_{}", memory.word(), info.name);
        let along = memories::along(dataset, own.joint, own.servo, memory, rates);
        add_state(dataset, own.joint, Starts::Along(&along), &name);
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

    /// What the loops with a feed-forward read of the other joints.
    fn read_others(&mut self) {
        let Some(known) = &self.known else { return };
        let velocities = self.dims.v();
        for own in &mut self.loops {
            let inertia = own.servo.has(Gain::InertiaAhead);
            if !(inertia || own.servo.has(Gain::Gravity)) {
                continue;
            }
            let others = (0..known.n()).filter(|&i| i != own.joint);
            let positions = others.clone().map(|i| (Read::Position(i, 1.0), i));
            let late = others.filter_map(|i| Some((i, self.lags[i]?)));
            let late = late.map(|(i, lag)| (Read::Position(i, LAGS), velocities + lag));
            let moved = self.accelerations.iter().enumerate();
            let moved = moved.filter_map(|(i, place)| Some((Read::Acceleration(i), (*place)?)));
            let moved = moved.filter(|_| inertia);
            let all = positions.chain(late).chain(moved);
            let (further, places): (Vec<Read>, Vec<usize>) = all.unzip();
            own.further = further;
            own.places.extend(places.into_iter().map(Some));
        }
    }

    /// Patterns, once all loops are there.
    fn settle(&mut self) {
        self.read_others();
        for state in &mut self.states {
            state.active = self.loops[state.own].active(state.memory);
        }
        let (before, dims) = (self.inner.dims(), self.dims);
        let group = |(own, &motor): (&Loop, &usize)| {
            let mut arguments = vec![None; own.places.len()];
            own.acting().for_each(|a| arguments[a] = own.places[a]);
            chain::Group {
                replaces: vec![before.u() + motor],
                arguments,
            }
        };
        let loops = self.loops.iter();
        self.brakes = (loops.clone())
            .filter_map(|own| Brake::of(own, self.inner.as_ref()))
            .collect();
        let brakes = self.brakes.iter().map(|own| own.group(&before, &dims));
        let groups = loops.zip(&self.motors).map(group).chain(brakes);
        let groups: Vec<chain::Group> = groups.collect();
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

    /// Calls with what the drives feed forward at a point, where one does.
    fn fed<T>(&self, at: &At<'_>, order: Order, work: impl FnOnce(Option<&Fed>) -> T) -> T {
        let Some(known) = &self.known else {
            return work(None);
        };
        let reads = |j: usize| {
            let lag = self.lags[j].map_or(0.0, |lag| LAGS * at.v[lag]);
            let acceleration = self.accelerations[j].map_or(0.0, |z| at.u[z - self.dims.u()]);
            (at.q[j] + lag, acceleration)
        };
        known.at(reads, order, |fed| work(Some(fed)))
    }

    /// Puts the residuals of the states into theirs, times a factor.
    fn put_states(&self, at: &At<'_>, factor: f64, r: &mut [f64]) {
        if self.states.is_empty() {
            return;
        }
        self.fed(at, Order::Value, |fed| {
            for s in &self.states {
                let own = &self.loops[s.own];
                let here = own.at(at, &self.dims, fed);
                r[s.coordinate] = factor * own.residual(s.memory, &here, None, None).0.re;
            }
        });
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
        let [mut u, mut p] = SCRATCH.with(|s| std::mem::take(&mut *s.borrow_mut()));
        let sizes = (&self.inner.dims(), &self.dims);
        let drives = |u: &mut [f64]| {
            self.fed(at, Order::Value, |fed| {
                for (own, &motor) in self.loops.iter().zip(&self.motors) {
                    let here = own.at(at, &self.dims, fed);
                    u[motor] = own.input(&here, None, None).0.re;
                }
            });
        };
        let out = narrowed(sizes, at, &mut u, drives, |within| {
            if self.brakes.is_empty() {
                return work(within);
            }
            p.clear();
            p.extend_from_slice(within.p);
            for own in &self.brakes {
                own.put(at, &self.dims, &mut p);
            }
            work(&At { p: &p, ..*within })
        });
        SCRATCH.with(|s| *s.borrow_mut() = [u, p]);
        out
    }

    fn gradients(&self, at: &At<'_>, out: &mut Vec<f64>) {
        self.fed(at, Order::Slope, |fed| {
            for own in &self.loops {
                let here = own.at(at, &self.dims, fed);
                let first = out.len();
                out.resize(first + own.places.len(), 0.0);
                for a in own.acting() {
                    out[first + a] = own.input(&here, Some(a), None).0.eps1;
                }
            }
        });
        for own in &self.brakes {
            out.extend_from_slice(&own.gradient(at, &self.dims));
        }
    }

    /// The lower triangles: those the chain reads.
    fn curvatures(&self, at: &At<'_>, weights: &[f64], out: &mut Vec<f64>) {
        self.fed(at, Order::Curve, |fed| {
            for (own, w) in self.loops.iter().zip(weights) {
                let here = own.at(at, &self.dims, fed);
                let (first, width) = (out.len(), own.places.len());
                out.resize(first + width * width, 0.0);
                for a in own.acting() {
                    for b in own.acting().take_while(|&b| b <= a) {
                        let second = own.input(&here, Some(a), Some(b)).0.eps1eps2;
                        out[first + a * width + b] = w * second;
                    }
                }
            }
        });
        for (own, w) in self.brakes.iter().zip(&weights[self.loops.len()..]) {
            out.extend_from_slice(&own.curvature(at, &self.dims, *w));
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
        self.put_states(&At { a: &[], ..*at }, -1.0, f);
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        let nq = self.inner.dims().nq;
        self.within(at, |at| self.inner.residual(at, &mut r[..nq]));
        self.put_states(at, 1.0, r);
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
        if !self.states.is_empty() {
            self.fed(at, Order::Slope, |fed| {
                for (state, slots) in self.states.iter().zip(self.jacobian.slots()) {
                    let own = &self.loops[state.own];
                    let here = own.at(at, &self.dims, fed);
                    r[state.coordinate] = own.residual(state.memory, &here, None, None).0.re;
                    for (&a, &slot) in state.active.iter().zip(slots) {
                        values[slot] += own.residual(state.memory, &here, Some(a), None).0.eps1;
                    }
                }
            });
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
        if self.states.is_empty() {
            return;
        }
        self.fed(at, Order::Curve, |fed| {
            for (state, slots) in self.states.iter().zip(self.hessian.slots()) {
                let own = &self.loops[state.own];
                let (weight, here) = (lambda[state.coordinate], own.at(at, &self.dims, fed));
                let active = &state.active;
                let pairs = (0..active.len()).flat_map(|i| (0..=i).map(move |k| (i, k)));
                for ((i, k), &slot) in pairs.zip(slots) {
                    let second =
                        own.residual(state.memory, &here, Some(active[i]), Some(active[k]));
                    values[slot] += weight * second.0.eps1eps2;
                }
            }
        });
    }
}
