//! The robot that every target writes: a tree of bodies in numbers, drives, effects.
//!
//! Effects that only change constants (payload, tilt of the base, rotor inertia) are in the numbers.

use pid_derive::mechanism::{Body, Distribution, Follows, InertiaSource, Mechanism};
use pid_derive::model::{About, Expr, Inertial, Joint, JointKind, Robot, Tensor};
use pid_derive::plausible;
use pid_effects::constants::{Constant, Constants};
use pid_effects::described::described;
use pid_effects::effect::{Gear, Term};
use pid_effects::nominal::{EncoderSide, Nominal};
use pid_interpret::nominal::{self as description, Velocity};

use crate::error::ExportError;
use crate::position_loop::PositionLoop;

/// Least mass, kg, and principal moment, kg m², of a moving body: MuJoCo refuses less than 1e-15.
const LEAST: f64 = 1e-12;

/// A drive on a coordinate.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Index of the body whose joint it moves.
    pub(crate) body: usize,
    /// Torque or force per unit of the input.
    pub(crate) gain: f64,
    /// Coulomb friction, N m or N.
    pub(crate) coulomb: f64,
    /// Viscous friction with what a motor brakes by that is on, N m s/rad or N s/m.
    pub(crate) viscous: f64,
    /// Damping by the voltage that the motor induces, a part of `viscous`.
    pub(crate) induced: f64,
    /// Unit of the input.
    pub(crate) unit: String,
    /// How the velocity is read.
    pub(crate) velocity: Velocity,
    /// Typical largest torque or force.
    pub(crate) peak: Option<f64>,
    /// The gear between rotor and link, if one gives way.
    pub(crate) gear: Option<Gear<f64>>,
    /// The loop that makes the input of a target.
    pub(crate) position_loop: Option<PositionLoop>,
    /// Torque or force per unit of the input, as the drive knows it.
    pub(crate) known_gain: f64,
}

impl Drive {
    /// Largest torque or force of the drive, N m or N: by its loop, and by a limit of its input.
    pub(crate) fn most(&self, limit_input: Option<f64>) -> Option<f64> {
        let own = self.position_loop.as_ref();
        let stated = ["limit", "stall"].map(|key| own.and_then(|own| own.get(key)));
        let all = stated.into_iter().chain([limit_input]).flatten();
        let least = all.min_by(f64::total_cmp);
        least.map(|u| (u * self.gain).abs())
    }
}

/// An effect with its parameters, SI.
#[derive(Debug, Clone)]
pub(crate) struct Named {
    /// The effect at its joint.
    pub(crate) term: Term,
    /// Its parameters in the order of the library.
    pub(crate) values: Vec<f64>,
}

impl Named {
    /// Identifier of the effect.
    pub(crate) fn id(&self) -> &'static str {
        self.term.effect.info().id
    }
    /// Value of a parameter by its name.
    pub(crate) fn value(&self, name: &str) -> Option<f64> {
        let all = self.term.effect.info().parameters;
        all.iter()
            .position(|p| p.name == name)
            .and_then(|i| self.values.get(i).copied())
    }
}

/// The robot.
#[derive(Debug, Clone)]
pub(crate) struct Machine {
    /// Bodies; `rotor`, `coulomb` and `viscous` are those of the drives.
    pub(crate) mechanism: Mechanism,
    /// One per coordinate.
    pub(crate) drives: Vec<Drive>,
    /// All effects, in the order of the description.
    pub(crate) effects: Vec<Named>,
    /// Body of the tool and the point in its frame, m.
    pub(crate) tool: Option<(usize, [f64; 3])>,
    /// Side of the encoders.
    pub(crate) encoder_side: EncoderSide,
    /// The robot as the feed-forward of the drives knows it, where a drive has one.
    pub(crate) known: Option<Box<Machine>>,
    /// What was changed so that a simulator takes it, and position loops whose gains nobody knows: one sentence each.
    pub(crate) mended: Vec<String>,
}

