//! A supply that gives less the more all drives take: u_a = u (1 − c Σ|u_k|) on every joint.
//!
//! The voltage of a supply falls by its inner resistance in proportion to the current, and that of
//! drives with the size of their inputs. The sum is over the recorded inputs in their own units, and over
//! the outputs of position loops where targets are recorded.
//!
//! Source: battery with inner resistance: T. Reddy, Linden's Handbook of Batteries, 4th ed. 2010,
//! section 3.2.

use crate::effect::{Class, Info, Kind, Law, Model, Unit, parameter};
use crate::scalar::Scalar;

/// A supply that all drives load.
#[derive(Debug, Clone, Copy, Default)]
pub struct SupplySag;

static INFO: Info = Info {
    id: "supply_sag",
    title: "A supply that gives less the more all drives take",
    equation: "u_a = u (1 − c Σ|u_k|) on every joint, the sum over all joints",
    source: "battery with inner resistance: T. Reddy, Linden's Handbook of Batteries, 4th ed. 2010, section 3.2",
    kind: Kind::Channel,
    class: Class::Load,
    has_joint: false,
    parameters: &[parameter(
        "loss_per_input",
        "1/A",
        Unit::InverseInput,
        -0.1,
        0.3,
    )],
    starts: &[&[0.03]],
    amplitudes: &[0],
    confusions: &[],
    regime: "large inputs of other joints",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for SupplySag {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn needs_inputs(&self) -> bool {
        true
    }
}

impl<D: Scalar> Law<D> for SupplySag {
    fn shared(&self, e: &[D], u: D, others: D) -> D {
        u * (-(e[0] * (u.magnitude() + others)) + 1.0)
    }
}
