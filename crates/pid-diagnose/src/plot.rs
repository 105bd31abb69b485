//! The plots of a diagnosis.

use maud::Markup;
use pid_page::{Axis, Ink, Plot, Range};

use crate::diagnosis::Nameless;
use crate::locate::{Class, Curve, Sample};
use crate::timing::Alignment;

/// A quantity and its unit.
pub(crate) type Quantity<'a> = (&'a str, &'a str);

fn axis((quantity, unit): Quantity<'_>, ends: (f64, f64)) -> Axis {
    Axis::new(quantity, unit, ends)
}

/// Missing force over time with its band about zero.
pub(crate) fn over_time(curve: &Curve, joint: &str, unit: &str) -> Markup {
    let x = Range::of(curve.t.iter().copied());
    let mut y = Range::of_most(curve.w.iter().copied());
    let band = Range::of_most(curve.band.iter().copied()).span(0.0);
    y.cover([0.0]);
    if !curve.band.is_empty() {
        y.cover([-band.0, band.0]);
    }
    let mut plot = Plot::new(
        &format!("Missing force on {joint} over time, {}", curve.record),
        axis(("time", "s"), x.span(0.0)),
        axis(("missing force", unit), y.span(0.08)),
    );
    let both = curve.t.iter().zip(&curve.band);
    let edges: Vec<(f64, f64, f64)> = both.map(|(t, b)| (*t, -b, *b)).collect();
    plot.band(&edges);
    plot.line(
        Ink::Force,
        curve.t.iter().copied().zip(curve.w.iter().copied()),
    );
    plot.draw()
}

/// What shifts of a channel leave, the best shift with two deviations, the stated one. `what` is
/// "input" or "velocity".
pub(crate) fn alignment(a: &Alignment, joint: &str, what: &str) -> Markup {
    let points = || a.curve.iter().map(|(t, x)| (1e3 * t, 100.0 * x));
    let x = Range::of(points().map(|p| p.0));
    let mut y = Range::of(points().map(|p| p.1));
    y.cover([0.0]);
    let mut plot = Plot::new(
        &format!("What a shift of the {what} of {joint} leaves unexplained"),
        axis(("shift", "ms"), x.span(0.0)),
        axis((&format!("left of the {what}"), "%"), y.span(0.04)),
    );
    if let Some(std) = a.std {
        let edge = |sign: f64| 1e3 * (a.delay + sign * 2.0 * std);
        plot.span((edge(-1.0), edge(1.0)));
    }
    plot.line(Ink::Force, points());
    plot.upright(Ink::Stated, 1e3 * a.stated);
    plot.draw()
}

/// A free law with its band, straight between its marks.
pub(crate) fn free_law(law: &Nameless, joint: &str, x: Quantity<'_>, y: Quantity<'_>) -> Markup {
    let all = || law.at.iter().copied().zip(law.values.iter().copied());
    let edges: Vec<(f64, f64, f64)> = all()
        .zip(&law.stds)
        .filter_map(|((q, f), std)| {
            let half = 2.0 * (*std)?;
            Some((q, f - half, f + half))
        })
        .collect();
    let mut range = Range::of(all().map(|(_, f)| f));
    range.cover(edges.iter().flat_map(|&(_, low, high)| [low, high]));
    range.cover([0.0]);
    let along = Range::of(law.at.iter().copied());
    let mut plot = Plot::new(
        &format!("Free law of joint {joint}: {} against {}", y.0, x.0),
        axis(x, along.span(0.03)),
        axis(y, range.span(0.06)),
    );
    plot.band(&edges);
    plot.line(Ink::Force, all());
    plot.marks(Ink::Force, all());
    plot.draw()
}

/// Missing force against a quantity: samples, class means and spreads, coloured by direction.
pub(crate) fn against(
    samples: &[Sample],
    classes: &[Class],
    of: usize,
    joint: &str,
    (x, y): (Quantity<'_>, Quantity<'_>),
) -> Markup {
    let along = Range::of_most(samples.iter().map(|s| s.x[of]));
    let mut range = Range::of_most(samples.iter().map(|s| s.w));
    range.cover([0.0]);
    let mut plot = Plot::new(
        &format!("{} on {joint} against {}", y.0, x.0),
        axis(x, along.span(0.03)),
        axis(y, range.span(0.06)),
    );
    for (ink, forward) in [(Ink::Forward, true), (Ink::Backward, false)] {
        let own = samples.iter().filter(|s| s.forward == forward);
        plot.cloud(ink, own.map(|s| (s.x[of], s.w)));
    }
    for (ink, forward) in [(Ink::Forward, true), (Ink::Backward, false)] {
        let own = || classes.iter().filter(|c| c.forward == forward);
        for c in own() {
            plot.interval(ink, c.at, (c.mean - c.spread, c.mean + c.spread));
        }
        plot.line(ink, own().map(|c| (c.at, c.mean)));
        plot.marks(ink, own().map(|c| (c.at, c.mean)));
    }
    plot.draw()
}