impl Machine {
    /// Of a description.
    pub(crate) fn new(nominal: &description::Nominal) -> Result<Self, ExportError> {
        let effects: Vec<Named> = described(nominal)?
            .into_iter()
            .map(|(term, values)| Named { term, values })
            .collect();
        let own = Nominal::new(nominal.clone());
        let theta = vec![0.0; own.size()];
        let before = Constants::<f64>::new(&own, &theta);
        let mut constants = before.clone();
        for effect in &effects {
            let law = effect.term.effect.plain();
            law.constants(&effect.values, effect.term.joint, &mut constants);
        }
        let mut mechanism = tree(nominal.robot())?;
        mechanism.gravity = [0, 1, 2].map(|k| constants.get(Constant::Gravity(k)));
        let tool = constants
            .tool()
            .and_then(|(body, at)| Some((body, nominal.tool_link()?, at)));
        let tool = tool.map(|(body, link, at)| {
            let more = constants.get(Constant::Mass(body)) - before.get(Constant::Mass(body));
            let target = &mut mechanism.bodies[link];
            let point = Distribution {
                mass: more,
                com: at,
                inertia: [0.0; 6],
            };
            if more != 0.0 {
                let all = target.distribution().with(&point);
                (target.mass, target.com, target.inertia) = (all.mass, all.com, all.inertia);
            }
            (link, at)
        });
        let drives = drives(nominal, &mut mechanism, &constants, &effects);
        let mut machine = Self {
            mechanism,
            drives,
            effects,
            tool,
            encoder_side: own.encoder_side,
            known: None,
            mended: Vec::new(),
        };
        machine.check()?;
        machine.mend();
        machine.close_loops(nominal, &constants);
        let modelled = machine.loops().any(|(_, own)| own.has_model());
        if modelled {
            let known = machine.known_to_drives(nominal, &before)?;
            machine.known = Some(Box::new(known));
        }
        Ok(machine)
    }

    /// The position loops with their joints.
    pub(crate) fn loops(&self) -> impl Iterator<Item = (&str, &PositionLoop)> {
        let drives = self.drives.iter().enumerate();
        drives.filter_map(|(c, drive)| Some((self.joint(c), drive.position_loop.as_ref()?)))
    }

    /// What is said of loops for which a format has no element.
    pub(crate) fn loops_left_out(&self) -> impl Iterator<Item = String> {
        self.loops().map(|(joint, own)| {
            format!(
                "Joint `{joint}`: its drive follows targets by a position loop of law \"{}\", for which there is no element here: close the loop in code of yours.",
                own.law()
            )
        })
    }

    /// Gives the drives their position loops, and says which are left out.
    fn close_loops(&mut self, nominal: &description::Nominal, constants: &Constants<'_, f64>) {
        for c in 0..self.drives.len() {
            let own = self.effects.iter().filter(|e| e.term.joint == c);
            let stages: Vec<_> = own.filter_map(|e| e.term.effect.stage()).collect();
            match PositionLoop::of(nominal, c, constants, &stages) {
                Some(Ok(own)) => self.drives[c].position_loop = Some(own),
                Some(Err(unknown)) => self.mended.push(format!(
                    "Joint `{}`: its drive follows targets by a position loop whose {} nobody knows, so it is left out: the input of the files is that of the motor, in {}. Export the extended.toml of a diagnosis or the identified.toml of an identification, which know.",
                    self.joint(c),
                    unknown.join(", "),
                    self.drives[c].unit,
                )),
                None => {}
            }
        }
    }

    /// The robot as the drives know it: as it is stated, or as is stated of its drives.
    fn known_to_drives(
        &mut self,
        nominal: &description::Nominal,
        stated: &Constants<'_, f64>,
    ) -> Result<Self, ExportError> {
        let mut known = Self {
            mechanism: tree(nominal.robot())?,
            effects: Vec::new(),
            tool: None,
            ..self.clone()
        };
        for c in 0..known.drives.len() {
            let (drive, own) = (&mut known.drives[c], nominal.drive_model(c));
            (drive.gear, drive.position_loop) = (None, None);
            let body = &mut known.mechanism.bodies[drive.body];
            body.limits = None;
            body.rotor = Some(stated.get(Constant::Rotor(c)));
            self.drives[c].known_gain = stated.get(Constant::Gain(c));
            if let Some(own) = own {
                (body.mass, body.com, body.inertia) = (own.mass, own.com, own.inertia);
                body.rotor = Some(own.rotor_inertia);
                self.drives[c].known_gain = own.motor_gain;
            }
        }
        known.mend();
        Ok(known)
    }

