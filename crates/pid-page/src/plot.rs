//! Plots and bars as inline SVG. Colours are CSS variables of the page.

use std::fmt::Write;

use maud::{Markup, PreEscaped, html};

use crate::Axis;

/// What is drawn, which decides its colour: the same on every page, dark or light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// A record.
    Measured,
    /// A simulation.
    Simulated,
    /// A missing force, or a law found in it.
    Force,
    /// Motion with v > 0.
    Forward,
    /// Motion with v < 0.
    Backward,
    /// What was stated before, dashed.
    Stated,
    /// One of six colours for series without a meaning of their own; the seventh series takes the
    /// first again.
    Series(usize),
}

impl Ink {
    /// Name of the CSS class and of the variable `--name`.
    pub(crate) fn name(self) -> &'static str {
        const SERIES: [&str; 6] = [
            "series-1", "series-2", "series-3", "series-4", "series-5", "series-6",
        ];
        match self {
            Ink::Measured => "measured",
            Ink::Simulated => "simulated",
            Ink::Force => "force",
            Ink::Forward => "forward",
            Ink::Backward => "backward",
            Ink::Stated => "stated",
            Ink::Series(k) => SERIES[k % SERIES.len()],
        }
    }
}

/// Places on the drawing, in units of its view box.
#[derive(Debug, Clone, Copy)]
struct Frame {
    width: f64,
    height: f64,
    left: f64,
    bottom: f64,
}

/// Half a page wide. Text of 11.5 units is as large as that of the tables.
const HALF: Frame = Frame {
    width: 470.0,
    height: 226.0,
    left: 68.0,
    bottom: 184.0,
};
/// A page wide, for many series.
const WIDE: Frame = Frame {
    width: 640.0,
    height: 300.0,
    left: 78.0,
    bottom: 252.0,
};
const TOP: f64 = 10.0;
const RIGHT: f64 = 14.0;

impl Frame {
    fn right(&self) -> f64 {
        self.width - RIGHT
    }
}

/// A plot being drawn.
#[derive(Debug, Clone)]
pub struct Plot {
    title: String,
    x: Axis,
    y: Axis,
    frame: Frame,
    content: String,
}

impl Plot {
    /// An empty plot. `title` says what it shows, to a reader who cannot see it; the ranges of the
    /// axes are added to it.
    pub fn new(title: &str, x: Axis, y: Axis) -> Self {
        Self {
            title: title.to_owned(),
            x,
            y,
            frame: HALF,
            content: String::new(),
        }
    }

    /// As wide as the page, for many series.
    #[must_use]
    pub fn wide(self) -> Self {
        Self {
            frame: WIDE,
            ..self
        }
    }

    fn across(&self, x: f64) -> Option<f64> {
        let f = &self.frame;
        Some(f.left + self.x.share(x)? * (f.right() - f.left))
    }

    fn up(&self, y: f64) -> Option<f64> {
        let f = &self.frame;
        Some(f.bottom + self.y.share(y)? * (TOP - f.bottom))
    }

    fn at(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        Some((self.across(x)?, self.up(y)?))
    }

    fn points(&self, points: impl IntoIterator<Item = (f64, f64)>) -> String {
        let mut out = String::new();
        for (x, y) in points.into_iter().filter_map(|(x, y)| self.at(x, y)) {
            let _ = write!(out, "{x:.1},{y:.1} ");
        }
        out.truncate(out.trim_end().len());
        out
    }

    /// A curve; a value that is not a number interrupts it.
    pub fn line(&mut self, ink: Ink, points: impl IntoIterator<Item = (f64, f64)>) {
        let points: Vec<(f64, f64)> = points.into_iter().collect();
        for piece in points.split(|(x, y)| x.is_nan() || y.is_nan()) {
            if piece.len() < 2 {
                continue;
            }
            let path = self.points(piece.iter().copied());
            let _ = write!(
                self.content,
                "<polyline class=\"line {}\" points=\"{path}\"/>",
                ink.name()
            );
        }
    }

