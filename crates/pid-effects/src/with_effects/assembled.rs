//! The model of a description with its effects, whatever they act on, and the records as it takes
//! them.

use std::f64::consts::TAU;
use std::sync::Arc;

use pid_data::{Dataset, InputQuantity};
use pid_fit::gap::force::States;
use pid_fit::transcribe::Prior;
use pid_fit::wrap::lag::{Lag, LagError, Lagging};
use pid_interpret::Model;
use pid_interpret::nominal::{
    self as description, EncoderSide, NominalError, Role, Servo, Velocity,
};
use pid_runtime::dynamics::{Dynamics, Hessian};

use super::states::{self, Drives, WithStates};
use super::{EffectError, Obstacle, Placed, WithEffects, WithLoops, gain_name, group, with_masses};
use crate::circumstances::Circumstances;
use crate::effect::Effect;
use crate::effects::by_id;
use crate::nominal::Nominal;

/// A description with effects that no estimator takes.
#[derive(Debug, thiserror::Error)]
pub enum AssembleError {
    /// The library does not have an effect as it is stated.
    #[error(transparent)]
    Nominal(#[from] NominalError),
    /// The robot has no equations of motion.
    #[error(transparent)]
    Model(#[from] pid_interpret::Error),
    /// The equations cannot take an effect.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The records have no velocity that could lag.
    #[error(transparent)]
    Lag(#[from] LagError),
}

/// A model with effects.
pub struct Assembled {
    /// The model.
    pub model: Box<dyn Hessian>,
    /// Stated standard deviation of each channel, positions first: `None` where none is stated,
    /// without bound where no sensor reads.
    pub noise: Vec<Option<f64>>,
    /// The records as they were read, where they have got columns since.
    pub read: Option<Dataset>,
    /// Coordinates that are no joints.
    pub states: States,
}

impl Assembled {
    /// Prior knowledge of the description's parameters: uniform within ± tolerance, a deviation of
    /// tolerance/√3.
    pub fn priors(&self, nominal: &description::Nominal) -> Vec<Prior> {
        let all = nominal.tolerances().iter().filter(|t| t.half_width > 0.0);
        let all = all.map(|t| (t.name.clone(), t.nominal, t.half_width));
        let joints = &nominal.robot().joints;
        let gains = joints.iter().enumerate().flat_map(|(j, joint)| {
            let servo = nominal.servo(j);
            let all = servo.into_iter().flat_map(Servo::gains);
            all.filter_map(move |gain| {
                let own = servo?.gain(gain);
                let stated = (gain_name(gain, &joint.name), own.value?, own.half_width);
                Some(stated).filter(|_| own.half_width > 0.0)
            })
        });
        all.chain(gains)
            .filter_map(|(name, mean, half_width)| {
                let mut params = self.model.params().iter();
                Some(Prior {
                    parameter: params.position(|p| p.name == name)?,
                    mean,
                    deviation: half_width / 3.0_f64.sqrt(),
                })
            })
            .collect()
    }
}

/// Puts an effect that equations of motion do not take as one that no motion tells from it on this
/// robot and that they take: on one joint a late reading is a late input.
fn as_equal(nominal: &description::Nominal, own: &mut Placed) {
    let takes = |effect: &dyn Effect| super::takes(effect).is_ok() || states::takes(effect);
    if takes(&*own.term.effect) || filters(own) || nominal.drives().is_some() {
        return;
    }
    let at = Circumstances::of(nominal, own.term.joint);
    let mut equal = own.term.effect.info().equal_to(&at).filter_map(by_id);
    let alike = |e: &Arc<dyn Effect>| {
        let (a, b) = (e.info().parameters, own.term.effect.info().parameters);
        takes(&**e) && a == b
    };
    if let Some(effect) = equal.find(alike) {
        own.term.effect = effect;
    }
}

/// Refuses a law of friction or of the input at a joint where a state takes the place of these.
fn clash(smooth: &[Placed], stateful: &[Placed]) -> Result<(), EffectError> {
    for own in smooth {
        let Ok(hooks) = group::hooks(&*own.term.effect) else {
            continue;
        };
        let friction = hooks.friction || hooks.viscous || hooks.load;
        let mut at = stateful.iter().filter(|s| s.term.joint == own.term.joint);
        if at.any(|s| hooks.input || friction && states::moves_friction(&*s.term.effect)) {
            return Err(EffectError::Obstacle {
                effect: own.term.label(),
                obstacle: Obstacle::Together,
            });
        }
    }
    Ok(())
}

/// Whether the input of a joint in the records is a target that the loop of its drive follows.
fn follows(nominal: &description::Nominal, dataset: &Dataset, joint: usize) -> bool {
    let input = dataset.joints.get(joint).map(|j| j.input);
    nominal.servo(joint).is_some() && input == Some(InputQuantity::Position)
}

/// Refuses what stands between a target and the loop that follows it: a law of the command, and a gear
/// before the reading of the loop.
fn before_loops(
    nominal: &description::Nominal,
    placed: &[Placed],
    dataset: &Dataset,
) -> Result<(), EffectError> {
    let motor_side = nominal.measurement().encoder_side == EncoderSide::Motor;
    for own in placed {
        let effect = &*own.term.effect;
        let geared = motor_side && states::moves_reading(effect);
        if follows(nominal, dataset, own.term.joint) && (effect.before_drive() || geared) {
            return Err(EffectError::Obstacle {
                effect: own.term.label(),
                obstacle: Obstacle::Loop,
            });
        }
    }
    Ok(())
}

/// Whether an effect is a filter of a velocity reading.
fn filters(own: &Placed) -> bool {
    let e = vec![1.0; own.ranges.len()];
    own.term.effect.plain().velocity_lag(&e).is_some()
}

impl Assembled {
    /// Of a description, without its effects.
    ///
    /// # Errors
    /// If the robot has no equations of motion.
    pub fn without_effects(nominal: &description::Nominal) -> Result<Self, AssembleError> {
        Ok(Self {
            model: Box::new(Model::new(nominal.robot())?),
            noise: stated_noise(nominal),
            read: None,
            states: States::default(),
        })
    }

    /// Of a description with its effects, behind the loops of its drives where the records have targets
    /// as inputs. Records get columns for states that no sensor reads, for inputs that act later, and for
    /// velocities whose readings lag.
    ///
    /// # Errors
    /// [`AssembleError`].
    pub fn new(
        nominal: &description::Nominal,
        dataset: &mut Dataset,
    ) -> Result<Self, AssembleError> {
        let mut placed = Placed::of(nominal)?;
        placed.iter_mut().for_each(|own| as_equal(nominal, own));
        let (robot, placed) = match placed.is_empty() {
            true => (nominal.robot().clone(), placed),
            false => with_masses(&Nominal::new(nominal.clone()), placed),
        };
        let (lags, placed): (Vec<_>, Vec<_>) = placed.into_iter().partition(filters);
        let (stateful, smooth): (Vec<_>, Vec<_>) =
            (placed.into_iter()).partition(|own| states::takes(&*own.term.effect));
        clash(&smooth, &stateful)?;
        before_loops(nominal, &stateful, dataset)?;
        before_loops(nominal, &smooth, dataset)?;
        let mut model: Box<dyn Hessian> = Box::new(Model::new(&robot)?);
        if !smooth.is_empty() {
            model = Box::new(WithEffects::new(model, &smooth)?);
        }
        let mut noise = stated_noise(nominal);
        let joints = 0..dataset.nq();
        let looped = joints.clone().any(|j| follows(nominal, dataset, j));
        let wide = !stateful.is_empty() || !lags.is_empty() || looped;
        let read = wide.then(|| dataset.clone());
        if !stateful.is_empty() {
            let drives = drives(nominal, model.as_ref());
            let with = WithStates::new(model, &stateful, &drives, dataset)?;
            noise = with.noise(&noise);
            model = Box::new(with);
        }
        if looped {
            let servos: Vec<_> = joints.map(|j| nominal.servo(j)).collect();
            let before = model.dims().nq;
            let with = WithLoops::new(model, &servos, nominal, dataset);
            for _ in 0..with.states() {
                noise.insert(before, Some(f64::INFINITY));
                noise.push(Some(f64::INFINITY));
            }
            model = Box::new(with);
        }
        let with = Self {
            model,
            noise,
            read,
            states: States::default(),
        };
        let mut with = lagging(nominal, with, &lags, dataset)?;
        let nq = with.model.dims().nq;
        let none = |c: usize| with.noise.get(c) == Some(&Some(f64::INFINITY));
        let unread = |j: &usize| none(*j) && none(nq + j);
        with.states.unread = (0..nq).filter(unread).collect();
        Ok(with)
    }
}

/// Stated noise of sensors; noise of zero means that nobody measured it.
fn stated_noise(nominal: &description::Nominal) -> Vec<Option<f64>> {
    let channels = &nominal.measurement().channels;
    let stated = |x: Option<f64>| x.filter(|x| *x > 0.0);
    let position = channels.iter().map(|c| stated(c.position_std()));
    let velocity = channels.iter().map(|c| match c.velocity {
        Velocity::Measured { noise } => stated(noise),
        Velocity::Derived { .. } | Velocity::Absent => None,
    });
    position.chain(velocity).collect()
}

/// Side of the encoders, and the rotor inertias among the parameters.
fn drives(nominal: &description::Nominal, model: &dyn Dynamics) -> Drives {
    let rotor = |joint: usize| {
        let mut all = nominal.tolerances().iter();
        let own = all.find(|t| t.joint == Some(joint) && t.role == Role::RotorInertia)?;
        model.params().iter().position(|p| p.name == own.name)
    };
    Drives {
        side: nominal.measurement().encoder_side,
        rotors: (0..model.dims().nq).map(rotor).collect(),
    }
}

/// Lags of velocity readings: where the velocity is derived from positions, behind the filter of
/// the derivative.
fn lagging(
    nominal: &description::Nominal,
    with: Assembled,
    lags: &[Placed],
    dataset: &mut Dataset,
) -> Result<Assembled, LagError> {
    let Assembled {
        mut model,
        mut noise,
        read,
        ..
    } = with;
    let h = states::step(dataset);
    let mut readings = Vec::new();
    for own in lags {
        let joint = own.term.joint;
        let mut name = model.joints()[joint].name.to_string();
        let info = own.term.effect.info();
        let parameter = format!("{}_{}_{name}", info.id, info.parameters[0].name);
        let channel = nominal.measurement().channels.get(joint);
        let derived = channel.and_then(|c| match c.velocity {
            Velocity::Derived { filter_hz } => filter_hz,
            _ => None,
        });
        let mut stages = Vec::new();
        if let Some(hz) = derived {
            // The difference quotient has half a sample more delay, the filter at the samples half
            // a sample less.
            let time = 1.0 / (TAU * hz);
            stages.push(Lag {
                joint: name.clone(),
                name: format!("velocity_filter_{name}"),
                range: (time, time, time),
                fixed: true,
                sooner: 0.0,
            });
        }
        let (start, lower, upper) = own.ranges[0];
        stages.push(Lag {
            joint: String::new(),
            name: parameter,
            range: (start, lower.max(h), upper),
            fixed: false,
            sooner: 0.5 * h,
        });
        let mut at = joint;
        for mut stage in stages {
            stage.joint.clone_from(&name);
            let n = model.dims().nq;
            let lagging = Lagging::of(model, &[stage], dataset)?;
            // The reading moves to the coordinate of the lag; its position is read nowhere.
            let velocity = noise[n + at].replace(f64::INFINITY);
            noise.insert(n, Some(f64::INFINITY));
            noise.push(velocity);
            readings.push(n);
            at = n;
            name = lagging.joints()[at].name.to_string();
            model = Box::new(lagging);
        }
    }
    Ok(Assembled {
        model,
        noise,
        read,
        states: States {
            readings,
            ..States::default()
        },
    })
}
