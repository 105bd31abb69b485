//! `--with`: what a model lacks, an effect of the library or a force law that is linear in its coefficient.

use std::fmt;
use std::str::FromStr;

use pid_data::Dataset;
use pid_diagnose::case::Case;
use pid_diagnose::effect::Term;
use pid_diagnose::effects;
use pid_diagnose::nominal::Nominal;
use pid_diagnose::with_effects::{Placed, WithEffects};
use pid_runtime::dynamics::{Dynamics, Hessian};
use pid_runtime::term::{LAWS, Law, Request};
use pid_toml::nearest;

use crate::error::CliError;

/// An effect of the library at a joint, or at every joint that can have it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct AtJoint {
    id: &'static str,
    joint: Option<String>,
}

/// One `--with`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct With {
    text: String,
    /// The effect of this name.
    pub(crate) effect: Option<AtJoint>,
    /// The force law of this name, or the linear form of the effect.
    pub(crate) law: Option<Request>,
}

/// A word that names neither.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is no effect and no force law\n  help: {like}write `stribeck`, `stribeck:elbow`, or `viscous:j5+j6` for a law at a motor of two joints; effects: {effects}; laws: {laws}"
)]
pub(crate) struct WithError {
    text: String,
    like: String,
    effects: String,
    laws: String,
}

impl FromStr for With {
    type Err = WithError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (word, joint) = match text.split_once(':') {
            Some((word, joint)) => (word.trim(), Some(joint.trim().to_owned())),
            None => (text.trim(), None),
        };
        let effect = effects::by_id(word).map(|effect| AtJoint {
            id: effect.info().id,
            joint,
        });
        let law = text.parse::<Request>().ok();
        if effect.is_some() || law.is_some() {
            return Ok(With {
                text: text.to_owned(),
                effect,
                law,
            });
        }
        let ids: Vec<&str> = effects::all().iter().map(|e| e.info().id).collect();
        let words = LAWS.map(Law::word);
        let like = nearest(word, ids.iter().copied().chain(words));
        Err(WithError {
            text: text.to_owned(),
            like: like.map_or(String::new(), |n| format!("did you mean `{n}`? ")),
            effects: ids.join(", "),
            laws: words.join(", "),
        })
    }
}

impl fmt::Display for With {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// The linear forms of all of them.
///
/// # Errors
/// If one has none.
pub(crate) fn laws(all: &[With]) -> Result<Vec<Request>, CliError> {
    let each = all.iter().map(|with| {
        with.law.clone().ok_or_else(|| CliError::NoLinearForm {
            effect: with.to_string(),
            laws: LAWS.map(Law::word).join(", "),
        })
    });
    each.collect()
}

/// The model with the effects among them; starts and ranges are sizes of the records and of the
/// robot as it was declared.
///
/// # Errors
/// If the records or the model do not tell the sizes, a joint does not exist, or the equations
/// cannot take an effect.
pub(crate) fn extended(
    inner: Box<dyn Hessian>,
    all: &[With],
    (declared, dataset): (&dyn Dynamics, &Dataset),
) -> Result<Box<dyn Hessian>, CliError> {
    let wanted: Vec<&AtJoint> = all.iter().filter_map(|w| w.effect.as_ref()).collect();
    if wanted.is_empty() {
        return Ok(inner);
    }
    let nominal = Nominal::of_declared(declared, None);
    let case = Case::new(
        nominal.map_err(pid_diagnose::case::CaseError::from)?,
        dataset,
    )?;
    let mut placed = Vec::new();
    for AtJoint { id, joint } in wanted {
        let Some(effect) = effects::by_id(id) else {
            continue;
        };
        let names = || inner.joints().iter().map(|j| j.name.as_ref());
        let joints: Vec<usize> = match joint {
            Some(name) => match names().position(|n| n == name) {
                Some(joint) => vec![joint],
                None => {
                    return Err(CliError::NoJoint {
                        effect: (*id).to_owned(),
                        joint: name.clone(),
                        joints: names().collect::<Vec<_>>().join(", "),
                    });
                }
            },
            None if !effect.info().has_joint => vec![0],
            None => (0..inner.dims().nq)
                .filter(|&j| !effect.needs_partner() || effect.partner(j).is_some())
                .collect(),
        };
        for joint in joints {
            let effect = effect.clone();
            let size = |unit, joint| case.unit(unit, joint);
            let description = &case.nominal.description;
            placed.push(Placed::at(Term { effect, joint }, description, &size));
        }
    }
    Ok(Box::new(WithEffects::new(inner, &placed)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_means_one_thing() {
        let read = |text: &str| text.parse::<With>().expect(text);
        let both = read("stribeck:elbow");
        assert!(both.effect.is_some() && both.law.is_some());
        assert!(read("spring:elbow").law.is_none());
        let linear = read("quadratic_drag");
        assert_eq!(linear.law.expect("a linear form").law, Law::Quadratic);
        assert!(read("viscous:a+b").effect.is_none());
        let text = "stribek".parse::<With>().expect_err("a slip").to_string();
        assert!(text.contains("did you mean `stribeck`"), "{text}");
        let none = laws(&[read("spring")]).expect_err("a spring is no law");
        assert!(none.to_string().contains("spring"), "{none}");
    }
}
