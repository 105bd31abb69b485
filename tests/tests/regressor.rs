//! Generated regressors and base parameters against the residual, and against its derivatives by
//! dual numbers.

use num_dual::Dual64;
use pid_models::arm6::{Arm6, Arm6Params};
use pid_models::panda::Panda;
use pid_runtime::dynamics::{At, Regressor};
use pid_runtime::generic::GenericDynamics;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

struct Point {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    u: Vec<f64>,
    p: Vec<f64>,
}

impl Point {
    fn new(model: &dyn Regressor, rng: &mut ChaCha8Rng) -> Self {
        let dims = model.dims();
        let mut vector = |n: usize| {
            (0..n)
                .map(|_| rng.random_range(-2.0..2.0))
                .collect::<Vec<f64>>()
        };
        let (q, v, a, u) = (
            vector(dims.nq),
            vector(dims.nq),
            vector(dims.nq),
            vector(dims.nu),
        );
        let spread = vector(dims.np);
        let p = model
            .params()
            .iter()
            .zip(spread)
            .map(|(info, x)| info.nominal * (1.0 + 0.2 * x) + 0.05 * x)
            .collect();
        Self { q, v, a, u, p }
    }

    fn at(&self) -> At<'_> {
        At {
            q: &self.q,
            v: &self.v,
            a: &self.a,
            u: &self.u,
            p: &self.p,
        }
    }
}

fn close(found: &[f64], expected: &[f64], tolerance: f64) {
    close_to(found, expected, tolerance, 1e-9);
}

fn close_to(found: &[f64], expected: &[f64], tolerance: f64, least: f64) {
    let scale = expected.iter().fold(least, |s, x| s.max(x.abs()));
    for (x, y) in found.iter().zip(expected) {
        assert!((x - y).abs() <= tolerance * scale, "{x} for {y} of {scale}");
    }
}

/// Y by the slice face, dense, and r₀; evaluated where the linear parameters are not a number,
/// since they must not be read.
fn evaluate(model: &dyn Regressor, point: &Point) -> (Vec<Vec<f64>>, Vec<f64>) {
    let (nq, nl) = (model.dims().nq, model.linear_params().len());
    let mut p = point.p.clone();
    for &k in model.linear_params() {
        p[k] = f64::NAN;
    }
    let pattern = model.regressor_pattern();
    let (mut offset, mut values) = (vec![0.0; nq], vec![0.0; pattern.nnz()]);
    model.regressor(
        &At {
            p: &p,
            ..point.at()
        },
        &mut offset,
        &mut values,
    );
    let mut y = vec![vec![0.0; nl]; nq];
    for ((&row, &col), value) in pattern.rows.iter().zip(pattern.cols).zip(values) {
        y[row as usize][col as usize] = value;
    }
    (y, offset)
}

fn check(model: &(impl Regressor + GenericDynamics), seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let nq = model.dims().nq;
    let base = model.base_parameters().expect("asked for");
    for _ in 0..5 {
        let point = Point::new(model, &mut rng);
        let mut r = vec![0.0; nq];
        model.residual(&point.at(), &mut r);
        let (y, offset) = evaluate(model, &point);
        let linear: Vec<f64> = model.linear_params().iter().map(|&k| point.p[k]).collect();
        let found: Vec<f64> = (0..nq)
            .map(|i| offset[i] + y[i].iter().zip(&linear).map(|(y, p)| y * p).sum::<f64>())
            .collect();
        close(&found, &r, 1e-12);

        // Column by column against ∂r/∂p by forward mode.
        let dual = |x: &[f64]| x.iter().map(|&x| Dual64::from(x)).collect::<Vec<_>>();
        let (q, v, a, u) = (
            dual(&point.q),
            dual(&point.v),
            dual(&point.a),
            dual(&point.u),
        );
        for (col, &k) in model.linear_params().iter().enumerate() {
            let mut p = dual(&point.p);
            p[k] = p[k].derivative();
            let mut slope = vec![Dual64::from(0.0); nq];
            model.residual_generic(&q, &v, &a, &u, &p, &mut slope);
            let expected: Vec<f64> = slope.iter().map(|x| x.eps).collect();
            let column: Vec<f64> = y.iter().map(|row| row[col]).collect();
            // Entries of unit size, N·m per unit of the parameter, set the scale.
            close_to(&column, &expected, 1e-12, 1.0);
        }

        let mut beta = vec![0.0; base.len()];
        base.evaluate(&linear, &mut beta);
        let found: Vec<f64> = (0..nq)
            .map(|i| {
                offset[i]
                    + base
                        .columns
                        .iter()
                        .zip(&beta)
                        .map(|(&j, b)| y[i][j as usize] * b)
                        .sum::<f64>()
            })
            .collect();
        close(&found, &r, 1e-10);
    }
}

#[test]
fn slice_faces() {
    check(&Arm6, 1);
    check(&Panda, 2);
}

#[test]
fn the_typed_face_of_a_six_axis_arm() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..5 {
        let point = Point::new(&Arm6, &mut rng);
        let array = |x: &[f64]| <[f64; 6]>::try_from(x).expect("six joints");
        let (q, v, a) = (array(&point.q), array(&point.v), array(&point.a));
        let params = Arm6Params::from_array(point.p.as_slice().try_into().expect("all parameters"));
        let tau = Arm6::inverse_dynamics(&q, &v, &a, &params);
        let offset = Arm6::regressor_offset(&q, &v, &a, &params);
        let y = Arm6::regressor(&q, &v, &a);
        let found: Vec<f64> = (0..6)
            .map(|i| {
                let columns = Arm6::REGRESSOR_PARAMS.iter().zip(&y[i]);
                offset[i]
                    + columns
                        .map(|(param, y)| y * point.p[param.index()])
                        .sum::<f64>()
            })
            .collect();
        close(&found, &tau, 1e-12);
        let (y, beta) = (
            Arm6::base_regressor(&q, &v, &a),
            Arm6::base_parameters(&params),
        );
        let found: Vec<f64> = (0..6)
            .map(|i| offset[i] + y[i].iter().zip(&beta).map(|(y, b)| y * b).sum::<f64>())
            .collect();
        close(&found, &tau, 1e-10);
    }
}

#[test]
fn counts() {
    // 60 inertial parameters and six viscous frictions; dry friction depends on the sharpness,
    // gains meet the currents.
    assert_eq!(Arm6::NL, 66);
    // The UR10 has 36 base inertial parameters.
    assert_eq!(Arm6::NB, 36 + 6);
    assert_eq!(Arm6::BASE.len(), Arm6::NB);
    assert_eq!(Arm6.linear_params().len(), 78);
    assert_eq!(Arm6.base_parameters().map(|b| b.len()), Some(36 + 18));
    // The Panda has 43 base inertial parameters (C. Gaz et al., 2019); friction is linear in both
    // coefficients.
    assert_eq!((Panda::NL, Panda::NB), (84, 43 + 14));
    // Its torque inputs are known, so that no common factor is lost: the rank of the motion is that
    // of the torques.
    assert_eq!(Panda::RANK, Panda::NB);
    // Link 1 of the arm turns about z; everything beyond adds to its inertia about that axis.
    assert!(Arm6::BASE[0].starts_with("l1_izz + l2_izz + 2*0.220941*l2_my + 0.220941^2*l2_m"));
    assert!(Arm6::BASE.contains(&"l4_iyy + l5_iyy + 0.1157^2*l6_m"));
}
