//! The robots of a study: five families, sizes from a seed.

use pid_interpret::nominal::{Nominal, NominalError};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::motion::{LENGTH, Room};
use crate::plant::{PER_JOINT, Plant};
use crate::robot::{Joint, Robot, Tolerance};
use crate::text;

/// Range of the drive noise, share of the largest usual torque.
const DRIVE_NOISE: (f64, f64) = (0.0012, 0.006);

/// What a robot is built like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Family {
    /// One hinge.
    Pendulum,
    /// Two hinges in a plane.
    PlanarArm,
    /// A slide with a hinge.
    Slide,
    /// A chain of three to six spatial hinges.
    Arm(usize),
    /// Hip roll, hip pitch and knee; its links hang.
    Leg,
}

impl Family {
    /// The `number`-th of those with as many joints as are wanted, or the last of them.
    pub(crate) fn of(number: usize, (fewest, most): (usize, usize)) -> Self {
        let most = most.clamp(1, 6);
        let number = match fewest {
            0 | 1 => number.min(most - 1),
            2 => number.clamp(1, most.max(2) - 1),
            _ => 3,
        };
        match number {
            0 => Self::Pendulum,
            1 => Self::PlanarArm,
            2 => Self::Slide,
            _ => Self::Arm(most.max(3)),
        }
    }
}

/// A robot of a family.
///
/// # Errors
/// If what is drawn is no robot; none is known.
pub(crate) fn draw(family: Family, random: &mut ChaCha8Rng) -> Result<Robot, NominalError> {
    let (axes, planar) = axes(family);
    let hangs = planar || family == Family::Leg;
    let n = axes.len();
    let mut scale = random.random_range(1.0..8.0);
    let mut joints = Vec::new();
    for (k, (prismatic, axis)) in axes.into_iter().enumerate() {
        joints.push(joint(k, (prismatic, axis), hangs, scale, random));
        scale *= 0.6;
    }
    let mut robot = Robot {
        joints,
        tool: [0.0, 0.0, if hangs { -0.35 } else { 0.2 }],
        planar,
        rate: [250.0, 400.0, 500.0, 1000.0][random.random_range(0..4usize)],
        horizon: if n == 1 { LENGTH } else { 2.0 },
        drive_noise: random
            .random_range(DRIVE_NOISE.0.ln()..DRIVE_NOISE.1.ln())
            .exp(),
        length: LENGTH,
        tolerance: Tolerance::TIGHT,
    };
    size_drives(&mut robot, random)?;
    Ok(robot)
}

/// Hinges and slides of a family, base to tip, and whether they move in one plane: whether each
/// slides, and its axis.
fn axes(family: Family) -> (Vec<(bool, [f64; 3])>, bool) {
    let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let hinges = |axes: &[[f64; 3]]| axes.iter().map(|axis| (false, *axis)).collect();
    match family {
        Family::Pendulum => (hinges(&[y]), true),
        Family::PlanarArm => (hinges(&[y, y]), true),
        Family::Slide => (vec![(true, x), (false, y)], true),
        Family::Arm(most) => (hinges(&[z, y, y, z, y, z][..most]), false),
        Family::Leg => (hinges(&[x, y, y]), false),
    }
}

/// The `k`-th joint with its link, of about `scale` kg; the drive has no size yet.
fn joint(
    k: usize,
    (prismatic, axis): (bool, [f64; 3]),
    hangs: bool,
    scale: f64,
    random: &mut ChaCha8Rng,
) -> Joint {
    let length = random.random_range(0.3..0.45);
    let mass = scale * random.random_range(0.8..1.2);
    let transverse = mass * length * length / 12.0;
    let (height, middle) = match (prismatic, hangs) {
        (true, _) => (0.0, 0.0),
        (false, true) => (-length, -0.45 * length),
        (false, false) => (length, 0.45 * length),
    };
    Joint {
        prismatic,
        axis,
        origin: [0.0, 0.0, if k == 0 { 0.8 } else { height }],
        mass,
        com: [0.0, 0.0, middle],
        inertia: [transverse, transverse * 1.03, 0.1 * transverse],
        rotor: 0.0,
        coulomb: 0.0,
        viscous: 0.0,
        gain: random.random_range(1.5..12.0),
        torque: 0.0,
        q_noise: random.random_range(3e-5..1e-4),
        q_step: random.random_range(1e-5..8e-5),
        v_noise: random.random_range(5e-3..1.5e-2),
        room: Room {
            centre: if prismatic {
                0.0
            } else {
                random.random_range(0.1..0.5)
            },
            amplitude: if prismatic {
                0.35
            } else {
                random.random_range(0.8..1.2)
            },
            speed: if prismatic {
                1.5
            } else {
                random.random_range(3.0..5.0)
            },
            frequency: random.random_range(1.5..2.2),
        },
        length: if prismatic { 0.35 } else { 1.0 },
    }
}

/// Rotors, friction and torques in proportion to what the joint moves.
fn size_drives(robot: &mut Robot, random: &mut ChaCha8Rng) -> Result<(), NominalError> {
    let n = robot.joints.len();
    let bare = Nominal::parse("nominal.toml", &text::nominal(robot, None, "derived"))?;
    let plant = Plant::<f64>::new(&bare, &vec![0.0; n * PER_JOINT]);
    let q: Vec<f64> = robot.joints.iter().map(|j| j.room.centre).collect();
    let (m, _) = plant.mass_and_bias(&q, &vec![0.0; n]);
    let far: Vec<f64> = robot
        .joints
        .iter()
        .map(|j| j.room.centre + 0.8 * j.room.amplitude)
        .collect();
    let (_, weight) = plant.mass_and_bias(&far, &vec![0.0; n]);
    for (k, j) in robot.joints.iter_mut().enumerate() {
        j.rotor = m[(k, k)] * random.random_range(0.15..0.35);
        let turning = (m[(k, k)] + j.rotor) * 3.0 * j.room.speed;
        j.torque = weight[k].abs() + turning;
        j.coulomb = j.torque * random.random_range(0.03..0.07);
        j.viscous = j.torque / j.room.speed * random.random_range(0.05..0.12);
        if j.prismatic {
            j.q_noise *= 0.4;
            j.q_step *= 0.3;
            j.v_noise *= 0.35;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Joints of the robots for all drawn numbers.
    fn joints(wanted: (usize, usize)) -> Vec<usize> {
        let count = |number| axes(Family::of(number, wanted)).0.len();
        (0..4).map(count).collect()
    }

    #[test]
    fn robots_have_as_many_joints_as_are_wanted() {
        assert_eq!(joints((1, 1)), [1, 1, 1, 1]);
        assert_eq!(joints((1, 3)), [1, 2, 2, 2]);
        assert_eq!(joints((1, 5)), [1, 2, 2, 5]);
        assert_eq!(joints((2, 2)), [2, 2, 2, 2]);
        assert_eq!(joints((3, 3)), [3, 3, 3, 3]);
        assert_eq!(joints((6, 6)), [6, 6, 6, 6]);
        assert_eq!(axes(Family::Leg).0.len(), 3);
    }
}
