//! Causes of a gap as the taxonomy defines them, with magnitudes drawn for a joint.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

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

/// What is wrong; parameters in SI units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(
    missing_docs,
    reason = "the taxonomy's symbols, see `Kind::id` and the equations in `world`"
)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Stribeck {
        ratio: f64,
        speed: f64,
    },
    CoulombAsymmetry {
        asymmetry: f64,
    },
    LoadDependentFriction {
        coefficient: f64,
    },
    QuadraticDrag {
        drag: f64,
    },
    PreslidingHysteresis {
        range: f64,
    },
    Cogging {
        amplitude: f64,
        wave: f64,
        phase: f64,
    },
    FrictionDrift {
        excess: f64,
        time: f64,
    },
    JointElasticity {
        stiffness: f64,
        damping: f64,
    },
    Backlash {
        gap: f64,
        stiffness: f64,
        damping: f64,
    },
    UnmodelledRotorInertia {
        extra: f64,
    },
    JointCoupling {
        stiffness: f64,
        ratio: f64,
        rest: f64,
    },
    ActuatorLag {
        time: f64,
    },
    InputDelay {
        delay: f64,
    },
    TorqueSaturation {
        limit: f64,
    },
    GainErrorNonlinear {
        droop: f64,
        at: f64,
    },
    CurrentOffset {
        offset: f64,
    },
    DriveDeadZone {
        half_width: f64,
    },
    Payload {
        mass: f64,
    },
    BaseTilt {
        x: f64,
        y: f64,
    },
    Spring {
        stiffness: f64,
        rest: f64,
    },
    ExternalForce {
        force: [f64; 3],
        windows: [[f64; 2]; 3],
    },
    EncoderOffset {
        offset: f64,
    },
    EncoderEccentricity {
        amplitude: f64,
        phase: f64,
    },
    VelocityFilterLag {
        time: f64,
    },
    SensorDelay {
        delay: f64,
    },
    /// Outside the list: a rubber buffer.
    SoftStop {
        from: f64,
        stiffness: f64,
    },
    /// Outside the list: the drive keeps its last input for a while.
    DroppedCommands {
        probability: f64,
        length: usize,
    },
    /// Outside the list: torque ripple in time.
    MainsHum {
        amplitude: f64,
        frequency: f64,
    },
    /// Outside the list: gears of two joints that mesh.
    GearMesh {
        amplitude: f64,
        waves: [f64; 2],
        phase: f64,
    },
    /// Outside the list: a hose between two joints that pulls where it is tight.
    Hose {
        stiffness: f64,
        ratio: f64,
        slack: f64,
    },
    /// Outside the list: a motor that loses torque as it warms.
    GainFade {
        loss: f64,
        time: f64,
    },
    /// Outside the list: a supply that gives less the more all drives take; `at` is the sum of inputs
    /// at which the whole share is lost.
    SupplySag {
        loss: f64,
        at: f64,
    },
    /// Outside the list: a base that something shakes.
    ShakenBase {
        amplitude: [f64; 3],
        frequency: f64,
    },
}

/// A cause at a joint (from 0).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cause {
    /// What.
    pub kind: Kind,
    /// Where.
    pub joint: usize,
}

/// Number of causes of the taxonomy.
pub(crate) const LISTED: usize = 25;
/// Number of causes outside.
pub(crate) const OUTSIDE: usize = 8;
/// Place of the coupling of two joints among the causes, as [`Kind::draw`] counts them.
pub(crate) const COUPLING: usize = 10;
/// Places of the gears that mesh, of the hose and of the supply.
const MESH: usize = 28;
const HOSE: usize = 29;
const SAG: usize = 31;
/// Place of the lag of the velocity.
pub(crate) const VELOCITY_LAG: usize = 23;

