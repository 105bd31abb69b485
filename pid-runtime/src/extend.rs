//! A model with further force terms: every estimator that takes a model takes this one.

use std::borrow::Cow;

use crate::dynamics::{
    At, Dims, Dynamics, Hessian, InputInfo, Jacobian, JointInfo, ParamInfo, Pattern,
};

use crate::memory::{Memory, widths};
use crate::term::{ARGUMENTS, Law, Place, REST_ROTATION, REST_TRANSLATION, Request, SHAPE};

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

/// A term at its joint.
#[derive(Debug, Clone)]
struct Term {
    law: Law,
    /// One joint, or two whose sum the motor turns with.
    joints: Vec<usize>,
    /// Position of the input in `u`.
    input: Option<usize>,
    rest: f64,
    /// Position of the coefficient and of the shape parameter in `p`.
    coefficient: usize,
    shape: Option<usize>,
}

impl Term {
    fn arguments(&self, at: &At<'_>) -> [f64; ARGUMENTS] {
        let sum = |x: &[f64]| self.joints.iter().map(|&j| x[j]).sum::<f64>();
        let depends = self.law.depends();
        [
            if depends[0] { sum(at.v) } else { 0.0 },
            if depends[1] { sum(at.a) } else { 0.0 },
            match self.input {
                Some(i) if depends[2] => at.u[i],
                _ => 0.0,
            },
            self.shape.map_or(0.0, |s| at.p[s]),
        ]
    }

    /// Positions in z of an argument of φ, each with derivative 1.
    fn places(&self, argument: usize, dims: Dims) -> Vec<usize> {
        match argument {
            0 => self.joints.iter().map(|j| dims.v() + j).collect(),
            1 => self.joints.iter().map(|j| dims.a() + j).collect(),
            2 => self.input.iter().map(|i| dims.u() + i).collect(),
            _ => self.shape.iter().map(|s| dims.p() + s).collect(),
        }
    }

    fn force(&self, at: &At<'_>) -> f64 {
        at.p[self.coefficient] * self.law.value(self.arguments(at), self.rest)
    }
}

/// Share of a term in an entry of a derivative: which part of φ's derivatives, and where it goes.
#[derive(Debug, Clone, Copy)]
struct Share {
    slot: usize,
    part: Part,
}

#[derive(Debug, Clone, Copy)]
enum Part {
    /// φ.
    Value,
    /// c ∂φ/∂x_i.
    Scaled(usize),
    /// ∂φ/∂x_i.
    Gradient(usize),
    /// c ∂²φ/∂x_i∂x_j.
    Curvature(usize, usize),
}

/// A model and the terms added to it. Parameters of the terms follow those of the model.
///
/// ```
/// use pid_runtime::extend::Extended;
/// use pid_models::Emps;
/// use pid_runtime::dynamics::Dynamics;
///
/// let model = Extended::new(&Emps, &["asymmetric".parse()?])?;
/// assert_eq!(model.params().last().unwrap().name, "asymmetric_x");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Extended<'m> {
    inner: &'m dyn Hessian,
    dims: Dims,
    params: Vec<ParamInfo>,
    terms: Vec<Term>,
    /// The model's inputs and the states of laws with a memory.
    inputs: Vec<InputInfo>,
    memories: Vec<Memory>,
    jacobian: Merged,
    hessian: Merged,
}

/// The model's pattern with the terms' entries merged in.
struct Merged {
    rows: Vec<u32>,
    cols: Vec<u32>,
    /// Slot of each entry of the model, increasing.
    inner: Vec<usize>,
    /// Shares of each term.
    shares: Vec<Vec<Share>>,
}

impl Merged {
    /// `own`: places of the model's entries.
    fn new(own: Vec<(u32, u32)>, entries: &[Vec<((u32, u32), Part)>]) -> Self {
        let mut all = own.clone();
        all.extend(entries.iter().flatten().map(|(place, _)| *place));
        all.sort_unstable();
        all.dedup();
        let slot = |place: &(u32, u32)| {
            all.binary_search(place)
                .expect("invariant: every place was put in above")
        };
        Self {
            inner: own.iter().map(slot).collect(),
            shares: entries
                .iter()
                .map(|term| {
                    term.iter()
                        .map(|(place, part)| Share {
                            slot: slot(place),
                            part: *part,
                        })
                        .collect()
                })
                .collect(),
            rows: all.iter().map(|p| p.0).collect(),
            cols: all.iter().map(|p| p.1).collect(),
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.rows,
            cols: &self.cols,
        }
    }

