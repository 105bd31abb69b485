//! The written catalogue is that of the library.

use std::collections::BTreeSet;

/// Numbers of a text, and what stands between them. Numbers of plots have one decimal.
fn parts(text: &str) -> (String, Vec<f64>) {
    let (mut words, mut numbers, mut number) = (String::new(), Vec::new(), String::new());
    for c in text.chars().chain(['\n']) {
        if c.is_ascii_digit() || c == '.' {
            number.push(c);
            continue;
        }
        if let Ok(x) = number.parse() {
            numbers.push(x);
            words.push('#');
        } else {
            words.push_str(&number);
        }
        number.clear();
        words.push(c);
    }
    (words, numbers)
}

#[test]
fn the_written_files_are_those_of_the_library() {
    let folder = pid_book::docs().join("book/effects");
    let made = pid_book::files().expect("every effect has a view");
    let names: BTreeSet<String> = made.iter().map(|f| f.name.clone()).collect();
    let there: BTreeSet<String> = std::fs::read_dir(&folder)
        .expect("docs/book/effects")
        .map(|entry| {
            entry
                .expect("an entry")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    let mend = "run `cargo run --release -p pid-book`";
    assert_eq!(names, there, "{mend}");
    for file in made {
        let kept = std::fs::read_to_string(folder.join(&file.name)).expect("readable");
        let (words, numbers) = parts(&file.text);
        let (kept_words, kept_numbers) = parts(&kept);
        assert_eq!(words, kept_words, "{}: {mend}", file.name);
        // Libraries of functions differ in the last place, and so may the last digit written.
        let same = numbers
            .iter()
            .zip(&kept_numbers)
            .all(|(a, b)| (a - b).abs() < 0.11);
        assert!(same, "{}: {mend}", file.name);
    }
}

#[test]
fn the_contents_list_every_effect() {
    let summary = std::fs::read_to_string(pid_book::docs().join("SUMMARY.md")).expect("readable");
    let lines = pid_book::contents();
    assert!(lines.lines().count() > 20);
    assert!(
        summary.contains(&lines),
        "write into docs/SUMMARY.md:\n{lines}"
    );
}

/// A plot shows the effect: its curves are not all one flat line.
#[test]
fn every_plot_shows_something() {
    let mut plots = 0;
    for file in pid_book::files().expect("every effect has a view") {
        if !file.name.ends_with(".svg") {
            continue;
        }
        plots += 1;
        let curves = file.text.split("points=\"").skip(1);
        let points = curves
            .filter_map(|c| c.split('"').next())
            .flat_map(|c| c.split(' '));
        let heights: BTreeSet<&str> = points.filter_map(|p| p.split(',').nth(1)).collect();
        assert!(heights.len() > 1, "{}: a flat line", file.name);
    }
    assert_eq!(plots, pid_book::contents().lines().count());
}
