//! One-step prediction of the readings and free runs.
//!
//! The predictor is the simulation corrected at every sample by its innovation,
//! `x̂ ← x̂ + K (y − ŷ)`; its innovations, whitened, are what is fitted (L. Ljung, System
//! Identification, 1999, chapters 3 and 7). Free runs use no correction.

use std::ops::ControlFlow;

use crate::case::{Case, Record, Velocity};
use crate::constants::{Constant, Constants};
use crate::drives::{falls, slopes};
use crate::effect::{Commands, Pick};
use crate::hypothesis::Hypothesis;
use crate::nominal::EncoderSide;
use crate::observer::{Design, Gain, INTEGRAL, Integral, LAGGING, gain};
use crate::scalar::Scalar;
use crate::simulate::{Machine, State};
use crate::substeps::Substeps;

/// Innovations of the first moments are left out: they tell of the start, s.
const SETTLING: f64 = 0.35;

/// Inputs of the first moments are averaged for the state at the start, s.
const HOLDING: f64 = 0.015;

/// Time in which an integral that is off is found again from what readings show, s, where torques are the larger
/// noise: 0.5 s end the fits of `a_fit_behind_a_limit_comes_to_the_noise` alike.
const FOUND_AGAIN: f64 = 2.0;

/// How far an integral strays in a sample after its loop came to its limit or left it, in what it grows in a period
/// there. The worst fit of `a_fit_behind_a_limit_comes_to_the_noise` ends at 1.3 times its number of innovations; with
/// half as much at 1.6 times, with nothing at ten times.
const MISCOUNTED: f64 = 0.1;

/// Samples of a record whose innovations count.
pub fn rows(record: &Record) -> usize {
    record.len() - ((SETTLING / record.h) as usize).min(record.len())
}

/// Gains of all joints in a record under a hypothesis at its parameters.
pub fn gains(
    (case, record): (&Case, &Record),
    hypothesis: &Hypothesis,
    theta: &[f64],
    e: &[f64],
) -> Vec<Gain> {
    let h = record.h;
    let constants = Constants::new(&case.nominal, theta);
    let mut machine = Machine::<f64>::beside(&case.known, constants, hypothesis, e.to_vec());
    machine.in_record(&record.gain_factors);
    let run = case.run(hypothesis);
    let number = Substeps::of(&case.nominal, h, run.short, run.finer).number();
    (0..case.n())
        .map(|j| {
            let noise = &case.noise[j];
            let all = case.scale[j].inertia;
            let rotor = machine.constants.get(Constant::Rotor(j)).max(1e-3 * all);
            let gear = machine.gears[j].map(|g| {
                // A gap is a soft spring on the whole.
                let compliance = 1.0 / g.stiffness + 0.5 * g.gap / case.scale[j].torque * 4.0;
                (
                    (all - rotor).max(0.02 * all),
                    1.0 / compliance,
                    (g.damping + g.open).min(2.0 * (rotor / compliance).sqrt()),
                    case.nominal.encoder_side == EncoderSide::Joint,
                )
            });
            let disturbed = noise.torque.hypot(noise.passed);
            let (servo, integral) = looped(&machine, j, h / FOUND_AGAIN * disturbed);
            let design = Design {
                h,
                inertia: if gear.is_some() { rotor } else { all },
                viscous: machine.viscous(j).max(0.0),
                gear,
                servo: (servo[0], servo[1]),
                integral,
                torque: noise.torque,
                passed: noise.passed,
                q: noise.q,
                v: (case.velocity[j] == Velocity::Measured).then_some(noise.v),
                lag: velocity_lag(case, &machine, j),
            };
            with_stirred(&machine, j, &design, h / number as f64)
        })
        .collect()
}

/// By how much the position loop of joint `j` lowers its torque, and its integral, which strays by so much in a sample.
fn looped(machine: &Machine<'_, f64>, j: usize, strays: f64) -> ([f64; 2], Option<Integral>) {
    let Some((servo, k)) = machine.servo(j) else {
        return ([0.0; 2], None);
    };
    let motor = machine.constants.get(Constant::Gain(j));
    let in_torque = |slopes: [f64; 2]| slopes.map(|slope| motor * slope);
    let integral = falls(servo.law, k).map(|falls| Integral {
        falls: in_torque(falls),
        strays,
    });
    (in_torque(slopes(servo.law, k)), integral)
}

