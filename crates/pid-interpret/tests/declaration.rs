//! Robots written as declarations and read again: the same equations.

use pid_codegen::show::{Unsaid, declaration};
use pid_derive::model::{Expr, Robot};
use pid_interpret::Model;
use pid_interpret::nominal::{self, Nominal};
use pid_runtime::dynamics::{At, Dynamics};

fn read(text: &str) -> Robot {
    let robots = pid_codegen::robots(text.parse().expect(text));
    robots
        .unwrap_or_else(|mistakes| panic!("{mistakes:#?}\n{text}"))
        .swap_remove(0)
}

/// Largest difference of the residuals over their size at points drawn for both; parameters and
/// inputs are matched by name, those that one does not have are left at their nominal values.
fn difference(a: &Robot, b: &Robot) -> f64 {
    let (x, y) = (Model::new(a), Model::new(b));
    let (x, y) = (x.expect("equations"), y.expect("equations"));
    let (dims, other) = (x.dims(), y.dims());
    assert_eq!((dims.nq, dims.nu), (other.nq, other.nu));
    let mut worst = 0.0_f64;
    for point in 0..20 {
        let wave = |k: usize| (0.3 + 1.7 * k as f64 + 0.61 * f64::from(point)).sin();
        let row = |from: usize, n: usize, size: f64| -> Vec<f64> {
            (0..n).map(|k| size * wave(from + k)).collect()
        };
        let (q, v) = (row(0, dims.nq, 1.2), row(20, dims.nq, 1.5));
        let (acc, u) = (row(40, dims.nq, 3.0), row(60, dims.nu, 2.0));
        let own: Vec<f64> = (x.params().iter().enumerate())
            .map(|(k, p)| p.nominal * (1.0 + 0.1 * wave(80 + k)))
            .collect();
        let theirs: Vec<f64> = (y.params().iter())
            .map(|p| {
                let place = x.params().iter().position(|o| o.name == p.name);
                own[place.unwrap_or_else(|| panic!("{}", p.name))]
            })
            .collect();
        let inputs: Vec<f64> = (y.inputs().iter())
            .map(|i| {
                let place = x.inputs().iter().position(|o| o.name == i.name);
                u[place.unwrap_or_else(|| panic!("{}", i.name))]
            })
            .collect();
        let residual = |model: &Model, u: &[f64], p: &[f64]| {
            let mut r = vec![0.0; dims.nq];
            let (q, v, a) = (&*q, &*v, &*acc);
            model.residual(&At { q, v, a, u, p }, &mut r);
            r
        };
        let (r, s) = (residual(&x, &u, &own), residual(&y, &inputs, &theirs));
        let size = r.iter().fold(1e-3_f64, |m, x| m.max(x.abs()));
        for (r, s) in r.iter().zip(&s) {
            worst = worst.max((r - s).abs() / size);
        }
    }
    worst
}

#[test]
fn every_model_is_written_and_read_again() {
    for entry in pid_models::all() {
        let robot = nominal::declaration(entry.model).expect(entry.name);
        let text = declaration(&robot, "").expect(entry.name);
        let again = read(&text);
        let off = difference(&robot, &again);
        // Sums of several laws are put together in another order.
        assert!(off < 1e-12, "{}: {off:.1e}\n{text}", entry.name);
        let inputs = |robot: &Robot| -> Vec<(String, String, Option<usize>)> {
            let all = robot.inputs.iter();
            all.map(|u| (u.name.clone(), u.unit.clone(), u.coord))
                .collect()
        };
        assert_eq!(inputs(&robot), inputs(&again), "{}\n{text}", entry.name);
        // What was read is written as it was.
        let twice = declaration(&again, "").expect(entry.name);
        assert_eq!(read(&twice), again, "{}", entry.name);
    }
}

#[test]
fn a_description_is_a_declaration_with_its_numbers() {
    let arm = include_str!("../../pid-effects/src/with_effects/arm.toml");
    let nominal = Nominal::parse("arm.toml", arm).expect("a robot");
    let text = declaration(nominal.robot(), "").expect("a declaration");
    let again = read(&text);
    let off = difference(nominal.robot(), &again);
    assert!(off < 1e-12, "{off:.1e}\n{text}");
    // Of a planar arm the moments about other axes than that of the hinges do not enter.
    assert!(
        text.contains("diag(_, iyy_shoulder, _)") || text.contains("xx: _, yy: iyy_shoulder"),
        "{text}"
    );
    for p in &again.params {
        let own = nominal.robot().params.iter().find(|o| o.name == p.name);
        let own = own.expect("a parameter of the description");
        assert_eq!(
            (p.nominal, p.fixed, &p.unit),
            (own.nominal, own.fixed, &own.unit)
        );
        assert!(
            p.fixed || (p.lower, p.upper) == (own.lower, own.upper),
            "{p:?} {own:?}"
        );
    }
}

#[test]
fn what_the_language_lacks_is_named() {
    let arm = include_str!("../../pid-effects/src/with_effects/arm.toml");
    let nominal = Nominal::parse("arm.toml", arm).expect("a robot");
    let refused = |change: &dyn Fn(&mut Robot)| {
        let mut robot = nominal.robot().clone();
        change(&mut robot);
        declaration(&robot, "").expect_err("refused")
    };
    let name = refused(&|robot| robot.joints[0].name = "joint-1".to_owned());
    assert_eq!(
        name,
        Unsaid::Name {
            name: "joint-1".to_owned()
        }
    );
    let unit = refused(&|robot| robot.params[0].unit = "lb".to_owned());
    assert!(unit.to_string().contains("`lb`"), "{unit}");
    let number = refused(&|robot| {
        // A square root of a force has no unit in the language.
        let root = Expr::Powi(Box::new(Expr::Num(2.0)), 7);
        robot.joints[0].force = Some(root);
    });
    assert!(
        number.to_string().contains("a force on `shoulder`"),
        "{number}"
    );
}
