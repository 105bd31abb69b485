use super::*;
use crate::bench::{SIZE, named, pendulum};

#[test]
fn a_gear_with_play_shows_the_rotor_apart_from_the_link() {
    let play = named(&["backlash"]);
    let e = [0.03, 6.7e-4, 2.6e-4, 0.0];
    let case = pendulum(&play, &e, 6.0, &|_| {});
    let at = Point {
        theta: vec![0.0; SIZE],
        e: e.to_vec(),
    };
    let rigid = basis(&case).columns.ncols();
    let beside = basis_beside(&case, &play, &at).columns.ncols();
    assert!(beside > rigid, "{beside} directions, {rigid} without play");
}

#[test]
fn a_fit_on_the_way_ends_where_the_same_steps_with_curvature_end() {
    let spring = named(&["spring"]);
    let case = pendulum(&spring, &[0.9, 0.2], 6.0, &|_| {});
    let basis = basis(&case);
    let start = || Point {
        theta: vec![0.0; SIZE],
        e: vec![0.1, 0.0],
    };
    let whole = fit(&case, &basis, &spring, start(), Effort::full(2));
    let part = fit(&case, &basis, &spring, start(), Effort::on_the_way(2));
    assert_eq!(whole.point, part.point);
    assert_eq!(whole.train, part.train);
    assert_eq!(whole.quadratic.h.nrows(), SIZE + 2);
    assert_eq!(part.steps, 2);
}

#[test]
fn borrowed_derivatives_make_the_model_that_they_are_part_of() {
    let spring = named(&["spring"]);
    let case = pendulum(&spring, &[0.9, 0.2], 3.0, &|_| {});
    let basis = basis(&case);
    let at = Point {
        theta: (0..SIZE).map(|i| 0.1 * (i as f64).sin()).collect(),
        e: vec![0.4, 0.1],
    };
    let gains = all_gains(&case, &spring, &at);
    let columns = basis.directions();
    let all = differentiated(&case, &spring, &at, &gains, &columns);
    let own: Vec<Direction<'_>> = (0..2).map(Direction::Effect).collect();
    let own = linearise(&case, &spring, &at, &gains, Role::Train, &own);
    let shared = Slopes::first(all.j.clone(), &gram(&all.j), columns.len());
    let (whole, beside) = (
        Quadratic::new(&basis, &all, &at),
        Quadratic::beside(&basis, &shared, &own, &at),
    );
    assert!((&whole.h - &beside.h).amax() < 1e-9 * whole.h.amax());
    assert!((&whole.g - &beside.g).amax() < 1e-9 * whole.g.amax());
    assert!(whole.h[(0, 0)] > 0.0 && whole.g.amax() > 0.0);
}

#[test]
fn a_fit_rests_at_its_optimum_and_not_on_the_way() {
    let spring = named(&["spring"]);
    let case = pendulum(&spring, &[0.9, 0.2], 6.0, &|_| {});
    let basis = basis(&case);
    let start = Point {
        theta: vec![0.0; SIZE],
        e: vec![0.1, 0.0],
    };
    let on_the_way = fit(&case, &basis, &spring, start.clone(), Effort::full(1));
    assert!(!on_the_way.rests(&case));
    let end = fit(&case, &basis, &spring, start, Effort::full(14));
    assert!(end.rests(&case), "{} steps", end.steps);
    // Without its curvature nobody knows.
    let bare = Quadratic {
        h: DMatrix::zeros(0, 0),
        g: DVector::zeros(0),
    };
    let unknown = Fit {
        quadratic: bare,
        ..end
    };
    assert!(!unknown.rests(&case));
}