    /// The area between two curves, given as (x, low, high).
    pub fn band(&mut self, edges: &[(f64, f64, f64)]) {
        if edges.len() < 2 {
            return;
        }
        let high = edges.iter().map(|&(x, _, high)| (x, high));
        let low = edges.iter().rev().map(|&(x, low, _)| (x, low));
        let path = self.points(high.chain(low));
        let _ = write!(self.content, "<polygon class=\"band\" points=\"{path}\"/>");
    }

    /// Many small dots, pale where they are few.
    pub fn cloud(&mut self, ink: Ink, points: impl IntoIterator<Item = (f64, f64)>) {
        self.circles(&format!("dot {}", ink.name()), 1.4, points);
    }

    /// Marks of single values.
    pub fn marks(&mut self, ink: Ink, points: impl IntoIterator<Item = (f64, f64)>) {
        self.circles(&format!("mark {}", ink.name()), 3.2, points);
    }

    fn circles(&mut self, class: &str, r: f64, points: impl IntoIterator<Item = (f64, f64)>) {
        let _ = write!(self.content, "<g class=\"{class}\">");
        for (x, y) in points {
            if let Some((x, y)) = self.at(x, y) {
                let _ = write!(
                    self.content,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\"/>"
                );
            }
        }
        self.content.push_str("</g>");
    }

    /// An upright interval; none where it has no width.
    pub fn interval(&mut self, ink: Ink, x: f64, (low, high): (f64, f64)) {
        if low < high {
            self.segment(&format!("spread {}", ink.name()), (x, low), (x, high));
        }
    }

    /// A straight line between two points.
    pub fn straight(&mut self, ink: Ink, from: (f64, f64), to: (f64, f64)) {
        self.segment(&format!("line {}", ink.name()), from, to);
    }

    fn segment(&mut self, class: &str, from: (f64, f64), to: (f64, f64)) {
        let ends = (self.at(from.0, from.1), self.at(to.0, to.1));
        if let (Some((x1, y1)), Some((x2, y2))) = ends {
            let _ = write!(
                self.content,
                "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>"
            );
        }
    }

    /// An upright line over the whole height.
    pub fn upright(&mut self, ink: Ink, x: f64) {
        if let Some(x) = self.across(x) {
            let bottom = self.frame.bottom;
            let _ = write!(
                self.content,
                "<line class=\"line {}\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{bottom}\"/>",
                ink.name()
            );
        }
    }

    /// A range of x over the whole height, at least wide enough to be seen; none where it has no width.
    pub fn span(&mut self, (from, to): (f64, f64)) {
        let (Some(a), Some(b)) = (self.across(from), self.across(to)) else {
            return;
        };
        if from < to {
            let _ = write!(
                self.content,
                "<rect class=\"band\" x=\"{a:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{:.1}\"/>",
                (b - a).max(1.5),
                self.frame.bottom - TOP
            );
        }
    }

