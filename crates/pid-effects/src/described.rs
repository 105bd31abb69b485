//! Effects in a nominal description: checked against the library, and as a description states them.

use std::sync::Arc;

use pid_interpret::nominal::{
    self as description, Effect as Stated, EffectParameter, Fault, Gain, NominalError, ServoGain,
    Written,
};
use pid_toml::{Place, nearest};

use crate::effect::{Effect, Info, Parameter, Term, Unit};
use crate::effects;
use crate::terms;

/// The effects of a description with their parameters, SI, as the library has them.
///
/// # Errors
/// If the library has no such effect, a joint or a parameter is missing or too many, a unit is
/// another, or a value is outside its range: file, line, key, value, mend.
pub fn described(nominal: &description::Nominal) -> Result<Vec<(Term, Vec<f64>)>, NominalError> {
    let library: Vec<Arc<dyn Effect>> = effects::all().into_iter().chain(terms::all()).collect();
    let all = nominal.effects().iter();
    let all = all.map(|stated| term(nominal, stated, &library));
    all.collect::<Result<_, Fault>>()
        .map_err(|fault| fault.within(nominal.file()))
}

/// The same description with effects that are stages of position loops as numbers of these, as uncertain as they are
/// large: equations of motion have them as parameters of the loop. A stage of size zero is none.
///
/// # Errors
/// As [`described`].
pub fn in_loops(nominal: &description::Nominal) -> Result<description::Nominal, NominalError> {
    let mut servos = nominal.servos().to_vec();
    let mut beside = Vec::new();
    for ((term, e), stated) in described(nominal)?.iter().zip(nominal.effects()) {
        let servo = servos.get_mut(term.joint).and_then(Option::as_mut);
        match (term.effect.stage(), servo, e.as_slice()) {
            (Some(_), Some(_), &[0.0]) => {}
            (Some(stage), Some(servo), &[value]) => servo.set(
                stage,
                ServoGain {
                    value: Some(value),
                    half_width: value.abs(),
                },
            ),
            _ => beside.push(stated.clone()),
        }
    }
    Ok(nominal.clone().with_servos(servos).with_effects(beside))
}

/// One effect at its place with its parameters.
fn term(
    nominal: &description::Nominal,
    stated: &Stated,
    library: &[Arc<dyn Effect>],
) -> Result<(Term, Vec<f64>), Fault> {
    let id = &stated.id;
    let fault = |place: &Option<Place>, key, found: String, mend: String| Fault {
        place: place.clone(),
        item: format!("effect {}", id.value),
        key,
        found,
        mend,
    };
    let ids = || library.iter().map(|e| e.info().id);
    let Some(effect) = library.iter().find(|e| e.info().id == id.value) else {
        let like = nearest(&id.value, ids());
        let like = like.map_or(String::new(), |n| format!("did you mean `{n}`? "));
        let all: Vec<&str> = ids().collect();
        let mend = format!("{like}the effects of the library are {}", all.join(", "));
        return Err(fault(&id.place, "id", format!("\"{}\"", id.value), mend));
    };
    let info = effect.info();
    let joint = match (&stated.joint, info.has_joint) {
        (Some(joint), true) => joint.value,
        (None, false) => 0,
        (None, true) => {
            let mend = "name the joint it acts on, `joint = \"…\"`".to_owned();
            return Err(fault(&id.place, "joint", "absent".to_owned(), mend));
        }
        (Some(joint), false) => {
            let mend = "it acts on the whole robot; leave the key out".to_owned();
            return Err(fault(&joint.place, "joint", "given".to_owned(), mend));
        }
    };
    if effect.needs_partner() && effect.partner(joint).is_none() {
        let mend = "it acts between a joint and the one before; name a joint that has one";
        return Err(fault(
            &id.place,
            "joint",
            "the first".to_owned(),
            mend.to_owned(),
        ));
    }
    if let (Some(stage), true) = (effect.stage(), info.has_joint) {
        belongs(nominal, stated, (stage, joint), &fault)?;
    }
    let e = values(nominal, stated, (info.parameters, joint), &fault)?;
    let effect = effect.clone();
    Ok((Term { effect, joint }, e))
}

/// Makes the error at an effect: place, key, what was found, mend.
type AtEffect<'a> = dyn Fn(&Option<Place>, &'static str, String, String) -> Fault + 'a;

/// Whether a stage belongs to the loop of its joint, which must be there and lack it.
fn belongs(
    nominal: &description::Nominal,
    stated: &Stated,
    (stage, joint): (Gain, usize),
    fault: &AtEffect<'_>,
) -> Result<(), Fault> {
    let place = &stated
        .joint
        .as_ref()
        .map_or(&stated.id.place, |joint| &joint.place)
        .clone();
    let refuse = |found: &str, mend: String| Err(fault(place, "joint", found.to_owned(), mend));
    match nominal.servo(joint) {
        None => {
            let mend = "it is a stage of a position loop: state the loop in [joint.drive], or leave the effect out";
            return refuse("without a position loop", mend.to_owned());
        }
        Some(servo) if servo.has(stage) => {
            let mend = format!(
                "its loop states `{}`: change that in place of it",
                stage.key()
            );
            return refuse("a joint whose loop has it", mend);
        }
        Some(servo) if !servo.lacks(stage) => {
            let mend = "the law \"p\" does not use the velocity: leave it out";
            return refuse("a loop without velocity", mend.to_owned());
        }
        Some(_) => {}
    }
    Ok(())
}

