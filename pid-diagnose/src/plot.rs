//! Plots of a diagnosis as inline SVG.

use maud::{Markup, PreEscaped, html};

use crate::diagnosis::Nameless;
use crate::locate::{Class, Curve, Sample};
use crate::timing::Alignment;

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 210.0;
const LEFT: f64 = 62.0;
const BOTTOM: f64 = 38.0;
const TOP: f64 = 8.0;
const RIGHT: f64 = 10.0;

/// A linear scale from data to picture.
struct Scale {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Scale {
    fn new((low, high): (f64, f64), from: f64, to: f64, margin: f64) -> Self {
        let width = if high > low { high - low } else { 1.0 };
        Scale {
            low: low - margin * width,
            high: high + margin * width,
            from,
            to,
        }
    }
    fn at(&self, x: f64) -> f64 {
        let s = ((x - self.low) / (self.high - self.low)).clamp(-0.02, 1.02);
        self.from + s * (self.to - self.from)
    }
    /// Round numbers along the scale.
    fn ticks(&self) -> Vec<f64> {
        let raw = (self.high - self.low) / 5.0;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 2.5, 5.0, 10.0]
            .into_iter()
            .map(|s| s * power)
            .find(|s| *s >= raw)
            .unwrap_or(raw);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// A tick's label without rounding dust.
fn label(x: f64) -> String {
    let text = format!("{:.4}", if x == 0.0 { 0.0 } else { x });
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Frame, grid, labels and content.
fn frame(x: &Scale, y: &Scale, names: (&str, &str), content: &str) -> Markup {
    let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
    html! {
        svg class="plot" viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" aria-label=(format!("{} over {}", names.1, names.0)) {
            @for t in y.ticks() {
                @let at = format!("{:.1}", y.at(t));
                line x1=(LEFT) x2=(right) y1=(at) y2=(at) class=(if t == 0.0 { "zero" } else { "grid" }) {}
                text x=(LEFT - 6.0) y=(format!("{:.1}", y.at(t) + 3.5)) text-anchor="end" { (label(t)) }
            }
            @for t in x.ticks() {
                text x=(format!("{:.1}", x.at(t))) y=(bottom + 15.0) text-anchor="middle" { (label(t)) }
            }
            line x1=(LEFT) x2=(right) y1=(bottom) y2=(bottom) class="zero" {}
            (PreEscaped(content))
            text x=(0.5 * (LEFT + right)) y=(HEIGHT - 5.0) text-anchor="middle" { (names.0) }
            text transform=(format!("translate(12 {:.1}) rotate(-90)", 0.5 * (TOP + bottom))) text-anchor="middle" { (names.1) }
        }
    }
}

fn points(x: &Scale, y: &Scale, data: impl Iterator<Item = (f64, f64)>) -> String {
    data.map(|(a, b)| format!("{:.1},{:.1}", x.at(a), y.at(b)))
        .collect::<Vec<_>>()
        .join(" ")
}

/// Range of most of the values: 0.5 % at either end may fall out, so that a single impact does not flatten the rest.
fn most(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut x: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    x.sort_by(f64::total_cmp);
    match x.len() {
        0 => (0.0, 1.0),
        n => (x[n / 200], x[n - 1 - n / 200]),
    }
}

/// Missing force over time with its band about zero.
pub(crate) fn over_time(curve: &Curve, unit: &str) -> Markup {
    let span = (
        curve.t.first().copied().unwrap_or(0.0),
        curve.t.last().copied().unwrap_or(1.0),
    );
    let x = Scale::new(span, LEFT, WIDTH - RIGHT, 0.0);
    let (low, high) = most(curve.w.iter().copied());
    let band = most(curve.band.iter().copied()).0;
    let y = Scale::new(
        (low.min(-band).min(0.0), high.max(band).max(0.0)),
        HEIGHT - BOTTOM,
        TOP,
        0.08,
    );
    let both = curve.t.iter().zip(&curve.band);
    let outline = points(
        &x,
        &y,
        both.clone()
            .map(|(t, b)| (*t, *b))
            .chain(both.rev().map(|(t, b)| (*t, -b))),
    );
    let line = points(&x, &y, curve.t.iter().copied().zip(curve.w.iter().copied()));
    let content = format!(
        "<polygon class=\"band\" points=\"{outline}\"/><polyline class=\"force\" points=\"{line}\"/>"
    );
    frame(
        &x,
        &y,
        ("time, s", &format!("missing force, {unit}")),
        &content,
    )
}

/// What shifts of a channel leave, the best shift with two deviations, the stated one.
pub(crate) fn alignment(a: &Alignment, name: &str) -> Markup {
    let points_of = || a.curve.iter().map(|(t, x)| (1e3 * t, 100.0 * x));
    let ends = |f: &dyn Fn(&(f64, f64)) -> f64| {
        points_of()
            .map(|p| f(&p))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| {
                (l.min(x), h.max(x))
            })
    };
    let x = Scale::new(ends(&|p| p.0), LEFT, WIDTH - RIGHT, 0.0);
    let y = Scale::new((0.0, ends(&|p| p.1).1), HEIGHT - BOTTOM, TOP, 0.04);
    let line = points(&x, &y, points_of());
    let mut content = format!("<polyline class=\"force\" points=\"{line}\"/>");
    let (top, bottom) = (TOP, HEIGHT - BOTTOM);
    let stated = x.at(1e3 * a.stated);
    content.push_str(&format!(
        "<line class=\"stated\" x1=\"{stated:.1}\" x2=\"{stated:.1}\" y1=\"{top}\" y2=\"{bottom}\"/>"
    ));
    if let Some(std) = a.std {
        let edge = |sign: f64| x.at(1e3 * (a.delay + sign * 2.0 * std));
        let (from, width) = (edge(-1.0), (edge(1.0) - edge(-1.0)).max(1.5));
        content.push_str(&format!(
            "<rect class=\"band\" x=\"{from:.1}\" y=\"{top}\" width=\"{width:.1}\" height=\"{:.1}\"/>",
            bottom - top
        ));
    }
    frame(&x, &y, ("shift, ms", name), &content)
}

/// A free law with its band, straight between its marks.
pub(crate) fn free_law(law: &Nameless, names: (&str, &str)) -> Markup {
    let first = law.at.first().copied().unwrap_or(0.0);
    let last = law.at.last().copied().unwrap_or(1.0);
    let x = Scale::new((first, last), LEFT, WIDTH - RIGHT, 0.03);
    let all = || law.at.iter().copied().zip(law.values.iter().copied());
    let edge = |sign: f64| {
        all()
            .zip(&law.stds)
            .filter_map(move |((q, f), std)| Some((q, f + sign * 2.0 * (*std)?)))
    };
    let (low, high) = all()
        .chain(edge(1.0))
        .chain(edge(-1.0))
        .fold((0.0_f64, 0.0_f64), |(a, b), (_, f)| (a.min(f), b.max(f)));
    let y = Scale::new((low, high), HEIGHT - BOTTOM, TOP, 0.06);
    let back: Vec<(f64, f64)> = edge(-1.0).collect();
    let outline = points(&x, &y, edge(1.0).chain(back.into_iter().rev()));
    let mut content = format!(
        "<polygon class=\"band\" points=\"{outline}\"/><polyline class=\"force\" points=\"{}\"/>",
        points(&x, &y, all())
    );
    for (q, f) in all() {
        content.push_str(&format!(
            "<circle class=\"forward\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\"/>",
            x.at(q),
            y.at(f)
        ));
    }
    frame(&x, &y, names, &content)
}

/// Missing force against a quantity: samples, class means and spreads, coloured by direction.
pub(crate) fn against(
    samples: &[Sample],
    classes: &[Class],
    axis: usize,
    names: (&str, &str),
) -> Markup {
    let x = Scale::new(
        most(samples.iter().map(|s| s.x[axis])),
        LEFT,
        WIDTH - RIGHT,
        0.03,
    );
    let (low, high) = most(samples.iter().map(|s| s.w));
    let y = Scale::new((low.min(0.0), high.max(0.0)), HEIGHT - BOTTOM, TOP, 0.06);
    let mut content = String::new();
    for s in samples {
        let way = if s.forward { "forward" } else { "backward" };
        content.push_str(&format!(
            "<circle class=\"dot {way}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.3\"/>",
            x.at(s.x[axis]),
            y.at(s.w)
        ));
    }
    for (way, forward) in [("forward", true), ("backward", false)] {
        let own: Vec<&Class> = classes.iter().filter(|c| c.forward == forward).collect();
        for c in &own {
            content.push_str(&format!(
                "<line class=\"spread {way}\" x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{1:.1}\" y2=\"{2:.1}\"/><circle class=\"{way}\" cx=\"{0:.1}\" cy=\"{3:.1}\" r=\"3\"/>",
                x.at(c.at),
                y.at(c.mean - c.spread),
                y.at(c.mean + c.spread),
                y.at(c.mean)
            ));
        }
        content.push_str(&format!(
            "<polyline class=\"mean {way}\" points=\"{}\"/>",
            points(&x, &y, own.iter().map(|c| (c.at, c.mean)))
        ));
    }
    frame(&x, &y, names, &content)
}

/// Horizontal bars with labels and figures; the largest fills the width.
pub(crate) fn bars(rows: &[(String, f64, String)], name: &str) -> Markup {
    let largest = rows.iter().map(|r| r.1).fold(1e-300, f64::max);
    let height = 26 * rows.len();
    html! {
        svg class="bars" viewBox=(format!("0 0 640 {height}")) role="img" aria-label=(name) {
            @for (i, (name, x, text)) in rows.iter().enumerate() {
                text x="0" y=(i * 26 + 17) { (name) }
                rect x="150" y=(i * 26 + 5) height="15" rx="3" width=(format!("{:.1}", 200.0 * x / largest)) {}
                text x=(format!("{:.1}", 158.0 + 200.0 * x / largest)) y=(i * 26 + 17) { (text) }
            }
        }
    }
}
