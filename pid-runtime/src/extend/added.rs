//! Places and parameters of the terms.

use std::borrow::Cow;

use super::term::Term;
use crate::dynamics::{Hessian, InputInfo, JointInfo, ParamInfo};
use crate::memory::{Memory, widths};
use crate::term::{Law, Place, REST_ROTATION, REST_TRANSLATION, Request};

/// Range of velocities in which a shape parameter is sought, as multiples of v₀.
const SHAPE_RANGE: (f64, f64, f64) = (4.0, 10.0, 200.0);
/// Widest coefficient, as a multiple of the largest force or torque among the ranges of the model's
/// parameters. It is wide so that a coefficient that the data do not pin shows in its deviation.
const WIDER: f64 = 10.0;
/// Widest coefficient for a model without such a range, N·m per unit of φ.
const WIDEST: f64 = 1e3;

/// A term that does not fit the model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExtendError {
    /// A joint that the model does not have.
    #[error("term `{term}`: the model has no joint `{joint}`; its joints are {joints}")]
    UnknownJoint {
        /// The term as written.
        term: String,
        /// The joint asked for.
        joint: String,
        /// The model's joints.
        joints: String,
    },
    /// The same parameter twice.
    #[error(
        "term `{term}`: the model has a parameter `{parameter}` already\n  help: leave the term out"
    )]
    Twice {
        /// The term as written.
        term: String,
        /// The parameter.
        parameter: String,
    },
    /// A law of the input at a joint without one.
    #[error(
        "term `{term}`: joint `{joint}` has no input whose load could be felt\n  help: leave the joint out"
    )]
    NoInput {
        /// The term as written.
        term: String,
        /// The joint.
        joint: String,
    },
    /// A law with a memory in a model whose inputs are not one per joint.
    #[error(
        "term `{term}`: the model has {inputs} inputs for {joints} joints; a law with a memory needs one at each\n  help: declare the missing ones, with a record of zeros"
    )]
    Inputs {
        /// The term as written.
        term: String,
        /// Inputs.
        inputs: usize,
        /// Joints.
        joints: usize,
    },
}

/// The joints of each term that a request asks for.
pub(super) fn places(
    model: &dyn Hessian,
    request: &Request,
) -> Result<Vec<Vec<usize>>, ExtendError> {
    let find = |name: &String| {
        model
            .joints()
            .iter()
            .position(|j| j.name == *name)
            .ok_or_else(|| ExtendError::UnknownJoint {
                term: request.to_string(),
                joint: name.clone(),
                joints: model
                    .joints()
                    .iter()
                    .map(|j| j.name.as_ref())
                    .collect::<Vec<_>>()
                    .join(", "),
            })
    };
    Ok(match &request.place {
        Place::EveryJoint => (0..model.dims().nq).map(|j| vec![j]).collect(),
        Place::Joint(name) => vec![vec![find(name)?]],
        Place::Sum(a, b) => vec![vec![find(a)?, find(b)?]],
    })
}

/// Additions of the terms to a model, under construction.
pub(super) struct Added {
    pub(super) params: Vec<ParamInfo>,
    pub(super) inputs: Vec<InputInfo>,
    pub(super) memories: Vec<Memory>,
    pub(super) terms: Vec<Term>,
}

impl Added {
    /// A parameter of a term; its position.
    fn parameter(
        &mut self,
        request: &Request,
        name: String,
        unit: String,
        (nominal, lower, upper): (f64, f64, f64),
    ) -> Result<usize, ExtendError> {
        if self.params.iter().any(|p| p.name == name) {
            return Err(ExtendError::Twice {
                term: request.to_string(),
                parameter: name,
            });
        }
        self.params.push(ParamInfo {
            name: Cow::Owned(name),
            unit: Cow::Owned(unit),
            doc: Cow::Owned(format!("term `{request}`")),
            nominal,
            lower,
            upper,
            fixed: false,
        });
        Ok(self.params.len() - 1)
    }

