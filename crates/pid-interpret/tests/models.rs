//! Every robot of `pid-models`, compiled and interpreted from the same declaration: equal values,
//! equal derivatives.

mod common;

use common::declared;
use pid_interpret::Model;
use pid_runtime::dynamics::{At, Dims, Dynamics, Hessian, Jacobian, Pattern};
use pid_runtime::generic;
use pid_runtime::lanes::{LANES, Lane, LanesAt};
use pid_symbolic::random::Random;

/// Agreement relative to the largest entry. The generated code is the same graph: only rounding of
/// libraries may differ.
const AGREEMENT: f64 = 1e-13;
const POINTS: usize = 20;

/// A point, parameters within 20 % of nominal.
struct Point {
    dims: Dims,
    z: Vec<f64>,
    lambda: Vec<f64>,
}

impl Point {
    fn new(model: &dyn Dynamics, random: &mut Random) -> Self {
        let dims = model.dims();
        let mut z = Vec::new();
        z.extend((0..dims.nq).map(|_| random.uniform(-3.0, 3.0)));
        z.extend((0..2 * dims.nq + dims.nu).map(|_| random.uniform(-4.0, 4.0)));
        for p in model.params() {
            let value = p.nominal * random.uniform(0.8, 1.2) + random.uniform(-0.01, 0.01);
            z.push(value.clamp(p.lower, p.upper));
        }
        let lambda = (0..dims.nq).map(|_| random.uniform(-1.0, 1.0)).collect();
        Self { dims, z, lambda }
    }

    fn at(&self) -> At<'_> {
        let d = self.dims;
        At {
            q: &self.z[..d.v()],
            v: &self.z[d.v()..d.a()],
            a: &self.z[d.a()..d.u()],
            u: &self.z[d.u()..d.p()],
            p: &self.z[d.p()..],
        }
    }
}

fn close(what: &str, found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        // Written so that NaN is refused.
        assert!(
            (found - expected).abs() <= AGREEMENT * scale,
            "{what}[{k}]: {found:e} for {expected:e}"
        );
    }
}

/// Values at a pattern as a dense matrix: entries that only one side calls structural must be zero.
fn dense(pattern: Pattern<'_>, values: &[f64], rows: usize, cols: usize) -> Vec<f64> {
    assert_eq!(pattern.nnz(), values.len());
    let mut matrix = vec![0.0; rows * cols];
    for ((&row, &col), value) in pattern.rows.iter().zip(pattern.cols).zip(values) {
        matrix[row as usize * cols + col as usize] = *value;
    }
    matrix
}

fn vector(len: usize, f: impl FnOnce(&mut [f64])) -> Vec<f64> {
    let mut out = vec![f64::NAN; len];
    f(&mut out);
    out
}

fn jacobian(model: &dyn Hessian, at: &At<'_>) -> Vec<f64> {
    let d = model.dims();
    let mut r = vec![f64::NAN; d.nq];
    let values = vector(model.jacobian_pattern().nnz(), |out| {
        model.residual_jacobian(at, &mut r, out);
    });
    close("r beside J", &r, &vector(d.nq, |r| model.residual(at, r)));
    dense(model.jacobian_pattern(), &values, d.nq, d.nz())
}

fn hessian(model: &dyn Hessian, at: &At<'_>, lambda: &[f64]) -> Vec<f64> {
    let values = vector(model.hessian_pattern().nnz(), |out| {
        model.residual_hessian(at, lambda, out);
    });
    let nz = model.dims().nz();
    dense(model.hessian_pattern(), &values, nz, nz)
}

fn compare(file: &str, compiled: &dyn Hessian) {
    let interpreted = Model::new(&declared(file)).expect("the robot can be derived");
    assert_eq!(interpreted.name(), compiled.name());
    assert_eq!(interpreted.dims(), compiled.dims());
    assert_eq!(interpreted.params(), compiled.params());
    assert_eq!(interpreted.joints(), compiled.joints());
    assert_eq!(interpreted.identifiability(), compiled.identifiability());
    assert_eq!(interpreted.inputs(), compiled.inputs());
    let d = compiled.dims();
    let mut random = Random::new(20_260_311);
    for _ in 0..POINTS {
        let point = Point::new(compiled, &mut random);
        let at = point.at();
        let both = |f: &dyn Fn(&dyn Hessian) -> Vec<f64>| (f(&interpreted), f(compiled));
        let check = |what: &str, (found, expected): (Vec<f64>, Vec<f64>)| {
            close(&format!("{file}: {what}"), &found, &expected);
        };
        check("r", both(&|m| vector(d.nq, |out| m.residual(&at, out))));
        check(
            "M",
            both(&|m| vector(d.nm(), |out| m.mass_matrix(&at, out))),
        );
        check("b", both(&|m| vector(d.nq, |out| m.bias(&at, out))));
        check(
            "f",
            both(&|m| vector(d.nq, |out| m.applied_force(&at, out))),
        );
        check("T", both(&|m| vec![m.kinetic_energy(&at)]));
        check("U", both(&|m| vec![m.potential_energy(&at)]));
        check("J", both(&|m| jacobian(m, &at)));
        check("H", both(&|m| hessian(m, &at, &point.lambda)));
        let mut duals = vec![0.0; d.nq * d.nz()];
        generic::residual_jacobian(&interpreted, d, &at, &mut duals);
        close(
            &format!("{file}: J over dual numbers"),
            &duals,
            &jacobian(compiled, &at),
        );
    }
}

