//! Single wrong readings: bit errors on a bus, dropped digits, glitches of a sensor.
//!
//! A reading is compared with the cubic through its two neighbours on either side,
//!
//! ```text
//! r_k = x_k − Σ_i L_i(t_k) x_i,        i = k−2, k−1, k+1, k+2        (Lagrange weights L_i of the actual stamps)
//! ```
//!
//! and with the robust deviation of these residuals (1.4826 times the median of |r|; F. R. Hampel,
//! J. Amer. Stat. Assoc. 69, 1974), over the whole channel and near the reading, whichever is
//! larger. A large residual alone is no error: at an impact or where dry friction lets go the
//! motion has a kink. An error is a reading whose neighbours agree with each other once it is left
//! out, and that lies off the motion before it as well as off the motion after it; a reading beside a
//! kink lies on one of the two. Up to two wrong readings may stand side by side.

/// Residual beyond which a reading is suspected, in robust deviations. Noise reaches 6 at most; the
/// rest is for small kinks of the motion, which look like errors ([`AGREE`]).
const SUSPECT: f64 = 12.0;
/// Residual of the neighbours, over that of the reading, up to which they agree without it. Without
/// noise it is 0 for a wrong reading and 0.3 for a kink.
const AGREE: f64 = 0.15;
/// Residual of the neighbours that is noise, in robust deviations: its deviation beside a hole of two
/// readings is 1.2 of them.
const NOISE: f64 = 5.0;
/// Least distance of a wrong reading from the motion before and from the motion after, in standard
/// deviations of the extrapolation. Beside a kink one of the two is noise, and 1 of 16 000 reaches 4.
const OFF: f64 = 4.0;
/// Standard deviation of a residual over that of a reading, for even stamps: √(1 + 2·(2/3)² + 2·(1/6)²).
const INTERPOLATED: f64 = 1.394;
/// Readings on either side over which the local deviation is taken.
const NEAR: usize = 25;
/// Share of a channel's readings beyond which what looks like errors is the nature of the channel
/// (a chattering input).
const MOST: f64 = 0.01;

/// Indices of wrong readings of one channel, increasing; missing readings (NaN) are skipped.
///
/// `t` are the stamps (s), increasing; `x` the readings; `least` a deviation below which nothing is
/// noticed (a quantum of the sensor), in the unit of `x`. Empty where more than 1 % of the readings
/// would be left out.
pub fn outliers(t: &[f64], x: &[f64], least: f64) -> Vec<usize> {
    let mut known: Vec<usize> = (0..x.len()).filter(|&i| x[i].is_finite()).collect();
    let count = known.len();
    let mut found = Vec::new();
    let scale = scales(t, x, &known, least);
    let mut suspects: Vec<(f64, usize)> = (0..known.len())
        .filter_map(|i| {
            let r = residual(t, x, &known, i)?.abs() / scale[i];
            (r > SUSPECT).then_some((r, known[i]))
        })
        .collect();
    suspects.sort_by(|a, b| b.0.total_cmp(&a.0));
    let deviation: std::collections::HashMap<usize, f64> =
        known.iter().copied().zip(scale.iter().copied()).collect();
    for (_, k) in suspects {
        let Ok(i) = known.binary_search(&k) else {
            continue;
        };
        // An error that was found nearby may have been all that was wrong here.
        let limit = SUSPECT * deviation[&k];
        if residual(t, x, &known, i).is_none_or(|r| r.abs() <= limit) {
            continue;
        }
        // A neighbour alone explains it as well as the reading; both only where neither does.
        let before = i.saturating_sub(1);
        // Beside a pair the next reading is off by half the error, each of the pair by a third.
        let pair = i.saturating_sub(2)..i;
        for group in [
            i..i + 1,
            i + 1..i + 2,
            before..i,
            i..i + 2,
            before..i + 1,
            i + 1..i + 3,
            pair,
        ] {
            if let Some(left) = agree_without(t, x, &known, group.clone(), limit) {
                found.extend(known[group].iter().copied());
                known = left;
                break;
            }
        }
    }
    found.sort_unstable();
    if found.len() as f64 > MOST * count as f64 {
        found.clear();
    }
    found
}

/// The known readings without a group, if those on either side of it agree then.
fn agree_without(
    t: &[f64],
    x: &[f64],
    known: &[usize],
    group: std::ops::Range<usize>,
    limit: f64,
) -> Option<Vec<usize>> {
    if group.end > known.len() || group.start < 2 || group.end + 2 > known.len() {
        return None;
    }
    let own = group
        .clone()
        .filter_map(|i| residual(t, x, known, i))
        .fold(0.0, |m: f64, r| m.max(r.abs()));
    let noise = limit / (SUSPECT * INTERPOLATED);
    let (first, last) = (group.start, group.end - 1);
    if first < 3 || last + 3 >= known.len() {
        return None;
    }
    let before = extrapolated(t, x, known[first], &known[first - 3..first]);
    let after = extrapolated(t, x, known[last], &known[last + 1..last + 4]);
    if before.min(after) < OFF * noise {
        return None;
    }
    let mut left = known.to_vec();
    left.drain(group.clone());
    let allowed = (AGREE * own).max(NOISE / SUSPECT * limit);
    (group.start.saturating_sub(2)..(group.start + 2).min(left.len()))
        .filter_map(|i| residual(t, x, &left, i))
        .all(|r| r.abs() <= allowed)
        .then_some(left)
}