    /// Size of gravity, m/s².
    pub(crate) fn gravity(&self) -> f64 {
        let square: f64 = self.mechanism.gravity.iter().map(|x| x * x).sum();
        square.sqrt()
    }

    /// Name of the joint of a coordinate.
    pub(crate) fn joint(&self, coordinate: usize) -> &str {
        &self.mechanism.bodies[self.drives[coordinate].body].joint
    }

    /// Effects of an identifier.
    pub(crate) fn all<'a>(&'a self, id: &'a str) -> impl Iterator<Item = &'a Named> {
        self.effects.iter().filter(move |e| e.id() == id)
    }

    /// The last effect of an identifier at a coordinate.
    pub(crate) fn at(&self, id: &str, coordinate: usize) -> Option<&Named> {
        let mut own = self.effects.iter().rev();
        own.find(|e| e.id() == id && e.term.joint == coordinate)
    }

    fn check(&self) -> Result<(), ExportError> {
        for body in &self.mechanism.bodies {
            let geometry = body.origin.iter().chain(&body.rpy).chain(&body.axis);
            let inertial = body.com.iter().chain(&body.inertia);
            let drive = [body.rotor, body.coulomb, body.viscous];
            let numbers = geometry.chain(inertial).copied().chain([body.mass]);
            let mut numbers = numbers.chain(drive.into_iter().flatten());
            if let Some(x) = numbers.find(|x| !x.is_finite()) {
                return Err(self.value(
                    body,
                    format!("{x} among its values"),
                    "give finite numbers",
                ));
            }
            if body.mass < 0.0 {
                let value = format!("a mass of {} kg", body.mass);
                return Err(self.value(
                    body,
                    value,
                    "a mass is zero or positive; look at the effect `payload`",
                ));
            }
            if let Some(rotor) = body.rotor.filter(|x| *x < 0.0) {
                let mend = "a rotor inertia is zero or positive; look at the effect `unmodelled_rotor_inertia`";
                return Err(self.value(body, format!("a rotor inertia of {rotor}"), mend));
            }
            if let Some(friction) = [body.coulomb, body.viscous]
                .into_iter()
                .flatten()
                .find(|x| *x < 0.0)
            {
                let mend = "friction coefficients are zero or positive";
                return Err(self.value(body, format!("a friction of {friction}"), mend));
            }
        }
        Ok(())
    }

    fn value(&self, body: &Body, value: String, mend: &'static str) -> ExportError {
        ExportError::Value {
            robot: self.mechanism.name.clone(),
            item: format!("joint `{}`", body.joint),
            value,
            mend,
        }
    }

    /// Inertias that no body has become the nearest ones that a body has; bodies without mass become
    /// light ones.
    fn mend(&mut self) {
        let still = vec![0.0; self.mechanism.bodies.len()];
        let before = self.mechanism.felt(&still);
        let mut changed = Vec::new();
        for body in &mut self.mechanism.bodies {
            let (inertia, excess) = plausible::nearest(body.inertia);
            if excess > 0.0 {
                changed.push((body.joint.clone(), excess));
            }
            body.inertia = plausible::raised(inertia, LEAST);
            body.mass = body.mass.max(LEAST);
        }
        if changed.is_empty() {
            return;
        }
        let after = self.mechanism.felt(&still);
        let largest = before
            .iter()
            .zip(&after)
            .map(|(x, y)| (y - x).abs() / x.abs().max(LEAST))
            .fold(0.0, f64::max);
        for (joint, excess) in changed {
            self.mended.push(format!(
                "The link of joint `{joint}` has an inertia that no body has: its largest principal moment exceeds the sum of \
                 the others by {excess:.3e} kg m^2. The nearest inertia that a body has is written. The inertia that a joint \
                 feels changes by up to {:.2} %.",
                100.0 * largest
            ));
        }
    }
}

