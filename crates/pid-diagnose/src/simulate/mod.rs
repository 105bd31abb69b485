//! One substep of the robot with its effects, over any [`Scalar`](crate::scalar::Scalar); see
//! [`effect`](crate::effect) for the equation.

mod contact;
mod feed_forward;
mod past;
mod servo;
mod step;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::ops::Range;

use pid_interpret::links;

use crate::constants::{Constant, Constants};
use crate::drives::target::Shaped;
use crate::effect::{Gear, Law, Pick};
use crate::hypothesis::Hypothesis;
use crate::known::Known;
use feed_forward::Model;
use past::Past;
use servo::{Answer, Loop};

pub(crate) use servo::{Memory, whole};

/// Everything that moves.
#[derive(Debug, Clone)]
pub struct State<D> {
    /// Link positions.
    pub q: Vec<D>,
    /// Link velocities.
    pub v: Vec<D>,
    /// Drive-side positions; equal to the link's where the joint is rigid.
    pub drive_q: Vec<D>,
    /// Drive-side velocities.
    pub drive_v: Vec<D>,
    /// Memory of the effects.
    pub memory: Vec<D>,
    /// Torque through the gear in the step before.
    pub load: Vec<D>,
    /// Accelerations of the step before, of links and then rotors.
    acceleration: Vec<D>,
    /// What the position loops of the drives remember.
    pub(crate) loops: Vec<Memory<D>>,
    /// What the drives whose loops read late moved through.
    past: Vec<Past<D>>,
    /// What has become of the targets of position loops; empty where there are none.
    shaped: Vec<Shaped<D>>,
    /// What the links' velocities have changed by since mass matrix and bias were evaluated.
    gained: Vec<D>,
}

impl State<f64> {
    /// The same state as constants of another scalar.
    pub(crate) fn lift<D: Pick>(&self) -> State<D> {
        let all = |x: &[f64]| x.iter().map(|&x| D::constant(x)).collect();
        State {
            q: all(&self.q),
            v: all(&self.v),
            drive_q: all(&self.drive_q),
            drive_v: all(&self.drive_v),
            memory: all(&self.memory),
            load: all(&self.load),
            acceleration: all(&self.acceleration),
            loops: self.loops.iter().map(Memory::lift).collect(),
            past: self.past.iter().map(Past::lift).collect(),
            shaped: (self.shaped.iter().map(|own| own.map(D::constant))).collect(),
            gained: all(&self.gained),
        }
    }
}

/// What a step needs to know of a term of the hypothesis.
#[derive(Debug, Clone)]
struct Place {
    joint: usize,
    /// Whether it acts at its joint alone.
    has_joint: bool,
    /// Its parameters among all of them.
    own: Range<usize>,
    /// Its cells of [`State::memory`].
    cells: Range<usize>,
    before_drive: bool,
    needs_inputs: bool,
}

/// Constants of the drive of a joint.
#[derive(Debug, Clone, Copy)]
struct Drive<D> {
    gain: D,
    coulomb: D,
    /// With the damping by the voltage that its motor induces while it is on.
    viscous: D,
    rotor: D,
}

impl<D: Pick> Drive<D> {
    fn of(constants: &Constants<'_, D>, j: usize) -> Self {
        Drive {
            gain: constants.get(Constant::Gain(j)),
            coulomb: constants.get(Constant::Coulomb(j)),
            viscous: constants.get(Constant::Viscous(j)) + constants.induced(j),
            rotor: constants.get(Constant::Rotor(j)),
        }
    }
}

/// The robot under a hypothesis, ready to step.
pub(crate) struct Machine<'h, D: Pick> {
    /// The constants, those of the effects included.
    pub constants: Constants<'h, D>,
    hypothesis: Cow<'h, Hypothesis>,
    e: Vec<D>,
    /// What a step needs to know of each term of the hypothesis.
    terms: Vec<Place>,
    memory: usize,
    /// Constants of each drive.
    drives: Vec<Drive<D>>,
    /// Gear of each joint.
    pub gears: Vec<Option<Gear<D>>>,
    /// Time of the first command since the start of what was recorded, s: effects that depend on
    /// time count from there.
    pub begin: f64,
    rotors: Vec<usize>,
    /// Whether an effect accelerates the base.
    shaken: bool,
    /// Whether an effect depends on the inputs of other joints, and the sum of the sizes of all.
    listens: bool,
    taken: D,
    /// Position loops of the drives.
    loops: Vec<Option<Loop<'h, D>>>,
    /// Whether a drive is off: its motor exerts no torque.
    off: Vec<bool>,
    /// What the loops answer over the substep.
    answers: Vec<Option<Answer<D>>>,
    /// What their feed-forward knows of the robot.
    model: Option<Model<D>>,
    links: links::Work<D>,
    /// Row by row.
    mass: Vec<D>,
    bias: Vec<D>,
    matrix: Vec<D>,
    rhs: Vec<D>,
    values: Vec<f64>,
    value_rhs: Vec<f64>,
    levels: Vec<Option<(D, D)>>,
    status: Vec<i8>,
    half_q: Vec<D>,
    half_v: Vec<D>,
    site_q: Vec<D>,
    site_v: Vec<D>,
    force: Vec<D>,
    rate: Vec<D>,
    next: Vec<D>,
    value_x: Vec<f64>,
    /// Of the values of the matrix, without what sticks.
    factor: Vec<f64>,
    /// Steps whose dry friction did not settle within `ROUNDS`.
    pub unsettled: usize,
}

