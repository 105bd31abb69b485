//! The layout that all pages share.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::{Date, Ink};

/// A page: what its title, lead, links, sections and footer say.
#[derive(Debug)]
pub struct Page<'a> {
    /// Title of page and window.
    pub title: &'a str,
    /// What the page is of, below the title.
    pub lead: Markup,
    /// Links below the lead: `id` of a section, its name.
    pub sections: &'a [(&'a str, &'a str)],
    /// The content, in `section` elements.
    pub body: Markup,
    /// Where the figures come from.
    pub footer: Footer<'a>,
}

/// Where the figures of a page come from. An empty text is left out.
#[derive(Debug, Clone, Copy)]
pub struct Footer<'a> {
    /// Name and version of the program.
    pub program: &'a str,
    /// Data set and records.
    pub data: &'a str,
    /// Settings that decide the result.
    pub settings: &'a str,
    /// Where more is found.
    pub more: &'a str,
}

impl Page<'_> {
    /// The text of the page, HTML that is well-formed XML too.
    pub fn html(&self) -> String {
        html! {
            (DOCTYPE)
            html lang="en" xmlns="http://www.w3.org/1999/xhtml" {
                head {
                    (PreEscaped("<meta charset=\"utf-8\"/><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>"))
                    title { (self.title) }
                    style { (PreEscaped(include_str!("style.css"))) }
                }
                body {
                    main {
                        header {
                            h1 { (self.title) }
                            div.lead { (self.lead) }
                            @if !self.sections.is_empty() {
                                nav { @for (id, name) in self.sections { a href={ "#" (id) } { (name) } } }
                            }
                        }
                        (self.body)
                        (self.footer.html())
                    }
                }
            }
        }
        .into_string()
    }
}

impl Footer<'_> {
    fn html(&self) -> Markup {
        let date = Date::today().to_string();
        let rows = [
            ("Data", self.data),
            ("Settings", self.settings),
            ("Made by", self.program),
            ("Date", &date),
            ("More", self.more),
        ];
        html! {
            footer { dl {
                @for (name, text) in rows.iter().filter(|(_, text)| !text.is_empty()) {
                    div { dt { (name) } dd { (text) } }
                }
            } }
        }
    }
}

/// A plot with its caption: the name of what it is of, and what it shows.
pub fn figure(plot: &Markup, name: &str, what: &str) -> Markup {
    html! {
        figure {
            (plot)
            figcaption {
                @if !name.is_empty() { (name) " " }
                span { (what) }
            }
        }
    }
}

/// An entry of a legend.
#[derive(Debug, Clone, Copy)]
pub enum Legend<'a> {
    /// A curve.
    Line(Ink, &'a str),
    /// Dots.
    Dot(Ink, &'a str),
    /// A remark.
    Note(&'a str),
}

/// A legend above plots.
pub fn legend(entries: &[Legend<'_>]) -> Markup {
    html! {
        div.legend {
            @for entry in entries {
                @match entry {
                    Legend::Line(ink, text) => span { i style=(format!("background:var(--{})", ink.name())) {} (text) },
                    Legend::Dot(ink, text) => span { i.dot style=(format!("background:var(--{})", ink.name())) {} (text) },
                    Legend::Note(text) => span { (text) },
                }
            }
        }
    }
}

/// A table that scrolls within itself where it is wider than the page. Columns of numbers stand right.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> Markup {
    let numbers: Vec<bool> = (0..head.len())
        .map(|k| {
            let mut cells = rows.iter().filter_map(|row| row.get(k)).peekable();
            cells.peek().is_some() && cells.all(|cell| is_number(cell))
        })
        .collect();
    let class = |k: usize| match numbers.get(k) {
        Some(true) => Some("num"),
        _ => None,
    };
    html! {
        div.scroll { table {
            thead { tr { @for (k, h) in head.iter().enumerate() { th class=[class(k)] { (h) } } } }
            tbody { @for row in rows { tr {
                @for (k, cell) in row.iter().enumerate() { td class=[class(k)] { (cell) } }
            } } }
        } }
    }
}

/// A number, "3 of 5", "12 %" or a sign for what there is none of.
fn is_number(cell: &str) -> bool {
    let first = cell.chars().next();
    first.is_none_or(|c| c.is_ascii_digit() || "-−–∞".contains(c)) && cell.chars().count() <= 16
}
