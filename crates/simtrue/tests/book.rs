//! The commands of the book run, and print what it says.

use std::path::Path;
use std::process::Command;

/// A fenced block: its language and lines.
struct Block {
    language: String,
    lines: Vec<String>,
}

fn blocks(text: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut inside = false;
    for line in text.lines() {
        match line.strip_prefix("```") {
            Some(_) if inside => inside = false,
            Some(language) => {
                inside = true;
                found.push(Block {
                    language: language.to_owned(),
                    lines: Vec::new(),
                });
            }
            None if inside => found
                .last_mut()
                .expect("a block")
                .lines
                .push(line.to_owned()),
            None => {}
        }
    }
    found
}

/// Whether two words are equal, numbers within 2 %: processors differ in the last places.
fn alike(written: &str, printed: &str) -> bool {
    let number = |w: &str| w.trim_end_matches([',', ';']).parse::<f64>().ok();
    match (number(written), number(printed)) {
        (Some(a), Some(b)) => (a - b).abs() <= 0.02 * a.abs().max(b.abs()),
        _ => written == printed,
    }
}

/// Whether a printed line is the written one. `…` stands for one word; what follows the last
/// written word may be anything.
fn says(printed: &str, written: &str) -> bool {
    let printed: Vec<&str> = printed.split_whitespace().collect();
    let written: Vec<&str> = written.split_whitespace().collect();
    printed.len() >= written.len()
        && (written.iter().zip(&printed)).all(|(w, p)| *w == "…" || alike(w, p))
}

/// Runs the commands of a chapter in one folder; how many there were.
fn run(chapter: &str) -> usize {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../docs/book")
        .join(chapter);
    let text = std::fs::read_to_string(&path).expect("the chapter");
    let folder = tempfile::tempdir().expect("a folder");
    let (mut printed, mut count, mut after_commands) = (String::new(), 0, false);
    for block in blocks(&text) {
        if block.language == "sh" {
            printed.clear();
            for line in &block.lines {
                let words = line.strip_prefix("simtrue ").expect("a command of simtrue");
                let mut command = Command::new(env!("CARGO_BIN_EXE_simtrue"));
                let output = command
                    .current_dir(folder.path())
                    .args(words.split(' '))
                    .output();
                let output = output.expect("the command runs");
                let told = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "{chapter}: {line}\n{told}");
                printed.push_str(&String::from_utf8_lossy(&output.stdout));
                printed.push_str(&told);
                count += 1;
            }
        } else if block.language == "text" && after_commands {
            for line in &block.lines {
                let found = printed.lines().any(|p| says(p, line));
                assert!(
                    found,
                    "{chapter} says\n{line}\nand this was printed:\n{printed}"
                );
            }
        }
        after_commands = block.language == "sh";
    }
    count
}

#[test]
fn the_first_robot() {
    assert!(run("first-robot.md") >= 5);
}

#[test]
fn how_to_log() {
    assert!(run("logging.md") >= 2);
}

#[test]
fn how_to_read_a_budget() {
    assert!(run("budget.md") >= 2);
}

#[test]
fn the_paper() {
    assert!(run("paper.md") >= 3);
}

/// A chapter with commands that no test above runs would be a claim that nobody checks.
#[test]
fn every_chapter_with_commands_is_run() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/book");
    let mut with_commands: Vec<String> = std::fs::read_dir(folder)
        .expect("the book")
        .map(|entry| entry.expect("an entry").path())
        .filter(|p| p.extension().is_some_and(|e| e == "md"))
        .filter(|p| {
            let text = std::fs::read_to_string(p).expect("readable");
            blocks(&text).iter().any(|b| b.language == "sh")
        })
        .map(|p| {
            p.file_name()
                .expect("a name")
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    with_commands.sort();
    assert_eq!(
        with_commands,
        ["budget.md", "first-robot.md", "logging.md", "paper.md"]
    );
}
