//! Friction outside the tolerance that was stated for it.
//!
//! Friction is what a description knows least, and no effect of the library stands for another level of it. Where nothing explains
//! the records and the nominal structure is fitted with a friction value at the end of its tolerance, both friction values of that
//! joint may lie anywhere from zero upwards, and everything is looked for once more.

use pid_interpret::nominal::Role;

use super::magnitude::deviations;
use super::search::search;
use super::{Beyond, Found, Magnitude, Named, Settings};
use crate::case::Case;
use crate::fit::{Effort, Fit, all_gains, basis, fit};
use crate::nominal::role_name;
use crate::simulate::Hypothesis;

/// The friction values of a joint.
const FRICTION: [Role; 2] = [Role::Coulomb, Role::Viscous];
/// Deviation, in tolerances, from which a value counts as held by its tolerance.
const HELD: f64 = 0.999;
/// Middle of the wider ranges over the nominal value; each range starts at zero.
const MIDDLES: [f64; 2] = [1.0, 4.0];
/// Relative decrease of the objective of the nominal structure without which friction is not the reason.
const WORTH: f64 = 0.02;

/// Looks again with wider ranges of friction where a tolerance holds it; `None` where none does or it is not the reason.
pub(super) fn wider(case: &Case, settings: &Settings, found: &Found) -> Option<Found> {
    let wide = widened(case, settings, found)?;
    let mut wider = search(&wide, settings);
    wider.diagnosis.refits += found.diagnosis.refits;
    Some(wider)
}

/// Says in a diagnosis that was made with wider ranges what lies outside the stated ones; what was before is the nominal structure
/// within them.
pub(super) fn describe(stated: Found, wider: &mut Found) {
    let beyond = outside(&stated.case, wider);
    let d = &mut wider.diagnosis;
    d.gap_before = stated.diagnosis.gap_before;
    d.gap_intervals.0 = stated.diagnosis.gap_intervals.0;
    d.gap_joints_before = stated.diagnosis.gap_joints_before;
    d.misfit.0 = stated.diagnosis.misfit.0;
    let theta = &mut wider.base.point.theta;
    theta.clone_from(&stated.base.point.theta);
    let values = stated.case.nominal.values.iter();
    for (k, (old, own)) in values.zip(&wider.case.nominal.values).enumerate() {
        if FRICTION.contains(&own.role) && own.half_width > 0.0 {
            let value = old.nominal + old.half_width * theta[k];
            theta[k] = (value - own.nominal) / own.half_width;
        }
    }
    let base = &mut wider.base;
    base.gains = all_gains(&wider.case, &base.hypothesis, &base.point);
    let squares = [d.gap_before, d.gap_after, d.gap_floor].map(|gap| gap * gap);
    if let Some(remainder) = &mut d.remainder
        && squares[0] > squares[2]
    {
        let explained = (squares[0] - squares[1]) / (squares[0] - squares[2]);
        remainder.explained = explained.clamp(0.0, 1.0);
    }
    if d.effect == "none"
        && let Some(first) = beyond.first()
    {
        // Nothing is missing beside it: another level of friction is the cause.
        d.effect = ALONE.to_owned();
        d.joint = Some(first.joint);
        d.regime = REGIME.to_owned();
        d.effects = named(&beyond);
    }
    d.beyond_tolerance = beyond;
}

/// Name of another level of friction where it is the only cause, and where it shows.
const ALONE: &str = "friction";
const REGIME: &str = "all motion of the joint";

/// One entry per joint whose friction lies outside its tolerance.
fn named(beyond: &[Beyond]) -> Vec<Named> {
    let mut out: Vec<Named> = Vec::new();
    for b in beyond {
        let parameter = Magnitude {
            name: b.parameter.clone(),
            value: b.value,
            std: b.std,
        };
        match out.iter_mut().find(|n| n.joint == Some(b.joint)) {
            Some(n) => n.parameters.push(parameter),
            None => out.push(Named {
                effect: ALONE.to_owned(),
                joint: Some(b.joint),
                parameters: vec![parameter],
                regime: REGIME.to_owned(),
            }),
        }
    }
    out
}