/// The gain of joint `j` for a design, with that shortly after its loop came to its limit or left it; substeps
/// take `dt`, s.
fn with_stirred(machine: &Machine<'_, f64>, j: usize, design: &Design, dt: f64) -> Gain {
    let mut own = gain(design);
    let per_input = machine.constants.get(Constant::Gain(j));
    if let (Some(integral), Some(step)) = (design.integral, machine.counted(j, dt)) {
        let strays = integral.strays.hypot(MISCOUNTED * per_input * step);
        let integral = Some(Integral { strays, ..integral });
        own.stirred = gain(&Design {
            integral,
            ..*design
        })
        .rows;
    }
    let unit = per_input * machine.holds(j);
    for rows in [&mut own.rows, &mut own.stirred] {
        rows[INTEGRAL] = rows[INTEGRAL].map(|x| x / unit);
    }
    own
}

/// Time constant by which the velocity reading of joint `j` lags, s: that of the effects and that
/// which all measured velocities share. Two lags one after the other are late by their sum.
fn velocity_lag<D: Pick>(case: &Case, machine: &Machine<'_, D>, j: usize) -> Option<D> {
    let own = machine.velocity_lag(j);
    let shared = case.shared_lag;
    if shared == 0.0 || case.velocity[j] != Velocity::Measured {
        return own;
    }
    Some(own.map_or(D::constant(shared), |t| t + shared))
}

/// Position and velocity `delay` (in samples) before the last entry of a history of samples `h`
/// apart: cubic through positions and velocities, differentiable at zero; the first entry before
/// the start.
fn earlier<D: Scalar>(history: &[(D, D)], delay: D, h: f64) -> (D, D) {
    let last = history.len() - 1;
    let x = -delay + last as f64;
    if x.value() <= 0.0 || last == 0 {
        return history[0];
    }
    let i = (x.value().ceil() as usize).clamp(1, last) - 1;
    let s = x - i as f64;
    let ((p0, v0), (p1, v1)) = (history[i], history[i + 1]);
    let (m0, m1, d) = (v0 * h, v1 * h, p1 - p0);
    let (a, b) = (m0 + m1 - d * 2.0, d * 3.0 - m0 * 2.0 - m1);
    (
        ((a * s + b) * s + m0) * s + p0,
        ((a * s * 3.0 + b * 2.0) * s + m0) / h,
    )
}

/// What the sensors of all joints remember while a predictor follows them.
struct Shown<D> {
    /// By how much readings are late.
    delays: Vec<Option<D>>,
    /// Share of a lagging velocity that is left after a sample.
    lags: Vec<Option<D>>,
    /// Positions and velocities up to now, of joints whose readings are late.
    history: Vec<Vec<(D, D)>>,
    /// Velocities as lagging sensors show them.
    lagged: Vec<D>,
    /// Units of the integrals of position loops, in which they are corrected.
    integrals: Vec<Option<D>>,
}

/// The machine over one record.
pub struct Runner<'a, 'h, D: Pick> {
    pub(crate) case: &'a Case,
    pub(crate) record: &'a Record,
    pub(crate) machine: Machine<'h, D>,
    substeps: Substeps,
}

impl<'a, 'h, D: Pick> Runner<'a, 'h, D> {
    /// For a record at parameters.
    pub fn new(
        case: &'a Case,
        record: &'a Record,
        hypothesis: &'h Hypothesis,
        theta: &[D],
        e: &[D],
    ) -> Self
    where
        'a: 'h,
    {
        debug_assert_eq!(theta.len(), case.nominal.size());
        let mut machine = Machine::beside(
            &case.known,
            Constants::new(&case.nominal, theta),
            hypothesis,
            e.to_vec(),
        );
        machine.begin = record.begin;
        machine.in_record(&record.gain_factors);
        let run = case.run(hypothesis);
        let short = run.short || machine.gears.iter().any(Option::is_some);
        Runner {
            case,
            record,
            substeps: Substeps::of(&case.nominal, record.h, short, run.finer),
            machine,
        }
    }

    /// True position and velocity whose reading is `q`, `v`.
    fn unread(&self, j: usize, q: f64, v: f64) -> (f64, f64) {
        let (mut a, mut b) = (q, v);
        for _ in 0..6 {
            let (rq, rv) = self.machine.sense(j, D::constant(a), D::constant(b));
            a += q - rq.value();
            b += v - rv.value();
        }
        (a, b)
    }

