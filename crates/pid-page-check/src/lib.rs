//! A check of pages for tests: well-formed, plots labelled, tables that do not widen the page.

use roxmltree::{Document, Node, ParsingOptions};

/// Number of plots, sets of bars and tables of a page that is in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counted {
    /// Plots with axes.
    pub plots: usize,
    /// Sets of bars.
    pub bars: usize,
    /// Tables.
    pub tables: usize,
}

/// Checks a page: it is well-formed; every drawing has `role="img"` and a title; every plot has two
/// axes with quantity and unit; no coordinate is infinite or not a number; no rectangle is without
/// width; every table scrolls within itself; title, footer, program and date are there.
///
/// # Errors
/// The first thing that is not in order.
pub fn page(html: &str) -> Result<Counted, String> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(html, options).map_err(|e| e.to_string())?;
    let all = || document.descendants().filter(Node::is_element);
    let named = |name: &'static str| all().filter(move |n| n.tag_name().name() == name);
    let mut counted = Counted {
        plots: 0,
        bars: 0,
        tables: 0,
    };
    for svg in named("svg").filter(|n| n.attribute("viewBox").is_some() && !inside(*n, "svg")) {
        match svg.attribute("class").unwrap_or_default() {
            "plot" | "plot wide" => {
                counted.plots += 1;
                axes(svg)?;
            }
            "bars" => counted.bars += 1,
            other => return Err(format!("a drawing of class `{other}`")),
        }
        drawing(svg)?;
    }
    for table in named("table") {
        counted.tables += 1;
        if !table
            .ancestors()
            .any(|n| n.attribute("class") == Some("scroll"))
        {
            return Err(format!("a table that does not scroll: {}", text(table)));
        }
    }
    let footer = named("footer").next().ok_or("no footer")?;
    for name in ["Made by", "Date"] {
        if !text(footer).contains(name) {
            return Err(format!("no `{name}` in the footer"));
        }
    }
    match named("h1").count() {
        1 => Ok(counted),
        n => Err(format!("{n} titles")),
    }
}

fn inside(node: Node<'_, '_>, name: &str) -> bool {
    node.ancestors()
        .skip(1)
        .any(|n| n.tag_name().name() == name)
}

fn text(node: Node<'_, '_>) -> String {
    node.descendants().filter_map(|n| n.text()).collect()
}

fn axes(svg: Node<'_, '_>) -> Result<(), String> {
    for axis in ["axis x", "axis y"] {
        let label = svg.children().find(|n| n.attribute("class") == Some(axis));
        let label = label.map(text).unwrap_or_default();
        match label.rsplit_once(", ") {
            Some((quantity, unit)) if !quantity.is_empty() && !unit.is_empty() => {}
            _ => return Err(format!("{axis} is labelled `{label}`")),
        }
    }
    let ticks = svg
        .children()
        .filter(|n| n.attribute("class") == Some("tick"));
    match ticks.count() {
        // Two on each axis, at least.
        0..4 => Err("fewer than four ticks".to_owned()),
        _ => Ok(()),
    }
}

fn drawing(svg: Node<'_, '_>) -> Result<(), String> {
    let title = svg
        .first_element_child()
        .filter(|n| n.tag_name().name() == "title");
    let title = title.map(text).unwrap_or_default();
    if svg.attribute("role") != Some("img") || title.len() < 10 {
        return Err(format!("a drawing without words: `{title}`"));
    }
    for node in svg.descendants().filter(Node::is_element) {
        for a in node.attributes().filter(|a| a.name() != "class") {
            if a.value().contains("NaN") || a.value().contains("inf") {
                return Err(format!("{title}: {} is {}", a.name(), a.value()));
            }
        }
        let width = node.attribute("width").map(str::parse::<f64>);
        if width.is_some_and(|w| !w.is_ok_and(|w| w > 0.0)) {
            return Err(format!(
                "{title}: a {} without width",
                node.tag_name().name()
            ));
        }
    }
    Ok(())
}
