//! Position loops of drives within a substep: from the target to the input of the motor, before
//! effects between them.

use pid_data::GainFactors;
use pid_interpret::nominal::{Role as Part, Servo, ServoLaw};

use super::{Machine, State};
use crate::constants::{Constant, Constants};
use crate::drives::target::{Motion, Shaped, followed};
use crate::drives::{Gains, Output, Seen, at_rest, filter, integrated, output, slowed};
use crate::effect::{Commands, Pick};
use crate::hypothesis::Hypothesis;
use crate::nominal::EncoderSide;

/// The loop of a joint with its gains.
pub(super) type Loop<'h, D> = (&'h Servo, Gains<D>);
/// Its output, and how far into the substep the state lies that it answers to, s.
pub(super) type Answer<D> = (Output<D>, f64);

/// What a loop remembers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Memory<D> {
    /// Part of the integral, in the unit of the joint's input.
    pub integral: D,
    /// Output, where it is held from one reading to the next.
    held: D,
    /// Whether the output is at its limit, which hides the integral.
    pub limited: bool,
    /// When the output came to its limit or left it last, s since the start of what was recorded.
    switched: f64,
    /// When it reads next, s since the start of what was recorded.
    pub(super) due: f64,
    /// What it follows.
    pub(super) follows: Motion<D>,
    /// The velocity behind its filter.
    velocity: D,
}

impl Memory<f64> {
    /// The same as constants of another scalar.
    pub(super) fn lift<D: Pick>(&self) -> Memory<D> {
        Memory {
            integral: D::constant(self.integral),
            held: D::constant(self.held),
            limited: self.limited,
            switched: self.switched,
            due: self.due,
            follows: self.follows.map(D::constant),
            velocity: D::constant(self.velocity),
        }
    }
}

impl<D: Pick> Memory<D> {
    /// Notes whether the output `u` of its loop is at the limit at `t`.
    #[inline(always)]
    fn note(&mut self, servo: &Servo, u: f64, t: f64) {
        let limited = servo.limit.is_some_and(|limit| u.abs() >= limit);
        if limited != self.limited {
            (self.limited, self.switched) = (limited, t);
        }
    }

    /// Of a loop that has not read yet.
    pub(super) fn new() -> Self {
        Memory {
            integral: D::nil(),
            held: D::nil(),
            limited: false,
            switched: f64::NEG_INFINITY,
            due: f64::NEG_INFINITY,
            follows: Motion::at_rest(D::nil()),
            velocity: D::nil(),
        }
    }
}

/// Share of a number within which it counts as whole.
const WHOLE: f64 = 1e-3;
/// Share of its stated value below which friction is no unit: a fit may end without any.
const LEAST: f64 = 1e-3;

/// What a loop sees.
#[inline(always)]
fn seen<D: Pick>((r, ahead): (D, D), (q, v): (D, D), (gravity, inertia): (D, D)) -> Seen<D> {
    Seen {
        r,
        q,
        v,
        ahead,
        gravity,
        inertia,
    }
}

/// Whether a number of steps is a whole one, and not none.
pub(crate) fn whole(number: f64) -> bool {
    number > 0.5 && (number - number.round()).abs() < WHOLE * number
}

/// The state itself, as [`Machine::reading`] has it.
pub(super) const START: (f64, f64) = (0.0, 1.0);

/// Period of a loop that holds its output, s; none where it answers at once.
fn period(servo: &Servo) -> f64 {
    servo.rate_hz.map_or(0.0, |rate| 1.0 / rate)
}

/// Period of a loop that reads at the start of a substep of `dt` and holds its output: those of a whole number of
/// substeps, and those so long that the next start is not far.
pub(super) fn held(servo: &Servo, dt: f64) -> Option<f64> {
    let period = period(servo);
    let number = period / dt;
    (whole(number) || number > 2.0).then_some(period)
}

/// How long after a loop came to its limit or left it its integral is looked for, s: 0.2 to 1 s end the fits of
/// `a_fit_behind_a_limit_comes_to_the_noise` alike, with 0.1 s the worst is three times as high.
const STIRRED: f64 = 0.3;

/// How far into a substep of `dt` the state lies that a loop answers to which does not read at its start: in its
/// middle, less the half period for which a held output is late on average.
pub(super) fn ahead(servo: &Servo, dt: f64) -> f64 {
    0.5 * (dt - period(servo))
}

