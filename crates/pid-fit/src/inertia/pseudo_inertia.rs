//! Pseudo-inertia of a body and its log-Cholesky coordinates.
//!
//! The ten parameters of a body, `(m, h, I)` with first moment h and inertia I about the origin,
//! are those of a body with a non-negative density if and only if its pseudo-inertia is positive
//! definite (P. M. Wensing, S. Kim, J.-J. E. Slotine, IEEE RA-L 3, 2018):
//!
//! ```text
//! J = [ Σ  h ]      Σ = ½ tr(I) 1 − I
//!     [ hᵀ m ]
//! ```
//!
//! Every θ ∈ R¹⁰ gives such a body, smoothly and one to one (C. Rucker, P. M. Wensing, IEEE RA-L 7, 2022):
//!
//! ```text
//! J = U Uᵀ,   U = e^α [ e^d₁ s₁₂ s₁₃ t₁ ]
//!                     [ 0  e^d₂ s₂₃ t₂ ]         θ = (α, d₁, d₂, d₃, s₁₂, s₂₃, s₁₃, t₁, t₂, t₃)
//!                     [ 0   0  e^d₃ t₃ ]
//!                     [ 0   0   0   1  ]
//! ```

use nalgebra::{Matrix4, SymmetricEigen};
use num_dual::{DualNum, HyperDual64};

/// Parameters of a body.
pub const BODY: usize = 10;
/// Their suffixes in the names of a model: mass, first moment, inertia about the origin.
pub const SUFFIXES: [&str; BODY] = [
    "m", "mx", "my", "mz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz",
];
/// Smallest eigenvalue of a start, as a share of the largest.
const FLOOR: f64 = 1e-4;

/// The parameters `(m, h, I)`, in the order of [`SUFFIXES`], of log-Cholesky coordinates.
pub fn body<D: DualNum<Primitive = f64> + Copy>(theta: &[D; BODY]) -> [D; BODY] {
    let [alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3] = *theta;
    let (e1, e2, e3) = (d1.exp(), d2.exp(), d3.exp());
    let scale = (alpha * 2.0).exp();
    let xx = e1 * e1 + s12 * s12 + s13 * s13 + t1 * t1;
    let yy = e2 * e2 + s23 * s23 + t2 * t2;
    let zz = e3 * e3 + t3 * t3;
    let xy = s12 * e2 + s13 * s23 + t1 * t2;
    let xz = s13 * e3 + t1 * t3;
    let yz = s23 * e3 + t2 * t3;
    [
        D::from(1.0),
        t1,
        t2,
        t3,
        yy + zz,
        xx + zz,
        xx + yy,
        -xy,
        -xz,
        -yz,
    ]
    .map(|x| x * scale)
}

/// [`body`] with its first derivatives (row: parameter) and the second ones of `Σ λ_k body_k`.
pub(crate) fn derivatives(
    theta: &[f64; BODY],
    lambda: &[f64; BODY],
) -> ([f64; BODY], [[f64; BODY]; BODY], [[f64; BODY]; BODY]) {
    let (mut first, mut second) = ([[0.0; BODY]; BODY], [[0.0; BODY]; BODY]);
    let mut seeded = theta.map(HyperDual64::from_re);
    for i in 0..BODY {
        for j in 0..=i {
            seeded[i].eps1 = 1.0;
            seeded[j].eps2 = 1.0;
            let p = body(&seeded);
            seeded[i].eps1 = 0.0;
            seeded[j].eps2 = 0.0;
            let mut sum = 0.0;
            for (k, p) in p.iter().enumerate() {
                first[k][i] = p.eps1;
                sum += lambda[k] * p.eps1eps2;
            }
            second[i][j] = sum;
            second[j][i] = sum;
        }
    }
    (body(theta), first, second)
}

/// The pseudo-inertia of `(m, h, I)`.
pub fn matrix(p: &[f64; BODY]) -> Matrix4<f64> {
    let [m, hx, hy, hz, ixx, iyy, izz, ixy, ixz, iyz] = *p;
    let half = 0.5 * (ixx + iyy + izz);
    Matrix4::new(
        half - ixx,
        -ixy,
        -ixz,
        hx, //
        -ixy,
        half - iyy,
        -iyz,
        hy, //
        -ixz,
        -iyz,
        half - izz,
        hz, //
        hx,
        hy,
        hz,
        m,
    )
}

/// Smallest eigenvalue of the pseudo-inertia over its largest: negative for parameters that no body
/// can have.
pub fn definiteness(p: &[f64; BODY]) -> f64 {
    let eigen = matrix(p).symmetric_eigenvalues();
    let largest = eigen.iter().fold(0.0_f64, |a, e| a.max(e.abs()));
    if largest > 0.0 {
        eigen.min() / largest
    } else {
        0.0
    }
}

