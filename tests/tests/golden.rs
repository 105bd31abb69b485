//! Inverse and forward dynamics of the arms against Pinocchio, which was given the published tables
//! and not our declarations. The files are made by `tests/golden/make_goldens.py`.

use std::collections::BTreeMap;

use pid_fit::transcribe::ExplicitForm;
use pid_models::{Arm6, Panda, Scara, Ur10e};
use pid_runtime::dynamics::{At, Dynamics, Hessian};
use pid_runtime::generic::GenericDynamics;
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    params: BTreeMap<String, f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    tau: Vec<f64>,
    inverse: Vec<f64>,
    forward: Vec<f64>,
}

fn goldens(text: &str) -> Vec<Golden> {
    let points: Vec<Golden> = serde_json::from_str(text).unwrap();
    assert_eq!(points.len(), 12);
    points
}

/// Parameters by name; gains are one, everything else that is not named is zero.
fn params(model: &dyn Dynamics, named: &BTreeMap<String, f64>) -> Vec<f64> {
    for name in named.keys() {
        assert!(
            model.params().iter().any(|p| p.name == *name),
            "{} has no parameter {name}",
            model.name()
        );
    }
    let value = |name: &str| match name.starts_with("gain") {
        true => 1.0,
        false => named.get(name).copied().unwrap_or(0.0),
    };
    model.params().iter().map(|p| value(&p.name)).collect()
}

fn assert_close(what: &str, found: &[f64], expected: &[f64]) {
    let scale = expected.iter().fold(1.0, |m: f64, x| m.max(x.abs()));
    for (i, (x, y)) in found.iter().zip(expected).enumerate() {
        assert!(
            (x - y).abs() <= 1e-10 * scale,
            "{what}[{i}]: {x} and by Pinocchio {y}"
        );
    }
}

fn check<M: Hessian + GenericDynamics>(model: &M, text: &str) {
    let (n, nu) = (model.dims().nq, model.dims().nu);
    assert_eq!(n, nu);
    let explicit = ExplicitForm::new(model);
    for (k, golden) in goldens(text).iter().enumerate() {
        let p = params(model, &golden.params);
        let at = At {
            q: &golden.q,
            v: &golden.v,
            a: &golden.a,
            u: &vec![0.0; nu],
            p: &p,
        };
        let mut out = vec![f64::NAN; n];
        let name = model.name();
        model.residual(&at, &mut out);
        assert_close(&format!("{name} {k}: inverse"), &out, &golden.inverse);

        // Inputs are in the order of declaration, one per joint.
        let joints = model.inputs().iter().map(|input| input.joint.unwrap());
        let u: Vec<f64> = joints.map(|j| golden.tau[j]).collect();
        let driven = At { u: &u, ..at };
        explicit.applied_force(&driven, &mut out);
        assert_close(&format!("{name} {k}: forward"), &out, &golden.forward);
        out.fill(f64::NAN);
        model
            .vector_field_generic(&golden.q, &golden.v, &u, &p, &mut out)
            .unwrap();
        assert_close(
            &format!("{name} {k}: forward, generic"),
            &out,
            &golden.forward,
        );
    }
}

const ARM6: &str = include_str!("../golden/arm6.json");
const UR10E: &str = include_str!("../golden/ur10e.json");
const PANDA: &str = include_str!("../golden/panda.json");
const SCARA: &str = include_str!("../golden/scara.json");

#[test]
fn arm6_equals_pinocchio() {
    check(&Arm6, ARM6);
}

#[test]
fn ur10e_equals_pinocchio() {
    check(&Ur10e, UR10E);
}

#[test]
fn panda_equals_pinocchio() {
    check(&Panda, PANDA);
}

#[test]
fn scara_equals_pinocchio() {
    check(&Scara, SCARA);
}

/// The first point of each file has the published values, brought into the frames of the joints by Pinocchio.
#[test]
fn nominal_inertias_are_the_published_ones() {
    let cases: [(&dyn Dynamics, &str); 4] = [
        (&Arm6, ARM6),
        (&Ur10e, UR10E),
        (&Panda, PANDA),
        (&Scara, SCARA),
    ];
    for (model, text) in cases {
        let published = &goldens(text)[0].params;
        for p in model.params() {
            if let Some(x) = published.get(p.name.as_ref()) {
                assert!(
                    (p.nominal - x).abs() < 1e-14,
                    "{} {}: {} for {x}",
                    model.name(),
                    p.name,
                    p.nominal
                );
            }
        }
    }
}
