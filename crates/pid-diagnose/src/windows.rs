//! When a force acts: start values for effects that are on within time windows.
//!
//! The time since the start of a record, shared by all train records, is cut into bins; in each bin
//! a constant amplitude is estimated from the linearised innovations with the nominal parameters
//! free within their prior,
//!
//! ```text
//! min over (z, f) |ε₀ + J_z z + Σ_{b on} J_b f_b|² + |z / σ|²,      s_b = f_bᵀ Cov(f_b)⁻¹ f_b
//! ```
//!
//! Bins are switched on one after the other: each time the one that gains most beside those that
//! are on, until its gain is not significant. A force that never ends is nearly a change of the
//! nominal parameters, and only bins without a force tell the two apart. Neighbouring bins that are
//! on make a window; the windows' edges are parameters of the refit. For the same reason a force
//! within some windows is nearly the opposite force outside them: where a window reaches an end of
//! the records, the times without a force are a second start.

use nalgebra::{DMatrix, DVector};
use pid_data::Role;
use rayon::prelude::*;

use crate::case::Case;
use crate::effect::{LANES, Term};
use crate::fit::{Basis, Direction, Fit, PRIOR, gram, linearise};

/// Shortest bins, s, and their largest number. Short bins separate windows that lie close to each
/// other, long ones see a faint force.
const BINS: [(f64, usize); 2] = [(0.4, 18), (0.2, 36)];
/// Gain of a bin that starts follow, in mean squared innovations that are left: five standard deviations.
const SIGNIFICANT: f64 = 25.0;
/// Share of the strongest bin from which the effect counts as on in a bin.
const ON: f64 = 0.12;
/// A time after every record, s.
const NEVER: f64 = 2e5;

/// Start parameters of a timed effect for a refit, one set for each length of bins; none if the
/// effect is not timed or shows in no bin.
pub(crate) fn starts(case: &Case, basis: &Basis, fit: &Fit, term: &Term) -> Vec<Vec<f64>> {
    if term.effect.edges().is_empty() || term.effect.info().amplitudes.is_empty() {
        return Vec::new();
    }
    let [long, short] = BINS.map(|bins| Bins::of(case, bins));
    let Some(fine) = Slopes::new(case, basis, fit, term, short) else {
        return Vec::new();
    };
    let coarse = match short.count == 2 * long.count {
        true => Some(fine.in_pairs(long)),
        false => fine.of_other_bins(case, fit, term, long),
    };
    [coarse, Some(fine)]
        .iter()
        .flatten()
        .filter_map(|slopes| found(slopes, term))
        .flatten()
        .collect()
}

/// Bins of time, from the start of what was recorded.
#[derive(Debug, Clone, Copy)]
struct Bins {
    count: usize,
    /// Length of one, s.
    length: f64,
}

impl Bins {
    /// Of the train records, not shorter and not more than so much.
    fn of(case: &Case, (shortest, most): (f64, usize)) -> Self {
        let train = case.records.iter().filter(|r| r.role == Role::Train);
        let whole = train
            .map(|r| r.begin + r.len() as f64 * r.h)
            .fold(0.0, f64::max);
        let count = ((whole / shortest) as usize).clamp(1, most);
        Bins {
            count,
            length: whole / count as f64,
        }
    }
}

/// Innovations of the train records with their slopes.
struct Slopes {
    r: DVector<f64>,
    /// With respect to the nominal parameters.
    nominal: DMatrix<f64>,
    bins: Bins,
    /// With respect to the amplitudes of every bin.
    amplitudes: DMatrix<f64>,
}

impl Slopes {
    fn new(case: &Case, basis: &Basis, fit: &Fit, term: &Term, bins: Bins) -> Option<Self> {
        let columns = basis.directions();
        let along: Vec<Direction<'_>> = columns.iter().map(|c| Direction::Theta(c)).collect();
        let (hypothesis, point) = (&fit.hypothesis, &fit.point);
        let lin = linearise(case, hypothesis, point, &fit.gains, Role::Train, &along);
        let amplitudes = along_bins(case, fit, term, bins)?;
        (amplitudes.nrows() == lin.r.len()).then_some(Self {
            r: lin.r,
            nominal: lin.j,
            bins,
            amplitudes,
        })
    }

