//! Effects in the words of `robot!`: items to put into the declaration of a robot.

use std::fmt::Write as _;

use pid_runtime::dynamics::{Hessian, JointInfo};

use super::roles::{JointRoles, roles};
use super::{Placed, group::REST};
use crate::smooth;

/// An effect that a declaration cannot take as a force.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// It is no force on a joint.
    #[error(
        "effect `{effect}` is no force law\n  help: `extended.toml` states it; for a heavier rotor raise `armature`, for a payload the mass of its link"
    )]
    NoForce {
        /// The effect, with its joint.
        effect: String,
    },
    /// It changes what the declaration does not have.
    #[error(
        "effect `{effect}` changes the {what} of joint `{joint}`, which the declaration has no parameter for\n  help: declare it"
    )]
    Missing {
        /// The effect, with its joint.
        effect: String,
        /// `Coulomb friction`, `viscous friction`, `gain` or `input`.
        what: &'static str,
        /// The joint.
        joint: String,
    },
}

/// Items for a declaration: the effects' parameters and their force laws, which `robot!` adds to
/// those that it has. Laws are those of [`WithEffects`](super::WithEffects), corners rounded alike.
///
/// # Errors
/// [`SourceError`].
pub fn source(model: &dyn Hessian, effects: &[Placed]) -> Result<String, SourceError> {
    let roles = roles(model);
    let (mut params, mut laws) = (String::new(), String::new());
    for own in effects {
        let (effect, joint) = (&own.term.effect, own.term.joint);
        let info = effect.info();
        let name = model.joints()[joint].name.as_ref();
        let label = format!("{}:{name}", info.id);
        let Some(source) = effect.source() else {
            return Err(SourceError::NoForce { effect: label });
        };
        for ((p, unit), &(value, low, high)) in
            info.parameters.iter().zip(&own.units).zip(&own.ranges)
        {
            let unit = if unit.is_empty() { "1" } else { unit };
            let range = match (low.is_finite(), high.is_finite()) {
                (true, true) if low < high => format!(" in {low:?}..={high:?}"),
                (true, false) => format!(" in {low:?}.."),
                _ => String::new(),
            };
            let _ = write!(
                params,
                "    /// {} ({}).\n    {}_{}_{name}: {unit} = {value:?}{range};\n",
                info.title, p.name, info.id, p.name
            );
        }
        let words = Words {
            model,
            own,
            role: &roles[joint],
            label: &label,
        };
        if !source.own.is_empty() {
            let _ = writeln!(laws, "force on {name} = {};", words.fill(source.own)?);
        }
        if let (Some(law), Some(before)) = (source.before, joint.checked_sub(1)) {
            let before = model.joints()[before].name.as_ref();
            let _ = writeln!(laws, "force on {before} = {};", words.fill(law)?);
        }
    }
    Ok(format!("params {{\n{params}}}\n{laws}"))
}

/// What the words in braces stand for.
struct Words<'a> {
    model: &'a dyn Hessian,
    own: &'a Placed,
    role: &'a JointRoles,
    label: &'a str,
}

impl Words<'_> {
    fn fill(&self, law: &str) -> Result<String, SourceError> {
        let mut out = String::new();
        let mut rest = law;
        while let Some((text, word, after)) = next(rest) {
            out.push_str(text);
            out.push_str(&self.word(word)?);
            rest = after;
        }
        out.push_str(rest);
        Ok(out)
    }

    fn joint(&self, back: usize) -> &JointInfo {
        &self.model.joints()[self.own.term.joint.saturating_sub(back)]
    }

    fn word(&self, word: &str) -> Result<String, SourceError> {
        let info = self.own.term.effect.info();
        let joint = self.joint(0);
        let parameter = |name: &str| {
            let mut all = info.parameters.iter();
            let found = all.any(|p| p.name == name);
            found.then(|| format!("{}_{name}_{}", info.id, joint.name))
        };
        if let Some(name) = word.strip_prefix("own.").and_then(parameter) {
            return Ok(name);
        }
        let of_model = |place: Option<usize>, what| {
            let found = place.map(|k| self.model.params()[k].name.to_string());
            found.ok_or_else(|| self.missing(what))
        };
        match word {
            "coulomb" => of_model(self.role.coulomb, "Coulomb friction"),
            "viscous" => of_model(self.role.viscous, "viscous friction"),
            "gain" => of_model(self.role.gain, "gain"),
            "input" => {
                let found = self
                    .role
                    .input
                    .map(|i| self.model.inputs()[i].name.to_string());
                found.ok_or_else(|| self.missing("input"))
            }
            "q" => Ok(format!("q.{}", joint.name)),
            "v" => Ok(format!("v.{}", joint.name)),
            "q_before" => Ok(format!("q.{}", self.joint(1).name)),
            "v_before" => Ok(format!("v.{}", self.joint(1).name)),
            "sign" => {
                let rest = self.role.rest.unwrap_or(REST);
                let unit = joint.velocity_unit();
                Ok(format!("tanh(v.{}/({rest:?} {unit}))", joint.name))
            }
            "round" => Ok(format!("{:?} {}", smooth::ROUND, joint.force_unit())),
            "jam" => Ok(format!("{:?}", smooth::JAM)),
            "round_q" => Ok(format!("{:?} {}", smooth::ROUND, joint.unit())),
            "round_v" => Ok(format!("{:?} {}", smooth::ROUND, joint.velocity_unit())),
            other => Ok(parameter(other).unwrap_or_else(|| other.to_owned())),
        }
    }

    fn missing(&self, what: &'static str) -> SourceError {
        SourceError::Missing {
            effect: self.label.to_owned(),
            what,
            joint: self.joint(0).name.to_string(),
        }
    }
}

