//! A small robot file and its log, for tests.

use std::fmt::Write;

/// An arm of one joint.
pub(crate) const ARM: &str = r#"<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.17"/><mass value="6"/>
<inertia ixx="0.085" iyy="0.088" izz="0.012" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="40" velocity="3"/><dynamics damping="0.5" friction="0.3"/></joint></robot>"#;

/// A swing of the arm under a small torque, in degrees, its columns in no order. Its mass is that of
/// the file, its viscous friction 0.5 N m s/rad, its dry friction 0.3 N m.
pub(crate) fn swing() -> String {
    let (weight, inertia) = (6.0 * 9.81 * 0.17, 0.088 + 6.0 * 0.17 * 0.17);
    let (mut q, mut v, h) = (1.0_f64, 0.0_f64, 1e-3);
    let mut text = String::from("time_ms,shoulder_effort [Nm],shoulder_pos [deg]\n");
    for k in 0..3000 {
        let u = 3.0 * (0.004 * f64::from(k)).sin();
        let t = f64::from(k);
        writeln!(text, "{t},{u},{}", q.to_degrees()).expect("a text");
        let friction = 0.5 * v + 0.3 * (v / 0.01).tanh();
        v += h * (u - friction - weight * q.sin()) / inertia;
        q += h * v;
    }
    text
}

/// The robot file and two logs of it in a folder.
pub(crate) fn written(folder: &std::path::Path) {
    std::fs::write(folder.join("arm.urdf"), ARM).expect("written");
    for log in ["a.csv", "b.csv"] {
        std::fs::write(folder.join(log), swing()).expect("written");
    }
}
