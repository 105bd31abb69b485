//! The nominal description of a declared chain or tree of driven bodies: the values its bodies and
//! drives have at the nominal parameters, tolerances from the ranges of the parameters.
//!
//! Bodies are those of the derivation ([`Tree`]): links joined rigidly are one body, held joints
//! stand at their value. The drive of a joint must have the form
//! `gain u − viscous v − coulomb s(v)` with a transition s from −1 to 1. Gain and friction are read
//! off its values, so it may be written in any way. A value's tolerance is the sum of its changes
//! as each parameter goes to the farther end of its range, the others nominal.

use std::path::Path;

use pid_derive::kinematics::{Motion, Tree};
use pid_derive::model::{Joint, Robot};
use pid_derive::{Blanks, Symbols};
use pid_runtime::dynamics::Dynamics;
use pid_symbolic::{Graph, Id, Tape};

use super::Nominal;
use super::assemble::{Assembly, JointValues, Value};
use super::error::{DeclaredError, NominalError};
use super::general;
use super::law::{At, Drive, Law};
use super::measured::{self, Driven};

impl Nominal {
    /// The description of a declared robot. `measurement` is a file as `docs/nominal-format.md`
    /// describes. Without one, or if it does not exist, nothing is known of the measurement.
    ///
    /// # Errors
    /// If the model is no declared robot, its structure is not that of a nominal description (see
    /// [`DeclaredError`]), or the file is malformed.
    pub fn of_declared(
        model: &dyn Dynamics,
        measurement: Option<&Path>,
    ) -> Result<Self, NominalError> {
        let robot = declaration(model)?;
        if general::needed(&robot) {
            return general::nominal(&robot, measurement);
        }
        let chain = Chain::new(&robot)?;
        let values = chain.values()?;
        let driven = values
            .iter()
            .map(|joint| Driven {
                name: joint.name.clone(),
                gain: joint.gain.nominal,
            })
            .collect();
        let measurement = measured::of_declared(measurement, driven)?;
        let mut assembly = Assembly::new(robot.name.clone(), chain.gravity());
        for (mut joint, channel) in values.into_iter().zip(&measurement.channels) {
            if joint.sharpness.is_infinite() {
                joint.sharpness = measured::sharpness(channel.speed_scale);
            }
            assembly.joint(joint);
        }
        Ok(assembly.finish(measurement))
    }
}

/// The declaration a model was compiled from.
///
/// # Errors
/// If it has none, or one of another version of this crate.
pub fn declaration(model: &dyn Dynamics) -> Result<Robot, DeclaredError> {
    let text = model
        .declaration()
        .ok_or_else(|| DeclaredError::NotDeclared {
            robot: model.name().to_owned(),
        })?;
    serde_json::from_str(text).map_err(|e| DeclaredError::Unreadable {
        robot: model.name().to_owned(),
        message: e.to_string(),
    })
}

/// A body as numbers.
#[derive(Debug, Clone, Copy)]
struct Numbers {
    mass: f64,
    com: [f64; 3],
    inertia: [f64; 6],
    rotor: f64,
    law: Law,
}

/// A declared robot as a chain or tree of driven bodies, its values as functions of the parameters.
struct Chain<'a> {
    robot: &'a Robot,
    /// Moving joints in the order of coordinates.
    joints: Vec<&'a Joint>,
    /// Body of each of them in `parents`, and so on.
    parents: Vec<Option<usize>>,
    axes: Vec<(bool, [f64; 3])>,
    /// Input of each, if it has one.
    inputs: Vec<Option<usize>>,
    /// Outputs: gravity; per joint mass, first moment, tensor, armature, origin, rotation, force.
    tape: Tape,
    /// Place of the parameters among the variables, and number of variables.
    params: usize,
    vars: usize,
}

const GRAVITY: usize = 3;
const PER_JOINT: usize = 1 + 3 + 6 + 1 + 3 + 9 + 1;
const FORCE: usize = PER_JOINT - 1;

