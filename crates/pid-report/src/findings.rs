//! Turns figures into sentences.

use pid_data::{Horizon, Role};
use pid_fit::gap::correlation_ratio;
use pid_fit::gap::metrics::FreeRunScore;
use pid_page::number::{short, unit};

use crate::{Direction, ForceBin, MissingForce, ParameterRow};

/// A share of the missing force's variance below this is no dependence.
const CLEAR: f64 = 0.35;
/// Slow means are those below this share of the fastest class.
const SLOW: f64 = 0.15;
/// A joint whose missing force is a smaller share of the whole gets no sentence of its own.
const SMALL: f64 = 0.01;

/// Sentences on missing forces, errors and parameters, the most important first.
pub(crate) fn findings(
    forces: &[MissingForce],
    free_run: &[FreeRunScore],
    parameters: &[ParameterRow],
) -> Vec<String> {
    let mut out = Vec::new();
    let mut ordered: Vec<&MissingForce> = forces.iter().collect();
    ordered.sort_by(|a, b| b.share.total_cmp(&a.share));
    for force in ordered {
        out.extend(missing_force(force));
    }
    out.extend(generalisation(free_run));
    let names = |which: &dyn Fn(&ParameterRow) -> bool| {
        parameters
            .iter()
            .filter(|p| which(p))
            .map(|p| p.name.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    };
    let bound = names(&|p| p.at_bound.is_some());
    if !bound.is_empty() {
        out.push(format!(
            "At a bound: {bound}. The data ask for values beyond it; the model may use these parameters to imitate something it lacks."
        ));
    }
    let open = names(&|p| p.deviation.is_none() && !p.fixed);
    if !open.is_empty() {
        out.push(format!("Not determined one by one: {open}. Only combinations of them enter the motion, or the records do not excite them."));
    }
    out
}

fn missing_force(f: &MissingForce) -> Vec<String> {
    let unit = unit(&f.unit);
    let deviation = f.band_rms.map(|b| 0.5 * b);
    if deviation.is_some_and(|n| f.rms <= 2.0 * n) {
        return vec![format!(
            "Joint {}: the missing force (RMS {} {unit}) is not clearly different from zero: the records tell it to ±{} {unit} (one standard deviation).",
            f.joint,
            short(f.rms),
            short(deviation.unwrap_or_default())
        )];
    }
    if f.share < SMALL {
        return vec![format!(
            "Joint {}: the missing force is below 1 % of the whole force ({} of {} {unit} RMS).",
            f.joint,
            short(f.rms),
            short(f.total_rms)
        )];
    }
    let mut text = format!(
        "Joint {}: a force of {} {unit} RMS is missing, {:.1} % of the whole force",
        f.joint,
        short(f.rms),
        100.0 * f.share
    );
    if let Some(n) = deviation {
        text += &format!(
            "; the records tell it to ±{} {unit} (one standard deviation)",
            short(n)
        );
    }
    text.push('.');
    let mut out = vec![text];
    let (velocity, position) = (explained(&f.by_velocity), explained(&f.by_position));
    if velocity > CLEAR && velocity > position {
        out.push(format!(
            "Joint {}: {:.0} % of its variance follows the velocity and the direction of motion ({:.0} % the position): {}",
            f.joint,
            100.0 * velocity,
            100.0 * position,
            friction(f, &unit)
        ));
    } else if position > CLEAR {
        out.push(format!(
            "Joint {}: {:.0} % of its variance follows the position ({:.0} % the velocity): a spring, a cable, a gravity or transmission term is missing.",
            f.joint,
            100.0 * position,
            100.0 * velocity
        ));
    }
    out
}

/// A force with its sign, also above zero.
fn signed(w: f64) -> String {
    let sign = if w > 0.0 { "+" } else { "" };
    format!("{sign}{}", short(w))
}

/// Words on a force that follows the velocity: its means when slow and when fast.
fn friction(f: &MissingForce, unit: &str) -> String {
    let fastest = f.by_velocity.iter().map(|b| b.at.abs()).fold(0.0, f64::max);
    let mean = |direction: Direction, slow: bool| {
        let (mut sum, mut n) = (0.0, 0.0);
        for b in f.by_velocity.iter().filter(|b| b.direction == direction) {
            if (b.at.abs() < SLOW * fastest) == slow {
                sum += b.mean * b.count as f64;
                n += b.count as f64;
            }
        }
        if n > 0.0 { Some(sum / n) } else { None }
    };
    let words = |slow| {
        let part = |d| mean(d, slow).map_or_else(|| "–".to_owned(), signed);
        format!(
            "{} forward, {} backward",
            part(Direction::Forward),
            part(Direction::Backward)
        )
    };
    let limit = format!("{} {}", short(SLOW * fastest), f.velocity_unit);
    format!(
        "mean {unit} below {limit}: {}; above: {}. The friction law of this joint is not complete.",
        words(true),
        words(false)
    )
}

/// Share of the variance that lies between the classes, adjusted for their number.
fn explained(bins: &[ForceBin]) -> f64 {
    let n: f64 = bins.iter().map(|b| b.count as f64).sum();
    if n == 0.0 {
        return 0.0;
    }
    let mean = bins.iter().map(|b| b.mean * b.count as f64).sum::<f64>() / n;
    let between: f64 = bins
        .iter()
        .map(|b| (b.mean - mean).powi(2) * b.count as f64)
        .sum();
    let within: f64 = bins
        .iter()
        .map(|b| b.spread * b.spread * b.count as f64)
        .sum();
    correlation_ratio(within, between + within, n, bins.len() as f64)
}

/// How the error on unseen records compares with that on fitted ones, at the longest horizon below
/// the whole record. All test records together stand before the single ones.
fn generalisation(free_run: &[FreeRunScore]) -> Option<String> {
    let mut tests = free_run
        .iter()
        .filter(|s| s.role == Role::Test && s.horizon != Horizon::Record);
    let longest = tests.clone().next_back()?.horizon;
    let test = tests.find(|s| s.horizon == longest)?;
    let train = free_run
        .iter()
        .find(|s| s.role == Role::Train && s.horizon == test.horizon)?;
    let (a, b) = (train.objective?.sqrt(), test.objective?.sqrt());
    let parts: Vec<String> = test
        .joints
        .iter()
        .filter_map(|j| j.q.map(|q| format!("{} {}", j.joint, short(q.rms))))
        .collect();
    let ratio = if a > 0.0 { b / a } else { return None };
    let verdict = if ratio > 2.0 {
        "the fit does not carry over well to motions it has not seen"
    } else {
        "the fit carries over to motions it has not seen"
    };
    Some(format!(
        "Free run on the test records, restarted every {}: RMS {} (rad or m); {:.1} times the error on the fitted records, {verdict}.",
        test.horizon,
        parts.join(", "),
        ratio
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_fit::gap::metrics::{ChannelError, JointError};

    fn force(by_velocity: Vec<ForceBin>, by_position: Vec<ForceBin>, share: f64) -> MissingForce {
        MissingForce {
            joint: "elbow".into(),
            unit: "N*m".into(),
            position_unit: "rad".into(),
            velocity_unit: "rad/s".into(),
            rms: 2.0,
            total_rms: 2.0 / share,
            share,
            band_rms: Some(0.2),
            over_time: Vec::new(),
            samples: Vec::new(),
            by_velocity,
            by_position,
        }
    }

    fn bin(direction: Direction, at: f64, mean: f64) -> ForceBin {
        ForceBin {
            direction,
            at,
            mean,
            spread: 0.1,
            count: 50,
        }
    }

    #[test]
    fn friction_and_springs_are_told_apart() {
        let friction = vec![
            bin(Direction::Forward, 0.1, -3.0),
            bin(Direction::Forward, 2.0, 0.1),
            bin(Direction::Backward, -0.1, 3.0),
            bin(Direction::Backward, -2.0, -0.1),
        ];
        let flat = vec![
            bin(Direction::Forward, 1.0, 0.0),
            bin(Direction::Backward, 2.0, 0.0),
        ];
        let text = findings(&[force(friction.clone(), flat.clone(), 0.2)], &[], &[]).join("\n");
        assert!(
            text.contains("follows the velocity") && text.contains("−3 forward, +3 backward"),
            "{text}"
        );
        let text = findings(&[force(flat.clone(), friction, 0.2)], &[], &[]).join("\n");
        assert!(text.contains("follows the position"), "{text}");
        let text = findings(&[force(flat.clone(), flat, 0.005)], &[], &[]).join("\n");
        assert!(text.contains("below 1 %"), "{text}");
    }

    fn score(experiments: &[&str], role: Role, seconds: f64, rms: f64) -> FreeRunScore {
        FreeRunScore {
            experiments: experiments.iter().map(|s| (*s).to_owned()).collect(),
            role,
            horizon: Horizon::Seconds(seconds),
            joints: vec![JointError {
                joint: "servo".into(),
                q: Some(ChannelError {
                    rms,
                    mae: rms,
                    max: rms,
                    count: 100,
                }),
                v: None,
            }],
            objective: Some(rms * rms),
            windows: 1,
            diverged: 0,
            skipped: 0,
        }
    }

    #[test]
    fn all_test_records_together_are_held_against_the_fitted_ones() {
        let scores = [
            score(&["a", "b"], Role::Train, 0.1, 0.01),
            score(&["c", "d"], Role::Test, 0.1, 0.01),
            score(&["a", "b"], Role::Train, 1.0, 0.02),
            score(&["c", "d"], Role::Test, 1.0, 0.06),
            score(&["c"], Role::Test, 1.0, 0.02),
            score(&["d"], Role::Test, 1.0, 0.08),
        ];
        let text = findings(&[], &scores, &[]).join("\n");
        assert!(
            text.contains("restarted every 1 s: RMS servo 0.06 (rad or m); 3.0 times"),
            "{text}"
        );
    }
}