impl<'h, D: Pick> Machine<'h, D> {
    /// From constants at the nominal parameters; `e` are the effects' parameters in SI units.
    pub(crate) fn new(constants: Constants<'h, D>, hypothesis: &'h Hypothesis, e: Vec<D>) -> Self {
        Self::over(constants, Cow::Borrowed(hypothesis), e)
    }

    /// The same beside effects that are known.
    pub(crate) fn beside(
        known: &Known,
        constants: Constants<'h, D>,
        hypothesis: &'h Hypothesis,
        e: Vec<D>,
    ) -> Self {
        if known.is_empty() {
            return Self::new(constants, hypothesis, e);
        }
        let mut all = known.hypothesis.clone();
        all.terms.extend(hypothesis.terms.iter().cloned());
        let held = known.e.iter().map(|&x| D::constant(x));
        Self::over(constants, Cow::Owned(all), held.chain(e).collect())
    }

    fn over(mut constants: Constants<'h, D>, hypothesis: Cow<'h, Hypothesis>, e: Vec<D>) -> Self {
        let n = constants.nominal().n();
        let (starts, _) = hypothesis.offsets();
        let mut gears = vec![None; n];
        let mut terms = Vec::new();
        let mut memory = 0;
        let (mut shaken, mut listens) = (false, false);
        for (term, &at) in hypothesis.terms.iter().zip(&starts) {
            let law = D::of(&*term.effect);
            let info = term.effect.info();
            let place = Place {
                joint: term.joint,
                has_joint: info.has_joint,
                own: at..at + info.parameters.len(),
                cells: memory..memory + term.effect.memory(),
                before_drive: term.effect.before_drive(),
                needs_inputs: term.effect.needs_inputs(),
            };
            let own = &e[place.own.clone()];
            law.constants(own, term.joint, &mut constants);
            if let Some(g) = law.gear(own) {
                gears[term.joint] = Some(g);
            }
            shaken |= law.base_acceleration(own, 0.0).is_some();
            listens |= place.needs_inputs;
            memory = place.cells.end;
            terms.push(place);
        }
        let rotors: Vec<usize> = (0..n).filter(|&j| gears[j].is_some()).collect();
        let m = n + rotors.len();
        let zero = D::nil();
        let links = constants.prepared();
        let loops = (0..n)
            .map(|j| Self::loop_of(&constants, &hypothesis, j))
            .collect::<Vec<_>>();
        let drives = (0..n).map(|j| Drive::of(&constants, j)).collect();
        let model = Model::of(&constants, &loops);
        Machine {
            constants,
            hypothesis,
            e,
            terms,
            memory,
            drives,
            gears,
            begin: 0.0,
            rotors,
            shaken,
            listens,
            taken: zero,
            loops,
            off: vec![false; n],
            answers: vec![None; n],
            model,
            links,
            mass: vec![zero; n * n],
            bias: vec![zero; n],
            matrix: vec![zero; m * m],
            rhs: vec![zero; m],
            values: vec![0.0; m * m],
            value_rhs: vec![0.0; m],
            levels: vec![None; m],
            status: vec![0; m],
            half_q: vec![zero; n],
            half_v: vec![zero; n],
            site_q: vec![zero; n],
            site_v: vec![zero; n],
            force: vec![zero; n],
            rate: vec![zero; n],
            next: vec![zero; m],
            value_x: vec![0.0; m],
            factor: vec![0.0; m * m],
            unsettled: 0,
        }
    }

    /// Number of joints.
    pub(crate) fn n(&self) -> usize {
        self.bias.len()
    }

    fn own(&self, i: usize) -> &[D] {
        &self.e[self.terms[i].own.clone()]
    }

    #[inline(always)]
    fn tip_force(&self, t: f64, dt: f64) -> Option<[D; 3]> {
        let mut tip_force: Option<[D; 3]> = None;
        for (i, term) in self.hypothesis.terms.iter().enumerate() {
            if let Some(f) = D::of(&*term.effect).tip_force(self.own(i), t, dt) {
                let sum = tip_force.unwrap_or([D::nil(); 3]);
                tip_force = Some([sum[0] + f[0], sum[1] + f[1], sum[2] + f[2]]);
            }
        }
        tip_force
    }