impl<'a> Chain<'a> {
    fn new(robot: &'a Robot) -> Result<Self, DeclaredError> {
        let name = || robot.name.clone();
        let structure = |what: String| {
            Err(DeclaredError::Structure {
                robot: name(),
                what,
            })
        };
        let mut joints: Vec<&Joint> = robot.joints.iter().filter(|j| j.coord.is_some()).collect();
        joints.sort_by_key(|j| j.coord);

        let mut g = Graph::new();
        let symbols = Symbols::new(&mut g, robot, Blanks::Zero);
        let tree = Tree::new(&mut g, robot, &symbols);
        // Bodies come parents first, joints as they were declared.
        let body_of = |coord: usize| {
            (tree.bodies.iter()).position(|b| b.rates.0.first().is_some_and(|r| r.0 == coord))
        };
        let coord_of = |body: usize| tree.bodies[body].rates.0[0].0;
        let (mut parents, mut axes, mut inputs) = (Vec::new(), Vec::new(), Vec::new());
        let mut outputs: Vec<Id> = tree.gravity.to_vec();
        for (coord, joint) in joints.iter().enumerate() {
            let Some(index) = body_of(coord) else {
                return structure(format!("has a joint `{}` that carries nothing", joint.name));
            };
            let body = &tree.bodies[index];
            parents.push(body.parent.map(coord_of));
            if parents[coord].is_some_and(|p| p >= coord) {
                return structure(format!(
                    "declares joint `{}` before the joint that carries it",
                    joint.name
                ));
            }
            let (prismatic, axis) = match body.motion {
                Motion::Revolute(axis) => (false, axis),
                Motion::Prismatic(axis) => (true, axis),
            };
            let mut number = [0.0; 3];
            Tape::new(&g, &axis).eval::<f64>(&[], &mut number);
            axes.push((prismatic, number));
            inputs.push((robot.inputs.iter()).position(|input| input.coord == Some(coord)));
            let inertia = &body.inertia;
            let t = &inertia.tensor;
            outputs.push(inertia.mass);
            outputs.extend(inertia.moment);
            outputs.extend([t[0][0], t[1][1], t[2][2], t[1][0], t[2][0], t[2][1]]);
            outputs.push(body.armature.unwrap_or_else(|| g.zero()));
            outputs.extend(body.frame.origin);
            outputs.extend(body.frame.rotation.iter().flatten());
            outputs.push(match &joint.force {
                Some(force) => symbols.expression(&mut g, force),
                None => g.zero(),
            });
        }
        let nq = joints.len();
        let params = 3 * nq + robot.inputs.len();
        Ok(Self {
            robot,
            parents,
            axes,
            inputs,
            tape: Tape::new(&g, &outputs),
            params,
            vars: params + robot.params.len() + nq,
            joints,
        })
    }

    /// All outputs at zero coordinates and given parameters, with the variables that `change` sets.
    fn eval(&self, p: &[f64], change: impl FnOnce(&mut [f64])) -> Vec<f64> {
        let mut vars = vec![0.0; self.vars];
        vars[self.params..self.params + p.len()].copy_from_slice(p);
        change(&mut vars);
        let mut out = vec![0.0; self.tape.outputs()];
        self.tape.eval(&vars, &mut out);
        out
    }

    fn nominal(&self) -> Vec<f64> {
        self.robot.params.iter().map(|p| p.nominal).collect()
    }

    fn gravity(&self) -> [f64; 3] {
        let out = self.eval(&self.nominal(), |_| {});
        [out[0], out[1], out[2]]
    }

    /// Force of joint `j` at a speed, an input and a position of joint `k`.
    fn force(&self, p: &[f64], j: usize, at: &At) -> f64 {
        let nq = self.joints.len();
        let out = self.eval(p, |vars| {
            for &(k, q) in &at.q {
                vars[k] = q;
            }
            for &(k, v) in &at.v {
                vars[nq + k] = v;
            }
            for &(k, u) in &at.u {
                vars[3 * nq + k] = u;
            }
        });
        out[GRAVITY + j * PER_JOINT + FORCE]
    }

    fn values(&self) -> Result<Vec<JointValues>, DeclaredError> {
        let p = self.nominal();
        let base = self.eval(&p, |_| {});
        let nominal = self.numbers(&p);
        let mut half: Vec<[f64; 14]> = vec![[0.0; 14]; nominal.len()];
        for (k, param) in self.robot.params.iter().enumerate() {
            if param.fixed {
                continue;
            }
            let mut change = vec![[0.0_f64; 14]; nominal.len()];
            for end in [param.lower, param.upper] {
                // An open range: as far as the value itself.
                let end = match end {
                    x if x.is_finite() => x,
                    x => param.nominal + param.nominal.abs().max(1.0).copysign(x),
                };
                let mut there = p.clone();
                there[k] = end;
                self.geometry_stays(&base, &there, k)?;
                for ((change, at), from) in
                    (change.iter_mut().zip(self.numbers(&there))).zip(&nominal)
                {
                    for ((c, x), y) in change.iter_mut().zip(at.list()).zip(from.list()) {
                        let d = (x - y).abs();
                        // Where the range is open, as far as the value itself.
                        *c = c.max(if d.is_finite() { d } else { y.abs() });
                    }
                }
            }
            for (half, change) in half.iter_mut().zip(&change) {
                for (h, c) in half.iter_mut().zip(change) {
                    *h += c;
                }
            }
        }
        (0..self.joints.len())
            .map(|j| self.joint(j, &p, &base, &nominal[j], &half[j]))
            .collect()
    }

