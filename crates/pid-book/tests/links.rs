//! Links between the pages of the project lead somewhere, without a network.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

/// A page: its links and the names of its headings.
struct Page {
    links: Vec<String>,
    headings: BTreeSet<String>,
}

/// The name of a heading, as mdBook and GitHub form it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter_map(|c| match c {
        ' ' | '-' => Some('-'),
        '_' => Some('_'),
        c if c.is_alphanumeric() => Some(c.to_ascii_lowercase()),
        _ => None,
    });
    kept.collect()
}

fn page(text: &str) -> Page {
    let (mut links, mut headings, mut heading) = (Vec::new(), BTreeSet::new(), None::<String>);
    for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
        match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                links.push(dest_url.into_string());
            }
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::End(TagEnd::Heading(_)) => {
                headings.extend(heading.take().map(|h| anchor(&h)));
            }
            Event::Text(t) | Event::Code(t) => {
                if let Some(heading) = &mut heading {
                    heading.push_str(&t);
                }
            }
            _ => {}
        }
    }
    Page { links, headings }
}

/// A path without `..` and `.`.
fn plain(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                out.pop();
            }
            Component::CurDir => {}
            part => out.push(part),
        }
    }
    out
}

fn collect(folder: &Path, pages: &mut BTreeMap<PathBuf, Page>) {
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            collect(&path, pages);
        } else if path.extension().is_some_and(|e| e == "md") {
            let text = std::fs::read_to_string(&path).expect("readable");
            pages.insert(plain(&path), page(&text));
        }
    }
}

fn all() -> (PathBuf, BTreeMap<PathBuf, Page>) {
    let docs = plain(&pid_book::docs().canonicalize().expect("docs"));
    let mut pages = BTreeMap::new();
    collect(&docs, &mut pages);
    let root = docs.parent().expect("the project").to_owned();
    for name in ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"] {
        let text = std::fs::read_to_string(root.join(name)).expect("readable");
        pages.insert(root.join(name), page(&text));
    }
    (docs, pages)
}

#[test]
fn every_link_leads_to_a_file_and_a_heading() {
    let (docs, pages) = all();
    let mut dead = Vec::new();
    let mut checked = 0;
    for (path, page) in &pages {
        for link in page.links.iter().filter(|l| !l.contains("://")) {
            checked += 1;
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = match file {
                "" => path.clone(),
                file => plain(&path.parent().expect("a folder").join(file)),
            };
            let named = || {
                pages
                    .get(&target)
                    .is_some_and(|p| p.headings.contains(heading))
            };
            // The book has the pages of `docs` alone.
            let outside = path.starts_with(&docs) && !target.starts_with(&docs);
            if !target.is_file() || outside || (!heading.is_empty() && !named()) {
                dead.push(format!("{}: {link}", path.display()));
            }
        }
    }
    assert!(checked > 200, "{checked} links");
    assert!(dead.is_empty(), "dead links:\n{}", dead.join("\n"));
}

/// What is not in the table of contents, mdBook leaves out.
#[test]
fn every_page_is_in_the_contents() {
    let (docs, pages) = all();
    let summary = &pages[&docs.join("SUMMARY.md")];
    let listed: BTreeSet<PathBuf> = summary.links.iter().map(|l| plain(&docs.join(l))).collect();
    assert_eq!(listed.len(), summary.links.len(), "a page is listed twice");
    let there: BTreeSet<PathBuf> = (pages.keys())
        .filter(|p| p.starts_with(&docs) && !p.ends_with("SUMMARY.md"))
        .cloned()
        .collect();
    assert_eq!(listed, there);
}
