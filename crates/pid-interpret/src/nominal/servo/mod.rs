//! The position loop of a drive: `[drive]` for all joints, `[joint.drive]` for one. With it the input
//! of the joint is a target position, and the drive makes its own input of the motor,
//!
//! ```text
//! target -> [`Shaping`] -> r,   e = r − q less the dead band,   v̂: the velocity, filtered
//!
//! p        u = kp e
//! pd       u = kp e − kd v̂
//! pid      u = kp e − kd v̂ + ki ∫ e dt
//! cascade  w = kp e within ± velocity_limit,   u = kv (w − v̂) + ki ∫ (w − v̂) dt
//! ```
//!
//! with q and v̂ of a while ago, v̂ less a share of the target's velocity, which a cascade adds to w instead, and plus
//! shares of what the drive's model needs against gravity and for the acceleration of the targets, in the unit of the
//! joint's `input`, within ± `limit` (K. J. Åström, T. Hägglund, PID Controllers, 1995, chapter 3; W. Leonhard,
//! Control of Electrical Drives, 2001, chapter 15). A motor with a stated `back_emf` brings
//! `motor_gain (u − back_emf v)` while its drive is on, and nothing while it is off; without, that part of its damping
//! is viscous friction.

mod number;
mod read;

use pid_toml::Place;

pub(in crate::nominal) use number::written;
pub use number::{Gain, ServoGain};
pub(in crate::nominal) use read::{Driven, RawDrive, servo};

/// Law of a position loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ServoLaw {
    /// Proportional.
    P,
    /// Proportional, with damping by the velocity.
    Pd,
    /// The same with an integral of the error.
    Pid,
    /// A proportional loop of the position around a loop of the velocity with an integral.
    Cascade,
}

impl ServoLaw {
    /// All of them.
    pub const ALL: [ServoLaw; 4] = [ServoLaw::P, ServoLaw::Pd, ServoLaw::Pid, ServoLaw::Cascade];

    /// Its word in a description.
    pub fn word(self) -> &'static str {
        match self {
            ServoLaw::P => "p",
            ServoLaw::Pd => "pd",
            ServoLaw::Pid => "pid",
            ServoLaw::Cascade => "cascade",
        }
    }

    /// The gains it has.
    pub fn gains(self) -> &'static [Gain] {
        match self {
            ServoLaw::P => &[Gain::Kp],
            ServoLaw::Pd => &[Gain::Kp, Gain::Kd],
            ServoLaw::Pid => &[Gain::Kp, Gain::Kd, Gain::Ki],
            ServoLaw::Cascade => &[Gain::Kp, Gain::Kv, Gain::Ki],
        }
    }

    /// Whether it uses the velocity.
    pub fn uses_velocity(self) -> bool {
        self != ServoLaw::P
    }

    /// Whether it has an integral.
    pub fn integrates(self) -> bool {
        self.gains().contains(&Gain::Ki)
    }
}

/// What a drive makes of a target before its loop follows it, in this order; then come the largest speed and the
/// acceleration of [`Gain::TargetSpeed`] and [`Gain::TargetAcceleration`], the average of [`Gain::TargetAverage`] and
/// the filter of [`Gain::TargetTime`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shaping {
    /// Step of the target, rad or m: the nearest multiple is followed.
    pub step: Option<f64>,
    /// Rate at which targets are taken, Hz, from the start of a record on; held between.
    pub rate_hz: Option<f64>,
}

/// What the feed-forward of a drive knows of a joint and the body that it carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveModel {
    /// Mass of the body, kg.
    pub mass: f64,
    /// Its centre of mass in its frame, m.
    pub com: [f64; 3],
    /// Its inertia about that, kg·m²: xx, yy, zz, xy, xz, yz.
    pub inertia: [f64; 6],
    /// Rotor inertia of the joint, kg·m² or kg.
    pub rotor_inertia: f64,
    /// Torque or force per unit of the joint's input.
    pub motor_gain: f64,
}

impl Default for DriveModel {
    fn default() -> Self {
        Self {
            mass: 0.0,
            com: [0.0; 3],
            inertia: [0.0; 6],
            rotor_inertia: 0.0,
            motor_gain: 1.0,
        }
    }
}

/// What a motor brings at most in the direction in which it turns: at a speed v up to `stall (1 − v/no_load_speed)`,
/// against it as much as that goes on to (a motor with back-EMF at a limited voltage: W. Leonhard, Control of
/// Electrical Drives, 2001, chapter 5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FallingLimit {
    /// At rest, in the unit of the joint's input.
    pub stall: f64,
    /// Speed at which nothing is left, rad/s or m/s.
    pub no_load_speed: f64,
}

