//! The gain droops at large inputs: u_a = u / (1 + b u²), b = droop/u_n².
//!
//! Source: saturation of the iron; P. C. Krause et al., 2013, section 2.3.

use crate::effect::{
    Class, Commands, Info, Kind, Law, Model, Quantity, Source, Unit, parameter, quantity,
};
use crate::scalar::Scalar;

/// The gain droops at large inputs.
#[derive(Debug, Clone, Copy, Default)]
pub struct GainErrorNonlinear;

static INFO: Info = Info {
    id: "gain_error_nonlinear",
    title: "The gain droops at large inputs",
    equation: "u_a = u / (1 + b u²), b = droop/u_n²",
    source: "saturation of the iron; P. C. Krause et al., 2013, section 2.3",
    kind: Kind::Channel,
    class: Class::Load,
    has_joint: true,
    parameters: &[parameter(
        "droop_per_input_squared",
        "1/A^2",
        Unit::InverseSquareInput,
        -0.2,
        8.0,
    )],
    starts: &[&[0.1]],
    amplitudes: &[0],
    confusions: &[
        ("torque_saturation", "a limit has a corner"),
        (
            "load_dependent_friction",
            "friction changes sign with the motion",
        ),
    ],
    regime: "large inputs",
    equals: &[],
    mujoco: None,
    isaac: None,
    urdf: None,
};

impl Model for GainErrorNonlinear {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn source(&self) -> Option<Source> {
        Some(Source {
            own: "{gain}*({input}/({droop_per_input_squared}*{input}^2 + 1) - {input})",
            before: None,
        })
    }
    fn shown(&self, e: &[f64], _gain: f64, rated: f64) -> Vec<Quantity> {
        vec![
            quantity("droop", "1", e[0] * rated * rated),
            quantity("at_input", "A", rated),
        ]
    }
}

impl<D: Scalar> Law<D> for GainErrorNonlinear {
    fn input(&self, e: &[D], u: D, _at: &Commands<'_>, _memory: &mut [D]) -> D {
        u / (e[0] * u * u + 1.0)
    }
}