/// The values of all parameters of an effect at a joint, in their order.
fn values(
    nominal: &description::Nominal,
    stated: &Stated,
    (parameters, joint): (&[Parameter], usize),
    fault: &AtEffect<'_>,
) -> Result<Vec<f64>, Fault> {
    let names: Vec<&str> = parameters.iter().map(|p| p.name).collect();
    for own in &stated.parameters {
        if !names.contains(&own.name.as_str()) {
            let like = nearest(&own.name, names.iter().copied());
            let like = like.map_or(String::new(), |n| format!("did you mean `{n}`? "));
            let mend = format!("{like}its parameters are {}", names.join(", "));
            return Err(fault(
                &own.value.place,
                "parameters",
                own.name.clone(),
                mend,
            ));
        }
    }
    let mut e = Vec::with_capacity(names.len());
    for p in parameters {
        let Some(own) = stated.parameters.iter().find(|own| own.name == p.name) else {
            let mend = format!("add `{} = {{ value = … }}`", p.name);
            let found = format!("without `{}`", p.name);
            return Err(fault(&stated.id.place, "parameters", found, mend));
        };
        e.push(value(nominal, joint, p, own, fault)?);
    }
    Ok(e)
}

/// The value of a parameter, its unit and range checked.
fn value(
    nominal: &description::Nominal,
    joint: usize,
    p: &Parameter,
    own: &EffectParameter,
    fault: &AtEffect<'_>,
) -> Result<f64, Fault> {
    let unit = unit(nominal, joint, p);
    if let Some(stated) = &own.unit
        && stated.value != unit
    {
        let mend = format!("`{}` is in {unit} here; convert the value", p.name);
        return Err(fault(
            &stated.place,
            "unit",
            format!("\"{}\"", stated.value),
            mend,
        ));
    }
    let x = own.value.value;
    let (low, high) = range(p);
    let positive = p.lower > 0.0 && x <= 0.0;
    if x < low || x > high || positive {
        let mend = match (positive, low.is_finite(), high.is_finite()) {
            (true, ..) => format!("`{}` is positive", p.name),
            (_, true, true) => format!("`{}` is from {low} to {high} {unit}", p.name),
            _ => format!("`{}` is at least {low} {unit}", p.name),
        };
        return Err(fault(&own.value.place, "value", format!("{x}"), mend));
    }
    Ok(x)
}

/// Range of a parameter on any robot: ranges in sizes of the motion keep their sign only.
pub fn range(p: &Parameter) -> (f64, f64) {
    match p.unit {
        Unit::One | Unit::Share | Unit::Angle | Unit::Time => (p.lower, p.upper),
        _ if p.lower >= 0.0 => (0.0, f64::INFINITY),
        _ => (f64::NEG_INFINITY, f64::INFINITY),
    }
}

/// SI unit of a parameter at a joint of a robot: with its kind of motion and of input.
pub fn unit(nominal: &description::Nominal, joint: usize, p: &Parameter) -> String {
    match p.unit {
        Unit::InverseSquareInput => format!("1/({})^2", input_unit(nominal, joint)),
        _ => unit_at(nominal, joint, p.si),
    }
}

fn input_unit(nominal: &description::Nominal, joint: usize) -> &str {
    let inputs = &nominal.robot().inputs;
    inputs.get(joint).map_or("A", |i| i.unit.as_str())
}

/// A unit that is stated for a revolute joint under a current, at a joint of a robot.
pub fn unit_at(nominal: &description::Nominal, joint: usize, si: &str) -> String {
    if si == "A" {
        return input_unit(nominal, joint).to_owned();
    }
    let mut joints = nominal.robot().joints.iter();
    let own = joints.find(|j| j.coord == Some(joint));
    if !own.is_some_and(|j| j.kind.is_length()) {
        return si.to_owned();
    }
    match si {
        "kg*m^2" => "kg".to_owned(),
        "rad/(N*m)" => "m/N".to_owned(),
        // Of a force over the square of a speed.
        "N*m*s^2" => "N*s^2/m^2".to_owned(),
        si => si.replace("N*m", "N").replace("rad", "m"),
    }
}

/// An effect with its parameters as a description states it.
pub fn stated(
    nominal: &description::Nominal,
    term: &Term,
    e: &[f64],
    intervals: &[Option<(f64, f64)>],
) -> Stated {
    let info: &Info = term.effect.info();
    let parameters = info.parameters.iter().zip(e).zip(intervals);
    Stated {
        id: Written::new(info.id.to_owned()),
        joint: info.has_joint.then(|| Written::new(term.joint)),
        parameters: parameters
            .map(|((p, &x), &interval)| EffectParameter {
                name: p.name.to_owned(),
                value: Written::new(x),
                unit: Some(Written::new(unit(nominal, term.joint, p))),
                interval,
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_follow_the_motion_and_the_input_of_a_joint() {
        let text = include_str!("with_effects/arm.toml");
        let slide = text
            .replace("\"revolute\"", "\"prismatic\"")
            .replace("input = \"current\"", "input = \"voltage\"");
        let read = |text: &str| description::Nominal::parse("arm.toml", text).expect("a robot");
        let (arm, slide) = (read(text), read(&slide));
        for (si, turning, sliding) in [
            ("N*m/rad", "N*m/rad", "N/m"),
            ("rad/(N*m)", "rad/(N*m)", "m/N"),
            ("N*m*s/rad", "N*m*s/rad", "N*s/m"),
            ("N*m*s^2", "N*m*s^2", "N*s^2/m^2"),
            ("1/rad", "1/rad", "1/m"),
            ("kg*m^2", "kg*m^2", "kg"),
            ("s", "s", "s"),
            ("A", "A", "V"),
        ] {
            assert_eq!(unit_at(&arm, 0, si), turning);
            assert_eq!(unit_at(&slide, 0, si), sliding);
        }
    }
}
