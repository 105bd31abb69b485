//! A small deterministic generator for random test points: same seed, same points, on every machine.

/// SplitMix64 (G. L. Steele, D. Lea, C. H. Flood, 2014).
#[derive(Debug, Clone)]
pub struct Random {
    state: u64,
}

impl Random {
    /// A generator with a seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `[lower, upper)`.
    pub fn uniform(&mut self, lower: f64, upper: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1u64 << 53) as f64;
        lower + (upper - lower) * unit
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn uniform_stays_inside_and_has_the_right_mean() {
        let mut random = Random::new(1);
        let n = 20_000;
        let mut sum = 0.0;
        for _ in 0..n {
            let x = random.uniform(-1.0, 3.0);
            assert!((-1.0..3.0).contains(&x));
            sum += x;
        }
        // Standard deviation of the mean: 4/√12/√n = 0.008.
        assert!((sum / f64::from(n) - 1.0).abs() < 0.04);
    }
}
