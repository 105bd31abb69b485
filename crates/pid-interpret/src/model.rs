//! The model of a robot that is known at run time.

use std::borrow::Cow;
use std::fmt;
use std::sync::OnceLock;

use num_dual::DualNum;
use pid_derive::identifiability::{Group, Structures};
use pid_derive::model::{Emit, Joint, Robot};
use pid_derive::{Equations, derivatives, equations, facts};
use pid_runtime::dynamics::{
    At, Dims, Dynamics, Hessian, Identifiability, InputInfo, Jacobian, JointInfo, ParamInfo,
    Pattern, SingularMassMatrix, StructuralRank,
};
use pid_runtime::generic::{GenericDynamics, cholesky_solve};
use pid_runtime::lanes::{Lane, LanesAt};
use pid_symbolic::diff::Entry;
use pid_symbolic::{Graph, Id, Tape};

use crate::check;
use crate::error::Error;
use crate::function::Function;

/// A robot as programs on its expression graph.
///
/// Values and first derivatives are derived when the model is made. Second derivatives and ranks
/// are derived at their first use: they cost several times as much, and most uses never need them.
///
/// Evaluation allocates nothing after the first call on a thread. Like the generated models,
/// functions panic if a slice they read has another length than [`Dims`] says.
pub struct Model {
    name: String,
    dims: Dims,
    params: Vec<ParamInfo>,
    joints: Vec<JointInfo>,
    inputs: Vec<InputInfo>,
    graph: Graph,
    equations: Equations,
    residual: Function,
    mass_matrix: Function,
    bias: Function,
    applied_force: Function,
    kinetic_energy: Function,
    potential_energy: Function,
    /// r, then ∂r/∂z.
    jacobian: Derivative,
    /// ∂²(λᵀr)/∂z².
    hessian: OnceLock<Derivative>,
    /// Ranks of the parameters; the robot they are of.
    identifiability: OnceLock<Option<Identifiability>>,
    robot: Robot,
    residual_dual: Tape,
    /// Lower triangle of M, then f_L − b.
    forward_dual: Tape,
}

/// Values of derivatives and their places.
struct Derivative {
    rows: Vec<u32>,
    cols: Vec<u32>,
    function: Function,
}

impl Derivative {
    /// `before` are written ahead of the entries.
    fn new(g: &Graph, dims: Dims, before: &[Id], entries: &[Entry]) -> Self {
        let place = |x: usize| u32::try_from(x).expect("a position in z, far below 2³²");
        let outputs: Vec<Id> = before
            .iter()
            .copied()
            .chain(entries.iter().map(|entry| entry.value))
            .collect();
        Self {
            rows: entries.iter().map(|entry| place(entry.row)).collect(),
            cols: entries.iter().map(|entry| place(entry.col)).collect(),
            function: Function::new(g, dims, &outputs),
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.rows,
            cols: &self.cols,
        }
    }
}

