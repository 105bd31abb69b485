//! Magnitudes of a cause, drawn for a joint.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::causes::{COUPLING, HOSE, Kind, MESH, SAG, VELOCITY_LAG};

/// Sizes a magnitude is drawn relative to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sizes {
    /// Largest usual torque or force.
    pub torque: f64,
    /// Torque per unit of input.
    pub gain: f64,
    /// Inertia seen by the joint.
    pub inertia: f64,
    /// Rotor inertia.
    pub rotor: f64,
    /// Half the range of motion.
    pub amplitude: f64,
    /// Middle of the motion.
    pub centre: f64,
    /// Largest speed.
    pub speed: f64,
    /// A radian, or the slide's unit of length.
    pub length: f64,
    /// Mass of the last link.
    pub tip_mass: f64,
    /// Force at the tool that the second joint's torque balances.
    pub tip_force: f64,
}

/// What magnitudes are computed from: sizes of the joint, and draws that every cause uses or leaves.
struct Drawn<'a> {
    /// Strength around 1.
    x: f64,
    /// Sizes of the joint.
    s: &'a Sizes,
    /// Sizes of the joint that it acts on together with; its own where there is none.
    b: Sizes,
    /// Whether the robot moves in a plane.
    planar: bool,
    /// 1 or −1.
    sign: f64,
    /// An angle, rad.
    phase: f64,
    /// Between −1 and 1.
    any: f64,
    /// Between 0 and 1.
    up: f64,
}

/// Draws the magnitudes of the `index`-th cause at a strength around 1.
pub(crate) fn draw(
    index: usize,
    strength: f64,
    s: &Sizes,
    planar: bool,
    partner: Option<Sizes>,
    random: &mut ChaCha8Rng,
) -> Kind {
    let drawn = Drawn {
        x: strength,
        s,
        b: partner.unwrap_or(*s),
        planar,
        // The order of these draws is the order of the stream: fields are evaluated as written.
        sign: if random.random_bool(0.5) { 1.0 } else { -1.0 },
        phase: random.random_range(-3.1..3.1),
        any: random.random_range(-1.0..1.0),
        up: random.random_range(0.0..1.0),
    };
    match index {
        0..=6 => drawn.friction(index),
        7..=COUPLING => drawn.transmission(index),
        11..=16 => drawn.drive(index),
        17..=20 => drawn.load(index, random),
        21..=24 => drawn.sensor(index),
        _ => drawn.outside(index),
    }
}