/// Distance of reading `k` from the parabola through three others, over what a unit of noise in each gives.
fn extrapolated(t: &[f64], x: &[f64], k: usize, nodes: &[usize]) -> f64 {
    let (residual, gain) = off(t, x, k, nodes);
    residual.abs() / gain
}

/// Residual of the `i`-th known reading against its four neighbours; none within two readings of an end.
fn residual(t: &[f64], x: &[f64], known: &[usize], i: usize) -> Option<f64> {
    if i < 2 || i + 2 >= known.len() {
        return None;
    }
    let nodes = [known[i - 2], known[i - 1], known[i + 1], known[i + 2]];
    Some(off(t, x, known[i], &nodes).0)
}

/// Reading `k` less the polynomial through the nodes, and the deviation of that for readings of deviation 1.
fn off(t: &[f64], x: &[f64], k: usize, nodes: &[usize]) -> (f64, f64) {
    let (mut predicted, mut square) = (0.0, 1.0);
    for (a, &i) in nodes.iter().enumerate() {
        let mut weight = 1.0;
        for (b, &j) in nodes.iter().enumerate() {
            if a != b {
                weight *= (t[k] - t[j]) / (t[i] - t[j]);
            }
        }
        predicted += weight * x[i];
        square += weight * weight;
    }
    (x[k] - predicted, f64::sqrt(square))
}

/// Robust deviation of the residuals around each known reading: that of the channel or that of the
/// neighbourhood, whichever is larger.
fn scales(t: &[f64], x: &[f64], known: &[usize], least: f64) -> Vec<f64> {
    let sizes: Vec<f64> = (0..known.len())
        .map(|i| residual(t, x, known, i).map_or(0.0, f64::abs))
        .collect();
    let robust = |range: &[f64]| {
        let mut sorted = range.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).map_or(0.0, |m| 1.4826 * m)
    };
    // Residuals of a channel without noise are rounding.
    let size = known.iter().fold(0.0, |m: f64, &k| m.max(x[k].abs()));
    let all = robust(&sizes)
        .max(least)
        .max(1e-12 * size)
        .max(f64::MIN_POSITIVE);
    (0..sizes.len())
        .map(|i| {
            let near = i.saturating_sub(NEAR)..(i + NEAR + 1).min(sizes.len());
            robust(&sizes[near]).max(all)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::outliers;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const H: f64 = 2e-3;

    /// Sum of twelve uniform numbers: deviation 1, nearly normal.
    fn normal(random: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    fn record(seed: u64, motion: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let t: Vec<f64> = (0..3000)
            .map(|k| H * (f64::from(k) + 0.1 * random.random::<f64>()))
            .collect();
        let x = t
            .iter()
            .map(|&t| motion(t) + 5e-5 * normal(&mut random))
            .collect();
        (t, x)
    }

    fn tones(t: f64) -> f64 {
        0.6 * (3.1 * t).sin() + 0.2 * (11.0 * t).cos()
    }

    #[test]
    fn clean_motion_has_none() {
        for seed in 0..500 {
            let (t, x) = record(seed, tones);
            assert_eq!(outliers(&t, &x, 0.0), [], "seed {seed}");
        }
    }

    #[test]
    fn single_and_double_errors_are_found_and_nothing_else() {
        for seed in 0..500 {
            let (t, mut x) = record(seed, tones);
            for k in [300, 1200, 1201, 2500] {
                x[k] += 4e-3;
            }
            x[2000] = f64::NAN;
            x[2002] -= 0.03;
            assert_eq!(
                outliers(&t, &x, 0.0),
                [300, 1200, 1201, 2002, 2500],
                "seed {seed}"
            );
        }
    }

    #[test]
    fn a_kink_of_the_motion_is_no_error() {
        // Velocity jumps by 2 rad/s at an impact: 4e-3 rad a sample beside a noise of 5e-5.
        for seed in 0..500 {
            let (t, x) = record(seed, |t| (t - 3.0).abs());
            assert_eq!(outliers(&t, &x, 0.0), [], "seed {seed}");
        }
    }

    #[test]
    fn steps_of_an_encoder_are_no_errors() {
        let quantum = 1e-3;
        let t: Vec<f64> = (0..3000).map(|k| H * f64::from(k)).collect();
        let x: Vec<f64> = t
            .iter()
            .map(|&t| (0.01 * (0.5 * t).sin() / quantum).round() * quantum)
            .collect();
        assert_eq!(outliers(&t, &x, quantum), []);
    }

    #[test]
    fn an_input_that_chatters_keeps_all_its_readings() {
        let (t, mut x) = record(1, tones);
        for k in (10..2990).step_by(40) {
            x[k] += 1.0;
        }
        assert_eq!(outliers(&t, &x, 0.0), []);
    }
}
