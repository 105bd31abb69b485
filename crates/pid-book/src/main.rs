//! Writes the catalogue of effects: `cargo run --release -p pid-book`.

use std::process::ExitCode;

fn main() -> ExitCode {
    match write() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Writes the files and leaves nothing of effects that are gone.
fn write() -> Result<(), Box<dyn std::error::Error>> {
    let files = pid_book::files()?;
    let folder = pid_book::docs().join("book/effects");
    if folder.is_dir() {
        std::fs::remove_dir_all(&folder)?;
    }
    std::fs::create_dir_all(&folder)?;
    for file in files {
        std::fs::write(folder.join(&file.name), file.text)?;
    }
    eprintln!("wrote {}\nits lines in docs/SUMMARY.md:", folder.display());
    eprint!("{}", pid_book::contents());
    Ok(())
}
