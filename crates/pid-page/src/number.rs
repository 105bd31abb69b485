//! Numbers as an engineer writes them: significant digits without noise, an exponent only for what is
//! very large or very small, values to the digits of their deviation.

use std::ops::Range;

/// Powers of ten that are written out.
const PLAIN: Range<i32> = -4..6;
/// Most significant digits of a value beside its deviation.
const MOST: i32 = 8;
/// A value of less than this share of its deviation has no digits of its own.
const NOTHING: f64 = 0.01;

/// Five significant digits, without trailing zeros.
pub fn value(x: f64) -> String {
    significant(x, 5)
}

/// Three significant digits, without trailing zeros: for errors, deviations and shares.
pub fn short(x: f64) -> String {
    significant(x, 3)
}

/// So many significant digits, without trailing zeros; from a million on and below a ten-thousandth
/// with a power of ten. What is not finite is a dash.
pub fn significant(x: f64, digits: i32) -> String {
    within(x, digits, PLAIN)
}

/// As [`significant`], with other powers of ten that are written out.
pub(crate) fn within(x: f64, digits: i32, plain: Range<i32>) -> String {
    if !x.is_finite() {
        return "–".to_owned();
    }
    if x == 0.0 {
        return "0".to_owned();
    }
    let text = match plain.contains(&power(x)) {
        true => trimmed(&format!("{x:.*}", decimals(x, digits))).to_owned(),
        false => {
            let text = format!("{x:.*e}", digits.clamp(1, 4) as usize - 1);
            let (factor, power) = text.split_once('e').unwrap_or((&text, "0"));
            format!("{}e{power}", trimmed(factor))
        }
    };
    signed(&text)
}

/// A value and its standard deviation: the deviation has three significant digits, the value as many
/// decimals, and four significant digits at least unless it is nothing beside its deviation. Where that
/// reads badly each stands for itself. A deviation is never written as zero.
pub fn with_deviation(x: f64, std: f64) -> (String, String) {
    let own = match x.abs() < NOTHING * std {
        true => 0,
        false => decimals(x, 4),
    };
    aligned(x, std, (3, own))
}

/// `14.23 ± 0.61`: two digits of the deviation. What is given has none, and stands alone.
pub fn plus_minus(x: f64, std: f64) -> String {
    if std == 0.0 {
        return significant(x, 5);
    }
    let (x, std) = aligned(x, std, (2, 0));
    format!("{x} ± {std}")
}

/// A deviation of so many digits, and its value with at least so many decimals.
fn aligned(x: f64, std: f64, (digits, least): (i32, usize)) -> (String, String) {
    let decimals = decimals(std, digits);
    let own = decimals.max(least);
    let readable = std > 0.0
        && PLAIN.contains(&power(std))
        && x.abs() < 10f64.powi(PLAIN.end)
        && power(x) + 1 + own as i32 <= MOST;
    if !readable {
        return (significant(x, 5), significant(std, digits));
    }
    let value = format!("{x:.own$}");
    let nothing = value.chars().all(|c| !c.is_ascii_digit() || c == '0');
    let value = if nothing {
        "0".to_owned()
    } else {
        signed(&value)
    };
    (value, format!("{std:.decimals$}"))
}

/// Both ends of an interval, with as many digits as tell them apart, three at least; `None` for one
/// without a width.
pub fn interval(low: f64, high: f64) -> Option<(String, String)> {
    let ends = |digits| (significant(low, digits), significant(high, digits));
    let written = (3..=MOST).map(ends).find(|(low, high)| low != high)?;
    (low < high).then_some(written)
}

/// A probability or confidence: none is certain.
pub fn probability(p: f64) -> String {
    match p {
        p if p >= 0.995 => "> 0.99".to_owned(),
        p if p < 0.005 => "< 0.01".to_owned(),
        p => format!("{p:.2}"),
    }
}

/// Units as people write them.
pub fn unit(u: &str) -> String {
    u.replace("^2", "²").replace("^3", "³").replace('*', "·")
}

/// The power of ten of the first digit.
fn power(x: f64) -> i32 {
    match x.abs().log10().floor() {
        power if power.is_finite() => power as i32,
        _ => 0,
    }
}

/// Decimals that show so many digits of a number, ten at most.
fn decimals(x: f64, digits: i32) -> usize {
    (digits - 1 - power(x)).clamp(0, 10) as usize
}

fn trimmed(text: &str) -> &str {
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => text,
    }
}

/// With a true minus sign.
fn signed(text: &str) -> String {
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_stand_only_where_digits_would_not_read() {
        for (x, digits, text) in [
            (0.195, 3, "0.195"),
            (0.000_195, 3, "0.000195"),
            (1.95e-5, 3, "1.95e−5"),
            (-12_859.788, 5, "−12860"),
            (129.4, 3, "129"),
            (1.5e7, 3, "1.5e7"),
            (5.0, 5, "5"),
            (200.0, 3, "200"),
            (0.0, 3, "0"),
            (f64::NAN, 3, "–"),
        ] {
            assert_eq!(significant(x, digits), text, "{x}");
        }
    }

    #[test]
    fn a_value_has_the_digits_of_its_deviation() {
        let pair = |x, std| {
            let (x, std) = with_deviation(x, std);
            format!("{x} | {std}")
        };
        assert_eq!(pair(2.345_678, 0.195), "2.346 | 0.195");
        assert_eq!(pair(12_859.788, 129.0), "12860 | 129");
        assert_eq!(pair(9.961_23, 170.2), "9.961 | 170");
        assert_eq!(pair(-0.001, 0.52), "−0.001 | 0.520");
        assert_eq!(pair(-1e-9, 0.0606), "0 | 0.0606");
        // Ten digits say nothing to a person.
        assert_eq!(pair(95.111_123_4, 2e-9), "95.111 | 2e−9");
        assert_eq!(pair(2.3e-5, 1e-6), "2.3e−5 | 1e−6");
        assert_eq!(plus_minus(14.234, 0.612), "14.23 ± 0.61");
        assert_eq!(plus_minus(12_859.8, 412.0), "12860 ± 412");
        assert_eq!(plus_minus(2.199_42, 0.0), "2.1994");
    }

    #[test]
    fn an_interval_has_a_width_as_written() {
        let ends = |low, high| interval(low, high).map(|(a, b)| format!("{a} to {b}"));
        assert_eq!(ends(0.0528, 0.0612).as_deref(), Some("0.0528 to 0.0612"));
        assert_eq!(
            ends(0.052_81, 0.052_84).as_deref(),
            Some("0.05281 to 0.05284")
        );
        assert_eq!(ends(0.0528, 0.0528), None);
        assert_eq!(ends(1.0, 1.0 + 1e-12), None);
    }

    #[test]
    fn no_probability_is_certain() {
        assert_eq!(probability(1.0), "> 0.99");
        assert_eq!(probability(0.0), "< 0.01");
        assert_eq!(probability(0.5), "0.50");
    }
}
