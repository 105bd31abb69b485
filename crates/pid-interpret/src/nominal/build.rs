//! From the file to robot, tolerances and measurement: every value checked once.

use pid_derive::plausible;

use super::assemble::{Assembly, JointValues, Value};
use super::error::NominalError;
use super::file::{RawFile, RawHalfWidths, RawJoint, RawTolerance};
use super::source::Source;
use super::{DriveModel, Nominal, Servo, measured, servo, stated};

pub(super) fn nominal(source: &Source<'_>) -> Result<Nominal, NominalError> {
    let raw: RawFile = source.parse()?;
    if raw.joint.is_empty() {
        return Err(NominalError::NoJoint {
            file: source.file.to_owned(),
        });
    }
    let shares = match &raw.tolerance {
        Some(tolerance) => Shares::new(source, tolerance)?,
        None => Shares::none(source, &raw.joint)?,
    };
    let measurement = measured::of_file(source, &raw)?;
    let gravity = source.list(&raw.robot.gravity, "robot", "gravity")?;
    let mut reader = Reader {
        source,
        shares,
        fitted: raw.simulated.is_some(),
        names: Vec::new(),
    };
    let mut assembly = Assembly::new(raw.robot.name.clone(), gravity);
    for joint in &raw.joint {
        assembly.joint(reader.joint(joint)?);
    }
    let effects = stated::effects(source, &raw.effect, &reader.names)?;
    let simulated = raw.simulated.as_ref();
    let simulated = simulated.map(|s| stated::simulated(source, s, raw.joint.len()));
    let mut nominal = assembly.finish(measurement);
    nominal.servos = servos(source, &raw)?;
    nominal.drive_models = drive_models(source, &raw)?;
    nominal.effects = effects;
    nominal.simulated = simulated.transpose()?;
    nominal.file = source.file.to_owned();
    Ok(nominal)
}

/// Position loops of the joints; none at all where the file states none.
fn servos(source: &Source<'_>, raw: &RawFile) -> Result<Vec<Option<Servo>>, NominalError> {
    let own = |joint: &RawJoint| {
        let name = joint.name.get_ref();
        let (drive, item) = match (&joint.drive, &raw.drive) {
            (Some(own), _) => (own, format!("joint {name}, drive")),
            (None, Some(all)) => (all, format!("drive, at joint {name}")),
            (None, None) => return Ok(None),
        };
        let driven = servo::Driven {
            item: &item,
            motor_gain: *joint.motor_gain.get_ref(),
            input: joint.input.get_ref(),
        };
        servo::servo(source, drive, &driven)
    };
    let all: Vec<Option<Servo>> = raw.joint.iter().map(own).collect::<Result<_, _>>()?;
    Ok(match all.iter().any(Option::is_some) {
        true => all,
        false => Vec::new(),
    })
}

/// What the feed-forward of the drives knows; none at all where the file states none.
fn drive_models(
    source: &Source<'_>,
    raw: &RawFile,
) -> Result<Vec<Option<DriveModel>>, NominalError> {
    let own = |joint: &RawJoint| -> Result<Option<DriveModel>, NominalError> {
        let Some(known) = &joint.drive_model else {
            return Ok(None);
        };
        let item = format!("joint {}, drive_model", joint.name.get_ref());
        let (mass, gain) = (&known.mass, &known.motor_gain);
        let some = "give the mass that the drive counts with, zero or more";
        let sign = "give the torque or force per unit of the input that the drive counts with";
        let (inertia, rotor) = (
            known.inertia.as_ref().unwrap_or(&joint.inertia),
            known.rotor_inertia.as_ref().unwrap_or(&joint.rotor_inertia),
        );
        let turns = "give the rotor inertia that the drive counts with, zero or more";
        Ok(Some(DriveModel {
            mass: source.number(mass, &item, "mass", |x| x >= 0.0, some)?,
            com: source.list(&known.com, &item, "com")?,
            inertia: source.list(inertia, &item, "inertia")?,
            rotor_inertia: source.number(rotor, &item, "rotor_inertia", |x| x >= 0.0, turns)?,
            motor_gain: source.number(gain, &item, "motor_gain", |x| x != 0.0, sign)?,
        }))
    };
    let all: Vec<Option<DriveModel>> = raw.joint.iter().map(own).collect::<Result<_, _>>()?;
    Ok(match all.iter().any(Option::is_some) {
        true => all,
        false => Vec::new(),
    })
}

/// Tolerances as the file states them.
struct Shares {
    mass: f64,
    com: f64,
    inertia: f64,
    rotor_inertia: f64,
    gain: f64,
    friction: f64,
}

impl Shares {
    /// Without the table every joint states tolerances of its own.
    fn none(source: &Source<'_>, joints: &[RawJoint]) -> Result<Self, NominalError> {
        match joints.iter().find(|j| j.tolerance.is_none()) {
            Some(joint) => Err(source.error(
                &joint.name,
                &format!("joint {}", joint.name.get_ref()),
                "tolerance",
                "absent",
                "add a table [tolerance] for all joints, or [joint.tolerance] for this one",
            )),
            None => Ok(Self {
                mass: 0.0,
                com: 0.0,
                inertia: 0.0,
                rotor_inertia: 0.0,
                gain: 0.0,
                friction: 0.0,
            }),
        }
    }

