//! Line and point charts of the study.

use maud::{Markup, html};
use pid_page::{Axis, Ink, Legend, Plot, Range, legend};

/// Points of one series.
pub(super) struct Series {
    pub(super) label: String,
    pub(super) points: Vec<(f64, f64)>,
    /// Drawn as a line, otherwise as dots.
    pub(super) line: bool,
}

/// Curve of one joint over time, out of values with `stride` a sample; thinned to every `every`-th.
pub(super) fn curve(
    label: impl Into<String>,
    t: &[f64],
    values: &[f64],
    (joint, stride): (usize, usize),
    every: usize,
) -> Series {
    let values = values.iter().skip(joint).step_by(stride);
    let points = t.iter().zip(values).step_by(every);
    Series {
        label: label.into(),
        points: points.map(|(t, q)| (*t, *q)).collect(),
        line: true,
    }
}

/// Curves of one joint's angle over time.
pub(super) fn joint_chart(record: &str, joint: usize, series: &[Series]) -> Markup {
    let axes = Axes {
        title: &format!("Angle of joint {} over time, {record}", joint + 1),
        x: ("time", "s"),
        y: (&format!("θ{}", joint + 1), "rad"),
        log: false,
    };
    chart(&axes, series)
}

/// What a chart shows, quantity and unit of its axes, and whether both count in powers of ten.
pub(super) struct Axes<'a> {
    pub(super) title: &'a str,
    pub(super) x: (&'a str, &'a str),
    pub(super) y: (&'a str, &'a str),
    pub(super) log: bool,
}

/// The chart with its legend; empty if there is nothing to draw.
pub(super) fn chart(axes: &Axes<'_>, series: &[Series]) -> Markup {
    let shown = |p: &(f64, f64)| {
        p.0.is_finite() && p.1.is_finite() && (!axes.log || (p.0 > 0.0 && p.1 > 0.0))
    };
    let all: Vec<(f64, f64)> = series
        .iter()
        .flat_map(|s| s.points.iter().filter(|p| shown(p)).copied())
        .collect();
    if all.is_empty() {
        return html! {};
    }
    let axis = |(quantity, unit): (&str, &str), of: fn(&(f64, f64)) -> f64| match axes.log {
        true => {
            let (low, high) = Range::of(all.iter().map(|p| of(p).log10())).span(0.04);
            Axis::log(quantity, unit, (10f64.powf(low), 10f64.powf(high)))
        }
        false => Axis::new(quantity, unit, Range::of(all.iter().map(of)).span(0.04)),
    };
    let mut plot = Plot::new(axes.title, axis(axes.x, |p| p.0), axis(axes.y, |p| p.1)).wide();
    let mut entries = Vec::new();
    for (k, s) in series.iter().enumerate() {
        let ink = Ink::Series(k);
        let points = s.points.iter().filter(|p| shown(p)).copied();
        if s.line {
            plot.line(ink, points);
            entries.push(Legend::Line(ink, &s.label));
        } else {
            plot.marks(ink, points);
            entries.push(Legend::Dot(ink, &s.label));
        }
    }
    html! { (legend(&entries)) div.full { figure { (plot.draw()) } } }
}
