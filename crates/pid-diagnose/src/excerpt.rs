//! Long records: what is fitted and judged by is cut to the parts that decide.
//!
//! A fit costs time in proportion to the length of the train records and, through candidates and
//! directions, to more than the square of the number of joints. Beyond a length the records repeat
//! themselves. They are cut into parts of some seconds, and parts are taken one after the other
//! that add most to the logarithm of the determinant of the information (V. V. Fedorov, Theory of
//! Optimal Experiments, 1972, section 2.5)
//!
//! ```text
//! maximise  ln det(I + Σ_taken Σ_k φ_k φ_kᵀ / N),      φ per joint: 1, sgn v, v, v|v|, a, sin q, cos q, q, u
//! ```
//!
//! each feature over its root mean square in all records of a role, N samples of a part.
//! Neighbouring parts stay together. Test records are cut alike, to half that length, while effects
//! are looked for; [`restore_tests`] puts them back, so that the gap is that of all of them.

use nalgebra::{Cholesky, DMatrix, DVector};
use pid_data::Role;

use crate::case::{Case, Record};
use crate::fit::{Fit, all_gains};
use crate::gap::deviations;

/// Length of a part at least, s.
const SHORTEST: f64 = 4.0;
/// Length of a part, in horizons.
const HORIZONS: f64 = 2.0;
/// Features of a joint.
const FEATURES: usize = 9;
/// Samples of a part that are looked at.
const LOOKS: usize = 200;

/// Length of the test records over that of the train records.
const TESTS: f64 = 0.5;

/// The case with train records of `joint_seconds` over the number of joints in all and test records
/// of half that; those of a role that are not longer stay as they are.
pub fn excerpt(case: &Case, joint_seconds: f64) -> Case {
    let allowed = joint_seconds / case.n() as f64;
    let mut out = case.clone();
    out.records = [(Role::Train, allowed), (Role::Test, TESTS * allowed)]
        .into_iter()
        .flat_map(|(role, allowed)| shorten(case, role, allowed))
        .collect();
    out
}

