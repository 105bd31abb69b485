use num_dual::Dual64;
use pid_data::Role;

use super::laws::ClassLaw;
use super::{About, ceilings, raise, removed};
use crate::bench::{SIZE, named, pendulum};
use crate::case::Case;
use crate::constants::Constants;
use crate::diagnosis::Ceiling;
use crate::effect::{Class, Commands, Forces, Friction, Law, Model, Site};
use crate::fit::{Effort, Fit, Point, basis, fit};
use crate::gap::{Gap, gap};
use crate::hypothesis::Hypothesis;
use crate::search::Watch;

/// The nominal structure fitted to a pendulum under a cause, and its gap.
fn nominal(case: &Case) -> (Fit, Gap) {
    let at = Point {
        theta: vec![0.0; SIZE],
        e: Vec::new(),
    };
    let nothing = Hypothesis::default();
    let found = fit(case, &basis(case), &nothing, at, Effort::full(14));
    let gap = gap(case, &nothing, &found.point.theta, &[], Role::Test);
    (found, gap)
}

fn of(cause: &str, e: &[f64]) -> Vec<Ceiling> {
    let case = pendulum(&named(&[cause]), e, 8.0, &|_| {});
    let (fit, gap) = nominal(&case);
    let about = About {
        case: &case,
        fit: &fit,
        gap: &gap,
        floor: 1e-3,
        watch: &Watch::default(),
    };
    ceilings(&about)
}

#[test]
fn the_class_of_the_cause_has_the_highest_ceiling() {
    // Friction over the load acts on the load of the step before, and its law has knots.
    let causes: [(&str, &[f64], Class, f64); 4] = [
        ("quadratic_drag", &[0.05], Class::Velocity, 0.85),
        ("spring", &[0.9, 0.2], Class::Position, 0.85),
        ("input_delay", &[0.02], Class::InputTiming, 0.85),
        ("load_dependent_friction", &[0.25], Class::Load, 0.6),
    ];
    for (cause, e, class, least) in causes {
        let all = of(cause, e);
        let first = &all[0];
        // On one joint a late input is the same map as a late reading.
        let equal = (class, first.class) == (Class::InputTiming, Class::PositionTiming);
        assert!(first.class == class || equal, "{cause}: {all:?}");
        assert!(first.share > least, "{cause}: {all:?}");
        // The one window of this record tells no interval.
        assert_eq!(first.interval, None);
        // A class that cannot do it leaves the most of it.
        let last = all.last().expect("several classes");
        assert!(last.share < 0.5, "{cause}: {all:?}");
    }
}

#[test]
fn a_gap_of_noise_has_no_ceilings() {
    let case = pendulum(&named(&[]), &[], 4.0, &|_| {});
    let (fit, gap) = nominal(&case);
    let about = About {
        case: &case,
        fit: &fit,
        gap: &gap,
        floor: gap.total,
        watch: &Watch::default(),
    };
    assert!(ceilings(&about).is_empty());
}

#[test]
fn an_effect_raises_the_ceiling_of_its_class_alone() {
    let ceiling = |class| Ceiling {
        joint: 1,
        class,
        share: 0.3,
        interval: Some((0.1, 0.4)),
        confounded: Vec::new(),
    };
    let mut all = [Class::Velocity, Class::Load].map(ceiling);
    raise(&mut all, ("stribeck", 1), 0.6);
    raise(&mut all, ("stribeck", 2), 0.9);
    raise(&mut all, ("load_dependent_friction", 1), 0.2);
    assert_eq!((all[0].share, all[0].interval), (0.6, Some((0.1, 0.6))));
    assert_eq!((all[1].share, all[1].interval), (0.3, Some((0.1, 0.4))));
}

