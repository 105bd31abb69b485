//! The workspace as a house: files of a length that one reads, modules without circles, crates that
//! can be published.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Most lines of a source file.
const LINES: usize = 600;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Files below a folder whose names end so; folders of builds and hidden ones are left out.
fn files(folder: &Path, end: &str, out: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).expect("a folder");
    let mut paths: Vec<PathBuf> = entries.map(|e| e.expect("an entry").path()).collect();
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() {
            if !name.starts_with('.') && !path.join("CACHEDIR.TAG").exists() && name != "target" {
                files(&path, end, out);
            }
        } else if name.ends_with(end) {
            out.push(path);
        }
    }
}

/// Folders of crates, with the text of their manifests.
fn crates() -> Vec<(PathBuf, toml::Table)> {
    let mut all = Vec::new();
    files(&root(), "Cargo.toml", &mut all);
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).expect("a manifest");
        let table: toml::Table = text.parse().expect("TOML");
        let folder = path.parent().expect("a folder").to_owned();
        table.contains_key("package").then_some((folder, table))
    };
    all.into_iter().filter_map(read).collect()
}

#[test]
fn files_are_of_a_length_that_one_reads() {
    let mut all = Vec::new();
    files(&root(), ".rs", &mut all);
    assert!(all.len() > 500, "{} files", all.len());
    let long: Vec<String> = (all.iter())
        .filter_map(|path| {
            let lines = fs::read_to_string(path).expect("a file").lines().count();
            (lines > LINES).then(|| format!("{}: {lines}", path.display()))
        })
        .collect();
    assert!(long.is_empty(), "{long:#?}");
}

type Module = Vec<String>;

/// Modules of a crate with their texts, without comments and tests.
fn modules(folder: &Path) -> BTreeMap<Module, String> {
    let src = folder.join("src");
    let mut all = Vec::new();
    if src.is_dir() {
        files(&src, ".rs", &mut all);
    }
    let mut out = BTreeMap::new();
    for path in all {
        let inside = path.strip_prefix(&src).expect("below").with_extension("");
        let mut module: Module = (inside.iter())
            .map(|part| part.to_string_lossy().into_owned())
            .collect();
        if module.last().is_some_and(|m| m == "mod") {
            module.pop();
        }
        let first = module.first().map(String::as_str);
        let last = module.last().map(String::as_str);
        if matches!(first, Some("lib" | "main" | "bin")) || last == Some("tests") {
            continue;
        }
        let text = fs::read_to_string(&path).expect("a file");
        let text = text
            .split("#[cfg(test)]\nmod tests {")
            .next()
            .unwrap_or_default();
        let code = text
            .lines()
            .map(|l| l.split("//").next().unwrap_or_default());
        out.insert(module, code.collect::<Vec<_>>().join("\n"));
    }
    out
}

/// Paths that a text of a module names, `crate::a::{b, c}` opened, from the root of the crate.
fn named(module: &[String], text: &str) -> Vec<Module> {
    let mut out = Vec::new();
    let mut rest = text;
    let word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    while let Some(at) = ["crate::", "super::"]
        .iter()
        .filter_map(|w| rest.find(w))
        .min()
    {
        let before = rest[..at].chars().next_back();
        let tail = &rest[at..];
        let end = tail.find(|c: char| !word(c)).unwrap_or(tail.len());
        if !before.is_some_and(word) {
            let path = tail[..end].trim_end_matches(':');
            let mut base: Module = module.to_vec();
            let mut parts = path.split("::").peekable();
            if parts.peek() == Some(&"crate") {
                base.clear();
                parts.next();
            }
            while parts.peek() == Some(&"super") {
                base.pop();
                parts.next();
            }
            base.extend(parts.map(str::to_owned));
            let group = tail[end..].starts_with('{').then(|| &tail[end + 1..]);
            match group {
                None => out.push(base),
                Some(group) => out.extend(opened(&base, group)),
            }
        }
        rest = &tail[end.max(1)..];
    }
    out
}

