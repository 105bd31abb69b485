//! What a stage of a position loop does, drawn on a damped loop whose joint is held at zero.

use std::f64::consts::PI;

use pid_effects::drives::target::{Point, Shaped, followed};
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
/// Steps in which time goes on.
const STEP: f64 = 1e-3;

/// The view of an effect that is a stage.
pub(crate) fn stage(effect: &dyn Effect, e: &[f64]) -> Option<View> {
    let stage = effect.stage()?;
    let value = *e.first()?;
    let with = gains(Some((stage, value)));
    if stage == Gain::Gravity {
        let input = |k: &Gains<f64>, q: f64| output(k, (q, 0.0), (q, LEVEL * q.sin()));
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
        curves: pair(inputs(&gains(None)), inputs(&with)),
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

/// Output of the loop of a joint at rest, for a target with its velocity, at a position with its gravity.
fn output(k: &Gains<f64>, (r, ahead): (f64, f64), (q, gravity): (f64, f64)) -> f64 {
    let at = Seen {
        r,
        q,
        v: 0.0,
        ahead,
        gravity,
    };
    unlimited(&Servo::new(ServoLaw::Pd), k, &at, 0.0).u
}

/// The same over the time while the target moves.
fn inputs(k: &Gains<f64>) -> Points {
    let servo = Servo::new(ServoLaw::Pd);
    let mut memory = Shaped::at_rest(0.0);
    let steps = (1.0 / STEP) as usize;
    let of = |i: usize| {
        let t = STEP * i as f64;
        let target = SPEED * (t.clamp(MOVES[0], MOVES[1]) - MOVES[0]);
        let moves = (MOVES[0]..MOVES[1]).contains(&t);
        let own = (target, if moves { SPEED } else { 0.0 });
        let [_, Point { r, rate }] = followed(&servo, k, &mut memory, own, (t, STEP), 0.0);
        (t, output(k, (r, rate), (0.0, 0.0)))
    };
    let all: Points = (0..steps).map(of).collect();
    all.into_iter().step_by(4).collect()
}
