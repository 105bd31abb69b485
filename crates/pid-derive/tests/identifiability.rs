//! Structural identifiability against results known in closed form.

mod robots;

use pid_derive::identifiability;
use pid_derive::identifiability::{GroupKind, Structure};
use pid_derive::model::{About, Expr, Inertial, JointKind, Robot};
use robots::{Builder, Y, call, diagonal, mul, num, nums};

fn names(robot: &Robot, structure: &Structure) -> Vec<(GroupKind, String)> {
    structure
        .groups
        .iter()
        .map(|group| (group.kind, group.text(|k| robot.params[k].name.clone())))
        .collect()
}

fn lost(structure: &Structure) -> usize {
    structure.groups.iter().map(|group| group.lost()).sum()
}

/// The gap must be wide: kept pivots are of the size of the problem, dropped ones are rounding.
fn clear(structure: &Structure) {
    assert!(
        structure.gap.0 > 1e-4 && structure.gap.1 < 1e-12,
        "{:?}",
        structure.gap
    );
    assert_eq!(structure.rank + lost(structure), structure.params.len());
}

#[test]
fn the_papers_robot_loses_five_directions_and_at_its_nominal_values_six() {
    let robot = robots::two_link();
    let found = identifiability(&robot).unwrap();
    let all = &found.all;
    assert_eq!((all.generic.rank, all.nominal.rank), (14, 13));
    clear(&all.generic);
    clear(&all.nominal);
    assert_eq!(found.all, found.free);
    // Link 1 enters through iz1 + m1 (sx1² + sy1²); that against ix2 + iz2 - 2 ix2 sin²; one scale of all.
    assert_eq!(
        names(&robot, &all.generic),
        [
            (GroupKind::OneCombination, "`m1`, `sx1`, `sy1` and `iz1` enter only through one combination".to_owned()),
            (GroupKind::OneLess, "`iz1`, `ix2` and `iz2` enter only through 2 combinations".to_owned()),
            (
                GroupKind::CommonFactor,
                "`m2`, `iy2`, `dry_shoulder`, `dry_elbow`, `viscous_shoulder`, `viscous_elbow`, `gain_shoulder` and \
                 `gain_elbow` are determined up to one common factor (`iz1` and `ix2` adjusted with it)"
                    .to_owned()
            ),
        ]
    );
}

#[test]
fn a_known_gain_takes_the_common_factor_away() {
    let mut robot = robots::two_link();
    for param in &mut robot.params {
        param.fixed = param.name.starts_with("gain");
    }
    let found = identifiability(&robot).unwrap();
    assert_eq!(
        (found.free.generic.rank, found.free.generic.params.len()),
        (13, 17)
    );
    assert_eq!(found.free.nominal.rank, 12);
    assert_eq!(
        (found.all.generic.rank, found.all.generic.params.len()),
        (14, 19)
    );
    clear(&found.free.generic);
    clear(&found.free.nominal);
    assert!(
        !names(&robot, &found.free.generic)
            .iter()
            .any(|group| group.0 == GroupKind::CommonFactor)
    );
}

#[test]
fn a_sharp_transition_of_friction_is_seen() {
    // At a sharpness of 2000 s/rad the transition ends within a milliradian per second.
    let mut b = Builder::new("Sharp");
    let dry = b.param("dry", "N*m", 1.0, 0.5, 2.0);
    let sharp = b.param("sharp", "s/rad", 2000.0, 1000.0, 3000.0);
    let link = b.link(
        "disc",
        Inertial::Body {
            mass: num(1.0),
            com: nums([0.0; 3]),
            inertia: diagonal(num(0.1), num(0.1), num(0.1)),
            about: About::Com,
        },
    );
    let joint = b.joint("axis", JointKind::Revolute(Y), None, link);
    joint.force = Some(robots::neg(mul(
        dry,
        call(pid_derive::model::Func::Tanh, mul(sharp, Expr::Velocity(0))),
    )));
    let found = identifiability(&b.robot()).unwrap();
    assert_eq!(found.all.generic.rank, 2);
}

#[test]
fn arms_in_linear_form() {
    // That the lost directions are those of the regressor is tested in `regressor.rs`.
    for n in [2, 6, 7] {
        let robot = robots::arm(n);
        let found = identifiability(&robot).unwrap();
        clear(&found.all.generic);
        clear(&found.all.nominal);
        // Link 1 turns about z only: nine of its ten have no effect.
        let idle = found
            .all
            .generic
            .groups
            .iter()
            .filter(|group| group.kind == GroupKind::NoEffect);
        assert!(idle.count() >= 9);
    }
}

#[test]
fn the_same_answer_every_time() {
    let robot = robots::tree();
    assert_eq!(
        identifiability(&robot).unwrap(),
        identifiability(&robot).unwrap()
    );
}

#[test]
fn no_parameters_at_all() {
    let mut robot = robots::carriage();
    robot.params.clear();
    robot.joints[0].force = None;
    robot.links[0].inertial = Inertial::Linear {
        mass: num(1.0),
        first_moment: nums([0.0; 3]),
        inertia: diagonal(num(0.0), num(0.0), num(0.0)),
    };
    assert_eq!(identifiability(&robot).unwrap().all.generic.rank, 0);
}
