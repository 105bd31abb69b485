//! The position loop of one joint, step by step: what a target and the readings become at the motor.

use serde::{Deserialize, Serialize};

use crate::world::STEP;

/// The law of a loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// On the error alone.
    P,
    /// With damping.
    Pd,
    /// With an integral.
    Pid,
    /// A loop of the position around one of the velocity.
    Cascade,
}

impl Law {
    /// All of them.
    pub const ALL: [Law; 4] = [Law::P, Law::Pd, Law::Pid, Law::Cascade];

    /// Its word in a description.
    pub fn word(self) -> &'static str {
        match self {
            Law::P => "p",
            Law::Pd => "pd",
            Law::Pid => "pid",
            Law::Cascade => "cascade",
        }
    }
}

/// A loop with its numbers, in amperes and radians or metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Loop {
    /// Its law.
    pub law: Law,
    /// Current per error; of a cascade speed per error.
    pub kp: f64,
    /// Current per speed; of a cascade that per lack of speed.
    pub kd: f64,
    /// Growth of the current per error; of a cascade that per lack of speed.
    pub ki: f64,
    /// Largest current.
    pub limit: f64,
    /// Largest speed that a cascade asks for.
    pub speed_limit: Option<f64>,
    /// Share of gravity that the drive makes up for, as it knows the robot.
    pub gravity: Option<f64>,
    /// Share of the target's speed that it feeds forward.
    pub target_share: Option<f64>,
    /// Time constant of the filter of the speed, s.
    pub speed_filter: Option<f64>,
    /// How late it reads its encoder, s.
    pub read_late: Option<f64>,
    /// Error that counts as none.
    pub dead_band: Option<f64>,
    /// Step of the target.
    pub target_step: Option<f64>,
    /// Rate of targets, Hz.
    pub target_rate: Option<f64>,
    /// Largest speed of what is followed.
    pub target_speed: Option<f64>,
    /// Time constant of the filter of the target, s.
    pub target_filter: Option<f64>,
    /// Rate of the loop, Hz; none: at every step.
    pub rate: Option<f64>,
}

/// A loop at work.
pub(crate) struct Running<'a> {
    own: &'a Loop,
    /// Steps since the start, and those at which the loop and its target are due.
    step: usize,
    due: usize,
    target_due: usize,
    /// The target as it was taken, as it moves, and as it is followed.
    taken: f64,
    moved: f64,
    followed: f64,
    speed: Option<f64>,
    integral: f64,
    current: f64,
    ahead: Ahead,
    /// Readings of the last steps in a ring, as many as the loop is late, and between which it reads.
    past: Vec<(f64, f64)>,
}

/// The speed of the target, from one target to the next.
struct Ahead {
    /// Steps between targets, and the one at which the next comes.
    every: usize,
    due: usize,
    last: Option<f64>,
    speed: f64,
    smooth: f64,
}

/// Steps in a period of a rate, Hz.
fn steps(rate: Option<f64>) -> usize {
    rate.map_or(1, |rate| (1.0 / (rate * STEP)).round() as usize)
}

/// Share by which a filter follows in a time.
fn share(filter: Option<f64>, time: f64) -> f64 {
    filter.map_or(1.0, |constant| 1.0 - (-time / constant).exp())
}

impl<'a> Running<'a> {
    /// At rest at a target under the current that holds the joint; targets come every `every` and are taken from
    /// `origin` on, in steps.
    pub(crate) fn new(
        own: &'a Loop,
        target: f64,
        current: f64,
        (every, origin): (usize, usize),
    ) -> Self {
        let integrates = matches!(own.law, Law::Pid | Law::Cascade);
        let every = own.target_rate.map_or(every, |rate| steps(Some(rate)));
        Self {
            own,
            step: 0,
            due: 0,
            target_due: origin % steps(own.target_rate),
            taken: target,
            moved: target,
            followed: target,
            speed: None,
            integral: if integrates { current } else { 0.0 },
            current: 0.0,
            ahead: Ahead {
                every,
                due: origin % every,
                last: None,
                speed: 0.0,
                smooth: 0.0,
            },
            past: Vec::new(),
        }
    }

