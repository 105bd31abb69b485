//! What an effect is: a description, parameters, and the places where it enters the simulation.
//!
//! An effect implements [`Law`] once, generic over [`Scalar`]; everything else follows. The
//! simulation calls the hooks it overrides. One substep of length δ is, for every coordinate (A.
//! Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008, chapter 10; here
//! with midpoint forces):
//!
//! ```text
//! M (v⁺ − v) = δ (k u_a − b + F(q½, v½) − R (v + v⁺)/2 − λ),     λ ∈ [level]·Sgn(v⁺),     q⁺ = q + δ (v + v⁺)/2
//! ```
//!
//! with q½ = q + δ v/2 and dry friction λ that really sticks. Derivatives are those of the active set.

use std::fmt;
use std::sync::Arc;

use pid_interpret::nominal::Gain;
use pid_symbolic::program::Element;

pub use crate::class::Class;
pub use crate::commands::Commands;
use crate::constants::Constants;
pub use crate::equal_when::EqualWhen;
pub use crate::parameter::{Parameter, Quantity, Unit, parameter, quantity};
pub use crate::read_off::{Over, ReadOff};
use crate::scalar::{Lanes, Scalar};
pub use crate::smooth::Smooth;
pub use crate::symbol::Symbol;

/// Lanes of one pass of derivatives.
pub const LANES: usize = 8;
/// Lanes of the inner loop.
pub type Wide = Lanes<LANES>;
/// Directions of [`Narrow`].
pub const FEW: usize = 4;
/// Few derivatives side by side: most refits differentiate in an effect's parameters alone.
pub type Narrow = Lanes<FEW>;

/// Where an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A force in the equations of motion, or a change of their parameters.
    Force,
    /// It brings states of its own.
    State,
    /// Between data and model.
    Channel,
}

/// Everything that is said of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Info {
    /// Identifier.
    pub id: &'static str,
    /// One line for people.
    pub title: &'static str,
    /// The equation.
    pub equation: &'static str,
    /// Where it is described.
    pub source: &'static str,
    /// Kind.
    pub kind: Kind,
    /// What it is a function of.
    pub class: Class,
    /// Whether it belongs to one joint.
    pub has_joint: bool,
    /// Parameters.
    pub parameters: &'static [Parameter],
    /// Start values to search from, in units of the parameters.
    pub starts: &'static [&'static [f64]],
    /// Parameters that are zero when the effect is absent and in which the motion is differentiable
    /// there, whatever the others are: the score test looks at these. Empty if there is no such
    /// point.
    pub amplitudes: &'static [usize],
    /// Effects it is easily taken for, and what tells them apart.
    pub confusions: &'static [(&'static str, &'static str)],
    /// The motion or load that brings it out.
    pub regime: &'static str,
    /// Effects that give the same readings in some circumstances, whatever the motion.
    pub equals: &'static [(&'static str, EqualWhen)],
    /// What models it in MuJoCo (MJCF), if anything does.
    pub mujoco: Option<&'static str>,
    /// What models it in Isaac Sim and Isaac Lab, if anything does.
    pub isaac: Option<&'static str>,
    /// What models it in URDF, if anything does.
    pub urdf: Option<&'static str>,
}

/// The motion of all joints at the middle of a substep.
#[derive(Debug, Clone, Copy)]
pub struct Site<'a, D> {
    /// Joint of the effect, from 0.
    pub joint: usize,
    /// Positions of the drive side (the side with friction and drive).
    pub q: &'a [D],
    /// Velocities of the drive side.
    pub v: &'a [D],
    /// Torque passed through the gear to the links in the step before, per joint.
    pub load: &'a [D],
    /// Time since the start of the record, s.
    pub t: f64,
    /// Length of the substep, s.
    pub dt: f64,
    /// Velocity over which dry friction changes its sign, where a smooth form is asked for; `None`: it jumps.
    pub rest: Option<f64>,
}

