//! Which part of the code carries an effect.

use pid_effects::effect::Effect;
use pid_effects::with_effects::{Obstacle, takes};

/// What carries an effect in the code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Carrier {
    /// A law of force, friction or input, or constants.
    Law,
    /// A shift of the positions.
    Reading,
    /// Nothing.
    Nothing,
}

/// What carries an effect, by what it does.
pub(crate) fn carrier(effect: &dyn Effect) -> Carrier {
    match takes(effect) {
        Ok(()) | Err(Obstacle::Structure) => Carrier::Law,
        Err(Obstacle::Reading) if effect.info().id == "encoder_offset" => Carrier::Reading,
        Err(_) => Carrier::Nothing,
    }
}
