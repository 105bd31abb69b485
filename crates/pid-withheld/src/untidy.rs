//! Several causes of like size on untidy records: what is drawn, and the share of each cause.

use pid_interpret::nominal::{Nominal, NominalError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::causes::Cause;
use crate::family::{self, Family};
use crate::gaps::Gaps;
use crate::like::Like;
use crate::mess::Mess;
use crate::motion::{Planned, untidy as planned};
use crate::plan::Truth;
use crate::plant::{PER_JOINT, Plant};
use crate::record::{Run, run, text as rows_text};
use crate::robot::{Joint, Robot, Tolerance};
use crate::setup::Setup;
use crate::{Files, Study, text};

/// Readings per second that are drawn from: their periods are whole steps of the simulation.
const RATES: [f64; 8] = [50.0, 100.0, 125.0, 200.0, 250.0, 400.0, 500.0, 1000.0];

/// Largest gap that noise may leave: windows of robots that fall when they run freely are shortened.
const STEADY: f64 = 0.03;
/// Shortest window of a free run, s.
const SHORTEST: f64 = 0.25;

/// A study of several causes on untidy records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UntidyPlan {
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Number of cases.
    pub cases: usize,
    /// Most joints of a robot, 1 to 6.
    pub joints: usize,
}

/// How the records of a case are made.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// Readings per second.
    pub rate: f64,
    /// Length of a record, s.
    pub length: f64,
    /// Number of records.
    pub records: usize,
    /// Untidiness.
    pub mess: Mess,
}

/// What is hidden in an untidy case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UntidyTruth {
    /// The causes and the robot.
    pub truth: Truth,
    /// The share of each cause, in the order of the causes, and the study's own gaps.
    pub gaps: Gaps,
    /// How the records are made.
    pub recording: Recording,
}

impl UntidyTruth {
    /// `nothing missing`, `one effect`, `several` or `one outside beside`.
    pub fn tier(&self) -> &'static str {
        let causes = &self.truth.causes;
        match causes.len() {
            0 => "nothing missing",
            1 => "one effect",
            _ if causes.iter().any(|c| c.kind.id() == "unknown") => "one outside beside",
            _ => "several",
        }
    }
}

/// A robot and its records before their causes.
struct Drawn {
    robot: Robot,
    nominal: Nominal,
    plant: Plant<f64>,
    theta: Vec<f64>,
    velocity: String,
    noise_stated: bool,
    mess: Mess,
    records: Vec<Planned>,
    /// Seed of the records.
    seed: u64,
}

impl Drawn {
    fn new(joints: usize, random: &mut ChaCha8Rng) -> Result<Self, NominalError> {
        let n = random.random_range(1..=joints.clamp(1, 6));
        let family = match n {
            1 => Family::Pendulum,
            2 => [Family::PlanarArm, Family::Slide][random.random_range(0..=1usize)],
            _ => Family::Arm(n),
        };
        let mut robot = family::draw(family, random)?;
        robot.tolerance = Tolerance::LOOSE;
        robot.rate = RATES[random.random_range(0..RATES.len())];
        robot.length = f64::from(random.random_range(30..=90)) / 10.0;
        robot.horizon = (robot.length / 3.0).clamp(1.0, 2.0);
        let level = random.random_range(0.5_f64.ln()..3.0_f64.ln()).exp();
        for joint in &mut robot.joints {
            joint.q_noise *= level;
        }
        let noise_stated = random.random_range(0..3) > 0;
        let velocity = ["measured", "derived", "absent"][random.random_range(0..3usize)];
        let stated = text::nominal(&robot, None, velocity);
        let nominal = Nominal::parse("nominal.toml", &stated)?;
        let theta: Vec<f64> = robot
            .joints
            .iter()
            .flat_map(|j| deviations(j, random))
            .collect();
        Ok(Self {
            plant: Plant::new(&nominal, &theta),
            theta,
            robot,
            nominal,
            velocity: velocity.to_owned(),
            noise_stated,
            mess: Mess::draw(random),
            records: planned(random.random_range(3..=6), random),
            seed: random.random(),
        })
    }