impl<D: Scalar> Site<'_, D> {
    /// Sign of the joint's velocity, tanh(v/v₀) where a smooth form is asked for.
    pub fn direction(&self) -> D {
        let v = self.v[self.joint];
        match self.rest {
            Some(rest) => (v / rest).hyperbolic_tangent(),
            None => D::constant(if v.value() > 0.0 { 1.0 } else { -1.0 }),
        }
    }
    /// Absolute value of the joint's velocity, v tanh(v/v₀) where a smooth form is asked for.
    pub fn speed(&self) -> D {
        let v = self.v[self.joint];
        match self.rest {
            Some(_) => v * self.direction(),
            None => v.magnitude(),
        }
    }
}

/// Dry and viscous friction of one joint: the nominal `f_c`, `f_v`, which effects change.
#[derive(Debug, Clone, Copy)]
pub struct Friction<D> {
    /// Level while moving in the positive direction.
    pub forward: D,
    /// Level while moving in the negative direction.
    pub backward: D,
    /// Viscous coefficient.
    pub viscous: D,
}

impl<D: Copy> Friction<D> {
    /// None; `zero` is that number.
    pub(crate) fn none(zero: D) -> Self {
        Friction {
            forward: zero,
            backward: zero,
            viscous: zero,
        }
    }
}

/// Generalised forces to add, per joint: `value − rate · (v + v⁺)/2`.
#[derive(Debug)]
pub struct Forces<'a, D> {
    /// Force, explicit part.
    pub value: &'a mut [D],
    /// Damping, treated implicitly.
    pub rate: &'a mut [D],
}

/// Connection of rotor and link.
#[derive(Debug, Clone, Copy)]
pub struct Gear<D> {
    /// Stiffness, N m/rad.
    pub stiffness: D,
    /// Damping while it touches, beside that of [`Gear::open`], N m s/rad.
    pub damping: D,
    /// Damping throughout, while the play is open too, N m s/rad.
    pub open: D,
    /// Free travel, rad.
    pub gap: D,
}

/// What has happened in a substep.
#[derive(Debug, Clone, Copy)]
pub struct After<D> {
    /// Mean velocity of the drive side.
    pub v: D,
    /// Length of the substep, s.
    pub dt: f64,
    /// Nominal Coulomb friction.
    pub coulomb: D,
}

/// What a memory sees in equations of motion: see [`Law::flow`].
#[derive(Debug, Clone, Copy)]
pub struct Flow<D> {
    /// Velocity of the drive side.
    pub v: D,
    /// Its absolute value, smooth at rest.
    pub speed: D,
    /// Commanded input.
    pub u: D,
    /// The memory.
    pub w: D,
    /// Nominal Coulomb friction.
    pub coulomb: D,
}

/// A memory as a state of equations of motion: `time · dw/dt = rate`.
#[derive(Debug, Clone, Copy)]
pub struct Flowing<D> {
    /// Positive factor of dw/dt.
    pub time: D,
    /// What it equals.
    pub rate: D,
    /// Input that acts, where the memory is a drive's.
    pub input: Option<D>,
    /// Friction in place of dry friction, where it is one of friction.
    pub friction: Option<D>,
}

/// Force laws of an effect in the words of `robot!`. In braces stand parameters of the effect (also
/// `own.NAME`), and of the joint: `coulomb`, `viscous`, `gain`, `input`, `q`, `v`, `sign` (of the
/// velocity, smooth), `round`, `round_q`, `round_v` (of absolute values of forces, positions and
/// velocities), and `q_before`, `v_before` of the joint before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Source {
    /// Additional force on the joint; empty for none.
    pub own: &'static str,
    /// Additional force on the joint before.
    pub before: Option<&'static str>,
}

