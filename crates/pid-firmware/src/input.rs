//! Laws between a command and the input that acts, and their inverses.

use pid_effects::effect::Term;
use pid_symbolic::Cost;

/// A law of the input of one drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Step {
    /// u + x.
    Shift(f64),
    /// u within ± x.
    Limit(f64),
    /// u / (1 + x u²).
    Droop(f64),
    /// u less what of it lies within ± x.
    DeadZone(f64),
}

impl Step {
    /// The law of an effect with its parameters, if it is one of the input. A law that changes nothing
    /// is `Shift(0)`.
    pub(crate) fn of(term: &Term, values: &[f64]) -> Option<Self> {
        let x = *values.first()?;
        let law = match term.effect.info().id {
            "current_offset" => Self::Shift,
            "torque_saturation" => Self::Limit,
            "gain_error_nonlinear" => Self::Droop,
            "drive_dead_zone" => Self::DeadZone,
            _ => return None,
        };
        let nothing = x == 0.0 && !matches!(law(x), Self::Limit(_));
        Some(if nothing { Self::Shift(0.0) } else { law(x) })
    }

    /// Whether it leaves every input as it is.
    pub(crate) fn is_nothing(self) -> bool {
        self == Self::Shift(0.0)
    }

    /// Adds the operations of the law.
    pub(crate) fn count(self, cost: &mut Cost) {
        match self {
            Self::Shift(_) => cost.additions += 1,
            Self::Limit(_) => {}
            Self::Droop(_) => {
                cost.additions += 1;
                cost.multiplications += 2;
                cost.divisions += 1;
            }
            Self::DeadZone(_) => cost.additions += 1,
        }
    }
}
