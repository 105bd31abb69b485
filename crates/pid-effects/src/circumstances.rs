//! On which robots two effects give the same readings, whatever the motion.

use nalgebra::{Rotation3, Vector3};
use pid_derive::model::{Expr, JointKind};
use pid_interpret::nominal::{Nominal, Role};

use crate::effect::{Effect, Info};
pub use crate::equal_when::EqualWhen;

/// What decides on [`EqualWhen`]: a robot and one of its joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Circumstances {
    /// Number of joints.
    pub joints: usize,
    /// The joint from 0.
    pub joint: usize,
    /// Whether gravity can have a moment about the first joint, or a part along it if it slides.
    pub gravity: bool,
    /// Whether all joints turn about one horizontal direction.
    pub vertical_plane: bool,
    /// Whether the joint may have viscous friction.
    pub viscous: bool,
}

/// Sine of an angle below which two directions count as one: descriptions state axes to more figures.
const PARALLEL: f64 = 1e-6;

impl Circumstances {
    /// Of a described robot and one of its joints, from 0.
    pub fn of(nominal: &Nominal, joint: usize) -> Self {
        let robot = nominal.robot();
        let number = |x: &Expr| match x {
            Expr::Num(x) => *x,
            _ => f64::NAN,
        };
        let gravity = Vector3::from_fn(|i, _| number(&robot.gravity[i]));
        // Of the links, at zero coordinates.
        let mut frames = vec![Rotation3::identity(); robot.links.len()];
        let mut axes = Vec::with_capacity(robot.joints.len());
        for own in &robot.joints {
            let [roll, pitch, yaw] = [0, 1, 2].map(|i| number(&own.rpy[i]));
            // Rz(yaw) Ry(pitch) Rx(roll); joints in a plane keep the direction of their axes as they turn.
            let placed = Rotation3::from_euler_angles(roll, pitch, yaw);
            let parent = own.parent.and_then(|link| frames.get(link).copied());
            let frame = parent.unwrap_or_default() * placed;
            if let Some(child) = frames.get_mut(own.child) {
                *child = frame;
            }
            let (revolute, axis) = match own.kind {
                JointKind::Revolute(axis) => (true, axis),
                JointKind::Prismatic(axis) => (false, axis),
                _ => (false, [f64::NAN; 3]),
            };
            if own.coord.is_some() {
                axes.push((revolute, frame * Vector3::from(axis)));
            }
        }
        let heavy = gravity.norm() * PARALLEL;
        let pulls = |(revolute, axis): &(bool, Vector3<f64>)| match revolute {
            true => gravity.cross(axis).norm() > heavy,
            false => gravity.dot(axis).abs() > heavy,
        };
        let vertical_plane = axes.iter().all(|(revolute, axis)| {
            let along = axes[0].1.cross(axis).norm() < PARALLEL;
            *revolute && along && gravity.norm() > 0.0 && gravity.dot(axis).abs() <= heavy
        });
        let viscous = nominal.tolerances().iter().any(|t| {
            t.joint == Some(joint)
                && t.role == Role::Viscous
                && (t.nominal > 0.0 || t.half_width > 0.0)
        });
        Circumstances {
            joints: axes.len(),
            joint,
            gravity: axes.first().is_some_and(pulls),
            vertical_plane,
            viscous,
        }
    }
}

impl EqualWhen {
    /// Whether it holds.
    pub fn holds(self, at: &Circumstances) -> bool {
        match self {
            EqualWhen::OneJoint => at.joints == 1,
            EqualWhen::OneJointWithoutGravity => at.joints == 1 && !at.gravity,
            EqualWhen::FirstOfVerticalPlane => at.vertical_plane && at.joint == 0,
            EqualWhen::NoViscousFriction => !at.viscous,
        }
    }
}

impl Info {
    /// Identifiers of the effects that no motion tells from this one there.
    pub fn equal_to(&self, at: &Circumstances) -> impl Iterator<Item = &'static str> {
        let own = self.equals.iter().filter(|(_, when)| when.holds(at));
        own.map(|(id, _)| *id)
    }

    /// Simulators, and what models the effect in each.
    pub fn simulators(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let all = [
            ("MuJoCo", self.mujoco),
            ("Isaac", self.isaac),
            ("URDF", self.urdf),
        ];
        all.into_iter()
            .filter_map(|(name, field)| Some((name, field?)))
    }
}

/// Identifiers of the effects of a joint of a described robot that no motion tells from `effect` there.
pub fn equal_to(effect: &dyn Effect, nominal: &Nominal, joint: usize) -> Vec<&'static str> {
    let at = Circumstances::of(nominal, joint);
    effect.info().equal_to(&at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{all, by_id};

    #[test]
    fn equality_goes_both_ways() {
        for effect in all() {
            let info = effect.info();
            for (other, when) in info.equals {
                let back = by_id(other).expect("an effect of the library");
                let same = back.info().equals.contains(&(info.id, *when));
                assert!(same, "{} and {other}", info.id);
            }
        }
    }

    #[test]
    fn a_pendulum_and_an_arm_differ_in_what_they_tell_apart() {
        let read = |text: &str| Nominal::parse("nominal.toml", text).expect("a robot");
        let pendulum = read(include_str!("../../pid-diagnose/tests/pendulum.toml"));
        let arm = read(include_str!("../../pid-diagnose/robots/ur10e.toml"));
        let equal = |id: &str, robot: &Nominal, joint: usize| {
            equal_to(&*by_id(id).expect("an effect"), robot, joint)
        };
        assert_eq!(equal("input_delay", &pendulum, 0), ["sensor_delay"]);
        assert_eq!(equal("encoder_offset", &pendulum, 0), ["base_tilt"]);
        assert!(equal("payload", &pendulum, 0).is_empty());
        // Gravity along the axis has no moment about it; a slide does not turn.
        let text = include_str!("../../pid-diagnose/tests/pendulum.toml");
        let waist = read(&text.replace("[0.0, 0.0, -9.81]", "[0.0, -9.81, 0.0]"));
        assert!(equal("encoder_offset", &waist, 0).is_empty());
        assert_eq!(equal("payload", &waist, 0), ["unmodelled_rotor_inertia"]);
        let slide = read(&text.replace("\"revolute\"", "\"prismatic\""));
        assert!(equal("encoder_offset", &slide, 0).is_empty());
        for id in ["input_delay", "encoder_offset", "payload"] {
            assert!(equal(id, &arm, 0).is_empty(), "{id}");
        }
    }
}
