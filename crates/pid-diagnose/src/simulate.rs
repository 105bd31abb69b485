//! One substep of the robot with its effects, over any [`Scalar`]; see [`effect`](crate::effect)
//! for the equation.

use std::borrow::Cow;

use pid_interpret::links;

use crate::constants::{Constant, Constants};
use crate::effect::{After, Commands, Forces, Friction, Gear, Pick, Site, Term};
use crate::extended::Known;
use crate::kernels;
use crate::scalar::Scalar;

/// A hypothesis: the effects present beside the nominal structure, and how it is run.
#[derive(Debug, Clone, Default)]
pub struct Hypothesis {
    /// The effects, in order.
    pub terms: Vec<Term>,
    /// How it is run.
    pub run: Run,
}

/// How a hypothesis is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Factor on the number of substeps; 1 unless a fit is finished with finer ones.
    pub finer: usize,
    /// Whether the states at the start that no sensor reads are estimated.
    pub initial_states: bool,
}

impl Default for Run {
    fn default() -> Self {
        Run {
            finer: 1,
            initial_states: false,
        }
    }
}

impl Run {
    /// As fine as either of two asks for.
    pub fn beside(self, other: Run) -> Run {
        Run {
            finer: self.finer.max(other.finer),
            initial_states: self.initial_states || other.initial_states,
        }
    }
}

impl Hypothesis {
    /// Of effects, run as usual.
    pub fn new(terms: Vec<Term>) -> Self {
        Hypothesis {
            terms,
            run: Run::default(),
        }
    }

    /// Position of the first parameter of each term, and their number.
    pub fn offsets(&self) -> (Vec<usize>, usize) {
        let mut next = 0;
        let starts = self
            .terms
            .iter()
            .map(|t| {
                let at = next;
                next += t.effect.info().parameters.len();
                at
            })
            .collect();
        (starts, next)
    }
}

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
    /// What the links' velocities have changed by since mass matrix and bias were evaluated.
    gained: Vec<D>,
}

/// The robot under a hypothesis, ready to step.
pub struct Machine<'h, D: Pick> {
    /// The constants, those of the effects included.
    pub constants: Constants<'h, D>,
    hypothesis: Cow<'h, Hypothesis>,
    e: Vec<D>,
    starts: Vec<usize>,
    cells: Vec<usize>,
    memory: usize,
    /// Gear of each joint.
    pub gears: Vec<Option<Gear<D>>>,
    /// Time of the first command since the start of what was recorded, s: effects that depend on
    /// time count from there.
    pub begin: f64,
    rotors: Vec<usize>,
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
    scratch: Vec<D>,
    value_x: Vec<f64>,
    value_scratch: Vec<f64>,
    /// Steps whose dry friction did not settle within `ROUNDS`.
    pub unsettled: usize,
}

/// Rounds of [`Machine::solve`] in which all joints may change between sticking and sliding at
/// once. After them one joint changes at a time, the first that must, which cannot cycle where
/// numbers are exact (K. G. Murty, Note on a Bard-type scheme for solving the complementarity
/// problem, Opsearch 11, 1974).
const TOGETHER: usize = 6;
/// Most rounds: many times the number of joints. A step that needs more goes on with what it has,
/// and is counted.
const ROUNDS: usize = 40;

impl<'h, D: Pick> Machine<'h, D> {
    /// From constants at the nominal parameters; `e` are the effects' parameters in SI units.
    pub fn new(constants: Constants<'h, D>, hypothesis: &'h Hypothesis, e: Vec<D>) -> Self {
        Self::over(constants, Cow::Borrowed(hypothesis), e)
    }

