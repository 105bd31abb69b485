//! Bounds and sizes of a model's parameters.

use pid_runtime::dynamics::Hessian;

/// Bounds of a model's parameters; held ones (marked `fixed`, or in `hold`) have their start as both bounds.
pub(super) fn bounds(
    model: &dyn Hessian,
    start: &[f64],
    hold: &[usize],
) -> (Vec<f64>, Vec<f64>, Vec<bool>) {
    let infos = model.params();
    let fixed = |k: usize| infos[k].fixed || hold.contains(&k);
    let held = |k: usize, bound: f64| if fixed(k) { start[k] } else { bound };
    let lower = infos
        .iter()
        .enumerate()
        .map(|(k, i)| held(k, i.lower))
        .collect();
    let upper = infos
        .iter()
        .enumerate()
        .map(|(k, i)| held(k, i.upper))
        .collect();
    (lower, upper, (0..infos.len()).map(fixed).collect())
}

/// Typical size of each parameter: the nominal value, a sixth of the range around zero, 1 without either.
pub(super) fn scales(model: &dyn Hessian) -> Vec<f64> {
    model
        .params()
        .iter()
        .map(|i| {
            let width = i.upper - i.lower;
            if i.nominal != 0.0 && !(i.lower < 0.0 && i.nominal.abs() < 0.01 * width) {
                i.nominal.abs()
            } else if width.is_finite() && width > 0.0 {
                width / 6.0
            } else {
                1.0
            }
        })
        .collect()
}
