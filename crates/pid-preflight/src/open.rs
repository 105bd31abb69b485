//! What the tolerances leave open of the torques: a small link with a centre of mass near its axis has a
//! gravity torque that nobody knows beforehand.

use crate::motion::Motion;
use crate::torque::Bench;

/// States at which it is asked.
const STATES: usize = 120;
/// Mean square of each torque that the tolerances leave open: deviations of the parameters by half their
/// width, which is that of an even distribution and a bit less, independent of each other.
pub(crate) fn squares(bench: &Bench, motion: &Motion) -> Vec<f64> {
    let n = motion.n;
    let np = bench.gravity.unwrap_or(bench.p.len());
    let step = motion.len().div_ceil(STATES).max(1);
    let mut rows = vec![0.0; n * np];
    let (mut sums, mut count) = (vec![0.0; n], 0.0);
    for i in (0..motion.len()).step_by(step) {
        let at = i * n..(i + 1) * n;
        bench.by_parameters(
            &motion.q[at.clone()],
            &motion.v[at.clone()],
            &motion.a[at],
            &mut rows,
        );
        for j in 0..n {
            let row = rows[j * np..(j + 1) * np].iter().zip(&bench.widths);
            sums[j] += row.map(|(x, w)| (0.5 * x * w).powi(2)).sum::<f64>();
        }
        count += 1.0;
    }
    sums.into_iter().map(|s| s / f64::max(count, 1.0)).collect()
}
