//! The nominal description of declared robots that are no chain or tree of driven bodies: joints
//! that follow others, drives on several joints, a potential, a bare Lagrangian.
//!
//! Mass matrix and bias stay as declared; the unknowns of the mechanism are the declared parameters
//! themselves. The force on each coordinate must be of the form
//! `gain u − viscous v − coulomb s(v)`, as for a chain. A robot with drives on several joints is
//! described in the coordinates of its drives ([`Drives`]).

use std::path::{Path, PathBuf};

use pid_derive::equations::applied_force;
use pid_derive::links::links;
use pid_derive::model::{Input, Joint, Robot};
use pid_derive::{Blanks, Symbols};
use pid_symbolic::{Graph, Program, Tape};

use super::assemble::{DriveValues, Value, drive_force, drive_params};
use super::drives::{Drives, in_drives};
use super::error::{DeclaredError, NominalError};
use super::law::{At, Drive, Law};
use super::measured::{self, Driven};
use super::{Channel, Measurement, Nominal, Role, Tolerance};

/// Whether a robot is more than a chain or tree of driven bodies.
pub(super) fn needed(robot: &Robot) -> bool {
    let follows =
        |j: &Joint| j.coord.is_none() && j.follows.as_ref().is_some_and(|f| !f.terms.is_empty());
    robot.lagrangian.is_some()
        || robot.potential.is_some()
        || !robot.motors.is_empty()
        || robot.joints.iter().any(follows)
}

/// The description.
pub(super) fn nominal(
    declared: &Robot,
    measurement: Option<&Path>,
) -> Result<Nominal, NominalError> {
    let (robot, drives) = match declared.motors.is_empty() {
        true => (declared.clone(), None),
        false => {
            let (robot, drives) = in_drives(declared)?;
            (robot, Some(drives))
        }
    };
    let laws = Laws::new(&robot);
    let values = laws.values()?;
    let named = coordinates(declared).into_iter().zip(&values);
    let driven = named
        .map(|(joint, v)| Driven {
            name: joint.name.clone(),
            gain: v.gain.nominal,
        })
        .collect();
    let mut measurement = measured::of_declared(measurement, driven)?;
    if let Some(drives) = &drives {
        at_drives(&mut measurement, drives);
    }
    let tool_link = coordinates(declared).last().map(|joint| joint.child);
    let tool_link = tool_link.filter(|&link| link < robot.links.len());
    let (robot, tolerances) = with_drives(robot, &values, &measurement);
    Ok(Nominal {
        robot,
        tolerances,
        measurement,
        effects: Vec::new(),
        simulated: None,
        servos: Vec::new(),
        drive_models: Vec::new(),
        file: PathBuf::new(),
        tool_link,
        drives,
    })
}

/// A mechanism with the drives of these values in place of its own forces, and the tolerances of
/// all parameters.
pub(super) fn with_drives(
    mut robot: Robot,
    values: &[DriveValues],
    measurement: &Measurement,
) -> (Robot, Vec<Tolerance>) {
    let mut tolerances = mechanism(&robot, values);
    for joint in &mut robot.joints {
        joint.force = None;
    }
    for motor in &mut robot.motors {
        motor.force = None;
    }
    robot.inputs.clear();
    // Coordinates are numbered as the joints that have them.
    let places: Vec<usize> = (0..robot.joints.len())
        .filter(|&k| robot.joints[k].coord.is_some())
        .collect();
    for (index, (place, drive)) in places.into_iter().zip(values).enumerate() {
        let joint = &robot.joints[place];
        let (name, prismatic) = (joint.name.clone(), joint.kind.is_length());
        let mut drive = drive.clone();
        if drive.sharpness.is_infinite() {
            let channel = measurement.channels.get(index);
            drive.sharpness = measured::sharpness(channel.and_then(|c| c.speed_scale));
        }
        let [gain, coulomb, viscous, sharp] =
            drive_params(&mut robot, &mut tolerances, index, &name, prismatic, &drive);
        robot.inputs.push(Input {
            name: format!("u_{name}"),
            docs: Vec::new(),
            unit: drive.input_unit,
            coord: Some(index),
        });
        robot.joints[place].force = Some(drive_force(index, gain, coulomb, viscous, sharp));
    }
    (robot, tolerances)
}

/// Joints with a coordinate, by coordinate.
fn coordinates(robot: &Robot) -> Vec<&Joint> {
    let mut joints: Vec<&Joint> = robot.joints.iter().filter(|j| j.coord.is_some()).collect();
    joints.sort_by_key(|j| j.coord);
    joints
}

/// Readings of the drives from what is known of those of the joints.
fn at_drives(measurement: &mut Measurement, drives: &Drives) {
    let of_joints = measurement.channels.clone();
    for (j, channel) in measurement.channels.iter_mut().enumerate() {
        let of = |x: fn(&Channel) -> Option<f64>| drives.spread(j, |k| x(&of_joints[k]));
        channel.position_noise = of(|c| c.position_noise);
        channel.position_resolution = of(|c| c.position_resolution);
        channel.speed_scale = of(|c| c.speed_scale);
        if let super::Velocity::Measured { noise } = &mut channel.velocity {
            *noise = of(|c| match c.velocity {
                super::Velocity::Measured { noise } => noise,
                _ => None,
            });
        }
    }
}

