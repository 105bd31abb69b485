//! Coupled drives: a robot in the coordinates of its drives.
//!
//! A drive on several joints turns by `w = Σ ratio·q + offset`. Friction and rotor act on w, so
//! that w and not q is the coordinate in which a robot with such drives has one drive per
//! coordinate. The joints then follow the drives.

use pid_derive::model::{Affine, Expr, Inertial, Joint, JointKind, Link, Motor, Robot};

use super::Nominal;
use super::error::DeclaredError;

/// Positions of drives in terms of positions of joints: `w = R q + o`.
#[derive(Debug, Clone, PartialEq)]
pub struct Drives {
    /// R, one row per drive.
    pub ratios: Vec<Vec<f64>>,
    /// o, rad or m.
    pub offsets: Vec<f64>,
    /// R⁻¹.
    inverse: Vec<Vec<f64>>,
}

impl Drives {
    /// Positions of the drives at positions `q` of the joints.
    ///
    /// # Panics
    /// If `q` has not one entry per joint.
    pub fn positions(&self, q: &[f64]) -> Vec<f64> {
        let w = self.velocities(q);
        w.iter().zip(&self.offsets).map(|(w, o)| w + o).collect()
    }

    /// Velocities of the drives at velocities `v` of the joints.
    ///
    /// # Panics
    /// If `v` has not one entry per joint.
    pub fn velocities(&self, v: &[f64]) -> Vec<f64> {
        assert_eq!(v.len(), self.ratios.len(), "one entry per joint");
        let row = |row: &Vec<f64>| row.iter().zip(v).map(|(r, v)| r * v).sum();
        self.ratios.iter().map(row).collect()
    }

    /// Standard deviations or steps of readings of the drives whose joints have these, taken as independent.
    pub(super) fn spread(&self, j: usize, of_joint: impl Fn(usize) -> Option<f64>) -> Option<f64> {
        let mut sum = 0.0;
        for (k, ratio) in self.ratios[j]
            .iter()
            .enumerate()
            .filter(|(_, r)| **r != 0.0)
        {
            sum += (ratio * of_joint(k)?).powi(2);
        }
        Some(sum.sqrt())
    }

    /// `Σ_k (R⁻¹)_jk (x_k − o_k)` with x the positions of the drives, or velocities without the offsets.
    fn joint(&self, j: usize, x: fn(usize) -> Expr, offset: bool) -> Expr {
        let row = &self.inverse[j];
        let mut sum: Option<Expr> = None;
        for (k, &s) in row.iter().enumerate().filter(|(_, s)| **s != 0.0) {
            let term = if s == 1.0 {
                x(k)
            } else {
                Expr::Mul(Box::new(Expr::Num(s)), Box::new(x(k)))
            };
            sum = Some(match sum {
                None => term,
                Some(sum) => Expr::Add(Box::new(sum), Box::new(term)),
            });
        }
        let sum = sum.unwrap_or(Expr::Num(0.0));
        match self.shift(j) {
            shift if offset && shift != 0.0 => Expr::Add(Box::new(sum), Box::new(Expr::Num(shift))),
            _ => sum,
        }
    }

    /// Position of joint `j` where all drives are at zero.
    fn shift(&self, j: usize) -> f64 {
        let terms = self.inverse[j].iter().zip(&self.offsets);
        -terms.map(|(s, o)| s * o).sum::<f64>()
    }

    fn expression(&self, x: &Expr) -> Expr {
        with_motion(x, &|leaf| match leaf {
            Expr::Position(j) => self.joint(*j, Expr::Position, true),
            Expr::Velocity(j) => self.joint(*j, Expr::Velocity, false),
            leaf => leaf.clone(),
        })
    }

    /// An affine combination of joints as one of drives.
    fn affine(&self, affine: &Affine) -> Affine {
        let n = self.ratios.len();
        let mut terms: Vec<(usize, Expr)> = Vec::new();
        let mut offset = affine.offset.clone();
        for (j, ratio) in &affine.terms {
            let scaled = |s: f64| Expr::Mul(Box::new(Expr::Num(s)), Box::new(ratio.clone()));
            for k in (0..n).filter(|&k| self.inverse[*j][k] != 0.0) {
                let term = scaled(self.inverse[*j][k]);
                match terms.iter_mut().find(|(i, _)| *i == k) {
                    Some((_, sum)) => {
                        *sum = Expr::Add(Box::new(sum.clone()), Box::new(term));
                    }
                    None => terms.push((k, term)),
                }
            }
            if self.shift(*j) != 0.0 {
                offset = Expr::Add(Box::new(offset), Box::new(scaled(self.shift(*j))));
            }
        }
        Affine { terms, offset }
    }
}