    fn new(source: &Source<'_>, raw: &RawTolerance) -> Result<Self, NominalError> {
        let number = |value, key| {
            let mend = "a tolerance is zero (the value is exact) or positive";
            source.number(value, "tolerance", key, |x| x >= 0.0, mend)
        };
        Ok(Self {
            mass: number(&raw.mass_rel, "mass_rel")?,
            com: number(&raw.com_abs_m, "com_abs_m")?,
            inertia: number(&raw.inertia_rel, "inertia_rel")?,
            rotor_inertia: number(&raw.rotor_inertia_rel, "rotor_inertia_rel")?,
            gain: number(&raw.motor_gain_rel, "motor_gain_rel")?,
            friction: number(&raw.friction_rel, "friction_rel")?,
        })
    }
}

/// Half widths of a joint's values.
struct HalfWidths {
    mass: f64,
    com: [f64; 3],
    inertia: [f64; 6],
    rotor_inertia: f64,
    coulomb: f64,
    viscous: f64,
    gain: f64,
}

impl HalfWidths {
    fn new(source: &Source<'_>, raw: &RawHalfWidths, item: &str) -> Result<Self, NominalError> {
        let item = format!("{item}, tolerance");
        let mend = "a tolerance is zero (the value is exact) or positive";
        let number = |value, key| source.number(value, &item, key, |x| x >= 0.0, mend);
        let com = source.list(&raw.com, &item, "com")?;
        let inertia = source.list(&raw.inertia, &item, "inertia")?;
        if com.iter().any(|x| *x < 0.0) {
            return Err(source.error(&raw.com, &item, "com", format!("{com:?}"), mend));
        }
        if inertia.iter().any(|x| *x < 0.0) {
            return Err(source.error(&raw.inertia, &item, "inertia", format!("{inertia:?}"), mend));
        }
        Ok(Self {
            mass: number(&raw.mass, "mass")?,
            com,
            inertia,
            rotor_inertia: number(&raw.rotor_inertia, "rotor_inertia")?,
            coulomb: number(&raw.coulomb, "coulomb")?,
            viscous: number(&raw.viscous, "viscous")?,
            gain: number(&raw.motor_gain, "motor_gain")?,
        })
    }

    /// Puts them in place of those that shares give.
    fn apply(&self, values: &mut JointValues) {
        let put = |value: &mut Value, half_width: f64| value.half_width = half_width;
        put(&mut values.mass, self.mass);
        (values.com.iter_mut().zip(self.com)).for_each(|(v, h)| put(v, h));
        (values.inertia.iter_mut().zip(self.inertia)).for_each(|(v, h)| put(v, h));
        put(&mut values.rotor_inertia, self.rotor_inertia);
        put(&mut values.coulomb, self.coulomb);
        put(&mut values.viscous, self.viscous);
        put(&mut values.gain, self.gain);
    }
}

struct Reader<'a> {
    source: &'a Source<'a>,
    shares: Shares,
    /// Whether a fit made the values: within their tolerances they need not be those of a body.
    fitted: bool,
    /// Names of the joints so far.
    names: Vec<String>,
}

