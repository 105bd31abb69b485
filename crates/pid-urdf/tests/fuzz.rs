//! The short version of `cargo run --release -p pid-urdf --example fuzz_urdf`.

mod common;

use common::{Outcome, exercise, mutated};
use pid_symbolic::random::Random;

#[test]
fn mutated_descriptions_are_read_or_refused() {
    let mut random = Random::new(1);
    let mut counts = [0; 3];
    for _ in 0..5_000 {
        let text = mutated(&mut random);
        counts[exercise(&text) as usize] += 1;
    }
    // All three ends are reached, so the mutations reach past the parser of XML.
    for outcome in [Outcome::NoXml, Outcome::Refused, Outcome::Robot] {
        assert!(counts[outcome as usize] > 100, "{outcome:?}: {counts:?}");
    }
}
