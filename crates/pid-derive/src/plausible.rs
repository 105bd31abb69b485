//! Whether a body can have a mass distribution: conditions on numbers, not on expressions.
//!
//! With the principal moments `J₁ ≥ J₂ ≥ J₃` about the centre of mass a body exists if and only if
//! `m > 0` and `J₁ ≤ J₂ + J₃` (the triangle inequality, which implies `J₃ ≥ 0`): equality for a
//! plate or a rod, all zero for a point (S. Traversaro et al., *Identification of fully physical
//! consistent inertial parameters using optimization on manifolds*, IROS 2016, section III).

use thiserror::Error;

/// Rounding in a file explains a violation of the triangle inequality up to this share of the
/// largest principal moment.
const ROUNDING: f64 = 1e-4;

/// Why no body has such a mass or inertia.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum Implausible {
    /// A number that is not finite.
    #[error("a value is {value}; give a finite number")]
    NotFinite {
        /// The value.
        value: f64,
    },
    /// The mass is zero or negative.
    #[error("the mass is {mass} kg; it must be positive")]
    Mass {
        /// The mass, kg.
        mass: f64,
    },
    /// A principal moment is negative.
    #[error(
        "the principal moments about the centre of mass are {0:.3e}, {1:.3e}, {2:.3e} kg m^2; none may be negative: check the \
         signs of the products of inertia, and that the tensor is about the centre of mass",
        .moments[0], .moments[1], .moments[2]
    )]
    Negative {
        /// The principal moments, kg·m², largest first.
        moments: [f64; 3],
    },
    /// A principal moment is larger than the sum of the others.
    #[error(
        "the principal moments about the centre of mass are {0:.3e}, {1:.3e}, {2:.3e} kg m^2; the largest must not exceed the \
         sum of the others: check units, and that the tensor is about the centre of mass",
        .moments[0], .moments[1], .moments[2]
    )]
    Triangle {
        /// The principal moments, kg·m², largest first.
        moments: [f64; 3],
    },
}

/// Checks mass and inertia about the centre of mass, `[xx, yy, zz, xy, xz, yz]` in any axes. It
/// accepts a violation that rounding to four digits explains.
///
/// # Errors
/// Which condition fails, with the values.
pub fn check(mass: f64, inertia: [f64; 6]) -> Result<(), Implausible> {
    if let Some(&value) = [mass].iter().chain(&inertia).find(|x| !x.is_finite()) {
        return Err(Implausible::NotFinite { value });
    }
    if mass <= 0.0 {
        return Err(Implausible::Mass { mass });
    }
    let moments = principal_moments(inertia);
    let allowed = ROUNDING * moments[0].abs();
    if moments[2] < -allowed {
        return Err(Implausible::Negative { moments });
    }
    if moments[0] > moments[1] + moments[2] + allowed {
        return Err(Implausible::Triangle { moments });
    }
    Ok(())
}

/// Principal moments of `[xx, yy, zz, xy, xz, yz]`, largest first, by the roots of the
/// characteristic cubic (O. K. Smith, *Eigenvalues of a symmetric 3×3 matrix*, Communications of
/// the ACM 4, 1961).
pub fn principal_moments(inertia: [f64; 6]) -> [f64; 3] {
    // Scaled first, since squares of large or small entries overflow or underflow.
    let scale = inertia.iter().fold(0.0_f64, |scale, x| scale.max(x.abs()));
    if scale == 0.0 {
        return [0.0; 3];
    }
    let [xx, yy, zz, xy, xz, yz] = inertia.map(|x| x / scale);
    let mean = (xx + yy + zz) / 3.0;
    let (a, b, c) = (xx - mean, yy - mean, zz - mean);
    let off = xy * xy + xz * xz + yz * yz;
    let radius = ((a * a + b * b + c * c + 2.0 * off) / 6.0).sqrt();
    if radius == 0.0 {
        return [scale * mean; 3];
    }
    let [a, b, c, xy, xz, yz] = [a, b, c, xy, xz, yz].map(|x| x / radius);
    let determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz);
    let angle = (0.5 * determinant).clamp(-1.0, 1.0).acos() / 3.0;
    let third = 2.0 * std::f64::consts::PI / 3.0;
    let largest = mean + 2.0 * radius * angle.cos();
    let smallest = mean + 2.0 * radius * (angle + third).cos();
    [largest, 3.0 * mean - largest - smallest, smallest].map(|x| scale * x)
}

#[cfg(test)]
mod tests {
    use super::{Implausible, check, principal_moments};

    #[test]
    fn principal_moments_of_a_turned_tensor() {
        // diag(5, 3, 1) turned by 30° about z, then by 40° about x.
        let (s, c) = (30.0_f64.to_radians().sin(), 30.0_f64.to_radians().cos());
        let (xx, yy, xy) = (
            5.0 * c * c + 3.0 * s * s,
            5.0 * s * s + 3.0 * c * c,
            2.0 * s * c,
        );
        let (s, c) = (40.0_f64.to_radians().sin(), 40.0_f64.to_radians().cos());
        let turned = [
            xx,
            c * c * yy + s * s,
            s * s * yy + c * c,
            c * xy,
            s * xy,
            s * c * (yy - 1.0),
        ];
        for scale in [1.0, 1e-300, 1e300] {
            let found = principal_moments(turned.map(|x| scale * x));
            for (found, expected) in found.into_iter().zip([5.0, 3.0, 1.0]) {
                assert!((found / scale - expected).abs() < 1e-14, "{found} {scale}");
            }
        }
        assert_eq!(principal_moments([2.0, 2.0, 2.0, 0.0, 0.0, 0.0]), [2.0; 3]);
    }

    #[test]
    fn bodies_at_the_edge_exist_and_beyond_do_not() {
        let diag = |x, y, z| [x, y, z, 0.0, 0.0, 0.0];
        assert_eq!(check(1.0, diag(0.0, 0.0, 0.0)), Ok(()));
        assert_eq!(check(1.0, diag(1.0, 1.0, 0.0)), Ok(()));
        assert_eq!(check(1.0, diag(1.0, 0.5, 0.5)), Ok(()));
        assert!(matches!(
            check(0.0, diag(1.0, 1.0, 1.0)),
            Err(Implausible::Mass { .. })
        ));
        assert!(matches!(
            check(1.0, diag(1.0, 0.5, 0.4)),
            Err(Implausible::Triangle { .. })
        ));
        // Positive on the diagonal, negative about a slanted axis.
        let slanted = [1.0, 1.0, 1.0, 1.1, 0.0, 0.0];
        assert!(matches!(
            check(1.0, slanted),
            Err(Implausible::Negative { .. })
        ));
        assert!(matches!(
            check(f64::NAN, diag(1.0, 1.0, 1.0)),
            Err(Implausible::NotFinite { .. })
        ));
    }
}
