//! Robots that are more than a chain of driven bodies: potentials of any function, drives on several joints.

mod common;

use common::{DOUBLE, compare, in_c, in_rust, with};
use pid_firmware::{Precision, Target};
use pid_interpret::nominal::Nominal;
use pid_runtime::robot;

robot! {
    /// A slide and a swing in a potential with every function and power.
    pub robot Odd {
        gravity: [0, 0, -9.81] m/s^2;
        params { c: J = 2.0 in 1.0..=3.0; }
        link slide { mass: 2 kg; }
        link swing { mass: 1 kg; com: [0.1, 0, -0.3] m; }
        joint x: prismatic about x { base -> slide; }
        joint y: revolute about y { slide -> swing; }
        potential += c*((4 + q.y)*ln(4 + q.y) + sqrt(4 + q.y)*atan(q.y) + tan(q.y/4)*tanh(q.y) + exp(q.y)
            + cos(q.y)^5 + 1/(4 + q.y)^7 + q.y^2*abs(q.y));
        per joint x {
            input push: N;
            viscous: N*s/m = 3.0 in 1.0..=5.0;
            force = push - viscous*v;
        }
        per joint y {
            input current: A;
            gain: N*m/A = 2.0 in 1.98..=2.02;
            dry: N*m = 0.1 in 0.06..=0.14;
            force = gain*current - dry*tanh(40 s/rad * v);
        }
        emit { dynamics }
    }
}

robot! {
    /// Two joints, the drive of the second on both.
    pub robot Wrist {
        gravity: [0, 0, -9.81] m/s^2;
        params { m: kg = 0.8 in 0.78..=0.82; }
        link upper { mass: m; com: [0, 0, -0.1] m; inertia at com: diag(_, 0.006 kg*m^2, _); }
        link hand { mass: m; com: [0, 0, -0.08] m; inertia at com: diag(_, 0.004 kg*m^2, _); }
        joint bend: revolute about y { base -> upper; }
        joint tip: revolute about y { upper -> hand at [0, 0, -0.2] m; }
        per joint bend {
            input current: A;
            gain: N*m/A = 2.0 in 1.98..=2.02;
            viscous: N*m*s/rad = 0.2 in 0.12..=0.28;
            force = gain*current - viscous*v;
        }
        motor wrist: bend + tip {
            input current: A;
            gain: N*m/A = 1.0 in 0.99..=1.01;
            dry: N*m = 0.05 in 0.03..=0.07;
            armature = 0.005 kg*m^2;
            force = gain*current - dry*tanh(40 s/rad * v);
        }
        emit { dynamics }
    }
}

#[test]
fn every_function_and_power_is_code() {
    let nominal = Nominal::of_declared(&Odd, None).expect("a description");
    compare(&nominal, &in_c(&nominal, Precision::F64), DOUBLE, "C");
    compare(&nominal, &in_rust(&nominal, Precision::F64), DOUBLE, "Rust");
}

#[test]
fn a_drive_on_two_joints_is_told() {
    let nominal = Nominal::of_declared(&Wrist, None).expect("a description");
    let nominal = with(&nominal, &[("spring", 1, &[1.5, 0.2])]);
    compare(&nominal, &in_c(&nominal, Precision::F64), DOUBLE, "C");
    let files = common::files(&nominal, Target::C, Precision::F64);
    let told = common::text(&files, "not_expressed.md");
    let row = "| drive on several joints | wrist | coordinate of the drive: [1.0, 1.0] times the joints' positions plus 0 |";
    assert!(told.contains(row), "{told}");
}