/// The case with wider ranges of the friction values that a tolerance holds, as wide as the nominal structure needs them.
fn widened(case: &Case, settings: &Settings, found: &Found) -> Option<Case> {
    let nothing = Hypothesis::default();
    let mut wide = case.clone();
    wide.noise.clone_from(&found.case.noise);
    let mut at = found.base.clone();
    let before = at.train.objective();
    let mut held: Vec<usize> = [&found.base, &found.fit]
        .iter()
        .flat_map(|f| at_an_end(case, f))
        .map(|(joint, _)| joint)
        .collect();
    held.sort_unstable();
    held.dedup();
    for middle in MIDDLES {
        if held.is_empty() {
            break;
        }
        for &joint in &held {
            for place in FRICTION
                .iter()
                .filter_map(|&role| case.nominal.place(joint, role))
            {
                let stated = &case.nominal.values[place];
                let (value, tolerance) = (middle * stated.nominal, stated.half_width);
                // A value of which no deviation is stated is meant exactly.
                if tolerance > 0.0 && value > 0.0 && (tolerance < value || middle > 1.0) {
                    let own = &mut wide.nominal.values[place];
                    let now = own.nominal + own.half_width * at.point.theta[place];
                    (own.nominal, own.half_width) = (value, value);
                    at.point.theta[place] = (now - value) / value;
                }
            }
        }
        let directions = basis(&wide);
        let effort = Effort::full(settings.steps);
        at = fit(&wide, &directions, &nothing, at.point.clone(), effort);
        held = at_an_end(&wide, &at)
            .into_iter()
            .filter(|(joint, deviation)| *deviation > 0.0 && held.contains(joint))
            .map(|(joint, _)| joint)
            .collect();
        held.dedup();
    }
    wide.noise.clone_from(&case.noise);
    (at.train.objective() < (1.0 - WORTH) * before).then_some(wide)
}

/// Joints with a friction value at the end of its range, and that deviation.
fn at_an_end(case: &Case, fit: &Fit) -> Vec<(usize, f64)> {
    let places = (0..case.n()).flat_map(|joint| FRICTION.map(|role| (joint, role)));
    places
        .filter_map(|(joint, role)| {
            let place = case.nominal.place(joint, role)?;
            Some((joint, fit.point.theta[place]))
        })
        .filter(|(_, deviation)| deviation.abs() > HELD)
        .collect()
}

/// Unit of a friction value.
fn unit(role: Role, revolute: bool) -> &'static str {
    match (role, revolute) {
        (Role::Coulomb, true) => "N m",
        (Role::Coulomb, false) => "N",
        (_, true) => "N m s/rad",
        (_, false) => "N s/m",
    }
}

/// The friction values that lie outside what was stated.
fn outside(case: &Case, wider: &Found) -> Vec<Beyond> {
    let std = deviations(&wider.case, &wider.fit);
    let mut out = Vec::new();
    for joint in 0..case.n() {
        for role in FRICTION {
            let Some(place) = case.nominal.place(joint, role) else {
                continue;
            };
            let (stated, own) = (
                &case.nominal.values[place],
                &wider.case.nominal.values[place],
            );
            let value = own.nominal + own.half_width * wider.fit.point.theta[place];
            if (value - stated.nominal).abs() > (1.0 + 1e-6) * stated.half_width {
                out.push(Beyond {
                    parameter: role_name(role).to_owned(),
                    joint: joint + 1,
                    unit: unit(role, case.nominal.joints[joint].revolute).to_owned(),
                    stated: stated.nominal,
                    tolerance: stated.half_width,
                    value,
                    std: std.as_ref().map(|s| own.half_width * s[place]),
                });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::pendulum;
    use crate::diagnose::investigate;
    use crate::effect::Term;
    use crate::effects;

    /// A pendulum with an effect whose description states other friction (Coulomb, viscous; ± 40 %) than it has: 0.1 N·m and
    /// 0.08 N·m·s/rad.
    fn misjudged(effect: Option<(&str, &[f64])>, stated: [f64; 2]) -> Found {
        let terms = effect
            .iter()
            .map(|(id, _)| Term {
                effect: effects::by_id(id).expect("an effect"),
                joint: 0,
            })
            .collect();
        let hypothesis = Hypothesis { terms };
        let mut case = pendulum(&hypothesis, effect.map_or(&[], |e| e.1), 6.0, &|_| {});
        for (role, value) in FRICTION.into_iter().zip(stated) {
            let place = case.nominal.place(0, role).expect("a friction");
            let own = &mut case.nominal.values[place];
            (own.nominal, own.half_width) = (value, 0.4 * value);
        }
        investigate(&case, &Settings::default())
    }

    #[test]
    fn friction_that_is_stated_too_low_is_the_cause() {
        let d = misjudged(None, [0.1, 0.02]).diagnosis;
        assert_eq!((d.effect.as_str(), d.joint), ("friction", Some(1)));
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
        let described = misjudged(None, [0.1, 0.08]).diagnosis;
        assert_eq!(described.effect, "none");
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
                && viscous
                    .words()
                    .contains("N m s/rad (stated 0.0200 ± 0.0080)"),
            "{}",
            viscous.words()
        );
    }

    #[test]
    fn an_effect_is_found_beside_friction_that_is_stated_too_high() {
        let d = misjudged(Some(("joint_elasticity", &[0.004, 0.001])), [0.4, 0.08]).diagnosis;
        assert_eq!((d.effect.as_str(), d.joint), ("joint_elasticity", Some(1)));
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
        let d = misjudged(None, [0.12, 0.07]).diagnosis;
        assert_eq!(d.effect, "none");
        assert!(d.beyond_tolerance.is_empty(), "{:?}", d.beyond_tolerance);
    }
}
