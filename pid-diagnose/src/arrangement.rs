//! What of a robot's geometry decides whether two effects are the same map from inputs to readings.

use nalgebra::{Matrix3, Vector3};

use crate::effect::Arrangement;
use crate::nominal::Nominal;

impl Arrangement {
    /// Of a robot as described.
    pub fn of(nominal: &Nominal) -> Self {
        Arrangement {
            joints: nominal.joints.len(),
            one_axis: about_one_horizontal_axis(nominal),
        }
    }
}

/// Largest sine of an angle that counts as none: descriptions state axes to more figures.
const PARALLEL: f64 = 1e-6;

/// Whether all joints turn, about axes that are parallel to each other and across gravity.
fn about_one_horizontal_axis(nominal: &Nominal) -> bool {
    let mut rotations: Vec<Matrix3<f64>> = Vec::with_capacity(nominal.joints.len());
    let mut first: Option<Vector3<f64>> = None;
    for joint in &nominal.joints {
        let hinge = &joint.hinge;
        let own = Matrix3::from_fn(|i, k| hinge.rotation[i][k]);
        let rotation = match hinge.parent.and_then(|p| rotations.get(p)) {
            Some(parent) => parent * own,
            None => own,
        };
        // Joints before it turn about the same axis: its direction at q = 0 is its direction always.
        let axis = rotation * Vector3::from(hinge.axis);
        rotations.push(rotation);
        let parallel = first.get_or_insert(axis).cross(&axis).norm() < PARALLEL;
        if !hinge.revolute || !parallel {
            return false;
        }
    }
    let gravity = Vector3::from(nominal.gravity);
    first.is_some_and(|axis| axis.dot(&gravity).abs() <= PARALLEL * gravity.norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::pendulum;
    use crate::simulate::Hypothesis;

    #[test]
    fn a_pendulum_turns_about_one_horizontal_axis_and_a_waist_does_not() {
        let mut nominal = pendulum(&Hypothesis::default(), &[], 0.2, &|_| {}).nominal;
        let swings = Arrangement::of(&nominal);
        assert_eq!((swings.joints, swings.one_axis), (1, true));
        nominal.gravity = nominal.joints[0].hinge.axis.map(|x| -9.81 * x);
        assert!(!Arrangement::of(&nominal).one_axis);
        let slide = &mut nominal.joints[0].hinge;
        slide.revolute = false;
        nominal.gravity = [0.0; 3];
        assert!(!Arrangement::of(&nominal).one_axis);
    }
}
