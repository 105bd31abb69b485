//! What was recorded.

/// Times and inputs of all samples, windows one after another.
pub(super) struct Records {
    pub(super) t: Vec<f64>,
    pub(super) u: Vec<f64>,
    pub(super) nu: usize,
}

impl Records {
    /// Inputs at a sample.
    pub(super) fn input(&self, sample: usize) -> &[f64] {
        &self.u[sample * self.nu..(sample + 1) * self.nu]
    }
}
