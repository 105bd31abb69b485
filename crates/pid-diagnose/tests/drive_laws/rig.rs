//! A pendulum on a drive: symplectic Euler at 20 µs with friction by impulses, the loop written a second time.

use std::collections::VecDeque;

use pid_data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use pid_diagnose::nominal::Nominal;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Sample time of the records and step of the integrator, s.
const H: f64 = 0.01;
const STEP: f64 = 2e-5;
pub(super) const SAMPLES: usize = 800;
/// Deviation of a position reading, rad.
const READING: f64 = 3e-4;
/// Mass (kg) of the bar, distance (m) of its middle, moment about that, rotor (kg m²).
pub(super) const BAR: [f64; 4] = [1.5, 0.2, 0.02, 0.02];
/// Dry and viscous friction, torque per ampere, gravity.
const COULOMB: f64 = 0.15;
const VISCOUS: f64 = 0.12;
const GAIN: f64 = 1.8;
const G: f64 = 9.81;
/// Moment of the bar about its hinge with the rotor.
const INERTIA: f64 = BAR[0] * BAR[1] * BAR[1] + BAR[2] + BAR[3];

/// A loop as the integrator knows it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Loop {
    pub(super) kp: f64,
    pub(super) kd: f64,
    pub(super) ki: f64,
    pub(super) kv: f64,
    /// Whether kp asks for a velocity, at most so large.
    pub(super) cascade: Option<f64>,
    /// Share of gravity and the mass that the drive believes in.
    pub(super) gravity: Option<(f64, f64)>,
    /// Share of the torque that accelerates the bar as the target does.
    pub(super) inertia: Option<f64>,
    /// Share of the target's velocity.
    pub(super) ahead: Option<f64>,
    pub(super) velocity_filter: Option<f64>,
    /// How late position and velocity are read, s.
    pub(super) late: Option<f64>,
    pub(super) dead_band: Option<f64>,
    pub(super) step: Option<f64>,
    pub(super) target_hz: Option<f64>,
    pub(super) speed: Option<f64>,
    /// Acceleration of a profile, and over which time it is averaged.
    pub(super) acceleration: Option<f64>,
    pub(super) average: Option<f64>,
    pub(super) target_filter: Option<f64>,
    pub(super) limit: Option<f64>,
    /// Largest size of the integral's part.
    pub(super) most: Option<f64>,
    /// Speed at which nothing of the limit is left.
    pub(super) no_load: Option<f64>,
    pub(super) hz: Option<f64>,
    /// Voltage that the motor induces per velocity.
    pub(super) back_emf: f64,
    /// With the drive off the bar falls from the first target.
    pub(super) off: bool,
}

/// What the loop remembers.
#[derive(Default)]
struct Inside {
    /// Velocity and acceleration of the target.
    rate: f64,
    growth: f64,
    ahead: f64,
    /// The target that was taken last, and what becomes of it.
    target: f64,
    taken: f64,
    slewed: f64,
    /// Velocity of the profile, and its positions and velocities before now.
    goes: f64,
    trace: VecDeque<(f64, f64)>,
    followed: f64,
    velocity: f64,
    integral: f64,
    output: f64,
    next_target: f64,
    next: f64,
}

impl Loop {
    /// What has become of the target after a period: position, velocity, acceleration.
    fn shaped(&self, inside: &mut Inside, dt: f64) -> (f64, f64, f64) {
        let most = self.speed.unwrap_or(f64::INFINITY);
        let (mut rate, mut growth) = (inside.rate.clamp(-most, most), inside.growth);
        if inside.rate.abs() > most {
            growth = 0.0;
        }
        for _ in 0..(dt / STEP).round() as usize {
            let way = inside.taken - inside.slewed;
            match self.acceleration {
                Some(a) => {
                    // As fast as it can still brake from by whole steps.
                    let half = 0.5 * a * STEP;
                    let brakes = (half * half + 2.0 * a * way.abs()).sqrt() - half;
                    let gained = way.signum() * brakes.min(most) - inside.goes;
                    growth = gained.clamp(-a * STEP, a * STEP) / STEP;
                    inside.goes += growth * STEP;
                    inside.slewed += inside.goes * STEP;
                    rate = inside.goes;
                }
                None => inside.slewed += way.clamp(-most * STEP, most * STEP),
            }
            inside.trace.push_back((inside.slewed, rate));
        }
        let Some(time) = self.average else {
            inside.trace.clear();
            return (inside.slewed, rate, growth);
        };
        let size = (time / STEP).round() as usize;
        while inside.trace.len() < size {
            inside.trace.push_front((0.0, 0.0));
        }
        inside.trace.drain(..inside.trace.len() - size);
        let old = inside.trace[0];
        let sum: f64 = inside.trace.iter().map(|x| x.0).sum();
        (
            sum / size as f64,
            (inside.slewed - old.0) / time,
            (rate - old.1) / time,
        )
    }