    /// The state at sample `k` as read, with everything else at rest.
    pub fn start(&mut self, k: usize) -> State<D> {
        let n = self.case.n();
        let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
        for j in 0..n {
            (q[j], v[j]) = self.read_state(j, k);
        }
        // A controller passes the noise of its readings on: what holds the robot is the mean of the
        // first inputs.
        let last = (k + (HOLDING / self.record.h) as usize).min(self.record.len() - 1);
        let u: Vec<f64> = (0..n)
            .map(|j| self.record.u[j][k..=last].iter().sum::<f64>() / (last + 1 - k) as f64)
            .collect();
        let mut state = self.machine.rest(&q, &v, &u);
        // The true position behind a reading moves with the parameters of the sensor.
        for j in 0..n {
            let (rq, rv) = self.machine.sense(j, D::constant(q[j]), D::constant(v[j]));
            let (mut a, mut b) = (D::constant(q[j]), D::constant(v[j]));
            for _ in 0..4 {
                let (x, y) = self.machine.sense(j, a, b);
                a += -x + rq.value();
                b += -y + rv.value();
            }
            let (a, b) = (a - a.value(), b - b.value());
            state.q[j] += a;
            state.drive_q[j] += a;
            state.v[j] += b;
            state.drive_v[j] += b;
        }
        state
    }

    /// Moves the states that no sensor reads to where they were found, joint by joint as [`Gain::hidden`] has them.
    fn unrest(&self, state: &mut State<D>, hidden: &[[D; 4]]) {
        let on_link = self.case.nominal.encoder_side == EncoderSide::Joint;
        for (j, hidden) in hidden.iter().enumerate() {
            if self.machine.gears[j].is_some() {
                let (q, v) = if on_link {
                    (&mut state.drive_q[j], &mut state.drive_v[j])
                } else {
                    (&mut state.q[j], &mut state.v[j])
                };
                *q += hidden[0];
                *v += hidden[1];
            }
        }
        for j in self.machine.integrating() {
            state.loops[j].integral += self.machine.holds(j) * hidden[j][3];
        }
        for (cell, joint, most) in self.machine.unknown_cells() {
            let moved = state.memory[cell] + hidden[joint][2];
            state.memory[cell] = moved.limit(D::constant(-most), D::constant(most));
        }
    }

    /// Smoothed reading of joint `j` at sample `k`, undone by the sensor effects.
    fn read_state(&self, j: usize, k: usize) -> (f64, f64) {
        let r = self.record;
        let late = self
            .machine
            .reading_delay(j)
            .map_or(0.0, |d| d.value() / r.h);
        let x = (k as f64 + late).min(r.len() as f64 - 1.0);
        let i = (x.floor() as usize).min(r.len() - 2);
        let s = x - i as f64;
        let mix = |y: &[f64]| y[i] * (1.0 - s) + y[i + 1] * s;
        let v = match k {
            0 => r.first_v[j],
            _ => mix(&r.smooth_v[j]),
        };
        self.unread(j, mix(&r.smooth_q[j]), v)
    }

    fn sample(&mut self, state: &mut State<D>, k: usize, commands: &mut Vec<Commands<'a>>) {
        let dt = self.record.h / self.substeps.number() as f64;
        for s in 0..self.substeps.number() {
            commands.clear();
            for j in 0..self.case.n() {
                commands.push(Commands {
                    u: &self.record.u[j],
                    h: self.record.h,
                    linear: self.case.linear_hold,
                    begin: self.record.begin,
                    t: k as f64 * self.record.h + s as f64 * dt,
                    dt,
                });
            }
            let links = self.substeps.links(self.record.h, s);
            self.machine.step(state, commands, links);
        }
    }

    fn encoder(&self, state: &State<D>, j: usize) -> (D, D) {
        if self.case.nominal.encoder_side == EncoderSide::Joint {
            (state.q[j], state.v[j])
        } else {
            (state.drive_q[j], state.drive_v[j])
        }
    }

    /// Runs the predictor over the whole record. `sink` gets each whitened innovation with sample,
    /// joint and channel (0 position, 1 velocity); `seen` the state at every sample, before it is
    /// corrected.
    pub fn predict(
        &mut self,
        gains: &[Gain],
        sink: &mut dyn FnMut(usize, usize, usize, D),
        seen: &mut dyn FnMut(usize, &State<D>),
    ) {
        self.predict_over(self.counted(), gains, sink, seen);
    }

    /// Samples whose innovations count.
    pub(crate) fn counted(&self) -> std::ops::Range<usize> {
        (SETTLING / self.record.h) as usize..self.record.len()
    }

    /// [`Runner::predict`] up to the end of `counted`, the samples whose innovations `sink` gets.
    pub(crate) fn predict_over(
        &mut self,
        counted: std::ops::Range<usize>,
        gains: &[Gain],
        sink: &mut dyn FnMut(usize, usize, usize, D),
        seen: &mut dyn FnMut(usize, &State<D>),
    ) {
        self.predict_while(counted, gains, sink, &mut |k, state| {
            seen(k, state);
            ControlFlow::Continue(())
        });
    }

