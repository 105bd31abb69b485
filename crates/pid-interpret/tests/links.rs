//! Mass matrix and bias with changeable constants against the emitted functions of every model of
//! this workspace.

use pid_interpret::Links;
use pid_interpret::links::{At, Constant};
use pid_interpret::nominal::declaration;
use pid_runtime::dynamics;

#[test]
fn programs_with_constants_are_the_equations_of_every_model() {
    for entry in pid_models::all() {
        let model = pid_models::by_name(entry.name).unwrap();
        let robot = declaration(model).unwrap();
        let links = Links::new(&robot, None);
        let n = links.nq();
        let p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
        let constants = links.constants(&p);
        let mut work = links.prepare(&p, &constants);
        for point in 0..3 {
            let wave = |k: usize, w: f64| (w * (k + 3 * point + 1) as f64).sin();
            let q: Vec<f64> = (0..n).map(|k| wave(k, 1.3)).collect();
            let v: Vec<f64> = (0..n).map(|k| 2.0 * wave(k, 0.7)).collect();
            let mut bias = vec![0.0; n];
            let at = At {
                q: &q,
                v: &v,
                force: None,
            };
            links.evaluate(&mut work, &at, f64::sin_cos, &mut bias);
            let mut mass = work.mass().to_vec();
            for j in 0..n {
                let rotor = links.place(Constant::Rotor(j)).unwrap();
                mass[j * (j + 1) / 2 + j] += constants[rotor];
            }
            let (mut m, mut b) = (vec![0.0; mass.len()], vec![0.0; n]);
            let at = dynamics::At {
                q: &q,
                v: &v,
                a: &vec![0.0; n],
                u: &vec![0.0; robot.inputs.len()],
                p: &p,
            };
            model.mass_matrix(&at, &mut m);
            model.bias(&at, &mut b);
            for (found, expected) in [(&mass, &m), (&bias, &b)] {
                let scale = expected.iter().fold(1e-3_f64, |s, x| s.max(x.abs()));
                for (x, y) in found.iter().zip(expected) {
                    let off = (x - y).abs() / scale;
                    assert!(off < 1e-12, "{}: {x} against {y}", entry.name);
                }
            }
        }
    }
}
