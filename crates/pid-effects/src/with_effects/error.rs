//! Effects and loops that a model cannot have.

use std::fmt;

/// An effect or a position loop that a model cannot take.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EffectError {
    /// It has no form in equations of motion with exact derivatives.
    #[error("effect `{effect}`: {obstacle}")]
    Obstacle {
        /// The effect, with its joint.
        effect: String,
        /// What stands in the way, and what to use instead.
        obstacle: Obstacle,
    },
    /// It changes what the model does not have.
    #[error(
        "effect `{effect}` changes the {what} of joint `{joint}`, which the model has no parameter for\n  help: declare it, or read the robot from a nominal description (--nominal)"
    )]
    Missing {
        /// The effect, with its joint.
        effect: String,
        /// `Coulomb friction`, `viscous friction` or `gain`.
        what: &'static str,
        /// The joint.
        joint: String,
    },
    /// The same effect at the same joint twice.
    #[error("the model has a parameter `{parameter}` already\n  help: leave effect `{effect}` out")]
    Twice {
        /// The effect, with its joint.
        effect: String,
        /// The parameter.
        parameter: String,
    },
}

/// Why equations of motion cannot take an effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Obstacle {
    /// It splits the joint into rotor and link.
    Gear,
    /// It has a state that depends on the motion so far.
    Memory,
    /// It looks back in time.
    Delay,
    /// It lies between the motion and its reading.
    Reading,
    /// It acts on the tool point.
    Tool,
    /// It depends on the time.
    Time,
    /// It acts on the inputs of all joints together.
    Inputs,
    /// It changes masses or gravity.
    Structure,
    /// It changes friction or input of a joint where another effect's state takes their place.
    Together,
    /// It belongs to the position loop of a drive, or stands before it.
    Loop,
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Obstacle::Gear => {
                "it splits the joint into rotor and link\n  help: state it in a nominal description (--nominal), beside a rotor inertia"
            }
            Obstacle::Memory => {
                "its state depends on the motion so far\n  help: state it in a nominal description (--nominal); `simtrue regress --with presliding` works it out from the records"
            }
            Obstacle::Delay => {
                "it looks back in time\n  help: state it in a nominal description (--nominal), or shift the input by the delay in the records"
            }
            Obstacle::Reading => {
                "it lies between the motion and its reading\n  help: for a velocity that lags use `--velocity-lag` or a nominal description (--nominal); for positions correct the records; `simtrue simulate` and `simtrue diagnose` take it"
            }
            Obstacle::Tool => {
                "it acts on the tool point within windows of time\n  help: leave the records with the push out; `simtrue simulate` and `simtrue diagnose` take it"
            }
            Obstacle::Time => {
                "it depends on the time, which equations of motion do not have\n  help: use records of a warm joint, or parameters of each record (--private); `simtrue simulate` and `simtrue diagnose` take it"
            }
            Obstacle::Inputs => {
                "it acts on the inputs of all joints together\n  help: leave it out; `simtrue simulate` and `simtrue diagnose` take it"
            }
            Obstacle::Together => {
                "a state of another effect takes the place of the friction or input that it changes\n  help: leave one of the two out; `simtrue simulate` and `simtrue diagnose` take both"
            }
            Obstacle::Loop => {
                "it belongs to the position loop of its drive, or stands before it\n  help: leave it out; `simtrue simulate` and `simtrue diagnose` take it"
            }
            Obstacle::Structure => {
                "it changes masses or gravity, which only a nominal description states\n  help: state it in the description (--nominal) or declare it"
            }
        })
    }
}
