//! An arm of one joint, and what is read of it.

use pid_urdf::Description;

pub(crate) const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];
/// An inertial of 1 kg, 0.1 m above the joint.
pub(crate) const BODY: &str = r#"<inertial><origin xyz="0 0 0.1"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.012" izz="0.006" ixy="0" ixz="0" iyz="0"/></inertial>"#;
const ENDS: &str = r#"<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>"#;

/// A base, an arm with this content, and a joint with this content beside its ends.
pub(crate) fn arm(link: &str, joint: &str) -> String {
    format!(
        "<robot name=\"a\">\n<link name=\"base\"/>\n<link name=\"arm\">{link}</link>\n\
         <joint name=\"j1\" type=\"revolute\">{ENDS}{joint}</joint>\n</robot>"
    )
}

pub(crate) fn read(text: &str) -> Description {
    Description::parse("a.urdf", text).unwrap_or_else(|e| panic!("{e}"))
}

#[track_caller]
pub(crate) fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (x, y) in found.iter().zip(expected) {
        assert!((x - y).abs() <= 1e-12, "{found:?} for {expected:?}");
    }
}