#[test]
fn the_interval_comes_from_the_windows_of_both_gaps() {
    let case = pendulum(&named(&[]), &[], 2.0, &|_| {});
    let (fit, _) = nominal(&case);
    let gap = |total: f64, windows: Vec<f64>| Gap {
        total,
        joints: Vec::new(),
        windows,
        joint_windows: Vec::new(),
    };
    let before = gap(1.0, (1..=8).map(f64::from).collect());
    let about = About {
        case: &case,
        fit: &fit,
        gap: &before,
        floor: 0.5,
        watch: &Watch::default(),
    };
    // A quarter of every square is left, whichever windows are drawn: all but the floor is removed.
    let quarter = gap(0.5, before.windows.iter().map(|w| 0.25 * w).collect());
    let (share, interval) = removed(&about, &quarter);
    let (low, high) = interval.expect("eight windows");
    assert!([share, low, high].iter().all(|x| (x - 1.0).abs() < 1e-12));
    // Half of the windows are left as they are.
    let left = before.windows.iter().enumerate();
    let half: Vec<f64> = left
        .map(|(i, w)| if i % 2 == 0 { *w } else { 0.5 * w })
        .collect();
    let total = (half.iter().sum::<f64>() / 36.0).sqrt();
    let (share, interval) = removed(&about, &gap(total, half));
    let (low, high) = interval.expect("eight windows");
    assert!((share - (1.0 - total * total) / 0.75).abs() < 1e-12);
    assert!(
        low < share - 0.05 && share + 0.05 < high,
        "{low} {share} {high}"
    );
}

/// Everything a law says at a place, over numbers that carry the slope along q, v and load.
fn answers(law: &ClassLaw, case: &Case, x: [f64; 4], seed: f64) -> Vec<Dual64> {
    let law: &dyn Law<Dual64> = law;
    let dual = |x: f64| Dual64::new(x, seed);
    let e: Vec<Dual64> = (0..40)
        .map(|i| Dual64::from(0.2 * (1.7 * f64::from(i)).sin()))
        .collect();
    let [q, v, load, u] = x.map(dual);
    let constants = Constants::<Dual64>::new(&case.nominal, &[Dual64::from(0.0); SIZE]);
    let (q, v, load) = ([q], [v], [load]);
    let site = Site {
        joint: 0,
        q: &q,
        v: &v,
        load: &load,
        t: 1.3,
        dt: 1e-3,
        rest: None,
    };
    let memory = [dual(0.05), Dual64::from(1.0)];
    let (mut value, mut rate) = ([Dual64::from(0.0)], [Dual64::from(0.0)]);
    let mut forces = Forces {
        value: &mut value,
        rate: &mut rate,
    };
    let mut friction = Friction {
        forward: Dual64::from(1.0),
        backward: Dual64::from(1.0),
        viscous: Dual64::from(0.1),
    };
    let commands = Commands {
        u: &[0.0],
        h: 1e-3,
        linear: false,
        begin: 0.0,
        t: 1.3,
        dt: 1e-3,
    };
    law.force(&e, &site, &memory, &mut forces, &constants);
    law.friction(&e, &site, &memory, &mut friction);
    let read = law.sense(&e, q[0], v[0]);
    let acts = law.input(&e, u, &commands, &mut []);
    vec![
        value[0],
        friction.forward,
        friction.backward,
        read.0,
        read.1,
        acts,
    ]
}

#[test]
fn slopes_of_the_laws_agree_with_differences() {
    let case = pendulum(&named(&[]), &[], 2.0, &|_| {});
    let classes = [
        Class::Velocity,
        Class::Load,
        Class::Position,
        Class::Reversal,
        Class::Time,
    ];
    for class in classes {
        let law = ClassLaw::new(&case, class, 0).expect("a law");
        assert!(law.info().parameters.len() > 3);
        // Between knots.
        for x in [[0.31, 0.53, 1.1, 0.7], [-0.42, -1.9, -2.3, -0.9]] {
            let h = 1e-6;
            let at = |d: f64| answers(&law, &case, x.map(|x| x + d), 1.0);
            let (low, here, high) = (at(-h), at(0.0), at(h));
            for (i, exact) in here.iter().enumerate() {
                // The memory of the distance moves with the seed and not with x.
                if class == Class::Reversal {
                    continue;
                }
                let difference = (high[i].re - low[i].re) / (2.0 * h);
                assert!(
                    (exact.eps - difference).abs() < 1e-6,
                    "{class:?} {i}: {exact:?} {difference}"
                );
            }
        }
    }
}

#[test]
fn a_single_joint_is_coupled_with_none() {
    let case = pendulum(&named(&[]), &[], 2.0, &|_| {});
    assert!(ClassLaw::new(&case, Class::Coupling, 0).is_none());
}
