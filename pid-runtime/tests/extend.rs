//! Terms against differences, against the declared model, and mistakes.

use pid_models::{CartPole, DoublePendulum, Emps, TwoLink};
use pid_runtime::dynamics::*;
use pid_runtime::extend::*;
use pid_runtime::term::{LAWS, Place, Request};

fn everything(model: &dyn Hessian) -> Vec<Request> {
    let mut requests: Vec<Request> = LAWS
        .into_iter()
        .map(|law| Request {
            law,
            place: Place::EveryJoint,
        })
        .collect();
    if let [a, b, ..] = model.joints() {
        requests.extend(
            ["armature", "coulomb", "stribeck"]
                .map(|law| format!("{law}:{}+{}", a.name, b.name).parse().unwrap()),
        );
    }
    // Terms that a model has by itself are refused; the rest are all there.
    requests.retain(|r| Extended::new(model, std::slice::from_ref(r)).is_ok());
    assert!(requests.len() >= 7);
    requests
}

/// A point away from zero, different in every entry.
fn point(model: &dyn Hessian, shift: f64) -> Vec<f64> {
    let dims = model.dims();
    (0..dims.nz())
        .map(|k| {
            let wave = (1.7 * k as f64 + shift).sin();
            match k.checked_sub(dims.p()) {
                Some(j) => {
                    let info = &model.params()[j];
                    info.nominal + 0.3 * (1.0 + wave) * info.nominal.abs().max(0.05)
                }
                None => 0.6 * wave,
            }
        })
        .collect()
}

fn at<'a>(z: &'a [f64], dims: &Dims) -> At<'a> {
    At {
        q: &z[..dims.v()],
        v: &z[dims.v()..dims.a()],
        a: &z[dims.a()..dims.u()],
        u: &z[dims.u()..dims.p()],
        p: &z[dims.p()..],
    }
}

#[test]
fn derivatives_are_those_of_differences() {
    for inner in [&TwoLink as &dyn Hessian, &DoublePendulum, &Emps] {
        let model = Extended::new(inner, &everything(inner)).unwrap();
        let dims = model.dims();
        let z = point(&model, 0.3);
        let lambda: Vec<f64> = (0..dims.nq).map(|j| 0.7 - 0.4 * j as f64).collect();
        let gradient = |z: &[f64]| {
            let (mut r, mut j) = (
                vec![0.0; dims.nq],
                vec![0.0; model.jacobian_pattern().nnz()],
            );
            model.residual_jacobian(&at(z, &dims), &mut r, &mut j);
            let mut dense = vec![0.0; dims.nq * dims.nz()];
            let pattern = model.jacobian_pattern();
            for ((&row, &col), v) in pattern.rows.iter().zip(pattern.cols).zip(&j) {
                dense[row as usize * dims.nz() + col as usize] += v;
            }
            (r, dense)
        };
        let weighted = |z: &[f64]| -> Vec<f64> {
            let (_, dense) = gradient(z);
            (0..dims.nz())
                .map(|k| {
                    (0..dims.nq)
                        .map(|j| lambda[j] * dense[j * dims.nz() + k])
                        .sum()
                })
                .collect()
        };
        let mut hessian = vec![0.0; model.hessian_pattern().nnz()];
        model.residual_hessian(&at(&z, &dims), &lambda, &mut hessian);
        let mut full = vec![0.0; dims.nz() * dims.nz()];
        let pattern = model.hessian_pattern();
        for ((&row, &col), v) in pattern.rows.iter().zip(pattern.cols).zip(&hessian) {
            assert!(row >= col);
            full[row as usize * dims.nz() + col as usize] += v;
            if row != col {
                full[col as usize * dims.nz() + row as usize] += v;
            }
        }
        let (r, dense) = gradient(&z);
        let mut plain = vec![0.0; dims.nq];
        model.residual(&at(&z, &dims), &mut plain);
        for k in 0..dims.nz() {
            let h = 1e-6 * z[k].abs().max(0.1);
            let moved = |d: f64| {
                let mut y = z.clone();
                y[k] += d;
                y
            };
            let (up, down) = (moved(h), moved(-h));
            for j in 0..dims.nq {
                assert!((r[j] - plain[j]).abs() < 1e-12 * (1.0 + r[j].abs()));
                let difference = (gradient(&up).0[j] - gradient(&down).0[j]) / (2.0 * h);
                let exact = dense[j * dims.nz() + k];
                assert!(
                    (difference - exact).abs() < 1e-5 * (1.0 + exact.abs()),
                    "{} {j} {k}: {difference} {exact}",
                    model.name()
                );
            }
            for (m, (a, b)) in weighted(&up).iter().zip(weighted(&down)).enumerate() {
                let difference = (a - b) / (2.0 * h);
                let exact = full[m * dims.nz() + k];
                assert!(
                    (difference - exact).abs() < 1e-4 * (1.0 + exact.abs()),
                    "{} {m} {k}: {difference} {exact}",
                    model.name()
                );
            }
        }
    }
}

#[test]
fn the_parts_make_the_residual() {
    let model = Extended::new(&TwoLink, &everything(&TwoLink)).unwrap();
    let dims = model.dims();
    let z = point(&model, 1.1);
    let at = at(&z, &dims);
    let (mut m, mut b, mut f, mut r) = (
        vec![0.0; dims.nm()],
        vec![0.0; 2],
        vec![0.0; 2],
        vec![0.0; 2],
    );
    model.mass_matrix(&at, &mut m);
    model.bias(&at, &mut b);
    model.applied_force(&at, &mut f);
    model.residual(&at, &mut r);
    let full = [
        m[0] * at.a[0] + m[1] * at.a[1],
        m[1] * at.a[0] + m[2] * at.a[1],
    ];
    let energy = 0.5
        * (m[0] * at.v[0] * at.v[0] + 2.0 * m[1] * at.v[0] * at.v[1] + m[2] * at.v[1] * at.v[1]);
    for j in 0..2 {
        assert!((full[j] + b[j] - f[j] - r[j]).abs() < 1e-10 * (1.0 + r[j].abs()));
    }
    assert!((model.kinetic_energy(&at) - energy).abs() < 1e-10 * energy.abs());
}

#[test]
fn mistakes_name_term_and_joint() {
    let error = |t: &str| {
        Extended::new(&Emps, &[t.parse().unwrap()])
            .err()
            .unwrap()
            .to_string()
    };
    assert!(error("load:elbow").contains("no joint `elbow`; its joints are x"));
    let twice = ["offset".parse().unwrap(), "offset:x".parse().unwrap()];
    let message = Extended::new(&Emps, &twice).err().unwrap().to_string();
    assert!(message.contains("`offset_x` already"), "{message}");
    // The pole has no drive: friction with a memory takes one state more at each.
    let memory = Extended::new(&CartPole, &["presliding".parse().unwrap()]);
    let message = memory.err().unwrap().to_string();
    assert!(message.contains("1 inputs for 2 joints"), "{message}");
}
