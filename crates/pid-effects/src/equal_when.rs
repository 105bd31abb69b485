//! Conditions on a robot under which two effects are one.

/// When two effects cannot be told apart by any motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EqualWhen {
    /// The robot has one joint.
    OneJoint,
    /// The robot has one joint, and gravity has no moment about it.
    OneJointWithoutGravity,
    /// The joint is the first of an arm in a vertical plane.
    FirstOfVerticalPlane,
    /// The joint has no viscous friction, and none is possible.
    NoViscousFriction,
}
