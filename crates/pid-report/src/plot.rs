//! Plots as inline SVG. They are drawn by `plotters` at four times their size, because its coordinates are whole numbers, and scaled
//! down by the view box; colours are stand-ins that become CSS variables, so that a page can be light or dark.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::{Direction, ForceBin, Trace};

/// Enlargement while drawing.
const S: i32 = 4;
/// Drawn width of a plot, in CSS pixels.
const WIDTH: i32 = 470;
/// Drawn height.
const HEIGHT: i32 = 210;

/// A colour of the page: the stand-in for drawing and the name of its CSS variable.
#[derive(Debug, Clone, Copy)]
struct Ink {
    stand_in: RGBColor,
    variable: &'static str,
}

const TEXT: Ink = Ink {
    stand_in: RGBColor(1, 2, 1),
    variable: "--text-2",
};
const AXIS: Ink = Ink {
    stand_in: RGBColor(1, 2, 2),
    variable: "--axis",
};
const GRID: Ink = Ink {
    stand_in: RGBColor(1, 2, 3),
    variable: "--grid",
};
const MEASURED: Ink = Ink {
    stand_in: RGBColor(1, 2, 4),
    variable: "--measured",
};
const SIMULATED: Ink = Ink {
    stand_in: RGBColor(1, 2, 5),
    variable: "--simulated",
};
const FORCE: Ink = Ink {
    stand_in: RGBColor(1, 2, 6),
    variable: "--force",
};
const FORWARD: Ink = Ink {
    stand_in: RGBColor(1, 2, 7),
    variable: "--forward",
};
const BACKWARD: Ink = Ink {
    stand_in: RGBColor(1, 2, 8),
    variable: "--backward",
};
const PALETTE: [Ink; 8] = [
    TEXT, AXIS, GRID, MEASURED, SIMULATED, FORCE, FORWARD, BACKWARD,
];

/// Labels of a plot's axes, with units.
pub(super) struct Axes<'a> {
    pub(super) x: &'a str,
    pub(super) y: &'a str,
}

/// Measured against simulated curve over time.
pub(super) fn compare(axes: &Axes<'_>, measured: Option<&Trace>, simulated: &Trace) -> String {
    let mut x = Range::default();
    let mut y = Range::default();
    for trace in measured.into_iter().chain([simulated]) {
        x.cover(trace.x.iter().copied());
        y.cover(trace.y.iter().flatten().copied());
    }
    // A diverging simulation must not flatten the record: the record decides where there is one.
    if let Some(measured) = measured {
        let mut record = Range::default();
        record.cover(measured.y.iter().flatten().copied());
        y = y.within(&record, 0.6);
    }
    draw(axes, x.span(0.0), y.span(0.06), &|chart| {
        if let Some(measured) = measured {
            lines(chart, measured, MEASURED, 2.6)?;
        }
        lines(chart, simulated, SIMULATED, 1.5)
    })
}

/// Missing force over time; the band around zero is two of its standard deviations wide to either side.
pub(super) fn force_over_time(axes: &Axes<'_>, w: &Trace, band: Option<&Trace>) -> String {
    let mut x = Range::default();
    let mut y = Range::default();
    x.cover(w.x.iter().copied());
    y.cover_most(w.y.iter().flatten().copied());
    y.cover([0.0]);
    draw(axes, x.span(0.0), y.span(0.06), &|chart| {
        if let Some(band) = band {
            let top = chart.y_range().end.min(-chart.y_range().start);
            let upper: Vec<(f64, f64)> = band
                .x
                .iter()
                .zip(&band.y)
                .filter_map(|(x, b)| b.map(|b| (*x, b.min(top))))
                .collect();
            let mut outline = upper.clone();
            outline.extend(upper.iter().rev().map(|(x, b)| (*x, -b)));
            if upper.len() > 1 {
                chart
                    .draw_series([Polygon::new(outline, MEASURED.stand_in.mix(0.22))])
                    .map_err(drop)?;
            }
        }
        lines(chart, w, FORCE, 1.3)
    })
}

