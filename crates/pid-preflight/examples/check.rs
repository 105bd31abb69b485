//! Checks folders with a `dataset.toml` and a `nominal.toml` and prints what is found:
//! `cargo run --release -p pid-preflight --example check -- FOLDER …`

use std::path::Path;
use std::time::Instant;

use pid_interpret::nominal::Nominal;
use pid_preflight::{Settings, check, open};

#[expect(clippy::print_stdout, reason = "a command")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    for folder in std::env::args().skip(1) {
        let folder = Path::new(&folder);
        let nominal = Nominal::read(folder.join("nominal.toml"))?;
        let opened = open(folder)?;
        let start = Instant::now();
        let mut findings = opened.findings;
        findings.extend(check(&opened.dataset, &nominal, &Settings::default()));
        let seconds = start.elapsed().as_secs_f64();
        println!(
            "== {} ({} findings, {seconds:.2} s)",
            folder.display(),
            findings.len()
        );
        for finding in findings {
            println!("{finding}");
        }
    }
    Ok(())
}