    /// The same in other bins.
    fn of_other_bins(&self, case: &Case, fit: &Fit, term: &Term, bins: Bins) -> Option<Self> {
        let amplitudes = along_bins(case, fit, term, bins)?;
        (amplitudes.nrows() == self.r.len()).then(|| self.with(bins, amplitudes))
    }

    /// The same in bins that are two of these: a force in both is the sum of a force in each.
    fn in_pairs(&self, bins: Bins) -> Self {
        let m = self.amplitudes.ncols() / self.bins.count;
        let column = |i: usize| {
            let first = i / m * 2 * m + i % m;
            self.amplitudes.column(first) + self.amplitudes.column(first + m)
        };
        let columns: Vec<DVector<f64>> = (0..bins.count * m).map(column).collect();
        self.with(bins, DMatrix::from_columns(&columns))
    }

    fn with(&self, bins: Bins, amplitudes: DMatrix<f64>) -> Self {
        Self {
            r: self.r.clone(),
            nominal: self.nominal.clone(),
            bins,
            amplitudes,
        }
    }
}

/// Amplitudes in some bins, zero in the others.
#[derive(Default)]
struct Profile {
    amplitudes: DVector<f64>,
    /// Decrease of the sum of squares.
    gain: f64,
    /// Squared amplitude over its covariance, bin by bin.
    strength: Vec<f64>,
}

impl Profile {
    fn of(precision: &DMatrix<f64>, pull: &DVector<f64>, bins: &[usize], m: usize) -> Option<Self> {
        let at: Vec<usize> = bins.iter().flat_map(|b| b * m..(b + 1) * m).collect();
        let own = DMatrix::from_fn(at.len(), at.len(), |i, k| precision[(at[i], at[k])]);
        let b = DVector::from_fn(at.len(), |i, _| pull[at[i]]);
        let inverse = own.cholesky()?.inverse();
        let amplitudes = &inverse * &b;
        let strength = (0..bins.len())
            .map(|i| {
                let covariance = inverse.view((i * m, i * m), (m, m)).into_owned();
                let f = amplitudes.rows(i * m, m);
                covariance.cholesky().map_or(0.0, |c| f.dot(&c.solve(&f)))
            })
            .collect();
        Some(Profile {
            gain: amplitudes.dot(&b),
            amplitudes,
            strength,
        })
    }
}

/// What the innovations of the train records say of a constant amplitude in each bin of time.
struct Information {
    bins: Bins,
    /// Number of amplitudes of a bin.
    m: usize,
    /// Information on the amplitudes, bin by bin, that the nominal parameters leave, and its
    /// product with their estimates.
    precision: DMatrix<f64>,
    pull: DVector<f64>,
    /// Sum of squares of the innovations, and their number.
    square: f64,
    rows: usize,
}

impl Information {
    fn new(slopes: &Slopes) -> Option<Self> {
        let Slopes {
            r,
            nominal,
            bins,
            amplitudes,
        } = slopes;
        let (rank, count) = (nominal.ncols(), bins.count);
        let m = amplitudes.ncols() / count;
        let total = rank + amplitudes.ncols();
        let mut j = nominal.clone().resize_horizontally(total, 0.0);
        j.columns_mut(rank, amplitudes.ncols())
            .copy_from(amplitudes);
        let mut h = gram(&j);
        let largest = (rank..total).map(|i| h[(i, i)]).fold(0.0, f64::max);
        for i in 0..total {
            h[(i, i)] += if i < rank {
                1.0 / (PRIOR * PRIOR)
            } else {
                1e-9 * largest + 1e-300
            };
        }
        let inverse = h.cholesky()?.inverse();
        let x: DVector<f64> = -(&inverse * j.tr_mul(r));
        let covariance = inverse
            .view((rank, rank), (count * m, count * m))
            .into_owned();
        let precision = covariance.cholesky()?.inverse();
        let pull = &precision * x.rows(rank, count * m);
        Some(Self {
            bins: *bins,
            m,
            precision,
            pull,
            square: r.norm_squared(),
            rows: r.len(),
        })
    }

