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

/// The tensor nearest to `[xx, yy, zz, xy, xz, yz]` that a body can have, and by how much the largest
/// principal moment exceeds the sum of the others, kg·m² (zero or negative for a body).
///
/// Nearest in the sum of squares of all nine entries: the principal axes stay, and the principal
/// moments go to the nearest point of the cone `J₁ ≤ J₂ + J₃`. The tensor of a body stays exactly as
/// it is. Entries must be finite.
pub fn nearest(inertia: [f64; 6]) -> ([f64; 6], f64) {
    let scale = inertia.iter().fold(0.0_f64, |scale, x| scale.max(x.abs()));
    if scale == 0.0 {
        return (inertia, 0.0);
    }
    let (moments, axes) = principal_axes(inertia.map(|x| x / scale));
    let [j1, j2, j3] = moments;
    let excess = j1 - j2 - j3;
    if excess <= 0.0 {
        return (inertia, scale * excess);
    }
    // On the face J₁ = J₂ + J₃, unless that leaves the cone: then on its edge J₁ = J₂, J₃ = 0.
    let share = excess / 3.0;
    let projected = match [j1 - share, j2 + share, j3 + share] {
        face if face[2] >= 0.0 => face,
        _ => [0.5 * (j1 + j2).max(0.0), 0.5 * (j1 + j2).max(0.0), 0.0],
    };
    (of_axes(projected.map(|j| scale * j), axes), scale * excess)
}

/// The tensor with principal moments below `least` raised to it; the axes stay. A tensor without such
/// moments stays exactly as it is. Entries must be finite.
pub fn raised(inertia: [f64; 6], least: f64) -> [f64; 6] {
    let (moments, axes) = principal_axes(inertia);
    if moments[2] >= least {
        return inertia;
    }
    of_axes(moments.map(|j| j.max(least)), axes)
}

/// The tensor of principal moments and axes.
fn of_axes(moments: [f64; 3], axes: [[f64; 3]; 3]) -> [f64; 6] {
    let entry =
        |r: usize, c: usize| -> f64 { (0..3).map(|k| moments[k] * axes[k][r] * axes[k][c]).sum() };
    [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(r, c)| entry(r, c))
}

/// Principal moments, largest first, and their axes, by Jacobi's rotations (W. H. Press et al.,
/// *Numerical Recipes*, section 11.1).
fn principal_axes([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> ([f64; 3], [[f64; 3]; 3]) {
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // Convergence is quadratic: six sweeps reach the rounding of any tensor.
    for _ in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = 0.5 * (2.0 * a[p][q] / (a[q][q] - a[p][p])).atan();
            let (s, c) = theta.sin_cos();
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            let (rp, rq) = (a[p], a[q]);
            for k in 0..3 {
                (a[p][k], a[q][k]) = (c * rp[k] - s * rq[k], s * rp[k] + c * rq[k]);
            }
            let (vp, vq) = (axes[p], axes[q]);
            for k in 0..3 {
                (axes[p][k], axes[q][k]) = (c * vp[k] - s * vq[k], s * vp[k] + c * vq[k]);
            }
            (a[p][q], a[q][p]) = (0.0, 0.0);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]));
    (order.map(|k| a[k][k]), order.map(|k| axes[k]))
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
    use super::{Implausible, check, nearest, principal_moments, raised};

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

    /// Faces, edge and apex of the cone by hand, and in turned axes.
    #[test]
    fn the_nearest_tensor_of_a_body() {
        for (moments, expected, excess) in [
            ([9.0, 6.0, 2.0], [26.0 / 3.0, 19.0 / 3.0, 7.0 / 3.0], 1.0),
            ([3.0, 0.0, 0.0], [2.0, 1.0, 1.0], 3.0),
            ([5.0, 4.0, -3.0], [4.5, 4.5, 0.0], 4.0),
            ([-1.0, -2.0, -3.0], [0.0, 0.0, 0.0], 4.0),
            ([5.0, 4.0, 3.0], [5.0, 4.0, 3.0], -2.0),
        ] {
            let [x, y, z]: [f64; 3] = moments;
            let (found, off) = nearest([x, y, z, 0.0, 0.0, 0.0]);
            assert!((off - excess).abs() < 1e-14, "{off}");
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-14, "{found} {expected}");
            }
            assert_eq!(check(1.0, found), Ok(()));
            // Turned about (1, 2, 2)/3 by 1 rad.
            let r = turn();
            let (turned, _) = nearest(about(r, moments));
            for (found, expected) in turned.into_iter().zip(about(r, expected)) {
                assert!((found - expected).abs() < 1e-14, "{found} {expected}");
            }
        }
    }

    #[test]
    fn small_moments_are_raised() {
        let r = turn();
        let found = raised(about(r, [5.0, 0.1, -2.0]), 0.5);
        for (found, expected) in found.into_iter().zip(about(r, [5.0, 0.5, 0.5])) {
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
        assert_eq!(raised([0.0; 6], 0.5), [0.5, 0.5, 0.5, 0.0, 0.0, 0.0]);
        let large = about(r, [5.0, 4.0, 3.0]);
        assert_eq!(raised(large, 0.5), large);
    }

    fn turn() -> [[f64; 3]; 3] {
        let (s, c) = 1.0_f64.sin_cos();
        let [x, y, z] = [1.0, 2.0, 2.0].map(|k: f64| k / 3.0);
        let t = 1.0 - c;
        [
            [c + x * x * t, x * y * t - z * s, x * z * t + y * s],
            [x * y * t + z * s, c + y * y * t, y * z * t - x * s],
            [x * z * t - y * s, y * z * t + x * s, c + z * z * t],
        ]
    }

    /// `R diag(J) Rᵀ`.
    fn about(r: [[f64; 3]; 3], moments: [f64; 3]) -> [f64; 6] {
        [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
            .map(|(i, j)| (0..3).map(|k| r[i][k] * moments[k] * r[j][k]).sum())
    }
}