/// Tolerances of the declared parameters: those that the mechanism does not read are exact.
fn mechanism(robot: &Robot, values: &[DriveValues]) -> Vec<Tolerance> {
    let mut g = Graph::new();
    let derived = links(&mut g, robot, None);
    let mut outputs = derived.values;
    outputs.extend(derived.mass_matrix);
    outputs.extend(derived.bias);
    let program = Program::new(&g, &outputs);
    let first = 3 * values.len() + robot.inputs.len();
    let tolerance = |(k, p): (usize, &pid_derive::model::Param)| {
        let read = program.reads(first + k..first + k + 1);
        let end = |end: f64| match end {
            x if x.is_finite() => (x - p.nominal).abs(),
            // An open range: as far as the value itself.
            _ => p.nominal.abs().max(1.0),
        };
        let mut half_width = end(p.lower).max(end(p.upper));
        // A mass stays one.
        if p.lower * p.nominal > 0.0 && p.upper * p.nominal > 0.0 {
            half_width = half_width.min((p.lower - p.nominal).abs().max(0.99 * p.nominal.abs()));
        }
        Tolerance {
            name: p.name.clone(),
            joint: None,
            role: Role::Declared,
            nominal: p.nominal,
            half_width: if p.fixed || !read { 0.0 } else { half_width },
        }
    };
    robot.params.iter().enumerate().map(tolerance).collect()
}

/// Forces on the coordinates as functions of motion, inputs and parameters.
struct Laws<'a> {
    robot: &'a Robot,
    joints: Vec<&'a Joint>,
    tape: Tape,
    params: usize,
    vars: usize,
}

impl<'a> Laws<'a> {
    fn new(robot: &'a Robot) -> Self {
        let mut g = Graph::new();
        let symbols = Symbols::new(&mut g, robot, Blanks::Zero);
        let forces = applied_force(&mut g, robot, &symbols);
        let nq = robot.nq();
        let params = 3 * nq + robot.inputs.len();
        Self {
            robot,
            joints: coordinates(robot),
            tape: Tape::new(&g, &forces),
            params,
            vars: params + robot.params.len() + nq,
        }
    }

    fn force(&self, p: &[f64], j: usize, at: &At) -> f64 {
        let nq = self.joints.len();
        let mut vars = vec![0.0; self.vars];
        vars[self.params..self.params + p.len()].copy_from_slice(p);
        for (from, entries) in [(0, &at.q), (nq, &at.v), (3 * nq, &at.u)] {
            for &(k, x) in entries {
                vars[from + k] = x;
            }
        }
        let mut out = vec![0.0; nq];
        self.tape.eval(&vars, &mut out);
        out[j]
    }

    /// The input of coordinate `j`: its own, or the one that moves it.
    fn input(&self, p: &[f64], j: usize) -> Option<usize> {
        let inputs = &self.robot.inputs;
        let rest = self.force(p, j, &At::default());
        let moves = |k: usize| {
            let at = At {
                u: vec![(k, 1.0)],
                ..At::default()
            };
            self.force(p, j, &at) != rest
        };
        (0..inputs.len())
            .find(|&k| inputs[k].coord == Some(j) && moves(k))
            .or_else(|| (0..inputs.len()).find(|&k| moves(k)))
    }

    fn drive<T>(&self, p: &[f64], j: usize, use_it: impl FnOnce(&Drive<'_>) -> T) -> T {
        use_it(&Drive {
            force: &|at| self.force(p, j, at),
            joint: j,
            input: self.input(p, j),
            joints: &self.joints.iter().map(|j| &*j.name).collect::<Vec<_>>(),
            inputs: &(self.robot.inputs.iter())
                .map(|u| &*u.name)
                .collect::<Vec<_>>(),
        })
    }

    fn values(&self) -> Result<Vec<DriveValues>, DeclaredError> {
        let p: Vec<f64> = self.robot.params.iter().map(|p| p.nominal).collect();
        (0..self.joints.len()).map(|j| self.value(&p, j)).collect()
    }

    fn value(&self, p: &[f64], j: usize) -> Result<DriveValues, DeclaredError> {
        let error = |what: String| DeclaredError::Law {
            robot: self.robot.name.clone(),
            joint: self.joints[j].name.clone(),
            what,
        };
        let input = self.input(p, j);
        if let Some(k) = input.filter(|&k| k != j) {
            return Err(error(format!(
                "its input `{}` is not the one of its place, {}",
                self.robot.inputs[k].name,
                j + 1
            )));
        }
        let law = self.drive(p, j, |drive| drive.law());
        let sharpness = self.drive(p, j, |drive| drive.check(law)).map_err(error)?;
        let list = |law: Law| [law.gain, law.coulomb, law.viscous];
        let nominal = list(law);
        let mut half = [0.0; 3];
        for (k, param) in self
            .robot
            .params
            .iter()
            .enumerate()
            .filter(|(_, p)| !p.fixed)
        {
            let mut change = [0.0_f64; 3];
            for end in [param.lower, param.upper] {
                let end = match end {
                    x if x.is_finite() => x,
                    x => param.nominal + param.nominal.abs().max(1.0).copysign(x),
                };
                let mut there = p.to_vec();
                there[k] = end;
                let at = list(self.drive(&there, j, |drive| drive.law()));
                for (c, (x, y)) in change.iter_mut().zip(at.into_iter().zip(nominal)) {
                    let d = (x - y).abs();
                    *c = c.max(if d.is_finite() { d } else { y.abs() });
                }
            }
            for (h, c) in half.iter_mut().zip(change) {
                *h += c;
            }
        }
        let value = |k: usize| Value {
            nominal: nominal[k],
            half_width: half[k],
        };
        let length = self.joints[j].kind.is_length();
        Ok(DriveValues {
            gain: match input {
                Some(_) => value(0),
                // A coordinate without drive: its input is zero in every record.
                None => Value {
                    nominal: 1.0,
                    half_width: 0.0,
                },
            },
            coulomb: value(1),
            viscous: value(2),
            sharpness,
            input_unit: match input {
                Some(k) => self.robot.inputs[k].unit.clone(),
                None => if length { "N" } else { "N*m" }.to_owned(),
            },
        })
    }
}
