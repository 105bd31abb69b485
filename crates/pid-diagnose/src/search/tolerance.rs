//! Friction, and gains of position loops, outside the tolerance that was stated for them.
//!
//! Friction is what a description knows least, and no effect of the library stands for another
//! level of it. Where nothing explains the records and the nominal structure is fitted with a
//! friction value at the end of its tolerance, both friction values of that joint may lie anywhere
//! from zero upwards, and everything is looked for once more. The same holds behind a servo of the gains
//! in [`GAINS`]: those of a joint are free where one of them is at the end of its tolerance, or stated as
//! exact, first, and friction beside them after. Another kd is not looked for: without limits it is
//! viscous friction, and no record tells the two apart.

use pid_interpret::nominal::{Gain, Role};

use super::evidence::Evidence;
use super::loops;
use super::magnitude::deviations;
use super::measure::share;
use super::partial::tuned_within;
use super::settings::Settings;
use crate::case::Case;
use crate::diagnosis::{Beyond, Remainder};
use crate::fit::{Effort, Fit, all_gains, basis, fit};
use crate::hypothesis::Hypothesis;
use crate::nominal::role_name;

/// The friction values of a joint.
const FRICTION: [Role; 2] = [Role::Coulomb, Role::Viscous];
/// Gains of a position loop that may be stated wrongly.
const GAINS: [Role; 3] = [
    Role::Servo(Gain::Kp),
    Role::Servo(Gain::Kv),
    Role::Servo(Gain::Ki),
];
/// A gain that is stated as exact is another one from this share of it on: less is within the error of
/// the model.
const OTHER: f64 = 0.02;
/// Deviation, in tolerances, from which a value counts as held by its tolerance: the bound is 1.
const HELD: f64 = 0.999;

/// The evidence of a search with wider ranges, with what lies outside the stated ones; what was
/// before is the nominal structure within them.
pub(super) fn beyond(stated: Evidence, wider: Evidence, settings: &Settings) -> Evidence {
    let beyond = outside(&stated.case, &wider);
    let mut base = wider.base.clone();
    base.point.theta = within(&stated.case, &wider.case, &stated.base.point.theta);
    base.gains = all_gains(&wider.case, &base.hypothesis, &base.point);
    let floor = wider.floor;
    // Where effects explain a part, what was before is judged as they are: by slow predictions. Without
    // a value outside its tolerance the wider ranges were not used.
    let (own, before) = match (&wider.part, beyond.is_empty()) {
        (None, _) => (base, stated.before),
        (Some(_), true) => (wider.base.clone(), wider.before.clone()),
        (Some(_), false) => {
            let (fit, gap) = tuned_within(&stated, settings);
            base.point.theta = within(&stated.case, &wider.case, &fit.point.theta);
            (base, gap)
        }
    };
    let after = wider.after.total;
    let remainder = wider.remainder.map(|left| Remainder {
        explained: if before.total > floor {
            share(before.total, after, floor)
        } else {
            left.explained
        },
        ..left
    });
    Evidence {
        misfit: (stated.misfit.0, wider.misfit.1),
        base: own,
        before,
        remainder,
        beyond,
        ..wider
    }
}

/// Deviations θ within the stated tolerances as deviations within the wider ones.
fn within(stated: &Case, wider: &Case, theta: &[f64]) -> Vec<f64> {
    let ranges = stated.nominal.values.iter().zip(&wider.nominal.values);
    let both = ranges.zip(theta);
    both.map(|((old, own), theta)| {
        let changed = (old.nominal, old.half_width) != (own.nominal, own.half_width);
        if changed && own.half_width > 0.0 {
            (old.nominal + old.half_width * theta - own.nominal) / own.half_width
        } else {
            *theta
        }
    })
    .collect()
}

/// The case with wider ranges of the friction values that a tolerance holds, as wide as the nominal
/// structure needs them.
pub(super) fn widened(case: &Case, settings: &Settings, found: &Evidence) -> Option<Case> {
    let at = (found.base.clone(), [&found.base, &found.fit]);
    freed(case, settings, found, (&FRICTION, at))
}

/// The same of the gains of position loops, those that are stated as exact included.
pub(super) fn other_gains(case: &Case, settings: &Settings, found: &Evidence) -> Option<Case> {
    if !case.nominal.description.has_servos() {
        return None;
    }
    let at = (found.base.clone(), [&found.base, &found.fit]);
    freed(case, settings, found, (&GAINS, at))
}

