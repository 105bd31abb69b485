//! Draws robots, tolerances and causes from a seed; each case by numbers of its own.

use pid_interpret::nominal::{Nominal, NominalError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::causes::{COUPLING, Cause, Kind, LISTED, OUTSIDE, VELOCITY_LAG};
use crate::family::{self, Family};
use crate::magnitudes::{self, Sizes};
use crate::mess::Mess;
use crate::motion::{LENGTH, tidy};
use crate::plant::{PER_JOINT, Plant};
use crate::record::{run, text as rows_text};
use crate::robot::Robot;
use crate::setup::Setup;
use crate::{Files, Study, text};

/// What a study consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Number of cases.
    pub cases: usize,
    /// Fewest joints of a robot. Robots of one and two joints make up all draws of at most three where this is 1;
    /// from 3 on all robots are arms of `joints` joints.
    pub fewest: usize,
    /// Most joints of a robot, 1 to 6.
    pub joints: usize,
    /// Which causes are drawn.
    pub causes: Drawing,
}

/// Which causes a study draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Drawing {
    /// Of all kinds, and none.
    #[default]
    All,
    /// None: the rate of false alarms.
    Nothing,
    /// One outside the list.
    Outside,
}

/// What was hidden in a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// The causes; empty: none.
    pub causes: Vec<Cause>,
    /// Joints of the robot.
    pub joints: usize,
    /// Whether all joints turn about one horizontal axis.
    pub one_axis: bool,
    /// Whether noise figures were stated.
    pub noise_stated: bool,
    /// `measured`, `derived` or `absent`.
    pub velocity: String,
}

/// A case before its records.
pub(crate) struct Drawn {
    pub(crate) truth: Truth,
    pub(crate) robot: Robot,
    pub(crate) nominal: Nominal,
    /// Deviations of the true values from the nominal ones, in tolerances.
    pub(crate) theta: Vec<f64>,
}

impl Plan {
    /// Name of the `i`-th case.
    pub fn id(&self, i: usize) -> String {
        format!("s{}_{i:04}", self.seed)
    }

    /// What is drawn of the `i`-th case before its records, and the numbers that go on from there.
    pub(crate) fn drawn(&self, i: usize) -> Result<(Drawn, ChaCha8Rng), NominalError> {
        self.drawn_of(i, |number| Family::of(number, (self.fewest, self.joints)))
    }

    /// The same with robots of the family that stands for a drawn number below four.
    pub(crate) fn drawn_of(
        &self,
        i: usize,
        family: impl Fn(usize) -> Family,
    ) -> Result<(Drawn, ChaCha8Rng), NominalError> {
        let mut random =
            ChaCha8Rng::seed_from_u64(self.seed.wrapping_mul(1_000_003).wrapping_add(i as u64));
        let family = family(random.random_range(0..4usize));
        let robot = family::draw(family, &mut random)?;
        let n = robot.joints.len();
        let noise_stated = random.random_range(0..3) > 0;
        let velocity = ["measured", "derived", "absent"][random.random_range(0..3usize)].to_owned();
        let stated = text::nominal(&robot, Some(robot.drive_noise), &velocity);
        let nominal = Nominal::parse("nominal.toml", &stated)?;
        let theta: Vec<f64> = (0..n * PER_JOINT)
            .map(|_| random.random_range(-0.9..0.9))
            .collect();
        let causes = self.causes(&robot, &nominal, &velocity, &mut random);
        let drawn = Drawn {
            truth: Truth {
                causes,
                joints: n,
                one_axis: robot.planar && robot.joints.iter().all(|j| !j.prismatic),
                noise_stated,
                velocity,
            },
            robot,
            nominal,
            theta,
        };
        Ok((drawn, random))
    }

    /// What is hidden in the `i`-th case, without its records.
    ///
    /// # Errors
    /// If the drawn robot is not one; none is known.
    pub fn truth(&self, i: usize) -> Result<Truth, NominalError> {
        Ok(self.drawn(i)?.0.truth)
    }