    /// A law without a memory.
    pub(super) fn place(
        &mut self,
        model: &dyn Hessian,
        request: &Request,
        joints: Vec<usize>,
    ) -> Result<(), ExtendError> {
        let law = request.law;
        let info = &model.joints()[joints[0]];
        let name = joined(model, &joints);
        let input = model
            .inputs()
            .iter()
            .position(|i| i.joint == Some(joints[0]));
        if law == Law::Load && input.is_none() {
            return Err(ExtendError::NoInput {
                term: request.to_string(),
                joint: name,
            });
        }
        let rest = if info.prismatic {
            REST_TRANSLATION
        } else {
            REST_ROTATION
        };
        let unit = law.unit(
            info.prismatic,
            input.map_or("", |i| &model.inputs()[i].unit),
        );
        let widest = widest(model, info);
        let lower = if law.non_negative() { 0.0 } else { -widest };
        let coefficient = self.parameter(
            request,
            format!("{}_{name}", law.word()),
            unit,
            (0.0, lower, widest),
        )?;
        let shape = match law.has_shape() {
            true => {
                let (low, start, high) = SHAPE_RANGE;
                let unit = if info.prismatic { "m/s" } else { "rad/s" };
                Some(self.parameter(
                    request,
                    format!("{}_velocity_{name}", law.word()),
                    unit.to_owned(),
                    (start * rest, low * rest, high * rest),
                )?)
            }
            // The voltage that drives the current is the input less the back-EMF.
            false if law == Law::Load && input.is_some_and(|i| model.inputs()[i].unit == "V") => {
                let name = format!("gain_{}", info.name);
                model.params().iter().position(|p| p.name == name)
            }
            false => None,
        };
        self.terms.push(Term {
            law,
            joints,
            input,
            rest,
            coefficient,
            shape,
        });
        Ok(())
    }

    /// A law with a memory: a term, and a state among the inputs, for each width.
    pub(super) fn remember(
        &mut self,
        model: &dyn Hessian,
        request: &Request,
        joints: &[usize],
    ) -> Result<(), ExtendError> {
        let dims = model.dims();
        if dims.nu != dims.nq {
            return Err(ExtendError::Inputs {
                term: request.to_string(),
                inputs: dims.nu,
                joints: dims.nq,
            });
        }
        let (law, info) = (request.law, &model.joints()[joints[0]]);
        let name = joined(model, joints);
        for (width, word) in widths(info.prismatic) {
            let coefficient = self.parameter(
                request,
                format!("{}_{word}_{name}", law.word()),
                law.unit(info.prismatic, ""),
                (0.0, 0.0, widest(model, info)),
            )?;
            self.terms.push(Term {
                law,
                joints: joints.to_vec(),
                input: Some(self.inputs.len()),
                rest: REST_ROTATION,
                coefficient,
                shape: None,
            });
            self.inputs.push(InputInfo {
                name: Cow::Owned(format!("{}_state_{word}_{name}", law.word())),
                unit: Cow::Borrowed("1"),
                joint: None,
            });
            self.memories.push(Memory {
                joints: joints.to_vec(),
                width,
            });
        }
        Ok(())
    }
}

/// Names of joints as part of a parameter's.
fn joined(model: &dyn Hessian, joints: &[usize]) -> String {
    let names = joints.iter().map(|&j| model.joints()[j].name.as_ref());
    names.collect::<Vec<_>>().join("_")
}

/// Widest coefficient of a term at a joint. Estimators take the width of a range as the size of its
/// values.
fn widest(model: &dyn Hessian, info: &JointInfo) -> f64 {
    let force = model
        .params()
        .iter()
        .filter(|p| p.unit == info.force_unit() && p.upper.is_finite())
        .fold(0.0_f64, |most, p| most.max(p.upper));
    if force > 0.0 { WIDER * force } else { WIDEST }
}
