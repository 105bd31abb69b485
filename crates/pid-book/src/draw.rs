//! A view as an SVG file that stands alone.

use pid_page::{Axis, Ink, Plot, Range};

use crate::curves::{Curve, View};

/// Colours and sizes; a page has them in its style sheet.
const STYLE: &str = "<style>text{font:11.5px system-ui,sans-serif;fill:#2b3440}\
    .line{fill:none;stroke-width:2}.grid{stroke:#e3e7ed}.zero{stroke:#b4bcc8}\
    .simulated{stroke:#d9480f}.stated{stroke:#5a6473;stroke-dasharray:5 4}</style>\
    <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>";

fn ink(curve: &Curve) -> Ink {
    match curve.without {
        true => Ink::Stated,
        false => Ink::Simulated,
    }
}

/// The drawing of a view with its legend in a line above.
pub(crate) fn svg(view: &View) -> String {
    let points = || view.curves.iter().flat_map(|c| &c.points);
    let x = Range::of(points().map(|p| p.0)).span(0.0);
    let y = Range::of(points().map(|p| p.1)).span(0.08);
    let mut plot = Plot::new(
        view.what,
        Axis::new(view.x.0, view.x.1, x),
        Axis::new(view.y.0, view.y.1, y),
    );
    for curve in &view.curves {
        plot.line(ink(curve), curve.points.iter().copied());
    }
    let (mut legend, mut left) = (String::new(), 68.0);
    for curve in &view.curves {
        let entry = maud::html! {
            line class={ "line " (if curve.without { "stated" } else { "simulated" }) } x1=(left) x2=(left + 22.0) y1="12" y2="12" {}
            text x=(left + 28.0) y="16" { (curve.name) }
        };
        legend.push_str(&entry.into_string());
        left += 48.0 + 6.2 * curve.name.chars().count() as f64;
    }
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"705\" height=\"375\" viewBox=\"0 0 470 250\">{STYLE}{legend}\
         <g transform=\"translate(0 24)\">{}</g></svg>\n",
        // The inner drawing keeps its own size.
        plot.draw().into_string().replacen(
            "<svg class=\"plot\"",
            "<svg class=\"plot\" width=\"470\" height=\"226\"",
            1
        )
    )
}