/// Drives, and their values at the bodies.
fn drives(
    nominal: &description::Nominal,
    mechanism: &mut Mechanism,
    constants: &Constants<'_, f64>,
    effects: &[Named],
) -> Vec<Drive> {
    let robot = nominal.robot();
    let channels = &nominal.measurement().channels;
    let mut out = Vec::new();
    for coordinate in 0..robot.nq() {
        let of = |j: &Joint| j.coord == Some(coordinate);
        let Some(joint) = robot.joints.iter().find(|j| of(j)) else {
            continue;
        };
        let body = joint.child;
        let coulomb = constants.get(Constant::Coulomb(coordinate));
        let induced = constants.induced(coordinate);
        let viscous = constants.get(Constant::Viscous(coordinate)) + induced;
        let own = &mut mechanism.bodies[body];
        own.rotor = Some(constants.get(Constant::Rotor(coordinate)));
        (own.coulomb, own.viscous) = (Some(coulomb), Some(viscous));
        let mut gears = effects.iter().rev();
        let gear = gears.find_map(|e| {
            (e.term.joint == coordinate).then(|| e.term.effect.plain().gear(&e.values))?
        });
        let channel = channels.get(coordinate);
        out.push(Drive {
            body,
            gain: constants.get(Constant::Gain(coordinate)),
            coulomb,
            viscous,
            induced,
            unit: robot
                .inputs
                .get(coordinate)
                .map_or_else(String::new, |input| input.unit.clone()),
            velocity: channel.map_or(Velocity::Measured { noise: None }, |c| c.velocity),
            peak: channel.and_then(|c| c.torque_peak),
            gear,
            position_loop: None,
            known_gain: constants.get(Constant::Gain(coordinate)),
        });
    }
    out
}

/// The bodies of a robot at the nominal values of its parameters.
fn tree(robot: &Robot) -> Result<Mechanism, ExportError> {
    let source = Source {
        robot,
        p: robot.params.iter().map(|p| p.nominal).collect(),
    };
    if robot.lagrangian.is_some() || robot.potential.is_some() || !robot.motors.is_empty() {
        let what = "it is declared by a Lagrangian, a potential, or drives on several joints";
        return Err(source.fault(what.to_owned(), "declare its links and joints"));
    }
    let places = robot.order.iter().enumerate();
    let bodies = places
        .map(|(place, &index)| source.body(place, &robot.joints[index]))
        .collect::<Result<_, _>>()?;
    let mut gravity = [0.0; 3];
    for (g, x) in gravity.iter_mut().zip(&robot.gravity) {
        *g = source.number(x, "gravity")?;
    }
    Ok(Mechanism {
        name: robot.name.clone(),
        gravity,
        bodies,
    })
}

/// A robot and the nominal values of its parameters.
struct Source<'a> {
    robot: &'a Robot,
    p: Vec<f64>,
}