/// The robot in the coordinates of its drives; the drive of coordinate k is the one that input k feeds.
///
/// # Errors
/// If a drive has no input, two drives have the same, a ratio is no number, or the ratios are singular.
pub(super) fn in_drives(robot: &Robot) -> Result<(Robot, Drives), DeclaredError> {
    let structure = |what: String| DeclaredError::Structure {
        robot: robot.name.clone(),
        what,
    };
    let n = robot.nq();
    let mut ratios: Vec<Vec<f64>> = (0..n).map(|i| unit(n, i)).collect();
    let mut offsets = vec![0.0; n];
    let mut owners: Vec<Option<usize>> = vec![None; n];
    for (m, motor) in robot.motors.iter().enumerate() {
        let number = |x: &Expr| {
            number(robot, x).ok_or_else(|| {
                structure(format!(
                    "has a drive `{}` whose ratio is not fixed",
                    motor.name
                ))
            })
        };
        let input = motor.force.as_ref().and_then(first_input);
        let own = input.filter(|&k| k < n).ok_or_else(|| {
            structure(format!(
                "has a drive `{}` without an input of its own",
                motor.name
            ))
        })?;
        if owners[own].replace(m).is_some() {
            return Err(structure(format!(
                "has two drives with the input `{}`",
                robot.inputs[own].name
            )));
        }
        let mut row = vec![0.0; n];
        for (j, ratio) in &motor.moves.terms {
            row[*j] = number(ratio)?;
        }
        (ratios[own], offsets[own]) = (row, number(&motor.moves.offset)?);
    }
    let inverse = inverse(&ratios)
        .ok_or_else(|| structure("has drives that do not move all joints".to_owned()))?;
    let drives = Drives {
        ratios,
        offsets,
        inverse,
    };
    Ok((rewritten(robot, &drives, &owners), drives))
}

fn rewritten(robot: &Robot, drives: &Drives, owners: &[Option<usize>]) -> Robot {
    let n = owners.len();
    let mut new = robot.clone();
    let mapped = |x: &Option<Expr>| x.as_ref().map(|x| drives.expression(x));
    new.potential = mapped(&robot.potential);
    new.lagrangian = mapped(&robot.lagrangian);
    new.joints.clear();
    let mut places = Vec::with_capacity(robot.joints.len());
    for joint in &robot.joints {
        let mut joint = Joint {
            force: mapped(&joint.force),
            follows: joint.follows.as_ref().map(|f| drives.affine(f)),
            ..joint.clone()
        };
        let mut own = Vec::new();
        if let Some(j) = joint.coord
            && robot.lagrangian.is_none()
            && (drives.inverse[j] != unit(n, j) || drives.offsets[j] != 0.0)
        {
            own.push(new.joints.len());
            let name = owners[j].map_or_else(
                || format!("drive_{}", joint.name),
                |m| robot.motors[m].name.clone(),
            );
            new.joints.push(shaft(&mut new.links, &joint, name));
            joint.follows = Some(drives.affine(&Affine {
                terms: vec![(j, Expr::Num(1.0))],
                offset: Expr::Num(0.0),
            }));
            (joint.coord, joint.limits) = (None, None);
        }
        own.push(new.joints.len());
        new.joints.push(joint);
        places.push(own);
    }
    new.order = robot
        .order
        .iter()
        .flat_map(|&k| places[k].clone())
        .collect();
    for (k, owner) in owners.iter().enumerate() {
        if let Some(m) = *owner {
            new.motors[m] = Motor {
                moves: Affine {
                    terms: vec![(k, Expr::Num(1.0))],
                    offset: Expr::Num(0.0),
                },
                force: mapped(&robot.motors[m].force),
                ..robot.motors[m].clone()
            };
        }
    }
    new
}

/// A joint on the base that turns as a drive does and carries nothing.
fn shaft(links: &mut Vec<Link>, joint: &Joint, name: String) -> Joint {
    links.push(Link {
        name: format!("shaft_{name}"),
        docs: Vec::new(),
        inertial: Inertial::None,
    });
    let axis = [0.0, 0.0, 1.0];
    let zero = || [0.0; 3].map(Expr::Num);
    Joint {
        name,
        docs: Vec::new(),
        kind: match joint.kind.is_length() {
            true => JointKind::Prismatic(axis),
            false => JointKind::Revolute(axis),
        },
        coord: joint.coord,
        follows: None,
        parent: None,
        child: links.len() - 1,
        origin: zero(),
        rpy: zero(),
        limits: None,
        armature: None,
        force: None,
    }
}

/// An expression with others in place of its positions and velocities.
fn with_motion(x: &Expr, leaf: &impl Fn(&Expr) -> Expr) -> Expr {
    let of = |x: &Expr| Box::new(with_motion(x, leaf));
    match x {
        Expr::Position(_) | Expr::Velocity(_) => leaf(x),
        Expr::Num(_) | Expr::Param(_) | Expr::Input(_) | Expr::Blank(_) => x.clone(),
        Expr::Neg(x) => Expr::Neg(of(x)),
        Expr::Add(x, y) => Expr::Add(of(x), of(y)),
        Expr::Sub(x, y) => Expr::Sub(of(x), of(y)),
        Expr::Mul(x, y) => Expr::Mul(of(x), of(y)),
        Expr::Div(x, y) => Expr::Div(of(x), of(y)),
        Expr::Powi(x, n) => Expr::Powi(of(x), *n),
        Expr::Call(f, x) => Expr::Call(*f, of(x)),
    }
}

