//! Something pushes the tool: a force on the tool point, fixed in base axes, on within time windows.
//!
//! Source: A. De Luca, R. Mattone, IEEE ICRA 2005.

use crate::effect::{Class, Info, Kind, Law, Model, Quantity, Unit, parameter, quantity};
use crate::scalar::Scalar;

/// A time after every record, s: the end of a force that lasts, and the place of windows that are not used.
const NEVER: f64 = 100_000.0;

/// Something pushes the tool.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExternalForce;

static INFO: Info = Info {
    id: "external_force",
    title: "Something pushes the tool",
    equation: "a force on the tool point, fixed in base axes, on within time windows",
    source: "A. De Luca, R. Mattone, IEEE ICRA 2005",
    kind: Kind::Force,
    class: Class::Time,
    has_joint: false,
    parameters: &[
        parameter("force_x", "N", Unit::Force, -20.0, 20.0),
        parameter("force_y", "N", Unit::Force, -20.0, 20.0),
        parameter("force_z", "N", Unit::Force, -20.0, 20.0),
        parameter("on_1_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("off_1_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("on_2_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("off_2_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("on_3_s", "s", Unit::Time, -1000.0, 1000000.0),
        parameter("off_3_s", "s", Unit::Time, -1000.0, 1000000.0),
    ],
    starts: &[&[
        0.02,
        0.0,
        0.02,
        0.0,
        NEVER,
        2.0 * NEVER,
        2.0 * NEVER,
        2.0 * NEVER,
        2.0 * NEVER,
    ]],
    amplitudes: &[0, 1, 2],
    confusions: &[
        (
            "base_tilt",
            "a constant force on a single body adds to gravity",
        ),
        (
            "payload",
            "a constant downward force is a weight without inertia",
        ),
        (
            "gravity_feed_forward",
            "on one joint a drive that makes up for gravity is an upward force that lasts",
        ),
    ],
    regime: "the time windows",
    equals: &[],
    mujoco: Some("xfrc_applied"),
    isaac: Some(
        "permanent_wrench_composer of the articulation; set_external_force_and_torque before Isaac Lab 2.3",
    ),
    urdf: None,
};

impl Model for ExternalForce {
    fn info(&self) -> &'static Info {
        &INFO
    }
    fn needs_bodies(&self) -> bool {
        true
    }
    fn edges(&self) -> &'static [usize] {
        &[3, 4, 5, 6, 7, 8]
    }
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        let names = INFO.parameters.iter().map(|p| p.name);
        let mut all = names.zip(e).map(|(name, &x)| (name, x));
        let forces = all.by_ref().take(3).map(|(name, x)| quantity(name, "N", x));
        let mut out: Vec<Quantity> = forces.collect();
        let edges: Vec<_> = all.collect();
        for window in edges.chunks_exact(2) {
            let [(on, from), (off, to)] = [window[0], window[1]];
            if to <= from || from >= NEVER {
                continue;
            }
            // What is on before the record begins, or goes on after it, has no such edge.
            let begins = (from > 0.0).then(|| quantity(on, "s", from));
            let ends = (to < NEVER).then(|| quantity(off, "s", to));
            out.extend(begins.into_iter().chain(ends));
        }
        out
    }
}

impl<D: Scalar> Law<D> for ExternalForce {
    fn tip_force(&self, e: &[D], t: f64, dt: f64) -> Option<[D; 3]> {
        let end = t + dt;
        let mut share = D::nil();
        for w in e[3..9].chunks_exact(2) {
            if w[1].value() <= t || w[0].value() >= end {
                continue;
            }
            let from = if w[0].value() > t {
                w[0]
            } else {
                D::constant(t)
            };
            let to = if w[1].value() < end {
                w[1]
            } else {
                D::constant(end)
            };
            share += (to - from) / dt;
        }
        Some([e[0] * share, e[1] * share, e[2] * share])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_edges_that_are_there_are_shown() {
        let names = |e: [f64; 9]| -> Vec<&'static str> {
            let shown = ExternalForce.shown(&e, 1.0, 1.0);
            shown.iter().skip(3).map(|q| q.name).collect()
        };
        let far = 2.0 * NEVER;
        let lasting = [1.0, 0.0, 2.0, 0.0, NEVER, far, far, far, far];
        assert!(names(lasting).is_empty());
        let twice = [1.0, 0.0, 2.0, -1.0, 0.7, 1.5, 2.5, far, far];
        assert_eq!(names(twice), ["off_1_s", "on_2_s", "off_2_s"]);
        let until_the_end = [1.0, 0.0, 2.0, 0.4, NEVER, far, far, far, far];
        assert_eq!(names(until_the_end), ["on_1_s"]);
    }
}