    /// The current after reading `q`, `v` at time `t`.
    fn current(&self, inside: &mut Inside, r: f64, (q, v): (f64, f64), t: f64) -> f64 {
        let dt = self.hz.map_or(STEP, |hz| 1.0 / hz);
        if t + 1e-9 < inside.next {
            return inside.output;
        }
        inside.next += dt;
        if t + 1e-9 >= inside.next_target {
            inside.taken = self.step.map_or(r, |step| (r / step).round() * step);
            inside.next_target += self.target_hz.map_or(dt, |hz| 1.0 / hz);
            if let Some(hz) = self.target_hz {
                let rate = (r - inside.target) * hz;
                (inside.rate, inside.growth) = (rate, (rate - inside.rate) * hz);
                inside.target = r;
            }
        }
        let (place, rate, growth) = self.shaped(inside, dt);
        let share = |time: Option<f64>| time.map_or(1.0, |time| 1.0 - (-dt / time).exp());
        inside.followed += share(self.target_filter) * (place - inside.followed);
        inside.ahead += share(self.target_filter) * (rate - inside.ahead);
        let growth = match self.target_filter {
            Some(time) => (rate - inside.ahead) / time,
            None => growth,
        };
        let ahead = self.ahead.unwrap_or(0.0) * inside.ahead;
        inside.velocity += share(self.velocity_filter) * (v - inside.velocity);
        let mut error = inside.followed - q;
        if let Some(band) = self.dead_band {
            error = error.signum() * (error.abs() - band).max(0.0);
        }
        let (direct, rate) = match self.cascade {
            Some(most) => {
                let lacks = (self.kp * error + ahead).clamp(-most, most) - inside.velocity;
                (self.kv * lacks, self.ki * lacks)
            }
            None => (
                self.kp * error - self.kd * (inside.velocity - ahead),
                self.ki * error,
            ),
        };
        let feed = self.gravity.map_or(0.0, |(share, mass)| {
            share * mass * G * BAR[1] * q.sin() / GAIN
        }) + self.inertia.unwrap_or(0.0) * INERTIA * growth / GAIN;
        let limit = self.limit.unwrap_or(f64::INFINITY);
        let before = direct + inside.integral + feed;
        if before.abs() <= limit || before * rate < 0.0 {
            inside.integral += rate * dt;
        }
        let most = self.most.unwrap_or(f64::INFINITY);
        inside.integral = inside.integral.clamp(-most, most);
        inside.output = (direct + inside.integral + feed).clamp(-limit, limit);
        inside.output
    }

    /// What the motor brings of a current or a voltage at a speed.
    fn brought(&self, asked: f64, v: f64) -> f64 {
        if self.off {
            return 0.0;
        }
        let asked = asked - self.back_emf * v;
        let (Some(limit), Some(speed)) = (self.limit, self.no_load) else {
            return asked;
        };
        let most = |v: f64| limit * (1.0 - v / speed);
        asked.clamp(-most(-v), most(v))
    }

    /// Positions at the samples under targets, from rest at zero; `stribeck`: how much larger than sliding
    /// friction that at rest is, and over which speed; `load`: a mass at the middle of the bar.
    pub(super) fn run(&self, targets: &[f64], stribeck: Option<[f64; 2]>, load: f64) -> Vec<f64> {
        let (mut q, mut v, mut inside) = (0.0_f64, 0.0_f64, Inside::default());
        if self.off {
            q = targets[0];
        }
        let mass = BAR[0] + load;
        let inertia = mass * BAR[1] * BAR[1] + BAR[2] + BAR[3];
        let steps = (H / STEP).round() as usize;
        let mut out = Vec::with_capacity(targets.len());
        let late = (self.late.unwrap_or(0.0) / STEP).round() as usize;
        let mut past = vec![(q, v); late + 1];
        for (k, r) in targets.iter().enumerate() {
            out.push(q);
            let rate = (r - targets[k.saturating_sub(1)]) / H;
            if self.target_hz.is_none() {
                (inside.rate, inside.growth) = (rate, (rate - inside.rate) / H);
            }
            for s in 0..steps {
                let t = k as f64 * H + s as f64 * STEP;
                let now = (k * steps + s) % (late + 1);
                past[now] = (q, v);
                let read = past[(now + 1) % (late + 1)];
                let asked = self.current(&mut inside, *r, read, t);
                let torque = GAIN * self.brought(asked, v);
                let free =
                    v + STEP / inertia * (torque - mass * G * BAR[1] * q.sin() - VISCOUS * v);
                let more = stribeck.map_or(1.0, |[ratio, speed]| {
                    1.0 + (ratio - 1.0) * (-(v / speed).powi(2)).exp()
                });
                let most = STEP / inertia * COULOMB * more;
                v = free - free.clamp(-most, most);
                q += STEP * v;
            }
        }
        out
    }
}

