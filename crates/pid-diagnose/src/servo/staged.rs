//! Where effects that are stages of a position loop start: its law with a stage that is not stated, fitted to inputs.

use pid_interpret::nominal::{Gain, Role as Part, Servo, ServoGain};

use super::followed::{Fitted, Followed, followed};
use crate::case::{Case, Staged};
use crate::effect::Term;

/// Share of what a law leaves of its inputs that one with a further stage leaves at most, for its gains to widen the
/// range of unknown ones. Of eleven drawn loops of unknown gains with all stages stated (`pid-studies servo --joints 1
/// --seed 371001`) three are below it; a wide range costs them no verdict.
const DECIDED: f64 = 0.5;

/// The parameters of an effect and the deviations of the robot to start from, from those at hand, if the effect is this
/// stage.
pub(crate) fn start(
    case: &Case,
    own: &Staged,
    term: &Term,
    theta: &[f64],
) -> Option<(Vec<f64>, Vec<f64>)> {
    if term.joint != own.joint || term.effect.stage() != Some(own.stage) {
        return None;
    }
    let parameter = term.effect.info().parameters.first()?;
    let unit = case.unit(parameter.unit, own.joint);
    let value = own
        .value
        .clamp(parameter.lower * unit, parameter.upper * unit);
    let mut theta = theta.to_vec();
    for &(place, gain) in &own.gains {
        let stated = &case.nominal.values[place];
        if stated.half_width > 0.0 {
            let deviation = (gain - stated.nominal) / stated.half_width;
            theta[place] = deviation.clamp(-1.0, 1.0);
        }
    }
    Some((vec![value], theta))
}

/// The laws of a joint with each stage that its loop can have and does not state, those that explain more than its own.
pub(super) fn laws(
    case: &Case,
    (j, servo): (usize, &Servo),
    inputs: &[Fitted<'_>],
    own: &Followed,
) -> Vec<(Gain, Followed)> {
    let with = |&stage: &Gain| {
        let mut with = servo.clone();
        with.set(stage, ServoGain::default());
        let found = followed(case, (j, &with), inputs)?;
        (found.explained > own.explained).then_some((stage, found))
    };
    let lacking = Gain::BESIDE.iter().filter(|&&stage| servo.lacks(stage));
    lacking.filter_map(with).collect()
}

/// The one of some laws that explains most.
pub(super) fn best<'a>(laws: impl Iterator<Item = &'a Followed>) -> Option<&'a Followed> {
    laws.max_by(|a, b| a.explained.total_cmp(&b.explained))
}

/// The law among them that leaves so little that its gains are nearer to the real ones.
pub(super) fn decided<'a>(laws: &'a [(Gain, Followed)], own: &Followed) -> Option<&'a Followed> {
    let best = best(laws.iter().map(|(_, law)| law))?;
    (1.0 - best.explained < DECIDED * (1.0 - own.explained)).then_some(best)
}

/// The same as starts.
pub(super) fn starts(
    case: &Case,
    j: usize,
    servo: &Servo,
    laws: &[(Gain, Followed)],
) -> Vec<Staged> {
    let gain = |law: &Followed, gain: Gain| {
        let place = case.nominal.place(j, Part::Servo(gain))?;
        Some((place, law.gains[gain as usize]))
    };
    let of = |(stage, law): &(Gain, Followed)| Staged {
        joint: j,
        stage: *stage,
        value: law.gains[*stage as usize],
        gains: servo.gains().filter_map(|own| gain(law, own)).collect(),
    };
    laws.iter().map(of).collect()
}
