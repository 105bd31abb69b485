//! Values and derivatives of every operation against the same functions on hyper-dual numbers.

use num_dual::{DualNum, HyperDual64};
use pid_nl::Problem;
use pid_nlp::Nlp;
use proptest::prelude::*;

/// A function of the two variables, in the file's form and in Rust.
struct Case {
    text: &'static str,
    function: fn(HyperDual64, HyperDual64) -> HyperDual64,
}

const fn case(text: &'static str, function: fn(HyperDual64, HyperDual64) -> HyperDual64) -> Case {
    Case { text, function }
}

/// `v2` is the defined variable 3 x + x y.
const CASES: [Case; 33] = [
    case("o0 v0 v1", |x, y| x + y),
    case("o1 o2 v0 v0 v1", |x, y| x * x - y),
    case("o2 v0 o2 v1 v1", |x, y| x * y * y),
    case("o3 v0 v1", |x, y| x / y),
    case("o5 v0 n3", |x, _| x.powi(3)),
    case("o5 v0 n-2", |x, _| x.powi(-2)),
    case("o5 v0 n0.5", |x, _| x.sqrt()),
    case("o5 v0 n2.5", |x, _| x.powf(2.5)),
    case("o5 v0 n-1.5", |x, _| x.powf(-1.5)),
    case("o5 v0 n1.37", |x, _| x.powf(1.37)),
    case("o5 v0 v1", |x, y| (y * x.ln()).exp()),
    case("o5 n2.2 v1", |_, y| (y * 2.2_f64.ln()).exp()),
    // Both arguments are below 1: the part above zero of x + 1 − y is all, that of y − 2 − x nothing.
    case("o6 o0 v0 n1 v1", |x, y| x + 1.0 - y),
    case("o6 v1 o0 v0 n2", |x, _| x * 0.0),
    case("o11 3 o2 v0 v1 n4 o0 v0 n5", |x, y| x * y),
    case("o12 3 o2 v0 v1 n4 o0 v0 n5", |x, _| x + 5.0),
    case("o15 o1 v0 n3", |x, _| -(x - 3.0)),
    case("o16 o2 v0 v1", |x, y| -(x * y)),
    case("o37 o2 v0 v1", |x, y| (x * y).tanh()),
    case("o38 v0", |x, _| x.tan()),
    case("o39 o2 v0 v1", |x, y| (x * y).sqrt()),
    case("o40 o2 v0 v1", |x, y| (x * y).sinh()),
    case("o41 o2 v0 v1", |x, y| (x * y).sin()),
    case("o42 o43 o0 v0 n2", |x, _| (x + 2.0).ln().log10()),
    case("o45 o44 v1", |_, y| y.exp().cosh()),
    case("o46 o2 v0 v1", |x, y| (x * y).cos()),
    case("o47 o2 v0 v1", |x, y| (x * y).atanh()),
    case("o48 v0 o16 v1", |x, y| x.atan2(-y)),
    case("o49 o50 v0", |x, _| x.asinh().atan()),
    case("o51 o2 v0 v1", |x, y| (x * y).asin()),
    case("o52 o0 n1 v0", |x, _| (x + 1.0).acosh()),
    case("o53 v1", |_, y| y.acos()),
    case("o54 3 v0 o2 v2 v2 v1", |x, y| {
        x + (x * 3.0 + x * y).powi(2) + y
    }),
];

/// All cases as constraints, each with linear terms, and the objective −(x y) to be made large.
fn text() -> String {
    let m = CASES.len();
    let mut out = format!(
        "g3 0 1 0 # all operations\n 2 {m} 1 0 {m}\n {m} 1\n 0 0\n 2 2 2\n 0 0 0 1\n 0 0 0 0 0\n {} 0\n 0 0\n 1 0 0 0 0\n",
        2 * m
    );
    out += "V2 1 0\n0 3\no2\nv0\nv1\n";
    for (i, case) in CASES.iter().enumerate() {
        out += &format!("C{i} # a row\n{}\n", case.text.replace(' ', "\n"));
    }
    out += "O0 1\no16\no2\nv0\nv1\nr\n";
    out += &"4 0\n".repeat(m);
    out += "b\n3\n3\nk1\n1\n";
    for i in 0..m {
        out += &format!("J{i} 2\n0 {i}\n1 -0.5\n");
    }
    out
}

fn close(found: f64, expected: f64, what: &str) {
    let error = (found - expected).abs() / expected.abs().max(1.0);
    assert!(error < 1e-11, "{what}: {found} for {expected}");
}

proptest! {
    #[test]
    fn all_operations_have_the_derivatives_of_dual_numbers(x in 0.1..0.9_f64, y in 0.1..0.9_f64) {
        let mut problem = Problem::parse("all.nl", &text()).expect("the text can be read");
        let m = CASES.len();
        let at = |a: [f64; 2], b: [f64; 2]| {
            [HyperDual64::new(x, a[0], b[0], 0.0), HyperDual64::new(y, a[1], b[1], 0.0)]
        };
        let row = |i: usize, [x, y]: [HyperDual64; 2]| {
            (CASES[i].function)(x, y) + x * i as f64 - y * 0.5
        };
        let unit = [[1.0, 0.0], [0.0, 1.0]];

        let mut c = vec![0.0; m];
        problem.constraints(&[x, y], &mut c);
        let mut jacobian = vec![0.0; problem.jacobian_pattern().nnz()];
        problem.jacobian(&[x, y], &mut jacobian);
        let mut dense = vec![[0.0; 2]; m];
        let pattern = problem.jacobian_pattern();
        for ((&r, &k), &value) in pattern.rows.iter().zip(&pattern.cols).zip(&jacobian) {
            dense[r as usize][k as usize] += value;
        }
        for i in 0..m {
            close(c[i], row(i, at([0.0; 2], [0.0; 2])).re, CASES[i].text);
            for (k, e) in unit.into_iter().enumerate() {
                close(dense[i][k], row(i, at(e, e)).eps1, CASES[i].text);
            }
        }

        // Every row alone, then the objective: what is made large is −x y, so the program's is x y.
        for i in 0..=m {
            let mut lambda = vec![0.0; m];
            if i < m {
                lambda[i] = 1.5;
            }
            let sigma = f64::from(u8::from(i == m));
            let mut values = vec![0.0; problem.hessian_pattern().nnz()];
            problem.hessian(&[x, y], sigma, &lambda, &mut values);
            let mut lower = [[0.0; 2]; 2];
            let pattern = problem.hessian_pattern();
            for ((&r, &k), &value) in pattern.rows.iter().zip(&pattern.cols).zip(&values) {
                prop_assert!(k <= r);
                lower[r as usize][k as usize] += value;
            }
            for (a, b) in [(0, 0), (1, 0), (1, 1)] {
                let z = at(unit[a], unit[b]);
                let expected = if i < m { 1.5 * row(i, z).eps1eps2 } else { (z[0] * z[1]).eps1eps2 };
                close(lower[a][b], expected, CASES.get(i).map_or("objective", |case| case.text));
            }
        }
        prop_assert!(problem.maximises());
        close(problem.objective(&[x, y]), x * y, "objective");
    }
}
