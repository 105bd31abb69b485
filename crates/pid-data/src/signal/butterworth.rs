//! Butterworth low-pass filters, forward and backward.

use std::f64::consts::PI;

/// A filter that cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// Order 0 or absurdly high.
    #[error(
        "a low-pass filter of order {order} cannot be made\n  help: use an order from 1 to 12, usually 4"
    )]
    Order {
        /// The order asked for.
        order: usize,
    },
    /// A cut-off outside of 0 … half the sampling rate.
    #[error(
        "cut-off {cutoff} Hz is not between 0 and half the sampling rate {rate} Hz\n  help: choose a cut-off below {} Hz", 0.5 * rate
    )]
    Cutoff {
        /// The cut-off asked for, Hz.
        cutoff: f64,
        /// The sampling rate, Hz.
        rate: f64,
    },
}

/// A section of second order: `y_i = b0 x_i + b1 x_{i−1} + b2 x_{i−2} − a1 y_{i−1} − a2 y_{i−2}`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Biquad {
    /// Coefficients of the input.
    pub b: [f64; 3],
    /// Coefficients a1, a2 of the output.
    pub a: [f64; 2],
}

impl Biquad {
    /// Filters in place. The state starts as if the first value had been there for ever (the
    /// section has gain 1 at rest).
    fn run(&self, x: &mut [f64]) {
        let Some(&first) = x.first() else { return };
        // Transposed direct form: y = b0 x + s1, s1' = b1 x − a1 y + s2, s2' = b2 x − a2 y. At rest
        // x = y = first.
        let mut s2 = (self.b[2] - self.a[1]) * first;
        let mut s1 = (self.b[1] - self.a[0]) * first + s2;
        for value in x {
            let y = self.b[0] * *value + s1;
            s1 = self.b[1] * *value - self.a[0] * y + s2;
            s2 = self.b[2] * *value - self.a[1] * y;
            *value = y;
        }
    }
}

/// A digital Butterworth low-pass filter as a chain of second-order sections of unit gain at rest.
///
/// The analogue prototype of order n has its poles at `exp(i π (2k + n + 1) / 2n)` (S. Butterworth,
/// 1930); each conjugate pair is the section `1 / (s² + s/Q + 1)` with
/// `1/Q = 2 sin(π (2k + 1) / 2n)`, a real pole is `1 / (s + 1)`. The bilinear transform
/// `s = (1 − z⁻¹) / (K (1 + z⁻¹))` with `K = tan(π f_c / f_s)` puts the −3 dB point exactly at the
/// cut-off (A. V. Oppenheim, R. W. Schafer, Discrete-Time Signal Processing, section 7.1).
#[derive(Debug, Clone, PartialEq)]
pub struct Butterworth {
    sections: Vec<Biquad>,
    order: usize,
}

impl Butterworth {
    /// Low-pass of an order, with cut-off and sampling rate in Hz.
    ///
    /// # Errors
    /// [`FilterError`] for an order outside of 1..=12 or a cut-off outside of 0 < f_c < f_s / 2.
    pub fn low_pass(order: usize, cutoff: f64, rate: f64) -> Result<Self, FilterError> {
        if !(1..=12).contains(&order) {
            return Err(FilterError::Order { order });
        }
        if !(cutoff > 0.0 && cutoff < 0.5 * rate && rate.is_finite()) {
            return Err(FilterError::Cutoff { cutoff, rate });
        }
        let k = (PI * cutoff / rate).tan();
        let mut sections = Vec::with_capacity(order.div_ceil(2));
        if order % 2 == 1 {
            let gain = k / (1.0 + k);
            sections.push(Biquad {
                b: [gain, gain, 0.0],
                a: [(k - 1.0) / (k + 1.0), 0.0],
            });
        }
        for pair in (0..order / 2).rev() {
            let inverse_q = 2.0 * (PI * (2 * pair + 1) as f64 / (2 * order) as f64).sin();
            let norm = 1.0 / (1.0 + k * inverse_q + k * k);
            let gain = k * k * norm;
            sections.push(Biquad {
                b: [gain, 2.0 * gain, gain],
                a: [
                    2.0 * (k * k - 1.0) * norm,
                    (1.0 - k * inverse_q + k * k) * norm,
                ],
            });
        }
        Ok(Butterworth { sections, order })
    }

    /// The sections, those with the fastest decay first.
    pub fn sections(&self) -> &[Biquad] {
        &self.sections
    }

