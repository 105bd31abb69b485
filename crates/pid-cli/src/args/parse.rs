//! Values of arguments.

use pid_fit::transcribe::Loss;

/// A whole number above zero.
pub(crate) fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n) if n > 0 => Ok(n),
        _ => Err(format!("`{text}` is not a whole number above zero")),
    }
}

/// A number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err(format!("`{text}` is not a number above zero, such as 1e-8")),
    }
}

/// A number of at least zero.
pub(crate) fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x >= 0.0 => Ok(x),
        _ => Err(format!("`{text}` is not a number of at least zero")),
    }
}

/// A number other than zero.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(x) if x.is_finite() && x != 0.0 => Ok(x),
        _ => Err(format!("`{text}` is not a number other than zero")),
    }
}

/// Reads `square`, `huber`, `huber=1.5`, `student-t`, `student-t=4`.
///
/// # Errors
/// What is wrong with the text.
pub fn loss(text: &str) -> Result<Loss, String> {
    let (word, number) = match text.split_once('=') {
        Some((word, number)) => (word, Some(number)),
        None => (text, None),
    };
    let value = |default: f64| match number.map(str::parse::<f64>) {
        None => Ok(default),
        Some(Ok(x)) if x.is_finite() && x > 0.0 => Ok(x),
        Some(_) => Err(format!("`{text}`: the number after `=` must be above zero")),
    };
    match (word, number) {
        ("square", None) => Ok(Loss::Square),
        ("huber", _) => Ok(Loss::Huber {
            threshold: value(1.345)?,
        }),
        ("student-t", _) => Ok(Loss::StudentT {
            freedom: value(4.0)?,
        }),
        _ => Err(format!(
            "`{text}` is not a loss: square, huber=THRESHOLD or student-t=FREEDOM"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_read_and_refused() {
        assert_eq!(loss("square"), Ok(Loss::Square));
        assert_eq!(loss("huber=2"), Ok(Loss::Huber { threshold: 2.0 }));
        assert_eq!(loss("student-t"), Ok(Loss::StudentT { freedom: 4.0 }));
        for bad in ["", "square=1", "huber=0", "huber=x", "cauchy"] {
            assert!(loss(bad).is_err(), "{bad}");
        }
    }
}
