//! Conditions that a robot must satisfy before it is derived. The checker of `robot!` and the
//! readers of files guarantee them; a robot put together by a program may break them.

use pid_derive::model::{Affine, Expr, Inertial, Joint, JointKind, Robot};
use thiserror::Error;

/// Axes are of unit length to this accuracy.
const UNIT: f64 = 1e-9;

/// How a robot contradicts itself.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Fault {
    /// An index beyond its list.
    #[error("{place} refers to {list}[{index}], but there are only {len}")]
    Index {
        /// Where the index stands: `joint j1`.
        place: String,
        /// List of the robot it points into.
        list: &'static str,
        /// The index.
        index: usize,
        /// Length of the list.
        len: usize,
    },
    /// A number that is not finite.
    #[error("{place} has the value {value}; give a finite number")]
    NotFinite {
        /// Where it stands.
        place: String,
        /// The number.
        value: f64,
    },
    /// `order` is not a permutation of the joints.
    #[error(
        "`order` must name each of the {joints} joints once; it has {len} entries, and joint `{joint}` {count} times"
    )]
    Order {
        /// Number of joints.
        joints: usize,
        /// Number of entries.
        len: usize,
        /// A joint that is named more or less than once.
        joint: String,
        /// How often it is named.
        count: usize,
    },
    /// A joint stands before the joint that carries its parent link.
    #[error(
        "joint `{joint}` hangs on link `{parent}`, which no joint before it in `order` carries; put the joint with child \
         `{parent}` first"
    )]
    ParentLater {
        /// The joint.
        joint: String,
        /// Its parent link.
        parent: String,
    },
    /// Two joints carry the same link.
    #[error(
        "link `{link}` is the child of joint `{joint}` and of another one; a link has one parent"
    )]
    TwoParents {
        /// The link.
        link: String,
        /// The second joint.
        joint: String,
    },
    /// A link that no joint carries.
    #[error("link `{link}` is not the child of any joint; add a joint that carries it")]
    Unreachable {
        /// The link.
        link: String,
    },
    /// Coordinates are not numbered as the moving joints.
    #[error(
        "joint `{joint}` has coordinate {found:?}; moving joints are numbered from 0 in the order of declaration, here {expected:?}"
    )]
    Coordinate {
        /// The joint.
        joint: String,
        /// The number it has.
        found: Option<usize>,
        /// The number it should have.
        expected: Option<usize>,
    },
    /// An axis that is not of unit length.
    #[error("the axis of joint `{joint}` has length {length}; it must be 1")]
    Axis {
        /// The joint.
        joint: String,
        /// Its length.
        length: f64,
    },
    /// A joint whose kind does not fit: coordinates of a Lagrangian have no axis, joints between
    /// links have one.
    #[error(
        "joint `{joint}` is a coordinate of a Lagrangian, but the robot has none, or the other way round; a robot has a \
         Lagrangian and coordinates of the kinds `Angle` and `Length`, or links and joints between them"
    )]
    Kind {
        /// The joint.
        joint: String,
    },
    /// A parameter whose nominal value is outside its range, or whose range is empty.
    #[error(
        "parameter `{name}` has the nominal value {nominal} and the range {lower}..={upper}; the value must lie in the range"
    )]
    Range {
        /// The parameter.
        name: String,
        /// Nominal value.
        nominal: f64,
        /// Lower end.
        lower: f64,
        /// Upper end.
        upper: f64,
    },
}

/// Checks a robot.
///
/// # Errors
/// The first fault found.
pub fn check(robot: &Robot) -> Result<(), Fault> {
    expressions(robot)?;
    for param in &robot.params {
        let (nominal, lower, upper) = (param.nominal, param.lower, param.upper);
        if !nominal.is_finite() {
            return Err(Fault::NotFinite {
                place: format!("the nominal value of parameter `{}`", param.name),
                value: nominal,
            });
        }
        // Written so that NaN is refused.
        if !(lower <= nominal && nominal <= upper) {
            return Err(Fault::Range {
                name: param.name.clone(),
                nominal,
                lower,
                upper,
            });
        }
    }
    let nq = robot.nq();
    for input in &robot.inputs {
        if let Some(coord) = input.coord {
            within(
                || format!("input `{}`", input.name),
                "coordinates",
                coord,
                nq,
            )?;
        }
    }
    if robot.lagrangian.is_some() {
        return coordinates(robot);
    }
    joints(robot)?;
    order(robot)
}

/// The coordinates of a Lagrangian.
fn coordinates(robot: &Robot) -> Result<(), Fault> {
    for (k, joint) in robot.joints.iter().enumerate() {
        if !matches!(joint.kind, JointKind::Angle | JointKind::Length) {
            return Err(Fault::Kind {
                joint: joint.name.clone(),
            });
        }
        coordinate(joint, Some(k))?;
    }
    Ok(())
}

fn coordinate(joint: &Joint, expected: Option<usize>) -> Result<(), Fault> {
    if joint.coord == expected {
        return Ok(());
    }
    Err(Fault::Coordinate {
        joint: joint.name.clone(),
        found: joint.coord,
        expected,
    })
}

