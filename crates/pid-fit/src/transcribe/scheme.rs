//! One-step schemes: their names, orders and use of the inputs.

use super::butcher::Butcher;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A one-step scheme for `M a + b = f_L`, `q' = v`.
///
/// # Inputs
/// A stage at the share `c` of the way reads the input of its sampling interval: with a zero-order
/// hold the value at the start of the interval, also at `c = 1`; with linear inputs the value
/// between the two samples at `c`. No stage ever reads an input from beyond its own sampling
/// interval.
///
/// # Names
/// In files and on the command line: `explicit-euler`, `heun`, `rk4`, `dormand-prince`,
/// `trapezoidal`, `implicit-midpoint`, `hermite-simpson`, `gauss-legendre-S`, `radau-S` with the
/// number of stages S (1 to 6); `euler` and `midpoint` are read too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
#[non_exhaustive]
pub enum Scheme {
    /// Explicit Euler, order 1: the paper's setting.
    ExplicitEuler,
    /// Heun's method (explicit trapezoidal rule), order 2.
    Heun,
    /// The classical explicit Runge-Kutta method, order 4.
    RungeKutta4,
    /// The explicit method of order 5 of J. R. Dormand and P. J. Prince (1980), with fixed steps.
    DormandPrince,
    /// Trapezoidal rule, order 2; inputs of a zero-order hold keep their value to the end of the step.
    Trapezoidal,
    /// Implicit midpoint rule, order 2.
    ImplicitMidpoint,
    /// Hermite-Simpson collocation (Lobatto IIIA with three stages), order 4.
    HermiteSimpson,
    /// Gauss-Legendre collocation, order 2 S.
    GaussLegendre(Stages),
    /// Radau IIA collocation, order 2 S − 1, L-stable.
    Radau(Stages),
}

/// Number of stages of a collocation scheme, 1 to [`Stages::MOST`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Stages(u8);

impl Stages {
    /// The largest number of stages: order 12 of Gauss-Legendre; beyond it rounding eats the gain.
    pub const MOST: usize = 6;

    /// So many stages.
    ///
    /// # Errors
    /// [`SchemeError::Stages`] if `count` is not between 1 and [`Stages::MOST`].
    pub fn new(count: usize) -> Result<Self, SchemeError> {
        match u8::try_from(count) {
            Ok(n) if n >= 1 && count <= Self::MOST => Ok(Self(n)),
            _ => Err(SchemeError::Stages { found: count }),
        }
    }

    /// Their number.
    pub fn count(self) -> usize {
        usize::from(self.0)
    }
}

/// A name that is no scheme.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SchemeError {
    /// No such name.
    #[error(
        "`{found}` is not a scheme\n  help: choose one of {}, gauss-legendre-S or radau-S with S stages (1 to {})",
        PLAIN.map(|(_, name)| name).join(", "),
        Stages::MOST
    )]
    Unknown {
        /// The value given.
        found: String,
    },
    /// A number of stages out of range.
    #[error(
        "collocation with {found} stages is not available\n  help: choose 1 to {} stages",
        Stages::MOST
    )]
    Stages {
        /// The value given.
        found: usize,
    },
}

/// Schemes without a number of stages, with their names.
const PLAIN: [(Scheme, &str); 7] = [
    (Scheme::ExplicitEuler, "explicit-euler"),
    (Scheme::Heun, "heun"),
    (Scheme::RungeKutta4, "rk4"),
    (Scheme::DormandPrince, "dormand-prince"),
    (Scheme::Trapezoidal, "trapezoidal"),
    (Scheme::ImplicitMidpoint, "implicit-midpoint"),
    (Scheme::HermiteSimpson, "hermite-simpson"),
];

impl Scheme {
    /// Order of convergence.
    pub fn order(self) -> u32 {
        match self {
            Self::ExplicitEuler => 1,
            Self::Heun | Self::Trapezoidal | Self::ImplicitMidpoint => 2,
            Self::RungeKutta4 | Self::HermiteSimpson => 4,
            Self::DormandPrince => 5,
            Self::GaussLegendre(s) => 2 * u32::from(s.0),
            Self::Radau(s) => 2 * u32::from(s.0) - 1,
        }
    }

