//! Parameters of effects, what they scale with, and the magnitudes that reports show.

/// What a parameter scales with: its unit in terms of the robot, so that ranges and starts hold for
/// every robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// A pure number.
    One,
    /// A share: at 1 it is all, which is as good a value as any other.
    Share,
    /// Typical torque or force of the joint.
    Torque,
    /// Typical input of the joint.
    Input,
    /// Typical speed of the joint.
    Speed,
    /// Square of the typical speed of the joint over its range of motion.
    Acceleration,
    /// Range of motion of the joint.
    Range,
    /// Angle, rad.
    Angle,
    /// Time, s.
    Time,
    /// Inertia seen by the joint.
    Inertia,
    /// Torque over range.
    Stiffness,
    /// Torque over speed.
    Damping,
    /// Torque over squared speed.
    Drag,
    /// 1 over range.
    Wave,
    /// Range over torque.
    Compliance,
    /// 1 over input.
    InverseInput,
    /// 1 over squared input.
    InverseSquareInput,
    /// Range of this joint over that of its partner.
    Ratio,
    /// Mass of the last link.
    Mass,
    /// Force at the tool that the second joint's typical torque balances.
    Force,
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name in reports.
    pub name: &'static str,
    /// SI unit as text, for a revolute joint.
    pub si: &'static str,
    /// What it is measured in.
    pub unit: Unit,
    /// Smallest value, in units.
    pub lower: f64,
    /// Largest value, in units.
    pub upper: f64,
}

/// A physical magnitude of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// Name in reports.
    pub name: &'static str,
    /// SI unit as text, for a revolute joint and a drive commanded in amperes.
    pub si: &'static str,
    /// Value in that unit.
    pub value: f64,
}

/// Shorthand for lists.
pub const fn quantity(name: &'static str, si: &'static str, value: f64) -> Quantity {
    Quantity { name, si, value }
}

/// Shorthand for tables.
pub const fn parameter(
    name: &'static str,
    si: &'static str,
    unit: Unit,
    lower: f64,
    upper: f64,
) -> Parameter {
    Parameter {
        name,
        si,
        unit,
        lower,
        upper,
    }
}
