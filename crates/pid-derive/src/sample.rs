//! Random points for comparisons and proofs. Seeds are fixed, so an expansion never changes from
//! run to run.

use pid_symbolic::random::Random;

use crate::model::{Param, Robot};

/// Values of all variables (`z`, λ, blanks) at a random point; parameters within their ranges.
pub fn point(robot: &Robot, random: &mut Random) -> Vec<f64> {
    let nq = robot.nq();
    let mut values = Vec::new();
    values.extend((0..nq).map(|_| random.uniform(-std::f64::consts::PI, std::f64::consts::PI)));
    values.extend((0..2 * nq + robot.inputs.len()).map(|_| random.uniform(-2.0, 2.0)));
    for param in &robot.params {
        values.push(parameter(param, random));
    }
    values.extend((0..nq + robot.blanks.len()).map(|_| random.uniform(-1.0, 1.0)));
    values
}

/// As [`point`], parameters at their nominal values.
pub fn nominal_point(robot: &Robot, random: &mut Random) -> Vec<f64> {
    let mut values = point(robot, random);
    let start = 3 * robot.nq() + robot.inputs.len();
    for (value, param) in values[start..].iter_mut().zip(&robot.params) {
        *value = param.nominal;
    }
    values
}

/// As [`point`], velocities of many magnitudes: friction changes within hundredths of a radian per second.
pub fn motion(robot: &Robot, random: &mut Random) -> Vec<f64> {
    let mut values = point(robot, random);
    let nq = robot.nq();
    for v in &mut values[nq..2 * nq] {
        let magnitude = 10.0_f64.powf(random.uniform(-3.5, 0.7));
        *v = magnitude.copysign(random.uniform(-1.0, 1.0));
    }
    values
}

/// Parameters within their ranges.
pub fn parameters(robot: &Robot, random: &mut Random) -> Vec<f64> {
    robot
        .params
        .iter()
        .map(|param| parameter(param, random))
        .collect()
}

/// How far a parameter may be expected to lie from its nominal value, in its unit; positive.
pub fn width(param: &Param) -> f64 {
    let range = 0.5 * (param.upper - param.lower);
    if range.is_finite() && range > 0.0 {
        range
    } else if param.nominal != 0.0 {
        param.nominal.abs()
    } else {
        1.0
    }
}

fn parameter(param: &Param, random: &mut Random) -> f64 {
    if param.lower.is_finite() && param.upper.is_finite() {
        return random.uniform(param.lower, param.upper);
    }
    let spread = if param.nominal == 0.0 {
        0.1
    } else {
        0.3 * param.nominal.abs()
    };
    let value = param.nominal + random.uniform(-spread, spread);
    value.clamp(param.lower, param.upper)
}
