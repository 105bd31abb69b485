//! Cost of the macro: processor seconds of expansion, statements and bytes of its output, for files
//! that contain `robot! { … }`.
//!
//! ```text
//! cargo run --release -p pid-codegen --bin macro_seconds -- models/src/*.rs
//! ```
//! To measure it as a debug build has it (cargo builds macros without optimisation unless told
//! otherwise):
//! ```text
//! cargo run -p pid-codegen --bin macro_seconds --target-dir target/debug_macro \
//!     --config 'profile.dev.package."*".opt-level=0' --config 'profile.dev.package.pid-symbolic.opt-level=0' \
//!     --config 'profile.dev.package.pid-derive.opt-level=0' --config 'profile.dev.package.pid-codegen.opt-level=0' \
//!     -- models/src/*.rs
//! ```

use std::time::Instant;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// The contents of the first `robot! { … }` of a file.
fn declaration(tokens: TokenStream) -> Option<TokenStream> {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    tokens.windows(3).find_map(|three| match three {
        [
            TokenTree::Ident(name),
            TokenTree::Punct(mark),
            TokenTree::Group(body),
        ] if name == "robot" && mark.as_char() == '!' && body.delimiter() == Delimiter::Brace => {
            Some(body.stream())
        }
        _ => None,
    })
}

/// Processor seconds of this thread, or wall-clock seconds where the system does not count them.
fn processor_seconds(start: Instant) -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text
        .split_whitespace()
        .next()
        .and_then(|x| x.parse::<f64>().ok());
    nanoseconds.map_or(start.elapsed().as_secs_f64(), |ns| 1e-9 * ns)
}

#[allow(clippy::print_stdout, reason = "a command")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("| file | macro, s | statements | bytes |");
    println!("|---|---|---|---|");
    for file in std::env::args().skip(1) {
        let Some(declaration) = declaration(std::fs::read_to_string(&file)?.parse()?) else {
            continue;
        };
        let clock = Instant::now();
        let start = processor_seconds(clock);
        let output = pid_codegen::expand(declaration);
        let seconds = processor_seconds(clock) - start;
        let text = output.to_string();
        let statements = text.matches("let ").count();
        println!("| {file} | {seconds:.3} | {statements} | {} |", text.len());
    }
    Ok(())
}