    /// The plot as an `svg` element. What lies outside of the axes is cut off.
    pub fn draw(&self) -> Markup {
        let f = &self.frame;
        let (right, bottom) = (f.right(), f.bottom);
        let (width, height) = (right - f.left, bottom - TOP);
        let class = if f.width > HALF.width {
            "plot wide"
        } else {
            "plot"
        };
        let zero = self.y.share(0.0).is_some_and(|s| (0.0..=1.0).contains(&s));
        html! {
            svg class=(class) viewBox=(format!("0 0 {} {}", f.width, f.height)) role="img" {
                title { (self.title) "; " (self.x.words()) ", " (self.y.words()) "." }
                @for (t, label) in self.y.ticks() {
                    @if let Some(at) = self.up(t) {
                        line class=(if zero && t == 0.0 { "zero" } else { "grid" }) x1=(f.left) x2=(right) y1=(format!("{at:.1}")) y2=(format!("{at:.1}")) {}
                        text class="tick" x=(f.left - 7.0) y=(format!("{:.1}", at + 4.0)) text-anchor="end" { (label) }
                    }
                }
                @for (t, label) in self.x.ticks() {
                    @if let Some(at) = self.across(t) {
                        line class="zero" x1=(format!("{at:.1}")) x2=(format!("{at:.1}")) y1=(bottom) y2=(bottom + 4.0) {}
                        text class="tick" x=(format!("{at:.1}")) y=(bottom + 17.0) text-anchor="middle" { (label) }
                    }
                }
                line class="zero" x1=(f.left) x2=(right) y1=(bottom) y2=(bottom) {}
                svg x=(f.left) y=(TOP) width=(width) height=(height) viewBox=(format!("{} {TOP} {width} {height}", f.left)) overflow="hidden" {
                    (PreEscaped(&self.content))
                }
                text class="axis x" x=(0.5 * (f.left + right)) y=(f.height - 6.0) text-anchor="middle" { (self.x.label()) }
                text class="axis y" transform=(format!("translate(14 {:.1}) rotate(-90)", 0.5 * (TOP + bottom))) text-anchor="middle" { (self.y.label()) }
            }
        }
    }
}

/// One row of [`bars`].
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// What the bar is of.
    pub label: String,
    /// Its length; not below zero.
    pub value: f64,
    /// The value in words, with its unit.
    pub text: String,
}

/// Horizontal bars with labels and values; the largest has the full length. `title` says what they show.
///
/// Bars are as long as labels and values leave room for; a drawing without room for them is wider.
pub fn bars(title: &str, rows: &[Bar]) -> Markup {
    /// Width of the drawing, height of a row and least left end of a bar.
    const WIDTH: f64 = 460.0;
    const ROW: f64 = 26.0;
    const LEFT: f64 = 112.0;
    /// Most and least full length of a bar.
    const LENGTH: (f64, f64) = (130.0, 40.0);
    /// Between a label, its bar and its value.
    const SPACE: f64 = 8.0;
    let widest = rows.iter().map(|r| letters(&r.label)).fold(0.0, f64::max);
    let left = (widest + SPACE).max(LEFT);
    let largest = rows.iter().map(|r| r.value).fold(1e-300, f64::max);
    let share = |row: &Bar| Some(row.value / largest).filter(|s| s.is_finite() && *s > 0.0);
    let end = |row: &Bar, full: f64| left + SPACE + full * share(row).unwrap_or(0.0);
    let room = |row: &Bar| Some((WIDTH - end(row, 0.0) - letters(&row.text)) / share(row)?);
    let full = rows.iter().filter_map(room).fold(LENGTH.0, f64::min);
    let full = full.max(LENGTH.1);
    let ends = rows.iter().map(|r| end(r, full) + letters(&r.text));
    let width = ends.fold(WIDTH, f64::max).ceil();
    let words: Vec<String> = rows
        .iter()
        .map(|r| format!("{} {}", r.label, r.text))
        .collect();
    html! {
        svg class="bars" viewBox=(format!("0 0 {width} {}", ROW * rows.len() as f64)) role="img" {
            title { (title) ": " (words.join(", ")) "." }
            @for (i, row) in rows.iter().enumerate() {
                @let y = ROW * i as f64;
                @let length = end(row, full) - end(row, 0.0);
                text x="0" y=(y + 17.0) { (row.label) }
                @if length >= 0.1 { rect x=(format!("{left:.1}")) y=(y + 6.0) height="14" rx="2" width=(format!("{length:.1}")) {} }
                text x=(format!("{:.1}", end(row, full))) y=(y + 17.0) { (row.text) }
            }
        }
    }
}

/// Width of a text beside a bar where its letters are largest, on a phone; letters are at most so wide in the mean.
fn letters(text: &str) -> f64 {
    8.0 * text.chars().count() as f64
}