impl Reader<'_> {
    fn joint(&mut self, raw: &RawJoint) -> Result<JointValues, NominalError> {
        let source = self.source;
        let name = self.name(raw)?;
        let item = format!("joint {name}");
        let (axis, prismatic) = axis(source, raw, &item)?;
        let parent = self.parent(raw, &item)?;
        let (mass, com, inertia) = self.inertial(raw, &item)?;
        let input_unit = input_unit(source, raw, &item, prismatic)?;
        let gain = source.number(
            &raw.motor_gain,
            &item,
            "motor_gain",
            |x| x != 0.0,
            "a drive with gain 0 does nothing; give the torque or force per unit of the input",
        )?;
        let positive = |value, key| {
            let mend = "friction and rotor inertia are zero or positive";
            source.number(value, &item, key, |x| x >= 0.0, mend)
        };
        let relative = |nominal: f64, share: f64| Value {
            nominal,
            half_width: share * nominal.abs(),
        };
        let shares = &self.shares;
        let mut values = JointValues {
            prismatic,
            axis,
            parent,
            origin: source.list(&raw.origin, &item, "origin")?,
            rpy: match &raw.rpy {
                Some(rpy) => source.list(rpy, &item, "rpy")?,
                None => [0.0; 3],
            },
            limits: limits(source, raw, &item)?,
            mass,
            com,
            inertia,
            rotor_inertia: relative(
                positive(&raw.rotor_inertia, "rotor_inertia")?,
                shares.rotor_inertia,
            ),
            coulomb: relative(positive(&raw.coulomb, "coulomb")?, shares.friction),
            viscous: relative(positive(&raw.viscous, "viscous")?, shares.friction),
            gain: relative(gain, shares.gain),
            input_unit: input_unit.to_owned(),
            sharpness: sharpness(source, raw, &item)?,
            name: name.clone(),
        };
        if let Some(own) = &raw.tolerance {
            HalfWidths::new(source, own, &item)?.apply(&mut values);
        }
        self.names.push(name);
        Ok(values)
    }

    fn name(&self, raw: &RawJoint) -> Result<String, NominalError> {
        let name = raw.name.get_ref();
        let error = |mend: &str| {
            let item = format!("joint {}", self.names.len() + 1);
            Err(self
                .source
                .error(&raw.name, &item, "name", format!("\"{name}\""), mend))
        };
        let letter = |c: char| c.is_ascii_alphabetic() || c == '_';
        if !(name.starts_with(letter) && name.chars().all(|c| letter(c) || c.is_ascii_digit())) {
            return error(
                "a name is letters, digits and `_`, and starts with a letter: parameters are named after it",
            );
        }
        if name == "base" {
            return error("`base` is what the first joint hangs on; choose another name");
        }
        if self.names.contains(name) {
            return error("another joint has this name; give each its own");
        }
        Ok(name.clone())
    }

    /// The link of the named joint; without a name that of the joint before.
    fn parent(&self, raw: &RawJoint, item: &str) -> Result<Option<usize>, NominalError> {
        let Some(parent) = &raw.parent else {
            return Ok(self.names.len().checked_sub(1));
        };
        if parent.get_ref() == "base" {
            return Ok(None);
        }
        match self.names.iter().position(|name| name == parent.get_ref()) {
            Some(index) => Ok(Some(index)),
            None => Err(self.source.error(
                parent,
                item,
                "parent",
                format!("\"{}\"", parent.get_ref()),
                "name a joint listed before this one, or \"base\"",
            )),
        }
    }

    /// Mass, centre of mass and inertia about it.
    fn inertial(
        &self,
        raw: &RawJoint,
        item: &str,
    ) -> Result<(Value, [Value; 3], [Value; 6]), NominalError> {
        let source = self.source;
        let mass = source.number(&raw.mass, item, "mass", |x| x > 0.0, "a mass is positive")?;
        let com = source.list(&raw.com, item, "com")?;
        let inertia = source.list(&raw.inertia, item, "inertia")?;
        if !self.fitted
            && let Err(e) = plausible::check(mass, inertia)
        {
            let mend = format!("{e}; entries are xx, yy, zz, xy, xz, yz about the centre of mass");
            return Err(source.error(&raw.inertia, item, "inertia", format!("{inertia:?}"), mend));
        }
        let largest = plausible::principal_moments(inertia)[0];
        let within = |half_width: f64| {
            move |nominal| Value {
                nominal,
                half_width,
            }
        };
        Ok((
            within(self.shares.mass * mass)(mass),
            com.map(within(self.shares.com)),
            inertia.map(within(self.shares.inertia * largest)),
        ))
    }
}

/// The axis, of unit length, and whether the joint slides along it.
fn axis(source: &Source<'_>, raw: &RawJoint, item: &str) -> Result<([f64; 3], bool), NominalError> {
    let kinds = [("revolute", false), ("prismatic", true)];
    let prismatic = source.word(&raw.r#type, item, "type", &kinds)?;
    let axis = source.list(&raw.axis, item, "axis")?;
    let largest = axis.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    if largest == 0.0 {
        let mend = "an axis has a direction, as in [0.0, 0.0, 1.0]";
        return Err(source.error(&raw.axis, item, "axis", format!("{axis:?}"), mend));
    }
    // An axis of unit length stays as it is written: what is read back equals what was written.
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (length - 1.0).abs() <= 4.0 * f64::EPSILON {
        return Ok((axis, prismatic));
    }
    let scaled = axis.map(|x| x / largest);
    let length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
    Ok((scaled.map(|x| x / length), prismatic))
}

fn input_unit(
    source: &Source<'_>,
    raw: &RawJoint,
    item: &str,
    prismatic: bool,
) -> Result<&'static str, NominalError> {
    let force = if prismatic {
        ("force", "N")
    } else {
        ("torque", "N*m")
    };
    let words = [force, ("current", "A"), ("voltage", "V")];
    source.word(&raw.input, item, "input", &words)
}

fn sharpness(source: &Source<'_>, raw: &RawJoint, item: &str) -> Result<f64, NominalError> {
    let positive = "give a positive number, or leave the key out";
    let stated = source.optional(
        raw.sharpness.as_ref(),
        item,
        "sharpness",
        |x| x > 0.0,
        positive,
    )?;
    let speed = source.optional(
        raw.speed_scale.as_ref(),
        item,
        "speed_scale",
        |x| x > 0.0,
        positive,
    )?;
    Ok(stated.unwrap_or_else(|| measured::sharpness(speed)))
}

fn limits(
    source: &Source<'_>,
    raw: &RawJoint,
    item: &str,
) -> Result<Option<(f64, f64)>, NominalError> {
    let Some(limits) = &raw.limits else {
        return Ok(None);
    };
    let [lower, upper] = source.list(limits, item, "limits")?;
    if lower < upper {
        return Ok(Some((lower, upper)));
    }
    let mend = "the first limit is below the second";
    Err(source.error(limits, item, "limits", format!("[{lower}, {upper}]"), mend))
}
