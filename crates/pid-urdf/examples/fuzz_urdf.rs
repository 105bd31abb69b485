//! Feeds mutated robot descriptions to the reader: no panic, no hang.
//!
//! `cargo run --release -p pid-urdf --example fuzz_urdf -- [inputs] [seed]`, a million inputs with
//! seed 0 by default. Prints how many were no XML, refused, and read (made a robot, written back
//! and read again), and the slowest input. A panic prints the number of its input.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "its result is what it prints"
)]

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::{Duration, Instant};

use common::{exercise, mutated};
use pid_symbolic::random::Random;

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
    let (inputs, seed) = (number(1_000_000), number(0));
    let started = Instant::now();
    let mut counts = [0_u64; 3];
    let mut slowest = (Duration::ZERO, 0);
    for input in 0..inputs {
        // A seed of its own for each input: any of them can be looked at alone.
        let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(input));
        let text = mutated(&mut random);
        let _named = Named(input);
        let begun = Instant::now();
        counts[exercise(&text) as usize] += 1;
        let took = begun.elapsed();
        if took > slowest.0 {
            slowest = (took, input);
        }
    }
    let [no_xml, refused, robots] = counts;
    println!(
        "{inputs} inputs in {:.0} s, no panic: {no_xml} no XML, {refused} refused, {robots} read, written and read again; \
         slowest: input {} in {:.1} ms",
        started.elapsed().as_secs_f64(),
        slowest.1,
        1e3 * slowest.0.as_secs_f64(),
    );
}