    /// [`Runner::predict_over`] until `seen` breaks off.
    pub(crate) fn predict_while(
        &mut self,
        counted: std::ops::Range<usize>,
        gains: &[Gain],
        sink: &mut dyn FnMut(usize, usize, usize, D),
        seen: &mut dyn FnMut(usize, &State<D>) -> ControlFlow<()>,
    ) {
        let hidden = gains.iter().map(|g| g.hidden.map(D::constant));
        let hidden: Vec<[D; 4]> = hidden.collect();
        self.predict_from(&hidden, counted, gains, sink, seen);
    }

    /// [`Runner::predict_while`] with the states that no sensor reads where `hidden` says.
    pub(crate) fn predict_from(
        &mut self,
        hidden: &[[D; 4]],
        counted: std::ops::Range<usize>,
        gains: &[Gain],
        sink: &mut dyn FnMut(usize, usize, usize, D),
        seen: &mut dyn FnMut(usize, &State<D>) -> ControlFlow<()>,
    ) {
        let n = self.case.n();
        let mut state = self.start(0);
        self.unrest(&mut state, hidden);
        let mut commands = Vec::with_capacity(n);
        let mut shown = self.shown(&state);
        for k in 0..counted.end {
            if seen(k, &state).is_break() {
                return;
            }
            for (j, g) in gains.iter().enumerate().take(n) {
                let read = self.read(&mut shown, &state, j);
                let [eq, ev] = self.innovation(j, k, read);
                if k >= counted.start {
                    sink(k, j, 0, eq * g.whiten[0][0]);
                    if self.case.velocity[j] == Velocity::Measured {
                        sink(k, j, 1, eq * g.whiten[1][0] + ev * g.whiten[1][1]);
                    }
                }
                let t = self.record.begin + k as f64 * self.record.h;
                let rows = match self.machine.stirred(&state, j, t) {
                    true => &g.stirred,
                    false => &g.rows,
                };
                let fix = |row: usize| eq * rows[row][0] + ev * rows[row][1];
                self.correct(&mut state, &mut shown, (j, k), &fix);
            }
            if k + 1 < counted.end {
                self.sample(&mut state, k, &mut commands);
            }
        }
    }

    /// Memories of the sensors at the start of a prediction.
    fn shown(&self, state: &State<D>) -> Shown<D> {
        let (n, h) = (self.case.n(), self.record.h);
        let delays: Vec<Option<D>> = (0..n).map(|j| self.machine.reading_delay(j)).collect();
        let fade = |t: D| (-(t.inverse() * h)).exponential();
        let lag = |j| velocity_lag(self.case, &self.machine, j).map(fade);
        let room = |d: &Option<D>| if d.is_some() { self.record.len() } else { 0 };
        Shown {
            history: delays.iter().map(|d| Vec::with_capacity(room(d))).collect(),
            lags: (0..n).map(lag).collect(),
            lagged: (0..n).map(|j| self.encoder(state, j).1).collect(),
            delays,
            integrals: self.machine.units_of_integrals(),
        }
    }

    /// Position and velocity of joint `j` as its sensors show them.
    fn read(&self, shown: &mut Shown<D>, state: &State<D>, j: usize) -> (D, D) {
        let h = self.record.h;
        let (mut q, mut v) = self.encoder(state, j);
        if let Some(delay) = shown.delays[j] {
            shown.history[j].push((q, v));
            (q, v) = earlier(&shown.history[j], delay / h, h);
        }
        let (q, mut v) = self.machine.sense(j, q, v);
        if let Some(a) = shown.lags[j] {
            shown.lagged[j] = shown.lagged[j] * a + v * (-a + 1.0);
            v = shown.lagged[j];
        }
        (q, v)
    }

    /// Recorded minus predicted position and velocity of joint `j` at sample `k`. A missing reading tells
    /// nothing and corrects nothing.
    fn innovation(&self, j: usize, k: usize, (q, v): (D, D)) -> [D; 2] {
        let less = |x: f64, y: D| match x.is_finite() {
            true => D::constant(x) - y,
            false => D::nil(),
        };
        let ev = match self.case.velocity[j] {
            Velocity::Measured => less(self.record.v[j][k], v),
            _ => D::nil(),
        };
        [less(self.record.q[j][k], q), ev]
    }