/// The case with wider ranges of values in some roles, where a fit has one of them at its end.
fn freed(
    case: &Case,
    settings: &Settings,
    found: &Evidence,
    (roles, (mut at, fits)): (&[Role], (Fit, [&Fit; 2])),
) -> Option<Case> {
    let nothing = Hypothesis::default();
    let mut wide = case.clone();
    wide.noise.clone_from(&found.case.noise);
    let before = at.train.objective();
    let mut held: Vec<usize> = fits
        .iter()
        .flat_map(|f| at_an_end(case, roles, f))
        .map(|(joint, _)| joint)
        .chain(exact(case, roles))
        .collect();
    held.sort_unstable();
    held.dedup();
    for middle in settings.budget.friction_middles {
        if held.is_empty() {
            break;
        }
        for &joint in &held {
            for place in (roles.iter()).filter_map(|&role| case.nominal.place(joint, role)) {
                let stated = &case.nominal.values[place];
                let (value, tolerance) = (middle * stated.nominal, stated.half_width);
                let size = value.abs();
                // A friction value of which no deviation is stated is meant exactly.
                let free = tolerance > 0.0 || matches!(stated.role, Role::Servo(_));
                if free && size > 0.0 && (tolerance < size || middle > 1.0) {
                    let own = &mut wide.nominal.values[place];
                    let now = own.nominal + own.half_width * at.point.theta[place];
                    (own.nominal, own.half_width) = (value, size);
                    at.point.theta[place] = (now - value) / size;
                }
            }
        }
        let directions = basis(&wide);
        let effort = Effort::full(settings.budget.steps);
        at = fit(&wide, &directions, &nothing, at.point.clone(), effort);
        held = at_an_end(&wide, roles, &at)
            .into_iter()
            .filter(|(joint, deviation)| *deviation > 0.0 && held.contains(joint))
            .map(|(joint, _)| joint)
            .collect();
        held.dedup();
    }
    wide.noise.clone_from(&case.noise);
    (at.train.objective() < (1.0 - settings.criteria.friction_decrease) * before).then_some(wide)
}

/// Joints with a gain of a loop among the roles that is stated as exact.
fn exact(case: &Case, roles: &[Role]) -> Vec<usize> {
    let stated = |joint: &usize| {
        let mut all = roles.iter().filter(|role| matches!(role, Role::Servo(_)));
        all.any(|&role| {
            let place = case.nominal.place(*joint, role);
            place.is_some_and(|i| case.nominal.values[i].half_width == 0.0)
        })
    };
    (0..case.n()).filter(stated).collect()
}

/// Joints with a value in one of the roles at the end of its range, and its deviation away from zero.
fn at_an_end(case: &Case, roles: &[Role], fit: &Fit) -> Vec<(usize, f64)> {
    let places = (0..case.n()).flat_map(|joint| roles.iter().map(move |&role| (joint, role)));
    places
        .filter_map(|(joint, role)| {
            let place = case.nominal.place(joint, role)?;
            let sign = case.nominal.values[place].nominal.signum();
            Some((joint, fit.point.theta[place] * sign))
        })
        .filter(|(_, deviation)| deviation.abs() > HELD)
        .collect()
}

/// Unit of a friction value or a gain.
fn unit(case: &Case, (joint, role): (usize, Role)) -> String {
    let nominal = &case.nominal;
    let unit = match (role, nominal.joints[joint].revolute) {
        (Role::Servo(gain), _) => {
            let servo = nominal.description.servo(joint);
            return servo.map_or_else(String::new, |s| loops::unit(case, s, (joint, gain)));
        }
        (Role::Coulomb, true) => "N m",
        (Role::Coulomb, false) => "N",
        (_, true) => "N m s/rad",
        (_, false) => "N s/m",
    };
    unit.to_owned()
}

