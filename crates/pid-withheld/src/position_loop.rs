//! The position loop of one joint, step by step: what a target and the readings become at the motor.

use std::collections::VecDeque;

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
    /// Share of the current that moves the robot, as the drive knows it, with the target's acceleration.
    pub inertia: Option<f64>,
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
    /// Acceleration of what is followed; it comes to rest at each target.
    pub target_acceleration: Option<f64>,
    /// Time over which what is followed is averaged, s.
    pub target_average: Option<f64>,
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
    /// Where it rested first.
    start: f64,
    /// The target as it was taken, as it moves, and as it is followed.
    taken: f64,
    moved: f64,
    followed: f64,
    /// Its speed on the way there, and what it was at each step of the time over which it is averaged.
    goes: f64,
    trace: VecDeque<(f64, f64)>,
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
    growth: f64,
    smooth: f64,
    /// Acceleration of what is followed.
    acceleration: f64,
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
            start: target,
            taken: target,
            moved: target,
            followed: target,
            goes: 0.0,
            trace: VecDeque::new(),
            speed: None,
            integral: if integrates { current } else { 0.0 },
            current: 0.0,
            ahead: Ahead {
                every,
                due: origin % every,
                last: None,
                speed: 0.0,
                growth: 0.0,
                smooth: 0.0,
                acceleration: 0.0,
            },
            past: Vec::new(),
        }
    }

    /// Whether the loop reads in the next step.
    fn reads(&self) -> bool {
        self.step >= self.due
    }

    /// Whether it needs to know the robot in the next step.
    pub(crate) fn weighs(&self) -> bool {
        (self.own.gravity.is_some() || self.own.inertia.is_some()) && self.reads()
    }

    /// Takes the target of the next step in. Returns the acceleration of what it follows.
    pub(crate) fn aim(&mut self, target: f64) -> f64 {
        if self.step >= self.ahead.due {
            let own = &mut self.ahead;
            let time = own.every as f64 * STEP;
            let speed = own.last.map_or(0.0, |last| (target - last) / time);
            own.growth = (speed - own.speed) / time;
            own.speed = speed;
            own.last = Some(target);
            own.due += own.every;
        }
        if self.reads() {
            self.take(target);
        }
        self.ahead.acceleration
    }

    /// The current over the next step; `weight` is the current that holds the robot as the drive knows it, `push` that
    /// which moves it as the targets are accelerated.
    pub(crate) fn next(&mut self, now: (f64, f64), weight: f64, push: f64) -> f64 {
        let now = self.read_late(now);
        if self.reads() {
            self.read(now, weight, push);
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

    /// What becomes of the target over a period of the loop.
    fn take(&mut self, target: f64) {
        let own = self.own;
        let every = steps(own.rate);
        let period = every as f64 * STEP;
        if own.target_rate.is_none() || self.step >= self.target_due {
            self.taken = match own.target_step {
                Some(step) => (target / step).round() * step,
                None => target,
            };
            while self.step >= self.target_due {
                self.target_due += steps(own.target_rate);
            }
        }
        let fastest = own.target_speed.unwrap_or(f64::INFINITY);
        let (mut speed, mut growth) =
            (self.ahead.speed.clamp(-fastest, fastest), self.ahead.growth);
        if self.ahead.speed.abs() > fastest {
            growth = 0.0;
        }
        match own.target_acceleration {
            Some(most) => (speed, growth) = self.travel((fastest, most), every),
            None => {
                let most = fastest * period;
                self.moved += (self.taken - self.moved).clamp(-most, most);
                let now = (self.moved, speed);
                self.trace.extend((0..every).map(|_| now));
            }
        }
        let mut place = self.moved;
        if let Some(time) = own.target_average {
            let size = ((time / STEP).round() as usize).max(1);
            // Before the first step it rested where it began.
            while self.trace.len() < size {
                self.trace.push_front((self.start, 0.0));
            }
            self.trace.drain(..self.trace.len() - size);
            let time = size as f64 * STEP;
            growth = (speed - self.trace[0].1) / time;
            speed = (place - self.trace[0].0) / time;
            place = self.trace.iter().map(|x| x.0).sum::<f64>() / size as f64;
        } else {
            self.trace.clear();
        }
        self.followed += share(own.target_filter, period) * (place - self.followed);
        let ahead = &mut self.ahead;
        ahead.smooth += share(own.target_filter, period) * (speed - ahead.smooth);
        ahead.acceleration = match own.target_filter {
            Some(time) => (speed - ahead.smooth) / time,
            None => growth,
        };
    }

    /// Goes to the target by steps, each with as much speed as it can still brake from. Returns speed and acceleration
    /// at the end.
    fn travel(&mut self, (fastest, most): (f64, f64), every: usize) -> (f64, f64) {
        let mut gained = 0.0;
        for _ in 0..every {
            let way = self.taken - self.moved;
            // It brakes by whole steps: v²/2a and half a step of v.
            let half = 0.5 * most * STEP;
            let brakes = (half * half + 2.0 * most * way.abs()).sqrt() - half;
            let wanted = way.signum() * brakes.min(fastest);
            gained = (wanted - self.goes).clamp(-most * STEP, most * STEP);
            self.goes += gained;
            self.moved += self.goes * STEP;
            self.trace.push_back((self.moved, self.goes));
        }
        (self.goes, gained / STEP)
    }

    fn read(&mut self, (q, v): (f64, f64), weight: f64, push: f64) {
        let own = self.own;
        let period = steps(own.rate) as f64 * STEP;
        let ahead = own
            .target_share
            .map_or(0.0, |share| share * self.ahead.smooth);
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
        let fed = |share: Option<f64>, current: f64| share.map_or(0.0, |share| share * current);
        let rest = at_once + fed(own.gravity, weight) + fed(own.inertia, push);
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
            inertia: None,
            speed_filter: None,
            read_late: None,
            dead_band: None,
            target_step: None,
            target_rate: None,
            target_speed: None,
            target_acceleration: None,
            target_average: None,
            target_filter: None,
            rate: None,
        }
    }

    /// The current of a step under a target.
    fn step(running: &mut Running<'_>, target: f64, now: (f64, f64), weight: f64) -> f64 {
        running.aim(target);
        running.next(now, weight, 0.0)
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
            .map(|i| step(&mut running, f64::from(i), (0.0, 0.0), 0.0))
            .collect();
        assert!(out[..10].iter().all(|u| *u == 0.0), "{out:?}");
        assert!(out[10..30].iter().all(|u| *u == 100.0), "{out:?}");
        assert!(out[30..].iter().all(|u| *u == 100.0));
        let own = Loop { limit: 1e3, ..own };
        let mut running = Running::new(&own, 0.0, 0.0, (20, 10));
        let out: Vec<f64> = (0..40)
            .map(|i| step(&mut running, f64::from(i), (0.0, 0.0), 0.0))
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
        let u = step(&mut running, 0.4, (0.0, 0.3), 6.0);
        assert!((u - (10.0 * 0.3 - 2.0 * 0.3 + 3.0)).abs() < 1e-12, "{u}");
        let own = Loop {
            law: Law::Cascade,
            speed_limit: Some(1.5),
            ki: 4.0,
            ..pd()
        };
        let mut running = Running::new(&own, 0.0, 0.7, (20, 0));
        // 10 · 0.4 asks for 4, gets 1.5.
        let u = step(&mut running, 0.4, (0.0, 0.3), 0.0);
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
            .map(|i| step(&mut running, 0.004 * f64::from(i / 20), (0.0, 0.0), 0.0))
            .collect();
        assert_eq!(out[19], 0.0);
        assert!((out[20] - (10.0 * 0.004 + 2.0)).abs() < 1e-12, "{out:?}");
        assert!((out[59] - (10.0 * 0.008 + 2.0)).abs() < 1e-12, "{out:?}");
    }

    #[test]
    fn a_profile_is_followed_and_averaged() {
        // Half of 0.01 after the time in which 0.005 is gone at 4: 50 ms; all of it after 100 ms.
        let own = Loop {
            target_acceleration: Some(4.0),
            ..pd()
        };
        let goes = |own: &Loop| {
            let mut running = Running::new(own, 0.0, 0.0, (20, 0));
            let mut at = |_| {
                let acceleration = running.aim(0.01);
                let u = running.next((0.0, 0.0), 0.0, acceleration);
                (u / 10.0, acceleration)
            };
            (0..2000).map(&mut at).collect::<Vec<_>>()
        };
        let plain = goes(&own);
        assert!((plain[499].0 - 0.005).abs() < 2e-5, "{:?}", plain[499]);
        assert!((plain[1200].0 - 0.01).abs() < 1e-9, "{:?}", plain[1200]);
        assert!((plain[200].1 - 4.0).abs() < 1e-9 && (plain[700].1 + 4.0).abs() < 1e-6);
        // Over 40 ms more it is there 40 ms later, by half of that on average, and its acceleration grows along a line.
        let soft = goes(&Loop {
            target_average: Some(0.04),
            ..own
        });
        assert!((soft[699].0 - 0.005).abs() < 2e-5, "{:?}", soft[699]);
        assert!(soft[1350].0 < 0.01 - 1e-7 && (soft[1402].0 - 0.01).abs() < 1e-9);
        assert!((soft[199].1 - 2.0).abs() < 0.02, "{:?}", soft[199]);
        // What it accelerates with is fed forward.
        let fed = goes(&Loop {
            inertia: Some(0.5),
            ..own
        });
        assert!((fed[200].0 - plain[200].0 - 0.2).abs() < 1e-9);
    }

    #[test]
    fn a_late_loop_reads_what_was() {
        let own = Loop {
            read_late: Some(2.5 * STEP),
            ..pd()
        };
        let mut running = Running::new(&own, 0.0, 0.0, (20, 0));
        for i in 0..12 {
            let out = step(&mut running, 0.0, (f64::from(i), 0.0), 0.0);
            let read = (f64::from(i) - 2.5).max(0.0);
            // Before the first reading it was there.
            if i != 2 {
                assert!((out + 10.0 * read).abs() < 1e-12, "{i}: {out}");
            }
        }
    }
}