impl Drawn<'_> {
    /// Friction at the joint.
    fn friction(&self, index: usize) -> Kind {
        let Self {
            x,
            s,
            sign,
            phase,
            up,
            ..
        } = *self;
        let slow = 0.06 * s.speed;
        match index {
            0 => Kind::Stribeck {
                ratio: 1.0 + x,
                speed: slow * (0.5 + 0.5 * up),
            },
            1 => Kind::CoulombAsymmetry {
                asymmetry: sign * (0.2 * x).min(0.9),
            },
            2 => Kind::LoadDependentFriction {
                coefficient: 0.08 * x,
            },
            3 => Kind::QuadraticDrag {
                drag: 0.08 * x * s.torque / (0.7 * s.speed).powi(2),
            },
            4 => Kind::PreslidingHysteresis {
                range: 0.02 * x * s.length,
            },
            5 => Kind::Cogging {
                amplitude: 0.03 * x * s.torque,
                wave: (7.0 + 11.0 * up).round() / s.length,
                phase,
            },
            _ => Kind::FrictionDrift {
                excess: 0.35 * x,
                time: 1.6 + 1.6 * up,
            },
        }
    }

    /// What is between the rotor and the link.
    fn transmission(&self, index: usize) -> Kind {
        let Self {
            x, s, b, any, up, ..
        } = *self;
        match index {
            7 => {
                let stiffness = s.torque / (0.04 * x * s.length);
                let reduced = s.rotor * (s.inertia - s.rotor).max(0.1 * s.inertia) / s.inertia;
                Kind::JointElasticity {
                    stiffness,
                    damping: 0.06 * (stiffness * reduced).sqrt(),
                }
            }
            8 => {
                let stiffness = s.torque / (0.003 * s.length);
                let reduced = s.rotor * (s.inertia - s.rotor).max(0.1 * s.inertia) / s.inertia;
                Kind::Backlash {
                    gap: 0.025 * x * s.length,
                    stiffness,
                    damping: 0.1 * (stiffness * reduced).sqrt(),
                }
            }
            9 => Kind::UnmodelledRotorInertia {
                extra: 0.15 * x * s.inertia,
            },
            _ => {
                let ratio = -(0.6 + 0.5 * up) * s.length / b.length;
                Kind::JointCoupling {
                    stiffness: 0.05 * x * s.torque / s.amplitude,
                    ratio,
                    rest: s.centre + ratio * b.centre + 0.15 * s.amplitude * any,
                }
            }
        }
    }

    /// What is between the command and the torque.
    fn drive(&self, index: usize) -> Kind {
        let Self { x, s, sign, .. } = *self;
        match index {
            11 => Kind::ActuatorLag { time: 0.009 * x },
            12 => Kind::InputDelay { delay: 0.005 * x },
            13 => Kind::TorqueSaturation {
                limit: s.torque * (0.95 - 0.3 * x).max(0.35),
            },
            14 => Kind::GainErrorNonlinear {
                droop: 0.08 * x,
                at: s.torque / s.gain,
            },
            15 => Kind::CurrentOffset {
                offset: sign * 0.025 * x * s.torque / s.gain,
            },
            _ => Kind::DriveDeadZone {
                half_width: 0.03 * x * s.torque / s.gain,
            },
        }
    }

    /// What the links carry and what pulls at them.
    fn load(&self, index: usize, random: &mut ChaCha8Rng) -> Kind {
        let Self {
            x,
            s,
            planar,
            sign,
            phase,
            any,
            ..
        } = *self;
        match index {
            17 => Kind::Payload {
                mass: 0.09 * x * s.tip_mass,
            },
            18 => {
                let a = 0.03 * x;
                if planar {
                    Kind::BaseTilt {
                        x: 0.0,
                        y: sign * a,
                    }
                } else {
                    Kind::BaseTilt {
                        x: a * phase.cos(),
                        y: a * phase.sin(),
                    }
                }
            }
            19 => Kind::Spring {
                stiffness: 0.04 * x * s.torque / s.amplitude,
                rest: s.centre + 0.4 * s.amplitude * any,
            },
            _ => {
                let d = if planar {
                    [sign, 0.0, 0.5 * any]
                } else {
                    [phase.cos(), phase.sin(), 0.5 * any]
                };
                let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
                let mut edge = |a: f64| a + random.random_range(-0.3..0.3);
                Kind::ExternalForce {
                    force: d.map(|d| 0.07 * x * s.tip_force * d / length),
                    windows: [
                        [edge(1.2), edge(2.0)],
                        [edge(2.9), edge(4.1)],
                        [edge(5.2), edge(6.1)],
                    ],
                }
            }
        }
    }

    /// What is between the joint and the readings.
    fn sensor(&self, index: usize) -> Kind {
        let Self {
            x, s, sign, phase, ..
        } = *self;
        match index {
            21 => Kind::EncoderOffset {
                offset: sign * 0.025 * x * s.length,
            },
            22 => Kind::EncoderEccentricity {
                amplitude: 0.035 * x,
                phase,
            },
            VELOCITY_LAG => Kind::VelocityFilterLag { time: 0.009 * x },
            _ => Kind::SensorDelay { delay: 0.004 * x },
        }
    }

    /// What is outside the list.
    fn outside(&self, index: usize) -> Kind {
        let Self {
            x,
            s,
            b,
            planar,
            sign,
            phase,
            any,
            up,
            ..
        } = *self;
        match index {
            25 => Kind::SoftStop {
                from: s.centre + 0.35 * s.amplitude,
                stiffness: 0.3 * x * s.torque / s.amplitude,
            },
            26 => Kind::DroppedCommands {
                probability: 0.004 * x,
                length: 25,
            },
            27 => Kind::MainsHum {
                amplitude: 0.05 * x * s.torque,
                frequency: 6.0 + 6.0 * up,
            },
            MESH => Kind::GearMesh {
                amplitude: 0.05 * x * s.torque,
                waves: [
                    (4.0 + 6.0 * up) / s.length,
                    sign * (5.0 + 3.0 * any) / b.length,
                ],
                phase,
            },
            HOSE => {
                let ratio = sign * (0.6 + 0.5 * up) * s.length / b.length;
                Kind::Hose {
                    stiffness: 0.1 * x * s.torque / s.amplitude,
                    ratio,
                    slack: s.centre + ratio * b.centre + 0.2 * s.amplitude * (1.0 + any),
                }
            }
            30 => Kind::GainFade {
                loss: (0.06 * x).min(0.6),
                time: 2.0 + 6.0 * up,
            },
            SAG => Kind::SupplySag {
                loss: (0.06 * x).min(0.3),
                at: 2.0 * s.torque / s.gain,
            },
            _ => {
                let a = 0.25 * x;
                let (along, across) = if planar {
                    (sign, 0.0)
                } else {
                    (phase.cos(), phase.sin())
                };
                Kind::ShakenBase {
                    amplitude: [a * along, a * across, 0.3 * a * any],
                    frequency: 2.0 + 4.0 * up,
                }
            }
        }
    }
}