    /// Moves the model's values, written at the front, to their slots; zero elsewhere.
    fn spread(&self, values: &mut [f64]) {
        let total = self.rows.len();
        let mut end = total;
        for (i, &slot) in self.inner.iter().enumerate().rev() {
            let value = values[i];
            values[slot + 1..end].fill(0.0);
            values[slot] = value;
            end = slot;
        }
        values[..end].fill(0.0);
    }
}

impl<'m> Extended<'m> {
    /// Adds terms to a model.
    ///
    /// # Errors
    /// [`ExtendError`] where a term names a joint that does not exist, or a parameter that does.
    pub fn new(inner: &'m dyn Hessian, requests: &[Request]) -> Result<Self, ExtendError> {
        let mut added = Added {
            params: inner.params().to_vec(),
            inputs: inner.inputs().to_vec(),
            memories: Vec::new(),
            terms: Vec::new(),
        };
        for request in requests {
            for joints in places(inner, request)? {
                match request.law.has_memory() {
                    true => added.remember(inner, request, &joints)?,
                    false => added.place(inner, request, joints)?,
                }
            }
        }
        let Added {
            params,
            inputs,
            memories,
            terms,
        } = added;
        let dims = Dims {
            nu: inner.dims().nu + memories.len(),
            np: params.len(),
            ..inner.dims()
        };
        // Further inputs lie before the parameters.
        let (first, further) = (inner.dims().p(), memories.len());
        let moved = |z: u32| match z as usize {
            z if z >= first => (z + further) as u32,
            z => z as u32,
        };
        let own = |pattern: Pattern<'_>, row: &dyn Fn(u32) -> u32| -> Vec<(u32, u32)> {
            let places = pattern.rows.iter().zip(pattern.cols);
            places.map(|(&r, &c)| (row(r), moved(c))).collect()
        };
        let jacobian = Merged::new(
            own(inner.jacobian_pattern(), &|row| row),
            &terms
                .iter()
                .map(|t| jacobian_entries(t, dims))
                .collect::<Vec<_>>(),
        );
        let hessian = Merged::new(
            own(inner.hessian_pattern(), &moved),
            &terms
                .iter()
                .map(|t| hessian_entries(t, dims))
                .collect::<Vec<_>>(),
        );
        Ok(Self {
            inner,
            dims,
            params,
            terms,
            inputs,
            memories,
            jacobian,
            hessian,
        })
    }

    /// States of laws with a memory, in the order in which the model takes them: after the inputs
    /// of the model without terms.
    pub fn memories(&self) -> &[Memory] {
        &self.memories
    }

    fn own<'a>(&self, at: &At<'a>) -> At<'a> {
        let dims = self.inner.dims();
        At {
            // Records may have more channels than the model has inputs.
            u: match self.memories.is_empty() {
                true => at.u,
                false => &at.u[..dims.nu],
            },
            p: &at.p[..dims.np],
            ..*at
        }
    }
}

