//! Mass matrix and bias of a robot over any number, for simulations that change its constants.
//!
//! ```text
//! M(q) a + b(q, v) − J(q)ᵀ f
//! ```
//!
//! with a force f on a tool point. M leaves out the rotors of the coordinates: a drive may sit
//! behind a gear. Three programs on the equations of `pid-derive` share the work:
//! [`Links::constants`] from parameters to constants (gravity, ten inertial parameters a body,
//! rotor inertias), once; [`Links::prepare`] everything that does not depend on the motion, once
//! after the constants were changed; [`Links::evaluate`] the rest, at every step. None allocates
//! after its first call.

use pid_derive::links::{GRAVITY, PER_BODY, Tool, links};
use pid_derive::model::Robot;
use pid_symbolic::program::{Element, Scratch};
use pid_symbolic::{Function, Graph, Id, Node, Program, hoist};

/// A constant of a robot, by what it is. Bodies and coordinates count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Constant {
    /// Component of the acceleration of gravity in base axes, m/s².
    Gravity(usize),
    /// Mass of a body, kg.
    Mass(usize),
    /// Component of the first moment m·c of a body in its frame, kg·m: body, axis.
    Moment(usize, usize),
    /// Entry xx, yy, zz, xy, xz, yz of the inertia of a body about the origin of its frame, kg·m²:
    /// body, entry.
    Inertia(usize, usize),
    /// Rotor inertia (kg·m²) or mass (kg) at a coordinate.
    Rotor(usize),
}

/// The programs of one robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Links {
    nq: usize,
    bodies: usize,
    body_of: Vec<Option<usize>>,
    constants: Program,
    prepare: Stage,
    free: Motion,
    pushed: Option<Motion>,
    tool: Option<(usize, [f64; 3])>,
}

/// What depends on parameters and constants alone.
#[derive(Debug, Clone, PartialEq)]
struct Stage {
    program: Program,
    /// First variable of the parameters and of the constants.
    params: usize,
    constants: usize,
}

/// M and b at a motion.
#[derive(Debug, Clone, PartialEq)]
struct Motion {
    program: Program,
    /// Coordinates whose sine or cosine it reads.
    turning: Vec<usize>,
}

/// Memory of evaluations.
#[derive(Debug, Clone)]
pub struct Work<T> {
    free: Scratch<T>,
    /// Of the motion with a force on the tool, from the first evaluation with one on.
    pushed: Option<Scratch<T>>,
    prepared: Vec<T>,
    /// Of what is prepared.
    stage: Scratch<T>,
    lower: Vec<T>,
}

impl<T: Element> Work<T> {
    /// The lower triangle of M, row by row, of the last evaluation.
    pub fn mass(&self) -> &[T] {
        &self.lower
    }
}

/// The motion at which M and b are wanted.
#[derive(Debug, Clone, Copy)]
pub struct At<'a, T> {
    /// Positions.
    pub q: &'a [T],
    /// Velocities.
    pub v: &'a [T],
    /// A force on the tool point, in base axes, N.
    pub force: Option<[T; 3]>,
}

