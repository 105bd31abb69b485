//! Drives: what force they exert for which control.

/// A drive on a joint: with x the position and w the velocity of the joint times the gear,
///
/// ```text
/// force on the joint = gear · (gain · control + bias[0] + bias[1] x + bias[2] w)
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Actuator {
    /// Name as written; empty if there is none.
    pub name: String,
    /// Element: `motor`, `position`, `velocity`, `general`, `damper`.
    pub kind: String,
    /// Index of the body whose joint it moves.
    pub body: usize,
    /// Gear ratio.
    pub gear: f64,
    /// Force per unit of the control, before the gear.
    pub gain: f64,
    /// Constant force, force per position, force per velocity, before the gear.
    pub bias: [f64; 3],
    /// Range of the control.
    pub control: Option<(f64, f64)>,
    /// Range of the force, before the gear.
    pub force: Option<(f64, f64)>,
}

/// A position loop about a joint: the force on it is `kp (target − q) − kd v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionLoop {
    /// N·m/rad; N/m of a slide.
    pub kp: f64,
    /// N·m·s/rad; N·s/m of a slide.
    pub kd: f64,
}

impl Actuator {
    /// The loop of a drive whose control is a target, with the target at the joint: control over gear. `None`
    /// of another law.
    pub fn position_loop(&self) -> Option<PositionLoop> {
        let [constant, of_position, of_velocity] = self.bias;
        let gear = self.gear * self.gear;
        let follows = self.gain > 0.0 && of_position == -self.gain && constant == 0.0;
        (follows && gear > 0.0 && of_velocity <= 0.0).then_some(PositionLoop {
            kp: gear * self.gain,
            kd: -gear * of_velocity,
        })
    }

    /// Largest force or torque on the joint that the range of the force allows, N or N·m.
    pub fn force_on_joint(&self) -> Option<f64> {
        let (low, high) = self.force?;
        Some(low.abs().max(high.abs()) * self.gear.abs())
    }

    /// Largest force or torque on the joint that the ranges allow, N or N·m.
    pub fn effort(&self) -> Option<f64> {
        let most = |(low, high): (f64, f64)| low.abs().max(high.abs());
        let of_control = (self.bias == [0.0; 3])
            .then_some(self.control)
            .flatten()
            .map(|range| self.gain.abs() * most(range));
        let force = self.force.map(most);
        let least = match (force, of_control) {
            (Some(x), Some(y)) => Some(x.min(y)),
            (x, y) => x.or(y),
        };
        least.map(|x| x * self.gear.abs())
    }
}