/// The position loop of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Servo {
    /// Its law.
    pub law: ServoLaw,
    /// Gains, shares and times, in the order of [`Gain::ALL`]; `None` of those it does not have.
    numbers: [Option<ServoGain>; Gain::ALL.len()],
    /// Largest size of its output, in the unit of the joint's input.
    pub limit: Option<f64>,
    /// Limit of the output that falls with the speed.
    pub falling: Option<FallingLimit>,
    /// Largest size of the part of the integral.
    pub integral_limit: Option<f64>,
    /// Largest velocity that the position loop of a cascade asks for, rad/s or m/s.
    pub velocity_limit: Option<f64>,
    /// Size of an error that counts as none, rad or m; of a larger one counts what is beyond.
    pub dead_band: Option<f64>,
    /// What becomes of the target before.
    pub shaping: Shaping,
    /// Rate at which it reads and answers, Hz; its output is held between. `None`: faster than the motion.
    pub rate_hz: Option<f64>,
    /// Where it stands; `None` if it was not read from a file.
    pub place: Option<Place>,
}

impl Servo {
    /// A loop with the gains of its law unknown and nothing beside.
    pub fn new(law: ServoLaw) -> Self {
        let mut out = Self {
            law,
            numbers: Default::default(),
            limit: None,
            falling: None,
            integral_limit: None,
            velocity_limit: None,
            dead_band: None,
            shaping: Shaping::default(),
            rate_hz: None,
            place: None,
        };
        for &gain in law.gains() {
            out.set(gain, ServoGain::default());
        }
        out
    }

    /// A gain as stated; unknown where the loop has no such.
    pub fn gain(&self, gain: Gain) -> ServoGain {
        self.numbers[gain as usize].unwrap_or_default()
    }

    /// Whether the loop has a gain.
    pub fn has(&self, gain: Gain) -> bool {
        self.numbers[gain as usize].is_some()
    }

    /// Whether the drive needs a model of the robot.
    pub fn has_model(&self) -> bool {
        self.gains().any(Gain::needs_model)
    }

    /// Whether the loop can have a stage that it does not state.
    pub fn lacks(&self, stage: Gain) -> bool {
        !self.has(stage) && (self.law.uses_velocity() || !stage.needs_velocity())
    }

    /// Gives the loop a gain.
    pub fn set(&mut self, gain: Gain, value: ServoGain) {
        self.numbers[gain as usize] = Some(value);
    }

    /// The gains it has, those of its law first.
    pub fn gains(&self) -> impl Iterator<Item = Gain> + '_ {
        Gain::ALL.into_iter().filter(|gain| self.has(*gain))
    }

    /// Unit of a gain of the loop of a joint with an input in a unit, and positions in `rad` or `m`.
    pub fn unit(&self, gain: Gain, input: &str, position: &str) -> String {
        match gain {
            Gain::Kp if self.law == ServoLaw::Cascade => "1/s".to_owned(),
            Gain::Kp => format!("{input}/{position}"),
            Gain::Kd | Gain::Kv | Gain::BackEmf => format!("{input}*s/{position}"),
            Gain::Ki if self.law == ServoLaw::Cascade => format!("{input}/{position}"),
            Gain::Ki => format!("{input}/({position}*s)"),
            Gain::Gravity | Gain::InertiaAhead | Gain::VelocityAhead => "1".to_owned(),
            Gain::TargetSpeed => format!("{position}/s"),
            Gain::TargetAcceleration => format!("{position}/s^2"),
            Gain::TargetAverage | Gain::TargetTime | Gain::VelocityTime | Gain::FeedbackDelay => {
                "s".to_owned()
            }
        }
    }

    /// Its numbers that are no gains, by their keys in a description.
    pub fn stated(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let all = [
            ("limit", self.limit),
            ("stall", self.falling.map(|own| own.stall)),
            ("no_load_speed", self.falling.map(|own| own.no_load_speed)),
            ("integral_limit", self.integral_limit),
            ("velocity_limit", self.velocity_limit),
            ("dead_band", self.dead_band),
            ("target_step", self.shaping.step),
            ("target_rate_hz", self.shaping.rate_hz),
            ("rate_hz", self.rate_hz),
        ];
        let known = |(key, value): (&'static str, Option<f64>)| Some((key, value?));
        all.into_iter().filter_map(known)
    }
}