/// Missing force against velocity (`axis` 1) or position (`axis` 0), coloured by the direction of motion, with class means.
pub(super) fn scatter(
    axes: &Axes<'_>,
    samples: &[[f64; 3]],
    axis: usize,
    bins: &[ForceBin],
) -> String {
    let mut x = Range::default();
    let mut y = Range::default();
    x.cover_most(samples.iter().map(|s| s[axis]));
    y.cover_most(samples.iter().map(|s| s[2]));
    y.cover([0.0]);
    let (x, y) = (x.span(0.03), y.span(0.06));
    draw(axes, x.clone(), y.clone(), &|chart| {
        for (ink, forward) in [(FORWARD, true), (BACKWARD, false)] {
            let dots = samples
                .iter()
                .filter(|s| (s[1] > 0.0) == forward && x.contains(&s[axis]) && y.contains(&s[2]))
                .map(|s| Circle::new((s[axis], s[2]), S * 3 / 2, ink.stand_in.mix(0.3).filled()));
            chart.draw_series(dots).map_err(drop)?;
        }
        for (ink, direction) in [
            (FORWARD, Direction::Forward),
            (BACKWARD, Direction::Backward),
        ] {
            let own: Vec<&ForceBin> = bins.iter().filter(|b| b.direction == direction).collect();
            for b in &own {
                let inside = |w: f64| (b.at, w.clamp(y.start, y.end));
                let bar = [inside(b.mean - b.spread), inside(b.mean + b.spread)];
                chart
                    .draw_series(LineSeries::new(bar, ink.stand_in.stroke_width(width(1.2))))
                    .map_err(drop)?;
            }
            let means = own.iter().map(|b| (b.at, b.mean));
            chart
                .draw_series(LineSeries::new(
                    means.clone(),
                    ink.stand_in.stroke_width(width(2.2)),
                ))
                .map_err(drop)?;
            chart
                .draw_series(means.map(|m| Circle::new(m, S * 3, ink.stand_in.filled())))
                .map_err(drop)?;
        }
        Ok(())
    })
}

type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

/// Draws frame, grid and content; an empty string if plotters refuses.
fn draw(
    axes: &Axes<'_>,
    x: std::ops::Range<f64>,
    y: std::ops::Range<f64>,
    content: &dyn Fn(&mut Chart<'_, '_>) -> Result<(), ()>,
) -> String {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, ((WIDTH * S) as u32, (HEIGHT * S) as u32))
            .into_drawing_area();
        if frame(&area, axes, x, y, content).is_err() {
            return String::new();
        }
    }
    for ink in PALETTE {
        let RGBColor(r, g, b) = ink.stand_in;
        svg = svg.replace(
            &format!("\"#{r:02X}{g:02X}{b:02X}\""),
            &format!("\"var({})\"", ink.variable),
        );
    }
    let size = format!("width=\"{}\" height=\"{}\" ", WIDTH * S, HEIGHT * S);
    let label = format!(
        "class=\"plot\" role=\"img\" aria-label=\"{} over {}\" ",
        escape(axes.y),
        escape(axes.x)
    );
    svg.replacen(&size, &label, 1)
        .replace("opacity=\"1\" ", "")
        .replace('\n', "")
}

fn frame(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    axes: &Axes<'_>,
    x: std::ops::Range<f64>,
    y: std::ops::Range<f64>,
    content: &dyn Fn(&mut Chart<'_, '_>) -> Result<(), ()>,
) -> Result<(), ()> {
    let font = |size: f64, ink: Ink| {
        ("sans-serif", size * f64::from(S))
            .into_font()
            .color(&ink.stand_in)
    };
    let mut chart = ChartBuilder::on(area)
        .margin_top(8 * S)
        .margin_right(14 * S)
        .margin_left(2 * S)
        .margin_bottom(2 * S)
        .x_label_area_size(32 * S)
        .y_label_area_size(60 * S)
        .build_cartesian_2d(x, y.clone())
        .map_err(drop)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(7)
        .y_labels(6)
        .max_light_lines(0)
        .bold_line_style(GRID.stand_in.stroke_width(S as u32))
        .axis_style(AXIS.stand_in.stroke_width(S as u32))
        .label_style(font(11.0, TEXT))
        .axis_desc_style(font(11.5, TEXT))
        .x_label_formatter(&|v| tick(*v))
        .y_label_formatter(&|v| tick(*v))
        .x_desc(axes.x)
        .y_desc(axes.y)
        .draw()
        .map_err(drop)?;
    if y.contains(&0.0) {
        let range = chart.x_range();
        let zero = [(range.start, 0.0), (range.end, 0.0)];
        chart
            .draw_series(LineSeries::new(zero, AXIS.stand_in.stroke_width(S as u32)))
            .map_err(drop)?;
    }
    content(&mut chart)?;
    area.present().map_err(drop)
}

