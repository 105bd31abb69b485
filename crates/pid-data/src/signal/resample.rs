//! Changing the grid of samples.

use super::{Butterworth, FilterError, map_columns};

/// How values between samples are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Straight lines.
    Linear,
    /// Cubic Hermite pieces whose slopes are those of [`super::central_differences`]: third order,
    /// one derivative continuous.
    #[default]
    Cubic,
}

/// `n` equally spaced times from `start` with step `h`, s.
pub fn uniform_times(start: f64, h: f64, n: usize) -> Vec<f64> {
    (0..n).map(|i| start + i as f64 * h).collect()
}

/// Values of one channel at other times.
///
/// `t` strictly increasing, `x` of the same length; times outside of the record get the value at its end.
pub fn resample(t: &[f64], x: &[f64], at: &[f64], how: Interpolation) -> Vec<f64> {
    let n = t.len().min(x.len());
    if n == 0 {
        return vec![f64::NAN; at.len()];
    }
    let slopes = match how {
        Interpolation::Cubic => super::central_differences(t, x),
        Interpolation::Linear => Vec::new(),
    };
    let mut i = 0;
    at.iter()
        .map(|&time| {
            if time <= t[0] {
                return x[0];
            }
            if time >= t[n - 1] {
                return x[n - 1];
            }
            // Times mostly increase: search from the last place, anew only when they go back.
            if time < t[i] {
                i = t[..n].partition_point(|s| *s <= time) - 1;
            }
            while t[i + 1] <= time {
                i += 1;
            }
            let h = t[i + 1] - t[i];
            let s = (time - t[i]) / h;
            match how {
                Interpolation::Linear => x[i] + s * (x[i + 1] - x[i]),
                Interpolation::Cubic => {
                    let (r, s2) = (1.0 - s, s * s);
                    let r2 = r * r;
                    x[i] * (1.0 + 2.0 * s) * r2
                        + h * slopes[i] * s * r2
                        + x[i + 1] * (3.0 - 2.0 * s) * s2
                        - h * slopes[i + 1] * s2 * r
                }
            }
        })
        .collect()
}

/// Replaces missing samples (NaN) of one channel by straight lines between their neighbours, at the
/// ends by the nearest value; returns how many. A channel without any value is left as it is.
pub fn fill_missing(t: &[f64], x: &mut [f64]) -> usize {
    let known: Vec<usize> = (0..x.len()).filter(|i| !x[*i].is_nan()).collect();
    let gaps = x.len() - known.len();
    if gaps == 0 || known.is_empty() {
        return gaps;
    }
    let known_t: Vec<f64> = known.iter().map(|i| t[*i]).collect();
    let known_x: Vec<f64> = known.iter().map(|i| x[*i]).collect();
    let filled = resample(&known_t, &known_x, t, Interpolation::Linear);
    for (value, new) in x.iter_mut().zip(filled) {
        if value.is_nan() {
            *value = new;
        }
    }
    gaps
}

/// Every `factor`-th sample of row-by-row data, after a zero-phase low-pass (Butterworth of order 8
/// at 80 % of half the new rate) against aliasing. Channels must have no missing samples. A factor
/// of 0 or 1 changes nothing.
///
/// # Errors
/// None for factors above 1; the filter's error is passed on.
pub fn decimate(x: &[f64], columns: usize, factor: usize) -> Result<Vec<f64>, FilterError> {
    if factor <= 1 || columns == 0 {
        return Ok(x.to_vec());
    }
    let filter = Butterworth::low_pass(8, 0.4 / factor as f64, 1.0)?;
    Ok(map_columns(x, columns, |c| {
        filter.both_ways(c).into_iter().step_by(factor).collect()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parabolas_are_met_by_cubic_and_lines_by_linear_interpolation() {
        let t = [0.0, 0.1, 0.3, 0.35, 0.7, 0.9];
        let at = [0.65, 0.05, 0.0, 0.2, 0.9, 0.33];
        let parabola = |t: f64| 1.0 - 2.0 * t + 4.0 * t * t;
        let x = t.map(parabola);
        for (y, t) in resample(&t, &x, &at, Interpolation::Cubic).iter().zip(at) {
            assert!((y - parabola(t)).abs() < 1e-12);
        }
        let line = |t: f64| 1.0 - 2.0 * t;
        let x = t.map(line);
        for (y, t) in resample(&t, &x, &at, Interpolation::Linear).iter().zip(at) {
            assert!((y - line(t)).abs() < 1e-12);
        }
        assert_eq!(
            resample(&t, &x, &[-1.0, 2.0], Interpolation::Cubic),
            [x[0], x[5]]
        );
    }

    #[test]
    fn gaps_are_bridged() {
        let t = [0.0, 1.0, 2.0, 4.0, 5.0];
        let mut x = [f64::NAN, 1.0, f64::NAN, 4.0, f64::NAN];
        assert_eq!(fill_missing(&t, &mut x), 3);
        assert_eq!(x, [1.0, 1.0, 2.0, 4.0, 4.0]);
        let mut none = [f64::NAN; 2];
        assert_eq!(fill_missing(&t[..2], &mut none), 2);
        assert!(none[0].is_nan());
    }

    #[test]
    fn decimation_keeps_slow_motion_and_removes_what_would_alias() {
        let n = 2000;
        let wave = |f: f64| move |i: usize| (std::f64::consts::TAU * f * i as f64).sin();
        let (slow, fast) = (wave(0.004), wave(0.0975));
        let x: Vec<f64> = (0..n).flat_map(|i| [slow(i), slow(i) + fast(i)]).collect();
        let y = decimate(&x, 2, 10).unwrap();
        assert_eq!(y.len(), 2 * n / 10);
        for i in 20..180 {
            assert!((y[2 * i] - slow(10 * i)).abs() < 1e-3);
            assert!(
                (y[2 * i + 1] - slow(10 * i)).abs() < 1e-3,
                "the fast wave would fold to 0.025 per sample"
            );
        }
        assert_eq!(decimate(&x, 2, 1).unwrap(), x);
    }
}
