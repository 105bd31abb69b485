//! Robots beyond chains of driven links against records of robots with an effect more: a mimic
//! gripper, a bare Lagrangian, a coupled wrist.

use pid_diagnose::diagnosis::Diagnosis;
use pid_diagnose::nominal::Nominal;
use pid_diagnose::report::Report;
use pid_diagnose::search::Settings;
use pid_runtime::dynamics::{Dynamics, Jacobian};
use pid_runtime::robot;

use crate::common::{folder, source_holds};

robot! {
    /// Two fingers, one driven, the other opposite to it.
    pub robot Gripper {
        gravity: [0, 0, -9.81] m/s^2;
        params { m: kg = 0.3 in 0.29..=0.31; }
        link left { mass: m; com: [0, 0, 0] m; }
        link right { mass: m; com: [0, 0, 0] m; }
        joint slide_left: prismatic along x { base -> left; }
        joint slide_right: prismatic along x { base -> right; follows -slide_left; }
        per joint slide_left {
            input current: A;
            gain: N/A = 2.0 in 1.98..=2.02;
            dry: N = 0.2 in 0.12..=0.28;
            viscous: N*s/m = 2.0 in 1.2..=2.8;
            force = gain*current - viscous*v - dry*tanh(40 s/m * v);
        }
        emit { first_derivatives }
        expect rank 3;
    }
}

robot! {
    /// The machine, with a spring between the fingers.
    pub robot SprungGripper {
        gravity: [0, 0, -9.81] m/s^2;
        params { stiffness: N/m = 6.0 in 0.0..=50.0; rest: m = 0.1 fixed; }
        link left { mass: 0.305 kg; com: [0, 0, 0] m; }
        link right { mass: 0.305 kg; com: [0, 0, 0] m; }
        joint slide_left: prismatic along x { base -> left; }
        joint slide_right: prismatic along x { base -> right; follows -slide_left; }
        per joint slide_left {
            input current: A;
            force = 1.99 N/A * current - 2.3 N*s/m * v - 0.18 N * tanh(50000 s/m * v) - stiffness*(q - rest);
        }
        emit { first_derivatives }
    }
}

robot! {
    /// A pole that hangs from a driven cart.
    pub robot Crane {
        params {
            cart: kg = 1.0 in 0.96..=1.04;
            pole: kg = 0.3 in 0.29..=0.31;
            half: m = 0.25 in 0.245..=0.255;
        }
        input push: N;
        coordinates
            slide: m,
            theta: rad;
        lagrangian = 0.5*(cart + pole)*v.slide^2 + pole*half*v.slide*v.theta*cos(theta)
            + 2/3*pole*half^2*v.theta^2 + pole*9.81 m/s^2*half*cos(theta);
        per joint slide { rolling: N*s/m = 1.0 in 0.6..=1.4; force = -rolling*v; }
        per joint theta { hinge: N*m*s/rad = 0.01 in 0.006..=0.014; force = -hinge*v; }
        force on slide = push;
        emit { first_derivatives }
    }
}

robot! {
    /// The machine, whose cart feels the air.
    pub robot DraggedCrane {
        params { drag: N*s^2/m^2 = 2.5 in 0.0..=20.0; }
        input push: N;
        coordinates
            slide: m,
            theta: rad;
        lagrangian = 0.5*1.31 kg*v.slide^2 + 0.305 kg*0.251 m*v.slide*v.theta*cos(theta)
            + 2/3*0.305 kg*0.251 m*0.251 m*v.theta^2 + 0.305 kg*9.81 m/s^2*0.251 m*cos(theta);
        force on slide = push - 1.1 N*s/m * v.slide - drag*v.slide*abs(v.slide);
        force on theta = -0.011 N*m*s/rad * v.theta;
        emit { first_derivatives }
    }
}

robot! {
    /// Two links; the second motor sits on the base and turns both.
    pub robot Wrist {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            m: kg = 0.8 in 0.78..=0.82;
        }
        link upper { mass: m; com: [0, 0, -0.1] m; inertia at com: diag(_, 0.006 kg*m^2, _); }
        link hand { mass: m; com: [0, 0, -0.08] m; inertia at com: diag(_, 0.004 kg*m^2, _); }
        joint bend: revolute about y { base -> upper; }
        joint tip: revolute about y { upper -> hand at [0, 0, -0.2] m; }
        per joint bend {
            input current: A;
            gain: N*m/A = 2.0 in 1.98..=2.02;
            dry: N*m = 0.1 in 0.06..=0.14;
            viscous: N*m*s/rad = 0.2 in 0.12..=0.28;
            armature = 0.01 kg*m^2;
            force = gain*current - viscous*v - dry*tanh(40 s/rad * v);
        }
        motor wrist: bend + tip {
            input current: A;
            gain: N*m/A = 1.0 in 0.99..=1.01;
            dry: N*m = 0.05 in 0.03..=0.07;
            viscous: N*m*s/rad = 0.1 in 0.06..=0.14;
            armature = 0.005 kg*m^2;
            force = gain*current - viscous*v - dry*tanh(40 s/rad * v);
        }
        emit { first_derivatives }
    }
}