fn joints(robot: &Robot) -> Result<(), Fault> {
    let mut next = 0;
    let mut carried = vec![false; robot.links.len()];
    for joint in &robot.joints {
        let place = || format!("joint `{}`", joint.name);
        within(place, "links", joint.child, robot.links.len())?;
        if let Some(parent) = joint.parent {
            within(place, "links", parent, robot.links.len())?;
        }
        if std::mem::replace(&mut carried[joint.child], true) {
            return Err(Fault::TwoParents {
                link: robot.links[joint.child].name.clone(),
                joint: joint.name.clone(),
            });
        }
        let expected = match joint.kind {
            JointKind::Fixed => None,
            JointKind::Angle | JointKind::Length => {
                return Err(Fault::Kind {
                    joint: joint.name.clone(),
                });
            }
            JointKind::Revolute(axis) | JointKind::Prismatic(axis) => {
                let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
                if length.is_nan() || (length - 1.0).abs() > UNIT {
                    return Err(Fault::Axis {
                        joint: joint.name.clone(),
                        length,
                    });
                }
                match joint.follows {
                    Some(_) => None,
                    None => {
                        next += 1;
                        Some(next - 1)
                    }
                }
            }
        };
        coordinate(joint, expected)?;
    }
    match carried.iter().position(|carried| !carried) {
        Some(link) => Err(Fault::Unreachable {
            link: robot.links[link].name.clone(),
        }),
        None => Ok(()),
    }
}

fn order(robot: &Robot) -> Result<(), Fault> {
    let mut count = vec![0; robot.joints.len()];
    for &joint in &robot.order {
        within(|| "`order`".to_owned(), "joints", joint, robot.joints.len())?;
        count[joint] += 1;
    }
    if let Some(joint) = count.iter().position(|&count| count != 1) {
        return Err(Fault::Order {
            joints: robot.joints.len(),
            len: robot.order.len(),
            joint: robot.joints[joint].name.clone(),
            count: count[joint],
        });
    }
    let mut carried = vec![false; robot.links.len()];
    for &joint in &robot.order {
        let joint = &robot.joints[joint];
        if let Some(parent) = joint.parent.filter(|&parent| !carried[parent]) {
            return Err(Fault::ParentLater {
                joint: joint.name.clone(),
                parent: robot.links[parent].name.clone(),
            });
        }
        carried[joint.child] = true;
    }
    Ok(())
}

fn within(
    place: impl Fn() -> String,
    list: &'static str,
    index: usize,
    len: usize,
) -> Result<(), Fault> {
    if index < len {
        return Ok(());
    }
    Err(Fault::Index {
        place: place(),
        list,
        index,
        len,
    })
}

fn expressions(robot: &Robot) -> Result<(), Fault> {
    let check = |place: &str, exprs: &[&Expr]| {
        exprs
            .iter()
            .try_for_each(|expr| expression(robot, place, expr))
    };
    check("gravity", &robot.gravity.each_ref())?;
    for link in &robot.links {
        let place = format!("link `{}`", link.name);
        let (mass, vector, inertia) = match &link.inertial {
            Inertial::None => continue,
            Inertial::Body {
                mass, com, inertia, ..
            } => (mass, com, inertia),
            Inertial::Linear {
                mass,
                first_moment,
                inertia,
            } => (mass, first_moment, inertia),
        };
        check(&place, &[mass])?;
        check(&place, &vector.each_ref())?;
        let t = inertia;
        check(&place, &[&t.xx, &t.yy, &t.zz, &t.xy, &t.xz, &t.yz])?;
    }
    for joint in &robot.joints {
        let place = format!("joint `{}`", joint.name);
        check(&place, &joint.origin.each_ref())?;
        check(&place, &joint.rpy.each_ref())?;
        for expr in joint.armature.iter().chain(&joint.force) {
            check(&place, &[expr])?;
        }
        if let Some(follows) = &joint.follows {
            affine(robot, &place, follows)?;
        }
    }
    for motor in &robot.motors {
        let place = format!("drive `{}`", motor.name);
        affine(robot, &place, &motor.moves)?;
        for expr in motor.armature.iter().chain(&motor.force) {
            check(&place, &[expr])?;
        }
    }
    for expr in robot.potential.iter().chain(&robot.lagrangian) {
        check("the potential or the Lagrangian", &[expr])?;
    }
    Ok(())
}

fn affine(robot: &Robot, place: &str, affine: &Affine) -> Result<(), Fault> {
    for (coord, ratio) in &affine.terms {
        within(|| place.to_owned(), "coordinates", *coord, robot.nq())?;
        expression(robot, place, ratio)?;
    }
    expression(robot, place, &affine.offset)
}

fn expression(robot: &Robot, place: &str, expr: &Expr) -> Result<(), Fault> {
    let index = |list, index, len| within(|| place.to_owned(), list, index, len);
    match expr {
        Expr::Num(value) if !value.is_finite() => Err(Fault::NotFinite {
            place: place.to_owned(),
            value: *value,
        }),
        Expr::Num(_) => Ok(()),
        Expr::Param(k) => index("params", *k, robot.params.len()),
        Expr::Input(k) => index("inputs", *k, robot.inputs.len()),
        Expr::Position(k) | Expr::Velocity(k) => index("coordinates", *k, robot.nq()),
        Expr::Blank(k) => index("blanks", *k, robot.blanks.len()),
        Expr::Neg(x) | Expr::Powi(x, _) | Expr::Call(_, x) => expression(robot, place, x),
        Expr::Add(x, y) | Expr::Sub(x, y) | Expr::Mul(x, y) | Expr::Div(x, y) => {
            expression(robot, place, x)?;
            expression(robot, place, y)
        }
    }
}