impl<D: Pick> Machine<'_, D> {
    /// The loop of a joint with its gains, and with the stages that effects add to it.
    pub(super) fn loop_of<'h>(
        constants: &Constants<'h, D>,
        hypothesis: &Hypothesis,
        j: usize,
    ) -> Option<Loop<'h, D>> {
        let servo = constants.nominal().description.servo(j)?;
        let added = |gain| {
            let mut own = hypothesis.terms.iter().filter(|term| term.joint == j);
            own.any(|term| term.effect.stage() == Some(gain))
        };
        let get = |gain| constants.get(Constant::Servo(gain, j));
        let gains = Gains::of(|gain| (servo.has(gain) || added(gain)).then(|| get(gain)));
        Some((servo, gains))
    }

    /// Gains of the loops as they are in a record, without those of drives that are off.
    pub(crate) fn in_record(&mut self, factors: &GainFactors) {
        for (j, own) in self.loops.iter_mut().enumerate() {
            self.off[j] = factors.is_off(j);
            if self.off[j] {
                *own = None;
                self.drives[j].viscous = self.constants.get(Constant::Viscous(j));
            } else if let Some((_, k)) = own {
                k.times(|gain| factors.at(gain as usize, j));
            }
        }
    }

    /// Viscous friction of a joint, with the damping by the voltage that its motor induces.
    pub(crate) fn viscous(&self, j: usize) -> D {
        self.drives[j].viscous
    }

    /// The loop of a joint with its gains.
    pub(crate) fn servo(&self, j: usize) -> Option<(&Servo, &Gains<D>)> {
        self.loops[j].as_ref().map(|(servo, k)| (*servo, k))
    }

    /// Joints whose loop has an integral.
    pub(crate) fn integrating(&self) -> Vec<usize> {
        let of = |(j, own): (usize, &Option<Loop<'_, D>>)| {
            own.is_some_and(|(servo, _)| servo.law.integrates())
                .then_some(j)
        };
        self.loops.iter().enumerate().filter_map(of).collect()
    }

    /// Units of the integrals of all joints, as [`Machine::holds`] has them; `None` where a loop has none.
    pub(crate) fn units_of_integrals(&self) -> Vec<Option<D>> {
        let mut out = vec![None; self.n()];
        for j in self.integrating() {
            out[j] = Some(self.holds(j));
        }
        out
    }

    /// Whether the loop of a joint came to its limit or left it shortly before `t`.
    pub(crate) fn stirred(&self, state: &State<D>, j: usize, t: f64) -> bool {
        self.loops[j].is_some() && t - state.loops[j].switched < STIRRED
    }

    /// What the integral of a loop at its limit grows in a period, in the unit of its input; in a substep of `dt`, s,
    /// where the loop answers at once. It stops there, and a period more or less is a matter of chance. `None` without
    /// a limit or an integral.
    pub(crate) fn counted(&self, j: usize, dt: f64) -> Option<f64> {
        let (servo, k) = self.loops[j]?;
        let limit = servo.limit?;
        let per_output = match servo.law {
            ServoLaw::Pid => k.ki / k.kp,
            ServoLaw::Cascade => k.ki / k.kv,
            _ => return None,
        };
        let step = limit * per_output.value() * period(servo).max(dt);
        step.is_finite().then_some(step)
    }

    /// Unit of the part of an integral that no gravity needs at rest: the input that dry friction holds, one where
    /// there is none. In this unit that part stays the same where all forces are another multiple, which no
    /// motion tells.
    pub(crate) fn holds(&self, j: usize) -> D {
        let nominal = self.constants.nominal();
        let place = nominal.place(j, Part::Coulomb);
        let stated = place.map_or(0.0, |i| nominal.values[i].nominal);
        if stated <= 0.0 {
            return D::constant(1.0);
        }
        let friction = self.constants.get(Constant::Coulomb(j));
        let least = D::constant(LEAST * stated);
        let some = friction.limit(least, D::constant(f64::INFINITY));
        some / self.constants.get(Constant::Gain(j))
    }

    /// Whether the loop of a joint closes over the gear: it reads the link and drives the rotor.
    fn reads_link(&self, j: usize) -> bool {
        self.gears[j].is_some() && self.constants.nominal().encoder_side == EncoderSide::Joint
    }

    /// Takes in where the drives whose loops read late are at `t`.
    #[inline(always)]
    pub(super) fn remember(&self, state: &mut State<D>, t: f64) {
        for j in 0..self.n() {
            let late = self.loops[j].and_then(|(_, k)| k.feedback_delay);
            if let Some(late) = late {
                let now = match self.reads_link(j) {
                    true => (state.q[j], state.v[j]),
                    false => (state.drive_q[j], state.drive_v[j]),
                };
                state.past[j].remember(t, now, late.value());
            }
        }
    }

    /// Bends what the drive of a joint moved through since the first of two times, as its position and velocity at the
    /// second are corrected by so much.
    pub(crate) fn bend(&self, state: &mut State<D>, j: usize, times: (f64, f64), by: (D, D)) {
        if self.loops[j].is_some_and(|(_, k)| k.feedback_delay.is_some()) {
            state.past[j].bend(times, by);
        }
    }

    /// Position and velocity that the loop of a joint reads, `ahead` of a state at `t`, s, within a substep of `dt`.
    #[inline(always)]
    pub(super) fn reading(
        &self,
        state: &State<D>,
        j: usize,
        t: f64,
        (ahead, dt): (f64, f64),
    ) -> (D, D) {
        let late = self.loops[j].and_then(|(_, k)| k.feedback_delay);
        if let Some((q, v)) = late.and_then(|late| state.past[j].at(-late + (t + ahead))) {
            return self.sense(j, q, v);
        }
        let (q, v) = match (self.reads_link(j), ahead == 0.0) {
            (true, _) => (
                state.q[j] + state.v[j] * ahead,
                state.v[j] + state.acceleration[j] * ahead,
            ),
            (false, true) => (state.drive_q[j], state.drive_v[j]),
            // Along the way to the middle of the substep.
            (false, false) => {
                let (q, v) = (state.drive_q[j], state.drive_v[j]);
                let share = ahead / (0.5 * dt);
                (
                    q + (self.site_q[j] - q) * share,
                    v + (self.site_v[j] - v) * share,
                )
            }
        };
        self.sense(j, q, v)
    }

    /// The output of a loop where its limit falls with the speed of its motor, in the middle of the substep of `dt`.
    #[inline(always)]
    pub(super) fn slow(
        &self,
        (j, (servo, _)): (usize, Loop<'_, D>),
        own: Answer<D>,
        dt: f64,
    ) -> Answer<D> {
        if servo.falling.is_none() {
            return own;
        }
        let sign = self.constants.get(Constant::Gain(j)).value().signum();
        let slowed = slowed(servo, own.0.u, self.site_v[j] * sign);
        slowed.map_or(own, |mut out| {
            out.damping = out.damping * sign;
            (out, 0.5 * dt)
        })
    }

    /// Answers of all loops over the substep from `t`, and the sum of the sizes of all inputs where an effect
    /// asks for it.
    #[inline(always)]
    pub(super) fn answer_all(
        &mut self,
        state: &mut State<D>,
        commands: &[Commands<'_>],
        (t, dt): (f64, f64),
    ) {
        for j in 0..commands.len() {
            self.answers[j] = self.loops[j].map(|own| {
                let answered = self.answer(state, (j, own), (t, dt));
                self.slow((j, own), answered, dt)
            });
        }
        if self.listens {
            self.taken = D::nil();
            for (j, own) in commands.iter().enumerate() {
                self.taken += self.before_effects(own, j).magnitude();
            }
        }
    }

    /// Input of a joint over the substep before its effects: the output of its loop, or what is commanded.
    #[inline(always)]
    pub(super) fn before_effects(&self, commands: &Commands<'_>, j: usize) -> D {
        match &self.answers[j] {
            Some((out, _)) => out.u,
            None if self.off[j] => D::nil(),
            None => D::constant(commands.now()),
        }
    }

    /// What the loops follow over the substep from `t`, those that read in it.
    #[inline(always)]
    pub(super) fn follow(
        &self,
        state: &mut State<D>,
        commands: &[Commands<'_>],
        (t, dt): (f64, f64),
    ) {
        for (j, own) in commands.iter().enumerate() {
            let Some((servo, k)) = self.loops[j] else {
                continue;
            };
            let target = self.target(state, own, (j, &k));
            let held = held(servo, dt);
            if held.is_some() && t < state.loops[j].due - 1e-3 * dt {
                continue;
            }
            let (length, lead) = match held {
                Some(period) => (period, 0.0),
                None => (dt, 0.5 * period(servo)),
            };
            let shaped = &mut state.shaped[j];
            let both = followed(servo, &k, shaped, &target, (t, length), lead);
            // One that reads at the start of the substep follows what its target becomes over a period.
            state.loops[j].follows = both[usize::from(held.is_some())];
        }
    }

    /// The target of a joint, with velocity and acceleration if a loop uses them: what it differs from the one before
    /// by, over the time between.
    #[inline(always)]
    fn target(
        &self,
        state: &mut State<D>,
        commands: &Commands<'_>,
        (j, k): (usize, &Gains<D>),
    ) -> Motion<D> {
        // A drive that feeds inertia forward counts with the accelerations of all targets.
        let accelerates = |own: &Option<Loop<'_, D>>| own.is_some_and(|(_, k)| k.inertia.is_some());
        let accelerates = self.model.is_some() && self.loops.iter().any(accelerates);
        let spacing = if commands.linear {
            commands.dt
        } else {
            commands.h
        };
        let mut before = |steps: f64| {
            let own = Commands {
                t: commands.t - spacing * steps,
                ..*commands
            };
            self.through(state, &own, (j, true), D::constant(own.now()))
        };
        let mut out = Motion::at_rest(before(0.0));
        if accelerates || k.ahead.is_some() {
            let last = before(1.0);
            out.rate = (out.r - last) / spacing;
            if accelerates {
                out.acceleration = (out.rate - (last - before(2.0)) / spacing) / spacing;
            }
        }
        out
    }

    /// The velocity that a loop uses in place of the one it reads, in the middle and at the end of `dt`, and
    /// how it moves with that.
    #[inline(always)]
    fn filtered(&self, (_, k): &Loop<'_, D>, w: D, v: D, dt: f64) -> ([D; 2], D) {
        let Some(time) = k.velocity_time else {
            return ([v, v], D::constant(1.0));
        };
        let middle = filter::kept(time, 0.5 * dt);
        let end = filter::after(w, v, time, dt);
        ([v + (w - v) * middle, end], -middle + 1.0)
    }

    /// Output of the loop of joint `j` for what it follows over the substep from `t`, with the slopes that the step
    /// takes implicitly (none where the loop closes over a gear or holds its output), and how far into the
    /// substep the state lies that it answers to, s.
    #[inline(always)]
    pub(super) fn answer(
        &self,
        state: &mut State<D>,
        (j, own): (usize, Loop<'_, D>),
        (t, dt): (f64, f64),
    ) -> Answer<D> {
        let (servo, k) = own;
        let fed = self.fed(j);
        let memory = state.loops[j];
        let mut next = memory;
        let follows = &memory.follows;
        let rate = k.ahead.map_or_else(D::nil, |share| share * follows.rate);
        let target = (follows.r, rate);
        let none = |u| {
            let (stiffness, damping) = (D::nil(), D::nil());
            let out = Output {
                u,
                stiffness,
                damping,
            };
            (out, 0.0)
        };
        if let Some(period) = held(servo, dt) {
            if t < memory.due - 1e-3 * dt {
                return none(memory.held);
            }
            // It reads at the start of the substep.
            let first = memory.due.is_infinite();
            let (q, v) = self.reading(state, j, t, (0.0, dt));
            let before = if first { v } else { memory.velocity };
            let ([_, v], _) = self.filtered(&own, before, v, period);
            let at = seen(target, (q, v), fed);
            next.velocity = v;
            next.integral = integrated(servo, &k, &at, (memory.integral, period));
            next.held = output(servo, &k, &at, next.integral).u;
            next.note(servo, next.held.value(), t);
            let late = first || t > memory.due + period;
            next.due = if late { t } else { memory.due } + period;
            state.loops[j] = next;
            return none(next.held);
        }
        let ahead = ahead(servo, dt);
        let (q, v) = self.reading(state, j, t, (ahead, dt));
        let ([v, end], moves) = self.filtered(&own, memory.velocity, v, dt);
        let at = seen(target, (q, v), fed);
        next.velocity = end;
        next.integral = integrated(servo, &k, &at, (memory.integral, dt));
        let out = output(servo, &k, &at, (memory.integral + next.integral) * 0.5);
        next.note(servo, out.u.value(), t);
        state.loops[j] = next;
        match self.reads_link(j) || k.feedback_delay.is_some() {
            true => none(out.u),
            false => {
                let damping = out.damping * moves;
                (Output { damping, ..out }, ahead)
            }
        }
    }

    /// Output of the loops of all joints as they hold the robot at a state at rest, for targets `r`:
    /// torques without a loop. An integral is where the torque `self.bias` needs it.
    pub(super) fn hold(&mut self, state: &mut State<D>, targets: &[f64]) -> Vec<D> {
        self.weigh_at_rest(state);
        let of = |j: usize| {
            let r = D::constant(targets[j]);
            let Some((servo, k)) = self.loops[j] else {
                return if self.off[j] { D::nil() } else { r };
            };
            let (q, v) = self.reading(state, j, self.begin, START);
            let at = seen((r, D::nil()), (q, v), (self.fed(j).0, D::nil()));
            let needed = self.bias[j] / self.constants.get(Constant::Gain(j));
            let integral = at_rest(servo, &k, &at, needed);
            state.shaped[j] = Shaped::at_rest(r);
            state.loops[j] = Memory {
                integral,
                follows: Motion::at_rest(r),
                velocity: v,
                ..state.loops[j]
            };
            output(servo, &k, &at, integral).u
        };
        (0..targets.len()).map(of).collect()
    }
}
