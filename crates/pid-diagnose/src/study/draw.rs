//! Draws robots, tolerances, causes and motions from a seed, runs the closed loop and writes the records.

use std::fmt::Write as _;

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use pid_interpret::nominal::Nominal;

use super::causes::{Cause, Kind, LISTED, OUTSIDE, Sizes};
use super::linkage::Surroundings;
use super::motion::{Motion, Room, reference};
use super::plant::{PER_JOINT, Plant};
use super::world::{STEP, World};
use crate::nominal::NominalError;

/// What a study consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Number of cases.
    pub cases: usize,
    /// Most joints of a robot, 1 to 6.
    pub joints: usize,
    /// Whether every case is without a cause: the false-alarm rate.
    pub nulls: bool,
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

/// File names and contents.
pub(super) type Files = Vec<(String, String)>;

/// The records: name, role, motion.
const RECORDS: [(&str, &str, Motion); 5] = [
    ("train_sines.csv", "train", Motion::Sines(100, 60)),
    ("train_fast.csv", "train", Motion::Sines(85, 100)),
    ("train_ramps.csv", "train", Motion::Ramps),
    ("test_moves.csv", "test", Motion::Moves),
    ("test_sines.csv", "test", Motion::Sines(90, 90)),
];
/// Length of a record, s.
const LENGTH: f64 = 7.0;
/// Time at rest before it, s.
const HOLDING: f64 = 0.6;
/// Corner of the filter behind a derived velocity, Hz.
const VELOCITY_HZ: f64 = 40.0;
/// Range of the drive noise, share of the largest usual torque.
const DRIVE_NOISE: (f64, f64) = (0.0012, 0.006);

/// One joint before it becomes text.
struct Joint {
    prismatic: bool,
    axis: [f64; 3],
    origin: [f64; 3],
    mass: f64,
    com: [f64; 3],
    inertia: [f64; 3],
    rotor: f64,
    coulomb: f64,
    viscous: f64,
    gain: f64,
    torque: f64,
    q_noise: f64,
    q_step: f64,
    v_noise: f64,
    room: Room,
    length: f64,
}

struct Robot {
    joints: Vec<Joint>,
    tool: [f64; 3],
    planar: bool,
    rate: f64,
    horizon: f64,
    drive_noise: f64,
}

/// A case before its records.
struct Drawn {
    truth: Truth,
    robot: Robot,
    nominal: Nominal,
    /// Deviations of the true values from the nominal ones, in tolerances.
    theta: Vec<f64>,
}

impl Plan {
    /// Name of the `i`-th case.
    pub fn id(&self, i: usize) -> String {
        format!("s{}_{i:04}", self.seed)
    }