impl Kind {
    /// Identifier of the taxonomy; `unknown` for what is outside.
    pub fn id(&self) -> &'static str {
        match self {
            Kind::Stribeck { .. } => "stribeck",
            Kind::CoulombAsymmetry { .. } => "coulomb_asymmetry",
            Kind::LoadDependentFriction { .. } => "load_dependent_friction",
            Kind::QuadraticDrag { .. } => "quadratic_drag",
            Kind::PreslidingHysteresis { .. } => "presliding_hysteresis",
            Kind::Cogging { .. } => "cogging",
            Kind::FrictionDrift { .. } => "friction_drift",
            Kind::JointElasticity { .. } => "joint_elasticity",
            Kind::Backlash { .. } => "backlash",
            Kind::UnmodelledRotorInertia { .. } => "unmodelled_rotor_inertia",
            Kind::JointCoupling { .. } => "joint_coupling",
            Kind::ActuatorLag { .. } => "actuator_lag",
            Kind::InputDelay { .. } => "input_delay",
            Kind::TorqueSaturation { .. } => "torque_saturation",
            Kind::GainErrorNonlinear { .. } => "gain_error_nonlinear",
            Kind::CurrentOffset { .. } => "current_offset",
            Kind::DriveDeadZone { .. } => "drive_dead_zone",
            Kind::Payload { .. } => "payload",
            Kind::BaseTilt { .. } => "base_tilt",
            Kind::Spring { .. } => "spring",
            Kind::ExternalForce { .. } => "external_force",
            Kind::EncoderOffset { .. } => "encoder_offset",
            Kind::EncoderEccentricity { .. } => "encoder_eccentricity",
            Kind::VelocityFilterLag { .. } => "velocity_filter_lag",
            Kind::SensorDelay { .. } => "sensor_delay",
            Kind::SoftStop { .. }
            | Kind::DroppedCommands { .. }
            | Kind::MainsHum { .. }
            | Kind::GearMesh { .. }
            | Kind::Hose { .. }
            | Kind::GainFade { .. }
            | Kind::SupplySag { .. }
            | Kind::ShakenBase { .. } => "unknown",
        }
    }

    /// Whether the `index`-th cause can be outside the list at a joint of `n`: a hose and gears that
    /// mesh are between a joint and the one before it, and one drive alone has no common supply.
    pub(crate) fn fits(index: usize, joint: usize, n: usize) -> bool {
        match index {
            MESH | HOSE => joint > 0,
            SAG => n > 1,
            _ => true,
        }
    }

    /// Whether it belongs to a joint.
    pub fn has_joint(&self) -> bool {
        !matches!(
            self,
            Kind::Payload { .. }
                | Kind::BaseTilt { .. }
                | Kind::ExternalForce { .. }
                | Kind::SupplySag { .. }
                | Kind::ShakenBase { .. }
        )
    }

    /// The magnitude that names its size: name in reports and value. `None` where the report's form
    /// has no single one.
    pub fn magnitude(&self) -> Option<(&'static str, f64)> {
        Some(match *self {
            Kind::Stribeck { ratio, .. } => ("static_to_coulomb", ratio),
            Kind::CoulombAsymmetry { asymmetry } => ("asymmetry", asymmetry),
            Kind::LoadDependentFriction { coefficient } => ("load_coefficient", coefficient),
            Kind::QuadraticDrag { drag } => ("drag", drag),
            Kind::PreslidingHysteresis { range } => ("presliding_range", range),
            Kind::Cogging { amplitude, .. } => ("amplitude", amplitude),
            Kind::FrictionDrift { excess, .. } => ("cold_excess", excess),
            Kind::JointElasticity { stiffness, .. } => ("stiffness", stiffness),
            Kind::Backlash { gap, .. } => ("gap", gap),
            Kind::UnmodelledRotorInertia { extra } => ("extra_inertia", extra),
            Kind::JointCoupling { stiffness, .. } | Kind::Spring { stiffness, .. } => {
                ("stiffness", stiffness)
            }
            Kind::ActuatorLag { time } | Kind::VelocityFilterLag { time } => {
                ("time_constant_s", time)
            }
            Kind::InputDelay { delay } | Kind::SensorDelay { delay } => ("delay_s", delay),
            Kind::TorqueSaturation { limit } => ("limit", limit),
            Kind::GainErrorNonlinear { .. } => return None,
            Kind::CurrentOffset { offset } | Kind::EncoderOffset { offset } => ("offset", offset),
            Kind::DriveDeadZone { half_width } => ("half_width", half_width),
            Kind::Payload { mass } => ("mass", mass),
            Kind::BaseTilt { y, .. } => ("tilt_y", y),
            Kind::EncoderEccentricity { amplitude, .. } => ("amplitude", amplitude),
            Kind::ExternalForce { .. }
            | Kind::SoftStop { .. }
            | Kind::DroppedCommands { .. }
            | Kind::MainsHum { .. }
            | Kind::GearMesh { .. }
            | Kind::Hose { .. }
            | Kind::GainFade { .. }
            | Kind::SupplySag { .. }
            | Kind::ShakenBase { .. } => return None,
        })
    }

    /// Parameters under the names and in the units of reports: [`Kind::magnitude`] first, then those
    /// that have the same meaning there.
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        let mut all: Vec<(&'static str, f64)> = self.magnitude().into_iter().collect();
        match *self {
            Kind::Stribeck { speed, .. } => all.push(("stribeck_velocity", speed)),
            Kind::Cogging { wave, .. } => all.push(("periods_per_unit", wave)),
            Kind::FrictionDrift { time, .. } => all.push(("time_constant_s", time)),
            Kind::JointElasticity { damping, .. } => all.push(("damping", damping)),
            Kind::JointCoupling { ratio, rest, .. } => {
                all.extend([("ratio", ratio), ("rest", rest)]);
            }
            Kind::Spring { rest, .. } => all.push(("rest", rest)),
            Kind::ExternalForce { force, .. } => {
                all.extend([
                    ("force_x", force[0]),
                    ("force_y", force[1]),
                    ("force_z", force[2]),
                ]);
            }
            _ => {}
        }
        all
    }

    /// Whether it acts between the command and the current of a drive.
    pub(crate) fn before_current(&self) -> bool {
        matches!(
            self,
            Kind::InputDelay { .. } | Kind::ActuatorLag { .. } | Kind::DroppedCommands { .. }
        )
    }

    /// Draws the magnitudes of the `index`-th cause at a strength around 1.
    pub(crate) fn draw(
        index: usize,
        strength: f64,
        s: &Sizes,
        planar: bool,
        partner: Option<Sizes>,
        random: &mut ChaCha8Rng,
    ) -> Self {
        let x = strength;
        let sign = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        let phase = random.random_range(-3.1..3.1);
        let any = random.random_range(-1.0..1.0);
        let up = random.random_range(0.0..1.0);
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
            6 => Kind::FrictionDrift {
                excess: 0.35 * x,
                time: 1.6 + 1.6 * up,
            },
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
            COUPLING => {
                let b = partner.unwrap_or(*s);
                let ratio = -(0.6 + 0.5 * up) * s.length / b.length;
                Kind::JointCoupling {
                    stiffness: 0.05 * x * s.torque / s.amplitude,
                    ratio,
                    rest: s.centre + ratio * b.centre + 0.15 * s.amplitude * any,
                }
            }
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
            16 => Kind::DriveDeadZone {
                half_width: 0.03 * x * s.torque / s.gain,
            },
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
            20 => {
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
            21 => Kind::EncoderOffset {
                offset: sign * 0.025 * x * s.length,
            },
            22 => Kind::EncoderEccentricity {
                amplitude: 0.035 * x,
                phase,
            },
            VELOCITY_LAG => Kind::VelocityFilterLag { time: 0.009 * x },
            24 => Kind::SensorDelay { delay: 0.004 * x },
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
            MESH => {
                let b = partner.unwrap_or(*s);
                Kind::GearMesh {
                    amplitude: 0.05 * x * s.torque,
                    waves: [
                        (4.0 + 6.0 * up) / s.length,
                        sign * (5.0 + 3.0 * any) / b.length,
                    ],
                    phase,
                }
            }
            HOSE => {
                let b = partner.unwrap_or(*s);
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
