//! Positions and orientations in the five ways of MJCF.

use pid_derive::mechanism::Place;

use crate::element::Element;
use crate::error::MjcfError;

/// What the compiler of a model is told about angles.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Angles {
    /// Radians per unit of the file.
    pub(crate) unit: f64,
    /// Axes of Euler angles: lower case turn with the body, capitals in the frame outside.
    pub(crate) sequence: Vec<char>,
}

impl Angles {
    /// The place of an element in the frame of its parent.
    pub(crate) fn place(&self, element: &Element) -> Result<Place, MjcfError> {
        Ok(Place {
            origin: element.numbers("pos")?.unwrap_or_default(),
            ..self.rotation(element)?
        })
    }

    fn rotation(&self, element: &Element) -> Result<Place, MjcfError> {
        let direction = "give a direction, not zero";
        if let Some([x, y, z, angle]) = element.numbers::<4>("axisangle")? {
            let axis = unit([x, y, z]).ok_or_else(|| element.error("axisangle", direction))?;
            return Ok(Place::moved(false, axis, angle * self.unit));
        }
        if let Some([x0, x1, x2, y0, y1, y2]) = element.numbers::<6>("xyaxes")? {
            let wrong = || element.error("xyaxes", "give two directions that differ");
            let x = unit([x0, x1, x2]).ok_or_else(wrong)?;
            let y = [y0, y1, y2];
            let along = dot(x, y);
            let y = unit([0, 1, 2].map(|k| y[k] - along * x[k])).ok_or_else(wrong)?;
            let z = cross(x, y);
            return Ok(Place {
                rotation: std::array::from_fn(|i| [x[i], y[i], z[i]]),
                origin: [0.0; 3],
            });
        }
        if let Some(axis) = element.numbers("zaxis")? {
            let z = unit(axis).ok_or_else(|| element.error("zaxis", direction))?;
            return Ok(from_z(z));
        }
        if let Some(angles) = element.numbers::<3>("euler")? {
            let mut out = Place::IDENTITY;
            for (&axis, angle) in self.sequence.iter().zip(angles) {
                let mut direction = [0.0; 3];
                direction[usize::from(axis.to_ascii_lowercase() as u8 - b'x')] = 1.0;
                let turn = Place::moved(false, direction, angle * self.unit);
                out = match axis.is_ascii_lowercase() {
                    true => out.then(&turn),
                    false => turn.then(&out),
                };
            }
            return Ok(out);
        }
        let [w, x, y, z] = element.numbers("quat")?.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let length = (w * w + x * x + y * y + z * z).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return Err(element.error("quat", "a quaternion is not zero"));
        }
        Ok(of_quaternion([w, x, y, z].map(|c| c / length)))
    }
}

/// The rotation of a quaternion of unit length.
fn of_quaternion([w, x, y, z]: [f64; 4]) -> Place {
    let rotation = [
        [
            w * w + x * x - y * y - z * z,
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            w * w - x * x + y * y - z * z,
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            w * w - x * x - y * y + z * z,
        ],
    ];
    Place {
        rotation,
        origin: [0.0; 3],
    }
}

/// The shortest turn from the z axis to a direction.
pub(crate) fn from_z(z: [f64; 3]) -> Place {
    let axis = cross([0.0, 0.0, 1.0], z);
    let sine = dot(axis, axis).sqrt();
    let angle = sine.atan2(z[2]);
    match unit(axis) {
        Some(axis) => Place::moved(false, axis, angle),
        // Along z, or against it: then any axis across does.
        None => Place::moved(false, [1.0, 0.0, 0.0], angle),
    }
}

/// A direction of unit length; `None` for zero.
pub(crate) fn unit(x: [f64; 3]) -> Option<[f64; 3]> {
    let largest = x.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return None;
    }
    let scaled = x.map(|c| c / largest);
    let length = dot(scaled, scaled).sqrt();
    Some(scaled.map(|c| c / length))
}

fn dot(x: [f64; 3], y: [f64; 3]) -> f64 {
    (0..3).map(|k| x[k] * y[k]).sum()
}

fn cross(x: [f64; 3], y: [f64; 3]) -> [f64; 3] {
    [
        x[1] * y[2] - x[2] * y[1],
        x[2] * y[0] - x[0] * y[2],
        x[0] * y[1] - x[1] * y[0],
    ]
}
