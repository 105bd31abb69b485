//! Tail probabilities, and which of many units stand out.

/// P(|z| > x) of a normal z.
pub fn two_sided(x: f64) -> f64 {
    libm::erfc(x.abs() / 2.0_f64.sqrt())
}

/// P(χ² > x) of one degree of freedom.
pub fn chi_square_tail(x: f64) -> f64 {
    two_sided(x.max(0.0).sqrt())
}

/// Which hypotheses are rejected so that at most the share `rate` of the rejected ones is expected to be false
/// (Y. Benjamini, Y. Hochberg, J. R. Statist. Soc. B 57, 1995): those up to the largest p₍ₖ₎ ≤ k/n · rate.
pub fn rejected(p: &[f64], rate: f64) -> Vec<bool> {
    let mut sorted = p.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = p.len() as f64;
    let ranks = sorted.iter().enumerate();
    let threshold = ranks
        .filter(|(k, p)| **p <= (*k + 1) as f64 / n * rate)
        .map(|(_, p)| *p)
        .next_back();
    p.iter()
        .map(|p| threshold.is_some_and(|t| *p <= t))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_the_tables() {
        assert!((two_sided(1.959_964) - 0.05).abs() < 1e-6);
        assert!((chi_square_tail(6.634_897) - 0.01).abs() < 1e-6);
        assert_eq!(chi_square_tail(-1.0), 1.0);
    }

    /// The example of the paper: 15 values, four rejected at 0.05.
    #[test]
    fn the_example_of_benjamini_and_hochberg() {
        let p = [
            0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.3240, 0.4262,
            0.5719, 0.6528, 0.7590, 1.0,
        ];
        let count = rejected(&p, 0.05).iter().filter(|r| **r).count();
        assert_eq!(count, 4);
        assert!(rejected(&[0.2, 0.9], 0.05).iter().all(|r| !r));
        assert!(rejected(&[], 0.05).is_empty());
    }
}
