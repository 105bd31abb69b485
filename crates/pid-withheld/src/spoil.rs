//! Makes records untidy: late samples, wrong stamps and readings, lost rows and cells.

use rand::RngExt;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;

use crate::mess::Mess;
use crate::sensors::normal;
use crate::setup::{Row, Setup};

/// Sizes of a wrong reading, in half ranges of the channel.
const SPIKE: std::ops::Range<f64> = 0.1..1.0;

impl Mess {
    /// Lateness of samples, shares of a period; the first is in time.
    pub(crate) fn late(&self, samples: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
        if self.jitter == 0.0 {
            return vec![0.0; samples];
        }
        (0..samples)
            .map(|k| match k {
                0 => 0.0,
                _ => random.random_range(0.0..self.jitter),
            })
            .collect()
    }

    /// Makes stamps wrong, readings wild and loses some; what is lost is NaN or a row less.
    pub(crate) fn spoil(&self, setup: &Setup<'_>, rows: &mut Vec<Row>, random: &mut ChaCha8Rng) {
        let (robot, h) = (setup.robot, 1.0 / setup.robot.rate);
        let channels = if setup.velocity == "absent" { 2 } else { 3 };
        if self.stamp > 0.0 {
            for row in rows.iter_mut() {
                row.t += self.stamp * h * normal(random);
            }
        }
        let wild = self.outliers * rows.len() as f64 * h;
        for _ in 0..whole(wild, random) {
            let k = random.random_range(0..rows.len());
            let j = random.random_range(0..robot.joints.len());
            let sign = if random.random_bool(0.5) { 1.0 } else { -1.0 };
            let size = sign * random.random_range(SPIKE);
            let joint = &robot.joints[j];
            match random.random_range(0..channels) {
                0 => rows[k].q[j] += size * joint.room.amplitude,
                1 => rows[k].u[j] += size * joint.torque / joint.gain,
                _ => rows[k].v[j] += size * joint.room.speed,
            }
        }
        self.lose(channels, rows, random);
    }

    /// Loses rows or cells, but never the first or the last row.
    fn lose(&self, channels: usize, rows: &mut Vec<Row>, random: &mut ChaCha8Rng) {
        let inner = rows.len().saturating_sub(2);
        let n = rows[0].q.len();
        let all = if self.cells {
            channels * n * inner
        } else {
            inner
        };
        let count = whole(self.lost * all as f64, random).min(all);
        let mut gone: Vec<usize> = sample(random, all, count).into_vec();
        gone.sort_unstable();
        for i in gone.into_iter().rev() {
            if !self.cells {
                rows.remove(i + 1);
                continue;
            }
            let row = &mut rows[i / (channels * n) + 1];
            let channel = [&mut row.q, &mut row.u, &mut row.v];
            channel[i / n % channels][i % n] = f64::NAN;
        }
    }
}

/// A whole number whose mean is `x`.
fn whole(x: f64, random: &mut ChaCha8Rng) -> usize {
    if x <= 0.0 {
        return 0;
    }
    x as usize + usize::from(random.random_bool(x.fract()))
}

#[cfg(test)]
mod tests {
    use pid_interpret::nominal::Nominal;
    use rand::SeedableRng;

    use super::*;
    use crate::family::{self, Family};
    use crate::motion::Motion;
    use crate::plant::{PER_JOINT, Plant};
    use crate::record::{run, text};
    use crate::text as words;

    /// A pendulum that lacks nothing, its rows spoiled by `mess`, and those of a tidy record.
    fn rows(mess: &Mess) -> (Vec<Row>, Vec<Row>) {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let mut robot = family::draw(Family::Pendulum, &mut random).expect("a robot");
        (robot.length, robot.rate) = (20.0, 250.0);
        let stated = words::nominal(&robot, None, "measured");
        let nominal = Nominal::parse("nominal.toml", &stated).expect("a description");
        let plant = Plant::new(&nominal, &[0.0; PER_JOINT]);
        let made = |mess: &Mess| {
            let setup = Setup {
                robot: &robot,
                nominal: &nominal,
                plant: &plant,
                theta: &[0.0; PER_JOINT],
                causes: &[],
                velocity: "measured",
                mess,
                loops: None,
            };
            let stream = |seed| ChaCha8Rng::seed_from_u64(seed);
            let (mut tidy, mut rest) = (stream(1), stream(2));
            let mut rows = run(&setup, Motion::Ramps, 250, &mut tidy, &mut rest).rows;
            mess.spoil(&setup, &mut rows, &mut rest);
            rows
        };
        (made(mess), made(&Mess::default()))
    }

    #[test]
    fn wrong_readings_stand_alone_and_come_as_often_as_drawn() {
        let mess = Mess {
            outliers: 0.3,
            ..Mess::default()
        };
        let (wild, tidy) = rows(&mess);
        let off = |of: fn(&Row) -> f64| {
            let pairs = wild.iter().zip(&tidy);
            pairs.filter(|(a, b)| of(a) != of(b)).count()
        };
        assert_eq!(off(|r| r.q[0]) + off(|r| r.v[0]) + off(|r| r.u[0]), 6);
    }

    #[test]
    fn rows_are_lost_and_cells_are_empty_in_the_drawn_share() {
        let mut mess = Mess {
            lost: 0.005,
            ..Mess::default()
        };
        let (rows_lost, tidy) = rows(&mess);
        assert_eq!(tidy.len() - rows_lost.len(), 25);
        mess.cells = true;
        let (cells_lost, _) = rows(&mess);
        let text = text(&cells_lost, "measured", "u");
        let empty = text.lines().flat_map(|line| line.split(','));
        assert_eq!(empty.filter(|cell| cell.is_empty()).count(), 75);
    }
}