/// Four nodes at once are the four nodes, bit by bit.
#[test]
fn lanes_equal_single_nodes() {
    let model = Model::new(&declared("two_link.rs")).unwrap();
    let (d, mut random) = (model.dims(), Random::new(7));
    let mut points: Vec<Point> = (0..LANES)
        .map(|_| Point::new(&model, &mut random))
        .collect();
    let p = points[0].at().p.to_vec();
    for point in &mut points {
        point.z[d.p()..].copy_from_slice(&p);
    }
    let lanes = |f: &dyn Fn(&Point) -> Vec<f64>| -> Vec<Lane> {
        let all: Vec<Vec<f64>> = points.iter().map(f).collect();
        (0..all[0].len())
            .map(|i| std::array::from_fn(|k| all[k][i]))
            .collect()
    };
    let z = lanes(&|point| point.z.clone());
    let at = LanesAt {
        q: &z[..d.v()],
        v: &z[d.v()..d.a()],
        a: &z[d.a()..d.u()],
        u: &z[d.u()..d.p()],
        p: &p,
    };
    let lambda = lanes(&|point| point.lambda.clone());
    let zeros = |len: usize| vec![[f64::NAN; LANES]; len];
    let mut r = zeros(d.nq);

    let mut m = zeros(d.nm());
    model.mass_matrix_lanes(&at, &mut m);
    assert_eq!(
        m,
        lanes(&|x| vector(d.nm(), |m| model.mass_matrix(&x.at(), m)))
    );
    model.applied_force_lanes(&at, &mut r);
    assert_eq!(
        r,
        lanes(&|x| vector(d.nq, |f| model.applied_force(&x.at(), f)))
    );
    let mut values = zeros(model.jacobian_pattern().nnz());
    model.residual_jacobian_lanes(&at, &mut r, &mut values);
    assert_eq!(r, lanes(&|x| vector(d.nq, |r| model.residual(&x.at(), r))));
    let single = |x: &Point| {
        vector(values.len(), |out| {
            model.residual_jacobian(&x.at(), &mut vec![0.0; d.nq], out)
        })
    };
    assert_eq!(values, lanes(&single));
    model.residual_lanes(&at, &mut r);
    assert_eq!(r, lanes(&|x| vector(d.nq, |r| model.residual(&x.at(), r))));
    let mut values = zeros(model.hessian_pattern().nnz());
    model.residual_hessian_lanes(&at, &lambda, &mut values);
    let single = |x: &Point| {
        vector(values.len(), |out| {
            model.residual_hessian(&x.at(), &x.lambda, out)
        })
    };
    assert_eq!(values, lanes(&single));
}

#[test]
fn emps() {
    compare("emps.rs", &pid_models::Emps);
}

#[test]
fn double_pendulum() {
    compare("double_pendulum.rs", &pid_models::DoublePendulum);
}

#[test]
fn two_link() {
    compare("two_link.rs", &pid_models::TwoLink);
}

#[test]
fn scara() {
    compare("scara.rs", &pid_models::Scara);
}

#[test]
fn arm6() {
    compare("arm6.rs", &pid_models::Arm6);
}

#[test]
fn ur10e() {
    compare("ur10e.rs", &pid_models::Ur10e);
}

#[test]
fn panda() {
    compare("panda.rs", &pid_models::Panda);
}

#[test]
fn cart_pole() {
    compare("cart_pole.rs", &pid_models::CartPole);
}

#[test]
fn servo_pendulum() {
    compare("servo_pendulum.rs", &pid_models::ServoPendulum);
}

#[test]
fn tx40() {
    compare("tx40.rs", &pid_models::Tx40);
}

#[test]
fn vs050() {
    compare("vs050.rs", &pid_models::Vs050);
}

#[test]
fn wrong_lengths_name_the_argument() {
    let model = Model::new(&declared("emps.rs")).unwrap();
    let at = At {
        q: &[0.0],
        v: &[0.0],
        a: &[],
        u: &[0.0],
        p: &[0.0; 5],
    };
    let mut b = [0.0];
    // b does not read a.
    model.bias(&at, &mut b);
    let panicked = std::panic::catch_unwind(|| model.residual(&at, &mut [0.0])).unwrap_err();
    let message = panicked
        .downcast_ref::<String>()
        .expect("a formatted message");
    assert_eq!(
        message,
        "`a` must have 1 entries, the dimensions of the model, but has 0"
    );
}