    fn joint(
        &self,
        j: usize,
        p: &[f64],
        base: &[f64],
        nominal: &Numbers,
        half: &[f64; 14],
    ) -> Result<JointValues, DeclaredError> {
        let sharpness = self.check_law(j, p, nominal.law)?;
        let list = nominal.list();
        let value = |k: usize| Value {
            nominal: list[k],
            half_width: half[k],
        };
        let joint = self.joints[j];
        let (prismatic, axis) = self.axes[j];
        let at = |from: usize| GRAVITY + j * PER_JOINT + from;
        let r: [f64; 9] = std::array::from_fn(|k| base[at(14 + k)]);
        let input_unit = match self.inputs[j] {
            Some(k) => self.robot.inputs[k].unit.clone(),
            None => if prismatic { "N" } else { "N*m" }.to_owned(),
        };
        Ok(JointValues {
            name: joint.name.clone(),
            prismatic,
            axis,
            parent: self.parents[j],
            origin: std::array::from_fn(|k| base[at(11 + k)]),
            // R = Rz(yaw) Ry(pitch) Rx(roll), row by row.
            rpy: [
                r[7].atan2(r[8]),
                (-r[6]).clamp(-1.0, 1.0).asin(),
                r[3].atan2(r[0]),
            ],
            limits: joint.limits,
            mass: value(0),
            com: [1, 2, 3].map(value),
            inertia: [4, 5, 6, 7, 8, 9].map(value),
            rotor_inertia: value(10),
            gain: if self.inputs[j].is_some() {
                value(11)
            } else {
                // A joint without drive: its input is zero in every record.
                Value {
                    nominal: 1.0,
                    half_width: 0.0,
                }
            },
            coulomb: value(12),
            viscous: value(13),
            input_unit,
            sharpness,
        })
    }

    /// Lengths and placements are exact in a description: no free parameter may change them.
    fn geometry_stays(&self, base: &[f64], p: &[f64], k: usize) -> Result<(), DeclaredError> {
        let out = self.eval(p, |_| {});
        let moved = |from: usize, to: usize| {
            (from..to).any(|i| (out[i] - base[i]).abs() > 1e-12 * (1.0 + base[i].abs()))
        };
        let joint = (0..self.joints.len()).find(|j| {
            let at = GRAVITY + j * PER_JOINT;
            moved(at + 11, at + FORCE)
        });
        if joint.is_none() && !moved(0, GRAVITY) {
            return Ok(());
        }
        Err(DeclaredError::Geometry {
            robot: self.robot.name.clone(),
            parameter: self.robot.params[k].name.clone(),
            what: joint.map_or("gravity".to_owned(), |j| {
                format!("the place of joint `{}`", self.joints[j].name)
            }),
        })
    }

    fn numbers(&self, p: &[f64]) -> Vec<Numbers> {
        let out = self.eval(p, |_| {});
        (0..self.joints.len())
            .map(|j| {
                let x = &out[GRAVITY + j * PER_JOINT..];
                let mass = x[0];
                let com = [1, 2, 3].map(|k| if mass == 0.0 { 0.0 } else { x[k] / mass });
                let [c0, c1, c2] = com;
                let shift = [
                    c1 * c1 + c2 * c2,
                    c0 * c0 + c2 * c2,
                    c0 * c0 + c1 * c1,
                    -c0 * c1,
                    -c0 * c2,
                    -c1 * c2,
                ];
                Numbers {
                    mass,
                    com,
                    inertia: std::array::from_fn(|k| x[4 + k] - mass * shift[k]),
                    rotor: x[10],
                    law: self.drive(p, j, |drive| drive.law()),
                }
            })
            .collect()
    }

    /// The drive of joint `j` at given parameters.
    fn drive<T>(&self, p: &[f64], j: usize, use_it: impl FnOnce(&Drive<'_>) -> T) -> T {
        use_it(&Drive {
            force: &|at| self.force(p, j, at),
            joint: j,
            input: self.inputs[j],
            joints: &self.joints.iter().map(|j| &*j.name).collect::<Vec<_>>(),
            inputs: &(self.robot.inputs.iter())
                .map(|u| &*u.name)
                .collect::<Vec<_>>(),
        })
    }

    /// Whether the drive follows `law`, and the sharpness of its transition, infinite for a jump.
    fn check_law(&self, j: usize, p: &[f64], law: Law) -> Result<f64, DeclaredError> {
        self.drive(p, j, |drive| drive.check(law))
            .map_err(|what| DeclaredError::Law {
                robot: self.robot.name.clone(),
                joint: self.joints[j].name.clone(),
                what,
            })
    }
}

impl Numbers {
    /// mass, com, inertia, rotor, gain, coulomb, viscous.
    fn list(&self) -> [f64; 14] {
        let mut list = [0.0; 14];
        list[0] = self.mass;
        list[1..4].copy_from_slice(&self.com);
        list[4..10].copy_from_slice(&self.inertia);
        list[10] = self.rotor;
        list[11..].copy_from_slice(&[self.law.gain, self.law.coulomb, self.law.viscous]);
        list
    }
}
