//! Position loops of drives within a substep: from the target to the input of the motor, before
//! effects between them.

use super::{Machine, State};
use crate::constants::Constant;
use crate::drives::{Gains, Output, Seen, at_rest, integrated, output};
use crate::effect::Pick;
use crate::nominal::EncoderSide;
use pid_interpret::nominal::{Gain, Servo, ServoLaw};

/// The loop of a joint with its gains.
pub(super) type Loop<'h, D> = (&'h Servo, Gains<D>);

/// What a loop remembers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Memory<D> {
    /// Part of the integral, in the unit of the joint's input.
    pub integral: D,
    /// Output, where it is held from one reading to the next.
    held: D,
    /// When it reads next, s since the start of what was recorded.
    due: f64,
}

impl Memory<f64> {
    /// The same as constants of another scalar.
    pub(super) fn lift<D: Pick>(&self) -> Memory<D> {
        Memory {
            integral: D::constant(self.integral),
            held: D::constant(self.held),
            due: self.due,
        }
    }
}

impl<D: Pick> Memory<D> {
    /// Of a loop that has not read yet.
    pub(super) fn new() -> Self {
        Memory {
            integral: D::nil(),
            held: D::nil(),
            due: f64::NEG_INFINITY,
        }
    }
}

impl<D: Pick> Machine<'_, D> {
    /// The gains of a loop.
    pub(super) fn gains_of(constants: &crate::constants::Constants<'_, D>, j: usize) -> Gains<D> {
        let of = |gain| constants.get(Constant::Servo(gain, j));
        Gains {
            kp: of(Gain::Kp),
            kd: of(Gain::Kd),
            ki: of(Gain::Ki),
        }
    }

    /// Joints whose loop has an integral.
    pub(crate) fn integrating(&self) -> Vec<usize> {
        let of = |(j, own): (usize, &Option<Loop<'_, D>>)| {
            own.is_some_and(|(servo, _)| servo.law == ServoLaw::Pid)
                .then_some(j)
        };
        self.loops.iter().enumerate().filter_map(of).collect()
    }

    /// Whether the loop of a joint closes over the gear: it reads the link and drives the rotor.
    fn reads_link(&self, j: usize) -> bool {
        self.gears[j].is_some() && self.constants.nominal().encoder_side == EncoderSide::Joint
    }

    /// Output of the loop of joint `j` for a target over the substep from `t`, and the slopes that the
    /// step takes implicitly: none where the loop closes over a gear or holds its output.
    #[inline(always)]
    pub(super) fn answer(
        &self,
        state: &mut State<D>,
        (j, (servo, k)): (usize, Loop<'_, D>),
        r: D,
        (t, dt): (f64, f64),
    ) -> Output<D> {
        let (half, link) = (0.5 * dt, self.reads_link(j));
        let held = servo
            .rate_hz
            .map(|rate| 1.0 / rate)
            .filter(|period| *period > dt * 1.001);
        let none = |u| Output {
            u,
            stiffness: D::nil(),
            damping: D::nil(),
        };
        if let Some(period) = held {
            let memory = state.loops[j];
            if t < memory.due - 1e-3 * dt {
                return none(memory.held);
            }
            // It reads at the start of the substep.
            let (q, v) = match link {
                true => (state.q[j], state.v[j]),
                false => (state.drive_q[j], state.drive_v[j]),
            };
            let (q, v) = self.sense(j, q, v);
            let at = Seen { r, q, v };
            let integral = integrated(servo, &k, &at, (memory.integral, period));
            let held = output(servo, &k, &at, integral).u;
            let late = t > memory.due + period || memory.due.is_infinite();
            state.loops[j] = Memory {
                integral,
                held,
                due: if late { t } else { memory.due } + period,
            };
            return none(held);
        }
        let (q, v) = match link {
            true => (
                state.q[j] + state.v[j] * half,
                state.v[j] + state.acceleration[j] * half,
            ),
            false => (self.site_q[j], self.site_v[j]),
        };
        let (q, v) = self.sense(j, q, v);
        let at = Seen { r, q, v };
        let before = state.loops[j].integral;
        let after = integrated(servo, &k, &at, (before, dt));
        state.loops[j].integral = after;
        let out = output(servo, &k, &at, (before + after) * 0.5);
        if link { none(out.u) } else { out }
    }

    /// Output of the loops of all joints as they hold the robot at a state at rest, for targets `r`:
    /// torques without a loop. An integral is where the torque `self.bias` needs it.
    pub(super) fn hold(&self, state: &mut State<D>, targets: &[f64]) -> Vec<D> {
        let of = |j: usize| {
            let r = D::constant(targets[j]);
            let Some((servo, k)) = self.loops[j] else {
                return r;
            };
            let (q, v) = self.sense(j, state.drive_q[j], state.drive_v[j]);
            let at = Seen { r, q, v };
            let needed = self.bias[j] / self.constants.get(Constant::Gain(j));
            let integral = at_rest(servo, &k, &at, needed);
            state.loops[j].integral = integral;
            output(servo, &k, &at, integral).u
        };
        (0..targets.len()).map(of).collect()
    }
}
