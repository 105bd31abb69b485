//! What `diagnose` writes of a declared robot is a file that compiles: `declared/extended.rs` here
//! is what it writes of the description below.

use simtrue::diagnosis::declared::declared;
use simtrue::diagnosis::described::stated;
use simtrue::diagnosis::effect::Term;
use simtrue::diagnosis::effects::by_id;
use simtrue::diagnosis::with_effects::{Placed, WithEffects};
use simtrue::dynamics::{At, Dynamics};
use simtrue::interpret::Model;
use simtrue::interpret::nominal::Nominal;
use simtrue::robot;

robot! {
    /// Two links; the second motor sits on the base and turns both.
    pub robot Wrist {
        gravity: [0, 0, -9.81] m/s^2;
        params { m: kg = 0.8 in 0.78..=0.82; }
        link upper { mass: m; com: [0, 0, -0.1] m; inertia at com: diag(_, 0.006 kg*m^2, _); }
        link hand { mass: m; com: [0, 0, -0.08] m; inertia at com: diag(_, 0.004 kg*m^2, _); }
        joint bend: revolute about y { base -> upper; }
        joint tip: revolute about y { upper -> hand at [0, 0, -0.2] m; }
        per joint bend {
            input current: A;
            gain: N*m/A = 2.0 in 1.98..=2.02;
            dry: N*m = 0.1 in 0.06..=0.14;
            viscous: N*m*s/rad = 0.2 in 0.12..=0.28;
            armature = 0.01 kg*m^2;
            force = gain*current - viscous*v - dry*tanh(40 s/rad * v);
        }
        motor wrist: bend + tip {
            input current: A;
            gain: N*m/A = 1.0 in 0.99..=1.01;
            dry: N*m = 0.05 in 0.03..=0.07;
            viscous: N*m*s/rad = 0.1 in 0.06..=0.14;
            armature = 0.005 kg*m^2;
            force = gain*current - viscous*v - dry*tanh(40 s/rad * v);
        }
        emit { first_derivatives, second_derivatives }
    }
}

mod written {
    include!("declared/extended.rs");
}

/// The wrist with a spring and Stribeck friction at its motor, and a gear that gives.
fn description() -> Nominal {
    let nominal = Nominal::of_declared(&Wrist, None).expect("a description");
    let effects = [
        ("spring", &[0.5, -0.2][..]),
        ("stribeck", &[0.4, 0.3]),
        ("joint_elasticity", &[0.01, 0.002]),
    ];
    let effects = effects.map(|(id, e)| {
        let effect = by_id(id).expect(id);
        let intervals = vec![None; e.len()];
        stated(&nominal, &Term { effect, joint: 1 }, e, &intervals)
    });
    let values: Vec<f64> = nominal.tolerances().iter().map(|t| t.nominal).collect();
    nominal.extended(&values, effects.to_vec(), None)
}

/// A text without its decimal numbers, and these.
fn apart(text: &str) -> (String, Vec<f64>) {
    let words = text.split_inclusive(|c: char| !(c.is_ascii_digit() || c == '.'));
    let (mut rest, mut numbers) = (String::new(), Vec::new());
    for word in words {
        // The dots of a range behind a number are not its own.
        let end = word.trim_end_matches(|c: char| !c.is_ascii_digit());
        match end.parse::<f64>() {
            Ok(x) if end.contains('.') => {
                numbers.push(x);
                rest.push_str(&word[end.len()..]);
            }
            _ => rest.push_str(word),
        }
    }
    (rest, numbers)
}

#[test]
fn the_file_that_compiles_is_the_one_that_is_written() {
    let text = declared(&Wrist, &description()).expect("a declaration");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/declared/extended.rs");
    let kept = std::fs::read_to_string(path).expect(path);
    let (own, theirs) = (apart(&text), apart(&kept));
    assert_eq!(
        own.0, theirs.0,
        "{path} is not what is written now:\n{text}"
    );
    for (x, y) in own.1.iter().zip(&theirs.1) {
        // Friction is read off values of tanh, which differ between machines in the last digit.
        assert!((x - y).abs() < 1e-8 * (1.0 + y.abs()), "{x} {y}\n{text}");
    }
    assert!(
        text.starts_with("// Not in it, as it is no force law: `joint_elasticity` of `wrist`"),
        "{text}"
    );
}

#[test]
fn what_was_compiled_moves_as_the_description_with_its_effects() {
    let extended = description();
    let mut placed = Placed::of(&extended).expect("effects");
    placed.retain(|own| own.term.effect.info().id != "joint_elasticity");
    let inner = Model::new(extended.robot()).expect("equations");
    let with = WithEffects::new(Box::new(inner), &placed).expect("effects");
    let nominal =
        |model: &dyn Dynamics| -> Vec<f64> { model.params().iter().map(|p| p.nominal).collect() };
    let (own, theirs) = (nominal(&written::WristExtended), nominal(&with));
    for point in 0..20 {
        let wave = |k: u32| (0.4 + 1.3 * f64::from(k) + 0.7 * f64::from(point)).sin();
        let ([q, v], a, u) = (
            [0, 2].map(|k| [wave(k), wave(k + 1)]),
            [3.0, -2.0],
            [0.6, 0.3],
        );
        let residual = |model: &dyn Dynamics, q: &[f64], v: &[f64], a: &[f64], p: &[f64]| {
            let mut r = [0.0; 2];
            model.residual(&At { q, v, a, u: &u, p }, &mut r);
            r
        };
        let r = residual(&written::WristExtended, &q, &v, &a, &own);
        // The description turns with its motors: the second by the sum of both joints.
        let turned = |x: [f64; 2]| [x[0], x[0] + x[1]];
        let s = residual(&with, &turned(q), &turned(v), &turned(a), &theirs);
        let s = [s[0] + s[1], s[1]];
        let off = (r[0] - s[0]).abs().max((r[1] - s[1]).abs());
        assert!(off < 1e-12, "{r:?} {s:?}");
    }
}
