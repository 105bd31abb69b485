//! The typed face of a declared robot against its slice face and against dual numbers.

use pid_runtime::dynamics::{At, Dynamics, Hessian, Jacobian, SingularMassMatrix};
use pid_runtime::{generic, robot};

robot! {
    /// A slanted slide that carries a pendulum.
    pub robot Crane {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            m: kg = 3.0 in 0.1..=5.0;
            l: m = 0.5 in 0.1..=1.0;
            cart: kg = 2.0 in 0.1..=9.0;
        }
        link slide { mass: cart; }
        link rod { mass: m; com: [0, 0, -l]; inertia at com: diag(_, 0.02, _) kg*m^2; }
        joint rail: prismatic along x { base -> slide at [0, 0, 0] m rpy [0, -0.2, 0] rad; }
        joint pivot: revolute about y { slide -> rod; }
        per joint rail { input pull: N; force = pull - 30 N*s/m * v; }
        per joint pivot { input torque: N*m; dry: N*m = 0.4 in 0.0..=1.0; force = torque - dry*tanh(20 s/rad * v); }
    }
}

const Q: [f64; 2] = [0.3, 0.8];
const V: [f64; 2] = [0.5, -0.04];
const A: [f64; 2] = [1.5, -2.5];
const U: CraneInputs = CraneInputs {
    pull_rail: 7.0,
    torque_pivot: -2.0,
};
const P: CraneParams = CraneParams::nominal();

fn at<'a>(u: &'a [f64], p: &'a [f64]) -> At<'a> {
    At {
        q: &Q,
        v: &V,
        a: &A,
        u,
        p,
    }
}

fn assert_close(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() <= 1e-12 * (1.0 + expected.abs()),
        "{found} for {expected}"
    );
}

/// Lagrange by hand: x along the rail, φ = q₂ − 0.2 the pitch of the rod against the vertical.
#[test]
fn residual_is_that_of_a_cart_with_a_pendulum() {
    let (m, l, cart, j) = (P.m, P.l, P.cart, 0.02 + P.m * P.l * P.l);
    let (s, c) = Q[1].sin_cos();
    let phi = Q[1] - 0.2;
    // The mass hangs at −l(sin q₂, cos q₂) in the axes of the rail, and the rail rises with sin 0.2.
    let expected = [
        (m + cart) * (A[0] + 9.81 * 0.2_f64.sin())
            - m * l * (c * A[1] - s * V[1] * V[1])
            - (U.pull_rail - 30.0 * V[0]),
        j * A[1] - m * l * c * A[0] + m * 9.81 * l * phi.sin()
            - (U.torque_pivot - P.dry_pivot * (20.0 * V[1]).tanh()),
    ];
    for (found, expected) in Crane::residual(&Q, &V, &A, &U, &P)
        .into_iter()
        .zip(expected)
    {
        assert_close(found, expected);
    }
}

#[test]
fn forward_dynamics_solves_the_residual() {
    let a = Crane::forward_dynamics(&Q, &V, &U, &P).unwrap();
    for r in Crane::residual(&Q, &V, &a, &U, &P) {
        assert!(r.abs() < 1e-13, "{r}");
    }
    let mut dual = [0.0; 2];
    Crane::vector_field_generic(&Q, &V, &U.as_array(), &P.as_array(), &mut dual).unwrap();
    assert_eq!(dual, a);
}

#[test]
fn a_massless_crane_has_a_singular_mass_matrix() {
    let massless = CraneParams {
        m: 0.0,
        cart: 0.0,
        ..P
    };
    let error = Crane::forward_dynamics(&Q, &V, &U, &massless).unwrap_err();
    assert_eq!(
        error,
        SingularMassMatrix {
            index: 0,
            pivot: 0.0
        }
    );
}