/// Equation of an effect at one joint; all hooks have a default that does nothing. `e`: the
/// parameters, SI units.
pub trait Law<D: Scalar>: Send + Sync {
    /// Changes constants of the robot.
    fn constants(&self, _e: &[D], _joint: usize, _constants: &mut Constants<D>) {}
    /// Applied input, averaged over the substep, from the commanded one (`u`, averaged too).
    fn input(&self, _e: &[D], u: D, _at: &Commands<'_>, _memory: &mut [D]) -> D {
        u
    }
    /// Applied input from that of the joint and the sum of the sizes of those of all other joints, each before its
    /// effects: what was commanded, or the output of a position loop.
    fn shared(&self, _e: &[D], u: D, _others: D) -> D {
        u
    }
    /// Changes the friction of the joint.
    fn friction(&self, _e: &[D], _at: &Site<'_, D>, _memory: &[D], _f: &mut Friction<D>) {}
    /// By how much the friction that it adds grows with the torque through the gear, in the smooth form: nothing but a
    /// term of its own may depend on that torque.
    fn load_slope(&self, _e: &[D], _at: &Site<'_, D>) -> Option<D> {
        None
    }
    /// Adds forces.
    fn force(
        &self,
        _e: &[D],
        _at: &Site<'_, D>,
        _memory: &[D],
        _f: &mut Forces<'_, D>,
        _constants: &Constants<D>,
    ) {
    }
    /// Force on the tool point in base axes, averaged over the substep.
    fn tip_force(&self, _e: &[D], _t: f64, _dt: f64) -> Option<[D; 3]> {
        None
    }
    /// Acceleration of the base at a time, m/s² in base axes.
    fn base_acceleration(&self, _e: &[D], _t: f64) -> Option<[D; 3]> {
        None
    }
    /// Splits the joint into rotor and link.
    fn gear(&self, _e: &[D]) -> Option<Gear<D>> {
        None
    }
    /// Updates the memory at the end of a substep.
    fn advance(&self, _e: &[D], _after: &After<D>, _memory: &mut [D]) {}
    /// Reading of position and velocity from the true ones.
    fn sense(&self, _e: &[D], q: D, v: D) -> (D, D) {
        (q, v)
    }
    /// How much later the readings come, s.
    fn reading_delay(&self, _e: &[D]) -> Option<D> {
        None
    }
    /// Time constant of an additional filter of the velocity reading, s.
    fn velocity_lag(&self, _e: &[D]) -> Option<D> {
        None
    }
    /// The first memory cell as a state in continuous time, for equations of motion that are
    /// integrated by other schemes than the simulation's substeps; `None` if it has no such form.
    fn flow(&self, _e: &[D], _at: &Flow<D>) -> Option<Flowing<D>> {
        None
    }
    /// Memory at the start of a record. `balance`: drive torque less gravity at rest; `u`: first input.
    fn start(&self, _e: &[D], _balance: D, _coulomb: D, _u: f64, _memory: &mut [D]) {}
}

/// An effect for use behind a pointer: [`Law`] over every scalar the tool computes with.
///
/// Implemented by [`Model`]'s blanket implementation; see there for how to add an effect.
pub trait Effect: Send + Sync {
    /// Description.
    fn info(&self) -> &'static Info;
    /// Number of memory cells.
    fn memory(&self) -> usize;
    /// Largest value of the first memory cell, if no reading tells its value at the start of a record.
    fn largest_memory(&self) -> Option<f64>;
    /// Another joint the effect acts on.
    fn partner(&self, joint: usize) -> Option<usize>;
    /// Whether it cannot be at a joint without partner.
    fn needs_partner(&self) -> bool;
    /// Parameters at whose zero the law is another one: each must differ from zero beside the amplitudes.
    fn essential(&self) -> &'static [usize];
    /// Whether it acts on the bodies of a robot: there are none where a robot is declared by its Lagrangian.
    fn needs_bodies(&self) -> bool;
    /// Whether it acts on the inputs of all joints together ([`Law::shared`]): it needs several.
    fn needs_inputs(&self) -> bool;
    /// Parameters that are times at which the effect goes on and off, in pairs; its amplitudes act
    /// between them.
    fn edges(&self) -> &'static [usize];
    /// Whether its [`Law::input`] acts on the command, before a position loop of the drive; the others
    /// act between the drive and its motor.
    fn before_drive(&self) -> bool;
    /// The stage of a position loop that it is: it needs a loop without a stated stage of this kind.
    fn stage(&self) -> Option<Gain>;
    /// Parameters whose starts are read off the records, beside [`Info::starts`].
    fn read_off(&self) -> Option<ReadOff>;
    /// Its force laws in the words of `robot!`, if equations of motion take it as a force.
    fn source(&self) -> Option<Source>;
    /// Physical magnitudes for the report.
    fn shown(&self, e: &[f64], gain: f64, rated: f64) -> Vec<Quantity>;
    /// Over plain numbers.
    fn plain(&self) -> &dyn Law<f64>;
    /// Over lanes of derivatives.
    fn wide(&self) -> &dyn Law<Wide>;
    /// Over few of them.
    fn narrow(&self) -> &dyn Law<Narrow>;
    /// Over smooth scalars with second derivatives, for equations of motion.
    fn smooth(&self) -> &dyn Law<Smooth>;
    /// Over expressions, for code that computes it.
    fn symbolic(&self) -> &dyn Law<Symbol>;
    /// Over single duals, for tests and users' own derivatives.
    fn dual(&self) -> &dyn Law<num_dual::Dual64>;
}

/// What the author of an effect implements beside [`Law`].
pub trait Model: Send + Sync {
    /// Description.
    fn info(&self) -> &'static Info;
    /// Number of memory cells.
    fn memory(&self) -> usize {
        0
    }
    /// Largest value of the first memory cell, if no reading tells its value at the start of a record.
    fn largest_memory(&self) -> Option<f64> {
        None
    }
    /// Another joint the effect acts on.
    fn partner(&self, _joint: usize) -> Option<usize> {
        None
    }
    /// Whether it cannot be at a joint without partner.
    fn needs_partner(&self) -> bool {
        false
    }
    /// Parameters at whose zero the law is another one: each must differ from zero beside the amplitudes.
    fn essential(&self) -> &'static [usize] {
        &[]
    }
    /// Whether it acts on the bodies of a robot: there are none where a robot is declared by its Lagrangian.
    fn needs_bodies(&self) -> bool {
        false
    }
    /// Whether it acts on the inputs of all joints together ([`Law::shared`]): it needs several.
    fn needs_inputs(&self) -> bool {
        false
    }
    /// Parameters that are times at which the effect goes on and off, in pairs; its amplitudes act
    /// between them.
    fn edges(&self) -> &'static [usize] {
        &[]
    }
    /// Whether its [`Law::input`] acts on the command, before a position loop of the drive; the others
    /// act between the drive and its motor.
    fn before_drive(&self) -> bool {
        false
    }
    /// The stage of a position loop that it is: it needs a loop without a stated stage of this kind.
    fn stage(&self) -> Option<Gain> {
        None
    }
    /// Parameters whose starts are read off the records, beside [`Info::starts`].
    fn read_off(&self) -> Option<ReadOff> {
        None
    }
    /// Its force laws in the words of `robot!`, if equations of motion take it as a force.
    fn source(&self) -> Option<Source> {
        None
    }
    /// Physical magnitudes for the report, from the parameters, the motor gain and the joint's typical input.
    fn shown(&self, e: &[f64], _gain: f64, _rated: f64) -> Vec<Quantity> {
        self.info()
            .parameters
            .iter()
            .zip(e)
            .map(|(p, &x)| quantity(p.name, p.si, x))
            .collect()
    }
}