/// The values that lie outside what was stated: gains first, as another gain moves friction too.
fn outside(case: &Case, wider: &Evidence) -> Vec<Beyond> {
    let std = deviations(&wider.case, &wider.criteria, &wider.fit);
    let mut out = Vec::new();
    let groups = [&GAINS[..], &FRICTION[..]].into_iter();
    let all = groups
        .flat_map(|roles| (0..case.n()).flat_map(move |j| roles.iter().map(move |r| (j, *r))));
    for (joint, role) in all {
        let Some(place) = case.nominal.place(joint, role) else {
            continue;
        };
        let (stated, own) = (
            &case.nominal.values[place],
            &wider.case.nominal.values[place],
        );
        let value = own.nominal + own.half_width * wider.fit.point.theta[place];
        let least = match (role, stated.half_width) {
            (Role::Servo(_), 0.0) => OTHER * stated.nominal.abs(),
            (_, half_width) => (1.0 + 1e-6) * half_width,
        };
        if (value - stated.nominal).abs() > least {
            out.push(Beyond {
                parameter: role_name(role).to_owned(),
                joint: joint + 1,
                unit: unit(case, (joint, role)),
                stated: stated.nominal,
                tolerance: stated.half_width,
                value,
                std: std.as_ref().map(|s| own.half_width * s[place]),
            });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::pendulum;
    use crate::diagnosis::{Diagnosis, Verdict};
    use crate::effect::Term;
    use crate::effects;

    /// A pendulum with an effect whose description states other friction (Coulomb, viscous; ± 40 %)
    /// than it has: 0.1 N·m and 0.08 N·m·s/rad.
    fn misjudged(effect: Option<(&str, &[f64])>, stated: [f64; 2]) -> Diagnosis {
        let terms = effect
            .iter()
            .map(|(id, _)| Term {
                effect: effects::by_id(id).expect("an effect"),
                joint: 0,
            })
            .collect();
        let hypothesis = Hypothesis::new(terms);
        let mut case = pendulum(&hypothesis, effect.map_or(&[], |e| e.1), 6.0, &|_| {});
        for (role, value) in FRICTION.into_iter().zip(stated) {
            let place = case.nominal.place(0, role).expect("a friction");
            let own = &mut case.nominal.values[place];
            (own.nominal, own.half_width) = (value, 0.4 * value);
        }
        crate::search::diagnose(&case, &Settings::default())
    }

    #[test]
    fn friction_that_is_stated_too_low_is_the_cause() {
        let d = misjudged(None, [0.1, 0.02]);
        assert_eq!(d.verdict, Verdict::OutsideTolerance { joint: 1 });
        let [viscous] = &d.beyond_tolerance[..] else {
            panic!("{:?}", d.beyond_tolerance);
        };
        assert_eq!(viscous.parameter, "viscous");
        let std = viscous.std.expect("determined");
        assert!(
            (viscous.value - 0.08).abs() < 4.0 * std && std < 0.004,
            "{viscous:?}"
        );
        assert!(
            d.gap_before > 3.0 * d.gap_after,
            "{} {}",
            d.gap_before,
            d.gap_after
        );
        let described = misjudged(None, [0.1, 0.08]);
        assert_eq!(described.verdict, Verdict::Nothing);
        assert!(
            d.gap_after < 1.1 * described.gap_after,
            "{} {}",
            d.gap_after,
            described.gap_after
        );
        assert!(
            viscous
                .words()
                .starts_with("viscous friction of joint 1 0.08")
                && viscous.words().contains("N m s/rad (stated 0.02 ± 0.008)"),
            "{}",
            viscous.words()
        );
    }

    #[test]
    fn an_effect_is_found_beside_friction_that_is_stated_too_high() {
        let d = misjudged(Some(("joint_elasticity", &[0.004, 0.001])), [0.4, 0.08]);
        assert_eq!(
            (d.verdict.word(), d.verdict.joint()),
            ("joint_elasticity", Some(1))
        );
        assert!(
            (d.effects[0].parameters[0].value - 250.0).abs() < 15.0,
            "{:?}",
            d.effects
        );
        let coulomb = &d.beyond_tolerance[0];
        assert_eq!(coulomb.parameter, "coulomb");
        assert!((coulomb.value - 0.1).abs() < 0.02, "{coulomb:?}");
    }

    #[test]
    fn friction_within_its_tolerance_is_no_cause() {
        let d = misjudged(None, [0.12, 0.07]);
        assert_eq!(d.verdict, Verdict::Nothing);
        assert!(d.beyond_tolerance.is_empty(), "{:?}", d.beyond_tolerance);
    }
}