    /// One case in six is without a cause, one in twelve outside the list, one in twelve of two causes.
    fn causes(
        &self,
        robot: &Robot,
        nominal: &Nominal,
        velocity: &str,
        random: &mut ChaCha8Rng,
    ) -> Vec<Cause> {
        let n = robot.joints.len();
        let kind = random.random_range(0..12);
        let (nothing, outside) = match self.causes {
            Drawing::All => (kind < 2, kind == 2),
            Drawing::Nothing => (true, false),
            Drawing::Outside => (false, true),
        };
        if nothing {
            return Vec::new();
        }
        let many = if kind == 3 && n > 1 && !outside { 2 } else { 1 };
        let inertia = robot.inertia(nominal);
        let mut out: Vec<Cause> = Vec::new();
        while out.len() < many {
            let joint = random.random_range(0..n);
            let index = if outside {
                LISTED + random.random_range(0..OUTSIDE)
            } else {
                random.random_range(0..LISTED)
            };
            if (index == COUPLING && n == 1) || !Kind::fits(index, joint, n) {
                continue;
            }
            // A lag of a channel that is not recorded leaves no trace.
            if index == VELOCITY_LAG && velocity == "absent" {
                continue;
            }
            // From faint to clear, even on a logarithmic scale; two causes are both to be seen.
            let low: f64 = if many == 2 { 0.8 } else { 0.2 };
            let strength = random.random_range(low.ln()..2.5f64.ln()).exp();
            let size = |j: usize| sizes(robot, &inertia, j);
            let partner = (n > 1).then(|| size(if joint > 0 { joint - 1 } else { 1 }));
            let kind =
                magnitudes::draw(index, strength, &size(joint), robot.planar, partner, random);
            if out
                .iter()
                .any(|c| c.kind.id() == kind.id() || same_place(c, &kind, joint))
            {
                continue;
            }
            out.push(Cause { kind, joint });
        }
        out
    }
}

impl Study for Plan {
    type Truth = Truth;

    fn id(&self, i: usize) -> String {
        self.id(i)
    }

    fn cases(&self) -> usize {
        self.cases
    }

    fn make(&self, i: usize) -> Result<(Files, Truth), NominalError> {
        let (drawn, mut random) = self.drawn(i)?;
        let Drawn {
            truth,
            robot,
            nominal,
            theta,
        } = drawn;
        let plant = Plant::<f64>::new(&nominal, &theta);
        let velocity = &truth.velocity;
        let records = tidy();
        let samples = (LENGTH * robot.rate) as usize + 1;
        let noise = truth.noise_stated.then_some(robot.drive_noise);
        let mut files: Files = vec![
            (
                "nominal.toml".to_owned(),
                text::nominal(&robot, noise, velocity),
            ),
            (
                "dataset.toml".to_owned(),
                text::dataset(&self.id(i), &robot, velocity, &records, Some(samples)),
            ),
        ];
        let setup = Setup {
            robot: &robot,
            nominal: &nominal,
            plant: &plant,
            theta: &theta,
            causes: &truth.causes,
            velocity,
            mess: &Mess::default(),
            loops: None,
        };
        // Nothing untidy is drawn.
        let mut none = random.clone();
        for record in records {
            let run = run(&setup, record.motion, samples, &mut random, &mut none);
            files.push((record.name, rows_text(&run.rows, velocity, "u")));
        }
        Ok((files, truth))
    }
}

/// What magnitudes at the joint `j` are drawn relative to.
pub(crate) fn sizes(robot: &Robot, inertia: &[f64], j: usize) -> Sizes {
    let x = &robot.joints[j];
    let n = robot.joints.len();
    let norm = |a: [f64; 3]| (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt();
    let reach: f64 = robot.joints[1..]
        .iter()
        .map(|j| norm(j.origin))
        .sum::<f64>()
        + norm(robot.tool);
    Sizes {
        torque: x.torque,
        gain: x.gain,
        inertia: inertia[j],
        rotor: x.rotor,
        amplitude: x.room.amplitude,
        centre: x.room.centre,
        speed: x.room.speed,
        length: x.length,
        tip_mass: robot.joints[n - 1].mass,
        tip_force: robot.joints[1.min(n - 1)].torque / reach.max(0.2),
    }
}

/// Two gears, or two changes of one input, at the same joint would be one cause.
pub(crate) fn same_place(a: &Cause, kind: &Kind, joint: usize) -> bool {
    let gear = |k: &Kind| matches!(k, Kind::JointElasticity { .. } | Kind::Backlash { .. });
    a.joint == joint && gear(&a.kind) && gear(kind)
}