impl<T> Effect for T
where
    T: Model
        + Law<f64>
        + Law<Wide>
        + Law<Narrow>
        + Law<Smooth>
        + Law<Symbol>
        + Law<num_dual::Dual64>,
{
    fn info(&self) -> &'static Info {
        Model::info(self)
    }
    fn memory(&self) -> usize {
        Model::memory(self)
    }
    fn largest_memory(&self) -> Option<f64> {
        Model::largest_memory(self)
    }
    fn partner(&self, joint: usize) -> Option<usize> {
        Model::partner(self, joint)
    }
    fn needs_partner(&self) -> bool {
        Model::needs_partner(self)
    }
    fn essential(&self) -> &'static [usize] {
        Model::essential(self)
    }
    fn needs_bodies(&self) -> bool {
        Model::needs_bodies(self)
    }
    fn needs_inputs(&self) -> bool {
        Model::needs_inputs(self)
    }
    fn edges(&self) -> &'static [usize] {
        Model::edges(self)
    }
    fn before_drive(&self) -> bool {
        Model::before_drive(self)
    }
    fn stage(&self) -> Option<Gain> {
        Model::stage(self)
    }
    fn read_off(&self) -> Option<ReadOff> {
        Model::read_off(self)
    }
    fn source(&self) -> Option<Source> {
        Model::source(self)
    }
    fn shown(&self, e: &[f64], gain: f64, rated: f64) -> Vec<Quantity> {
        Model::shown(self, e, gain, rated)
    }
    fn plain(&self) -> &dyn Law<f64> {
        self
    }
    fn wide(&self) -> &dyn Law<Wide> {
        self
    }
    fn narrow(&self) -> &dyn Law<Narrow> {
        self
    }
    fn smooth(&self) -> &dyn Law<Smooth> {
        self
    }
    fn symbolic(&self) -> &dyn Law<Symbol> {
        self
    }
    fn dual(&self) -> &dyn Law<num_dual::Dual64> {
        self
    }
}

