//! Classes of causes: what a law is a function of.

use serde::{Deserialize, Serialize};

/// A class of causes: what a law of it is a function of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Friction over the velocity and its direction.
    Velocity,
    /// Friction over the load, and what the drive makes of its input.
    Load,
    /// A force over the position, and an error of the position reading.
    Position,
    /// Friction over the distance since the last reversal.
    Reversal,
    /// Friction and the gain of the drive over the time.
    Time,
    /// When the input acts.
    InputTiming,
    /// When positions show.
    PositionTiming,
    /// When the velocity shows.
    VelocityTiming,
    /// Inertia and gravity of the link and its rotor, outside their tolerances.
    Inertia,
    /// A force over position, velocity and load of the other joints.
    Coupling,
}

impl Class {
    /// All of them.
    pub const ALL: [Class; 10] = [
        Class::Velocity,
        Class::Load,
        Class::Position,
        Class::Reversal,
        Class::Time,
        Class::InputTiming,
        Class::PositionTiming,
        Class::VelocityTiming,
        Class::Inertia,
        Class::Coupling,
    ];

    /// In a few words.
    pub fn words(self) -> &'static str {
        match self {
            Class::Velocity => "velocity",
            Class::Load => "load or input",
            Class::Position => "position",
            Class::Reversal => "distance since the reversal",
            Class::Time => "time",
            Class::InputTiming => "timing of the input",
            Class::PositionTiming => "timing of the position",
            Class::VelocityTiming => "timing of the velocity",
            Class::Inertia => "inertia and gravity",
            Class::Coupling => "motion of other joints",
        }
    }
}
