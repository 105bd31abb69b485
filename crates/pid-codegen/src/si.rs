//! Units: their names, their dimensions and their algebra.
//!
//! The angle is dimensionless in comparisons and kept in printing, so `N*m*s/rad` reads as the user
//! wrote it and still multiplies with `rad/s` to `N*m`. Values are converted to the coherent SI
//! unit wherever a literal meets a unit.

use std::fmt;

/// Exponents of kg, m, s, A, K.
pub type Dims = [i32; 5];

/// A product of named SI units with the factor that converts a value to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    /// Exponents of the base units.
    pub dims: Dims,
    /// A value in the unit as written, times this, is the value in SI.
    pub scale: f64,
    /// SI names with exponents, in order of appearance, for printing.
    terms: Vec<(&'static str, i32)>,
}

/// A known unit.
struct Known {
    name: &'static str,
    dims: Dims,
    scale: f64,
    terms: &'static [(&'static str, i32)],
}

const fn known(
    name: &'static str,
    dims: Dims,
    scale: f64,
    terms: &'static [(&'static str, i32)],
) -> Known {
    Known {
        name,
        dims,
        scale,
        terms,
    }
}

use std::f64::consts::PI;

/// Every unit the language knows. Only prefixes that occur in mechanics and drives.
#[rustfmt::skip]
const KNOWN: &[Known] = &[
    known("kg",   [1, 0, 0, 0, 0],   1.0,   &[("kg", 1)]),
    known("m",    [0, 1, 0, 0, 0],   1.0,   &[("m", 1)]),
    known("s",    [0, 0, 1, 0, 0],   1.0,   &[("s", 1)]),
    known("A",    [0, 0, 0, 1, 0],   1.0,   &[("A", 1)]),
    known("K",    [0, 0, 0, 0, 1],   1.0,   &[("K", 1)]),
    known("rad",  [0, 0, 0, 0, 0],   1.0,   &[("rad", 1)]),
    known("N",    [1, 1, -2, 0, 0],  1.0,   &[("N", 1)]),
    known("J",    [1, 2, -2, 0, 0],  1.0,   &[("J", 1)]),
    known("W",    [1, 2, -3, 0, 0],  1.0,   &[("W", 1)]),
    known("V",    [1, 2, -3, -1, 0], 1.0,   &[("V", 1)]),
    known("Hz",   [0, 0, -1, 0, 0],  1.0,   &[("Hz", 1)]),
    known("Pa",   [1, -1, -2, 0, 0], 1.0,   &[("Pa", 1)]),
    known("Ohm",  [1, 2, -3, -2, 0], 1.0,   &[("Ohm", 1)]),
    known("g",    [1, 0, 0, 0, 0],   1e-3,  &[("kg", 1)]),
    known("mm",   [0, 1, 0, 0, 0],   1e-3,  &[("m", 1)]),
    known("cm",   [0, 1, 0, 0, 0],   1e-2,  &[("m", 1)]),
    known("um",   [0, 1, 0, 0, 0],   1e-6,  &[("m", 1)]),
    known("ms",   [0, 0, 1, 0, 0],   1e-3,  &[("s", 1)]),
    known("us",   [0, 0, 1, 0, 0],   1e-6,  &[("s", 1)]),
    known("mA",   [0, 0, 0, 1, 0],   1e-3,  &[("A", 1)]),
    known("mN",   [1, 1, -2, 0, 0],  1e-3,  &[("N", 1)]),
    known("kN",   [1, 1, -2, 0, 0],  1e3,   &[("N", 1)]),
    known("mV",   [1, 2, -3, -1, 0], 1e-3,  &[("V", 1)]),
    known("kW",   [1, 2, -3, 0, 0],  1e3,   &[("W", 1)]),
    known("kHz",  [0, 0, -1, 0, 0],  1e3,   &[("Hz", 1)]),
    known("deg",  [0, 0, 0, 0, 0],   PI / 180.0, &[("rad", 1)]),
    known("mrad", [0, 0, 0, 0, 0],   1e-3,  &[("rad", 1)]),
    known("rpm",  [0, 0, -1, 0, 0],  PI / 30.0,  &[("rad", 1), ("s", -1)]),
];

/// Whether `name` is a unit.
pub fn is_unit(name: &str) -> bool {
    KNOWN.iter().any(|k| k.name == name)
}

/// Names of all units.
pub fn unit_names() -> impl Iterator<Item = &'static str> {
    KNOWN.iter().map(|k| k.name)
}

impl Unit {
    /// The unit of numbers.
    pub fn one() -> Unit {
        Unit {
            dims: [0; 5],
            scale: 1.0,
            terms: Vec::new(),
        }
    }

    /// The unit with this name.
    pub fn named(name: &str) -> Option<Unit> {
        let k = KNOWN.iter().find(|k| k.name == name)?;
        Some(Unit {
            dims: k.dims,
            scale: k.scale,
            terms: k.terms.to_vec(),
        })
    }

    /// Product of named units; every name must be known.
    ///
    /// # Panics
    /// If a name is not in the table: the callers pass literals.
    pub fn of(terms: &[(&str, i32)]) -> Unit {
        terms.iter().fold(Unit::one(), |u, (name, n)| {
            u.mul(&Unit::named(name).expect("a unit of the table").powi(*n))
        })
    }

