//! What the records say of the gains of position loops, and what they leave open.

use pid_interpret::nominal::{Gain, Role as Part, Servo};

use super::spread::Spread;
use crate::case::Case;
use crate::criteria::Criteria;
use crate::fit::{Fit, PRIOR};
use crate::loop_gain::{LoopGain, Told, Trade};
use crate::nominal::role_name;

/// Deviations to either side of an interval of 95 %.
const SIDES: f64 = 1.96;
/// A gain is determined where its interval of 95 % lies within this share of it to either side.
const DETERMINED: f64 = 0.05;
/// Share of the deviation that its tolerance leaves a gain beyond which the records say nothing of it:
/// its variance is at least half of that before.
const OPEN: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Deviation, in tolerances, from which a value counts as held by its tolerance.
const HELD: f64 = 0.999;
/// Correlation from which a value moves together with a gain.
const TOGETHER: f64 = 0.5;
/// Most values that are told to move with a gain.
const PARTNERS: usize = 4;

/// The gains of all position loops that are not exact, joint by joint.
pub(super) fn loop_gains(case: &Case, criteria: &Criteria, fit: &Fit) -> Vec<LoopGain> {
    if !case.nominal.description.has_servos() {
        return Vec::new();
    }
    let spread = Spread::new(case, criteria, fit);
    let mut out = Vec::new();
    for joint in 0..case.n() {
        let Some(servo) = case.nominal.description.servo(joint) else {
            continue;
        };
        for gain in servo.gains() {
            let Some(place) = case.nominal.place(joint, Part::Servo(gain)) else {
                continue;
            };
            let own = &case.nominal.values[place];
            if own.half_width == 0.0 {
                continue;
            }
            let deviation = fit.point.theta[place];
            let value = own.nominal + own.half_width * deviation;
            let std = spread.as_ref().map(|s| s.deviation(place));
            let std = std.filter(|std| std.is_finite());
            let told = match std {
                _ if deviation.abs() > HELD => Told::AtItsTolerance,
                Some(std) if SIDES * std * own.half_width <= DETERMINED * value.abs() => {
                    Told::Determined
                }
                Some(std) if std < OPEN * PRIOR => Told::Roughly,
                _ => Told::Open,
            };
            let partners = match (told, &spread) {
                (Told::Determined, _) | (_, None) => Vec::new(),
                (_, Some(spread)) => partners(case, fit, &spread.curved, place),
            };
            let stated = servo.gain(gain);
            out.push(LoopGain {
                joint: joint + 1,
                gain: gain.key().to_owned(),
                unit: unit(case, servo, (joint, gain)),
                stated: stated.value,
                tolerance: stated.value.map(|_| stated.half_width),
                value,
                std: std.map(|std| std * own.half_width),
                told,
                together: partners,
            });
        }
    }
    out
}

/// Unit of a gain.
pub(super) fn unit(case: &Case, servo: &Servo, (joint, gain): (usize, Gain)) -> String {
    let robot = case.nominal.description.robot();
    let input = robot.inputs.get(joint).map_or("1", |input| &input.unit);
    let position = match case.nominal.joints[joint].revolute {
        true => "rad",
        false => "m",
    };
    servo.unit(gain, input, position)
}

/// What moves together with a value that the records leave open: along the regression on it, the
/// direction in which the misfit grows least, in shares of each value per share of the first.
fn partners(
    case: &Case,
    fit: &Fit,
    covariance: &nalgebra::DMatrix<f64>,
    place: usize,
) -> Vec<Trade> {
    let values = &case.nominal.values;
    let size = values.len();
    let at = |i: usize| values[i].nominal + values[i].half_width * fit.point.theta[i];
    let own = at(place);
    let share = values[place].half_width / own;
    let correlation = |i: usize| {
        let both = covariance[(i, i)] * covariance[(place, place)];
        covariance[(i, place)] / both.max(1e-300).sqrt()
    };
    let change = |i: usize, scale: f64| {
        covariance[(i, place)] / covariance[(place, place)].max(1e-300) * scale / share
    };
    let mut all: Vec<(f64, Trade)> = (0..size)
        .filter(|&i| i != place && values[i].half_width > 0.0 && at(i) != 0.0)
        .map(|i| {
            let trade = Trade {
                parameter: role_name(values[i].role).to_owned(),
                joint: values[i].joint.map(|j| j + 1),
                change: change(i, values[i].half_width / at(i)),
            };
            (correlation(i), trade)
        })
        .collect();
    let (starts, _) = fit.hypothesis.offsets();
    for (term, start) in fit.hypothesis.terms.iter().zip(starts) {
        let info = term.effect.info();
        for (k, p) in info.parameters.iter().enumerate() {
            let e = fit.point.e[start + k];
            if e != 0.0 {
                let i = size + start + k;
                let trade = Trade {
                    parameter: format!("{} of {}", p.name, info.id),
                    joint: term.shown_joint(),
                    change: change(i, 1.0 / e),
                };
                all.push((correlation(i), trade));
            }
        }
    }
    all.retain(|(c, _)| c.abs() > TOGETHER);
    all.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    all.into_iter()
        .take(PARTNERS)
        .map(|(_, trade)| trade)
        .collect()
}