impl Source<'_> {
    fn fault(&self, what: String, mend: &str) -> ExportError {
        ExportError::Structure {
            robot: self.robot.name.clone(),
            what,
            mend: mend.to_owned(),
        }
    }

    /// The value of an expression of `item`.
    fn number(&self, x: &Expr, item: &str) -> Result<f64, ExportError> {
        value(x, &self.p).ok_or_else(|| {
            self.fault(
                format!("{item} is no number"),
                "state lengths and inertias as numbers or parameters",
            )
        })
    }

    /// The link that the `place`-th joint in order carries.
    fn body(&self, place: usize, joint: &Joint) -> Result<Body, ExportError> {
        let item = format!("joint `{}`", joint.name);
        let (prismatic, axis) = match joint.kind {
            JointKind::Revolute(axis) => (false, axis),
            JointKind::Prismatic(axis) => (true, axis),
            _ => {
                return Err(self.fault(format!("{item} neither turns nor slides"), "leave it out"));
            }
        };
        if joint.child != place {
            let what = format!(
                "{item} carries link {}, listed at another place",
                joint.child + 1
            );
            return Err(self.fault(what, "list links in the order of their joints"));
        }
        let follows = self.follows(joint, &item)?;
        let three = |x: &[Expr; 3]| -> Result<[f64; 3], ExportError> {
            Ok([
                self.number(&x[0], &item)?,
                self.number(&x[1], &item)?,
                self.number(&x[2], &item)?,
            ])
        };
        let link = &self.robot.links[joint.child];
        let own = inertial(&link.inertial, &|x| self.number(x, &item))?;
        Ok(Body {
            joint: joint.name.clone(),
            link: link.name.clone(),
            prismatic,
            axis,
            parent: joint.parent,
            origin: three(&joint.origin)?,
            rpy: three(&joint.rpy)?,
            follows,
            limits: joint.limits,
            mass: own.mass,
            com: own.com,
            inertia: own.inertia,
            source: InertiaSource::Stated,
            rotor: None,
            coulomb: None,
            viscous: None,
            effort: None,
            speed: None,
        })
    }

    /// The joint that a joint without a coordinate follows.
    fn follows(&self, joint: &Joint, item: &str) -> Result<Option<Follows>, ExportError> {
        let (Some(affine), None) = (&joint.follows, joint.coord) else {
            return Ok(None);
        };
        let [(coordinate, ratio)] = &affine.terms[..] else {
            return Err(self.fault(
                format!("{item} follows several joints, or none"),
                "let it follow one",
            ));
        };
        let mut joints = self.robot.joints.iter();
        let Some(leader) = joints.find(|j| j.coord == Some(*coordinate)) else {
            return Ok(None);
        };
        Ok(Some(Follows {
            body: leader.child,
            ratio: self.number(ratio, item)?,
            offset: self.number(&affine.offset, item)?,
        }))
    }
}

/// Mass, centre of mass, and inertia about it.
fn inertial(
    inertial: &Inertial,
    number: &dyn Fn(&Expr) -> Result<f64, ExportError>,
) -> Result<Distribution, ExportError> {
    let six = |t: &Tensor| -> Result<[f64; 6], ExportError> {
        let mut out = [0.0; 6];
        for (x, e) in out
            .iter_mut()
            .zip([&t.xx, &t.yy, &t.zz, &t.xy, &t.xz, &t.yz])
        {
            *x = number(e)?;
        }
        Ok(out)
    };
    let three = |x: &[Expr; 3]| -> Result<[f64; 3], ExportError> {
        Ok([number(&x[0])?, number(&x[1])?, number(&x[2])?])
    };
    let (mass, com, inertia, about) = match inertial {
        Inertial::None => return Ok(Distribution::default()),
        Inertial::Body {
            mass,
            com,
            inertia,
            about,
        } => (number(mass)?, three(com)?, six(inertia)?, *about),
        Inertial::Linear {
            mass,
            first_moment,
            inertia,
        } => {
            let mass = number(mass)?;
            let com = three(first_moment)?.map(|x| if mass == 0.0 { 0.0 } else { x / mass });
            (mass, com, six(inertia)?, About::Origin)
        }
    };
    let shift = Distribution {
        mass,
        com,
        inertia: [0.0; 6],
    };
    let inertia = match about {
        About::Com => inertia,
        About::Origin => {
            let of_point = shift.about([0.0; 3]);
            std::array::from_fn(|k| inertia[k] - of_point[k])
        }
    };
    Ok(Distribution { inertia, ..shift })
}

/// The value of an expression of numbers and parameters.
fn value(x: &Expr, p: &[f64]) -> Option<f64> {
    let of = |x: &Expr| value(x, p);
    Some(match x {
        Expr::Num(x) => *x,
        Expr::Param(k) => *p.get(*k)?,
        Expr::Blank(_) => 0.0,
        Expr::Neg(x) => -of(x)?,
        Expr::Add(x, y) => of(x)? + of(y)?,
        Expr::Sub(x, y) => of(x)? - of(y)?,
        Expr::Mul(x, y) => of(x)? * of(y)?,
        Expr::Div(x, y) => of(x)? / of(y)?,
        Expr::Powi(x, n) => of(x)?.powi(*n),
        Expr::Input(_) | Expr::Position(_) | Expr::Velocity(_) | Expr::Call(..) => return None,
    })
}
