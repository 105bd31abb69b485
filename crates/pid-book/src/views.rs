//! What of an effect is drawn. The hooks of its law decide: each view asks one of them, and the first
//! in which the effect shows is taken. The view of its class comes first.

use std::f64::consts::{PI, TAU};

use pid_effects::effect::{After, Class, Commands, Effect, Site};

use crate::Failure;
use crate::curves::{Curve, POINTS, POSITION, Points, TIME, VELOCITY, View, along, pair};
use crate::reference::{JOINT, Reference};
use crate::stage::stage;

/// A change below this share of the largest value does not show.
const SHOWS: f64 = 1e-6;

/// An effect on the reference robot.
struct Subject<'a> {
    robot: &'a Reference,
    effect: &'a dyn Effect,
    e: Vec<f64>,
}

type Maker = fn(&Subject<'_>) -> Option<View>;

/// The view of an effect.
pub(crate) fn view(robot: &Reference, effect: &dyn Effect) -> Result<View, Failure> {
    let subject = Subject {
        robot,
        effect,
        e: robot.size(effect),
    };
    let looped: Maker = |s| stage(s.effect, &s.e);
    let special: [Maker; 7] = [
        looped,
        gear,
        reading_delay,
        velocity_lag,
        tip_force,
        reading,
        drive,
    ];
    let of_class: Maker = match effect.info().class {
        Class::Velocity => over_velocity,
        Class::Load => over_load,
        Class::Position => over_position,
        Class::Reversal => over_travel,
        Class::Time => over_time,
        Class::Coupling => over_other,
        Class::Inertia => holding,
        _ => over_velocity,
    };
    let rest: [Maker; 8] = [
        over_velocity,
        over_position,
        over_load,
        over_travel,
        over_time,
        over_other,
        holding,
        accelerating,
    ];
    let mut makers = special.into_iter().chain([of_class]).chain(rest);
    makers.find_map(|make| make(&subject)).ok_or_else(|| {
        Failure(format!(
            "no view shows the effect `{}`\n  help: add one in crates/pid-book/src/views.rs for the hook that it uses",
            effect.info().id
        ))
    })
}

/// Curves without and with the effect; `None` where they are the same.
fn compared(
    (from, to): (f64, f64),
    without: impl Fn(f64) -> f64,
    with: impl Fn(f64) -> f64,
) -> Option<Vec<Curve>> {
    let without: Points = along(from, to).map(|x| (x, without(x))).collect();
    let with: Points = along(from, to).map(|x| (x, with(x))).collect();
    differ(&without, &with).then(|| pair(without, with))
}

fn differ(a: &[(f64, f64)], b: &[(f64, f64)]) -> bool {
    let largest = a.iter().chain(b).map(|p| p.1.abs()).fold(0.0, f64::max);
    a.iter()
        .zip(b)
        .any(|(a, b)| (a.1 - b.1).abs() > SHOWS * largest)
}

/// A site of the joint; the other joint rests at zero.
fn felt_at(s: &Subject<'_>, with: bool, motion: Motion, memory: &[f64]) -> crate::reference::Felt {
    let site = Site {
        joint: JOINT,
        q: &[motion.other_q, motion.q],
        v: &[motion.other_v, motion.v],
        load: &[motion.load; 2],
        t: motion.t,
        dt: 1e-3,
        rest: None,
    };
    let effect = with.then_some((s.effect, &s.e[..]));
    s.robot.felt(effect, &site, memory)
}

#[derive(Clone, Copy, Default)]
struct Motion {
    q: f64,
    v: f64,
    other_q: f64,
    other_v: f64,
    load: f64,
    t: f64,
}

fn gear(s: &Subject<'_>) -> Option<View> {
    let gear = s.effect.plain().gear(&s.e)?;
    let open = 0.5 * gear.gap;
    // The torque of the typical drive bends the gear by half of what is drawn.
    let end = open + 12.0 / gear.stiffness;
    let torque = |x: f64| gear.stiffness * (x.abs() - open).max(0.0) * x.signum();
    Some(View {
        what: "torque that the gear passes on over its twist, rotor less link",
        x: ("twist", "rad"),
        y: ("torque", "N·m"),
        curves: vec![Curve {
            name: "with the effect; without it the gear does not twist",
            without: false,
            points: along(-end, end).map(|x| (x, torque(x))).collect(),
        }],
    })
}

fn reading_delay(s: &Subject<'_>) -> Option<View> {
    let delay = s.effect.plain().reading_delay(&s.e)?;
    let period = 12.0 * delay;
    let motion = move |t: f64| (TAU * t / period).sin();
    Some(View {
        what: "reading of a swinging joint",
        x: TIME,
        y: POSITION,
        curves: compared((0.0, 1.5 * period), motion, |t| motion(t - delay))?,
    })
}

fn velocity_lag(s: &Subject<'_>) -> Option<View> {
    let lag = s.effect.plain().velocity_lag(&s.e)?;
    let half = 8.0 * lag;
    let square = move |t: f64| if t > lag && t < lag + half { 1.0 } else { 0.0 };
    let read = move |t: f64| {
        let rise = |from: f64| {
            if t > from {
                1.0 - (-(t - from) / lag).exp()
            } else {
                0.0
            }
        };
        rise(lag) - rise(lag + half)
    };
    Some(View {
        what: "reading of a velocity that jumps",
        x: TIME,
        y: VELOCITY,
        curves: compared((0.0, 2.0 * half), square, read)?,
    })
}

fn tip_force(s: &Subject<'_>) -> Option<View> {
    let law = s.effect.plain();
    law.tip_force(&s.e, 0.0, 1e-3)?;
    let axis = (0..3).max_by(|&a, &b| s.e[a].abs().total_cmp(&s.e[b].abs()))?;
    let force = |t: f64| law.tip_force(&s.e, t, 1e-3).map_or(0.0, |f| f[axis]);
    Some(View {
        what: "largest component of the force on the tool, within time windows",
        x: TIME,
        y: ("force", "N"),
        curves: compared((0.0, 6.0), |_| 0.0, force)?,
    })
}

fn reading(s: &Subject<'_>) -> Option<View> {
    let law = s.effect.plain();
    let error = |q: f64| law.sense(&s.e, q, 0.0).0 - q;
    Some(View {
        what: "error of the position reading over one turn",
        x: POSITION,
        y: ("error", "rad"),
        curves: compared((-PI, PI), |_| 0.0, error)?,
    })
}

/// The applied input: over time after a pulse where the law looks back, else over the commanded one.
fn drive(s: &Subject<'_>) -> Option<View> {
    if let Some((command, real)) = pulse(s).filter(|(a, b)| differ(a, b)) {
        return Some(View {
            what: "input that acts after a pulse of the command",
            x: TIME,
            y: ("input", "A"),
            curves: pair(command, real),
        });
    }
    let law = s.effect.plain();
    let rated = s.robot.input();
    let applied = |u: f64| {
        let at = Commands {
            u: &[u],
            h: 1e-3,
            linear: false,
            begin: 0.0,
            t: 0.0,
            dt: 1e-3,
        };
        let mut memory = vec![0.0; s.effect.memory()];
        law.start(&s.e, 0.0, 0.0, u, &mut memory);
        law.input(&s.e, u, &at, &mut memory)
    };
    Some(View {
        what: "input that acts over the commanded one",
        x: ("command", "A"),
        y: ("input", "A"),
        curves: compared((-1.2 * rated, 1.2 * rated), |u| u, applied)?,
    })
}

/// A pulse of the command, and what a law with a time of its own makes of it.
fn pulse(s: &Subject<'_>) -> Option<(Points, Points)> {
    let law = s.effect.plain();
    let time = s.e.iter().zip(s.effect.info().parameters);
    let time = time.filter(|(_, p)| p.si == "s").map(|(x, _)| *x);
    let end = 10.0 * time.fold(0.0, f64::max);
    if end <= 0.0 {
        return None;
    }
    let h = end / (POINTS - 1) as f64;
    let half = 0.5 * s.robot.input();
    let u: Vec<f64> = (0..POINTS)
        .map(|i| if (20..140).contains(&i) { half } else { 0.0 })
        .collect();
    let mut memory = vec![0.0; s.effect.memory()];
    law.start(&s.e, 0.0, 0.0, 0.0, &mut memory);
    let mut real = Vec::with_capacity(POINTS);
    for i in 0..POINTS {
        let t = i as f64 * h;
        let at = Commands {
            u: &u,
            h,
            linear: false,
            begin: 0.0,
            t,
            dt: h,
        };
        real.push((t, law.input(&s.e, u[i], &at, &mut memory)));
    }
    let command = (0..POINTS).map(|i| (i as f64 * h, u[i])).collect();
    Some((command, real))
}

fn over_velocity(s: &Subject<'_>) -> Option<View> {
    let force = |with: bool| {
        move |v: f64| {
            let motion = Motion {
                v,
                load: 2.0,
                ..Motion::default()
            };
            let felt = felt_at(s, with, motion, &vec![0.0; s.effect.memory()]);
            felt.dry + felt.viscous - felt.own
        }
    };
    Some(View {
        what: "friction over the velocity, in the steady state",
        x: VELOCITY,
        y: ("friction", "N·m"),
        // An even number of steps beside zero, where the direction changes.
        curves: compared((-1.5, 1.5), force(false), force(true))?,
    })
}

fn over_position(s: &Subject<'_>) -> Option<View> {
    let force = |with: bool| {
        move |q: f64| {
            felt_at(
                s,
                with,
                Motion {
                    q,
                    ..Motion::default()
                },
                &vec![0.0; s.effect.memory()],
            )
            .own
        }
    };
    Some(View {
        what: "additional force over the position",
        x: POSITION,
        y: ("torque", "N·m"),
        curves: compared((-1.5, 1.5), force(false), force(true))?,
    })
}

fn over_load(s: &Subject<'_>) -> Option<View> {
    let level = |with: bool| {
        move |load: f64| {
            let motion = Motion {
                load,
                v: 0.5,
                ..Motion::default()
            };
            felt_at(s, with, motion, &vec![0.0; s.effect.memory()]).level
        }
    };
    Some(View {
        what: "level of dry friction over the torque through the gear",
        x: ("torque through the gear", "N·m"),
        y: ("dry friction", "N·m"),
        curves: compared((-6.0, 6.0), level(false), level(true))?,
    })
}

/// Friction along a slow motion to and fro, whose size is some lengths of the law.
fn over_travel(s: &Subject<'_>) -> Option<View> {
    let size = 6.0 * s.e.first().copied()?;
    let steps = 4 * POINTS;
    let dt = 1e-3;
    let (mut without, mut with) = (Points::new(), Points::new());
    let mut memory = vec![0.0; s.effect.memory()];
    for i in 0..steps {
        let at = |i: usize| size * (2.5 * PI * i as f64 / steps as f64).sin();
        let (q, v) = (at(i), (at(i + 1) - at(i)) / dt);
        let motion = Motion {
            q,
            v,
            ..Motion::default()
        };
        let nominal = felt_at(s, false, motion, &[]);
        let felt = felt_at(s, true, motion, &memory);
        without.push((q, nominal.dry));
        with.push((q, felt.dry - felt.own));
        let after = After {
            v,
            dt,
            coulomb: nominal.level,
        };
        s.effect.plain().advance(&s.e, &after, &mut memory);
    }
    differ(&without, &with).then(|| View {
        what: "dry friction along a motion to and fro that starts at rest",
        x: POSITION,
        y: ("friction", "N·m"),
        curves: pair(without, with),
    })
}

fn over_time(s: &Subject<'_>) -> Option<View> {
    let level = |with: bool| {
        move |t: f64| {
            let motion = Motion {
                t,
                v: 0.5,
                ..Motion::default()
            };
            let felt = felt_at(s, with, motion, &vec![0.0; s.effect.memory()]);
            felt.dry + felt.viscous
        }
    };
    Some(View {
        what: "friction at 0.5 rad/s over the time since the start",
        x: TIME,
        y: ("friction", "N·m"),
        curves: compared((0.0, 12.0), level(false), level(true))?,
    })
}

/// Forces on both joints while the other one is elsewhere, or moves, and this one rests.
fn over_other(s: &Subject<'_>) -> Option<View> {
    let memory = vec![0.0; s.effect.memory()];
    let forces = |motion: fn(f64) -> Motion| -> [Points; 2] {
        let at = |x: f64| felt_at(s, true, motion(x), &memory);
        [
            along(-1.0, 1.0).map(|x| (x, at(x).own)).collect(),
            along(-1.0, 1.0).map(|x| (x, at(x).before)).collect(),
        ]
    };
    let moves = |curves: &[Points; 2]| curves.iter().any(|c| differ(c, &vec![c[0]; c.len()]));
    let by_position = forces(|other_q| Motion {
        other_q,
        ..Motion::default()
    });
    let by_velocity = forces(|other_v| Motion {
        other_v,
        ..Motion::default()
    });
    let (what, x, [own, before]) = if moves(&by_position) {
        (
            "forces on both joints over the position of the joint before, while this one rests at zero",
            ("position of the joint before", "rad"),
            by_position,
        )
    } else if moves(&by_velocity) {
        (
            "forces on both joints over the velocity of the joint before, while this one rests",
            ("velocity of the joint before", "rad/s"),
            by_velocity,
        )
    } else {
        return None;
    };
    Some(View {
        what,
        x,
        y: ("torque", "N·m"),
        curves: vec![
            Curve {
                name: "on the joint",
                without: false,
                points: own,
            },
            Curve {
                name: "on the joint before",
                without: true,
                points: before,
            },
        ],
    })
}

fn holding(s: &Subject<'_>) -> Option<View> {
    let torque = |with: bool| {
        move |q: f64| {
            let effect = with.then_some((s.effect, &s.e[..]));
            s.robot.structure(effect, [q, 0.0]).1[0]
        }
    };
    Some(View {
        what: "torque that holds the stretched arm over the position of the first joint",
        x: POSITION,
        y: ("torque", "N·m"),
        curves: compared((-PI, PI), torque(false), torque(true))?,
    })
}

fn accelerating(s: &Subject<'_>) -> Option<View> {
    let torque = |with: bool| {
        move |a: f64| {
            let effect = with.then_some((s.effect, &s.e[..]));
            s.robot.structure(effect, [0.0, 0.0]).0[JOINT] * a
        }
    };
    Some(View {
        what: "torque that accelerates the hanging joint, the other one at rest",
        x: ("acceleration", "rad/s²"),
        y: ("torque", "N·m"),
        curves: compared((-20.0, 20.0), torque(false), torque(true))?,
    })
}