    /// Whether the loop reads in the next step.
    fn reads(&self) -> bool {
        self.step >= self.due
    }

    /// Whether it makes up for gravity in the next step.
    pub(crate) fn weighs(&self) -> bool {
        self.own.gravity.is_some() && self.reads()
    }

    /// The current over the next step; `weight` is the current that holds the robot as the drive knows it.
    pub(crate) fn next(&mut self, target: f64, (q, v): (f64, f64), weight: f64) -> f64 {
        let (q, v) = self.read_late((q, v));
        if self.step >= self.ahead.due {
            let own = &mut self.ahead;
            let time = own.every as f64 * STEP;
            own.speed = own.last.map_or(0.0, |last| (target - last) / time);
            own.last = Some(target);
            own.due += own.every;
        }
        if self.reads() {
            self.read(target, (q, v), weight);
            self.due += steps(self.own.rate);
        }
        self.step += 1;
        self.current
    }

    /// What it reads in place of what is there now.
    fn read_late(&mut self, now: (f64, f64)) -> (f64, f64) {
        let Some(late) = self.own.read_late else {
            return now;
        };
        let steps = late / STEP;
        let whole = steps.floor() as usize;
        let size = whole + 2;
        if self.past.is_empty() {
            self.past = vec![now; size];
        }
        let at = self.step % size;
        self.past[at] = now;
        let (after, before) = (
            self.past[(at + size - whole) % size],
            self.past[(at + 1) % size],
        );
        let part = steps.fract();
        let mix = |a: f64, b: f64| a + part * (b - a);
        (mix(after.0, before.0), mix(after.1, before.1))
    }