/// Log-Cholesky coordinates of a body; eigenvalues of its pseudo-inertia are lifted to at least a
/// ten-thousandth of the largest (to that of a body of 1 kg and 0.1 m where none is positive).
pub fn coordinates(p: &[f64; BODY]) -> [f64; BODY] {
    let eigen = SymmetricEigen::new(matrix(p));
    let largest = eigen.eigenvalues.max();
    let j = if largest > 0.0 && largest.is_finite() {
        let lifted = eigen.eigenvalues.map(|e| e.max(FLOOR * largest));
        eigen.eigenvectors * Matrix4::from_diagonal(&lifted) * eigen.eigenvectors.transpose()
    } else {
        Matrix4::from_diagonal(&nalgebra::Vector4::new(0.01, 0.01, 0.01, 1.0))
    };
    // J = U Uᵀ with U upper triangular, from the last column to the first.
    let mut u = Matrix4::zeros();
    for c in (0..4).rev() {
        for r in (0..=c).rev() {
            let rest: f64 = (c + 1..4).map(|k| u[(r, k)] * u[(c, k)]).sum();
            u[(r, c)] = match r == c {
                true => (j[(r, r)] - rest).max(f64::MIN_POSITIVE).sqrt(),
                false => (j[(r, c)] - rest) / u[(c, c)],
            };
        }
    }
    let e = u[(3, 3)];
    [
        e.ln(),
        (u[(0, 0)] / e).ln(),
        (u[(1, 1)] / e).ln(),
        (u[(2, 2)] / e).ln(),
        u[(0, 1)] / e,
        u[(1, 2)] / e,
        u[(0, 2)] / e,
        u[(0, 3)] / e,
        u[(1, 3)] / e,
        u[(2, 3)] / e,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_coordinate_is_a_body_of_point_masses(theta in prop::array::uniform10(-1.2_f64..1.2)) {
            let p = body(&theta);
            prop_assert!(definiteness(&p) > 0.0);
            // The inertia about the centre of mass is that of a body: positive, and no principal
            // moment above the sum of the others.
            let m = p[0];
            let c = [p[1] / m, p[2] / m, p[3] / m];
            let square: f64 = c.iter().map(|x| x * x).sum();
            let inertia = nalgebra::Matrix3::new(
                p[4], p[7], p[8], p[7], p[5], p[9], p[8], p[9], p[6],
            ) - m * (square * nalgebra::Matrix3::identity() - nalgebra::Vector3::from(c) * nalgebra::Vector3::from(c).transpose());
            let moments = inertia.symmetric_eigenvalues();
            prop_assert!(moments.min() > 0.0);
            prop_assert!(2.0 * moments.max() < moments.sum());
            // And back.
            if definiteness(&p) > 2.0 * FLOOR {
                for (a, b) in coordinates(&p).iter().zip(theta) {
                    prop_assert!((a - b).abs() < 1e-7, "{a} {b}");
                }
            }
        }

        #[test]
        fn derivatives_are_those_of_differences(theta in prop::array::uniform10(-0.8_f64..0.8), lambda in prop::array::uniform10(-1.0_f64..1.0)) {
            let (_, first, second) = derivatives(&theta, &lambda);
            for i in 0..BODY {
                let h = 1e-5;
                let moved = |d: f64| { let mut t = theta; t[i] += d; derivatives(&t, &lambda) };
                let (up, down) = (moved(h), moved(-h));
                for k in 0..BODY {
                    prop_assert!(((up.0[k] - down.0[k]) / (2.0 * h) - first[k][i]).abs() < 1e-6 * (1.0 + first[k][i].abs()));
                    let slope = |d: &[[f64; BODY]; BODY]| (0..BODY).map(|m| lambda[m] * d[m][k]).sum::<f64>();
                    let difference = (slope(&up.1) - slope(&down.1)) / (2.0 * h);
                    prop_assert!((difference - second[k][i]).abs() < 1e-5 * (1.0 + second[k][i].abs()));
                }
            }
        }
    }

    #[test]
    fn point_masses_give_their_pseudo_inertia() {
        // J = Σ m (x, 1)(x, 1)ᵀ by definition.
        let points = [
            (2.0, [0.1, 0.2, -0.3]),
            (0.5, [-0.4, 0.3, 0.2]),
            (1.0, [0.2, -0.5, 0.1]),
            (0.7, [0.0, 0.1, 0.6]),
        ];
        let mut p = [0.0; BODY];
        let mut j = Matrix4::zeros();
        for (m, [x, y, z]) in points {
            let v = nalgebra::Vector4::new(x, y, z, 1.0);
            j += m * v * v.transpose();
            let own = [
                m,
                m * x,
                m * y,
                m * z,
                m * (y * y + z * z),
                m * (x * x + z * z),
                m * (x * x + y * y),
                -m * x * y,
                -m * x * z,
                -m * y * z,
            ];
            p.iter_mut().zip(own).for_each(|(p, o)| *p += o);
        }
        assert!((matrix(&p) - j).norm() < 1e-12);
        let back = body(&coordinates(&p));
        assert!(back.iter().zip(p).all(|(a, b)| (a - b).abs() < 1e-9));
    }

    #[test]
    fn what_no_body_has_is_seen() {
        // Principal moments 1, 1, 3: more than the sum of the others.
        let p = [1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 3.0, 0.0, 0.0, 0.0];
        assert!(definiteness(&p) < 0.0);
        assert!(definiteness(&body(&coordinates(&p))) > 0.0);
    }
}