    /// Mean squared innovation that amplitudes leave.
    fn left(&self, explained: f64) -> f64 {
        ((self.square - explained) / self.rows as f64).max(1.0)
    }

    /// Bins switched on one after the other while their gain is significant, in the order of
    /// switching, and their profile.
    fn active(&self) -> (Vec<usize>, Profile) {
        let mut active: Vec<usize> = Vec::new();
        let mut profile = Profile::default();
        while active.len() < self.bins.count {
            let best = (0..self.bins.count)
                .filter(|b| !active.contains(b))
                .filter_map(|b| {
                    let mut wider = active.clone();
                    wider.push(b);
                    let profile = Profile::of(&self.precision, &self.pull, &wider, self.m)?;
                    Some((b, profile))
                })
                .max_by(|a, b| a.1.gain.total_cmp(&b.1.gain));
            let Some((b, next)) = best else { break };
            if next.gain - profile.gain < SIGNIFICANT * self.left(next.gain) {
                break;
            }
            active.push(b);
            profile = next;
        }
        (active, profile)
    }
}

/// Slopes of the innovations on the train records with respect to the amplitudes of every bin; `None` where they do
/// not have the same rows in all bins.
fn along_bins(case: &Case, fit: &Fit, term: &Term, bins: Bins) -> Option<DMatrix<f64>> {
    let amplitudes = term.effect.info().amplitudes;
    let m = amplitudes.len();
    let per_pass = (LANES / m).max(1);
    let blocks: Vec<DMatrix<f64>> = (0..bins.count.div_ceil(per_pass))
        .into_par_iter()
        .map(|pass| {
            let mut hypothesis = fit.hypothesis.clone();
            let mut point = fit.point.clone();
            let mut lanes = Vec::new();
            for b in pass * per_pass..((pass + 1) * per_pass).min(bins.count) {
                let first = point.e.len();
                lanes.extend(amplitudes.iter().map(|a| Direction::Effect(first + a)));
                hypothesis.terms.push(term.clone());
                let nothing = DVector::zeros(m);
                point
                    .e
                    .extend(term_at(term, &[(b, b + 1)], &nothing, bins.length));
            }
            linearise(case, &hypothesis, &point, &fit.gains, Role::Train, &lanes).j
        })
        .collect();
    let rows = blocks.first()?.nrows();
    let mut j = DMatrix::zeros(rows, bins.count * m);
    let mut next = 0;
    for b in &blocks {
        if b.nrows() != rows {
            return None;
        }
        j.columns_mut(next, b.ncols()).copy_from(b);
        next += b.ncols();
    }
    Some(j)
}

/// Start parameters for bins of a length: the force within the bins that are on, and the opposite
/// force outside them where they reach an end of the records.
fn found(slopes: &Slopes, term: &Term) -> Option<Vec<Vec<f64>>> {
    let information = Information::new(slopes)?;
    let (Bins { count, length }, m) = (information.bins, information.m);
    let most_windows = term.effect.edges().len() / 2;
    let (active, profile) = information.active();
    let place = |b: usize| active.iter().position(|a| *a == b);
    let most = profile.strength.iter().copied().fold(0.0, f64::max);
    let strength: Vec<f64> = (0..count)
        .map(|b| place(b).map_or(0.0, |i| profile.strength[i]))
        .collect();
    let amplitude = |b: usize| {
        place(b).map_or_else(
            || DVector::zeros(m),
            |i| profile.amplitudes.rows(i * m, m).into_owned(),
        )
    };
    let on: Vec<bool> = strength
        .iter()
        .map(|s| *s > 0.0 && *s > ON * most)
        .collect();
    if on.iter().all(|x| *x == on[0]) {
        return None;
    }
    let mut mean = DVector::zeros(m);
    for b in (0..count).filter(|&b| on[b]) {
        mean += amplitude(b) * strength[b];
    }
    mean /= (0..count)
        .filter(|&b| on[b])
        .map(|b| strength[b])
        .sum::<f64>();
    let within = joined(&on, &strength, most_windows);
    let mut out = vec![term_at(term, &within, &mean, length)];
    if on[0] || on[count - 1] {
        let off: Vec<bool> = on.iter().map(|x| !x).collect();
        let outside = joined(&off, &vec![1.0; count], most_windows);
        out.push(term_at(term, &outside, &-mean, length));
    }
    Some(out)
}

