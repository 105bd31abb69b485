//! What a stage of a position loop does, drawn on a damped loop whose joint is held at zero.

use std::f64::consts::PI;

use pid_effects::drives::target::{Motion, Shaped, followed};
use pid_effects::drives::{Gains, Seen, unlimited};
use pid_effects::effect::Effect;
use pid_interpret::nominal::{Gain, Servo, ServoLaw};

use crate::curves::{POSITION, Points, TIME, View, along, pair};

/// Gains of the loop, A/rad and A·s/rad.
const KP: f64 = 20.0;
const KD: f64 = 2.0;
/// Its target goes by this speed, rad/s, from the first to the second of these times, s.
const SPEED: f64 = 2.0;
const MOVES: [f64; 2] = [0.1, 0.6];
/// Input that holds the link out level, A.
const LEVEL: f64 = 4.0;
/// Input that accelerates the joint, A·s²/rad.
const INERTIA: f64 = 0.1;
/// Steps in which time goes on.
const STEP: f64 = 1e-3;

/// The view of an effect that is a stage.
pub(crate) fn stage(effect: &dyn Effect, e: &[f64]) -> Option<View> {
    let stage = effect.stage()?;
    let value = *e.first()?;
    let with = gains(Some((stage, value)));
    if stage == Gain::Gravity {
        let input = |k: &Gains<f64>, q: f64| output(k, &Motion::at_rest(q), (q, LEVEL * q.sin()));
        let of = |k: Gains<f64>| -> Points { along(-PI, PI).map(|q| (q, input(&k, q))).collect() };
        return Some(View {
            what: "input that the loop of a joint gives at its target",
            x: POSITION,
            y: ("input", "A"),
            curves: pair(of(gains(None)), of(with)),
        });
    }
    Some(View {
        what: "input that the loop of a joint at zero gives while its target moves on by 1 rad in half a second",
        x: TIME,
        y: ("input", "A"),
        curves: pair(inputs(&gains(None), stage), inputs(&with, stage)),
    })
}

/// Gains of the loop, with a stage or without.
fn gains(stage: Option<(Gain, f64)>) -> Gains<f64> {
    Gains::of(|gain| match (gain, stage) {
        (Gain::Kp, _) => Some(KP),
        (Gain::Kd, _) => Some(KD),
        (gain, Some((own, value))) if gain == own => Some(value),
        _ => None,
    })
}

/// Output of the loop of a joint at rest, for a target, at a position with its gravity.
fn output(k: &Gains<f64>, target: &Motion<f64>, (q, gravity): (f64, f64)) -> f64 {
    let at = Seen {
        r: target.r,
        q,
        v: 0.0,
        ahead: k.ahead.unwrap_or(0.0) * target.rate,
        gravity,
        inertia: INERTIA * target.acceleration,
    };
    unlimited(&Servo::new(ServoLaw::Pd), k, &at, 0.0).u
}

/// The target at a time: at a constant speed, or for what goes with its acceleration up to twice that and down again.
fn target(t: f64, stage: Gain) -> Motion<f64> {
    let [from, to] = MOVES;
    let since = t.clamp(from, to) - from;
    let moves = (from..to).contains(&t);
    if stage != Gain::InertiaAhead {
        return Motion {
            r: SPEED * since,
            rate: if moves { SPEED } else { 0.0 },
            acceleration: 0.0,
        };
    }
    let half = 0.5 * (to - from);
    let a = 2.0 * SPEED / half;
    let (up, left) = (since < half, 2.0 * half - since);
    Motion {
        r: match up {
            true => 0.5 * a * since * since,
            false => 2.0 * SPEED * half - 0.5 * a * left * left,
        },
        rate: a * since.min(left),
        acceleration: match (moves, up) {
            (false, _) => 0.0,
            (true, true) => a,
            (true, false) => -a,
        },
    }
}

/// The same over the time while the target moves.
fn inputs(k: &Gains<f64>, stage: Gain) -> Points {
    let servo = Servo::new(ServoLaw::Pd);
    let mut memory = Shaped::at_rest(0.0);
    let steps = (1.0 / STEP) as usize;
    let of = |i: usize| {
        let t = STEP * i as f64;
        let own = target(t, stage);
        let [_, own] = followed(&servo, k, &mut memory, &own, (t, STEP), 0.0);
        (t, output(k, &own, (0.0, 0.0)))
    };
    let all: Points = (0..steps).map(of).collect();
    all.into_iter().step_by(4).collect()
}