/// Scalars for which every [`Effect`] offers its equation.
pub trait Pick: Scalar + Element {
    /// Whether it is a plain number: what was solved for values is solved.
    const PLAIN: bool = false;
    /// The equation over this scalar.
    fn of(effect: &dyn Effect) -> &dyn Law<Self>;
}
impl Pick for f64 {
    const PLAIN: bool = true;
    fn of(effect: &dyn Effect) -> &dyn Law<f64> {
        effect.plain()
    }
}
impl Pick for Wide {
    fn of(effect: &dyn Effect) -> &dyn Law<Wide> {
        effect.wide()
    }
}
impl Pick for Narrow {
    fn of(effect: &dyn Effect) -> &dyn Law<Narrow> {
        effect.narrow()
    }
}
impl Pick for num_dual::Dual64 {
    fn of(effect: &dyn Effect) -> &dyn Law<num_dual::Dual64> {
        effect.dual()
    }
}

/// An effect at a joint.
#[derive(Clone)]
pub struct Term {
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// The joint from 0; 0 for effects without one.
    pub joint: usize,
}

impl fmt::Debug for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.label())
    }
}

impl Term {
    /// `effect` or `effect:joint`, joints from 1.
    pub fn label(&self) -> String {
        let info = self.effect.info();
        match self.shown_joint() {
            Some(j) => format!("{}:{j}", info.id),
            None => info.id.to_owned(),
        }
    }
    /// Whether the other effect is one of the [`Info::confusions`] of this one.
    pub fn is_confused_with(&self, other: &Term) -> bool {
        let id = other.effect.info().id;
        self.effect.info().confusions.iter().any(|(c, _)| *c == id)
    }
    /// Whether the effect splits its joint into rotor and link: a contact or a resonance.
    pub fn splits_joint(&self) -> bool {
        let some = vec![1.0; self.effect.info().parameters.len()];
        self.effect.plain().gear(&some).is_some()
    }
    /// The joint from 1, if the effect has one.
    pub fn shown_joint(&self) -> Option<usize> {
        self.effect.info().has_joint.then_some(self.joint + 1)
    }
}
