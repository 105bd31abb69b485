//! Proofs about robots: blanks, unused declarations, singular mass matrices.

mod robots;

use pid_derive::model::{Expr, Func, Inertial, JointKind};
use pid_derive::{Error, Facts};
use robots::{Builder, X, Z, call, diagonal, num, nums};

#[test]
fn the_papers_robot_is_as_it_says() {
    let facts = pid_derive::facts(&robots::two_link());
    assert!(facts.residual.total() > 50);
    assert_eq!(
        facts,
        Facts {
            residual: facts.residual,
            ..Facts::default()
        }
    );
}

#[test]
fn a_blank_that_enters_is_named_with_its_equation() {
    let mut robot = robots::two_link();
    // The forearm pitches: its Izz enters the yaw equation (0) and, through the gyroscopic force,
    // the pitch equation (1).
    let Inertial::Body { inertia, .. } = &mut robot.links[1].inertial else {
        unreachable!()
    };
    robot.blanks.push(pid_derive::model::Blank {
        link: 1,
        entry: "Izz".into(),
    });
    inertia.zz = Expr::Blank(3);
    let facts = pid_derive::facts(&robot);
    assert_eq!(facts.blank_violations, [(3, 0), (3, 1)]);
    // iz2 is now used nowhere.
    assert_eq!(facts.unused_params, [10]);
    assert_eq!(facts.singular_mass, None);
}

#[test]
fn parameters_and_inputs_without_effect() {
    let mut robot = robots::two_link();
    robot.joints[1].force = None;
    let facts = pid_derive::facts(&robot);
    // dry, viscous, gain and sharp of the elbow, and its current.
    assert_eq!(facts.unused_params, [12, 14, 16, 18]);
    assert_eq!(facts.unused_inputs, [1]);
}

#[test]
fn a_saturated_friction_law_still_counts_as_an_effect() {
    let mut robot = robots::carriage();
    let steep = robots::mul(num(1e6), Expr::Velocity(0));
    robot.joints[0].force = Some(robots::mul(Expr::Param(1), call(Func::Tanh, steep)));
    let facts = pid_derive::facts(&robot);
    assert_eq!(facts.unused_params, [0usize; 0]);
    let mut g = pid_symbolic::Graph::new();
    let equations = pid_derive::equations(&mut g, &robot).unwrap();
    let derivatives = pid_derive::derivatives(&mut g, &equations, robot.emit);
    let cols: Vec<usize> = derivatives.jacobian.iter().map(|entry| entry.col).collect();
    // v, a, mass, viscous: ∂r/∂v vanishes at almost every v, but is no structural zero.
    assert_eq!(cols, [1, 2, 4, 5]);
}

#[test]
fn a_massless_tip_makes_the_mass_matrix_singular_at_its_joint() {
    let mut robot = robots::two_link();
    robot.links[1].inertial = Inertial::None;
    assert_eq!(pid_derive::facts(&robot).singular_mass, Some(1));
    // A rotor helps.
    robot.joints[1].armature = Some(num(0.01));
    assert_eq!(pid_derive::facts(&robot).singular_mass, None);
}

#[test]
fn a_negative_inertia_is_not_positive_definite() {
    let mut b = Builder::new("Wheel");
    let izz = b.param("izz", "kg*m^2", -0.1, -1.0, 1.0);
    let wheel = b.link(
        "wheel",
        Inertial::Linear {
            mass: num(1.0),
            first_moment: nums([0.0; 3]),
            inertia: diagonal(num(1.0), num(1.0), izz),
        },
    );
    b.joint("axle", JointKind::Revolute(Z), None, wheel);
    assert_eq!(pid_derive::facts(&b.robot()).singular_mass, Some(0));
}

#[test]
fn nonsmooth_laws_are_seen() {
    let mut robot = robots::carriage();
    assert!(!pid_derive::facts(&robot).nonsmooth);
    robot.joints[0].force = Some(robots::mul(
        Expr::Param(1),
        call(Func::Abs, Expr::Velocity(0)),
    ));
    assert!(pid_derive::facts(&robot).nonsmooth);
}

#[test]
fn equations_that_are_finite_nowhere_are_an_error() {
    let mut b = Builder::new("Impossible");
    let mass = b.param("mass", "kg", -1.0, -2.0, -0.5);
    let body = b.link(
        "body",
        Inertial::Linear {
            mass: call(Func::Ln, mass),
            first_moment: nums([0.0; 3]),
            inertia: diagonal(num(0.0), num(0.0), num(0.0)),
        },
    );
    b.joint("rail", JointKind::Prismatic(X), None, body);
    let error = pid_derive::equations(&mut pid_symbolic::Graph::new(), &b.robot()).unwrap_err();
    assert_eq!(
        error,
        Error::NowhereFinite {
            robot: "Impossible".into(),
            points: 40
        }
    );
    assert!(
        error.to_string().contains("`Impossible`")
            && error.to_string().contains("parameter ranges")
    );
}
