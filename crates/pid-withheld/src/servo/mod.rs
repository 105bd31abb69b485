//! Cases behind position servos: records have targets and positions, and no input of the motors.
//!
//! Loops are written a second time (`position_loop`) and share nothing with those by which records are judged.

mod draw;

use pid_interpret::nominal::{Nominal, NominalError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

pub use draw::Stated;

use crate::family::Family;
use crate::mess::Mess;
use crate::motion::{LENGTH, tidy};
use crate::plan::{Drawn, Plan, Truth};
use crate::plant::Plant;
use crate::position_loop::{Law, Loop};
use crate::record::{run, text as rows_text};
use crate::setup::Setup;
use crate::{Files, Study, text};

/// A study of cases behind servos.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServoPlan {
    /// Robots and causes.
    pub plan: Plan,
    /// The law of all loops; `None`: drawn.
    pub law: Option<Law>,
    /// What is drawn.
    pub servos: Servos,
}

/// What a study of cases behind servos draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Servos {
    /// Robots and causes of the plan, with any loops.
    #[default]
    All,
    /// Legs of three joints under a policy instead of other robots: damped loops at 1 kHz with unknown gains take
    /// targets at 50 Hz.
    Legs,
    /// One elastic joint or one loop that reads late each, of a size that has the loop ring, in place of the plan's
    /// causes.
    Resonant,
    /// One stage of a loop that its description does not state each, in place of the plan's causes.
    Unstated,
}

/// What was hidden in a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ServoTruth {
    /// Its causes.
    #[serde(flatten)]
    pub truth: Truth,
    /// The loops, joint by joint.
    pub loops: Vec<Loop>,
    /// How well they are stated.
    pub stated: Stated,
    /// Rate of the records, Hz.
    pub rate: f64,
}

impl Study for ServoPlan {
    type Truth = ServoTruth;

    fn id(&self, i: usize) -> String {
        let kind = match self.servos {
            Servos::All => "servo",
            Servos::Legs => "leg",
            Servos::Resonant => "resonant",
            Servos::Unstated => "unstated",
        };
        format!("{kind}_{}", self.plan.id(i))
    }

    fn cases(&self) -> usize {
        self.plan.cases
    }

    fn make(&self, i: usize) -> Result<(Files, ServoTruth), NominalError> {
        let legs = self.servos == Servos::Legs;
        let (drawn, _) = match legs {
            true => self.plan.drawn_of(i, |_| Family::Leg)?,
            false => self.plan.drawn(i)?,
        };
        let Drawn {
            mut truth,
            mut robot,
            mut nominal,
            theta,
        } = drawn;
        // Numbers of its own: the robots are those of the study without loops.
        let seed = self
            .plan
            .seed
            .wrapping_mul(7_368_787)
            .wrapping_add(i as u64);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        robot.rate = draw::rate(&mut random);
        let inertia = robot.inertia(&nominal);
        let (mut loops, stated) = if legs {
            let loops = draw::under_a_policy(&robot, &inertia, &mut random);
            (loops, Stated::Unknown)
        } else {
            let mut loops = draw::loops(&robot, &inertia, self.law, &mut random);
            draw::brake(&mut robot, &inertia, &mut loops, &mut random);
            let braked = text::nominal(&robot, Some(robot.drive_noise), &truth.velocity);
            nominal = Nominal::parse("nominal.toml", &braked)?;
            let stated = [Stated::Exactly, Stated::Roughly, Stated::Unknown];
            (loops, stated[random.random_range(0..stated.len())])
        };
        let mut shown = None;
        match self.servos {
            Servos::All | Servos::Legs => {}
            Servos::Resonant => {
                shown = Some(loops.clone());
                truth.causes = vec![draw::resonance(&robot, &inertia, &mut loops, &mut random)];
            }
            Servos::Unstated => {
                let pull = robot.pull(&nominal);
                let (cause, stated) =
                    draw::hide(&robot, (&inertia, &pull), &mut loops, &mut random);
                (truth.causes, shown) = (vec![cause], Some(stated));
            }
        }
        let shown = shown.as_deref().unwrap_or(&loops);
        let tables = draw::tables(shown, stated, &mut random);
        let velocity = &truth.velocity;
        let records = tidy();
        let samples = (LENGTH * robot.rate) as usize + 1;
        let noise = truth.noise_stated.then_some(robot.drive_noise);
        let mut files: Files = vec![
            (
                "nominal.toml".to_owned(),
                text::with_loops(&text::nominal(&robot, noise, velocity), &tables),
            ),
            (
                "dataset.toml".to_owned(),
                text::commanded(&text::dataset(
                    &self.id(i),
                    &robot,
                    velocity,
                    &records,
                    Some(samples),
                )),
            ),
        ];
        // What is written is a description.
        Nominal::parse("nominal.toml", &files[0].1)?;
        let setup = Setup {
            robot: &robot,
            nominal: &nominal,
            plant: &Plant::<f64>::new(&nominal, &theta),
            theta: &theta,
            causes: &truth.causes,
            velocity,
            mess: &Mess::default(),
            loops: Some(&loops),
        };
        let mut none = random.clone();
        for record in records {
            let run = run(&setup, record.motion, samples, &mut random, &mut none);
            files.push((record.name, rows_text(&run.rows, velocity, "qref")));
        }
        let rate = robot.rate;
        let truth = ServoTruth {
            truth,
            loops,
            stated,
            rate,
        };
        Ok((files, truth))
    }
}