/// The text before the next word in braces, the word, and the text after it.
fn next(law: &str) -> Option<(&str, &str, &str)> {
    let (text, rest) = law.split_once('{')?;
    let (word, after) = rest.split_once('}')?;
    Some((text, word, after))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Term;
    use crate::effects::all;
    use crate::with_effects::WithEffects;
    use pid_interpret::Model;
    use pid_runtime::dynamics::{At, Dynamics};

    /// A declaration with all roles; `{}` stands for further items.
    const ARM: &str = "pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        params { m1: kg = 2.0; m2: kg = 1.0; }
        link upper { mass: m1; com: [0, 0, -0.15] m; inertia at com: diag(0.02, 0.02, 0.001) kg*m^2; }
        link fore { mass: m2; com: [0, 0, -0.12] m; inertia at com: diag(0.006, 0.006, 0.001) kg*m^2; }
        joint shoulder: revolute about y { base -> upper; }
        joint elbow: revolute about y { upper -> fore at [0, 0, -0.3] m; }
        per joint {
            input current: A;
            dry: N*m = [0.3, 0.2] in 0.0..=2.0;
            viscous: N*m*s/rad = [0.3, 0.1] in 0.0..=2.0;
            gain: N*m/A = [1.8, 0.9] in 0.1..=5.0;
            force = -dry*tanh(v/(0.02 rad/s)) - viscous*v + gain*current;
        }
        {}
        emit { dynamics, first_derivatives, second_derivatives }
    }";

    fn declared(more: &str) -> Model {
        let text = ARM.replace("{}", more);
        let tokens = text.parse().expect(&text);
        let robots = pid_codegen::robots(tokens);
        let robots = robots.unwrap_or_else(|mistakes| panic!("{mistakes:#?}\n{text}"));
        Model::new(&robots[0]).expect("equations")
    }

    /// Every force law of the library and every term, declared and added to the model: the same equations.
    #[test]
    fn declared_effects_are_those_of_the_library() {
        let mut tried = 0;
        for effect in all().into_iter().chain(crate::terms::all()) {
            if effect.source().is_none() {
                continue;
            }
            tried += 1;
            let info = effect.info();
            let id = info.id;
            let plain = declared("");
            let units = info.parameters.iter().map(|p| p.si.to_owned()).collect();
            let n = info.parameters.len();
            let placed = [Placed {
                term: Term { effect, joint: 1 },
                ranges: (0..n).map(|i| (0.3 + 0.1 * i as f64, 0.01, 2.0)).collect(),
                units,
            }];
            let items = source(&plain, &placed).expect(id);
            let declared = declared(&items);
            let with = WithEffects::new(Box::new(plain), &placed).expect(id);
            let d = with.dims();
            assert_eq!(declared.dims(), d, "{id}");
            // Parameters by name: a declaration has those of `params` before those of the joints.
            let place = |name: &str| {
                let mut all = declared.params().iter();
                all.position(|p| p.name == name).expect(name)
            };
            for point in 0..20 {
                let wave = |k: usize| (0.7 + 1.3 * k as f64 + 0.37 * f64::from(point)).sin();
                let rows = |from: usize, size: f64| [size * wave(from), size * wave(from + 1)];
                let (q, a, u) = (rows(0, 1.5), rows(4, 5.0), rows(6, 2.0));
                // Slow and fast motions: within the transition at rest and beyond it.
                let v = rows(2, if point % 2 == 0 { 1.0 } else { 0.03 });
                let own: Vec<f64> = (with.params().iter().enumerate())
                    .map(|(k, p)| p.nominal * (1.0 + 0.1 * wave(k + 8)))
                    .collect();
                let mut theirs = vec![f64::NAN; own.len()];
                for (p, &x) in with.params().iter().zip(&own) {
                    theirs[place(&p.name)] = x;
                }
                let residual = |model: &dyn Dynamics, p: &[f64]| {
                    let mut r = [0.0; 2];
                    let at = At {
                        q: &q,
                        v: &v,
                        a: &a,
                        u: &u,
                        p,
                    };
                    model.residual(&at, &mut r);
                    r
                };
                let (x, y) = (residual(&with, &own), residual(&declared, &theirs));
                let off = x
                    .iter()
                    .zip(y)
                    .map(|(x, y)| (x - y).abs())
                    .fold(0.0, f64::max);
                assert!(off < 1e-12, "{id}: {x:?} {y:?}");
            }
        }
        assert_eq!(tried, 21);
    }

    #[test]
    fn what_is_no_force_says_so() {
        let effect = crate::effects::by_id("backlash").expect("an effect");
        let placed = [Placed {
            term: Term { effect, joint: 1 },
            ranges: vec![(0.1, 0.0, 1.0); 3],
            units: vec!["1".to_owned(); 3],
        }];
        let text = source(&declared(""), &placed)
            .expect_err("a gap")
            .to_string();
        assert!(
            text.contains("backlash:elbow") && text.contains("help:"),
            "{text}"
        );
    }
}