    /// Corrects joint `j` at sample `k`: what a late reading corrects is the state it shows; from there the
    /// correction moves on with its velocity. `fix` gives the correction by rows of [`Gain::rows`].
    fn correct(
        &self,
        state: &mut State<D>,
        shown: &mut Shown<D>,
        (j, k): (usize, usize),
        fix: &impl Fn(usize) -> D,
    ) {
        let h = self.record.h;
        if shown.lags[j].is_some() {
            shown.lagged[j] += fix(LAGGING);
        }
        if let Some(unit) = shown.integrals[j].filter(|_| !state.loops[j].limited) {
            state.loops[j].integral += unit * fix(INTEGRAL);
        }
        let late =
            shown.delays[j].map_or(D::nil(), |d| (d / h).limit(D::nil(), D::constant(k as f64)));
        let moved = |row: usize, samples: D| fix(row) + fix(row + 1) * samples * h;
        let geared = self.machine.gears[j].is_some();
        let on_link = geared && self.case.nominal.encoder_side == EncoderSide::Joint;
        let row = if on_link { 2 } else { 0 };
        let t = self.record.begin + k as f64 * h;
        let read = (moved(row, late), fix(row + 1));
        self.machine.bend(state, j, (t - h, t), read);
        if geared {
            state.drive_q[j] += moved(0, late);
            state.drive_v[j] += fix(1);
            state.q[j] += moved(2, late);
            state.v[j] += fix(3);
        } else {
            state.q[j] += moved(0, late);
            state.v[j] += fix(1);
            state.drive_q[j] = state.q[j];
            state.drive_v[j] = state.v[j];
        }
        for (back, entry) in shown.history[j].iter_mut().rev().enumerate() {
            let since = late - back as f64;
            if back > 0 && since.value() <= 0.0 {
                break;
            }
            entry.0 += moved(row, since);
            entry.1 += fix(row + 1);
        }
    }

    /// Free run from sample `k` over `samples` steps: readings (position, velocity as a prompt
    /// sensor sees it) of all joints at each of the samples after `k`, before filters of a derived
    /// or lagging velocity.
    pub fn free(
        &mut self,
        from: &State<D>,
        k: usize,
        samples: usize,
        sink: &mut dyn FnMut(usize, usize, D, D),
    ) {
        let n = self.case.n();
        let mut state = from.clone();
        for j in 0..n {
            let (q, v) = self.read_state(j, k);
            let dq = D::constant(q) - self.encoder(&state, j).0;
            if self.machine.gears[j].is_some() {
                state.drive_q[j] += dq;
                state.q[j] += dq;
                if self.case.nominal.encoder_side == EncoderSide::Joint {
                    state.v[j] = D::constant(v);
                } else {
                    state.drive_v[j] = D::constant(v);
                }
            } else {
                state.q[j] = D::constant(q);
                state.v[j] = D::constant(v);
                state.drive_q[j] = state.q[j];
                state.drive_v[j] = state.v[j];
            }
        }
        let delays: Vec<f64> = (0..n)
            .map(|j| {
                self.machine
                    .reading_delay(j)
                    .map_or(0.0, |d| d.value() / self.record.h)
            })
            .collect();
        let mut history: Vec<Vec<(D, D)>> = vec![Vec::with_capacity(samples + 1); n];
        for j in 0..n {
            history[j].push(self.encoder(&state, j));
        }
        let mut commands = Vec::with_capacity(n);
        for i in 1..=samples {
            self.sample(&mut state, k + i - 1, &mut commands);
            for j in 0..n {
                history[j].push(self.encoder(&state, j));
                let (mut q, mut v) = history[j][i];
                if delays[j] > 0.0 {
                    let x = i as f64 - delays[j];
                    if x >= 0.0 {
                        let a = (x.floor() as usize).min(i - 1);
                        let s = x - a as f64;
                        let (h0, h1) = (history[j][a], history[j][a + 1]);
                        q = h0.0 * (1.0 - s) + h1.0 * s;
                        v = h0.1 * (1.0 - s) + h1.1 * s;
                    } else {
                        // The readings before the delay has passed are those of the record.
                        let back = self.record.h * x;
                        q = history[j][0].0 + history[j][0].1 * back;
                        v = history[j][0].1;
                    }
                }
                let (q, v) = self.machine.sense(j, q, v);
                sink(i, j, q, v);
            }
        }
    }

    /// Factor exp(−h/T) of an additional velocity filter of joint `j`.
    pub fn velocity_fade(&self, j: usize) -> Option<D> {
        let time = velocity_lag(self.case, &self.machine, j)?;
        // No time at all is no lag.
        let some = time.value() > 1e-9;
        Some(if some {
            (D::constant(-self.record.h) / time).exponential()
        } else {
            D::nil()
        })
    }
}