#[test]
fn parts_add_up() {
    let m = Crane::mass_matrix(&Q, &P);
    assert_eq!(m[0][1], m[1][0]);
    let (b, f, r) = (
        Crane::bias(&Q, &V, &P),
        Crane::applied_force(&Q, &V, &U, &P),
        Crane::residual(&Q, &V, &A, &U, &P),
    );
    for i in 0..2 {
        assert_close(m[i][0] * A[0] + m[i][1] * A[1] + b[i] - f[i], r[i]);
    }
    assert_eq!(Crane::gravity(&Q, &P), Crane::bias(&Q, &[0.0; 2], &P));
    assert_close(
        Crane::kinetic_energy(&Q, &V, &P),
        0.5 * (m[0][0] * V[0] * V[0] + 2.0 * m[0][1] * V[0] * V[1] + m[1][1] * V[1] * V[1]),
    );
    let h = 1e-6;
    for k in 0..2 {
        let energy = |h: f64| {
            let mut q = Q;
            q[k] += h;
            Crane::potential_energy(&q, &P)
        };
        let slope = (energy(h) - energy(-h)) / (2.0 * h);
        assert!((slope - Crane::gravity(&Q, &P)[k]).abs() < 1e-8);
    }
}

#[test]
fn typed_derivatives_are_those_of_dual_numbers() {
    let (p, nz) = (P.as_array(), Crane.dims().nz());
    let zero = [0.0; 2];
    let mut dense = vec![0.0; 2 * nz];
    generic::residual_jacobian(&Crane, Crane.dims(), &at(&zero, &p), &mut dense);
    let d = Crane::inverse_dynamics_derivatives(&Q, &V, &A, &P);
    for row in 0..2 {
        let blocks = [
            &d.dtau_dq[row][..],
            &d.dtau_dv[row],
            &d.dtau_da[row],
            &zero,
            &d.dtau_dp[row],
        ]
        .concat();
        for (col, found) in blocks.into_iter().enumerate() {
            // u does not belong to the inverse dynamics.
            if !(6..8).contains(&col) {
                assert_close(found, dense[row * nz + col]);
            }
        }
    }
}

#[test]
fn both_faces_agree() {
    let (u, p, lambda) = (U.as_array(), P.as_array(), [0.7, -1.3]);
    let at = at(&u, &p);
    let mut r = [0.0; 2];
    Crane.residual(&at, &mut r);
    assert_eq!(r, Crane::residual(&Q, &V, &A, &U, &P));
    let mut with_values = [0.0; 2];
    Crane.residual_jacobian(&at, &mut with_values, &mut [0.0; Crane::JACOBIAN_NNZ]);
    for (found, expected) in with_values.into_iter().zip(r) {
        assert_close(found, expected);
    }
    let mut values = [0.0; Crane::HESSIAN_NNZ];
    Crane.residual_hessian(&at, &lambda, &mut values);
    assert_eq!(
        values,
        Crane::lagrangian_hessian(&Q, &V, &A, &U, &P, &lambda)
    );
    let mut dual = [0.0; Crane::HESSIAN_NNZ];
    generic::residual_hessian(
        &Crane,
        Crane.dims(),
        &at,
        &lambda,
        Crane.hessian_pattern(),
        &mut dual,
    );
    for (found, expected) in values.into_iter().zip(dual) {
        assert_close(found, expected);
    }
}

#[test]
fn names_replace_indices() {
    assert_eq!(
        CraneParam::ALL.map(|param| param.name()),
        ["m", "l", "cart", "dry_pivot"]
    );
    assert_eq!(
        (CraneParam::Cart.index(), CraneParam::DryPivot.unit()),
        (2, "N*m")
    );
    assert_eq!(
        CraneJoint::ALL.map(|joint| (joint.name(), joint.index())),
        [("rail", 0), ("pivot", 1)]
    );
    assert!(Crane.joints()[0].prismatic && !Crane.joints()[1].prismatic);
    assert_eq!(CraneParams::from_array(P.as_array()), P);
    assert_eq!((CraneParams::lower().l, CraneParams::upper().l), (0.1, 1.0));
    assert_eq!(Crane.inputs()[1].joint, Some(1));
}