/// The strongest windows of neighbouring bins, in the order of time: first bin and the one after
/// the last.
fn joined(on: &[bool], strength: &[f64], most: usize) -> Vec<(usize, usize)> {
    let mut windows: Vec<(usize, usize, f64)> = Vec::new();
    for (b, s) in strength.iter().enumerate().filter(|(b, _)| on[*b]) {
        match windows.last_mut() {
            Some(w) if w.1 == b => *w = (w.0, b + 1, w.2 + s),
            _ => windows.push((b, b + 1, *s)),
        }
    }
    windows.sort_by(|a, b| b.2.total_cmp(&a.2));
    windows.truncate(most);
    windows.sort_by_key(|w| w.0);
    windows.into_iter().map(|w| (w.0, w.1)).collect()
}

/// Parameters of a timed effect with an amplitude within windows of bins.
fn term_at(
    term: &Term,
    windows: &[(usize, usize)],
    amplitude: &DVector<f64>,
    bin: f64,
) -> Vec<f64> {
    let info = term.effect.info();
    let mut e = vec![0.0; info.parameters.len()];
    for (i, pair) in term.effect.edges().chunks_exact(2).enumerate() {
        (e[pair[0]], e[pair[1]]) = windows
            .get(i)
            .map_or((NEVER, NEVER), |w| (w.0 as f64 * bin, w.1 as f64 * bin));
    }
    for (&a, x) in info.amplitudes.iter().zip(amplitude.iter()) {
        e[a] = *x;
    }
    e
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, pendulum};
    use crate::effects;
    use crate::fit::{Effort, Point, basis, fit};
    use crate::hypothesis::Hypothesis;

    #[test]
    fn a_force_in_a_long_bin_is_the_sum_of_those_in_its_halves() {
        let term = Term {
            effect: effects::by_id("external_force").expect("an effect"),
            joint: 0,
        };
        let case = pendulum(&Hypothesis::default(), &[], 4.0, &|_| {});
        let basis = basis(&case);
        let zero = Point {
            theta: vec![0.0; SIZE],
            e: Vec::new(),
        };
        let nominal = fit(&case, &basis, &Hypothesis::default(), zero, Effort::full(2));
        let [long, short] = BINS.map(|bins| Bins::of(&case, bins));
        assert_eq!(short.count, 2 * long.count);
        let fine = Slopes::new(&case, &basis, &nominal, &term, short).expect("slopes");
        let own = along_bins(&case, &nominal, &term, long).expect("slopes");
        let sums = fine.in_pairs(long).amplitudes;
        assert!(own.amax() > 0.0);
        assert!((own - &sums).amax() < 1e-9 * sums.amax());
    }

    #[test]
    fn windows_of_a_force_are_found_also_where_the_parameters_take_its_mean() {
        let term = Term {
            effect: effects::by_id("external_force").expect("an effect"),
            joint: 0,
        };
        let truth = [0.7, 2.4, 2.9, 4.4, 4.9, 6.5];
        let mut e = vec![-0.5, 0.0, 0.17];
        e.extend(truth);
        let hypothesis = Hypothesis::new(vec![term.clone()]);
        let case = pendulum(&hypothesis, &e, 7.0, &|_| {});
        let basis = basis(&case);
        let zero = Point {
            theta: vec![0.0; SIZE],
            e: Vec::new(),
        };
        let nominal = fit(&case, &basis, &Hypothesis::default(), zero, Effort::full(8));
        let starts = starts(&case, &basis, &nominal, &term);
        let near =
            |e: &[f64]| e[0] < 0.0 && e[3..].iter().zip(truth).all(|(a, b)| (a - b).abs() <= 0.45);
        assert!(starts.iter().any(|e| near(e)), "{starts:.2?}");
    }
}
