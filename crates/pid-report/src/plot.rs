//! The plots of a report.

use maud::Markup;
use pid_page::{Axis, Ink, Plot, Range};

use super::{Direction, ForceBin, Trace};

/// Title and axes of a plot: what it shows, quantity and unit of either axis.
pub(super) struct Axes<'a> {
    pub(super) title: &'a str,
    pub(super) x: (&'a str, &'a str),
    pub(super) y: (&'a str, &'a str),
}

impl Axes<'_> {
    fn plot(&self, x: (f64, f64), y: (f64, f64)) -> Plot {
        let axis = |(quantity, unit), ends| Axis::new(quantity, unit, ends);
        Plot::new(self.title, axis(self.x, x), axis(self.y, y))
    }
}

/// Points of a trace; NaN where it is interrupted.
fn points(trace: &Trace) -> impl Iterator<Item = (f64, f64)> {
    let values = trace.y.iter().map(|y| y.unwrap_or(f64::NAN));
    trace.x.iter().copied().zip(values)
}

fn values(trace: &Trace) -> impl Iterator<Item = f64> {
    trace.y.iter().flatten().copied()
}

/// Measured against simulated curve over time.
pub(super) fn compare(axes: &Axes<'_>, measured: Option<&Trace>, simulated: &Trace) -> Markup {
    let mut x = Range::default();
    let mut y = Range::default();
    for trace in measured.into_iter().chain([simulated]) {
        x.cover(trace.x.iter().copied());
        y.cover(values(trace));
    }
    // A diverging simulation must not flatten the record: the record sets the range where there is
    // one.
    if let Some(measured) = measured {
        y = y.within(&Range::of(values(measured)), 0.6);
    }
    let mut plot = axes.plot(x.span(0.0), y.span(0.06));
    if let Some(measured) = measured {
        plot.line(Ink::Measured, points(measured));
    }
    plot.line(Ink::Simulated, points(simulated));
    plot.draw()
}

/// Missing force over time; the band around zero is two of its standard deviations wide to either side.
pub(super) fn force_over_time(axes: &Axes<'_>, w: &Trace, band: Option<&Trace>) -> Markup {
    let x = Range::of(w.x.iter().copied());
    let mut y = Range::of_most(values(w));
    y.cover([0.0]);
    let mut plot = axes.plot(x.span(0.0), y.span(0.06));
    if let Some(band) = band {
        let edges: Vec<(f64, f64, f64)> = points(band)
            .filter(|(_, b)| b.is_finite())
            .map(|(x, b)| (x, -b, b))
            .collect();
        plot.band(&edges);
    }
    plot.line(Ink::Force, points(w));
    plot.draw()
}

/// Missing force against velocity (`axis` 1) or position (`axis` 0), coloured by the direction of
/// motion, with class means.
pub(super) fn scatter(
    axes: &Axes<'_>,
    samples: &[[f64; 3]],
    axis: usize,
    bins: &[ForceBin],
) -> Markup {
    let x = Range::of_most(samples.iter().map(|s| s[axis]));
    let mut y = Range::of_most(samples.iter().map(|s| s[2]));
    y.cover([0.0]);
    let mut plot = axes.plot(x.span(0.03), y.span(0.06));
    for (ink, forward) in [(Ink::Forward, true), (Ink::Backward, false)] {
        let own = samples.iter().filter(|s| (s[1] > 0.0) == forward);
        plot.cloud(ink, own.map(|s| (s[axis], s[2])));
    }
    for (ink, direction) in [
        (Ink::Forward, Direction::Forward),
        (Ink::Backward, Direction::Backward),
    ] {
        let own = || bins.iter().filter(|b| b.direction == direction);
        for b in own() {
            plot.interval(ink, b.at, (b.mean - b.spread, b.mean + b.spread));
        }
        plot.line(ink, own().map(|b| (b.at, b.mean)));
        plot.marks(ink, own().map(|b| (b.at, b.mean)));
    }
    plot.draw()
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXES: Axes<'_> = Axes {
        title: "Position of <b> & \"q\"",
        x: ("time", "s"),
        y: ("position", "rad"),
    };

    #[test]
    fn a_gap_interrupts_a_curve() {
        let trace = Trace {
            x: vec![0.0, 1.0, 2.0, 3.0, 4.0],
            y: vec![Some(0.0), Some(1.0), None, Some(2.0), Some(1.0)],
        };
        let svg = compare(&AXES, Some(&trace), &trace).into_string();
        assert_eq!(svg.matches("class=\"line measured\"").count(), 2);
        assert_eq!(svg.matches("class=\"line simulated\"").count(), 2);
        assert!(!svg.contains("<b>"), "{svg}");
    }

    #[test]
    fn empty_and_constant_curves_can_be_drawn() {
        let constant = Trace {
            x: vec![0.0, 1.0],
            y: vec![Some(3.0); 2],
        };
        for trace in [Trace::default(), constant] {
            let plots = [
                compare(&AXES, None, &trace),
                force_over_time(&AXES, &trace, Some(&trace)),
                scatter(&AXES, &[], 1, &[]),
            ];
            for svg in plots.map(Markup::into_string) {
                assert!(svg.contains("time, s") && !svg.contains("NaN"), "{svg}");
            }
        }
    }
}
