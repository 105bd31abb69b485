//! From raw channels to states: filters, derivatives, resampling, noise levels.
//!
//! Several channels are stored row by row as in [`crate::data`]: channel `j` of sample `i` is `x[i * columns + j]`.
//! [`state_from_data`] is what most users want; the rest are its parts.

mod butterworth;
mod derivative;
mod noise;
mod outliers;
mod resample;
mod state;

pub use butterworth::{Biquad, Butterworth, FilterError};
pub use derivative::central_differences;
pub use noise::{choose_cutoff, noise_level, noise_level_without_jumps};
pub use outliers::outliers;
pub use resample::{Interpolation, decimate, fill_missing, resample, uniform_times};
pub use state::{SignalError, StateEstimate, acting_inputs, low_pass_channels, state_from_data};

/// One channel of row-by-row data.
pub(crate) fn column(x: &[f64], columns: usize, j: usize) -> Vec<f64> {
    x.iter().skip(j).step_by(columns).copied().collect()
}

/// Applies a function to each channel of row-by-row data; all results must be of one length.
pub(crate) fn map_columns(
    x: &[f64],
    columns: usize,
    mut f: impl FnMut(&[f64]) -> Vec<f64>,
) -> Vec<f64> {
    let mapped: Vec<Vec<f64>> = (0..columns).map(|j| f(&column(x, columns, j))).collect();
    let rows = mapped.first().map_or(0, Vec::len);
    let mut out = Vec::with_capacity(rows * columns);
    for i in 0..rows {
        out.extend(mapped.iter().map(|c| c[i]));
    }
    out
}