impl Links {
    /// Of a robot, with a tool on a link: its index and the point in its frame, m.
    ///
    /// The robot must be one that [`Model::new`](crate::Model::new) takes.
    pub fn new(robot: &Robot, tool: Option<(usize, [f64; 3])>) -> Self {
        let mut g = Graph::new();
        let derived = links(&mut g, robot, tool.map(|(link, at)| Tool { link, at }));
        let nq = derived.symbols.q.len();
        let params = 3 * nq + robot.inputs.len();
        let constants = Program::new(&g, &derived.values).exact();
        // Of the motion's program: q, v, sines, cosines, force, then what is prepared.
        let known = 4 * nq + 3;
        let slow = |var: u32| {
            let var = var as usize;
            (params..params + robot.params.len()).contains(&var)
                || (derived.first..derived.first + derived.values.len()).contains(&var)
        };
        let mut outputs = derived.mass_matrix.clone();
        outputs.extend(&derived.bias);
        let m = derived.mass_matrix.len();
        let mut all = outputs.clone();
        if let Some(pushed) = &derived.pushed {
            all.extend(pushed);
        }
        // Variables of the force come right before the prepared ones.
        let force: Vec<(Id, usize)> = derived
            .force
            .iter()
            .zip(4 * nq..)
            .map(|(&x, k)| (x, k))
            .collect();
        let mut given = force;
        let mut turning = vec![false; nq];
        for (j, &q) in derived.symbols.q.iter().enumerate() {
            for (f, from) in [(Function::Sin, 2 * nq), (Function::Cos, 3 * nq)] {
                if let Some(id) = g.find(&Node::Call(f, q)) {
                    given.push((id, from + j));
                    turning[j] = true;
                }
            }
        }
        let split = hoist(&mut g, &all, slow, known, &given);
        let program = |outputs: &[Id]| {
            let program = Program::new(&g, outputs);
            let reads = |j: usize| {
                program.reads(2 * nq + j..2 * nq + j + 1)
                    || program.reads(3 * nq + j..3 * nq + j + 1)
            };
            Motion {
                turning: (0..nq).filter(|&j| turning[j] && reads(j)).collect(),
                program,
            }
        };
        let (inertial, push) = split.after.split_at(outputs.len());
        let pushed = derived
            .pushed
            .as_ref()
            .map(|_| program(&[&inertial[..m], push].concat()));
        Self {
            nq,
            bodies: derived.bodies,
            tool: tool.and_then(|(_, at)| Some((derived.tool_body?, at))),
            constants,
            prepare: Stage {
                program: Program::new(&g, &split.before).exact(),
                params,
                constants: derived.first,
            },
            free: program(inertial),
            pushed,
            body_of: derived.body_of,
        }
    }

    /// Number of coordinates.
    pub fn nq(&self) -> usize {
        self.nq
    }

    /// Number of bodies with constants of their own; none of a robot declared by its Lagrangian.
    pub fn bodies(&self) -> usize {
        self.bodies
    }

    /// The body that a coordinate moves by itself.
    pub fn body_of(&self, coordinate: usize) -> Option<usize> {
        self.body_of.get(coordinate).copied().flatten()
    }

    /// The body that carries the tool, and the tool point in its frame, m.
    pub fn tool(&self) -> Option<(usize, [f64; 3])> {
        self.tool
    }

    /// Place of a constant; `None` if the robot has no such.
    pub fn place(&self, which: Constant) -> Option<usize> {
        let body = |b: usize, from: usize, i: usize, of: usize| {
            (b < self.bodies && i < of).then_some(GRAVITY + PER_BODY * b + from + i)
        };
        match which {
            Constant::Gravity(i) => (self.bodies > 0 && i < GRAVITY).then_some(i),
            Constant::Mass(b) => body(b, 0, 0, 1),
            Constant::Moment(b, i) => body(b, 1, i, 3),
            Constant::Inertia(b, i) => body(b, 4, i, 6),
            Constant::Rotor(j) => (j < self.nq).then_some(GRAVITY + PER_BODY * self.bodies + j),
        }
    }

    /// Operations of one evaluation and slots of its program, without a force on the tool.
    pub fn size(&self) -> (usize, usize) {
        (
            self.free.program.instructions().0,
            self.free.program.slots(),
        )
    }

    /// The constants at the parameters `p` of the robot.
    ///
    /// # Panics
    /// If `p` has fewer entries than the robot has parameters.
    pub fn constants<T: Element>(&self, p: &[T]) -> Vec<T> {
        let mut out = vec![T::splat(0.0); self.constants.outputs()];
        let fill = |z: &mut [T]| fill_from(z, self.prepare.params, p);
        self.constants
            .evaluate(&mut Scratch::new(), fill, [&mut out]);
        out
    }

