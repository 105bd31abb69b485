//! The short version of `cargo run --release -p pid-codegen --example fuzz_robot`.

mod fuzzing;
#[path = "fuzzing/grammar.rs"]
mod grammar;

use fuzzing::{Outcome, exercise, input};
use pid_symbolic::random::Random;

#[test]
fn declarations_are_expanded_or_refused() {
    let mut random = Random::new(1);
    let mut counts = [0; 3];
    for k in 0..2_000 {
        let tokens = input(&mut random);
        counts[exercise(&tokens, k % 4 == 0) as usize] += 1;
    }
    // All three ends are reached, so the inputs reach past the grammar and past the checks.
    for outcome in [Outcome::Syntax, Outcome::Refused, Outcome::Robot] {
        assert!(counts[outcome as usize] > 100, "{outcome:?}: {counts:?}");
    }
}