    /// Records with causes. Where a cause acts between command and current, the command is recorded:
    /// the current would show what the cause does.
    fn with<T>(&self, causes: &[Cause], use_it: impl FnOnce(&Setup<'_>) -> T) -> T {
        let mut mess = self.mess;
        if causes.iter().any(|c| c.kind.before_current()) {
            mess.current = None;
        }
        use_it(&Setup {
            robot: &self.robot,
            nominal: &self.nominal,
            plant: &self.plant,
            theta: &self.theta,
            causes,
            velocity: &self.velocity,
            mess: &mess,
            loops: None,
        })
    }

    /// Halves the windows of free runs until noise leaves little at their ends.
    fn steady(&mut self) {
        while self.robot.horizon > 2.0 * SHORTEST && self.gaps(&[], true).all > STEADY {
            self.robot.horizon *= 0.5;
        }
    }

    /// Rows of a window of free runs.
    fn window(&self) -> usize {
        (self.robot.horizon * self.robot.rate).round() as usize
    }

    /// The numbers of the `k`-th record: what is there in a tidy record too, and the rest.
    fn numbers(&self, k: usize) -> (ChaCha8Rng, ChaCha8Rng) {
        let stream = |number: usize| {
            let mut random = ChaCha8Rng::seed_from_u64(self.seed);
            random.set_stream(number as u64);
            random
        };
        (stream(2 * k), stream(2 * k + 1))
    }

    /// The runs of the first test records, `most` of them.
    fn tests(&self, setup: &Setup<'_>, most: usize) -> Vec<Run> {
        (self.records.iter().enumerate())
            .filter(|(_, record)| record.role == "test")
            .take(most)
            .map(|(k, record)| {
                let (mut tidy, mut rest) = self.numbers(k);
                run(setup, record.motion, self.window(), &mut tidy, &mut rest)
            })
            .collect()
    }

    /// The gaps on the test records; `rough` ones are those on the first, near enough for a draw.
    fn gaps(&self, causes: &[Cause], rough: bool) -> Gaps {
        self.with(causes, |setup| {
            let runs = self.tests(setup, if rough { 1 } else { usize::MAX });
            if runs.iter().all(|run| run.held(&self.robot)) {
                Gaps::new(setup, &runs, self.window(), rough)
            } else {
                Gaps::out_of_hand(causes.len())
            }
        })
    }

    /// The text of the `k`-th record.
    fn record(&self, setup: &Setup<'_>, k: usize) -> String {
        let (mut tidy, mut rest) = self.numbers(k);
        let motion = self.records[k].motion;
        let mut rows = run(setup, motion, self.window(), &mut tidy, &mut rest).rows;
        setup.mess.spoil(setup, &mut rows, &mut rest);
        rows_text(&rows, setup.velocity, "u")
    }
}

/// Deviations of one joint's true values from the stated ones, in tolerances.
fn deviations(joint: &Joint, random: &mut ChaCha8Rng) -> [f64; PER_JOINT] {
    let mut theta: [f64; PER_JOINT] = std::array::from_fn(|_| random.random_range(-0.9..0.9));
    // The moments grow or shrink together, so that they stay those of a body.
    let scale = theta[4];
    let largest = joint.inertia.iter().copied().fold(0.0, f64::max);
    for (theta, moment) in theta[4..7].iter_mut().zip(joint.inertia) {
        *theta = scale * moment / largest;
    }
    theta[7..10].fill(0.0);
    // Friction is from half of what is stated to twice that; the tolerance is what is stated.
    for theta in &mut theta[12..14] {
        *theta = random.random_range(0.5_f64.ln()..2.0_f64.ln()).exp() - 1.0;
    }
    theta
}

/// Numbers of listed causes, and whether one is outside the list: in an eighth of the cases nothing,
/// in a sixth two and one outside, else one to four.
fn numbers(random: &mut ChaCha8Rng) -> (usize, bool) {
    match random.random_range(0..24) {
        0..3 => (0, false),
        3..7 => (2, true),
        _ => (random.random_range(1..=4), false),
    }
}

impl Study for UntidyPlan {
    type Truth = UntidyTruth;

    fn id(&self, i: usize) -> String {
        format!("u{}_{i:04}", self.seed)
    }

    fn cases(&self) -> usize {
        self.cases
    }

    fn make(&self, i: usize) -> Result<(Files, UntidyTruth), NominalError> {
        let seed = self.seed.wrapping_mul(1_000_003).wrapping_add(i as u64);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut drawn = Drawn::new(self.joints, &mut random)?;
        drawn.steady();
        let Drawn {
            robot, velocity, ..
        } = &drawn;
        let one_axis = robot.planar && robot.joints.iter().all(|j| !j.prismatic);
        let like = Like {
            robot,
            nominal: &drawn.nominal,
            velocity,
            one_axis,
        };
        let numbers = numbers(&mut random);
        let causes = match numbers {
            (0, _) => Vec::new(),
            _ => like.draw(numbers, &|causes| drawn.gaps(causes, true), &mut random),
        };
        let gaps = drawn.gaps(&causes, false);
        let (mess, texts) = drawn.with(&causes, |setup| {
            let texts = (0..drawn.records.len()).map(|k| drawn.record(setup, k));
            (*setup.mess, texts.collect::<Vec<_>>())
        });
        let noise = mess.current.map_or(robot.drive_noise, |c| c.noise);
        let noise = drawn.noise_stated.then_some(noise);
        let mut files: Files = vec![
            (
                "nominal.toml".to_owned(),
                text::nominal(robot, noise, velocity),
            ),
            (
                "dataset.toml".to_owned(),
                text::dataset(&self.id(i), robot, velocity, &drawn.records, None),
            ),
        ];
        files.extend(drawn.records.iter().map(|r| r.name.clone()).zip(texts));
        let truth = UntidyTruth {
            truth: Truth {
                causes,
                joints: robot.joints.len(),
                one_axis,
                noise_stated: drawn.noise_stated,
                velocity: velocity.clone(),
            },
            gaps,
            recording: Recording {
                rate: robot.rate,
                length: robot.length,
                records: drawn.records.len(),
                mess,
            },
        };
        Ok((files, truth))
    }
}