/// The records of a role, cut to a length in all if they are longer.
fn shorten(case: &Case, role: Role, allowed: f64) -> Vec<Record> {
    let own = || {
        case.records
            .iter()
            .enumerate()
            .filter(move |r| r.1.role == role)
    };
    let total: f64 = own().map(|(_, r)| r.len() as f64 * r.h).sum();
    if total <= allowed {
        return own().map(|(_, r)| r.clone()).collect();
    }
    let length = (HORIZONS * case.nominal.horizon.unwrap_or(0.0)).max(SHORTEST);
    let parts: Vec<(usize, usize, usize)> = own()
        .flat_map(|(i, r)| {
            let many = ((r.len() as f64 * r.h / length) as usize).max(1);
            (0..many).map(move |p| (i, p * r.len() / many, (p + 1) * r.len() / many))
        })
        .collect();
    let taken = choose(case, &parts, allowed);
    own()
        .flat_map(|(i, record)| {
            let mut spans: Vec<(usize, usize)> = Vec::new();
            for (part, _) in parts.iter().zip(&taken).filter(|(p, t)| p.0 == i && **t) {
                match spans.last_mut() {
                    Some(last) if last.1 == part.1 => last.1 = part.2,
                    _ => spans.push((part.1, part.2)),
                }
            }
            spans
                .into_iter()
                .map(|(from, to)| cut(record, from, to))
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Puts the whole test records back into a case that was cut, and into its fits; `false` if they
/// were whole. A test record of which a part was fitted stays out.
pub fn restore_tests<'a>(
    whole: &Case,
    case: &mut Case,
    fits: impl Iterator<Item = &'a mut Fit>,
) -> bool {
    let length = |case: &Case| -> usize {
        let tests = case.records.iter().filter(|r| r.role == Role::Test);
        tests.map(Record::len).sum()
    };
    let fitted: Vec<&Record> = whole
        .records
        .iter()
        .filter(|w| {
            let mut parts = case.records.iter().filter(|r| r.role == Role::Train);
            w.role == Role::Test && parts.any(|r| r.name == w.name)
        })
        .collect();
    let apart = |r: &&Record| r.role == Role::Test && !fitted.iter().any(|f| f.name == r.name);
    let tests: Vec<Record> = whole.records.iter().filter(apart).cloned().collect();
    if tests.iter().map(Record::len).sum::<usize>() == length(case) {
        return false;
    }
    case.records.retain(|r| r.role == Role::Train);
    case.records.extend(tests);
    for fit in fits {
        fit.gains = all_gains(case, &fit.hypothesis, &fit.point);
    }
    true
}

/// The first samples of a record, `number` of them if there are as many.
pub(crate) fn beginning(record: &Record, number: usize) -> Record {
    cut(record, 0, number.min(record.len()))
}

/// Samples `from..to` of a record.
fn cut(record: &Record, from: usize, to: usize) -> Record {
    let part = |x: &Vec<Vec<f64>>| x.iter().map(|x| x[from..to].to_vec()).collect();
    Record {
        name: record.name.clone(),
        role: record.role,
        h: record.h,
        uneven: record.uneven,
        begin: record.begin + from as f64 * record.h,
        q: part(&record.q),
        v: part(&record.v),
        u: part(&record.u),
        smooth_q: part(&record.smooth_q),
        smooth_v: part(&record.smooth_v),
        first_v: match from {
            0 => record.first_v.clone(),
            _ => record.smooth_v.iter().map(|v| v[from]).collect(),
        },
        gain_factors: record.gain_factors.clone(),
        // A joint that hardly moves in a part is not judged by that little motion.
        whole: Some(deviations(record, record.q.len())),
    }
}

/// Features of a sample.
fn features(case: &Case, r: &Record, k: usize) -> DVector<f64> {
    let before = k.saturating_sub(1);
    let after = (k + 1).min(r.len() - 1);
    DVector::from_iterator(
        FEATURES * case.n(),
        (0..case.n()).flat_map(|j| {
            let (q, v, u) = (r.smooth_q[j][k], r.smooth_v[j][k], r.u[j][k]);
            let a = (r.smooth_v[j][after] - r.smooth_v[j][before])
                / ((after - before).max(1) as f64 * r.h);
            // Within a hundredth of its largest speed a joint has no direction.
            let sign = (v / (0.01 * case.scale[j].speed)).clamp(-1.0, 1.0);
            [1.0, sign, v, v * v.abs(), a, q.sin(), q.cos(), q, u]
        }),
    )
}

/// Which parts are taken until the allowed length is reached, at least one.
fn choose(case: &Case, parts: &[(usize, usize, usize)], allowed: f64) -> Vec<bool> {
    let m = FEATURES * case.n();
    let mut grams: Vec<DMatrix<f64>> = parts
        .iter()
        .map(|&(i, from, to)| {
            let r = &case.records[i];
            let mut gram = DMatrix::zeros(m, m);
            let step = ((to - from) / LOOKS).max(1);
            for k in (from..to).step_by(step) {
                let x = features(case, r, k);
                gram.ger(step as f64 * r.h, &x, &x, 1.0);
            }
            gram
        })
        .collect();
    let mut whole = DMatrix::<f64>::zeros(m, m);
    for g in &grams {
        whole += g;
    }
    let size: Vec<f64> = (0..m)
        .map(|i| whole[(i, i)].max(1e-300).sqrt().recip())
        .collect();
    for g in &mut grams {
        for a in 0..m {
            for b in 0..m {
                g[(a, b)] *= size[a] * size[b] * parts.len() as f64;
            }
        }
    }
    let mut information = DMatrix::<f64>::identity(m, m);
    let mut taken = vec![false; parts.len()];
    let mut length = 0.0;
    let seconds = |p: &(usize, usize, usize)| (p.2 - p.1) as f64 * case.records[p.0].h;
    loop {
        let best = (0..parts.len())
            .filter(|&p| !taken[p] && (length == 0.0 || length + seconds(&parts[p]) <= allowed))
            .filter_map(|p| {
                let factor = Cholesky::new(&information + &grams[p])?;
                Some((p, factor.ln_determinant()))
            })
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((p, _)) = best else {
            return taken;
        };
        taken[p] = true;
        length += seconds(&parts[p]);
        information += &grams[p];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{SIZE, pendulum};
    use crate::gap::gap;
    use crate::hypothesis::Hypothesis;

    /// A part from the middle of a motion starts with its velocity, and errors are relative to the whole motion.
    #[test]
    fn parts_are_predicted_as_they_are_in_the_whole() {
        let nothing = Hypothesis::default();
        let case = pendulum(&nothing, &[], 24.0, &|_| {});
        let cut = excerpt(&case, 20.0);
        let tests = || cut.records.iter().filter(|r| r.role == Role::Test);
        assert!(tests().any(|r| r.begin > 0.0 && r.first_v[0].abs() > 0.2 * case.scale[0].speed));
        for part in tests() {
            let mut whole = case.records.iter();
            let whole = whole.find(|w| w.name == part.name).expect("a record");
            assert_eq!(deviations(part, 1), deviations(whole, 1));
        }
        let left = |case: &Case| gap(case, &nothing, &[0.0; SIZE], &[], Role::Test).total;
        let (parts, all) = (left(&cut), left(&case));
        assert!(parts < 1.5 * all, "{parts} of parts, {all} of all");
    }

    #[test]
    fn parts_that_move_are_kept_with_their_time() {
        let mut case = pendulum(&Hypothesis::default(), &[], 24.0, &|_| {});
        // The first half of the first record tells nothing.
        let half = case.records[0].len() / 2;
        for k in 0..half {
            case.records[0].smooth_q[0][k] = 0.0;
            case.records[0].smooth_v[0][k] = 0.0;
            case.records[0].u[0][k] = 0.0;
        }
        let whole = case.clone();
        assert_eq!(
            excerpt(&case, 48.0).records.len(),
            3,
            "as long as is allowed"
        );
        let mut cut = excerpt(&case, 20.0);
        let (mut train, mut test) = (0.0, 0.0);
        for r in &cut.records {
            let source = whole
                .records
                .iter()
                .find(|w| w.name == r.name)
                .expect("a record");
            let from = (r.begin / r.h).round() as usize;
            assert_eq!(r.q[0][..], source.q[0][from..from + r.len()]);
            if r.role == Role::Train {
                train += r.len() as f64 * r.h;
                assert!(
                    r.name != "r0" || from + r.len() > half,
                    "a part at rest was kept"
                );
            } else {
                test += r.len() as f64 * r.h;
            }
        }
        assert!((16.0..=20.0).contains(&train), "{train}");
        assert!((6.0..=10.0).contains(&test), "{test}");
        assert!(restore_tests(&whole, &mut cut, std::iter::empty()));
        let tests = |case: &Case| -> Vec<Record> {
            let own = case.records.iter().filter(|r| r.role == Role::Test);
            own.cloned().collect()
        };
        assert_eq!(tests(&cut), tests(&whole));
        assert!(
            !restore_tests(&whole, &mut cut, std::iter::empty()),
            "whole"
        );
    }
}