/// The description of the bar with a loop.
pub(super) fn described(drive: &str) -> Nominal {
    let [mass, arm, moment, rotor] = BAR;
    let text = format!(
        "[robot]\nname = \"bar\"\ngravity = [0.0, 0.0, -{G}]\ntool = [0.0, 0.0, -{arm}]\nhorizon_s = 1.0\ninput_noise = 0.001\n\
         [tolerance]\nmass_rel = 0.01\ncom_abs_m = 0.001\ninertia_rel = 0.02\nrotor_inertia_rel = 0.02\nmotor_gain_rel = 0.0\n\
         friction_rel = 0.5\n[[joint]]\nname = \"a\"\ntype = \"revolute\"\naxis = [0.0, 1.0, 0.0]\norigin = [0.0, 0.0, 0.0]\n\
         mass = {mass}\ncom = [0.0, 0.0, -{arm}]\ninertia = [{moment}, {moment}, 0.001, 0.0, 0.0, 0.0]\nrotor_inertia = {rotor}\n\
         coulomb = {COULOMB}\nviscous = {VISCOUS}\nmotor_gain = {GAIN}\ninput = \"current\"\nvelocity = \"absent\"\n\
         q_noise_std = {READING}\ntorque_peak = 6.0\n[joint.drive]\n{drive}\n"
    );
    Nominal::parse(&text, "nominal.toml".as_ref()).expect("a description")
}

/// Targets of a record: rest, then slow sines, or steps between rests.
fn targets(random: &mut ChaCha8Rng, record: usize) -> Vec<f64> {
    let waves: Vec<[f64; 3]> = (0..4)
        .map(|k| {
            let f = 0.2 + 0.5 * f64::from(k) + 0.2 * random.random::<f64>();
            let size = 0.45 / (1.0 + f64::from(k));
            [f, size, std::f64::consts::TAU * random.random::<f64>()]
        })
        .collect();
    let mut step = 0.0;
    let of = |k: usize| {
        if k < 20 {
            return 0.0;
        }
        if k.is_multiple_of(80) {
            step = 0.8 * (random.random::<f64>() - 0.5);
        }
        let t = H * (k - 20) as f64;
        let wave = |[f, a, p]: &[f64; 3]| a * ((std::f64::consts::TAU * f * t + p).sin() - p.sin());
        match record % 2 {
            0 => waves.iter().map(wave).sum(),
            _ => step,
        }
    };
    (0..SAMPLES).map(of).collect()
}

/// Records of the bar behind a loop, three to fit and two to test.
pub(super) fn records(own: &Loop, stribeck: Option<[f64; 2]>, load: f64, seed: u64) -> Dataset {
    read_with(READING, own, (stribeck, load), seed)
}

/// The same without noise, Stribeck friction and load.
pub(super) fn exact_records(own: &Loop, seed: u64) -> Dataset {
    read_with(0.0, own, (None, 0.0), seed)
}

fn read_with(
    reading: f64,
    own: &Loop,
    (stribeck, load): (Option<[f64; 2]>, f64),
    seed: u64,
) -> Dataset {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let record = |i: usize| {
        let r = targets(&mut random, i);
        let noise = |q: f64| q + reading * random.sample::<f64, _>(StandardNormal);
        Experiment {
            name: format!("r{i}"),
            role: if i < 3 { Role::Train } else { Role::Test },
            note: String::new(),
            nq: 1,
            t: (0..SAMPLES).map(|k| H * k as f64).collect(),
            q: own.run(&r, stribeck, load).into_iter().map(noise).collect(),
            v: None,
            u: r.clone(),
            tau: None,
            qref: Some(r),
            missing: 0,
            gain_factors: Default::default(),
        }
    };
    Dataset {
        name: "bar".to_owned(),
        title: String::new(),
        source: "simulated".to_owned(),
        license: "none".to_owned(),
        kind: Kind::Simulated,
        input_hold: InputHold::ZeroOrder,
        joints: vec![JointChannels {
            name: "a".to_owned(),
            prismatic: false,
            input: InputQuantity::Position,
            input_unit: "rad".to_owned(),
            velocity: VelocityKind::Absent,
        }],
        experiments: (0..5).map(record).collect(),
        warnings: Vec::new(),
    }
}

pub(super) const PD: Loop = Loop {
    kp: 12.0,
    kd: 0.9,
    ki: 0.0,
    kv: 0.0,
    cascade: None,
    gravity: None,
    inertia: None,
    ahead: None,
    velocity_filter: None,
    late: None,
    dead_band: None,
    step: None,
    target_hz: None,
    speed: None,
    acceleration: None,
    average: None,
    target_filter: None,
    limit: Some(6.0),
    most: None,
    no_load: None,
    hz: None,
    back_emf: 0.0,
    off: false,
};
pub(super) const PID: Loop = Loop { ki: 25.0, ..PD };
pub(super) const CASCADE: Loop = Loop {
    kp: 12.0,
    kv: 1.1,
    ki: 8.0,
    cascade: Some(3.0),
    ..PD
};