robot! {
    /// The machine, with a spring at the motor of the wrist.
    pub robot SprungWrist {
        gravity: [0, 0, -9.81] m/s^2;
        params { stiffness: N*m/rad = 0.5 in 0.0..=5.0; rest: rad = 0.4 fixed; }
        link upper { mass: 0.81 kg; com: [0, 0, -0.1] m; inertia at com: diag(_, 0.006 kg*m^2, _); }
        link hand { mass: 0.81 kg; com: [0, 0, -0.08] m; inertia at com: diag(_, 0.004 kg*m^2, _); }
        joint bend: revolute about y { base -> upper; }
        joint tip: revolute about y { upper -> hand at [0, 0, -0.2] m; }
        potential += 0.5*stiffness*(q.bend + q.tip - rest)^2;
        per joint bend {
            input current: A;
            armature = 0.01 kg*m^2;
            force = 2 N*m/A * current - 0.22 N*m*s/rad * v - 0.09 N*m * tanh(2000 s/rad * v);
        }
        motor wrist: bend + tip {
            input current: A;
            armature = 0.005 kg*m^2;
            force = 1 N*m/A * current - 0.11 N*m*s/rad * v - 0.055 N*m * tanh(2000 s/rad * v);
        }
        emit { first_derivatives }
    }
}

/// Diagnosis of records of a machine by the declared model.
fn diagnosed(
    model: &dyn Dynamics,
    machine: &dyn Jacobian,
    joints: &[&str],
    start: &[f64],
    amplitude: f64,
) -> Diagnosis {
    let folder = folder(model.name(), machine, joints, start, amplitude);
    let report = Report::of_model(model, &folder, &Settings::default(), false);
    std::fs::remove_dir_all(&folder).expect("the folder");
    let report = report.expect("a diagnosis");
    source_holds(model, &report);
    report.diagnosis
}

/// One parameter of the first effect, with its standard deviation.
fn magnitude(d: &Diagnosis, name: &str) -> (f64, f64) {
    let found = d.effects[0].parameters.iter();
    let found = found
        .clone()
        .find(|p| p.name.contains(name))
        .unwrap_or_else(|| panic!("{d:?}"));
    (found.value, found.std.expect("determined"))
}

#[test]
fn a_spring_is_found_at_a_gripper_whose_fingers_follow_each_other() {
    let nominal = Nominal::of_declared(&Gripper, None).expect("a description");
    // The mass of a finger, gain and friction of the drive.
    assert_eq!((nominal.n(), nominal.size()), (1, 4));
    let d = diagnosed(&Gripper, &SprungGripper, &["slide_left"], &[0.05], 1.5);
    assert_eq!(
        (d.verdict.word(), d.verdict.joint()),
        ("spring", Some(1)),
        "{d:?}"
    );
    assert!(d.gap_after < 0.2 * d.gap_before, "{d:?}");
    let (stiffness, std) = magnitude(&d, "stiff");
    assert!(
        (stiffness - 6.0).abs() < 4.0 * std && std < 0.2,
        "{stiffness} ± {std}"
    );
}

#[test]
fn drag_is_found_at_a_robot_that_is_declared_by_its_lagrangian() {
    let nominal = Nominal::of_declared(&Crane, None).expect("a description");
    // Three parameters of the Lagrangian, and gain and friction of two coordinates.
    assert_eq!((nominal.n(), nominal.size()), (2, 9));
    // There is no link to hang a payload on or to push.
    assert!(!nominal.has_bodies());
    let d = diagnosed(&Crane, &DraggedCrane, &["slide", "theta"], &[0.0, 0.3], 4.0);
    assert_eq!(
        (d.verdict.word(), d.verdict.joint()),
        ("quadratic_drag", Some(1)),
        "{d:?}"
    );
    assert!(d.gap_after < 0.2 * d.gap_before, "{d:?}");
    let absent = ["payload", "base_tilt", "external_force"];
    assert!(
        d.ranking
            .iter()
            .all(|r| !absent.contains(&r.effect.as_str())),
        "{:?}",
        d.ranking
    );
    let (drag, std) = magnitude(&d, "drag");
    assert!(
        (drag - 2.5).abs() < 4.0 * std && std < 0.2,
        "{drag} ± {std}"
    );
}

#[test]
fn a_spring_is_found_at_the_motor_of_a_coupled_wrist() {
    let nominal = Nominal::of_declared(&Wrist, None).expect("a description");
    let names: Vec<&str> = nominal.joints.iter().map(|j| j.name.as_str()).collect();
    assert_eq!(names, ["bend", "wrist"]);
    let drives = nominal.description.drives().expect("coupled drives");
    assert_eq!(drives.positions(&[0.3, 0.5]), [0.3, 0.8]);
    let d = diagnosed(&Wrist, &SprungWrist, &["bend", "tip"], &[0.1, -0.2], 0.8);
    assert_eq!(
        (d.verdict.word(), d.verdict.joint()),
        ("spring", Some(2)),
        "{d:?}"
    );
    assert!(d.gap_after < 0.2 * d.gap_before, "{d:?}");
    let (stiffness, std) = magnitude(&d, "stiff");
    assert!(
        (stiffness - 0.5).abs() < 4.0 * std && std < 0.02,
        "{stiffness} ± {std}"
    );
}
