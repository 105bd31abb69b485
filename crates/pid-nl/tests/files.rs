//! Whole files: problems with known optima, answers, and files that are refused.

use pid_nl::{NlError, Problem, answer};
use pid_nlp::Nlp;
use pid_nlp::solver::{Settings, minimise};
use proptest::prelude::*;

/// Problem 71 of Hock and Schittkowski: least x₁ x₄ (x₁ + x₂ + x₃) + x₃ with x₁ x₂ x₃ x₄ ≥ 25,
/// Σ x² = 40 and 1 ≤ x ≤ 5.
const HS71: &str = "g3 0 1 0	# problem 71
 4 2 1 0 1	# vars, constraints, objectives, ranges, eqns
 2 1
 0 0
 4 4 4
 0 0 0 1
 0 0 0 0 0
 8 4
 0 0
 0 0 0 0 0
C0	# product
o2
o2
v0
v1
o2
v2
v3
C1
o54
4
o5
v0
n2
o5
v1
n2
o5
v2
n2
o5
v3
n2
O0 0
o2
o2
v0
v3
o54
3
v0
v1
v2
d1
0 0.5
x4
0 1
1 5
2 5
3 1
S0 1 mark
0 1
r
2 25
4 40
b
0 1 5
0 1 5
0 1 5
0 1 5
k3
2
4
6
J0 4
0 0
1 0
2 0
3 0
J1 4
0 0
1 0
2 0
3 0
G0 4
0 0
1 0
2 1
3 0
";

fn read(text: &str) -> Result<Problem, NlError> {
    Problem::parse("model.nl", text)
}

#[test]
fn problem_71_ends_at_the_published_optimum() {
    let mut problem = read(HS71).expect("the text can be read");
    assert_eq!(problem.start(), [1.0, 5.0, 5.0, 1.0]);
    let start = problem.start().to_vec();
    let found = minimise(&mut problem, &start, &Settings::default());
    assert!(found.status.converged());
    assert!(
        (found.objective - 17.014_017_3).abs() < 1e-6,
        "{}",
        found.objective
    );
    let expected = [1.0, 4.742_999_4, 3.821_150_3, 1.379_408_2];
    assert!(
        found
            .x
            .iter()
            .zip(expected)
            .all(|(x, e)| (x - e).abs() < 1e-5),
        "{:?}",
        found.x
    );
}

/// `bound` ≤ x y, with the least x² + y² = 2 `bound`: its slope by the bound is 2.
fn hyperbola(bound: f64, sense: u8, sign: &str) -> String {
    format!(
        "g3 0 1 0\n 2 1 1 0 0\n 1 1\n 0 0\n 2 2 2\n 0 0 0 1\n 0 0 0 0 0\n 2 0\n 0 0\n 0 0 0 0 0\n\
         C0\no2\nv0\nv1\nO0 {sense}\n{sign}o0\no2\nv0\nv0\no2\nv1\nv1\nx2\n0 3.0\n1 0.5\nr\n2 {bound}\nb\n3\n3\nJ0 2\n0 0\n1 0\n"
    )
}

#[test]
fn an_answer_holds_slopes_by_the_bounds_for_both_senses() {
    for (sense, sign, slope) in [(0, "", 2.0), (1, "o16\n", -2.0)] {
        let mut problem = read(&hyperbola(1.0, sense, sign)).expect("the text can be read");
        let found = minimise(&mut problem, &[3.0, 0.5], &Settings::default());
        let text = answer(&problem, &found);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[1..10],
            ["", "Options", "3", "0", "1", "0", "1", "1", "2"]
        );
        let numbers: Vec<f64> = lines[11..14]
            .iter()
            .map(|l| l.parse().expect("a number"))
            .collect();
        assert!((numbers[0] - slope).abs() < 1e-6, "{text}");
        assert!(
            (numbers[1] - 1.0).abs() < 1e-6 && (numbers[2] - 1.0).abs() < 1e-6,
            "{text}"
        );
        assert_eq!(lines[14..], ["objno 0 0"]);
        // The slope as the difference of two optima.
        let mut other = read(&hyperbola(1.001, sense, sign)).expect("the text can be read");
        let moved = minimise(&mut other, &[3.0, 0.5], &Settings::default());
        let outside = if sense == 0 { 1.0 } else { -1.0 };
        let difference = outside * (moved.objective - found.objective) / 0.001;
        assert!(
            (difference - slope).abs() < 1e-3,
            "{difference} for {slope}"
        );
    }
}

#[test]
fn refusals_name_the_line_and_the_mend() {
    let message = |text: &str| read(text).expect_err("it is refused").to_string();
    let changed = |from: &str, to: &str| {
        assert!(HS71.contains(from), "{from}");
        message(&HS71.replacen(from, to, 1))
    };
    for (found, says) in [
        (message("b3 0 1 0\n"), "ampl -og"),
        (message("hello"), "begins with \"hello\""),
        (
            changed(" 0 0 0 0 0\n 8 4", " 0 2 0 0 0\n 8 4"),
            "model.nl:7: a whole or binary variable",
        ),
        (changed("o54\n4", "o35\n4"), "model.nl:20: `if` (o35)"),
        (
            changed("v3\nC1", "v4\nC1"),
            "model.nl:18: a variable is \"4\"\n  help: write a number below 4",
        ),
        (changed("2 25", "5 1 1"), "a complementarity"),
        (changed("2 25", "0 3 2"), "write the lower bound first"),
        (changed("n2", "ninf"), "a number is \"inf\""),
        (
            changed("o54\n4", "o54\n4000"),
            "the number of operands is \"4000\"",
        ),
        (
            changed(" 4 2 1 0 1", " 4000000 2 1 0 1"),
            "the number of variables is \"4000000\"",
        ),
        (
            changed("J0 4", "Q0 4"),
            "the beginning of a part is \"Q0 4\"",
        ),
        (changed("J0 4", "J2 4"), "a constraint is \"2\""),
    ] {
        assert!(
            found.contains(says) && found.contains("\n  help: "),
            "{found}\nlacks {says}"
        );
    }
}

#[test]
fn a_file_that_is_cut_is_refused() {
    let lines: Vec<&str> = HS71.lines().collect();
    for length in 0..lines.len() {
        assert!(
            read(&lines[..length].join("\n")).is_err(),
            "after {length} lines"
        );
    }
}

#[test]
fn nesting_as_deep_as_the_file_is_long_is_read() {
    let depth = 20_000;
    let text = hyperbola(1.0, 0, &"o41\n".repeat(depth));
    let mut problem = read(&text).expect("the text can be read");
    assert!(problem.objective(&[0.3, 0.4]).is_finite());
}

proptest! {
    #[test]
    fn changed_bytes_are_read_or_refused(changes in prop::collection::vec((0..HS71.len(), any::<u8>()), 1..6)) {
        let mut bytes = HS71.as_bytes().to_vec();
        for (place, byte) in changes {
            bytes[place] = byte;
        }
        let _ = read(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn changed_words_are_read_or_refused(
        line in 0..100_usize,
        word in prop::sample::select(vec!["o54", "99999999999", "-1", "v3", "n1e400", "J0 4", "x4", "r", "g0", "o11", "0"]),
    ) {
        let mut lines: Vec<&str> = HS71.lines().collect();
        let place = line % lines.len();
        lines[place] = word;
        let _ = read(&lines.join("\n"));
    }
}
