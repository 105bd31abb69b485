//! Cost of building a robot: generates arms of 1 … 7 joints, expands them, and compiles the
//! expansions with rustc.
//!
//! ```text
//! cargo run --release -p pid-studies -- build-budget [largest n]
//! ```
//! "general": joint frames turned and moved in all directions. "industrial": quarter turns and one
//! or two offsets. All ten inertial parameters of every link are open, four parameters of the drive
//! per joint; r, M, b, J and H are emitted, r and the forces also over dual numbers. Printed:
//! operations of r + J + H, statements and bytes of the expansion, seconds of expansion (macro
//! built with optimisation; for one built without see `pid-codegen/src/bin/macro_seconds.rs`),
//! processor seconds of rustc for the expansion: optimised, optimised with lanes added, not
//! optimised. Budget: rustc, optimised, n = 2 below 1 s, n = 6 below 6 s, n = 7 below 10 s; macro
//! below 1 s. Needs Linux (processor time of child processes from `/proc`).

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::Failure;

/// The declaration of an arm; `lanes` is "" or ", lanes".
fn arm(n: usize, general: bool, lanes: &str) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(n as u64);
    let mut text = String::from("pub robot Arm { gravity: [0, 0, -9.81] m/s^2;\n");
    for k in 1..=n {
        let _ = writeln!(
            text,
            "link l{k} {{ inertial: free; mass: 2 kg; com: [0.01, 0.02, 0.1] m; \
             inertia at com: diag(0.02, 0.02, 0.01) kg*m^2; }}"
        );
    }
    let turns = ["0, 0, 0", "pi/2, 0, 0", "-pi/2, 0, 0"];
    for k in 1..=n {
        let parent = if k == 1 {
            "base".to_owned()
        } else {
            format!("l{}", k - 1)
        };
        let (at, rpy) = if general {
            let mut three = |scale: f64| {
                let x: [f64; 3] = std::array::from_fn(|_| scale * rng.random_range(-1.0..1.0));
                format!("{:.4}, {:.4}, {:.4}", x[0], x[1], x[2])
            };
            (three(0.4), three(3.0))
        } else {
            let offset = ["0, 0, 0.3", "0.4, 0, 0", "0.1, 0, 0.2"][k % 3];
            (offset.to_owned(), turns[(k * k) % 3].to_owned())
        };
        let _ = writeln!(
            text,
            "joint j{k}: revolute about z {{ {parent} -> l{k} at [{at}] m rpy [{rpy}] rad; }}"
        );
    }
    text.push_str(
        "per joint { input current: A; dry: N*m = 2.0; viscous: N*m*s/rad = 3.0; gain: N*m/A = 5.0; \
         sharp: s/rad = 50.0; force = gain*current - viscous*v - dry*tanh(sharp*v); }\n\
         emit { dynamics, first_derivatives, second_derivatives",
    );
    text.push_str(lanes);
    text.push_str(" } }");
    text
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

/// Processor seconds of all child processes that have ended.
fn children() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    // Fields 16 and 17 of the whole line, in ticks of 10 ms.
    Some((fields.get(13)?.parse::<f64>().ok()? + fields.get(14)?.parse::<f64>().ok()?) / 100.0)
}

/// The latest build of `pid-runtime` beside this program.
fn runtime(deps: &Path) -> Option<PathBuf> {
    let files = std::fs::read_dir(deps).ok()?.flatten();
    files
        .filter(|file| {
            let name = file.file_name().to_string_lossy().into_owned();
            name.starts_with("libpid_runtime-") && name.ends_with(".rlib")
        })
        .max_by_key(|file| file.metadata().and_then(|m| m.modified()).ok())
        .map(|file| file.path())
}

/// Processor seconds of rustc for a source.
fn compile(source: &Path, deps: &Path, runtime: &Path, level: &str) -> Option<f64> {
    let before = children()?;
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let status = Command::new(rustc)
        .args([
            "--crate-type",
            "lib",
            "--edition",
            "2024",
            "--cap-lints",
            "allow",
        ])
        .args(["-C", "codegen-units=1", "-C"])
        .arg(format!("opt-level={level}"))
        .arg("-L")
        .arg(format!("dependency={}", deps.display()))
        .arg("--extern")
        .arg(format!("pid_runtime={}", runtime.display()))
        .arg("--out-dir")
        .arg(source.parent()?)
        .arg(source)
        .status()
        .ok()?;
    status.success().then_some(())?;
    Some(children()? - before)
}

/// "12 345 (+ …" after a row's label in the robot's documentation: operations.
fn operations(text: &str, row: &str) -> usize {
    let at = text.find(row).map_or(0, |at| at + row.len());
    let number = text[at..].trim_start_matches(|c: char| !c.is_ascii_digit());
    let number = number.trim_start_matches(|c: char| c.is_ascii_digit());
    let number: String = number
        .trim_start_matches(|c: char| !c.is_ascii_digit())
        .chars()
        .take_while(char::is_ascii_digit)
        .collect();
    number.parse().unwrap_or(0)
}

/// Runs the command with its words.
///
/// # Errors
/// What stops it.
pub fn run(words: &[String]) -> Result<(), Failure> {
    let largest: usize = match words.first().cloned() {
        Some(n) => n.parse()?,
        None => 7,
    };
    let program = std::env::current_exe()?;
    let deps = program
        .parent()
        .ok_or("this program has no folder")?
        .join("deps");
    let runtime =
        runtime(&deps).ok_or("no libpid_runtime beside this program: run it through cargo")?;
    let folder = std::env::temp_dir().join(format!("pid_build_budget_{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    println!(
        "| n | geometry | operations r + J + H | statements | kB | macro, s | rustc -O3, s | with lanes, s | rustc -O0, s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for n in 1..=largest {
        for general in [false, true] {
            let declaration = arm(n, general, "")
                .parse()
                .map_err(|e: proc_macro2::LexError| e.to_string())?;
            let clock = Instant::now();
            let start = processor_seconds(clock);
            let output = pid_codegen::expand(declaration);
            let seconds = processor_seconds(clock) - start;
            let text = output.to_string();
            let source = folder.join("arm.rs");
            let mut times = String::new();
            for (level, lanes) in [("3", false), ("3", true), ("0", false)] {
                if lanes {
                    let output = pid_codegen::expand(
                        arm(n, general, ", lanes")
                            .parse()
                            .map_err(|e: proc_macro2::LexError| e.to_string())?,
                    );
                    std::fs::write(&source, format!("#![forbid(unsafe_code)]\n{output}"))?;
                } else {
                    std::fs::write(&source, format!("#![forbid(unsafe_code)]\n{text}"))?;
                }
                let time = compile(&source, &deps, &runtime, level).ok_or("rustc failed")?;
                let _ = write!(times, " {time:.2} |");
            }
            println!(
                "| {n} | {} | {} | {} | {} | {seconds:.3} |{times}",
                if general { "general" } else { "industrial" },
                operations(&text, "| r and ∂r/∂z |") + operations(&text, "| ∂²(λᵀr)/∂z² |"),
                text.matches("let ").count(),
                text.len() / 1000,
            );
        }
    }
    std::fs::remove_dir_all(&folder)?;
    Ok(())
}
