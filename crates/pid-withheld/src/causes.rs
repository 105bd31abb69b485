//! Causes of a gap as the taxonomy defines them.

use serde::{Deserialize, Serialize};

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
    /// A stage of a position loop that its description does not state, as are the next seven.
    CommandFilter {
        time: f64,
    },
    CommandSpeedLimit {
        speed: f64,
    },
    CommandAccelerationLimit {
        acceleration: f64,
    },
    CommandAverage {
        time: f64,
    },
    GravityFeedForward {
        share: f64,
    },
    InertiaFeedForward {
        share: f64,
    },
    VelocityFeedForward {
        share: f64,
    },
    FeedbackDelay {
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
/// Place of the coupling of two joints among the causes, as the drawing of magnitudes counts them.
pub(crate) const COUPLING: usize = 10;
/// Places of the gears that mesh, of the hose and of the supply.
pub(crate) const MESH: usize = 28;
pub(crate) const HOSE: usize = 29;
pub(crate) const SAG: usize = 31;
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
            Kind::CommandFilter { .. } => "command_filter",
            Kind::CommandSpeedLimit { .. } => "command_speed_limit",
            Kind::CommandAccelerationLimit { .. } => "command_acceleration_limit",
            Kind::CommandAverage { .. } => "command_average",
            Kind::GravityFeedForward { .. } => "gravity_feed_forward",
            Kind::InertiaFeedForward { .. } => "inertia_feed_forward",
            Kind::VelocityFeedForward { .. } => "velocity_feed_forward",
            Kind::FeedbackDelay { .. } => "feedback_delay",
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
            Kind::ActuatorLag { time }
            | Kind::VelocityFilterLag { time }
            | Kind::CommandFilter { time } => ("time_constant_s", time),
            Kind::CommandSpeedLimit { speed } => ("speed", speed),
            Kind::CommandAccelerationLimit { acceleration } => ("acceleration", acceleration),
            Kind::CommandAverage { time } => ("time_s", time),
            Kind::GravityFeedForward { share }
            | Kind::InertiaFeedForward { share }
            | Kind::VelocityFeedForward { share } => ("share", share),
            Kind::InputDelay { delay }
            | Kind::SensorDelay { delay }
            | Kind::FeedbackDelay { delay } => ("delay_s", delay),
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
}
