//! The library: one file per effect.

mod actuator_lag;
mod backlash;
mod base_tilt;
mod cogging;
mod command_acceleration_limit;
mod command_average;
mod command_filter;
mod command_speed_limit;
mod coulomb_asymmetry;
mod current_offset;
mod drive_dead_zone;
mod encoder_eccentricity;
mod encoder_offset;
mod external_force;
mod feedback_delay;
mod friction_drift;
mod gain_error_nonlinear;
mod gravity_feed_forward;
mod inertia_feed_forward;
mod input_delay;
mod joint_coupling;
mod joint_elasticity;
mod load_dependent_friction;
mod motor_coupling;
mod payload;
mod presliding_hysteresis;
mod quadratic_drag;
mod saturating_friction;
mod sensor_delay;
mod spring;
mod stribeck;
mod torque_saturation;
mod unmodelled_rotor_inertia;
mod velocity_feed_forward;
mod velocity_filter_lag;

pub use actuator_lag::ActuatorLag;
pub use backlash::Backlash;
pub use base_tilt::BaseTilt;
pub use cogging::Cogging;
pub use command_acceleration_limit::CommandAccelerationLimit;
pub use command_average::CommandAverage;
pub use command_filter::CommandFilter;
pub use command_speed_limit::CommandSpeedLimit;
pub use coulomb_asymmetry::CoulombAsymmetry;
pub use current_offset::CurrentOffset;
pub use drive_dead_zone::DriveDeadZone;
pub use encoder_eccentricity::EncoderEccentricity;
pub use encoder_offset::EncoderOffset;
pub use external_force::ExternalForce;
pub use feedback_delay::FeedbackDelay;
pub use friction_drift::FrictionDrift;
pub use gain_error_nonlinear::GainErrorNonlinear;
pub use gravity_feed_forward::GravityFeedForward;
pub use inertia_feed_forward::InertiaFeedForward;
pub use input_delay::InputDelay;
pub use joint_coupling::JointCoupling;
pub use joint_elasticity::JointElasticity;
pub use load_dependent_friction::LoadDependentFriction;
pub use motor_coupling::MotorCoupling;
pub use payload::Payload;
pub use presliding_hysteresis::PreslidingHysteresis;
pub use quadratic_drag::QuadraticDrag;
pub use saturating_friction::SaturatingFriction;
pub use sensor_delay::SensorDelay;
pub use spring::Spring;
pub use stribeck::Stribeck;
pub use torque_saturation::TorqueSaturation;
pub use unmodelled_rotor_inertia::UnmodelledRotorInertia;
pub use velocity_feed_forward::VelocityFeedForward;
pub use velocity_filter_lag::VelocityFilterLag;

use std::sync::Arc;

use crate::effect::Effect;

/// All effects of the library.
pub fn all() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(Stribeck),
        Arc::new(CoulombAsymmetry),
        Arc::new(LoadDependentFriction),
        Arc::new(QuadraticDrag),
        Arc::new(SaturatingFriction),
        Arc::new(PreslidingHysteresis),
        Arc::new(Cogging),
        Arc::new(FrictionDrift),
        Arc::new(JointElasticity),
        Arc::new(Backlash),
        Arc::new(UnmodelledRotorInertia),
        Arc::new(JointCoupling),
        Arc::new(MotorCoupling),
        Arc::new(ActuatorLag),
        Arc::new(InputDelay),
        Arc::new(CommandFilter),
        Arc::new(CommandAverage),
        Arc::new(CommandSpeedLimit),
        Arc::new(CommandAccelerationLimit),
        Arc::new(GravityFeedForward),
        Arc::new(InertiaFeedForward),
        Arc::new(VelocityFeedForward),
        Arc::new(FeedbackDelay),
        Arc::new(TorqueSaturation),
        Arc::new(GainErrorNonlinear),
        Arc::new(CurrentOffset),
        Arc::new(DriveDeadZone),
        Arc::new(Payload),
        Arc::new(BaseTilt),
        Arc::new(Spring),
        Arc::new(ExternalForce),
        Arc::new(EncoderOffset),
        Arc::new(EncoderEccentricity),
        Arc::new(VelocityFilterLag),
        Arc::new(SensorDelay),
    ]
}

/// The effect, or the [term](crate::terms) of a law without a name, with an identifier.
pub fn by_id(id: &str) -> Option<Arc<dyn Effect>> {
    let mut every = all().into_iter().chain(crate::terms::all());
    every.find(|e| e.info().id == id)
}