    /// The same beside effects that are known.
    pub fn beside(
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
        let mut cells = Vec::new();
        let mut memory = 0;
        for (term, &at) in hypothesis.terms.iter().zip(&starts) {
            let law = D::of(&*term.effect);
            let own = &e[at..at + term.effect.info().parameters.len()];
            law.constants(own, term.joint, &mut constants);
            if let Some(g) = law.gear(own) {
                gears[term.joint] = Some(g);
            }
            cells.push(memory);
            memory += term.effect.memory();
        }
        let rotors: Vec<usize> = (0..n).filter(|&j| gears[j].is_some()).collect();
        let m = n + rotors.len();
        let zero = D::nil();
        let links = constants.prepared();
        Machine {
            constants,
            hypothesis,
            e,
            starts,
            cells,
            memory,
            gears,
            begin: 0.0,
            rotors,
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
            scratch: vec![zero; m * m],
            value_x: vec![0.0; m],
            value_scratch: vec![0.0; m * m],
            unsettled: 0,
        }
    }

    /// Number of joints.
    pub fn n(&self) -> usize {
        self.bias.len()
    }

    fn own(&self, i: usize) -> &[D] {
        let at = self.starts[i];
        &self.e[at..at + self.hypothesis.terms[i].effect.info().parameters.len()]
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

    /// Bias torque at rest at a position.
    fn rest_bias(&mut self, q: &[D]) {
        let n = self.n();
        self.half_q.copy_from_slice(q);
        self.half_v.copy_from_slice(&vec![D::nil(); n]);
        let force = self.tip_force(self.begin, 1e-3);
        self.links_at_half(force);
    }

    /// The state in which the drives at their first inputs hold the robot at the drive-side
    /// positions `q`, `v`.
    pub fn rest(&mut self, q: &[f64], v: &[f64], u: &[f64]) -> State<D> {
        let n = self.n();
        let lift = |x: &[f64]| x.iter().map(|&x| D::constant(x)).collect::<Vec<D>>();
        let mut state = State {
            q: lift(q),
            v: lift(v),
            drive_q: lift(q),
            drive_v: lift(v),
            memory: vec![D::nil(); self.memory],
            load: vec![D::nil(); n],
            acceleration: vec![D::nil(); n + self.rotors.len()],
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
        for i in 0..self.hypothesis.terms.len() {
            let term = &self.hypothesis.terms[i];
            let (a, b) = (self.cells[i], self.cells[i] + term.effect.memory());
            let j = term.joint;
            let balance = self.constants.get(Constant::Gain(j)) * u[j] - self.bias[j];
            D::of(&*term.effect).start(
                self.own(i),
                balance,
                self.constants.get(Constant::Coulomb(j)),
                u[j],
                &mut state.memory[a..b],
            );
        }
        state
    }

    /// Memory cells whose value at the start no reading tells, with their joint and their largest value.
    pub fn unknown_cells(&self) -> Vec<(usize, usize, f64)> {
        let terms = self.hypothesis.terms.iter().zip(&self.cells);
        terms
            .filter_map(|(term, &at)| Some((at, term.joint, term.effect.largest_memory()?)))
            .collect()
    }

    /// Reading of joint `j`: position and velocity as the encoder sees them.
    pub fn sense(&self, j: usize, q: D, v: D) -> (D, D) {
        let mut reading = (q, v);
        for (i, term) in self.hypothesis.terms.iter().enumerate() {
            if term.joint == j && term.effect.info().has_joint {
                reading = D::of(&*term.effect).sense(self.own(i), reading.0, reading.1);
            }
        }
        reading
    }

    /// Sum of the delays of the readings of joint `j`, s.
    pub fn reading_delay(&self, j: usize) -> Option<D> {
        self.collect(j, |law, e| law.reading_delay(e))
    }

    /// Sum of the time constants of additional velocity filters of joint `j`, s.
    pub fn velocity_lag(&self, j: usize) -> Option<D> {
        self.collect(j, |law, e| law.velocity_lag(e))
    }

    fn collect(
        &self,
        j: usize,
        f: impl Fn(&dyn crate::effect::Law<D>, &[D]) -> Option<D>,
    ) -> Option<D> {
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

    /// Moves the state by one substep of `at(j).dt` from `at(j).t`; `commands` holds the inputs of
    /// each joint.
    ///
    /// `links`: time, s, for whose middle mass matrix and bias are evaluated, from this step on;
    /// `None`: those of the steps before serve. Contacts and resonances of a gear need short steps,
    /// the links behind it do not (C. W. Gear, D. R. Wells, Multirate linear multistep methods, BIT
    /// 24, 1984).
    pub fn step(&mut self, state: &mut State<D>, commands: &[Commands<'_>], links: Option<f64>) {
        kernels::step(self, state, commands, links);
    }

    /// [`Machine::step`] for the processor features of its caller.
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        state: &mut State<D>,
        commands: &[Commands<'_>],
        links: Option<f64>,
    ) {
        let n = self.n();
        let m = n + self.rotors.len();
        let (t, dt) = (self.begin + commands[0].t, commands[0].dt);
        let half = 0.5 * dt;
        if let Some(length) = links {
            self.evaluate_links(state, t, length);
        }
        for j in 0..n {
            self.site_q[j] = state.q[j] + state.v[j] * half;
            self.site_v[j] = state.v[j] + state.acceleration[j] * half;
            self.force[j] = D::nil();
            self.rate[j] = D::nil();
        }
        for (r, &j) in self.rotors.iter().enumerate() {
            self.site_q[j] = state.drive_q[j] + state.drive_v[j] * half;
            self.site_v[j] = state.drive_v[j] + state.acceleration[n + r] * half;
        }
        for x in &mut self.matrix {
            *x = D::nil();
        }
        for i in 0..n {
            let mut momentum = D::nil();
            for j in 0..n {
                let x = self.mass[i * n + j];
                self.matrix[i * m + j] = x;
                momentum += x * state.v[j];
            }
            self.rhs[i] = momentum - self.bias[i] * dt;
        }
        for (r, &j) in self.rotors.iter().enumerate() {
            self.rhs[n + r] = D::nil();
            self.levels[j] = None;
            self.status[j] = 2;
        }
        // Effects that add forces.
        for i in 0..self.hypothesis.terms.len() {
            let term = &self.hypothesis.terms[i];
            let (a, b) = (self.cells[i], self.cells[i] + term.effect.memory());
            let at = Site {
                joint: term.joint,
                q: &self.site_q,
                v: &self.site_v,
                load: &state.load,
                t: t + half,
                dt,
                rest: None,
            };
            let own = {
                let at = self.starts[i];
                &self.e[at..at + term.effect.info().parameters.len()]
            };
            let mut forces = Forces {
                value: &mut self.force,
                rate: &mut self.rate,
            };
            D::of(&*term.effect).force(own, &at, &state.memory[a..b], &mut forces, &self.constants);
        }
        // Drive, rotor, friction, on the side of the drive.
        let mut rotor = 0;
        for j in 0..n {
            let geared = self.gears[j].is_some();
            let c = if geared {
                rotor += 1;
                n + rotor - 1
            } else {
                j
            };
            let mut u = D::constant(commands[j].now());
            let mut friction = Friction {
                forward: self.constants.get(Constant::Coulomb(j)),
                backward: self.constants.get(Constant::Coulomb(j)),
                viscous: self.constants.get(Constant::Viscous(j)),
            };
            for i in 0..self.hypothesis.terms.len() {
                let term = &self.hypothesis.terms[i];
                if term.joint != j {
                    continue;
                }
                let (a, b) = (self.cells[i], self.cells[i] + term.effect.memory());
                let own = {
                    let at = self.starts[i];
                    &self.e[at..at + term.effect.info().parameters.len()]
                };
                let law = D::of(&*term.effect);
                u = law.input(own, u, &commands[j], &mut state.memory[a..b]);
                let at = Site {
                    joint: j,
                    q: &self.site_q,
                    v: &self.site_v,
                    load: &state.load,
                    t: t + half,
                    dt,
                    rest: None,
                };
                law.friction(own, &at, &state.memory[a..b], &mut friction);
            }
            let v = if geared { state.drive_v[j] } else { state.v[j] };
            let inertia = self.constants.get(Constant::Rotor(j));
            let damping = (friction.viscous + self.rate[j]) * half;
            self.matrix[c * m + c] += inertia + damping;
            self.rhs[c] += inertia * v
                + (self.constants.get(Constant::Gain(j)) * u + self.force[j]) * dt
                - damping * v;
            let some = friction.forward.value() > 0.0 || friction.backward.value() > 0.0;
            self.levels[c] = some.then(|| (friction.forward * dt, friction.backward * dt));
            if let Some(gear) = self.gears[j] {
                let x = state.drive_q[j] - state.q[j];
                let rate = state.drive_v[j] - state.v[j];
                let middle = x + rate * half;
                let edge = gear.gap * 0.5;
                let over = middle - middle.limit(-edge, edge);
                let touches = gear.gap.value() == 0.0 || middle.value().abs() > edge.value();
                let slope = if touches {
                    gear.stiffness * half
                } else {
                    D::nil()
                };
                let give = (slope + gear.damping) * 0.5;
                let push = gear.stiffness * over - slope * rate + give * rate;
                let (push, give) = (push * dt, give * dt);
                self.rhs[c] -= push;
                self.rhs[j] += push;
                self.matrix[c * m + c] += give;
                self.matrix[j * m + j] += give;
                self.matrix[c * m + j] -= give;
                self.matrix[j * m + c] -= give;
            }
            let v = v.value();
            self.status[c] = match self.levels[c] {
                None => 2,
                Some(_) if v > 0.0 => 1,
                Some(_) if v < 0.0 => -1,
                Some(_) => 0,
            };
        }
        self.solve(m);
        // Torque through the gear from the links' own equation, then the motion.
        for j in 0..n {
            let gained = self.next[j] - state.v[j];
            state.acceleration[j] = gained / dt;
            state.gained[j] += gained;
        }
        for i in 0..n {
            let mut load = self.bias[i];
            for j in 0..n {
                load += self.mass[i * n + j] * state.acceleration[j];
            }
            state.load[i] = load;
        }
        for j in 0..n {
            state.q[j] += (state.v[j] + self.next[j]) * half;
            state.v[j] = self.next[j];
        }
        let mut rotor = 0;
        for j in 0..n {
            let mean;
            if self.gears[j].is_some() {
                let next = self.next[n + rotor];
                state.acceleration[n + rotor] = (next - state.drive_v[j]) / dt;
                mean = (state.drive_v[j] + next) * 0.5;
                state.drive_q[j] += mean * dt;
                state.drive_v[j] = next;
                rotor += 1;
            } else {
                mean = (state.q[j] - state.drive_q[j]) / dt;
                state.drive_q[j] = state.q[j];
                state.drive_v[j] = state.v[j];
            }
            for i in 0..self.hypothesis.terms.len() {
                let term = &self.hypothesis.terms[i];
                if term.joint == j && term.effect.memory() > 0 {
                    let (a, b) = (self.cells[i], self.cells[i] + term.effect.memory());
                    let own = {
                        let at = self.starts[i];
                        &self.e[at..at + term.effect.info().parameters.len()]
                    };
                    let after = After {
                        v: mean,
                        dt,
                        coulomb: self.constants.get(Constant::Coulomb(j)),
                    };
                    D::of(&*term.effect).advance(own, &after, &mut state.memory[a..b]);
                }
            }
        }
    }

    /// Mass matrix and bias in the middle of the time `length` from `t`.
    #[inline(always)]
    fn evaluate_links(&mut self, state: &mut State<D>, t: f64, length: f64) {
        let half = 0.5 * length;
        for j in 0..self.n() {
            self.half_q[j] = state.q[j] + state.v[j] * half;
            self.half_v[j] = state.v[j] + state.gained[j] / length * half;
            state.gained[j] = D::nil();
        }
        let force = self.tip_force(t, length);
        self.links_at_half(force);
    }

    /// Mass matrix and bias at `half_q`, `half_v`.
    #[inline(always)]
    fn links_at_half(&mut self, force: Option<[D; 3]>) {
        let at = links::At {
            q: &self.half_q,
            v: &self.half_v,
            force,
        };
        let programs = &self.constants.nominal().links;
        programs.evaluate(&mut self.links, &at, D::sine_cosine, &mut self.bias);
        let n = self.bias.len();
        let lower = self.links.mass();
        let mut next = 0;
        for i in 0..n {
            for j in 0..=i {
                let entry = lower[next];
                self.mass[i * n + j] = entry;
                self.mass[j * n + i] = entry;
                next += 1;
            }
        }
    }

    /// Velocities after the step, with dry friction: the active set is found on values, derivatives
    /// belong to it.
    #[inline(always)]
    fn solve(&mut self, m: usize) {
        for i in 0..m * m {
            self.values[i] = self.matrix[i].value();
        }
        let mut x = std::mem::take(&mut self.value_x);
        for round in 0..=ROUNDS {
            if round == ROUNDS {
                self.unsettled += 1;
                break;
            }
            for c in 0..m {
                self.value_rhs[c] = self.rhs[c].value() - self.dry(c);
            }
            reduced(
                m,
                &self.values,
                &self.value_rhs,
                &self.status,
                &mut self.value_scratch,
                &mut x,
            );
            let mut stable = true;
            for c in 0..m {
                let Some((forward, backward)) = self.levels[c] else {
                    continue;
                };
                let old = self.status[c];
                let new = if old == 0 {
                    // The impulse that holds it.
                    let mut pull = self.rhs[c].value();
                    for d in 0..m {
                        pull -= self.values[c * m + d] * x[d];
                    }
                    if pull > forward.value() {
                        1
                    } else if pull < -backward.value() {
                        -1
                    } else {
                        0
                    }
                } else if f64::from(old) * x[c] < 0.0 {
                    0
                } else {
                    old
                };
                if new != old {
                    self.status[c] = new;
                    stable = false;
                    // After a while one change at a time, which cannot cycle.
                    if round > TOGETHER {
                        break;
                    }
                }
            }
            if stable && D::PLAIN {
                for (next, x) in self.next.iter_mut().zip(&x) {
                    *next = D::constant(*x);
                }
                self.value_x = x;
                return;
            }
            if stable {
                break;
            }
        }
        self.value_x = x;
        for c in 0..m {
            self.rhs[c] = match (self.levels[c], self.status[c]) {
                (Some((f, _)), 1) => self.rhs[c] - f,
                (Some((_, b)), -1) => self.rhs[c] + b,
                _ => self.rhs[c],
            };
        }
        reduced(
            m,
            &self.matrix,
            &self.rhs,
            &self.status,
            &mut self.scratch,
            &mut self.next,
        );
    }

    #[inline(always)]
    fn dry(&self, c: usize) -> f64 {
        match (self.levels[c], self.status[c]) {
            (Some((f, _)), 1) => f.value(),
            (Some((_, b)), -1) => -b.value(),
            _ => 0.0,
        }
    }
}

/// Solves the rows and columns whose status is not 0 by Cholesky factorization; the others are zero.
#[inline(always)]
fn reduced<D: Scalar>(m: usize, a: &[D], b: &[D], status: &[i8], l: &mut [D], x: &mut [D]) {
    for i in 0..m {
        if status[i] == 0 {
            x[i] = D::nil();
            continue;
        }
        for j in 0..=i {
            if status[j] == 0 {
                continue;
            }
            let mut entry = a[i * m + j];
            for k in 0..j {
                if status[k] != 0 {
                    entry -= l[i * m + k] * l[j * m + k];
                }
            }
            l[i * m + j] = if i == j {
                entry.root().inverse()
            } else {
                entry * l[j * m + j]
            };
        }
        let mut y = b[i];
        for k in 0..i {
            if status[k] != 0 {
                y -= l[i * m + k] * x[k];
            }
        }
        x[i] = y * l[i * m + i];
    }
    for i in (0..m).rev() {
        if status[i] == 0 {
            continue;
        }
        let mut y = x[i];
        for k in i + 1..m {
            if status[k] != 0 {
                y -= l[k * m + i] * x[k];
            }
        }
        x[i] = y * l[i * m + i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nominal::Nominal;
    use crate::predict::Substeps;

    /// Sample time, s, and samples of the runs.
    const H: f64 = 4e-3;
    const SAMPLES: usize = 100;

    /// Link positions of a six-joint arm whose second joint has a gear, after a motion under
    /// current; the links are evaluated at every fine substep, or held.
    fn run(effect: &str, e: &[f64], refined: usize, held: bool) -> Vec<f64> {
        let text = include_str!("../robots/ur10e.toml");
        let nominal = Nominal::parse(text, "ur10e.toml".as_ref()).unwrap();
        let n = nominal.n();
        let effect = crate::effects::all()
            .into_iter()
            .find(|x| x.info().id == effect)
            .unwrap();
        let hypothesis = Hypothesis::new(vec![Term { effect, joint: 1 }]);
        let constants = Constants::new(&nominal, &vec![0.0; nominal.size()]);
        let mut machine = Machine::<f64>::new(constants, &hypothesis, e.to_vec());
        let steps = Substeps::new(H, true, refined);
        let dt = H / steps.number() as f64;
        let u: Vec<Vec<f64>> = (0..n)
            .map(|j| {
                let wave =
                    |k: usize| (0.3 + 0.05 * (k as f64 * (0.2 + 0.1 * j as f64)).sin()) * 9.0;
                (0..SAMPLES).map(wave).collect()
            })
            .collect();
        let mut state = machine.rest(&[0.3, -0.8, 0.9, 0.2, 0.4, 0.1], &[0.0; 6], &[0.0; 6]);
        for k in 0..SAMPLES {
            for i in 0..steps.number() {
                let commands: Vec<Commands<'_>> = u
                    .iter()
                    .map(|u| Commands {
                        u,
                        h: H,
                        linear: false,
                        begin: 0.0,
                        t: k as f64 * H + i as f64 * dt,
                        dt,
                    })
                    .collect();
                let links = if held { steps.links(H, i) } else { Some(dt) };
                machine.step(&mut state, &commands, links);
            }
        }
        state.q
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).fold(0.0, |d, (a, b)| (a - b).abs().max(d))
    }

    /// One joint sticks below its level of friction and slides beyond it. Two whose matrix is not
    /// symmetric, as none of a robot is, have no consistent state: the second slides only while the
    /// first sticks, and the first only while the second slides.
    #[test]
    fn friction_settles_and_what_does_not_is_counted() {
        let text = include_str!("../robots/ur10e.toml");
        let nominal = Nominal::parse(text, "ur10e.toml".as_ref()).unwrap();
        let nothing = Hypothesis::default();
        let constants = Constants::new(&nominal, &vec![0.0; nominal.size()]);
        let mut machine = Machine::<f64>::new(constants, &nothing, Vec::new());
        machine.levels.fill(Some((0.5, 0.5)));
        machine.matrix[0] = 4.0;
        for (pull, expected) in [(0.4, 0.0), (1.5, 0.25), (-1.5, -0.25)] {
            machine.rhs[0] = pull;
            machine.solve(1);
            assert_eq!((machine.next[0], machine.unsettled), (expected, 0));
        }
        machine.status.fill(0);
        machine.matrix[..4].copy_from_slice(&[2.0, -10.0, 0.0, 2.0]);
        machine.rhs[..2].copy_from_slice(&[0.0, 2.5]);
        machine.solve(2);
        assert_eq!(machine.unsettled, 1);
    }

    #[test]
    fn links_held_over_fine_substeps_keep_the_order_of_the_steps() {
        let spring = [1e-4, 1e-3];
        let exact = run("joint_elasticity", &spring, 32, false);
        let error =
            |refined: usize| distance(&run("joint_elasticity", &spring, refined, true), &exact);
        let errors = [1, 2, 4].map(error);
        for pair in errors.windows(2) {
            assert!(pair[1] < 0.3 * pair[0], "{errors:?}");
        }
    }

    #[test]
    fn links_held_over_fine_substeps_cost_little_accuracy_in_contacts() {
        let play = [0.01, 1e-4, 1e-3];
        let exact = run("backlash", &play, 32, false);
        let error = |held: bool| distance(&run("backlash", &play, 1, held), &exact);
        // In rad; the gap is a thousand times wider.
        let (held, own) = (error(true), error(false));
        assert!(held < 2e-5 && held < 10.0 * own, "{held} {own}");
    }
}
