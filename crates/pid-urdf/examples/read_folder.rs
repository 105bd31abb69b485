//! Reads every URDF of a folder and counts what is read, what is warned of, and what is refused and why.
//!
//! `cargo run --release -p pid-urdf --example read_folder FOLDER [guess]`

use std::collections::BTreeMap;
use std::path::PathBuf;

use pid_urdf::{Description, Guess, Missing, Options, Reading};

#[allow(clippy::print_stdout, reason = "the output of the example")]
fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| ".".to_owned());
    let mut reading = Reading::default();
    if arguments.next().as_deref() == Some("guess") {
        let mut guess = Guess::default();
        // Meshes are often not beside the file.
        guess.otherwise = Some(1.0);
        reading.missing = Missing::Guess(guess);
    }
    let entries = std::fs::read_dir(folder)?;
    let mut files: Vec<PathBuf> = entries
        .map(|e| e.map(|e| e.path()))
        .collect::<Result<_, _>>()?;
    files.sort();
    let (mut read, mut warned, mut still) = (0, 0, 0);
    let mut reasons: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in &files {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let description = Description::read_with(file, &reading);
        let robot = description.and_then(|description| {
            let robot = pid_urdf::robot(&description, &Options::default())?;
            Ok((description, robot))
        });
        match robot {
            Ok((description, robot)) => {
                read += 1;
                warned += usize::from(!description.warnings.is_empty());
                if robot.nq() == 0 {
                    still += 1;
                    println!("{name}: nothing moves");
                }
            }
            Err(error) => {
                // The kind of the error is the name of its variant.
                let kind = format!("{error:?}");
                let kind = kind.split([' ', '{', '(']).next().unwrap_or("").to_owned();
                let line = error.to_string().replace('\n', " ");
                reasons
                    .entry(kind)
                    .or_default()
                    .push(format!("{name}: {line}"));
            }
        }
    }
    println!(
        "{} files: {read} read ({warned} with warnings, {still} without a joint that moves)",
        files.len()
    );
    for (kind, all) in &reasons {
        println!("refused, {kind}: {}", all.len());
        for line in all {
            println!("    {line}");
        }
    }
    Ok(())
}