/// The joints of each term that a request asks for.
fn places(model: &dyn Hessian, request: &Request) -> Result<Vec<Vec<usize>>, ExtendError> {
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
struct Added {
    params: Vec<ParamInfo>,
    inputs: Vec<InputInfo>,
    memories: Vec<Memory>,
    terms: Vec<Term>,
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
    fn place(
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
    fn remember(
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

fn jacobian_entries(term: &Term, dims: Dims) -> Vec<((u32, u32), Part)> {
    let mut entries = Vec::new();
    let depends = term.law.depends();
    for &row in &term.joints {
        entries.push((pair(row, dims.p() + term.coefficient), Part::Value));
        for i in (0..ARGUMENTS).filter(|&i| depends[i]) {
            for z in term.places(i, dims) {
                entries.push((pair(row, z), Part::Scaled(i)));
            }
        }
    }
    entries
}

fn hessian_entries(term: &Term, dims: Dims) -> Vec<((u32, u32), Part)> {
    let mut entries = Vec::new();
    let depends = term.law.depends();
    let used: Vec<(usize, usize)> = (0..ARGUMENTS)
        .filter(|&i| depends[i])
        .flat_map(|i| term.places(i, dims).into_iter().map(move |z| (i, z)))
        .collect();
    let c = dims.p() + term.coefficient;
    for &(i, z) in &used {
        entries.push((pair(c.max(z), c.min(z)), Part::Gradient(i)));
        if term.law.linear() {
            continue;
        }
        for &(j, y) in used.iter().filter(|(_, y)| *y <= z) {
            entries.push((pair(z, y), Part::Curvature(i, j)));
        }
    }
    entries
}

fn pair(row: usize, col: usize) -> (u32, u32) {
    (row as u32, col as u32)
}

impl Dynamics for Extended<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }
    fn dims(&self) -> Dims {
        self.dims
    }
    fn params(&self) -> &[ParamInfo] {
        &self.params
    }
    fn joints(&self) -> &[JointInfo] {
        self.inner.joints()
    }
    fn inputs(&self) -> &[InputInfo] {
        &self.inputs
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        self.inner.mass_matrix(&self.own(at), m);
        for term in self.terms.iter().filter(|t| t.law == Law::Armature) {
            let c = at.p[term.coefficient];
            for &i in &term.joints {
                for &j in term.joints.iter().filter(|&&j| j <= i) {
                    m[i * (i + 1) / 2 + j] += c;
                }
            }
        }
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        self.inner.bias(&self.own(at), b);
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        self.inner.applied_force(&self.own(at), f);
        for term in self.terms.iter().filter(|t| t.law != Law::Armature) {
            let force = term.force(at);
            term.joints.iter().for_each(|&j| f[j] -= force);
        }
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        self.inner.residual(&self.own(at), r);
        for term in &self.terms {
            let force = term.force(at);
            term.joints.iter().for_each(|&j| r[j] += force);
        }
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        let rotors: f64 = self
            .terms
            .iter()
            .filter(|t| t.law == Law::Armature)
            .map(|t| {
                let w: f64 = t.joints.iter().map(|&j| at.v[j]).sum();
                0.5 * at.p[t.coefficient] * w * w
            })
            .sum();
        self.inner.kinetic_energy(&self.own(at)) + rotors
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        self.inner.potential_energy(&self.own(at))
    }
}

impl Jacobian for Extended<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let own = self.jacobian.inner.len();
        self.inner
            .residual_jacobian(&self.own(at), r, &mut values[..own]);
        self.jacobian.spread(values);
        for (term, shares) in self.terms.iter().zip(&self.jacobian.shares) {
            let c = at.p[term.coefficient];
            let (value, gradient, _) = term.law.derivatives(term.arguments(at), term.rest);
            term.joints.iter().for_each(|&j| r[j] += c * value);
            for share in shares {
                values[share.slot] += match share.part {
                    Part::Value => value,
                    Part::Scaled(i) => c * gradient[i],
                    Part::Gradient(_) | Part::Curvature(..) => 0.0,
                };
            }
        }
    }
}

impl Hessian for Extended<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let own = self.hessian.inner.len();
        self.inner
            .residual_hessian(&self.own(at), lambda, &mut values[..own]);
        self.hessian.spread(values);
        for (term, shares) in self.terms.iter().zip(&self.hessian.shares) {
            let l: f64 = term.joints.iter().map(|&j| lambda[j]).sum();
            let c = at.p[term.coefficient];
            let (_, gradient, curvature) = term.law.derivatives(term.arguments(at), term.rest);
            for share in shares {
                values[share.slot] += l * match share.part {
                    Part::Gradient(i) => gradient[i],
                    Part::Curvature(i, j) => c * curvature[i][j],
                    Part::Value | Part::Scaled(_) => 0.0,
                };
            }
        }
    }
}

/// Position of the shape parameter among φ's arguments.
const _: () = assert!(SHAPE == ARGUMENTS - 1);