    /// Whether every stage follows from the ones before it: cheap steps, bounded stability.
    pub fn explicit(self) -> bool {
        matches!(
            self,
            Self::ExplicitEuler | Self::Heun | Self::RungeKutta4 | Self::DormandPrince
        )
    }

    /// Name for people.
    pub fn label(self) -> String {
        match self {
            Self::ExplicitEuler => "explicit Euler".to_owned(),
            Self::Heun => "Heun's method".to_owned(),
            Self::RungeKutta4 => "Runge-Kutta method of order 4".to_owned(),
            Self::DormandPrince => "Dormand-Prince method of order 5".to_owned(),
            Self::Trapezoidal => "trapezoidal rule".to_owned(),
            Self::ImplicitMidpoint => "implicit midpoint rule".to_owned(),
            Self::HermiteSimpson => "Hermite-Simpson collocation".to_owned(),
            Self::GaussLegendre(s) => format!("Gauss-Legendre collocation with {} stages", s.0),
            Self::Radau(s) => format!("Radau collocation with {} stages", s.0),
        }
    }

    /// Its coefficients.
    pub(super) fn butcher(self) -> Butcher {
        match self {
            Self::ExplicitEuler => Butcher::explicit_euler(),
            Self::Heun => Butcher::heun(),
            Self::RungeKutta4 => Butcher::rk4(),
            Self::DormandPrince => Butcher::dormand_prince(),
            Self::Trapezoidal => Butcher::trapezoidal(),
            Self::ImplicitMidpoint => Butcher::gauss_legendre(1),
            Self::HermiteSimpson => Butcher::hermite_simpson(),
            Self::GaussLegendre(s) => Butcher::gauss_legendre(s.count()),
            Self::Radau(s) => Butcher::radau(s.count()),
        }
    }
}

impl fmt::Display for Scheme {
    /// The name in files.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GaussLegendre(s) => write!(f, "gauss-legendre-{}", s.0),
            Self::Radau(s) => write!(f, "radau-{}", s.0),
            plain => {
                let named = PLAIN.iter().find(|(scheme, _)| scheme == plain);
                f.write_str(named.map_or("", |(_, name)| name))
            }
        }
    }
}

impl FromStr for Scheme {
    type Err = SchemeError;

    fn from_str(text: &str) -> Result<Self, SchemeError> {
        if let Some((scheme, _)) = PLAIN.iter().find(|(_, name)| *name == text) {
            return Ok(*scheme);
        }
        match text {
            "euler" => return Ok(Self::ExplicitEuler),
            "midpoint" => return Ok(Self::ImplicitMidpoint),
            _ => {}
        }
        let stages = |rest: &str| rest.parse::<usize>().ok();
        if let Some(count) = text.strip_prefix("gauss-legendre-").and_then(stages) {
            return Stages::new(count).map(Self::GaussLegendre);
        }
        if let Some(count) = text.strip_prefix("radau-").and_then(stages) {
            return Stages::new(count).map(Self::Radau);
        }
        Err(SchemeError::Unknown {
            found: text.to_owned(),
        })
    }
}

impl From<Scheme> for String {
    fn from(scheme: Scheme) -> Self {
        scheme.to_string()
    }
}

impl TryFrom<String> for Scheme {
    type Error = SchemeError;

    fn try_from(text: String) -> Result<Self, SchemeError> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        let staged = (1..=Stages::MOST).flat_map(|s| {
            let stages = Stages::new(s).unwrap();
            [Scheme::GaussLegendre(stages), Scheme::Radau(stages)]
        });
        for scheme in PLAIN.iter().map(|(scheme, _)| *scheme).chain(staged) {
            assert_eq!(scheme.to_string().parse(), Ok(scheme));
        }
    }

    #[test]
    fn other_names_are_refused_with_the_choice() {
        let error = "leapfrog".parse::<Scheme>().unwrap_err().to_string();
        assert!(
            error.contains("`leapfrog`") && error.contains("explicit-euler, heun"),
            "{error}"
        );
        for count in [0, 7] {
            let error = format!("radau-{count}").parse::<Scheme>().unwrap_err();
            assert_eq!(error, SchemeError::Stages { found: count });
        }
    }
}
