//! Differentiation of sampled channels.

/// Derivative of one channel by central differences on a grid that need not be uniform.
///
/// With `h₋ = t_i − t_{i−1}`, `h₊ = t_{i+1} − t_i` the slope of the parabola through three neighbours,
///
/// ```text
/// x'(t_i) ≈ (h₋ (x_{i+1} − x_i)/h₊ + h₊ (x_i − x_{i−1})/h₋) / (h₋ + h₊),      error h₋ h₊ x'''/6,
/// ```
///
/// and at both ends the slope of the end parabola there (error of the same order). Two samples give
/// the slope of their chord, fewer give zeros. `t` and `x` have the same length.
pub fn central_differences(t: &[f64], x: &[f64]) -> Vec<f64> {
    let n = t.len().min(x.len());
    if n < 2 {
        return vec![0.0; n];
    }
    let chord = |i: usize| (x[i + 1] - x[i]) / (t[i + 1] - t[i]);
    if n == 2 {
        return vec![chord(0); 2];
    }
    let mut out = Vec::with_capacity(n);
    // The end parabola's slope: chord minus half its second difference.
    let bend = |i: usize| (chord(i + 1) - chord(i)) / (t[i + 2] - t[i]);
    out.push(chord(0) - bend(0) * (t[1] - t[0]));
    for i in 1..n - 1 {
        let (before, after) = (t[i] - t[i - 1], t[i + 1] - t[i]);
        out.push((before * chord(i) + after * chord(i - 1)) / (before + after));
    }
    out.push(chord(n - 2) + bend(n - 3) * (t[n - 1] - t[n - 2]));
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn parabolas_are_differentiated_exactly_on_any_grid(
            steps in prop::collection::vec(0.01_f64..0.3, 2..40),
            c in prop::array::uniform3(-3.0_f64..3.0),
        ) {
            let mut t = vec![0.0];
            for s in &steps {
                t.push(t[t.len() - 1] + s);
            }
            let x: Vec<f64> = t.iter().map(|t| c[0] + c[1] * t + c[2] * t * t).collect();
            for (d, t) in central_differences(&t, &x).iter().zip(&t) {
                prop_assert!((d - (c[1] + 2.0 * c[2] * t)).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn the_error_falls_with_the_square_of_the_step() {
        let worst = |n: usize| {
            // A smooth but uneven grid: its steps vary by a factor of three.
            let t: Vec<f64> = (0..=n)
                .map(|i| {
                    let s = i as f64 / n as f64;
                    s + 0.08 * (6.0 * s).sin()
                })
                .collect();
            let x: Vec<f64> = t.iter().map(|t| (3.0 * t).sin()).collect();
            central_differences(&t, &x)
                .iter()
                .zip(&t)
                .map(|(d, t)| (d - 3.0 * (3.0 * t).cos()).abs())
                .fold(0.0, f64::max)
        };
        let order = (worst(100) / worst(200)).log2();
        assert!((order - 2.0).abs() < 0.1, "order {order}");
    }

    #[test]
    fn short_records() {
        assert_eq!(central_differences(&[0.0, 0.5], &[1.0, 2.0]), [2.0, 2.0]);
        assert_eq!(central_differences(&[0.0], &[1.0]), [0.0]);
        assert!(central_differences(&[], &[]).is_empty());
    }
}
