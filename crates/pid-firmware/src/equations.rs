//! A description with its effects as expressions: torques of the drives, and laws of their inputs.

use pid_derive::links::{GRAVITY, PER_BODY, links};
use pid_effects::constants::{Constant, Constants};
use pid_effects::described::described;
use pid_effects::effect::{Forces, Friction, Law, Site, Symbol, Term};
use pid_effects::nominal::Nominal;
use pid_effects::scalar::Scalar;
use pid_effects::symbol;
use pid_interpret::nominal::{self as description, Role};
use pid_symbolic::{Cost, Graph, Id};

use crate::Precision;
use crate::carrier::{Carrier, carrier};
use crate::error::FirmwareError;
use crate::input::Step;

/// The drive of a coordinate.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Name of the joint.
    pub(crate) name: String,
    /// Whether it slides.
    pub(crate) prismatic: bool,
    /// Unit of the input.
    pub(crate) unit: String,
    /// Torque or force per unit of the input.
    pub(crate) gain: f64,
    /// Laws of the input, from the command to the motor.
    pub(crate) steps: Vec<Step>,
    /// Whether a position loop stands before the motor.
    pub(crate) looped: bool,
}

/// The robot.
#[derive(Debug, Clone)]
pub(crate) struct Equations {
    pub(crate) name: String,
    pub(crate) graph: Graph,
    /// Torque or force of each drive; q, v and a are the variables 0.., n.., 2n...
    pub(crate) torque: Vec<Id>,
    pub(crate) drives: Vec<Drive>,
    pub(crate) effects: Vec<(Term, Vec<f64>)>,
    /// Rows `w = R q + o` where the coordinates are those of drives on several joints.
    pub(crate) coupled: Option<description::Drives>,
}

impl Equations {
    /// Of a description.
    pub(crate) fn new(nominal: &description::Nominal) -> Result<Self, FirmwareError> {
        let effects = described(nominal)?;
        let own = Nominal::new(nominal.clone());
        let mut constants = Constants::<f64>::new(&own, &vec![0.0; own.size()]);
        let acts = |term: &Term| carrier(&*term.effect) != Carrier::Nothing;
        let acting: Vec<_> = effects.iter().filter(|(term, _)| acts(term)).collect();
        for (term, values) in &acting {
            let law = term.effect.plain();
            law.constants(values, term.joint, &mut constants);
        }
        let drives = drives(nominal, &own, &constants, &effects)?;
        let mut graph = Graph::new();
        let inertial = inertial(&mut graph, nominal, &own, &constants);
        let n = drives.len();
        let var = |g: &mut Graph, from: usize| (from..from + n).map(|k| Symbol(g.var(k))).collect();
        let motion = Motion {
            q: var(&mut graph, 0),
            v: var(&mut graph, n),
            a: var(&mut graph, 2 * n),
            load: inertial.into_iter().map(Symbol).collect(),
            rest: (0..n).map(|j| rest(nominal, j)).collect(),
        };
        let torque = symbol::on(&mut graph, || motion.torque(&constants, &acting));
        // The laws hold for true positions; the code takes what the encoders show.
        let mut offsets = vec![0.0; n];
        for (term, values) in &acting {
            if carrier(&*term.effect) == Carrier::Reading {
                offsets[term.joint] += values[0];
            }
        }
        let torque = graph.substitute(&torque, |g, var| {
            let offset = *offsets.get(var as usize).filter(|x| **x != 0.0)?;
            let (q, offset) = (g.var(var as usize), g.constant(offset));
            Some(g.sub(q, offset))
        });
        Ok(Self {
            name: nominal.robot().name.clone(),
            graph,
            torque,
            drives,
            effects,
            coupled: nominal.drives().cloned(),
        })
    }

    /// Operations of the torques.
    pub(crate) fn cost(&self) -> Cost {
        Cost::of(&self.graph, &self.torque)
    }

    /// Operations of the residual.
    pub(crate) fn residual_cost(&self) -> Cost {
        let mut cost = self.cost();
        for drive in &self.drives {
            cost.additions += 1;
            cost.multiplications += usize::from(drive.gain != 1.0);
            drive.steps.iter().for_each(|step| step.count(&mut cost));
        }
        cost
    }

    /// Whether all constants are numbers of the code.
    pub(crate) fn check(&self, precision: Precision) -> Result<(), FirmwareError> {
        let all = self.graph.reachable(&self.torque).into_iter();
        let values = all.filter_map(|id| self.graph.value(id));
        let steps = self.drives.iter().flat_map(|d| &d.steps);
        let steps = steps.map(|step| match *step {
            Step::Shift(x) | Step::Limit(x) | Step::Droop(x) | Step::DeadZone(x) => x,
        });
        let gains = self.drives.iter().map(|d| d.gain);
        let mut all = values.chain(steps).chain(gains);
        let fits = |x: f64| match precision {
            Precision::F64 => x.is_finite(),
            Precision::F32 => (x as f32).is_finite(),
        };
        match all.find(|&x| !fits(x)) {
            None => Ok(()),
            Some(x) => Err(FirmwareError::Value {
                robot: self.name.clone(),
                item: "a constant of its equations".to_owned(),
                value: format!("{x:e}"),
                mend: match x.is_finite() {
                    true => "it is beyond single precision; use --precision f64",
                    false => {
                        "look for values that are not finite in the description and its effects"
                    }
                },
            }),
        }
    }
}