    fn read(&mut self, target: f64, (q, v): (f64, f64), weight: f64) {
        let own = self.own;
        let period = steps(own.rate) as f64 * STEP;
        if own.target_rate.is_none() || self.step >= self.target_due {
            self.taken = match own.target_step {
                Some(step) => (target / step).round() * step,
                None => target,
            };
            while self.step >= self.target_due {
                self.target_due += steps(own.target_rate);
            }
        }
        let most = own
            .target_speed
            .map_or(f64::INFINITY, |speed| speed * period);
        self.moved += (self.taken - self.moved).clamp(-most, most);
        self.followed += share(own.target_filter, period) * (self.moved - self.followed);
        let fastest = own.target_speed.unwrap_or(f64::INFINITY);
        let ahead = &mut self.ahead;
        let goes = ahead.speed.clamp(-fastest, fastest);
        ahead.smooth += share(own.target_filter, period) * (goes - ahead.smooth);
        let ahead = own.target_share.map_or(0.0, |share| share * ahead.smooth);
        let before = self.speed.unwrap_or(v);
        let speed = before + share(own.speed_filter, period) * (v - before);
        self.speed = Some(speed);
        let away = self.followed - q;
        let band = own.dead_band.unwrap_or(0.0);
        let error = away - away.clamp(-band, band);
        let (at_once, growth) = match own.law {
            Law::P => (own.kp * error, 0.0),
            Law::Pd => (own.kp * error - own.kd * (speed - ahead), 0.0),
            Law::Pid => (own.kp * error - own.kd * (speed - ahead), own.ki * error),
            Law::Cascade => {
                let most = own.speed_limit.unwrap_or(f64::INFINITY);
                let lack = (own.kp * error + ahead).clamp(-most, most) - speed;
                (own.kd * lack, own.ki * lack)
            }
        };
        let rest = at_once + own.gravity.map_or(0.0, |share| share * weight);
        let wanted = rest + self.integral;
        // The integral waits while the current is at its end and would be pushed beyond.
        if wanted.abs() <= own.limit || wanted * growth <= 0.0 {
            self.integral += growth * period;
        }
        self.current = (rest + self.integral).clamp(-own.limit, own.limit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pd() -> Loop {
        Loop {
            law: Law::Pd,
            kp: 10.0,
            kd: 2.0,
            ki: 0.0,
            limit: 100.0,
            speed_limit: None,
            gravity: None,
            target_share: None,
            speed_filter: None,
            read_late: None,
            dead_band: None,
            target_step: None,
            target_rate: None,
            target_speed: None,
            target_filter: None,
            rate: None,
        }
    }

    #[test]
    fn a_loop_reads_at_its_rate_and_takes_targets_at_theirs() {
        // At 2 kHz: five steps. Targets at 500 Hz: twenty, from the tenth step on.
        let own = Loop {
            rate: Some(2000.0),
            target_rate: Some(500.0),
            ..pd()
        };
        let mut running = Running::new(&own, 0.0, 0.0, (20, 10));
        let out: Vec<f64> = (0..40)
            .map(|i| running.next(f64::from(i), (0.0, 0.0), 0.0))
            .collect();
        assert!(out[..10].iter().all(|u| *u == 0.0), "{out:?}");
        assert!(out[10..30].iter().all(|u| *u == 100.0), "{out:?}");
        assert!(out[30..].iter().all(|u| *u == 100.0));
        let own = Loop { limit: 1e3, ..own };
        let mut running = Running::new(&own, 0.0, 0.0, (20, 10));
        let out: Vec<f64> = (0..40)
            .map(|i| running.next(f64::from(i), (0.0, 0.0), 0.0))
            .collect();
        assert_eq!(
            [out[9], out[10], out[29], out[30]],
            [0.0, 100.0, 100.0, 300.0]
        );
    }

    #[test]
    fn stages_by_hand() {
        let own = Loop {
            dead_band: Some(0.1),
            gravity: Some(0.5),
            ..pd()
        };
        let mut running = Running::new(&own, 0.0, 0.0, (20, 0));
        let u = running.next(0.4, (0.0, 0.3), 6.0);
        assert!((u - (10.0 * 0.3 - 2.0 * 0.3 + 3.0)).abs() < 1e-12, "{u}");
        let own = Loop {
            law: Law::Cascade,
            speed_limit: Some(1.5),
            ki: 4.0,
            ..pd()
        };
        let mut running = Running::new(&own, 0.0, 0.7, (20, 0));
        // 10 · 0.4 asks for 4, gets 1.5.
        let u = running.next(0.4, (0.0, 0.3), 0.0);
        assert!(
            (u - (2.0 * 1.2 + 0.7 + 4.0 * 1.2 * STEP)).abs() < 1e-12,
            "{u}"
        );
    }

    #[test]
    fn the_speed_of_a_target_is_fed_forward() {
        let own = Loop {
            target_share: Some(0.5),
            ..pd()
        };
        let mut running = Running::new(&own, 0.0, 0.0, (20, 0));
        // Targets every 20 steps of 0.1 ms go by 4 mrad: 2 rad/s.
        let out: Vec<f64> = (0..60)
            .map(|i| running.next(0.004 * f64::from(i / 20), (0.0, 0.0), 0.0))
            .collect();
        assert_eq!(out[19], 0.0);
        assert!((out[20] - (10.0 * 0.004 + 2.0)).abs() < 1e-12, "{out:?}");
        assert!((out[59] - (10.0 * 0.008 + 2.0)).abs() < 1e-12, "{out:?}");
    }

    #[test]
    fn a_late_loop_reads_what_was() {
        let own = Loop {
            read_late: Some(2.5 * STEP),
            ..pd()
        };
        let mut running = Running::new(&own, 0.0, 0.0, (20, 0));
        for i in 0..12 {
            let out = running.next(0.0, (f64::from(i), 0.0), 0.0);
            let read = (f64::from(i) - 2.5).max(0.0);
            // Before the first reading it was there.
            if i != 2 {
                assert!((out + 10.0 * read).abs() < 1e-12, "{i}: {out}");
            }
        }
    }
}
