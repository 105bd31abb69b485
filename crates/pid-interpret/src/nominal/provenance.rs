//! How far the figures of a robot file are trusted, by where they come from.

use pid_derive::mechanism::{Body, InertiaSource};
use pid_derive::plausible::principal_moments;

use super::assemble::Value;

/// Where masses and inertias of a robot file come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Provenance {
    /// A CAD model: volumes are exact, but cables, screws, grease and the inside of bought parts are
    /// not drawn.
    #[default]
    Cad,
    /// A data sheet, or a description whose origin is unknown: figures are rounded, and centres of
    /// mass and inertias are often those of simple shapes.
    DataSheet,
    /// A guess, from geometry and density for example: right within a factor of two.
    Guessed,
}

/// Tolerances of one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shares {
    /// Of the mass, as a share of it.
    pub mass: f64,
    /// Of each component of the centre of mass, m.
    pub com: f64,
    /// Of the centre of mass besides, as a share of the radius of gyration of the body.
    pub com_of_radius: f64,
    /// Of each entry of the inertia, as a share of the largest principal moment.
    pub inertia: f64,
}

/// Of an inertia that no body has: it is wrong by about its own size.
const CORRECTED: f64 = 0.5;
/// A part whose mass no file states is light: at most this share of the whole robot.
const LIGHT: f64 = 0.01;
/// Such a part has its mass within this distance of its origin, m.
const LIGHT_RADIUS: f64 = 0.05;
/// Its start value, as a share of the robot: below what any record resolves, and still a body.
const LIGHTEST: f64 = 1e-6;

impl Provenance {
    /// The tolerances of this class.
    pub fn shares(self) -> Shares {
        match self {
            // Cables, connectors and screws make a few per cent of a link and sit at its surface.
            Self::Cad => Shares {
                mass: 0.05,
                com: 0.005,
                com_of_radius: 0.0,
                inertia: 0.1,
            },
            // Published and identified masses of the same arm differ by up to a fifth.
            Self::DataSheet => Shares {
                mass: 0.2,
                com: 0.01,
                com_of_radius: 0.0,
                inertia: 0.3,
            },
            // From nothing to twice as much; a factor of two upwards, and more downwards.
            Self::Guessed => Shares {
                mass: 1.0,
                com: 0.01,
                com_of_radius: 0.5,
                inertia: 1.0,
            },
        }
    }
}

/// Mass, centre of mass and inertia with their tolerances.
pub(super) struct Inertials {
    pub(super) mass: Value,
    pub(super) com: [Value; 3],
    pub(super) inertia: [Value; 6],
}

impl Inertials {
    /// Of a body of a robot with this total mass. A body without mass becomes a light one.
    pub(super) fn new(body: &Body, class: Provenance, total: f64) -> Self {
        let class = match body.source {
            InertiaSource::Guessed => Provenance::Guessed,
            _ => class,
        };
        let shares = class.shares();
        let largest = principal_moments(body.inertia)[0].abs();
        if body.mass <= 0.0 {
            return Self::light(body, shares, total);
        }
        // Half the trace is the moment about the point, Σ m r².
        let trace: f64 = body.inertia[..3].iter().sum();
        let radius = (0.5 * trace.max(0.0) / body.mass).sqrt();
        let inertia = match body.source {
            InertiaSource::Corrected => shares.inertia.max(CORRECTED),
            _ => shares.inertia,
        };
        let value = |half_width: f64| {
            move |nominal: f64| Value {
                nominal,
                half_width,
            }
        };
        Self {
            mass: value(shares.mass * body.mass)(body.mass),
            com: body
                .com
                .map(value(shares.com + shares.com_of_radius * radius)),
            inertia: body.inertia.map(value(inertia * largest)),
        }
    }

    fn light(body: &Body, shares: Shares, total: f64) -> Self {
        let mass = Value {
            nominal: LIGHTEST * total,
            half_width: LIGHT * total,
        };
        let square = LIGHT_RADIUS * LIGHT_RADIUS;
        // A sphere of that radius, or the inertia that is stated without a mass.
        let sphere = 0.4 * mass.nominal * square;
        let stated = body.inertia != [0.0; 6];
        let largest = principal_moments(body.inertia)[0].abs();
        let inertia = std::array::from_fn(|k| Value {
            nominal: match (stated, k) {
                (true, _) => body.inertia[k],
                (false, 0..3) => sphere,
                (false, _) => 0.0,
            },
            half_width: mass.half_width * square + shares.inertia * largest,
        });
        Self {
            mass,
            com: body.com.map(|nominal| Value {
                nominal,
                half_width: LIGHT_RADIUS,
            }),
            inertia,
        }
    }
}
