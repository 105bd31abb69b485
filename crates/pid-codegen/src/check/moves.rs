//! How a joint or motor moves with the coordinates.

use pid_derive::model::{self, Affine};

use super::numbers::{plus, times};

/// The motion of a joint or motor.
#[derive(Debug, Clone)]
pub struct Moves {
    /// Its position.
    pub position: model::Expr,
    /// Its velocity.
    pub velocity: model::Expr,
    /// Whether it is measured as a length; as an angle otherwise.
    pub length: bool,
    /// The combination, if it has no coordinate of its own.
    pub affine: Option<Affine>,
}

impl Moves {
    /// With a coordinate of its own.
    pub(super) fn own(coord: usize, length: bool) -> Self {
        Moves {
            position: model::Expr::Position(coord),
            velocity: model::Expr::Velocity(coord),
            length,
            affine: None,
        }
    }

    /// With a combination of coordinates.
    pub(super) fn along(affine: Affine, length: bool) -> Self {
        let sum = |leaf: fn(usize) -> model::Expr, start: model::Expr| {
            affine.terms.iter().fold(start, |sum, (coord, ratio)| {
                plus(sum, times(ratio.clone(), leaf(*coord)))
            })
        };
        Moves {
            position: sum(model::Expr::Position, affine.offset.clone()),
            velocity: sum(model::Expr::Velocity, model::Expr::Num(0.0)),
            length,
            affine: Some(affine),
        }
    }
}