/// Velocity over which dry friction changes its sign.
fn rest(nominal: &description::Nominal, joint: usize) -> f64 {
    let mut all = nominal.tolerances().iter();
    let sharp = all.find(|t| t.joint == Some(joint) && t.role == Role::Sharpness);
    sharp.map_or(REST, |t| 1.0 / t.nominal)
}

/// The same where nothing is stated, rad/s or m/s.
const REST: f64 = 0.02;

/// M a + b without rotors, parameters and constants as numbers.
fn inertial(
    g: &mut Graph,
    nominal: &description::Nominal,
    own: &Nominal,
    constants: &Constants<'_, f64>,
) -> Vec<Id> {
    let derived = links(g, nominal.robot(), None);
    let p = own.parameters(&vec![0.0; own.size()]);
    let params = 3 * own.n() + nominal.robot().inputs.len();
    let number = |k: usize| {
        let place = |k: usize| (k / PER_BODY, k % PER_BODY);
        let bodies = PER_BODY * derived.bodies;
        constants.get(match k {
            k if k < GRAVITY => Constant::Gravity(k),
            k if k - GRAVITY < bodies => match place(k - GRAVITY) {
                (body, 0) => Constant::Mass(body),
                (body, i @ 1..=3) => Constant::Moment(body, i - 1),
                (body, i) => Constant::Inertia(body, i - 4),
            },
            k => Constant::Rotor(k - GRAVITY - bodies),
        })
    };
    let known = derived.first..derived.first + derived.values.len();
    g.substitute(&derived.inertial, |g, var| {
        let var = var as usize;
        let value = match var.checked_sub(params).and_then(|k| p.get(k)) {
            Some(&x) => x,
            None if known.contains(&var) => number(var - known.start),
            None => return None,
        };
        Some(g.constant(value))
    })
}

fn drives(
    nominal: &description::Nominal,
    own: &Nominal,
    constants: &Constants<'_, f64>,
    effects: &[(Term, Vec<f64>)],
) -> Result<Vec<Drive>, FirmwareError> {
    let inputs = &nominal.robot().inputs;
    let drive = |(j, joint): (usize, &pid_effects::nominal::Joint)| {
        let gain = constants.get(Constant::Gain(j));
        if gain == 0.0 {
            return Err(FirmwareError::Value {
                robot: own.name.clone(),
                item: format!("joint `{}`", joint.name),
                value: "its drive has a gain of zero".to_owned(),
                mend: "a feed-forward needs a drive on each coordinate; state its gain or hold the joint",
            });
        }
        let at = effects.iter().filter(|(term, _)| term.joint == j);
        let steps = at.filter_map(|(term, values)| Step::of(term, values));
        Ok(Drive {
            name: joint.name.clone(),
            prismatic: !joint.revolute,
            unit: inputs.get(j).map_or_else(String::new, |i| i.unit.clone()),
            gain,
            steps: steps.filter(|step| !step.is_nothing()).collect(),
            looped: nominal.servo(j).is_some(),
        })
    };
    own.joints.iter().enumerate().map(drive).collect()
}

/// The motion as expressions.
struct Motion {
    q: Vec<Symbol>,
    v: Vec<Symbol>,
    a: Vec<Symbol>,
    /// Torque through the gear to the links: M a + b without rotors.
    load: Vec<Symbol>,
    rest: Vec<f64>,
}

impl Motion {
    fn site(&self, joint: usize) -> Site<'_, Symbol> {
        Site {
            joint,
            q: &self.q,
            v: &self.v,
            load: &self.load,
            t: 0.0,
            dt: 1.0,
            rest: Some(self.rest[joint]),
        }
    }

    /// Torques of the drives.
    fn torque(&self, constants: &Constants<'_, f64>, effects: &[&(Term, Vec<f64>)]) -> Vec<Id> {
        let n = self.q.len();
        let nil = Symbol::nil();
        let (mut value, mut rate) = (vec![nil; n], vec![nil; n]);
        let nothing = Constants::<Symbol>::none(constants.nominal());
        let laws: Vec<(&Term, Vec<Symbol>)> = (effects.iter())
            .map(|(term, e)| (term, e.iter().map(|&x| Symbol::constant(x)).collect()))
            .collect();
        for (term, e) in &laws {
            let law: &dyn Law<Symbol> = term.effect.symbolic();
            let mut forces = Forces {
                value: &mut value,
                rate: &mut rate,
            };
            law.force(e, &self.site(term.joint), &[], &mut forces, &nothing);
        }
        let of = |j: usize| {
            let number = |which| Symbol::constant(constants.get(which));
            let coulomb = number(Constant::Coulomb(j));
            let mut friction = Friction {
                forward: coulomb,
                backward: coulomb,
                viscous: Symbol::constant(
                    constants.get(Constant::Viscous(j)) + constants.induced(j),
                ),
            };
            let site = self.site(j);
            for (term, e) in laws.iter().filter(|(term, _)| term.joint == j) {
                term.effect
                    .symbolic()
                    .friction(e, &site, &[], &mut friction);
            }
            let Friction {
                forward,
                backward,
                viscous,
            } = friction;
            // Both levels weighted by (1 ± sign)/2.
            let mean = (forward + backward) * 0.5;
            let dry = mean * site.direction() + (forward - backward) * 0.5;
            let rotor = number(Constant::Rotor(j)) * self.a[j];
            self.load[j] + rotor + dry + (viscous + rate[j]) * self.v[j] - value[j]
        };
        (0..n).map(|j| of(j).0).collect()
    }
}