/// A curve, interrupted where it is.
fn lines(chart: &mut Chart<'_, '_>, trace: &Trace, ink: Ink, pixels: f64) -> Result<(), ()> {
    let mut piece: Vec<(f64, f64)> = Vec::new();
    let values = trace
        .x
        .iter()
        .zip(&trace.y)
        .map(|(x, y)| y.map(|y| (*x, y)));
    for point in values.chain([None]) {
        match point {
            Some(point) => piece.push(point),
            None if piece.len() > 1 => {
                let style = ink.stand_in.stroke_width(width(pixels));
                chart
                    .draw_series(LineSeries::new(piece.drain(..), style))
                    .map_err(drop)?;
            }
            None => piece.clear(),
        }
    }
    Ok(())
}

fn width(pixels: f64) -> u32 {
    (pixels * f64::from(S)).round() as u32
}

/// A tick label: up to six significant digits, a true minus sign.
fn tick(v: f64) -> String {
    let text = if v == 0.0 || (v.abs() < 1e-12) {
        "0".to_owned()
    } else if v.abs() >= 1e5 || v.abs() < 1e-4 {
        format!("{v:.1e}")
    } else {
        let digits = (5.0 - v.abs().log10().floor()).clamp(0.0, 9.0) as usize;
        let text = format!("{v:.digits$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    };
    text.replace('-', "\u{2212}")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// Smallest and largest value seen.
#[derive(Clone, Copy)]
struct Range {
    low: f64,
    high: f64,
}

impl Default for Range {
    fn default() -> Self {
        Range {
            low: f64::INFINITY,
            high: f64::NEG_INFINITY,
        }
    }
}

impl Range {
    fn cover(&mut self, values: impl IntoIterator<Item = f64>) {
        for v in values.into_iter().filter(|v| v.is_finite()) {
            self.low = self.low.min(v);
            self.high = self.high.max(v);
        }
    }

    /// All but the outermost half percent on either side, with half as much room again: single spikes must not flatten the rest.
    fn cover_most(&mut self, values: impl IntoIterator<Item = f64>) {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (Some(&least), Some(&most)) = (sorted.first(), sorted.last()) else {
            return;
        };
        let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
        let (low, high) = (at(0.005), at(0.995));
        let room = 0.5 * (high - low);
        self.cover([least.max(low - room), most.min(high + room)]);
    }

    /// Limited to another range, widened by a share of it.
    fn within(self, other: &Range, share: f64) -> Range {
        let room = share * (other.high - other.low);
        if room.is_finite() && room > 0.0 {
            Range {
                low: self.low.max(other.low - room),
                high: self.high.min(other.high + room),
            }
        } else {
            self
        }
    }

    /// The range with a margin; never empty.
    fn span(self, margin: f64) -> std::ops::Range<f64> {
        if self.low > self.high {
            return 0.0..1.0;
        }
        let size = self.high - self.low;
        if size <= 1e-12 * self.low.abs().max(1e-9) {
            let room = 0.5 * self.low.abs().max(1e-3);
            return self.low - room..self.high + room;
        }
        self.low - margin * size..self.high + margin * size
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_short_and_true() {
        let cases = [
            (0.0, "0"),
            (0.25, "0.25"),
            (-1.5, "\u{2212}1.5"),
            (1200.0, "1200"),
            (0.30000000000000004, "0.3"),
            (2.5e-6, "2.5e\u{2212}6"),
            (100.0, "100"),
        ];
        for (v, expected) in cases {
            assert_eq!(tick(v), expected);
        }
    }

    #[test]
    fn plots_use_the_colours_of_the_page_and_escape_labels() {
        let trace = Trace {
            x: vec![0.0, 1.0, 2.0, 3.0],
            y: vec![Some(0.0), Some(1.0), None, Some(2.0)],
        };
        let svg = compare(
            &Axes {
                x: "time, s",
                y: "<b> & \"q\"",
            },
            Some(&trace),
            &trace,
        );
        assert!(svg.starts_with("<svg class=\"plot\""), "{}", &svg[..80]);
        assert!(svg.contains("var(--measured)") && svg.contains("var(--simulated)"));
        assert!(!svg.contains("<b>") && !svg.contains("#0102"), "{svg}");
        assert!(svg.contains("time, s"));
    }

    #[test]
    fn empty_and_constant_curves_can_be_drawn() {
        let axes = Axes { x: "t", y: "q" };
        let constant = Trace {
            x: vec![0.0, 1.0],
            y: vec![Some(3.0); 2],
        };
        for trace in [Trace::default(), constant] {
            assert!(compare(&axes, None, &trace).contains("</svg>"));
            assert!(force_over_time(&axes, &trace, Some(&trace)).contains("</svg>"));
        }
        assert!(scatter(&axes, &[], 1, &[]).contains("</svg>"));
    }
}
