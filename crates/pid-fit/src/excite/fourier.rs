//! Finite Fourier series as motions.

/// A periodic motion of several joints (J. Swevers et al., IEEE Trans. Robot. Autom. 13 (1997)):
///
/// ```text
/// q_j(t) = q0_j + Σ_k a_jk/(kω) sin kωt − b_jk/(kω) cos kωt,   k = 1 … K,   ω = 2π / period
/// ```
///
/// so that a and b are amplitudes of the velocity.
#[derive(Debug, Clone, PartialEq)]
pub struct Fourier {
    /// Length of a period, s.
    pub period: f64,
    /// K.
    pub harmonics: usize,
    /// For each joint q0, a_1, b_1, … a_K, b_K; nq × (2 K + 1).
    pub coefficients: Vec<f64>,
}

impl Fourier {
    /// Coefficients of one joint: 2 K + 1.
    pub fn width(&self) -> usize {
        2 * self.harmonics + 1
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.coefficients.len() / self.width()
    }

    /// Position, velocity and acceleration at time t, nq each.
    ///
    /// # Panics
    /// If a slice is shorter than the number of joints.
    pub fn at(&self, t: f64, q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
        let mut rows = vec![0.0; 3 * self.width()];
        basis(self.period, self.harmonics, t, &mut rows);
        evaluate(&rows, &self.coefficients, q, v, a);
    }
}

/// Rows of position, velocity and acceleration over the coefficients of one joint; 3 × (2 K + 1).
pub(super) fn basis(period: f64, harmonics: usize, t: f64, rows: &mut [f64]) {
    let width = 2 * harmonics + 1;
    let (q, rest) = rows.split_at_mut(width);
    let (v, a) = rest.split_at_mut(width);
    (q[0], v[0], a[0]) = (1.0, 0.0, 0.0);
    for k in 1..=harmonics {
        let w = std::f64::consts::TAU * k as f64 / period;
        let (sin, cos) = (w * t).sin_cos();
        let (s, c) = (2 * k - 1, 2 * k);
        (q[s], v[s], a[s]) = (sin / w, cos, -w * sin);
        (q[c], v[c], a[c]) = (-cos / w, sin, w * cos);
    }
}

/// Motion of all joints from the rows of [`basis`].
pub(super) fn evaluate(rows: &[f64], x: &[f64], q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
    let width = rows.len() / 3;
    let dot = |row: &[f64], x: &[f64]| row.iter().zip(x).map(|(r, x)| r * x).sum::<f64>();
    for (j, x) in x.chunks_exact(width).enumerate() {
        q[j] = dot(&rows[..width], x);
        v[j] = dot(&rows[width..2 * width], x);
        a[j] = dot(&rows[2 * width..], x);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocity_and_acceleration_are_derivatives_of_the_position() {
        let motion = Fourier {
            period: 3.0,
            harmonics: 4,
            coefficients: (0..18).map(|k| f64::from(k * k % 7) - 2.5).collect(),
        };
        let at = |t: f64| {
            let mut out = [[0.0; 2]; 3];
            let [q, v, a] = &mut out;
            motion.at(t, q, v, a);
            out
        };
        let h = 1e-4;
        for t in [0.0, 0.7, 2.9] {
            let (low, mid, high) = (at(t - h), at(t), at(t + h));
            for j in 0..2 {
                assert!(((high[0][j] - low[0][j]) / (2.0 * h) - mid[1][j]).abs() < 1e-4);
                assert!(((high[1][j] - low[1][j]) / (2.0 * h) - mid[2][j]).abs() < 1e-3);
                assert!((at(t + 3.0)[0][j] - mid[0][j]).abs() < 1e-12, "periodic");
            }
        }
    }
}
