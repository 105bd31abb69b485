//! What drives feed forward of the model of the robot that they know: inputs that make up for gravity and inertia.

use pid_interpret::links;

use super::servo::{Loop, Memory, START, ahead, held};
use super::{Machine, State};
use crate::constants::Constants;
use crate::effect::Pick;
use crate::nominal::DriveKnowledge;

/// Whether a drive makes up for gravity or inertia.
fn makes_up<D: Copy>(own: &Option<Loop<'_, D>>) -> bool {
    own.is_some_and(|(_, k)| k.gravity.is_some() || k.inertia.is_some())
}

/// The robot as the feed-forward of the drives knows it.
pub(super) struct Model<D> {
    links: links::Work<D>,
    known: DriveKnowledge<D>,
    /// Where it was evaluated last, and the velocity, which is none.
    q: Vec<D>,
    still: Vec<D>,
    bias: Vec<D>,
    /// Inputs that make up for gravity and for the acceleration of the targets, joint by joint, where its loop read
    /// last.
    gravity: Vec<D>,
    inertia: Vec<D>,
}

impl<D: Pick> Model<D> {
    /// Where a drive has a feed-forward.
    pub(super) fn of(constants: &Constants<'_, D>, loops: &[Option<Loop<'_, D>>]) -> Option<Self> {
        let nominal = constants.nominal();
        let n = nominal.n();
        if !loops.iter().any(makes_up) {
            return None;
        }
        let (links, known) = Constants::known_to_drives(nominal);
        let zero = || vec![D::nil(); n];
        Some(Model {
            links,
            known,
            q: zero(),
            still: zero(),
            bias: zero(),
            gravity: zero(),
            inertia: zero(),
        })
    }

    /// Notes what makes up for gravity at a joint where it was evaluated.
    fn weigh(&mut self, j: usize) {
        self.gravity[j] = self.bias[j] / self.known.gains[j];
    }

    /// Notes what accelerates a joint there as the targets do.
    fn accelerate(&mut self, j: usize, loops: &[Memory<D>]) {
        let lower = self.links.mass();
        let entry = |i: usize, j: usize| lower[i * (i + 1) / 2 + j];
        let mut force = loops[j].follows.acceleration * self.known.rotors[j];
        for (i, own) in loops.iter().enumerate() {
            force += entry(i.max(j), i.min(j)) * own.follows.acceleration;
        }
        self.inertia[j] = force / self.known.gains[j];
    }
}

impl<D: Pick> Machine<'_, D> {
    /// What the drives' model makes up for at the positions that their loops read over the substep from
    /// `t`: in its middle, or at its start where a loop reads there and holds its output.
    #[inline(always)]
    pub(super) fn feed_forward(&mut self, state: &State<D>, (t, dt): (f64, f64)) {
        let Some(mut model) = self.model.take() else {
            return;
        };
        for holds in [false, true] {
            let reads = |j: usize| match self.loops[j] {
                Some((servo, _)) if makes_up(&self.loops[j]) => {
                    let period = held(servo, dt);
                    period.is_some() == holds && (!holds || t >= state.loops[j].due - 1e-3 * dt)
                }
                _ => false,
            };
            if !(0..self.n()).any(reads) {
                continue;
            }
            for j in 0..self.n() {
                let ahead = match (holds, self.loops[j]) {
                    (true, _) => 0.0,
                    (false, Some((servo, _))) => ahead(servo, dt),
                    (false, None) => 0.5 * dt,
                };
                model.q[j] = self.reading(state, j, t, (ahead, dt)).0;
            }
            self.evaluate_model(&mut model);
            for j in (0..self.n()).filter(|&j| reads(j)) {
                model.weigh(j);
                if self.loops[j].is_some_and(|(_, k)| k.inertia.is_some()) {
                    model.accelerate(j, &state.loops);
                }
            }
        }
        self.model = Some(model);
    }

    /// Forces that the drives' model needs to rest at its positions.
    #[inline(always)]
    fn evaluate_model(&self, model: &mut Model<D>) {
        let at = links::At {
            q: &model.q,
            v: &model.still,
            force: None,
        };
        let programs = &self.constants.nominal().links;
        programs.evaluate(&mut model.links, &at, D::sine_cosine, &mut model.bias);
    }

    /// Inputs with which the model of the drive of a joint makes up for gravity and inertia.
    pub(super) fn fed(&self, j: usize) -> (D, D) {
        match &self.model {
            Some(own) => (own.gravity[j], own.inertia[j]),
            None => (D::nil(), D::nil()),
        }
    }

    /// Notes what makes up for gravity at a state at rest.
    pub(super) fn weigh_at_rest(&mut self, state: &State<D>) {
        if let Some(mut model) = self.model.take() {
            for j in 0..self.n() {
                model.q[j] = self.reading(state, j, self.begin, START).0;
            }
            self.evaluate_model(&mut model);
            (0..self.n()).for_each(|j| model.weigh(j));
            self.model = Some(model);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{Commands, Term};
    use crate::hypothesis::Hypothesis;
    use crate::nominal::Nominal;

    /// A drive that feeds inertia forward counts with the targets of joints whose drives do not.
    #[test]
    fn inertia_is_fed_forward_for_the_targets_of_all_joints() {
        const H: f64 = 4e-3;
        const ACCELERATION: f64 = 3.0;
        let drive = "[drive]\nlaw = \"pd\"\nkp = 50.0\nkd = 5.0\n\n[[joint]]";
        let text = include_str!("../../robots/ur10e.toml").replacen("[[joint]]", drive, 1);
        let nominal = Nominal::parse(&text, "ur10e.toml".as_ref()).expect("a description");
        let q = [0.3, -0.8, 0.9, 0.2, 0.4, 0.1];
        let effect = crate::effects::by_id("inertia_feed_forward").expect("an effect");
        let hypothesis = Hypothesis::new(vec![Term { effect, joint: 1 }]);
        let constants = Constants::new(&nominal, &vec![0.0; nominal.size()]);
        let mut machine = Machine::<f64>::new(constants, &hypothesis, vec![1.0]);
        let mut state = machine.rest(&q, &[0.0; 6], &q);
        // The third joint alone has a target that is accelerated.
        let target = |j: usize, k: i32| match j {
            2 => q[j] + 0.5 * ACCELERATION * (H * f64::from(k)).powi(2),
            _ => q[j],
        };
        let targets: Vec<Vec<f64>> = (0..6)
            .map(|j| (0..10).map(|k| target(j, k)).collect())
            .collect();
        let of = |u| Commands {
            u,
            h: H,
            linear: false,
            begin: 0.0,
            t: 5.0 * H,
            dt: 1e-6,
        };
        let commands: Vec<Commands<'_>> = targets.iter().map(|u| of(u)).collect();
        machine.step(&mut state, &commands, Some(1e-6));
        let (mut work, known) = Constants::<f64>::known_to_drives(&nominal);
        let at = links::At {
            q: &q,
            v: &[0.0; 6],
            force: None,
        };
        let mut bias = [0.0; 6];
        (nominal.links).evaluate(&mut work, &at, f64::sin_cos, &mut bias);
        // Row 2, column 1 of the lower triangle.
        let expected = work.mass()[4] * ACCELERATION / known.gains[1];
        let (_, fed) = machine.fed(1);
        assert!(expected.abs() > 0.01, "{expected}");
        assert!((fed / expected - 1.0).abs() < 1e-6, "{fed} {expected}");
    }
}
