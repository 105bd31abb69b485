//! What the tolerances leave open of the torques: a small link with a centre of mass near its axis has a
//! gravity torque that nobody knows beforehand.

use pid_interpret::nominal::{Nominal, Role};

use crate::motion::Motion;
use crate::torque::Bench;

/// States at which it is asked.
const STATES: usize = 120;
/// Most that is taken for possible: wider tolerances say that values were guessed, and a guess is compared
/// like a value that is known to so much of it.
const RELATIVE: f64 = 0.3;
/// Likewise for centres of mass, m.
const CENTRE: f64 = 0.02;

/// Deviation of each parameter of a description that is taken for possible; friction is fitted anyway.
pub(crate) fn widths(nominal: &Nominal) -> Vec<f64> {
    let width = |t: &pid_interpret::nominal::Tolerance| match t.role {
        Role::CenterOfMass(_) => t.half_width.min(CENTRE),
        Role::Coulomb | Role::Viscous | Role::Gain | Role::Sharpness => 0.0,
        // Products of inertia are zero often, their tolerance refers to the moments.
        Role::Inertia(k) if k > 2 => t.half_width,
        _ => t.half_width.min(RELATIVE * t.nominal.abs()),
    };
    nominal.tolerances().iter().map(width).collect()
}

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
