//! Mass and inertia of geoms, filled with matter of one density.

use std::f64::consts::PI;

use pid_derive::mechanism::{Distribution, Place};

use crate::element::Element;
use crate::error::MjcfError;
use crate::mesh::Meshes;
use crate::place::{Angles, from_z, unit};

/// Density of a geom that states neither density nor mass, kg/m³: that of MuJoCo.
const DENSITY: f64 = 1000.0;

/// The mass distribution of a geom in the frame of its body; `None` for one without volume, such as a
/// plane, and words for one whose volume is not computed here.
pub(crate) fn filled(
    geom: &Element,
    angles: &Angles,
    meshes: &mut Meshes,
) -> Result<Result<Distribution, String>, MjcfError> {
    let mass = geom.number("mass")?;
    let density = geom.number("density")?.unwrap_or(DENSITY);
    if mass == Some(0.0) || (mass.is_none() && density == 0.0) {
        return Ok(Ok(Distribution::default()));
    }
    let (place, half) = placed(geom, angles)?;
    if let Some(name) = geom.get("mesh") {
        // A primitive that is fitted to a mesh is taken as the mesh.
        return Ok(meshes.filled(name).map(|unit| {
            let density = mass.map_or(density, |mass| mass / unit.mass);
            let own = Distribution {
                mass: density * unit.mass,
                inertia: unit.inertia.map(|x| density * x),
                ..unit
            };
            own.placed(&place)
        }));
    }
    let kind = geom.get("type").unwrap_or("sphere");
    let size = geom.list("size")?.unwrap_or_default();
    let at = |k: usize| -> Result<f64, MjcfError> {
        let found = size.get(k).copied().filter(|x| *x > 0.0);
        found.ok_or_else(|| geom.error("size", format!("a {kind} needs more positive sizes")))
    };
    let length = |k: usize| half.map_or_else(|| at(k), Ok);
    // Between two ends a geom is as wide across as it is in the first direction, whatever else is stated.
    let across = || at(usize::from(half.is_none()));
    // Volume, and moments of unit density about the centre.
    let (volume, moments) = match kind {
        "sphere" => {
            let r = at(0)?;
            let v = 4.0 / 3.0 * PI * r.powi(3);
            (v, [0.4 * v * r * r; 3])
        }
        "capsule" => capsule(at(0)?, length(1)?),
        "cylinder" => {
            let (r, h) = (at(0)?, length(1)?);
            let v = 2.0 * PI * r * r * h;
            let aside = v * (3.0 * r * r + 4.0 * h * h) / 12.0;
            (v, [aside, aside, 0.5 * v * r * r])
        }
        "ellipsoid" => {
            let [a, b, c] = [at(0)?, across()?, length(2)?];
            let v = 4.0 / 3.0 * PI * a * b * c;
            (
                v,
                [b * b + c * c, a * a + c * c, a * a + b * b].map(|x| 0.2 * v * x),
            )
        }
        "box" => {
            let [a, b, c] = [at(0)?, across()?, length(2)?];
            let v = 8.0 * a * b * c;
            (
                v,
                [b * b + c * c, a * a + c * c, a * a + b * b].map(|x| v * x / 3.0),
            )
        }
        "plane" | "hfield" => return Ok(Ok(Distribution::default())),
        "mesh" => return Ok(Err("a mesh without a name".to_owned())),
        "sdf" => return Ok(Err("a signed distance field".to_owned())),
        _ => return Err(geom.error("type", "use a type of geom of MuJoCo")),
    };
    let density = mass.map_or(density, |mass| mass / volume);
    let [xx, yy, zz] = moments.map(|x| density * x);
    let own = Distribution {
        mass: density * volume,
        com: [0.0; 3],
        inertia: [xx, yy, zz, 0.0, 0.0, 0.0],
    };
    Ok(Ok(own.placed(&place)))
}

/// A cylinder of half length h with half a ball at each end.
fn capsule(r: f64, h: f64) -> (f64, [f64; 3]) {
    let (cylinder, ball) = (2.0 * PI * r * r * h, 4.0 / 3.0 * PI * r.powi(3));
    let along = 0.5 * cylinder * r * r + 0.4 * ball * r * r;
    // The centre of half a ball is 3/8 r from its flat side.
    let across =
        cylinder * (3.0 * r * r + 4.0 * h * h) / 12.0 + ball * (0.4 * r * r + h * h + 0.75 * h * r);
    (cylinder + ball, [across, across, along])
}

/// Place of a geom, and its half length where it is stated by its ends.
fn placed(geom: &Element, angles: &Angles) -> Result<(Place, Option<f64>), MjcfError> {
    let Some([x0, y0, z0, x1, y1, z1]) = geom.numbers::<6>("fromto")? else {
        return Ok((angles.place(geom)?, None));
    };
    let along = [x0 - x1, y0 - y1, z0 - z1];
    let length = along.iter().map(|x| x * x).sum::<f64>().sqrt();
    let z = unit(along).ok_or_else(|| geom.error("fromto", "give two points that differ"))?;
    let place = Place {
        origin: [0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1)],
        ..from_z(z)
    };
    Ok((place, Some(0.5 * length)))
}