    /// Product.
    #[must_use]
    pub fn mul(&self, other: &Unit) -> Unit {
        let mut out = self.clone();
        for (d, e) in out.dims.iter_mut().zip(other.dims) {
            *d = d.saturating_add(e);
        }
        out.scale *= other.scale;
        for &(name, n) in &other.terms {
            match out.terms.iter_mut().find(|t| t.0 == name) {
                Some(t) => t.1 = t.1.saturating_add(n),
                None => out.terms.push((name, n)),
            }
        }
        out.terms.retain(|t| t.1 != 0);
        out
    }

    /// Quotient.
    #[must_use]
    pub fn div(&self, other: &Unit) -> Unit {
        self.mul(&other.powi(-1))
    }

    /// Integer power.
    #[must_use]
    pub fn powi(&self, n: i32) -> Unit {
        let mut out = self.clone();
        for d in &mut out.dims {
            *d = d.saturating_mul(n);
        }
        out.scale = out.scale.powi(n);
        for t in &mut out.terms {
            t.1 = t.1.saturating_mul(n);
        }
        out.terms.retain(|t| t.1 != 0);
        out
    }

    /// Square root, if every exponent is even.
    pub fn sqrt(&self) -> Option<Unit> {
        self.root(2)
    }

    /// The unit whose power `n` it is, if every exponent is a multiple of `n`.
    pub fn root(&self, n: i32) -> Option<Unit> {
        if n == 0 || self.dims.iter().any(|d| d % n != 0) {
            return None;
        }
        let dims = self.dims.map(|d| d / n);
        let whole = self.terms.iter().all(|t| t.1 % n == 0);
        let terms = if whole {
            self.terms.iter().map(|t| (t.0, t.1 / n)).collect()
        } else {
            ["kg", "m", "s", "A", "K"]
                .into_iter()
                .zip(dims)
                .filter(|t| t.1 != 0)
                .collect()
        };
        Some(Unit {
            dims,
            scale: match n {
                2 => self.scale.sqrt(),
                _ => self.scale.powf(1.0 / f64::from(n)),
            },
            terms,
        })
    }

    /// Whether a value in one can be added to a value in the other.
    pub fn same_dims(&self, other: &Unit) -> bool {
        self.dims == other.dims
    }

    /// Whether the unit is that of a number or an angle.
    pub fn is_dimensionless(&self) -> bool {
        self.dims == [0; 5]
    }
}

/// `N*m*s/rad`, `1/s`, `1`: the coherent SI unit, in the form the language reads.
impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let power = |(name, n): (&str, i32)| match n {
            1 => name.to_string(),
            n => format!("{name}^{n}"),
        };
        let up: Vec<String> = self
            .terms
            .iter()
            .filter(|t| t.1 > 0)
            .map(|&t| power(t))
            .collect();
        f.write_str(&if up.is_empty() {
            "1".to_string()
        } else {
            up.join("*")
        })?;
        for &(name, n) in self.terms.iter().filter(|t| t.1 < 0) {
            write!(f, "/{}", power((name, -n)))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_cancel_and_print() {
        let viscous = Unit::of(&[("N", 1), ("m", 1), ("s", 1), ("rad", -1)]);
        let v = Unit::of(&[("rad", 1), ("s", -1)]);
        assert_eq!(viscous.to_string(), "N*m*s/rad");
        assert_eq!(viscous.mul(&v).to_string(), "N*m");
        assert_eq!(Unit::one().div(&v).to_string(), "s/rad");
        assert_eq!(Unit::one().to_string(), "1");
        assert_eq!(Unit::of(&[("s", -2)]).to_string(), "1/s^2");
    }

    #[test]
    fn derived_units_have_the_dimensions_of_their_definition() {
        for (derived, definition) in [
            ("N", &[("kg", 1), ("m", 1), ("s", -2)][..]),
            ("J", &[("N", 1), ("m", 1)]),
            ("W", &[("J", 1), ("s", -1)]),
            ("V", &[("W", 1), ("A", -1)]),
            ("Ohm", &[("V", 1), ("A", -1)]),
            ("Pa", &[("N", 1), ("m", -2)]),
            ("Hz", &[("s", -1)]),
            ("rpm", &[("rad", 1), ("s", -1)]),
        ] {
            let (d, e) = (Unit::named(derived).unwrap(), Unit::of(definition));
            assert_eq!(d.dims, e.dims, "{derived}");
        }
    }

    #[test]
    fn prefixes_scale_and_print_as_si() {
        let u = Unit::of(&[("g", 1), ("mm", 2)]);
        assert!((u.scale - 1e-9).abs() < 1e-24);
        assert_eq!(u.to_string(), "kg*m^2");
        assert!((Unit::named("deg").unwrap().scale * 180.0 - PI).abs() < 1e-15);
    }

    #[test]
    fn roots_need_even_exponents() {
        let r = Unit::of(&[("N", 1), ("m", -1), ("kg", -1)]).sqrt().unwrap();
        assert_eq!(r.to_string(), "1/s");
        assert!(Unit::of(&[("m", 1)]).sqrt().is_none());
        let cube = Unit::of(&[("m", 3), ("s", -6)]);
        assert_eq!(cube.root(3).unwrap().to_string(), "m/s^2");
        assert_eq!(cube.root(-3).unwrap().to_string(), "s^2/m");
        assert!(cube.root(2).is_none() && cube.root(0).is_none());
    }
}