    /// Filters forward and backward: no phase shift, the gain squared, −6 dB at the cut-off.
    ///
    /// The record is continued at both ends by its point reflection (`2 x_0 − x_i`) over
    /// `3 (2 ⌈n/2⌉ + 1)` samples for order n (less three for odd orders; at most N − 1), and each
    /// pass starts at rest, as is usual for this method (F. Gustafsson, 1996, reviews it).
    pub fn both_ways(&self, x: &[f64]) -> Vec<f64> {
        let n = x.len();
        if n < 2 {
            return x.to_vec();
        }
        let taps = 2 * self.sections.len() + 1 - self.order % 2;
        let pad = (3 * taps).min(n - 1);
        let mut y = Vec::with_capacity(n + 2 * pad);
        y.extend((1..=pad).rev().map(|i| 2.0 * x[0] - x[i]));
        y.extend_from_slice(x);
        y.extend((1..=pad).map(|i| 2.0 * x[n - 1] - x[n - 1 - i]));
        for _ in 0..2 {
            for section in &self.sections {
                section.run(&mut y);
            }
            y.reverse();
        }
        y.drain(..pad);
        y.truncate(n);
        y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Product of the sections as seen on the unit circle, |H(e^{iω})|.
    fn gain(filter: &Butterworth, frequency: f64, rate: f64) -> f64 {
        let w = 2.0 * PI * frequency / rate;
        filter
            .sections()
            .iter()
            .map(|s| {
                let norm = |c: [f64; 3]| {
                    let re = c[0] + c[1] * w.cos() + c[2] * (2.0 * w).cos();
                    let im = c[1] * w.sin() + c[2] * (2.0 * w).sin();
                    re.hypot(im)
                };
                norm(s.b) / norm([1.0, s.a[0], s.a[1]])
            })
            .product()
    }

    #[test]
    fn sections_are_those_of_scipy() {
        // scipy 1.17.1: signal.butter(4, 100, fs=1000, output="sos"), denominators.
        let f = Butterworth::low_pass(4, 100.0, 1000.0).unwrap();
        let expected = [
            [-1.0485995763626117, 0.2961403575616696],
            [-1.3209134308194264, 0.6327387928852766],
        ];
        for (s, e) in f.sections().iter().zip(expected) {
            assert!(
                (s.a[0] - e[0]).abs() < 1e-14 && (s.a[1] - e[1]).abs() < 1e-14,
                "{s:?}"
            );
        }
        // signal.butter(3, 8, fs=50, output="sos")
        let f = Butterworth::low_pass(3, 8.0, 50.0).unwrap();
        let expected = [
            [-0.2905268567319164, 0.0],
            [-0.7535372981080232, 0.40630760754986184],
        ];
        for (s, e) in f.sections().iter().zip(expected) {
            assert!(
                (s.a[0] - e[0]).abs() < 1e-14 && (s.a[1] - e[1]).abs() < 1e-14,
                "{s:?}"
            );
        }
    }

    #[test]
    fn filtering_both_ways_gives_the_values_of_scipy() {
        let x: Vec<f64> = (0..60)
            .map(|i| {
                let i = f64::from(i);
                (0.31 * i).sin() + 0.3 * (2.1 * i).cos() + 0.01 * i * i / 10.0
            })
            .collect();
        let at = [0, 1, 2, 10, 29, 30, 58, 59];
        // scipy 1.17.1: signal.sosfiltfilt(signal.butter(order, cutoff, fs=rate, output="sos"), x)
        let cases = [
            (
                4,
                100.0,
                1000.0,
                [
                    0.3021712680396661,
                    0.4854261340081932,
                    0.6583705765047274,
                    0.1559930272175931,
                    1.2609323724538894,
                    1.0240910597663058,
                    2.6092274257905688,
                    2.900887396605121,
                ],
            ),
            (
                3,
                8.0,
                50.0,
                [
                    0.29957709825697,
                    0.40116412621176784,
                    0.5594534036688127,
                    0.1390782679153209,
                    1.2618827586199381,
                    1.0246792424954172,
                    2.5973152022895567,
                    2.8921870447261075,
                ],
            ),
        ];
        for (order, cutoff, rate, expected) in cases {
            let y = Butterworth::low_pass(order, cutoff, rate)
                .unwrap()
                .both_ways(&x);
            assert_eq!(y.len(), x.len());
            for (i, e) in at.iter().zip(expected) {
                assert!(
                    (y[*i] - e).abs() < 1e-12,
                    "order {order}, sample {i}: {} for {e}",
                    y[*i]
                );
            }
        }
    }

    #[test]
    fn three_decibels_at_the_cut_off_and_none_at_rest() {
        for order in 1..=12 {
            let f = Butterworth::low_pass(order, 30.0, 200.0).unwrap();
            assert!(
                (gain(&f, 30.0, 200.0) - 0.5_f64.sqrt()).abs() < 1e-12,
                "order {order}"
            );
            assert!((gain(&f, 0.0, 200.0) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn straight_lines_pass_unchanged() {
        let x: Vec<f64> = (0..600).map(|i| 3.0 - 0.25 * f64::from(i)).collect();
        let y = Butterworth::low_pass(4, 5.0, 100.0).unwrap().both_ways(&x);
        // The reflected ends continue the line; only the start-up within the padding is felt, and
        // it dies out.
        for i in 250..350 {
            assert!((x[i] - y[i]).abs() < 1e-9, "sample {i}: {} {}", x[i], y[i]);
        }
        let constant = vec![2.5; 30];
        let y = Butterworth::low_pass(5, 5.0, 100.0)
            .unwrap()
            .both_ways(&constant);
        assert!(y.iter().all(|v| (v - 2.5).abs() < 1e-12));
    }

    #[test]
    fn impossible_filters_are_refused_with_their_numbers() {
        let text = Butterworth::low_pass(4, 600.0, 1000.0)
            .unwrap_err()
            .to_string();
        assert!(text.contains("600") && text.contains("below 500"), "{text}");
        assert!(Butterworth::low_pass(0, 1.0, 10.0).is_err());
        assert!(Butterworth::low_pass(4, f64::NAN, 10.0).is_err());
        assert!(Butterworth::low_pass(4, 1.0, f64::INFINITY).is_err());
    }
}