impl Model {
    /// Derives the equations of a robot and makes them ready for evaluation.
    ///
    /// Everything is derived, whatever the robot's `emit` says.
    ///
    /// # Errors
    /// If the robot contradicts itself, has no moving joint, a singular mass matrix, or equations
    /// that are finite nowhere.
    pub fn new(robot: &Robot) -> Result<Self, Error> {
        check::check(robot).map_err(|fault| Error::Malformed {
            robot: robot.name.clone(),
            fault,
        })?;
        let dims = Dims {
            nq: robot.nq(),
            nu: robot.inputs.len(),
            np: robot.params.len(),
        };
        if dims.nq == 0 {
            return Err(Error::NothingMoves {
                robot: robot.name.clone(),
            });
        }
        let mut g = Graph::new();
        let equations = equations(&mut g, robot)?;
        let moving = moving(robot);
        let facts = facts(robot);
        if let Some(coord) = facts.velocity_in_mass {
            return Err(Error::VelocityInMass {
                robot: robot.name.clone(),
                coordinate: moving[coord].name.clone(),
            });
        }
        if let Some(coord) = facts.singular_mass {
            return Err(Error::SingularMass {
                robot: robot.name.clone(),
                joint: moving[coord].name.clone(),
            });
        }
        let first = Emit {
            first_derivatives: true,
            second_derivatives: false,
            ..Emit::default()
        };
        let jacobian = derivatives(&mut g, &equations, first).jacobian;
        let net: Vec<Id> = equations
            .applied_force
            .iter()
            .zip(&equations.bias)
            .map(|(&force, &bias)| g.sub(force, bias))
            .collect();
        let forward: Vec<Id> = equations.mass_matrix.iter().copied().chain(net).collect();

        let function = |outputs: &[Id]| Function::new(&g, dims, outputs);
        Ok(Self {
            name: robot.name.clone(),
            dims,
            params: robot.params.iter().map(parameter).collect(),
            joints: moving.into_iter().map(joint).collect(),
            inputs: robot.inputs.iter().map(input).collect(),
            residual: function(&equations.residual),
            mass_matrix: function(&equations.mass_matrix),
            bias: function(&equations.bias),
            applied_force: function(&equations.applied_force),
            kinetic_energy: function(&[equations.energies.kinetic]),
            potential_energy: function(&[equations.energies.potential]),
            jacobian: Derivative::new(&g, dims, &equations.residual, &jacobian),
            hessian: OnceLock::new(),
            identifiability: OnceLock::new(),
            robot: robot.clone(),
            residual_dual: Tape::new(&g, &equations.residual),
            forward_dual: Tape::new(&g, &forward),
            graph: g,
            equations,
        })
    }

    fn second(&self) -> &Derivative {
        self.hessian.get_or_init(|| {
            let mut g = self.graph.clone();
            let both = Emit {
                first_derivatives: true,
                second_derivatives: true,
                ..Emit::default()
            };
            let entries = derivatives(&mut g, &self.equations, both).hessian;
            Derivative::new(&g, self.dims, &[], &entries)
        })
    }

    /// z as one list of dual numbers; parts that a caller leaves empty are zero.
    fn stacked<D: DualNum<Primitive = f64> + Copy>(&self, parts: [&[D]; 5]) -> Vec<D> {
        let d = self.dims;
        let mut z = vec![D::from(0.0); d.nz()];
        let starts = [0, d.v(), d.a(), d.u(), d.p()];
        for (part, start) in parts.into_iter().zip(starts) {
            z[start..start + part.len()].copy_from_slice(part);
        }
        z
    }
}

impl fmt::Debug for Model {
    /// Sizes: the programs of a six-axis arm have tens of thousands of instructions.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hessian = self.hessian.get().map(|h| h.function.size());
        f.debug_struct("Model")
            .field("name", &self.name)
            .field("dims", &self.dims)
            .field(
                "residual (instructions, runs, slots)",
                &self.residual.size(),
            )
            .field("jacobian", &self.jacobian.function.size())
            .field("hessian", &hessian)
            .finish_non_exhaustive()
    }
}

/// Moving joints in the order of their coordinates.
fn moving(robot: &Robot) -> Vec<&Joint> {
    let mut moving: Vec<&Joint> = robot.joints.iter().filter(|j| j.coord.is_some()).collect();
    moving.sort_by_key(|joint| joint.coord);
    moving
}

/// A rank with its groups as text.
fn structural(robot: &Robot, found: &Structures) -> StructuralRank {
    let groups = found.generic.groups.iter();
    let text = |group: &Group| Cow::Owned(group.text(|k| robot.params[k].name.clone()));
    StructuralRank {
        params: found.generic.params.len(),
        generic: found.generic.rank,
        nominal: found.nominal.rank,
        groups: Cow::Owned(groups.map(text).collect()),
    }
}

fn parameter(param: &pid_derive::model::Param) -> ParamInfo {
    let doc = param.docs.iter().map(|line| line.trim());
    ParamInfo {
        name: Cow::Owned(param.name.clone()),
        unit: Cow::Owned(param.unit.clone()),
        doc: Cow::Owned(
            doc.into_iter()
                .find(|line| !line.is_empty())
                .unwrap_or("")
                .to_owned(),
        ),
        nominal: param.nominal,
        lower: param.lower,
        upper: param.upper,
        fixed: param.fixed,
    }
}

fn joint(joint: &Joint) -> JointInfo {
    JointInfo {
        name: Cow::Owned(joint.name.clone()),
        prismatic: joint.kind.is_length(),
        limits: joint.limits,
    }
}