    /// Moves the base as the effects say.
    #[inline(always)]
    fn shake(&mut self, t: f64) {
        if !self.shaken {
            return;
        }
        let mut sum = [D::nil(); 3];
        for (i, term) in self.hypothesis.terms.iter().enumerate() {
            if let Some(a) = D::of(&*term.effect).base_acceleration(self.own(i), t) {
                for (sum, a) in sum.iter_mut().zip(a) {
                    *sum += a;
                }
            }
        }
        self.constants.shaken(&mut self.links, sum);
    }

    /// Bias torque at rest at a position.
    fn rest_bias(&mut self, q: &[D]) {
        let n = self.n();
        self.half_q.copy_from_slice(q);
        self.half_v.copy_from_slice(&vec![D::nil(); n]);
        self.shake(self.begin);
        let force = self.tip_force(self.begin, 1e-3);
        self.links_at_half(force);
    }

    /// The state in which the drives at their first inputs, or targets, hold the robot at the
    /// drive-side positions `q`, `v`.
    pub(crate) fn rest(&mut self, q: &[f64], v: &[f64], u: &[f64]) -> State<D> {
        let n = self.n();
        let lift = |x: &[f64]| x.iter().map(|&x| D::constant(x)).collect::<Vec<D>>();
        let looped = match self.loops.iter().any(Option::is_some) {
            true => n,
            false => 0,
        };
        let mut state = State {
            q: lift(q),
            v: lift(v),
            drive_q: lift(q),
            drive_v: lift(v),
            memory: vec![D::nil(); self.memory],
            load: vec![D::nil(); n],
            acceleration: vec![D::nil(); n + self.rotors.len()],
            loops: vec![Memory::new(); n],
            past: vec![Past::new(); n],
            shaped: vec![Shaped::at_rest(D::nil()); looped],
            gained: vec![D::nil(); n],
        };
        self.rest_bias(&state.q.clone());
        state.load.copy_from_slice(&self.bias);
        for j in 0..n {
            if let Some(gear) = self.gears[j] {
                let b = self.bias[j];
                let side = if b.value() < 0.0 { -0.5 } else { 0.5 };
                state.q[j] = state.drive_q[j] - b / gear.stiffness - gear.gap * side;
            }
        }
        let inputs = self.hold(&mut state, u);
        for i in 0..self.hypothesis.terms.len() {
            let term = &self.hypothesis.terms[i];
            let j = term.joint;
            let balance = self.constants.get(Constant::Gain(j)) * inputs[j] - self.bias[j];
            D::of(&*term.effect).start(
                self.own(i),
                balance,
                self.constants.get(Constant::Coulomb(j)),
                inputs[j].value(),
                &mut state.memory[self.terms[i].cells.clone()],
            );
        }
        state
    }

    /// Memory cells whose value at the start no reading tells, with their joint and their largest value.
    pub(crate) fn unknown_cells(&self) -> Vec<(usize, usize, f64)> {
        let terms = self.hypothesis.terms.iter().zip(&self.terms);
        terms
            .filter_map(|(term, place)| {
                let largest = term.effect.largest_memory()?;
                Some((place.cells.start, place.joint, largest))
            })
            .collect()
    }

    /// Reading of joint `j`: position and velocity as the encoder sees them.
    pub(crate) fn sense(&self, j: usize, q: D, v: D) -> (D, D) {
        let mut reading = (q, v);
        for (i, term) in self.hypothesis.terms.iter().enumerate() {
            if term.joint == j && self.terms[i].has_joint {
                reading = D::of(&*term.effect).sense(self.own(i), reading.0, reading.1);
            }
        }
        reading
    }

    /// Sum of the delays of the readings of joint `j`, s.
    pub(crate) fn reading_delay(&self, j: usize) -> Option<D> {
        self.collect(j, |law, e| law.reading_delay(e))
    }

    /// Sum of the time constants of additional velocity filters of joint `j`, s.
    pub(crate) fn velocity_lag(&self, j: usize) -> Option<D> {
        self.collect(j, |law, e| law.velocity_lag(e))
    }

    fn collect(&self, j: usize, f: impl Fn(&dyn Law<D>, &[D]) -> Option<D>) -> Option<D> {
        let mut out: Option<D> = None;
        for (i, term) in self.hypothesis.terms.iter().enumerate() {
            if term.joint == j
                && let Some(x) = f(D::of(&*term.effect), self.own(i))
            {
                out = Some(out.map_or(x, |o| o + x));
            }
        }
        out
    }
}