    /// Everything that depends on parameters and constants alone.
    ///
    /// # Panics
    /// If `p` or `constants` are too short.
    pub fn prepare<T: Element>(&self, p: &[T], constants: &[T]) -> Work<T> {
        let mut prepared = vec![T::splat(0.0); self.prepare.program.outputs()];
        let mut stage = Scratch::new();
        self.prepare_into(&mut stage, (p, constants), &mut prepared);
        Work {
            free: self.loaded(&self.free, &prepared),
            pushed: None,
            prepared,
            stage,
            lower: vec![T::splat(0.0); self.nq * (self.nq + 1) / 2],
        }
    }

    fn prepare_into<T: Element>(
        &self,
        stage: &mut Scratch<T>,
        (p, constants): (&[T], &[T]),
        prepared: &mut [T],
    ) {
        let fill = |z: &mut [T]| {
            fill_from(z, self.prepare.params, p);
            fill_from(z, self.prepare.constants, constants);
        };
        self.prepare.program.evaluate(stage, fill, [prepared]);
    }

    /// The same as [`Self::prepare`] in memory that is there already: for constants that change with the
    /// time. Allocates nothing.
    ///
    /// # Panics
    /// If `p` or `constants` are too short.
    pub fn renew<T: Element>(&self, work: &mut Work<T>, p: &[T], constants: &[T]) {
        self.prepare_into(&mut work.stage, (p, constants), &mut work.prepared);
        let prepared = &work.prepared;
        let fill = |z: &mut [T]| fill_from(z, 4 * self.nq + 3, prepared);
        self.free.program.load(&mut work.free, fill);
        if let (Some(pushed), Some(scratch)) = (&self.pushed, &mut work.pushed) {
            pushed.program.load(scratch, fill);
        }
    }

    /// The work space of a motion that holds what was prepared.
    fn loaded<T: Element>(&self, motion: &Motion, prepared: &[T]) -> Scratch<T> {
        let mut scratch = Scratch::new();
        let fill = |z: &mut [T]| fill_from(z, 4 * self.nq + 3, prepared);
        motion.program.load(&mut scratch, fill);
        scratch
    }

    /// M (to [`Work::mass`]) and b − Jᵀ f at a motion; `turn` is sine and cosine. A force without a
    /// tool does nothing.
    ///
    /// # Panics
    /// If `q`, `v` or `bias` do not have one entry per coordinate.
    #[inline(always)]
    pub fn evaluate<T: Element>(
        &self,
        work: &mut Work<T>,
        at: &At<'_, T>,
        turn: impl Fn(T) -> (T, T),
        bias: &mut [T],
    ) {
        let n = self.nq;
        let (motion, scratch) = match (&self.pushed, at.force) {
            (Some(pushed), Some(_)) => {
                let prepared = &work.prepared;
                let own = &mut work.pushed;
                let scratch = own.get_or_insert_with(|| self.loaded(pushed, prepared));
                (pushed, scratch)
            }
            _ => (&self.free, &mut work.free),
        };
        let lower = &mut work.lower[..];
        let fill = |z: &mut [T]| {
            fill_from(z, 0, at.q);
            fill_from(z, n, at.v);
            for &j in &motion.turning {
                let (s, c) = turn(at.q[j]);
                for (k, x) in [(2 * n + j, s), (3 * n + j, c)] {
                    if let Some(z) = z.get_mut(k) {
                        *z = x;
                    }
                }
            }
            if let Some(force) = &at.force {
                fill_from(z, 4 * n, force);
            }
        };
        motion.program.resume(scratch, fill, [lower, bias]);
    }
}

/// Writes the variables from number `first` on, as far as the program has them.
#[inline(always)]
fn fill_from<T: Copy>(z: &mut [T], first: usize, values: &[T]) {
    if let Some(z) = z.get_mut(first..) {
        for (z, &x) in z.iter_mut().zip(values) {
            *z = x;
        }
    }
}
