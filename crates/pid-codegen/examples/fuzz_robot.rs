//! Feeds declarations that nobody would write to `robot!`: no panic, no hang, and every refusal
//! gives its reason.
//!
//! `cargo run --release -p pid-codegen --example fuzz_robot -- [inputs] [seed] [first]`, a million
//! inputs with seed 0 by default, from the input number `first` on. Prints how many were refused by
//! the grammar, by a check, and expanded, and the slowest input. A panic prints the number of its
//! input. Every input is parsed and checked, one in 16 expanded to code as well.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "its result is what it prints"
)]

#[path = "../tests/fuzzing/mod.rs"]
mod fuzzing;
#[path = "../tests/fuzzing/grammar.rs"]
mod grammar;

use std::time::{Duration, Instant};

use fuzzing::{exercise, input};
use pid_symbolic::random::Random;

/// After so many inputs the places of tokens are forgotten; otherwise the thread keeps them all.
const FORGET: u64 = 1000;

/// One input in so many is expanded to code as well. That costs several times as much as parsing
/// and checking it.
const WHOLE: u64 = 16;

/// Says which input a panic belongs to.
struct Named(u64);

impl Drop for Named {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("input {}", self.0);
        }
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u64| match arguments.next() {
        None => default,
        Some(text) => text.parse().unwrap_or_else(|e| panic!("`{text}`: {e}")),
    };
    let (inputs, seed, first) = (number(1_000_000), number(0), number(0));
    let started = Instant::now();
    let mut counts = [0_u64; 3];
    let mut slowest = (Duration::ZERO, 0);
    for number in first..first + inputs {
        if number % FORGET == 0 {
            proc_macro2::extra::invalidate_current_thread_spans();
        }
        // A seed of its own for each input: any of them can be looked at alone.
        let mut random = Random::new(
            seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .wrapping_add(number),
        );
        let _named = Named(number);
        let tokens = input(&mut random);
        if inputs == 1 {
            println!("{tokens}");
        }
        let begun = Instant::now();
        counts[exercise(&tokens, number % WHOLE == 0) as usize] += 1;
        let took = begun.elapsed();
        if took > slowest.0 {
            slowest = (took, number);
        }
    }
    let [syntax, refused, robots] = counts;
    println!(
        "{inputs} inputs in {:.0} s, no panic: {syntax} refused by the grammar, {refused} by a check, {robots} expanded; \
         slowest: input {} in {:.1} ms",
        started.elapsed().as_secs_f64(),
        slowest.1,
        1e3 * slowest.0.as_secs_f64(),
    );
}
