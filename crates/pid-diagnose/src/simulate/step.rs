//! The step itself: the inner loop, compiled for AVX2 with FMA beside the portable form and chosen
//! at run time.

use pid_interpret::links;
use pid_lanes::kernel::widest;

use super::{Machine, State};
use crate::effect::{After, Commands, Forces, Friction, Pick, Site};

impl<D: Pick> Machine<'_, D> {
    /// Moves the state by one substep of `at(j).dt` from `at(j).t`; `commands` holds the inputs of
    /// each joint.
    ///
    /// `links`: time, s, for whose middle mass matrix and bias are evaluated, from this step on;
    /// `None`: those of the steps before serve. Contacts and resonances of a gear need short steps,
    /// the links behind it do not (C. W. Gear, D. R. Wells, Multirate linear multistep methods, BIT
    /// 24, 1984).
    pub(crate) fn step(
        &mut self,
        state: &mut State<D>,
        commands: &[Commands<'_>],
        links: Option<f64>,
    ) {
        // Everything generic that it calls is compiled into it.
        widest!(_simd => self.advance(state, commands, links));
    }

    /// [`Machine::step`] for the processor features of its caller.
    #[inline(always)]
    fn advance(&mut self, state: &mut State<D>, commands: &[Commands<'_>], links: Option<f64>) {
        let n = self.n();
        let m = n + self.rotors.len();
        let (t, dt) = (self.begin + commands[0].t, commands[0].dt);
        if let Some(length) = links {
            self.evaluate_links(state, t, length);
        }
        self.place_links(state, dt);
        self.remember(state, t);
        self.follow(state, commands, (t, dt));
        self.feed_forward(state, (t, dt));
        self.answer_all(state, commands, (t, dt));
        self.add_forces(state, t, dt);
        let mut rotor = 0;
        for j in 0..n {
            let c = if self.gears[j].is_some() {
                rotor += 1;
                n + rotor - 1
            } else {
                j
            };
            self.add_drive(state, &commands[j], (j, c), t);
            if self.gears[j].is_some() {
                self.add_gear(state, (j, c), dt);
            }
        }
        self.solve(m);
        self.move_links(state, dt);
        self.move_drives(state, dt);
    }

    /// Positions and velocities in the middle of the step; the links' own momentum.
    #[inline(always)]
    fn place_links(&mut self, state: &State<D>, dt: f64) {
        let n = self.n();
        let m = n + self.rotors.len();
        let half = 0.5 * dt;
        for j in 0..n {
            self.site_q[j] = state.q[j] + state.v[j] * half;
            self.site_v[j] = state.v[j] + state.acceleration[j] * half;
            self.force[j] = D::nil();
            self.rate[j] = D::nil();
        }
        for (r, &j) in self.rotors.iter().enumerate() {
            self.site_q[j] = state.drive_q[j] + state.drive_v[j] * half;
            self.site_v[j] = state.drive_v[j] + state.acceleration[n + r] * half;
        }
        for x in &mut self.matrix {
            *x = D::nil();
        }
        for i in 0..n {
            let mut momentum = D::nil();
            for j in 0..n {
                let x = self.mass[i * n + j];
                self.matrix[i * m + j] = x;
                momentum += x * state.v[j];
            }
            self.rhs[i] = momentum - self.bias[i] * dt;
        }
        for (r, &j) in self.rotors.iter().enumerate() {
            self.rhs[n + r] = D::nil();
            self.levels[j] = None;
            self.status[j] = 2;
        }
    }

    /// Forces of the effects.
    #[inline(always)]
    fn add_forces(&mut self, state: &State<D>, t: f64, dt: f64) {
        for i in 0..self.hypothesis.terms.len() {
            let place = &self.terms[i];
            let at = Site {
                joint: place.joint,
                q: &self.site_q,
                v: &self.site_v,
                load: &state.load,
                t: t + 0.5 * dt,
                dt,
                rest: None,
            };
            let (own, memory) = (
                &self.e[place.own.clone()],
                &state.memory[place.cells.clone()],
            );
            let mut forces = Forces {
                value: &mut self.force,
                rate: &mut self.rate,
            };
            let law = D::of(&*self.hypothesis.terms[i].effect);
            law.force(own, &at, memory, &mut forces, &self.constants);
        }
    }

    /// Drive, rotor and friction of joint `j` in row `c`, on the side of the drive.
    #[inline(always)]
    fn add_drive(
        &mut self,
        state: &mut State<D>,
        commands: &Commands<'_>,
        (j, c): (usize, usize),
        t: f64,
    ) {
        let m = self.n() + self.rotors.len();
        let dt = commands.dt;
        let half = 0.5 * dt;
        let own = self.before_effects(commands, j);
        let u = match self.off[j] {
            true => own,
            false => self.through(state, commands, (j, false), own),
        };
        let drive = self.drives[j];
        let mut friction = Friction {
            forward: drive.coulomb,
            backward: drive.coulomb,
            viscous: drive.viscous,
        };
        for (place, term) in self.terms.iter().zip(&self.hypothesis.terms) {
            if place.joint != j {
                continue;
            }
            let law = D::of(&*term.effect);
            let at = Site {
                joint: j,
                q: &self.site_q,
                v: &self.site_v,
                load: &state.load,
                t: t + half,
                dt,
                rest: None,
            };
            let (own, memory) = (
                &self.e[place.own.clone()],
                &state.memory[place.cells.clone()],
            );
            law.friction(own, &at, memory, &mut friction);
        }
        let geared = self.gears[j].is_some();
        let v = if geared { state.drive_v[j] } else { state.v[j] };
        let inertia = drive.rotor;
        let damping = (friction.viscous + self.rate[j]) * half;
        self.matrix[c * m + c] += inertia + damping;
        self.rhs[c] += inertia * v + (drive.gain * u + self.force[j]) * dt - damping * v;
        if let Some((out, ahead)) = self.answers[j] {
            let ahead = ahead.max(0.0);
            // In place of the velocity and position that the loop saw those that the step leads to there.
            let (give, damping) = (
                drive.gain * out.stiffness * (half * ahead),
                drive.gain * out.damping * ahead,
            );
            self.matrix[c * m + c] += give + damping;
            self.rhs[c] += give * v + damping * (self.site_v[j] * 2.0 - v);
        }
        let some = friction.forward.value() > 0.0 || friction.backward.value() > 0.0;
        self.levels[c] = some.then(|| (friction.forward * dt, friction.backward * dt));
        let v = v.value();
        self.status[c] = match self.levels[c] {
            None => 2,
            Some(_) if v > 0.0 => 1,
            Some(_) if v < 0.0 => -1,
            Some(_) => 0,
        };
    }

    /// An input of joint `j` through the effects before the position loop of its drive, or after it;
    /// without a loop all effects are after it.
    #[inline(always)]
    pub(super) fn through(
        &self,
        state: &mut State<D>,
        commands: &Commands<'_>,
        (j, before): (usize, bool),
        mut u: D,
    ) -> D {
        let looped = self.loops[j].is_some();
        let own = u;
        // What acts before the drive reads the commands and not what others made of them, so it comes first.
        for first in [true, false] {
            if looped && first != before {
                continue;
            }
            for (place, term) in self.terms.iter().zip(&self.hypothesis.terms) {
                let elsewhere = place.joint != j && place.has_joint;
                if elsewhere || place.before_drive != first {
                    continue;
                }
                let law = D::of(&*term.effect);
                let (e, memory) = (
                    &self.e[place.own.clone()],
                    &mut state.memory[place.cells.clone()],
                );
                u = law.input(e, u, commands, memory);
                if place.needs_inputs {
                    u = law.shared(e, u, self.taken - own.magnitude());
                }
            }
        }
        u
    }

    /// The gear between the link `j` and its rotor in row `c`.
    #[inline(always)]
    fn add_gear(&mut self, state: &State<D>, (j, c): (usize, usize), dt: f64) {
        let Some(gear) = self.gears[j] else {
            return;
        };
        let m = self.n() + self.rotors.len();
        let half = 0.5 * dt;
        let x = state.drive_q[j] - state.q[j];
        let rate = state.drive_v[j] - state.v[j];
        let middle = x + rate * half;
        let edge = gear.gap * 0.5;
        let over = middle - middle.limit(-edge, edge);
        let touches = gear.gap.value() == 0.0 || middle.value().abs() > edge.value();
        let slope = if touches {
            gear.stiffness * half
        } else {
            D::nil()
        };
        let damping = if touches {
            gear.damping + gear.open
        } else {
            gear.open
        };
        let give = (slope + damping) * 0.5;
        let push = gear.stiffness * over - slope * rate + give * rate;
        let (push, give) = (push * dt, give * dt);
        self.rhs[c] -= push;
        self.rhs[j] += push;
        self.matrix[c * m + c] += give;
        self.matrix[j * m + j] += give;
        self.matrix[c * m + j] -= give;
        self.matrix[j * m + c] -= give;
    }

    /// Torque through the gear from the links' own equation, then the motion of the links.
    #[inline(always)]
    fn move_links(&mut self, state: &mut State<D>, dt: f64) {
        let n = self.n();
        for j in 0..n {
            let gained = self.next[j] - state.v[j];
            state.acceleration[j] = gained / dt;
            state.gained[j] += gained;
        }
        for i in 0..n {
            let mut load = self.bias[i];
            for j in 0..n {
                load += self.mass[i * n + j] * state.acceleration[j];
            }
            state.load[i] = load;
        }
        for j in 0..n {
            state.q[j] += (state.v[j] + self.next[j]) * (0.5 * dt);
            state.v[j] = self.next[j];
        }
    }

    /// Motion of the drives, and what the effects remember of it.
    #[inline(always)]
    fn move_drives(&mut self, state: &mut State<D>, dt: f64) {
        let n = self.n();
        let mut rotor = 0;
        for j in 0..n {
            let mean;
            if self.gears[j].is_some() {
                let next = self.next[n + rotor];
                state.acceleration[n + rotor] = (next - state.drive_v[j]) / dt;
                mean = (state.drive_v[j] + next) * 0.5;
                state.drive_q[j] += mean * dt;
                state.drive_v[j] = next;
                rotor += 1;
            } else {
                mean = (state.q[j] - state.drive_q[j]) / dt;
                state.drive_q[j] = state.q[j];
                state.drive_v[j] = state.v[j];
            }
            for (place, term) in self.terms.iter().zip(&self.hypothesis.terms) {
                if place.joint == j && !place.cells.is_empty() {
                    let after = After {
                        v: mean,
                        dt,
                        coulomb: self.drives[j].coulomb,
                    };
                    let (own, memory) = (
                        &self.e[place.own.clone()],
                        &mut state.memory[place.cells.clone()],
                    );
                    D::of(&*term.effect).advance(own, &after, memory);
                }
            }
        }
    }

    /// Mass matrix and bias in the middle of the time `length` from `t`.
    #[inline(always)]
    fn evaluate_links(&mut self, state: &mut State<D>, t: f64, length: f64) {
        let half = 0.5 * length;
        for j in 0..self.n() {
            self.half_q[j] = state.q[j] + state.v[j] * half;
            self.half_v[j] = state.v[j] + state.gained[j] / length * half;
            state.gained[j] = D::nil();
        }
        self.shake(t + half);
        let force = self.tip_force(t, length);
        self.links_at_half(force);
    }

    /// Mass matrix and bias at `half_q`, `half_v`.
    #[inline(always)]
    pub(super) fn links_at_half(&mut self, force: Option<[D; 3]>) {
        let at = links::At {
            q: &self.half_q,
            v: &self.half_v,
            force,
        };
        let programs = &self.constants.nominal().links;
        programs.evaluate(&mut self.links, &at, D::sine_cosine, &mut self.bias);
        let n = self.bias.len();
        let lower = self.links.mass();
        let mut next = 0;
        for i in 0..n {
            for j in 0..=i {
                let entry = lower[next];
                self.mass[i * n + j] = entry;
                self.mass[j * n + i] = entry;
                next += 1;
            }
        }
    }
}
