//! Reference motions of the study: sums of sines, slow reversing ramps, moves from point to point.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A record to be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Planned {
    /// Its file.
    pub(crate) name: String,
    /// `train` or `test`.
    pub(crate) role: &'static str,
    /// What the robot is to do.
    pub(crate) motion: Motion,
}

/// Names, roles and motions of the tidy records.
const TIDY: [(&str, &str, Motion); 5] = [
    ("train_sines.csv", "train", Motion::Sines(100, 60)),
    ("train_fast.csv", "train", Motion::Sines(85, 100)),
    ("train_ramps.csv", "train", Motion::Ramps),
    ("test_moves.csv", "test", Motion::Moves),
    ("test_sines.csv", "test", Motion::Sines(90, 90)),
];

/// The records of a tidy case.
pub(crate) fn tidy() -> Vec<Planned> {
    let planned = |(name, role, motion): (&str, &'static str, Motion)| Planned {
        name: name.to_owned(),
        role,
        motion,
    };
    TIDY.map(planned).to_vec()
}

/// A number of untidy records, 3 to 6: at least two to fit, and one or two to test.
pub(crate) fn untidy(count: usize, random: &mut ChaCha8Rng) -> Vec<Planned> {
    let tests = if count > 4 { 2 } else { 1 };
    let train = [
        Motion::Sines(100, 60),
        Motion::Ramps,
        Motion::Sines(85, 100),
        Motion::Moves,
    ];
    let mut test = [Motion::Moves, Motion::Sines(90, 90)];
    if random.random_bool(0.5) {
        test.reverse();
    }
    let planned = |role: &'static str, motions: &[Motion]| -> Vec<Planned> {
        (motions.iter().enumerate())
            .map(|(k, &motion)| Planned {
                name: format!("{role}_{}.csv", k + 1),
                role,
                motion,
            })
            .collect()
    };
    let mut all = planned("train", &train[..count.saturating_sub(tests).clamp(2, 4)]);
    all.extend(planned("test", &test[..tests]));
    all
}

/// Length of a tidy record, s.
pub(crate) const LENGTH: f64 = 7.0;

/// What a joint may do.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    /// Middle of the motion.
    pub centre: f64,
    /// Largest deviation from it.
    pub amplitude: f64,
    /// Largest speed.
    pub speed: f64,
    /// Largest frequency of the sines, Hz.
    pub frequency: f64,
}

/// Kind of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Motion {
    /// Five sines, faded in from rest; share of amplitude and frequency in per cent.
    Sines(u8, u8),
    /// Slow ramps that reverse.
    Ramps,
    /// Trapezoidal moves with rests.
    Moves,
}

/// Positions at the multiples of `h`.
pub(crate) fn reference(
    motion: Motion,
    room: &Room,
    samples: usize,
    h: f64,
    random: &mut ChaCha8Rng,
) -> Vec<f64> {
    match motion {
        Motion::Sines(amplitude, frequency) => sines(
            room,
            samples,
            h,
            f64::from(amplitude) / 100.0,
            f64::from(frequency) / 100.0,
            random,
        ),
        Motion::Ramps => steps(room, samples, h, true, random),
        Motion::Moves => steps(room, samples, h, false, random),
    }
}

fn sines(
    room: &Room,
    samples: usize,
    h: f64,
    amplitude: f64,
    frequency: f64,
    random: &mut ChaCha8Rng,
) -> Vec<f64> {
    let length = samples as f64 * h;
    let top = ((room.frequency * frequency * length) as usize).max(6);
    let tones: Vec<(f64, f64, f64)> = (0..5)
        .map(|_| {
            let k = random.random_range(1..=top) as f64;
            (
                std::f64::consts::TAU * k / length,
                random.random_range(0.5..1.0) / k.powf(0.9),
                random.random_range(0.0..std::f64::consts::TAU),
            )
        })
        .collect();
    let at = |t: f64| {
        tones
            .iter()
            .map(|(w, a, p)| a * (w * t + p).sin())
            .sum::<f64>()
    };
    let rate = |t: f64| {
        tones
            .iter()
            .map(|(w, a, p)| a * w * (w * t + p).cos())
            .sum::<f64>()
    };
    let times = (0..samples).map(|k| k as f64 * h);
    let (mut far, mut fast) = (1e-9_f64, 1e-9_f64);
    for t in times.clone() {
        far = far.max(at(t).abs());
        fast = fast.max(rate(t).abs());
    }
    let scale = (amplitude * room.amplitude / far).min(room.speed / fast);
    times
        .map(|t| {
            let x = (t / 0.8).min(1.0);
            let fade = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
            room.centre + fade * scale * at(t)
        })
        .collect()
}

/// Piecewise constant speeds with rests, rounded by two moving averages.
fn steps(room: &Room, samples: usize, h: f64, slow: bool, random: &mut ChaCha8Rng) -> Vec<f64> {
    let mut v = vec![0.0; samples];
    let mut k = (0.3 / h) as usize;
    let mut position = 0.0;
    let mut side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    while k < samples {
        let (speed, goal) = if slow {
            (
                0.06 * room.speed * random.random_range(0.25..1.6),
                side * room.amplitude * random.random_range(0.2..0.7),
            )
        } else {
            (
                room.speed * random.random_range(0.3..0.65),
                side * room.amplitude * random.random_range(0.35..0.9),
            )
        };
        let away: f64 = goal - position;
        let count = ((away.abs() / speed).min(2.2) / h).max(10.0) as usize;
        for x in v.iter_mut().skip(k).take(count) {
            *x = away.signum() * speed;
        }
        position += away.signum() * speed * count as f64 * h;
        let rest = if slow {
            if random.random_bool(0.5) { 0.15 } else { 0.0 }
        } else {
            random.random_range(0.3..0.6)
        };
        k += count + (rest / h) as usize;
        side = -side;
    }
    let window = ((if slow { 0.06 } else { 0.16 }) / h) as usize + 1;
    let v = average(&average(&v, window), window);
    let mut q = room.centre;
    v.iter()
        .map(|v| {
            q += v * h;
            q
        })
        .collect()
}

fn average(x: &[f64], window: usize) -> Vec<f64> {
    let mut sum = 0.0;
    (0..x.len())
        .map(|k| {
            sum += x[k];
            if k >= window {
                sum -= x[k - window];
            }
            sum / window as f64
        })
        .collect()
}
