//! Line and point charts as inline SVG.

use plotters::prelude::*;

/// Points of one series; `None` interrupts its line.
pub(super) struct Series {
    pub(super) label: String,
    pub(super) points: Vec<Option<(f64, f64)>>,
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
        points: points.map(|(t, q)| Some((*t, *q))).collect(),
        line: true,
    }
}

/// Curves of one joint's angle over time.
pub(super) fn joint_chart(joint: usize, series: &[Series]) -> String {
    let axes = Axes {
        x: "time, s",
        y: &format!("θ{}, rad", joint + 1),
        log_x: false,
        log_y: false,
    };
    chart(&axes, series)
}

/// What the axes are called and how they count.
pub(super) struct Axes<'a> {
    pub(super) x: &'a str,
    pub(super) y: &'a str,
    pub(super) log_x: bool,
    pub(super) log_y: bool,
}

const SIZE: (u32, u32) = (760, 340);
const COLOURS: [RGBColor; 6] = [
    RGBColor(31, 95, 168),
    RGBColor(200, 85, 30),
    RGBColor(40, 140, 80),
    RGBColor(140, 70, 150),
    RGBColor(150, 120, 20),
    RGBColor(90, 90, 90),
];

/// The chart; empty if there is nothing to draw.
pub(super) fn chart(axes: &Axes<'_>, series: &[Series]) -> String {
    let scale = |(x, y): (f64, f64)| {
        let log = |v: f64, on: bool| if on { v.log10() } else { v };
        let point = (log(x, axes.log_x), log(y, axes.log_y));
        (point.0.is_finite() && point.1.is_finite()).then_some(point)
    };
    let scaled: Vec<Vec<Option<(f64, f64)>>> = series
        .iter()
        .map(|s| s.points.iter().map(|p| p.and_then(scale)).collect())
        .collect();
    let all: Vec<(f64, f64)> = scaled.iter().flatten().flatten().copied().collect();
    if all.is_empty() {
        return String::new();
    }
    let range = |of: fn(&(f64, f64)) -> f64| {
        let low = all.iter().map(of).fold(f64::INFINITY, f64::min);
        let high = all.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
        let room = (0.04 * (high - low)).max(1e-6 * high.abs()).max(1e-9);
        low - room..high + room
    };
    let mut svg = String::new();
    let drawn = draw(
        &mut svg,
        axes,
        series,
        &scaled,
        range(|p| p.0),
        range(|p| p.1),
    );
    if drawn.is_none() {
        return String::new();
    }
    svg
}

fn draw(
    svg: &mut String,
    axes: &Axes<'_>,
    series: &[Series],
    scaled: &[Vec<Option<(f64, f64)>>],
    x: std::ops::Range<f64>,
    y: std::ops::Range<f64>,
) -> Option<()> {
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    let mut chart = ChartBuilder::on(&area)
        .margin(10)
        .x_label_area_size(38)
        .y_label_area_size(66)
        .build_cartesian_2d(x, y)
        .ok()?;
    let tick = |log: bool| {
        move |v: &f64| {
            if log {
                power(*v)
            } else {
                format!("{v:.4}")
                    .trim_end_matches('0')
                    .trim_end_matches('.')
                    .to_owned()
            }
        }
    };
    let (format_x, format_y) = (tick(axes.log_x), tick(axes.log_y));
    chart
        .configure_mesh()
        .x_desc(axes.x)
        .y_desc(axes.y)
        .x_label_formatter(&format_x)
        .y_label_formatter(&format_y)
        .light_line_style(TRANSPARENT)
        .draw()
        .ok()?;
    for (k, (s, points)) in series.iter().zip(scaled).enumerate() {
        let colour = COLOURS[k % COLOURS.len()];
        let drawn = if s.line {
            let mut first = true;
            for part in points.split(Option::is_none).filter(|p| !p.is_empty()) {
                let part: Vec<(f64, f64)> = part.iter().flatten().copied().collect();
                let line = LineSeries::new(part, colour.stroke_width(2));
                let drawn = chart.draw_series(line).ok()?;
                if first {
                    drawn
                        .label(&s.label)
                        .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour));
                    first = false;
                }
            }
            continue;
        } else {
            chart.draw_series(
                points
                    .iter()
                    .flatten()
                    .map(|&p| Circle::new(p, 3, colour.mix(0.7).filled())),
            )
        };
        drawn
            .ok()?
            .label(&s.label)
            .legend(move |(x, y)| Circle::new((x + 8, y), 3, colour.filled()));
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.2))
        .draw()
        .ok()?;
    area.present().ok()
}

/// 10^v in short.
fn power(v: f64) -> String {
    let value = 10f64.powf(v);
    if (1e-3..1e5).contains(&value) {
        format!("{value:.3}")
            .trim_end_matches('0')
            .trim_end_matches('.')
            .to_owned()
    } else {
        format!("{value:.0e}")
    }
}