impl Nominal {
    /// The description's robot in the coordinates of its joints: that of [`Nominal::robot`], except
    /// where drives move several joints. Then it is the declaration with the description's values
    /// and drives; `declared` is the one that the description was made of.
    pub fn robot_in_joints(&self, declared: &Robot) -> Robot {
        if self.drives.is_none() {
            return self.robot.clone();
        }
        let mut robot = declared.clone();
        robot.params.clone_from(&self.robot.params);
        robot.inputs.clone_from(&self.robot.inputs);
        for joint in &mut robot.joints {
            joint.force = None;
        }
        for motor in &mut robot.motors {
            motor.force = None;
        }
        for drive in self.robot.joints.iter().filter(|j| j.coord.is_some()) {
            let owner = (self.robot.motors.iter())
                .position(|m| m.moves.terms.first().map(|t| t.0) == drive.coord);
            match owner {
                Some(m) => {
                    let moves = robot.motors[m].moves.clone();
                    let force = drive.force.as_ref().map(|f| along(f, &moves));
                    robot.motors[m].force = force;
                }
                None => {
                    let mut own = robot.joints.iter_mut();
                    if let Some(joint) = own.find(|j| j.coord == drive.coord) {
                        joint.force.clone_from(&drive.force);
                    }
                }
            }
        }
        robot
    }
}

/// A law of a drive's own motion in terms of the joints that it moves.
fn along(law: &Expr, moves: &Affine) -> Expr {
    let sum = |of: fn(usize) -> Expr| {
        let terms = moves.terms.iter().map(|(j, ratio)| match ratio {
            Expr::Num(1.0) => of(*j),
            ratio => Expr::Mul(Box::new(ratio.clone()), Box::new(of(*j))),
        });
        terms.reduce(|a, b| Expr::Add(Box::new(a), Box::new(b)))
    };
    let zero = || Expr::Num(0.0);
    with_motion(law, &|leaf| match leaf {
        Expr::Position(_) => {
            let sum = sum(Expr::Position).unwrap_or_else(zero);
            Expr::Add(Box::new(sum), Box::new(moves.offset.clone()))
        }
        _ => sum(Expr::Velocity).unwrap_or_else(zero),
    })
}

fn unit(n: usize, i: usize) -> Vec<f64> {
    (0..n).map(|j| f64::from(u8::from(i == j))).collect()
}

/// An expression of numbers and fixed parameters.
fn number(robot: &Robot, x: &Expr) -> Option<f64> {
    let of = |x: &Expr| number(robot, x);
    Some(match x {
        Expr::Num(x) => *x,
        Expr::Param(k) => robot.params.get(*k).filter(|p| p.fixed)?.nominal,
        Expr::Neg(x) => -of(x)?,
        Expr::Add(x, y) => of(x)? + of(y)?,
        Expr::Sub(x, y) => of(x)? - of(y)?,
        Expr::Mul(x, y) => of(x)? * of(y)?,
        Expr::Div(x, y) => of(x)? / of(y)?,
        Expr::Powi(x, n) => of(x)?.powi(*n),
        Expr::Input(_)
        | Expr::Position(_)
        | Expr::Velocity(_)
        | Expr::Blank(_)
        | Expr::Call(..) => {
            return None;
        }
    })
}

/// The first input that an expression reads.
fn first_input(x: &Expr) -> Option<usize> {
    match x {
        Expr::Input(k) => Some(*k),
        Expr::Num(_) | Expr::Param(_) | Expr::Position(_) | Expr::Velocity(_) | Expr::Blank(_) => {
            None
        }
        Expr::Neg(x) | Expr::Powi(x, _) | Expr::Call(_, x) => first_input(x),
        Expr::Add(x, y) | Expr::Sub(x, y) | Expr::Mul(x, y) | Expr::Div(x, y) => {
            first_input(x).or_else(|| first_input(y))
        }
    }
}

/// Inverse of a small matrix by elimination with row exchange; `None` if it is singular.
fn inverse(a: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let n = a.len();
    let mut left = a.to_vec();
    let mut right: Vec<Vec<f64>> = (0..n).map(|i| unit(n, i)).collect();
    for c in 0..n {
        let pivot = (c..n).max_by(|&i, &j| left[i][c].abs().total_cmp(&left[j][c].abs()))?;
        if left[pivot][c].abs() < 1e-9 {
            return None;
        }
        left.swap(c, pivot);
        right.swap(c, pivot);
        let scale = left[c][c];
        for x in left[c].iter_mut().chain(&mut right[c]) {
            *x /= scale;
        }
        for i in (0..n).filter(|&i| i != c) {
            let factor = left[i][c];
            if factor != 0.0 {
                for k in 0..n {
                    left[i][k] -= factor * left[c][k];
                    right[i][k] -= factor * right[c][k];
                }
            }
        }
    }
    Some(right)
}