    /// What is drawn of the `i`-th case before its records, and the numbers that go on from there.
    fn drawn(&self, i: usize) -> Result<(Drawn, ChaCha8Rng), NominalError> {
        let mut random =
            ChaCha8Rng::seed_from_u64(self.seed.wrapping_mul(1_000_003).wrapping_add(i as u64));
        let family = random
            .random_range(0..4usize)
            .min(self.joints.clamp(1, 6) - 1);
        let robot = robot(family, self.joints, &mut random)?;
        let n = robot.joints.len();
        let noise_stated = random.random_range(0..3) > 0;
        let velocity = ["measured", "derived", "absent"][random.random_range(0..3usize)].to_owned();
        let stated = nominal_text(&robot, true, &velocity);
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

    /// Records and cause of the `i`-th case.
    pub(super) fn make(&self, i: usize) -> Result<(Files, Truth), NominalError> {
        let (drawn, mut random) = self.drawn(i)?;
        let Drawn {
            truth,
            robot,
            nominal,
            theta,
        } = drawn;
        let plant = Plant::<f64>::new(&nominal, &theta);
        let velocity = &truth.velocity;
        let mut files: Files = vec![
            (
                "nominal.toml".to_owned(),
                nominal_text(&robot, truth.noise_stated, velocity),
            ),
            (
                "dataset.toml".to_owned(),
                dataset_text(&self.id(i), &robot, velocity),
            ),
        ];
        for (name, _, motion) in RECORDS {
            let text = record(
                &robot,
                &nominal,
                &plant,
                &truth.causes,
                motion,
                velocity,
                &mut random,
            );
            files.push((name.to_owned(), text));
        }
        Ok((files, truth))
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
        if self.nulls || kind < 2 {
            return Vec::new();
        }
        let outside = kind == 2;
        let many = if kind == 3 && n > 1 { 2 } else { 1 };
        let inertia = inertia(nominal, robot);
        let mut out: Vec<Cause> = Vec::new();
        while out.len() < many {
            let joint = random.random_range(0..n);
            let index = if outside {
                LISTED + random.random_range(0..OUTSIDE)
            } else {
                random.random_range(0..LISTED)
            };
            let coupling = 10;
            if index == coupling && n == 1 {
                continue;
            }
            // A lag of a channel that is not recorded leaves no trace.
            let lag = 23;
            if index == lag && velocity == "absent" {
                continue;
            }
            // From faint to clear, even on a logarithmic scale; two causes are both to be seen.
            let low: f64 = if many == 2 { 0.8 } else { 0.2 };
            let strength = random.random_range(low.ln()..2.5f64.ln()).exp();
            let sizes = |j: usize| self.sizes(robot, &inertia, j);
            let partner = (n > 1).then(|| sizes(if joint > 0 { joint - 1 } else { 1 }));
            let kind = Kind::draw(
                index,
                strength,
                &sizes(joint),
                robot.planar,
                partner,
                random,
            );
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

    fn sizes(&self, robot: &Robot, inertia: &[f64], j: usize) -> Sizes {
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
}

/// Two gears, or two changes of one input, at the same joint would be one cause.
fn same_place(a: &Cause, kind: &Kind, joint: usize) -> bool {
    let gear = |k: &Kind| matches!(k, Kind::JointElasticity { .. } | Kind::Backlash { .. });
    a.joint == joint && gear(&a.kind) && gear(kind)
}

/// Mass matrix diagonal with rotors, in the middle of the motion.
fn inertia(nominal: &Nominal, robot: &Robot) -> Vec<f64> {
    let n = robot.joints.len();
    let plant = Plant::<f64>::new(nominal, &vec![0.0; n * PER_JOINT]);
    let q: Vec<f64> = robot.joints.iter().map(|j| j.room.centre).collect();
    let (m, _) = dynamics(&plant, &q, &vec![0.0; n]);
    (0..n).map(|j| m[(j, j)] + plant.rotor[j]).collect()
}

fn dynamics(plant: &Plant<f64>, q: &[f64], v: &[f64]) -> (DMatrix<f64>, Vec<f64>) {
    let n = q.len();
    let around = Surroundings {
        gravity: plant.gravity,
        tip_force: None,
    };
    let (mut mass, mut bias) = (vec![0.0; n * n], vec![0.0; n]);
    plant
        .linkage()
        .mass_and_bias(&around, (q, v), &mut mass, &mut bias);
    (DMatrix::from_row_slice(n, n, &mass), bias)
}

/// Families: a pendulum; a planar arm; a slide with an arm; a chain of up to six spatial joints.
fn robot(family: usize, most: usize, random: &mut ChaCha8Rng) -> Result<Robot, NominalError> {
    let y = [0.0, 1.0, 0.0];
    let (axes, planar): (Vec<(bool, [f64; 3])>, bool) = match family {
        0 => (vec![(false, y)], true),
        1 => (vec![(false, y); 2], true),
        2 => (vec![(true, [1.0, 0.0, 0.0]), (false, y)], true),
        _ => {
            let z = [0.0, 0.0, 1.0];
            let n = most.clamp(3, 6);
            (
                [z, y, y, z, y, z][..n]
                    .iter()
                    .map(|a| (false, *a))
                    .collect(),
                false,
            )
        }
    };
    let n = axes.len();
    let mut scale = random.random_range(1.0..8.0);
    let mut joints = Vec::new();
    for (k, (prismatic, axis)) in axes.into_iter().enumerate() {
        let length = random.random_range(0.3..0.45);
        let mass = scale * random.random_range(0.8..1.2);
        scale *= 0.6;
        let transverse = mass * length * length / 12.0;
        let hanging = planar && !prismatic;
        joints.push(Joint {
            prismatic,
            axis,
            origin: [
                0.0,
                0.0,
                if k == 0 {
                    0.8
                } else if prismatic {
                    0.0
                } else if planar {
                    -length
                } else {
                    length
                },
            ],
            mass,
            com: [
                0.0,
                0.0,
                if prismatic {
                    0.0
                } else if hanging {
                    -0.45 * length
                } else {
                    0.45 * length
                },
            ],
            inertia: [transverse, transverse * 1.03, 0.1 * transverse],
            rotor: 0.0,
            coulomb: 0.0,
            viscous: 0.0,
            gain: random.random_range(1.5..12.0),
            torque: 0.0,
            q_noise: random.random_range(3e-5..1e-4),
            q_step: random.random_range(1e-5..8e-5),
            v_noise: random.random_range(5e-3..1.5e-2),
            room: Room {
                centre: if prismatic {
                    0.0
                } else {
                    random.random_range(0.1..0.5)
                },
                amplitude: if prismatic {
                    0.35
                } else {
                    random.random_range(0.8..1.2)
                },
                speed: if prismatic {
                    1.5
                } else {
                    random.random_range(3.0..5.0)
                },
                frequency: random.random_range(1.5..2.2),
            },
            length: if prismatic { 0.35 } else { 1.0 },
        });
    }
    let mut robot = Robot {
        joints,
        tool: [0.0, 0.0, if planar { -0.35 } else { 0.2 }],
        planar,
        rate: [250.0, 400.0, 500.0, 1000.0][random.random_range(0..4usize)],
        horizon: if n == 1 { LENGTH } else { 2.0 },
        drive_noise: random
            .random_range(DRIVE_NOISE.0.ln()..DRIVE_NOISE.1.ln())
            .exp(),
    };
    // Rotors, friction and torques in proportion to what the joint moves.
    let bare = Nominal::parse("nominal.toml", &nominal_text(&robot, false, "derived"))?;
    let plant = Plant::<f64>::new(&bare, &vec![0.0; n * PER_JOINT]);
    let q: Vec<f64> = robot.joints.iter().map(|j| j.room.centre).collect();
    let (m, _) = dynamics(&plant, &q, &vec![0.0; n]);
    let far: Vec<f64> = robot
        .joints
        .iter()
        .map(|j| j.room.centre + 0.8 * j.room.amplitude)
        .collect();
    let (_, weight) = dynamics(&plant, &far, &vec![0.0; n]);
    for (k, j) in robot.joints.iter_mut().enumerate() {
        j.rotor = m[(k, k)] * random.random_range(0.15..0.35);
        let turning = (m[(k, k)] + j.rotor) * 3.0 * j.room.speed;
        j.torque = weight[k].abs() + turning;
        j.coulomb = j.torque * random.random_range(0.03..0.07);
        j.viscous = j.torque / j.room.speed * random.random_range(0.05..0.12);
        if j.prismatic {
            j.q_noise *= 0.4;
            j.q_step *= 0.3;
            j.v_noise *= 0.35;
        }
    }
    Ok(robot)
}

fn list(x: [f64; 3]) -> String {
    format!("[{:?}, {:?}, {:?}]", x[0], x[1], x[2])
}

fn nominal_text(robot: &Robot, noise: bool, velocity: &str) -> String {
    let mut s = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        s,
        "[robot]\nname = \"drawn\"\ngravity = [0.0, 0.0, -9.81]\ntool = {}\nencoder_side = \"motor\"\nhorizon_s = {:?}\n",
        list(robot.tool),
        robot.horizon
    );
    if noise {
        let _ = writeln!(s, "input_noise = {:?}", robot.drive_noise);
    }
    if velocity == "derived" {
        let _ = writeln!(s, "velocity_filter_hz = {VELOCITY_HZ:?}");
    }
    s.push_str(
        "\n[tolerance]\nmass_rel = 0.05\ncom_abs_m = 0.003\ninertia_rel = 0.05\nrotor_inertia_rel = 0.05\nmotor_gain_rel = 0.01\nfriction_rel = 0.4\n",
    );
    for (k, j) in robot.joints.iter().enumerate() {
        let kind = if j.prismatic { "prismatic" } else { "revolute" };
        let [xx, yy, zz] = j.inertia;
        let _ = write!(
            s,
            "\n[[joint]]\nname = \"j{}\"\ntype = \"{kind}\"\naxis = {}\norigin = {}\nmass = {:?}\ncom = {}\ninertia = [{xx:?}, {yy:?}, {zz:?}, 0.0, 0.0, 0.0]\nrotor_inertia = {:?}\ncoulomb = {:?}\nviscous = {:?}\nmotor_gain = {:?}\ninput = \"current\"\nvelocity = \"{velocity}\"\n",
            k + 1,
            list(j.axis),
            list(j.origin),
            j.mass,
            list(j.com),
            j.rotor,
            j.coulomb,
            j.viscous,
            j.gain,
        );
        if j.torque > 0.0 {
            let _ = writeln!(s, "torque_peak = {:?}", j.torque);
        }
        if noise {
            let v = if velocity == "measured" {
                j.v_noise
            } else {
                0.0
            };
            let _ = write!(
                s,
                "q_resolution = {:?}\nq_noise_std = {:?}\ndq_noise_std = {v:?}\n",
                j.q_step, j.q_noise
            );
        }
    }
    s
}

fn dataset_text(id: &str, robot: &Robot, velocity: &str) -> String {
    let mut s = format!(
        "name = \"{id}\"\ntitle = \"drawn case\"\nsource = \"simtrue study\"\nlicense = \"as this program\"\nkind = \"simulated\"\ninput_hold = \"zero-order\"\n"
    );
    for (k, j) in robot.joints.iter().enumerate() {
        let kind = if j.prismatic { "prismatic" } else { "revolute" };
        let _ = write!(
            s,
            "\n[[joint]]\nname = \"j{}\"\ntype = \"{kind}\"\ninput = \"current\"\ninput_unit = \"A\"\nvelocity = \"{velocity}\"\n",
            k + 1
        );
    }
    for (name, role, _) in RECORDS {
        let _ = write!(
            s,
            "\n[[experiment]]\nfile = \"{name}\"\nrole = \"{role}\"\nsample_time_s = {:?}\nsamples = {}\nnote = \"\"\n",
            1.0 / robot.rate,
            (LENGTH * robot.rate) as usize + 1
        );
    }
    s
}

/// Normal number of mean 0 and standard deviation 1.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

/// One record under a controller with the nominal robot's inverse dynamics as feedforward and
/// proportional-derivative feedback.
fn record(
    robot: &Robot,
    nominal: &Nominal,
    plant: &Plant<f64>,
    causes: &[Cause],
    motion: Motion,
    velocity: &str,
    random: &mut ChaCha8Rng,
) -> String {
    let n = robot.joints.len();
    let h = 1.0 / robot.rate;
    let hold = (HOLDING * robot.rate) as usize;
    let samples = (LENGTH * robot.rate) as usize + 1;
    let per_sample = (h / STEP).round() as usize;
    let wanted: Vec<Vec<f64>> = robot
        .joints
        .iter()
        .map(|j| reference(motion, &j.room, samples, h, random))
        .collect();
    let target = |j: usize, k: usize| wanted[j][k.saturating_sub(hold).min(samples - 1)];
    let model = Plant::<f64>::new(nominal, &vec![0.0; n * PER_JOINT]);
    let start: Vec<f64> = (0..n).map(|j| target(j, 0)).collect();
    let mut world = World::new(plant.clone(), causes, &start);
    let weights: Vec<f64> = inertia(nominal, robot);
    let fade = (-std::f64::consts::TAU * VELOCITY_HZ * h).exp();
    let mut filtered = vec![0.0; n];
    let mut shown = vec![0.0; n];
    let mut previous: Vec<Option<f64>> = vec![None; n];
    let mut history: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut commands: Vec<Vec<f64>> = Vec::new();
    let mut text = String::from("t");
    for (head, some) in [("q", true), ("dq", velocity != "absent"), ("u", true)] {
        for j in 0..n {
            if some {
                let _ = write!(text, ",{head}{}", j + 1);
            }
        }
    }
    text.push('\n');
    history.push((0..n).map(|j| world.encoder(j)).collect());
    for k in 0..hold + samples {
        let now = history.len() - 1;
        let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
        for j in 0..n {
            let delay = causes
                .iter()
                .find_map(|c| match c.kind {
                    Kind::SensorDelay { delay } if c.joint == j => Some(delay / STEP),
                    _ => None,
                })
                .unwrap_or(0.0);
            let at = (now as f64 - delay).max(0.0);
            let (i, s) = (at.floor() as usize, at.fract());
            let ((qa, va), (qb, vb)) = (history[i][j], history[(i + 1).min(now)][j]);
            let (mut x, mut w) = (qa * (1.0 - s) + qb * s, va * (1.0 - s) + vb * s);
            for c in causes.iter().filter(|c| c.joint == j) {
                match c.kind {
                    Kind::EncoderOffset { offset } => x += offset,
                    Kind::EncoderEccentricity { amplitude, phase } => {
                        w *= 1.0 + amplitude * (x + phase).cos();
                        x += amplitude * (x + phase).sin();
                    }
                    _ => {}
                }
            }
            let joint = &robot.joints[j];
            let noisy = x + joint.q_noise * normal(random);
            q[j] = (noisy / joint.q_step).round() * joint.q_step;
            let difference = (q[j] - previous[j].unwrap_or(q[j])) / h;
            previous[j] = Some(q[j]);
            filtered[j] = fade * filtered[j] + (1.0 - fade) * difference;
            let mut read = if velocity == "measured" {
                w
            } else {
                filtered[j]
            };
            let lag = causes.iter().find_map(|c| match c.kind {
                Kind::VelocityFilterLag { time } if c.joint == j => Some((-h / time).exp()),
                _ => None,
            });
            if let Some(a) = lag {
                shown[j] = a * shown[j] + (1.0 - a) * read;
                read = shown[j];
            }
            if velocity == "measured" {
                read += joint.v_noise * normal(random);
            }
            v[j] = read;
        }
        // The controller works on the readings.
        let slope = |j: usize| (target(j, k + 1) - target(j, k.saturating_sub(1))) / (2.0 * h);
        let bend = |j: usize| {
            (target(j, k + 1) - 2.0 * target(j, k) + target(j, k.saturating_sub(1))) / (h * h)
        };
        let position: Vec<f64> = (0..n).map(|j| target(j, k)).collect();
        let rates: Vec<f64> = (0..n).map(slope).collect();
        let (m, bias) = dynamics(&model, &position, &rates);
        let mut u = vec![0.0; n];
        for j in 0..n {
            let mut torque = bias[j] + model.rotor[j] * bend(j);
            for i in 0..n {
                torque += m[(j, i)] * bend(i);
            }
            let (w, damping) = (18.0, 0.8);
            torque += weights[j]
                * (w * w * (position[j] - q[j]) + 2.0 * damping * w * (rates[j] - filtered[j]));
            let limit = 2.0 * robot.joints[j].torque;
            u[j] = torque.clamp(-limit, limit) / robot.joints[j].gain;
        }
        commands.push(u.clone());
        if k >= hold {
            let _ = write!(text, "{:.6}", (k - hold) as f64 * h);
            for x in &q {
                let _ = write!(text, ",{x:.7}");
            }
            if velocity != "absent" {
                for x in &v {
                    let _ = write!(text, ",{x:.6}");
                }
            }
            for x in &u {
                let _ = write!(text, ",{x:.7}");
            }
            text.push('\n');
        }
        world.command(&mut u, random);
        let noise: Vec<f64> = robot
            .joints
            .iter()
            .map(|j| robot.drive_noise * j.torque / j.gain * normal(random))
            .collect();
        for s in 0..per_sample {
            let t = (k as f64 - hold as f64) * h + s as f64 * STEP;
            let mut applied = u.clone();
            for c in causes {
                if let Kind::InputDelay { delay } = c.kind {
                    // The mean over the step, in which the command may change.
                    let at = |t: f64| {
                        let i = ((t - delay) / h + 1e-9).floor().max(0.0) as usize;
                        (i, commands[i.min(commands.len() - 1)][c.joint])
                    };
                    let from = k as f64 * h + s as f64 * STEP;
                    let ((_, before), (i, after)) = (at(from), at(from + STEP));
                    let share = ((from + STEP - delay - i as f64 * h) / STEP).clamp(0.0, 1.0);
                    applied[c.joint] = before + (after - before) * share;
                }
            }
            for (a, e) in applied.iter_mut().zip(&noise) {
                *a += e;
            }
            world.step(&applied, t);
            history.push((0..n).map(|j| world.encoder(j)).collect());
        }
    }
    text
}