/// Paths of a group in braces.
fn opened(base: &[String], group: &str) -> Vec<Module> {
    let (mut out, mut depth, mut item) = (Vec::new(), 0, String::new());
    for c in group.chars() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            _ => {}
        }
        if c == ',' && depth == 0 {
            out.push(std::mem::take(&mut item));
        } else {
            item.push(c);
        }
    }
    out.push(item);
    let path = |item: String| -> Vec<Module> {
        let item: String = item.split_whitespace().collect();
        let (head, inner) = match item.split_once('{') {
            Some((head, inner)) => (head.to_owned(), Some(inner.to_owned())),
            None => (item, None),
        };
        let mut whole = base.to_vec();
        let parts = head.split("::").filter(|p| !p.is_empty() && *p != "self");
        whole.extend(parts.map(str::to_owned));
        match inner {
            None => vec![whole],
            Some(inner) => opened(&whole, &inner),
        }
    };
    out.into_iter().flat_map(path).collect()
}

/// Groups of modules that import each other.
fn circles(modules: &BTreeMap<Module, String>) -> Vec<String> {
    let arrows: BTreeMap<&Module, BTreeSet<&Module>> = (modules.iter())
        .map(|(module, text)| {
            let to = named(module, text).into_iter().filter_map(|path| {
                let prefixes = (1..=path.len()).rev();
                let found = prefixes.filter_map(|n| modules.get_key_value(&path[..n]));
                found.map(|(m, _)| m).next()
            });
            (module, to.filter(|to| *to != module).collect())
        })
        .collect();
    let reached = |from: &Module| {
        let (mut seen, mut left) = (BTreeSet::new(), vec![from]);
        while let Some(here) = left.pop() {
            for to in &arrows[here] {
                if seen.insert(*to) {
                    left.push(to);
                }
            }
        }
        seen
    };
    let all: BTreeMap<&Module, BTreeSet<&Module>> =
        modules.keys().map(|m| (m, reached(m))).collect();
    let mut out = BTreeSet::new();
    for (module, to) in &all {
        let both: Vec<String> = (to.iter())
            .filter(|other| all[**other].contains(*module))
            .map(|m| m.join("::"))
            .collect();
        if to.contains(*module) {
            out.insert(both.join(", "));
        }
    }
    out.into_iter().collect()
}

#[test]
fn modules_import_each_other_one_way() {
    let mut found = Vec::new();
    for (folder, _) in crates() {
        let place = folder
            .strip_prefix(root())
            .expect("below")
            .display()
            .to_string();
        let own = circles(&modules(&folder));
        found.extend(own.into_iter().map(|circle| format!("{place}: {circle}")));
    }
    assert_eq!(found, Vec::<String>::new());
}

#[test]
fn a_circle_is_seen() {
    let module = |name: &str| vec![name.to_owned()];
    let texts = [
        (module("a"), "use crate::b::{X, Y};".to_owned()),
        (module("b"), "use super::{c, d::Z};".to_owned()),
        (module("c"), "fn f() { crate::a::g(); }".to_owned()),
        (module("d"), "use std::fmt;".to_owned()),
    ];
    assert_eq!(circles(&texts.into()), ["a, b, c"]);
}

#[test]
fn published_crates_say_what_they_are_and_need_published_ones() {
    let all = crates();
    let name = |t: &toml::Table| t["package"]["name"].as_str().expect("a name").to_owned();
    let published = |t: &toml::Table| {
        let says = t["package"].get("publish").and_then(toml::Value::as_bool);
        says != Some(false)
    };
    let names: BTreeSet<String> = (all.iter().filter(|(_, t)| published(t)))
        .map(|(_, t)| name(t))
        .collect();
    assert!(names.contains("simtrue") && names.len() > 20, "{names:?}");
    let own: BTreeSet<String> = all.iter().map(|(_, t)| name(t)).collect();
    for (_, t) in all.iter().filter(|(_, t)| published(t)) {
        let package = t["package"].as_table().expect("a table");
        for key in [
            "description",
            "license",
            "readme",
            "keywords",
            "categories",
            "documentation",
        ] {
            assert!(package.contains_key(key), "{} has no `{key}`", name(t));
        }
        let needs = t.get("dependencies").and_then(toml::Value::as_table);
        for need in needs.into_iter().flat_map(toml::Table::keys) {
            let unpublished = own.contains(need) && !names.contains(need);
            assert!(
                !unpublished,
                "{} needs {need}, which is not published",
                name(t)
            );
        }
    }
}
