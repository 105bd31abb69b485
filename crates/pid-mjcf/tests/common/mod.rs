//! Models of one body, and what is read of them.

use pid_derive::mechanism::Body;
use pid_mjcf::Mjcf;

pub(crate) fn model(world: &str, rest: &str) -> String {
    format!("<mujoco model=\"test_robot\">{rest}<worldbody>{world}</worldbody></mujoco>")
}

pub(crate) fn read(text: &str) -> Mjcf {
    Mjcf::parse("a.xml", text).unwrap_or_else(|e| panic!("{e}"))
}

/// A body with this content on a hinge about y.
pub(crate) fn hinge(content: &str) -> String {
    format!("<body name=\"arm\"><joint name=\"j\" axis=\"0 2 0\"/>{content}</body>")
}

pub(crate) fn body_of(text: &str) -> Body {
    read(text).mechanism.bodies.remove(0)
}

#[track_caller]
pub(crate) fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (x, y) in found.iter().zip(expected) {
        assert!(
            (x - y).abs() <= 1e-12 * (1.0 + y.abs()),
            "{found:?} for {expected:?}"
        );
    }
}
