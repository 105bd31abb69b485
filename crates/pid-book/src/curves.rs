//! Curves of a plot, its axes, and what it shows.

/// A quantity along an axis: its name and unit.
pub(crate) type Quantity = (&'static str, &'static str);

pub(crate) type Points = Vec<(f64, f64)>;

/// A curve with its name; the robot without the effect is drawn dashed.
pub(crate) struct Curve {
    pub(crate) name: &'static str,
    pub(crate) without: bool,
    pub(crate) points: Points,
}

/// What a plot shows.
pub(crate) struct View {
    pub(crate) what: &'static str,
    pub(crate) x: Quantity,
    pub(crate) y: Quantity,
    pub(crate) curves: Vec<Curve>,
}

pub(crate) const POSITION: Quantity = ("position", "rad");
pub(crate) const VELOCITY: Quantity = ("velocity", "rad/s");
pub(crate) const TIME: Quantity = ("time", "s");
/// Points of a curve.
pub(crate) const POINTS: usize = 241;

/// Points along an axis.
pub(crate) fn along(from: f64, to: f64) -> impl Iterator<Item = f64> {
    (0..POINTS).map(move |i| from + (to - from) * i as f64 / (POINTS - 1) as f64)
}

/// Curves without an effect and with it.
pub(crate) fn pair(without: Points, with: Points) -> Vec<Curve> {
    vec![
        Curve {
            name: "without the effect",
            without: true,
            points: without,
        },
        Curve {
            name: "with it",
            without: false,
            points: with,
        },
    ]
}