fn input(input: &pid_derive::model::Input) -> InputInfo {
    InputInfo {
        name: Cow::Owned(input.name.clone()),
        unit: Cow::Owned(input.unit.clone()),
        joint: input.coord,
    }
}

impl Dynamics for Model {
    fn name(&self) -> &str {
        &self.name
    }
    fn dims(&self) -> Dims {
        self.dims
    }
    fn params(&self) -> &[ParamInfo] {
        &self.params
    }
    fn joints(&self) -> &[JointInfo] {
        &self.joints
    }
    fn inputs(&self) -> &[InputInfo] {
        &self.inputs
    }
    /// Computed when it is asked for first.
    fn identifiability(&self) -> Option<&Identifiability> {
        let found = self.identifiability.get_or_init(|| {
            // The equations have been derived once, so they can be derived again.
            let found = pid_derive::identifiability(&self.robot).ok()?;
            Some(Identifiability {
                all: structural(&self.robot, &found.all),
                free: structural(&self.robot, &found.free),
            })
        });
        found.as_ref()
    }
    fn mass_matrix(&self, at: &At<'_>, m: &mut [f64]) {
        self.mass_matrix.eval(at, &[], [m]);
    }
    fn bias(&self, at: &At<'_>, b: &mut [f64]) {
        self.bias.eval(at, &[], [b]);
    }
    fn applied_force(&self, at: &At<'_>, f: &mut [f64]) {
        self.applied_force.eval(at, &[], [f]);
    }
    fn residual(&self, at: &At<'_>, r: &mut [f64]) {
        self.residual.eval(at, &[], [r]);
    }
    fn kinetic_energy(&self, at: &At<'_>) -> f64 {
        let mut out = [0.0];
        self.kinetic_energy.eval(at, &[], [&mut out]);
        out[0]
    }
    fn potential_energy(&self, at: &At<'_>) -> f64 {
        let mut out = [0.0];
        self.potential_energy.eval(at, &[], [&mut out]);
        out[0]
    }
    fn mass_matrix_lanes(&self, at: &LanesAt<'_>, m: &mut [Lane]) {
        self.mass_matrix.eval_lanes(at, &[], [m]);
    }
    fn applied_force_lanes(&self, at: &LanesAt<'_>, f: &mut [Lane]) {
        self.applied_force.eval_lanes(at, &[], [f]);
    }
    fn residual_lanes(&self, at: &LanesAt<'_>, r: &mut [Lane]) {
        self.residual.eval_lanes(at, &[], [r]);
    }
}

impl Jacobian for Model {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        self.jacobian.function.eval(at, &[], [r, values]);
    }
    fn residual_jacobian_lanes(&self, at: &LanesAt<'_>, r: &mut [Lane], values: &mut [Lane]) {
        self.jacobian.function.eval_lanes(at, &[], [r, values]);
    }
}

impl Hessian for Model {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.second().pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        self.second().function.eval(at, lambda, [values]);
    }
    fn residual_hessian_lanes(&self, at: &LanesAt<'_>, lambda: &[Lane], values: &mut [Lane]) {
        self.second().function.eval_lanes(at, lambda, [values]);
    }
}

impl GenericDynamics for Model {
    fn residual_generic<D: DualNum<Primitive = f64> + Copy>(
        &self,
        q: &[D],
        v: &[D],
        a: &[D],
        u: &[D],
        p: &[D],
        r: &mut [D],
    ) {
        self.residual_dual.eval(&self.stacked([q, v, a, u, p]), r);
    }

    fn vector_field_generic<D: DualNum<Primitive = f64> + Copy>(
        &self,
        q: &[D],
        v: &[D],
        u: &[D],
        p: &[D],
        a: &mut [D],
    ) -> Result<(), SingularMassMatrix> {
        let mut out = vec![D::from(0.0); self.dims.nm() + self.dims.nq];
        self.forward_dual
            .eval(&self.stacked([q, v, &[], u, p]), &mut out);
        let (m, f) = out.split_at_mut(self.dims.nm());
        cholesky_solve(m, f)?;
        a.copy_from_slice(f);
        Ok(())
    }
}
