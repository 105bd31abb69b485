//! Restart windows: a record is cut into stretches, and each is simulated on its own.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::Experiment;

/// How far a simulation runs before it is restarted from the data.
///
/// Written `record`, `1s` (`0.5s`, …) or a number of samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Horizon {
    /// The whole record: output error.
    Record,
    /// So many seconds.
    Seconds(f64),
    /// So many sampling steps; one step is the equation error.
    Samples(usize),
}

impl fmt::Display for Horizon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Horizon::Record => f.write_str("record"),
            Horizon::Seconds(s) => write!(f, "{s} s"),
            Horizon::Samples(1) => f.write_str("1 sample"),
            Horizon::Samples(n) => write!(f, "{n} samples"),
        }
    }
}

/// A horizon that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is not a horizon\n  help: write `record`, a time such as `1s` or `0.25s`, or a number of samples such as `10`, above zero"
)]
pub struct ParseHorizonError(pub String);

impl FromStr for Horizon {
    type Err = ParseHorizonError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let word = text.trim();
        let horizon = if word == "record" {
            Some(Horizon::Record)
        } else if let Some(seconds) = word.strip_suffix('s') {
            let seconds = seconds.trim_end().parse::<f64>().ok();
            seconds
                .filter(|s| s.is_finite() && *s > 0.0)
                .map(Horizon::Seconds)
        } else {
            word.parse::<usize>()
                .ok()
                .filter(|n| *n > 0)
                .map(Horizon::Samples)
        };
        horizon.ok_or_else(|| ParseHorizonError(text.to_owned()))
    }
}

/// Cuts a record into restart windows.
///
/// Consecutive windows share the sample at their border, so every sampling step belongs to exactly
/// one window. [`Horizon::Samples(n)`](Horizon::Samples) windows have `n` steps, that is `n + 1`
/// samples. A [`Horizon::Seconds`] window ends at the sample whose time is nearest to its start
/// plus the horizon. A window has at least one step. The rest at the end of a record is a window if
/// it lasts at least half a horizon; a shorter rest is dropped. A record shorter than the horizon
/// is one window. A record of fewer than two samples has none.
pub fn windows(experiment: &Experiment, horizon: Horizon) -> Vec<Range<usize>> {
    let t = &experiment.t;
    let last = match t.len() {
        0 | 1 => return Vec::new(),
        n => n - 1,
    };
    let mut out = Vec::new();
    let mut start = 0;
    while start < last {
        let (end, long_enough) = match horizon {
            Horizon::Record => (last, true),
            Horizon::Samples(n) => {
                let n = n.max(1);
                let end = start.saturating_add(n).min(last);
                (end, 2 * (end - start) >= n)
            }
            Horizon::Seconds(s) => {
                let end = nearest(t, t[start] + s).clamp(start + 1, last);
                (end, 2.0 * (t[end] - t[start]) >= s * (1.0 - 1e-9))
            }
        };
        if long_enough || end < last || out.is_empty() {
            out.push(start..end + 1);
        }
        start = end;
    }
    out
}

/// Index of the sample nearest to a time.
fn nearest(t: &[f64], time: f64) -> usize {
    let after = t.partition_point(|x| *x < time);
    if after == 0 {
        0
    } else if after == t.len() || time - t[after - 1] <= t[after] - time {
        after - 1
    } else {
        after
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::Role;
    use super::*;

    fn record(t: Vec<f64>) -> Experiment {
        let n = t.len();
        Experiment {
            name: "r".into(),
            role: Role::Train,
            note: String::new(),
            nq: 1,
            t,
            q: vec![0.0; n],
            v: None,
            u: vec![0.0; n],
            tau: None,
            qref: None,
            missing: 0,
            gain_factors: Default::default(),
        }
    }

    fn uniform(n: usize, h: f64) -> Experiment {
        record((0..n).map(|i| i as f64 * h).collect())
    }

    #[test]
    #[allow(clippy::single_range_in_vec_init)] // one window is a list of one range
    fn windows_share_their_border_and_keep_a_rest_of_half_a_window() {
        let e = uniform(11, 0.1);
        assert_eq!(windows(&e, Horizon::Record), [0..11]);
        assert_eq!(windows(&e, Horizon::Samples(5)), [0..6, 5..11]);
        assert_eq!(windows(&e, Horizon::Samples(4)), [0..5, 4..9, 8..11]);
        assert_eq!(windows(&e, Horizon::Samples(7)), [0..8]);
        assert_eq!(windows(&e, Horizon::Seconds(0.4)), [0..5, 4..9, 8..11]);
        assert_eq!(windows(&e, Horizon::Seconds(30.0)), [0..11]);
        assert_eq!(windows(&e, Horizon::Samples(1)).len(), 10);
        assert!(windows(&uniform(1, 0.1), Horizon::Record).is_empty());
    }

    #[test]
    fn seconds_follow_the_time_stamps() {
        let e = record(vec![0.0, 0.1, 0.2, 0.9, 1.05, 1.2, 2.0]);
        assert_eq!(windows(&e, Horizon::Seconds(1.0)), [0..5, 4..7]);
    }

    #[test]
    fn horizons_are_read_and_refused() {
        let read = |s: &str| s.parse::<Horizon>();
        assert_eq!(read("record"), Ok(Horizon::Record));
        assert_eq!(read("1s"), Ok(Horizon::Seconds(1.0)));
        assert_eq!(read("0.25 s"), Ok(Horizon::Seconds(0.25)));
        assert_eq!(read("10"), Ok(Horizon::Samples(10)));
        for bad in ["", "0", "0s", "-1s", "nans", "infs", "1.5", "s", "samples"] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }

    proptest! {
        #[test]
        fn every_step_belongs_to_at_most_one_window(
            steps in prop::collection::vec(0.001_f64..0.1, 1..200),
            horizon in 0.005_f64..3.0,
        ) {
            let mut t = vec![0.0];
            for s in &steps {
                t.push(t[t.len() - 1] + s);
            }
            let e = record(t);
            let w = windows(&e, Horizon::Seconds(horizon));
            prop_assert!(!w.is_empty());
            prop_assert_eq!(w[0].start, 0);
            for pair in w.windows(2) {
                prop_assert_eq!(pair[0].end - 1, pair[1].start);
            }
            let last = w.last().unwrap().end - 1;
            prop_assert!(e.t[e.len() - 1] - e.t[last] < 0.5 * horizon);
            prop_assert!(w.iter().all(|r| r.len() >= 2));
        }
    }
}
